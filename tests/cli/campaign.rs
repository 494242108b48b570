//! Campaigns: the results do not depend on shards and interruptions.

use std::process::Command;

use super::{Session, shipped, text};

/// Two seconds of a longer mission, so that a check fails and there is a case to minimise.
fn short(session: &Session) {
    let scenario = shipped("empty-room").replace("\"90s\"", "\"2s\"");
    session.write("short.toml", &scenario);
}

fn campaign(session: &Session, more: &str) -> Option<i32> {
    let arguments = format!("campaign short.toml --seeds 0..6 --vary timing {more}");
    let arguments: Vec<&str> = arguments.split_whitespace().collect();
    session.hilrig(&arguments).status.code()
}

/// The merged files of a campaign in one piece and of one in four, compared byte for byte; all
/// runs fail, so each has a group and a smallest case.
#[test]
fn four_shards_merged_are_the_whole_campaign() {
    let session = Session::new("campaign-shards");
    short(&session);
    assert_eq!(campaign(&session, "--out whole"), Some(1));
    for shard in 0..4 {
        assert_eq!(
            campaign(&session, &format!("--shard {shard}/4 --out part-{shard}")),
            Some(1)
        );
    }
    let merge = "campaign merge part-3 part-0 part-1 part-2 --out merged";
    let merge: Vec<&str> = merge.split(' ').collect();
    assert_eq!(session.hilrig(&merge).status.code(), Some(1));
    for file in ["campaign.json", "campaign.html", "groups/01.toml"] {
        let read = |dir: &str| session.read(&format!("{dir}/{file}"));
        assert_eq!(read("whole"), read("merged"), "{file}");
    }
    let json = session.read("merged/campaign.json");
    assert!(json.contains("\"cause\": \"waypoints-visited: "), "{json}");
    assert!(json.contains("\"missing\": 0"), "{json}");
}

/// A kill in the middle of a line, then the same command: nothing is run twice or lost.
#[test]
fn a_campaign_that_was_killed_goes_on() {
    let session = Session::new("campaign-resumed");
    short(&session);
    campaign(&session, "--out whole");
    let runs = session.read("whole/runs.jsonl");
    let cut = &runs[..runs.len() - 20];
    session.write("whole/runs.jsonl", cut);
    let json = session.read("whole/campaign.json");
    session.write("whole/campaign.json", "");

    campaign(&session, "--out whole");

    assert_eq!(session.read("whole/campaign.json"), json);
    assert_eq!(session.read("whole/runs.jsonl").lines().count(), 6);
}

#[test]
fn a_folder_of_another_campaign_is_refused() {
    let session = Session::new("campaign-other");
    short(&session);
    campaign(&session, "--out one");
    let other = ["campaign", "short.toml", "--seeds", "0..7", "--out", "one"];
    let output = session.hilrig(&other);
    assert_eq!(output.status.code(), Some(2));
    let error = text(&output.stderr);
    assert!(
        error.contains("plan.json: is of another campaign"),
        "{error}"
    );
}

/// Runs without faults pass, but prove nothing about the robot's reaction to faults.
#[test]
fn a_campaign_in_which_too_little_came_up_fails_on_request() {
    let session = Session::new("campaign-situations");
    let scenario = shipped("empty-room").replace("\"90s\"", "\"2s\"");
    session.write("calm.toml", &scenario.replace("visit_within_mm = 200", ""));
    let run = |more: &[&str]| {
        let arguments = ["campaign", "calm.toml", "--seeds", "0..2", "--out", "calm"];
        session.hilrig(&[&arguments[..], more].concat())
    };
    let page = || session.read("calm/campaign.html");
    assert_eq!(run(&[]).status.code(), Some(0));
    assert!(page().contains("PASS</b>"));
    let output = run(&["--all-situations"]);
    assert!(page().contains("FAIL</b> 2 of 2 runs passed<br>no run had: "));
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stdout);
    assert!(said.contains("  never occurred: base silences\n"), "{said}");
}

