//! A gyroscope on the base's own bus; the base integrates its turn rate.
//!
//! The report plans inertial sensors without a type. The emulated one is a rate gyroscope like the
//! MPU-6050: the base integrates its samples. Registers 54 to 57 hold the sum in hundredths of a
//! degree, counter-clockwise. The base does not correct the offset: at rest a master sees the sum
//! drift.

use protocols::Instant;
use protocols::avr::registers::YAW;

use super::AvrBase;
use crate::rng::Rng;
use crate::world::{World, wrap_angle};

/// Offset of the rate, degrees a second. Data sheet of the MPU-6050: 20 at most. This is a guess of
/// the remainder after one calibration.
const OFFSET_DEG_S: f64 = 0.5;
/// Error of the scale: data sheet, 3 %; calibrated once, a guess.
const SCALE: f64 = 0.005;
/// Noise, degrees per root of a second: data sheet, 0.005 degrees/s per root of a hertz.
const NOISE_DEG: f64 = 0.005;

/// Whether the base has a gyroscope.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Imu {
    /// Like the fielded base.
    #[default]
    None,
    /// A gyroscope.
    Fitted,
}

/// The gyroscope and the sum of its samples.
#[derive(Clone, Debug)]
pub(super) struct Gyro {
    noise: Rng,
    offset_deg_s: f64,
    scale: f64,
    /// Time of the last look, and the true heading then.
    last: Option<(Instant, f64)>,
    sum_deg: f64,
}

impl Gyro {
    pub(super) fn new(seed: u64) -> Self {
        let mut unit = Rng::stream(seed, "base.gyro");
        Self {
            offset_deg_s: OFFSET_DEG_S * unit.gauss(),
            scale: 1.0 + SCALE * unit.gauss(),
            noise: Rng::stream(seed, "base.gyro-noise"),
            last: None,
            sum_deg: 0.0,
        }
    }

    /// Restarts the sum at 0 when the base restarts.
    pub(super) const fn restart(&mut self) {
        self.last = None;
        self.sum_deg = 0.0;
    }

    /// The sum of the samples up to `now`.
    fn sum(&mut self, now: Instant, theta: f64) -> f64 {
        if let Some((at, before)) = self.last {
            let time_s = (now - at).as_secs_f64();
            let turned = wrap_angle(theta - before).to_degrees();
            let noise = NOISE_DEG * libm::sqrt(time_s) * self.noise.gauss();
            self.sum_deg += turned * self.scale + self.offset_deg_s * time_s + noise;
        }
        self.last = Some((now, theta));
        self.sum_deg
    }
}

impl AvrBase {
    /// Fills the registers with the turn so far.
    pub(super) fn look_at_turn(&mut self, world: &World) {
        if self.config.imu == Imu::None {
            return;
        }
        let sum = self.gyro.sum(self.now, world.pose().theta);
        #[expect(clippy::cast_possible_truncation, reason = "60,000 turns")]
        let hundredths = libm::round(sum * 100.0) as i32;
        self.memory.set_i32(YAW, hundredths);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A turn by 503 degrees in three seconds. The sum may differ by three deviations of the scale,
    /// half a per cent each, and of the offset, half a degree a second each.
    #[test]
    fn a_turn_is_summed_up_with_scale_and_offset() {
        let mut gyro = Gyro::new(1);
        for (second, theta) in [0.0, 3.0, -0.283_185, 2.5].into_iter().enumerate() {
            gyro.sum(Instant::from_secs(second as u64), theta);
        }
        let turned = (3.0 + 3.0 + 2.783_185_f64).to_degrees();
        assert!((gyro.sum_deg - turned).abs() < 13.0, "{}", gyro.sum_deg);
        let rest = gyro.sum_deg;
        gyro.sum(Instant::from_secs(103), 2.5);
        let drift = gyro.sum_deg - rest;
        assert!((drift - 100.0 * gyro.offset_deg_s).abs() < 0.3, "{drift}");
    }

    /// A radian is 57.296 degrees; with the scale fault 85.944. Ten seconds at 2 degrees add 20.
    #[test]
    fn a_scale_multiplies_the_turn_and_an_offset_the_time() {
        let mut gyro = Gyro::new(1);
        (gyro.scale, gyro.offset_deg_s) = (1.5, 2.0);
        gyro.sum(Instant::from_secs(5), 0.25);
        let sum = gyro.sum(Instant::from_secs(15), 1.25);
        assert!((sum - 105.944).abs() < 1.0, "{sum}");
        gyro.restart();
        assert_eq!(gyro.sum(Instant::from_secs(20), 3.0), 0.0);
    }

    /// A base without a gyroscope leaves its registers alone; a base with one reports a radian as
    /// 57 degrees.
    #[test]
    fn only_a_base_with_a_gyroscope_tells_its_turn() {
        use crate::avr_base::AvrBaseConfig;
        use crate::world::{BodyConfig, Pose, Scene, Shape};
        let told = |imu| {
            let config = AvrBaseConfig {
                imu,
                ..AvrBaseConfig::default()
            };
            let mut base = AvrBase::new(config, 7);
            base.memory.set_i32(YAW, -7);
            for theta in [0.0, 1.0] {
                let scene = Scene::new::<Shape>([], vec![]).unwrap();
                let pose = Pose::new(0.0, 0.0, theta);
                let world = World::new(scene, BodyConfig::default(), pose, 1).unwrap();
                base.look_at_turn(&world);
            }
            let bytes = [0, 1, 2, 3].map(|at| base.register(YAW + at));
            i32::from_le_bytes(bytes)
        };
        assert_eq!(told(Imu::None), -7);
        assert!(
            (5_600..5_860).contains(&told(Imu::Fitted)),
            "{}",
            told(Imu::Fitted)
        );
    }
}
