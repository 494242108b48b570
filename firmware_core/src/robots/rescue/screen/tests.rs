//! Tests of the picture as the display gets it, by positions and content.

extern crate std;

use std::vec;
use std::vec::Vec;

use embedded_graphics::Pixel;
use embedded_graphics::mono_font::ascii::{FONT_6X10, FONT_6X13_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{IntoStorage, Rgb565, WebColors};
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};
use protocols::Decode;
use protocols::panel::{self, Command, Contact, Pen, encode_pen};

use super::*;
use crate::pose::{Point, Pose};

const BLACK: u16 = 0x0000;
const WHITE: u16 = 0xFFFF;
/// Colour of a cell that was never seen: the gray 255 - 127 is level 4 of 7, which is 18 of 31 and
/// 37 of 63.
const GRAY: u16 = 18 << 11 | 37 << 5 | 18;

/// 480 x 272 pixels.
struct Picture(Vec<u16>);

impl Picture {
    fn of(colour: u16) -> Self {
        Self(vec![colour; 480 * 272])
    }

    fn at(&self, x: usize, y: usize) -> u16 {
        self.0[y * 480 + x]
    }

    /// Whether these words are at this position in this colour: every pixel of their letters, and
    /// no other pixel of the area.
    fn says(&self, at: (i32, i32), words: &str, font: &MonoFont<'_>, ink: u16) -> bool {
        let mut expected = Self::of(0);
        let style = MonoTextStyle::new(font, Rgb565::new(31, 63, 31));
        let place = embedded_graphics::geometry::Point::new(at.0, at.1);
        let Ok(_) = Text::with_baseline(words, place, style, Baseline::Top).draw(&mut expected);
        let size = font.character_size;
        let (left, top) = (
            usize::try_from(at.0).unwrap(),
            usize::try_from(at.1).unwrap(),
        );
        let width = usize::try_from(size.width).unwrap() * words.len();
        let height = usize::try_from(size.height).unwrap();
        (top..top + height).all(|y| {
            (left..left + width).all(|x| (expected.at(x, y) == WHITE) == (self.at(x, y) == ink))
        })
    }
}

impl OriginDimensions for Picture {
    fn size(&self) -> Size {
        Size::new(480, 272)
    }
}

impl DrawTarget for Picture {
    type Color = Rgb565;
    type Error = core::convert::Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb565>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Self::Error> {
        for Pixel(at, colour) in pixels {
            if let (Ok(x @ 0..480), Ok(y @ 0..272)) = (usize::try_from(at.x), usize::try_from(at.y))
            {
                self.0[y * 480 + x] = colour.into_storage();
            }
        }
        Ok(())
    }
}

/// The picture on a display that has received all data due at `now`.
fn sent(screen: &mut Screen, now: Instant, view: &View<'_>, picture: &mut Picture) {
    let mut decoder = panel::Decoder::default();
    for _ in 0..5_000 {
        if !screen.has_work(now) {
            break;
        }
        screen.refresh(now, view);
        let mut bytes = [0; 2_000];
        let len = screen.transmit(&mut bytes);
        for frame in decoder.push(&bytes[..len]) {
            let frame = frame.expect("sound");
            let (window, pixels): (_, Vec<u16>) = match frame.command() {
                Some(Command::Write(window, bytes)) => {
                    let pixels = bytes.chunks_exact(2);
                    let pixels = pixels.map(|it| u16::from_be_bytes([it[0], it[1]]));
                    (window, pixels.collect())
                }
                Some(Command::Runs(window, bytes)) => {
                    let runs = bytes.chunks_exact(3);
                    let runs =
                        runs.flat_map(|it| vec![u16::from_be_bytes([it[1], it[2]]); it[0].into()]);
                    (window, runs.collect())
                }
                _ => continue,
            };
            let [left, right] = window.columns.map(usize::from);
            let width = right + 1 - left;
            for (row, pixels) in pixels.chunks_exact(width).enumerate() {
                let y = usize::from(window.rows[0]) + row;
                picture.0[y * 480 + left..][..width].copy_from_slice(pixels);
            }
        }
    }
    assert!(!screen.has_work(now), "it comes to an end");
}

