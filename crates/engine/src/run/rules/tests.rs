//! Rules at the moments on both sides of their times; whole runs are in `tests/rules.rs`.

use std::collections::BTreeMap;

use super::*;
use crate::rig::bare::linked;
use crate::robots::Status;
use crate::robots::instruments::Unknown;
use crate::run::check::safety::puppet::scenario;
use crate::run::check::safety::tests::drive;

/// The drive's set-point is more than 0.5.
const FAST: &str = "{ axis = { name = \"drive\", op = \">\", value = 0.5 } }";
/// A byte 01 on the link `ask`, and 02 on the link `answer`.
const ASK: &str = "{ bytes = { link = \"ask\", direction = \"to-master\", hex = \"01\" } }";
const ANSWER: &str = "{ bytes = { link = \"answer\", direction = \"to-master\", hex = \"02\" } }";

struct Bench {
    rig: Rig,
    rules: Rules,
    nodes: [usize; 2],
}

/// One rule on a rig with the links `ask` and `answer`, on which a byte takes 10 us.
fn bench(rule: &str) -> Bench {
    let (mut rig, ends) = linked(["ask", "answer"], 1_000_000);
    let spec: RuleSpec = toml::from_str(&format!("name = \"r\"\n{rule}")).expect("a rule");
    let (lines, devices) = (LineWatches::default(), Arc::new(BTreeMap::new()));
    let moment = Moment {
        rig: &rig,
        instruments: &Unknown,
        axes: None,
        devices: &devices,
        waypoints: [0; 2],
    };
    let rule = Rule::new(&spec, &moment, &lines).expect("its links exist");
    rig.add_tap(Box::new(lines));
    let (scenario, _) = scenario("");
    Bench {
        rig,
        rules: Rules {
            rules: vec![rule],
            refused: Vec::new(),
            devices,
            progress: Progress::new(&scenario.mission, &scenario.expect),
        },
        nodes: ends.map(|ends| ends[0].node),
    }
}

impl Bench {
    /// A look at this millisecond, with a set-point. At the same time 01 arrives for `a` in
    /// `bytes`, 02 for `b`, and 07 on both links for another letter.
    fn at(&mut self, millis: u64, bytes: &str, set_point: f64) -> &mut Self {
        let now = Instant::from_millis(millis);
        self.rig
            .run_until(Instant::from_nanos(now.as_nanos() - 10_000));
        for letter in bytes.chars() {
            let bytes: &[(usize, u8)] = match letter {
                'a' => &[(0, 1)],
                'b' => &[(1, 2)],
                _ => &[(0, 7), (1, 7)],
            };
            for &(link, byte) in bytes {
                self.rig.inject(self.nodes[link], &[byte]);
            }
        }
        self.rig.run_until(now);
        let axes = [drive(set_point)];
        self.rules.look(&self.rig, &Unknown, &axes, &[]);
        self
    }

    fn told(&self, is_over: bool) -> (Status, String) {
        let now = self.rig.now();
        let check = self.rules.checks(now, is_over).next().expect("one rule");
        assert!(check.name == "rule-r" || check.name == "goal-r");
        (check.status, check.detail)
    }

    /// The verdict at the end, and the beginning of its words.
    #[track_caller]
    fn ends(&self, status: Status, words: &str) {
        let (found, told) = self.told(true);
        assert_eq!(found, status, "{told}");
        assert!(told.starts_with(words), "{told}");
    }

    fn status(&self) -> Status {
        self.told(true).0
    }
}

use Status::{Fail, NotObserved, Pass};

const YES: f64 = 0.75;
const NO: f64 = 0.25;

/// A state that is wrong at several looks in a row is one break.
#[test]
fn a_state_holds_at_all_looks_or_breaks_the_rule() {
    let mut bench = bench(&format!("always = {FAST}"));
    bench.at(10, "", YES).at(20, "", 0.51);
    bench.ends(Pass, "held at all of 2 moments: always axis drive");
    bench.at(30, "", 0.5).at(40, "", NO);
    let first = "at 0.030000 s axis drive, set-point is 0.5; expected always axis drive";
    bench.ends(Fail, first);
    assert!(!bench.told(true).1.contains("in all"));
    bench.at(50, "", YES).at(60, "", NO);
    bench.ends(Fail, first);
    assert!(bench.told(true).1.ends_with("; 2 times in all"));
    let mut never = self::bench(&format!("never = {FAST}"));
    never.at(10, "", NO);
    assert_eq!(never.status(), Pass);
    assert_eq!(never.at(20, "", YES).status(), Fail);
}

