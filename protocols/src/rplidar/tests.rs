//! Vectors of LR001 and of a real A1M8 with firmware 1.29, and the laws of the decoder.

extern crate std;

use std::vec::Vec;

use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

use super::*;
use crate::{Decode, FrameError};

/// Serial number and revision as reported by a real sensor.
const INFO: [u8; 27] = [
    0xA5, 0x5A, 0x14, 0x00, 0x00, 0x00, 0x04, 0x18, 0x1D, 0x01, 0x07, 0x92, 0xD8, 0xED, 0x93, 0xC0,
    0xEA, 0x98, 0xC9, 0xA5, 0xE6, 0x98, 0xF2, 0x07, 0x06, 0x46, 0x69,
];
/// The first nodes that a real sensor sent.
const FIRST_NODES: [[u8; 5]; 6] = [
    [0x02, 0x8F, 0x63, 0x00, 0x00],
    [0x02, 0x23, 0x64, 0x00, 0x00],
    [0x3E, 0x9B, 0x64, 0x00, 0x00],
    [0x3E, 0x97, 0x64, 0x00, 0x00],
    [0x3E, 0x5B, 0x68, 0x00, 0x00],
    [0x3E, 0xAD, 0x65, 0x00, 0x00],
];
const SCAN: [u8; 7] = [0xA5, 0x5A, 0x05, 0x00, 0x00, 0x40, 0x81];
const EXPRESS: [u8; 7] = [0xA5, 0x5A, 0x54, 0x00, 0x00, 0x40, 0x82];
const ULTRA: [u8; 7] = [0xA5, 0x5A, 0x84, 0x00, 0x00, 0x40, 0x84];

/// All results from `bytes` with an idle line behind them.
fn decode(mut decoder: Decoder, bytes: &[u8]) -> (Vec<Frame>, u64) {
    let mut frames: Vec<_> = decoder.push(bytes).filter_map(Result::ok).collect();
    decoder.idle();
    frames.extend(decoder.push(&[]).filter_map(Result::ok));
    (frames, decoder.discarded())
}

fn streaming(mode: Mode) -> Decoder {
    let mut decoder = Decoder::default();
    decoder.expect(mode);
    decoder
}

fn wire(frames: &[Frame]) -> Vec<u8> {
    frames.iter().flat_map(|f| f.as_bytes().to_vec()).collect()
}

/// Requests of LR001 and of the vendor's SDK.
#[test]
fn requests_are_those_of_the_document() {
    let bytes = |command: Command| command.request().as_bytes().to_vec();
    assert_eq!(bytes(Command::Scan), [0xA5, 0x20]);
    assert_eq!(bytes(Command::ForceScan), [0xA5, 0x21]);
    assert_eq!(bytes(Command::Stop), [0xA5, 0x25]);
    assert_eq!(bytes(Command::Reset), [0xA5, 0x40]);
    assert_eq!(bytes(Command::Info), [0xA5, 0x50]);
    assert_eq!(bytes(Command::Health), [0xA5, 0x52]);
    assert_eq!(bytes(Command::SampleRate), [0xA5, 0x59]);
    assert_eq!(
        bytes(Command::ExpressScan { mode: 0 }),
        [0xA5, 0x82, 0x05, 0, 0, 0, 0, 0, 0x22]
    );
    assert_eq!(
        bytes(Command::MotorPwm { pwm: 660 }),
        [0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1]
    );
    // The checksum is A5 ^ 84 ^ 04 ^ 70 = 55, and with a mode A5 ^ 84 ^ 06 ^ 71 ^ 01 = 57.
    let (key, mode) = (0x70, None);
    assert_eq!(
        bytes(Command::Conf { key, mode }),
        [0xA5, 0x84, 0x04, 0x70, 0, 0, 0, 0x55]
    );
    let (key, mode) = (0x71, Some(1));
    assert_eq!(
        bytes(Command::Conf { key, mode }),
        [0xA5, 0x84, 0x06, 0x71, 0, 0, 0, 1, 0, 0x57]
    );
}