fn shown(screen: &mut Screen, now: Instant, view: &View<'_>) -> Picture {
    let mut picture = Picture::of(0x1234);
    sent(screen, now, view, &mut picture);
    picture
}

fn view<'a>(map: &'a Grid, waypoints: &'a Waypoints) -> View<'a> {
    View {
        map,
        pose: Pose::new(1_500.0, 750.0, 0.0),
        scan: &[],
        waypoints,
        mode: Mode::Stop,
        mode_name: "Stop",
        health: Notice::AllWell,
        battery: Some(Battery {
            millivolts: 12_345,
            percent: 81,
        }),
        switches: Switches::AT_START,
        figures: Figures::default(),
    }
}

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

/// Pixel 20 of row 50 from below is cell 30 of row 75, pixel 22 cell 33, pixel 24 cell 36; the
/// first and the last are those of the corners. The gray 255 - 95 is level 5 of 7, which is 22 of
/// 31 and 45 of 63.
#[test]
fn the_map_is_drawn_at_two_pixels_for_three_cells() {
    let mut map = Grid::new(10.0);
    for (x, y, value) in [
        (30, 75, 255),
        (33, 75, 0),
        (36, 75, 95),
        (0, 0, 255),
        (299, 299, 255),
    ] {
        map.set(x, y, value);
    }
    let waypoints = Waypoints::new();
    let picture = shown(&mut Screen::new(), Instant::ZERO, &view(&map, &waypoints));
    let row = [25, 26, 27, 28, 29, 30, 31].map(|x| picture.at(x, 181));
    let shade = 22 << 11 | 45 << 5 | 22;
    assert_eq!(row, [GRAY, BLACK, GRAY, WHITE, GRAY, shade, GRAY]);
    assert_eq!([180, 182].map(|y| picture.at(26, y)), [GRAY; 2]);
    assert_eq!([picture.at(6, 231), picture.at(205, 32)], [BLACK; 2]);
    assert_eq!([picture.at(7, 231), picture.at(205, 33)], [GRAY; 2]);
    // The map has a frame around it, and the frame is surrounded by the background colour.
    for (x, y) in [
        (5, 31),
        (206, 232),
        (5, 100),
        (100, 31),
        (206, 100),
        (100, 232),
    ] {
        assert_eq!(picture.at(x, y), BLACK, "{x} {y}");
    }
    for (x, y) in [(4, 100), (100, 30), (207, 100), (100, 233)] {
        assert_eq!(picture.at(x, y), WHITE, "{x} {y}");
    }
}

/// A pixel is 15 mm: (1500, 750) mm is pixel (106, 181). The two legs are 10 pixels long, 20
/// degrees to either side of backwards: 9.4 pixels back and 3.4 aside.
#[test]
fn the_robot_is_a_tip_with_two_legs() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let crimson = Rgb565::CSS_CRIMSON.into_storage();
    let mut screen = Screen::new();
    let mut picture = Picture::of(0);
    let mut legs = |ms: u64, heading: f32| {
        let view = View {
            pose: Pose::new(1_500.0, 750.0, heading),
            ..view(&map, &waypoints)
        };
        sent(&mut screen, Instant::from_millis(ms), &view, &mut picture);
        let is_leg = |(x, y)| picture.at(x, y) == crimson;
        let ahead = [(97, 184), (97, 178), (106, 181)].map(is_leg);
        let left = [(109, 190), (103, 190), (106, 181)].map(is_leg);
        let all = picture.0.iter().filter(|it| **it == crimson).count();
        (ahead, left, all)
    };
    // Ten pixels for each leg; the legs share the pixel at the tip and maybe the next one.
    let (ahead, left, all) = legs(0, 0.0);
    assert_eq!((ahead, left), ([true; 3], [false, false, true]));
    assert!((17..=19).contains(&all), "{all}");
    // After the turn, pixels of the old legs are cleared.
    let (ahead, left, all) = legs(1_000, core::f32::consts::FRAC_PI_2);
    assert_eq!((ahead, left), ([false, false, true], [true; 3]));
    assert!((17..=19).contains(&all), "{all}");
}

