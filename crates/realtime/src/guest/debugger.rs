//! A debugger that stops time: GDB's remote protocol for a program in virtual time.
//!
//! ```text
//!  gdb ---TCP---> wire ---> gdbstub ---> session ---> supervisor ---> threads
//!                                          `---> rig: time, wires, verdicts
//! ```
//!
//! While the debugger holds the program, no time passes at the rig. A held thread continues in the
//! middle of its turn, so the run is the same as without a debugger.

mod again;
mod back;
mod begin;
mod failure;
mod monitor;
mod registers;
mod target;
mod wire;
mod wires;

use core::time::Duration;
use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;

use gdbstub::common::{Signal as GdbSignal, Tid};
use gdbstub::stub::state_machine::GdbStubStateMachine;
use gdbstub::stub::{DisconnectReason, GdbStub, MultiThreadStopReason};
use gdbstub::target::ext::breakpoints::WatchKind;
use protocols::Instant;

use super::GuestError;
use super::computing::Computing;
use super::supervisor::{Stop, Supervisor, Wanted};
use super::trial::{Played, Trial};
use crate::clock::{Clock as _, WallClock};
use crate::process::Ended;
use again::Marks;
use back::Back;
use registers::to_gdb;
use target::Action;
use wire::{Door, Ear, Wire};
use wires::Wires;

/// Maximum number of turns, and maximum wall time, between two checks for input of the debugger.
const TURNS: u32 = 64;
/// Number of steps back in a row between two lines about them: a breakpoint with a condition causes
/// one step back at each place where the condition is false.
const STEPS_EACH: u32 = 5;
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// Settings of a debugger session.
#[derive(Clone, Debug, Default)]
pub struct DebugSettings {
    /// Port on this machine where the debugger connects; 0: a free one.
    pub port: u16,
    /// Name of the program's file, if it is not the first that uses a port.
    pub program: Option<String>,
    /// Rig time at which the program first stops; if `None`, it stops at its start.
    pub at: Option<Duration>,
    /// Whether the program runs once, and then again up to the place where a check failed.
    pub on_fail: bool,
}

/// The end of a debugger session.
pub enum Debugged {
    /// The run ended and was judged.
    Judged(Box<Played>),
    /// The debugger killed the program; the run until then.
    Killed(Box<Played>),
    /// The caller stopped the session; the run until then.
    Cut(Box<Played>),
    /// The program to debug did not start, or its place was not reached; with the fix.
    NotReached(String),
    /// The program could not be started; the caller knows the reason.
    NotStarted,
}

/// Functions of the caller that a session uses.
pub struct Surroundings<'a> {
    /// Starts the program from its beginning, if possible.
    pub start: &'a mut dyn FnMut() -> Option<Trial>,
    /// Whether the session may continue.
    pub goes_on: &'a dyn Fn() -> bool,
    /// Prints a line for the user.
    pub say: &'a dyn Fn(&str),
}

/// A program and its debugger.
struct Session<'a> {
    /// The supervised program; `None` only while the program is started again.
    trial: Option<Trial>,
    start: &'a mut dyn FnMut() -> Option<Trial>,
    settings: DebugSettings,
    goes_on: &'a dyn Fn() -> bool,
    say: &'a dyn Fn(&str),
    /// The thread of the last stop.
    current: Option<i32>,
    actions: Vec<(Tid, Action)>,
    /// Length and kind of watched memory, by its address.
    kinds: BTreeMap<u64, (u64, WatchKind)>,
    wires: Wires,
    /// Whether the run is over and the debugger knows it.
    is_over: bool,
    /// The backward motion that the debugger requests, and the time to which the next one leads.
    back: Option<Back>,
    back_to: Option<Instant>,
    /// Address of the watched memory at the last stop.
    last_watched: Option<u64>,
    /// Result of the first run with `on_fail`.
    first: Option<Box<Played>>,
    /// The program that is debugged, once it is known.
    wanted: Option<Wanted>,
    /// Whether the signal of the held thread was reported to the debugger.
    is_signal_told: bool,
    /// Whether a backward motion did not reach its place.
    has_missed: bool,
    /// Receives an interrupt of the debugger during a backward motion; and whether there was one.
    ear: Option<Ear>,
    is_broken_off: bool,
    /// Charges for computing in the previous run.
    computing: Option<Computing>,
    /// The reason why the place to debug was not reached.
    missed: Option<String>,
    /// Number of `reverse-continue` in a row.
    steps_back: u32,
}

