//! The encoder ring: 15 teeth, and their evaluation by the firmware.
//!
//! All figures are from the 1,800 teeth of the steady part of the "hand in box" capture and from
//! the coast-down behind it. A tooth passes at angle 2 (mod 24). The firmware divides the time
//! of the tooth before into 24 slots, one per degree:
//!
//! - the tooth comes early: slots not yet begun are skipped (0x21). In the capture that happens if
//!   and only if the tooth was more than 0.2 % faster than the one before (203 of 1,800);
//! - the tooth comes late by more than 0.85 of a slot: synchronisation is lost until the second
//!   edge of the tooth, five degrees on.

use core::f64::consts::TAU;

use crate::rng::Rng;

/// Teeth on the ring.
pub(super) const TEETH: u8 = 15;
/// Degrees from tooth to tooth, and slots into which the firmware divides them.
pub(super) const TOOTH_DEG: f64 = 24.0;
/// Degrees from the edge of a tooth to the first slot after it, in a steady turn.
pub(super) const PHASE_SLOTS: f64 = 0.9;
/// A slot has begun, and is not skipped, if the tooth passes this many slot times after the slot
/// before was due.
const SKIP_SLOTS: f64 = 0.952;
/// Lateness of a tooth, in slots, from which synchronisation is lost.
const LATE_SLOTS: f64 = 0.85;
/// Degrees between the two edges of a tooth.
pub(super) const SECOND_EDGE_DEG: f64 = 5.0;
/// Jitter of an edge. Makes the ratio of neighbouring teeth wander by 0.065 %, as captured.
const JITTER_DEG: f64 = 0.0064;

/// Jitter of an edge if the speed wanders as well: the remainder. Fitted together with [`REST`] to
/// the difference of a tooth's speed from that of a turn before, and to its correlation between
/// teeth.
const JITTER_CAPTURED_DEG: f64 = 0.0022;
/// Variation of the speed within a turn: cycles per turn of the head, and amplitude as a part of
/// the speed. Lines in the spectrum of 1,785 tooth speeds of the capture, after subtracting the
/// mean of each tooth and of each turn: 0.139, 0.079, 0.072 and 0.070 rpm at 297. They come from
/// belt and gear, as their even spacing shows. Some are a little larger here: steps from tooth to
/// tooth have a deviation of 0.20 rpm and few outliers (kurtosis 2.3).
const LINES: [(f64, f64); 4] = [
    (0.868_5, 0.145 / 297.0),
    (3.361_5, 0.079 / 297.0),
    (4.915_5, 0.084 / 297.0),
    (6.723, 0.104 / 297.0),
];
/// Variation besides those lines: a deviation of 0.1 rpm; neighbouring teeth correlate by 0.61.
const REST: f64 = 0.098 / 297.0;
const REST_KEPT: f64 = 0.61;
/// Share of the shift by it that is kept at each tooth, so that it does not add up over minutes.
const SHIFT_KEPT: f64 = 0.99;

/// Mean speed shown for each tooth over 120 turns of the capture at 297.0 rpm. The pattern of
/// speeds means that the ring is not divided evenly.
const SPEEDS_RPM: [f64; TEETH as usize] = [
    297.492, 296.674, 297.126, 296.470, 296.474, 296.266, 296.388, 297.348, 297.903, 297.163,
    296.923, 297.141, 297.204, 297.101, 297.157,
];

/// The ring itself: where its edges are.
#[derive(Clone, Debug)]
pub(super) struct Encoder {
    /// Deviation of each tooth from its place, degrees.
    offsets: [f64; TEETH as usize],
    rng: Rng,
    /// The tooth that passes next.
    tooth: u8,
    /// Jitter of its edge.
    jitter_deg: f64,
    wander: Wander,
}

/// Effect of belt and gear on an even speed: a head ahead of its even angle meets its teeth early.
#[derive(Clone, Debug)]
pub(super) struct Wander {
    /// Random stream of the remaining variation and of the lines' phases; `None`: the speed does
    /// not vary.
    rng: Option<Rng>,
    phases: [f64; LINES.len()],
    /// Teeth passed.
    teeth: u32,
    /// Deviation of the speed besides the lines, as a part of the speed.
    rest: f64,
    /// Advance of the head by that deviation, degrees.
    shift_deg: f64,
}

impl Wander {
    /// An even speed.
    pub(super) const fn none() -> Self {
        Self {
            rng: None,
            phases: [0.0; LINES.len()],
            teeth: 0,
            rest: 0.0,
            shift_deg: 0.0,
        }
    }

    /// A speed that wanders as the captured one.
    pub(super) fn captured(mut rng: Rng) -> Self {
        let phases = core::array::from_fn(|_| rng.range(0.0, TAU));
        Self {
            phases,
            rng: Some(rng),
            ..Self::none()
        }
    }

