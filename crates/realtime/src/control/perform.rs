//! Execution of requests.

use core::time::Duration;
use protocols::Instant;
use serde_json::json;

use super::answer::{Answer, Refusal};
use super::modem::{self, Port, Wish};
use super::request::Request;
use crate::clock::Clock as _;
use crate::held::{Held, SPEEDS, STEP_MAX};
use engine::rig::fault::FaultId;
use engine::run::{CommandError, Run, Watch};
use engine::scenario::{Action, Condition, Span};

/// A run, and the other objects of requests.
pub(super) struct Office<'a> {
    pub(super) run: &'a mut Run,
    /// Clock control of the run, if clients may use it.
    pub(super) tempo: Option<&'a Held>,
    pub(super) ports: &'a mut [Port],
    /// Current number of clients.
    pub(super) clients: usize,
    pub(super) tally: &'a mut Tally,
}

/// Counts of all requests.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Tally {
    pub(super) requests: u64,
    pub(super) refused: u64,
    /// Requests that changed the run.
    pub(super) changes: u64,
    /// Whether a client requested the end of the run.
    pub(super) quits: bool,
}

/// State of one client.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Session {
    /// Number of contacts already reported to the client.
    pub(super) contacts: u64,
    /// Whether the client sets the modem lines for programs that open ports.
    pub(super) has_modem: bool,
}

/// An answer, or the event before it.
pub(super) enum Reply {
    Now(Answer),
    Later(Pending),
}

/// Event for which an answer waits.
#[derive(Debug)]
pub(super) enum Pending {
    /// A condition, until a moment.
    Condition(Box<Watch>, Instant),
    /// The end of a step.
    Step(Instant),
}

impl Pending {
    /// Latest time of the answer.
    pub(super) const fn until(&self) -> Instant {
        match self {
            Self::Condition(_, until) | Self::Step(until) => *until,
        }
    }
}

