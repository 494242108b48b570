//! Bridges, motors, encoder counters and the battery.

use protocols::Instant;
use protocols::peripherals::Outputs;

use super::Config;
use super::fault::Faults;
use crate::rng::Rng;
use crate::world::{Command, Wheel, World};

/// Both bridges with their motors.
#[derive(Clone, Debug)]
pub(super) struct Drives {
    config: Config,
    rpm_per_v: [f64; 2],
    /// Part of full drive, the mean of both motors.
    effort: f64,
}

impl Drives {
    pub(super) fn new(name: &str, seed: u64, config: &Config) -> Self {
        let rpm_per_v = Wheel::ALL.map(|wheel| {
            let mut dice = Rng::stream(seed, &format!("{name}.motor.{}", wheel.name()));
            config.motor.rpm_per_v * (1.0 + config.motor.spread * dice.range(-1.0, 1.0))
        });
        Self {
            config: config.clone(),
            rpm_per_v,
            effort: 0.0,
        }
    }

    pub(super) const fn rpm_per_v(&self) -> [f64; 2] {
        self.rpm_per_v
    }

    pub(super) const fn effort(&self) -> f64 {
        self.effort
    }

    /// Sets the chassis's motors; `part` is the part of their speed that a fault leaves.
    pub(super) fn apply(&mut self, world: &mut World, outputs: Outputs, supply_v: f64, part: f64) {
        let volts = self.config.volts(outputs, supply_v);
        for (wheel, volts) in Wheel::ALL.into_iter().zip(volts) {
            let command = match volts {
                Some(volts) => Command::Speed(part * self.steady_m_s(wheel, volts)),
                None => Command::Coast,
            };
            // A chassis without such a motor was refused at the start, or stays at rest.
            let _ = world.actuate(wheel.name(), command);
        }
        let full = volts.map(|volts| volts.unwrap_or_default().abs() / self.config.supply_v);
        self.effort = f64::midpoint(full[0], full[1]);
    }

    /// Speed of the rim in the long run.
    fn steady_m_s(&self, wheel: Wheel, volts: f64) -> f64 {
        if volts.abs() < self.config.motor.dead_band_v {
            return 0.0;
        }
        volts * self.rpm_per_v[wheel as usize] * self.config.rim_m_s_per_rpm()
    }
}

/// Counters of 16 bits, which wrap.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Counters {
    mirrored: [bool; 2],
    /// Edges of the chassis's encoders at the last look.
    seen: [i64; 2],
    /// Edges counted, parts of one left by a fault included.
    counted: [f64; 2],
}

impl Counters {
    pub(super) const fn new(mirrored: [bool; 2]) -> Self {
        Self {
            mirrored,
            seen: [0; 2],
            counted: [0.0; 2],
        }
    }

    pub(super) fn look(&mut self, world: &World, faults: &Faults) {
        for wheel in Wheel::ALL {
            let side = wheel as usize;
            let edges = world.encoder_ticks(wheel);
            let turned = edges - core::mem::replace(&mut self.seen[side], edges);
            if faults.stuck[side] {
                continue;
            }
            #[expect(clippy::cast_precision_loss, reason = "a millisecond has few edges")]
            let counted = turned as f64 * faults.count_factor;
            self.counted[side] += if self.mirrored[side] {
                -counted
            } else {
                counted
            };
        }
    }

    pub(super) const fn reset(&mut self) {
        self.counted = [0.0; 2];
    }

    pub(super) fn values(&self) -> [u16; 2] {
        self.counted.map(|counted| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "the low 16 bits are the counter"
            )]
            let low = libm::floor(counted) as i64 as u16;
            low
        })
    }
}

/// A battery whose voltage falls with the drawn charge.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Battery {
    volts: f64,
    drain_v_per_h: [f64; 2],
    /// Time up to which its loss is counted.
    at: Instant,
    /// Last voltage reported to the bridges.
    told: f64,
}

/// Minimum loss that is reported to the bridges: a thousandth of their speed.
const TOLD_V: f64 = 0.01;
/// An empty pack: its protection switches nothing off here, the motors only get slower.
const EMPTY_V: f64 = 6.0;

impl Battery {
    pub(super) const fn new(config: &Config) -> Self {
        Self {
            volts: config.supply_v,
            drain_v_per_h: config.drain_v_per_h,
            at: Instant::ZERO,
            told: config.supply_v,
        }
    }

    pub(super) const fn volts(&self) -> f64 {
        self.volts
    }

