//! Probes on readings, moments and entries of the log that are given by hand.

use std::collections::BTreeMap;

use emulators::world::{Contact, Point};
use emulators::{Event, EventKind};

use super::answers::may_be_one;
use super::*;
use crate::rig::{Rig, bare};
use crate::robots::instruments::Unknown;
use crate::run::Contacts;
use crate::scenario::{DeviceSpec, Operand};

fn condition(text: &str) -> Condition {
    let table: BTreeMap<String, Condition> = toml::from_str(&format!("it = {text}")).expect(text);
    table.into_values().next().expect("one")
}

const FAST: &str = "{ axis = { name = \"left\", op = \">\", value = 0.5 } }";
const TOUCH: &str = "{ contact = {} }";

fn leaf(source: Source) -> Leaf {
    Leaf {
        source,
        moments: Vec::new(),
        now: None,
        known: Known::Open,
        is_logged: false,
        near: None,
        lost: 0,
        missing: None,
    }
}

fn reading(holds: Option<bool>) -> Reading {
    Reading { holds, value: None }
}

fn probe(text: &str, leaf: Leaf) -> Probe {
    Probe::of(&condition(text), Node::Leaf(leaf))
}

/// A probe of the state with this reading.
fn state(holds: Option<bool>) -> Probe {
    let now = Some(reading(holds));
    probe(
        FAST,
        Leaf {
            now,
            ..leaf(Source::State)
        },
    )
}

/// Both probes together, either of them, and the first one alone, negated.
fn groups(one: &Probe, other: &Probe) -> [Probe; 3] {
    let both = || vec![one.clone(), other.clone()];
    let any = condition(FAST);
    [
        Probe::of(&any, Node::All(both())),
        Probe::of(&any, Node::Any(both())),
        Probe::of(&any, Node::Not(Box::new(one.clone()))),
    ]
}

/// One decisive value decides; the opposite needs all of them.
#[test]
fn values_of_parts_are_put_together() {
    const T: Truth = Some(true);
    const F: Truth = Some(false);
    for (truths, all, any) in [
        ([T, T], T, T),
        ([T, F], F, T),
        ([F, F], F, F),
        ([T, None], None, T),
        ([F, None], F, None),
        ([None, None], None, None),
    ] {
        let found = [together(&truths, false), together(&truths, true)];
        assert_eq!(found, [all, any], "{truths:?}");
        let [first, second] = truths.map(state);
        let judged = groups(&first, &second).map(|mut probe| probe.judge(None));
        let not = truths[0].map(|truth| !truth);
        assert_eq!(judged, [all, any, not], "{truths:?}");
    }
}

/// A part that was read and cannot be compared; one that was not read yet is none.
#[test]
fn a_part_that_cannot_be_compared_is_found() {
    let (sound, odd) = (state(Some(true)), state(None));
    let unread = probe(FAST, leaf(Source::State));
    let found = |one: &Probe, other: &Probe| groups(one, other).map(|it| it.is_incomparable());
    assert_eq!(found(&sound, &odd), [true, true, false]);
    assert_eq!(found(&odd, &sound), [true; 3]);
    assert_eq!(found(&unread, &sound), [false; 3]);
    let appeared = |one: &Probe, other: &Probe| groups(one, other).map(|it| it.has_appeared(false));
    assert_eq!(appeared(&sound, &odd), [true; 3]);
    assert_eq!(appeared(&sound, &unread), [false, false, true]);
    assert_eq!(appeared(&unread, &sound), [false; 3]);
}

/// A robot that has not moved causes no contact; the state counts as momentary part never.
#[test]
fn contacts_appear_with_motion() {
    let touch = probe(TOUCH, leaf(Source::Contacts(0)));
    assert_eq!(
        [false, true].map(|moved| touch.has_appeared(moved)),
        [false, true]
    );
    assert_eq!(
        [false, true].map(|moved| touch.have_moments_appeared(moved)),
        [false, true]
    );
    let unread = probe(FAST, leaf(Source::State));
    assert!(unread.have_moments_appeared(false));
    let both = groups(&unread, &touch).map(|it| it.have_moments_appeared(false));
    assert_eq!(both, [false, false, true]);
}

