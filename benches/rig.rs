//! How many simulated seconds does one second of computing give? The whole loop of the demo: lidar,
//! base, radio and PC, without faults, with checkers, the robot's program with its mapping; the
//! same for every robot. What does the capture cost? And how much do checkpoints save in a search?
//!
//! Criterion prints the rate in "elements": simulated milliseconds per second; divide by 1000 for
//! the factor over real time. One thread. The rates of the robots are in processor time, so they
//! are valid on a busy host, too.

use std::path::Path;

use core::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use emulators::world::World;
use emulators::{Device, Event};
use hilrig::capture::{Capture, Limits, Recording, about};
use hilrig::realtime::clock::{Clock, WallClock};
use hilrig::rig::bare;
use hilrig::rig::line::End;
use hilrig::run::Run;
use hilrig::run::check::Status;
use hilrig::scenario::Scenario;
use hilrig::search::shrink::{self, Branches, Effort, Judged};
use protocols::{Instant, LineConfig, Port};
use rustix::time::{ClockId, clock_gettime};

const CAPTURE: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/bench.pcapng");

/// A run of a shipped scenario.
fn shipped(name: &str) -> Run {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("scenarios/{name}.toml"));
    let (scenario, source) = Scenario::read(&path).expect("shipped");
    Run::new(scenario, &source, None).expect("can be wired")
}

fn flat() -> Run {
    shipped("rescue-flat")
}

fn captured() -> Run {
    let mut run = flat();
    let about = about(run.scenario());
    let recording = Recording::create(Path::new(CAPTURE), &run.rig, about, Limits::default());
    run.rig
        .add_tap(Box::new(recording.expect("can be written")));
    run
}

fn whole_loop(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("rig");
    let sim = flat().finish().ran;
    group.throughput(Throughput::Elements(
        u64::try_from(sim.as_millis()).expect("a minute"),
    ));
    group.sample_size(10);
    group.measurement_time(Duration::from_secs(5));
    group.bench_function("whole mission", |bencher| bencher.iter(|| flat().finish()));
    group.bench_function("whole mission, captured", |bencher| {
        bencher.iter(|| captured().finish());
    });
    group.finish();
}

/// Reads the capture of the whole mission: its blocks are slices of the read data, not copies.
fn reading_a_capture(criterion: &mut Criterion) {
    captured().finish();
    let bytes = std::fs::read(CAPTURE).expect("just written");
    let mut group = criterion.benchmark_group("capture");
    group.throughput(Throughput::Bytes(bytes.len() as u64));
    group.sample_size(20);
    group.bench_function("read", |bencher| bencher.iter(|| Capture::of(&bytes)));
    group.finish();
}

/// Missions of each robot. Yellow's must be 300 times as fast as real time.
const MISSIONS: [&str; 7] = [
    "rescue-flat",
    "yellow-reactive",
    "yellow-map",
    "yellow-alike",
    "yellow-lost-commands",
    "apollo13-goal",
    "apollo13-gates",
];

/// How much faster than real time is the whole loop of each robot? The fastest of several runs
/// counts.
fn every_robot(_: &mut Criterion) {
    let tries = if is_measured() { 5 } else { 1 };
    for name in MISSIONS {
        let rate = (0..tries).map(|_| {
            let run = shipped(name);
            let began = cpu_time(ClockId::ThreadCPUTime);
            let ran = run.finish().ran;
            ran.as_secs_f64() / (cpu_time(ClockId::ThreadCPUTime) - began).as_secs_f64()
        });
        let rate = rate.fold(0.0, f64::max);
        println!("{name}: {rate:.0} times real time, best of {tries}");
    }
}

/// Whether this is a measurement, not a test run of the benches.
fn is_measured() -> bool {
    std::env::args().any(|arg| arg == "--bench")
}

/// Processor time so far, of this thread or of all threads.
fn cpu_time(clock: ClockId) -> Duration {
    Duration::try_from(clock_gettime(clock)).expect("it began at zero")
}

/// What does the capture cost? Runs with and without it alternate, so that both see the same host;
/// the fastest of each are compared, because other work on the host only adds time. The time of the
/// run's own thread is the duration on a host with a spare processor for the writer, even a busy
/// one; the time of all threads is the total cost.
fn cost_of_capture(_: &mut Criterion) {
    let pairs = if is_measured() { 30 } else { 1 };
    let time = |run: fn() -> Run| {
        let run = run();
        let clocks = [ClockId::ThreadCPUTime, ClockId::ProcessCPUTime];
        let (clock, cpu) = (WallClock::start(), clocks.map(cpu_time));
        run.finish();
        let [own, all] = clocks.map(cpu_time);
        [clock.now() - Instant::ZERO, own - cpu[0], all - cpu[1]]
    };
    let mut best = [[Duration::MAX; 3]; 2];
    for _ in 0..pairs {
        for (best, run) in best.iter_mut().zip([flat as fn() -> Run, captured]) {
            let took = time(run);
            *best = core::array::from_fn(|index| best[index].min(took[index]));
        }
    }
    for (index, what) in ["time", "processor time of the run", "of all threads"]
        .into_iter()
        .enumerate()
    {
        let [plain, with] = best.map(|times| times[index].as_secs_f64() * 1e3);
        let cost = (with / plain - 1.0) * 100.0;
        println!(
            "capture, {what}: {plain:.1} ms without, {with:.1} ms with: {cost:+.1} %, \
             best of {pairs} each"
        );
    }
}

