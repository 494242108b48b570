//! Rules for the robot of another crate. Each of ten rules is kept by a valid run and broken by a
//! mutant; the tests check the messages.

use std::path::Path;

use hilrig_engine::robots::{self, Dut, PcEnd, Wired};
use hilrig_engine::run::check::{Check, Status};
use hilrig_engine::run::{Outcome, Run};
use hilrig_engine::scenario::{Scenario, ScenarioError};
use protocols::avr::{ChecksumOrder, Frame};
use protocols::{Instant, LineConfig};

/// The robot's driver: it drives until `stops_ms`, then orders 0. It weighs every second.
#[derive(Clone, Copy, Debug)]
struct Driver {
    cm_s: i8,
    stops_ms: u64,
    /// Time at which the robot drives again for a moment.
    again_ms: u64,
    /// Time at which it reverses.
    back_ms: u64,
    /// Time from which on the checksums of three orders are wrong.
    damage_ms: u64,
}

const SOUND: Driver = Driver {
    cm_s: 20,
    stops_ms: 6_500,
    again_ms: u64::MAX,
    back_ms: u64::MAX,
    damage_ms: u64::MAX,
};

impl Driver {
    fn speed_at(&self, ms: u64) -> i8 {
        match ms {
            _ if ms < 500 => 0,
            _ if (self.back_ms..self.back_ms.saturating_add(300)).contains(&ms) => -20,
            _ if (self.again_ms..self.again_ms.saturating_add(300)).contains(&ms) => 5,
            _ if ms < self.stops_ms => self.cm_s,
            _ => 0,
        }
    }
}

fn porter() -> String {
    std::fs::read_to_string("tests/rules/porter.toml").expect("is there")
}

fn wired(text: String) -> Result<(Scenario, Wired), ScenarioError> {
    let path = Path::new("tests/rules/porter.toml");
    let (scenario, source) = Scenario::parse(path, text)?;
    let wired = robots::wire(&scenario, &source, Dut::External, PcEnd::External)?;
    Ok((scenario, wired))
}

fn drive(driver: Driver, text: String) -> Outcome {
    let (scenario, wired) = wired(text).expect("sound");
    let node = |name: &str| {
        let mut ends = wired.open_ends.iter();
        ends.find(|end| end.name == name).expect("offered").node
    };
    let (wheels, scale) = (node("wheels"), node("scale"));
    let duration = scenario.duration.instant();
    let mut run = Run::with_rig(scenario, wired.rig, wired.instruments);
    for (node, baud) in [(wheels, 115_200), (scale, 9_600)] {
        run.rig.set_line_config(node, LineConfig::new_8n1(baud));
    }
    for ms in (0..duration.as_millis()).step_by(100) {
        let speed = driver.speed_at(ms);
        let bytes = [speed, speed].map(i8::cast_unsigned);
        let mut frame = Frame::write(1, &bytes, ChecksumOrder::LowFirst)
            .as_bytes()
            .to_vec();
        if (driver.damage_ms..driver.damage_ms.saturating_add(300)).contains(&ms) {
            frame[3] ^= 1;
        }
        run.rig.inject(wheels, &frame);
        if ms % 1_000 == 0 {
            run.rig.inject(scale, b"W\n");
        }
        run.go_on_until(Instant::from_millis(ms + 100));
    }
    run.judge()
}

/// Checks of rules with this status, without the prefix.
fn rules(outcome: &Outcome, status: Status) -> Vec<&str> {
    let checks = outcome.checks.iter();
    let checks = checks.filter(|check| check.status == status);
    checks
        .filter_map(|check| check.name.strip_prefix("rule-"))
        .collect()
}

fn detail<'a>(outcome: &'a Outcome, name: &str) -> &'a Check {
    let mut checks = outcome.checks.iter();
    checks.find(|check| check.name == name).expect("judged")
}

const RULES: [&str; 10] = [
    "slow",
    "forward",
    "scale-answers",
    "load",
    "arrives",
    "no-contact",
    "obeys",
    "stays-put",
    "sound-frames",
    "careful",
];

