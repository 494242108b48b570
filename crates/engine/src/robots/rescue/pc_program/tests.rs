//! Defects of the fielded PC program, one by one: the rig's PC has none of them. Frames are the
//! golden ones of the fielded robot, or come from the codec, which the golden frames verify.

use proptest::prelude::*;
use protocols::pcui::message::{self, MapProperties, Mode, NO_WAYPOINT, Waypoint};
use protocols::pcui::{FRAME_MAX, HEADER_LEN, seal};
use protocols::{LineEvent, Port};

use emulators::Device;
use emulators::pc::Script;

use super::*;
use protocols::Instant;

use crate::robots::rescue::pc_action;
use crate::scenario::SetPoint;

const AIR: Port = Pc::AIR;

/// A frame made by `encode`.
fn frame(encode: impl FnOnce(&mut [u8]) -> Option<usize>) -> Vec<u8> {
    let mut frame = [0; FRAME_MAX];
    let len = encode(&mut frame).expect("fits");
    frame[..len].to_vec()
}

fn sealed(id: &[u8; 3], payload: &[u8]) -> Vec<u8> {
    frame(|frame| {
        frame[HEADER_LEN..HEADER_LEN + payload.len()].copy_from_slice(payload);
        seal(frame, *id, payload.len())
    })
}

fn properties(size_mm: [u16; 2], position_mm: [i16; 2], psi_deg: i16) -> Vec<u8> {
    let map = MapProperties {
        resolution_mm: 10,
        size_mm,
        layers: 1,
        position_mm,
        layer: 0,
        psi_deg,
    };
    frame(|frame| message::encode_map_properties(&map, frame))
}

fn echo(list: &[(i16, [i16; 2], i16)]) -> Vec<u8> {
    let waypoints = list.iter().map(|&(id, position_mm, previous)| Waypoint {
        position_mm,
        layer: 0,
        id,
        previous,
    });
    frame(|frame| message::encode_waypoints(waypoints, frame))
}

/// A PC with its port open.
struct Operator {
    pc: Pc,
    now: Instant,
}

impl Operator {
    fn connected() -> Self {
        let script = Script::new(Vec::new()).expect("empty");
        let mut desk = Self {
            pc: Pc::new(script),
            now: Instant::ZERO,
        };
        desk.does(Gesture::Connect).expect("always");
        desk.pc.line_event(AIR, desk.now, LineEvent::Opened);
        desk
    }

    fn hears(&mut self, bytes: &[u8]) {
        self.pc.receive(AIR, self.now, bytes);
    }

    fn with_map() -> Self {
        let mut desk = Self::connected();
        desk.hears(&properties([3_000, 3_000], [1_000, 1_000], 90));
        desk
    }

    /// Executes a gesture; returns the written bytes.
    fn does(&mut self, gesture: Gesture) -> Result<Vec<u8>, Refusal> {
        let action = answer(&self.pc, gesture)?;
        let done = self
            .pc
            .perform(self.now, pc_action(&action).expect("known"));
        done.expect("answers are within the limits");
        let mut buf = [0; 2048];
        let len = self.pc.transmit(AIR, &mut buf);
        Ok(buf[..len].to_vec())
    }

    /// Numbers, positions and predecessors of the only list in `bytes`.
    fn sent_list(bytes: &[u8]) -> Vec<(i16, [i16; 2], i16)> {
        let mut decoder = protocols::pcui::Decoder::default();
        let frames: Vec<_> = protocols::Decode::push(&mut decoder, bytes).collect();
        let [Ok(frame)] = &frames[..] else {
            panic!("one frame expected: {frames:?}");
        };
        let Ok(message::Message::Waypoints(list)) = frame.message() else {
            panic!("a list expected: {frame:?}");
        };
        list.iter()
            .map(|w| (w.id, w.position_mm, w.previous))
            .collect()
    }

    fn add(&mut self, x: i32, y: i32) -> Result<Vec<u8>, Refusal> {
        self.does(Gesture::Add { at: [x, y] })
    }
}

