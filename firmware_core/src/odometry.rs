//! Conversion of wheel ticks to pose changes, and a short history of the dead-reckoned pose.
//!
//! Both wheels turn at constant speed between two readings, so the robot moves along an exact arc;
//! the formula is the midpoint form with the chord's true length. Readings that no motor could
//! produce are counted and ignored. Example: a slave reads a 32-bit counter during a carry; this
//! reading is wrong by 256 ticks, the next one is right again.

use core::f32::consts::TAU;
use core::time::Duration;

use protocols::Instant;

use crate::pose::{Pose, PoseChange, sin_cos};

/// Dimensions of the drive for the odometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelGeometry {
    /// Radius of a wheel.
    pub wheel_radius_mm: f32,
    /// Distance between the wheels' points of contact.
    pub axle_mm: f32,
    /// Encoder counts of one turn of a wheel.
    pub ticks_per_turn: u16,
    /// Maximum tick rate of a wheel; faster readings are ignored.
    pub ticks_per_second_max: u16,
}

impl WheelGeometry {
    /// Travel of a wheel's circumference per tick.
    pub fn tick_mm(&self) -> f32 {
        TAU * self.wheel_radius_mm / f32::from(self.ticks_per_turn)
    }

    /// The arc that the robot runs when its wheels turn by `ticks` (left, right).
    pub fn arc(&self, ticks: [i32; 2]) -> PoseChange {
        let [left, right] = ticks.map(|count| count as f32 * self.tick_mm());
        self.arc_turning(ticks, (right - left) / self.axle_mm)
    }

    /// The arc for a turn, radians, that a better sensor than the wheels measured.
    pub fn arc_turning(&self, ticks: [i32; 2], turn: f32) -> PoseChange {
        let [left, right] = ticks.map(|count| count as f32 * self.tick_mm());
        let path = (right + left) / 2.0;
        // The chord starts at half the turn.
        let (sin, cos) = sin_cos(turn / 2.0);
        let chord = path * chord_of_arc(turn);
        PoseChange {
            forward_mm: chord * cos,
            left_mm: chord * sin,
            turn,
        }
    }
}

/// Defects of the fielded code, to show their effects; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The length of the motion is used without its sign: driving backwards moves forwards (SL-07).
    pub loses_the_sign: bool,
    /// The heading in degrees is multiplied by `180 / pi` before sine and cosine, beyond the
    /// accuracy of single precision (SL-08).
    pub garbles_the_heading: bool,
    /// The motion is applied along the heading turned in the wrong direction (SL-09).
    pub turns_the_wrong_way: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        loses_the_sign: false,
        garbles_the_heading: false,
        turns_the_wrong_way: false,
    };
}

/// Ticks allowed beyond the fastest wheel, for a reading that arrives a little late.
const TICKS_SLACK: u32 = 16;
/// Implausible readings in a row after which the counters must have been restarted.
const RESTART_AFTER: u8 = 3;
/// Counters this low after a silence have restarted.
const RESTARTED_TICKS: i32 = 2;
/// Maximum time that wheels run on without a command: the base's watchdog takes a second.
const RUNS_ON_MAX: Duration = Duration::from_millis(1_500);
/// Number of stored samples.
const SAMPLES: usize = 16;
/// Maximum extrapolation beyond the newest sample.
const EXTRAPOLATION_MAX: Duration = Duration::from_millis(250);
/// Shortest time between two readings that gives a speed.
const SPEED_TAKES: Duration = Duration::from_millis(20);

#[derive(Clone, Copy, Debug)]
struct Sample {
    at: Instant,
    pose: Pose,
}

/// Dead reckoning: integrates tick readings, and returns the pose at any recent time.
#[derive(Clone, Debug)]
pub struct Odometry {
    geometry: WheelGeometry,
    defects: Defects,
    /// The fielded heading: degrees, clockwise, never normalised.
    psi_deg: f32,
    last_ticks: Option<[i32; 2]>,
    /// Oldest first; the first `len` are valid.
    samples: [Sample; SAMPLES],
    len: usize,
    disbelieved_in_a_row: u8,
    disbelieved: u32,
    /// The next reading is the first one after a silence.
    resumes: bool,
    /// Motion was ignored, or only its sum is known.
    has_gap: bool,
}

