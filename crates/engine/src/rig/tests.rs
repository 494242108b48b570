//! A rig as its owner uses it: 1 Mbaud, so that a byte takes 10 us.

pub(in crate::rig) mod probe;

use emulators::BrokenRules;
use protocols::{LineConfig, Port};

use super::fault::{Activity, Effect, FaultId, Window};
use super::trace::fingerprint;
use super::*;
use probe::{Notes, Probe, Watch};

const fn at(us: u64) -> Instant {
    Instant::from_micros(us)
}

const fn end(node: usize, port: u8) -> End {
    let port = Port(port);
    End { node, port }
}

/// The device "board", node 0, and the program "robot", node 1, at the ends of "line": port 2 of
/// the device, port 5 of the program.
pub(in crate::rig) fn pair(device: Probe, program: Probe) -> Rig {
    let mut rig = bare::rig();
    let device = rig.add_device("board", device);
    let program = rig.add_program("robot", Box::new(program));
    rig.connect("line", end(device, 2), end(program, 5), 1);
    rig
}

/// An observer of `rig` and its notes.
pub(in crate::rig) fn watched(rig: &mut Rig) -> Notes {
    let watch = Watch::default();
    let notes = watch.notes.clone();
    rig.add_tap(Box::new(watch));
    notes
}

fn event(kind: EventKind, us: u64) -> Event {
    Event {
        at: at(us),
        kind,
        rule: "too-soon",
        detail: "why".to_owned(),
        bytes: Vec::new(),
    }
}

fn with_line(baud: u32) -> Probe {
    Probe {
        line: LineConfig::new_8n1(baud),
        ..Probe::default()
    }
}

/// Nodes and links have numbers in the order in which they were added, from 0, each on its own.
#[test]
fn nodes_and_links_are_numbered_in_their_order() {
    let mut rig = bare::rig();
    let nodes = [
        rig.add_device("one", Probe::default()),
        rig.add_boxed_device("two", Box::new(Probe::default())),
        rig.add_program("three", Box::new(Probe::default())),
        rig.add_outside("four", LineConfig::new_8n1(9600)),
    ];
    assert_eq!(nodes, [0, 1, 2, 3]);
    let names = nodes.map(|node| rig.node_name(node));
    assert_eq!(names, ["one", "two", "three", "four"]);
    let links = [
        rig.connect("a", end(0, 1), end(2, 3), 4),
        rig.connect_by(LinkKind::Datagram, "b", end(1, 0), end(3, 0), 9),
        rig.connect_by(LinkKind::Pin, "c", end(1, 7), end(3, 8), 2),
    ];
    assert_eq!(links, [0, 1, 2]);
    let kinds = [LinkKind::Uart, LinkKind::Datagram, LinkKind::Pin];
    let known = rig.links().iter().map(|link| (&*link.name, link.kind));
    assert!(known.eq(["a", "b", "c"].into_iter().zip(kinds)));
    assert_eq!(rig.link("c").map(|link| link.kind), Some(LinkKind::Pin));
    assert!(rig.link("d").is_none() && rig.link_mut("d").is_none());

    let ends = |line: &Line| (line.from, line.to, line.piece);
    let [to_master, to_device] = [Direction::ToMaster, Direction::ToDevice];
    let link = rig.link_mut("a").expect("it is connected");
    assert_eq!(ends(link.line(to_master)), (end(0, 1), end(2, 3), 4));
    assert_eq!(ends(link.line(to_device)), (end(2, 3), end(0, 1), 4));
    link.line_mut(to_device).piece = 6;
    rig.line_mut(0, to_master).piece = 5;
    rig.line_mut(2, to_master).piece = 8;
    let pieces = |name: &str| {
        let link = rig.link(name).expect("it is connected");
        [to_master, to_device].map(|direction| link.line(direction).piece)
    };
    assert_eq!([pieces("a"), pieces("c")], [[5, 6], [8, 2]]);
}

/// Both ends of each line have their own coding: the sender's comes first.
#[test]
fn the_codings_of_a_line_are_those_of_its_ends() {
    let rig = pair(with_line(1_200), with_line(2_400));
    let bauds = Direction::BOTH.map(|direction| {
        let line = rig.links()[0].line(direction);
        rig.line_configs(line).map(|coding| coding.baud)
    });
    assert_eq!(bauds, [[1_200, 2_400], [2_400, 1_200]]);
}