/// Sends eight bytes every 100 ms.
#[derive(Clone)]
struct Beacon {
    sends_at: Instant,
    waiting: usize,
}

impl Device for Beacon {
    fn receive(&mut self, _: Port, _: Instant, _: &[u8]) {}

    fn poll(&mut self, now: Instant, _: &mut World) {
        if now >= self.sends_at {
            self.sends_at += Duration::from_millis(100);
            self.waiting = 8;
        }
    }

    fn transmit(&mut self, _: Port, buf: &mut [u8]) -> usize {
        let len = self.waiting.min(buf.len());
        buf[..len].fill(0x55);
        self.waiting -= len;
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        Some(self.sends_at)
    }

    fn line_config(&self, _: Port) -> LineConfig {
        LineConfig::new_8n1(115_200)
    }

    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}

/// What does a device cost among many? Each sends at its own time, byte by byte.
fn many_devices(_: &mut Criterion) {
    let device_seconds = if is_measured() { 16_384 } else { 1_024 };
    for devices in [16, 64, 256, 1_024] {
        let mut rig = bare::rig();
        for number in 0..devices {
            let beacon = Beacon {
                sends_at: Instant::from_micros(number * 7_919 % 100_000),
                waiting: 0,
            };
            let ends = [
                rig.add_device(&format!("beacon-{number}"), beacon),
                rig.add_outside(&format!("reader-{number}"), LineConfig::new_8n1(115_200)),
            ];
            let [device, reader] = ends.map(|node| End {
                node,
                port: Port(0),
            });
            rig.connect(&format!("link-{number}"), device, reader, 1);
        }
        let began = cpu_time(ClockId::ThreadCPUTime);
        for step in 1..=20 * device_seconds / devices {
            rig.run_until(Instant::from_millis(50 * step));
        }
        let took = cpu_time(ClockId::ThreadCPUTime) - began;
        println!(
            "{devices} devices: {:.1} us for a second of each",
            took.as_secs_f64() * 1e6 / device_seconds as f64
        );
    }
}

/// How much do checkpoints save when twelve faults are reduced to the two relevant ones? A search
/// whose tries are whole runs, against one whose tries continue from a checkpoint.
fn shrinking(_: &mut Criterion) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/twelve-faults.toml");
    let (scenario, source) = Scenario::read(&path).expect("it is there");
    let run = Run::new(scenario, &source, None).expect("can be wired");
    let start = run.finish().case;
    let cause = "motors-stop-after-silence";
    let tries = if is_measured() { 5 } else { 1 };
    let mut best = [Duration::MAX; 2];
    let mut cases = Vec::new();
    for _ in 0..tries {
        let (mut branches, mut effort) = (Branches::new(&source, cause), Effort::tries(1_000));
        let mut whole = |case: &Scenario| {
            let mut run = Run::new(case.clone(), &source, None).expect("can be wired");
            while !run.is_over() {
                run.step();
            }
            let checks = run.checks();
            let failed = checks.iter().find(|check| check.status == Status::Fail);
            Judged::of(failed.map(|check| &*check.name), cause)
        };
        let judges: [&mut dyn FnMut(&Scenario) -> Judged; 2] =
            [&mut |case| branches.judge(case), &mut whole];
        for (best, judge) in best.iter_mut().zip(judges) {
            let began = cpu_time(ClockId::ThreadCPUTime);
            assert_eq!(judge(&start), Judged::FailsAlike);
            cases.push(shrink::scenario(&start, cause, judge, &mut effort));
            *best = (*best).min(cpu_time(ClockId::ThreadCPUTime) - began);
        }
    }
    assert!(
        cases
            .iter()
            .all(|case| *case == cases[0] && case.fault.len() == 2)
    );
    let [branched, whole] = best.map(|time| time.as_secs_f64() * 1e3);
    println!(
        "shrink, twelve faults: {whole:.0} ms by whole runs, {branched:.0} ms by checkpoints: \
         {:.1} times faster, best of {tries} each",
        whole / branched
    );
}

criterion_group!(
    benches,
    whole_loop,
    every_robot,
    reading_a_capture,
    cost_of_capture,
    many_devices,
    shrinking
);
criterion_main!(benches);