impl Odometry {
    /// Starts at the origin, without a counter reading.
    pub const fn new(geometry: WheelGeometry) -> Self {
        Self::with_defects(geometry, Defects::NONE)
    }

    /// An odometry with the fielded code's defects, which starts at the fielded heading, psi 90.
    pub const fn with_defects(geometry: WheelGeometry, defects: Defects) -> Self {
        const ORIGIN: Sample = Sample {
            at: Instant::ZERO,
            pose: Pose {
                x_mm: 0.0,
                y_mm: 0.0,
                heading: 0.0,
            },
        };
        Self {
            geometry,
            defects,
            psi_deg: 90.0,
            last_ticks: None,
            samples: [ORIGIN; SAMPLES],
            len: 0,
            disbelieved_in_a_row: 0,
            disbelieved: 0,
            resumes: false,
            has_gap: false,
        }
    }

    /// Takes a reading of both counters (left, right), which wrap; returns the motion since the
    /// previous one. The first reading, and the third implausible one in a row, only set the
    /// counters; other implausible readings have no effect.
    pub fn update(&mut self, now: Instant, ticks: [i32; 2]) -> PoseChange {
        self.update_turning(now, ticks, None)
    }

    /// Takes a reading of both counters, and optionally the robot's turn since the previous one
    /// (radians) from a sensor that does not slip; see [`update`](Self::update).
    pub fn update_turning(
        &mut self,
        now: Instant,
        ticks: [i32; 2],
        turn: Option<f32>,
    ) -> PoseChange {
        let (Some(last_ticks), Some(newest)) = (self.last_ticks, self.newest()) else {
            self.last_ticks = Some(ticks);
            self.push(Sample {
                at: now,
                pose: self.pose(),
            });
            return PoseChange::NONE;
        };
        let step = [
            ticks[0].wrapping_sub(last_ticks[0]),
            ticks[1].wrapping_sub(last_ticks[1]),
        ];
        let resumes = core::mem::take(&mut self.resumes);
        let elapsed = match resumes {
            true => (now - newest.at).min(RUNS_ON_MAX),
            false => now - newest.at,
        };
        let is_restarted = resumes && ticks.iter().all(|count| count.abs() <= RESTARTED_TICKS);
        if is_restarted || !self.is_believable(elapsed, step) {
            let unbelievable = u32::from(!is_restarted);
            self.disbelieved = self.disbelieved.saturating_add(unbelievable);
            self.disbelieved_in_a_row += 1;
            if resumes || self.disbelieved_in_a_row >= RESTART_AFTER {
                self.has_gap = true;
                self.disbelieved_in_a_row = 0;
                self.last_ticks = Some(ticks);
                self.push(Sample {
                    at: now,
                    pose: newest.pose,
                });
            }
            return PoseChange::NONE;
        }
        self.disbelieved_in_a_row = 0;
        self.last_ticks = Some(ticks);
        let change = match turn {
            _ if self.defects != Defects::NONE => {
                fielded::change(&self.geometry, self.defects, self.psi_deg, step)
            }
            Some(turn) => self.geometry.arc_turning(step, turn),
            None => self.geometry.arc(step),
        };
        self.psi_deg -= change.turn.to_degrees();
        self.push(Sample {
            at: now,
            pose: newest.pose.then(change),
        });
        change
    }

    /// Notes that the drive answers again after a silence. If the drive was restarted, its counters
    /// were too, and wheel turns up to the next reading are not integrated. If not, the counters
    /// give the motion in the silence.
    pub const fn resume(&mut self) {
        self.resumes = true;
        self.has_gap = true;
        self.disbelieved_in_a_row = 0;
    }

    /// Whether motion was ignored since the last call, or only its end is known.
    pub const fn take_gap(&mut self) -> bool {
        core::mem::replace(&mut self.has_gap, false)
    }

    /// The dead-reckoned pose at the newest reading.
    pub fn pose(&self) -> Pose {
        self.newest()
            .map_or_else(Pose::default, |sample| sample.pose)
    }

