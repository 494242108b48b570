//! Finds answers, nodes and capsules in the sensor's bytes; optionally requests as well.

use super::answer::{ANSWER_MAX, Answer, Descriptor, PAYLOAD_MAX, Transfer, kind};
use super::capsule::{self, CAPSULE_LEN, Capsule};
use super::node::{self, Head, NODE_LEN, Node};
use super::request::{PAYLOAD, Request, Requests};
use super::ultra::{self, ULTRA_LEN, UltraCapsule};
use super::{ANSWER_START, DESCRIPTOR_LEN, START};
use crate::{Candidate, Decode, Format, FrameError};

/// Number of further nodes after a node whose check bits must be valid as well, if no valid node
/// precedes it. A quarter of all positions in a stream look like a node; five in a row are one in a
/// thousand.
const NODES_AHEAD: usize = 4;
/// As [`NODES_AHEAD`], directly after a valid node. The next node is checked because only it
/// reveals a lost byte.
const NODES_AHEAD_ALIGNED: usize = 1;

/// Data of the sensor other than answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Nothing.
    #[default]
    Answers,
    /// Nodes of a standard scan.
    Nodes,
    /// Capsules of an express scan.
    Capsules,
    /// Capsules of type 0x84.
    Ultra,
}

/// Something that the sensor sent, verified as far as the format allows, with every bit kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// A stream begins.
    Stream(Descriptor),
    /// An answer that is no stream.
    Answer(Answer),
    /// A sample of a standard scan.
    Node(Node),
    /// 32 samples of an express scan.
    Capsule(Capsule),
    /// 96 samples of a scan of the kind 0x84.
    Ultra(UltraCapsule),
    /// Request of the host; only from a decoder of [both directions](Decoder::of_both_ways).
    Request(Request),
}

impl Frame {
    /// The frame as on the wire.
    pub fn as_bytes(&self) -> &[u8] {
        match self {
            Self::Stream(descriptor) => descriptor.as_bytes(),
            Self::Answer(answer) => answer.as_bytes(),
            Self::Node(node) => node.as_bytes(),
            Self::Capsule(capsule) => capsule.as_bytes(),
            Self::Ultra(capsule) => capsule.as_bytes(),
            Self::Request(request) => request.as_bytes(),
        }
    }
}

/// Finds frames in the byte stream, and the start text and torn nodes between them.
///
/// A node is reported when the next node is valid, too (the next four after damage), or when the
/// line is reported as idle. So a lost byte costs one or two nodes, and the decoder stays aligned.
/// Between nodes the line is idle for a node's time, so a reported pause should be several times as
/// long.
#[derive(Clone, Debug, Default)]
pub struct Decoder(crate::Decoder<Answers, ANSWER_MAX>);

impl Decoder {
    /// A decoder that expects answers. A constant, for programs that are laid out by the linker.
    pub const fn new() -> Self {
        Self(crate::Decoder::with_format(Answers {
            mode: Mode::Answers,
            is_aligned: false,
            has_requests: false,
        }))
    }

    /// A decoder that also finds requests while no stream is announced, for a listener that does
    /// not know the direction of the bytes. Two bytes without a checksum are a request only if the
    /// command is known. A payload is at most as long as that of an answer.
    pub const fn of_both_ways() -> Self {
        Self(crate::Decoder::with_format(Answers {
            mode: Mode::Answers,
            is_aligned: false,
            has_requests: true,
        }))
    }

    /// Sets the mode from the next pending byte on. Needed only if the descriptor was not received:
    /// after a reset, or when the sensor streams already.
    pub const fn expect(&mut self, mode: Mode) {
        self.0.format_mut().mode = mode;
    }

    /// The search mode of the decoder.
    pub const fn mode(&self) -> Mode {
        self.0.format().mode
    }
}

impl Decode for Decoder {
    type Frame = Frame;

