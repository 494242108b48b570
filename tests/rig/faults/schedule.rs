//! Times of faults: triggers, spells, counts, budget, phases.

use std::path::Path;

use hilrig::run::Run;
use hilrig::scenario::Scenario;
use protocols::Instant;

use super::wire::{SENT, one, run, scenario};
use crate::{failures, in_a_room, run_to_end, start};

const DRIVES: &str = "[program]\nstart_mode = \"exploration\"\n";

fn lost(keys: &str) -> String {
    run(one("cut", keys), &SENT, 1).line(0)
}

/// Byte 3 is sent at 10.3 ms; bytes sent in the 200 us from then on are lost. The saved case
/// contains that time and waits for no byte.
#[test]
fn a_fault_begins_with_the_byte_that_it_waits_for() {
    let seen = run(one("cut", "at_byte = 3\nlasting = \"200us\""), &SENT, 1);
    assert_eq!(seen.line(0), "1:00 2:0d 3:11 6:05 7:06 8:07 9:08 10:09");
    let [fault] = &seen.case.fault[..] else {
        panic!("one fault")
    };
    assert_eq!((fault.at_byte, fault.lasting), (None, None));
    let window = fault.window();
    assert_eq!(window.from, Instant::from_micros(10_300));
    assert_eq!(window.until, Instant::from_micros(10_500));
}

/// Bytes 0 and 3 are sent during the first and the second cut of the line. With a count of two, the
/// fault is then over; without one, bytes 6 and 9 are lost too.
#[test]
fn spells_come_as_often_as_they_should() {
    let spells = "from = \"10ms\"\nevery = \"300us\"\nlasting = \"100us\"\n";
    let twice = format!("{spells}count = 2");
    assert_eq!(lost(&twice), "2:0d 3:11 5:81 6:05 7:06 8:07 9:08 10:09");
    assert_eq!(lost(spells), "2:0d 3:11 5:81 6:05 8:07 9:08");
}

#[test]
fn random_damage_wears_off_after_its_count() {
    let seen = run(one("drop", "rate = 1.0\ncount = 2"), &SENT, 1);
    assert_eq!(seen.line(0), "3:11 4:13 5:81 6:05 7:06 8:07 9:08 10:09");
}

fn on_both(budget: &str) -> [Vec<u8>; 2] {
    let fault = "[[fault]]\nkind = \"drop\"\ndirection = \"to-master\"\nrate = 1.0\n";
    let text = format!("[budget]\n{budget}\n{fault}link = \"a\"\n{fault}link = \"b\"\n");
    let [a, _, b, _] = run(scenario(&text), &SENT, 1).got;
    [a, b]
}

/// Two lines that would lose all bytes lose three together: the first of both, and the second of
/// the first line. With `at_once = 1`, all of this happens within one window, which allows one
/// strike.
#[test]
fn a_budget_bounds_the_damage_of_all_lines_together() {
    let [a, b] = on_both("total = 3");
    assert_eq!((&a[..], &b[..1]), (&SENT[2..], &[0x4D][..]));
    assert_eq!((a.len(), b.len()), (8, 9));
    let [a, b] = on_both("at_once = 1");
    assert_eq!((a.len(), b.len()), (9, 10));
}

/// The adversity lasts from 10.3 to 10.5 ms: bytes 3 and 4. A fault with its own byte or time also
/// strikes outside of it; a random one never does.
#[test]
fn chance_strikes_in_the_adversity_only() {
    let phases = "[phases]\nwarm_up = \"10300us\"\nadversity = \"200us\"\nrecovery = \"1ms\"\n\
                  judgement = \"1ms\"\n";
    let fault = |keys: &str| {
        let fault = "[[fault]]\nkind = \"drop\"\nlink = \"a\"\ndirection = \"to-master\"\n";
        run(scenario(&format!("{phases}{fault}{keys}")), &SENT, 1).line(0)
    };
    let both = "1:00 2:0d 3:11 6:05 7:06 8:07 9:08 10:09";
    assert_eq!(fault("rate = 1.0\n"), both);
    assert_eq!(
        fault("rate = 1.0\nfrom = \"1ms\"\nlasting = \"1s\"\n"),
        both
    );
    assert_eq!(
        fault("byte = 0\n"),
        "2:0d 3:11 4:13 5:81 6:05 7:06 8:07 9:08 10:09"
    );
}

const PHASES: &str = "[phases]\nwarm_up = \"8s\"\nadversity = \"3s\"\nrecovery = \"3s\"\n\
                      judgement = \"2s\"\n";
const CUT: &str = "[[fault]]\nkind = \"cut\"\nlink = \"base\"\ndirection = \"to-master\"\n";

/// The bus is cut in the adversity, the default time of a fault. In the judgement the robot works
/// again.
#[test]
fn a_robot_that_recovers_is_at_work_in_the_judgement() {
    let outcome = run_to_end(in_a_room("20s", &format!("{DRIVES}{PHASES}{CUT}")));
    assert_eq!(failures(&outcome), [""; 0]);
    assert!(
        outcome
            .checks
            .iter()
            .any(|check| check.name == "at-work-again")
    );
    let window = outcome.case.fault[0].window();
    assert_eq!(window.from, Instant::from_secs(8));
    assert_eq!(window.until, Instant::from_secs(11));
    let case = outcome.case.to_toml();
    let again = Scenario::parse(Path::new("case.toml"), case)
        .expect("sound")
        .0;
    assert_eq!(again.fault, outcome.case.fault);
}