/// The robot looks along y: a point 150 mm ahead of it is 10 pixels above it, one 150 mm to its
/// left is 10 pixels to the left. Points outside the map are not drawn.
#[test]
fn the_scan_is_drawn_if_it_is_asked_for() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let scan = [
        Point::new(150.0, 0.0),
        Point::new(0.0, 150.0),
        Point::new(0.0, -2_000.0),
    ];
    let drawn = |scan_on: bool| {
        let view = View {
            pose: Pose::new(1_500.0, 750.0, core::f32::consts::FRAC_PI_2),
            scan: &scan,
            switches: Switches {
                scan: scan_on,
                ..Switches::AT_START
            },
            ..view(&map, &waypoints)
        };
        let picture = shown(&mut Screen::new(), Instant::ZERO, &view);
        let blue = Rgb565::CSS_DODGER_BLUE.into_storage();
        let all = picture.0.iter().filter(|it| **it == blue).count();
        (
            [(106, 171), (96, 181)].map(|(x, y)| picture.at(x, y) == blue),
            all,
        )
    };
    assert_eq!(drawn(true), ([true; 2], 2));
    assert_eq!(drawn(false), ([false; 2], 0));
}

/// The waypoint at (300, 300) mm is pixel (26, 211), that at (1200, 300) mm is (86, 211); (4000,
/// 300) mm is off the map, and so is the path to it. The first one is reached.
#[test]
fn waypoints_are_dots_with_numbers_and_ways_between() {
    let map = Grid::new(10.0);
    let mut waypoints = Waypoints::new();
    for place in [[300, 300], [1_200, 300], [4_000, 300]] {
        waypoints.push(place, 0).expect("there is room");
    }
    waypoints.advance();
    let picture = shown(&mut Screen::new(), Instant::ZERO, &view(&map, &waypoints));
    let [open, reached] = [Rgb565::CSS_PURPLE, Rgb565::CSS_PLUM].map(IntoStorage::into_storage);
    // The path to the second one begins over the dot of the first.
    assert_eq!([picture.at(26, 211), picture.at(26, 209)], [open, reached]);
    assert_eq!([picture.at(86, 211), picture.at(86, 213)], [open; 2]);
    assert_eq!([picture.at(56, 211), picture.at(150, 211)], [open, GRAY]);
    assert!(picture.says((30, 201), "1", &FONT_6X10, reached));
    assert!(picture.says((90, 201), "2", &FONT_6X10, open));
    let words = "waypoint 2 of 3: 1200, 300 mm";
    assert!(picture.says((218, 200), words, &FONT_6X10, BLACK));
    waypoints.advance();
    waypoints.advance();
    let picture = shown(&mut Screen::new(), Instant::ZERO, &view(&map, &waypoints));
    assert!(picture.says((218, 200), "all 3 waypoints reached", &FONT_6X10, BLACK));
}

#[test]
fn the_status_bar_tells_mode_message_and_battery() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let mut screen = Screen::new();
    let mut picture = Picture::of(0);
    sent(
        &mut screen,
        Instant::ZERO,
        &view(&map, &waypoints),
        &mut picture,
    );
    assert!(picture.says((8, 6), "Stop", &FONT_6X13_BOLD, WHITE));
    assert!(picture.says((112, 7), "0 s  started", &FONT_6X10, WHITE));
    assert!(picture.says((388, 6), "battery  81 %", &FONT_6X13_BOLD, WHITE));
    let red = Rgb565::CSS_ORANGE_RED.into_storage();
    let mut battery = |ms: u64, percent: Option<i8>| {
        let view = View {
            battery: percent.map(|percent| Battery {
                millivolts: 0,
                percent,
            }),
            ..view(&map, &waypoints)
        };
        sent(&mut screen, Instant::from_millis(ms), &view, &mut picture);
        let says = |words, ink| picture.says((388, 6), words, &FONT_6X13_BOLD, ink);
        let warns = picture.says((112, 7), "2 s  Battery warning!", &FONT_6X10, red);
        (
            says("battery  21 %", WHITE),
            says("battery  20 %", red),
            says("battery  -- %", WHITE),
            warns,
        )
    };
    assert_eq!(battery(1_000, Some(21)), (true, false, false, false));
    assert_eq!(battery(2_000, Some(20)), (false, true, false, true));
    assert_eq!(battery(2_900, None), (false, false, true, true));
}

