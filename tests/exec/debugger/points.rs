//! A step backwards reaches the same state as a new run that stops at the same position.

use core::fmt::Write as _;
use std::fs;
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

const STEPS: u64 = 40;

/// The part of the output between the marks.
fn state(said: &str) -> Option<&str> {
    said.split_once("STATE\n")?
        .1
        .split_once("END\n")
        .map(|it| it.0)
}

/// A program and the function at which the points are.
struct Program {
    name: &'static str,
    /// The executable with its symbols; none of a script.
    path: Option<PathBuf>,
    command: String,
    function: &'static str,
    variables: &'static str,
    /// Number of calls of the function. A landing does not count them again; a wrong number fails
    /// at a step behind a call.
    hits: u64,
    /// Most instructions behind a hit.
    steps: u64,
}

impl Program {
    /// What GDB prints for `script`; `None` if there is no GDB.
    fn session(&self, script: &str) -> Option<String> {
        // An interpreter calls the function often before the program uses its port.
        let more: &[&str] = match self.path {
            None => &["--at", "1s"],
            Some(_) => &[],
        };
        let name = format!("points-{}", self.name);
        let debugged = Debugged::start(&name, &self.command, &[("sonar.toml", SONAR)], more);
        // A signal of the program is no stop.
        let script = format!("handle SIGUSR1 nostop noprint pass\n{script}");
        let Some(said) = debugged.gdb(self.path.as_deref(), &script) else {
            debugged.interrupt();
            return None;
        };
        debugged.end();
        Some(said)
    }

    /// Counts the hits of the breakpoint in a whole run.
    fn count(&self) -> Option<u64> {
        let function = self.function;
        let script =
            format!("break {function}\nignore 1 999999\ncontinue\ninfo breakpoints\nkill\n");
        let said = self.session(&script)?;
        let hits = said.split_once("breakpoint already hit ");
        let hits = hits.and_then(|(_, rest)| rest.split_once(' ')?.0.parse().ok());
        assert!(said.contains("the run is over"), "{}\n{said}", self.name);
        Some(hits.unwrap_or_else(|| panic!("{}\n{said}", self.name)))
    }
}

/// The script is written once: its dates are in the interpreter's memory.
fn python() -> Program {
    let folder = folder("points-script");
    fs::create_dir_all(&folder).expect("a fresh folder");
    let script = folder.join("program.py");
    fs::write(&script, PYTHON).expect("a fresh file");
    Program {
        name: "python",
        path: None,
        command: format!("python3 {}", script.display()),
        function: "write",
        variables: "x/16xb $sp + 256",
        hits: 18,
        steps: STEPS,
    }
}