/// The mutant: a bus that stays cut, because the fault has no end.
#[test]
fn a_robot_that_does_not_recover_is_named_by_its_silent_line() {
    let late = "from = \"8s\"\nuntil = \"20s\"\n";
    let outcome = run_to_end(in_a_room("20s", &format!("{DRIVES}{PHASES}{CUT}{late}")));
    let failed = failures(&outcome);
    let named = "at-work-again: silent in the judgement: base to-master";
    assert!(failed.contains(&named.to_owned()), "{failed:?}");
}

fn begins(when: &str) -> (Run, Instant) {
    let text = format!("{DRIVES}{CUT}lasting = \"1s\"\nwhen = {{ {when} }}\n");
    let mut run = start(in_a_room("20s", &text));
    run.go_on_until(Instant::from_secs(19));
    let case = run.case();
    assert_eq!(case.fault[0].when, None, "it never began");
    let window = case.fault[0].window();
    assert_eq!(
        window.until,
        window.from + core::time::Duration::from_secs(1)
    );
    (run, window.from)
}

/// Register 46 is the set-point of the left wheel, and the robot stands still for the first
/// seconds. Until then, two runs are equal. The run without the fault shows when the wheel first
/// moved: the condition is checked every 10 ms.
#[test]
fn a_fault_begins_when_a_register_says_so() {
    let (_, began) = begins("device = \"base\", register = 46, at_least = 1");
    let mut run = start(in_a_room("20s", DRIVES));
    let set_point = |run: &Run| run.rig.register("base", 46).expect("it has one");
    run.go_on_until(began);
    assert_ne!(set_point(&run), 0);
    let mut before = start(in_a_room("20s", DRIVES));
    before.go_on_until(Instant::from_millis(began.as_millis() - 10));
    assert_eq!(set_point(&before), 0);
}

/// The robot starts at (1.5, 1.2) and drives along y. At 0.2 m from there the condition holds, and
/// 10 ms before it did not.
#[test]
fn a_fault_begins_where_the_robot_is() {
    let (_, began) = begins("near_m = [1.5, 1.5], within_m = 0.1");
    let mut run = start(in_a_room("20s", DRIVES));
    run.go_on_until(Instant::from_millis(began.as_millis() - 10));
    let far = |run: &Run| {
        let pose = run.rig.world.pose();
        libm::hypot(pose.x - 1.5, pose.y - 1.5)
    };
    assert!(far(&run) > 0.1, "{}", far(&run));
    run.go_on_until(began);
    assert!(far(&run) <= 0.1, "{}", far(&run));
}

/// Keys that exclude each other are an error that names file, line, key and the expected value.
#[test]
fn keys_that_mean_nothing_together_are_refused() {
    let refused = |keys: &str| {
        let (scenario, source) = in_a_room("9s", &format!("{CUT}{keys}\n"));
        let error = Run::new(scenario, &source, None).err().expect("refused");
        error.to_string()
    };
    let said = |keys: &str, expected: &str| assert_eq!(refused(keys), format!("<test>:{expected}"));
    said(
        "rate = 0.1",
        "9: fault[0].rate: has no effect on cut, expected link, direction or a time",
    );
    said(
        "until = \"0s\"",
        "9: fault[0].until: is not after its start, expected a later time",
    );
    said(
        "at_byte = 1\nfrom = \"1s\"",
        "10: fault[0].from: is impossible for a fault that waits for an event, expected lasting",
    );
    said(
        "every = \"1s\"",
        "5: fault[0].lasting: is missing, every needs it: the duration of each repetition",
    );
    said(
        "every = \"1s\"\nlasting = \"2s\"",
        "9: fault[0].every: is 1s, expected at least 2s",
    );
    said(
        "count = 3",
        "9: fault[0].count: expected a rate or every: it limits their damaged bytes or repetitions",
    );
    said(
        "when = { register = 3 }",
        "9: fault[0].when: expected device, register and equals or at_least, or near_m and \
         within_m",
    );
    said(
        "device = \"lidar\"",
        "9: fault[0].device: has no effect on cut, expected link, direction or a time",
    );
}

/// A name that a fault or a rule names is reported at its own key, with the known names: faults of
/// a device, registers and variables, and rules of the log.
#[test]
fn names_of_a_described_device_are_reported_at_their_key() {
    let device = "schema = 1\nname = \"s\"\nrobot = \"none\"\nduration = \"1s\"\n\
                  device.sensor = { description = \"cobs-sensor\" }\n";
    let refused = |rest: &str| {
        let (scenario, source) = Scenario::from_text(&format!("{device}{rest}\n")).expect("read");
        let run = Run::new(scenario, &source, None);
        run.err().map(|error| error.to_string()).unwrap_or_default()
    };
    let fault = "[[fault]]\ndevice = \"sensor\"\n";
    let said = refused(&format!("{fault}kind = \"device\"\nfault = \"offf\""));
    assert!(
        said.contains("fault[0].fault: is \"offf\", did you mean \"off\"?"),
        "{said}"
    );
    let cut = "[[fault]]\nkind = \"cut\"\nlink = \"sensor\"\ndirection = \"to-master\"\n\
               lasting = \"1s\"\n";
    let when = |name: &str| {
        format!("{cut}when = {{ device = \"sensor\", register = {name}, at_least = 20.5 }}")
    };
    assert_eq!(refused(&when("\"temperature\"")), "");
    let said = refused(&when("\"temprature\""));
    assert!(
        said.contains("\"temprature\", did you mean \"temperature\"?"),
        "{said}"
    );
    let rule = "[[expect.rule]]\nname = \"r\"\nnever = { event = { source = \"sensor\", rule = ";
    let said = refused(&format!("{rule}\"unknown-mesage\" }} }}"));
    assert!(said.contains("did you mean \"unknown-message\"?"), "{said}");
}