    /// Time of the newest reading.
    pub fn updated_at(&self) -> Option<Instant> {
        self.newest().map(|sample| sample.at)
    }

    /// The dead-reckoned pose at `at`. Between two readings it is interpolated. After the newest
    /// reading it continues at the last speed for at most 250 ms. Before the oldest reading it is
    /// the pose of that reading.
    pub fn pose_at(&self, at: Instant) -> Pose {
        let samples = &self.samples[..self.len];
        let Some(newest) = samples.last() else {
            return Pose::default();
        };
        let after = samples.partition_point(|sample| sample.at < at);
        if after == 0 {
            return samples[0].pose;
        }
        if after < self.len {
            return between(samples[after - 1], samples[after], at);
        }
        let latest = newest.at + EXTRAPOLATION_MAX;
        // Two readings in quick succession give no speed: the second may have one more tick by
        // chance.
        let is_before = |sample: &&Sample| newest.at - sample.at >= SPEED_TAKES;
        let before = samples.iter().rev().find(is_before);
        before.map_or(newest.pose, |before| {
            between(*before, *newest, at.min(latest))
        })
    }

    /// Whether `at` is not before the oldest stored reading.
    pub fn remembers(&self, at: Instant) -> bool {
        self.samples[..self.len]
            .first()
            .is_some_and(|oldest| oldest.at <= at)
    }

    /// Number of implausible readings.
    pub const fn disbelieved(&self) -> u32 {
        self.disbelieved
    }

    fn newest(&self) -> Option<Sample> {
        self.samples[..self.len].last().copied()
    }

    fn is_believable(&self, elapsed: Duration, step: [i32; 2]) -> bool {
        let micros = elapsed.as_micros().min(60_000_000);
        let ticks = u128::from(self.geometry.ticks_per_second_max) * micros / 1_000_000;
        let limit = u32::try_from(ticks)
            .unwrap_or(u32::MAX)
            .saturating_add(TICKS_SLACK);
        step.iter().all(|ticks| ticks.unsigned_abs() <= limit)
    }

    fn push(&mut self, sample: Sample) {
        match self.samples[..self.len].last_mut() {
            Some(newest) if newest.at >= sample.at => newest.pose = sample.pose,
            _ => {
                if self.len == SAMPLES {
                    self.samples.copy_within(1.., 0);
                    self.len -= 1;
                }
                self.samples[self.len] = sample;
                self.len += 1;
            }
        }
    }
}

/// The pose at `at` of a robot that moves from `a` to `b` along an arc at constant speed; `at` may
/// lie beyond `b`.
fn between(a: Sample, b: Sample, at: Instant) -> Pose {
    let whole = seconds(b.at - a.at);
    if whole <= 0.0 {
        return b.pose;
    }
    let share = seconds(at - a.at) / whole;
    let change = a.pose.change_to(b.pose);
    // The chord of a part of an arc starts at half the part's turn, and is longer relative to its
    // arc.
    let turn = change.turn * share;
    let (sin, cos) = sin_cos((turn - change.turn) / 2.0);
    let length = share * chord_of_arc(turn) / chord_of_arc(change.turn);
    let (forward, left) = (change.forward_mm * length, change.left_mm * length);
    let change = PoseChange {
        forward_mm: cos * forward - sin * left,
        left_mm: sin * forward + cos * left,
        turn,
    };
    a.pose.then(change)
}

/// Length of the chord of an arc of length 1 that turns by `turn`.
fn chord_of_arc(turn: f32) -> f32 {
    let half = turn / 2.0;
    if half.abs() < 1e-3 {
        1.0 - half * half / 6.0
    } else {
        sin_cos(half).0 / half
    }
}

fn seconds(duration: Duration) -> f32 {
    duration.as_secs_f32()
}

/// The fielded firmware's odometry (its document's listing B.4), kept to show its errors; see
/// [`fielded::change`].
pub mod fielded {
    use core::f32::consts::PI;

    use super::{Defects, WheelGeometry, sin_cos};
    use crate::pose::PoseChange;

