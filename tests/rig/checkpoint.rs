//! A run that continues from a checkpoint equals the uninterrupted run, and a branch equals a
//! separate run.

use core::time::Duration;

use hilrig::run::Outcome;
use hilrig::scenario::{
    BudgetSpec, ChassisSpec, DifferentialSpec, FaultSpec, PhasesSpec, SafetySpec, Scenario, Source,
    Span,
};
use proptest::prelude::*;
use protocols::Instant;

use super::{in_a_room, shipped, start};

/// Twelve faults of all kinds, spread over six seconds. The position of a fault with a rate in the
/// list selects its random stream, so the two faults with a rate come first.
const FAULTS: &str = r#"
[[fault]]
kind = "drop"
link = "base"
direction = "to-device"
at_byte = 2000
lasting = "20ms"
rate = 0.5
[[fault]]
kind = "flip"
link = "lidar"
direction = "to-master"
rate = 0.001
from = "2s"
until = "4s"
[[fault]]
kind = "latency"
link = "base"
direction = "to-device"
by = "2ms"
from = "1500ms"
until = "3s"
[[fault]]
kind = "stall"
link = "lidar"
direction = "to-master"
from = "2500ms"
until = "2600ms"
[[fault]]
kind = "jitter"
link = "pc"
direction = "to-master"
by = "5ms"
stream = "late"
from = "3s"
until = "5s"
[[fault]]
kind = "cut"
link = "base"
direction = "to-master"
from = "1s"
until = "1200ms"
[[fault]]
kind = "wrong-baud"
link = "lidar"
direction = "to-master"
baud = 125000
from = "3500ms"
until = "3600ms"
[[fault]]
kind = "unplugged"
link = "radio"
direction = "to-device"
from = "4s"
until = "4200ms"
[[fault]]
kind = "clog"
link = "base"
direction = "to-master"
every = "300ms"
lasting = "10ms"
stream = "clogs"
from = "1800ms"
until = "4500ms"
[[fault]]
kind = "flip"
link = "base"
direction = "to-device"
byte = 3000
bit = 3
[[fault]]
kind = "overrun"
link = "lidar"
direction = "to-master"
from = "4700ms"
until = "4750ms"
[[fault]]
kind = "truncate"
link = "base"
direction = "to-master"
byte = 6000
"#;

fn faulted() -> (Scenario, Source) {
    in_a_room("6s", FAULTS)
}

/// Everything that the profile `harsh` expects of a robot. Many of its checks decode lines.
fn safe() -> Option<SafetySpec> {
    let expect = "[expect.safety]\nrests_within = '1s'\nsound_orders = true\n\
                  true_telemetry = true\ntrue_counts = true\nsound_frames = true\n\
                  pose_within_mm = 400.0\nobeys_within = '500ms'\ncommands_within = '1s'\n\
                  sends_within = '4s'\nsends_cyclically = true\nasks_again = true\n\
                  true_complaints = true\nmotion_within_percent = 5.0\nshort_turns = true\n\
                  says_within = '3s'\nalive_for = '1s'\nby_hand = true\n";
    in_a_room("6s", expect).0.expect.safety
}

/// Values that must be equal for two runs to count as the same.
fn identity(outcome: &Outcome) -> (String, Vec<String>, Vec<FaultSpec>, Vec<String>) {
    let checks = outcome.checks.iter().map(ToString::to_string);
    let events = outcome.events.iter().map(ToString::to_string);
    (
        outcome.trace_hash.clone(),
        checks.collect(),
        outcome.case.fault.clone(),
        events.collect(),
    )
}

fn cases(usual: u32) -> ProptestConfig {
    let more = std::env::var("CHECKPOINT_CASES").ok();
    let more = more.map(|count| count.parse().expect("a number"));
    ProptestConfig::with_cases(more.unwrap_or(usual))
}

