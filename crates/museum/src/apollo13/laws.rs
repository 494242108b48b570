//! Formulas of the report and of the fielded program, figure by figure.

use emulators::car_board::steering::{angle_deg, nearest};
use firmware_core::ackermann::{CarGeometry, CarPose};
use firmware_core::robots::apollo13::gates::{Gates, Passage, Settings};
use protocols::car_board::Steering;

use crate::{Observation, Variant};

/// The fielded search: the first value whose angle is not greater; beyond the range, its end.
fn first_below(wanted_deg: f64) -> Option<Steering> {
    let [least, most] = Steering::RANGE.map(i16::from);
    let mut values = (least..=most).filter_map(|value| Steering::new(value).ok());
    values.find(|value| angle_deg(*value) <= wanted_deg)
}

/// Value 0 is 6.0 degrees, value 1 is 5.2.
pub(super) fn af_17(variant: Variant) -> Observation {
    const WANTED_DEG: f64 = 5.9;
    let value = match variant {
        Variant::Defective => first_below(WANTED_DEG),
        Variant::Sound => nearest(WANTED_DEG),
    };
    let found = value.map_or(f64::NAN, angle_deg);
    let mut seen = Observation::default();
    seen.figure("5.9 degrees become", format!("{found:.1}"));
    seen.judged((found - WANTED_DEG).abs() > 0.4)
}

/// Half a radian along the circle that results from 15 degrees of steering to the left.
pub(super) fn af_18(variant: Variant) -> Observation {
    let car = CarGeometry {
        wheelbase_m: 0.258,
        track_m: 0.155,
    };
    let steering = 15_f64.to_radians();
    let there = car.front_arc(steering, 0.5 * car.wheelbase_m / libm::sin(steering));
    let found = match variant {
        Variant::Defective => {
            let (x, y, k) = (-there.left_m, there.ahead_m, car.wheelbase_m);
            libm::atan(2.0 * x * k / (-x * x - y * y + 2.0 * y * k))
        }
        Variant::Sound => {
            let inverse = car.front_inverse(there.ahead_m, there.left_m);
            inverse.map_or(f64::NAN, |(steering, _)| steering)
        }
    };
    let mut seen = Observation::default();
    let told = format!("{:.1}", found.to_degrees());
    seen.figure("steering to where 15 degrees lead", told);
    seen.judged((found - steering).abs() > 0.1)
}

/// Passage that a car at the origin, facing along x, derives from markers seen in this order.
fn next(variant: Variant, markers: &[(u32, [f64; 2])]) -> Option<Passage> {
    let mut gates = Gates::new(match variant {
        Variant::Defective => Settings::fielded(),
        Variant::Sound => Settings::default(),
    });
    for (id, place_m) in markers {
        gates.see(*id, *place_m);
    }
    gates.next(CarPose::default(), |_| true)
}

pub(super) fn af_19(variant: Variant) -> Observation {
    let found = next(variant, &[(10, [-2.0, 0.4]), (11, [-2.0, -0.4])]);
    let told = found.map_or_else(
        || "none".to_owned(),
        |found| format!("{:.2}", found.middle.x_m),
    );
    let mut seen = Observation::default();
    seen.figure("goal in a gate 2 m behind the car, m ahead", told);
    seen.judged(found.is_some())
}

/// A gate of 0.8 m whose normal points 45 degrees to the left: 0.283 m each way from its middle.
pub(super) fn af_20(variant: Variant) -> Observation {
    let found = next(variant, &[(10, [1.717, 0.283]), (11, [2.283, -0.283])]);
    let heading = found.map_or(f64::NAN, |found| found.middle.heading_rad.to_degrees());
    let mut seen = Observation::default();
    seen.figure("heading in a gate of 45 degrees", format!("{heading:.0}"));
    seen.judged(heading.abs() < 1.0)
}

/// The first sighting of each marker is 0.3 m too far to the left; 29 later ones are correct.
pub(super) fn af_21(variant: Variant) -> Observation {
    let mut markers = vec![(10, [2.0, 0.7]), (11, [2.0, -0.1])];
    for _ in 0..29 {
        markers.extend([(10, [2.0, 0.4]), (11, [2.0, -0.4])]);
    }
    let off = next(variant, &markers).map_or(f64::NAN, |found| found.middle.y_m);
    let mut seen = Observation::default();
    seen.figure("off the gate's middle, m", format!("{off:.2}"));
    seen.judged(off > 0.1)
}