    /// The motion by `ticks`, by the fielded rule with the enabled defects. `psi_deg` is the
    /// fielded heading, clockwise and never normalised.
    pub fn change(
        geometry: &WheelGeometry,
        defects: Defects,
        psi_deg: f32,
        ticks: [i32; 2],
    ) -> PoseChange {
        let sound = geometry.arc(ticks);
        let [left, right] = ticks.map(|count| count as f32 * geometry.tick_mm());
        let mut length = sound.distance_mm();
        if defects.garbles_the_heading && left != right {
            let radius = -geometry.axle_mm * (left + right) / (2.0 * (right - left));
            let garbled = psi_deg * 180.0 / PI;
            let (sin_0, cos_0) = sin_cos(garbled);
            let (sin_1, cos_1) = sin_cos((left - right) / geometry.axle_mm + garbled);
            length = libm::hypotf(radius * (sin_1 - sin_0), radius * (cos_1 - cos_0));
        }
        if left + right < 0.0 && !defects.loses_the_sign {
            length = -length;
        }
        let along = if defects.turns_the_wrong_way {
            -sound.turn
        } else {
            sound.turn / 2.0
        };
        let (sin, cos) = sin_cos(along);
        PoseChange {
            forward_mm: length * cos,
            left_mm: length * sin,
            turn: sound.turn,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f32::consts::{FRAC_PI_2, PI};
    use proptest::prelude::*;

    /// The rescue robot's drive, seed report: radius 26 mm, axle 260 mm, 360 ticks a turn.
    const DRIVE: WheelGeometry = WheelGeometry {
        wheel_radius_mm: 26.0,
        axle_mm: 260.0,
        ticks_per_turn: 360,
        ticks_per_second_max: 900,
    };

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn near(a: f32, b: f32, tolerance: f32) -> bool {
        (a - b).abs() <= tolerance
    }

    /// Seed report: one tick is 2 pi 26 mm / 360 = 0.45379 mm; defect list SL-07 gives the right
    /// answer for backwards driving as -45.4 mm.
    #[test]
    fn straight_driving_keeps_length_and_sign() {
        assert!(near(DRIVE.arc([100, 100]).forward_mm, 45.379, 1e-3));
        assert!(near(DRIVE.arc([-100, -100]).forward_mm, -45.379, 1e-3));
        assert!(near(DRIVE.arc([100, 100]).left_mm, 0.0, 1e-6));
    }

    /// SL-09 gives +1.48 mm sideways for 100/50 ticks (measured to the right, as the left wheel
    /// runs further); SL-08 gives 45.15 mm for 100/99.
    #[test]
    fn curves_bend_to_the_slower_wheel() {
        let curve = DRIVE.arc([100, 50]);
        assert!(near(curve.left_mm, -1.48, 0.01), "{curve:?}");
        assert!(near(curve.turn, -22.689 / 260.0, 1e-5));
        assert!(near(DRIVE.arc([100, 99]).distance_mm(), 45.15, 0.01));
    }

    /// The base was silent for a second while the robot continued turning: 450 ticks of each wheel
    /// are a quarter turn. The motion in the silence is known, but not its course in time.
    #[test]
    fn what_the_counters_went_on_counting_in_a_silence_is_motion() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(at(0), [300, 300]);
        assert!(!odometry.take_gap());
        odometry.resume();
        odometry.update(at(1000), [-150, 750]);
        assert!(near(odometry.pose().heading, FRAC_PI_2, 0.01));
        assert!(odometry.take_gap() && !odometry.take_gap());
    }

    /// Restarted counters are no motion: from 300 to 0 would be 136 mm backwards. Nor is a count
    /// that no wheel reaches in a second and a half, even after a longer silence.
    #[test]
    fn counters_that_begin_anew_after_a_silence_are_no_motion() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(at(0), [300, 300]);
        odometry.resume();
        odometry.update(at(1000), [0, 0]);
        odometry.update(at(1040), [10, 10]);
        assert!(
            near(odometry.pose().x_mm, 4.54, 0.01),
            "{:?}",
            odometry.pose()
        );
        odometry.resume();
        odometry.update(at(60_000), [2_000, 2_000]);
        assert!(near(odometry.pose().x_mm, 4.54, 0.01));
    }