#[test]
fn a_device_is_found_by_its_name_and_type() {
    let mut rig = bare::rig();
    rig.add_outside("port", LineConfig::new_8n1(9600));
    rig.add_device("one", with_line(1_000));
    rig.add_device("two", with_line(2_000));
    rig.add_program("robot", Box::new(with_line(3_000)));
    let baud = |probe: Option<&Probe>| probe.map(|probe| probe.line.baud);
    let found = ["one", "two", "robot", "port", "three"].map(|name| baud(rig.device(name)));
    assert_eq!(found, [Some(1_000), Some(2_000), None, None, None]);
    let names = ["one", "two", "robot", "port", "three"];
    let expected = names.map(|name| baud(rig.device(name)));
    assert_eq!(
        names.map(|name| baud(rig.device_mut(name).map(|it| &*it))),
        expected
    );
    let planned = names.map(|name| baud(rig.device_to_plan(name).map(|it| &*it)));
    assert_eq!(planned, expected);
    assert!(rig.device::<emulators::odometer::Odometer>("one").is_none());
    assert!(
        rig.device_mut::<emulators::odometer::Odometer>("one")
            .is_none()
    );
}

/// The program is found by its type, among devices of the same type.
#[test]
fn the_program_of_a_rig_is_found_by_its_type() {
    let mut rig = pair(with_line(1_000), with_line(3_000));
    assert_eq!(rig.program().map(|program| program.mode()), Some("probe"));
    let baud = |probe: Option<&Probe>| probe.map(|probe| probe.line.baud);
    assert_eq!(baud(rig.program_as()), Some(3_000));
    assert!(rig.program_as::<u32>().is_none());
    assert!(rig.program_as_mut::<u32>().is_none());
    let program = rig.program_as_mut::<Probe>().expect("it is there");
    program.line.baud = 4_000;
    assert_eq!(baud(rig.program_as()), Some(4_000));

    let mut rig = bare::rig();
    rig.add_device("board", Probe::default());
    rig.add_outside("port", LineConfig::new_8n1(9600));
    assert!(rig.program().is_none() && rig.last_cost().is_none());
    assert!(rig.program_as::<Probe>().is_none() && rig.program_as_mut::<Probe>().is_none());
}

/// Two scans of 1 ms keep the program from 0 to 2 ms. The byte of 10 us waits until then, and
/// there is no work in the second poll: its cost stays the last one.
#[test]
fn work_of_the_program_takes_its_processors_time() {
    let work = firmware_core::Work {
        scans: 2,
        ..firmware_core::Work::NONE
    };
    let mut robot = Probe {
        work,
        ..Probe::default()
    };
    robot.wakes_at = Some(at(5_000));
    let mut rig = pair(Probe::default(), robot);
    rig.cpu.per_scan = Duration::from_millis(1);
    assert_eq!(rig.last_cost(), Some(Duration::ZERO));
    rig.device_mut::<Probe>("board")
        .expect("it is there")
        .to_send
        .push_back(7);
    rig.run_until(at(10_000));
    let robot = rig.program_as::<Probe>().expect("it is there");
    assert_eq!(robot.received, [(5, 10, vec![7])]);
    assert_eq!(robot.polls, [0, 2_000, 5_000]);
    assert_eq!(rig.last_cost(), Some(Duration::from_millis(2)));
}

/// A run never goes back, and its observers learn how far it went.
#[test]
fn a_run_ends_at_its_deadline() {
    let mut rig = bare::rig();
    let notes = watched(&mut rig);
    rig.run_for(Duration::from_micros(7));
    assert_eq!(rig.now(), at(7));
    rig.run_for(Duration::from_micros(5));
    assert_eq!(rig.now(), at(12));
    rig.run_until(at(3));
    assert_eq!(rig.now(), at(12));
    assert_eq!(notes.take(), ["reached 7", "reached 12", "reached 12"]);
}

/// A condition is looked at each 10 us until 25 us, the first time at once.
#[test]
fn a_run_stops_when_its_condition_holds() {
    let run = |from: u64| {
        let mut rig = bare::rig();
        let mut seen = Vec::new();
        let step = Duration::from_micros(10);
        let has_held = rig.run_until_condition(step, at(25), |rig| {
            seen.push(rig.now().as_micros());
            rig.now() >= at(from)
        });
        (has_held, seen, rig.now().as_micros())
    };
    assert_eq!(run(0), (true, vec![0], 0));
    assert_eq!(run(15), (true, vec![0, 10, 20], 20));
    assert_eq!(run(25), (true, vec![0, 10, 20, 25], 25));
    assert_eq!(run(26), (false, vec![0, 10, 20, 25], 25));
}