    fn step(&mut self, input: &mut &[u8]) -> Option<Result<Frame, FrameError>> {
        let outcome = self.0.step(input)?;
        self.0.format_mut().is_aligned = outcome.is_ok();
        match &outcome {
            Ok(Frame::Stream(descriptor)) => self.expect(match descriptor.kind() {
                kind::NODES => Mode::Nodes,
                kind::CAPSULES => Mode::Capsules,
                kind::ULTRA => Mode::Ultra,
                _ => Mode::Answers,
            }),
            Ok(Frame::Answer(_)) => self.expect(Mode::Answers),
            Ok(Frame::Node(_) | Frame::Capsule(_) | Frame::Ultra(_) | Frame::Request(_))
            | Err(_) => {}
        }
        Some(outcome)
    }

    fn idle(&mut self) {
        self.0.idle();
    }

    fn pending(&self) -> usize {
        self.0.pending()
    }

    fn discarded(&self) -> u64 {
        self.0.discarded()
    }
}

/// The format, with the last descriptor.
#[derive(Clone, Copy, Debug, Default)]
struct Answers {
    mode: Mode,
    /// Whether the pending bytes begin right behind a valid frame.
    is_aligned: bool,
    /// Whether the decoder searches for requests.
    has_requests: bool,
}

impl Answers {
    /// Judges `bytes`; `is_last`: no more bytes will follow.
    fn judge(self, bytes: &[u8], is_last: bool) -> Candidate {
        match self.mode {
            Mode::Answers if self.has_requests => judge_both(bytes),
            Mode::Answers => judge_answer(bytes),
            Mode::Nodes if begins_answer(bytes) && self.is_aligned => judge_answer(bytes),
            // A capsule may begin with the same two bytes, and damage may look like them: the other
            // five must be known ones.
            _ if begins_answer(bytes) && is_cut(bytes) => Candidate::Incomplete,
            _ if bytes.first_chunk().copied().is_some_and(is_known) => judge_answer(bytes),
            Mode::Nodes => self.judge_node(bytes, is_last),
            Mode::Capsules => judge_capsule(bytes, capsule::checksum),
            Mode::Ultra => judge_capsule(bytes, ultra::checksum),
        }
    }

    /// Checks a node by its own check bits and those of the following nodes.
    fn judge_node(self, bytes: &[u8], is_last: bool) -> Candidate {
        let ahead = if self.is_aligned {
            NODES_AHEAD_ALIGNED
        } else {
            NODES_AHEAD
        };
        let mut starts = 0;
        for at in (0..=ahead).map(|index| index * NODE_LEN) {
            let rest = bytes.get(at..).unwrap_or_default();
            match node::head(rest) {
                Head::Unknown if is_last && at > 0 => break,
                Head::Unknown => return Candidate::Incomplete,
                Head::Sound { starts_turn } => starts += u32::from(starts_turn),
                // The stream ends here, and an answer follows.
                Head::NoCheck if at > 0 && begins_answer(rest) => break,
                Head::NoStart if at == 0 && !self.is_aligned => return Candidate::Noise,
                Head::NoStart | Head::NoCheck => {
                    return Candidate::Rejected(node::check_bits(rest));
                }
            }
            // No turn is shorter than the examined nodes.
            if starts > 1 {
                let (expected, found) = (1, starts);
                return Candidate::Rejected(FrameError::Checksum { expected, found });
            }
        }
        if bytes.len() < NODE_LEN {
            return Candidate::Incomplete;
        }
        Candidate::Complete(NODE_LEN)
    }
}

impl Format for Answers {
    type Frame = Frame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        Self::judge(*self, bytes, false)
    }

    fn judge_last(&self, bytes: &[u8]) -> Candidate {
        Self::judge(*self, bytes, true)
    }

    fn frame(&self, bytes: &[u8]) -> Frame {
        let head = bytes.first_chunk().copied();
        if self.mode == Mode::Answers && !begins_answer(bytes) {
            return Frame::Request(Request::from_bytes(bytes));
        }
        if let &[a, b, c, d, e] = bytes {
            return Frame::Node(Node::from_judged([a, b, c, d, e]));
        }
        if bytes.len() == CAPSULE_LEN && self.mode == Mode::Capsules && !head.is_some_and(is_known)
        {
            return Frame::Capsule(Capsule::from_judged(bytes));
        }
        if bytes.len() == ULTRA_LEN && self.mode == Mode::Ultra && !head.is_some_and(is_known) {
            return Frame::Ultra(UltraCapsule::from_judged(bytes));
        }
        match head.and_then(Descriptor::from_started) {
            Some(descriptor) if descriptor.transfer() == Transfer::Stream => {
                Frame::Stream(descriptor)
            }
            _ => Frame::Answer(Answer::from_judged(bytes)),
        }
    }
}

