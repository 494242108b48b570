//! The driver of the RPLIDAR A1: starts the lidar, takes its nodes, and detects silence.
//!
//! ```text
//! motor on --1 s--> SCAN --nodes--> ... --1 s of silence--> HEALTH? --good--> SCAN
//!                    ^                                         | error, or no answer
//!                    +-------------------1 s----- RESET <------+
//! ```
//!
//! A lidar in Protection Stop ignores scan requests silently (protocol document LR001), so silence
//! is the only sign. Duty and waiting time: public code of the robot, `LIDAR`.

use core::time::Duration;

use protocols::rplidar::{Command, Decoder, Frame, Mode, Node, Reply, Status};
use protocols::{Decode, Instant};

use super::guard::Strip;
use super::order::{Group, Order};
use super::scans::{self, Scans};
use crate::fifo::Fifo;

/// Duty of the motor, 0.6 of 255.
const MOTOR_DUTY: u8 = 153;
/// Time from the motor's start, or a reset, to the first request.
const START: Duration = Duration::from_secs(1);
/// Time without nodes after which the driver requests the lidar's health.
const SILENCE: Duration = Duration::from_secs(1);
/// Time without nodes before the first node, after which the health is requested. The first node
/// arrives only when the head turns evenly.
const SPIN_UP: Duration = Duration::from_secs(3);
/// Timeout for the answer.
const ANSWER: Duration = Duration::from_millis(100);
/// Idle time after which a partial node is discarded: the time of forty nodes.
const IDLE_GAP: Duration = Duration::from_millis(20);
/// A turn takes 0.1 s to 1 s: a shorter one has two start marks, a longer one has lost its mark.
const TURN_MIN: Duration = Duration::from_millis(80);
const TURN_MAX: Duration = Duration::from_millis(1_500);
/// Angle of three quarters of a turn: after it, angles of the first quarter belong to the next
/// turn.
const THREE_QUARTERS_Q6: u16 = 270 * 64;
const QUARTER_Q6: u16 = 90 * 64;

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Seven bytes are skipped, then every five bytes count as a node, whatever their content.
    pub unchecked: bool,
    /// The seven bytes are skipped once, not after each start.
    pub skips_once: bool,
    /// Silence is not noticed.
    pub notices_no_silence: bool,
    /// Defects of the set of turns.
    pub scans: scans::Defects,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        unchecked: false,
        skips_once: false,
        notices_no_silence: false,
        scans: scans::Defects::NONE,
    };
}

/// State of the driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The motor is off; initial state.
    Off,
    /// The motor speeds up, or the lidar starts again.
    Starting { until: Instant },
    /// A scan was requested.
    Scanning,
    /// The health was requested.
    Asking { until: Instant },
}

/// The driver.
#[derive(Clone, Debug)]
pub(super) struct Lidar {
    defects: Defects,
    phase: Phase,
    decoder: Decoder,
    groups: Groups,
    order: Order,
    /// Angle of the last accepted node.
    angle_q6: u16,
    pub(super) scans: Scans,
    pub(super) strip: Strip,
    requests: Fifo<16>,
    duty: Option<u8>,
    received_at: Instant,
    /// Time of the last node, or of the scan request.
    node_at: Instant,
    /// Maximum time until the next node.
    patience: Duration,
    turn_at: Instant,
    pub(super) counters: Counters,
}

#[derive(Clone, Debug)]
pub(super) struct Counters {
    pub(super) nodes: u32,
    pub(super) resyncs: u32,
    pub(super) turns: u32,
    pub(super) silences: u32,
    pub(super) restarts: u32,
}

impl Lidar {
    pub(super) const fn new(defects: Defects) -> Self {
        Self {
            defects,
            phase: Phase::Off,
            decoder: Decoder::new(),
            groups: Groups::NEW,
            order: Order::NEW,
            angle_q6: 0,
            scans: Scans::new(defects.scans),
            strip: Strip::new(),
            requests: Fifo::new(),
            duty: None,
            received_at: Instant::ZERO,
            node_at: Instant::ZERO,
            patience: SPIN_UP,
            turn_at: Instant::ZERO,
            counters: Counters {
                nodes: 0,
                resyncs: 0,
                turns: 0,
                silences: 0,
                restarts: 0,
            },
        }
    }