/// The byte is sent until 10 us = 10,000 ns = 0x2710 and arrives then: link 0, direction 0, side 0
/// for the sender and 1 for the receiver, one byte, the time.
#[test]
fn the_fingerprint_of_a_run_covers_both_ends_of_a_line() {
    let mut rig = pair(Probe::default(), Probe::default());
    assert_eq!(rig.trace_hash(), fingerprint(&[]));
    rig.device_mut::<Probe>("board")
        .expect("it is there")
        .to_send
        .push_back(7);
    rig.run_until(at(20));
    let sent = [0, 0, 0, 1, 0x10, 0x27, 0, 0, 0, 0, 0, 0, 7];
    let received = [0, 0, 1, 1, 0x10, 0x27, 0, 0, 0, 0, 0, 0, 7];
    assert_eq!(rig.trace_hash(), fingerprint(&[sent, received].concat()));
}

/// Each byte is seen when it is sent, when it arrives, and when its receiver gets it.
#[test]
fn observers_see_each_byte_at_both_ends() {
    let mut rig = pair(Probe::default(), Probe::default());
    let notes = watched(&mut rig);
    let board = rig.device_mut::<Probe>("board").expect("it is there");
    board.to_send.extend([7, 8]);
    board.change = Some(LineEvent::Opened);
    let robot = rig.program_as_mut::<Probe>().expect("it is there");
    robot.to_send.push_back(9);
    rig.run_until(at(20));
    let expected = [
        "0 to-master Opened 0",
        "0 to-master Sent 10 [7]",
        "0 to-device Sent 10 [9]",
        "0 to-master arrived 10 [7]",
        "0 to-master Received 10 [7]",
        "0 to-device arrived 10 [9]",
        "0 to-device Received 10 [9]",
        "0 to-master Sent 20 [8]",
        "0 to-master arrived 20 [8]",
        "0 to-master Received 20 [8]",
        "reached 20",
    ];
    assert_eq!(notes.take(), expected);
    let board = rig.device::<Probe>("board").expect("it is there");
    assert_eq!(board.received, [(2, 10, vec![9])]);
    let robot = rig.program_as::<Probe>().expect("it is there");
    assert_eq!(robot.received, [(5, 10, vec![7]), (5, 20, vec![8])]);
    assert_eq!(robot.line_events, [(5, 0, LineEvent::Opened)]);
}

/// The first observer is sound, the second one has a trouble. All are finished up to the first
/// error.
#[test]
fn an_observers_trouble_is_reported() {
    let mut rig = bare::rig();
    let first = watched(&mut rig);
    assert_eq!(rig.take_tap_trouble(), None);
    assert!(rig.finish_taps().is_ok());
    assert_eq!(first.take(), ["finished"]);
    rig.add_tap(Box::new(Watch {
        trouble: Some("disk full".to_owned()),
        ..Watch::default()
    }));
    let last = watched(&mut rig);
    assert_eq!(rig.take_tap_trouble().as_deref(), Some("disk full"));
    let error = rig.finish_taps().expect_err("the disk is full");
    assert_eq!(error.to_string(), "disk full");
    assert_eq!(
        (first.take(), last.take()),
        (vec!["finished".to_owned()], vec![])
    );
}

/// A byte is on its way when the rig is copied. It arrives in both, and what reaches one of them
/// later does not reach the other; the copy has no observer.
#[test]
fn a_copy_of_a_rig_goes_on_by_itself() {
    let (mut rig, [[device, master]]) = bare::linked(["line"], 1_000_000);
    let notes = watched(&mut rig);
    rig.inject(device.node, &[7]);
    rig.log("line", event(EventKind::Violation, 0));
    rig.run_until(at(5));
    let mut copy = rig.fork().expect("no programs");
    copy.inject(device.node, &[8]);
    notes.take();
    copy.run_until(at(30));
    assert!(notes.take().is_empty());
    assert_eq!((rig.now(), copy.now()), (at(5), at(30)));
    rig.run_until(at(30));
    assert_eq!((rig.violations(), copy.violations()), (1, 1));
    assert_eq!(*rig.take_output(master.node), [7]);
    assert_eq!(*copy.take_output(master.node), [7, 8]);
    assert_ne!(rig.trace_hash(), copy.trace_hash());
}