#[test]
fn a_sound_run_keeps_all_ten_rules() {
    let outcome = drive(SOUND, porter());
    assert_eq!(
        rules(&outcome, Status::Pass),
        RULES,
        "{:#?}",
        outcome.checks
    );
}

/// A mutant: its name, its driver, its additions to the scenario, the rules that it breaks, and the
/// message of the first of them.
type Mutant = (
    &'static str,
    Driver,
    &'static str,
    &'static [&'static str],
    &'static str,
);

/// The figures: 28 cm/s are 0.28; the robot needs 0.3 s from 0 to its speed; a request of two bytes
/// at 9600 baud ends 2 ms after its start, and its answer is missed 200 ms later.
const MUTANTS: [Mutant; 11] = [
    (
        "too fast",
        Driver {
            cm_s: 28,
            stops_ms: 4_800,
            ..SOUND
        },
        "",
        &["slow"],
        "axis left, set-point is 0.28; expected always axis left, set-point <= 0.25",
    ),
    (
        "backwards",
        Driver {
            back_ms: 3_000,
            stops_ms: 7_500,
            ..SOUND
        },
        "",
        &["forward"],
        "; expected never axis left, actual value < -0.01, from 500ms",
    ),
    (
        "the scale is off",
        SOUND,
        "kind = \"off\"\ndevice = \"scale\"\nfrom = \"4500ms\"\nuntil = \"8500ms\"",
        &["scale-answers"],
        "asked at 5.002083 s, not frame on scale to-master with \"reading\" until then",
    ),
    (
        "overloaded",
        SOUND,
        "kind = \"device\"\ndevice = \"scale\"\nfault = \"overloaded\"\nfrom = \"3500ms\"",
        &["load"],
        "weight on scale is 250; expected always frame on scale to-master, weight < 100; 8 times in all",
    ),
    (
        "stops on the way",
        Driver {
            stops_ms: 4_000,
            ..SOUND
        },
        "",
        &["arrives"],
        "did not come true; expected eventually robot within 0.1 m of 2.2, 1, until 10s",
    ),
    (
        "drives into the wall",
        Driver {
            stops_ms: 12_000,
            ..SOUND
        },
        "",
        &["no-contact", "careful"],
        "contact at 0.198 m/s; expected never contact",
    ),
    (
        "drives on, fast",
        Driver {
            stops_ms: 8_500,
            ..SOUND
        },
        "",
        &["careful"],
        "clearance in m is 0.4",
    ),
    (
        "the door opens near the wall",
        Driver {
            cm_s: 15,
            stops_ms: 9_600,
            ..SOUND
        },
        "kind = \"device\"\ndevice = \"scale\"\nfault = \"ajar\"\nfrom = \"9s\"",
        &["careful"],
        "scale door is \"open\"",
    ),
    (
        "the wheels do not obey",
        SOUND,
        "kind = \"off\"\ndevices = [\"nothing\"]",
        &["arrives", "obeys"],
        "did not come true",
    ),
    (
        "drives again",
        Driver {
            again_ms: 7_500,
            ..SOUND
        },
        "",
        &["stays-put"],
        "; expected after frame on wheels to-device with \"left=0\", within 500ms always speed in m/s == 0 for 1s, from 6600ms",
    ),
    (
        "damaged frames, which the device's log folds",
        Driver {
            damage_ms: 3_000,
            ..SOUND
        },
        "",
        &["sound-frames"],
        "event bad-checksum of wheels; expected never event bad-checksum of wheels; 3 times in all",
    ),
];

#[test]
fn each_rule_is_broken_by_its_mutant_and_says_how() {
    let (mut left, mut wrong) = (RULES.to_vec(), Vec::new());
    for (what, driver, fault, broken, says) in MUTANTS {
        let text = match fault {
            "" => porter(),
            // With this addition the wheels hardly turn.
            "kind = \"off\"\ndevices = [\"nothing\"]" => {
                porter().replace("speed_m_s = 0.01 }", "speed_m_s = 0.0001 }")
            }
            fault => format!("{}\n[[fault]]\n{fault}\n", porter()),
        };
        let outcome = drive(driver, text);
        let found = rules(&outcome, Status::Fail);
        let check = detail(&outcome, &format!("rule-{}", broken[0]));
        if found != broken || !check.detail.contains(says) {
            wrong.push(format!("{what}: broke {found:?}; {check}"));
        }
        left.retain(|rule| !broken.contains(rule));
    }
    assert_eq!(wrong, [""; 0]);
    assert_eq!(left, [""; 0], "no mutant breaks these");
}

