//! A step backwards reaches the same state as a new run that stops at the same position.

use core::fmt::Write as _;
use std::path::PathBuf;

use super::{DEBUGGED, Debugged, PYTHON, SONAR, languages};
use crate::guest::compiled;
use crate::support::{folder, run_in};
use crate::thorough::is_thorough;

/// Registers, the stack, variables, and the rig; between two marks.
const STATE: &str = "\
echo STATE\\n
info registers
x/128xg $sp
VARIABLES
monitor time
monitor state
monitor wires sonar 5
echo END\\n
";
const VARIABLES: &str = "x/128xg (char *)&__bss_start";
/// Not the mutex: it holds the kernel's number of its thread, another one in each run.
const VARIABLES_OF_C: &str = "print counted\nprint signals\nprint scale\nprint millimetres";

/// The part of the output between the marks.
fn state(said: &str) -> Option<&str> {
    said.split_once("STATE\n")?
        .1
        .split_once("END\n")
        .map(|it| it.0)
}

/// A new run to a hit of a breakpoint, and some instructions farther.
fn forth(function: &str, hit: u64, steps: u64, state: &str) -> String {
    let mut script = format!("break {function}\nignore 1 {}\ncontinue\n", hit - 1);
    if steps > 0 {
        let _ = writeln!(script, "stepi {steps}");
    }
    script + state + "kill\n"
}

/// The same position reached backwards: two hits and one instruction back.
fn back(function: &str, hit: u64, steps: u64, state: &str) -> String {
    let mut script = format!("break {function}\nignore 1 {}\n", hit + 1);
    script += "continue\nreverse-continue\nreverse-continue\n";
    let _ = write!(script, "stepi {}\nreverse-stepi\n", steps + 1);
    script + state + "kill\n"
}

/// A pseudo-random number below `below`; the same in each run.
fn draw(index: u64, below: u64) -> u64 {
    let mixed = (index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed >> 33) % below
}

/// Four programs and a hundred points with HILRIG_TESTS=all, else a point of two of them.
#[test]
fn points_on_the_way_back_are_those_of_a_fresh_run() {
    let pthread = ["-g", "-O0", "-pthread"];
    let c = compiled("points-c", "cc", DEBUGGED, &pthread);
    let text = |it: &PathBuf| it.to_str().expect("a plain path").to_owned();
    let points = if is_thorough() { 25 } else { 1 };
    let mut programs = vec![("c", c, "count", 40), ("python", None, "write", 15)];
    if is_thorough() {
        let [cpp, rust] = ["c++", "rustc"].map(languages::program);
        programs.push(("cpp", cpp, "Rover::understand", 25));
        programs.push(("rust", rust, "program::beat", 35));
    }
    for (number, (name, program, function, hits)) in (0..).zip(programs) {
        let is_python = name == "python";
        if program.is_none() && !is_python {
            continue;
        }
        let command = program
            .as_ref()
            .map_or("python3 program.py".to_owned(), text);
        let variables = match name {
            "python" => "x/16xb $sp + 256",
            "rust" => "print program::BEATS",
            "c" => VARIABLES_OF_C,
            _ => VARIABLES,
        };
        let shown = STATE.replace("VARIABLES", variables);
        let more: &[&str] = if is_python { &["--at", "1s"] } else { &[] };
        for point in 0..points {
            let index = number * 100 + 3 * point;
            let (hit, steps) = (1 + draw(index, hits), draw(index + 1, 40));
            let mut seen = Vec::new();
            for script in [forth, back] {
                let files = [("sonar.toml", SONAR), ("program.py", PYTHON)];
                let debugged = Debugged::start(&format!("points-{name}"), &command, &files, more);
                let script = script(function, hit, steps, &shown);
                let Some(said) = debugged.gdb(program.as_deref(), &script) else {
                    debugged.interrupt();
                    return;
                };
                debugged.end();
                let state = state(&said).map(str::to_owned);
                seen.push(state.unwrap_or_else(|| panic!("{name} {hit} {steps}\n{said}")));
            }
            assert!(seen[0].contains("rip"), "{name} {hit} {steps}\n{}", seen[0]);
            assert_eq!(seen[0], seen[1], "{name}: hit {hit}, {steps} instructions");
        }
    }
}

/// The master must send a byte every 300 ms; the program sends one every 200 ms.
const WATCHDOG: &str = "\
device.sonar.text.watchdog = \"300ms\"
device.sonar.text.variable = [{ name = \"speed\", initial = 1, safe = 0 }]
";

/// Wall time has no effect: a minute at a breakpoint with HILRIG_TESTS=all, else half a second. A
/// watchdog of 100 ms shows the effect that the watchdog would have.
#[test]
fn a_long_stop_fires_no_watchdog_and_loses_no_byte() {
    let Some(program) = compiled("long-stop", "cc", DEBUGGED, &["-g", "-O0", "-pthread"]) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let scenario = SONAR.to_owned() + WATCHDOG;
    let run = |name: &str, scenario: &str| {
        let folder = folder(&format!("undisturbed-{name}"));
        run_in(
            &folder,
            &[("sonar.toml", scenario)],
            command,
            &["--virtual"],
        )
    };
    let bitten = run("bitten", &scenario.replace("300ms", "100ms"));
    assert!(bitten.events().contains("made-safe"), "{}", bitten.events());
    let plain = run("long-stop", &scenario);
    let debugged = Debugged::start("long-stop", command, &[("sonar.toml", &*scenario)], &[]);
    let length = if is_thorough() { "60" } else { "0.5" };
    let script = format!(
        "handle SIGUSR1 nostop noprint pass\nbreak beat if number == 5\ncontinue\nshell sleep {length}\ndetach\n"
    );
    let Some(said) = debugged.gdb(Some(&program), &script) else {
        debugged.interrupt();
        return;
    };
    let ended = debugged.end();
    assert!(said.contains("beat (port=3, number=5)"), "{said}");
    assert!(!ended.events().contains("made-safe"), "{}", ended.events());
    assert_eq!(ended.events(), plain.events(), "{said}");
    assert_eq!(ended.trace(), plain.trace(), "{said}");
    assert!(!ended.said.contains("lost"), "{}", ended.said);
}

/// The supervisor answers the instruction that reads the processor's counter.
const COUNTER: &str = "\
#include <fcntl.h>
#include <stdlib.h>
#include <unistd.h>
#include <x86intrin.h>
static volatile unsigned long long seen;
static volatile int looks;
int main(void) {
    char byte;
    int port = open(getenv(\"HILRIG_PORT_SONAR\"), O_RDWR | O_NOCTTY);
    while (read(port, &byte, 1) == 1) {
        seen = __rdtsc();
        looks++;
    }
    return 1;
}
";

/// A step back from the line after the counter: over `mov`, `or` and `shl` to the instruction
/// itself.
#[test]
fn a_step_back_passes_a_look_at_the_counter() {
    let Some(program) = compiled("counter", "cc", COUNTER, &["-g", "-O0"]) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let debugged = Debugged::start("counter", command, &[("sonar.toml", SONAR)], &[]);
    let script = "break 12 if looks == 5\ncontinue\n".to_owned()
        + &"reverse-stepi\nx/i $pc\n".repeat(5)
        + "kill\n";
    let Some(said) = debugged.gdb(Some(&program), &script) else {
        debugged.interrupt();
        return;
    };
    debugged.end();
    assert!(said.contains("\trdtsc"), "{said}");
    assert!(
        !said.contains("No more reverse-execution history"),
        "{said}"
    );
}
