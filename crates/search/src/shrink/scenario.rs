use core::time::Duration;

use super::culprit::Cause;
use super::{Effort, Judged, fewest};
use engine::run::is_of_the_end;
use engine::scenario::{Expect, FaultSpec, Scenario, Span};

/// The smallest scenario found for which `judge` returns `FailsAlike`. The search first shortens
/// the run and removes faults, because they show the cause, then removes orders, waypoints and
/// objects, and resets settings.
///
/// If `start` passes without its faults, or without one object or order, the result has this
/// property too: a mission that is impossible in its time would not show the obstacle. If no
/// culprit is known and `cause`, which begins with the name of the failed check, concerns a missed
/// goal, the run keeps its time and one waypoint. Expectations about the end are removed if the
/// cause is a different one.
///
/// `start` must fail alike. Random faults change if they are thinned out; pass the case of a run,
/// in which they are written as the bytes that they hit.
pub fn scenario(
    start: &Scenario,
    cause: &str,
    mut judge: impl FnMut(&Scenario) -> Judged,
    effort: &mut Effort<'_>,
) -> Scenario {
    let mut best = start.clone();
    // The path of the original file does not apply to the new case.
    best.origin = None;
    let check = cause.split(": ").next().unwrap_or_default();
    let is_late = is_of_the_end(check) || start.expect.has_rule_of_the_end(check);
    // `alive_for` judges the last part of the run. If the run is shortened, lines that are healed
    // later are still silent.
    let is_of_life = check == ALIVE;
    if !is_late {
        let fails = &mut |case: &Scenario| judge(case) == Judged::FailsAlike;
        let unasked = nothing_in_the_end(&best, check);
        take(&mut best, unasked, effort, fails);
    }
    let first = best.clone();
    let blame = Cause::of(&first, &mut judge, effort);
    let has_goal = is_late && !blame.is_known();
    let keeps_time = has_goal || is_of_life;
    let keeps_waypoint = has_goal && !start.mission.waypoints_m.is_empty();
    let mut fails = |case: &Scenario| {
        let is_asked = !keeps_waypoint || !case.mission.waypoints_m.is_empty();
        is_asked && judge(case) == Judged::FailsAlike && blame.is_of(case, &mut judge)
    };
    loop {
        let before = best.clone();
        if !keeps_time {
            shorter(&mut best, effort, &mut fails);
        }
        late_faults(&mut best, effort, &mut fails);
        fewer_faults(&mut best, effort, &mut fails);
        if !keeps_time {
            earlier(&mut best, effort, &mut fails);
        }
        fewer_parts(&mut best, effort, &mut fails);
        plainer(&mut best, effort, &mut fails);
        if best == before {
            return best;
        }
    }
}

/// The check of `alive_for`.
const ALIVE: &str = "alive-at-the-end";

/// `case` without expectations about the end, which a shorter run does not meet; that of the check
/// `kept` stays.
fn nothing_in_the_end(case: &Scenario, kept: &str) -> Scenario {
    let mut safety = case.expect.safety.clone();
    if let Some(safety) = safety.as_mut().filter(|_| kept != ALIVE) {
        safety.alive_for = None;
    }
    let expect = Expect {
        visit_within_mm: None,
        return_within_mm: None,
        home_within_mm: None,
        explored_min: None,
        victims_within_mm: None,
        settle: None,
        wall_overlap_min: None,
        map_received: None,
        rule: case.expect.rules_of_shorter_runs(kept),
        safety,
        ..case.expect.clone()
    };
    Scenario {
        expect,
        ..case.clone()
    }
}

/// Minimum time by which faults are moved forward.
const EARLIER_MIN: Duration = Duration::from_millis(100);

type Fails<'a> = &'a mut dyn FnMut(&Scenario) -> bool;