    pub(super) fn receive(&mut self, now: Instant, bytes: &[u8]) {
        if now - self.received_at >= IDLE_GAP {
            self.line_broke();
        }
        self.received_at = now;
        if self.defects.unchecked {
            for &byte in bytes {
                if let Some(node) = self.groups.take(byte) {
                    self.count(now);
                    self.take(now, node, node.starts_turn);
                }
            }
            return;
        }
        let mut input = bytes;
        while let Some(outcome) = self.decoder.step(&mut input) {
            match outcome {
                Ok(Frame::Node(node)) => {
                    self.count(now);
                    if let Some(group) = self.order.take(Group::of(node)) {
                        self.believe(now, group);
                    }
                }
                Ok(Frame::Answer(answer)) => self.answered(now, answer.reply()),
                Ok(_) => {}
                Err(_) => {
                    self.order.gap();
                    self.counters.resyncs = self.counters.resyncs.saturating_add(1);
                }
            }
        }
    }

    pub(super) fn line_broke(&mut self) {
        self.decoder.idle();
        self.order.gap();
    }

    /// Runs all work due by `now`.
    pub(super) fn tick(&mut self, now: Instant) {
        // Nodes may arrive without completing a turn: the points from before are then outdated.
        let is_old = now - self.turn_at > 2 * TURN_MAX && !self.defects.unchecked;
        if is_old && !self.scans.points().is_empty() {
            self.scans.forget();
        }
        match self.phase {
            Phase::Off => {
                self.duty = Some(MOTOR_DUTY);
                self.phase = Phase::Starting { until: now + START };
            }
            Phase::Starting { until } if now >= until => self.scan(now),
            Phase::Asking { until } if now >= until => self.reset(now),
            Phase::Scanning if self.is_silent(now) => {
                self.counters.silences = self.counters.silences.saturating_add(1);
                self.scans.forget();
                self.line_broke();
                self.decoder.expect(Mode::Answers);
                self.send(Command::Health);
                self.phase = Phase::Asking {
                    until: now + ANSWER,
                };
            }
            Phase::Starting { .. } | Phase::Asking { .. } | Phase::Scanning => {}
        }
    }

    pub(super) fn next_at(&self) -> Instant {
        match self.phase {
            Phase::Off => Instant::ZERO,
            Phase::Starting { until } | Phase::Asking { until } => until,
            Phase::Scanning if self.defects.notices_no_silence => Instant::from_nanos(u64::MAX),
            Phase::Scanning => self.node_at + self.patience,
        }
    }

    /// Whether a new duty must be sent to the motor.
    pub(super) const fn has_duty(&self) -> bool {
        self.duty.is_some()
    }

    pub(super) const fn take_duty(&mut self) -> Option<u8> {
        self.duty.take()
    }

    /// Whether a request waits for the line.
    pub(super) const fn has_output(&self) -> bool {
        !self.requests.is_empty()
    }

    pub(super) fn transmit(&mut self, buf: &mut [u8]) -> usize {
        self.requests.pop(buf)
    }

    /// Groups of five bytes that were not a node.
    pub(super) const fn bad_groups(&self) -> u32 {
        self.groups.bad
    }

    fn is_silent(&self, now: Instant) -> bool {
        now - self.node_at >= self.patience && !self.defects.notices_no_silence
    }

    fn answered(&mut self, now: Instant, reply: Reply<'_>) {
        let (Phase::Asking { .. }, Reply::Health(health)) = (self.phase, reply) else {
            return;
        };
        match health.status {
            Status::Good | Status::Warning => self.scan(now),
            _ => self.reset(now),
        }
    }

    fn reset(&mut self, now: Instant) {
        self.counters.restarts = self.counters.restarts.saturating_add(1);
        self.send(Command::Reset);
        self.phase = Phase::Starting { until: now + START };
    }

    fn scan(&mut self, now: Instant) {
        self.line_broke();
        self.decoder.expect(Mode::Answers);
        if !self.defects.skips_once {
            self.groups = Groups {
                bad: self.groups.bad,
                ..Groups::NEW
            };
        }
        self.send(Command::Scan);
        self.phase = Phase::Scanning;
        (self.node_at, self.turn_at) = (now, now);
        self.patience = SPIN_UP;
    }

