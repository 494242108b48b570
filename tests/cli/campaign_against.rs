//! New, fixed and still failing causes since an earlier campaign, in folders with known answers.

use serde_json::Value;

use super::campaign_folder::Folder;
use super::{Session, shipped, text};

/// Runs `arguments`: exit code, standard output, standard error.
fn hilrig(session: &Session, arguments: &str) -> (Option<i32>, String, String) {
    let output = session.hilrig(&arguments.split_whitespace().collect::<Vec<_>>());
    let [stdout, stderr] = [&output.stdout, &output.stderr].map(|bytes| text(bytes).to_owned());
    (output.status.code(), stdout, stderr)
}

const ROOM: &str = "one room";
const TWO: Folder<'_> = Folder {
    scenarios: &[("room", ROOM), ("hall", "a hall")],
    seeds: 0..10,
    vary: "world",
};

/// Cause and change of each cause in the results of `dir`.
fn changes(session: &Session, dir: &str) -> Vec<(String, String)> {
    let json = session.read(&format!("{dir}/campaign.json"));
    let json: Value = serde_json::from_str(&json).expect("JSON");
    let causes = json["comparison"]["causes"].as_array().expect("compared");
    let field = |cause: &Value, name: &str| cause[name].as_str().expect("text").to_owned();
    let pairs = causes
        .iter()
        .map(|cause| (field(cause, "cause"), field(cause, "change")));
    pairs.collect()
}

fn pairs(expected: &[(&str, &str)]) -> Vec<(String, String)> {
    let owned = expected.iter().map(|&(a, b)| (a.to_owned(), b.to_owned()));
    owned.collect()
}

/// One cause for each possible change. "masked" now fails with another cause; of the two runs with
/// "late", one was not repeated.
#[test]
fn each_cause_is_new_fixed_still_failing_or_not_known() {
    let session = Session::new("against-causes");
    let earlier = [
        ("hall", 0, Some("settled")),
        ("hall", 1, Some("settled")),
        ("hall", 2, Some("no-collision")),
        ("hall", 3, Some("no-collision")),
        ("room", 0, Some("masked")),
        ("room", 1, Some("late")),
        ("room", 2, Some("late")),
        ("room", 3, None),
    ];
    let now = [
        ("hall", 0, None),
        ("hall", 1, None),
        ("hall", 2, Some("no-collision")),
        ("hall", 3, None),
        ("room", 0, Some("no-collision")),
        ("room", 1, None),
        ("room", 3, Some("lost<pose>")),
        ("room", 4, Some("lost<pose>")),
    ];
    TWO.write(&session, "before", &earlier);
    TWO.write(&session, "now", &now);
    let (code, said, errors) = hilrig(&session, "campaign merge now --out all --against before");
    assert_eq!(code, Some(1), "{errors}");
    let expected = [
        ("lost<pose>", "new"),
        ("no-collision", "still-failing"),
        ("late", "not-known"),
        ("masked", "not-known"),
        ("settled", "fixed"),
    ];
    assert_eq!(changes(&session, "all"), pairs(&expected));
    let (_, compared) = said.split_once("compared with ").expect("it is said");
    let (compared, _) = compared.split_once("table in").expect("the end");
    insta::assert_snapshot!(compared, @r"
    before (hilrig 0.0.9): 1 new, 1 still failing, 2 not known, 1 fixed; 7 runs in both
      new: lost<pose>
             2 runs (before: 1 pass, 1 not run), first room seed 3
      still failing: no-collision
             2 runs, 2 before (now: 1 fail alike, 1 pass), first hall seed 2
      not known: late
             2 runs before (now: 1 pass, 1 not run), first room seed 1
      not known: masked
             1 runs before (now: 1 fail otherwise), first room seed 0
      fixed: settled
             2 runs before (now: 2 pass), first hall seed 0
    ");
    let page = session.read("all/campaign.html");
    assert!(
        page.contains("<td>lost&lt;pose&gt;<td class=\"bad\">new<"),
        "{page}"
    );
    assert!(
        page.contains("<td>settled<td class=\"good\">fixed<"),
        "{page}"
    );
}

/// Runs with equal names and seeds are different runs if the scenario or the variation was changed.
/// A pass then proves nothing.
#[test]
fn nothing_is_fixed_in_a_scenario_that_was_changed() {
    let session = Session::new("against-changed");
    TWO.write(&session, "before", &[("room", 0, Some("settled"))]);
    let room = Folder {
        scenarios: &[("room", "another room"), ("hall", "a hall")],
        ..TWO
    };
    let vary = Folder {
        vary: "faults",
        ..TWO
    };
    let changed = "  scenario room differs: its runs are not compared\n";
    for (folder, dir, expected, note) in [
        (&room, "room", "not-known", changed),
        (
            &vary,
            "vary",
            "not-known",
            "  --vary or --profile differs: no run is compared\n",
        ),
        (&TWO, "same", "fixed", "; 1 runs in both\n"),
    ] {
        folder.write(&session, dir, &[("room", 0, None)]);
        let merge = format!("campaign merge {dir} --out all-{dir} --against before");
        let (_, said, _) = hilrig(&session, &merge);
        let all = format!("all-{dir}");
        assert_eq!(changes(&session, &all), pairs(&[("settled", expected)]));
        assert_eq!(said.contains(" differs: "), dir != "same", "{said}");
        assert!(said.contains(note), "{said}");
    }
}

/// The exit code is that of the campaign: 0 if its runs pass, whatever failed earlier; 1 for
/// failures, also for old ones. A comment in the scenario does not make it another scenario.
#[test]
fn a_campaign_is_compared_and_keeps_its_exit_code() {
    const CAUSE: &str = "waypoints-visited: never moved";
    let session = Session::new("against-campaign");
    let short = shipped("empty-room").replace("\"90s\"", "\"2s\"");
    let calm = short.replace("visit_within_mm = 200", "");
    for (name, scenario, code, change) in [
        ("calm", &calm, 0, "fixed"),
        ("short", &short, 1, "still-failing"),
    ] {
        session.write(&format!("{name}.toml"), scenario);
        let commented = format!("# as it was\n{scenario}");
        let before = Folder {
            scenarios: &[("empty-room", &commented)],
            seeds: 0..5,
            vary: "none",
        };
        before.write(&session, "before", &[("empty-room", 1, Some(CAUSE))]);
        let campaign = format!("campaign {name}.toml --seeds 0..2 --out {name} --against before");
        let (found, said, errors) = hilrig(&session, &campaign);
        assert_eq!(found, Some(code), "{said}{errors}");
        assert_eq!(changes(&session, name), pairs(&[(CAUSE, change)]), "{said}");
    }
}

/// The error is reported before the first run, not at the end of a long campaign; a single shard
/// has too few runs to compare.
#[test]
fn what_cannot_be_compared_is_refused_at_once() {
    let session = Session::new("against-refused");
    session.write("short.toml", &shipped("empty-room"));
    std::fs::create_dir(session.path("empty")).expect("room");
    let campaign = "campaign short.toml --out night";
    for (more, expected) in [
        ("--against nowhere", "nowhere/plan.json: "),
        ("--against empty", "expected the plan of a campaign"),
        ("--against short.toml", "short.toml/plan.json: "),
        ("--against empty --shard 0/2", "--shard"),
    ] {
        let (code, _, errors) = hilrig(&session, &format!("{campaign} {more}"));
        assert_eq!(code, Some(2), "{errors}");
        assert!(errors.contains(expected), "{errors}");
        assert!(!session.path("night").exists(), "{more}");
    }
}