/// The size is one byte: of 300 bytes 255 are sent; with start, command, size and checksum 259. Of
/// the checksum, 255 times 7 is 7: A5 ^ F0 ^ FF ^ 07 = AD. The same requests are read from their
/// bytes; an unknown code is no command.
#[test]
fn the_document_s_requests_are_read_from_their_bytes() {
    let asked = |code| Request::plain(code).command();
    assert_eq!(asked(0x20), Some(Command::Scan));
    assert_eq!(asked(0x21), Some(Command::ForceScan));
    assert_eq!(asked(0x25), Some(Command::Stop));
    assert_eq!(asked(0x40), Some(Command::Reset));
    assert_eq!(asked(0x50), Some(Command::Info));
    assert_eq!(asked(0x52), Some(Command::Health));
    assert_eq!(asked(0x59), Some(Command::SampleRate));
    assert_eq!(asked(0x31), None);
    let with = |code, payload: &[u8]| Request::with_payload(code, payload).command();
    assert_eq!(
        with(0x82, &[4, 0, 0, 0, 0]),
        Some(Command::ExpressScan { mode: 4 })
    );
    assert_eq!(with(0x82, &[4]), None);
    let key = |mode| Some(Command::Conf { key: 0x71, mode });
    assert_eq!(with(0x84, &[0x71, 0, 0, 0]), key(None));
    assert_eq!(with(0x84, &[0x71, 0, 0, 0, 2, 0]), key(Some(2)));
    assert_eq!(
        with(0xA8, &[0x58, 0x02]),
        Some(Command::MotorSpeed { rpm: 600 })
    );
    assert_eq!(
        with(0xF0, &[0x94, 0x02]),
        Some(Command::MotorPwm { pwm: 660 })
    );
    assert_eq!(with(0xFF, &[0, 0, 0, 0]), Some(Command::AccBoard));
}

/// A log shows a request or an answer as its bytes.
#[test]
fn a_log_shows_bytes() {
    let request = std::format!("{:?}", Command::Stop.request());
    assert_eq!(request, "rplidar::Request([A5, 25])");
    let (frames, _) = decode(Decoder::default(), &INFO);
    assert!(std::format!("{frames:?}").contains("rplidar::Answer([A5, 5A, 14, 00, 00, 00, 04, 18"));
}

#[test]
fn the_longest_request_has_a_payload_of_255_bytes() {
    let request = Request::with_payload(code::MOTOR_PWM, &[7; 300]);
    let bytes = request.as_bytes();
    assert_eq!((bytes.len(), bytes[2], bytes[258]), (259, 0xFF, 0xAD));
    assert_eq!(request.payload(), [7; 255]);
    let mut decoder = RequestDecoder::with_format(Requests);
    assert_eq!(decoder.push(bytes).next(), Some(Ok(request)));
}

#[test]
fn a_request_with_a_bad_checksum_is_rejected() {
    let mut decoder = RequestDecoder::with_format(Requests);
    let outcome: Vec<_> = decoder.push(&[0xA5, 0xF0, 2, 0x94, 2, 0xC0]).collect();
    let (expected, found) = (0xC1, 0xC0);
    assert_eq!(outcome, [Err(FrameError::Checksum { expected, found })]);
}

#[test]
fn the_descriptors_are_those_of_the_document() {
    assert_eq!(Descriptor::nodes().as_bytes(), &SCAN);
    assert_eq!(Descriptor::capsules().as_bytes(), &EXPRESS);
    assert_eq!(Descriptor::ultra().as_bytes(), &ULTRA);
    let (frames, _) = decode(Decoder::default(), &SCAN);
    assert_eq!(frames, [Frame::Stream(Descriptor::nodes())]);
}

/// Model 0x18, firmware 1.29, hardware 7.
#[test]
fn the_info_of_a_real_sensor_is_read_and_written() {
    let (frames, _) = decode(Decoder::default(), &INFO);
    let [Frame::Answer(answer)] = &frames[..] else {
        panic!("{frames:?}");
    };
    let Reply::Info(info) = answer.reply() else {
        panic!("{answer:?}");
    };
    assert_eq!(
        (info.model, info.firmware, info.hardware),
        (0x18, (1, 29), 7)
    );
    assert_eq!((info.serial[0], info.serial[15]), (0x92, 0x69));
    assert_eq!(info.answer().as_bytes(), INFO);
}

#[test]
fn health_rate_and_conf_are_written_as_described() {
    let health = Health {
        status: Status::Error,
        error: 0x8002,
    };
    let bytes = [0xA5, 0x5A, 3, 0, 0, 0, 0x06, 2, 0x02, 0x80];
    assert_eq!(health.answer().as_bytes(), bytes);
    assert_eq!(health.answer().reply(), Reply::Health(health));
    let rate = SampleRate {
        standard_us: 500,
        express_us: 250,
    };
    let bytes = [0xA5, 0x5A, 4, 0, 0, 0, 0x15, 0xF4, 0x01, 0xFA, 0x00];
    assert_eq!(rate.answer().as_bytes(), bytes);
    assert_eq!(rate.answer().reply(), Reply::SampleRate(rate));
    let conf = Conf {
        key: 0x70,
        value: &[3, 0],
    };
    let bytes = [0xA5, 0x5A, 6, 0, 0, 0, 0x20, 0x70, 0, 0, 0, 3, 0];
    assert_eq!(conf.answer().as_bytes(), bytes);
    assert_eq!(conf.answer().reply(), Reply::Conf(conf));
}

