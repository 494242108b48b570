//! Rotation, samples, nodes and capsules.
//!
//! The sensor takes 7 degrees off the angle of the head, as triangulation needs it, but only where
//! there is a distance. So invalid nodes lie 7 degrees ahead of their neighbours (inferred from
//! angles of a real sensor: 213, 220, 217, 222).

use core::time::Duration;

use protocols::Instant;
use protocols::rplidar::{
    CAPSULE_SAMPLES, Capsule, CapsuleSample, Command, Descriptor, Node, TURN_Q6,
};

use super::{Fault, Rplidar};
use crate::lidar::beam::normal;
use crate::world::World;

/// Time of a sample: 2,005 a second, LD108 says 2,000 to 2,010.
const STANDARD_TIME: Duration = Duration::from_nanos(498_753);
/// Time of a sample in an express scan, half of it.
const EXPRESS_TIME: Duration = Duration::from_nanos(249_377);
/// The rotation is checked this often while a scan starts. A guess, ...
const CHECK_TIME: Duration = Duration::from_millis(25);
/// ... and is even if it changed by less than this between that many checks in a row.
const EVEN_CHANGE: f64 = 0.002;
const EVEN_CHECKS: u8 = 4;
/// Slowest rotation that counts as one (LD108: 1 to 10 turns a second).
const SPEED_MIN_RPM: f64 = 60.0;
/// A scan pauses at a speed that differs from the one it began with by more than this part of it. A
/// guess.
const SPEED_CHANGE: f64 = 0.25;
/// A pause that lasts this long is a Protection Stop. A guess.
const PAUSE_TIME: Duration = Duration::from_secs(2);
/// Current of a scan at 5 V (LD108).
const CORE_MA: f64 = 300.0;
/// The same while the head starts: LD108 says 500 to 600.
const START_MA: f64 = 550.0;
/// How far an invalid node lies ahead.
const INVALID_AHEAD_DEG: f64 = 7.0;
/// The same as the offset that a capsule takes off valid samples, eighths of a degree.
const VALID_OFFSET_Q3: u8 = 56;
/// Error codes of the health. Guesses: the vendor does not document any.
mod error {
    pub(super) const LASER: u16 = 0x0001;
    pub(super) const ROTATION: u16 = 0x0002;
    pub(super) const UNKNOWN: u16 = 0x8000;
}

/// What the sensor is doing.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Phase {
    Off,
    Idle,
    Starting(Starting),
    Scanning(Box<Scanning>),
    ProtectionStop { error: u16 },
}

/// What is streamed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stream {
    Nodes,
    /// Nodes whatever the rotation is.
    Forced,
    Capsules,
}

/// Waits for an even rotation.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Starting {
    stream: Stream,
    check_at: Instant,
    speed_rpm: f64,
    even_checks: u8,
    /// When the first node was sent, and since when the scan pauses.
    paused: Option<(Instant, Instant)>,
}

/// Measures.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scanning {
    stream: Stream,
    /// When the first node of the scan was due.
    began_at: Instant,
    /// When sample 0 was due.
    from: Instant,
    sample: u64,
    speed_rpm: f64,
    capsule: Vec<CapsuleSample>,
    /// Angle of the head at the first sample of the capsule.
    start_angle_q6: u16,
    is_first: bool,
}

impl Phase {
    /// When there is something to do.
    pub(super) fn next_at(&self) -> Option<Instant> {
        match self {
            Self::Off | Self::Idle | Self::ProtectionStop { .. } => None,
            Self::Starting(starting) => Some(starting.check_at),
            Self::Scanning(scanning) => Some(scanning.sample_at()),
        }
    }
}

impl Scanning {
    fn phase(stream: Stream, began_at: Instant, from: Instant, speed_rpm: f64) -> Phase {
        Phase::Scanning(Box::new(Self {
            stream,
            began_at,
            from,
            sample: 0,
            speed_rpm,
            capsule: Vec::with_capacity(CAPSULE_SAMPLES),
            start_angle_q6: 0,
            is_first: began_at == from,
        }))
    }