/// Whether a descriptor begins here. No node begins with these two bytes.
const fn begins_answer(bytes: &[u8]) -> bool {
    matches!(*bytes, [START, ANSWER_START, ..])
}

/// Whether bytes of a descriptor are missing.
const fn is_cut(bytes: &[u8]) -> bool {
    bytes.len() < DESCRIPTOR_LEN
}

/// Whether this is a known descriptor of this sensor.
fn is_known(head: [u8; DESCRIPTOR_LEN]) -> bool {
    let descriptor = Descriptor::from_started(head).filter(|_| begins_answer(&head));
    descriptor.is_some_and(|descriptor| {
        let lengths = descriptor.lengths();
        lengths.is_some_and(|[least, greatest]| (least..=greatest).contains(&descriptor.length()))
    })
}

fn judge_answer(bytes: &[u8]) -> Candidate {
    if bytes[0] != START || bytes.get(1).is_some_and(|&byte| byte != ANSWER_START) {
        return Candidate::Noise;
    }
    let Some(&head) = bytes.first_chunk::<DESCRIPTOR_LEN>() else {
        return Candidate::Incomplete;
    };
    let longest = u32::try_from(PAYLOAD_MAX).expect("128");
    let Some(descriptor) = Descriptor::from_started(head) else {
        let found = u32::from_le_bytes([head[2], head[3], head[4], head[5]]);
        let max = longest;
        return Candidate::Rejected(FrameError::Length { max, found });
    };
    let (length, transfer) = (descriptor.length(), descriptor.transfer());
    let [least, max] = descriptor.lengths().unwrap_or([0, longest]);
    if !(least..=max).contains(&length) {
        let found = length;
        return Candidate::Rejected(FrameError::Length { max, found });
    }
    let end = match transfer {
        Transfer::Stream => DESCRIPTOR_LEN,
        Transfer::Single => DESCRIPTOR_LEN + usize::try_from(length).unwrap_or(usize::MAX),
    };
    if bytes.len() < end {
        return Candidate::Incomplete;
    }
    Candidate::Complete(end)
}

/// Judges an answer or a request: the second byte of an answer is no command.
fn judge_both(bytes: &[u8]) -> Candidate {
    match *bytes {
        [START, ANSWER_START, ..] => judge_answer(bytes),
        [START, command, size, ..] if command & PAYLOAD != 0 && usize::from(size) > PAYLOAD_MAX => {
            Candidate::Rejected(FrameError::Length {
                max: u32::try_from(PAYLOAD_MAX).expect("128"),
                found: u32::from(size),
            })
        }
        [START, command, ..] if command & PAYLOAD == 0 => {
            let request = Request::plain(command);
            match request.command() {
                Some(_) => Candidate::Complete(request.as_bytes().len()),
                None => Candidate::Noise,
            }
        }
        _ => Requests.judge(bytes),
    }
}

/// Judges a capsule of `LEN` bytes; both kinds have the same sync nibbles and the same sum.
fn judge_capsule<const LEN: usize>(bytes: &[u8], checksum: fn(&[u8; LEN]) -> u8) -> Candidate {
    if !capsule::may_begin(bytes) {
        return Candidate::Noise;
    }
    let Some(bytes) = bytes.first_chunk::<LEN>() else {
        return Candidate::Incomplete;
    };
    let (expected, found) = (checksum(bytes), capsule::found_checksum(bytes[0], bytes[1]));
    if expected == found {
        return Candidate::Complete(LEN);
    }
    Candidate::Rejected(FrameError::Checksum {
        expected: u32::from(expected),
        found: u32::from(found),
    })
}
