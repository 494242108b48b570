//! Does the memory of a page that is open for half an hour stay small? A run at four times real
//! time in a real browser: memory of server and page, bytes to the page, and the server's share of
//! a core, at 1x and at 4x.
//!
//! ```text
//! cargo bench --bench page                     three minutes
//! cargo bench --bench page -- --minutes 30     half an hour
//! ```
//!
//! Ends with exit code 1 if a limit is exceeded. Under `cargo test` it runs for a few seconds and
//! judges nothing. Linux only: it reads /proc.

#[path = "../tests/page/browser.rs"]
#[expect(dead_code, reason = "the tests use the rest")]
mod browser;
#[path = "../tests/page/server.rs"]
#[expect(dead_code, reason = "the tests use the rest")]
mod server;

use core::time::Duration;
use std::fs;
use std::process::ExitCode;

use browser::Browser;
use hilrig::realtime::clock::{Clock, WallClock};
use server::Server;

/// Maximum number of kilobytes a second to the page.
const KB_S_MAX: f64 = 1000.0;
/// Maximum share of a core for the server at real time, per cent.
const CORE_MAX: f64 = 15.0;
/// Maximum growth of memory from the middle third of the time to the last, MB and share. By then
/// everything that is stored has nearly reached its limit.
const GROWTH_MAX: (f64, f64) = (2.0, 0.05);

/// Lines of the table at 4x.
const ROWS: u32 = 18;

/// Measured values between two looks.
struct Look {
    server_mb: f64,
    heap_mb: f64,
    renderer_mb: f64,
    kb_s: f64,
    core: f64,
}

/// A page under measurement.
struct Bench {
    clock: WallClock,
    browser: Browser,
    server: u32,
    last: (f64, f64, f64),
}

impl Bench {
    /// Waits, and returns the measured values of this time.
    fn look(&mut self, speed: &str, span: Duration) -> Look {
        self.clock.sleep_until(self.clock.now() + span);
        let heap = self.number("(gc(), performance.memory.usedJSHeapSize)");
        let now = (
            (self.clock.now() - protocols::Instant::ZERO).as_secs_f64(),
            self.number("hilrig.bytes"),
            cpu_s(self.server),
        );
        let seconds = now.0 - self.last.0;
        let renderers = descendants(std::process::id()).into_iter();
        let renderers = renderers.filter(|&pid| of(pid, "cmdline").contains("--type=renderer"));
        let look = Look {
            server_mb: kib(self.server, "status", "VmRSS:") / 1024.0,
            heap_mb: heap / 1e6,
            renderer_mb: renderers
                .map(|pid| kib(pid, "smaps_rollup", "Pss:"))
                .sum::<f64>()
                / 1024.0,
            kb_s: (now.1 - self.last.1) / 1e3 / seconds,
            core: (now.2 - self.last.2) / seconds * 100.0,
        };
        self.last = now;
        println!(
            "{:8.0} s {speed:>4} {:9.0} s {:9.1} MB {:7.1} MB {:8.1} MB {:7.1} kB/s {:6.1} %",
            now.0,
            self.number("hilrig.now.at_ns") / 1e9,
            look.server_mb,
            look.heap_mb,
            look.renderer_mb,
            look.kb_s,
            look.core
        );
        look
    }

    fn number(&self, expression: &str) -> f64 {
        self.browser.value(expression).as_f64().expect("a number")
    }
}

fn of(pid: u32, file: &str) -> String {
    fs::read_to_string(format!("/proc/{pid}/{file}")).unwrap_or_default()
}

/// A figure of a file in /proc, in KiB; 0 for a process that is gone.
fn kib(pid: u32, file: &str, key: &str) -> f64 {
    let text = of(pid, file);
    let line = text.lines().find_map(|line| line.strip_prefix(key));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok())
        .unwrap_or(0.0)
}

