//! Scans: packets of one lidar revolution, converted to points in the robot's frame.
//!
//! ```text
//! packets -> TurnAssembler -> Turn: 360 distances, start, end
//!                              Turn + odometry -> Scan: points as if all were measured at the end
//! ```
//!
//! A turn ends when the packet index decreases (or at the last packet), so a lost first packet does
//! not lose the turn. Missing packets leave "no data", never the distances of an earlier turn.
//! While the sensor turns once, the robot drives on: at 0.3 m/s and 5 turns a second 60 mm (seed
//! report, chapter on the lidar). Every beam is therefore moved by the odometry's motion between
//! the beam and the end of the turn.

use core::f32::consts::TAU;
use core::time::Duration;

use protocols::xv11::SpeedWord;
use protocols::{Instant, xv11};

use crate::odometry::Odometry;
use crate::pose::{Point, PoseChange, normalised, sin_cos};

/// Beams in a turn, one degree apart.
pub const BEAMS: usize = 360;

const PACKETS: u8 = 90;
const READINGS: usize = BEAMS / PACKETS as usize;

/// Minimum number of packets of a turn, a tenth: a stuck lidar repeats one or two of them.
const PACKETS_MIN: u8 = 9;

/// Maximum duration of a turn: 120 turns a minute.
const TURN_MAX: Duration = Duration::from_millis(500);

/// Treatment of readings with the sensor's strength warning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WeakReadings {
    /// Weak readings count like other readings.
    #[default]
    Use,
    /// Weak readings count as no data, as in the fielded code; that is about 28 % of near readings.
    Discard,
}

/// Position of the lidar on the robot, and the limits of valid readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounting {
    /// Position of the lidar's axis in the robot's frame.
    pub position: Point,
    /// Direction of beam 0 in the robot's frame, radians.
    pub first_bearing: f32,
    /// Minimum valid distance.
    pub distance_min_mm: u16,
    /// Maximum valid distance.
    pub distance_max_mm: u16,
    /// Readings with the strength warning.
    pub weak: WeakReadings,
    /// Time from the measurement of a packet's last beam to the arrival of its last byte.
    pub delay: Duration,
}

/// Defects of the fielded program in assembling scans; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Distances of packets that did not arrive stay from earlier turns (XV-07).
    pub stale_distances: bool,
    /// A turn ends only at packet 0; without that packet the turn is lost (XV-06).
    pub synchronised_by_packet_0: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        stale_distances: false,
        synchronised_by_packet_0: false,
    };
}

/// Distances of one turn, still on the sensor's clock.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Turn {
    /// Distances by sensor degree; 0 is no data.
    pub distances_mm: [u16; BEAMS],
    /// Time of beam 0, measured or calculated.
    pub start: Instant,
    /// End of the turn.
    pub end: Instant,
    /// Packets that arrived.
    pub packets: u8,
    /// Maximum number of missing packets in a row: a direction without data.
    pub gap: u8,
}

impl Turn {
    const EMPTY: Self = Self {
        distances_mm: [0; BEAMS],
        start: Instant::ZERO,
        end: Instant::ZERO,
        packets: 0,
        gap: 0,
    };
}

#[derive(Clone, Copy, Debug)]
struct Arrival {
    at: Instant,
    index: u8,
}

/// Collects packets into turns.
#[derive(Clone, Debug)]
pub struct TurnAssembler {
    mounting: Mounting,
    defects: Defects,
    building: Turn,
    finished: Turn,
    first: Option<Arrival>,
    last: Option<Arrival>,
    speed: SpeedWord,
    abandoned: u32,
}

impl TurnAssembler {
    /// An assembler without packets.
    pub const fn new(mounting: Mounting) -> Self {
        Self::with_defects(mounting, Defects::NONE)
    }

    /// An assembler with the given defects of the fielded program.
    pub const fn with_defects(mounting: Mounting, defects: Defects) -> Self {
        Self {
            mounting,
            defects,
            building: Turn::EMPTY,
            finished: Turn::EMPTY,
            first: None,
            last: None,
            speed: SpeedWord(0),
            abandoned: 0,
        }
    }