/// From 20 to 40 ms, both ends included.
#[test]
fn a_rule_applies_in_its_time() {
    let judged = |millis: u64| {
        let keys = "from = \"20ms\"\nuntil = \"40ms\"";
        let mut bench = bench(&format!("always = {FAST}\n{keys}"));
        for at in [19, 20, 30, 40, 41] {
            bench.at(at, "", if at == millis { NO } else { YES });
        }
        bench.status()
    };
    assert_eq!([19, 20, 40, 41].map(judged), [Pass, Fail, Fail, Pass]);
    let mut early = bench(&format!("always = {FAST}\nfrom = \"20ms\""));
    early.at(19, "", YES);
    early.ends(
        NotObserved,
        "the run ended before its time; expected always",
    );
}

/// Without `after`, 50 ms from 20 ms on: at 70 ms at the latest.
#[test]
fn a_condition_comes_in_time_or_too_late() {
    let rule = format!("eventually = {FAST}\nwithin = \"50ms\"\nfrom = \"20ms\"");
    let mut late = bench(&rule);
    late.at(19, "", YES).at(70, "", NO);
    assert!(late.rules.awaits(late.rig.now()));
    let waits = "has not become true yet; expected";
    assert_eq!(late.told(false).0, NotObserved);
    assert!(late.told(false).1.starts_with(waits));
    late.ends(Fail, "did not come true; expected within 50ms eventually");
    late.at(71, "", YES);
    assert!(!late.rules.awaits(late.rig.now()));
    assert_eq!(late.told(false).0, Fail);
    let mut timely = bench(&rule);
    timely.at(70, "", YES).at(71, "", 0.8);
    timely.ends(
        Pass,
        "at 0.070000 s axis drive, set-point is 0.75: within 50ms",
    );
    let mut met = bench(&rule);
    met.at(30, "", YES);
    assert!(!met.rules.awaits(met.rig.now()));
    let mut early = bench(&rule);
    early.at(10, "", YES);
    assert!(early.rules.awaits(early.rig.now()));
    early.ends(NotObserved, "the run ended before its time; expected");
    // A condition ends the rule for good.
    let mut ended = bench(&format!("eventually = {FAST}\nuntil = {ASK}"));
    ended.at(10, "", NO).at(20, "a", NO).at(30, "", YES);
    assert!(!ended.rules.awaits(ended.rig.now()));
    assert_eq!((ended.told(false).0, ended.status()), (Fail, Fail));
}

/// An answer has 100 ms; it counts at its own time, not at that of the look.
#[test]
fn a_question_is_answered_in_time() {
    let rule = format!("eventually = {ANSWER}\nafter = {ASK}\nwithin = \"100ms\"");
    let mut timely = bench(&rule);
    timely.at(1_000, "a", NO);
    assert!(timely.rules.awaits(timely.rig.now()));
    let waits = "asked at 1.000000 s, the time is not up; expected";
    assert!(timely.told(true).1.starts_with(waits));
    timely.at(1_100, "b", NO);
    assert!(!timely.rules.awaits(timely.rig.now()));
    timely.ends(
        Pass,
        "once; the slowest after 0.100 s, at 1.000000 s: after ",
    );
    let mut late = bench(&rule);
    late.at(1_000, "a", NO).at(1_101, "b", NO);
    late.ends(Fail, "by 1.100000 s: asked at 1.000000 s, not ");
    assert!(!late.told(true).1.contains("in all"));
    let mut none = bench(&rule);
    none.at(1_000, "", NO).at(1_100, "", NO);
    let (status, told) = none.told(true);
    assert_eq!(status, NotObserved);
    assert!(told.contains(" did not come true"), "{told}");
    let mut open = bench(&format!("eventually = {ANSWER}\nafter = {ASK}"));
    open.at(1_000, "a", NO).at(9_000, "", NO);
    assert_eq!(open.told(false).0, NotObserved);
    open.ends(Fail, "asked at 1.000000 s, nothing until the end; expected");
    let mut early = bench(&format!("{rule}\nfrom = \"2s\""));
    early.at(1_000, "a", NO);
    early.ends(NotObserved, "the run ended before its time; expected");
}

