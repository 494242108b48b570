//! A drive along a wall at 0.40 m distance. The report dropped the integral part of its controller,
//! because it had no visible effect.

use core::time::Duration;

use firmware_core::robots::apollo13::Apollo13;
use firmware_core::robots::apollo13::wall::Gains;

use super::super::runs::{Spread, each, start};
use super::super::{Figure, Findings, Plan, Plot, Table};
use super::{EVERY, way};

/// The corridor, and a start 0.60 m from the wall.
const SCENARIO: &str = include_str!("../../../scenarios/apollo13-wall.toml");
/// Gain on the integral of the distance error, rad/(m s). The report has no figure.
const INTEGRAL: f64 = 0.01;
/// Times at which control begins and at which the car has settled, and the last check before the
/// end of the corridor.
const FROM: Duration = Duration::from_secs(1);
const SETTLED: Duration = Duration::from_secs(9);
const UNTIL: Duration = Duration::from_secs(34);
/// Position of the sensor: metres ahead and to the right of the rear axle's middle.
const SENSOR_M: [f64; 2] = [0.304, 0.1];
const WANTED_M: f64 = 0.40;

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let seeds: Vec<u64> = (1..=plan.seeds).collect();
    let runs = each(plan, &seeds, tell, |seed| {
        [0.0, INTEGRAL].map(|integral| distances_m(integral, *seed))
    });
    let first = settled();
    let mm = |rms_m: f64| 1e3 * rms_m;
    let off = |distances: &[f64]| mm(rms(distances[first..].iter().map(|it| it - WANTED_M)));
    let apart = |[without, with]: &[Vec<f64>; 2]| {
        let pairs = without.iter().zip(with);
        mm(rms(pairs.map(|(one, other)| one - other)))
    };
    let mut table = Table::new(["PD, rms (mm)", "PID, rms (mm)", "difference, rms (mm)"]);
    for (seed, run) in seeds.iter().zip(&runs) {
        let row = [off(&run[0]), off(&run[1]), apart(run)];
        table.push(format!("seed {seed}"), row);
    }
    let plot = plot(runs.first().map_or(&[][..], |run| &run[..]));
    let spread = |of: &dyn Fn(&[Vec<f64>; 2]) -> f64| {
        let spread = Spread::of(runs.iter().map(of));
        format!("{:.1} mm, at most {:.1}", spread.median, spread.worst)
    };
    let figures = vec![
        Figure::new(
            "PD: rms off 0.40 m once settled, median",
            spread(&|run| off(&run[0])),
            "",
        ),
        Figure::new(
            "PID: rms off 0.40 m once settled, median",
            spread(&|run| off(&run[1])),
            "",
        ),
        Figure::new(
            "difference between the two, rms, median",
            spread(&apart),
            "no visible effect",
        ),
    ];
    Findings {
        table,
        plot,
        figures,
    }
}

fn plot(run: &[Vec<f64>]) -> Plot {
    let plot = Plot::new("Distance to the wall, seed 1", ["time (s)", "distance (m)"]);
    let time = |look: usize| FROM.as_secs_f64() + look as f64 * EVERY.as_secs_f64();
    let curves = ["PD", "PID"].into_iter().zip(run);
    curves.fold(plot, |plot, (name, distances)| {
        let places = distances.iter().enumerate();
        plot.line(name, places.map(|(look, it)| [time(look), *it]))
    })
}

/// Index of the first check of a settled car.
pub(in super::super) fn settled() -> usize {
    let looks = (SETTLED - FROM).as_millis() / EVERY.as_millis();
    usize::try_from(looks).unwrap_or_default()
}

/// The sensor's distance to the wall at y = 0.
pub(in super::super) fn distances_m(integral: f64, seed: u64) -> Vec<f64> {
    let mut run = start(SCENARIO, seed, |scenario| {
        scenario.mission.to_the_end = true;
    });
    if let Some(program) = run.rig.program_as_mut::<Apollo13>() {
        program.set_wall_gains(Gains {
            integral,
            ..Gains::default()
        });
    }
    let [ahead, right] = SENSOR_M;
    let way = way(&mut run, FROM, UNTIL);
    way.iter()
        .map(|pose| pose.offset(ahead, -right).y)
        .collect()
}

fn rms(errors: impl Iterator<Item = f64>) -> f64 {
    let (count, squares) = errors.fold((0.0, 0.0), |(count, squares), error| {
        (count + 1.0, squares + error * error)
    });
    f64::sqrt(squares / f64::max(count, 1.0))
}
