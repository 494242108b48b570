//! Replay of a capture: into the robot's program in virtual time, or into ports.
//!
//! In virtual time the robot is wired as for any run. The bytes to the program come from the
//! capture, each at its recorded nanosecond. The devices still receive the program's bytes and
//! judge it; their replies are discarded. An unchanged program therefore sends the same bytes at
//! the same time, and the devices give the same verdicts.

mod conversation;
mod listen;
mod rig;
mod silence;
mod turn;

use core::time::Duration;
use std::sync::Arc;

use protocols::{Instant, LineConfig, LineEvent};

use crate::divergence::{Divergence, Track, compare};
use crate::{Capture, Conclusion, Kind, Record, Section};
use engine::Shared;
use engine::rig::line::Direction;
use engine::rig::{Logged, Program, Rig};
use engine::robots::{self, Dut, Instruments, PcEnd, Wired};
use engine::run::LOOK_EVERY;
use engine::run::check::Check;
use engine::run::watch::Watchers;
use engine::scenario::{PhasesSpec, Scenario, ScenarioError, Source};

pub use conversation::{Conversation, Tally, are_over};
pub use listen::Eavesdrop;
use listen::Listener;
pub use rig::{Ear, StandIn, Timing};
pub use silence::{SILENCE_MAX, Silence, Silences};
use turn::Turn;

/// Error when a capture cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The robot cannot be wired.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The capture does not fit the robot, or has no data.
    #[error("{0}")]
    Capture(String),
}

/// Maximum idle time at the beginning that is played; the rest is left out.
const IDLE_MAX: Duration = Duration::from_secs(2);

/// Bytes that reach the end of a line at one time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Time of its last byte.
    pub at: Instant,
    /// The bytes; empty: a character without a stop bit.
    pub bytes: Vec<u8>,
}

/// The bytes of one link.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Passage {
    /// Name of the link.
    pub link: String,
    /// Bits per second.
    pub baud: u32,
    /// Bytes to the program, in order.
    pub arrivals: Vec<Arrival>,
    /// Bytes to the device, in order.
    pub heard: Vec<Arrival>,
    /// Bytes sent by the program.
    pub sent: Track,
    /// Time at which the program opened the port, if the capture records it.
    pub opened: Vec<Instant>,
}

/// Content of a capture for each link, ready to be played; times count from the start of the run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Recorded {
    /// The links.
    pub links: Vec<Passage>,
    /// Time of the last event.
    pub end: Instant,
    /// Time of the capture's own clock at time zero.
    pub zero: Instant,
}

impl Recorded {
    /// Content of `capture` up to `until` after its [zero](Capture::zero).
    pub fn of(capture: &Capture, until: Option<Duration>) -> Self {
        let (shown, section) = (capture.zero(), capture.sections.first());
        // A rig in real time may have been idle before its first record: that time is not played.
        let is_virtual = section.is_some_and(|section| section.fact("clock") == Some("virtual"));
        let first = || capture.records.iter().map(|record| record.at).min();
        let zero = first().filter(|_| !is_virtual).unwrap_or(shown);
        let mut this = Self {
            zero,
            ..Self::default()
        };
        for link in &capture.links {
            this.links.push(Passage {
                link: link.name.clone(),
                baud: link.baud,
                ..Passage::default()
            });
        }
        let mut is_open = vec![false; this.links.len()];
        let mut records: Vec<&Record> = capture.records.iter().collect();
        records.sort_by_key(|record| record.at);
        let mut turns = vec![Turn::of(capture); this.links.len()];
        for record in records {
            let later = turns[record.link].later(record, this.links[record.link].line());
            let shift = |at: Instant| Instant::ZERO + (at - zero) + later;
            if until.is_some_and(|until| record.at - shown > until) {
                break;
            }
            this.end = this.end.max(shift(record.at));
            this.links[record.link].take(record, shift);
            if let (Kind::Line(event), Direction::ToDevice) = (record.kind, record.direction) {
                let is_open = &mut is_open[record.link];
                let was_open = *is_open;
                *is_open = (was_open || event == LineEvent::Opened) && event != LineEvent::Closed;
                if *is_open && !was_open {
                    this.links[record.link].opened.push(shift(record.at));
                }
            }
        }
        let start = capture
            .sections
            .first()
            .map_or(Instant::ZERO, Section::start);
        let lasted = capture.conclusion.as_ref().and_then(Conclusion::end);
        if let Some(lasted) = lasted {
            // After a program fell silent, the run continued.
            let end = (start + (lasted - Instant::ZERO)) - zero;
            let until = until.map(|until| until.saturating_sub(zero - shown));
            let end = until.map_or(end, |until| until.min(end));
            this.end = this.end.max(Instant::ZERO + end);
        }
        this
    }