    /// Takes a packet that arrived at `at`; returns the turn that it completes, if any.
    /// [`turn`](Self::turn) returns the same turn until the next one is complete.
    pub fn push(&mut self, at: Instant, packet: &xv11::Frame) -> Option<&Turn> {
        let index = packet.index();
        let mut ended = false;
        if let Some(last) = self.last
            && (index < last.index || at - last.at >= TURN_MAX)
        {
            ended = self.close(at);
        }
        let before = self.last.map_or(0, |last| last.index + 1);
        self.building.gap = self.building.gap.max(index.saturating_sub(before));
        self.speed = packet.speed();
        self.store(index, packet.readings());
        let arrival = Arrival { at, index };
        self.first.get_or_insert(arrival);
        self.last = Some(arrival);
        if index == PACKETS - 1 && !self.defects.synchronised_by_packet_0 {
            ended = self.close(at);
        }
        ended.then_some(&self.finished)
    }

    /// The newest complete turn; empty before the first.
    pub const fn turn(&self) -> &Turn {
        &self.finished
    }

    /// Turns discarded because their packets stopped arriving, or too few of them arrived.
    pub const fn abandoned(&self) -> u32 {
        self.abandoned
    }

    /// Speed in the newest packet.
    pub fn speed_rpm(&self) -> f32 {
        self.speed.rpm()
    }

    fn store(&mut self, index: u8, readings: [xv11::Reading; READINGS]) {
        let first = usize::from(index) * READINGS;
        let beams = &mut self.building.distances_mm[first..first + READINGS];
        for (beam, reading) in beams.iter_mut().zip(readings) {
            *beam = self.mounting.believed_mm(reading);
        }
        self.building.packets = self.building.packets.saturating_add(1);
    }

    /// Ends the current turn; returns false if the turn was discarded.
    fn close(&mut self, now: Instant) -> bool {
        let (Some(first), Some(last)) = (self.first.take(), self.last.take()) else {
            return false;
        };
        let is_whole = match self.defects.synchronised_by_packet_0 {
            true => first.index == 0,
            false => self.building.packets >= PACKETS_MIN,
        };
        let fresh = is_whole && now - last.at < TURN_MAX && last.at - first.at < TURN_MAX;
        if fresh {
            self.building.gap = self.building.gap.max(PACKETS - 1 - last.index);
            (self.building.start, self.building.end) = self.span(first, last);
            self.finished = self.building.clone();
        } else {
            self.abandoned = self.abandoned.saturating_add(1);
        }
        (self.building.packets, self.building.gap) = (0, 0);
        if !self.defects.stale_distances {
            self.building.distances_mm = [0; BEAMS];
        }
        fresh
    }

    /// Start and end of the turn, from the arrivals of its first and last packet. If too few
    /// packets arrived, or they arrived in bunches, the speed that the sensor reports gives the
    /// times instead.
    fn span(&self, first: Arrival, last: Arrival) -> (Instant, Instant) {
        let reported = reported_period(self.speed);
        let steps = u32::from(last.index - first.index);
        let measured = (last.at - first.at) * u32::from(PACKETS) / steps.max(1);
        let agree = measured.abs_diff(reported) < reported / 10;
        let period = if steps >= u32::from(PACKETS / 2) && agree {
            measured
        } else {
            reported
        };
        // Packet i arrives one delay after the beams of the first i + 1 packets.
        let to_come = period * u32::from(PACKETS - 1 - last.index) / u32::from(PACKETS);
        let since_zero = last.at - Instant::ZERO + to_come;
        let start = since_zero.saturating_sub(self.mounting.delay + period);
        (Instant::ZERO + start, Instant::ZERO + start + period)
    }
}

/// Time of a turn at the speed that the sensor reports; 200 ms if the report is missing or invalid.
fn reported_period(speed: SpeedWord) -> Duration {
    const SECOND_AS_64THS_OF_RPM: u64 = 60 * 64 * 1_000_000_000;
    let nanos = SECOND_AS_64THS_OF_RPM
        .checked_div(u64::from(speed.0))
        .unwrap_or(0);
    let period = Duration::from_nanos(nanos);
    let usual = Duration::from_millis(200);
    if period.is_zero() || period > TURN_MAX {
        usual
    } else {
        period
    }
}

impl Mounting {
    /// The valid distance of a reading; 0 is no data.
    fn believed_mm(&self, reading: xv11::Reading) -> u16 {
        match reading {
            xv11::Reading::Range { weak: true, .. } if self.weak == WeakReadings::Discard => 0,
            xv11::Reading::Range { distance_mm, .. }
                if (self.distance_min_mm..=self.distance_max_mm).contains(&distance_mm) =>
            {
                distance_mm
            }
            _ => 0,
        }
    }