/// Three orders are damaged. They count if they come after the time from which violations count,
/// and if their link has no fault to the end.
#[test]
fn violations_count_from_their_time_on() {
    for (damage_ms, from, exempt, status, says) in [
        (
            3_000,
            "5s",
            "[]",
            Status::Pass,
            "0 broken rules from 5.000000 s on",
        ),
        (
            3_000,
            "2s",
            "[]",
            Status::Fail,
            "at most 0: 3 times bad-checksum of wheels",
        ),
        (
            11_500,
            "11s",
            "[]",
            Status::Fail,
            "3 broken rules from 11.000000 s on",
        ),
        (
            3_000,
            "2s",
            "[\"scale\"]",
            Status::Fail,
            "3 times bad-checksum",
        ),
        (3_000, "2s", "[\"wheels\"]", Status::Pass, "0 broken rules"),
        (
            3_000,
            "20s",
            "[]",
            Status::NotObserved,
            "the run ended before 20.000000 s",
        ),
    ] {
        let driver = Driver { damage_ms, ..SOUND };
        let more = format!(
            "\n[expect]\nviolations_max = 0\nviolations_from = \"{from}\"\n\
             [expect.safety]\nalive_without = {exempt}\n"
        );
        let outcome = drive(driver, porter() + &more);
        let check = detail(&outcome, "violations");
        assert_eq!(check.status, status, "{check}");
        assert!(check.detail.contains(says), "{check}");
    }
}

/// Three orders are damaged at 3 s or at 11.5 s. They do not count during a fault that has an end,
/// and for 5 s after it, whether its time is planned or a frame begins it.
#[test]
fn violations_do_not_count_during_a_fault() {
    let planned = "from = '2500ms'\nuntil = '3500ms'";
    let begun_by_a_frame = "at_frame = 3\nlasting = '300ms'";
    let to_the_end = "from = '2500ms'";
    for (damage_ms, times, status) in [
        (3_000, planned, Status::Pass),
        (11_500, planned, Status::Fail),
        (3_000, begun_by_a_frame, Status::Pass),
        (11_500, begun_by_a_frame, Status::Fail),
        (3_000, to_the_end, Status::Fail),
        (3_000, "from = '50ms'\nuntil = '11s'", Status::NotObserved),
    ] {
        let driver = Driver { damage_ms, ..SOUND };
        let more = format!(
            "\n[expect]\nviolations_max = 0\nviolations_from = \"100ms\"\n[[fault]]\n\
             kind = \"latency\"\nlink = \"wheels\"\ndirection = \"to-device\"\nby = \"1us\"\n{times}\n"
        );
        let outcome = drive(driver, porter() + &more);
        let check = detail(&outcome, "violations");
        assert_eq!(check.status, status, "{damage_ms} {times}: {check}");
    }
}

/// Rules that a valid run must not pass, because their subject never appeared or cannot be
/// compared: the addition to the scenario, the verdict, and its message.
const UNPROVED: [(&str, Status, &str); 3] = [
    (
        "never = { event = { rule = \"over-run\", source = \"pc\" } }",
        Status::NotObserved,
        "pc logged nothing",
    ),
    (
        "never = { all = [{ frame = { link = \"scale\", direction = \"to-master\", \
         field = \"reading\", value = 1 } }, { axis = { name = \"left\", op = \">\", value = 9 } }] }",
        Status::NotObserved,
        "frames arrived on scale, the last: ",
    ),
    (
        "never = { frame = { link = \"scale\", direction = \"to-master\", field = \"door\", \
         op = \">\", value = 5 } }",
        Status::Fail,
        "door on scale is \"shut\"",
    ),
];