/// Event of a running program.
enum Event {
    Stop(Stop),
    /// The run is over.
    Over,
}

/// The reason why a debugger is not served any more.
enum Leave {
    Detached,
    Killed,
    /// The process has ended, and the debugger knows it.
    Ended,
    /// The connection is broken.
    Gone,
    /// The caller stopped the session.
    Cut,
}

/// Runs a program under a debugger to the end of its run.
///
/// # Errors
/// If the port is in use, or the program cannot be started or supervised.
pub fn debug(
    settings: DebugSettings,
    surroundings: Surroundings<'_>,
) -> Result<Debugged, GuestError> {
    let door = Door::open(settings.port)?;
    let Surroundings {
        start,
        goes_on,
        say,
    } = surroundings;
    let mut session = Session {
        trial: None,
        start,
        settings,
        goes_on,
        say,
        current: None,
        actions: Vec::new(),
        kinds: BTreeMap::new(),
        wires: Wires::default(),
        is_over: false,
        back: None,
        back_to: None,
        last_watched: None,
        first: None,
        wanted: None,
        is_signal_told: false,
        has_missed: false,
        ear: None,
        is_broken_off: false,
        computing: None,
        missed: None,
        steps_back: 0,
    };
    let is_there = session.run_to_start();
    let leave = is_there.and_then(|is_there| match is_there {
        true => session.serve_all(&door),
        false => Ok(Leave::Ended),
    });
    session.conclude(leave)
}

/// Panic message: the caller has checked that there is a run.
const THERE: &str = "a session without a run is over";