/// Processor time of all threads so far: the first figure of their `schedstat`, nanoseconds.
fn cpu_s(pid: u32) -> f64 {
    let tasks = fs::read_dir(format!("/proc/{pid}/task")).expect("it lives");
    let tasks =
        tasks.filter_map(|task| fs::read_to_string(task.ok()?.path().join("schedstat")).ok());
    let nanos = tasks.filter_map(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanos.sum::<f64>() / 1e9
}

/// All processes below `root`.
fn descendants(root: u32) -> Vec<u32> {
    let all = fs::read_dir("/proc").expect("Linux has one").flatten();
    let pids = all.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    // The parent is the second field after the name, which is in brackets.
    let parent = |pid| -> Option<u32> {
        let stat = of(pid, "stat");
        stat.rsplit_once(')')?
            .1
            .split_whitespace()
            .nth(1)?
            .parse()
            .ok()
    };
    let pairs: Vec<(u32, u32)> = pids.filter_map(|pid| Some((pid, parent(pid)?))).collect();
    let mut family = vec![root];
    let mut index = 0;
    while let Some(&parent) = family.get(index) {
        let children = pairs.iter().filter(|pair| pair.1 == parent);
        family.extend(children.map(|pair| pair.0));
        index += 1;
    }
    family
}

fn mean(looks: &[Look], figure: impl Fn(&Look) -> f64) -> f64 {
    looks.iter().map(figure).sum::<f64>() / looks.len().max(1) as f64
}

/// Prints whether a figure keeps its limit.
fn judge(what: &str, found: f64, most: f64, unit: &str) -> bool {
    let verdict = if found <= most { "ok" } else { "TOO MUCH" };
    println!("{what}: {found:.1} {unit}, at most {most:.1}: {verdict}");
    found <= most
}

/// The value of `--minutes N`, and whether limits are judged.
fn arguments() -> (f64, bool) {
    let arguments: Vec<String> = std::env::args().collect();
    let is_bench = arguments.iter().any(|argument| argument == "--bench");
    let minutes = arguments
        .iter()
        .position(|argument| argument == "--minutes");
    let minutes = minutes.and_then(|at| arguments.get(at + 1)?.parse().ok());
    (
        minutes.unwrap_or(if is_bench { 3.0 } else { 0.1 }),
        is_bench,
    )
}

fn main() -> ExitCode {
    let (minutes, is_bench) = arguments();
    let mut server = Server::of("rescue-flat", "1");
    let Some(browser) = Browser::at(&server) else {
        return ExitCode::SUCCESS;
    };
    let mut bench = Bench {
        clock: WallClock::start(),
        browser,
        server: server.process().id(),
        last: (0.0, 0.0, 0.0),
    };
    // A robot that continues moving, so that there is always something new to show.
    bench
        .browser
        .wait("hilrig.now.pc.map || hilrig.now.pc.size_mm");
    bench
        .browser
        .value("send({do: 'mode', mode: 'exploration'})");
    println!(
        "  page open, speed   virtual    server    heap    renderer   to page   server's core"
    );
    let row = Duration::from_secs_f64(minutes * 60.0 / f64::from(ROWS));
    bench.look("1x", row);
    let slow = [bench.look("1x", row), bench.look("1x", row)];
    bench.browser.value("send({do: 'speed', x: 4})");
    bench.browser.wait("hilrig.now.speed === 4");
    bench.look("4x", Duration::from_millis(300));
    let looks: Vec<Look> = (0..ROWS).map(|_| bench.look("4x", row)).collect();

    let third = looks.len() / 3;
    let [middle, last] = [&looks[third..2 * third], &looks[2 * third..]];
    let (most_mb, most_share) = GROWTH_MAX;
    let grows = |what, figure: fn(&Look) -> f64| {
        let (before, after) = (mean(middle, figure), mean(last, figure));
        judge(what, after, before * (1.0 + most_share) + most_mb, "MB")
    };
    let kept = [
        judge(
            "to the page at 4x",
            mean(&looks, |look| look.kb_s),
            KB_S_MAX,
            "kB/s",
        ),
        judge(
            "server at 1x",
            mean(&slow, |look| look.core),
            CORE_MAX,
            "% of a core",
        ),
        grows("server's memory in the last third", |look| look.server_mb),
        grows("page's heap in the last third", |look| look.heap_mb),
        grows("renderer's memory in the last third", |look| {
            look.renderer_mb
        }),
    ];
    if is_bench && kept.contains(&false) {
        return ExitCode::FAILURE;
    }
    ExitCode::SUCCESS
}
