//! A program that is put back to its first wait for each case, in place of a start.
//!
//! ```text
//!  start --> first wait --> case --> fine? --> put back to the first wait --> next case
//!                                      |
//!                                      +-- no: the same case again from a start, which is judged
//! ```
//!
//! Only a case from a start gives a finding, so a search finds nothing that a start does not show.
//! A program that cannot be put back (threads, other processes, open files, changed mappings) is
//! started for each case.

use core::time::Duration;
use std::path::Path;

use protocols::Instant;

use super::case::{Case, Raw};
use super::harness::{Harness, HarnessError, Spent};
use super::player::Halt;
use super::session::{Session, SessionMoment};
use super::speech::Speech;
use super::trial::{self, TrialOutcome};
use realtime::clock::{Clock as _, WallClock};

/// Maximum virtual time until the program waits for its port and all its bytes have come.
const WAIT_MAX: Duration = Duration::from_millis(500);
/// Interval of the checks whether the program waits.
const LOOK_EVERY: Duration = Duration::from_millis(10);
/// If the program could not be put back after half of this number of cases, it is started for each
/// case, because each other case would cost two runs.
const LOOKED_AT: u32 = 16;

/// A program at its first wait.
struct Kept<'a> {
    live: Session<'a>,
    moment: SessionMoment,
    was_put_back: bool,
}

/// The program of a search on one link.
pub(super) struct Restarts<'a> {
    link: String,
    /// The program at its first wait; `None` if it must be started.
    kept: Option<Kept<'a>>,
    is_possible: bool,
    cases: u32,
    ends: u32,
    /// Number of cases without a start.
    pub(super) saved: u64,
}

impl<'a> Restarts<'a> {
    pub(super) const fn new(link: String) -> Self {
        Self {
            link,
            kept: None,
            is_possible: true,
            cases: 0,
            ends: 0,
            saved: 0,
        }
    }

    /// Whether cases on `link` may begin without a start.
    pub(super) fn may_do(&self, link: &str) -> bool {
        self.is_possible && self.link == link
    }

    /// Runs `case`, without a start if the program was put back; `None`: the case must be run from
    /// a start, because it fails without one, or because the program cannot be put back.
    pub(super) fn run(
        &mut self,
        harness: &Harness<'a>,
        case: &Case,
        speech: &Speech,
        recording: &Path,
    ) -> Result<Option<TrialOutcome>, HarnessError> {
        if self.kept.is_none() {
            self.kept = first_wait(harness, case, recording)?;
            self.is_possible = self.kept.is_some();
        }
        let Some(kept) = self.kept.take() else {
            return Ok(None);
        };
        let mut live = kept.live;
        let (clock, from) = (WallClock::start(), live.now());
        let mut causes = Vec::new();
        let acted = trial::act(harness, &mut live, case, speech, &mut causes);
        let spent = harness.spent.get();
        harness.spent.set(Spent {
            wall: spent.wall + (clock.now() - Instant::ZERO),
            rig: spent.rig + (live.now() - from),
            ..spent
        });
        if matches!(acted, Err(Halt::Interrupted)) {
            live.end(harness);
            return Err(HarnessError::Interrupted);
        }
        let (known, played) = (live.known(live.now()), core::mem::take(&mut live.played));
        let held = core::mem::take(&mut live.held);
        if acted.is_err() || !causes.is_empty() {
            if kept.was_put_back {
                self.note(false);
                live.end(harness);
                return Ok(None);
            }
            (live.played, live.held) = (played, held);
            return trial::conclude(harness, live, case, acted, causes).map(Some);
        }
        let has_spoken = live.has_spoken();
        let is_back = live.put_back(&kept.moment);
        self.note(is_back);
        if is_back {
            self.kept = Some(Kept {
                live,
                was_put_back: true,
                ..kept
            });
        } else {
            live.end(harness);
        }
        self.saved += u64::from(kept.was_put_back);
        Ok(Some(TrialOutcome {
            causes,
            said: String::new(),
            ran: case.scenario.clone(),
            known,
            was_late: false,
            reached: Vec::new(),
            played,
            held,
            reported: None,
            has_spoken,
        }))
    }

    /// Records whether the program could be put back after a case.
    fn note(&mut self, is_back: bool) {
        self.cases += 1;
        self.ends += u32::from(!is_back);
        self.is_possible = self.cases < LOOKED_AT || self.ends * 2 < self.cases;
    }

    /// Ends the program.
    pub(super) fn end(&mut self, harness: &Harness<'a>) {
        if let Some(kept) = self.kept.take() {
            kept.live.end(harness);
        }
    }
}

/// The program of `case` at its first wait, if it can be put back to it.
fn first_wait<'a>(
    harness: &Harness<'a>,
    case: &Case,
    recording: &Path,
) -> Result<Option<Kept<'a>>, HarnessError> {
    let clock = WallClock::start();
    let (mut live, opened) = Session::begin(harness, case, recording)?;
    let spent = harness.spent.get();
    let started = clock.now() - Instant::ZERO;
    harness.spent.set(Spent {
        starts: spent.starts + started,
        wall: spent.wall + started,
        ..spent
    });
    let from = live.now();
    let mut waited = opened;
    while waited.is_ok() && live.now() - from < WAIT_MAX {
        if let Some(moment) = live.moment() {
            return Ok(Some(Kept {
                live,
                moment,
                was_put_back: false,
            }));
        }
        waited = live.pass(LOOK_EVERY);
    }
    live.end(harness);
    match waited {
        Err(Halt::Interrupted) => Err(HarnessError::Interrupted),
        _ => Ok(None),
    }
}

/// Whether a start can be left out for a case with `raw`: all data come from the case, and no
/// device has a state.
pub(super) fn is_alone(case: &Case, raw: &Raw) -> bool {
    case.scenario.device.keys().eq([&raw.link])
}
