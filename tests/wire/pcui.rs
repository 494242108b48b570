//! Robot to PC link: golden frames of the fielded program in both directions, and frames that its
//! receiver accepted and ours refuses.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::pcui::message::{
    MapProperties, MapRow, Message, Mode, NO_WAYPOINT, Order, State, WAYPOINTS_MAX, Waypoint,
    encode_map_properties, encode_order, encode_row, encode_state, encode_waypoints,
};
use protocols::pcui::{self, FRAME_MAX, Frame, MessageError};
use protocols::{Decode, FrameError, rle};

use crate::hex;
use crate::protocol::{Protocol, Wire};

/// "PCUI_MSG", as every frame begins.
const MAGIC: &str = "50 43 55 49 5F 4D 53 47";

fn golden(rest: &str) -> Vec<u8> {
    hex(&format!("{MAGIC} {rest}"))
}

fn decoded(bytes: &[u8]) -> Frame {
    let mut decoder = pcui::Decoder::default();
    let frames: Vec<_> = decoder.push(bytes).collect();
    let [Ok(frame)] = &frames[..] else {
        panic!("{frames:?}")
    };
    frame.clone()
}

/// Output of an encoder; the buffer is prefilled so that an unwritten byte shows.
fn encoded(encode: impl FnOnce(&mut [u8]) -> Option<usize>) -> Vec<u8> {
    let mut buffer = vec![0xA5; FRAME_MAX];
    let len = encode(&mut buffer).expect("fits the longest frame");
    buffer.truncate(len);
    buffer
}

/// Start pose of the field program e94332f: 20 mm cells, 6 m x 6 m, at (1000, 1000), psi 90.
#[test]
fn the_map_properties_are_golden_both_ways() {
    let bytes = golden("0D 00 53 03 00 00 4D 50 44 14 70 17 70 17 01 E8 03 E8 03 00 5A 00");
    let map = MapProperties {
        resolution_mm: 20,
        size_mm: [6000, 6000],
        layers: 1,
        position_mm: [1000, 1000],
        layer: 0,
        psi_deg: 90,
    };
    assert_eq!(decoded(&bytes).message(), Ok(Message::Map(map)));
    assert_eq!(encoded(|frame| encode_map_properties(&map, frame)), bytes);
}

/// Request and reply as exchanged with the field program: exploration, set-points 1 and 2.
#[test]
fn order_and_state_are_golden_both_ways() {
    let bytes = golden("03 00 04 00 00 00 53 54 41 01 01 02");
    let order = Order {
        mode: Mode::Exploration,
        set_point: [1, 2],
    };
    assert_eq!(decoded(&bytes).message(), Ok(Message::Order(order)));
    assert_eq!(encoded(|frame| encode_order(&order, frame)), bytes);

    let bytes = golden("09 00 04 00 00 00 53 54 41 01 00 00 00 00 00 00 01 02");
    let state = State {
        mode: Mode::Exploration,
        set_point: [1, 2],
        ..State::default()
    };
    assert_eq!(decoded(&bytes).message(), Ok(Message::State(state)));
    assert_eq!(encoded(|frame| encode_state(&state, frame)), bytes);
}

/// Each field of the state in its place, negative ones included. By hand: the payload is
/// 03 EC 14 0E FF E2 00 F6 0A, whose sum is 1010, 0x3F2.
#[test]
fn the_fields_of_the_state_do_not_change_places() {
    let bytes = golden("09 00 F2 03 00 00 53 54 41 03 EC 14 0E FF E2 00 F6 0A");
    let state = State {
        mode: Mode::Manual,
        speed: [-20, 20],
        speed_mm_s: [-242, 226],
        set_point: [-10, 10],
    };
    assert_eq!(decoded(&bytes).message(), Ok(Message::State(state)));
    assert_eq!(encoded(|frame| encode_state(&state, frame)), bytes);
}