    /// Advances by one tooth.
    fn pass(&mut self) {
        let Some(rng) = &mut self.rng else { return };
        self.teeth = self.teeth.wrapping_add(1);
        let fresh = REST * (1.0 - REST_KEPT * REST_KEPT).sqrt();
        self.rest = REST_KEPT * self.rest + fresh * rng.gauss();
        self.shift_deg = SHIFT_KEPT * self.shift_deg + self.rest * TOOTH_DEG;
    }

    /// Advance of the head, degrees.
    fn ahead_deg(&self) -> f64 {
        if self.rng.is_none() {
            return 0.0;
        }
        // A speed of 1 + a sin(f turns) adds a distance of -a cos / f.
        let turns = f64::from(self.teeth) / f64::from(TEETH);
        let lines = LINES
            .iter()
            .zip(self.phases)
            .map(|((cycles, part), phase)| {
                -part * 360.0 / (TAU * cycles) * libm::cos(TAU * cycles * turns + phase)
            });
        lines.sum::<f64>() + self.shift_deg
    }

    const fn jitter_deg(&self) -> f64 {
        if self.rng.is_none() {
            JITTER_DEG
        } else {
            JITTER_CAPTURED_DEG
        }
    }
}

impl Encoder {
    pub(super) fn new(mut rng: Rng, wander: Wander) -> Self {
        let jitter_deg = wander.jitter_deg() * rng.gauss();
        Self {
            offsets: offsets(),
            rng,
            tooth: 0,
            jitter_deg,
            wander,
        }
    }

    /// A random angle at which the head stands at power-on, degrees.
    pub(super) fn any_angle(&mut self) -> f64 {
        self.rng.range(0.0, 360.0)
    }

    /// The tooth that passes next.
    pub(super) const fn tooth(&self) -> u8 {
        self.tooth
    }

    /// Angle by which belt and gear have the head ahead of the motor's shaft when the next tooth
    /// passes.
    pub(super) fn ahead_deg(&self) -> f64 {
        self.wander.ahead_deg()
    }

    /// Angle of the motor's shaft when the tooth passes. Tooth 0 is counted at 2 degrees.
    pub(super) fn edge_deg(&self) -> f64 {
        first_slot_deg(self.tooth) - PHASE_SLOTS
            + self.offsets[usize::from(self.tooth)]
            + self.jitter_deg
            - self.wander.ahead_deg()
    }

    /// Advances to the next tooth; `true` if a new turn began.
    pub(super) fn pass(&mut self) -> bool {
        self.tooth = (self.tooth + 1) % TEETH;
        self.wander.pass();
        self.jitter_deg = self.wander.jitter_deg() * self.rng.gauss();
        self.tooth == 0
    }

    /// The first tooth beyond `angle_deg` (0 to 360) is the next. True if that is in the next turn.
    pub(super) fn seek(&mut self, angle_deg: f64) -> bool {
        let ahead = (0..TEETH).find(|&tooth| first_slot_deg(tooth) - 2.0 > angle_deg);
        self.tooth = ahead.unwrap_or(0);
        ahead.is_none()
    }

    /// A draw for the motor that turns the ring.
    pub(super) fn draw(&mut self) -> f64 {
        self.rng.gauss()
    }
}

/// Angle of the first slot behind `tooth`.
pub(super) fn first_slot_deg(tooth: u8) -> f64 {
    f64::from(first_slot(tooth))
}

/// Number of the first slot behind `tooth`, 3 to 339.
pub(super) const fn first_slot(tooth: u8) -> u16 {
    24 * (tooth as u16 % TEETH as u16) + 3
}

/// Running sum of each tooth's width minus 24 degrees.
fn offsets() -> [f64; TEETH as usize] {
    let slowness: f64 = SPEEDS_RPM.iter().map(|rpm| 1.0 / rpm).sum();
    let mut sum = 0.0;
    SPEEDS_RPM.map(|rpm| {
        sum += 360.0 / (rpm * slowness) - TOOTH_DEG;
        sum
    })
}

/// Arrival of a tooth, measured in slots of the tooth before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Arrival {
    /// Its slots are done; this many of them may have to be skipped.
    Expected,
    /// Too late: the next slot is no longer known.
    Late,
}

/// Classifies a tooth that took `slots` slot times of the previous one.
pub(super) fn arrival(slots: f64) -> Arrival {
    if slots > TOOTH_DEG + LATE_SLOTS {
        Arrival::Late
    } else {
        Arrival::Expected
    }
}

