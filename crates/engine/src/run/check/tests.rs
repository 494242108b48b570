//! The checkers of every run, on a link between two ends and without a program.

use core::time::Duration;

use emulators::world::{BodyConfig, Contact, Point, Pose, Scene, Shape, World};
use protocols::{LineConfig, Port};

use super::*;
use crate::rig::fault::Window;
use crate::rig::line::End;
use crate::robots::{Dialect, Silence};

const MASTER: usize = 1;

/// A base and its master, on 1 Mbaud.
fn rig() -> Rig {
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
    let body = BodyConfig::default().ideal();
    let mut rig = Rig::new(World::new(scene, body, Pose::default(), 1).expect("free"));
    let [device, master] = ["base", "master"].map(|name| End {
        node: rig.add_outside(name, LineConfig::new_8n1(1_000_000)),
        port: Port(0),
    });
    rig.connect("base", device, master, 16);
    rig
}

fn axis(set_point: f64, limit: Option<f64>) -> Axis {
    Axis {
        name: "left".into(),
        unit: "",
        set_point,
        limit,
        actual: None,
    }
}

/// Updates the checker with the rig at `at` milliseconds.
fn look(checker: &mut dyn Checker, rig: &mut Rig, at: u64, axes: &[Axis], contacts: &[Contact]) {
    rig.run_until(Instant::from_millis(at));
    checker.observe(&Look {
        rig,
        axes,
        contacts,
    });
}

fn verdict(checker: &dyn Checker) -> (Status, String) {
    let check = checker.verdict();
    (check.status, check.detail)
}

#[test]
fn a_set_point_may_be_as_large_as_its_limit() {
    let (mut rig, mut checker) = (rig(), SetPointsInRange::default());
    look(&mut checker, &mut rig, 1, &[axis(99.0, None)], &[]);
    let nothing = (
        Status::NotObserved,
        "no axis with a limit to watch".to_owned(),
    );
    assert_eq!(verdict(&checker), nothing);
    look(
        &mut checker,
        &mut rig,
        2,
        &[axis(10.0, Some(10.0)), axis(99.0, None)],
        &[],
    );
    look(&mut checker, &mut rig, 3, &[axis(-10.0, Some(10.0))], &[]);
    let held = (Status::Pass, "in range in all 2 samples".to_owned());
    assert_eq!(verdict(&checker), held);
    let beyond = [axis(-10.5, Some(10.0)), axis(3.0, Some(20.0))];
    look(&mut checker, &mut rig, 4, &beyond, &[]);
    look(&mut checker, &mut rig, 5, &[axis(70.0, Some(10.0))], &[]);
    let worst = "-10.5, 3 at 0.004000 s, limit +-20".to_owned();
    assert_eq!(verdict(&checker), (Status::Fail, worst));
}

/// Bytes arrive at 10 ms; with set-points on until 510 ms the silence was 500 ms, which is allowed.
#[test]
fn motors_may_run_for_the_time_of_the_silence() {
    let silence = Silence {
        link: "base",
        silence_max: Duration::from_millis(500),
    };
    let (mut rig, mut checker) = (rig(), MotorsStopAfterSilence::new(silence));
    let (rests, drives) = ([axis(0.0, None)], [axis(0.0, None), axis(-5.0, None)]);
    look(&mut checker, &mut rig, 9, &rests, &[]);
    assert_eq!(verdict(&checker).0, Status::NotObserved);
    rig.inject(MASTER, &[1, 2]);
    look(&mut checker, &mut rig, 10, &drives, &[]);
    look(&mut checker, &mut rig, 510, &drives, &[]);
    look(&mut checker, &mut rig, 600, &rests, &[]);
    let longest = "longest silence with set-points on 500 ms, limit 500 ms".to_owned();
    assert_eq!(verdict(&checker), (Status::Pass, longest));
    rig.inject(MASTER, &[3]);
    look(&mut checker, &mut rig, 700, &drives, &[]);
    look(&mut checker, &mut rig, 1_201, &drives, &[]);
    look(&mut checker, &mut rig, 1_300, &drives, &[]);
    let broken = "set-points still on at 1.201000 s after 501 ms of silence, limit 500 ms";
    assert_eq!(verdict(&checker), (Status::Fail, broken.to_owned()));
}