/// Questions at 1,000 and 1,040 ms, an answer at 1,080 ms: it is that of both, or of the first.
#[test]
fn one_answer_is_that_of_all_questions_or_of_one() {
    let asked = |each: &str| {
        let rule = format!("eventually = {ANSWER}\nafter = {ASK}\nwithin = \"100ms\"\n{each}");
        let mut bench = bench(&rule);
        bench
            .at(1_000, "a", NO)
            .at(1_040, "a", NO)
            .at(1_080, "b", NO);
        bench
    };
    asked("").ends(Pass, "2 times; the slowest after 0.080 s, at 1.000000 s: ");
    let mut each = asked("each = true");
    each.ends(
        Pass,
        "once of 2; the slowest after 0.080 s, at 1.000000 s: ",
    );
    each.at(1_140, "", NO);
    assert_eq!(each.status(), Pass);
    each.at(1_141, "", NO);
    each.ends(Fail, "by 1.140000 s: asked at 1.040000 s");
    let mut both = asked("each = true");
    both.at(1_130, "b", NO);
    // The second one took 90 ms.
    both.ends(Pass, "2 times; the slowest after 0.090 s, at 1.040000 s: ");
    let mut three = bench(&format!(
        "eventually = {ANSWER}\nafter = {ASK}\nwithin = \"100ms\""
    ));
    for millis in [1_000, 1_010, 1_020, 2_000] {
        three.at(millis, if millis < 2_000 { "a" } else { "" }, NO);
    }
    three.ends(Fail, "by 1.100000 s: asked at 1.000000 s");
    assert!(three.told(true).1.ends_with("; 3 times in all"));
}

/// A frame of another line at the same time is an answer, and a state at its own look.
#[test]
fn an_answer_may_come_with_its_question() {
    let mut line = bench(&format!("eventually = {ANSWER}\nafter = {ASK}"));
    line.at(1_000, "ab", NO);
    line.ends(Pass, "once; the slowest after 0.000 s, at 1.000000 s: ");
    let state = format!("eventually = {FAST}\nafter = {ASK}");
    let mut with = bench(&state);
    with.at(1_000, "a", YES);
    assert_eq!(with.status(), Pass);
    let mut before = bench(&state);
    before.at(990, "", YES).at(1_000, "a", NO);
    assert_eq!(before.status(), Fail);
    let mut own = bench(&format!("eventually = {ASK}\nafter = {ASK}"));
    own.at(1_000, "a", NO);
    assert_eq!(own.status(), Fail, "no answer to itself");
    own.at(1_010, "a", NO);
    assert_eq!(own.rules.rules[0].seen.answers, 1);
}

/// A state that lasts asks once, each byte asks by itself.
#[test]
fn a_question_begins_when_its_condition_does() {
    let triggers = |bench: &Bench| bench.rules.rules[0].seen.triggers;
    let mut state = bench(&format!("eventually = {ANSWER}\nafter = {FAST}"));
    for (millis, set_point) in [(10, YES), (20, YES), (30, NO), (40, YES), (50, YES)] {
        state.at(millis, "", set_point);
    }
    assert_eq!(triggers(&state), 2);
    let mut bytes = bench(&format!("eventually = {ANSWER}\nafter = {ASK}"));
    bytes
        .at(10, "a", NO)
        .at(20, "a", NO)
        .at(30, "", NO)
        .at(40, "a", NO);
    assert_eq!(triggers(&bytes), 3);
    // A state that began before the time of the rule does not begin in it.
    let mut early = bench(&format!(
        "eventually = {ANSWER}\nafter = {FAST}\nfrom = \"20ms\""
    ));
    early.at(10, "", YES).at(20, "", YES);
    assert_eq!(triggers(&early), 0);
}

/// After a question at 1,000 ms the rule applies from 1,020 ms on, for 100 ms.
fn after(breaks_ms: u64, asks_ms: &[u64]) -> Status {
    let keys = "within = \"20ms\"\nlasting = \"100ms\"";
    let mut bench = bench(&format!("always = {FAST}\nafter = {ASK}\n{keys}"));
    for millis in 1_000..=1_400 {
        let bytes = if asks_ms.contains(&millis) { "a" } else { "" };
        bench.at(millis, bytes, if millis == breaks_ms { NO } else { YES });
    }
    bench.status()
}