/// The run continues as well: the test compares the checkpoint and its original, with the check of
/// the robot's recovery.
#[test]
fn taking_a_checkpoint_changes_nothing() {
    let faulted = || {
        let (mut scenario, source) = faulted();
        scenario.phases = Some(PhasesSpec {
            warm_up: Span::from_millis(1_000),
            adversity: Span::from_millis(3_000),
            recovery: Span::from_millis(1_000),
            judgement: Span::from_millis(1_000),
        });
        (scenario, source)
    };
    let mut run = start(faulted());
    run.go_on_until(Instant::from_millis(2_555));
    let point = run.checkpoint().expect("no client listens");
    let whole = identity(&run.finish());
    assert_eq!(identity(&point.resume().finish()), whole);
    assert_eq!(identity(&point.resume().finish()), whole);
    assert_eq!(identity(&start(faulted()).finish()), whole);
}

/// The branch is at 2.555 s: faults that began earlier cannot be removed or begin later.
#[test]
fn what_has_come_to_bear_cannot_be_taken_back() {
    let (scenario, source) = faulted();
    let mut run = start((scenario.clone(), source));
    run.go_on_until(Instant::from_millis(2_555));
    let point = run.checkpoint().expect("no client listens");
    let without = |index: usize| {
        let mut other = scenario.clone();
        other.fault.remove(index);
        point.resume_as(&other).is_some()
    };
    let known: Vec<bool> = (0..12).map(without).collect();
    let (yes, no) = (true, false);
    let known_by_then = [no, no, no, no, yes, no, yes, yes, no, yes, yes, yes];
    assert_eq!(known, known_by_then);
    let later = |index: usize| {
        let mut other = scenario.clone();
        let fault = &mut other.fault[index];
        fault.from = fault
            .from
            .map(|from| Span(from.0 + Duration::from_micros(1)));
        point.resume_as(&other).is_some()
    };
    // The first fault is left out: it has no start time, so it may act at any time.
    let begins_later: Vec<bool> = (1..12).map(later).collect();
    assert_eq!(begins_later, known_by_then[1..]);
    // The stall at 2.5 s exists from that nanosecond on.
    let known_at = [2_499_999_999, 2_500_000_000].map(|nanos| {
        let mut run = start(faulted());
        run.go_on_until(Instant::from_nanos(nanos));
        let mut other = scenario.clone();
        other.fault.remove(3);
        let point = run.checkpoint().expect("no client listens");
        point.resume_as(&other).is_some()
    });
    assert_eq!(known_at, [yes, no]);
    let mut ended = scenario.clone();
    ended.duration = Span::from_millis(2_500);
    assert!(point.resume_as(&ended).is_none());
    // Only a future fault may become shorter or longer.
    for millis in [2_556, 5_000, 9_000] {
        ended.duration = Span::from_millis(millis);
        assert!(point.resume_as(&ended).is_some(), "{millis}");
    }
}

/// Any other change of a scenario requires a run from the beginning. Changes of names and texts do
/// not count.
#[test]
fn a_run_of_something_else_does_not_branch() {
    let (scenario, source) = faulted();
    let mut run = start((scenario.clone(), source));
    run.go_on_until(Instant::from_millis(2_555));
    let point = run.checkpoint().expect("no client listens");
    let branches = |change: fn(&mut Scenario)| {
        let mut other = scenario.clone();
        change(&mut other);
        assert_ne!(other, scenario);
        point.resume_as(&other).is_some()
    };
    let changes: [fn(&mut Scenario); 12] = [
        |it| {
            let (other, _) = in_a_room("6s", "[device.lidar.xv11]\nmount = { heading_deg = 30 }");
            it.device = other.device;
        },
        |it| it.schema += 1,
        |it| it.name.push('x'),
        |it| it.robot.push('x'),
        |it| it.seed += 1,
        |it| it.mission.connect = Span::from_millis(700),
        |it| it.program.start_mode = Some("x".to_owned()),
        |it| it.chassis = Some(ChassisSpec::Differential(DifferentialSpec::default())),
        |it| {
            it.link.entry("base".to_owned()).or_default();
        },
        |it| it.budget = Some(BudgetSpec::default()),
        |it| {
            let span = Span::from_millis(1_000);
            it.phases = Some(PhasesSpec {
                warm_up: span,
                adversity: span,
                recovery: span,
                judgement: span,
            });
        },
        |it| it.world.wall.clear(),
    ];
    assert_eq!(changes.map(branches), [false; 12]);
    assert!(branches(|it| it.description.push('x')));
}

