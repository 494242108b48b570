//! `rplidar`: both directions of an RPLIDAR's serial port.
//!
//! The meaning of bytes depends on the descriptor before them: only answers and requests are
//! recognisable alone. A node has three check bits in five bytes, so any bytes contain some valid
//! nodes.

use protocols::rplidar::{
    Answer, CAPSULE_LEN, CAPSULE_SAMPLES, Capsule, CapsuleSample, Command, Decoder, Descriptor,
    Frame, NODE_LEN, Node, PAYLOAD_MAX, Reply, Request, START, Status, ULTRA_LEN, ULTRA_SAMPLES,
    UltraCapsule, kind,
};

use super::answers::Answers;
use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Broken, Choices, Wire, made_again};
use crate::hex;

/// Requests, answers, nodes and capsules of an RPLIDAR.
pub static RPLIDAR: Codec = Codec::of::<Rplidar>("RPLIDAR lidar, requests, answers and scans")
    .with_answers(Answers {
        // The kind of an answer; the start byte of frames without a descriptor.
        kind: |frame| frame.get(6..7).or(frame.get(..1)).unwrap_or(frame),
        head: HEAD_LEN,
        // Requests: the frames that the sensor answers.
        likely: &[(0, 1)],
        ..Answers::PLAIN
    })
    .with_floor(Floor {
        check_bits: 16,
        share: 30,
        ..Floor::CHECKED
    })
    .with_lua(Lua {
        source: include_str!("lua/rplidar.lua"),
        judge: "judge_rplidar",
        tell: "tell_rplidar",
        fields: &FIELDS,
    });

const FIELDS: [LuaField; 6] = [
    field("rp_command", "uint8", "hilrig.rplidar.command", "Command").shown_as("base.HEX"),
    field("rp_kind", "uint8", "hilrig.rplidar.kind", "Kind of answer").shown_as("base.HEX"),
    field("rp_angle", "float", "hilrig.rplidar.angle", "Angle (deg)"),
    field(
        "rp_distance",
        "float",
        "hilrig.rplidar.distance",
        "Distance (mm)",
    ),
    field("rp_quality", "uint8", "hilrig.rplidar.quality", "Quality"),
    field(
        "rp_start",
        "bool",
        "hilrig.rplidar.start",
        "First of a turn or scan",
    ),
];

/// Bytes of a descriptor, and its first two.
const HEAD_LEN: usize = 7;
const ANSWER: [u8; 2] = [0xA5, 0x5A];

/// An RPLIDAR's serial port.
#[derive(Clone, Copy, Debug)]
pub struct Rplidar;

impl Wire for Rplidar {
    type Decoder = Decoder;
    const NAME: &'static str = "rplidar";

    fn decoder() -> Decoder {
        Decoder::of_both_ways()
    }

    fn bytes(frame: &Frame) -> &[u8] {
        frame.as_bytes()
    }

    fn words(frame: &Frame) -> String {
        words(frame)
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        match choices.byte() % 10 {
            0 => out.extend(request(choices).as_bytes()),
            1 => out.extend(Descriptor::nodes().as_bytes()),
            2 => out.extend(Descriptor::capsules().as_bytes()),
            3 => out.extend(capsule(choices).as_bytes()),
            4 => out.extend(answer(choices).as_bytes()),
            5 => out.extend(Descriptor::ultra().as_bytes()),
            6 => out.extend(ultra(choices).as_bytes()),
            _ => out.extend(node(choices).as_bytes()),
        }
    }