#[test]
fn what_was_not_observed_is_not_passed() {
    let mut text = porter();
    for (index, (rule, ..)) in UNPROVED.iter().enumerate() {
        text += &format!("\n[[expect.rule]]\nname = \"unproved-{index}\"\n{rule}\n");
    }
    let outcome = drive(SOUND, text);
    assert_eq!(outcome.unobserved_rules().count(), 2);
    for (index, (rule, status, says)) in UNPROVED.iter().enumerate() {
        let check = detail(&outcome, &format!("rule-unproved-{index}"));
        assert_eq!(check.status, *status, "{rule}: {check}");
        assert!(check.detail.contains(says), "{rule}: {check}");
    }
    for (rule, source, says) in [
        (
            "bad-cheksum",
            "wheels",
            "rule: is \"bad-cheksum\", did you mean \"bad-checksum\"?",
        ),
        (
            "to-fast",
            "scale",
            "rule: is \"to-fast\", did you mean \"too-fast\"?",
        ),
        (
            "wieght",
            "scale",
            "rule: is \"wieght\", expected one of bad-character, ",
        ),
    ] {
        let more = format!(
            "\n[[expect.rule]]\nname = \"name\"\nnever = {{ event = {{ rule = \"{rule}\", \
             source = \"{source}\" }} }}\n"
        );
        let error = wired(porter() + &more).err().expect("refused").to_string();
        assert!(error.contains(says), "{error}");
    }
    let wrong = "\n[[expect.rule]]\nname = \"name\"\nnever = { frame = { link = \"scale\", \
                 direction = \"to-master\", field = \"wieght\", value = 1 } }\n";
    let error = wired(porter() + wrong).err().expect("refused").to_string();
    assert!(error.contains("did you mean \"weight\"?"), "{error}");
    let wrong = "\n[[expect.rule]]\nname = \"type\"\nnever = { register = { device = \"wheels\", \
                 name = \"left\", value = \"fast\" } }\n";
    let error = wired(porter() + wrong).err().expect("refused").to_string();
    assert!(
        error.contains("expected a value of the same type"),
        "{error}"
    );
}

/// A sound run that leaves one rule unobserved does not pass, unless the rule allows it.
#[test]
fn a_run_passes_only_with_each_rule_observed() {
    let rule = "\n[[expect.rule]]\nname = \"wet\"\nafter = { event = { rule = \"made-safe\", \
                source = \"wheels\" } }\nnever = { contact = {} }\n";
    for (more, passes) in [("", false), ("may_be_unobserved = true\n", true)] {
        let outcome = drive(SOUND, porter() + rule + more);
        assert_eq!(detail(&outcome, "rule-wet").status, Status::NotObserved);
        let is_failed = |check: &Check| check.status == Status::Fail;
        assert!(
            !outcome.checks.iter().any(is_failed),
            "{:#?}",
            outcome.checks
        );
        assert_eq!(outcome.passed(), passes, "{more}");
    }
}

