//! The robot's end of the PC link, and its navigation.

use core::time::Duration;

use firmware_core::Master;
use firmware_core::robots::rescue::Rescue;
use firmware_core::waypoints::Waypoints;
use protocols::pcui::message::{self, NO_WAYPOINT, Order, Waypoint};
use protocols::pcui::{self, FRAME_MAX, HEADER_LEN};
use protocols::{Decode, Instant};

use super::robot::{MS, Robot, config, range};
use super::{Bug, Live, Observation, Variant};
use crate::decode::Protocol;

const PC_LINK: &str = "robot's program, PC link";

pub(super) const ROWS: [Bug; 20] = [
    Bug::mutant(
        "PU-01",
        PC_LINK,
        "a stray P before a frame costs the frame",
        pu_01,
    ),
    Bug::mutant(
        "PU-02",
        PC_LINK,
        "a checksum whose second byte is 80 or more is refused",
        pu_02,
    ),
    Bug::mutant(
        "PU-03",
        PC_LINK,
        "one header with a length of 8000: the receiver is deaf until the robot is restarted",
        pu_03,
    ),
    Bug::mutant(
        "PU-04",
        PC_LINK,
        "a frame without payload takes a byte of the next one, which is lost",
        pu_04,
    ),
    Bug::mutant(
        "PU-05",
        PC_LINK,
        "a list that says 50 and holds one waypoint yields 49 phantoms",
        pu_05,
    ),
    Bug::mutant(
        "PU-06",
        PC_LINK,
        "poses are written into map rows: both are lost",
        pu_06,
    ),
    Bug::mutant(
        "PU-07",
        PC_LINK,
        "a link to an unknown waypoint is a null pointer: the program ends",
        pu_07,
    ),
    Bug::mutant(
        "PU-09",
        PC_LINK,
        "two waypoints behind the same one: a link to an object that is gone",
        pu_09,
    ),
    Bug::mutant(
        "PU-10",
        PC_LINK,
        "a shorter list while heading for the third waypoint: the robot drives to (-1, -1)",
        pu_10,
    ),
    Bug::mutant(
        "PU-11",
        PC_LINK,
        "an empty list begins an exploration",
        pu_11,
    ),
    Bug::mutant(
        "PU-12",
        PC_LINK,
        "a list of 21 waypoints overruns the receive queue of 200 bytes",
        pu_12,
    ),
    Bug {
        id: "PU-15",
        place: PC_LINK,
        sees: "bytes received while the link was switched off are parsed later as a torn frame",
        live: Live::Not("the program here has no switch that turns its PC link off"),
    },
    Bug::mutant(
        "PU-14",
        PC_LINK,
        "one received byte is looked at per row sent: a list takes as many rows as it has bytes",
        pu_14,
    ),
    Bug::mutant(
        "PU-16",
        PC_LINK,
        "a byte in the first millisecond after a restart ends the program",
        pu_16,
    ),
    Bug::mutant(
        "PU-17",
        PC_LINK,
        "once the send queue was full, every byte is sent twice for ever",
        pu_17,
    ),
    Bug::mutant(
        "PU-18",
        PC_LINK,
        "debug text stands inside of frames",
        pu_18,
    ),
    Bug::mutant(
        "PU-19",
        PC_LINK,
        "the last pixel of a coded row is lost",
        pu_19,
    ),
    Bug::mutant(
        "PU-20",
        PC_LINK,
        "an order to drive by hand is forgotten at the next scan",
        pu_20,
    ),
    Bug::mutant(
        "PU-21",
        PC_LINK,
        "the orders to drive by hand stop, the robot does not",
        pu_21,
    ),
    Bug {
        id: "PU-22",
        place: PC_LINK,
        sees: "a payload of 512 bytes is refused though the buffer holds it",
        live: Live::Not(
            "a wrong figure in the document: 511 is the limit of the wire, and is kept",
        ),
    },
];