/// The log has room for 10,000 entries, the oldest ones. The others are counted.
#[test]
fn a_full_log_counts_what_it_leaves_out() {
    let mut rig = bare::rig();
    for us in 0..10_003 {
        rig.log("board", event(EventKind::Violation, us));
    }
    assert_eq!((rig.events().len(), rig.events_dropped()), (10_000, 3));
    assert_eq!(rig.events()[9_999].event.at, at(9_999));
    assert_eq!(rig.violations(), 10_003);
    assert_eq!(rig.events()[0].source, "board");
}

/// Until 10 us the rig was late: a violation before that time becomes a note and is excused. Notes,
/// and violations that their device counts, are not counted by the log.
#[test]
fn an_entry_of_the_log_counts_if_it_is_a_violation() {
    let mut rig = bare::rig();
    rig.excuse_until(at(10));
    let counts = |rig: &Rig| (rig.violations(), rig.excused());
    let entry = |rig: &Rig| {
        let logged = rig.events().last().expect("an entry");
        (
            logged.is_violation(),
            logged.event.detail.clone(),
            logged.is_kept,
        )
    };
    let excused = "why (not charged: the rig was late)".to_owned();
    let why = || "why".to_owned();
    rig.log("board", event(EventKind::Violation, 9));
    assert_eq!(
        (counts(&rig), entry(&rig)),
        ((0, 1), (false, excused.clone(), false))
    );
    rig.log("board", event(EventKind::Note, 9));
    assert_eq!((counts(&rig), entry(&rig)), ((0, 1), (false, why(), false)));
    rig.log("board", event(EventKind::Note, 11));
    assert_eq!((counts(&rig), entry(&rig)), ((0, 1), (false, why(), false)));
    rig.log("board", event(EventKind::Violation, 10));
    assert_eq!((counts(&rig), entry(&rig)), ((1, 1), (true, why(), false)));
    rig.log_from("board", event(EventKind::Violation, 9), false, true);
    assert_eq!(
        (counts(&rig), entry(&rig)),
        ((1, 1), (false, excused, true))
    );
    rig.log_from("board", event(EventKind::Violation, 11), false, true);
    assert_eq!((counts(&rig), entry(&rig)), ((1, 1), (true, why(), true)));
}

/// Three bytes are injected; the line takes one at a time. Damaged characters count as output, and
/// are gone with it.
#[test]
fn an_outside_end_tells_what_waits_at_it() {
    let (mut rig, [[device, master]]) = bare::linked(["line"], 1_000_000);
    rig.inject(device.node, &[1, 2, 3]);
    assert_eq!(rig.backlog(device.node), 3);
    rig.run_until(at(0));
    assert_eq!(rig.backlog(device.node), 2);
    rig.run_until(at(30));
    assert_eq!(
        (rig.backlog(device.node), rig.output_len(master.node)),
        (0, 3)
    );
    let tell = Disturbance::Tell {
        link: "line".to_owned(),
        direction: Direction::ToMaster,
        begin: LineEvent::Break,
        end: None,
    };
    rig.disturb(&tell, true);
    assert_eq!(rig.output_len(master.node), 4);
    assert_eq!(*rig.take_output(master.node), [1, 2, 3]);
    assert_eq!(rig.output_len(master.node), 0);
    assert!(rig.take_marks(master.node).is_empty());
    assert!(rig.take_output(master.node).is_empty());
}

/// Only an outside end has bytes, modes and lines of an owner: on another node the calls do
/// nothing.
#[test]
fn a_node_inside_has_no_owner_outside() {
    let mut rig = pair(Probe::default(), Probe::default());
    for node in [0, 1] {
        rig.inject(node, &[1]);
        rig.change_line(node, LineEvent::Opened);
        rig.set_line_config(node, LineConfig::new_8n1(50));
        rig.force_lines(node, [Some(true); 4]);
        rig.hold(node, true);
        rig.discard_input(node);
        rig.set_terminal_modes(node, Some([1, 2]));
        rig.run_for(Duration::from_micros(100));
        assert_eq!((rig.backlog(node), rig.output_len(node)), (0, 0));
        assert!(rig.take_output(node).is_empty() && rig.take_messages(node).is_empty());
        assert!(rig.take_marks(node).is_empty() && !rig.is_unplugged(node));
        assert_eq!((rig.level(node), rig.back_as(node)), (None, None));
        assert_eq!(rig.forced_lines(node), [None; 4]);
        assert_eq!(rig.terminal_modes(node), None);
    }
    let board = rig.device::<Probe>("board").expect("it is there");
    assert!(board.received.is_empty() && board.line_events.is_empty());
    assert_eq!(board.line.baud, 1_000_000);
}