/// The document's key numbers, and two unknown ones.
#[test]
fn keys_of_the_configuration_are_known_by_their_numbers() {
    let numbers = [0x01, 0x70, 0x71, 0x74, 0x75, 0x7C, 0x7F];
    assert_eq!(numbers.map(ConfKey::from_number), ConfKey::ALL.map(Some));
    assert_eq!([0x00, 0x72].map(ConfKey::from_number), [None; 2]);
}

/// The first node's angle is 0x63 * 128 + 0x8F / 2 = 12743 64ths = 199.1 degrees; the fifth is at
/// 208.7, the sixth at 203.3 again.
#[test]
fn the_first_nodes_of_a_real_sensor_are_read_as_sent() {
    let bytes = [&SCAN[..], FIRST_NODES.as_flattened()].concat();
    let (frames, discarded) = decode(Decoder::default(), &bytes);
    assert_eq!((wire(&frames), discarded), (bytes, 0));
    let node = |frame: &Frame| match frame {
        Frame::Node(node) => Some((node.angle_q6(), node.quality(), node.distance_mm())),
        _ => None,
    };
    let nodes: Vec<_> = frames.iter().filter_map(node).collect();
    let expected = [
        (12_743, 0),
        (12_817, 0),
        (12_877, 15),
        (12_875, 15),
        (13_357, 15),
        (13_014, 15),
    ];
    assert_eq!(
        nodes,
        expected.map(|(angle, quality)| (angle, quality, None))
    );
}

/// The next node should begin with a check bit (!S S C is 100, not 101), and no answer begins
/// there. So a byte was lost, and the node in front may have lost it.
#[test]
fn a_node_is_refused_where_none_follows() {
    let no_check_bit = [0x02, 0x00, 0, 0, 0];
    let bytes = [&SCAN[..], &FIRST_NODES[2], &no_check_bit].concat();
    let outcomes: Vec<_> = Decoder::default().push(&bytes).take(2).collect();
    let error = FrameError::Checksum {
        expected: 0b101,
        found: 0b100,
    };
    let scan = Frame::Stream(Descriptor::nodes());
    assert_eq!(outcomes, [Ok(scan), Err(error)]);
    let bytes = [&SCAN[..], &FIRST_NODES[2], &INFO].concat();
    let outcome = Decoder::default().push(&bytes).nth(1);
    assert_eq!(outcome, Some(Node::parse(FIRST_NODES[2]).map(Frame::Node)));
}

/// Behind a valid frame equal start bits are reported as damage; without one before they are noise.
/// 02 begins no turn: two nodes in a row that do are damage as well.
#[test]
fn damage_between_nodes_is_told() {
    let first = |bytes: &[u8]| streaming(Mode::Nodes).push(bytes).next();
    assert_eq!(first(&[0x03, 0x03, 0x03]), None);
    let behind = |bytes: &[u8]| {
        let bytes = [&SCAN[..], bytes].concat();
        Decoder::default().push(&bytes).nth(1)
    };
    let equal_start_bits = FrameError::Checksum {
        expected: 0b011,
        found: 0b111,
    };
    assert_eq!(behind(&[0x03]), Some(Err(equal_start_bits)));
    let node = FIRST_NODES[0];
    assert_eq!(
        behind(&[&node[..], &[0x03]].concat()),
        Some(Err(equal_start_bits))
    );
    let begins = [0x01, 0x8F, 0x63, 0x00, 0x00];
    let (expected, found) = (1, 2);
    let twice = FrameError::Checksum { expected, found };
    assert_eq!(behind(&[begins, begins].concat()), Some(Err(twice)));
    let parsed = Node::parse(node).expect("sound");
    assert_eq!(
        behind(&[node, begins].concat()),
        Some(Ok(Frame::Node(parsed)))
    );
    assert!(!parsed.starts_turn());
    assert!(Node::parse(begins).is_ok_and(Node::starts_turn));
}