    fn send(&mut self, command: Command) {
        // A request that does not fit is repeated after the following silence.
        self.requests.push(command.request().as_bytes());
    }

    fn count(&mut self, now: Instant) {
        self.counters.nodes = self.counters.nodes.saturating_add(1);
        (self.node_at, self.patience) = (now, SILENCE);
    }

    /// Processes an accepted node. The node with a turn's start mark may have been lost.
    fn believe(&mut self, now: Instant, group: Group) {
        let is_behind = self.angle_q6 > THREE_QUARTERS_Q6 && group.angle_q6 < QUARTER_Q6;
        self.angle_q6 = group.angle_q6;
        let begins = group.starts_turn || is_behind;
        self.take(now, group, begins && now - self.turn_at >= TURN_MIN);
    }

    fn take(&mut self, now: Instant, group: Group, begins: bool) {
        if begins {
            self.counters.turns = self.counters.turns.saturating_add(1);
            // A turn with a lost start counts as two.
            if now - self.turn_at <= TURN_MAX {
                self.scans.turn_ends();
            }
            self.turn_at = now;
        }
        self.scans
            .sample(group.angle_q6, group.distance_mm, group.quality);
        self.strip.take(now, group.angle_q6, group.distance_mm);
    }
}

/// The fielded parser: groups bytes by their count.
#[derive(Clone, Debug)]
struct Groups {
    /// Bytes of the descriptor still to skip.
    skips: u8,
    bytes: [u8; 5],
    len: usize,
    bad: u32,
}

impl Groups {
    const NEW: Self = Self {
        skips: 7,
        bytes: [0; 5],
        len: 0,
        bad: 0,
    };