    /// The session of the program: from [`origin`](Self::origin) to the end.
    pub fn session(&self) -> core::ops::Range<Instant> {
        self.origin()..self.end
    }

    /// Start of the program's session: the opening of its first port, if the capture contains it.
    /// If not, the first event, or a short time before it if the capture's clock begins with the
    /// session. Earlier idle time is left out.
    pub fn origin(&self) -> Instant {
        let opened = self.links.iter().flat_map(|link| &link.opened);
        if let Some(&opened) = opened.min() {
            return opened;
        }
        let events = self.links.iter().flat_map(Passage::times);
        let first = events.min().unwrap_or_default();
        Instant::ZERO + (first - Instant::ZERO).saturating_sub(IDLE_MAX)
    }
}

impl Passage {
    /// Coding of the line; a capture without a baud rate is played at the usual rate.
    pub fn line(&self) -> LineConfig {
        LineConfig::new_8n1(match self.baud {
            0 => 115_200,
            baud => baud,
        })
    }

    fn take(&mut self, record: &Record, shift: impl Fn(Instant) -> Instant) {
        let line = self.line();
        let list = match record.direction {
            Direction::ToMaster => &mut self.arrivals,
            Direction::ToDevice => &mut self.heard,
        };
        match record.kind {
            Kind::Data => {
                // The time of a record is that of its arrival. Its first chunks were complete
                // earlier, but not before the record ahead of it.
                let before = list.last().map_or(Instant::ZERO, |last| last.at);
                let chunks = record.chunks(line).into_iter();
                let arrivals = chunks.map(|(at, bytes)| Arrival {
                    at: shift(at).max(before),
                    bytes: bytes.to_vec(),
                });
                list.extend(arrivals.clone());
                match &record.sent {
                    _ if record.direction == Direction::ToMaster => {}
                    Some(sent) => self.sent.push(shift(sent.at), &sent.bytes),
                    None => arrivals.for_each(|one| self.sent.push(one.at, &one.bytes)),
                }
            }
            Kind::Line(LineEvent::FramingError) => list.push(Arrival {
                at: shift(record.at),
                bytes: Vec::new(),
            }),
            Kind::Line(_) | Kind::Other(_) => {}
        }
    }
}

/// Source of the bytes to the devices in a replay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Voice {
    /// The program.
    Program,
    /// The capture: the devices judge the recorded bytes, not those of the program.
    Capture,
}

/// A running replay.
pub struct Replay {
    rig: Rig,
    /// Link of the rig, line, and bytes that arrive there.
    feed: Vec<Feed>,
    expected: Vec<(usize, Passage)>,
    sent: Shared<Vec<Track>>,
    instruments: Arc<dyn Instruments>,
    watchers: Watchers,
    next_look: Instant,
    end: Instant,
}

struct Feed {
    link: usize,
    direction: Direction,
    arrivals: std::vec::IntoIter<Arrival>,
}

/// Result of a replay.
#[derive(Clone, Debug)]
pub struct Replayed {
    /// Length in virtual time.
    pub ran: Duration,
    /// Bytes that reached the program.
    pub heard: usize,
    /// Bytes of the program on each link, with those of the capture.
    pub links: Vec<Played>,
    /// Rules that the program violated, as judged by the devices.
    pub violations: Vec<Logged>,
    /// Verdicts of the checkers of every run.
    pub checks: Vec<Check>,
    /// Fingerprint of all bytes.
    pub trace_hash: String,
}