/// 7, 4 and 73 bytes are 84, as many as a capsule has; of a longer value 124 bytes are reported.
#[test]
fn an_answer_as_long_as_a_capsule_is_none() {
    let answer = |len: usize| {
        let value = &[7; 200][..len];
        Conf { key: 0x7F, value }.answer()
    };
    assert_eq!(answer(73).as_bytes().len(), 84);
    for mode in [Mode::Answers, Mode::Capsules] {
        let outcome = streaming(mode).push(answer(73).as_bytes()).next();
        assert_eq!(outcome, Some(Ok(Frame::Answer(answer(73)))));
    }
    assert_eq!(answer(124).as_bytes().len(), 7 + 128);
    assert_eq!(answer(200), answer(124));
    assert_eq!(answer(123).as_bytes().len(), 7 + 127);
}

/// By hand: quality 47 << 2 | 01 = BD; 90 degrees = 5760 = 45 * 128, so 01 2D; 1000 mm = 0FA0.
#[test]
fn ye3_a_node_is_laid_out_by_hand() {
    let node = Node::new(true, 47, 5_760, 4_000);
    assert_eq!(node.as_bytes(), &[0xBD, 0x01, 0x2D, 0xA0, 0x0F]);
    assert!(node.starts_turn());
    assert_eq!((node.angle_deg(), node.distance_mm()), (90.0, Some(1000.0)));
    assert_eq!(Node::parse([0xBD, 0x01, 0x2D, 0xA0, 0x0F]), Ok(node));
    let equal_start_bits = FrameError::Checksum {
        expected: 0b011,
        found: 0b111,
    };
    assert_eq!(Node::parse([0x03, 0x01, 0, 0, 0]), Err(equal_start_bits));
    let no_check_bit = FrameError::Checksum {
        expected: 0b101,
        found: 0b100,
    };
    assert_eq!(Node::parse([0x02, 0x00, 0, 0, 0]), Err(no_check_bit));
}

/// By hand, one cabin: 1000 mm and offset 0x38 (7 degrees): 0FA0 | 3, then 2000 mm and 0x01:
/// 1F40 | 0; low nibbles 8 and 1. Angle 10 degrees = 0280, first capsule: 80 02 -> 80 82.
/// A3 ^ 0F ^ 40 ^ 1F ^ 18 = EB; EB ^ 80 ^ 82 = E9.
#[test]
fn a_capsule_is_laid_out_by_hand() {
    let mut samples = [CapsuleSample::default(); CAPSULE_SAMPLES];
    samples[0] = CapsuleSample {
        distance_mm: 1000,
        dtheta_q3: 0x38,
    };
    samples[1] = CapsuleSample {
        distance_mm: 2000,
        dtheta_q3: 0x01,
    };
    let capsule = Capsule::new(true, 640, &samples);
    let bytes = capsule.as_bytes();
    assert_eq!(
        bytes[..9],
        [0xA9, 0x5E, 0x80, 0x82, 0xA3, 0x0F, 0x40, 0x1F, 0x18]
    );
    assert!(bytes[9..].iter().all(|&byte| byte == 0));
    assert!(capsule.is_first());
    assert_eq!(capsule.raw_samples(), samples);
    let shown = std::format!("{capsule:?}");
    assert!(shown.starts_with("rplidar::Capsule([A9, 5E, 80, 82, A3"));
}

/// The bit of the first capsule is the highest of the angle's word and does not change the angle.
#[test]
fn the_first_capsule_is_told_at_any_angle() {
    let samples = [CapsuleSample::default(); CAPSULE_SAMPLES];
    for (first, angle_q6) in [(true, 0), (true, 640), (false, 0), (false, 640)] {
        let capsule = Capsule::new(first, angle_q6, &samples);
        assert_eq!(
            (capsule.is_first(), capsule.start_angle_q6()),
            (first, angle_q6)
        );
    }
}

/// From 350 degrees to 14 degrees are 24 degrees: 0.75 per sample. Sample 16 is at 362 - 7 = 355
/// degrees. An offset of 0x38 is 7 degrees; with a sign it would be -1, 8 degrees off.
#[test]
fn offsets_are_taken_off_without_sign_across_zero() {
    let mut samples = [CapsuleSample::default(); CAPSULE_SAMPLES];
    samples[16] = CapsuleSample {
        distance_mm: 500,
        dtheta_q3: 0x38,
    };
    let capsule = Capsule::new(false, 350 * 64, &samples);
    let next = Capsule::new(false, 14 * 64, &samples);
    let angles = capsule.samples(&next).map(Sample::angle_deg);
    assert_eq!((angles[0], angles[1]), (350.0, 350.75));
    assert_eq!((angles[15], angles[16], angles[17]), (1.25, 355.0, 2.75));
}

