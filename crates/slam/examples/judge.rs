//! Results of the mapper on logs whose poses another mapper corrected, and in generated buildings:
//! errors, false loops, warnings, the stated bound, and the processor time of a scan.
//!
//! ```text
//! cargo run --release -p hilrig-slam --example judge -- logs SEEDS FOLDER..
//! cargo run --release -p hilrig-slam --example judge -- buildings FIRST COUNT
//! cargo run --release -p hilrig-slam --example judge -- troubled FIRST COUNT SEED..
//! cargo run --release -p hilrig-slam --example judge -- turned DEGREES SEED..
//! ```
//!
//! A seed above 0 changes each range by up to 5 mm, within the resolution of the logs. The error is
//! the mean distance to the corrected poses, or to the true ones, after the best rigid alignment.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use emulators::rng::Rng;
use emulators::world::{Pose, wrap_angle};
use hilrig_slam::mapping::building::Building;
use hilrig_slam::mapping::motion::{aligned_m, between, distance, moved};
use hilrig_slam::mapping::{Edge, Kind, Mapper, Settings, Shot};
use hilrig_slam::{Log, carmen};
use realtime::clock::thread_cpu_time;

/// Error above which a loop is false, metres and radians.
const FALSE_M: f64 = 0.5;
const FALSE_RAD: f64 = 0.1;
/// Error above which the mapper fails, as a part of the path.
const FAILS: f64 = 0.005;
/// Change of a range, metres.
const DITHER_M: f64 = 0.005;

/// One scan of an input.
struct Scan {
    moved: Pose,
    is_measured: bool,
    ends: Vec<[f32; 2]>,
    truth: Option<Pose>,
}

/// The result for one input.
struct Result {
    name: String,
    way_m: f64,
    off_m: f64,
    wheels_m: f64,
    bound_m: Option<f64>,
    from_wheels_m: Option<f64>,
    may_be_worse: bool,
    parts: usize,
    doubt: f64,
    joins: usize,
    far_jumps: usize,
    false_loops: usize,
    loops: usize,
    /// Processor time of all scans, s; of a scan in the median, at 99 % and at most, us.
    cpu_s: f64,
    scan_us: [f64; 3],
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let number = |at: usize| words.get(at).and_then(|word| word.parse().ok());
    let results: Vec<Result> = match words.first().map(String::as_str) {
        Some("logs") => logs(number(1).unwrap_or(1), &words[2..]),
        Some(kind @ ("buildings" | "troubled")) => {
            let (first, count) = (number(1).unwrap_or(0), number(2).unwrap_or(20));
            let chosen: Vec<u64> = words[3.min(words.len())..]
                .iter()
                .filter_map(|word| word.parse().ok())
                .collect();
            (first..first + count)
                .chain(chosen)
                .map(|seed| in_building(seed, kind == "troubled"))
                .collect()
        }
        Some("turned") => {
            let degrees = number(1).unwrap_or(80);
            words[2..]
                .iter()
                .filter_map(|word| word.parse().ok())
                .map(|seed| turned(seed, degrees as f64))
                .collect()
        }
        _ => {
            eprintln!("expected logs, buildings or troubled; see the head of examples/judge.rs");
            return ExitCode::from(2);
        }
    };
    summarise(&results);
    ExitCode::SUCCESS
}

fn logs(seeds: u64, folders: &[String]) -> Vec<Result> {
    let mut paths: Vec<PathBuf> = Vec::new();
    for folder in folders {
        let folder = Path::new(folder);
        match std::fs::read_dir(folder) {
            Ok(entries) => paths.extend(entries.flatten().map(|entry| entry.path())),
            Err(_) => paths.push(folder.to_owned()),
        }
    }
    paths.retain(|path| path.to_string_lossy().ends_with(".log.gz"));
    paths.sort();
    let mut results = Vec::new();
    for path in paths {
        let text = unpacked(&path);
        let truth = corrected(&text);
        let log = carmen::read(&text).expect("a log of CARMEN");
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let name = name.replace("-corrected.log.gz", "");
        let first = results.len();
        for seed in 0..seeds {
            let scans = of_log(&log, &truth, seed);
            results.push(judged(format!("{name} {seed}"), Pose::default(), &scans));
        }
        let mut off: Vec<f64> = results[first..].iter().map(|one| one.off_m).collect();
        off.sort_by(f64::total_cmp);
        let (least, most) = (off[0], off[off.len() - 1]);
        let median = off[off.len() / 2];
        println!("{name}: median {median:.3} m, {least:.3}..{most:.3}");
    }
    results
}

fn unpacked(path: &Path) -> Vec<u8> {
    let packed = std::fs::read(path).expect("a readable file");
    let mut text = Vec::new();
    let mut reader = flate2::read::GzDecoder::new(&packed[..]);
    reader.read_to_end(&mut text).expect("a whole file");
    text
}

