//! Wheels that slip by different amounts, and a gyroscope that does not slip: the outlook of the
//! rescue robot's report.

use core::time::Duration;

use emulators::world::wrap_angle;
use firmware_core::robots::rescue::Rescue;
use protocols::Instant;

use super::runs::{FLAT, Spread, each, start};
use super::{Figure, Findings, Plan, Plot, Table};

/// The left wheel loses three per cent of its distance, the right one none; random slip affects
/// both.
const SLIP: &str = "\n[world.body]\nslip = [0.03, 0.0]\nslip_noise_m = 0.02\n";
const IMU: &str = "\n[device.base.avr-base]\nimu = true\n";
/// Interval of the heading checks, and their number.
const EVERY: Duration = Duration::from_secs(2);
const LOOKS: u32 = 45;

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let jobs: Vec<(bool, u64)> = [false, true]
        .into_iter()
        .flat_map(|has_imu| plan.seeds().map(move |seed| (has_imu, seed)))
        .collect();
    let errors = each(plan, &jobs, tell, |(has_imu, seed)| drive(*has_imu, *seed));
    let count = plan.count();
    let mut table = Table::new(["time (s)", "median (deg)", "worst (deg)"]);
    let mut plot = Plot::new(
        "Error of the dead-reckoned heading, wheels that slip",
        ["time (s)", "error (deg)"],
    );
    let mut rms = Vec::new();
    for (index, name) in ["wheels", "gyroscope"].into_iter().enumerate() {
        let runs = &errors[index * count..(index + 1) * count];
        let after = |look: usize| Spread::of(runs.iter().map(|run| run[look]));
        let time = |look: usize| (look as f64 + 1.0) * EVERY.as_secs_f64();
        for look in 0..LOOKS as usize {
            let spread = after(look);
            table.push(name, [time(look), spread.median, spread.worst]);
        }
        plot = plot.line(
            format!("{name}, median"),
            (0..LOOKS as usize).map(|look| [time(look), after(look).median]),
        );
        let of_run = |run: &Vec<f64>| {
            let squares = run.iter().map(|error| error * error).sum::<f64>();
            (squares / run.len() as f64).sqrt()
        };
        let each: Vec<f64> = runs.iter().map(of_run).collect();
        rms.push(each);
    }
    let [wheels, gyro] = [&rms[0], &rms[1]].map(|each| Spread::of(each.iter().copied()));
    let ratios = Spread::of(
        rms[1]
            .iter()
            .zip(&rms[0])
            .map(|(with, without)| with / without),
    );
    let shown = |spread: Spread| format!("{:.2} deg, worst {:.2}", spread.median, spread.worst);
    let figures = vec![
        Figure::new("wheels alone: median RMS error", shown(wheels), ""),
        Figure::new("with the gyroscope: median RMS error", shown(gyro), ""),
        Figure::new(
            "ratio, median",
            format!("{:.3}, worst {:.3}", ratios.median, ratios.worst),
            "",
        ),
    ];
    Findings {
        table,
        plot,
        figures,
    }
}

/// Heading error of the odometry alone, every two seconds, degrees.
fn drive(has_imu: bool, seed: u64) -> Vec<f64> {
    let more = if has_imu { IMU } else { "" };
    let mut run = start(&format!("{FLAT}{SLIP}{more}"), seed, |scenario| {
        scenario.mission.to_the_end = true;
    });
    let began = run.rig.world.pose().theta;
    let mut errors = Vec::new();
    for look in 1..=LOOKS {
        run.go_on_until(Instant::ZERO + EVERY * look);
        let program = run.rig.program_as::<Rescue>();
        let error = program
            .and_then(Rescue::dead_reckoned)
            .map(|(at, believed)| {
                let turned = run.rig.world.pose_at(at).theta - began;
                let error = wrap_angle(f64::from(believed.heading) - turned);
                error.to_degrees().abs()
            });
        errors.push(error.unwrap_or(f64::NAN));
    }
    errors
}
