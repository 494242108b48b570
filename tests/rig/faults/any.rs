//! Any schedule of faults: no panic, no lost byte in the counts, the same result twice, and again
//! as a case.

use std::path::Path;

use hilrig::run::Run;
use hilrig::scenario::{FaultKind, FaultSpec, Scenario};
use proptest::collection::vec;
use proptest::prelude::*;

use super::wire::{self, SENT};
use crate::in_a_room;

const TIMES: [&str; 8] = [
    "0s", "1ns", "100us", "300us", "10ms", "10350us", "1h", "168h",
];
const NUMBERS: [&str; 9] = [
    "0",
    "1",
    "2",
    "7",
    "9",
    "255",
    "65535",
    "-1",
    "18446744073709551615",
];
const FIGURES: [&str; 8] = [
    "0.0", "0.5", "1.0", "-1.0", "1e300", "nan", "inf", "50000.0",
];

fn named(name: &str) -> String {
    format!("\"{name}\"")
}

/// A value for `key`, valid or not.
fn value(key: &'static str) -> BoxedStrategy<String> {
    let of = |values: &'static [&'static str]| proptest::sample::select(values);
    match key {
        "link" | "with" => of(&["a", "b", "c"]).prop_map(named).boxed(),
        "direction" => of(&["to-master", "to-device"]).prop_map(named).boxed(),
        "device" | "fault" | "stream" | "back_as" => {
            ".{0,5}".prop_map(|s| format!("{s:?}")).boxed()
        }
        "devices" => Just("[\"a.device\", \"\"]".to_owned()).boxed(),
        "from" | "until" | "lasting" | "every" | "by" => of(&TIMES).prop_map(named).boxed(),
        "rate" | "ppm" | "ppm_per_s" | "factor" => of(&FIGURES).prop_map(str::to_owned).boxed(),
        "when" => Just("{ near_m = [1.5, 1.2], within_m = 0.5 }".to_owned()).boxed(),
        _ => of(&NUMBERS).prop_map(str::to_owned).boxed(),
    }
}

const KEYS: [&str; 26] = [
    "back_as",
    "device",
    "devices",
    "rate",
    "byte",
    "bit",
    "value",
    "len",
    "fifo",
    "by",
    "baud",
    "ppm",
    "ppm_per_s",
    "with",
    "fault",
    "factor",
    "from",
    "until",
    "lasting",
    "every",
    "count",
    "at_byte",
    "at_frame",
    "when",
    "stream",
    "direction",
];

/// A few keys with their values. Valid ones make a fault; the others must not cause a panic.
fn fault() -> impl Strategy<Value = String> {
    let kind = proptest::sample::select(FaultKind::ALL.to_vec());
    let key = proptest::sample::select(KEYS.to_vec());
    let more = vec(
        key.prop_flat_map(|key| value(key).prop_map(move |v| (key, v))),
        0..5,
    );
    (kind, value("link"), value("direction"), more).prop_map(|(kind, link, direction, more)| {
        let mut keys: Vec<(&str, String)> = vec![("link", link), ("direction", direction)];
        for (key, value) in more {
            keys.retain(|(other, _)| *other != key);
            keys.push((key, value));
        }
        let lines = keys.iter().map(|(key, value)| format!("{key} = {value}\n"));
        format!("kind = \"{}\"\n{}", kind.name(), lines.collect::<String>())
    })
}

proptest! {
    #![proptest_config(crate::thorough::cases(400))]

    /// Twelve attempts at a fault; those that make sense run together.
    #[test]
    fn any_schedule_runs_the_same_twice_and_again_as_its_case(
        texts in vec(fault(), 0..12),
        piece in 1_usize..5,
    ) {
        let specs = texts.iter().filter_map(|text| toml::from_str::<FaultSpec>(text).ok());
        let mut scenario = wire::scenario("");
        scenario.fault = specs.filter(wire::is_sound).collect();
        let seen = wire::run(scenario.clone(), &SENT, piece);
        prop_assert_eq!(&wire::run(scenario, &SENT, piece), &seen);
        let text = seen.case.to_toml();
        let case = Scenario::parse(Path::new("case.toml"), text).expect("what is saved is sound").0;
        let again = wire::run(case, &SENT, piece);
        prop_assert_eq!(again.lines, seen.lines);
        prop_assert_eq!(again.got, seen.got);
    }

    /// Requests by people to a running rig, at any time.
    #[test]
    fn anything_asked_of_a_running_rig_is_answered(texts in vec(fault(), 1..8)) {
        let mut run = crate::start(in_a_room("1s", ""));
        for (tenth, text) in (1..).zip(&texts) {
            run.go_on_until(protocols::Instant::from_millis(10 * tenth));
            let text = text.replace("\"a\"", "\"lidar\"").replace("\"b\"", "\"base\"");
            if let Ok(id) = toml::from_str(&text).map_err(|_| ()).and_then(|spec: FaultSpec| {
                run.inject(spec).map_err(|_| ())
            }) && tenth % 2 == 0 {
                let _ = run.withdraw(id);
            }
        }
        let outcome = run.finish();
        let text = outcome.case.to_toml();
        let (case, source) = Scenario::parse(Path::new("case.toml"), text).expect("sound");
        let again = Run::new(case, &source, None).expect("sound").finish();
        prop_assert_eq!(again.trace_hash, outcome.trace_hash);
    }

    /// A shipped scenario, damaged anywhere, is a scenario or an error; a scenario that wires up
    /// runs.
    #[test]
    fn a_damaged_scenario_is_an_error_or_runs(
        places in vec((any::<proptest::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let text = include_str!("../../../scenarios/empty-room.toml");
        let mut bytes = text.as_bytes().to_vec();
        for (place, byte) in places {
            let place = place.index(bytes.len());
            bytes[place] = byte;
        }
        let text = String::from_utf8_lossy(&bytes).into_owned();
        if let Ok((mut scenario, source)) = Scenario::parse(Path::new("damaged.toml"), text) {
            scenario.duration = "100ms".parse().expect("a span");
            scenario.phases = None;
            if let Ok(run) = Run::new(scenario, &source, None) {
                run.finish();
            }
        }
    }

    #[test]
    fn any_text_is_a_scenario_or_an_error(text in ".*") {
        let _ = Scenario::parse(Path::new("any.toml"), text);
    }
}