    /// Takes the charge for `effort`, a part of full drive, until `now`. `true` if the bridges need
    /// the new voltage.
    pub(super) fn drain(&mut self, now: Instant, effort: f64) -> bool {
        let hours = (now - self.at).as_secs_f64() / 3_600.0;
        self.at = now;
        let [rest, full] = self.drain_v_per_h;
        let left = self.volts - (rest + full * effort) * hours;
        self.volts = left.max(EMPTY_V.min(self.volts));
        let is_news = self.told - self.volts >= TOLD_V;
        if is_news {
            self.told = self.volts;
        }
        is_news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 12 V that fall by 0.036 V an hour at rest and by 0.36 V more at full drive. After 1000 s at
    /// rest, or after 91 s at full drive, 10 mV are lost and reported, and again after as long. An
    /// empty pack keeps its 6 V.
    #[test]
    fn a_loss_of_ten_millivolts_is_told() {
        let config = Config {
            supply_v: 12.0,
            drain_v_per_h: [0.036, 0.36],
            ..Config::default()
        };
        let told = |effort: f64| {
            let mut battery = Battery::new(&config);
            let news =
                (1..2_100).filter(|second| battery.drain(Instant::from_secs(*second), effort));
            news.take(2).collect::<Vec<_>>()
        };
        assert!((999..=1_001).contains(&told(0.0)[0]), "{:?}", told(0.0));
        assert!((1_999..=2_002).contains(&told(0.0)[1]), "{:?}", told(0.0));
        assert!((90..=92).contains(&told(1.0)[0]) && (181..=184).contains(&told(1.0)[1]));
        let mut battery = Battery::new(&config);
        assert!(battery.drain(Instant::from_secs(1_000_000), 1.0));
        assert_eq!(battery.volts(), 6.0);
    }

    /// Both bridges at three quarters are half of full drive each. One bridge off halves that; both
    /// off give none.
    #[test]
    fn the_effort_is_the_mean_of_both_bridges() {
        let config = Config::default();
        let effort = |duty: [u16; 2], enable| {
            let mut drives = Drives::new("board", 7, &config);
            assert_eq!(drives.effort(), 0.0);
            let outputs = Outputs {
                duty,
                enable,
                ..Outputs::default()
            };
            let scene = crate::world::Scene::new::<crate::world::Shape>([], vec![]).unwrap();
            let body = crate::world::BodyConfig::default();
            let pose = crate::world::Pose::default();
            let mut world = World::new(scene, body, pose, 1).unwrap();
            drives.apply(&mut world, outputs, config.supply_v, 1.0);
            drives.effort()
        };
        assert!((effort([7_500, 7_500], true) - 0.5).abs() < 1e-9);
        assert!((effort([2_500, 7_500], true) - 0.5).abs() < 1e-9);
        assert!((effort([10_000, 5_000], true) - 0.5).abs() < 1e-9);
        assert!((effort([7_500, 5_000], true) - 0.25).abs() < 1e-9);
        assert_eq!(effort([10_000, 10_000], false), 0.0);
    }

    /// 12 V at 40 rpm a volt are 480 rpm; a wheel of 37.5 mm then rolls 1.885 m a second. Half a
    /// volt moves it, less does not. Motors differ by a twentieth at most, and from each other.
    #[test]
    fn a_wheel_turns_by_its_volts() {
        let config = Config::default();
        let mut drives = Drives::new("board", 7, &config);
        let rpm_per_v = drives.rpm_per_v();
        assert!(rpm_per_v.iter().all(|rpm| (rpm / 40.0 - 1.0).abs() <= 0.05));
        assert!(rpm_per_v[0] != rpm_per_v[1] && rpm_per_v[0] != 40.0);
        drives.rpm_per_v = [40.0, 20.0];
        let steady = |wheel, volts| drives.steady_m_s(wheel, volts);
        for (wheel, volts, expected) in [
            (Wheel::Left, 12.0, 1.884_956),
            (Wheel::Left, -12.0, -1.884_956),
            (Wheel::Right, 12.0, 0.942_478),
            (Wheel::Left, 0.5, 0.078_540),
            (Wheel::Left, -0.5, -0.078_540),
            (Wheel::Left, 0.499, 0.0),
            (Wheel::Left, -0.499, 0.0),
        ] {
            let found = steady(wheel, volts);
            assert!((found - expected).abs() < 1e-6, "{volts} V: {found}");
        }
    }

    /// The motors of a run are spread over all of the range.
    #[test]
    fn motors_of_many_boards_differ_by_up_to_a_twentieth() {
        let config = Config::default();
        let parts = (0..400).map(|seed| Drives::new("board", seed, &config).rpm_per_v()[0] / 40.0);
        let [low, high] = parts.fold([9.0, 0.0], |[low, high]: [f64; 2], part| {
            [low.min(part), high.max(part)]
        });
        assert!((0.95..0.952).contains(&low) && (1.048..=1.05).contains(&high));
    }
}