    fn sample_at(&self) -> Instant {
        let time = match self.stream {
            Stream::Nodes | Stream::Forced => STANDARD_TIME,
            Stream::Capsules => EXPRESS_TIME,
        };
        let nanos = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        self.from + Duration::from_nanos(nanos.saturating_mul(self.sample))
    }

    /// Whether the head turns as it did when the scan began.
    fn is_even(&self, speed_rpm: f64) -> bool {
        let change = (speed_rpm - self.speed_rpm).abs();
        let is_fast = speed_rpm >= 0.9 * SPEED_MIN_RPM;
        self.stream == Stream::Forced || is_fast && change <= SPEED_CHANGE * self.speed_rpm
    }
}

impl Rplidar {
    /// Ends a scan if there is one; a Protection Stop stays.
    pub(super) fn end_scan(&mut self) {
        let was_scanning = matches!(self.phase, Phase::Starting(_) | Phase::Scanning(_));
        if !was_scanning {
            return;
        }
        self.phase = Phase::Idle;
        if let Some(nodes) = self.faults.figure(Fault::UncleanStop) {
            let last = self.output.last().to_vec();
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a cast of a float saturates"
            )]
            let nodes = nodes.min(40.0) as usize;
            let stale = last.repeat(nodes);
            let torn = &last[..last.len() * 3 / 5];
            let bytes = [&stale, torn].concat();
            self.output.send(&bytes, &mut self.faults);
        }
    }

    /// A scan is asked for: the descriptor comes at once, nodes when the rotation is even.
    pub(super) fn start_scan(&mut self, at: Instant, command: Command) {
        self.end_scan();
        self.rotor.advance(at);
        // Drawn whether they are needed or not.
        let share = |fault| self.faults.figure(fault).unwrap_or(0.0);
        let is_deaf = self.starts.chance(share(Fault::DeafStart));
        let is_torn = self.starts.chance(share(Fault::TornStart));
        let torn_bytes = 1 + self.starts.below(4);
        if is_deaf || self.refuses_scan(at, command) {
            return;
        }
        let (stream, descriptor) = match command {
            Command::ExpressScan { .. } => (Stream::Capsules, Descriptor::capsules()),
            Command::ForceScan => (Stream::Forced, Descriptor::nodes()),
            _ => (Stream::Nodes, Descriptor::nodes()),
        };
        self.announce(descriptor);
        if is_torn {
            let count = usize::try_from(torn_bytes).expect("1 to 4");
            let node = *Node::new(false, self.profile.quality(), 5_760, 4_000).as_bytes();
            self.output.send(&node[5 - count..], &mut self.faults);
        }
        let speed_rpm = self.rotor.speed_rpm();
        self.phase = match stream {
            Stream::Forced => Scanning::phase(stream, at, at, speed_rpm),
            Stream::Nodes | Stream::Capsules => Phase::Starting(Starting {
                stream,
                check_at: at + CHECK_TIME,
                speed_rpm,
                even_checks: 0,
                paused: None,
            }),
        };
    }

    /// Whether a request for a scan has no answer, for one reason or another.
    fn refuses_scan(&mut self, at: Instant, command: Command) -> bool {
        if let Command::ExpressScan { mode } = command
            && !self.profile.has_express(mode)
        {
            let detail = format!("express scan of mode {mode} is not supported");
            self.log.violation(at, "mode-not-supported", detail, &[]);
            return true;
        }
        if matches!(self.phase, Phase::ProtectionStop { .. }) {
            let rule = "scan-in-protection-stop";
            let detail = "a scan is asked for in Protection Stop, which ignores it".to_owned();
            self.log.violation(at, rule, detail, &[]);
            return true;
        }
        let limit_ma = self.faults.figure(Fault::WeakSupply);
        if limit_ma.is_some_and(|limit_ma| self.current_ma() > limit_ma) {
            self.restart(at, "brown-out", "the supply gives way as the scan begins");
            return true;
        }
        false
    }

    /// What a scan draws from the supply.
    fn current_ma(&self) -> f64 {
        if self.rotor.speed_rpm() < SPEED_MIN_RPM {
            START_MA
        } else {
            CORE_MA
        }
    }

    /// Does what a scan has to do at `at`.
    pub(super) fn scan(&mut self, at: Instant, world: &World) {
        self.rotor.advance(at);
        match core::mem::replace(&mut self.phase, Phase::Idle) {
            Phase::Starting(starting) => self.check_rotation(at, starting),
            Phase::Scanning(scanning) => self.sample(at, scanning, world),
            phase => self.phase = phase,
        }
    }

    /// Checks whether the rotation has become even.
    fn check_rotation(&mut self, at: Instant, mut starting: Starting) {
        let speed_rpm = self.rotor.speed_rpm();
        let change = (speed_rpm - starting.speed_rpm).abs();
        let is_even = speed_rpm >= SPEED_MIN_RPM && change <= EVEN_CHANGE * speed_rpm;
        starting.even_checks = if is_even { starting.even_checks + 1 } else { 0 };
        starting.speed_rpm = speed_rpm;
        starting.check_at = at + CHECK_TIME;
        let since = starting.paused.map(|(_, since)| since);
        if starting.even_checks >= EVEN_CHECKS {
            let began_at = starting.paused.map_or(at, |(began_at, _)| began_at);
            self.phase = Scanning::phase(starting.stream, began_at, at, speed_rpm);
            let detail = format!("the head turns evenly at {speed_rpm:.0} rpm");
            self.log.note(at, "rotation-stable", detail);
        } else if since.is_some_and(|since| at - since >= PAUSE_TIME) {
            self.protect(at, error::ROTATION, "the head turns too slowly or unevenly");
        } else {
            self.phase = Phase::Starting(starting);
        }
    }

    fn protect(&mut self, at: Instant, error: u16, why: &str) {
        self.phase = Phase::ProtectionStop { error };
        self.log.note(at, "protection-stop", why.to_owned());
    }

    /// Takes one sample.
    fn sample(&mut self, at: Instant, mut scanning: Box<Scanning>, world: &World) {
        // Turns before the first sample are nobody's: a real sensor's first node starts none.
        let starts_turn = self.wrap_angle() && scanning.sample > 0;
        let due = self.faults.figure(Fault::ProtectionStop);
        if self.faults.has(Fault::LaserOff) {
            return self.protect(at, error::LASER, "the laser is off");
        }
        if due.is_some_and(|seconds| (at - scanning.began_at).as_secs_f64() >= seconds) {
            return self.protect(at, error::UNKNOWN, "for no visible reason");
        }
        let speed_rpm = self.rotor.speed_rpm();
        if !scanning.is_even(speed_rpm) {
            let detail = format!("the head turns at {speed_rpm:.0} rpm");
            self.log.note(at, "rotation-unstable", detail);
            self.phase = Phase::Starting(Starting {
                stream: scanning.stream,
                check_at: at + CHECK_TIME,
                speed_rpm,
                even_checks: 0,
                paused: Some((scanning.began_at, at)),
            });
            return;
        }
        let angle_deg = self.rotor.angle_deg();
        let range_max_mm = self.profile.range_max_mm();
        let distance_q2 = self.optics.measure(world, at, angle_deg, range_max_mm);
        match scanning.stream {
            Stream::Capsules => self.fill(&mut scanning, angle_deg, distance_q2),
            Stream::Nodes | Stream::Forced => self.node(starts_turn, angle_deg, distance_q2),
        }
        scanning.sample += 1;
        self.phase = Phase::Scanning(scanning);
    }

    /// Takes whole turns off the angle; whether there was one.
    fn wrap_angle(&mut self) -> bool {
        let has_turned = self.rotor.angle_deg() >= 360.0;
        while self.rotor.angle_deg() >= 360.0 {
            self.rotor.wrap();
        }
        if has_turned {
            let noise = normal(&mut self.drive);
            self.rotor.wander(noise);
            let uneven = self.drive.uniform();
            if let Some(most) = self.faults.figure(Fault::Uneven) {
                self.rotor.dust_rpm_s = uneven * most;
            }
        }
        has_turned
    }

    fn node(&mut self, starts_turn: bool, angle_deg: f64, distance_q2: u16) {
        let (angle_q6, quality) = match distance_q2 {
            0 => (whole_q6(angle_deg + INVALID_AHEAD_DEG), 0),
            _ => (whole_q6(angle_deg) % TURN_Q6, self.profile.quality()),
        };
        let angle_q6 = match self.faults.has(Fault::AnglePast360) {
            true => angle_q6,
            false => angle_q6 % TURN_Q6,
        };
        let node = Node::new(starts_turn, quality, angle_q6, distance_q2);
        self.output.stream(node.as_bytes(), &mut self.faults);
    }

    /// Puts a sample into a capsule, and sends it when it is full.
    fn fill(&mut self, scanning: &mut Scanning, angle_deg: f64, distance_q2: u16) {
        if scanning.capsule.is_empty() {
            scanning.start_angle_q6 = whole_q6(angle_deg + INVALID_AHEAD_DEG) % TURN_Q6;
        }
        let distance_mm = distance_q2.saturating_add(2) / 4;
        let dtheta_q3 = if distance_mm == 0 { 0 } else { VALID_OFFSET_Q3 };
        scanning.capsule.push(CapsuleSample {
            distance_mm,
            dtheta_q3,
        });
        if let Ok(samples) = <&[_; CAPSULE_SAMPLES]>::try_from(&scanning.capsule[..]) {
            let first = core::mem::take(&mut scanning.is_first);
            let capsule = Capsule::new(first, scanning.start_angle_q6, samples);
            self.output.stream(capsule.as_bytes(), &mut self.faults);
            scanning.capsule.clear();
        }
    }
}

