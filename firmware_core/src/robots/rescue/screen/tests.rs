//! Taps, messages and buttons. Pictures of the display are compared in the rig.

extern crate std;

use std::vec::Vec;

use protocols::panel::{Contact, Pen, encode_pen};

use super::*;
use crate::pose::{Point, Pose};

/// A tap on this pixel: 4096 readings are 480 columns and 272 rows.
fn tap(screen: &mut Screen, ms: u64, x: u32, y: u32) -> Option<Hit> {
    let reading = [(x * 4096).div_ceil(480), (y * 4096).div_ceil(272)];
    let mut report = |contact, ms| {
        let reading = reading.map(|it| u16::try_from(it).unwrap());
        let pen = encode_pen(Pen { contact, reading });
        screen.receive(Instant::from_millis(ms), &pen)
    };
    let hit = report(Contact::Down, ms);
    assert_eq!(report(Contact::Up, ms + 20), None);
    hit
}

/// Pixel 20 of row 50 from below: 20.5 and 50.5 times 1.5 cells. Two taps within 0.6 s and 12
/// pixels are a double tap, a third tap is a first one again. Reset needs a double tap, other
/// buttons one tap.
#[test]
fn the_map_is_touched_once_or_twice() {
    let place = [30.75, 75.75];
    let mut screen = Screen::new();
    assert_eq!(
        tap(&mut screen, 1_000, 26, 181),
        Some(Hit::Map(place, false))
    );
    assert_eq!(
        tap(&mut screen, 1_600, 26, 181),
        Some(Hit::Map(place, true))
    );
    assert_eq!(
        tap(&mut screen, 1_800, 26, 181),
        Some(Hit::Map(place, false))
    );
    assert_eq!(
        tap(&mut screen, 2_401, 26, 181),
        Some(Hit::Map(place, false))
    );
    let doubles = |x, y| {
        let mut screen = Screen::new();
        tap(&mut screen, 1_000, 26, 181);
        matches!(tap(&mut screen, 1_200, x, y), Some(Hit::Map(_, true)))
    };
    assert!(doubles(38, 181) && doubles(14, 181) && doubles(26, 193) && doubles(26, 169));
    assert!(!doubles(39, 181) && !doubles(13, 181) && !doubles(26, 194) && !doubles(26, 168));
    assert_eq!(tap(&mut screen, 4_000, 400, 256), None);
    assert_eq!(tap(&mut screen, 5_000, 281, 130), None);
    let reset = tap(&mut screen, 5_200, 281, 130);
    assert_eq!(reset, Some(Hit::Button(Action::Reset)));
    assert_eq!(tap(&mut screen, 6_000, 26, 181), None);
    let pc_link = tap(&mut screen, 7_000, 350, 33);
    assert_eq!(pc_link, Some(Hit::Button(Action::PcLink)));
}

/// Messages of the robot so far, the newest first.
fn told(robot: &super::super::Rescue) -> Vec<Notice> {
    robot
        .screen
        .notices
        .newest()
        .map(|entry| entry.notice)
        .collect()
}

fn robot() -> std::boxed::Box<super::super::Rescue> {
    std::boxed::Box::new(super::super::Rescue::new(super::super::Config::default()))
}

/// 20 mm from the edge, there again, back in the middle, and at the edge again.
#[test]
fn each_time_that_the_map_ends_is_told_once() {
    let mut robot = robot();
    let mut count = |x_mm: f32, y_mm: f32| {
        robot.mapper.set_pose(Pose::new(x_mm, y_mm, 0.0));
        robot.watch_health(Instant::ZERO);
        told(&robot)
            .iter()
            .filter(|it| **it == Notice::OffMap)
            .count()
    };
    assert_eq!([count(1_500.0, 1_500.0), count(20.0, 1_500.0)], [0, 1]);
    assert_eq!([count(30.0, 1_500.0), count(2_990.0, 1_500.0)], [1, 1]);
    assert_eq!([count(1_500.0, 1_500.0), count(1_500.0, 2_990.0)], [1, 2]);
    assert_eq!([count(1_500.0, 1_500.0), count(1_500.0, 10.0)], [2, 3]);
}

/// One message when the search turns into the drive home.
#[test]
fn that_nothing_is_left_is_told_once() {
    let mut robot = robot();
    let place = |degree: u16| {
        let (sin, cos) = crate::pose::sin_cos(f32::from(degree).to_radians());
        let far = 600.0 / sin.abs().max(cos.abs());
        Point::new(far * cos, far * sin)
    };
    let points: Vec<Point> = (0..360).map(place).collect();
    let scan = crate::scan::Scan::from_points(&points, Instant::ZERO, Instant::ZERO);
    for _ in 0..20 {
        robot.mapper.draw(&scan, [0; 2]);
    }
    let pose = robot.mapper.pose();
    let around = crate::navigation::Surroundings::EMPTY;
    let counts = [(); 20].map(|()| {
        robot.search(Instant::ZERO, pose, &around);
        let count = told(&robot)
            .iter()
            .filter(|it| **it == Notice::Explored)
            .count();
        (
            robot.explore.progress() != super::super::Progress::Seeks,
            count,
        )
    });
    assert_eq!((counts[0], counts[19]), ((false, 0), (true, 1)));
    assert!(
        counts
            .iter()
            .all(|(is_over, count)| usize::from(*is_over) == *count)
    );
}

/// The report's display has further buttons: "Processed" on the page of the map, and the streams
/// (raw lidar, debug, debug OS, errors, SlamUI) among the settings. These are all that there are.
#[test]
fn r088_r147_no_button_for_raw_scans_or_streams() {
    let labels = |page| -> Vec<&str> {
        let own = layout::buttons(page, false).skip(3);
        own.map(|button| button.label).collect()
    };
    assert_eq!(
        labels(Page::Map),
        [
            "Stop",
            "Explore",
            "Waypoints",
            "Mapping",
            "Show scan",
            "Set waypoints",
            "Clear map",
            "Clear waypoints",
        ]
    );
    assert_eq!(
        labels(Page::Settings),
        ["Lidar", "PC link", "RESET: tap twice"]
    );
    assert_eq!(labels(Page::Info), [""; 0]);
}