fn of_executable(
    name: &'static str,
    path: Option<PathBuf>,
    [function, variables]: [&'static str; 2],
    hits: u64,
) -> Option<Program> {
    let command = path.as_ref()?.to_str().expect("a plain path").to_owned();
    Some(Program {
        name,
        path,
        command,
        function,
        variables,
        hits,
        steps: STEPS,
    })
}

/// How a point is reached backwards.
#[derive(Clone, Copy, Debug)]
enum Way {
    /// From two hits and one instruction behind it.
    Hits,
    /// From the end of the run, where no breakpoint was set on the way.
    End,
    /// By the rig's time.
    Time,
}

/// The two sessions of a point: forth in a new run, and back.
fn scripts(way: Way, function: &str, [hits, hit, steps]: [u64; 3], state: &str) -> [String; 2] {
    let there = format!(
        "break {function}\nignore 1 {}\ncontinue\necho HIT\\n\nbt 1\n",
        hit - 1
    );
    let mut forth = there;
    if steps > 0 {
        let _ = writeln!(forth, "stepi {steps}");
    }
    let mut back = match way {
        Way::Hits => format!(
            "break {function}\nignore 1 {}\ncontinue\nreverse-continue\nreverse-continue\n",
            hit + 1
        ),
        Way::End => format!(
            "continue\nbreak {function}\nignore 1 {}\nreverse-continue\n",
            hits - hit
        ),
        // Between two events of the rig: times are printed with microseconds.
        Way::Time => {
            let at = format!("1.{:03}713s", 20 * hit % 1000);
            forth = format!("echo rig {at}\\n\nmonitor until {at}\ncontinue\n");
            "monitor until 2.5s\ncontinue\nmonitor back BACK\nreverse-continue\n".to_owned()
        }
    };
    if !matches!(way, Way::Time) {
        let _ = write!(back, "stepi {}\nreverse-stepi\n", steps + 1);
    }
    forth += state;
    if matches!(way, Way::Time) {
        forth += "monitor until 2.5s\ncontinue\nmonitor time\n";
    }
    [forth + "kill\n", back + state + "kill\n"]
}

/// How long before the last printed time of a session the first one is.
fn span(said: &str) -> Option<String> {
    let mut times = said.lines().filter_map(|line| {
        let (seconds, _) = line.strip_prefix("rig ")?.split_once('s')?;
        let (seconds, micros) = seconds.trim().split_once('.')?;
        Some(seconds.parse::<u64>().ok()? * 1_000_000 + micros.parse::<u64>().ok()?)
    });
    let (first, last) = (times.next()?, times.next_back()?);
    Some(format!("{}us", last - first))
}

/// A pseudo-random number below `below`; the same in each run.
fn draw(index: u64, below: u64) -> u64 {
    let mixed = (index + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    (mixed >> 33) % below
}

/// Compares points of a program: 25 with HILRIG_TESTS=all, else one. Other points with
/// HILRIG_POINTS=NUMBER.
fn compare(mut program: Program) {
    let seed = std::env::var("HILRIG_POINTS").map_or(Ok(0), |it| it.parse::<u64>());
    let seed = seed.expect("HILRIG_POINTS: expected a number");
    let points = if is_thorough() { 25 } else { 1 };
    if is_thorough() {
        let Some(hits) = program.count() else { return };
        program.hits = hits;
    }
    let shown = STATE.replace("VARIABLES", program.variables);
    for point in 0..points {
        let index = seed * 1000 + 3 * point;
        let way = [Way::Hits, Way::Time, Way::Hits, Way::End, Way::Hits];
        let way = way[usize::try_from(point % 5).expect("small")];
        let hits = program.hits;
        let (hit, steps) = match way {
            Way::End => (hits - draw(index, 3), draw(index + 1, program.steps)),
            _ => (1 + draw(index, hits - 2), draw(index + 1, program.steps)),
        };
        let [forth, back] = scripts(way, program.function, [hits, hit, steps], &shown);
        let what = format!("{}: {way:?}, hit {hit} of {hits}, {steps} on", program.name);
        let Some(first) = program.session(&forth) else {
            return;
        };
        let back = back.replace("BACK", &span(&first).unwrap_or_default());
        let second = program.session(&back).expect("as before");
        let shown = |said| state(said).map(str::to_owned);
        let [one, other] =
            [&first, &second].map(|said| shown(said).unwrap_or_else(|| panic!("{what}\n{said}")));
        let is_hit = matches!(way, Way::Time) || {
            let hit = first.split_once("HIT\n#0 ");
            hit.is_some_and(|(_, frame)| frame.contains(program.function))
        };
        assert!(is_hit && one.contains("rip"), "{what}\n{first}");
        assert!(one == other, "{what}\n{first}\nBACKWARDS\n{second}");
    }
}

#[test]
fn points_in_c_on_the_way_back_are_those_of_a_fresh_run() {
    let path = compiled("points-c", "cc", DEBUGGED, &["-g", "-O0", "-pthread"]);
    // Not the mutex: it holds the kernel's number of its thread, another one in each run.
    let variables = "print counted\nprint signals\nprint scale\nprint millimetres";
    if let Some(program) = of_executable("c", path, ["count", variables], 60) {
        // Farther on, the lock has the kernel's number of its thread in a register.
        let steps = 7;
        compare(Program { steps, ..program });
    }
}

#[test]
fn points_in_python_on_the_way_back_are_those_of_a_fresh_run() {
    compare(python());
}

#[test]
fn points_in_other_languages_on_the_way_back_are_those_of_a_fresh_run() {
    if !is_thorough() {
        return;
    }
    let [cpp, rust] = ["c++", "rustc"].map(languages::program);
    let memory = "x/128xg (char *)&__bss_start";
    let beats = "print program::BEATS";
    let cpp = of_executable("cpp", cpp, ["Rover::understand", memory], 0);
    let rust = of_executable("rust", rust, ["program::beat", beats], 0);
    [cpp, rust].into_iter().flatten().for_each(compare);
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