/// Field bug 3 (RPLIDAR clients #18, #31): a length that does not belong to the kind.
#[test]
fn a_descriptor_with_the_wrong_length_is_reported() {
    let mut decoder = Decoder::default();
    let outcome: Vec<_> = decoder.push(&[0xA5, 0x5A, 4, 0, 0, 0x40, 0x81]).collect();
    assert_eq!(outcome, [Err(FrameError::Length { max: 5, found: 4 })]);
    assert_eq!(decoder.discarded(), 7);
}

/// For each kind the decoder waits for the right length, and refuses one byte less. A repeating
/// answer of a single one's kind, and the modes 2 and 3, are unknown; only the format bounds them.
#[test]
fn each_kind_of_answer_has_its_length() {
    let judged = |length: u8, mode: u8, kind: u8| {
        let bytes = [0xA5, 0x5A, length, 0, 0, mode, kind];
        let mut decoder = Decoder::default();
        decoder.push(&bytes).next()
    };
    let single = [
        (kind::INFO, 20),
        (kind::HEALTH, 3),
        (kind::SAMPLE_RATE, 4),
        (kind::ACC_BOARD, 4),
    ];
    for (kind, length) in single {
        assert_eq!(judged(length, 0, kind), None, "{kind:02X}");
        for found in [length - 1, length + 1] {
            let (max, found) = (u32::from(length), u32::from(found));
            let wrong = Some(Err(FrameError::Length { max, found }));
            let length = u8::try_from(found).unwrap();
            assert_eq!(judged(length, 0, kind), wrong, "{kind:02X}");
        }
    }
    let wrong = |max, found| Some(Err(FrameError::Length { max, found }));
    assert_eq!(judged(3, 0, kind::CONF), wrong(128, 3));
    assert_eq!(judged(129, 0, kind::CONF), wrong(128, 129));
    assert_eq!(judged(4, 0, kind::CONF), None);
    assert_eq!(judged(128, 0, kind::CONF), None);
    assert_eq!(judged(83, 0x40, kind::CAPSULES), wrong(84, 83));
    assert_eq!(judged(84, 0x40, kind::ULTRA), wrong(132, 84));
    assert_eq!(judged(129, 0, 0x33), wrong(128, 129));
    assert_eq!(judged(5, 0x80, kind::NODES), wrong(128, 0x8000_0005));
}

/// Flags of the accessory board, the lowest byte first; an unknown kind.
#[test]
fn replies_without_a_type_of_their_own_are_read() {
    let flags = Answer::new(kind::ACC_BOARD, &[1, 2, 3, 4]);
    assert_eq!(flags.reply(), Reply::AccBoard(0x0403_0201));
    assert_eq!(Answer::new(0x33, &[1, 2, 3, 4]).reply(), Reply::Unknown);
}

/// No valid frame lies before it and kind 33 is unknown, so the decoder judges the descriptor as a
/// node. The start bits of A5 are 1 and 0, as in a node; the check bit of 5A is 0.
#[test]
fn an_unknown_descriptor_behind_damage_is_no_node() {
    let mut decoder = streaming(Mode::Nodes);
    let bytes = [0xA5, 0x5A, 0x80, 0, 0, 0, 0x33];
    let (expected, found) = (0b011, 0b010);
    let rejected = Err(FrameError::Checksum { expected, found });
    assert_eq!(decoder.push(&bytes).next(), Some(rejected));
}

/// A listener on both lines: a question, its answer, a request with a payload, a scan.
#[test]
fn a_listener_finds_requests_and_answers() {
    let (info, motor, scan) = ([0xA5, 0x50], [0xA5, 0xF0, 2, 0x94, 2, 0xC1], [0xA5, 0x20]);
    let nodes = nodes(8).concat();
    let bytes = [&info, &INFO[..], &motor, &scan, &SCAN, &nodes].concat();
    let (frames, discarded) = decode(Decoder::of_both_ways(), &bytes);
    assert_eq!((wire(&frames), discarded), (bytes, 0));
    let (asked, pwm) = (Command::Info.request(), Command::MotorPwm { pwm: 660 });
    assert_eq!(frames[0], Frame::Request(asked));
    assert!(matches!(frames[1], Frame::Answer(_)), "{:?}", frames[1]);
    assert_eq!(frames[2], Frame::Request(pwm.request()));
    assert_eq!(frames[3], Frame::Request(Command::Scan.request()));
    assert_eq!(frames[4], Frame::Stream(Descriptor::nodes()));
    assert!(frames[5..].iter().all(|f| matches!(f, Frame::Node(_))));
    assert_eq!(frames.len(), 5 + 8);
}