impl Office<'_> {
    /// Executes `line`, which was read at `asked`.
    pub(super) fn perform(&mut self, session: &mut Session, line: &[u8], asked: Instant) -> Reply {
        let request = Request::parse(line);
        let reply = request.and_then(|request| self.grant(session, request, asked));
        self.tally.requests += 1;
        reply.unwrap_or_else(|refusal| {
            self.tally.refused += 1;
            Reply::Now(refusal.into())
        })
    }

    /// Whether the answer can be sent now.
    pub(super) fn look_again(&self, pending: Pending) -> Reply {
        let now = self.run.rig.now();
        match pending {
            Pending::Condition(watch, until) => {
                let held = self.run.has_come(&watch);
                match held || now >= until {
                    true => Reply::Now(Answer::granted(json!({"held": held})).at(now)),
                    false => Reply::Later(Pending::Condition(watch, until)),
                }
            }
            Pending::Step(until) if now >= until => Reply::Now(self.granted_now()),
            pending @ Pending::Step(_) => Reply::Later(pending),
        }
    }

    fn grant(
        &mut self,
        session: &mut Session,
        request: Request,
        asked: Instant,
    ) -> Result<Reply, Refusal> {
        Ok(Reply::Now(match request {
            Request::Hello {} => Answer::granted(self.hello()),
            Request::State {} => Answer::granted(self.state(session)),
            Request::Verdict {} => Answer::granted(self.verdict()).at(self.run.rig.now()),
            Request::Wait { condition, timeout } => return self.wait(&condition, timeout),
            Request::Step { by } => return self.step(by),
            Request::Pause {} => self.pace(Held::hold)?,
            Request::Resume {} => self.pace(Held::let_go)?,
            Request::Speed { x } => self.speed(x)?,
            Request::Press { display, button } => self.press(display, button)?,
            Request::Mission { action } => self.mission(action)?,
            Request::Quit {} => {
                self.tally.quits = true;
                self.granted_now()
            }
            Request::Modem {
                port,
                dtr,
                rts,
                cts,
                dsr,
                ri,
                dcd,
                sends_break,
                modes,
                discard,
            } => {
                let wish = Wish {
                    outputs: [dtr, rts],
                    inputs: [cts, dsr, ri, dcd],
                    sends_break,
                    modes,
                    discards: discard,
                };
                self.modem(session, port.as_deref(), wish)?
            }
            Request::List {} => Answer {
                ok: true,
                faults: Some(self.run.faults().collect()),
                ..Answer::default()
            },
            Request::Add { fault } => {
                let id = self.run.inject(*fault)?;
                self.changed_fault(id, asked)
            }
            Request::End { id } => {
                self.run.withdraw(id)?;
                self.changed_fault(id, asked)
            }
        }))
    }

    fn modem(
        &mut self,
        session: &mut Session,
        port: Option<&str>,
        wish: Wish,
    ) -> Result<Answer, Refusal> {
        // A client that only sets lines by hand does not supervise programs at the ports.
        session.has_modem |= wish.inputs == [None; 4];
        let lines = port.map(|port| modem::change(self.ports, self.run, port, wish));
        let lines = lines.transpose()?;
        Ok(Answer::granted(lines.unwrap_or_default()).at(self.run.rig.now()))
    }

    fn granted_now(&self) -> Answer {
        Answer::granted(json!({})).at(self.run.rig.now())
    }

    fn changed_fault(&mut self, id: FaultId, asked: Instant) -> Answer {
        self.tally.changes += 1;
        Answer {
            ok: true,
            id: Some(id),
            asked: Some(Span(asked - Instant::ZERO)),
            applied: Some(Span(self.run.rig.now() - Instant::ZERO)),
            ..Answer::default()
        }
    }

    fn wait(&mut self, condition: &Condition, timeout: Span) -> Result<Reply, Refusal> {
        let watch = self.run.watch(condition)?;
        let until = self.run.rig.now() + timeout.0;
        Ok(self.look_again(Pending::Condition(Box::new(watch), until)))
    }

    fn step(&mut self, by: Span) -> Result<Reply, Refusal> {
        if by.0.is_zero() || by.0 > STEP_MAX {
            let max = STEP_MAX.as_secs();
            let message = format!("is {by}, expected more than 0 and at most {max}s");
            return Err(Refusal::new("by", message));
        }
        let until = match self.tempo {
            // No other caller advances the clock.
            None => self.run.rig.now() + by.0,
            Some(_) => {
                let tempo = self.tempo_that_began()?;
                if !tempo.stands() {
                    let message = "rig time runs, expected `pause` before";
                    return Err(Refusal::new("do", message));
                }
                tempo.step(by.0)
            }
        };
        Ok(Reply::Later(Pending::Step(until)))
    }

    /// The clock, if it has started.
    fn tempo_that_began(&self) -> Result<&Held, Refusal> {
        let Some(tempo) = self.tempo else {
            let message = "this run's clock is moved by `step` and `wait` alone";
            return Err(Refusal::new("do", message));
        };
        match tempo.has_begun() {
            true => Ok(tempo),
            false => {
                let message = "rig time stands until the program has opened its ports";
                Err(Refusal::new("do", message))
            }
        }
    }

    fn pace(&self, change: impl FnOnce(&Held)) -> Result<Answer, Refusal> {
        let tempo = self.tempo_that_began()?;
        change(tempo);
        // The rig is slightly behind its clock and will reach the clock's time.
        let at = tempo.now().max(self.run.rig.now());
        Ok(Answer::granted(json!({})).at(at))
    }

    fn speed(&self, x: f64) -> Result<Answer, Refusal> {
        let [least, most] = SPEEDS;
        if !(least..=most).contains(&x) {
            let message =
                format!("is {x}, expected {least} to {most}: other programs can open the ports");
            return Err(Refusal::new("x", message));
        }
        self.pace(|tempo| tempo.set_speed(x))
    }

    fn press(
        &mut self,
        display: Option<[u16; 2]>,
        button: Option<String>,
    ) -> Result<Answer, Refusal> {
        let place = match (display, button) {
            (Some(place), None) => place,
            (None, Some(button)) => {
                let has = self.what_can_be_pressed();
                return Err(Refusal::new("button", format!("is {button:?}, but {has}")));
            }
            _ => return Err(Refusal::new("display", "expected display or button")),
        };
        let tapped = self.run.tap(place);
        tapped.map_err(|error| match error {
            CommandError::NoDisplay => Refusal::new("display", self.what_can_be_pressed()),
            error => Refusal::new("display", error.to_string()),
        })?;
        self.tally.changes += 1;
        Ok(self.granted_now())
    }

    fn what_can_be_pressed(&self) -> String {
        match self.run.instruments().display(&self.run.rig) {
            Some(display) => {
                let (width, height) = (display.width, display.height());
                format!("the robot has no buttons, only a display of {width} x {height} pixels")
            }
            None => "the robot has no display and no buttons: nothing to press".to_owned(),
        }
    }

    fn mission(&mut self, action: Action) -> Result<Answer, Refusal> {
        let done = self.run.command(action);
        done.map_err(|error| Refusal::new("action", error.to_string()))?;
        self.tally.changes += 1;
        Ok(self.granted_now())
    }
}

/// Absolute difference of two times.
pub(super) fn apart(a: Instant, b: Instant) -> Duration {
    a.max(b) - a.min(b)
}