/// UI-01: the checksum does not cover the id; 'P' to 'R' turns a plain row into a coded one. The
/// pairs of a plain row do not add up to its width, so the row is rejected; the next transmission
/// repairs it.
#[test]
fn ui_01_a_plain_row_taken_for_a_coded_one_is_not_drawn() {
    let mut desk = Operator::with_map();
    let plain = [&[0, 7, 0][..], &[28; 300]].concat();
    desk.hears(&sealed(b"MAP", &plain));
    let before = desk.pc.map().expect("known").pixels.clone();
    let other = [&[0, 7, 0][..], &[29; 300]].concat();
    desk.hears(&sealed(b"MAR", &other));
    assert_eq!(desk.pc.record().counts.bad_rows, 1);
    assert_eq!(desk.pc.map().expect("known").pixels, before);
}

/// UI-02: frames that stopped the receiver of the fielded program permanently. Each is counted, and
/// the program still receives.
#[test]
fn ui_02_no_frame_makes_the_program_deaf() {
    let mut desk = Operator::with_map();
    desk.hears(&sealed(b"MAR", &[0, 0, 0, 255]));
    desk.hears(&sealed(b"MAP", &[&[0, 0x2C, 1][..], &[0; 300]].concat()));
    desk.hears(&sealed(b"MAP", &[0]));
    desk.hears(&sealed(b"MPD", &[]));
    let no_cells = properties([0, 0], [0, 0], 0);
    desk.hears(&no_cells);
    desk.hears(&sealed(b"LWP", &[5, 0]));
    let counts = desk.pc.record().counts;
    assert_eq!((counts.bad_rows, counts.bad_messages), (2, 4), "{counts:?}");
    desk.hears(&properties([3_000, 3_000], [1_234, 5], 0));
    let (_, heard) = desk.pc.record().map_properties.expect("heard");
    assert_eq!(heard.position_mm, [1_234, 5]);
}

/// UI-03: 65526 and 65446 degrees were displayed for -10 and -90. 0xFFF6 is -10, 0xFFA6 is -90.
#[test]
fn ui_03_a_negative_pose_is_negative() {
    let mut desk = Operator::connected();
    let payload = [
        10, 0xB8, 0x0B, 0xB8, 0x0B, 1, 0xF6, 0xFF, 0, 0, 0, 0xA6, 0xFF,
    ];
    desk.hears(&sealed(b"MPD", &payload));
    let (_, heard) = desk.pc.record().map_properties.expect("heard");
    assert_eq!((heard.position_mm, heard.psi_deg), ([-10, 0], -90));
}

/// UI-04: 65516 was displayed for -20.
#[test]
fn ui_04_a_negative_waypoint_is_negative() {
    let mut desk = Operator::with_map();
    desk.hears(&echo(&[(0, [-20, 5], NO_WAYPOINT)]));
    assert_eq!(waypoints(&desk.pc), [[-20, 5]]);
}

/// UI-05: after the robot's list with the numbers 0 and 1, a click got the number 0 again.
#[test]
fn ui_05_a_waypoint_added_to_the_robots_list_gets_a_number_of_its_own() {
    let mut desk = Operator::with_map();
    desk.hears(&echo(&[(0, [100, 100], NO_WAYPOINT), (1, [200, 200], 0)]));
    let sent = desk.add(300, 300).expect("on the map");
    assert_eq!(
        Operator::sent_list(&sent),
        [
            (0, [100, 100], NO_WAYPOINT),
            (1, [200, 200], 0),
            (2, [300, 300], 1)
        ]
    );
}

/// UI-06: a click outside the map sent the robot there.
#[test]
fn ui_06_a_place_beside_the_map_is_no_waypoint() {
    let mut desk = Operator::with_map();
    let outside = Err(Refusal::Outside {
        size_mm: [3_000, 3_000],
    });
    assert_eq!(desk.add(-1, 500), outside);
    assert_eq!(desk.add(500, 3_000), outside);
    assert_eq!(desk.add(100_000, 0), outside);
    assert!(desk.add(2_999, 0).is_ok());
}

/// UI-07: a click before the first report of the map sent (0, 0).
#[test]
fn ui_07_there_is_no_place_before_there_is_a_map() {
    let mut desk = Operator::connected();
    assert_eq!(desk.add(0, 0), Err(Refusal::NoMap));
    desk.hears(&properties([0, 0], [0, 0], 0));
    assert_eq!(desk.add(0, 0), Err(Refusal::NoMap));
}

