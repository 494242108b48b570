extern crate std;

use std::vec::Vec;

use protocols::pcui::diagnosis::Diagnosis;
use protocols::pcui::message::{Message, Mode};

use super::*;

fn at(millis: u64) -> Instant {
    Instant::from_millis(millis)
}

fn link(pace_bytes_per_s: Option<u32>) -> PcLink {
    PcLink::new(Settings {
        pace_bytes_per_s,
        ..Settings::default()
    })
}

fn sent(link: &mut PcLink) -> Vec<u8> {
    let mut buf = [0; 4096];
    let count = link.transmit(&mut buf);
    buf[..count].to_vec()
}

struct Robot {
    map: std::boxed::Box<Grid>,
    waypoints: Waypoints,
}

impl Robot {
    fn new() -> Self {
        Self {
            map: std::boxed::Box::new(Grid::new(20.0)),
            waypoints: Waypoints::new(),
        }
    }

    fn view(&self) -> View<'_> {
        View {
            map: &self.map,
            pose: Pose::new(1000.0, 1000.0, core::f32::consts::FRAC_PI_2),
            state: State {
                mode: Mode::Exploration,
                set_point: [1, 2],
                ..State::default()
            },
            waypoints: &self.waypoints,
            diagnosis: Diagnosis::default(),
            victims: &[],
            readings: Readings::NONE,
            message: Text::default(),
        }
    }
}

/// Golden frames of the fielded program: MPD at its start pose and 20 mm a cell, its state, and its
/// row of unknown cells. The row lacks its last pixel, which the fielded program never counted.
#[test]
fn the_first_frames_are_the_golden_ones() {
    let (mut link, robot) = (link(Some(12_000)), Robot::new());
    link.tick(at(0), &robot.view());
    let mut golden = b"PCUI_MSG\x0D\x00\x53\x03\x00\x00MPD\
        \x14\x70\x17\x70\x17\x01\xE8\x03\xE8\x03\x00\x5A\x00"
        .to_vec();
    golden.extend(b"PCUI_MSG\x09\x00\x04\x00\x00\x00STA\x01\x00\x00\x00\x00\x00\x00\x01\x02");
    assert_eq!(sent(&mut link), golden);
    // 56 bytes at 12 kB/s: 4.67 ms until the first row.
    assert_eq!(
        link.next_at(),
        Instant::from_nanos(30 * 1_000_000_000 / 12_000 + 26 * 1_000_000_000 / 12_000)
    );
    link.tick(at(5), &robot.view());
    let row = b"PCUI_MSG\x07\x00\x2A\x02\x00\x00MAR\x00\x00\x00\xFF\x7F\x2D\x7F";
    assert_eq!(sent(&mut link), row);
}

/// A list whose end is lost, then 200 ms of silence and a complete list.
#[test]
fn silence_ends_a_frame_that_was_cut_off() {
    let mut link = link(None);
    let mut input = &b"PCUI_MSG\xFF\x01\x00\x00\x00\x00LWP\x38\x00"[..];
    assert_eq!(link.receive(at(0), &mut input), None);
    assert_eq!(link.idle_at(), Some(at(100)));
    let mut input = &b"PCUI_MSG\x02\x00\x00\x00\x00\x00LWP\x00\x00"[..];
    let frame = link.receive(at(200), &mut input).expect("whole");
    assert_eq!(frame.id(), *b"LWP");
    assert_eq!((link.counters().bad_frames, link.idle_at()), (1, None));
}

#[test]
fn without_a_pace_the_queue_is_kept_filled() {
    let (mut link, robot) = (link(None), Robot::new());
    link.tick(at(0), &robot.view());
    assert!(sent(&mut link).len() > ROWS_BELOW);
    assert!(link.next_at() <= at(0));
    link.tick(at(0), &robot.view());
    assert!(sent(&mut link).len() > ROWS_BELOW);
}

#[test]
fn a_line_that_takes_nothing_is_asked_again_later_and_not_at_once() {
    let (mut link, robot) = (link(None), Robot::new());
    link.tick(at(0), &robot.view());
    assert_eq!(link.next_at(), at(5));
    link.tick(at(5), &robot.view());
    assert_eq!(link.next_at(), at(10));
}

