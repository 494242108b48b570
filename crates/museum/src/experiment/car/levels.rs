//! The motor's levels; the report measured level 2 ahead and level -3 back.

use core::time::Duration;

use super::super::runs::{Spread, each};
use super::super::{Figure, Findings, Plan, Plot, Table};
use super::{jobs, told, way};

/// The fastest level in both directions.
const LEVEL_MAX: i8 = 10;
/// Steering value closest to straight ahead.
const STRAIGHT: i8 = 8;
/// Interval of the measurement; at its beginning, the car has reached its speed.
const FROM: Duration = Duration::from_secs(4);
const UNTIL: Duration = Duration::from_secs(7);

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let levels: Vec<i8> = (-LEVEL_MAX..=LEVEL_MAX).collect();
    let jobs = jobs(&levels, plan);
    let found = each(plan, &jobs, tell, |(level, seed)| speed_cm_s(*level, *seed));
    let speeds = |level: i8| {
        let of_level = jobs
            .iter()
            .zip(&found)
            .filter(move |((of, _), _)| *of == level);
        Spread::of(of_level.map(|(_, speed)| *speed))
    };
    let mut table = Table::new(["speed, median (cm/s)", "lower quartile", "upper quartile"]);
    for &level in &levels {
        let Spread {
            median,
            quartiles: [lower, upper],
            ..
        } = speeds(level);
        table.push(format!("level {level}"), [median, lower, upper]);
    }
    let medians = levels
        .iter()
        .map(|level| [f64::from(*level), speeds(*level).median]);
    let plot = Plot::new("Speed of the car", ["motor level", "speed (cm/s)"])
        .line("rig, median", medians)
        .points("report", [[2.0, 22.0], [-3.0, -22.0]]);
    let figure = |level: i8, report| {
        let median = speeds(level).median;
        Figure::new(
            format!("level {level}"),
            format!("{median:.1} cm/s"),
            report,
        )
    };
    let figures = vec![
        figure(2, "+22 cm/s"),
        figure(-3, "-22 cm/s"),
        figure(-2, "does not move"),
        figure(LEVEL_MAX, ""),
        figure(-LEVEL_MAX, ""),
    ];
    Findings {
        table,
        plot,
        figures,
    }
}

/// Speed in cm/s; positive is ahead.
fn speed_cm_s(level: i8, seed: u64) -> f64 {
    let mut run = told([22.0, 8.0], [level, STRAIGHT], seed);
    let way = way(&mut run, FROM, UNTIL);
    let ahead = way.windows(2).map(|pair| {
        let (sin, cos) = libm::sincos(pair[0].theta);
        (pair[1].x - pair[0].x) * cos + (pair[1].y - pair[0].y) * sin
    });
    100.0 * ahead.sum::<f64>() / (UNTIL - FROM).as_secs_f64()
}
