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
        }
    }
}

/// Golden frames of the fielded program: MPD at its start pose and 20 mm a cell, its state, and
/// its row of unknown cells but for the last pixel, which it never counted.
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

/// A list of which the rest was lost, then 200 ms of silence and a whole one.
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
