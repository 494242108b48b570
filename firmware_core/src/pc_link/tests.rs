extern crate std;

use std::vec::Vec;

use protocols::pcui::diagnosis::Diagnosis;
use protocols::pcui::message::Mode;

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