#[test]
fn a_list_goes_out_before_the_next_row() {
    let (mut link, mut robot) = (link(Some(1000)), Robot::new());
    link.tick(at(0), &robot.view());
    sent(&mut link);
    robot.waypoints.push([-20, 5], 0).expect("room");
    link.echo_waypoints();
    assert!(link.next_at() <= at(1));
    link.tick(at(1), &robot.view());
    let bytes = sent(&mut link);
    let mut decoder = pcui::Decoder::default();
    let frame = decoder.push(&bytes).next().expect("whole").expect("valid");
    let Ok(Message::Waypoints(list)) = frame.message() else {
        panic!("{frame:?}");
    };
    assert_eq!(
        list.iter().next().map(|waypoint| waypoint.position_mm),
        Some([-20, 5])
    );
}

/// The next time is 50 ms after the due time; a call that comes later than that starts a new
/// period.
#[test]
fn a_late_period_is_not_made_up_for() {
    let period = Duration::from_millis(50);
    let next = |due, now| next_period(at(due), period, at(now));
    assert_eq!(
        [next(0, 0), next(0, 49), next(100, 120)],
        [50, 50, 150].map(at)
    );
    assert_eq!([next(0, 50), next(0, 51)], [100, 101].map(at));
}

/// At 12,000 bytes a second, 12 bytes take a millisecond. A pace of 0 counts as one byte a second.
#[test]
fn bytes_pass_at_their_pace() {
    assert_eq!(passing(12, 12_000), Duration::from_millis(1));
    assert_eq!(passing(30_000, 12_000), Duration::from_millis(2_500));
    assert_eq!(passing(3, 0), Duration::from_secs(3));
}

/// Values above 16 bits or below 0 are sent as the nearest possible value.
#[test]
fn millimetres_are_told_whole() {
    let told = [-5.0, 0.49, 20.5, 6_000.4, 70_000.0].map(whole);
    assert_eq!(told, [0, 0, 21, 6_000, u16::MAX]);
    let robot = Robot::new();
    let side = u16::try_from(crate::grid::SIDE).expect("small");
    let properties = properties(&robot.view());
    assert_eq!(properties.size_mm, [side * 20; 2]);
    assert_eq!((properties.resolution_mm, properties.psi_deg), (20, 90));
    assert_eq!(properties.position_mm, [1_000, 1_000]);
}

/// Bytes beyond the radio's room wait until the radio has sent the earlier ones. Later bytes wait
/// too, and half of that room is freed at a time.
#[test]
fn what_the_radio_has_no_room_for_waits() {
    let mut link = link(Some(1_000));
    let most = u64::try_from(AT_ONCE).expect("small");
    link.hold(at(5), AT_ONCE, 1_000);
    assert_eq!(link.held, 0);
    link.hold(at(5), AT_ONCE + 700, 1_000);
    assert_eq!((link.held, link.release_at), (700, at(5 + most)));
    link.hold(at(6), 20, 1_000);
    assert_eq!((link.held, link.release_at), (720, at(5 + most)));
    link.pose_at = at(60_000);
    (link.state_at, link.row_at) = (link.pose_at, link.pose_at);
    assert_eq!(link.next_at(), at(5 + most));
    link.tx.push(&[7; 1_000]);
    assert_eq!(sent(&mut link).len(), 280);
    link.release(at(4 + most));
    assert_eq!(link.held, 720);
    link.release(at(5 + most));
    let half = AT_ONCE / 2;
    let part = u64::try_from(half.min(720)).expect("small");
    assert_eq!(
        (link.held, link.release_at),
        (720 - half.min(720), at(5 + most + part))
    );
    assert_eq!(sent(&mut link).len(), half.min(720));
    link.release(at(60_000));
    assert_eq!((link.held, sent(&mut link).len()), (0, 720 - half.min(720)));
}