/// Whether slot `index` (0 to 23) of a tooth was begun when the next tooth came after `slots`.
pub(super) fn is_begun(index: u16, slots: f64) -> bool {
    f64::from(index) + SKIP_SLOTS <= slots
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_teeth_close_the_ring() {
        assert!(offsets()[14].abs() < 1e-9);
        assert!(offsets().iter().all(|o| o.abs() < 0.3));
    }

    /// The first slots of the teeth lie at 3, 27, .. 339 degrees, and 2 degrees before them is the
    /// tooth. Behind the last one comes that of the next turn.
    #[test]
    fn the_next_tooth_is_the_first_one_ahead() {
        let mut encoder = Encoder::new(Rng::stream(1, "teeth"), Wander::none());
        let mut seek = |angle_deg| (encoder.seek(angle_deg), encoder.tooth());
        assert_eq!(seek(0.0), (false, 0));
        assert_eq!(seek(0.9), (false, 0));
        assert_eq!(seek(1.1), (false, 1));
        assert_eq!(seek(180.0), (false, 8));
        assert_eq!(seek(336.9), (false, 14));
        assert_eq!(seek(337.1), (true, 0));
    }

    /// In the capture the boundary of a skipped slot lies between 0.189 and 0.217 % of faster
    /// turning, that of a late tooth between 3.52 and 3.58 % of slower turning.
    #[test]
    fn a_slot_is_skipped_and_a_tooth_is_late_where_the_capture_says() {
        let slots = |faster: f64| 24.0 / (1.0 + faster);
        assert!(is_begun(23, slots(0.0018)));
        assert!(!is_begun(23, slots(0.0022)));
        assert!(is_begun(22, slots(0.01)));
        assert_eq!(arrival(slots(-0.033)), Arrival::Expected);
        assert_eq!(arrival(slots(-0.036)), Arrival::Late);
    }

    /// Speeds of 1,800 teeth by their places: a deviation of 0.18 rpm at 297, neighbours alike by a
    /// third, and half a turn apart the opposite, as in the capture.
    #[test]
    fn f8_the_speed_wanders_over_teeth_as_captured() {
        for seed in 0..4 {
            let mut wander = Wander::captured(Rng::stream(seed, "belt"));
            let mut before = wander.ahead_deg();
            let speeds: Vec<f64> = (0..1_800)
                .map(|_| {
                    wander.pass();
                    let way = wander.ahead_deg() - before;
                    before += way;
                    297.0 * way / TOOTH_DEG
                })
                .collect();
            // As the capture is checked: without the mean of each turn.
            let rest: Vec<f64> = speeds
                .chunks_exact(15)
                .flat_map(|turn| {
                    let mean = turn.iter().sum::<f64>() / 15.0;
                    turn.iter().map(move |speed| speed - mean)
                })
                .collect();
            let alike = |lag: usize| {
                let pairs = rest.iter().zip(&rest[lag..]).map(|(a, b)| a * b);
                pairs.sum::<f64>() / rest.iter().map(|a| a * a).sum::<f64>()
            };
            let deviation = (rest.iter().map(|a| a * a).sum::<f64>() / 1_800.0).sqrt();
            assert!((0.14..0.22).contains(&deviation), "{deviation}");
            assert!((0.2..0.55).contains(&alike(1)), "{}", alike(1));
            assert!((-0.6..-0.1).contains(&alike(7)), "{}", alike(7));
            assert!((0.05..0.5).contains(&alike(15)), "{}", alike(15));
        }
    }

    /// 0x21 lies at 2 (mod 24): slot 23 of a tooth is the last before the next tooth's first.
    #[test]
    fn the_last_slot_of_a_tooth_is_at_2_mod_24() {
        assert_eq!((first_slot(0) + 23) % 24, 2);
        assert_eq!((first_slot(14) + 23) % 360, 2);
    }

    /// A walk that forgets keeps its deviation: over 50,000 teeth it is that of the rest.
    #[test]
    fn the_rest_of_the_wander_keeps_its_deviation() {
        let mut wander = Wander::captured(Rng::stream(3, "belt"));
        let squares = (0..50_000).map(|_| {
            wander.pass();
            wander.rest * wander.rest
        });
        let deviation = (squares.sum::<f64>() / 50_000.0).sqrt();
        assert!((deviation / REST - 1.0).abs() < 0.05, "{deviation}");
    }

    /// A head with these phases of the four lines after so many teeth.
    fn wander(phase: f64, teeth: u32, shift_deg: f64) -> Wander {
        Wander {
            rng: Some(Rng::stream(1, "belt")),
            phases: [phase; LINES.len()],
            teeth,
            rest: 0.0,
            shift_deg,
        }
    }

    /// The first line has 0.145 rpm of 297 and 0.8685 cycles a turn: at its turning point the head
    /// is 0.145 / 297 * 360 / (2 pi 0.8685) = 0.03221 degrees behind; all four add up to 0.04302.
    /// After four of 15 teeth they have turned by 83.4, 322.7, 471.9 and 645.4 degrees.
    #[test]
    fn lines_of_the_speed_have_the_head_ahead_or_behind() {
        for (phase, teeth, shift_deg, expected) in [
            (0.0, 0, 0.0, -0.043_022_8),
            (core::f64::consts::FRAC_PI_2, 0, 0.0, 0.0),
            (0.0, 0, 0.5, 0.456_977_2),
            (0.0, 4, 0.0, -0.006_885_9),
            (1.0, 4, 0.0, 0.021_042_3),
            (0.0, 15, 0.0, -0.021_241_9),
            (1.0, 15, 0.0, -0.032_370_9),
        ] {
            let found = wander(phase, teeth, shift_deg).ahead_deg();
            assert!((found - expected).abs() < 1e-7, "{phase} {teeth}: {found}");
        }
        assert_eq!(Wander::none().ahead_deg(), 0.0);
    }

    /// Two heads with the same draws: 0.61 of a difference of their rests stays at a tooth. So do
    /// 99 % of the shift, to which the rest adds its part of 24 degrees.
    #[test]
    fn a_tooth_keeps_a_part_of_rest_and_shift() {
        let [mut one, mut other] = [wander(0.0, 3, 0.2), wander(0.0, 3, 0.2)];
        other.rest = 1e-3;
        one.pass();
        other.pass();
        assert_eq!(one.teeth, 4);
        assert!((other.rest - one.rest - 0.61e-3).abs() < 1e-15);
        for head in [&one, &other] {
            let shift_deg = 0.99 * 0.2 + 24.0 * head.rest;
            assert!((head.shift_deg - shift_deg).abs() < 1e-12);
        }
        let mut even = Wander::none();
        even.pass();
        assert_eq!((even.teeth, even.shift_deg), (0, 0.0));
    }

    /// Tooth 0 takes 360 / (297.492 * 0.050500...) degrees, as the sum of all fifteen inverse
    /// speeds gives, 0.04066 less than 24; the last one closes the ring. The first slots lie 0.9
    /// degrees behind the edges.
    #[test]
    fn an_edge_lies_where_its_tooth_is_off() {
        let edge = |tooth: u8, jitter_deg: f64, wander: Wander| {
            let mut encoder = Encoder::new(Rng::stream(1, "teeth"), wander);
            (encoder.tooth, encoder.jitter_deg) = (tooth, jitter_deg);
            encoder.edge_deg()
        };
        for (tooth, jitter_deg, expected) in [
            (0, 0.0, 2.1 - 0.040_66),
            (1, 0.0, 26.1 - 0.015_26),
            (6, 0.0, 146.1 + 0.164_22),
            (14, 0.0, 338.1),
            (14, 0.5, 338.6),
            (14, -0.5, 337.6),
        ] {
            let found = edge(tooth, jitter_deg, Wander::none());
            assert!((found - expected).abs() < 1e-5, "{tooth}: {found}");
        }
        // A head that is ahead meets the tooth before the motor's shaft is there.
        let quarter = core::f64::consts::FRAC_PI_2;
        let found = edge(14, 0.0, wander(quarter, 0, 0.25));
        assert!((found - 337.85).abs() < 1e-9, "{found}");
    }

    /// Over 6,000 teeth: 0.0064 degrees of a unit with an even speed, 0.0022 of one that wanders.
    /// The motor's draws have a deviation of 1, and the angles at power-on lie anywhere in a turn.
    #[test]
    fn an_edge_jitters_as_captured() {
        let deviation = |values: &[f64]| {
            let squares = values.iter().map(|value| value * value).sum::<f64>();
            (squares / values.len() as f64).sqrt()
        };
        for (wander, expected) in [(Wander::none(), 0.006_4), (wander(0.0, 0, 0.0), 0.002_2)] {
            let mut encoder = Encoder::new(Rng::stream(1, "teeth"), wander);
            let mut turns = 0;
            let mut jitter = Vec::new();
            for _ in 0..6_000 {
                jitter.push(encoder.jitter_deg);
                turns += u32::from(encoder.pass());
            }
            assert_eq!(turns, 400);
            let found = deviation(&jitter);
            assert!((found / expected - 1.0).abs() < 0.05, "{found}");
            let draws: Vec<f64> = (0..6_000).map(|_| encoder.draw()).collect();
            assert!((deviation(&draws) - 1.0).abs() < 0.05);
            let angles: Vec<f64> = (0..6_000).map(|_| encoder.any_angle() - 180.0).collect();
            // Even numbers between two ends have a deviation of half their span by the root of 3.
            assert!((deviation(&angles) / 180.0 * 3.0_f64.sqrt() - 1.0).abs() < 0.05);
        }
    }
}