    /// A quarter circle on the spot: each wheel runs 130 mm * pi / 2 = 204.2 mm = 450 ticks.
    #[test]
    fn opposite_wheels_turn_on_the_spot() {
        let spin = DRIVE.arc([-450, 450]);
        assert!(
            near(spin.turn, FRAC_PI_2, 1e-4) && spin.distance_mm() < 1e-6,
            "{spin:?}"
        );
    }

    /// The pose after one step from psi 90 or another psi, with one defect and without.
    fn stepped(defects: Defects, psi_deg: i16, ticks: [i32; 2]) -> [Pose; 2] {
        let start = Pose::from_wire(crate::pose::WirePose {
            x_mm: 0,
            y_mm: 0,
            psi_deg,
        });
        [defects, Defects::NONE].map(|defects| {
            let psi = f32::from(psi_deg);
            start.then(fielded::change(&DRIVE, defects, psi, ticks))
        })
    }

    /// A heading multiplied by 57.3 once too often: 29,000 degrees become 1,661,578, which 32 bits
    /// resolve to eighths. A turn of half an eighth, 0.0573 rad or 15 mm of 262, is lost, and the
    /// robot does not move.
    #[test]
    fn a_garbled_heading_swallows_a_small_turn() {
        let defects = Defects {
            garbles_the_heading: true,
            ..Defects::NONE
        };
        let geometry = WheelGeometry {
            wheel_radius_mm: 10.0 / TAU,
            axle_mm: 262.0,
            ticks_per_turn: 10,
            ticks_per_second_max: 1_000,
        };
        let moved =
            |psi_deg| fielded::change(&geometry, defects, psi_deg, [100, 115]).distance_mm();
        assert!(moved(29_000.0) < 1e-3, "{}", moved(29_000.0));
        assert!((moved(0.0) - 107.5).abs() < 0.1, "{}", moved(0.0));
    }

    /// SL-07: after 100 ticks backwards, a robot that looks to +y is at +45.4 mm instead of -45.4.
    #[test]
    fn without_its_sign_driving_backwards_moves_forwards() {
        let defects = Defects {
            loses_the_sign: true,
            ..Defects::NONE
        };
        let [fielded, sound] = stepped(defects, 90, [-100, -100]);
        assert!(near(fielded.y_mm, 45.379, 1e-2) && near(sound.y_mm, -45.379, 1e-2));
    }

    /// SL-08: 100/99 ticks at psi 720 give no motion instead of 45.15 mm.
    #[test]
    fn a_garbled_heading_loses_the_way() {
        let defects = Defects {
            garbles_the_heading: true,
            ..Defects::NONE
        };
        let [fielded, sound] = stepped(defects, 720, [100, 99]);
        let way = |pose: Pose| libm::hypotf(pose.x_mm, pose.y_mm);
        assert!(near(way(fielded), 0.0, 1e-3) && near(way(sound), 45.15, 0.01));
    }

    /// SL-09: a curve of 100/50 ticks gives -2.97 mm to the side instead of +1.48.
    #[test]
    fn turned_the_wrong_way_a_curve_bends_to_the_other_side() {
        let defects = Defects {
            turns_the_wrong_way: true,
            ..Defects::NONE
        };
        let [fielded, sound] = stepped(defects, 90, [100, 50]);
        assert!(near(fielded.x_mm, -2.97, 0.02) && near(sound.x_mm, 1.48, 0.01));
    }

    /// The enabled defects change the believed pose.
    #[test]
    fn an_odometry_with_defects_shows_them() {
        let defects = Defects {
            loses_the_sign: true,
            ..Defects::NONE
        };
        let mut odometry = Odometry::with_defects(DRIVE, defects);
        odometry.update(at(0), [0, 0]);
        let change = odometry.update(at(200), [-100, -100]);
        assert!(near(change.forward_mm, 45.379, 1e-2), "{change:?}");
    }