/// Times of rules: the addition to the scenario, the verdict and its message. The scale gets a
/// request each second and replies after 30 ms. The left wheel turns from 0.5 s to 6.5 s, and the
/// robot is beyond x = 1.5 m from about 3 s on.
const TIMES: [(&str, Status, &str); 8] = [
    // The requests at 5, 6 and 7 s have no answer until 8.022 s, which is in time for the last
    // request.
    (
        "after = { frame = { link = \"scale\", direction = \"to-device\", contains = \"weigh\" } }\n\
         within = \"1200ms\"\neventually = { frame = { link = \"scale\", direction = \"to-master\", \
         contains = \"reading\" } }\n[[fault]]\nkind = \"off\"\ndevice = \"scale\"\n\
         from = \"4500ms\"\nuntil = \"7500ms\"",
        Status::Fail,
        "; 2 times in all",
    ),
    // One heavy reading, at 6.022 s, for the requests of 5 and 6 s.
    (
        "after = { frame = { link = \"scale\", direction = \"to-device\", contains = \"weigh\" } }\n\
         within = \"1500ms\"\nfrom = \"4500ms\"\nuntil = \"6900ms\"\neventually = { frame = { \
         link = \"scale\", direction = \"to-master\", field = \"weight\", op = \">\", value = 100 } }\n\
         [[fault]]\nkind = \"device\"\ndevice = \"scale\"\nfault = \"overloaded\"\n\
         from = \"5500ms\"\nuntil = \"6500ms\"",
        Status::Pass,
        "2 times; the slowest after 1.0",
    ),
    (
        "each = true\nafter = { frame = { link = \"scale\", direction = \"to-device\", contains = \"weigh\" } }\n\
         within = \"1500ms\"\nfrom = \"4500ms\"\nuntil = \"6900ms\"\neventually = { frame = { \
         link = \"scale\", direction = \"to-master\", field = \"weight\", op = \">\", value = 100 } }\n\
         [[fault]]\nkind = \"device\"\ndevice = \"scale\"\nfault = \"overloaded\"\n\
         from = \"5500ms\"\nuntil = \"6500ms\"",
        Status::Fail,
        "asked at 6.0",
    ),
    // The same frame sets both wheels: it is the trigger, so it is no answer. The next frame comes
    // 100 ms later.
    (
        "after = { frame = { link = \"wheels\", direction = \"to-device\", contains = \"left=0\" } }\n\
         eventually = { frame = { link = \"wheels\", direction = \"to-device\", \
         contains = \"right=0\" } }\nwithin = \"5ms\"",
        Status::Fail,
        "asked at 0.00",
    ),
    // `after` stays true, so it triggers the rule once: before the end of `after` at the first
    // reading.
    (
        "after = { axis = { name = \"left\", op = \">\", value = 0.1 } }\n\
         never = { robot = { of = \"x-m\", op = \">\", value = 1.5 } }\n\
         until = { frame = { link = \"scale\", direction = \"to-master\", contains = \"reading\" } }",
        Status::Pass,
        "begun once",
    ),
    (
        "after = { axis = { name = \"left\", op = \">\", value = 0.1 } }\nfrom = \"2s\"\n\
         never = { robot = { of = \"x-m\", op = \">\", value = 1.5 } }",
        Status::NotObserved,
        "did not come true",
    ),
    // The state counts as the answer at the sample after the moment.
    (
        "after = { frame = { link = \"scale\", direction = \"to-master\", contains = \"reading\" } }\n\
         within = \"10ms\"\nuntil = \"6s\"\nfrom = \"1s\"\n\
         eventually = { axis = { name = \"left\", op = \">\", value = 0.1 } }",
        Status::Pass,
        "; the slowest after 0.00",
    ),
    // The condition holds once in this window; ten characters at 9600 baud need 10.4 ms after the
    // 20 ms of the scale.
    (
        "after = { frame = { link = \"scale\", direction = \"to-device\", contains = \"weigh\" } }\n\
         from = \"3500ms\"\nuntil = \"4500ms\"\neventually = { frame = { link = \"scale\", \
         direction = \"to-master\", contains = \"reading\" } }",
        Status::Pass,
        "once; the slowest after 0.030 s",
    ),
];

#[test]
fn times_of_rules_are_kept_to_the_letter() {
    let mut wrong = Vec::new();
    for (rule, status, says) in TIMES {
        let text = format!("{}\n[[expect.rule]]\nname = \"time\"\n{rule}\n", porter());
        let outcome = drive(SOUND, text);
        let check = detail(&outcome, "rule-time");
        if check.status != status || !check.detail.contains(says) {
            wrong.push(format!("{rule}: {check}"));
        }
    }
    assert_eq!(wrong, [""; 0]);
}