/// The branch is at 2.555 s: later faults can begin earlier, but not at exactly that time.
#[test]
fn what_is_to_come_can_begin_earlier() {
    let (scenario, source) = faulted();
    let mut run = start((scenario.clone(), source));
    let now = Duration::from_millis(2_555);
    run.go_on_until(Instant::ZERO + now);
    let point = run.checkpoint().expect("no client listens");
    let begins = |from: Duration| {
        let mut other = scenario.clone();
        other.fault[4].from = Some(Span(from));
        point.resume_as(&other).is_some()
    };
    let nanosecond = Duration::from_nanos(1);
    let known = [now - nanosecond, now, now + nanosecond].map(begins);
    assert_eq!(known, [false, false, true]);
    assert_eq!(
        format!("{point:?}"),
        format!("Checkpoint({:?})", point.at())
    );
}

/// The first of two future faults is removed. The second fault then has the first one's number, and
/// would use the random stream of that number, unless its own stream has a name.
#[test]
fn dice_that_are_named_by_a_place_keep_it() {
    let cut = "[[fault]]\nkind = 'cut'\nlink = 'base'\ndirection = 'to-master'\nfrom = '5s'\n";
    let is_known = |keys: &str| {
        let second =
            format!("[[fault]]\nlink = 'lidar'\ndirection = 'to-master'\nfrom = '4s'\n{keys}\n");
        let (scenario, source) = in_a_room("6s", &format!("{cut}{second}"));
        let mut run = start((scenario.clone(), source));
        run.go_on_until(Instant::from_secs(1));
        let point = run.checkpoint().expect("no client listens");
        let mut other = scenario;
        other.fault.remove(0);
        point.resume_as(&other).is_some()
    };
    let known = [
        "kind = 'latency'\nby = '5ms'",
        "kind = 'jitter'\nby = '5ms'",
        "kind = 'jitter'\nby = '5ms'\nstream = 'late'",
        "kind = 'clog'\nevery = '300ms'\nlasting = '10ms'",
        "kind = 'clog'\nevery = '300ms'\nlasting = '10ms'\nstream = 'clogs'",
        "kind = 'flip'\nrate = 0.1",
    ];
    assert_eq!(known.map(is_known), [true, false, true, false, true, false]);
}

/// By default a mission ends within 200 mm and with a rest of 2 s.
#[test]
fn what_is_judged_in_the_end_can_be_another() {
    let (scenario, source) = faulted();
    let mut run = start((scenario, source.clone()));
    run.go_on_until(Instant::from_millis(2_555));
    let point = run.checkpoint().expect("no client listens");
    let expecting = |more: &str| in_a_room("6s", &format!("{FAULTS}[expect]\n{more}\n")).0;
    for (more, is_known) in [
        ("visit_within_mm = 200", true),
        ("visit_within_mm = 199", false),
        ("settle = '2s'", true),
        ("settle = '1s'", false),
        ("home_within_mm = 100", false),
        ("map_received = false", true),
        ("map_received = true", false),
        (
            "pose_rms_mm_max = 0\nviolations_max = 0\nwall_overlap_min = 1",
            true,
        ),
        (
            "heading_rms_deg_max = 0\nreturn_within_mm = 0\nexplored_min = 1",
            true,
        ),
    ] {
        let scenario = expecting(more);
        let branch = point.resume_as(&scenario);
        assert_eq!(branch.is_some(), is_known, "{more}");
        if let Some(branch) = branch {
            let own = start((scenario, source.clone())).finish();
            assert_eq!(identity(&branch.finish()), identity(&own), "{more}");
        }
    }
}

/// Each of the twelve faults is added alone at 2.555 s to a run without faults. Rejected are faults
/// that wait for the number of a byte, draw random numbers for each byte, or should have begun
/// before.
#[test]
fn what_is_still_to_come_can_be_added() {
    let (scenario, source) = faulted();
    let with = |fault: &[FaultSpec]| Scenario {
        fault: fault.to_vec(),
        ..scenario.clone()
    };
    let mut run = start((with(&[]), source));
    run.go_on_until(Instant::from_millis(2_555));
    let point = run.checkpoint().expect("no client listens");
    let faults = scenario.fault.iter();
    let known: Vec<bool> = faults
        .map(|fault| {
            point
                .resume_as(&with(core::slice::from_ref(fault)))
                .is_some()
        })
        .collect();
    let (yes, no) = (true, false);
    assert_eq!(
        known,
        [no, no, no, no, yes, no, yes, yes, no, yes, yes, yes]
    );
}