#[test]
fn lost_moments_of_a_part_are_those_of_the_whole() {
    let of = |lost| {
        probe(
            TOUCH,
            Leaf {
                lost,
                ..leaf(Source::Contacts(0))
            },
        )
    };
    assert_eq!(groups(&of(0), &of(0)).map(|it| it.has_lost()), [false; 3]);
    assert_eq!(
        groups(&of(0), &of(1)).map(|it| it.has_lost()),
        [true, true, false]
    );
    assert_eq!(groups(&of(2), &of(0)).map(|it| it.has_lost()), [true; 3]);
}

/// A name that a device does not have, with or without the known names.
#[test]
fn the_first_missing_name_is_told() {
    let of = |missing: Option<&str>| {
        let register = "{ register = { device = \"scale\", name = \"mass\", value = 1 } }";
        probe(
            register,
            Leaf {
                missing: missing.map(str::to_owned),
                ..leaf(Source::State)
            },
        )
    };
    let told = |one, other| {
        let groups = groups(&of(one), &of(other));
        groups.map(|it| it.missing().map(str::to_owned))
    };
    let words = Some("has no mass".to_owned());
    assert_eq!(
        told(None, Some("has no mass")),
        [words.clone(), words.clone(), None]
    );
    assert_eq!(
        told(Some("has no mass"), None),
        [words.clone(), words.clone(), words]
    );
    assert_eq!(told(Some(""), None), [None, None, None]);
    let silent = of(Some("")).silence();
    assert_eq!(silent.as_deref(), Some("scale never showed mass"));
    assert_eq!(of(None).silence(), None);
}

/// Moments at the same time have numbers; several probes share a moment.
#[test]
fn moments_have_times_and_numbers() {
    let at = Instant::from_millis;
    let with = |times: &[u64]| {
        let holds = |index: usize| reading(Some(index.is_multiple_of(2)));
        let moments = times.iter().enumerate();
        probe(
            TOUCH,
            Leaf {
                moments: moments
                    .map(|(index, &time)| (at(time), holds(index)))
                    .collect(),
                ..leaf(Source::Contacts(0))
            },
        )
    };
    let (mut one, other) = (with(&[10, 20, 20, 20, 30]), with(&[5, 20, 20]));
    let found = moments_of([&one, &other].into_iter());
    let expected = [(5, 0), (10, 0), (20, 0), (20, 1), (20, 2), (30, 0)];
    assert_eq!(found, expected.map(|(time, number)| (at(time), number)));
    let judged = [(10, 0), (20, 0), (20, 1), (20, 2), (20, 3), (25, 0)]
        .map(|(time, number)| one.judge(Some((at(time), number))));
    assert_eq!(
        judged,
        [Some(true), Some(false), Some(true), Some(false), None, None]
    );
    assert_eq!(one.judge(None), None, "it has a value at its moments only");
    for mut group in groups(&one, &other) {
        let mut all = Vec::new();
        group.moments(&mut all);
        assert!(all.len() == 8 || all.len() == 5, "{all:?}");
        assert!(group.judge(Some((at(20), 0))).is_some());
    }
}

fn event(source: Option<&str>) -> EventCondition {
    EventCondition {
        rule: "door-open".to_owned(),
        source: source.map(str::to_owned),
    }
}

fn logs(known: Known, is_logged: bool, near: Option<&str>) -> Leaf {
    Leaf {
        known,
        is_logged,
        near: near.map(str::to_owned),
        ..leaf(Source::Log(LogPoint::default()))
    }
}

