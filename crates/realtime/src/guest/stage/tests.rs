//! The stage with one port, whose client is the test: a device that sends "mm=700" and a line end
//! each 100 ms, a character in 1.0417 ms.

use crate::guest::supervisor::tests::Bench;

use super::*;

const MS: u64 = 1_000_000;

fn ms(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

fn at(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

/// Nothing runs at the rig before the program has opened its ports.
#[test]
fn time_of_the_rig_begins_with_the_ports() {
    let mut bench = Bench::new();
    let stage = &mut bench.supervisor.stage;
    stage.pass(ms(30)).expect("the port stays");
    assert_eq!((stage.now(), stage.run.rig.now()), (at(30), at(0)));
    assert!(!stage.has_begun() && stage.quiet_until().is_none());
    assert_eq!(stage.rig_time(at(40)), None);
    let _port = bench.opens("sonar");
    let stage = &mut bench.supervisor.stage;
    assert!(stage.has_begun());
    assert_eq!(stage.rig_time(at(40)), Some(at(10)));
    stage.is_frozen = true;
    assert_eq!(stage.rig_time(at(40)), None);
    stage.is_frozen = false;
    stage.pass(ms(5)).expect("the port stays");
    stage.begin();
    assert_eq!(stage.rig_time(at(40)), Some(at(10)), "it has begun already");
    // The next event of the rig, in the time of the program.
    let next = stage.run.next_event().expect("it sends each 100 ms");
    assert_eq!(stage.quiet_until(), Some(next + ms(30)));
    stage.touch();
    assert_eq!(stage.quiet_until(), Some(at(35)));
    stage.has_counted(at(36));
    stage.has_counted(at(33));
    assert_eq!(stage.now(), at(36));
}

/// While no thread can run time passes by 10 ms at most, and ends with bytes for the program.
#[test]
fn a_leap_ends_with_its_reason() {
    let mut bench = Bench::new();
    let stage = &mut bench.supervisor.stage;
    let leap = |stage: &mut Stage, deadline: Option<u64>| {
        stage.leap(deadline.map(at), false).expect("the port stays");
        stage.now()
    };
    assert_eq!(leap(stage, None), at(10));
    assert_eq!(leap(stage, Some(14)), at(14));
    assert_eq!(leap(stage, Some(3)), at(14), "it is over already");
    assert_eq!(leap(stage, Some(900)), at(24));
    let _port = bench.opens("sonar");
    let stage = &mut bench.supervisor.stage;
    assert!(!stage.take_delivered() || stage.take_arrived().is_empty());
    let mut leaps = 0;
    while stage.terminal(0).is_none_or(|it| it.unread() == 0) {
        stage.leap(None, false).expect("the port stays");
        leaps += 1;
        assert!(leaps < 100);
    }
    // By its line: a character after whole 100 ms and its length.
    let heard = stage.now();
    assert_eq!(stage.heard(0), heard);
    let since_begin = heard.as_nanos() - 24 * MS;
    let rest = since_begin % (100 * MS);
    assert!((1_041_666..=1_041_668).contains(&rest), "{since_begin}");
    assert!(stage.take_delivered() && !stage.take_delivered());
    assert_eq!(
        (stage.take_arrived(), stage.take_arrived()),
        (vec![0], vec![])
    );
    // Free room in the line counts as well, where it is watched.
    let before = stage.now();
    stage.leap(None, true).expect("the port stays");
    assert!(stage.now() > before && stage.now() <= before + ms(2));
}

#[test]
fn a_run_is_over_at_its_end() {
    let mut bench = Bench::new();
    let _port = bench.opens("sonar");
    let stage = &mut bench.supervisor.stage;
    assert!(!stage.is_over());
    stage
        .pass(Duration::from_millis(2_999))
        .expect("the port stays");
    stage.leap(None, false).expect("the port stays");
    stage.pass(ms(20)).expect("the port stays");
    stage.leap(None, false).expect("the port stays");
    assert!(stage.is_over());
    stage.is_endless = true;
    assert!(!stage.is_over());
    let before = stage.run.rig.now();
    stage.pass(ms(200)).expect("the port stays");
    assert!(stage.run.rig.now() > before, "it goes on");
}

/// The bench waits for 60 s.
#[test]
fn a_program_that_opens_nothing_is_given_up() {
    let mut bench = Bench::new();
    let stage = &mut bench.supervisor.stage;
    stage
        .pass(Duration::from_millis(59_999))
        .expect("the port stays");
    assert!(!stage.gave_up());
    stage.pass(ms(1)).expect("the port stays");
    assert!(stage.gave_up());
    stage.begin();
    assert!(!stage.gave_up());
}

/// A 16550 counts each change of CTS, DSR and DCD, and of RI the end.
#[test]
fn changes_of_lines_are_counted() {
    let mut bench = Bench::new();
    let slot = bench.supervisor.stage.slot(0);
    let (cts, dcd, ri, dsr) = (0x20, 0x40, 0x80, 0x100);
    assert_eq!(slot.inputs, cts | dcd | dsr, "as without a device");
    slot.note_inputs(dcd | dsr);
    slot.note_inputs(cts | dcd | dsr | ri);
    assert_eq!(slot.changes, [2, 0, 0, 0]);
    slot.note_inputs(cts | dsr);
    assert_eq!(slot.changes, [2, 0, 1, 1]);
    slot.note_inputs(cts | dsr);
    slot.note_inputs(ri);
    slot.note_inputs(ri);
    assert_eq!(slot.changes, [3, 1, 1, 1]);
    assert_eq!(slot.inputs, ri);
    let stage = &mut bench.supervisor.stage;
    assert_eq!(stage.line_changes(0), [3, 1, 1, 1]);
    stage.set_modem(0, 0xFFFF);
    assert_eq!(
        stage.modem(0),
        ri | 2 | 4,
        "only DTR and RTS are the client's"
    );
    stage.set_modem(0, 4);
    assert_eq!(stage.modem(0), ri | 4);
}

/// 4,096 bytes may wait for the line; after the run nothing waits.
#[test]
fn a_client_may_send_while_there_is_room() {
    let mut bench = Bench::new();
    let _port = bench.opens("sonar");
    let stage = &mut bench.supervisor.stage;
    assert_eq!(
        (stage.room(0), stage.backlog(0), stage.discards(0)),
        (4_096, 0, false)
    );
    stage.realtime.inject(0, &[b'x'; 4_000], &mut stage.run);
    let backlog = stage.backlog(0);
    assert!((3_998..=4_000).contains(&backlog), "{backlog}");
    assert_eq!(stage.room(0), 4_096 - backlog);
    stage.terminal(0).expect("it is there").suspend(true);
    assert_eq!(stage.room(0), 0);
    stage.terminal(0).expect("it is there").suspend(false);
    stage.realtime.inject(0, &[b'x'; 200], &mut stage.run);
    assert_eq!((stage.room(0), stage.discards(0)), (0, false));
    stage.is_frozen = true;
    assert_eq!(
        (stage.room(0), stage.backlog(0), stage.discards(0)),
        (4_096, 0, true)
    );
    stage.is_frozen = false;
    stage.discard_sent(0).expect("the port stays");
    assert!(stage.backlog(0) <= 2);
}

/// A character of 8N1 at 9,600 bit/s takes 1,041,666.7 ns, behind those that wait.
#[test]
fn the_next_byte_of_a_client_arrives_behind_those_that_wait() {
    let mut bench = Bench::new();
    let _port = bench.opens("sonar");
    let stage = &mut bench.supervisor.stage;
    let (first, to) = stage.arrival_of_next(0);
    assert!(
        (1_041_666..=1_041_668).contains(&first.as_nanos()),
        "{first:?}"
    );
    assert_eq!(to.map(|node| stage.run.rig.node_name(node)), Some("sonar"));
    stage.realtime.inject(0, &[b'x'; 10], &mut stage.run);
    let (later, _) = stage.arrival_of_next(0);
    let characters = (later.as_nanos() + 500_000) / 1_041_667;
    assert!((10..=11).contains(&characters), "{later:?}");
}

#[test]
fn a_port_is_known_by_its_device() {
    let mut bench = Bench::new();
    let port = bench.opens("sonar");
    let path = bench.path("sonar");
    let stage = &mut bench.supervisor.stage;
    let device = port.metadata().expect("open").rdev();
    assert_eq!(
        (stage.port_of(device), stage.port_of(device + 1)),
        (Some(0), None)
    );
    assert_eq!(stage.port_of(0), None);
    assert_eq!(stage.path_of(0).as_deref(), path.to_str());
    assert_eq!((stage.path_of(1), stage.is_gone(device)), (None, false));
    stage.slots[0].device = 0;
    assert_eq!(stage.port_of(0), None, "no device is none of a port");
    let terminal = path.canonicalize().expect("it is there");
    assert_eq!(stage.clients(), [terminal.to_str().expect("text")]);
}

/// 1,000 calls in a row at a port that hung up are a busy loop; each of them takes 100 us then.
#[test]
fn a_busy_loop_at_a_port_that_hung_up_is_named() {
    let mut bench = Bench::new();
    let stage = &mut bench.supervisor.stage;
    for _ in 0..999 {
        stage.note_fruitless();
    }
    assert_eq!((stage.now().as_nanos(), stage.busy.is_some()), (0, false));
    stage.end_fruitless();
    for _ in 0..999 {
        stage.note_fruitless();
    }
    assert_eq!((stage.now().as_nanos(), stage.busy.is_some()), (0, false));
    stage.note_fruitless();
    let text = "busy loop at a port that hung up: 1000 calls in a row that did not wait";
    assert_eq!(
        (stage.now().as_nanos(), stage.busy.as_deref()),
        (100_000, Some(text))
    );
    stage.note_fruitless();
    assert_eq!(stage.now().as_nanos(), 200_000);
    let logged = stage
        .run
        .rig
        .events()
        .iter()
        .filter(|it| it.event.rule == "busy-loop");
    assert_eq!(logged.count(), 1);
}

#[test]
fn an_exclusive_port_is_free_again_when_it_is_closed() {
    let mut bench = Bench::new();
    let port = bench.opens("sonar");
    assert!(!bench.supervisor.stage.has_exclusive());
    bench.supervisor.stage.slot(0).is_exclusive = true;
    assert!(bench.supervisor.stage.has_exclusive());
    assert_eq!(bench.supervisor.stage.modem(0) & 6, 6, "open: DTR and RTS");
    drop(port);
    bench.supervisor.stage.touch();
    bench.supervisor.stage.carry().expect("the port stays");
    assert!(!bench.supervisor.stage.has_exclusive());
    assert_eq!(bench.supervisor.stage.modem(0) & 6, 0, "closed");
}

/// Up to the next look of the stage, 10 ms, or of the checks, what comes is known: 64 bytes.
#[test]
fn bytes_are_seen_ahead() {
    let mut bench = Bench::new();
    let _port = bench.opens("sonar");
    let stage = &mut bench.supervisor.stage;
    let ports = [(0, 3, true)];
    let look = |stage: &mut Stage, until: u64| stage.look_ahead(&ports, at(until));
    stage.leap(None, false).expect("the port stays");
    while stage.now() < at(98) {
        stage.leap(Some(at(98)), false).expect("the port stays");
    }
    let ahead = look(stage, 500).expect("nothing is in the way");
    assert!(ahead.limit > stage.now() && ahead.limit < stage.now() + ms(10));
    let near = look(stage, 99).expect("nothing is in the way");
    assert_eq!(near.limit.as_nanos(), 99 * MS - 1);
    assert!(look(stage, 98).is_none(), "no time at all");
    let port = &ahead.ports[0];
    assert_eq!(
        (port.port, port.fd, port.waits, port.takes),
        (0, 3, true, true)
    );
    assert_eq!(port.known_until.as_nanos(), ahead.limit.as_nanos() + 1);
    stage.touch();
    assert!(look(stage, 500).is_none());
    stage.carry().expect("the port stays");
    assert!(look(stage, 500).is_some());
    stage.stir();
    assert!(look(stage, 500).is_none());
    stage.carry().expect("the port stays");
    stage.is_frozen = true;
    assert!(look(stage, 500).is_none());
    stage.is_frozen = false;
    // The whole line, byte by byte, as it comes then.
    let mut seen = Vec::new();
    while stage.now() < at(112) {
        if let Some(ahead) = look(stage, 500) {
            seen.extend(ahead.ports[0].bytes.iter().copied());
            let last = stage.last_arrivals(ahead.limit);
            let own = ahead.ports[0].bytes.iter().rev().map(|&(at, _)| at);
            let own = own
                .filter(|&at| at > stage.now())
                .take(1)
                .collect::<Vec<_>>();
            assert_eq!(last, own);
            stage.follow(ahead.limit).expect("the port stays");
            let len = ahead.ports[0].bytes.len();
            assert!(stage.has_read(0, len), "they are there");
            assert!(!stage.has_read(0, 1), "and no more");
        }
        stage.leap(None, false).expect("the port stays");
        let rest = stage.terminal(0).expect("it is there").unread();
        seen.extend(
            stage
                .terminal(0)
                .and_then(|it| it.take(rest))
                .expect("held")
                .iter()
                .map(|&it| (stage.now, it)),
        );
        stage.took(0, rest);
    }
    let bytes: Vec<u8> = seen.iter().map(|&(_, byte)| byte).collect();
    assert_eq!(bytes, b"mm=700\n");
    let times: Vec<u64> = seen.iter().map(|(at, _)| at.as_nanos()).collect();
    assert!(
        times.is_sorted() && times[0] > 101 * MS && times[6] < 108 * MS,
        "{times:?}"
    );
}

/// The program's time and its terminal are put back; the rig goes on.
#[test]
fn a_stage_is_put_back() {
    let mut bench = Bench::new();
    assert!(bench.supervisor.stage.moment().is_none(), "not begun");
    let port = bench.opens("sonar");
    let stage = &mut bench.supervisor.stage;
    stage.leap(None, false).expect("the port stays");
    let now = stage.now();
    let moment = stage.moment().expect("nothing is under way");
    while stage.terminal(0).is_none_or(|it| it.unread() < 3) {
        stage.leap(None, false).expect("the port stays");
    }
    let rig = stage.run.rig.now();
    assert!(stage.put_back(&moment));
    assert_eq!((stage.now(), stage.heard(0)), (now, Instant::ZERO));
    assert_eq!(stage.terminal(0).map(|it| it.unread()), Some(0));
    assert_eq!(stage.rig_time(now), Some(rig), "the rig has not gone back");
    assert!(!stage.take_delivered() && stage.take_arrived().is_empty());
    stage.realtime.inject(0, &[b'x'; 9], &mut stage.run);
    assert!(
        stage.moment().is_none() && !stage.put_back(&moment),
        "bytes are on their way"
    );
    stage.discard_sent(0).expect("the port stays");
    stage.pass(ms(5)).expect("the port stays");
    stage.carry().expect("the port stays");
    assert!(stage.moment().is_some());
    stage.release(0);
    assert!(stage.moment().is_none(), "the kernel holds its bytes");
    drop(port);
    let mut bench = Bench::new();
    let port = bench.opens("sonar");
    drop(port);
    assert!(
        bench.supervisor.stage.moment().is_none(),
        "no client is there"
    );
}