    /// A frame is identified by its start and length.
    fn repair(frame: &mut [u8]) {
        let len = frame.len();
        match *frame {
            [START, command @ 0x80..=0xFF, ..] if len >= 4 => {
                let whole = Request::with_payload(command, &frame[3..len - 1]);
                if whole.as_bytes().len() == len {
                    frame.copy_from_slice(whole.as_bytes());
                }
            }
            [ref mut first, ref mut second, ..] if len == NODE_LEN => {
                *first = *first & !0b11 | if *first & 1 == 0 { 0b10 } else { 0b01 };
                *second |= 1;
            }
            [first, second, ..]
                if matches!(len, CAPSULE_LEN | ULTRA_LEN)
                    && first >> 4 == 0xA
                    && [first, second] != ANSWER =>
            {
                let sum = frame[2..].iter().fold(0, |sum, byte| sum ^ byte);
                frame[0] = 0xA0 | sum & 0x0F;
                frame[1] = 0x50 | sum >> 4;
            }
            [ref mut first, _] => *first = START,
            [_, _, _, _, _, mode, kind, ..] => {
                let payload = u32::try_from(len - HEAD_LEN).unwrap_or(0);
                let [a, b, c, d] = payload.to_le_bytes();
                // A descriptor alone still announces a stream.
                if len > HEAD_LEN || mode & 0x40 == 0 {
                    let head = [ANSWER[0], ANSWER[1], a, b, c, d, kind];
                    frame[..HEAD_LEN].copy_from_slice(&head);
                }
            }
            _ => {}
        }
    }

    /// Nodes and capsules count only if `bytes` contains nothing else.
    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let is_whole = |len: &usize| *len == bytes.len();
        let [answer, request] = [answer_at(bytes), request_at(bytes)];
        let streamed = [capsule_at(bytes), node_at(bytes)];
        let mut whole = streamed.into_iter().chain([answer, request]).flatten();
        whole.find(is_whole).or(answer).or(request)
    }

    /// An answer of a known kind and length; other bytes may be part of such an answer.
    fn unmistakable_at(bytes: &[u8]) -> Option<usize> {
        let len = answer_at(bytes)?;
        is_known(bytes).then_some(len)
    }

    fn is_plausible(frame: &Frame) -> bool {
        match frame {
            Frame::Answer(answer) => answer.reply() != Reply::Unknown,
            Frame::Request(request) => request.command().is_some(),
            _ => true,
        }
    }

    fn kind(frame: &Frame) -> u64 {
        match frame {
            Frame::Stream(descriptor) => u64::from(descriptor.kind()),
            Frame::Answer(answer) => {
                let is_known = u64::from(answer.reply() != Reply::Unknown);
                1 << 16 | is_known << 8 | u64::from(answer.kind())
            }
            Frame::Node(node) => {
                let is_measured = node.distance_mm().is_some();
                2 << 16 | u64::from(node.starts_turn()) << 1 | u64::from(is_measured)
            }
            Frame::Capsule(capsule) => 3 << 16 | u64::from(capsule.is_first()),
            Frame::Ultra(capsule) => 5 << 16 | u64::from(capsule.is_first()),
            Frame::Request(request) => {
                let is_known = u64::from(request.command().is_some());
                4 << 16 | is_known << 8 | u64::from(request.code())
            }
        }
    }

    fn means_itself(frame: &Frame) -> Result<(), Broken> {
        let found = frame.as_bytes();
        match frame {
            Frame::Node(node) => {
                let (angle, distance) = (node.angle_q6(), node.distance_q2());
                let made = Node::new(node.starts_turn(), node.quality(), angle, distance);
                made_again(found, made.as_bytes())
            }
            Frame::Capsule(capsule) => {
                let (first, angle) = (capsule.is_first(), capsule.start_angle_q6());
                let made = Capsule::new(first, angle, &capsule.raw_samples());
                made_again(found, made.as_bytes())
            }
            // The first distances are in the capsule itself; the differences need the next capsule.
            Frame::Ultra(capsule) => {
                let head = (capsule.is_first(), capsule.start_angle_q6());
                let sound = capsule.majors_mm().count() == ULTRA_SAMPLES / 3;
                let flags = u16::from_le_bytes([found[2], found[3]]);
                let read = (flags >> 15 == 1, flags & 0x7FFF);
                let detail = || Broken::new("ultra-means-itself", format!("{read:?} {head:?}"));
                (sound && read == head).then_some(()).ok_or_else(detail)
            }
            Frame::Answer(answer) => {
                let made = match answer.reply() {
                    Reply::Info(info) => info.answer(),
                    Reply::Health(health) => health.answer(),
                    Reply::SampleRate(rate) => rate.answer(),
                    Reply::Conf(conf) => conf.answer(),
                    _ => Answer::new(answer.kind(), answer.payload()),
                };
                made_again(found, made.as_bytes())
            }
            Frame::Stream(descriptor) => {
                let (kind, length) = (descriptor.kind(), descriptor.length());
                let made = Descriptor::new(kind, length, descriptor.transfer());
                made_again(found, made.as_bytes())
            }
            Frame::Request(request) => command_means_itself(*request),
        }
    }
}

