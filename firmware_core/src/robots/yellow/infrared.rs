//! Three of the six IR sensors around the robot, read one after the other by one ADC.
//!
//! The sensors are GP2Y0A21: 0.4 V at 0.8 m, 1.9 V more at 0.1 m, and in between a straight line
//! over the reciprocal of the distance (data sheet). They are numbered clockwise from ahead.

use protocols::peripherals::{ADC_MAX, Sample};

/// Sensors that are read: ahead, right front, left front.
pub(super) const SENSORS: [u8; 3] = [0, 1, 5];
/// Voltage of the largest value.
const REFERENCE_VOLTS: f32 = 3.3;
/// Maximum distance that the sensor measures.
pub(super) const FAR_M: f32 = 0.8;
const NEAR_M: f32 = 0.1;
const FAR_VOLTS: f32 = 0.4;
const NEAR_VOLTS: f32 = 2.3;
/// The line over the reciprocal of the distance.
const SLOPE: f32 = (NEAR_VOLTS - FAR_VOLTS) / (1.0 / NEAR_M - 1.0 / FAR_M);
const OFFSET: f32 = FAR_VOLTS - SLOPE / FAR_M;
/// The fielded program's curve: 0.58 (1 - sqrt(part of the reference)).
const FIELDED_M: f32 = 0.58;

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// A curve that is correct only near the robot: 0.8 m are read as 0.38 m.
    pub reads_short: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self { reads_short: false };
}

/// The last distances.
#[derive(Clone, Debug)]
pub(super) struct Infrared {
    defects: Defects,
    distances_m: [f32; SENSORS.len()],
    /// Index of the sensor that is read next.
    next: usize,
}

impl Infrared {
    pub(super) const fn new(defects: Defects) -> Self {
        Self {
            defects,
            distances_m: [FAR_M; SENSORS.len()],
            next: 0,
        }
    }

    /// Takes a value; returns the channel that the ADC must read next.
    pub(super) fn take(&mut self, sample: &Sample) -> u8 {
        let known = SENSORS.iter().position(|it| *it == sample.channel);
        if let Some(slot) = known.and_then(|at| self.distances_m.get_mut(at)) {
            *slot = match self.defects.reads_short {
                true => fielded(sample.adc),
                false => distance_m(sample.adc),
            };
        }
        self.next = (self.next + 1) % SENSORS.len();
        SENSORS[self.next]
    }

    /// Metres: ahead, right front, left front.
    pub(super) const fn distances_m(&self) -> [f32; SENSORS.len()] {
        self.distances_m
    }
}

/// The distance of a value: the inverse of the sensor's curve.
fn distance_m(adc: u16) -> f32 {
    let volts = f32::from(adc) / f32::from(ADC_MAX) * REFERENCE_VOLTS;
    if volts <= FAR_VOLTS {
        return FAR_M;
    }
    SLOPE / (volts - OFFSET)
}

fn fielded(adc: u16) -> f32 {
    FIELDED_M * (1.0 - libm::sqrtf(f32::from(adc) / f32::from(ADC_MAX)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// From the data sheet's two points, by hand: 1/d is 1.25 at 0.8 m and 10 at 0.1 m, so 0.2 m
    /// give 0.4 + 1.9 * 3.75 / 8.75 = 1.2143 V and 0.4 m give 0.6714 V. A reading of 4095 is 3.3 V.
    /// The fielded figures are those of a script on the fielded formula.
    #[test]
    fn the_curve_is_that_of_the_sensor_and_the_fielded_one_is_not() {
        for (adc, true_m, fielded_m) in [
            (2_854, 0.10, 0.096),
            (1_507, 0.20, 0.228),
            (833, 0.40, 0.3184),
            (496, 0.80, 0.378),
        ] {
            assert!((distance_m(adc) - true_m).abs() < 0.002, "{adc}");
            assert!((fielded(adc) - fielded_m).abs() < 0.002, "{adc}");
        }
        assert!((distance_m(0) - 0.8).abs() < 1e-6);
    }

    #[test]
    fn the_three_sensors_are_read_in_turn() {
        let mut infrared = Infrared::new(Defects::NONE);
        let mut sample = Sample::default();
        let mut channels = [9; 6];
        for channel in &mut channels {
            sample.adc = 1_507 + u16::from(sample.channel) * 200;
            sample.channel = infrared.take(&sample);
            *channel = sample.channel;
        }
        assert_eq!(channels, [1, 5, 0, 1, 5, 0]);
        let [ahead, right, left] = infrared.distances_m();
        assert!((ahead - 0.2).abs() < 0.002 && ahead > right && right > left);
    }
}