/// Two goals: each run drives, but no run drives 9 m/s. The campaign fails because of the second
/// goal, as a whole and merged from two shards, which do not judge goals. Without this goal, it
/// passes.
#[test]
fn a_campaign_whose_goal_never_came_up_fails() {
    let session = Session::new("campaign-goals");
    let scenario = shipped("empty-room").replace("\"90s\"", "\"4s\"");
    let scenario = scenario.replace("visit_within_mm = 200", "");
    let goal = |name: &str, speed: &str| {
        format!(
            "\n[[expect.rule]]\nname = \"{name}\"\n\
             sometimes = {{ robot = {{ of = \"speed-m-s\", op = \">\", value = {speed} }} }}\n"
        )
    };
    let reachable = scenario + &goal("drives", "0.05");
    session.write("sound.toml", &reachable);
    // A rule whose `after` never comes true, though a single run may pass without it.
    let unseen = "\n[[expect.rule]]\nname = \"wet\"\nmay_be_unobserved = true\n\
                  after = { robot = { of = \"speed-m-s\", op = \">\", value = 9 } }\n\
                  never = { contact = {} }\n";
    session.write("rules.toml", &format!("{reachable}{unseen}"));
    session.write("goals.toml", &(reachable + &goal("flies", "9")));
    let run = |arguments: &str| {
        let arguments: Vec<&str> = arguments.split_whitespace().collect();
        session.hilrig(&arguments)
    };
    let one = "campaign sound.toml --seeds 0..2 --out sound";
    assert_eq!(
        run(one).status.code(),
        Some(0),
        "{}",
        text(&run(one).stdout)
    );
    let run_alone = run("run rules.toml --out alone");
    assert_eq!(
        run_alone.status.code(),
        Some(0),
        "{}",
        text(&run_alone.stdout)
    );
    session.write(
        "strict.toml",
        &session
            .read("rules.toml")
            .replace("may_be_unobserved = true\n", ""),
    );
    let strict = run("run strict.toml --out alone --junit junit.xml");
    assert_eq!(strict.status.code(), Some(1));
    let said = text(&strict.stdout);
    assert!(
        said.contains("not observed, so not passed: rule-wet"),
        "{said}"
    );
    assert!(session.read("junit.xml").contains("failures=\"1\""));
    let rules = run("campaign rules.toml --seeds 0..2 --out rules");
    assert_eq!(rules.status.code(), Some(1));
    let said = text(&rules.stdout);
    let unobserved = "  FAIL rule wet of empty-room was not observed in any of the runs\n";
    assert!(said.contains(unobserved), "{said}");
    let all = "campaign goals.toml --seeds 0..2 --jobs 2";
    let missed = "  FAIL goal flies of empty-room was not reached in any of the runs\n";
    let output = run(&format!("{all} --out whole"));
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stdout);
    assert!(
        said.contains(missed) && !said.contains("goal drives"),
        "{said}"
    );
    for shard in 0..2 {
        let output = run(&format!("{all} --shard {shard}/2 --out part-{shard}"));
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stdout));
    }
    let output = run("campaign merge part-0 part-1 --out merged --json");
    assert_eq!(output.status.code(), Some(1));
    let answer: String = text(&output.stdout).split_whitespace().collect();
    let goals = "\"missed_goals\":[\"goalfliesofempty-room\"]";
    assert!(answer.contains(goals), "{answer}");
    assert_eq!(
        session.read("merged/campaign.json"),
        session.read("whole/campaign.json")
    );
    // After it is continued, the campaign still judges all of its runs.
    assert_eq!(run(&format!("{all} --out whole")).status.code(), Some(1));
}

/// The templates for clusters as in the docs, except for the number of runs: a shell runs them, and
/// a shard of each leaves its runs where the merge expects them.
#[test]
fn the_templates_for_clusters_run() {
    let docs = include_str!("../../docs/campaigns.md");
    let between = |from: &str, to: &str| {
        let (_, rest) = docs.split_once(from).expect("the docs have the template");
        rest.split_once(to).expect("and its end").0.to_owned()
    };
    let slurm = between("```bash\n", "```");
    let kubernetes = between("            - |\n", "          volumeMounts");

    let session = Session::new("campaign-templates");
    short(&session);
    let run = |script: &str, queue: &[(&str, &str)]| {
        let script = script.replace("scenarios/*.toml", "short.toml");
        let script = script
            .replace("0..100000", "0..2")
            .replace("--shards 16", "--shards 1");
        let script = script.replace("\"/shards/", "\"indexed/");
        let mut command = Command::new("bash");
        command.args(["-euc", &format!("srun() {{ shift; \"$@\"; }}\n{script}")]);
        let tool = std::path::Path::new(env!("CARGO_BIN_EXE_hilrig")).parent();
        let tools = std::env::var("PATH").expect("a shell needs it");
        let tools = format!("{}:{tools}", tool.expect("it is in a folder").display());
        command.env("PATH", tools).current_dir(session.path("."));
        command.envs(queue.iter().copied());
        command.output().expect("there is a shell")
    };
    let of_slurm = [("SLURM_ARRAY_TASK_ID", "0"), ("SLURM_CPUS_PER_TASK", "1")];
    let of_kubernetes = [("JOB_COMPLETION_INDEX", "0")];
    for (script, queue, folder) in [
        (slurm, &of_slurm[..], "shards/0"),
        (kubernetes, &of_kubernetes[..], "indexed/0"),
    ] {
        let output = run(&script, queue);
        let runs = session.read(&format!("{folder}/runs.jsonl"));
        assert_eq!(runs.lines().count(), 2, "{}", text(&output.stderr));
    }
}