/// 1,100 bytes ask before the one answer, at 1 s: more than a rule keeps. One answer is that of
/// all, in time for the oldest, unless each needs its own.
#[test]
fn more_times_may_wait_than_a_rule_keeps() {
    let rule = |more: &str| {
        let text = "\n[[expect.rule]]\nname = \"many\"\nafter = { bytes = { link = \"wheels\", \
                    direction = \"to-device\", hex = \"55\" } }\neventually = { frame = { link = \
                    \"scale\", direction = \"to-master\", contains = \"reading\" } }\n";
        let (scenario, wired) = wired(porter() + text + more).expect("sound");
        let [wheels, scale] = ["wheels", "scale"].map(|name| {
            let mut ends = wired.open_ends.iter();
            ends.find(|end| end.name == name).expect("offered").node
        });
        let mut run = Run::with_rig(scenario, wired.rig, wired.instruments);
        run.rig
            .set_line_config(wheels, LineConfig::new_8n1(115_200));
        run.rig.set_line_config(scale, LineConfig::new_8n1(9_600));
        for _ in 0..11 {
            run.rig.inject(wheels, &[0x55; 100]);
            run.go_on_until(run.rig.now() + core::time::Duration::from_millis(20));
        }
        run.go_on_until(Instant::from_secs(1));
        run.rig.inject(scale, b"W\n");
        run.go_on_until(Instant::from_secs(12));
        detail(&run.judge(), "rule-many").clone()
    };
    for (more, status, says) in [
        ("", Status::Pass, "1100 times; the slowest after 1.0"),
        (
            "within = \"5s\"",
            Status::Pass,
            "1100 times; the slowest after 1.0",
        ),
        ("within = \"500ms\"", Status::Fail, "by 0.50"),
        ("each = true", Status::Fail, "nothing until the end"),
    ] {
        let check = rule(more);
        assert_eq!(check.status, status, "{more}: {check}");
        assert!(check.detail.contains(says), "{more}: {check}");
    }
}

/// Questions that their own frame or contact must not answer: the rule, and its verdict.
#[test]
fn a_question_is_not_its_own_answer() {
    let frame = |direction: &str, words: &str| {
        format!(
            "{{ frame = {{ link = \"scale\", direction = \"{direction}\", contains = \"{words}\" }} }}"
        )
    };
    let contact = |more: &str| format!("{{ contact = {{ {more} }} }}");
    let event = |more: &str| format!("{{ event = {{ rule = \"bad-checksum\"{more} }} }}");
    let driver = Driver {
        stops_ms: 12_000,
        damage_ms: 3_000,
        ..SOUND
    };
    let bytes = "{ bytes = { link = \"scale\", direction = \"to-device\", hex = \"0a\" } }";
    for (after, eventually, passes) in [
        (frame("to-device", "weigh"), frame("to-device", ""), false),
        (frame("to-device", "weigh"), bytes.to_owned(), false),
        (frame("to-device", "weigh"), frame("to-master", ""), true),
        (contact(""), contact("faster_than_m_s = 0"), false),
        (event(", source = \"wheels\""), event(""), false),
    ] {
        let rule = format!(
            "\n[[expect.rule]]\nname = \"own\"\nafter = {after}\nwithin = \"90ms\"\n\
             eventually = {eventually}\n"
        );
        let outcome = drive(driver, porter() + &rule);
        let check = detail(&outcome, "rule-own");
        assert_eq!(check.status == Status::Pass, passes, "{rule}{check}");
        assert!(!check.detail.contains("did not come true"), "{rule}{check}");
    }
}

/// A run keeps its own path and breaks it if it stops on the way; a missing file is refused.
#[test]
fn a_golden_path_is_kept_or_broken() {
    let line = |(at, pose): &(Instant, emulators::world::Pose)| {
        format!("{at} {} {} 0 0 0 0 1\n", pose.x, pose.y)
    };
    let lines: String = drive(SOUND, porter()).truth.iter().map(line).collect();
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("golden.tum");
    std::fs::write(&path, lines).expect("a fresh file");
    let golden = format!("\n[expect.golden]\npath = {path:?}\npath_within_mm = 30\n");
    let stopped = Driver {
        stops_ms: 4_000,
        ..SOUND
    };
    for (driver, status) in [(SOUND, Status::Pass), (stopped, Status::Fail)] {
        let outcome = drive(driver, porter() + &golden);
        let check = detail(&outcome, "golden-path");
        assert_eq!(check.status, status, "{check}");
    }
    for (wrong, says) in [
        (
            golden.replace("golden.tum", "gone.tum"),
            "expect.golden.path: ",
        ),
        (
            golden.replace("path_within_mm = 30\n", ""),
            "expect.golden.path_within_mm: expected",
        ),
        (
            golden.replace("path_within_mm", "map_walls_min"),
            "expect.golden.path_within_mm: expected",
        ),
    ] {
        let error = wired(porter() + &wrong).err().expect("refused").to_string();
        assert!(error.contains(says), "{error}");
    }
}