#[test]
fn a_touch_of_five_centimetres_a_second_does_no_harm() {
    let (mut rig, mut checker) = (rig(), NoCollisionAtSpeed::default());
    let contact = |millis, own_m_s| Contact {
        at: Instant::from_millis(millis),
        speed_m_s: own_m_s + 0.5,
        own_m_s,
        place: Point::default(),
    };
    look(&mut checker, &mut rig, 1, &[], &[]);
    assert_eq!(verdict(&checker).0, Status::NotObserved);
    look(&mut checker, &mut rig, 2, &[], &[contact(2, 0.05)]);
    let harmless = "1 contacts, none at more than 0.05 m/s".to_owned();
    assert_eq!(verdict(&checker), (Status::Pass, harmless));
    look(
        &mut checker,
        &mut rig,
        9,
        &[],
        &[contact(7, 0.3), contact(8, 0.2)],
    );
    look(&mut checker, &mut rig, 10, &[], &[contact(10, 0.4)]);
    let first =
        "4 contacts, the first harmful one at 0.007000 s, the fastest at 0.400 m/s".to_owned();
    assert_eq!(verdict(&checker), (Status::Fail, first));
}

/// Five bytes; those on a line played from a capture do not count.
#[test]
fn bytes_are_counted_on_all_lines_but_those_that_are_played() {
    let (mut rig, mut checker) = (rig(), BytesConserved::default());
    look(&mut checker, &mut rig, 1, &[], &[]);
    assert_eq!(verdict(&checker).0, Status::NotObserved);
    rig.inject(MASTER, &[1, 2, 3]);
    rig.inject(0, &[4, 5]);
    look(&mut checker, &mut rig, 2, &[], &[]);
    assert_eq!(
        verdict(&checker),
        (Status::Pass, "5 bytes accounted for".to_owned())
    );
    rig.lines_mut(0).expect("it is there")[0].is_played = true;
    look(&mut checker, &mut rig, 3, &[], &[]);
    assert_eq!(verdict(&checker).1, "3 bytes accounted for");
}

#[test]
fn without_a_program_there_is_none_to_watch() {
    let mut rig = rig();
    let nothing = (
        Status::NotObserved,
        "no program in this process to watch".to_owned(),
    );
    let mut memory = MemoryIntact::default();
    look(&mut memory, &mut rig, 1, &[], &[]);
    assert_eq!(verdict(&memory), nothing);
    let mut alive = ProgramAlive::default();
    look(&mut alive, &mut rig, 2, &[], &[]);
    assert_eq!(verdict(&alive), nothing);
    assert!(memory.fork(&mut rig).is_some() && alive.fork(&mut rig).is_some());
}

/// The judgement ends at 20 s: a run that ends earlier cannot pass it.
#[test]
fn a_run_that_ends_within_its_judgement_is_not_judged() {
    let mut from = Instant::ZERO;
    let phases = [8, 2, 2, 8].map(|secs| {
        let until = from + Duration::from_secs(secs);
        let window = Window { from, until };
        from = until;
        window
    });
    let (mut rig, mut checker) = (rig(), AtWorkAgain::new(phases, &[]));
    look(&mut checker, &mut rig, 19_999, &[], &[]);
    let early = "the run ended before the end of the judgement".to_owned();
    assert_eq!(verdict(&checker), (Status::Fail, early));
    look(&mut checker, &mut rig, 20_000, &[], &[]);
    let silent = "no line was busy in the warm-up, so none can be judged".to_owned();
    assert_eq!(verdict(&checker), (Status::NotObserved, silent));
}

/// Each byte is a frame that sets one axis. A command of the last two seconds is stored,
/// independent of the number of later ones; of older commands only the last eight are.
#[test]
fn a_set_point_is_remembered_for_two_seconds_or_eight_commands() {
    let dialect = Dialect {
        link: "base",
        frame_max: 1,
        command: |bytes| Some(vec![Some(f64::from(bytes[0]))]),
    };
    // A byte takes 10 us: the first nine arrive in one piece at 90 us, the last alone.
    let after = |last_us: u64| {
        let mut rig = rig();
        let mut checker = SetPointsAsAccepted::listening(&mut rig, dialect).expect("a link");
        rig.inject(MASTER, &[5, 1, 1, 1, 1, 1, 1, 1, 1]);
        rig.run_until(Instant::from_micros(last_us - 10));
        rig.inject(MASTER, &[2]);
        look(&mut checker, &mut rig, 3_000, &[axis(5.0, None)], &[]);
        verdict(&checker)
    };
    let told = "as commanded by 10 valid frames".to_owned();
    assert_eq!(after(2_000_090), (Status::Pass, told));
    let untold = "5 at 3.000000 s, which no valid frame commanded".to_owned();
    assert_eq!(after(2_000_091), (Status::Fail, untold));
}