/// The corrected poses by time, or by number if the times are all alike.
fn corrected(text: &[u8]) -> Vec<(f64, Pose)> {
    let mut all: Vec<(f64, Pose)> = Vec::new();
    for line in String::from_utf8_lossy(text).lines() {
        let fields: Vec<&str> = line.split_whitespace().collect();
        if fields.first() != Some(&"FLASER") {
            continue;
        }
        let number = |back: usize| fields[fields.len() - back].parse().unwrap_or(f64::NAN);
        all.push((number(3), Pose::new(number(9), number(8), number(7))));
    }
    let mut stamps: Vec<u64> = all.iter().map(|(at, _)| at.to_bits()).collect();
    stamps.sort_unstable();
    stamps.dedup();
    if stamps.len() * 10 < all.len() * 9 {
        for (number, one) in all.iter_mut().enumerate() {
            one.0 = number as f64;
        }
    }
    all
}

#[expect(clippy::cast_possible_truncation, reason = "metres of a building")]
fn of_log(log: &Log, truth: &[(f64, Pose)], seed: u64) -> Vec<Scan> {
    let mut rng = Rng::stream(seed, "judge.dither");
    let scans = log.shots.iter().map(|shot| Scan {
        moved: shot.moved,
        is_measured: shot.is_measured,
        ends: shot
            .points
            .iter()
            .map(|point| {
                let [x, y] = [point.x_mm, point.y_mm].map(|mm| f64::from(mm) / 1000.0);
                let range = libm::hypot(x, y).max(0.01);
                let by = rng.range(-DITHER_M, DITHER_M);
                let part = if seed > 0 { 1.0 + by / range } else { 1.0 };
                [(x * part) as f32, (y * part) as f32]
            })
            .collect(),
        truth: truth
            .iter()
            .find(|(at, _)| (at - shot.at_s).abs() < 1e-6)
            .map(|(_, pose)| *pose),
    });
    scans.collect()
}

fn in_building(seed: u64, has_troubles: bool) -> Result {
    let building = if has_troubles {
        Building::troubled(seed)
    } else {
        Building::generate(seed)
    };
    let start = building.sights[0].truth;
    let name = format!("{seed} {}", building.troubles.join("+"));
    let scans: Vec<Scan> = building
        .sights
        .into_iter()
        .map(|sight| Scan {
            moved: sight.moved,
            is_measured: true,
            ends: sight.ends,
            truth: Some(sight.truth),
        })
        .collect();
    judged(name, start, &scans)
}

/// A building in which the robot is turned, unseen, after three tenths of its path.
#[expect(clippy::cast_possible_truncation, reason = "metres of a building")]
fn turned(seed: u64, degrees: f64) -> Result {
    let building = Building::generate(seed);
    let at = building.sights.len() * 3 / 10;
    let back = Pose::new(0.0, 0.0, -degrees.to_radians());
    let scans: Vec<Scan> = building
        .sights
        .iter()
        .enumerate()
        .map(|(number, sight)| {
            let place = |end: &[f32; 2]| {
                let end = Pose::new(f64::from(end[0]), f64::from(end[1]), 0.0);
                let end = moved(back, end);
                [end.x as f32, end.y as f32]
            };
            let by = moved(back, Pose::new(sight.moved.x, sight.moved.y, 0.0));
            let is_turned = number >= at;
            Scan {
                moved: if number > at {
                    Pose::new(by.x, by.y, sight.moved.theta)
                } else {
                    sight.moved
                },
                is_measured: true,
                ends: if is_turned {
                    sight.ends.iter().map(place).collect()
                } else {
                    sight.ends.clone()
                },
                truth: Some(Pose {
                    theta: sight.truth.theta + if is_turned { degrees.to_radians() } else { 0.0 },
                    ..sight.truth
                }),
            }
        })
        .collect();
    judged(
        format!("{seed} turned {degrees}"),
        building.sights[0].truth,
        &scans,
    )
}