/// The state is sent five times a second, the diagnosis each second if it is enabled, the pose each
/// 50 ms.
#[test]
fn each_frame_has_its_period() {
    let count = |diagnosis| {
        let robot = Robot::new();
        let mut link = PcLink::new(Settings {
            diagnosis,
            ..Settings::default()
        });
        let mut bytes = Vec::new();
        for millis in 0..2_000 {
            link.tick(at(millis), &robot.view());
            bytes.extend(sent(&mut link));
        }
        let mut decoder = pcui::Decoder::default();
        let frames: Vec<_> = decoder.push(&bytes).flatten().collect();
        let of = |id: &[u8; 3]| frames.iter().filter(|frame| frame.id() == *id).count();
        let [poses, states] = [of(b"MPD"), of(b"STA")];
        let rows = of(b"MAR");
        assert_eq!(u32::try_from(rows), Ok(link.counters().rows));
        assert_eq!(u32::try_from(frames.len()), Ok(link.counters().sent));
        (poses, states, frames.len() - poses - states - rows)
    };
    assert_eq!(count(Diagnose::Nothing), (40, 10, 0));
    assert_eq!(count(Diagnose::EachSecond), (40, 10, 8));
}

/// After the last row the first follows; while too many bytes wait no row is added.
#[test]
fn rows_go_round_and_stop_while_the_queue_is_long() {
    let (mut link, robot) = (link(None), Robot::new());
    let mut frame = [0; FRAME_MAX];
    let side = u16::try_from(crate::grid::SIDE).expect("small");
    link.row = side - 1;
    link.tick_row(at(3), &robot.view(), &mut frame);
    assert_eq!(
        (link.row, link.row_at, link.counters.rows),
        (side, at(3), 1)
    );
    link.tick_row(at(3), &robot.view(), &mut frame);
    assert_eq!((link.row, link.counters.rows), (0, 1));
    sent(&mut link);
    link.tx.push(&[0; ROWS_BELOW + 1]);
    link.tick_row(at(7), &robot.view(), &mut frame);
    assert_eq!((link.row, link.row_at), (0, at(12)));
    // 24 bytes of a row on top of a queue that is not full yet.
    sent(&mut link);
    link.tx.push(&[0; ROWS_BELOW]);
    link.tick_row(at(20), &robot.view(), &mut frame);
    assert_eq!((link.row, link.row_at), (1, at(25)));
    let mut few = [0; 23];
    link.transmit(&mut few);
    assert_eq!(link.row_at, at(25));
    link.transmit(&mut few[..1]);
    assert_eq!(link.row_at, at(0));
}

/// Half a list arrives, and the other half 60 ms later: the link keeps the first half until then.
/// After 100 ms it does not.
#[test]
fn half_a_frame_waits_for_its_rest() {
    let list = b"PCUI_MSG\x02\x00\x00\x00\x00\x00LWP\x00\x00";
    let takes = |asked: u64| {
        let mut link = link(None);
        let (mut head, mut tail) = list.split_at(9);
        assert_eq!(link.receive(at(10), &mut head), None);
        assert_eq!(link.freed(at(10 + asked)), None);
        let taken = link.receive(at(10 + asked), &mut tail).is_some();
        (taken, link.decoder.pending(), link.counters().bad_frames)
    };
    assert_eq!(takes(99), (true, 0, 0));
    assert!(!takes(100).0);
}

/// The other end closed in the middle of a long frame: the next one is received at once.
#[test]
fn a_line_that_broke_gives_up_what_it_had_begun() {
    let heard = |breaks: bool| {
        let mut link = link(None);
        let mut input = &b"PCUI_MSG\xFF\x01\x00\x00\x00\x00LWP\x38\x00"[..];
        assert_eq!(link.receive(at(0), &mut input), None);
        if breaks {
            link.line_broke();
        }
        let mut input = &b"PCUI_MSG\x02\x00\x00\x00\x00\x00LWP\x00\x00"[..];
        link.receive(at(1), &mut input).is_some()
    };
    assert_eq!([true, false].map(heard), [true, false]);
}

/// PU-17: every byte is sent twice after the first frame that did not fit.
#[test]
fn bytes_are_sent_twice_once_the_queue_was_full() {
    let mut link = PcLink::new(Settings {
        defects: Defects {
            sends_twice: true,
            ..Defects::NONE
        },
        ..Settings::default()
    });
    link.tx.push(b"ab");
    assert_eq!((sent(&mut link), link.overflows()), (b"ab".to_vec(), 0));
    link.tx.push(&[0; TX_LEN + 1]);
    link.tx.push(b"abcd");
    assert_eq!(
        (sent(&mut link), link.overflows()),
        (b"aabbccdd".to_vec(), 1)
    );
    link.tx.push(b"e");
    assert_eq!(sent(&mut link), b"ee");
}
