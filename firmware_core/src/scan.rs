//! One revolution of the lidar: from packets to points in the robot's frame.
//!
//! ```text
//! packets -> TurnAssembler -> Turn: 360 distances, start, end
//!                              Turn + odometry -> Scan: points as if all were measured at the end
//! ```
//!
//! A turn ends when the packet index goes down (or at the last packet), so a lost first packet
//! does not lose the turn; packets that did not arrive leave "no data", never the distances of an
//! earlier turn. While the sensor turns once, the robot drives on: at 0.3 m/s and 5 turns a second
//! 60 mm (seed report, chapter on the lidar), so every beam is moved by what the odometry says has
//! happened between it and the end of the turn.

use core::f32::consts::TAU;
use core::time::Duration;

use protocols::{Instant, xv11};

use crate::odometry::Odometry;
use crate::pose::{Point, PoseChange, normalised, sin_cos};

/// Beams in a turn, one degree apart.
pub const BEAMS: usize = 360;

const PACKETS: u8 = 90;
const READINGS: usize = BEAMS / PACKETS as usize;

/// Longest turn that is waited for: 120 turns a minute.
const TURN_MAX: Duration = Duration::from_millis(500);

/// What to do with readings that carry the sensor's strength warning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WeakReadings {
    /// They are as good as others.
    #[default]
    Use,
    /// They count as no data, as in the fielded code; that is about 28 % of near readings.
    Discard,
}

/// Where and how the lidar sits on the robot, and which of its readings are believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mounting {
    /// Position of the lidar's axis in the robot's frame.
    pub position: Point,
    /// Direction of beam 0 in the robot's frame, radians.
    pub first_bearing: f32,
    /// Nearest distance that is believed.
    pub distance_min_mm: u16,
    /// Farthest distance that is believed.
    pub distance_max_mm: u16,
    /// Readings with the strength warning.
    pub weak: WeakReadings,
    /// From the measurement of a packet's last beam to the arrival of its last byte.
    pub delay: Duration,
}

/// What the fielded program did wrong in assembling scans; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Distances of packets that did not arrive stay from earlier turns (XV-07).
    pub stale_distances: bool,
    /// Only packet 0 ends a turn; without it the turn is lost (XV-06).
    pub synchronised_by_packet_0: bool,
}

/// Distances of one turn, still on the sensor's clock.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Turn {
    /// By sensor degree; 0 is no data.
    pub distances_mm: [u16; BEAMS],
    /// When beam 0 was, or would have been, measured.
    pub start: Instant,
    /// When the turn was over.
    pub end: Instant,
    /// Packets that arrived.
    pub packets: u8,
}

impl Turn {
    const EMPTY: Self = Self {
        distances_mm: [0; BEAMS],
        start: Instant::ZERO,
        end: Instant::ZERO,
        packets: 0,
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
    speed_rpm: f32,
    abandoned: u32,
}

impl TurnAssembler {
    /// An assembler that has seen nothing.
    pub const fn new(mounting: Mounting) -> Self {
        Self::with_defects(
            mounting,
            Defects {
                stale_distances: false,
                synchronised_by_packet_0: false,
            },
        )
    }

    /// An assembler with some of the fielded program's faults.
    pub const fn with_defects(mounting: Mounting, defects: Defects) -> Self {
        Self {
            mounting,
            defects,
            building: Turn::EMPTY,
            finished: Turn::EMPTY,
            first: None,
            last: None,
            speed_rpm: 0.0,
            abandoned: 0,
        }
    }