/// The field program's row of 300 unknown cells, layer 0, y 0: pairs (255, 127) and (44, 127).
#[test]
fn a_coded_row_is_golden_both_ways() {
    let bytes = golden("07 00 29 02 00 00 4D 41 52 00 00 00 FF 7F 2C 7F");
    let row = MapRow {
        layer: 0,
        y: 0,
        data: &hex("FF 7F 2C 7F"),
    };
    assert_eq!(decoded(&bytes).message(), Ok(Message::CodedRow(row)));
    let fielded = rle::Dialect::Fielded;
    assert_eq!(
        encoded(|frame| encode_row(0, 0, &[127; 300], fielded, frame)),
        bytes
    );
}

/// A row that does not compress is sent uncompressed: 303 bytes of payload. By hand: layer 1, y 299
/// (2B 01), then 150 times 00 FF; the sum is 1 + 0x2B + 1 + 150 * 255 = 0x9597.
#[test]
fn a_plain_row_is_golden_both_ways() {
    let pixels = [0x00, 0xFF].repeat(150);
    let mut bytes = golden("2F 01 97 95 00 00 4D 41 50 01 2B 01");
    bytes.extend(&pixels);
    let row = MapRow {
        layer: 1,
        y: 299,
        data: &pixels,
    };
    assert_eq!(decoded(&bytes).message(), Ok(Message::Row(row)));
    for dialect in [rle::Dialect::Lossless, rle::Dialect::Fielded] {
        let sent = encoded(|frame| encode_row(1, 299, &pixels, dialect, frame));
        assert_eq!(sent, bytes, "{dialect:?}");
    }
}

/// The fielded threshold: 149 runs are 301 bytes of payload and go out coded, 150 would be 303 like
/// the plain row and go out plain.
#[test]
fn a_row_is_coded_up_to_149_runs() {
    let row = |runs: usize| -> Vec<u8> {
        let single = (0..runs - 1).map(|run| if run % 2 == 0 { 0xFF } else { 0x00 });
        single.chain([127].repeat(301 - runs)).collect()
    };
    let dialect = rle::Dialect::Lossless;
    let coded = encoded(|frame| encode_row(0, 0, &row(149), dialect, frame));
    assert_eq!((coded.len(), &coded[14..17]), (17 + 301, &b"MAR"[..]));
    let plain = encoded(|frame| encode_row(0, 0, &row(150), dialect, frame));
    assert_eq!((plain.len(), &plain[14..17]), (17 + 303, &b"MAP"[..]));
}

/// By hand: (1500, -2) as id 0, first; (300, 600) as id 7 after it. Sum of 02 00 DC 05 FE FF 00 00
/// 00 FF FF 2C 01 58 02 00 07 00 00 00 is 1388, 0x56C.
#[test]
fn a_list_of_waypoints_is_golden_both_ways() {
    let bytes = golden(
        "14 00 6C 05 00 00 4C 57 50 02 00 \
         DC 05 FE FF 00 00 00 FF FF 2C 01 58 02 00 07 00 00 00",
    );
    let list = [
        Waypoint {
            position_mm: [1500, -2],
            layer: 0,
            id: 0,
            previous: NO_WAYPOINT,
        },
        Waypoint {
            position_mm: [300, 600],
            layer: 0,
            id: 7,
            previous: 0,
        },
    ];
    let frame = decoded(&bytes);
    let Ok(Message::Waypoints(found)) = frame.message() else {
        panic!("{:?}", frame.message())
    };
    assert_eq!(found.iter().collect::<Vec<_>>(), list);
    assert_eq!(
        encoded(|frame| encode_waypoints(list.into_iter(), frame)),
        bytes
    );
}