/// Two bytes are a request only if the command is known, whatever the third is. A payload has 128
/// bytes at most, like the longest answer.
#[test]
fn a_listener_takes_no_unknown_request_and_no_longer_one_than_an_answer() {
    let (frames, discarded) = decode(Decoder::of_both_ways(), &[0xA5, 0x33, 0xA5, 0x50, 0xFF]);
    assert_eq!((wire(&frames), discarded), ([0xA5, 0x50].to_vec(), 3));
    let first = |bytes: &[u8]| Decoder::of_both_ways().push(bytes).next();
    let (max, found) = (128, 129);
    let too_long = Err(FrameError::Length { max, found });
    assert_eq!(first(&[0xA5, 0x84, 129]), Some(too_long));
    assert_eq!(first(&[0xA5, 0x84, 128]), None);
    // A decoder that expects answers takes no request.
    let (frames, discarded) = decode(Decoder::new(), &[0xA5, 0x50]);
    assert_eq!((frames.len(), discarded), (0, 2));
}

/// Field bug 5: a foreign sensor begins its descriptors with the bytes swapped.
#[test]
fn a_foreign_descriptor_is_noise() {
    let (frames, discarded) = decode(Decoder::default(), &[0xAA, 0x55, 5, 0, 0, 0x40, 0x81]);
    assert_eq!((frames.len(), discarded), (0, 7));
}

/// The text that follows a reset, and an answer behind it.
#[test]
fn the_start_text_is_noise() {
    let bytes = [b"RP LIDAR System.\r\nFirmware Ver 1.29\r\n", &INFO[..]].concat();
    let (frames, discarded) = decode(Decoder::default(), &bytes);
    assert_eq!((wire(&frames), discarded), (INFO.to_vec(), 37));
}

/// A request during a scan ends it: its answer follows the last node.
#[test]
fn an_answer_ends_a_stream_of_either_kind() {
    let nodes = [&SCAN[..], &nodes(20).concat(), &INFO].concat();
    let (frames, discarded) = decode(Decoder::default(), &nodes);
    assert_eq!((wire(&frames), discarded), (nodes, 0));
    let capsule = Capsule::new(false, 0, &[CapsuleSample::default(); 32]);
    let capsules = [&EXPRESS[..], capsule.as_bytes(), &INFO, &SCAN].concat();
    let mut decoder = Decoder::default();
    assert_eq!(decoder.push(&capsules).filter(Result::is_ok).count(), 4);
    assert_eq!(decoder.mode(), Mode::Nodes);
}

/// A descriptor of an unknown kind that announces 128 bytes, in damaged nodes: it must not swallow
/// them. Behind sound nodes it is an answer like any other.
#[test]
fn damage_that_looks_like_a_descriptor_swallows_no_nodes() {
    let fake = [0xA5, 0x5A, 0x80, 0, 0, 0, 0x33];
    let damaged = [
        &SCAN[..],
        &[0x02, 0x01, 0, 0, 0, 0xFF],
        &fake,
        &nodes(20).concat(),
    ]
    .concat();
    let (frames, _) = decode(Decoder::default(), &damaged);
    assert!(wire(&frames).ends_with(&nodes(20).concat()));
    let sound = [&SCAN[..], &nodes(20).concat(), &fake, &[0; 128]].concat();
    let (frames, discarded) = decode(Decoder::default(), &sound);
    assert_eq!((wire(&frames), discarded), (sound, 0));
}

/// YE3: after a lost byte the decoder returns frames again after at most ten bytes.
#[test]
fn ye3_a_lost_byte_costs_at_most_ten() {
    let nodes = nodes(40);
    for lost in 0..200 {
        let mut bytes = [&SCAN[..], &nodes.concat()].concat();
        bytes.remove(7 + lost);
        let (mut frames, discarded) = decode(Decoder::default(), &bytes);
        frames.remove(0);
        assert!(discarded <= 10, "{discarded} without byte {lost}");
        let (node, tail) = (
            lost / 5,
            nodes.concat().split_off((lost / 5 * 5 + 10).min(200)),
        );
        assert!(wire(&frames).starts_with(&nodes.concat()[..node.saturating_sub(1) * 5]));
        assert!(wire(&frames).ends_with(&tail), "byte {lost}");
    }
}