/// Replaces `best` with `smaller` if they differ and `smaller` still fails.
fn take(best: &mut Scenario, smaller: Scenario, effort: &mut Effort<'_>, fails: Fails<'_>) -> bool {
    let is_taken = smaller != *best && effort.spend() && fails(&smaller);
    if is_taken {
        *best = smaller;
    }
    is_taken
}

/// Removes everything that begins before the last quarter, or half, of the run: the last events are
/// the cause most often, and each later try is short.
fn late_faults(best: &mut Scenario, effort: &mut Effort<'_>, fails: Fails<'_>) {
    for from in [best.duration.0 * 3 / 4, best.duration.0 / 2] {
        let mut smaller = best.clone();
        smaller
            .fault
            .retain(|fault| fault.from.is_some_and(|begin| begin.0 >= from));
        if !smaller.fault.is_empty() && take(best, smaller, effort, fails) {
            return;
        }
    }
}

fn fewer_faults(best: &mut Scenario, effort: &mut Effort<'_>, fails: Fails<'_>) {
    // Whole lanes first: a case may contain thousands of damaged bytes on irrelevant lines.
    let mut lanes: Vec<(String, &str)> = Vec::new();
    for fault in &best.fault {
        let lane = (fault.place(), fault.kind.name());
        if !lanes.contains(&lane) {
            lanes.push(lane);
        }
    }
    for (place, kind) in lanes {
        let mut smaller = best.clone();
        smaller
            .fault
            .retain(|fault| fault.place() != place || fault.kind.name() != kind);
        take(best, smaller, effort, fails);
    }
    let rest = best.clone();
    best.fault = fewest(&rest.fault, effort, |fault| {
        let mut smaller = rest.clone();
        smaller.fault = fault.to_vec();
        smaller == rest || fails(&smaller)
    });
    for index in 0..best.fault.len() {
        shorter_window(best, index, effort, fails);
    }
}

/// Halves the duration of a fault, from its end and from its beginning.
fn shorter_window(best: &mut Scenario, index: usize, effort: &mut Effort<'_>, fails: Fails<'_>) {
    for from_the_end in [true, false] {
        loop {
            let fault = &best.fault[index];
            let from = fault.from.unwrap_or_default().0;
            let until = fault.until.unwrap_or(best.duration).0;
            let length = until.saturating_sub(from);
            let is_short = fault.byte.is_some() || length < Duration::from_millis(20);
            if is_short || !effort.is_left() {
                break;
            }
            let middle = Span(whole_ms(from + length / 2));
            let mut smaller = best.clone();
            match from_the_end {
                true => smaller.fault[index].until = Some(middle),
                false => smaller.fault[index].from = Some(middle),
            }
            if !take(best, smaller, effort, fails) {
                break;
            }
        }
    }
}

fn whole_ms(length: Duration) -> Duration {
    Duration::from_millis(u64::try_from(length.as_millis()).unwrap_or(u64::MAX))
}

fn shorter(best: &mut Scenario, effort: &mut Effort<'_>, fails: Fails<'_>) {
    // Bisects the end of the run to a tenth of a second.
    let (mut least, mut most) = (Duration::ZERO, best.duration.0);
    while most - least > Duration::from_millis(100) {
        let middle = whole_ms(least + (most - least) / 2);
        let mut smaller = best.clone();
        smaller.duration = Span(middle);
        if take(best, smaller, effort, fails) {
            most = middle;
        } else {
            least = middle;
        }
    }
}