/// An entry is possible if the source is known to log it, or if it logged something and no similar
/// name.
#[test]
fn an_entry_could_come_from_a_source_that_logs() {
    for (known, unlogged, logged, near) in [
        (Known::Logged, true, true, true),
        (Known::NeverLogged, false, false, false),
        (Known::Misspelt("door-opened"), false, false, false),
        (Known::Undeclared, false, false, false),
        (Known::OfOthers, false, true, true),
        (Known::Open, false, true, false),
    ] {
        let found = [(false, None), (true, None), (true, Some("door-opens"))]
            .map(|(is_logged, near)| logs(known, is_logged, near).could_be_logged());
        assert_eq!(found, [unlogged, logged, near], "{known:?}");
    }
}

#[test]
fn a_missing_entry_has_a_reason() {
    let told = |known, near, source: Option<&str>| {
        let leaf = logs(known, false, near);
        leaf.silence_of_log(&event(source)).unwrap_or_default()
    };
    let scale = Some("scale");
    assert_eq!(told(Known::Logged, None, scale), "");
    let meant = "door-open is no event of scale, did you mean \"door-opened\"?";
    assert_eq!(told(Known::Misspelt("door-opened"), None, scale), meant);
    assert_eq!(told(Known::Open, Some("door-opened"), scale), meant);
    assert_eq!(told(Known::Undeclared, Some("door-opened"), scale), meant);
    let any = "door-open is no event of any device, did you mean \"door-opened\"?";
    assert_eq!(told(Known::Misspelt("door-opened"), None, None), any);
    assert_eq!(
        told(Known::Open, None, None),
        "door-open needs a source to be observed"
    );
    let never = "door-open is no event that scale is known to log";
    assert_eq!(told(Known::NeverLogged, None, scale), never);
    assert_eq!(told(Known::NeverLogged, Some("door-opened"), scale), never);
    let program = "it is unknown whether the program of scale can log door-open: list the names of \
                   its events in device.scale.program.events";
    assert_eq!(told(Known::Undeclared, None, scale), program);
    assert_eq!(told(Known::Open, None, scale), "scale logged nothing");
    assert_eq!(told(Known::OfOthers, None, scale), "scale logged nothing");
}

#[test]
fn an_entry_is_of_its_rule_and_source() {
    let entry = |source: &'static str, rule: &'static str| LogMoment {
        at: Instant::ZERO,
        source,
        rule,
    };
    let found = |source: Option<&str>, entry: LogMoment<'_>| {
        let wanted = event(source);
        [is_event(&wanted, &entry), is_source(&wanted, &entry)]
    };
    let scale = Some("scale");
    assert_eq!(found(scale, entry("scale", "door-open")), [true, true]);
    assert_eq!(found(scale, entry("scale", "other")), [false, true]);
    assert_eq!(found(scale, entry("lidar", "door-open")), [false, false]);
    assert_eq!(found(None, entry("lidar", "door-open")), [true, true]);
    assert_eq!(found(None, entry("lidar", "other")), [false, false]);
}

fn contact(millis: u64, own_m_s: f64) -> Contact {
    Contact {
        at: Instant::from_millis(millis),
        speed_m_s: 1.0,
        own_m_s,
        place: Point::default(),
    }
}

fn moment<'a>(rig: &'a Rig, devices: &'a BTreeMap<String, DeviceSpec>) -> Moment<'a> {
    Moment {
        rig,
        instruments: &Unknown,
        axes: None,
        devices,
        waypoints: [0; 2],
    }
}

/// Contacts faster than 0.3 m/s; a reading has the robot's own speed to a millimetre a second.
#[test]
fn contacts_are_moments_with_the_own_speed() {
    let (rig, devices) = (bare::rig(), BTreeMap::new());
    let faster = "{ contact = { faster_than_m_s = 0.3 } }";
    let read = |text: &str| {
        let mut probe = probe(text, leaf(Source::Contacts(0)));
        let all = [contact(1, 0.3), contact(2, 0.300_6), contact(3, 0.123_4)];
        probe.look(&moment(&rig, &devices), &all);
        let Node::Leaf(leaf) = &probe.node else {
            panic!("a leaf")
        };
        let moments = leaf.moments.iter();
        moments
            .map(|(at, reading)| (at.as_millis(), reading.holds, reading.value.clone()))
            .collect::<Vec<_>>()
    };
    let of = |millis, speed| (millis, Some(true), Some(Operand::Number(speed)));
    assert_eq!(read(faster), [of(2, 0.301)]);
    assert_eq!(read(TOUCH), [of(1, 0.3), of(2, 0.301), of(3, 0.123)]);
}

