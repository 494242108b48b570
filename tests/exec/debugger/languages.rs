//! Sessions in C++ and Rust with threads, and Python under its own debugger.

use std::path::PathBuf;
use std::sync::OnceLock;

use super::{Debugged, SONAR, count, undisturbed};
use crate::guest::compiled;
use crate::support::{folder, run_in};

const CPP: &str = include_str!("../programs/debugged.cpp");
const RUST: &str = include_str!("../programs/debugged.rs");

/// The program in C++ or Rust, compiled once.
pub(super) fn program(compiler: &str) -> Option<PathBuf> {
    static PROGRAMS: [OnceLock<Option<PathBuf>>; 2] = [const { OnceLock::new() }; 2];
    const CPP_FLAGS: [&str; 4] = ["-g", "-O0", "-pthread", "-std=c++17"];
    const RUST_FLAGS: [&str; 4] = ["-g", "-Copt-level=0", "-Cpanic=abort", "--edition=2021"];
    let (index, source, flags) = match compiler {
        "c++" => (0, CPP, CPP_FLAGS),
        _ => (1, RUST, RUST_FLAGS),
    };
    let build = || compiled(&format!("debugged-{compiler}"), compiler, source, &flags);
    PROGRAMS[index].get_or_init(build).clone()
}

/// Stops that continue by themselves.
const STOPS: &str = "\
break UNDERSTAND
commands
silent
echo understood\\n
continue
end
break STEER
commands
silent
echo steered\\n
continue
end
continue
detach
";
/// A session: break, inspect, step, watch, change, query.
const CPP_SESSION: &str = "\
break Rover::understand
continue
print line
bt 1
next
next
print total
delete 1
watch -l total
continue
print total
delete
break Rover::steer if steered == 2
continue
info threads
print steered
set var scale = 100
finish
delete
break Rover::steer
continue
continue
print total
kill
";
const RUST_SESSION: &str = "\
break program::understand
continue
print line
print rover.scale
bt 1
next
next
print rover.total
delete 1
watch -l rover.total
continue
print rover.total
delete
break program::steer if rover.steered == 2
continue
info threads
set var rover.scale = 100
finish
delete
break program::steer
continue
continue
print rover.total
kill
";

/// By hand: each line of the sonar adds 700, and a hundred times that after the change.
#[test]
fn sessions_in_other_languages_see_and_change_their_variables() {
    for (name, compiler, [understand, steer], session, expected) in [
        (
            "cpp",
            "c++",
            ["Rover::understand", "Rover::steer"],
            CPP_SESSION,
            &[
                "\"mm=700\"",
                "#0  Rover::understand",
                "$2 = 700",
                "Hardware watchpoint",
                "Old value = 700",
                "New value = 1400",
                "waits in ",
                "$3 = 1400",
                "$4 = 2",
            ][..],
        ),
        (
            "rust",
            "rustc",
            ["program::understand", "program::steer"],
            RUST_SESSION,
            &[
                "\"mm=700\"",
                "$2 = 1",
                "#0  program::understand",
                "$3 = 700",
                "Hardware watchpoint",
                "Old value = 700",
                "New value = 1400",
                "waits in ",
            ],
        ),
    ] {
        let Some(program) = program(compiler) else {
            continue;
        };
        let command = program.to_str().expect("a plain path");
        let files = [("sonar.toml", SONAR)];
        let expected_trace = undisturbed(name, command, &files);
        let debugged = Debugged::start(name, command, &files, &[]);
        let script = STOPS
            .replace("UNDERSTAND", understand)
            .replace("STEER", steer);
        let Some(said) = debugged.gdb(Some(&program), &script) else {
            debugged.interrupt();
            return;
        };
        let ended = debugged.end();
        assert_eq!(ended.trace(), expected_trace, "{name}\n{said}");
        let stops = [count(&said, "understood\n"), count(&said, "steered\n")];
        assert!(stops[0] >= 28 && stops[1] >= 14, "{name}\n{said}");

        let debugged = Debugged::start(name, command, &files, &[]);
        let said = debugged.gdb(Some(&program), session).expect("as before");
        for expected in expected {
            assert!(said.contains(expected), "{name}: {expected}\n{said}");
        }
        let last = said.lines().rev().find(|line| line.starts_with('$'));
        let total = last.and_then(|line| line.split_once(" = ")?.1.parse().ok());
        let total: i32 = total.unwrap_or_else(|| panic!("{name}\n{said}"));
        assert!(
            total > 70_000 && total % 700 == 0,
            "{name}: {total}\n{said}"
        );
        assert_eq!(debugged.end().code, Some(143), "{name}");
    }
}

const PYTHON: &str = "\
import os
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
total, scale = 0, 1
def understand(line):
    global total
    value = int(line[3:])
    total += value * scale
    return total
text = b''
while True:
    text += os.read(fd, 64)
    while b'\\n' in text:
        line, text = text.split(b'\\n', 1)
        if line.startswith(b'mm='):
            print(understand(line), flush=True)
            os.write(fd, b'ping\\r\\n')
";
const PDB: &str = "\
break 6
continue
p line
next
next
p total
!scale = 3
clear 1
continue
";

/// By hand: 700, then three times 700 more. Time stands while the debugger reads its orders from a
/// file, so the run is the same each time.
#[test]
fn python_runs_under_its_own_debugger() {
    let folder = folder("debug-pdb");
    let files = [
        ("sonar.toml", SONAR),
        ("program.py", PYTHON),
        ("orders", PDB),
    ];
    let command = "python3 -u -m pdb program.py < orders";
    let ended = run_in(&folder, &files, command, &["--virtual", "--check"]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    assert_eq!(ended.check("deterministic").0, "pass");
    for expected in [
        "(Pdb) b'mm=700\\r'",
        "(Pdb) 700",
        "Deleted breakpoint 1",
        "\n2800\n",
    ] {
        assert!(ended.log.contains(expected), "{expected}\n{}", ended.log);
    }
}