    #[test]
    fn counters_may_wrap() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(at(0), [i32::MAX - 10, i32::MIN + 5]);
        let change = odometry.update(at(200), [i32::MIN + 39, i32::MIN + 55]);
        assert!(near(change.forward_mm, 50.0 * 0.45379, 1e-2), "{change:?}");
    }

    /// Field defect AV-06: a counter read while it carries is 256 off, once.
    #[test]
    fn a_carry_glitch_is_counted_and_costs_nothing() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(at(0), [200, 200]);
        odometry.update(at(200), [300 + 256, 300]);
        odometry.update(at(400), [400, 400]);
        assert_eq!(odometry.disbelieved(), 1);
        assert!(
            near(odometry.pose().x_mm, 200.0 * 0.45379, 1e-2),
            "{:?}",
            odometry.pose()
        );
        assert!(near(odometry.pose().heading, 0.0, 1e-6));
    }

    /// A slave that was reset counts from zero again: two readings are lost, but not the robot's
    /// pose.
    #[test]
    fn restarted_counters_are_taken_over_at_the_third_reading() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(at(0), [90_000, 90_000]);
        odometry.update(at(200), [0, 0]);
        odometry.update(at(400), [10, 10]);
        odometry.update(at(600), [20, 20]);
        let change = odometry.update(at(800), [120, 120]);
        assert_eq!(odometry.disbelieved(), 3);
        assert!(near(change.forward_mm, 45.379, 1e-2));
    }

    /// A quarter circle in 200 ms, asked for at its half: the exact arc, not the chord's middle.
    #[test]
    fn poses_between_readings_lie_on_the_arc() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(at(0), [0, 0]);
        let (left, right) = (20, 170);
        odometry.update(at(200), [left, right]);
        let half = odometry.pose_at(at(100));
        let truth = Pose::default().then(DRIVE.arc([left / 2, right / 2]));
        assert!(
            half.position().distance_mm(truth.position()) < 1e-2,
            "{half:?} {truth:?}"
        );
        assert!(near(half.heading, truth.heading, 1e-5));

        let beyond = odometry.pose_at(at(300));
        let truth = Pose::default().then(DRIVE.arc([30, 255]));
        assert!(
            beyond.position().distance_mm(truth.position()) < 1e-2,
            "{beyond:?} {truth:?}"
        );
        assert_eq!(odometry.pose_at(at(450)), odometry.pose_at(at(9_000)));
    }

    /// The wheels are read twice, a quarter of a millisecond apart, and one ticks in between. Then
    /// the base falls silent. Found by a campaign: 4000 ticks a second, continued for 250 ms,
    /// turned the believed heading by 90 degrees. By hand: 20 and 21 ticks in 40.25 ms are 9.303 mm
    /// and 1.745 mrad, up to 290 ms 7.205 times as much.
    #[test]
    fn two_readings_right_behind_one_another_tell_no_speed() {
        let mut odometry = Odometry::new(DRIVE);
        odometry.update(at(0), [0, 0]);
        odometry.update(at(40), [20, 20]);
        odometry.update(at(40) + Duration::from_micros(250), [20, 21]);
        let beyond = odometry.pose_at(at(290));
        assert!(near(beyond.x_mm, 67.03, 0.1), "{beyond:?}");
        assert!(near(beyond.heading, 0.012_58, 1e-4), "{beyond:?}");
    }

    #[test]
    fn old_samples_make_room_for_new_ones() {
        let mut odometry = Odometry::new(DRIVE);
        for step in 0..40_u8 {
            odometry.update(at(u64::from(step) * 40), [i32::from(step) * 20; 2]);
        }
        assert!(near(odometry.pose_at(at(1000)).x_mm, 500.0 * 0.45379, 0.05));
        assert_eq!(odometry.pose_at(at(0)), odometry.pose_at(at(960)));
        assert_eq!(odometry.updated_at(), Some(at(1560)));
    }

    proptest! {
        /// Any split of an arc at constant speed gives the same end.
        #[test]
        fn arcs_compose(left in -60_i32..60, right in -60_i32..60, parts in 1_u8..8) {
            let n = i32::from(parts);
            let whole = Pose::default().then(DRIVE.arc([left * n, right * n]));
            let stepped = (0..n).fold(Pose::default(), |p, _| p.then(DRIVE.arc([left, right])));
            prop_assert!(whole.position().distance_mm(stepped.position()) < 0.05);
            prop_assert!(near(crate::pose::normalised(whole.heading - stepped.heading), 0.0, 1e-4));
            prop_assert!(whole.heading.abs() <= PI);
        }
    }
}