/// An angle in 64ths of a degree.
fn whole_q6(degrees: f64) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "angles are between 0 and 367 degrees, and a cast saturates"
    )]
    let whole = (degrees * 64.0 + 0.5) as u16;
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scan that began at 400 rpm pauses when that differs by more than 100, either way; one of
    /// a slow head below 54 rpm, nine tenths of the slowest that counts. A forced one never does.
    #[test]
    fn a_scan_pauses_where_the_head_turns_otherwise() {
        let is_even = |stream, began_rpm, speed_rpm| {
            let phase = Scanning::phase(stream, Instant::ZERO, Instant::ZERO, began_rpm);
            matches!(phase, Phase::Scanning(scanning) if scanning.is_even(speed_rpm))
        };
        let fast = [299.0, 300.0, 400.0, 500.0, 501.0];
        let slow = [53.0, 54.0, 60.0, 75.0, 76.0];
        let expected = [false, true, true, true, false];
        for stream in [Stream::Nodes, Stream::Capsules] {
            assert_eq!(fast.map(|rpm| is_even(stream, 400.0, rpm)), expected);
            assert_eq!(slow.map(|rpm| is_even(stream, 60.0, rpm)), expected);
        }
        assert_eq!(
            [0.0, 53.0, 900.0].map(|rpm| is_even(Stream::Forced, 400.0, rpm)),
            [true; 3]
        );
    }

    /// 498.753 us a sample, an express one takes half of that.
    #[test]
    fn a_sample_is_due_at_its_number() {
        let due = |stream, sample| {
            let from = Instant::from_secs(2);
            let Phase::Scanning(mut scanning) = Scanning::phase(stream, from, from, 300.0) else {
                unreachable!("a scan");
            };
            scanning.sample = sample;
            let phase = Phase::Scanning(scanning);
            phase.next_at().map(|at| at.as_nanos() - from.as_nanos())
        };
        for stream in [Stream::Nodes, Stream::Forced] {
            assert_eq!(
                [0, 3].map(|sample| due(stream, sample)),
                [Some(0), Some(1_496_259)]
            );
        }
        assert_eq!(due(Stream::Capsules, 4), Some(997_508));
    }

    /// 550 mA are drawn as the head starts: a supply of as much holds, one of less does not.
    #[test]
    fn a_supply_of_what_is_drawn_holds() {
        let gives_way = |limit_ma: f64| {
            let mut lidar = Rplidar::new("lidar", 1, crate::rplidar::Config::default());
            lidar.faults.set(Fault::WeakSupply, Some(limit_ma));
            lidar.refuses_scan(Instant::from_secs(5), Command::Scan)
        };
        assert_eq!([549.9, 550.0].map(gives_way), [true, false]);
    }
}
