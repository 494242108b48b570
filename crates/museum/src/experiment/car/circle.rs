//! Steering value 0 is not straight ahead: the report's table gives 6 degrees to the left.

use core::time::Duration;

use emulators::world::{Pose, wrap_angle};

use super::super::runs::{Spread, each};
use super::super::{Figure, Findings, Plan, Plot, Table};
use super::{jobs, told, way};

/// Steering values, and their angles in the report's table.
const VALUES: [(i8, &str); 3] = [
    (0, "6.0 deg to the left"),
    (7, "0.4 deg to the left"),
    (8, "0.4 deg to the right"),
];
/// Wheelbase of the car, metres.
const WHEELBASE_M: f64 = 0.258;
/// At 22 cm/s a circle at value 0 takes 70 s.
const FROM: Duration = Duration::from_secs(3);
const UNTIL: Duration = Duration::from_secs(75);

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let values = VALUES.map(|(value, _)| value);
    let jobs = jobs(&values, plan);
    let ways = each(plan, &jobs, tell, |(value, seed)| {
        // Driving straight, the car gets 16 m far.
        let size_m = if *value == 0 {
            [12.0, 12.0]
        } else {
            [36.0, 12.0]
        };
        way(&mut told(size_m, [2, *value], *seed), FROM, UNTIL)
    });
    let mut table = Table::new(["angle (deg, left is positive)", "radius (m)"]);
    for ((value, _), way) in jobs.iter().zip(&ways) {
        let angle = angle_deg(way);
        table.push(format!("value {value}"), [angle, radius_m(angle)]);
    }
    let mut plot = Plot::new("Ways of the car, seed 1", ["x (m)", "y (m)"]);
    let mut figures = Vec::new();
    for (value, report) in VALUES {
        let all = jobs.iter().zip(&ways).filter(|((of, _), _)| *of == value);
        let all: Vec<&Vec<Pose>> = all.map(|(_, way)| way).collect();
        if let [first, ..] = all[..] {
            let places = first.iter().map(|pose| [pose.x, pose.y]);
            plot = plot.line(format!("value {value}"), places);
        }
        let angle = Spread::of(all.iter().map(|way| angle_deg(way))).median;
        let side = if angle >= 0.0 { "left" } else { "right" };
        figures.push(Figure::new(
            format!("steering value {value}: angle of the wheels"),
            format!("{:.1} deg to the {side}", angle.abs()),
            report,
        ));
        if value == 0 {
            let radius = format!("{:.2} m", radius_m(angle));
            figures.push(Figure::new("steering value 0: radius", radius, ""));
        }
    }
    Findings {
        table,
        plot,
        figures,
    }
}

/// Angle of the front wheels that fits the observed motion, from length and turn of the rear axle's
/// path.
pub(in super::super) fn angle_deg(way: &[Pose]) -> f64 {
    let pairs = || way.windows(2).map(|pair| (pair[0], pair[1]));
    let turned: f64 = pairs()
        .map(|(one, next)| wrap_angle(next.theta - one.theta))
        .sum();
    let gone: f64 = pairs()
        .map(|(one, next)| one.point().distance(next.point()))
        .sum();
    libm::atan(WHEELBASE_M * turned / gone).to_degrees()
}

/// Radius of the path of the rear axle's middle.
fn radius_m(angle_deg: f64) -> f64 {
    WHEELBASE_M / libm::tan(angle_deg.to_radians()).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quarter of a circle of 2 m in 100 steps: the tangent is 0.258 / 2, the angle 7.35 degrees.
    #[test]
    fn an_angle_follows_from_way_and_turn() {
        let way = (0..=100).map(|step| {
            let turned = f64::from(step) / 100.0 * core::f64::consts::FRAC_PI_2;
            let (sin, cos) = libm::sincos(turned);
            Pose::new(2.0 * sin, 2.0 - 2.0 * cos, turned)
        });
        let angle = angle_deg(&way.collect::<Vec<_>>());
        assert!((angle - 7.35).abs() < 0.01, "{angle}");
        assert!((radius_m(angle) - 2.0).abs() < 0.001);
    }
}