/// A link of a replay.
#[derive(Clone, Debug)]
pub struct Played {
    /// Its name.
    pub link: String,
    /// Bytes of the program in the captured run.
    pub expected: Track,
    /// Bytes of the program now.
    pub got: Track,
    /// State of the conversation, in a replay by requests.
    pub talk: Option<Talked>,
}

/// State of a conversation.
#[derive(Clone, Debug)]
pub struct Talked {
    /// Comparison of the program's requests with those of the capture.
    pub tally: Tally,
    /// Number of bytes that the capture's side sent.
    pub said: u64,
    /// The first request that the capture does not contain, or one that is missing.
    pub divergence: Option<Divergence>,
}

impl Talked {
    /// The present state of `talk`.
    pub fn of(talk: &Conversation) -> Self {
        Self {
            tally: talk.tally(),
            said: talk.said(),
            divergence: talk.divergence(),
        }
    }
}

impl Replayed {
    /// The earliest difference between the bytes of the program and the capture.
    pub fn divergence(&self) -> Option<Divergence> {
        Played::first_divergence(&self.links)
    }

    /// Number of bytes that the program sent.
    pub fn sent(&self) -> usize {
        self.links.iter().map(|one| one.got.bytes().len()).sum()
    }

    /// Maximum time by which the program sent a byte earlier or later than captured.
    pub fn largest_shift(&self) -> Duration {
        let shifts = self
            .links
            .iter()
            .map(|one| one.expected.largest_shift(&one.got));
        shifts.max().unwrap_or_default()
    }
}

impl Played {
    /// The earliest difference on `links` between the sent and the captured bytes.
    pub fn first_divergence(links: &[Self]) -> Option<Divergence> {
        let of = |one: &Self| match &one.talk {
            Some(talk) => talk.divergence.clone(),
            None => compare(&one.link, Direction::ToDevice, &one.expected, &one.got),
        };
        let all = links.iter().filter_map(of);
        all.min_by_key(|divergence| divergence.at)
    }
}

impl Replay {
    /// Wires the robot of `scenario` for a replay of `recorded`.
    ///
    /// # Errors
    /// If the robot cannot be wired, or `recorded` has no bytes for its program.
    pub fn new(
        recorded: &Recorded,
        scenario: &Scenario,
        source: &Source,
        voice: Voice,
    ) -> Result<Self, ReplayError> {
        let wired = robots::wire(scenario, source, Dut::Internal, PcEnd::Scripted)?;
        let Wired {
            mut rig,
            instruments,
            ..
        } = wired;
        let instruments: Arc<dyn Instruments> = Arc::from(instruments);
        let (mut feed, mut expected) = (Vec::new(), Vec::new());
        for link in rig.program_links() {
            let name = &rig.links()[link].name;
            let passage = recorded.links.iter().find(|passage| passage.link == *name);
            let passage = passage.cloned().unwrap_or_else(|| Passage {
                link: name.clone(),
                ..Passage::default()
            });
            let mut play = |direction: Direction, arrivals: Vec<Arrival>| {
                feed.push(Feed {
                    link,
                    direction,
                    arrivals: arrivals.into_iter(),
                });
                let lines = rig.lines_mut(link).expect("one of its links");
                lines[direction as usize].is_played = true;
            };
            play(Direction::ToMaster, passage.arrivals.clone());
            if voice == Voice::Capture {
                play(Direction::ToDevice, passage.heard.clone());
            }
            expected.push((link, passage));
        }
        if expected
            .iter()
            .all(|(_, passage)| passage.arrivals.is_empty())
        {
            if expected.is_empty() {
                let wrong = "the robot has no built-in program: expected --exec CMD";
                return Err(ReplayError::Capture(wrong.to_owned()));
            }
            let links: Vec<&str> = expected.iter().map(|(_, one)| &*one.link).collect();
            return Err(ReplayError::Capture(format!(
                "nothing for the robot's program: expected a capture with bytes to-master on {}",
                links.join(", ")
            )));
        }
        let sent = Shared::new(vec![Track::default(); rig.links().len()]);
        rig.add_tap(Box::new(Listener(sent.clone())));
        let mut watched = scenario.clone();
        // A capture that ends before the phases do contains no result for them.
        let lasts = |phases: &PhasesSpec| phases.windows()[3].until <= recorded.end;
        watched.phases = watched.phases.filter(lasts);
        let watchers = Watchers::of(&watched, &mut rig, &instruments);
        Ok(Self {
            watchers,
            rig,
            feed,
            expected,
            sent,
            instruments,
            next_look: Instant::ZERO + LOOK_EVERY,
            end: recorded.end,
        })
    }

