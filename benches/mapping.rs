//! How accurate are the mappers on the public Intel Lab log, and what do they cost? Compared are
//! the one that closes loops, the robot's own, and tinySLAM's search as published. The latter is
//! random, so nine seeds are run, as for BreezySLAM (median 0.311 m at 25 mm cells, 0.085 m at 50
//! mm, 2.2 s to 2.4 s; with the setting of 5 degrees 0.077 m).
//!
//! Measured: closing loops 0.061 m, the robot's own 0.064 m; tinySLAM at 25 mm 5.4 m in the median
//! of nine seeds [0.46..8.8], at 50 mm 0.141 m [0.082..4.8].
//!
//! Prints mean errors of 2,984 relations (Kuemmerle et al. 2009), metres, and processor time. The
//! data must lie beside the repository; if it is missing, the bench says so.

use firmware_core::slam::{Mode, Settings};
use hilrig::realtime::clock::WallClock;
use hilrig::slam::carmen;
use hilrig::slam::survey::{CELL_MM, Survey, settings, survey};
use hilrig::slam::tour::{Wish, tour};
use lab::{SHIFT_S, data, wheels};
use relations::{Track, judge};

#[expect(dead_code, reason = "shared with the tests that read captures")]
#[path = "../tests/support/captures.rs"]
mod captures;
#[path = "../tests/slam/lab.rs"]
mod lab;
#[expect(dead_code, reason = "shared with the tests, which look at more")]
#[path = "../tests/slam/relations.rs"]
mod relations;

/// Number of random runs.
const SEEDS: u64 = 9;

fn main() {
    let Some((text, relations)) = data() else {
        return;
    };
    let log = carmen::read(&text).expect("a good log");
    let wheels = wheels(&text);
    let tell = |name: &str, surveys: &[Survey]| {
        let mut metres: Vec<f64> = surveys
            .iter()
            .map(|one| judge(&Track::new(one.way.clone()), &wheels, &relations, SHIFT_S).mean_m)
            .collect();
        metres.sort_by(f64::total_cmp);
        let cpu_s = surveys.iter().filter_map(|one| one.cpu);
        let cpu_s = cpu_s.map(|cpu| cpu.as_secs_f64()).fold(f64::MAX, f64::min);
        let (least, most) = (metres[0], metres[metres.len() - 1]);
        let median = metres[metres.len() / 2];
        println!("{name:<24} {median:.3} m [{least:.3}..{most:.3}]   {cpu_s:.2} s");
    };
    let clock = WallClock::start();
    tell(
        "closing loops",
        &[tour(&log, &Wish::default(), &clock, &mut |_| {})],
    );
    let core = survey(&log, settings(Mode::Core, CELL_MM), &clock, &mut |_| {});
    tell("the robot's own", &[core]);
    for cell_mm in [25.0, 50.0] {
        let drawn = (1..=SEEDS).map(|seed| {
            let settings = Settings {
                seed,
                ..settings(Mode::Document, cell_mm)
            };
            survey(&log, settings, &clock, &mut |_| {})
        });
        let drawn: Vec<Survey> = drawn.collect();
        tell(&format!("tinySLAM, {cell_mm} mm, {SEEDS} seeds"), &drawn);
    }
}