/// Entries and contacts count from the start of the wait on.
#[test]
fn a_wait_sees_what_comes_after_its_start() {
    let (mut rig, devices) = (bare::rig(), BTreeMap::new());
    let log = |rig: &mut Rig, rule| {
        let event = Event {
            at: rig.now(),
            kind: EventKind::Note,
            rule,
            detail: String::new(),
            bytes: Vec::new(),
        };
        rig.log("scale", event);
    };
    log(&mut rig, "door-open");
    let lines = LineWatches::default();
    let new = |rig: &Rig, text: &str| {
        let moment = moment(rig, &devices);
        Probe::new(&condition(text), &moment, &lines, true).expect("sound")
    };
    let door = new(
        &rig,
        "{ event = { rule = \"door-open\", source = \"scale\" } }",
    );
    let mut contacts = Contacts::default();
    let come = |rig: &Rig, probe: &Probe, contacts: &Contacts| {
        probe.has_come(&moment(rig, &devices), contacts)
    };
    assert_eq!(come(&rig, &door, &contacts), Some(false));
    log(&mut rig, "other");
    assert_eq!(come(&rig, &door, &contacts), Some(false));
    log(&mut rig, "door-open");
    assert_eq!(come(&rig, &door, &contacts), Some(true));
    let not = groups(&door, &door).map(|it| come(&rig, &it, &contacts));
    assert_eq!(not, [Some(true), Some(true), Some(false)]);
    let touch = new(&rig, "{ contact = { faster_than_m_s = 0.3 } }");
    contacts.extend(vec![contact(1, 0.2)]);
    assert_eq!(come(&rig, &touch, &contacts), Some(false));
    contacts.extend(vec![contact(2, 0.4)]);
    assert_eq!(come(&rig, &touch, &contacts), Some(true));
}

/// A rule sees each entry once, and notes a similar name of its source.
#[test]
fn entries_are_read_once() {
    let (mut rig, devices) = (bare::rig(), BTreeMap::new());
    let mut door = probe(
        "{ event = { rule = \"door-open\", source = \"scale\" } }",
        leaf(Source::Log(LogPoint::default())),
    );
    let mut looks = Vec::new();
    for (source, rule) in [
        ("lidar", "door-open"),
        ("scale", "other"),
        ("scale", "door-open"),
        ("scale", "door-opens"),
    ] {
        let event = Event {
            at: rig.now(),
            kind: EventKind::Note,
            rule,
            detail: String::new(),
            bytes: Vec::new(),
        };
        rig.log(source, event);
        door.look(&moment(&rig, &devices), &[]);
        let Node::Leaf(leaf) = &door.node else {
            panic!("a leaf")
        };
        looks.push((leaf.moments.len(), leaf.is_logged, leaf.near.is_some()));
    }
    let expected = [
        (0, false, false),
        (0, true, false),
        (1, true, false),
        (0, true, true),
    ];
    assert_eq!(looks, expected);
}

