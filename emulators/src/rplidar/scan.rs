//! Rotation, samples, nodes and capsules.
//!
//! The beam looks back by an angle that depends on the distance (see `beam`). The sensor subtracts
//! that angle from the head's angle, but only if it has a distance. So invalid nodes lie ahead of
//! their neighbours: 5.3 degrees at 0.5 m, 6.6 at 1 m, 7.8 at 6 m (angles of a real sensor: 213,
//! 220, 217, 222; of others 5.8 and 6.2 degrees). Capsules of the kind 0x84 contain the head's
//! angle alone, and the host subtracts the rest.

use core::time::Duration;

use protocols::Instant;
use protocols::rplidar::{
    CAPSULE_SAMPLES, Capsule, CapsuleSample, Command, Descriptor, Node, TURN_Q6, ULTRA_SAMPLES,
    UltraCapsule, kind,
};

use super::beam::{Seen, ZERO_DEG};
use super::{Fault, Rplidar};
use crate::lidar::beam::normal;
use crate::world::World;

/// Interval of the checks of the rotation while a scan starts. A guess.
const CHECK_TIME: Duration = Duration::from_millis(25);
/// Maximum change of an even rotation, as a share, in each of [`EVEN_CHECKS`] consecutive checks. A
/// guess.
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
/// Current at 5 V while the head starts: LD108 says 500 to 600.
const START_MA: f64 = 550.0;
/// Error codes of the health. Guesses: the vendor does not document any.
mod error {
    pub(super) const LASER: u16 = 0x0001;
    pub(super) const ROTATION: u16 = 0x0002;
    pub(super) const UNKNOWN: u16 = 0x8000;
}

/// State of the sensor.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Phase {
    Off,
    Idle,
    Starting(Starting),
    Scanning(Box<Scanning>),
    ProtectionStop { error: u16 },
}

/// The streamed data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stream {
    Nodes,
    /// Nodes whatever the rotation is.
    Forced,
    Capsules,
    /// Capsules of type 0x84.
    Ultra,
}

/// A scan that waits for an even rotation.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Starting {
    stream: Stream,
    sample_time: Duration,
    check_at: Instant,
    speed_rpm: f64,
    even_checks: u8,
    /// Time of the first node, and start of the current pause.
    paused: Option<(Instant, Instant)>,
}

/// A scan that takes samples.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scanning {
    stream: Stream,
    sample_time: Duration,
    /// Scheduled time of the scan's first node.
    began_at: Instant,
    /// Scheduled time of sample 0.
    from: Instant,
    sample: u64,
    speed_rpm: f64,
    /// Results of the capsule's samples.
    capsule: Vec<Seen>,
    /// Angle of the head at the first sample of the capsule.
    start_angle_q6: u16,
    is_first: bool,
}

impl Phase {
    /// Time of the next action.
    pub(super) fn next_at(&self) -> Option<Instant> {
        match self {
            Self::Off | Self::Idle | Self::ProtectionStop { .. } => None,
            Self::Starting(starting) => Some(starting.check_at),
            Self::Scanning(scanning) => Some(scanning.sample_at()),
        }
    }
}

impl Scanning {
    fn phase(
        (stream, sample_time): (Stream, Duration),
        began_at: Instant,
        from: Instant,
        speed_rpm: f64,
    ) -> Phase {
        Phase::Scanning(Box::new(Self {
            stream,
            sample_time,
            began_at,
            from,
            sample: 0,
            speed_rpm,
            capsule: Vec::new(),
            start_angle_q6: 0,
            is_first: began_at == from,
        }))
    }

