//! How many cases a second does one core try, without a sanitizer? A case is judged, not only
//! decoded: by every law of the wire, or by every checker of a run.
//!
//! Each figure is the median of some rounds, in processor time of one thread, so that other work on
//! the host has little influence. `cargo bench --bench fuzz` ends with exit code 1 if a goal is
//! missed; under `cargo test` everything runs once and nothing is judged.

use core::hint::black_box;
use core::time::Duration;
use std::path::Path;
use std::process::ExitCode;

use hilrig::codec::wire::{Stream, Target, Wire};
use hilrig::codec::{self, Avr, LowFirst, Pcui, Xv11};
use hilrig::run::Run;
use hilrig::scenario::{Scenario, Span};
use hilrig::search::fuzz::{Behaviour, programs};
use rustix::time::{ClockId, clock_gettime};

/// Number of rounds per figure, and minimum duration of a round.
const ROUNDS: usize = 7;
const ROUND: Duration = Duration::from_millis(200);

/// Numbers as from a fuzzer, different for each `seed`.
fn numbers(seed: u64, count: usize) -> Vec<u8> {
    let mut rng = emulators::rng::Rng::stream(seed, "bench");
    let words = (0..count.div_ceil(8)).flat_map(|_| rng.next_u64().to_le_bytes());
    words.take(count).collect()
}

fn target(name: &str) -> &'static Target {
    codec::target(name).expect("listed")
}

fn cpu_time() -> Duration {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    Duration::try_from(now).expect("it began at zero")
}

/// The state of the measurement.
struct Bench {
    is_bench: bool,
    all_kept: bool,
}

impl Bench {
    /// Prints the number of `cases` tried per second, beside `goal`.
    fn measure(&mut self, name: &str, goal: Option<u32>, mut cases: impl FnMut() -> u32) {
        if !self.is_bench {
            cases();
            return;
        }
        let mut rates = [(); ROUNDS].map(|()| {
            let (begun, mut tried) = (cpu_time(), 0);
            while cpu_time() - begun < ROUND {
                tried += cases();
            }
            f64::from(tried) / (cpu_time() - begun).as_secs_f64()
        });
        rates.sort_by(f64::total_cmp);
        let rate = rates[ROUNDS / 2];
        let verdict = match goal {
            None => String::new(),
            Some(goal) if rate >= f64::from(goal) => format!(", goal {goal}: ok"),
            Some(goal) => {
                self.all_kept = false;
                format!(", goal {goal}: NOT")
            }
        };
        println!("{name:<36} {rate:>10.0}/s{verdict}");
    }
}

/// Single packets: valid ones, and ones with a bit wrong.
fn packets(bench: &mut Bench) {
    let target = target("xv11");
    let valid: Vec<_> = (0..64)
        .map(|seed| [&[0, 0][..], &numbers(seed, 18)].concat())
        .collect();
    let damaged: Vec<_> = valid
        .iter()
        .zip(0..)
        .map(|(valid, at)| [&valid[..], &[13, at % 22, at]].concat())
        .collect();
    let goal = Some(1_000_000);
    for (name, pool) in [
        ("one xv11 packet", valid),
        ("one damaged xv11 packet", damaged),
    ] {
        bench.measure(name, goal, || {
            pool.iter().for_each(|data| target.fuzz(black_box(data)));
            64
        });
    }
}

/// 64 valid frames, one behind the other.
fn session<W: Wire>(seed: u64, frame: usize) -> Vec<u8> {
    let numbers = numbers(seed, 64 * frame);
    let frames = numbers
        .chunks(frame)
        .flat_map(|choices| [&[0], choices].concat());
    let data: Vec<u8> = [0].into_iter().chain(frames).collect();
    let stream = Stream::session::<W>(&data);
    assert!(stream.bytes().len() >= 64 * 5, "{}", stream.bytes().len());
    data
}

fn sessions(bench: &mut Bench) {
    let pool = |make: fn(u64) -> Vec<u8>| (0..16).map(make).collect::<Vec<_>>();
    for (name, pool) in [
        ("xv11", pool(|seed| session::<Xv11>(seed, 18))),
        (
            "avr-low-first",
            pool(|seed| session::<Avr<LowFirst>>(seed, 12)),
        ),
        ("pcui", pool(|seed| session::<Pcui>(seed, 20))),
    ] {
        let target = target(name);
        let name = format!("a session of 64 frames of {name}");
        bench.measure(&name, Some(20_000), || {
            pool.iter().for_each(|data| target.fuzz(black_box(data)));
            16
        });
    }
}

/// A session of frames and pauses, some seconds of virtual time, for a whole program.
fn programs_on_a_bench(bench: &mut Bench) {
    for subject in programs(&[]).expect("without a defect") {
        let pool: Vec<_> = (0..16).map(|seed| numbers(seed, 200)).collect();
        let name = format!("a session of the program {}", subject.name());
        bench.measure(&name, None, || {
            for choices in &pool {
                let judged = subject.run(black_box(choices), &mut Behaviour::default());
                judged.expect("it is sound");
            }
            16
        });
    }
}

/// Five seconds of the whole rescue robot in the empty room: world, lidar, base, radio, PC,
/// mapping, all checkers.
fn scenarios(bench: &mut Bench) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios/empty-room.toml");
    let (mut scenario, source) = Scenario::read(&path).expect("shipped");
    scenario.duration = Span::from_millis(5000);
    bench.measure("5 seconds of a scenario", Some(60), || {
        let run = Run::new(scenario.clone(), &source, None).expect("can be wired");
        black_box(run.finish().violations);
        1
    });
}

fn main() -> ExitCode {
    let is_bench = std::env::args().any(|argument| argument == "--bench");
    let mut bench = Bench {
        is_bench,
        all_kept: true,
    };
    packets(&mut bench);
    sessions(&mut bench);
    programs_on_a_bench(&mut bench);
    scenarios(&mut bench);
    if bench.all_kept {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}