/// Frames that end only by a silence count like other frames, and a rule that they break fails.
#[test]
fn frames_that_a_silence_ends_are_judged() {
    let text = porter().replace("scale.toml", "silent-scale.toml");
    let sound = drive(SOUND, text.clone());
    assert_eq!(rules(&sound, Status::Pass), RULES, "{:#?}", sound.checks);
    let fault = "\n[[fault]]\nkind = \"device\"\ndevice = \"scale\"\nfault = \"overloaded\"\n\
                 from = \"3500ms\"\n";
    let broken = drive(SOUND, text + fault);
    assert_eq!(
        rules(&broken, Status::Fail),
        ["load"],
        "{:#?}",
        broken.checks
    );
    let load = &detail(&broken, "rule-load").detail;
    assert!(load.ends_with("; 8 times in all"), "{load}");
}

/// Steps of the rig: the scale's door opens at 3 s. A frame that sets the left wheel to 9 cm/s
/// reaches the board at 7.05 s, between two orders of the driver. A wrong name is rejected with its
/// position.
#[test]
fn a_step_sets_a_value_and_puts_bytes_on_a_line() {
    let step = |at: &str, what: &str| format!("\n[[mission.step]]\nat = \"{at}\"\ndo = {what}\n");
    let door = step(
        "3s",
        "{ set = { device = \"scale\", name = \"door\", value = \"open\" } }",
    );
    let frame = Frame::write(1, &[9], ChecksumOrder::LowFirst);
    let pairs: Vec<String> = frame
        .as_bytes()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let bytes = format!(
        "{{ inject = {{ link = \"wheels\", direction = \"to-device\", hex = \"{}\" }} }}",
        pairs.join(" ")
    );
    let rules = "\n[[expect.rule]]\nname = \"opens\"\neventually = { frame = { link = \"scale\", \
        direction = \"to-master\", contains = \"open\" } }\nuntil = \"3900ms\"\n\
        [[expect.rule]]\nname = \"told\"\nfrom = \"6900ms\"\neventually = { axis = \
        { name = \"left\", value = 0.09 } }\n";
    let told = |steps: &str| {
        let outcome = drive(SOUND, format!("{}{steps}{rules}", porter()));
        let broken = rules_of(&outcome, &["opens", "told"]);
        (
            broken,
            outcome
                .events
                .iter()
                .map(ToString::to_string)
                .collect::<Vec<_>>(),
        )
    };
    assert_eq!(told("").0, [Status::Fail, Status::Fail]);
    let (kept, events) = told(&format!("{door}{}", step("7050ms", &bytes)));
    assert_eq!(kept, [Status::Pass, Status::Pass], "{events:?}");
    let said = |words: &str| events.iter().any(|event| event.contains(words));
    assert!(
        said("value-set: scale door = \"open\"") && said("bytes-injected"),
        "{events:?}"
    );
    let refused = |steps: String| wired(porter() + &steps).err().expect("refused").to_string();
    let rows = [
        (door.replace("scale", "scael"), "did you mean \"scale\"?"),
        (door.replace("door", "dor"), "did you mean \"door\"?"),
        (
            step("1s", &bytes.replace("wheels", "wheel")),
            "did you mean \"wheels\"?",
        ),
        (step("1s", &bytes.replace("ab", "a")), "hex"),
        (step("1s", "{ mode = \"stop\" }"), "expected inject or set"),
    ];
    for (steps, words) in rows {
        let error = refused(steps.clone());
        assert!(
            error.starts_with("tests/rules/porter.toml:"),
            "{steps}: {error}"
        );
        assert!(error.contains(words), "{steps}: {error}");
    }
}

fn rules_of(outcome: &Outcome, names: &[&str]) -> Vec<Status> {
    let status = |name: &&str| detail(outcome, &format!("rule-{name}")).status;
    names.iter().map(status).collect()
}