/// A damaged check bit costs its node and the one before it, which looks like a torn one. Any other
/// damaged bit changes only its own value. Bytes ahead of the first node are noise; between nodes
/// they are reported as damage.
#[test]
fn bytes_that_begin_no_node_are_noise_only_before_the_first() {
    let failures = |bytes: &[u8]| {
        let mut decoder = streaming(Mode::Nodes);
        decoder.push(bytes).filter(Result::is_err).count()
    };
    let sound = nodes(12).concat();
    // In the byte 00, both start bits are 0.
    assert_eq!(failures(&[&[0x00][..], &sound].concat()), 0);
    assert!(failures(&[&sound[..], &[0x00], &sound].concat()) > 0);
}

#[test]
fn a_damaged_bit_costs_at_most_two_nodes() {
    let nodes = nodes(20);
    // Behind the last nodes there are too few others to find where a node begins.
    for bit in 0..15 * 40 {
        let mut bytes = [&SCAN[..], &nodes.concat()].concat();
        bytes[7 + bit / 8] ^= 1 << (bit % 8);
        let (frames, _) = decode(Decoder::default(), &bytes);
        let is_sent = |frame: &&Frame| nodes.iter().any(|node| node[..] == *frame.as_bytes());
        let kept = frames.iter().skip(1).filter(is_sent).count();
        assert!(kept >= 18, "{kept} nodes with bit {bit} damaged");
    }
}

/// A wall at 1 m, 1.35 degrees from node to node.
fn nodes(count: u16) -> Vec<[u8; 5]> {
    let node = |index: u16| {
        let angle = index * 86 % TURN_Q6;
        *Node::new(index == 0, 47, angle, 4_000 + 3 * index).as_bytes()
    };
    (0..count).map(node).collect()
}

/// Anything that a sensor may send.
fn frame() -> impl Strategy<Value = Vec<u8>> {
    let rate = any::<(u16, u16)>().prop_map(|(standard_us, express_us)| {
        let rate = SampleRate {
            standard_us,
            express_us,
        };
        rate.answer().as_bytes().to_vec()
    });
    let conf = (any::<u32>(), vec(any::<u8>(), 0..60)).prop_map(|(key, value)| {
        let value = &value;
        Conf { key, value }.answer().as_bytes().to_vec()
    });
    let scan = vec((any::<u8>(), any::<u16>(), any::<u16>()), 0..30).prop_map(|nodes| {
        let node = |(index, (quality, angle, distance))| {
            Node::new(index % 10 == 3, quality, angle, distance)
                .as_bytes()
                .to_vec()
        };
        let nodes = (0..).zip(nodes).map(node).collect::<Vec<_>>().concat();
        [&SCAN[..], &nodes].concat()
    });
    let express = vec(capsule(), 0..3).prop_map(|capsules| {
        let capsules = capsules.iter().map(|capsule| *capsule.as_bytes());
        [&EXPRESS[..], capsules.collect::<Vec<_>>().as_flattened()].concat()
    });
    let ultra = vec(ultra(), 0..3).prop_map(|capsules| {
        let capsules = capsules.iter().map(|capsule| *capsule.as_bytes());
        [&ULTRA[..], capsules.collect::<Vec<_>>().as_flattened()].concat()
    });
    prop_oneof![rate, conf, scan, express, ultra, Just(INFO.to_vec())]
}

fn capsule() -> impl Strategy<Value = Capsule> {
    let sample = (0..1_u16 << 14, 0..64_u8).prop_map(|(distance_mm, dtheta_q3)| CapsuleSample {
        distance_mm,
        dtheta_q3,
    });
    let samples = proptest::array::uniform32(sample);
    (any::<bool>(), 0..1_u16 << 15, samples).prop_map(|(first, q6, s)| Capsule::new(first, q6, &s))
}

fn ultra() -> impl Strategy<Value = UltraCapsule> {
    let samples = vec(0..1_u16 << 15, ULTRA_SAMPLES);
    (any::<bool>(), 0..1_u16 << 15, samples, 0..1_u16 << 15).prop_map(|(first, q6, s, next)| {
        let samples = s.try_into().expect("96 samples");
        UltraCapsule::new(first, q6, &samples, next)
    })
}

