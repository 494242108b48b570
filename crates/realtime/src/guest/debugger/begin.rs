//! The first stop of a debugger session: runs the program to the place where the debugger first
//! finds it.

use protocols::Instant;

use super::failure::{First, Spot};
use super::wires::Wires;
use super::{Event, Session, THERE};
use crate::guest::GuestError;
use crate::guest::supervisor::{Goal, Stop, Wanted};

impl Session<'_> {
    /// Runs the program to the place where the debugger first finds it; returns whether the place
    /// was reached.
    pub(super) fn run_to_start(&mut self) -> Result<bool, GuestError> {
        self.find_program()?;
        let spot = match self.settings.on_fail {
            true => match self.look_for_failure()? {
                Some(spot) => Some(spot),
                None => return Ok(false),
            },
            false => {
                let at = self.settings.at;
                at.map(|at| Spot::Time(Instant::ZERO + at))
            }
        };
        let is_loaded = self.load_again()?;
        if self.trial.is_none() || !(self.goes_on)() {
            return Ok(false);
        }
        if !is_loaded {
            self.miss_program();
            return Ok(false);
        }
        let is_there = match spot {
            None => true,
            Some(Spot::Time(at)) => self.reach_goal(Goal::Time(at))?,
            Some(Spot::Call(moment)) => self.reach_goal(Goal::Moment(moment))?,
            Some(Spot::Signal(number)) => self.reach_signal(number)?,
        };
        if !is_there && (self.goes_on)() {
            let now = self.trial().now();
            self.missed = Some(match self.settings.on_fail {
                true => format!(
                    "--on-fail: the second run was over at {now} s and did not come to the place of \
                     the failure: the program does not repeat; check it with hilrig run --virtual \
                     --check"
                ),
                false => format!(
                    "--at: the run was over at {now} s, before that place: expected an earlier --at"
                ),
            });
        }
        Ok(is_there)
    }

    /// Stores the error that no program to debug was started, and lists the programs that were.
    fn miss_program(&mut self) {
        let debugging = self.supervisor().debugging();
        let started = debugging.map_or_else(String::new, |it| it.started().join(", "));
        let started = match started.is_empty() {
            true => "the command started no program".to_owned(),
            false => format!("the command started {started}"),
        };
        self.missed = Some(match &self.settings.program {
            Some(name) => format!(
                "--program {name}: no program of that name that can be debugged was started; \
                 {started}: expected the name of one of these"
            ),
            None => format!(
                "--exec: no program was started that could be debugged; {started}: expected one \
                 that is no shell, or its name by --program"
            ),
        });
    }

    /// Runs the program once; returns the place where the run failed, if it failed.
    fn look_for_failure(&mut self) -> Result<Option<Spot>, GuestError> {
        if !self.load_again()? {
            if (self.goes_on)() {
                self.miss_program();
            }
            return Ok(None);
        }
        Ok(match self.find_failure()? {
            First::Failed(failure) => {
                (self.say)(&failure.what);
                (self.say)("running again to the place before it");
                Some(failure.spot)
            }
            First::Passed => {
                (self.say)("no check fails: nothing to stop at");
                None
            }
            First::Cut => None,
        })
    }

    /// Waits until a program that has just started is loaded; returns whether it was loaded.
    pub(super) fn load(&mut self) -> Result<bool, GuestError> {
        let wanted = self.wanted.clone().unwrap_or_default();
        self.supervisor().begin_debugging(wanted);
        self.wires = Wires::default();
        self.wires.listen(self.trial.as_mut().expect(THERE));
        loop {
            match self.run_until_event()? {
                Some(Event::Stop(Stop::Loaded(tid))) => {
                    self.current = Some(tid);
                    return Ok(true);
                }
                Some(Event::Stop(_)) => {}
                Some(Event::Over) | None => return Ok(false),
            }
        }
    }

    /// Finds the program to debug: among the programs that a command starts, the first one that
    /// uses a port. The command runs until then.
    fn find_program(&mut self) -> Result<(), GuestError> {
        if let Some(name) = &self.settings.program {
            self.wanted = Some(Wanted::Name(name.clone()));
            return Ok(());
        }
        self.trial = (self.start)();
        if self.trial.is_none() {
            return Ok(());
        }
        self.supervisor().begin_debugging(Wanted::Nothing);
        let mut user = None;
        while user.is_none() && (self.goes_on)() {
            let event = self.run_turn()?;
            user = self.supervisor().debugging().and_then(|it| it.port_user());
            if let Some(Event::Over) = event {
                break;
            }
        }
        self.wanted = Some(user.map_or(Wanted::NoShell, Wanted::Load));
        Ok(())
    }

    /// Runs to the signal with this number, counted from the start.
    pub(super) fn reach_signal(&mut self, number: u64) -> Result<bool, GuestError> {
        let mut left = number;
        loop {
            match self.run_until_event()? {
                Some(Event::Stop(Stop::Signal(tid, _))) => {
                    self.current = Some(tid);
                    left -= 1;
                    if left == 0 {
                        return Ok(true);
                    }
                }
                Some(Event::Stop(Stop::Ended(_)) | Event::Over) | None => return Ok(false),
                Some(Event::Stop(_)) => {}
            }
        }
    }
}