/// 902 bytes of payload hold the 100 waypoints of the robot's list: one more is refused by the
/// encoder instead of being cut off on the wire.
#[test]
fn a_frame_holds_100_waypoints() {
    let list = |count| vec![Waypoint::default(); count].into_iter();
    let mut frame = [0; 2 * FRAME_MAX];
    let len = encode_waypoints(list(WAYPOINTS_MAX), &mut frame);
    assert_eq!((WAYPOINTS_MAX, len), (100, Some(17 + 2 + 9 * 100)));
    assert_eq!(encode_waypoints(list(101), &mut frame), None);
}

/// The field program shares the line between frames and debug text.
#[test]
fn frames_are_found_between_debug_text() {
    let order = golden("03 00 04 00 00 00 53 54 41 01 01 02");
    let text = b"Watermark slam: 123\r\nPCUI_M";
    let mut decoder = pcui::Decoder::default();
    let line = [&text[..], &order, &text[..], &order].concat();
    assert_eq!(decoder.push(&line).filter(Result::is_ok).count(), 2);
    assert_eq!(decoder.discarded(), 2 * text.len() as u64);
}

/// 902 are a list of 100 waypoints. No checksum protects the length of a frame. So 903 is refused
/// from the header alone, without waiting for a byte of payload.
#[test]
fn a_payload_of_903_bytes_is_refused_from_its_header() {
    let mut decoder = pcui::Decoder::default();
    let header = golden("87 03 00 00 00 00 4D 41 50");
    let error = FrameError::Length {
        max: 902,
        found: 903,
    };
    assert_eq!(decoder.push(&header).collect::<Vec<_>>(), [Err(error)]);

    let mut longest = golden("86 03 00 00 00 00 4D 41 50");
    longest.resize(FRAME_MAX, 0);
    assert_eq!(decoded(&longest).payload().len(), 902);
}

#[test]
fn what_a_frame_cannot_mean_is_refused_with_its_reason() {
    let length = |expected, found| Err(MessageError::Length { expected, found });
    let refused = [
        ("00 00 00 00 00 00 57 41 59", Err(MessageError::Id(*b"WAY"))),
        ("00 00 00 00 00 00 4D 50 44", length(13, 0)),
        ("02 00 00 00 00 00 4D 41 52 00 00", length(3, 2)),
        ("01 00 00 00 00 00 4C 57 50 00", length(2, 1)),
        ("02 00 01 00 00 00 4C 57 50 01 00", length(11, 2)),
        ("01 00 00 00 00 00 53 54 41 00", length(9, 1)),
        (
            "03 00 05 00 00 00 53 54 41 05 00 00",
            Err(MessageError::Mode(5)),
        ),
    ];
    for (bytes, reason) in refused {
        assert_eq!(decoded(&golden(bytes)).message(), reason, "{bytes}");
    }
}

/// The format read by the order of its fields, with sums in whole numbers.
fn slow_frame_at(bytes: &[u8]) -> Option<usize> {
    let rest = bytes.strip_prefix(b"PCUI_MSG")?;
    if rest.len() < 9 {
        return None;
    }
    let length = usize::from(rest[0]) + 256 * usize::from(rest[1]);
    let found: u64 = (0..4).map(|i| u64::from(rest[2 + i]) << (8 * i)).sum();
    if length > 902 {
        return None;
    }
    let payload = rest.get(9..9 + length)?;
    let expected: u64 = payload.iter().map(|&byte| u64::from(byte)).sum();
    (found == expected).then_some(17 + length)
}

/// The PC link, for the laws.
pub(crate) struct Pcui;

impl Wire for Frame {
    fn wire(&self) -> Vec<u8> {
        self.as_bytes().to_vec()
    }
}

impl Protocol for Pcui {
    type Decoder = pcui::Decoder;
    const TELLING: &'static [u8] = b"PCUI_MSG\0";
    const CASES: u32 = 2000;