/// The owner of the master's end opens its port at 5 us: the device learns it then.
#[test]
fn the_other_end_learns_that_a_port_was_opened() {
    let mut rig = bare::rig();
    let board = rig.add_device("board", Probe::default());
    let port = rig.add_outside("port", LineConfig::new_8n1(1_000_000));
    rig.connect("line", end(board, 2), end(port, 0), 1);
    rig.run_until(at(5));
    rig.change_line(port, LineEvent::Opened);
    rig.run_until(at(9));
    rig.change_line(port, LineEvent::Closed);
    rig.run_until(at(20));
    let board = rig.device::<Probe>("board").expect("it is there");
    let expected = [(2, 5, LineEvent::Opened), (2, 9, LineEvent::Closed)];
    assert_eq!(board.line_events, expected);
    assert_eq!(board.polls, [0, 5, 9]);
}

/// At half the rate a byte takes twice as long.
#[test]
fn an_outside_end_sends_at_the_rate_of_its_owner() {
    let (mut rig, [[device, master]]) = bare::linked(["line"], 1_000_000);
    for end in [device, master] {
        rig.set_line_config(end.node, LineConfig::new_8n1(500_000));
    }
    rig.inject(device.node, &[7]);
    rig.run_until(at(19));
    assert_eq!(rig.output_len(master.node), 0);
    rig.run_until(at(20));
    assert_eq!(rig.output_len(master.node), 1);
}

/// Messages arrive one by one, in their order, and stay apart from each other.
#[test]
fn messages_are_taken_one_by_one() {
    let mut rig = bare::rig();
    let ends = ["left", "right"].map(|name| {
        let node = rig.add_outside(name, LineConfig::new_8n1(1_000_000));
        end(node, 0)
    });
    rig.connect_by(LinkKind::I2c, "bus", ends[0], ends[1], 1);
    rig.inject(ends[0].node, &[1, 2]);
    rig.inject(ends[0].node, &[3]);
    // 2 x 9 + 2 and 9 + 2 bits of 1 us.
    rig.run_until(at(20));
    assert_eq!(
        rig.take_messages(ends[1].node),
        [Bytes::from_static(&[1, 2])]
    );
    rig.run_until(at(31));
    assert_eq!(rig.take_messages(ends[1].node), [Bytes::from_static(&[3])]);
    assert!(rig.take_messages(ends[1].node).is_empty());
}

/// A device that counts its rules itself, and one that does not: each entry counts once.
#[test]
fn entries_of_a_device_come_into_the_log_with_its_name() {
    let mut counts = BrokenRules::default();
    counts.count(at(0), "too-soon");
    let board = Probe {
        events: vec![event(EventKind::Violation, 0)],
        broken: Some(counts),
        ..Probe::default()
    };
    let other = Probe {
        events: vec![event(EventKind::Violation, 0), event(EventKind::Note, 0)],
        ..Probe::default()
    };
    let mut rig = bare::rig();
    rig.add_device("board", board);
    rig.add_device("other", other);
    rig.run_until(at(1));
    assert_eq!(rig.violations(), 2);
    let entries = rig.events().iter();
    let entries = entries.map(|one| (&*one.source, one.is_violation(), one.is_kept));
    let expected = [
        ("board", true, true),
        ("other", true, false),
        ("other", false, false),
    ];
    assert!(entries.eq(expected));
    assert_eq!(rig.events()[0].to_string(), "0.000000 board too-soon: why");
}

/// A fault of the line that waits for its time delays the bytes that arrive within it.
#[test]
fn a_fault_that_is_planned_during_a_run_takes_effect() {
    let (mut rig, [[device, master]]) = bare::linked(["line"], 1_000_000);
    rig.inject(device.node, &[7]);
    rig.run_until(at(5));
    let window = Window {
        from: at(6),
        until: at(50),
    };
    let line = rig.line_mut(0, Direction::ToMaster);
    line.faults
        .add(FaultId(0), Activity::from(window), Effect::Stall);
    line.note_due();
    rig.run_until(at(49));
    assert_eq!(rig.output_len(master.node), 0);
    rig.run_until(at(50));
    assert_eq!(rig.output_len(master.node), 1);
}