fn judged(name: String, start: Pose, scans: &[Scan]) -> Result {
    let mut mapper = Mapper::new(Settings {
        start,
        ..Settings::default()
    });
    let mut took: Vec<f64> = Vec::with_capacity(scans.len());
    let now = || thread_cpu_time().unwrap_or_default();
    let began = now();
    let (mut here, mut far_jumps) = (None, 0);
    for scan in scans {
        let before = now();
        let outcome = mapper.take(&Shot {
            moved: scan.moved,
            is_measured: scan.is_measured,
            ends: &scan.ends,
        });
        let wheels = here.map_or(outcome.pose, |here| moved(here, scan.moved));
        far_jumps += usize::from(distance(outcome.pose, wheels) > 0.5);
        here = Some(outcome.pose);
        took.push((now() - before).as_secs_f64() * 1e6);
    }
    mapper.finish();
    let cpu_s = (now() - began).as_secs_f64();
    took.sort_by(f64::total_cmp);
    let part = |share: usize| took[(took.len() - 1) * share / 100];
    let way = mapper.way();
    let pairs = |way: &[Pose]| -> (Vec<Pose>, Vec<Pose>) {
        let both = scans.iter().zip(way);
        both.filter_map(|(scan, pose)| Some((scan.truth?, *pose)))
            .unzip()
    };
    let off = |way: &[Pose]| {
        let (truth, way) = pairs(way);
        aligned_m(&truth, &way)
    };
    let numbers = mapper.scans();
    let is_false = |edge: &&Edge| {
        let truth = [edge.from, edge.to].map(|key| scans[numbers[key]].truth);
        edge.kind == Kind::Loop
            && matches!(truth, [Some(from), Some(to)] if contradicts(edge, between(from, to)))
    };
    let edges = &mapper.graph().edges;
    let accuracy = mapper.accuracy();
    let way_m: f64 = scans
        .windows(2)
        .filter_map(|two| Some(between(two[0].truth?, two[1].truth?)))
        .map(|by| libm::hypot(by.x, by.y))
        .sum();
    let result = Result {
        name,
        way_m,
        off_m: off(&way),
        wheels_m: off(mapper.way_by_wheels()),
        bound_m: accuracy.as_ref().map(|known| known.bound_m),
        from_wheels_m: accuracy.as_ref().and_then(|known| known.from_wheels_m),
        may_be_worse: accuracy
            .as_ref()
            .is_some_and(|known| known.may_be_worse_than_wheels()),
        parts: mapper.parts().unwrap_or(0),
        doubt: mapper.doubt().unwrap_or(-1.0),
        joins: mapper.unsure_joins(),
        far_jumps,
        false_loops: edges.iter().filter(is_false).count(),
        loops: edges.iter().filter(|edge| edge.kind == Kind::Loop).count(),
        cpu_s,
        scan_us: [part(50), part(99), part(100)],
    };
    tell(&result);
    result
}

/// Whether an edge contradicts the truth in a direction that it measures. Along a corridor it
/// measures nothing.
fn contradicts(edge: &Edge, truth: Pose) -> bool {
    let turn = wrap_angle(truth.theta - edge.way.theta);
    let off = [truth.x - edge.way.x, truth.y - edge.way.y, turn];
    let mut deviations = 0.0;
    for (row, a) in edge.information.iter().zip(off) {
        let by = row.iter().zip(off).map(|(value, b)| a * value * b);
        deviations += by.sum::<f64>();
    }
    deviations > 100.0 && (libm::hypot(off[0], off[1]) > FALSE_M || turn.abs() > FALSE_RAD)
}

fn tell(one: &Result) {
    let or_none = |of: Option<f64>| of.map_or("-".to_owned(), |of| format!("{of:.3}"));
    let [median, most, longest] = one.scan_us;
    println!(
        "{}: {:.0} m off {:.3} bound {} wheels {:.3} apart {} parts {} doubt {:.2} joins {} jumps \
         {} loops {} false \
         {} cpu {:.2} s scan {median:.0} {most:.0} {longest:.0} us{}",
        one.name,
        one.way_m,
        one.off_m,
        or_none(one.bound_m),
        one.wheels_m,
        or_none(one.from_wheels_m),
        one.parts,
        one.doubt,
        one.joins,
        one.far_jumps,
        one.loops,
        one.false_loops,
        one.cpu_s,
        if one.off_m > FAILS * one.way_m {
            " FAILED"
        } else {
            ""
        },
    );
}

fn summarise(results: &[Result]) {
    let is_warned = |one: &&Result| {
        one.parts > 1
            || one.joins > 0
            || one.bound_m.is_none_or(|bound| bound > FAILS * one.way_m)
            || one.may_be_worse
    };
    let count = |is: &dyn Fn(&&Result) -> bool| results.iter().filter(is).count();
    let is_known = |one: &&Result| one.bound_m.is_some();
    let known = count(&is_known);
    let within = count(&|one| one.bound_m.is_some_and(|bound| one.off_m <= bound));
    let has_failed = |one: &&Result| one.off_m > FAILS * one.way_m;
    let failed = count(&has_failed);
    let silent = count(&|one| has_failed(one) && !is_warned(one));
    let warned = count(&is_warned);
    let with_false = count(&|one| one.false_loops > 0);
    let silent_false = count(&|one| one.false_loops > 0 && !is_warned(one));
    let is_worse = |one: &&Result| one.off_m > 1.1 * one.wheels_m;
    let worse = count(&is_worse);
    let silent_worse = count(&|one| is_worse(one) && !is_warned(one));
    println!(
        "{} results, {warned} with a warning: {failed} off by more than 0.5 % of the way, {silent} \
         of them unwarned; {with_false} with false loops, {silent_false} unwarned; {worse} worse \
         than the wheels, {silent_worse} unwarned; {within} of {known} within the bound",
        results.len()
    );
    let mut ratios: Vec<f64> = results
        .iter()
        .filter_map(|one| Some(one.off_m / one.bound_m?))
        .collect();
    ratios.sort_by(f64::total_cmp);
    if let Some(last) = ratios.len().checked_sub(1) {
        let at = |share: usize| ratios[last * share / 100];
        println!(
            "error by bound: 10 % {:.2}, 50 % {:.2}, 75 % {:.2}, 90 % {:.2}, 95 % {:.2}, \
             most {:.2}",
            at(10),
            at(50),
            at(75),
            at(90),
            at(95),
            at(100)
        );
    }
}