/// Buttons of 128 x 36 pixels, labels in their middles, active buttons in another colour.
#[test]
fn buttons_show_what_is_on() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let mut screen = Screen::new();
    let picture = shown(&mut screen, Instant::ZERO, &view(&map, &waypoints));
    let [lit, field, bar] = [
        Rgb565::CSS_STEEL_BLUE,
        Rgb565::CSS_GAINSBORO,
        Rgb565::CSS_DARK_SLATE_GRAY,
    ]
    .map(IntoStorage::into_storage);
    // The button at (218, 32) of 128 x 36 pixels has its middle at (281, 49); a letter is 6 pixels
    // wide.
    assert!(picture.says((269, 43), "Stop", &FONT_6X13_BOLD, WHITE));
    assert!(picture.says((390, 43), "Explore", &FONT_6X13_BOLD, BLACK));
    assert_eq!([picture.at(219, 33), picture.at(349, 33)], [lit, field]);
    assert_eq!(
        [
            picture.at(218, 32),
            picture.at(345, 67),
            picture.at(346, 50)
        ],
        [bar, bar, WHITE]
    );
    // Mapping is on, the scan and setting waypoints are not.
    assert_eq!(
        [(349, 73), (219, 113), (349, 113)].map(|(x, y)| picture.at(x, y)),
        [lit, field, field]
    );
    assert!(picture.says((70, 249), "Map", &FONT_6X13_BOLD, WHITE));
    assert_eq!(
        [(1, 241), (161, 241)].map(|(x, y)| picture.at(x, y)),
        [lit, field]
    );
    assert!(picture.says((218, 200), "no waypoints", &FONT_6X10, BLACK));
    let words = "touch the map: robot is here";
    assert!(picture.says((218, 216), words, &FONT_6X10, BLACK));
    let setting = View {
        switches: Switches {
            waypoints: true,
            ..Switches::AT_START
        },
        ..view(&map, &waypoints)
    };
    let picture = shown(&mut Screen::new(), Instant::ZERO, &setting);
    let words = "touch the map: next waypoint";
    assert!(picture.says((218, 216), words, &FONT_6X10, BLACK));
    assert_eq!(picture.at(349, 113), lit);
}

/// The tab in the middle shows the figures, which are updated while they are visible.
#[test]
fn the_page_of_figures_tells_them() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let view = |scans| View {
        figures: Figures {
            pose: [1, -2, 3],
            scans,
            lost_packets: 5,
            base_retries: 6,
            rows_sent: 7,
            arrivals: 0,
        },
        ..view(&map, &waypoints)
    };
    let mut screen = Screen::new();
    let mut picture = Picture::of(0);
    sent(&mut screen, Instant::ZERO, &view(4), &mut picture);
    assert_eq!(tap(&mut screen, 100, 240, 256), None);
    for (ms, scans, told) in [(200, 4, "       4"), (900, 8, "       8")] {
        sent(
            &mut screen,
            Instant::from_millis(ms),
            &view(scans),
            &mut picture,
        );
        let lines = [
            "x 1 mm  y -2 mm  heading 3".into(),
            "battery voltage    12345 mV".into(),
            std::format!("scans           {told}"),
            "lidar lost             5 packets".into(),
            "base retries           6".into(),
            "map rows to PC         7".into(),
            "waypoints done         0".into(),
        ];
        for (y, line) in (36..).step_by(16).zip(&lines) {
            let line: &std::string::String = line;
            assert!(picture.says((218, y), line, &FONT_6X10, BLACK), "{line}");
        }
    }
}

