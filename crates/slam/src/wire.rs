//! A log from the bytes on a robot's links: lidar turns and encoder readings as its program
//! received them.
//!
//! ```text
//! lidar's bytes -> packets -> turns --------+
//!                                           +--> corrected scans, the motion between them
//! base's bytes -> replies -> odometry ------+
//! ```

use core::time::Duration;

use emulators::world::Pose as Place;
use firmware_core::odometry::Odometry;
use firmware_core::pose::{Pose, PoseChange};
use firmware_core::scan::{Scan, Turn, TurnAssembler};
use protocols::{Decode, Instant, LineConfig, avr, xv11};

use super::finding::Kind;
use super::{Log, Shot};
use capture::replay::{Arrival, Passage, Recorded};
use engine::robots::Senses;

/// The reason why links give no log.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct WireError(String);

/// Idle time after which a partial frame is discarded.
const IDLE: Duration = Duration::from_millis(20);
/// Maximum wait of a turn for the next encoder reading.
const READING_MAX: Duration = Duration::from_millis(250);

/// Converts the bytes of links to a log.
///
/// # Errors
/// If the links contain no turn of the lidar.
pub fn read(recorded: &Recorded, senses: &Senses) -> Result<Log, WireError> {
    let link = |name: &str| recorded.links.iter().find(|one| one.link == name);
    let lidar = link(senses.lidar).ok_or_else(|| {
        let names: Vec<&str> = recorded.links.iter().map(|one| &*one.link).collect();
        let (name, found) = (senses.lidar, names.join(", "));
        WireError(format!("no link {name} in it, found {found}"))
    })?;
    let packets = frames(lidar, xv11::Decoder::default()).into_iter();
    let mut events: Vec<(Instant, Event)> = packets
        .map(|(at, packet)| (at, Event::Packet(packet)))
        .collect();
    if let Some(base) = link(senses.base) {
        let replies = frames(base, avr::Decoder::new(senses.checksum_order));
        events.extend(counts(&replies, senses.counters));
    }
    events.sort_by_key(|(at, _)| *at);
    let mut reader = Reader::new(recorded.zero, senses);
    for (at, event) in events {
        reader.take(at, event);
    }
    reader.finish()
}

enum Event {
    Packet(xv11::Frame),
    Counts([i32; 2]),
}

/// The valid frames that reached the program, each with the time of its last byte.
fn frames<D: Decode>(passage: &Passage, mut decoder: D) -> Vec<(Instant, D::Frame)> {
    let line = passage.line();
    let mut found = Vec::new();
    let mut last = Instant::ZERO;
    for arrival in &passage.arrivals {
        if arrival.at - last >= IDLE {
            decoder.idle();
        }
        last = arrival.at;
        for (at, byte) in bytes(arrival, line) {
            let byte = [byte];
            let sound = decoder.push(&byte).flatten();
            found.extend(sound.map(|frame| (at, frame)));
        }
    }
    found
}

/// The bytes of an arrival with their times, which follow each other without gaps.
fn bytes(arrival: &Arrival, line: LineConfig) -> impl Iterator<Item = (Instant, u8)> + '_ {
    (1..).zip(&arrival.bytes).map(move |(number, byte)| {
        let behind = (arrival.bytes.len() - number) as u64;
        (line.byte_end(arrival.at, behind), *byte)
    })
}

/// Both counters, each time both have been read again.
fn counts(replies: &[(Instant, avr::Frame)], counters: [u8; 2]) -> Vec<(Instant, Event)> {
    let mut fresh = [None; 2];
    let mut found = Vec::new();
    for (at, reply) in replies {
        for (counter, first) in fresh.iter_mut().zip(counters) {
            let skip = first.checked_sub(reply.register()).map(usize::from);
            let four = skip.and_then(|skip| reply.data().get(skip..)?.first_chunk());
            *counter = four.copied().map(i32::from_le_bytes).or(*counter);
        }
        if let [Some(left), Some(right)] = fresh {
            found.push((*at, Event::Counts([left, right])));
            fresh = [None; 2];
        }
    }
    found
}

struct Reader {
    log: Log,
    zero: Instant,
    senses: Senses,
    assembler: TurnAssembler,
    odometry: Odometry,
    /// A turn that waits for the next encoder reading.
    waiting: Option<Turn>,
    /// The odometry pose at the previous turn.
    before: Option<Pose>,
    unmeasured: u32,
}

impl Reader {
    fn new(zero: Instant, senses: &Senses) -> Self {
        let start = senses.start;
        let [x, y] = [start.x_mm, start.y_mm].map(|mm| f64::from(mm) / 1000.0);
        let log = Log {
            start: Place::new(x, y, f64::from(start.heading)),
            ..Log::default()
        };
        Self {
            log,
            zero,
            senses: *senses,
            assembler: TurnAssembler::new(senses.mounting),
            odometry: Odometry::new(senses.wheels),
            waiting: None,
            before: None,
            unmeasured: 0,
        }
    }

    fn take(&mut self, at: Instant, event: Event) {
        let overdue = |turn: &Turn| at - turn.end >= READING_MAX;
        if self.waiting.as_ref().is_some_and(overdue) {
            self.scan();
        }
        match event {
            Event::Packet(packet) => {
                if let Some(turn) = self.assembler.push(at, &packet) {
                    let turn = turn.clone();
                    self.scan();
                    self.waiting = Some(turn);
                }
            }
            Event::Counts(counts) => {
                self.odometry.update(at, counts);
                if self.waiting.as_ref().is_some_and(|turn| turn.end <= at) {
                    self.scan();
                }
            }
        }
    }

    /// Converts the waiting turn to a scan.
    fn scan(&mut self) {
        let Some(turn) = self.waiting.take() else {
            return;
        };
        let scan = Scan::deskewed(&turn, &self.senses.mounting, &self.odometry);
        let here = self.odometry.pose_at(scan.end);
        let at = self.zero + (scan.end - Instant::ZERO);
        if scan.points().is_empty() {
            let place = format_args!("{at}");
            let what = format_args!("none of the beams of a turn has a distance");
            self.log.findings.add(Kind::Blind, place, what);
            return;
        }
        let change = self
            .before
            .replace(here)
            .map(|before| before.change_to(here));
        let measured_at = self.odometry.updated_at();
        let is_measured = measured_at.is_some_and(|measured| measured + READING_MAX >= scan.end);
        self.unmeasured += u32::from(!is_measured);
        self.log.shots.push(Shot {
            at_s: at.as_nanos() as f64 / 1e9,
            moved: motion(change.unwrap_or(PoseChange::NONE)),
            is_measured,
            points: scan.points().to_vec(),
        });
    }

    fn finish(mut self) -> Result<Log, WireError> {
        self.scan();
        let lidar = self.senses.lidar;
        if self.log.shots.is_empty() {
            let turns = self.assembler.abandoned();
            return Err(WireError(format!(
                "no whole turn of a lidar on its link {lidar}, {turns} in part"
            )));
        }
        if self.unmeasured > 0 {
            let (count, base) = (self.unmeasured, self.senses.base);
            let note = format!("{count} scans without readings of the wheels on link {base}");
            self.log.notes.push(note);
        }
        Ok(self.log)
    }
}

/// A motion in metres and radians.
fn motion(change: PoseChange) -> Place {
    let [x, y] = [change.forward_mm, change.left_mm].map(|mm| f64::from(mm) / 1000.0);
    Place::new(x, y, f64::from(change.turn))
}