/// UI-08 and PU-01: the start of a frame within the start of a frame.
#[test]
fn ui_08_a_stray_byte_before_a_frame_costs_nothing_else() {
    for stray in [&b"P"[..], b"PCUI_", b"PCUI_MS"] {
        let mut desk = Operator::connected();
        let golden = b"PCUI_MSG\x0D\x00\x53\x03\x00\x00MPD\
            \x14\x70\x17\x70\x17\x01\xE8\x03\xE8\x03\x00\x5A\x00";
        desk.hears(&[stray, golden].concat());
        assert_eq!(desk.pc.record().counts.map_properties, 1);
    }
}

/// UI-09: rows of a map that is not square were arranged by its height.
#[test]
fn ui_09_a_map_that_is_not_square_keeps_its_rows() {
    let mut desk = Operator::connected();
    desk.hears(&properties([40, 20], [0, 0], 0));
    desk.hears(&sealed(b"MAP", &[0, 1, 0, 1, 2, 3, 4]));
    let map = desk.pc.map().expect("known");
    assert_eq!((map.width, map.height), (4, 2));
    assert_eq!(map.pixels, [127, 127, 127, 127, 1, 2, 3, 4]);
    assert!(matches!(
        desk.add(30, 30),
        Err(Refusal::Outside { size_mm: [40, 20] })
    ));
}

/// UI-10: the last column of a coded row stayed white, which means free.
#[test]
fn ui_10_a_column_that_was_not_told_is_unknown() {
    let mut desk = Operator::connected();
    desk.hears(&properties([40, 10], [0, 0], 0));
    desk.hears(&sealed(b"MAR", &[0, 0, 0, 3, 0]));
    assert_eq!(desk.pc.map().expect("known").pixels, [0, 0, 0, 127]);
}

/// PU-06: a pose written into the middle of a row. Both are lost, nothing else is, and no wrong
/// cell is drawn.
#[test]
fn pu_06_a_pose_inside_a_row_costs_at_most_the_two() {
    let row = sealed(b"MAP", &[&[0, 0, 0][..], &[9; 300]].concat());
    for at in 0..row.len() {
        let mut desk = Operator::with_map();
        let pose = properties([3_000, 3_000], [5, 5], 90);
        desk.hears(&[&row[..at], &pose, &row[at..]].concat());
        let good = sealed(b"MAP", &[&[0, 1, 0][..], &[0; 300]].concat());
        desk.hears(&[&good[..], &good].concat());
        let map = desk.pc.map().expect("known");
        assert_eq!(map.pixels[300..600], [0; 300], "pose at {at}");
        let first = &map.pixels[..300];
        assert!(first.iter().all(|&pixel| pixel == first[0]), "pose at {at}");
    }
}

/// PU-07: a list whose first waypoint names the second one as predecessor crashed the fielded
/// robot. If the robot reports such a list, its order counts; the list that is sent back has
/// correct links, and each waypoint keeps its number.
#[test]
fn pu_07_predecessors_are_always_those_of_the_list() {
    let mut desk = Operator::with_map();
    desk.hears(&echo(&[(1, [2, 2], NO_WAYPOINT), (0, [5, 5], 1)]));
    let sent = desk.add(9, 9).expect("on the map");
    assert_eq!(
        Operator::sent_list(&sent),
        [(1, [2, 2], NO_WAYPOINT), (0, [5, 5], 1), (2, [9, 9], 0)]
    );
}

/// PU-08: deleting the first of three, or one in the middle, left a gap in the chain.
#[test]
fn pu_08_deleting_leaves_no_gap_in_the_chain() {
    let mut desk = Operator::with_map();
    for x in [100, 200, 300] {
        desk.add(x, x).expect("on the map");
    }
    let first = Gesture::Delete {
        index: 0,
        at: [100, 100],
    };
    let sent = desk.does(first).expect("is there");
    assert_eq!(
        Operator::sent_list(&sent),
        [(0, [200, 200], NO_WAYPOINT), (1, [300, 300], 0)]
    );
}

/// PU-09: two waypoints with the same predecessor.
#[test]
fn pu_09_a_forked_chain_of_the_robot_becomes_a_list() {
    let mut desk = Operator::with_map();
    let forked = [(0, [1, 1], NO_WAYPOINT), (1, [2, 2], 0), (2, [3, 3], 0)];
    desk.hears(&echo(&forked));
    assert_eq!(waypoints(&desk.pc), [[1, 1], [2, 2], [3, 3]]);
    let sent = desk.add(4, 4).expect("on the map");
    let chain: Vec<i16> = Operator::sent_list(&sent).iter().map(|one| one.2).collect();
    assert_eq!(chain, [NO_WAYPOINT, 0, 1, 2]);
}