    /// Direction of a beam in the robot's frame, radians.
    pub fn bearing(&self, beam: u16) -> f32 {
        normalised(self.first_bearing + f32::from(beam) * (TAU / 360.0))
    }
}

/// End points of a turn's beams in the robot's frame, as measured at the end of the turn.
#[derive(Clone, Debug)]
pub struct Scan {
    points: [Point; BEAMS],
    beams: [u16; BEAMS],
    count: usize,
    /// Positions of the lidar at the turn's knots, in the robot's frame at the turn's end.
    origins: [Point; KNOTS + 1],
    /// Start of the turn.
    pub start: Instant,
    /// End of the turn: the time of the pose that matches the points.
    pub end: Instant,
}

/// Parts of a turn within which the robot's motion is taken as uniform: 25 ms each at 5 turns a
/// second.
const KNOTS: usize = KNOTS_U32 as usize;
const KNOTS_U32: u32 = 8;
const BEAMS_PER_KNOT: usize = BEAMS / KNOTS;

impl Scan {
    /// A scan without points.
    pub const EMPTY: Self = Self {
        points: [Point::new(0.0, 0.0); BEAMS],
        beams: [0; BEAMS],
        count: 0,
        origins: [Point::new(0.0, 0.0); KNOTS + 1],
        start: Instant::ZERO,
        end: Instant::ZERO,
    };

    /// Points of `turn`, each moved by the robot's motion between its beam and the turn's end.
    pub fn deskewed(turn: &Turn, mounting: &Mounting, odometry: &Odometry) -> Self {
        let end_pose = odometry.pose_at(turn.end);
        let step = (turn.end - turn.start) / KNOTS_U32;
        let mut knots = [PoseChange::NONE; KNOTS + 1];
        for (index, knot) in (0..).zip(&mut knots) {
            *knot = end_pose.change_to(odometry.pose_at(turn.start + step * index));
        }
        Self::projected(turn, mounting, &knots)
    }

    /// Points of `turn` without motion correction.
    pub fn raw(turn: &Turn, mounting: &Mounting) -> Self {
        Self::projected(turn, mounting, &[PoseChange::NONE; KNOTS + 1])
    }

    /// A scan of given points; points beyond [`BEAMS`] are ignored. The points keep their order as
    /// beams.
    pub fn from_points(points: &[Point], start: Instant, end: Instant) -> Self {
        let mut scan = Self {
            start,
            end,
            ..Self::EMPTY
        };
        for (beam, point) in (0..).zip(points.iter().take(BEAMS)) {
            scan.push(beam, *point);
        }
        scan
    }

    /// The points, in order of their beams.
    pub fn points(&self) -> &[Point] {
        &self.points[..self.count]
    }

    /// The sensor degree of each point.
    pub fn beams(&self) -> &[u16] {
        &self.beams[..self.count]
    }

    /// Position of the lidar when beam `beam` was measured, in the robot's frame at the scan's end.
    /// The beam's free path starts there.
    pub fn origin(&self, beam: u16) -> Point {
        let (knot, share) = knot_of(beam);
        let (a, b) = (self.origins[knot], self.origins[knot + 1]);
        Point {
            x_mm: lerp(a.x_mm, b.x_mm, share),
            y_mm: lerp(a.y_mm, b.y_mm, share),
        }
    }

    fn push(&mut self, beam: u16, point: Point) {
        self.points[self.count] = point;
        self.beams[self.count] = beam;
        self.count += 1;
    }

    fn projected(turn: &Turn, mounting: &Mounting, knots: &[PoseChange; KNOTS + 1]) -> Self {
        let mut scan = Self {
            start: turn.start,
            end: turn.end,
            ..Self::EMPTY
        };
        let lidar = PoseChange {
            forward_mm: mounting.position.x_mm,
            left_mm: mounting.position.y_mm,
            turn: 0.0,
        };
        let knots = knots.map(|knot| knot.then(lidar));
        scan.origins = knots.map(|knot| Point::new(knot.forward_mm, knot.left_mm));
        for (beam, distance_mm) in (0..).zip(turn.distances_mm) {
            if distance_mm == 0 {
                continue;
            }
            let (knot, share) = knot_of(beam);
            let turned = lerp(knots[knot].turn, knots[knot + 1].turn, share);
            let origin = scan.origin(beam);
            let (sin, cos) = sin_cos(mounting.bearing(beam) + turned);
            let distance = f32::from(distance_mm);
            let point = Point::new(origin.x_mm + distance * cos, origin.y_mm + distance * sin);
            scan.push(beam, point);
        }
        scan
    }
}