/// In a campaign over a folder, a robot without a program is left out; otherwise every report would
/// begin with it.
#[test]
fn a_robot_without_a_program_is_left_out_beside_others() {
    let session = Session::new("campaign-bare");
    short(&session);
    let bare = shipped("custom-robot").replace("\"20s\"", "\"1s\"");
    session.write("bare.toml", &bare);
    let run = |arguments: &str| {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        let output = session.hilrig(&[&["campaign", "--seeds", "0..2"], &arguments[..]].concat());
        text(&output.stderr).to_owned()
    };
    let told = run("bare.toml short.toml --out both");
    assert!(
        told.contains("custom-robot is skipped") && told.contains("--exec"),
        "{told}"
    );
    let runs = session.read("both/runs.jsonl");
    assert!(
        runs.lines().count() == 2 && !runs.contains("custom-robot"),
        "{runs}"
    );
    // If it is the only scenario, it runs.
    run("bare.toml --out alone");
    assert_eq!(session.read("alone/runs.jsonl").lines().count(), 2);
    // A single run reports why the robot does not move. A robot with a program has no such report.
    let told = |file: &str| {
        let output = session.hilrig(&["run", file, "--out", "one"]);
        text(&output.stderr).contains("has no program; --exec CMD starts one")
    };
    assert_eq!(["bare.toml", "short.toml"].map(told), [true, false]);
}

/// A built-in profile is printed as a file that is read again; an error in it names file, line and
/// key, before the first run.
#[test]
fn a_profile_is_a_file_to_copy_and_change() {
    let session = Session::new("campaign-profile");
    short(&session);
    let printed = session.hilrig(&["campaign", "--print-profile", "harsh"]);
    assert_eq!(printed.status.code(), Some(0));
    let profile = text(&printed.stdout);
    session.write(
        "my.toml",
        &profile
            .replace("count_max = 12", "count_max = 0")
            .replace("long_percent = 10", "long_percent = 0"),
    );
    let run = |vary: &str| {
        let arguments =
            format!("campaign short.toml --seeds 0..6 --vary {vary} --profile my.toml --out mine");
        let arguments: Vec<&str> = arguments.split_whitespace().collect();
        session.hilrig(&arguments)
    };
    // Without a fault the mission is judged: no run completes it in 2 s.
    assert_eq!(run("faults").status.code(), Some(1));
    let runs = session.read("mine/runs.jsonl");
    assert_eq!(runs.lines().count(), 6);
    for line in runs.lines() {
        assert!(line.contains("waypoints-visited"), "{line}");
    }
    let unused = run("timing");
    assert_eq!(unused.status.code(), Some(2));
    let error = text(&unused.stderr);
    assert!(
        error.contains("--profile: needs faults in --vary"),
        "{error}"
    );
    session.write(
        "my.toml",
        &profile.replace("heal = \"12s\"", "heal = \"59s\""),
    );
    let arguments = ["campaign", "short.toml", "--profile", "my.toml"];
    let refused = session.hilrig(&arguments);
    assert_eq!(refused.status.code(), Some(2));
    let error = text(&refused.stderr);
    let line = profile
        .lines()
        .position(|line| line.starts_with("heal"))
        .expect("it has one");
    let expected = format!("my.toml:{}: time.heal: leaves less than 5s", line + 1);
    assert!(error.contains(&expected), "{error}");
}