/// A command may carry bytes without meaning; these need not be the same after encoding.
fn command_means_itself(request: Request) -> Result<(), Broken> {
    let command = request.command();
    let again = command.and_then(|command| command.request().command());
    if command == again {
        return Ok(());
    }
    let detail = format!("{command:?} written and read is {again:?}");
    Err(Broken::new("command-means-itself", detail))
}

/// A descriptor and, unless it begins a stream, its payload.
fn answer_at(bytes: &[u8]) -> Option<usize> {
    let &[0xA5, 0x5A, a, b, c, d, kind, ..] = bytes else {
        return None;
    };
    let length = usize::from(a) + 256 * usize::from(b) + 65_536 * usize::from(c);
    let is_ultra = (d, kind, length) == (0x40, 0x84, 132);
    if length > 128 && !is_ultra || d & 0xBF != 0 {
        return None;
    }
    let end = if d == 0x40 { 7 } else { 7 + length };
    let fits = is_known(bytes) || !is_of_known_kind(bytes);
    (fits && end <= bytes.len()).then_some(end)
}

/// Kinds of answers and of streams, with the minimum and maximum length that they announce.
const LENGTHS: [(u8, u8, [u8; 2]); 8] = [
    (0x00, 0x04, [20, 20]),
    (0x00, 0x06, [3, 3]),
    (0x00, 0x15, [4, 4]),
    (0x00, 0x20, [4, 128]),
    (0x00, 0xFF, [4, 4]),
    (0x40, 0x81, [5, 5]),
    (0x40, 0x82, [84, 84]),
    (0x40, 0x84, [132, 132]),
];

fn is_of_known_kind(head: &[u8]) -> bool {
    let mut rows = LENGTHS.iter();
    rows.any(|&(mode, kind, _)| (mode, kind) == (head[5], head[6]))
}

fn is_known(head: &[u8]) -> bool {
    let mut rows = LENGTHS.iter();
    rows.any(|&(mode, kind, [least, most])| {
        (mode, kind) == (head[5], head[6])
            && (least..=most).contains(&head[2])
            && head[3..5] == [0; 2]
    })
}

/// A request; one without payload only if its command is known.
fn request_at(bytes: &[u8]) -> Option<usize> {
    match *bytes {
        [0xA5, 0x20 | 0x21 | 0x25 | 0x40 | 0x50 | 0x52 | 0x59, ..] => Some(2),
        [0xA5, 0x80..=0xFF, size @ 0..=128, ..] => {
            let end = 3 + usize::from(size);
            let sum = bytes.get(..end)?.iter().fold(0, |sum, byte| sum ^ byte);
            (*bytes.get(end)? == sum).then_some(end + 1)
        }
        _ => None,
    }
}

fn capsule_at(bytes: &[u8]) -> Option<usize> {
    let len = bytes.len();
    let is_synced = matches!(len, 84 | 132) && bytes[0] >> 4 == 0xA && bytes[1] >> 4 == 0x5;
    let sum = bytes.iter().skip(2).fold(0, |sum, byte| sum ^ byte);
    (is_synced && bytes[0] & 15 == sum & 15 && bytes[1] & 15 == sum >> 4).then_some(len)
}

fn node_at(bytes: &[u8]) -> Option<usize> {
    let &[flags, angle, _, _, _] = bytes else {
        return None;
    };
    (matches!(flags % 4, 1 | 2) && angle % 2 == 1).then_some(5)
}