#[test]
fn a_reading_is_put_in_words() {
    let words = |text: &str, value: Option<Operand>| {
        told(
            &condition(text),
            &Reading {
                holds: Some(true),
                value,
            },
        )
    };
    let number = |value: f64| Some(Operand::Number(value));
    let register =
        |key: &str| format!("{{ register = {{ device = \"scale\", {key}, value = 1 }} }}");
    for (text, value, expected) in [
        (FAST.to_owned(), number(0.25), "axis left, set-point is 0.25"),
        (register("name = \"mass\""), number(2.0), "scale mass is 2"),
        (register("address = 7"), number(2.0), "scale register 7 is 2"),
        (register("address = 7"), None, "scale register 7"),
        ("{ map = { known_min = 0.5 } }".to_owned(), number(0.25), "known share of the map is 0.25"),
        ("{ visited = 2 }".to_owned(), number(1.0), "number of visited waypoints is 1"),
        (TOUCH.to_owned(), number(0.3), "contact at 0.3 m/s"),
        (TOUCH.to_owned(), None, "contact"),
        (
            "{ pose = { near_m = [1, 2], within_m = 0.5 } }".to_owned(),
            number(0.25),
            "distance from 1, 2 is 0.25 m",
        ),
        (
            "{ frame = { link = \"base\", direction = \"to-master\", field = \"speed\", value = 1 } }"
                .to_owned(),
            number(3.0),
            "speed on base is 3",
        ),
    ] {
        assert_eq!(words(&text, value), expected);
    }
    let all = groups(&state(Some(true)), &probe(TOUCH, leaf(Source::Contacts(0))));
    // A part that was not read has no words.
    assert_eq!(all.map(|it| it.words()), ["axis left, set-point"; 3]);
}

/// The same line, contact or entry may be one; an entry without a source may be any.
#[test]
fn two_conditions_may_hold_by_one_event() {
    let line = |link: &str, way: &str| {
        condition(&format!(
            "{{ bytes = {{ link = \"{link}\", direction = \"{way}\", count = 1 }} }}"
        ))
    };
    let frame = |link: &str| {
        condition(&format!(
            "{{ frame = {{ link = \"{link}\", direction = \"to-master\" }} }}"
        ))
    };
    let entry = |rule: &str, source: Option<&str>| {
        Condition::Event(EventCondition {
            rule: rule.to_owned(),
            source: source.map(str::to_owned),
        })
    };
    let both = |one: &Condition, other: &Condition| {
        let found = may_be_one(one, other);
        assert_eq!(found, may_be_one(other, one));
        found
    };
    let up = line("base", "to-master");
    assert!(both(&up, &up) && both(&up, &frame("base")));
    assert!(!both(&up, &line("base", "to-device")) && !both(&up, &line("arm", "to-master")));
    assert!(!both(&frame("base"), &frame("arm")));
    let touch = condition(TOUCH);
    assert!(both(&touch, &touch) && !both(&touch, &up));
    let (open, scale) = (entry("door", None), entry("door", Some("scale")));
    assert!(both(&open, &open) && both(&open, &scale) && both(&scale, &scale));
    assert!(!both(&scale, &entry("door", Some("lidar"))));
    assert!(!both(&open, &entry("other", None)) && !both(&open, &touch) && !both(&scale, &up));
}

/// A line whose watch lost moments, and one that carried bytes, frames or readings.
#[test]
fn a_line_tells_what_it_carried() {
    use crate::scenario::DirectionSpec;
    let bytes = "{ bytes = { link = \"base\", direction = \"to-master\", count = 1 } }";
    let frame = "{ frame = { link = \"base\", direction = \"to-master\" } }";
    let field = "{ frame = { link = \"base\", direction = \"to-master\", field = \"speed\", \
                 value = 1 } }";
    let told = |text: &str, [bytes, frames, readings, lost]: [u64; 4]| {
        let wanted = Wanted::Count { of: 1, left: 1 };
        let watch = LineWatch::new(0, DirectionSpec::ToMaster, wanted, false);
        let watch = LineWatches::default().add(watch);
        {
            let found = &mut watch.lock().found;
            (found.bytes, found.frames, found.readings) = (bytes, frames, readings);
            found.lost = lost;
        }
        let probe = probe(text, leaf(Source::Line(watch)));
        (probe.has_appeared(false), probe.has_lost())
    };
    assert_eq!(told(bytes, [0, 1, 1, 0]), (false, false));
    assert_eq!(told(bytes, [1, 0, 0, 1]), (true, true));
    assert_eq!(told(frame, [1, 0, 1, 0]), (false, false));
    assert_eq!(told(frame, [0, 1, 0, 2]), (true, true));
    assert_eq!(told(field, [1, 1, 0, 0]), (false, false));
    assert_eq!(told(field, [0, 0, 1, 0]), (true, false));
}