/// A frame of the PC link.
pub(super) fn frame(id: &[u8; 3], payload: &[u8]) -> Vec<u8> {
    let mut bytes = [0; FRAME_MAX];
    bytes[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(payload);
    let len = pcui::seal(&mut bytes, *id, payload.len()).expect("at most 511 bytes");
    bytes[..len].to_vec()
}

/// A list of waypoints with these ids and links, one after the other along x.
fn list(links: &[[i16; 2]]) -> Vec<Waypoint> {
    let waypoints = (1..).zip(links).map(|(x, &[id, previous])| Waypoint {
        position_mm: [x * 5, 5],
        layer: 0,
        id,
        previous,
    });
    waypoints.collect()
}

/// Waypoints as a sound PC links them.
pub(super) fn chain(count: i16) -> Vec<Waypoint> {
    let links: Vec<_> = (0..count).map(|id| [id, id - 1]).collect();
    list(&links)
}

pub(super) fn list_frame(waypoints: &[Waypoint]) -> Vec<u8> {
    let mut bytes = [0; FRAME_MAX];
    let len = message::encode_waypoints(waypoints.iter().copied(), &mut bytes);
    bytes[..len.expect("at most 56")].to_vec()
}

pub(super) fn order(mode: message::Mode, set_point: [i8; 2]) -> Vec<u8> {
    let mut bytes = [0; FRAME_MAX];
    let len = message::encode_order(&Order { mode, set_point }, &mut bytes);
    bytes[..len.expect("twenty bytes")].to_vec()
}

/// The golden request of the fielded PC program: STA, mode 1.
fn request() -> Vec<u8> {
    frame(b"STA", &[1, 1, 2])
}

fn note_received(robot: &mut Robot, name: &'static str) -> u64 {
    let received = robot.counter("radio frames");
    robot.seen.figure(name, received);
    received
}

fn pu_01(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-01");
    robot.tell(&[b"P", &*request()].concat());
    let received = note_received(&mut robot, "frames received");
    robot.judged(received == 0)
}

/// Sum 8080: 129 times FF and 01.
fn pu_02(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-02");
    let payload = [&[1, 0, 0][..], &[0xFF; 129]].concat();
    robot.tell(&frame(b"STA", &payload));
    robot
        .seen
        .figure("sum", format!("{:04X}", pcui::checksum(&payload)));
    let received = note_received(&mut robot, "frames received");
    robot.judged(received == 0)
}

fn pu_03(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-03");
    robot.tell(b"PCUI_MSG\x00\x80\x00\x00\x00\x00STA");
    for _ in 0..200 {
        robot.program.receive(Rescue::RADIO, robot.now, &request());
        robot.run(5 * MS);
    }
    robot.seen.bytes("PC", Protocol::Pcui, &request());
    let received = note_received(&mut robot, "of 200 good frames received");
    robot.judged(received == 0)
}

fn pu_04(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-04");
    robot.tell(&frame(b"STA", &[]));
    robot.tell(&list_frame(&chain(2)));
    let waypoints = robot.program.waypoints().all().len();
    robot
        .seen
        .figure("waypoints of the frame behind", waypoints);
    robot.judged(waypoints == 0)
}

fn pu_05(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-05");
    let mut payload = vec![50, 0];
    payload.extend(&list_frame(&chain(1))[HEADER_LEN + 2..]);
    robot.tell(&frame(b"LWP", &payload));
    let all = robot.program.waypoints().all();
    let phantoms = all
        .iter()
        .filter(|waypoint| waypoint.position_mm == [0, 0])
        .count();
    robot.seen.figure("waypoints at (0, 0)", phantoms);
    robot.judged(phantoms == 49)
}

/// What the PC makes of all that the robot sent: rows, and bytes that are no frame.
fn rows(robot: &mut Robot) -> (usize, u64) {
    let mut decoder = pcui::Decoder::default();
    let frames: Vec<_> = decoder.push(&robot.radio).flatten().collect();
    let rows = frames.iter().filter(|frame| frame.id().starts_with(b"MA"));
    let (rows, strays) = (rows.count(), decoder.discarded());
    robot
        .seen
        .figure("map rows sent", robot.counter("map rows sent"));
    robot.seen.figure("map rows that arrive whole", rows);
    robot.seen.figure("bytes that are no frame", strays);
    (rows, strays)
}

pub(super) fn pu_06(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-06");
    robot.run(Duration::from_secs(5));
    let torn = robot
        .radio
        .windows(14)
        .position(|w| w.starts_with(b"PCUI_MSG") && w[9..].contains(&b'P'));
    if let Some(at) = torn {
        let bytes = robot.radio[at..]
            .iter()
            .take(40)
            .copied()
            .collect::<Vec<_>>();
        robot.seen.bytes("robot", Protocol::Pcui, &bytes);
    }
    let (_, strays) = rows(&mut robot);
    robot.judged(strays > 0)
}

fn note_end(robot: &mut Robot) -> bool {
    use firmware_core::Inspect as _;
    let before = robot.radio.len();
    robot.run(500 * MS);
    let (ended, silent) = (robot.program.is_dead(), robot.radio.len() == before);
    let told = if ended { "has ended" } else { "runs" };
    robot.seen.figure("the program", told);
    robot.seen.figure(
        "bytes to the PC in half a second",
        robot.radio.len() - before,
    );
    ended && silent
}

/// What the PC program sends after the first of two waypoints was removed and one was added.
fn pu_07(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-07");
    let waypoint = |place, id, previous| Waypoint {
        position_mm: [place; 2],
        layer: 0,
        id,
        previous,
    };
    robot.tell(&list_frame(&[
        waypoint(2, 1, NO_WAYPOINT),
        waypoint(5, 0, 1),
    ]));
    let ended = note_end(&mut robot);
    robot.judged(ended)
}

/// A list with some of the fielded program's faults.
pub(super) fn waypoints(variant: Variant, id: &str) -> Waypoints {
    Waypoints::with_defects(config(variant, id).defects.waypoints)
}

fn pu_09(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let sent = list(&[[0, NO_WAYPOINT], [1, 0], [2, 0]]);
    seen.bytes("PC", Protocol::Pcui, &list_frame(&sent));
    let mut list = waypoints(variant, "PU-09");
    list.replace(sent.into_iter());
    seen.figure("waypoints that the list reaches", list.all().len());
    seen.figure("links to what is gone", list.stray_writes().count);
    seen.judged(list.stray_writes().count == 1)
}

fn pu_10(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut list = waypoints(variant, "PU-10");
    list.replace(chain(3).into_iter());
    list.advance();
    list.advance();
    let mut shorter = chain(1);
    shorter[0].position_mm = [500, 0];
    seen.bytes("PC", Protocol::Pcui, &list_frame(&shorter));
    list.replace(shorter.into_iter());
    let target = list.target().map(|target| target.position_mm);
    seen.figure("target, mm", format!("{:?}", target.unwrap_or_default()));
    seen.judged(target == Some([-1, -1]))
}

fn pu_11(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-11");
    robot.tell(&list_frame(&chain(2)));
    robot.run(50 * MS);
    robot.tell(&list_frame(&[]));
    let mode = robot.program.ordered_mode();
    robot
        .seen
        .figure("mode with nowhere to go", format!("{mode:?}"));
    robot.judged(mode == message::Mode::Exploration)
}

/// 19 bytes and 9 a waypoint: 208 in one burst.
fn pu_12(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-12");
    robot.run(100 * MS);
    robot.tell(&list_frame(&chain(21)));
    robot.run(Duration::from_secs(4));
    let waypoints = robot.program.waypoints().all().len();
    robot.seen.figure("of 21 waypoints taken", waypoints);
    robot.judged(waypoints == 0)
}

fn pu_14(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-14");
    robot.run(100 * MS);
    robot.tell(&list_frame(&chain(20)));
    let begun = robot.now;
    while robot.program.waypoints().is_empty() && robot.now - begun < Duration::from_secs(10) {
        robot.run(MS);
    }
    let late = robot.now - begun;
    robot
        .seen
        .figure("199 bytes are taken after, ms", late.as_millis());
    robot.judged(late >= 100 * MS)
}

fn pu_16(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-16");
    robot.seen.bytes("PC", Protocol::Pcui, b"P");
    robot
        .program
        .receive(Rescue::RADIO, Instant::from_micros(500), b"P");
    let ended = note_end(&mut robot);
    robot.judged(ended)
}

/// Nobody takes the bytes until the queue has refused a frame.
fn pu_17(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-17");
    while robot.counter("radio queue overflows") == 0 && robot.now < Instant::from_secs(60) {
        robot.now += MS;
        robot.program.poll(robot.now);
    }
    robot.run(200 * MS);
    let bytes = robot.radio.clone();
    robot.seen.bytes("robot", Protocol::Pcui, &bytes[..40]);
    let frames = pcui::Decoder::default().push(&bytes).flatten().count();
    robot.seen.figure("frames in the next 200 ms", frames);
    robot.judged(frames == 0)
}

fn pu_18(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-18");
    robot.run(Duration::from_secs(2));
    let text = robot
        .radio
        .windows(9)
        .position(|window| window == b"Watermark");
    if let Some(at) = text {
        let bytes = robot.radio[at.saturating_sub(13)..]
            .iter()
            .take(40)
            .copied();
        robot
            .seen
            .bytes("robot", Protocol::Pcui, &bytes.collect::<Vec<_>>());
    }
    let (_, strays) = rows(&mut robot);
    robot.judged(text.is_some() && strays > 0)
}

/// 299 unknown cells and a wall.
fn pu_19(variant: Variant) -> Observation {
    let mut seen = Observation::default();
    let mut pixels = [127; 300];
    pixels[299] = 255;
    let mut bytes = [0; FRAME_MAX];
    let dialect = config(variant, "PU-19").pc_link.dialect;
    let len = message::encode_row(0, 0, &pixels, dialect, &mut bytes).unwrap_or(0);
    seen.bytes("robot", Protocol::Pcui, &bytes[..len]);
    let mut row = [127; 300];
    let decoded = protocols::rle::decode(&bytes[HEADER_LEN + 3..len], &mut row);
    seen.figure("pixels sent of 300", decoded.unwrap_or(0));
    seen.figure("pixel 299, a wall of 255", row[299]);
    seen.judged(row[299] == 127)
}

fn pu_20(variant: Variant) -> Observation {
    let mut robot = Robot::exploring(variant, "PU-20");
    robot.scene = Some(range(2000));
    robot.run(Duration::from_secs(2));
    robot.tell(&order(message::Mode::Manual, [5, -5]));
    robot.run(600 * MS);
    let set_points = robot.note_set_points("set-points 600 ms after the order 5, -5");
    robot.judged(set_points != [5, -5])
}

fn pu_21(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "PU-21");
    robot.run(100 * MS);
    robot.tell(&order(message::Mode::Manual, [5, -5]));
    robot.run(Duration::from_secs(3));
    let set_points = robot.note_set_points("set-points 3 s after the last order 5, -5");
    robot.judged(set_points == [5, -5])
}