    fn sample_at(&self) -> Instant {
        let nanos = u64::try_from(self.sample_time.as_nanos()).unwrap_or(u64::MAX);
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

    /// Starts a scan: the descriptor goes out at once, nodes once the rotation is even.
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
        let express = match command {
            Command::ExpressScan { mode } => self.profile.express(mode),
            _ => None,
        };
        let (stream, descriptor) = match (command, express) {
            (_, Some((_, kind::ULTRA))) => (Stream::Ultra, Descriptor::ultra()),
            (_, Some(_)) => (Stream::Capsules, Descriptor::capsules()),
            (Command::ForceScan, _) => (Stream::Forced, Descriptor::nodes()),
            _ => (Stream::Nodes, Descriptor::nodes()),
        };
        let sample_time = self
            .profile
            .sample_time(express.map_or(0, |(mode, _)| mode));
        self.announce(descriptor);
        if is_torn {
            let count = usize::try_from(torn_bytes).expect("1 to 4");
            let node = *Node::new(false, self.profile.quality(4.0), 5_760, 4_000).as_bytes();
            self.output.send(&node[5 - count..], &mut self.faults);
        }
        let speed_rpm = self.rotor.speed_rpm();
        self.phase = match stream {
            Stream::Forced => Scanning::phase((stream, sample_time), at, at, speed_rpm),
            _ => Phase::Starting(Starting {
                stream,
                sample_time,
                check_at: at + CHECK_TIME,
                speed_rpm,
                even_checks: 0,
                paused: None,
            }),
        };
    }

    /// Whether a request for a scan gets no answer.
    fn refuses_scan(&mut self, at: Instant, command: Command) -> bool {
        if let Command::ExpressScan { mode } = command
            && self.profile.express(mode).is_none()
        {
            let detail = format!("express scan of mode {mode} is not supported");
            self.log.violation(at, "mode-not-supported", detail, &[]);
            return true;
        }
        if matches!(self.phase, Phase::ProtectionStop { .. }) {
            let rule = "scan-in-protection-stop";
            let detail = "a scan is requested in Protection Stop, which ignores it".to_owned();
            self.log.violation(at, rule, detail, &[]);
            return true;
        }
        let limit_ma = self.faults.figure(Fault::WeakSupply);
        if limit_ma.is_some_and(|limit_ma| self.current_ma() > limit_ma) {
            self.restart(
                at,
                "brown-out",
                "the supply is too weak for the start of the scan",
            );
            return true;
        }
        false
    }

    /// Current that a scan draws from the supply.
    fn current_ma(&self) -> f64 {
        if self.rotor.speed_rpm() < SPEED_MIN_RPM {
            START_MA
        } else {
            CORE_MA
        }
    }

    /// Runs the actions of a scan that are due at `at`.
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
            let scan = (starting.stream, starting.sample_time);
            self.phase = Scanning::phase(scan, began_at, at, speed_rpm);
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
        // Turns before the first sample do not count: a real sensor's first node starts none.
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
                sample_time: scanning.sample_time,
                check_at: at + CHECK_TIME,
                speed_rpm,
                even_checks: 0,
                paused: Some((scanning.began_at, at)),
            });
            return;
        }
        let angle_deg = self.rotor.angle_deg();
        let range_max_mm = self.profile.range_max_mm();
        let seen = self.optics.measure(world, at, angle_deg, range_max_mm);
        match scanning.stream {
            Stream::Capsules | Stream::Ultra => self.fill(&mut scanning, angle_deg, seen),
            Stream::Nodes | Stream::Forced => self.node(starts_turn, angle_deg, seen),
        }
        scanning.sample += 1;
        self.phase = Phase::Scanning(scanning);
    }

    /// Takes whole turns off the angle; returns whether there was one.
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

    fn node(&mut self, starts_turn: bool, angle_deg: f64, seen: Seen) {
        let head_deg = angle_deg + ZERO_DEG;
        let (angle_q6, quality) = match seen.distance_q2 {
            0 => (whole_q6(head_deg), 0),
            _ => {
                let angle_deg = (head_deg - seen.lead_deg + 360.0) % 360.0;
                let quality = self.profile.quality(seen.light);
                (whole_q6(angle_deg) % TURN_Q6, quality)
            }
        };
        let angle_q6 = match self.faults.has(Fault::AnglePast360) {
            true => angle_q6,
            false => angle_q6 % TURN_Q6,
        };
        let node = Node::new(starts_turn, quality, angle_q6, seen.distance_q2);
        self.output.stream(node.as_bytes(), &mut self.faults);
    }

    /// Puts a sample into a capsule, and sends the capsule once it is full. A capsule of the kind
    /// 0x84 is full with the next one's first sample, because its last difference needs that.
    fn fill(&mut self, scanning: &mut Scanning, angle_deg: f64, seen: Seen) {
        let head_q6 = whole_q6(angle_deg + ZERO_DEG) % TURN_Q6;
        if scanning.capsule.is_empty() {
            scanning.start_angle_q6 = head_q6;
        }
        scanning.capsule.push(seen);
        let (samples, first) = (&scanning.capsule, scanning.is_first);
        if scanning.stream == Stream::Ultra {
            let Some((whole, [next])) = samples.split_first_chunk::<ULTRA_SAMPLES>() else {
                return;
            };
            let millimetres = whole.map(whole_mm);
            let angle_q6 = scanning.start_angle_q6;
            let capsule = UltraCapsule::new(first, angle_q6, &millimetres, whole_mm(*next));
            self.output.stream(capsule.as_bytes(), &mut self.faults);
            scanning.capsule.drain(..ULTRA_SAMPLES);
            scanning.start_angle_q6 = head_q6;
        } else if let Ok(whole) = <&[_; CAPSULE_SAMPLES]>::try_from(&samples[..]) {
            let samples = whole.map(capsule_sample);
            let capsule = Capsule::new(first, scanning.start_angle_q6, &samples);
            self.output.stream(capsule.as_bytes(), &mut self.faults);
            scanning.capsule.clear();
        } else {
            return;
        }
        scanning.is_first = false;
    }
}