fn request(choices: &mut Choices<'_>) -> Request {
    let plain = match choices.byte() {
        0..32 => Command::Scan,
        32..64 => Command::Stop,
        64..96 => Command::Info,
        96..112 => Command::Health,
        112..128 => Command::SampleRate,
        128..136 => Command::ForceScan,
        136..144 => Command::Reset,
        144..160 => Command::ExpressScan {
            mode: choices.byte() % 6,
        },
        160..192 => Command::Conf {
            key: choices.byte().into(),
            mode: (choices.byte() % 2 == 1).then(|| choices.word() % 4),
        },
        192..208 => Command::MotorPwm {
            pwm: choices.word(),
        },
        208..216 => Command::MotorSpeed {
            rpm: choices.word(),
        },
        216..224 => Command::AccBoard,
        _ => {
            let (code, len) = (choices.byte(), usize::from(choices.byte()));
            return Request::with_payload(code, choices.take(len));
        }
    };
    plain.request()
}

fn answer(choices: &mut Choices<'_>) -> Answer {
    let (kind, len) = match choices.byte() {
        0..64 => (kind::INFO, 20),
        64..128 => (kind::HEALTH, 3),
        128..160 => (kind::SAMPLE_RATE, 4),
        160..224 => (kind::CONF, 4 + usize::from(choices.byte()) % 32),
        224..240 => (kind::ACC_BOARD, 4),
        _ => (choices.byte(), usize::from(choices.byte()) % PAYLOAD_MAX),
    };
    let mut payload = [0; PAYLOAD_MAX];
    let taken = choices.take(len);
    payload[..taken.len()].copy_from_slice(taken);
    Answer::new(kind, &payload[..len])
}

fn node(choices: &mut Choices<'_>) -> Node {
    let first = choices.byte();
    Node::new(first & 31 == 1, first >> 2, choices.word(), choices.word())
}

fn capsule(choices: &mut Choices<'_>) -> Capsule {
    let (first, angle) = (choices.byte() & 1 == 1, choices.word());
    let sample = CapsuleSample {
        distance_mm: choices.word(),
        dtheta_q3: choices.byte(),
    };
    Capsule::new(first, angle, &[sample; CAPSULE_SAMPLES])
}

fn ultra(choices: &mut Choices<'_>) -> UltraCapsule {
    let (first, angle) = (choices.byte() & 1 == 1, choices.word());
    let [near, far, next] = [choices.word(), choices.word(), choices.word()];
    let samples = core::array::from_fn(|k| if k % 2 == 0 { near } else { far });
    UltraCapsule::new(first, angle, &samples, next)
}

/// A frame of either direction.
fn words(frame: &Frame) -> String {
    match frame {
        Frame::Stream(descriptor) => match descriptor.kind() {
            kind::NODES => "standard scan begins".to_owned(),
            kind::CAPSULES => "express scan begins".to_owned(),
            kind::ULTRA => "express scan of kind 84 begins".to_owned(),
            other => format!("stream of kind {other:02X} begins"),
        },
        Frame::Answer(answer) => answer_words(answer),
        Frame::Node(node) => {
            let start = if node.starts_turn() {
                "turn begins, "
            } else {
                ""
            };
            let (angle, quality) = (node.angle_deg(), node.quality());
            match node.distance_mm() {
                Some(mm) => format!("{start}{angle:.2} deg: {mm:.2} mm, quality {quality}"),
                None => format!("{start}{angle:.2} deg: nothing, quality {quality}"),
            }
        }
        Frame::Capsule(capsule) => {
            let start = if capsule.is_first() {
                "scan begins, "
            } else {
                ""
            };
            let angle = f32::from(capsule.start_angle_q6()) / 64.0;
            let samples = capsule.raw_samples();
            let measured = samples
                .iter()
                .filter(|sample| sample.distance_mm > 0)
                .count();
            format!("{start}from {angle:.2} deg: 32 samples, {measured} measured")
        }
        Frame::Ultra(capsule) => {
            let start = if capsule.is_first() {
                "scan begins, "
            } else {
                ""
            };
            let angle = f32::from(capsule.start_angle_q6()) / 64.0;
            let measured = capsule.majors_mm().filter(|mm| *mm > 0).count();
            format!("{start}from {angle:.2} deg: 96 samples, {measured} of 32 firsts measured")
        }
        Frame::Request(request) => request_words(*request),
    }
}