/// Moves all faults and the end of the run forward: a try that cannot start from a checkpoint takes
/// as long as the run.
fn earlier(best: &mut Scenario, effort: &mut Effort<'_>, fails: Fails<'_>) {
    let begin = |fault: &FaultSpec| {
        let waits =
            fault.at_byte.is_some() || fault.at_frame.is_some() || fault.waits_for_condition();
        let is_timed = fault.byte.is_none() && !waits;
        fault.from.filter(|_| is_timed)
    };
    let begins: Option<Vec<Span>> = best.fault.iter().map(begin).collect();
    let Some(first) = begins.and_then(|begins| begins.into_iter().min()) else {
        return;
    };
    for quarters in [3, 2, 1] {
        let by = whole_ms(first.0 * quarters / 4);
        let earlier = |time: Span| Span(time.0.saturating_sub(by));
        let mut smaller = best.clone();
        smaller.duration = earlier(best.duration);
        for fault in &mut smaller.fault {
            fault.from = fault.from.map(earlier);
            fault.until = fault.until.map(earlier);
        }
        if by >= EARLIER_MIN && take(best, smaller, effort, fails) {
            return;
        }
    }
}

/// Removes elements, one list of the scenario after the other.
fn fewer_parts(best: &mut Scenario, effort: &mut Effort<'_>, fails: Fails<'_>) {
    macro_rules! fewer {
        ($($field:ident).+) => {
            let rest = best.clone();
            best.$($field).+ = fewest(&rest.$($field).+, effort, |left| {
                let mut smaller = rest.clone();
                smaller.$($field).+ = left.to_vec();
                smaller == rest || fails(&smaller)
            });
        };
    }
    fewer!(mission.step);
    fewer!(mission.waypoints_m);
    fewer!(expect.rule);
    fewer!(world.push);
    fewer!(world.moving);
    fewer!(world.pillar);
    fewer!(world.polygon);
    fewer!(world.wall);
}

/// Resets settings to their defaults.
fn plainer(best: &mut Scenario, effort: &mut Effort<'_>, fails: Fails<'_>) {
    for link in best.link.keys().cloned().collect::<Vec<_>>() {
        let mut smaller = best.clone();
        smaller.link.remove(&link);
        take(best, smaller, effort, fails);
    }
    for device in best.device.keys().cloned().collect::<Vec<_>>() {
        let mut smaller = best.clone();
        smaller.device.remove(&device);
        take(best, smaller, effort, fails);
    }
    let plain: [fn(&mut Scenario); 5] = [
        |scenario| scenario.phases = None,
        |scenario| scenario.budget = None,
        |scenario| scenario.program = Default::default(),
        |scenario| scenario.mission.connect = Span::from_millis(500),
        |scenario| scenario.description.clear(),
    ];
    for make_plain in plain {
        let mut smaller = best.clone();
        make_plain(&mut smaller);
        take(best, smaller, effort, fails);
    }
}

/// A sentence about a case in which no part was left out. It names no part, because most parts are
/// no cause.
pub fn unminimised_in_words(case: &Scenario) -> String {
    let (faults, duration) = (case.fault.len(), case.duration);
    let faults = match faults {
        1 => "1 fault".to_owned(),
        faults => format!("{faults} faults"),
    };
    format!("Not minimised: {faults} in {duration}.")
}

