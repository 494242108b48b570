//! Infrared range sensors of the kind Sharp GP2Y0A21: a voltage that is held until the next
//! measurement is done, linear in the inverse of the distance.
//!
//! ```text
//! V = 0.129 + 0.217 m / d      0.4 V at 0.8 m, 1.9 V more at 0.1 m (data sheet)
//! ```
//!
//! Nearer than the curve's peak the voltage falls again, so that a near wall looks far: the data
//! sheet's figure rises to about 3.1 V at 7 cm and falls from there; here in a straight line.

use core::time::Duration;

use protocols::Instant;

use super::fault::Faults;
use super::{Config, RangeSensor};
use crate::rng::Rng;
use crate::world::World;

/// Time between two measurements, and its greatest deviation (data sheet).
const PERIOD_MS: f64 = 38.3;
const PERIOD_SPREAD_MS: f64 = 9.6;
/// The data sheet's two points of the curve.
const FAR: (f64, f64) = (0.8, 0.4);
const NEAR: (f64, f64) = (0.1, 2.3);
const SLOPE_V_M: f64 = (NEAR.1 - FAR.1) / (1.0 / NEAR.0 - 1.0 / FAR.0);
const OFFSET_V: f64 = FAR.1 - SLOPE_V_M / FAR.0;
/// Distance of the greatest voltage.
const PEAK_M: f64 = 0.07;
/// Light from farther away is lost in the noise.
const RANGE_M: f64 = 3.0;

/// All sensors of a board.
#[derive(Clone, Debug)]
pub(super) struct Infrared {
    sensors: Vec<Sensor>,
    noise_v: f64,
    /// Time of the next finished measurement of any sensor.
    next_at: Instant,
}

#[derive(Clone, Debug)]
struct Sensor {
    mount: RangeSensor,
    /// Output voltage, held until the next measurement.
    volts: f64,
    done_at: Instant,
    dice: Rng,
}

impl Infrared {
    pub(super) fn new(name: &str, seed: u64, config: &Config) -> Self {
        let mounts = config.range_sensors.iter().enumerate();
        let sensors = mounts.map(|(index, mount)| {
            let mut dice = Rng::stream(seed, &format!("{name}.range.{index}"));
            let phase_ms = dice.range(0.0, PERIOD_MS);
            Sensor {
                mount: *mount,
                volts: 0.0,
                done_at: Instant::ZERO + duration(phase_ms),
                dice,
            }
        });
        Self {
            sensors: sensors.collect(),
            noise_v: config.range_noise_v,
            next_at: Instant::ZERO,
        }
    }

    /// Ends the measurements that are done by `now`.
    pub(super) fn measure(&mut self, now: Instant, world: &World, faults: &Faults) {
        if now < self.next_at {
            return;
        }
        for (index, sensor) in self.sensors.iter_mut().enumerate() {
            if sensor.done_at <= now {
                sensor.measure(world, self.noise_v, faults.is_blind(index));
                // A rig that was stopped for long does not repeat missed measurements.
                sensor.done_at = (sensor.done_at + sensor.period()).max(now);
            }
        }
        let done = self.sensors.iter().map(|sensor| sensor.done_at).min();
        self.next_at = done.unwrap_or(Instant::from_nanos(u64::MAX));
    }

    pub(super) fn volts(&self) -> impl Iterator<Item = f64> + '_ {
        self.sensors.iter().map(|sensor| sensor.volts)
    }

    /// Voltage at a channel of the ADC; an open channel is at ground.
    pub(super) fn volts_of(&self, channel: usize) -> f64 {
        self.sensors.get(channel).map_or(0.0, |sensor| sensor.volts)
    }
}

impl Sensor {
    fn measure(&mut self, world: &World, noise_v: f64, is_blind: bool) {
        let pose = world.pose();
        let from = pose.offset(self.mount.x_m, self.mount.y_m);
        let noise = noise_v * self.dice.gauss();
        let hit = world.cast_ray(from, pose.theta + self.mount.angle_rad, RANGE_M);
        let distance = hit.filter(|_| !is_blind).map(|hit| hit.distance);
        self.volts = (volts(distance) + noise).max(0.0);
    }

    fn period(&mut self) -> Duration {
        duration(PERIOD_MS + self.dice.range(-PERIOD_SPREAD_MS, PERIOD_SPREAD_MS))
    }
}

fn duration(ms: f64) -> Duration {
    Duration::from_secs_f64(ms / 1_000.0)
}

/// Voltage of a sensor for an object at this distance, metres, or for none.
pub(super) fn volts(distance_m: Option<f64>) -> f64 {
    match distance_m {
        None => OFFSET_V,
        Some(d) if d < PEAK_M => (OFFSET_V + SLOPE_V_M / PEAK_M) * (d.max(0.0) / PEAK_M),
        Some(d) => OFFSET_V + SLOPE_V_M / d,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The data sheet's two points, nothing in sight, and a wall nearer than the peak: 3.2306 V at
    /// 7 cm, half of it at half of that.
    #[test]
    fn voltages_are_those_of_the_curve() {
        let found = [
            None,
            Some(0.8),
            Some(0.1),
            Some(0.07),
            Some(0.035),
            Some(-1.0),
        ]
        .map(volts);
        let expected = [0.128_571, 0.4, 2.3, 3.230_612, 1.615_306, 0.0];
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        assert_eq!(duration(38.3), Duration::from_micros(38_300));
    }

    /// Of seven channels six have a sensor; none has measured yet.
    #[test]
    fn an_open_channel_is_at_ground() {
        let mut sensors = Infrared::new("board", 7, &Config::default());
        sensors.sensors[2].volts = 1.25;
        assert_eq!(
            [2, 3, 6, 99].map(|channel| sensors.volts_of(channel)),
            [1.25, 0.0, 0.0, 0.0]
        );
        assert!(sensors.volts().eq([0.0, 0.0, 1.25, 0.0, 0.0, 0.0]));
    }

    /// Measurements last 38.3 ms, 9.6 ms more or less, and at the start one is under way. A request
    /// after a second finds one measurement, not twenty-six.
    #[test]
    fn measurements_are_as_long_as_the_data_sheet_says() {
        let mut sensors = Infrared::new("board", 7, &Config::default());
        let phases = sensors
            .sensors
            .iter()
            .map(|sensor| sensor.done_at.as_nanos());
        let phases: Vec<u64> = phases.collect();
        assert!(phases.iter().all(|phase| *phase < 38_300_000));
        assert!(phases.windows(2).all(|pair| pair[0] != pair[1]));
        for _ in 0..200 {
            let period = sensors.sensors[0].period();
            let range = Duration::from_micros(28_700)..=Duration::from_micros(47_900);
            assert!(range.contains(&period), "{period:?}");
        }
        let scene = crate::world::Scene::new::<crate::world::Shape>([], vec![]).expect("empty");
        let body = crate::world::BodyConfig::default();
        let world = World::new(scene, body, crate::world::Pose::default(), 1).expect("free");
        let late = Instant::from_secs(1);
        sensors.measure(late, &world, &Faults::default());
        assert!(sensors.sensors.iter().all(|sensor| sensor.done_at == late));
        assert_eq!(sensors.next_at, late);
        sensors.measure(late, &world, &Faults::default());
        assert!(sensors.next_at > late + Duration::from_millis(28));
    }
}