    /// Replaces the robot's program by another one.
    pub fn replace_program(&mut self, replace: impl FnOnce(Box<dyn Program>) -> Box<dyn Program>) {
        self.rig.replace_program(replace);
    }

    /// The rig.
    pub const fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The interface of the robot.
    pub fn instruments(&self) -> &dyn Instruments {
        &*self.instruments
    }

    /// Whether the whole capture was played.
    pub fn is_over(&self) -> bool {
        self.rig.now() >= self.end
    }

    /// Continues the replay for `span`, at most to the end.
    pub fn run_for(&mut self, span: Duration) {
        let until = (self.rig.now() + span).min(self.end);
        // Bytes that arrive at the same nanosecond are delivered together, as captured.
        while let Some(at) = self.next_arrival().filter(|&at| at <= until) {
            for feed in &mut self.feed {
                let line = self.rig.lines_mut(feed.link).expect("one of its links");
                let line = &mut line[feed.direction as usize];
                while feed.next_at() == Some(at) {
                    let arrival = feed.arrivals.next().expect("was there");
                    line.play(at, &arrival.bytes, u32::from(arrival.bytes.is_empty()));
                }
            }
            self.advance(at);
        }
        self.advance(until);
    }

    fn advance(&mut self, until: Instant) {
        while self.next_look <= until {
            self.rig.run_until(self.next_look);
            self.next_look += LOOK_EVERY;
            let contacts = self.rig.world.take_contacts();
            self.watchers.look(&self.rig, &*self.instruments, &contacts);
        }
        self.rig.run_until(until);
    }

    fn next_arrival(&self) -> Option<Instant> {
        self.feed.iter().filter_map(Feed::next_at).min()
    }

    /// Plays to the end.
    pub fn finish(mut self) -> Replayed {
        while !self.is_over() {
            self.run_for(Duration::from_secs(1));
        }
        let mut sent = self.sent.lock();
        let links = self.expected.iter().map(|(link, passage)| Played {
            link: passage.link.clone(),
            expected: passage.sent.clone(),
            got: core::mem::take(&mut sent[*link]),
            talk: None,
        });
        let events = self.rig.events().iter();
        let heard = self
            .expected
            .iter()
            .flat_map(|(_, passage)| &passage.arrivals);
        Replayed {
            checks: self.watchers.verdicts(self.rig.now(), self.is_over()),
            ran: self.rig.now() - Instant::ZERO,
            heard: heard.map(|arrival| arrival.bytes.len()).sum(),
            links: links.collect(),
            violations: events
                .filter(|event| event.is_violation())
                .cloned()
                .collect(),
            trace_hash: self.rig.trace_hash(),
        }
    }
}

impl Feed {
    fn next_at(&self) -> Option<Instant> {
        self.arrivals.as_slice().first().map(|arrival| arrival.at)
    }
}

/// The scenario in a capture's section header, if it has one.
///
/// # Errors
/// If the scenario cannot be read.
pub fn scenario_of(
    capture: &Capture,
    path: &std::path::Path,
) -> Result<Option<(Scenario, Source)>, ScenarioError> {
    let mut texts = capture.sections.iter().map(|section| &section.scenario);
    let Some(text) = texts.find(|text| !text.is_empty()) else {
        return Ok(None);
    };
    Scenario::parse(path, text.clone()).map(Some)
}

#[cfg(test)]
mod tests;