/// A sentence about the remaining parts of a case.
pub fn in_words(case: &Scenario) -> String {
    let faults: Vec<String> = case
        .fault
        .iter()
        .take(5)
        .map(|fault| {
            let at = match (fault.byte, fault.from) {
                (Some(byte), _) => format!(" of byte {byte}"),
                (None, Some(from)) => format!(" from {from}"),
                (None, None) => String::new(),
            };
            format!("{}{at} on {}", fault.kind.name(), fault.place())
        })
        .collect();
    let more = match case.fault.len().saturating_sub(5) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let faults = match faults.is_empty() {
        true => "no fault".to_owned(),
        false => format!("{}{more}", faults.join(", ")),
    };
    let solid = case.world.wall.len() + case.world.polygon.len() + case.world.pillar.len();
    format!(
        "This is enough: {faults}; {} waypoints, {} orders, {solid} objects in the world, {}.",
        case.mission.waypoints_m.len(),
        case.mission.step.len(),
        case.duration
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case() -> Scenario {
        let text = "schema = 1\nname = \"test\"\nrobot = \"rescue\"\nduration = \"60s\"\n\
                    mission.waypoints_m = [[2.4, 2.4], [1.0, 1.0]]\n\
                    world.start = { x_m = 0.6, y_m = 0.6, heading_deg = 0 }\n\
                    [[world.pillar]]\nat_m = [[1.0, 2.0]]\nradius_m = 0.1\n\
                    [[world.pillar]]\nat_m = [[2.0, 2.0]]\nradius_m = 0.1\n";
        let (case, _) = Scenario::from_text(text).expect("sound");
        case
    }

    fn smallest(cause: &str, mut fails: impl FnMut(&Scenario) -> bool) -> Scenario {
        let judge = |case: &Scenario| match fails(case) {
            true => Judged::FailsAlike,
            false => Judged::Passes,
        };
        scenario(&case(), cause, judge, &mut Effort::tries(1000))
    }

    fn has_pillar(case: &Scenario) -> bool {
        let mut pillars = case.world.pillar.iter();
        pillars.any(|pillar| pillar.get_ref().at_m == [[2.0, 2.0]])
    }

    /// R2: 40 s suffice for the mission, but not with the second pillar. The minimised case shows
    /// this: it keeps the pillar and 40 s, in which it passes without the pillar.
    #[test]
    fn a_mission_that_a_thing_prevents_keeps_the_thing_and_time_to_do_it_without() {
        let is_short = |case: &Scenario| case.duration.0 < Duration::from_secs(40);
        let fails = |case: &Scenario| is_short(case) || has_pillar(case);
        let small = smallest("waypoints-visited: standing still", fails);
        assert!((40_000..40_200).contains(&small.duration.0.as_millis()));
        assert!(has_pillar(&small) && small.world.pillar.len() == 1);
    }

    /// Without a known cause the failure is only shown by a run of the same length.
    #[test]
    fn a_mission_that_nothing_prevents_keeps_its_time_and_a_waypoint() {
        let small = smallest("waypoints-visited", |_| true);
        assert_eq!(small.duration, Span::from_millis(60_000));
        assert_eq!(small.mission.waypoints_m.len(), 1);
    }

    /// A cut at 16 s that matters from 3 s on: three quarters earlier is 4 s; from there three
    /// quarters or a half earlier would be 1 s and 2 s, a quarter earlier is 3 s.
    #[test]
    fn what_goes_wrong_comes_as_early_as_it_still_matters() {
        let fault = "link = \"base\"\ndirection = \"to-device\"\nkind = \"cut\"\n\
                     from = \"16s\"\nuntil = \"17s\"\n";
        let text = format!("{}[[fault]]\n{fault}", case().to_toml());
        let (start, _) = Scenario::from_text(&text).expect("sound");
        let fails = |case: &Scenario| {
            let mut begins = case.fault.iter().filter_map(|fault| fault.from);
            let matters = begins.any(|from| from.0 >= Duration::from_secs(3));
            matters && case.duration.0 > case.fault[0].from.unwrap_or_default().0
        };
        let judge = |case: &Scenario| match fails(case) {
            true => Judged::FailsAlike,
            false => Judged::Passes,
        };
        let check = "motors-stop-after-silence";
        let small = scenario(&start, check, judge, &mut Effort::tries(1000));
        let from = small.fault[0].from.unwrap_or_default();
        assert_eq!(from, Span::from_millis(3_000));
        assert!(
            small.duration <= Span::from_millis(3_200),
            "{}",
            small.duration
        );
    }

    /// A contact at 12 s does not depend on the length of the run after it.
    #[test]
    fn what_happens_on_the_way_is_shown_by_a_shorter_run() {
        let fails = |case: &Scenario| case.duration.0 > Duration::from_secs(12) && has_pillar(case);
        let small = smallest("no-collision-at-speed", fails);
        assert!(
            small.duration <= Span::from_millis(12_200),
            "{}",
            small.duration
        );
    }
}
