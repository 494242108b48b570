//! `--cpu`: programs that compute too slowly for their robot fail with it and pass without it, and
//! their saved cases repeat the run exactly.

use std::fs;
use std::process::{Child, Command, Stdio};

use crate::guest::compiled;
use crate::support::{Ended, folder, run_in};
use crate::thorough::{few, is_thorough};

/// "mm=700" each 100 ms at 9600 baud for three seconds.
const SONAR: &str = include_str!("programs/sonar.toml");
/// An answer within 50 ms of each line.
const ANSWERS: &str = "
[[expect.rule]]
name = \"answers\"
after = { bytes = { link = \"sonar\", direction = \"to-master\", hex = \"6d6d3d\" } }
within = \"50ms\"
eventually = { bytes = { link = \"sonar\", direction = \"to-device\", hex = \"70696e67\" } }
";
const PLANNER: &str = include_str!("programs/slow/planner.c");
const MAPPER: &str = include_str!("programs/slow/mapper.py");
const ANSWERER: &str = include_str!("programs/slow/answerer.rs");
/// Scale at which each step of the programs takes some hundred milliseconds; on this machine it
/// takes only a few.
const SCALE: &str = "100";

fn run(name: &str, scenario: &str, command: &str, more: &[&str]) -> Ended {
    let folder = folder(&format!("slow-{name}"));
    let files = [("sonar.toml", scenario), ("mapper.py", MAPPER)];
    // An interpreter takes long to start on such a processor.
    let how = ["--virtual", "--exec-wait", "120s"];
    run_in(&folder, &files, command, &[&how[..], more].concat())
}

/// Processes that load the processor until they are dropped.
struct Load(Vec<Child>);

impl Load {
    fn start() -> Self {
        let spin = || {
            let mut shell = Command::new("sh");
            shell
                .args(["-c", "while :; do :; done"])
                .stdin(Stdio::null());
            shell.spawn().expect("a shell")
        };
        Self(vec![spin(), spin(), spin()])
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

#[test]
fn programs_that_are_too_slow_fail_and_their_cases_repeat() {
    let answered = SONAR.to_owned() + ANSWERS;
    let text = |it: std::path::PathBuf| it.to_str().expect("a plain path").to_owned();
    let planner = compiled("slow-planner", "cc", PLANNER, &[]).map(text);
    let rust = || compiled("slow-answerer", "rustc", ANSWERER, &["--edition=2021"]);
    let answerer = is_thorough().then(rust).flatten().map(text);
    let mapper = Some("python3 mapper.py".to_owned());
    let programs = [
        ("planner", planner, SONAR, "program-alive"),
        ("mapper", mapper, SONAR, "program-reads"),
        ("answerer", answerer, &answered, "rule-answers"),
    ];
    for (name, command, scenario, check) in few(2, programs) {
        let Some(command) = command else { continue };
        let plain = run(name, scenario, &command, &[]);
        assert_eq!(plain.failed(), Vec::<&str>::new(), "{name}: {}", plain.said);
        let slow = run(name, scenario, &command, &["--cpu", SCALE, "--check"]);
        assert_eq!(slow.failed(), [check], "{name}: {}", slow.said);
        assert!(slow.said.contains("case.toml --exec"), "{}", slow.said);
        assert!(slow.said.contains(" --virtual --cpu case"), "{}", slow.said);
        let case = slow.case();
        let load = Load::start();
        let again = run(name, &case, &command, &["--cpu", "case"]);
        drop(load);
        assert_eq!(again.failed(), [check], "{name}: {}", again.said);
        assert_eq!(again.trace(), slow.trace(), "{name}: {}", again.said);
        assert_eq!(again.case(), case, "{name}");
        let repeats = again.check("computes-as-recorded");
        assert_eq!(repeats.0, "pass", "{name}: {}", repeats.1);
    }
}

/// A case with other charges is another run, and a program with other calls does not repeat the
/// case. Both are charged with the times of the case: nothing is measured.
#[test]
fn a_case_that_does_not_fit_its_program_fails() {
    let Some(planner) = compiled("slow-other", "cc", PLANNER, &[]) else {
        return;
    };
    let command = planner.to_str().expect("a plain path");
    let slow = run("other", SONAR, command, &["--cpu", SCALE]);
    assert_eq!(slow.failed(), ["program-alive"], "{}", slow.said);
    let case = slow.case();
    let (before, charges) = case.split_once("charges = [").expect("recorded");
    let (_, after) = charges.split_once(']').expect("a list");
    let free = format!("{before}charges = []{after}");
    let ended = run("other", &free, command, &["--cpu", "case"]);
    // The program continues where the recorded run ended.
    assert_eq!(ended.failed(), ["computes-as-recorded"], "{}", ended.said);
    // The case keeps its record: a second try fails as well.
    let recorded = |text: &str| {
        text.lines()
            .find(|it| it.starts_with("fingerprint"))
            .map(str::to_owned)
    };
    assert_eq!(recorded(&ended.case()), recorded(&case));
    assert!(ended.case().contains("charges = []"), "{}", ended.case());
    // The same calls of another file.
    let quick = PLANNER.replace("step < 2000000", "step < 2000");
    assert!(compiled("slow-other", "cc", &quick, &[]).is_some_and(|it| it == planner));
    let ended = run("other", &case, command, &["--cpu", "case"]);
    let (status, detail) = ended.check("computes-as-recorded");
    assert_eq!(status, "fail", "{}", ended.said);
    assert!(detail.starts_with("program is another file"), "{detail}");
    let wrong = format!("{before}charges = [\"7\"]{after}");
    let folder = folder("slow-wrong");
    fs::create_dir_all(&folder).expect("a fresh folder");
    for (file, text) in [
        ("wrong.toml", &*wrong),
        ("sonar.toml", SONAR),
        ("case.toml", &case),
    ] {
        fs::write(folder.join(file), text).expect("a fresh file");
    }
    for (words, code, expected) in [
        (
            "run wrong.toml --exec true --virtual --cpu case",
            2,
            "a charge is \"7\", expected STEP:UNITS",
        ),
        (
            "run sonar.toml --exec true --virtual --cpu case",
            2,
            "the scenario has no table [computing]",
        ),
        (
            "run sonar.toml --exec true --virtual --cpu 0",
            2,
            "expected a factor from 0.001 to 10000",
        ),
        ("run sonar.toml --exec true --cpu 20", 2, "--virtual"),
        (
            "debug sonar.toml --exec true --cpu case",
            2,
            "the scenario has no table [computing]",
        ),
        (
            "campaign sonar.toml --exec true --virtual --cpu case",
            2,
            "expected a number, as in --cpu 20",
        ),
        (
            "shrink case.toml --exec true --virtual --cpu 20",
            2,
            "shrink saves no case that records",
        ),
        ("run case.toml", 1, "computing: has no effect without"),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_hilrig"))
            .current_dir(&folder)
            .args(words.split(' '))
            .output()
            .expect("the binary is built");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains(expected), "{words}: {said}");
        assert_eq!(output.status.code(), Some(code), "{words}: {said}");
    }
}

/// The arguments choose one of two cases: a thread waits in a loop for one that sleeps 50 ms, or a
/// child computes for seconds as the run ends.
const FREE: &str = "\
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>
static volatile int flag;
static volatile unsigned plan;
static void nap(long ms) {
    struct timespec pause = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&pause, NULL);
}
static long millis(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000 + now.tv_nsec / 1000000;
}
static void *setter(void *none) {
    nap(50);
    flag = 1;
    return none;
}
int main(int count, char **words) {
    int port = open(getenv(\"HILRIG_PORT_SONAR\"), O_RDWR | O_NOCTTY);
    char bytes[64];
    pthread_t thread;
    if (read(port, bytes, sizeof bytes) <= 0) return 2;
    if (count > 1 && fork() == 0) {
        nap(2500);
        for (unsigned step = 0; step < 60000000; step++) plan = plan * 1664525 + step;
        for (;;) nap(10);
    }
    if (count == 1) {
        long begin = millis();
        pthread_create(&thread, NULL, setter, NULL);
        while (!flag);
        dprintf(1, \"waited %ld ms\\n\", millis() - begin);
    }
    for (;;)
        if (read(port, bytes, sizeof bytes) <= 0 || write(port, \"ping\\r\\n\", 6) != 6) return 3;
}
";

/// Processor time of a loop that waits for another thread is no computing: 100 ms of it, after
/// which the watch over the program looks, would be 2 s here. A thread whose computing has not
/// passed when the run ends gets its signal then.
#[test]
fn waits_are_free_and_the_end_of_a_run_waits_for_no_charge() {
    let Some(program) = compiled("slow-free", "cc", FREE, &["-pthread"]) else {
        return;
    };
    let command = program.to_str().expect("a plain path");
    let ended = run("free", SONAR, command, &["--cpu", "20", "--schedule", "3"]);
    let line = ended
        .log
        .lines()
        .find_map(|line| line.strip_prefix("waited "));
    let waited = line.and_then(|line| line.strip_suffix(" ms")?.parse().ok());
    let waited: u32 = waited.unwrap_or_else(|| panic!("{}\n{}", ended.said, ended.log));
    assert!((50..1000).contains(&waited), "{waited} ms\n{}", ended.said);
    let ended = run(
        "child",
        SONAR,
        &format!("{command} child"),
        &["--cpu", "100"],
    );
    assert!(ended.said.contains("of computing took"), "{}", ended.said);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
}