/// The part of the turn that contains a beam, and the beam's fraction within it.
fn knot_of(beam: u16) -> (usize, f32) {
    let beam = usize::from(beam).min(BEAMS - 1);
    let (knot, rest) = (beam / BEAMS_PER_KNOT, beam % BEAMS_PER_KNOT);
    let share = rest as f32 / BEAMS_PER_KNOT as f32;
    (knot, share)
}

fn lerp(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::odometry::WheelGeometry;
    use core::f32::consts::FRAC_PI_2;
    use protocols::xv11::{RawReading, Reading};

    /// The rescue robot's lidar: sensor degree 90 looks ahead, 180 to the left.
    const MOUNTING: Mounting = Mounting {
        position: Point::new(0.0, 0.0),
        first_bearing: -FRAC_PI_2,
        distance_min_mm: 100,
        distance_max_mm: 6000,
        weak: WeakReadings::Use,
        delay: Duration::ZERO,
    };
    const DRIVE: WheelGeometry = WheelGeometry {
        wheel_radius_mm: 26.0,
        axle_mm: 260.0,
        ticks_per_turn: 360,
        ticks_per_second_max: 900,
    };

    fn range(distance_mm: u16) -> Reading {
        Reading::Range {
            distance_mm,
            strength: 200,
            weak: false,
        }
    }

    fn packet(index: u8, reading: Reading) -> xv11::Frame {
        xv11::Frame::new(index, SpeedWord(300 * 64), [RawReading::from(reading); 4])
    }

    /// Arrival of packet `index` of turn `turn` at 300 turns a minute: 90 packets in 200 ms.
    fn arrival(turn: u64, index: u8) -> Instant {
        Instant::from_nanos(turn * 200_000_000 + (u64::from(index) + 1) * 200_000_000 / 90)
    }

    fn all() -> [u8; 90] {
        core::array::from_fn(|index| u8::try_from(index).unwrap())
    }

    /// Feeds one turn without the packets in `lost`; returns the reported ends.
    fn feed(assembler: &mut TurnAssembler, turn: u64, distance_mm: u16, lost: &[u8]) -> usize {
        let kept = (0..90).filter(|index| !lost.contains(index));
        kept.filter(|index| {
            let packet = packet(*index, range(distance_mm));
            assembler.push(arrival(turn, *index), &packet).is_some()
        })
        .count()
    }

    /// Two, three and one packets in a row are missing: at the beginning, in the middle, at the
    /// end.
    #[test]
    fn the_gap_of_a_turn_is_its_longest_run_of_missing_packets() {
        let mut assembler = TurnAssembler::new(MOUNTING);
        feed(&mut assembler, 0, 1000, &[0, 1, 40, 41, 42]);
        assert_eq!(assembler.turn().gap, 3);
        feed(&mut assembler, 1, 1000, &[0, 1, 40]);
        assert_eq!(assembler.turn().gap, 2);
        feed(&mut assembler, 2, 1000, &[86, 87, 88, 89]);
        feed(&mut assembler, 3, 1000, &[]);
        assert_eq!(assembler.turn().gap, 0);
    }

    #[test]
    fn the_last_packet_ends_the_turn() {
        let mut assembler = TurnAssembler::new(MOUNTING);
        assert_eq!(feed(&mut assembler, 0, 1000, &[]), 1);
        let turn = assembler.turn();
        assert_eq!((turn.packets, turn.distances_mm), (90, [1000; BEAMS]));
        let micros = |instant: Instant| instant.as_micros();
        assert!(
            micros(turn.start) <= 1 && micros(turn.end).abs_diff(200_000) <= 1,
            "{turn:?}"
        );
    }

    /// XV-06: with a lost packet 0 the fielded code skips the whole turn.
    #[test]
    fn a_lost_first_packet_does_not_lose_the_turn() {
        let mut assembler = TurnAssembler::new(MOUNTING);
        assert_eq!(feed(&mut assembler, 1, 1000, &[0]), 1);
        assert_eq!(assembler.turn().packets, 89);
        assert_eq!(assembler.turn().start.as_millis(), 200);

        let defects = Defects {
            synchronised_by_packet_0: true,
            ..Defects::default()
        };
        let mut fielded = TurnAssembler::with_defects(MOUNTING, defects);
        let ends: usize = (0..5)
            .map(|turn| feed(&mut fielded, turn, 1000, &[0]))
            .sum();
        assert_eq!(ends, 0);
    }

    #[test]
    fn a_lost_last_packet_only_delays_the_end_to_the_next_turn() {
        let mut assembler = TurnAssembler::new(MOUNTING);
        assert_eq!(feed(&mut assembler, 0, 1000, &[88, 89]), 0);
        assert!(
            assembler
                .push(arrival(1, 0), &packet(0, range(2000)))
                .is_some()
        );
        let turn = assembler.turn();
        assert_eq!(
            (turn.packets, turn.distances_mm[0], turn.distances_mm[359]),
            (88, 1000, 0)
        );
        assert!(
            turn.end.as_micros().abs_diff(200_000) <= 1,
            "{:?}",
            turn.end
        );
    }

    /// XV-07: the fielded code keeps the distances of an earlier turn.
    #[test]
    fn a_missing_packet_is_no_data_not_old_data() {
        let with = |defects| {
            let mut assembler = TurnAssembler::with_defects(MOUNTING, defects);
            feed(&mut assembler, 0, 1000, &[]);
            feed(&mut assembler, 1, 2000, &[40]);
            assembler.turn().distances_mm[160]
        };
        assert_eq!(with(Defects::default()), 0);
        assert_eq!(
            with(Defects {
                stale_distances: true,
                ..Defects::default()
            }),
            1000
        );
    }

    /// The sensor is unplugged in mid-turn and returns a second later at a higher index.
    #[test]
    fn a_turn_whose_packets_stopped_is_given_up() {
        let mut assembler = TurnAssembler::new(MOUNTING);
        feed(&mut assembler, 0, 1000, &[30, 31, 32, 89]);
        assert_eq!(feed(&mut assembler, 6, 2000, &all()[..81]), 1);
        assert_eq!(assembler.abandoned(), 1);
        assert_eq!(
            (assembler.turn().packets, assembler.turn().distances_mm[0]),
            (9, 0)
        );
    }

    /// A stuck lidar repeats a packet, even the last one: no turn is made of that, or of
    /// eight packets.
    #[test]
    fn a_few_packets_are_no_turn() {
        let ends = |first: usize| {
            let mut assembler = TurnAssembler::new(MOUNTING);
            let ends = feed(&mut assembler, 0, 1000, &all()[..first]);
            (ends, assembler.abandoned(), assembler.turn().packets)
        };
        assert_eq!([81, 82, 89].map(ends), [(1, 0, 9), (0, 1, 0), (0, 1, 0)]);
    }

    /// Packets that a busy program takes out of its queue all at once still cover 200 ms.
    #[test]
    fn a_turn_taken_in_one_go_is_timed_by_the_reported_speed() {
        let mut assembler = TurnAssembler::new(MOUNTING);
        let now = Instant::from_millis(900);
        let ends = (0..90).filter(|i| assembler.push(now, &packet(*i, range(500))).is_some());
        assert_eq!(ends.count(), 1);
        let turn = assembler.turn();
        assert_eq!((turn.start.as_millis(), turn.end.as_millis()), (700, 900));
    }

    #[test]
    fn readings_that_are_not_believed_are_no_data() {
        let weak = Reading::Range {
            distance_mm: 300,
            strength: 5,
            weak: true,
        };
        let strict = Mounting {
            weak: WeakReadings::Discard,
            ..MOUNTING
        };
        assert_eq!(
            (MOUNTING.believed_mm(weak), strict.believed_mm(weak)),
            (300, 0)
        );
        assert_eq!(
            MOUNTING.believed_mm(Reading::Invalid {
                code: 0x35,
                strength: 0
            }),
            0
        );
        let seen = [99, 100, 6000, 6001].map(|mm| MOUNTING.believed_mm(range(mm)));
        assert_eq!(seen, [0, 100, 6000, 0]);
    }

    /// Seed report: sensor degree 90 is ahead, 180 left, 0 right, 270 behind.
    #[test]
    fn beams_point_where_the_lidar_is_mounted_to() {
        let mut turn = Turn::EMPTY;
        for beam in [0, 90, 180, 270] {
            turn.distances_mm[beam] = 1000;
        }
        let scan = Scan::raw(&turn, &MOUNTING);
        let expected = [(0.0, -1000.0), (1000.0, 0.0), (0.0, 1000.0), (-1000.0, 0.0)];
        for (point, (x, y)) in scan.points().iter().zip(expected) {
            assert!(point.distance_mm(Point::new(x, y)) < 0.01, "{point:?}");
        }
        let ahead = Mounting {
            position: Point::new(50.0, 20.0),
            ..MOUNTING
        };
        let shifted = Scan::raw(&turn, &ahead);
        assert!(shifted.points()[1].distance_mm(Point::new(1050.0, 20.0)) < 0.01);
    }

    /// Seed figure S2: 0.3 m/s moves the robot 60 mm in a turn. At its end a wall is 1200 mm ahead.
    /// Beam 0, which looks ahead here, has seen the wall 60 mm earlier; beam 359 sees it at the
    /// end.
    #[test]
    fn motion_within_the_turn_is_taken_out_of_the_scan() {
        let mut odometry = Odometry::new(DRIVE);
        let ticks = 132; // 60 mm at 0.45379 mm each
        odometry.update(Instant::ZERO, [0, 0]);
        odometry.update(Instant::from_millis(200), [ticks, ticks]);
        let mut turn = Turn {
            end: Instant::from_millis(200),
            ..Turn::EMPTY
        };
        turn.distances_mm[0] = 1260;
        turn.distances_mm[359] = 1200;
        let forward = Mounting {
            first_bearing: 0.0,
            ..MOUNTING
        };

        let xs = |scan: &Scan| (scan.points()[0].x_mm, scan.points()[1].x_mm);
        let (first, last) = xs(&Scan::raw(&turn, &forward));
        assert!(
            (first - last - 60.0).abs() < 3.0,
            "raw smear: {first} {last}"
        );
        let scan = Scan::deskewed(&turn, &forward, &odometry);
        let (first, last) = xs(&scan);
        assert!(
            (first - last).abs() < 1.0 && (first - 1200.0).abs() < 1.0,
            "{first} {last}"
        );
        assert!(
            (scan.origin(0).x_mm + 60.0).abs() < 0.5,
            "{:?}",
            scan.origin(0)
        );
        assert!(scan.origin(359).x_mm.abs() < 0.5);
    }

    #[test]
    fn points_of_others_keep_their_order_and_their_number_is_bounded() {
        let points = [Point::new(1.0, 2.0); 400];
        let scan = Scan::from_points(&points, Instant::ZERO, Instant::ZERO);
        assert_eq!((scan.points().len(), scan.beams()[359]), (BEAMS, 359));
    }

    /// Each half second without packets discards the current turn, but no complete one.
    #[test]
    fn turns_that_were_given_up_are_counted() {
        let mut assembler = TurnAssembler::new(MOUNTING);
        assert_eq!(assembler.abandoned(), 0);
        feed(&mut assembler, 0, 1000, &[]);
        assert_eq!((assembler.abandoned(), assembler.turn().packets), (0, 90));
        for count in 1..4 {
            let at = arrival(10 * u64::from(count), 5);
            assembler.push(at, &packet(5, range(1000)));
            assert_eq!(assembler.abandoned(), count - 1);
        }
        assert_eq!(assembler.speed_rpm(), 300.0);
    }

    /// A turn may take half a second less a nanosecond.
    #[test]
    fn a_pause_of_half_a_second_ends_a_turn() {
        let ends_after = |pause: Duration| {
            let mut assembler = TurnAssembler::new(MOUNTING);
            assembler.push(Instant::from_millis(1), &packet(3, range(1000)));
            let at = Instant::from_millis(1) + pause;
            assembler.push(at, &packet(4, range(1000)));
            (assembler.abandoned(), assembler.building.packets)
        };
        let half = Duration::from_millis(500);
        assert_eq!(ends_after(half - Duration::from_nanos(1)), (0, 2));
        assert_eq!(ends_after(half), (1, 1));
    }

    /// A turn takes 3,840,000,000,000 nanoseconds divided by 64 times the speed in rpm: 300 rpm are
    /// 200 ms, 240 rpm 250 ms, and 120 rpm just half a second. A lower speed, or none, counts as
    /// 300.
    #[test]
    fn a_turn_lasts_as_long_as_the_reported_speed_says() {
        let ms = |word: u16| reported_period(SpeedWord(word)).as_micros();
        assert_eq!(
            [300, 240, 120].map(|rpm| ms(rpm * 64)),
            [200_000, 250_000, 500_000]
        );
        assert_eq!([ms(119 * 64), ms(1), ms(0)], [200_000; 3]);
        assert_eq!(ms(400 * 64), 150_000);
    }

    /// Packets 10 and 60 arrive 50 / 90 of a turn of 210 ms apart: 5 % longer than the reported
    /// turn, which is accepted. The turn's last packet comes 29 / 90 of a turn after packet 60; its
    /// beams were measured a delay earlier. The reported 200 ms count if the packets are only 44
    /// apart, or if they give 225 ms.
    #[test]
    fn a_turn_is_timed_by_its_packets_if_they_agree_with_its_speed() {
        let span = |turn_us: u64, first: u8, last: u8| {
            let mut assembler = TurnAssembler::new(Mounting {
                delay: Duration::from_millis(2),
                ..MOUNTING
            });
            assembler.speed = SpeedWord(300 * 64);
            let at = |index: u8| {
                Instant::from_nanos(1_000_000_000 + turn_us * 1_000 * u64::from(index) / 90)
            };
            let arrival = |index| Arrival {
                at: at(index),
                index,
            };
            let (start, end) = assembler.span(arrival(first), arrival(last));
            [start, end].map(|at| (at - Instant::ZERO).as_micros())
        };
        // The last packet, 89, comes at 1 s + 89 / 90 of a turn.
        assert_eq!(span(210_000, 10, 60), [995_666, 1_205_666]);
        assert_eq!(span(210_000, 10, 55), [995_666, 1_205_666]);
        // The end is 1 s + 54 / 90 of 210 ms + 35 / 90 of 200 ms, less the delay of 2 ms. The start
        // is 200 ms earlier.
        assert_eq!(span(210_000, 10, 54), [1_001_777, 1_201_777]);
        assert_eq!(span(225_000, 10, 60), [1_012_444, 1_212_444]);
        assert_eq!(span(181_000, 0, 89), [995_988, 1_176_988]);
        assert_eq!(span(179_000, 0, 89), [975_011, 1_175_011]);
    }

    /// A part has 45 beams; 67 beams are one part and 22 of 45 beams of the next.
    #[test]
    fn beams_lie_in_eight_parts_of_a_turn() {
        let is = |beam, knot, share: f32| {
            let found = knot_of(beam);
            found.0 == knot && (found.1 - share).abs() < 1e-6
        };
        assert!(is(0, 0, 0.0) && is(44, 0, 44.0 / 45.0) && is(45, 1, 0.0));
        assert!(is(67, 1, 22.0 / 45.0) && is(359, 7, 44.0 / 45.0) && is(400, 7, 44.0 / 45.0));
        assert_eq!(lerp(10.0, 30.0, 0.25), 15.0);
    }

    /// A lidar 100 mm before the axle of a robot that turns by 90 degrees to the left in a turn. At
    /// the turn's start, relative to the final pose, the robot looked to the right, and the lidar
    /// was there.
    #[test]
    fn a_turning_robot_s_lidar_swings_around_its_axle() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(Instant::ZERO, [0, 0]);
        // In a turn by 90 degrees each wheel, 130 mm from the middle, travels 204.2 mm, 450 ticks
        // of 0.45379 mm.
        odometry.update(Instant::from_millis(500), [-450, 450]);
        let mut turn = Turn {
            end: Instant::from_millis(500),
            ..Turn::EMPTY
        };
        turn.distances_mm[0] = 1000;
        turn.distances_mm[180] = 1000;
        let ahead = Mounting {
            position: Point::new(100.0, 0.0),
            first_bearing: 0.0,
            ..MOUNTING
        };
        let scan = Scan::deskewed(&turn, &ahead, &odometry);
        let near = |found: Point, x, y| found.distance_mm(Point::new(x, y)) < 3.0;
        assert!(near(scan.origin(0), 0.0, -100.0), "{:?}", scan.origin(0));
        assert!(near(scan.points()[0], 0.0, -1100.0), "{:?}", scan.points());
        // Half way through the turn the lidar looked 45 degrees to the right; beam 180 looks back.
        let half = libm::sqrtf(0.5);
        assert!(near(scan.origin(180), 100.0 * half, -100.0 * half));
        assert!(near(scan.points()[1], -900.0 * half, 900.0 * half));
        assert_eq!(scan.beams(), [0, 180]);
    }
}