#[test]
fn a_rule_applies_for_a_time_after_a_question() {
    let judged = |breaks| after(breaks, &[1_000]);
    assert_eq!(
        [1_019, 1_020, 1_120, 1_121].map(judged),
        [Pass, Fail, Fail, Pass]
    );
    // A second question within that time makes it longer, without another pause.
    let longer = |breaks| after(breaks, &[1_000, 1_100]);
    assert_eq!([1_105, 1_220, 1_221].map(longer), [Fail, Fail, Pass]);
    let at_its_end = |breaks| after(breaks, &[1_000, 1_120]);
    assert_eq!([1_130, 1_240].map(at_its_end), [Fail, Fail]);
    // One behind it begins anew.
    let anew = |breaks| after(breaks, &[1_000, 1_121]);
    assert_eq!(
        [1_130, 1_140, 1_141, 1_241, 1_242].map(anew),
        [Pass, Pass, Fail, Fail, Pass]
    );
}

/// Without a time to comply the moment of the question itself does not count; a condition ends it
/// until the next question.
#[test]
fn a_rule_applies_behind_its_question_until_a_condition() {
    let mut own = bench(&format!("always = {FAST}\nafter = {ASK}"));
    own.at(1_000, "a", NO);
    assert_eq!(own.status(), NotObserved);
    assert_eq!(own.at(1_001, "", YES).status(), Pass);
    assert_eq!(own.at(1_002, "", NO).status(), Fail);
    let mut until = bench(&format!("always = {FAST}\nafter = {ASK}\nuntil = {ANSWER}"));
    until
        .at(1_000, "a", YES)
        .at(1_010, "", YES)
        .at(1_050, "b", NO)
        .at(1_060, "", NO);
    until.ends(Pass, "held at all of 1 moments, begun once: after");
    assert_eq!(until.at(1_100, "a", YES).at(1_110, "", NO).status(), Fail);
    // Questions that wait for an answer are dropped as well.
    let mut asked = bench(&format!(
        "eventually = {FAST}\nafter = {ASK}\nuntil = {ANSWER}"
    ));
    asked.at(1_000, "a", NO).at(1_010, "b", NO);
    assert!(asked.rules.rules[0].seen.pending.is_empty());
}

/// Each byte that must not come is a break. A line without any byte proves nothing.
#[test]
fn an_event_that_must_not_come_is_counted() {
    let rule = format!("never = {ANSWER}");
    let mut came = bench(&rule);
    came.at(10, "b", NO).at(20, "b", NO);
    came.ends(Fail, "at 0.010000 s bytes");
    assert!(came.told(true).1.ends_with("; 2 times in all"));
    let mut silent = bench(&rule);
    silent.at(10, "a", NO);
    silent.ends(
        NotObserved,
        "nothing that the rule names appeared; expected never",
    );
    let mut busy = bench(&rule);
    busy.at(10, "x", NO);
    busy.ends(Pass, "never came up: never");
}

#[test]
fn a_goal_may_be_missed() {
    let mut goal = bench(&format!("sometimes = {FAST}"));
    goal.at(10, "", NO);
    goal.ends(
        NotObserved,
        "not reached in this run, which can happen in a single run: sometimes",
    );
    assert!(!goal.rules.awaits(goal.rig.now()));
    goal.at(20, "", YES).at(30, "", 0.8);
    goal.ends(
        Pass,
        "at 0.020000 s axis drive, set-point is 0.75: sometimes",
    );
}

/// A copy keeps the questions asked before, on its own lines.
#[test]
fn a_copy_continues_with_its_own_lines() {
    let mut bench = bench(&format!("eventually = {ANSWER}\nafter = {ASK}"));
    bench.at(1_000, "a", NO);
    let mut rig = bench.rig.fork().expect("plain");
    let mut copy = Bench {
        rules: bench.rules.fork(&mut rig),
        rig,
        nodes: bench.nodes,
    };
    copy.at(1_050, "b", NO);
    copy.ends(Pass, "once; the slowest after 0.050 s, at 1.000000 s: ");
    bench.at(1_100, "", NO);
    assert_eq!(bench.status(), Fail);
}

/// A log that lost entries may have had the one that is missing; other rules do not need it.
#[test]
fn a_cut_log_leaves_rules_on_it_open() {
    let event = "{ event = { rule = \"door-open\", source = \"ask\" } }";
    let mut log = bench(&format!("eventually = {event}"));
    log.at(10, "", NO);
    assert_eq!(log.status(), Fail);
    log.rules.rules[0].seen.is_log_cut = true;
    let (status, told) = log.told(true);
    assert_eq!(status, NotObserved);
    assert!(
        told.ends_with("; the run kept only a part of the log"),
        "{told}"
    );
    let mut state = bench(&format!("always = {FAST}"));
    state.at(10, "", YES);
    state.rules.rules[0].seen.is_log_cut = true;
    assert_eq!(state.status(), Pass);
}