/// PU-11: an empty list left the target of the old one behind.
#[test]
fn pu_11_an_empty_list_is_sent_and_shown() {
    let mut desk = Operator::with_map();
    desk.hears(&echo(&[(0, [1, 1], NO_WAYPOINT)]));
    let sent = desk.does(Gesture::Clear).expect("always");
    // Count zero, sum zero.
    assert_eq!(sent, b"PCUI_MSG\x02\x00\x00\x00\x00\x00LWP\x00\x00");
    assert_eq!(waypoints(&desk.pc), <[[i16; 2]; 0]>::default());
    desk.hears(&echo(&[]));
    assert_eq!(waypoints(&desk.pc), <[[i16; 2]; 0]>::default());
}

/// PU-12: every gesture sent a list when the button was released anywhere, a right click sent two.
/// Nine waypoints in two lists overflowed the robot's queue.
#[test]
fn pu_12_a_gesture_sends_one_list() {
    let mut desk = Operator::with_map();
    desk.add(100, 100).expect("on the map");
    let moved = Gesture::Move {
        index: 0,
        from: [100, 100],
        to: [150, 100],
    };
    let sent = desk.does(moved).expect("is there");
    assert_eq!(Operator::sent_list(&sent), [(0, [150, 100], NO_WAYPOINT)]);
    let gone = Gesture::Delete {
        index: 0,
        at: [150, 100],
    };
    assert_eq!(Operator::sent_list(&desk.does(gone).expect("is there")), []);
}

/// PU-13: the 57th waypoint made a list that the robot ignored without a message. Our robot accepts
/// 100, as in the report.
#[test]
fn pu_13_a_list_too_long_for_a_message_is_refused_aloud() {
    let mut desk = Operator::with_map();
    for x in 0..100 {
        desk.add(x, 0).expect("100 fit");
    }
    assert_eq!(desk.add(100, 0), Err(Refusal::Full));
    assert!(Refusal::Full.to_string().contains("100"));
    assert_eq!(waypoints(&desk.pc).len(), 100);
}

/// PU-15: bytes that arrived while the program was off were taken as its first frame.
#[test]
fn pu_15_what_came_before_the_port_was_opened_is_not_heard() {
    let mut desk = Operator::connected();
    desk.does(Gesture::Disconnect).expect("always");
    desk.hears(&properties([3_000, 3_000], [1, 1], 0)[..20]);
    desk.does(Gesture::Connect).expect("always");
    desk.pc.line_event(AIR, desk.now, LineEvent::Opened);
    desk.hears(&properties([3_000, 3_000], [7, 7], 0));
    let counts = desk.pc.record().counts;
    assert_eq!((counts.map_properties, counts.bad_frames), (1, 0));
}

/// Two pages, or a robot with a new list: a gesture never affects a waypoint other than the one
/// that the operator saw.
#[test]
fn a_gesture_at_a_waypoint_that_has_changed_is_refused() {
    let mut desk = Operator::with_map();
    desk.hears(&echo(&[(0, [100, 100], NO_WAYPOINT), (1, [200, 200], 0)]));
    let delete = |index, at| Gesture::Delete { index, at };
    assert_eq!(desk.does(delete(1, [100, 100])), Err(Refusal::Changed));
    assert_eq!(desk.does(delete(2, [0, 0])), Err(Refusal::Changed));
    assert!(desk.does(delete(1, [200, 200])).is_ok());
}

#[test]
fn nothing_is_asked_of_a_robot_that_is_not_there() {
    let mut desk = Operator::with_map();
    desk.does(Gesture::Disconnect).expect("always");
    let stop = Gesture::Mode("stop".to_owned());
    assert_eq!(desk.does(stop), Err(Refusal::NotConnected));
    assert_eq!(desk.add(1, 1), Err(Refusal::NotConnected));
}

/// An order by hand is valid for half a second on the wire and is repeated; its source must be
/// active once a second.
#[test]
fn a_hand_that_is_not_felt_any_more_stops_the_robot() {
    let mut hand = Hand::default();
    let at = Instant::from_millis;
    assert_eq!(
        hand.hold(at(0), &SetPoint::list([10, 10])),
        Some(Gesture::Drive(SetPoint::list([10, 10])))
    );
    assert_eq!(hand.hold(at(300), &SetPoint::list([10, 10])), None);
    assert_eq!(hand.tick(at(1_299)), None);
    assert_eq!(
        hand.tick(at(1_300)),
        Some(Gesture::Drive(SetPoint::list([0, 0])))
    );
    assert_eq!(hand.tick(at(9_000)), None);
    assert_eq!(
        hand.hold(at(9_000), &SetPoint::list([0, 0])),
        Some(Gesture::Drive(SetPoint::list([0, 0])))
    );
    assert_eq!(hand.tick(at(19_000)), None);
}