fn answer_words(answer: &Answer) -> String {
    match answer.reply() {
        Reply::Info(info) => {
            let (major, minor) = info.firmware;
            let (model, hardware, serial) = (info.model, info.hardware, hex::digits(&info.serial));
            format!(
                "model {model:02X}, firmware {major}.{minor}, hardware {hardware}, serial {serial}"
            )
        }
        Reply::Health(health) => {
            let status = match health.status {
                Status::Good => "good".to_owned(),
                Status::Warning => "warning".to_owned(),
                Status::Error => "error".to_owned(),
                Status::Unknown(status) => format!("status {status}"),
            };
            format!("health {status}, code {:#06x}", health.error)
        }
        Reply::SampleRate(rate) => {
            let (standard, express) = (rate.standard_us, rate.express_us);
            format!("samples of {standard} us, in express scans {express} us")
        }
        Reply::Conf(conf) => format!("configuration {:02X}: {}", conf.key, hex::pairs(conf.value)),
        Reply::AccBoard(flags) => format!("accessory board, flags {flags:#x}"),
        _ => {
            let (kind, len) = (answer.kind(), answer.payload().len());
            format!("answer of kind {kind:02X}, {len} bytes")
        }
    }
}

fn request_words(request: Request) -> String {
    match request.command() {
        Some(Command::Stop) => "stop".to_owned(),
        Some(Command::Reset) => "reset".to_owned(),
        Some(Command::Scan) => "scan?".to_owned(),
        Some(Command::ForceScan) => "forced scan?".to_owned(),
        Some(Command::ExpressScan { mode }) => format!("express scan of mode {mode}?"),
        Some(Command::Info) => "info?".to_owned(),
        Some(Command::Health) => "health?".to_owned(),
        Some(Command::SampleRate) => "sample rate?".to_owned(),
        Some(Command::Conf { key, mode: None }) => format!("configuration {key:02X}?"),
        Some(Command::Conf {
            key,
            mode: Some(mode),
        }) => {
            format!("configuration {key:02X} of mode {mode}?")
        }
        Some(Command::MotorPwm { pwm }) => format!("motor duty {pwm} of 1023"),
        Some(Command::MotorSpeed { rpm }) => format!("motor speed {rpm} rpm"),
        Some(Command::AccBoard) => "accessory board?".to_owned(),
        _ => {
            let (code, payload) = (request.code(), hex::pairs(request.payload()));
            format!("request {code:02X}: {payload}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(bytes: &[u8]) -> Vec<String> {
        let found = RPLIDAR.found(bytes).into_iter();
        let words = found.map(|one| match one.what {
            super::super::What::Frame(words) => words,
            super::super::What::Bad(_) => "bad".to_owned(),
        });
        words.collect()
    }

    /// First nodes of a real A1M8 behind their descriptor, then the answer that ends the stream.
    #[test]
    fn a_scan_is_told_node_by_node() {
        let scan = b"\xA5\x5A\x05\x00\x00\x40\x81\x02\x8F\x63\x00\x00\x3E\x9B\x64\xA0\x0F\
            \xA5\x5A\x03\x00\x00\x00\x06\x02\x02\x80";
        let expected = [
            "standard scan begins",
            "199.11 deg: nothing, quality 0",
            "201.20 deg: 1000.00 mm, quality 15",
            "health error, code 0x8002",
        ];
        assert_eq!(told(scan), expected);
    }

    /// Requests of LR001 and of the vendor's SDK, in sequence.
    #[test]
    fn requests_are_told_by_their_command() {
        let requests = b"\xA5\x25\xA5\x50\xA5\x82\x05\x00\x00\x00\x00\x00\x22\
            \xA5\xF0\x02\x94\x02\xC1\xA5\x84\x06\x71\x00\x00\x00\x01\x00\x57";
        let expected = [
            "stop",
            "info?",
            "express scan of mode 0?",
            "motor duty 660 of 1023",
            "configuration 71 of mode 1?",
        ];
        assert_eq!(told(requests), expected);
    }

    #[test]
    fn a_request_of_an_unknown_command_is_none_without_a_checksum() {
        assert_eq!(told(&[START, 0x70]), ["bad"]);
    }
}