/// The whole millimetres of a sample; 0 without a measurement.
fn whole_mm(seen: Seen) -> u16 {
    seen.distance_q2.saturating_add(2) / 4
}

/// A sample in the form of a capsule, with the angle to subtract from the head's, in eighths of a
/// degree. A sample without a measurement is empty.
fn capsule_sample(seen: Seen) -> CapsuleSample {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0 to 63, and a cast saturates"
    )]
    let dtheta_q3 = (seen.lead_deg * 8.0 + 0.5).clamp(0.0, 63.0) as u8;
    CapsuleSample {
        distance_mm: whole_mm(seen),
        dtheta_q3,
    }
}

/// An angle in 64ths of a degree.
fn whole_q6(degrees: f64) -> u16 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "angles are between 0 and 368 degrees, and a cast saturates"
    )]
    let whole = (degrees * 64.0 + 0.5) as u16;
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A scan that began at 400 rpm pauses when the speed differs by more than 100 in either
    /// direction. A scan of a slow head pauses below 54 rpm, nine tenths of the slowest valid
    /// speed. A forced scan never pauses.
    #[test]
    fn a_scan_pauses_where_the_head_turns_otherwise() {
        let is_even = |stream, began_rpm, speed_rpm| {
            let scan = (stream, Duration::from_micros(500));
            let phase = Scanning::phase(scan, Instant::ZERO, Instant::ZERO, began_rpm);
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

    /// 498.753 us a sample, half of that in an express scan; firmware 1.29 uses its reported
    /// figures.
    #[test]
    fn a_sample_is_due_at_its_number() {
        use crate::rplidar::Profile::{self, Fw120, Fw129};
        let due = |profile: Profile, mode, sample| {
            let from = Instant::from_secs(2);
            let scan = (Stream::Nodes, profile.sample_time(mode));
            let Phase::Scanning(mut scanning) = Scanning::phase(scan, from, from, 300.0) else {
                unreachable!("a scan");
            };
            scanning.sample = sample;
            let phase = Phase::Scanning(scanning);
            phase.next_at().map(|at| at.as_nanos() - from.as_nanos())
        };
        assert_eq!(
            [0, 3].map(|sample| due(Fw120, 0, sample)),
            [Some(0), Some(1_496_259)]
        );
        assert_eq!(due(Fw120, 1, 4), Some(997_504));
        let of_129 = [0, 1, 2, 3, 4].map(|mode| due(Fw129, mode, 10));
        assert_eq!(
            of_129,
            [5_080_000, 2_540_000, 1_270_000, 1_270_000, 2_010_000].map(Some)
        );
    }

    /// The head draws 550 mA at its start: a supply with that limit holds, one with less does not.
    #[test]
    fn a_supply_of_what_is_drawn_holds() {
        let gives_way = |limit_ma: f64| {
            let mut lidar = Rplidar::new("lidar", 1, crate::rplidar::Config::default());
            lidar.faults.set(Fault::WeakSupply, Some(limit_ma));
            lidar.refuses_scan(Instant::from_secs(5), Command::Scan)
        };
        assert_eq!([549.9, 550.0].map(gives_way), [true, false]);
    }

    /// Quarters of a millimetre are rounded to whole ones, angles to 64ths of a degree; a capsule
    /// holds up to 63 eighths of a degree.
    #[test]
    fn figures_of_nodes_and_capsules_are_rounded() {
        let mm = |distance_q2| {
            whole_mm(Seen {
                distance_q2,
                ..Seen::default()
            })
        };
        assert_eq!([0, 1, 2, 4_001, 4_002].map(mm), [0, 0, 1, 1_000, 1_001]);
        assert_eq!(mm(u16::MAX), 16_383);
        let lead = |lead_deg| {
            let seen = Seen {
                lead_deg,
                distance_q2: 4_000,
                light: 1.0,
            };
            let sample = capsule_sample(seen);
            (sample.distance_mm, sample.dtheta_q3)
        };
        let leads = [0.0, 5.3, 5.32, 7.8, 9.0, -1.0].map(lead);
        assert_eq!(leads, [0, 42, 43, 62, 63, 0].map(|lead| (1_000, lead)));
        assert_eq!(
            [0.0, 0.007, 0.008, 90.0, 361.624].map(whole_q6),
            [0, 0, 1, 5_760, 23_144]
        );
    }

    /// The head at 355 degrees is 6.624 farther on. A point a metre away lies as many degrees
    /// behind it; without a measurement the angle is the head's, 1.624 degrees of the next turn.
    #[test]
    fn a_node_has_the_angle_of_its_point() {
        let sent = |angle_deg: f64, seen: Seen, fault: Option<Fault>| {
            let mut lidar = Rplidar::new("lidar", 1, crate::rplidar::Config::default());
            if let Some(fault) = fault {
                lidar.faults.set(fault, None);
            }
            lidar.node(true, angle_deg, seen);
            let mut buf = [0; 8];
            let len = lidar.output.transmit(&mut buf);
            buf[..len].to_vec()
        };
        let node = |quality: u8, angle_q6: u16, distance_q2: u16| {
            Node::new(true, quality, angle_q6, distance_q2)
                .as_bytes()
                .to_vec()
        };
        let point = |lead_deg| Seen {
            distance_q2: 4_000,
            lead_deg,
            light: 4.0,
        };
        assert_eq!(sent(355.0, point(6.624), None), node(21, 355 * 64, 4_000));
        assert_eq!(sent(0.5, point(8.0), None), node(21, 22_984, 4_000));
        assert_eq!(sent(358.0, point(1.0), None), node(21, 232, 4_000));
        assert_eq!(sent(355.0, Seen::default(), None), node(0, 104, 0));
        let past = Some(Fault::AnglePast360);
        assert_eq!(sent(355.0, Seen::default(), past), node(0, 23_144, 0));
        assert_eq!(sent(358.0, point(1.0), past), node(21, 232, 4_000));
    }

    /// The head has passed its zero: a node starts a turn, unless it is the first of its scan.
    #[test]
    fn the_first_node_of_a_scan_starts_no_turn() {
        use crate::rplidar::{Config, motor};
        use crate::world::{BodyConfig, Pose, Scene, Shape};
        let scene = Scene::new::<Shape>([], vec![]).expect("empty");
        let world = World::new(scene, BodyConfig::default(), Pose::default(), 1).expect("free");
        let starts = |sample: u64, angle_deg: f64| {
            let config = Config::default();
            let rotor = motor::rotor(config.motor, angle_deg);
            let mut lidar = Rplidar::new("lidar", 1, config);
            lidar.rotor = rotor;
            let scan = (Stream::Forced, Duration::from_micros(500));
            let at = Instant::from_secs(5);
            let Phase::Scanning(mut scanning) = Scanning::phase(scan, at, at, 0.0) else {
                unreachable!("a scan");
            };
            scanning.sample = sample;
            lidar.sample(at, scanning, &world);
            let mut buf = [0; 8];
            assert_eq!(lidar.output.transmit(&mut buf), 5);
            // The start bit, and its complement.
            buf[0] & 0b11 == 0b01
        };
        assert_eq!(
            [0, 1, 9].map(|sample| starts(sample, 365.0)),
            [false, true, true]
        );
        assert_eq!([0, 1, 9].map(|sample| starts(sample, 5.0)), [false; 3]);
    }
}