/// Frames and errors of `bytes`, pushed in pieces, with a pause in the end.
fn outcome(bytes: &[u8], mut cuts: Vec<usize>) -> (Vec<Result<Frame, FrameError>>, u64) {
    cuts.push(bytes.len());
    cuts.sort_unstable();
    let mut decoder = Decoder::default();
    let (mut all, mut from) = (Vec::new(), 0);
    for cut in cuts {
        all.extend(decoder.push(&bytes[from..cut]));
        from = cut;
        let framed: usize = all
            .iter()
            .flatten()
            .map(|frame| frame.as_bytes().len())
            .sum();
        let discarded = usize::try_from(decoder.discarded()).expect("short");
        assert_eq!(
            framed + discarded + decoder.pending(),
            cut,
            "bytes are lost"
        );
    }
    decoder.idle();
    all.extend(decoder.push(&[]));
    assert_eq!(decoder.pending(), 0);
    (all, decoder.discarded())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4 * ProptestConfig::default().cases))]

    /// Sound frames, damage and noise in any order: the same in any pieces, every byte accounted.
    #[test]
    fn any_cut_gives_the_same_frames(
        parts in vec(prop_oneof![frame(), vec(any::<u8>(), 0..40)], 1..6),
        flips in vec((any::<Index>(), any::<u8>()), 0..4),
        cuts in vec(any::<Index>(), 0..12),
    ) {
        let mut bytes = parts.concat();
        for (at, flip) in flips {
            if !bytes.is_empty() {
                let at = at.index(bytes.len());
                bytes[at] ^= flip;
            }
        }
        let cuts = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
        prop_assert_eq!(outcome(&bytes, cuts), outcome(&bytes, Vec::new()));
    }

    #[test]
    fn sound_frames_arrive_as_sent(parts in vec(frame(), 1..6)) {
        let (frames, discarded) = decode(Decoder::default(), &parts.concat());
        prop_assert_eq!((wire(&frames), discarded), (parts.concat(), 0));
    }

    /// Noise without a start byte, so that it cannot be half of a frame, then an answer.
    #[test]
    fn the_next_sound_answer_is_found_behind_noise(noise in vec(0_u8..0xA5, 0..300)) {
        let (frames, discarded) = decode(Decoder::default(), &[&noise, &INFO[..]].concat());
        prop_assert_eq!((wire(&frames), discarded), (INFO.to_vec(), noise.len() as u64));
    }

    /// After any noise, the last 20 of 40 nodes are found, byte for byte.
    #[test]
    fn nodes_are_found_behind_noise(noise in vec(any::<u8>(), 0..60)) {
        prop_assume!(!noise.windows(2).any(|pair| pair == [0xA5, 0x5A]));
        prop_assume!(noise.last() != Some(&0xA5));
        let nodes = nodes(40).concat();
        let (frames, _) = decode(streaming(Mode::Nodes), &[&noise, &nodes[..]].concat());
        prop_assert!(wire(&frames).ends_with(&nodes[100..]));
    }

    #[test]
    fn a_capsule_is_found_behind_noise(noise in vec(any::<u8>(), 0..200), capsule in capsule()) {
        // A false capsule or descriptor in the noise may hide the first, never all of them.
        let bytes = [&noise, capsule.as_bytes().repeat(3).as_slice()].concat();
        let (frames, _) = decode(streaming(Mode::Capsules), &bytes);
        prop_assert_eq!(frames.last(), Some(&Frame::Capsule(capsule)));
    }

    #[test]
    fn requests_arrive_in_any_pieces(
        noise in vec(0_u8..0xA5, 0..20),
        sent in vec((any::<u8>(), vec(any::<u8>(), 0..20)), 1..5),
        cut in any::<Index>(),
    ) {
        let request = |(code, payload): &(u8, Vec<u8>)| match code {
            0..0x80 => Request::plain(*code),
            _ => Request::with_payload(*code, payload),
        };
        let sent: Vec<_> = sent.iter().map(request).collect();
        let wire = sent.iter().flat_map(|request| request.as_bytes().to_vec());
        let bytes: Vec<u8> = noise.iter().copied().chain(wire).collect();
        let (front, back) = bytes.split_at(cut.index(bytes.len() + 1));
        let mut decoder = RequestDecoder::with_format(Requests);
        let mut got: Vec<_> = decoder.push(front).flatten().collect();
        got.extend(decoder.push(back).flatten());
        prop_assert_eq!((got, decoder.discarded()), (sent, noise.len() as u64));
    }

    #[test]
    fn any_bytes_are_survived(bytes in vec(any::<u8>(), 0..600), mode in 0..4) {
        let modes = [Mode::Answers, Mode::Nodes, Mode::Capsules, Mode::Ultra];
        let mode = modes[usize::try_from(mode).unwrap()];
        let mut decoder = streaming(mode);
        for frame in decoder.push(&bytes).flatten() {
            if let Frame::Answer(answer) = frame {
                let _ = answer.reply();
            }
        }
        let mut requests = RequestDecoder::with_format(Requests);
        for request in requests.push(&bytes).flatten() {
            let _ = request.command();
        }
    }
}