/// The page's list equals a plain list with the same edits.
#[derive(Clone, Debug)]
enum Edit {
    Add(i32, i32),
    Move(usize, i32, i32),
    Delete(usize),
}

fn edit() -> impl Strategy<Value = Edit> {
    let place = || 0..3_000_i32;
    prop_oneof![
        (place(), place()).prop_map(|(x, y)| Edit::Add(x, y)),
        (0..8_usize, place(), place()).prop_map(|(index, x, y)| Edit::Move(index, x, y)),
        (0..8_usize).prop_map(Edit::Delete),
    ]
}

proptest! {
    /// For any sequence of additions, moves and deletions, sent lists are linked 0, 1, 2 and equal
    /// a plain list; metres and millimetres give the same positions.
    #[test]
    fn edits_do_what_a_plain_list_does(edits in prop::collection::vec(edit(), 0..40)) {
        let mut desk = Operator::with_map();
        let mut plain: Vec<[i32; 2]> = Vec::new();
        for edit in edits {
            let gesture = match edit {
                Edit::Add(x, y) => Gesture::Add { at: [x, y] },
                Edit::Move(index, x, y) => {
                    let from = plain.get(index).copied().unwrap_or_default();
                    Gesture::Move { index, from, to: [x, y] }
                }
                Edit::Delete(index) => {
                    let at = plain.get(index).copied().unwrap_or_default();
                    Gesture::Delete { index, at }
                }
            };
            let sent = desk.does(gesture);
            match edit {
                Edit::Add(x, y) => plain.push([x, y]),
                Edit::Move(index, x, y) if index < plain.len() => plain[index] = [x, y],
                Edit::Delete(index) if index < plain.len() => {
                    plain.remove(index);
                }
                _ => {
                    prop_assert_eq!(sent, Err(Refusal::Changed));
                    continue;
                }
            }
            let sent = Operator::sent_list(&sent.expect("a sound gesture"));
            for (place, (index, one)) in plain.iter().zip((0..).zip(&sent)) {
                prop_assert_eq!((one.0, one.1.map(i32::from), one.2), (index, *place, index - 1));
            }
            prop_assert_eq!(sent.len(), plain.len());
        }
    }

    /// No bytes from the robot end the program, and it keeps receiving.
    #[test]
    fn no_bytes_break_the_program(
        pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..40), 0..8),
        id in prop::sample::select(vec![*b"MPD", *b"MAP", *b"MAR", *b"LWP", *b"STA", *b"XYZ"]),
        payload in prop::collection::vec(any::<u8>(), 0..=40),
    ) {
        let mut desk = Operator::with_map();
        for piece in pieces {
            desk.hears(&piece);
            desk.hears(&sealed(&id, &payload));
        }
        desk.now = Instant::from_secs(1);
        desk.pc.tick(desk.now);
        desk.hears(&properties([3_000, 3_000], [321, 123], 0));
        let (_, heard) = desk.pc.record().map_properties.expect("heard");
        prop_assert_eq!(heard.position_mm, [321, 123]);
        let _ = waypoints(&desk.pc);
    }
}

/// Modes have the numbers of the wire: stop 0, exploration 1, waypoint 2, manual 3.
#[test]
fn orders_are_the_golden_ones() {
    let mut desk = Operator::with_map();
    let bytes = desk
        .does(Gesture::Mode("exploration".to_owned()))
        .expect("ok");
    assert_eq!(bytes, b"PCUI_MSG\x03\x00\x01\x00\x00\x00STA\x01\x00\x00");
    let bytes = desk
        .does(Gesture::Drive(SetPoint::list([1, -2])))
        .expect("connected");
    // 3 + 1 + 0xFE = 0x102
    assert_eq!(bytes, b"PCUI_MSG\x03\x00\x02\x01\x00\x00STA\x03\x01\xFE");
    assert_eq!(desk.pc.order().map(|order| order.mode), Some(Mode::Manual));
}
