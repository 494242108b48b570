//! Reads of ports that are answered in the program itself: with `--trace-calls` each call is a
//! stop, and both runs are the same to the nanosecond.

use crate::guest::{compiled, run, trace};
use crate::support::Ended;

const LENT: &str = include_str!("programs/lent.c");
/// A line of 7 bytes and its end every 40 ms, at 9600 baud.
const SONAR: &str = include_str!("programs/sonar.toml");

/// Number of reads and selects without a stop, from the output of the run.
fn served(ended: &Ended) -> u32 {
    let words = ended.said.split(" reads and selects without a stop").next();
    let count = words.and_then(|words| words.rsplit(' ').next());
    count.and_then(|count| count.parse().ok()).unwrap_or(0)
}

#[test]
fn reads_without_a_stop_are_those_of_stops() {
    let Some(program) = compiled("lent", "cc", LENT, &["-w", "-pthread"]) else {
        return;
    };
    let rig = SONAR.replace("\"3s\"", "\"40s\"").replace("100ms", "40ms");
    let files = [("sonar.toml", rig.as_str())];
    let program = program.display().to_string();
    let lent = run("lent", &program, &files, &["--exec-may-end"]);
    let stopped = run(
        "lent-stops",
        &program,
        &files,
        &["--trace-calls", "calls.txt"],
    );
    assert_eq!(
        lent.failed(),
        Vec::<&str>::new(),
        "{}\n{}",
        lent.said,
        lent.log
    );
    assert_eq!(lent.log, stopped.log, "{}\n{}", lent.said, stopped.said);
    assert!(
        lent.log.contains("cancelled threads took 0"),
        "{}",
        lent.log
    );
    assert_eq!(trace(&lent), trace(&stopped));
    assert_eq!(served(&stopped), 0, "{}", stopped.said);
    // The other reads need a stop: for the last known byte, a request, a timeout, a signal.
    assert!(served(&lent) > 1_500, "{}\n{}", lent.said, lent.log);
}

/// A wait with VTIME counts from the last byte, also if that came between two stops.
#[test]
fn a_wait_counts_from_a_byte_that_came_without_a_stop() {
    let Some(program) = compiled("lent-late", "cc", LENT, &["-w", "-pthread"]) else {
        return;
    };
    let rig = SONAR.replace("100ms", "300ms");
    let files = [("sonar.toml", rig.as_str())];
    let command = format!("{} late", program.display());
    let may_end = ["--exec-may-end"];
    let lent = run("lent-late", &command, &files, &may_end);
    let traced = [&may_end[..], &["--trace-calls", "calls.txt"]].concat();
    let stopped = run("lent-late-stops", &command, &files, &traced);
    assert!(lent.log.starts_with("late tenths: "), "{}", lent.said);
    assert_eq!(lent.log, stopped.log, "{}\n{}", lent.said, stopped.said);
    assert!(served(&lent) > 3, "{}", lent.said);
}

/// A port with RTS/CTS or BRKINT is read with a stop for each call, because the future of the line
/// depends on more than its bytes. After the end of the run, a program that writes more than the
/// line takes still ends.
#[test]
fn stopped_settings_and_the_end_of_a_run() {
    let Some(program) = compiled("lent-stopped", "cc", LENT, &["-w", "-pthread"]) else {
        return;
    };
    let command = format!("{} stops", program.display());
    let files = [("sonar.toml", SONAR)];
    let ended = run("lent-stopped", &command, &files, &[]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    assert!(ended.log.contains("breaks: "), "{}", ended.log);
    assert_eq!(served(&ended), 0, "{}", ended.said);
}