    fn take(&mut self, byte: u8) -> Option<Group> {
        if self.skips > 0 {
            self.skips -= 1;
            return None;
        }
        self.bytes[self.len] = byte;
        self.len += 1;
        if self.len < self.bytes.len() {
            return None;
        }
        self.len = 0;
        if Node::parse(self.bytes).is_err() {
            self.bad = self.bad.saturating_add(1);
        }
        let [first, low, high, near, far] = self.bytes;
        let distance_q2 = u16::from_le_bytes([near, far]);
        Some(Group {
            starts_turn: first & 1 != 0,
            quality: first >> 2,
            angle_q6: u16::from_le_bytes([low, high]) >> 1,
            distance_mm: (distance_q2 != 0).then(|| f32::from(distance_q2) / 4.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn group(degrees: u16, starts_turn: bool) -> Group {
        Group {
            starts_turn,
            quality: 15,
            angle_q6: degrees * 64,
            distance_mm: Some(1_000.0),
        }
    }

    /// The motor gets its duty once; a second later the program requests a scan.
    #[test]
    fn a_scan_is_asked_for_when_the_motor_turns() {
        let mut lidar = Lidar::new(Defects::NONE);
        assert!(!lidar.has_duty() && !lidar.has_output());
        lidar.tick(at(5));
        assert!(lidar.has_duty() && lidar.next_at() == at(1_005));
        assert_eq!(
            (lidar.take_duty(), lidar.has_duty()),
            (Some(MOTOR_DUTY), false)
        );
        lidar.tick(at(1_004));
        assert!(!lidar.has_output());
        lidar.tick(at(1_005));
        let mut buf = [0; 16];
        let len = lidar.transmit(&mut buf);
        assert_eq!(buf[..len], *Command::Scan.request().as_bytes());
        // Three seconds until the first node, one second after each.
        assert_eq!(lidar.next_at(), at(4_005));
        lidar.count(at(1_500));
        assert_eq!((lidar.next_at(), lidar.counters.nodes), (at(2_500), 1));
    }

    /// After a silence the health is requested; without an answer within 100 ms the lidar is reset,
    /// which takes a second.
    #[test]
    fn a_silent_lidar_is_asked_and_started_again() {
        let mut lidar = Lidar::new(Defects::NONE);
        lidar.tick(at(5));
        lidar.tick(at(1_005));
        let mut buf = [0; 16];
        lidar.transmit(&mut buf);
        lidar.tick(at(4_004));
        assert_eq!(lidar.counters.silences, 0);
        lidar.tick(at(4_005));
        assert_eq!((lidar.counters.silences, lidar.next_at()), (1, at(4_105)));
        let len = lidar.transmit(&mut buf);
        assert_eq!(buf[..len], *Command::Health.request().as_bytes());
        lidar.tick(at(4_104));
        assert_eq!(lidar.counters.restarts, 0);
        lidar.tick(at(4_105));
        assert_eq!((lidar.counters.restarts, lidar.next_at()), (1, at(5_105)));
        let len = lidar.transmit(&mut buf);
        assert_eq!(buf[..len], *Command::Reset.request().as_bytes());
    }

    /// A turn begins at a node's start mark, or where the fourth quarter is followed by the first.
    /// It begins no sooner than 80 ms after the one before, and one of more than 1.5 s does not
    /// count.
    #[test]
    fn a_turn_begins_behind_three_quarters() {
        let turns = |nodes: &[(u64, u16, bool)]| {
            let mut lidar = Lidar::new(Defects::NONE);
            for (millis, degrees, starts_turn) in nodes {
                lidar.believe(at(*millis), group(*degrees, *starts_turn));
            }
            lidar.counters.turns
        };
        assert_eq!(turns(&[(100, 271, false), (101, 89, false)]), 1);
        assert_eq!(turns(&[(100, 270, false), (101, 89, false)]), 0);
        assert_eq!(turns(&[(100, 271, false), (101, 90, false)]), 0);
        assert_eq!(turns(&[(100, 89, false), (101, 271, false)]), 0);
        assert_eq!(turns(&[(100, 5, true), (179, 5, true)]), 1);
        assert_eq!(turns(&[(100, 5, true), (180, 5, true)]), 2);
        assert_eq!(turns(&[(79, 5, true)]), 0);
    }

    /// The fielded parser skips seven bytes, then takes groups of five with any content: 0x3E is
    /// quality 15 and no start; 0x2D01 halved are 90 degrees of 64 parts, 0x0FA2 quarters are
    /// 1000.5 mm; 0 is no reading.
    #[test]
    fn the_fielded_parser_takes_five_bytes_for_a_node() {
        let mut groups = Groups::NEW;
        for byte in [0xA5, 0x5A, 5, 0, 0, 0x40, 0x81] {
            assert!(groups.take(byte).is_none());
        }
        let mut node = |bytes: [u8; 5]| {
            let taken = bytes.map(|byte| groups.take(byte));
            assert!(taken[..4].iter().all(Option::is_none));
            let group = taken[4].expect("five bytes");
            let mm = group.distance_mm;
            (
                group.starts_turn,
                group.quality,
                group.angle_q6,
                mm,
                groups.bad,
            )
        };
        let ahead = (false, 15, 90 * 64, Some(1_000.5), 0);
        assert_eq!(node([0x3E, 0x01, 0x2D, 0xA2, 0x0F]), ahead);
        assert_eq!(node([0x3D, 0x01, 0x2D, 0, 0]), (true, 15, 90 * 64, None, 0));
        assert_eq!(
            node([0x3F, 0x00, 0x2D, 4, 0]),
            (true, 15, 90 * 64, Some(1.0), 1)
        );
    }

    /// Twice the longest turn, 1.5 s, without a completed turn makes the points outdated.
    #[test]
    fn what_was_seen_long_ago_is_forgotten() {
        let mut lidar = Lidar::new(Defects::NONE);
        lidar.phase = Phase::Scanning;
        for turn in 0..3_u16 {
            for degree in 0..360 {
                let millis = u64::from(turn) * 200 + u64::from(degree) / 2;
                lidar.believe(at(100 + millis), group(degree, degree == 0));
            }
        }
        lidar.node_at = at(9_000);
        assert!(!lidar.scans.points().is_empty());
        lidar.tick(at(500 + 3_000));
        assert!(!lidar.scans.points().is_empty());
        lidar.tick(at(500 + 3_001));
        assert!(lidar.scans.points().is_empty());
    }
}