/// A stray write and an end of the program are reported with the time of their first observation.
#[test]
fn what_a_program_broke_is_told_with_its_time() {
    let at = Instant::from_millis(40);
    let stray = StrayWrites {
        count: 3,
        first: 12,
        last: -1,
    };
    let memory = MemoryIntact {
        has_program: true,
        broken: Some((at, "reply buffer", stray)),
    };
    let words = "3 writes beside the reply buffer, the first at 0.040000 s to element 12, the last \
                 to -1";
    assert_eq!(verdict(&memory), (Status::Fail, words.to_owned()));
    let sound = MemoryIntact {
        has_program: true,
        broken: None,
    };
    assert_eq!(
        verdict(&sound),
        (Status::Pass, "no write beside a buffer".to_owned())
    );
    let alive = |ended| ProgramAlive {
        has_program: true,
        ended,
    };
    assert_eq!(
        verdict(&alive(None)),
        (Status::Pass, "to the end".to_owned())
    );
    assert_eq!(
        verdict(&alive(Some(at))),
        (Status::Fail, "ended at 0.040000 s".to_owned())
    );
}

/// The first of two stray writes, and the end at 4 ms, are printed with their times.
#[test]
fn a_program_that_breaks_is_told_with_the_first_moment() {
    use super::safety::puppet::{copied, puppet};
    let mut rig = rig();
    puppet(&mut rig);
    let (mut memory, mut alive) = (MemoryIntact::default(), ProgramAlive::default());
    for checker in [&mut memory as &mut dyn Checker, &mut alive] {
        look(checker, &mut rig, 1, &[], &[]);
        assert_eq!(checker.verdict().status, Status::Pass);
    }
    let stray = |count| StrayWrites {
        count,
        first: 12,
        last: 13,
    };
    for (millis, count) in [(2, 1), (3, 2)] {
        puppet(&mut rig).stray = Some(stray(count));
        look(&mut memory, &mut rig, millis, &[], &[]);
    }
    let words = "2 writes beside the reply buffer, the first at 0.002000 s to element 12, the last \
                 to 13";
    assert_eq!(verdict(&memory), (Status::Fail, words.to_owned()));
    puppet(&mut rig).is_dead = true;
    for millis in [4, 5] {
        look(&mut alive, &mut rig, millis, &[], &[]);
    }
    let words = "ended at 0.004000 s".to_owned();
    assert_eq!(verdict(&alive), (Status::Fail, words));
    for checker in [&memory as &dyn Checker, &alive] {
        assert_eq!(copied(checker, &rig), checker.verdict().to_string());
    }
}

/// Set-points and bytes that were observed are those of a copy, too.
#[test]
fn copies_of_the_checkers_of_every_run_go_on() {
    use super::safety::puppet::copied;
    let mut rig = rig();
    let (mut points, mut bytes) = (SetPointsInRange::default(), BytesConserved::default());
    rig.inject(MASTER, &[1, 2, 3]);
    look(&mut points, &mut rig, 1, &[axis(50.0, Some(10.0))], &[]);
    look(&mut bytes, &mut rig, 2, &[], &[]);
    for (checker, words) in [
        (&points as &dyn Checker, "50 at 0.001000 s, limit +-10"),
        (&bytes, "3 bytes accounted for"),
    ] {
        let copied = copied(checker, &rig);
        assert!(copied.ends_with(words), "{copied}");
    }
    let (status, detail) = {
        let broken = Some((Instant::from_millis(7), "base: lost".to_owned()));
        verdict(&BytesConserved { sent: 5, broken })
    };
    assert_eq!(
        (status, &*detail),
        (Status::Fail, "at 0.007000 s on base: lost")
    );
}