    fn decoder() -> pcui::Decoder {
        pcui::Decoder::default()
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        slow_frame_at(bytes)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        let byte = prop_oneof![any::<u8>(), proptest::sample::select(Self::TELLING)];
        let payload = prop_oneof![6 => vec(byte.clone(), 0..24), 1 => vec(byte, 0..=902)];
        let ids = [*b"MPD", *b"MAP", *b"MAR", *b"LWP", *b"STA"];
        let id = proptest::sample::select(ids.to_vec());
        (id, payload)
            .prop_map(|(id, payload)| {
                let mut frame = vec![0; 17];
                frame.extend(&payload);
                assert_eq!(pcui::seal(&mut frame, id, payload.len()), Some(frame.len()));
                frame
            })
            .boxed()
    }
}

/// Any message is the same after encoding and decoding.
mod identity {
    use super::*;

    fn pair<T: Arbitrary + Copy>() -> impl Strategy<Value = [T; 2]> {
        (any::<T>(), any::<T>()).prop_map(|(left, right)| [left, right])
    }

    fn mode() -> impl Strategy<Value = Mode> {
        let modes = [Mode::Stop, Mode::Exploration, Mode::Waypoint, Mode::Manual];
        proptest::sample::select(modes.to_vec())
    }

    proptest! {
        #![proptest_config(crate::thorough::cases(4000))]

        #[test]
        fn of_map_properties(
            (resolution_mm, layers, layer) in any::<(u8, u8, i8)>(),
            size_mm in pair(),
            position_mm in pair(),
            psi_deg: i16,
        ) {
            let map = MapProperties {
                resolution_mm, size_mm, layers, position_mm, layer, psi_deg,
            };
            let bytes = encoded(|frame| encode_map_properties(&map, frame));
            let frame = decoded(&bytes);
            prop_assert_eq!(frame.message(), Ok(Message::Map(map)));
        }

        #[test]
        fn of_states(
            mode in mode(),
            speed in pair(),
            speed_mm_s in pair(),
            set_point in pair(),
        ) {
            let state = State { mode, speed, speed_mm_s, set_point };
            let bytes = encoded(|frame| encode_state(&state, frame));
            let frame = decoded(&bytes);
            prop_assert_eq!(frame.message(), Ok(Message::State(state)));
            let order = Order { mode, set_point };
            let bytes = encoded(|frame| encode_order(&order, frame));
            let frame = decoded(&bytes);
            prop_assert_eq!(frame.message(), Ok(Message::Order(order)));
        }

        #[test]
        fn of_waypoints(list in vec((pair::<i16>(), any::<(i8, i16, i16)>()), 0..=WAYPOINTS_MAX)) {
            let list: Vec<_> = list
                .into_iter()
                .map(|(position_mm, (layer, id, previous))| Waypoint {
                    position_mm, layer, id, previous,
                })
                .collect();
            let bytes = encoded(|frame| encode_waypoints(list.iter().copied(), frame));
            let frame = decoded(&bytes);
            let Ok(Message::Waypoints(found)) = frame.message() else {
                return Err(TestCaseError::fail("not a list of waypoints"));
            };
            prop_assert_eq!(found.iter().collect::<Vec<_>>(), list);
        }

        /// In either form a row keeps its pixels, and no form is longer than the plain one.
        #[test]
        fn of_map_rows(layer: u8, y: u16, pixels in super::super::rle::row(1..=300)) {
            let bytes = encoded(|frame| {
                encode_row(layer, y, &pixels, rle::Dialect::Lossless, frame)
            });
            prop_assert!(bytes.len() <= 17 + 3 + pixels.len());
            let frame = decoded(&bytes);
            let mut row = vec![0xA5; pixels.len()];
            let found = match frame.message() {
                Ok(Message::Row(found)) => {
                    row.copy_from_slice(found.data);
                    found
                }
                Ok(Message::CodedRow(found)) => {
                    prop_assert_eq!(rle::decode(found.data, &mut row), Ok(pixels.len()));
                    found
                }
                other => return Err(TestCaseError::fail(format!("{other:?}"))),
            };
            prop_assert_eq!((found.layer, found.y, row), (layer, y, pixels));
        }
    }
}