impl Session<'_> {
    fn trial(&mut self) -> &mut Trial {
        self.trial.as_mut().expect(THERE)
    }

    fn trial_ref(&self) -> &Trial {
        self.trial.as_ref().expect(THERE)
    }

    fn supervisor(&mut self) -> &mut Supervisor {
        self.trial().supervisor()
    }

    fn supervisor_ref(&self) -> &Supervisor {
        self.trial_ref().supervisor_ref()
    }

    /// Runs until an event; `None` if the caller stops the session.
    fn run_until_event(&mut self) -> Result<Option<Event>, GuestError> {
        while (self.goes_on)() && !self.breaks_off() {
            if let Some(event) = self.run_for_a_while()? {
                return Ok(Some(event));
            }
        }
        Ok(None)
    }

    /// Whether the debugger interrupts its backward motion.
    fn breaks_off(&mut self) -> bool {
        self.is_broken_off |= self.ear.as_ref().is_some_and(Ear::hears_interrupt);
        self.is_broken_off
    }

    /// Runs for some turns, or until an event.
    fn run_for_a_while(&mut self) -> Result<Option<Event>, GuestError> {
        let clock = WallClock::start();
        for _ in 0..TURNS {
            if let Some(event) = self.run_turn()? {
                return Ok(Some(event));
            }
            // A turn of a thread that computes can take a second.
            if clock.now() - Instant::ZERO >= LOOK_EVERY {
                break;
            }
        }
        Ok(None)
    }

    fn run_turn(&mut self) -> Result<Option<Event>, GuestError> {
        self.trial().turn()?;
        if let Some(stop) = self.supervisor().take_stop() {
            return Ok(Some(Event::Stop(stop)));
        }
        // A run is not over in the middle of a turn: without a stop, the end would not have been
        // noticed there.
        let is_over = !self.supervisor().is_held() && self.trial().is_over();
        Ok(is_over.then_some(Event::Over))
    }

    /// Serves one debugger after the other.
    fn serve_all(&mut self, door: &Door) -> Result<Leave, GuestError> {
        loop {
            self.invite(door);
            let accepted = door.accept(self.goes_on);
            let accepted = accepted.map_err(|source| GuestError::DebugPort {
                port: door.address.port(),
                source,
            })?;
            let Some(wire) = accepted else {
                return Ok(Leave::Cut);
            };
            match self.serve(door, wire)? {
                Leave::Gone => {
                    self.forget_debugger();
                    (self.say)("the debugger is gone; time stands");
                }
                leave => return Ok(leave),
            }
        }
    }

    /// Removes all breakpoints and settings of a debugger, because the next one does not know them.
    fn forget_debugger(&mut self) {
        self.set_marks(&Marks::default());
        if let Some(debugging) = self.supervisor().debugging() {
            debugging.set_step(None);
            debugging.set_goal(None);
        }
        self.actions.clear();
        self.kinds.clear();
        (self.back, self.back_to, self.last_watched) = (None, None, None);
        self.is_signal_told = false;
    }

    fn invite(&self, door: &Door) {
        let port = door.address.port();
        let file = self.supervisor_ref().debugged_file();
        let file = file.map_or_else(String::new, |file| file.display().to_string());
        (self.say)(&format!(
            "the program stands at {} s, waiting for a debugger on localhost:{port}\n  \
             gdb {file} -ex 'target remote :{port}'",
            self.trial_ref().now()
        ));
    }

    /// Serves one debugger until it leaves.
    fn serve(&mut self, door: &Door, wire: Wire) -> Result<Leave, GuestError> {
        let Ok(mut stub) = GdbStub::new(wire).run_state_machine(self) else {
            return Ok(Leave::Gone);
        };
        loop {
            let next = match stub {
                GdbStubStateMachine::Idle(mut stub) => {
                    match stub.borrow_conn().next(door, self.goes_on) {
                        Ok(Some(byte)) => stub.incoming_data(self, byte),
                        Ok(None) => return Ok(Leave::Cut),
                        Err(_) => return Ok(Leave::Gone),
                    }
                }
                GdbStubStateMachine::Running(mut stub) => match stub.borrow_conn().try_next() {
                    Ok(Some(byte)) => stub.incoming_data(self, byte),
                    Err(_) => return Ok(Leave::Gone),
                    Ok(None) => {
                        door.turn_away();
                        if !(self.goes_on)() {
                            return Ok(Leave::Cut);
                        }
                        match self.run_for_debugger(stub.borrow_conn())? {
                            Some(reason) => stub.report_stop(self, reason),
                            None => Ok(stub.into()),
                        }
                    }
                },
                GdbStubStateMachine::CtrlCInterrupt(stub) => {
                    let held = self.supervisor().debugging();
                    self.current = held.and_then(|it| it.held_thread()).or(self.current);
                    let reason = self.reason(GdbSignal::SIGINT);
                    stub.interrupt_handled(self, Some(reason))
                }
                GdbStubStateMachine::Disconnected(mut stub) => {
                    return Ok(match stub.get_reason() {
                        DisconnectReason::Disconnect => Leave::Detached,
                        DisconnectReason::Kill => {
                            // One of the two packets for this request expects an answer.
                            let _ = stub.borrow_conn().confirm();
                            Leave::Killed
                        }
                        DisconnectReason::TargetExited(_)
                        | DisconnectReason::TargetTerminated(_) => Leave::Ended,
                    });
                }
            };
            stub = match next {
                Ok(stub) => stub,
                // The client sent another protocol, or is gone.
                Err(_) => return Ok(Leave::Gone),
            };
        }
    }

    /// A stop of the current thread by `signal`.
    fn reason(&self, signal: GdbSignal) -> MultiThreadStopReason<u64> {
        let tid = self.number_of(self.current.unwrap_or(0));
        MultiThreadStopReason::SignalWithThread { tid, signal }
    }

    /// Runs for a while for the debugger; returns the reason for a stop, if the program stopped.
    fn run_for_debugger(
        &mut self,
        wire: &mut Wire,
    ) -> Result<Option<MultiThreadStopReason<u64>>, GuestError> {
        if let Some(back) = self.back.take() {
            // Without an ear, the connection is read only after the backward motion.
            self.ear = wire.ear().ok();
            let Some(reason) = self.go_back(back)? else {
                // If the debugger is gone, the next read reports it.
                let _ = wire.take_interrupt();
                let _ = wire.say(
                    "[hilrig] the backward motion is interrupted; the program is at its start",
                );
                return Ok(Some(self.reason(GdbSignal::SIGINT)));
            };
            if core::mem::take(&mut self.has_missed) {
                let text = "the program does not repeat, so the backward motion missed its place; \
                            check it with hilrig run --virtual --check";
                (self.say)(text);
                // If the debugger is gone, the next read reports it.
                let _ = wire.say(&format!("[hilrig] {text}"));
            }
            self.steps_back += u32::from(back == Back::Continue);
            if back == Back::Continue && self.steps_back.is_multiple_of(STEPS_EACH) {
                let (steps, now) = (self.steps_back, self.trial_ref().now());
                let _ = wire.say(&format!("[hilrig] {steps} steps back, now at {now} s"));
            }
            return Ok(Some(reason));
        }
        self.steps_back = 0;
        if self.is_over {
            return Ok(Some(MultiThreadStopReason::Exited(0)));
        }
        let event = self.run_for_a_while()?;
        // A line that cannot be sent is dropped.
        let mut tell = |text: &str| drop(wire.say(&format!("[hilrig] {text}")));
        let now = self.trial().now();
        let stop = match event {
            None => return Ok(None),
            Some(Event::Over) => {
                self.is_over = true;
                let spins = self.trial().spins().unwrap_or("the run is over").to_owned();
                tell(&format!("{now} s: {spins}; continue ends the program"));
                return Ok(Some(self.reason(GdbSignal::SIGTRAP)));
            }
            Some(Event::Stop(stop)) => stop,
        };
        Ok(Some(match stop {
            Stop::Break(tid) => {
                self.current = Some(tid);
                MultiThreadStopReason::SwBreak(self.number_of(tid))
            }
            Stop::Watch(tid, address) => {
                self.current = Some(tid);
                self.last_watched = Some(address);
                let (addr, kind) = self.watched_at(address);
                MultiThreadStopReason::Watch {
                    tid: self.number_of(tid),
                    kind,
                    addr,
                }
            }
            Stop::Step(tid) | Stop::Loaded(tid) => {
                self.current = Some(tid);
                self.reason(GdbSignal::SIGTRAP)
            }
            Stop::Signal(tid, signal) => {
                self.current = Some(tid);
                self.is_signal_told = true;
                self.reason(to_gdb(signal))
            }
            Stop::Reached(tid) => {
                self.current = tid.or(self.current);
                tell(&format!("{now} s is reached"));
                self.reason(GdbSignal::SIGTRAP)
            }
            Stop::Ended(status) => match Ended::of(ExitStatus::from_raw(status)) {
                Ended::Code(code) => {
                    let code = u8::try_from(code & 0xFF).unwrap_or(u8::MAX);
                    MultiThreadStopReason::Exited(code)
                }
                Ended::Signal(signal) => MultiThreadStopReason::Terminated(to_gdb(signal)),
            },
        }))
    }

    /// The watched memory that contains `address`, and its kind.
    fn watched_at(&self, address: u64) -> (u64, WatchKind) {
        let before = self.kinds.range(..=address).next_back();
        before.map_or((address, WatchKind::Write), |(&at, &(_, kind))| (at, kind))
    }

    /// Ends the session, and lets the run continue to its end if required.
    fn conclude(mut self, leave: Result<Leave, GuestError>) -> Result<Debugged, GuestError> {
        let leave = match leave {
            Ok(leave) => leave,
            Err(error) => {
                if let Some(trial) = self.trial {
                    trial.abandon();
                }
                return Err(error);
            }
        };
        if let Some(missed) = self.missed {
            if let Some(trial) = self.trial {
                trial.abandon();
            }
            return Ok(Debugged::NotReached(missed));
        }
        let Some(mut trial) = self.trial.take() else {
            return Ok(match self.first {
                Some(played) => Debugged::Judged(played),
                None => Debugged::NotStarted,
            });
        };
        trial.supervisor().end_debugging();
        let leave = match (self.goes_on)() {
            true => leave,
            false => Leave::Cut,
        };
        let mut turned = Ok(());
        if matches!(leave, Leave::Detached | Leave::Ended) && !self.is_over {
            while !trial.is_over() && (self.goes_on)() && turned.is_ok() {
                turned = trial.turn();
            }
        }
        let played = Box::new(trial.end());
        turned?;
        Ok(match leave {
            Leave::Killed => Debugged::Killed(played),
            Leave::Cut => Debugged::Cut(played),
            _ => Debugged::Judged(played),
        })
    }
}

#[cfg(test)]
mod tests;