proptest! {
    #![proptest_config(cases(6))]

    /// A run with the first few of the twelve faults branches into a run with more of them.
    #[test]
    fn a_branch_with_more_faults_equals_a_run_of_its_own(
        first in prop::sample::select(vec![0_usize, 2, 4]),
        more in 0_u16..1 << 12,
        at_us in 0_u64..4_500_000,
        seed in 1_u64..1_000_000,
    ) {
        let (mut asked, source) = faulted();
        asked.seed = seed;
        asked.expect.safety = safe();
        let all = core::mem::take(&mut asked.fault);
        let at = Span(Duration::from_micros(at_us));
        let mut whole = asked.clone();
        let numbered = all.into_iter().enumerate();
        whole.fault.extend(numbered.filter_map(|(index, fault)| {
            let is_to_come = fault.rate.is_none() && fault.from.is_none_or(|from| from > at);
            let is_more = more >> index & 1 == 1 && is_to_come && fault.at_byte.is_none();
            (index < first || is_more).then_some(fault)
        }));
        asked.fault = whole.fault[..first].to_vec();
        let mut run = start((asked, source.clone()));
        run.go_on_until(Instant::from_micros(at_us));
        let point = run.checkpoint().expect("no client listens");
        if let Some(branch) = point.resume_as(&whole) {
            let own = start((whole, source)).finish();
            prop_assert_eq!(identity(&branch.finish()), identity(&own));
        }
    }

    /// Whole missions of several robots, cut at any time.
    #[test]
    fn resuming_equals_the_uninterrupted_run(
        name in prop::sample::select(vec!["two-rooms", "own-slave", "yellow-reactive", "faulted"]),
        at_us in 0_u64..4_000_000,
        seed in 1_u64..1_000_000,
    ) {
        let made = || {
            let (mut scenario, source) = match name {
                "faulted" => faulted(),
                name => shipped(name),
            };
            scenario.seed = seed;
            scenario.duration = scenario.duration.min(Span::from_millis(4_000));
            scenario.expect.safety = safe();
            (scenario, source)
        };
        let mut run = start(made());
        run.go_on_until(Instant::from_micros(at_us));
        let point = run.checkpoint().expect("no client listens");
        drop(run);
        prop_assert_eq!(identity(&point.resume().finish()), identity(&start(made()).finish()));
    }

    /// Some of the twelve faults are removed, one may begin later or end earlier, and the run may
    /// be shorter. If a branch is possible, its result equals that of a run from the beginning.
    #[test]
    fn a_branch_equals_a_run_of_its_own(
        kept in 0_u16..1 << 12,
        shorter in 0_usize..12,
        is_late in any::<bool>(),
        lasts_ms in 4_000_u64..6_000,
        at_us in 0_u64..4_500_000,
        seed in 1_u64..1_000_000,
    ) {
        let (mut whole, source) = faulted();
        whole.seed = seed;
        whole.expect.safety = safe();
        // It counts from the end.
        whole.expect.safety.iter_mut().for_each(|safety| safety.alive_for = None);
        let mut smaller = whole.clone();
        smaller.duration = Span::from_millis(lasts_ms);
        let fault = &mut smaller.fault[shorter];
        if let (Some(from), Some(until)) = (fault.from, fault.until) {
            let middle = Some(Span((from.0 + until.0) / 2));
            *(if is_late { &mut fault.from } else { &mut fault.until }) = middle;
        }
        // A fault that has begun, or waits for a byte, must stay.
        let at = Span(Duration::from_micros(at_us));
        let mut index = 0;
        smaller.fault.retain(|fault| {
            index += 1;
            let has_begun = fault.from.is_some_and(|from| from <= at) || fault.at_byte.is_some();
            has_begun || kept >> (index - 1) & 1 == 1
        });
        let mut run = start((whole, source.clone()));
        run.go_on_until(Instant::from_micros(at_us));
        let point = run.checkpoint().expect("no client listens");
        if let Some(branch) = point.resume_as(&smaller) {
            let own = start((smaller, source)).finish();
            prop_assert_eq!(identity(&branch.finish()), identity(&own));
        }
    }
}
