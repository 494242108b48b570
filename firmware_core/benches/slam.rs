//! What does a scan cost the mapper? One evaluation, one search and one map update, in both modes,
//! on a scan of the furnished flat after its tour, beside the goals. Figures to beat: the seed's
//! own code 520 ns for 36 points and 61.9 us for 360 rays; another tinySLAM 123 to 203 ns and 140
//! us (x86-64).
//!
//! Processor time of this thread, so that other work on the machine has little influence: the
//! minimum and the median of 300 batches.

#![expect(
    clippy::cast_possible_truncation,
    reason = "the figures of a small world are small"
)]

use core::hint::black_box;
use core::time::Duration;

use firmware_core::pose::Pose;
use firmware_core::scan::Scan;
use firmware_core::slam::{Budget, Mapper, Search, Settings};
use rustix::time::{ClockId, clock_gettime};

use measure::Run;
use world::{FLAT_TOUR, World, flat};

#[expect(dead_code, reason = "shared with the stories")]
#[path = "../tests/mapping/measure.rs"]
mod measure;
#[path = "../tests/mapping/world.rs"]
mod world;

const BATCHES: usize = 300;
/// A batch is this long at least: the clock takes part of a microsecond to read.
const BATCH: Duration = Duration::from_micros(200);

/// Nanoseconds that `work` takes: the least and the median.
fn measured<R>(mut work: impl FnMut() -> R) -> [f64; 2] {
    let cpu_time = || {
        let now = clock_gettime(ClockId::ThreadCPUTime);
        Duration::try_from(now).expect("it began at zero")
    };
    let mut batch = |count: u32| {
        let begin = cpu_time();
        for _ in 0..count {
            black_box(work());
        }
        cpu_time() - begin
    };
    let mut count = 1;
    while batch(count) < BATCH {
        count *= 2;
    }
    let mut took: Vec<Duration> = (0..BATCHES).map(|_| batch(count)).collect();
    took.sort();
    [took[0], took[BATCHES / 2]].map(|took| took.as_secs_f64() * 1e9 / f64::from(count))
}

/// Prints a line of the table: `times`, in nanoseconds, are divided by `parts`.
fn print(what: &str, times: [f64; 2], parts: f64, (unit, of_unit): (&str, f64), goal: &str) {
    let [least, median] = times.map(|time| time / parts / of_unit);
    println!("{what:<64} {least:>8.3} {median:>8.3} {unit:<3} {goal}");
}

const NS: (&str, f64) = ("ns", 1.0);
const US: (&str, f64) = ("us", 1e3);
const MS: (&str, f64) = ("ms", 1e6);

/// With the robot's own map, also where another size is built.
type RobotMapper = Box<Mapper<300, 300>>;

/// A mapper that has seen the flat, and one more scan from where it stands.
fn toured(settings: Settings) -> (RobotMapper, Scan) {
    let start = [1000.0, 1000.0, core::f64::consts::FRAC_PI_2];
    let mut run: Run = Run::new(World::new(flat(), start, 1), settings);
    run.tour(&FLAT_TOUR);
    run.stop();
    run.world.turn();
    let scan = run.world.scan();
    (run.mapper, scan)
}

/// Tries of the document's search, each with drawing its candidate.
fn evaluations(points: u16, goal: &str) {
    let budget = Budget {
        start: 1000,
        ..Budget::DOCUMENT
    };
    let search = Search {
        points,
        ..Settings::document().search
    };
    let (mut mapper, scan) = toured(Settings {
        budget,
        search,
        ..Settings::document()
    });
    while mapper.tries() < 1000 {
        mapper.search_time(Duration::ZERO);
    }
    let pose = mapper.pose();
    let mut locate = || {
        mapper.set_pose(pose);
        mapper.locate(black_box(&scan))
    };
    let tries = f64::from(locate().tries);
    let times = measured(locate);
    let what = format!("document: one evaluation of {points} points (of {tries})");
    print(&what, times, tries, NS, goal);
}

fn updates(mode: &str, settings: Settings, goal: &str) {
    let (mut mapper, scan) = toured(settings);
    let times = measured(|| mapper.draw(black_box(&scan), [0, 0]));
    let what = format!("{mode}: map update of {} rays", scan.points().len());
    print(&what, times, 1.0, US, goal);
}

fn tracking() {
    let (mut mapper, scan) = toured(Settings::default());
    let pose = mapper.pose();
    let mut locate = || {
        mapper.set_pose(pose);
        mapper.locate(black_box(&scan))
    };
    let poses = locate().poses;
    let times = measured(locate);
    let what = format!("core: search of {poses} poses and refinement");
    print(&what, times, 1.0, US, "");
}

/// The largest search that a window allows, as by a robot without encoder readings: 180 points, 12
/// cells of 35 mm and 12 degrees to each side, 30,625 poses. The figures include refinement and the
/// choice of the best pose, also that per look-up.
fn exhaustive() {
    let search = Search {
        points: 180,
        ..Settings::default().search
    };
    let settings = Settings {
        search,
        resolution_mm: 35.0,
        ..Settings::core(35.0)
    };
    let (at_edge, scan) = toured(settings);
    // The same place in the middle of another map.
    let middle = Pose::new(5250.0, 5250.0, at_edge.pose().heading);
    let mut in_middle: RobotMapper = Box::new(Mapper::new(Settings {
        start: middle,
        ..settings
    }));
    for _ in 0..20 {
        in_middle.draw(&scan, [0, 0]);
    }
    for (mut mapper, place) in [(in_middle, "map's middle"), (at_edge, "map's corner")] {
        let pose = mapper.pose();
        let mut look = || {
            mapper.set_pose(pose);
            mapper.doubt(120.0, 4.5_f32.to_radians());
            mapper.locate(black_box(&scan))
        };
        let poses = look().poses;
        let times = measured(look);
        let what = format!("core: exhaustive search of {poses} poses, 180 points, {place}");
        print(&what, times, 1.0, MS, "(0.25 for 26000)");
        let lookups = f64::from(poses) * 180.0;
        print(
            "core: a look-up of that search",
            times,
            lookups,
            NS,
            "(0.04)",
        );
    }
}

fn main() {
    println!(
        "{:<64} {:>8} {:>8}     goal",
        "processor time", "least", "median"
    );
    evaluations(36, "(60)");
    evaluations(360, "");
    updates("document", Settings::document(), "(40)");
    tracking();
    updates("core", Settings::default(), "(40)");
    exhaustive();
}