/// The status bar opens into the list of messages, the newest first, and closes again.
#[test]
fn the_status_bar_opens_into_the_messages() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let view = view(&map, &waypoints);
    let mut screen = Screen::new();
    screen
        .notices
        .push(Instant::from_secs(12), Notice::BaseSilent);
    assert_eq!(tap(&mut screen, 12_500, 100, 10), None);
    let now = Instant::from_millis(12_600);
    let picture = shown(&mut screen, now, &view);
    let red = Rgb565::CSS_ORANGE_RED.into_storage();
    assert!(picture.says((218, 30), "   12 s  base and lidar work", &FONT_6X10, BLACK));
    assert!(picture.says((218, 43), "   12 s  base does not answer", &FONT_6X10, red));
    assert!(picture.says((218, 56), "    0 s  started", &FONT_6X10, BLACK));
    // There are no buttons under it.
    assert_eq!(tap(&mut screen, 13_000, 281, 49), None);
    assert_eq!(tap(&mut screen, 14_000, 100, 10), None);
    let hit = tap(&mut screen, 15_000, 281, 49);
    assert_eq!(hit, Some(Hit::Button(Action::Order(Mode::Stop))));
}

/// A tap on pixel 20 of row 50 from below means 20.5 and 50.5 times 1.5 cells. Two taps within 0.6
/// s and 12 pixels are a double tap, a third tap is a first one again. Reset needs a double tap,
/// other buttons one tap.
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

/// For base and lidar no message comes in the first 3 s, then one for each change; one comes for
/// each new waypoint. 25 messages are kept.
#[test]
fn messages_tell_what_changed() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let view = view(&map, &waypoints);
    let mut notices = Notices::NONE;
    let mut told = |ms: u64, view: &View<'_>| {
        let before = notices.count();
        notices.observe(Instant::from_millis(ms), view);
        (
            notices.count() - before,
            notices.last().notice,
            notices.last().at_s,
        )
    };
    assert_eq!(told(2_999, &view), (0, Notice::Started, 0));
    assert_eq!(told(3_000, &view), (1, Notice::AllWell, 3));
    assert_eq!(told(4_000, &view), (0, Notice::AllWell, 3));
    let arrived = View {
        figures: Figures {
            arrivals: 1,
            ..Figures::default()
        },
        ..view
    };
    assert_eq!(told(5_999, &arrived), (1, Notice::WaypointReached, 5));
    assert_eq!(told(6_000, &arrived), (0, Notice::WaypointReached, 5));
    for second in 10..40 {
        notices.push(Instant::from_secs(second), Notice::PoseSet);
    }
    assert_eq!((notices.count(), notices.newest().count()), (33, 25));
    let ends = [notices.newest().next(), notices.newest().last()];
    assert_eq!(
        ends.map(|entry| entry.map(|entry| entry.at_s)),
        [Some(39), Some(15)]
    );
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

/// Each time that the robot comes near the edge from the middle of the map counts once; staying
/// near the edge does not count again.
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

/// One message is shown when the search ends and the drive home begins.
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

/// A new waypoint is drawn at once, not with the next sweep over the map.
#[test]
fn a_new_waypoint_is_drawn_at_once() {
    let (map, mut waypoints) = (Grid::new(10.0), Waypoints::new());
    let (mut screen, now) = (Screen::new(), Instant::from_millis(10));
    let before = shown(&mut screen, now, &view(&map, &waypoints));
    waypoints.push([1_000, 2_000], 0).expect("there is room");
    screen.look(now, &view(&map, &waypoints));
    assert!(screen.has_work(now));
    let mut after = Picture(before.0.clone());
    sent(&mut screen, now, &view(&map, &waypoints), &mut after);
    assert!(after.0 != before.0);
    screen.look(now, &view(&map, &waypoints));
    assert!(!screen.has_work(now));
}

/// The whole map is drawn with each check while the moving scan is shown on it.
#[test]
fn a_map_with_the_scan_on_it_is_drawn_with_each_look() {
    let (map, waypoints) = (Grid::new(10.0), Waypoints::new());
    let looks_again = |scan: bool| {
        let (mut screen, now) = (Screen::new(), Instant::from_millis(10));
        let view = View {
            switches: Switches {
                scan,
                ..Switches::AT_START
            },
            ..view(&map, &waypoints)
        };
        shown(&mut screen, now, &view);
        screen.look(now, &view);
        screen.has_work(now)
    };
    assert_eq!([false, true].map(looks_again), [false, true]);
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
