//! A finished run is never lost: not by a kill, not by a second process, not by a merge.

use core::time::Duration;
use std::collections::BTreeSet;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use hilrig::realtime::clock::{Clock as _, WallClock};
use rustix::process::{Pid, Signal, kill_process};

use super::campaign_folder::line;
use super::{Session, shipped, text, wait_until};

/// A campaign that continues until it is killed.
struct Running(Child);

impl Running {
    fn start(session: &Session, arguments: &str) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        command.args(arguments.split_whitespace());
        command.current_dir(session.path("."));
        command.stdout(Stdio::null()).stderr(Stdio::null());
        Self(command.spawn().expect("the command starts"))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Waits until a run is recorded in `runs`.
fn wait_for_a_run(runs: &Path) {
    let is_there = || std::fs::metadata(runs).is_ok_and(|file| file.len() > 0);
    wait_until("a run", is_there);
}

/// Runs `arguments` to the end: exit code, standard output, standard error.
fn hilrig(session: &Session, arguments: &str) -> (Option<i32>, String, String) {
    let output = session.hilrig(&arguments.split_whitespace().collect::<Vec<_>>());
    let [stdout, stderr] = [&output.stdout, &output.stderr].map(|bytes| text(bytes).to_owned());
    (output.status.code(), stdout, stderr)
}

/// Two seconds without a failure.
fn calm(session: &Session) {
    let scenario = shipped("empty-room").replace("\"90s\"", "\"2s\"");
    let scenario = scenario.replace("visit_within_mm = 200", "");
    session.write("calm.toml", &scenario);
}

/// Two seconds of a longer mission: each run fails and there are cases.
fn short(session: &Session) {
    let scenario = shipped("empty-room").replace("\"90s\"", "\"2s\"");
    session.write("short.toml", &scenario);
}

/// The whole lines of `text`.
fn whole(text: &str) -> &str {
    &text[..text.rfind('\n').map_or(0, |at| at + 1)]
}

/// 128 plus the number of the signal, as in a shell. With 0 or 1 a queue would regard a shard with
/// remaining runs as done. The shard's page is the last one, so it does not reload.
#[test]
fn a_campaign_that_is_told_to_end_is_not_done() {
    for (signal, code) in [(Signal::INT, 130), (Signal::TERM, 143)] {
        let session = Session::new(&format!("campaign-told-{code}"));
        calm(&session);
        let campaign = "campaign calm.toml --seeds 0..100000 --shard 0/2 --out night";
        let mut running = Running::start(&session, campaign);
        let runs = session.path("night/runs.jsonl");
        wait_for_a_run(&runs);
        kill_process(Pid::from_child(&running.0), signal).expect("it runs");
        assert_eq!(running.0.wait().expect("it ends").code(), Some(code));
        let done = session.read("night/runs.jsonl");
        assert!(done.ends_with("}\n"), "{done}");
        let (done, page) = (done.lines().count(), session.read("night/campaign.html"));
        let far = format!("<p>{done} runs, 0 failed, {} left", 50_000 - done);
        assert!(page.contains(&far), "{page}");
        assert!(!page.contains("http-equiv"), "{page}");
    }
}

/// All runs are done, and 150 tries of a mission of 90 s remain: the case is written unreduced,
/// with its four waypoints.
#[test]
fn who_is_told_to_end_while_a_case_is_made_smaller_takes_the_best_so_far() {
    let session = Session::new("campaign-told-late");
    let scenario = shipped("empty-room").replace("visit_within_mm = 200", "visit_within_mm = 0.01");
    session.write("exact.toml", &scenario);
    let mut running = Running::start(&session, "campaign exact.toml --seeds 0..1 --out night");
    let runs = session.path("night/runs.jsonl");
    wait_for_a_run(&runs);
    kill_process(Pid::from_child(&running.0), Signal::INT).expect("it runs");
    assert_eq!(running.0.wait().expect("it ends").code(), Some(1));
    let smallest = session.read("night/groups/01.toml");
    for waypoint in ["1.0, 2.2", "2.1, 2.1", "2.1, 0.9", "1.0, 1.0"] {
        assert!(smallest.contains(waypoint), "{smallest}");
    }
}

/// Half of the kills come during the start, the other half after some runs have ended. Before every
/// third start the test cuts the last line by hand, because a kill rarely comes during a write. The
/// file counts as appended to if it stays the same file and keeps its first bytes.
#[test]
fn a_kill_at_any_moment_loses_no_finished_run() {
    const SEEDS: u64 = 4000;
    let session = Session::new("campaign-kills");
    calm(&session);
    let campaign = |more: &str| format!("campaign calm.toml --seeds 0..{SEEDS} --out night {more}");
    // The last run, for the plan; its line is the first one, where no sorted file would have it.
    hilrig(
        &session,
        &campaign(&format!("--shard {}/{SEEDS}", SEEDS - 1)),
    );
    let plan = session.read("night/plan.json");
    let last = session.read("night/runs.jsonl");
    let done: String = (0..3000)
        .map(|seed| line("empty-room", seed, None))
        .collect();
    session.write("night/runs.jsonl", &(last + &done));
    let file = || std::fs::metadata(session.path("night/runs.jsonl")).expect("it is there");
    let inode = file().ino();
    let clock = WallClock::start();
    for round in 0..20_u64 {
        let before = session.read("night/runs.jsonl");
        let before = whole(&before);
        if round % 3 == 2 {
            let torn = line("empty-room", 3990, None);
            let torn = format!("{before}{}", &torn[..torn.len() / 2]);
            session.write("night/runs.jsonl", &torn);
        }
        let running = Running::start(&session, &campaign(""));
        if round % 2 == 0 {
            clock.sleep_until(clock.now() + Duration::from_millis(round * 37 % 50));
        } else {
            let more = before.len() + 150 * usize::try_from(round % 4).expect("small");
            wait_until("more runs", || file().len() > more as u64);
        }
        drop(running);

        let after = session.read("night/runs.jsonl");
        assert!(after.starts_with(before), "round {round} lost a run");
        assert_eq!(file().ino(), inode, "round {round} made a new file");
        assert_eq!(session.read("night/plan.json"), plan, "round {round}");
    }
    let (code, said, errors) = hilrig(&session, &campaign(&format!("--shard 0/{SEEDS}")));
    let runs = session.read("night/runs.jsonl");
    let keys: BTreeSet<&str> = runs.lines().map(|line| &line[..40]).collect();
    assert_eq!(code, Some(0), "{errors}");
    assert!(runs.lines().count() > 3001, "no run was added");
    assert_eq!(keys.len(), runs.lines().count(), "a run was done twice");
    assert!(
        said.starts_with(&format!("{} runs, 0 failed", keys.len())),
        "{said}"
    );
}

/// A run has the same result at any time: the lost run is repeated, later in the file.
#[test]
fn a_torn_line_is_cut_away_and_its_run_done_again() {
    let session = Session::new("campaign-torn");
    calm(&session);
    let campaign = "campaign calm.toml --seeds 0..6 --out night --shard 0/2 --jobs 1";
    hilrig(&session, campaign);
    let runs = session.read("night/runs.jsonl");
    let sorted = |text: &str| text.lines().map(str::to_owned).collect::<BTreeSet<_>>();
    let first = runs.find('\n').expect("there are lines");
    let cuts = [
        0,
        1,
        first / 2,
        first,
        first + 1,
        first + 13,
        runs.len() - 1,
    ];
    for (cut, zeros) in cuts.iter().flat_map(|&cut| [(cut, 0), (cut, 7)]) {
        let torn = runs[..cut].to_owned() + &"\0".repeat(zeros);
        session.write("night/runs.jsonl", &torn);
        let (code, _, errors) = hilrig(&session, campaign);
        assert_eq!(code, Some(0), "cut at {cut}: {errors}");
        let again = session.read("night/runs.jsonl");
        assert!(again.starts_with(whole(&runs[..cut])), "cut at {cut}");
        assert_eq!(sorted(&again), sorted(&runs), "cut at {cut}");
    }
}

/// The second process prints the process number of the first one, for any command in the folder.
/// After a kill -9 the lock still contains the number of the dead process, and is ignored.
#[test]
fn a_second_process_is_refused_until_the_first_is_dead() {
    let session = Session::new("campaign-locked");
    calm(&session);
    let campaign = "campaign calm.toml --seeds 0..100000 --out night";
    let first = Running::start(&session, campaign);
    let pid = first.0.id();
    let lock = session.path("night/campaign.lock");
    let is_locked = || std::fs::read_to_string(&lock).is_ok_and(|text| text == format!("{pid}\n"));
    wait_until("the lock", is_locked);
    wait_until("the plan", || session.path("night/plan.json").exists());

    // A shard of one run, so that it ends soon if it is not refused.
    let one = format!("{campaign} --shard 0/100000");
    for second in [&one, "campaign merge night --out night"] {
        let (code, _, errors) = hilrig(&session, second);
        assert_eq!(code, Some(2), "{errors}");
        let expected = format!("night: process {pid} works in this folder, expected none");
        assert!(errors.contains(&expected), "{errors}");
    }

    drop(first);
    assert_eq!(session.read("night/campaign.lock"), format!("{pid}\n"));
    let (code, _, errors) = hilrig(&session, &one);
    assert_eq!(code, Some(0), "{errors}");
    assert_eq!(session.read("night/campaign.lock"), "");
}

/// A foreign file at the path of a campaign's file stays unchanged; the error names it and the
/// expected content.
#[test]
fn what_is_no_campaign_is_refused_in_words() {
    let foreign_run = line("elsewhere", 0, None);
    let late_run = line("empty-room", 3, None);
    let texts = [
        ("plan.json", "", "expected the plan of a campaign"),
        (
            "plan.json",
            "{\"tool\":1}",
            "expected the plan of a campaign",
        ),
        ("runs.jsonl", "1\n", "line 1: "),
        ("runs.jsonl", "\n", "expected a run"),
        ("runs.jsonl", "notes of today", "expected runs"),
        (
            "runs.jsonl",
            &foreign_run,
            "expected a run of this campaign",
        ),
        ("runs.jsonl", &late_run, "expected a run of this campaign"),
        ("campaign.lock", "notes of today", "expected a process id"),
        ("cases", "", "expected a folder"),
    ];
    let folders = [
        ("plan.json", "expected the plan of a campaign"),
        ("plan.json.part", "plan.json: "),
        ("runs.jsonl", "expected the runs of a campaign"),
        ("campaign.lock", "expected the lock of a campaign"),
        ("campaign.json", "expected a file"),
        ("campaign.html", "expected a file"),
    ];
    let session = Session::new("campaign-foreign");
    calm(&session);
    hilrig(&session, "campaign calm.toml --seeds 0..1 --out sound");
    let plan = session.read("sound/plan.json");
    let refused = |name: &str, expected: &str| {
        for command in ["campaign calm.toml --seeds 0..1", "campaign merge sound"] {
            let (code, _, errors) = hilrig(&session, &format!("{command} --out night"));
            assert_eq!(code, Some(2), "{name} {expected}: {errors}");
            let named = format!("night/{name}: ");
            assert!(
                errors.contains(&named) || name.ends_with(".part"),
                "{errors}"
            );
            assert!(errors.contains(expected), "{errors}");
        }
        std::fs::remove_dir_all(session.path("night")).expect("it is there");
    };
    for (name, content, expected) in texts {
        std::fs::create_dir_all(session.path("night")).expect("room");
        session.write("night/plan.json", &plan);
        session.write(&format!("night/{name}"), content);
        refused(name, expected);
    }
    for (name, expected) in folders {
        std::fs::create_dir_all(session.path("night").join(name)).expect("room");
        if !name.starts_with("plan.json") {
            session.write("night/plan.json", &plan);
        }
        refused(name, expected);
    }
}

/// Three shards, merged at once and in two steps; in the third variant the half that was merged
/// first is continued instead. All give the same bytes, lines and cases.
#[test]
fn what_was_merged_is_merged_again_and_gone_on_with() {
    let session = Session::new("campaign-merges");
    short(&session);
    let campaign = "campaign short.toml --seeds 0..6 --vary timing";
    for shard in 0..3 {
        hilrig(
            &session,
            &format!("{campaign} --shard {shard}/3 --out {shard}"),
        );
    }
    hilrig(&session, "campaign merge 2 0 1 --out at-once");
    hilrig(&session, "campaign merge 1 2 --out half");
    let half = session.read("half/runs.jsonl");
    hilrig(&session, "campaign merge half 0 --out in-steps");
    hilrig(&session, &format!("{campaign} --out half"));

    let cases = |dir: &str| {
        let entries = std::fs::read_dir(session.path(dir).join("cases")).expect("there are cases");
        let names = entries.map(|entry| entry.expect("readable").file_name());
        let names: BTreeSet<String> = names.map(|name| name.to_string_lossy().into()).collect();
        let texts = names
            .iter()
            .map(|name| session.read(&format!("{dir}/cases/{name}")));
        (names.clone(), texts.collect::<Vec<_>>())
    };
    assert!(!cases("at-once").0.is_empty());
    for dir in ["in-steps", "half"] {
        for file in ["campaign.json", "campaign.html", "groups/01.toml"] {
            let read = |dir: &str| session.read(&format!("{dir}/{file}"));
            assert_eq!(read(dir), read("at-once"), "{dir}/{file}");
        }
        assert_eq!(cases(dir), cases("at-once"), "{dir}");
    }
    let lines = |dir: &str| session.read(&format!("{dir}/runs.jsonl"));
    assert_eq!(lines("in-steps"), lines("at-once"));
    assert!(lines("half").starts_with(&half), "its runs were not kept");
    assert_eq!(lines("half").lines().count(), 6);
}

/// A changed program makes the runs of the folder stale.
#[test]
fn a_campaign_does_not_continue_with_a_changed_program() {
    let session = Session::new("campaign-changed");
    calm(&session);
    session.write("driver.sh", "exit 0\n");
    let campaign = |program: &str| {
        let line = "campaign calm.toml --seeds 0..2 --virtual --out n --exec";
        let mut words: Vec<&str> = line.split(' ').collect();
        words.push(program);
        let output = session.hilrig(&words);
        let said = [&output.stdout, &output.stderr].map(|bytes| text(bytes).to_owned());
        (output.status.code(), said)
    };
    let program = "sh ./driver.sh";
    let (code, [_, stderr]) = campaign(program);
    assert_eq!(code, Some(1), "{stderr}");
    assert!(!stderr.contains("from earlier calls"), "{stderr}");
    let (_, [_, stderr]) = campaign(program);
    let expected = "0 runs made now, 2 from earlier calls\n";
    assert!(stderr.contains(expected), "{stderr}");

    session.write("driver.sh", "exit 1\n");
    let (code, [_, stderr]) = campaign(program);
    assert_eq!(code, Some(2), "{stderr}");
    let expected = "error: n/plan.json: the program ./driver.sh has changed since these runs; use \
                    another --out or delete the folder\n";
    assert_eq!(stderr, expected);
}