    /// Takes a packet that arrived at `at`; returns the turn that it ends, if it ends one. The
    /// turn stays readable as [`turn`](Self::turn) until the next one ends.
    pub fn push(&mut self, at: Instant, packet: &xv11::Frame) -> Option<&Turn> {
        let index = packet.index();
        let mut ended = false;
        if let Some(last) = self.last
            && (index < last.index || at - last.at >= TURN_MAX)
        {
            ended = self.close(at);
        }
        self.speed_rpm = packet.speed_rpm();
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

    /// Turns given up because their packets stopped arriving.
    pub const fn abandoned(&self) -> u32 {
        self.abandoned
    }

    /// Speed in the newest packet.
    pub const fn speed_rpm(&self) -> f32 {
        self.speed_rpm
    }

    fn store(&mut self, index: u8, readings: [xv11::Reading; READINGS]) {
        let first = usize::from(index) * READINGS;
        let beams = &mut self.building.distances_mm[first..first + READINGS];
        for (beam, reading) in beams.iter_mut().zip(readings) {
            *beam = self.mounting.believed_mm(reading);
        }
        self.building.packets = self.building.packets.saturating_add(1);
    }

    /// Ends the turn that is being built; false if it was given up.
    fn close(&mut self, now: Instant) -> bool {
        let (Some(first), Some(last)) = (self.first.take(), self.last.take()) else {
            return false;
        };
        let is_whole = !self.defects.synchronised_by_packet_0 || first.index == 0;
        let fresh = is_whole && now - last.at < TURN_MAX && last.at - first.at < TURN_MAX;
        if fresh {
            (self.building.start, self.building.end) = self.span(first, last);
            self.finished = self.building.clone();
        } else {
            self.abandoned = self.abandoned.saturating_add(1);
        }
        self.building.packets = 0;
        if !self.defects.stale_distances {
            self.building.distances_mm = [0; BEAMS];
        }
        fresh
    }

    /// Start and end of the turn, from the arrivals of its first and last packet. A turn of which
    /// too little arrived, or whose packets arrived in bunches, is timed by the speed that the
    /// sensor reports.
    fn span(&self, first: Arrival, last: Arrival) -> (Instant, Instant) {
        let reported = if self.speed_rpm >= 120.0 {
            60.0 / self.speed_rpm
        } else {
            0.2
        };
        let steps = last.index - first.index;
        let measured =
            (last.at - first.at).as_secs_f32() * f32::from(PACKETS) / f32::from(steps.max(1));
        let agree = (measured - reported).abs() < 0.1 * reported;
        let period = if steps >= PACKETS / 2 && agree {
            measured
        } else {
            reported
        };
        let period = Duration::from_secs_f32(period);
        // Packet i arrives one delay after the beams of the first i + 1 packets.
        let ended = last.at + period * u32::from(PACKETS - 1 - last.index) / u32::from(PACKETS);
        let back = self.mounting.delay + period;
        let start =
            Instant::from_nanos((ended - Instant::ZERO).saturating_sub(back).as_nanos() as u64);
        (start, start + period)
    }
}

impl Mounting {
    /// The distance that counts for a reading; 0 is no data.
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

/// End points of a turn's beams in the robot's frame, as if all had been measured at the end of
/// the turn.
#[derive(Clone, Debug)]
pub struct Scan {
    points: [Point; BEAMS],
    beams: [u16; BEAMS],
    count: usize,
    /// The lidar at the turn's knots, in the robot's frame at the turn's end.
    origins: [Point; KNOTS + 1],
    /// When the turn began.
    pub start: Instant,
    /// When the turn ended: the time of the pose that matches the points.
    pub end: Instant,
}

/// Parts of a turn within which the robot's motion is taken as even: 25 ms each at 5 turns a
/// second.
const KNOTS: usize = 8;
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
        let step = (turn.end - turn.start) / KNOTS as u32;
        let mut knots = [PoseChange::NONE; KNOTS + 1];
        for (index, knot) in (0..).zip(&mut knots) {
            *knot = end_pose.change_to(odometry.pose_at(turn.start + step * index));
        }
        Self::projected(turn, mounting, &knots)
    }

    /// Points of `turn` as a robot at rest would see them: the motion smear stays in.
    pub fn raw(turn: &Turn, mounting: &Mounting) -> Self {
        Self::projected(turn, mounting, &[PoseChange::NONE; KNOTS + 1])
    }

    /// A scan of points that somebody else has made; more than [`BEAMS`] are left out. The points
    /// keep their order as beams.
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

    /// Where the lidar was when beam `beam` was measured, in the robot's frame at the scan's end:
    /// the place from which the beam's free way is drawn.
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

/// The part of the turn in which a beam lies, and how far into it.
fn knot_of(beam: u16) -> (usize, f32) {
    let beam = usize::from(beam).min(BEAMS - 1);
    let (knot, rest) = (beam / BEAMS_PER_KNOT, beam % BEAMS_PER_KNOT);
    #[expect(clippy::cast_precision_loss, reason = "less than 45")]
    let share = rest as f32 / BEAMS_PER_KNOT as f32;
    (knot, share)
}

fn lerp(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}
