//! `--schedule`: programs with a race work in the order of their calls, and fail in some other
//! order that its seed repeats.

use crate::guest::compiled;
use crate::support::{Ended, folder, run_in};

/// "mm=700" each 100 ms at 9600 baud for three seconds.
const SONAR: &str = include_str!("programs/sonar.toml");
const ACCOUNT: &str = include_str!("programs/races/account.py");
/// Programs with a race. With this seed, each loses its race and ends with code 7.
const RACES: [(&str, &str, u64); 4] = [
    ("counter", include_str!("programs/races/counter.c"), 1),
    ("lazy", include_str!("programs/races/lazy.c"), 1),
    ("order", include_str!("programs/races/order.c"), 0),
    ("pair", include_str!("programs/races/pair.c"), 7),
];
/// Seed with which the program in Python loses its race.
const ACCOUNT_SEED: u64 = 2;
/// Maximum number of seeds to try if the random numbers have changed.
const SEEDS: u64 = 200;

fn run(name: &str, command: &str, more: &[&str]) -> Ended {
    let folder = folder(&format!("race-{name}"));
    let files = [("sonar.toml", SONAR), ("account.py", ACCOUNT)];
    run_in(&folder, &files, command, &[&["--virtual"], more].concat())
}

#[test]
fn races_are_lost_in_some_orders_of_threads_and_never_in_the_order_of_calls() {
    let compile = |(name, source, seed)| {
        let flags = ["-O1", "-pthread"];
        let program = compiled(&format!("race-{name}"), "cc", source, &flags);
        program.map(|program| {
            (
                name,
                program.to_str().expect("a plain path").to_owned(),
                seed,
            )
        })
    };
    let mut programs: Vec<(&str, String, u64)> = RACES.into_iter().filter_map(compile).collect();
    programs.push(("account", "python3 account.py".to_owned(), ACCOUNT_SEED));
    for (name, command, known) in &programs {
        let plain = run(name, command, &[]);
        assert_eq!(plain.failed(), Vec::<&str>::new(), "{name}: {}", plain.said);
        let lost = core::iter::once(*known).chain(0..SEEDS).find(|seed| {
            let seed = seed.to_string();
            run(name, command, &["--schedule", &seed]).code == Some(1)
        });
        let seed = lost.unwrap_or_else(|| panic!("{name}: in none of {SEEDS} orders"));
        // The failure repeats, also in the second run of --check.
        let seed = seed.to_string();
        let again = run(name, command, &["--schedule", &seed, "--check"]);
        assert_eq!(again.code, Some(1), "{name}, seed {seed}: {}", again.said);
        assert_eq!(
            again.check("deterministic").0,
            "pass",
            "{name}, seed {seed}: {}",
            again.said
        );
    }
}

/// Options that would not vary the order of threads, or not as requested, are rejected before the
/// first run.
#[test]
fn orders_that_would_not_vary_are_refused() {
    let folder = folder("race-refused");
    std::fs::create_dir_all(&folder).expect("a fresh folder");
    std::fs::write(folder.join("sonar.toml"), SONAR).expect("a fresh file");
    let campaign = "campaign sonar.toml --seeds 0..2 --exec true --virtual --schedule 5";
    let fuzz = "fuzz --scenario sonar.toml";
    for (args, expected) in [
        (campaign, "not possible with --schedule"),
        (fuzz, "fuzz has no order of threads to vary"),
    ] {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_hilrig"))
            .current_dir(&folder)
            .args(args.split(' ').chain(["--vary", "schedule"]))
            .output()
            .expect("the binary is built");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(expected), "{args}: {said}");
        assert_eq!(output.status.code(), Some(2), "{args}: {said}");
    }
}

/// Each child waits in a call until its parent ends it by a signal. This is correct in each order,
/// also if the signal arrives while the child is late at its call.
const ENDED_CHILDREN: &str = "\
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
int main(void) {
    int files[2];
    int port = open(getenv(\"HILRIG_PORT_SONAR\"), O_RDWR | O_NOCTTY);
    char first;
    if (port < 0 || pipe(files) || read(port, &first, 1) != 1) return 1;
    for (int child = 0; child < 40; child++) {
        pid_t pid = fork();
        if (pid == 0) {
            char byte;
            struct timespec day = {86400, 0};
            for (;;) {
                if (child % 3 == 0) pause();
                if (child % 3 == 1) (void)!read(files[0], &byte, 1);
                if (child % 3 == 2) nanosleep(&day, 0);
            }
        }
        struct timespec moment = {0, 10000 * (child % 5)};
        nanosleep(&moment, 0);
        int status;
        kill(pid, SIGTERM);
        if (waitpid(pid, &status, 0) != pid || !WIFSIGNALED(status)) return 2;
    }
    return 0;
}
";

#[test]
fn a_signal_reaches_a_thread_that_is_late_at_its_call() {
    let Some(program) = compiled("race-children", "cc", ENDED_CHILDREN, &["-O1"]) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let may_end = ["--exec-may-end", "--exec-may-idle", "--schedule"];
    for seed in ["0", "1", "2"] {
        let ended = run("children", command, &[&may_end[..], &[seed]].concat());
        assert_eq!(ended.code, Some(0), "seed {seed}: {}", ended.said);
    }
}

const FLAGS: &str = include_str!("programs/races/flags.c");

/// A wait in a loop ends by its event, independent of the processor's speed: after 150 ms a signal,
/// then three times 200 ms of another thread, each answered. Without `--schedule` no time passes. A
/// loop that counts is not recognised as a wait.
#[test]
fn a_loop_that_waits_for_a_flag_lets_time_pass() {
    let Some(program) = compiled("race-flags", "cc", FLAGS, &["-O1", "-pthread"]) else {
        return;
    };
    let scenario = SONAR.replace("3s", "1s");
    let run = |command: &str, more: &[&str]| {
        let folder = folder("race-flags");
        let more = [&["--virtual", "--exec-may-idle", "--spin-max", "1s"], more].concat();
        run_in(&folder, &[("sonar.toml", &scenario)], command, &more)
    };
    let command = program.to_str().expect("a plain path");
    let waits = run(command, &["--schedule", "3", "--check"]);
    assert_eq!(waits.failed(), Vec::<&str>::new(), "{}", waits.said);
    assert_eq!(waits.check("deterministic").0, "pass", "{}", waits.said);
    assert!(waits.log.contains("round 2"), "{}", waits.log);
    let counts = format!("{command} counts");
    for (command, more) in [(command, &[][..]), (&*counts, &["--schedule", "3"])] {
        let ended = run(command, more);
        assert!(ended.failed().contains(&"program-yields"), "{}", ended.said);
    }
}
