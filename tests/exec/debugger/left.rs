//! What a debugger leaves behind: no breakpoint in a thread outside of virtual time, and none in a
//! child.

use super::{Debugged, SONAR};
use crate::guest::compiled;

const LEFT: &str = include_str!("../programs/left.c");

/// The debugger leaves while the thread waits outside, and when the thread stands at the
/// breakpoint. A trap that is left would end the program or its child by SIGTRAP.
#[test]
fn breakpoints_are_gone_for_threads_outside_and_for_children() {
    let Some(program) = compiled("left", "cc", LEFT, &["-g", "-O0", "-pthread"]) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    for (name, script, expected) in [
        (
            "left-waiting",
            "break mark\nmonitor until 0.5s\ncontinue\ninfo threads\ndetach\n",
            "outside of virtual time in fcntl",
        ),
        (
            "left-stopped",
            "break mark\ncontinue\ndetach\n",
            "mark (who=1)",
        ),
    ] {
        let debugged = Debugged::start(name, command, &[("sonar.toml", SONAR)], &[]);
        let Some(said) = debugged.gdb(Some(&program), script) else {
            debugged.interrupt();
            return;
        };
        let ended = debugged.end();
        assert!(said.contains(expected), "{name}\n{said}");
        let words = "outside 1\nchild 11, ended 1\n";
        assert!(ended.log.contains(words), "{name}\n{}\n{said}", ended.log);
        assert_eq!(ended.code, Some(0), "{name}\n{}", ended.said);
    }
}
