//! Compares a real device with its description: sends the same requests to the device and to
//! emulated twins, and compares the answers.
//!
//! ```text
//! description --> probes --+--> the device: answers, times
//!                          +--> several emulated twins: allowed answers and times
//! ```
//!
//! The twins have different seeds and start times. Values that differ between the twins may differ
//! in the device too: a measured value must lie within their range, a constant value must be equal.

mod after;
mod asks;
mod harm;
mod judge;
mod probes;

use core::fmt;
use core::time::Duration;
use std::collections::BTreeMap;
use std::sync::Arc;

use protocols::{LineConfig, Parity};

use crate::description::Description;
use crate::device::{Described, Place};
use crate::field;
use crate::framing::Frame;
use crate::number::Number;
use crate::peer::{Emulated, Peer, Speaker};
use crate::registers;
use crate::schema::message::From;
use crate::speak::{self, Asks};
use crate::value::{Record, Value};
pub use asks::Ask;
use judge::Samples;
use probes::Probe;

/// The scope and tolerance of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strictness {
    /// Whether requests that change the device's state are sent too.
    pub writes: bool,
    /// Allowed deviation of times, in addition to a fifth of the expected time.
    pub slack: Duration,
}

impl Strictness {
    /// For a device in virtual time.
    pub const EMULATED: Self = Self {
        writes: true,
        slack: Duration::from_micros(100),
    };
}

/// A difference between device and description.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Difference {
    /// The kind of difference.
    pub kind: DifferenceKind,
    /// The request, message, field or register.
    pub place: String,
    /// The value or behaviour in the description.
    pub expected: String,
    /// The value or behaviour of the device.
    pub found: String,
}

/// Kinds of differences.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DifferenceKind {
    /// The line has another rate or format.
    Line,
    /// The device does not answer a request.
    NoReply,
    /// The device answers a request that it should ignore.
    UnexpectedReply,
    /// The device answers with another message.
    OtherReply,
    /// The device refuses a request that it should answer, or the reverse, or for another reason.
    Refusal,
    /// A reply has another length.
    Length,
    /// Replies come earlier or later.
    Latency,
    /// Unsolicited messages come more or less often.
    Period,
    /// A number has another byte order.
    ByteOrder,
    /// A number has another scale.
    Scale,
    /// A number has another signedness.
    Sign,
    /// A value differs.
    Value,
}

impl DifferenceKind {
    /// The name of the kind.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Line => "line",
            Self::NoReply => "no-reply",
            Self::UnexpectedReply => "unexpected-reply",
            Self::OtherReply => "other-reply",
            Self::Refusal => "refusal",
            Self::Length => "length",
            Self::Latency => "latency",
            Self::Period => "period",
            Self::ByteOrder => "byte-order",
            Self::Scale => "scale",
            Self::Sign => "sign",
            Self::Value => "value",
        }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            kind,
            place,
            expected,
            found,
        } = self;
        write!(f, "{}: {place}: {found}, expected {expected}", kind.name())
    }
}

/// The result of a comparison.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Conformity {
    /// Requests that were sent.
    pub requests: usize,
    /// Replies that were received.
    pub replies: usize,
    /// Median and 99th percentile of the time from a request to its reply.
    pub latency: Option<[Duration; 2]>,
    /// Requests whose replies were compared with all their values.
    pub compared: usize,
    /// Whether unsolicited messages of the device were compared.
    pub heard_by_itself: bool,
    /// The differences found.
    pub differences: Vec<Difference>,
    /// Requests that were left out because they change the device's state.
    pub left_out: usize,
    /// Requests that the description answers, but the emulated twins did not: their replies were
    /// not compared.
    pub unproved: Vec<String>,
    /// Other parts of the description that were not compared, each with the reason.
    pub unseen: Vec<String>,
}

impl Conformity {
    /// Whether no message of the device was compared with the description. Such a comparison does
    /// not pass: the device was not observed.
    pub fn is_void(&self) -> bool {
        let is_unasked = self.compared == 0 && self.unproved.is_empty();
        let is_unanswered = self.compared == 0 && !self.unproved.is_empty();
        self.differences.is_empty() && (is_unanswered || is_unasked && !self.heard_by_itself)
    }
}

/// Number of emulated twins.
const TWINS: u64 = 6;
/// Virtual times for which the twins ran before the comparison, milliseconds. They differ so that
/// counters and waves differ between the twins.
const STARTED_MS: [u64; 6] = [0, 3_370, 17_910, 61_230, 301_570, 1_801_830];
/// Maximum number of steps of a twin before the comparison. The limit shortens the times of
/// [`STARTED_MS`] for devices that stream.
const STEPS_MAX: u32 = 10_000;
/// Number of times that a port is listened to again if its messages seem to come too often or too
/// rarely: a busy computer delivers them late.
const LISTEN_AGAIN: u32 = 3;
/// Minimum number of reply bytes for which the timeout allows.
const REPLY_BYTES: u64 = 64;

/// The kind of a reply that is no message of the description.
pub const UNKNOWN: &str = "an unknown message";

/// A frame that answered a probe.
#[derive(Clone, Debug)]
struct Answer {
    label: String,
    is_refusal: bool,
    latency: Duration,
    len: usize,
    fields: Vec<Seen>,
}

/// A value in an answer.
#[derive(Clone, Debug)]
struct Seen {
    place: String,
    value: Value,
    raw: Option<Raw>,
}

/// The bytes of a number, and its scale.
#[derive(Clone, Debug, PartialEq)]
struct Raw {
    bytes: Vec<u8>,
    number: Number,
    scale: [f64; 2],
}

/// Compares the device `peer` with its description.
///
/// # Errors
/// If the port is gone.
pub fn conform(
    description: &Arc<Description>,
    peer: &mut dyn Peer,
    strictness: Strictness,
) -> Result<Conformity, String> {
    let all = probes::of(description);
    let (probes, left_out): (Vec<_>, Vec<_>) = all
        .into_iter()
        .partition(|probe| strictness.writes || !probe.changes);
    let time = patience(description) + 4 * strictness.slack;
    let mut twins = Vec::new();
    for (seed, started_ms) in (1..=TWINS).zip(STARTED_MS) {
        let mut twin = emulated(description, seed);
        twin.pass(Duration::from_millis(started_ms), STEPS_MAX);
        twins.push(ask(description, &mut twin, &probes, time)?.answers);
    }
    let mut found = ask(description, peer, &probes, time)?;
    listen_again(description, peer, &probes, (&twins, &mut found))?;
    let mut conformity = judge::judge(&probes, &twins, &found, strictness);
    conformity.left_out = left_out.len();
    let other = peer.line().filter(|line| *line != description.line);
    let line = other.map(|line| Difference {
        kind: DifferenceKind::Line,
        place: "line".to_owned(),
        expected: line_in_words(description.line),
        found: line_in_words(line),
    });
    conformity.differences.splice(0..0, line);
    conformity.unseen = after::unseen(description, &probes, &twins, &found);
    Ok(conformity)
}

/// A line as in a description, e.g. `9600 baud, 8E1`.
fn line_in_words(line: LineConfig) -> String {
    let parity = match line.parity {
        Parity::None => 'N',
        Parity::Even => 'E',
        Parity::Odd => 'O',
    };
    let LineConfig {
        baud,
        data_bits,
        stop_bits,
        ..
    } = line;
    format!("{baud} baud, {data_bits}{parity}{stop_bits}")
}

/// Listens to a port again, twice as long, if the number of its messages differs.
fn listen_again(
    of: &Description,
    peer: &mut dyn Peer,
    probes: &[Probe],
    (twins, found): (&[Vec<Vec<Answer>>], &mut Asked),
) -> Result<(), String> {
    let is_port = !peer.lateness().is_zero();
    // The state before the first command no longer exists, but the messages still come as often.
    let first = probes.iter().position(|probe| probe.listen.is_some());
    let Some((at, time)) = first.and_then(|at| Some((at, probes[at].listen?))) else {
        return Ok(());
    };
    for _ in 0..LISTEN_AGAIN {
        let expected: Vec<&[Answer]> = twins.iter().map(|twin| &twin[at][..]).collect();
        if !is_port || after::is_as_often(&expected, found, at, time) {
            break;
        }
        let again = ask(of, peer, &[probes[at].lasting(2 * time)], time)?;
        found.answers[at] = again.answers.into_iter().flatten().collect();
        found.took[at] = again.took.into_iter().sum();
    }
    Ok(())
}

/// The answers of a device to each probe, and the time that each one took.
#[derive(Debug, Default)]
struct Asked {
    answers: Vec<Vec<Answer>>,
    took: Vec<Duration>,
}

/// The described device, emulated in virtual time.
pub fn emulated(description: &Arc<Description>, seed: u64) -> Emulated {
    let place = Place {
        name: description.name.clone(),
        seed,
        address: None,
        is_alone: true,
    };
    let device = Described::new(description.clone(), place);
    Emulated::new(Box::new(device), Described::UART)
}

/// The time within which a reply begins and usually ends.
fn patience(of: &Description) -> Duration {
    let jitter = |jitter: Option<Duration>| jitter.unwrap_or(Duration::ZERO);
    let latencies = of.on.iter().map(|on| on.latency + jitter(on.jitter));
    let longest = latencies.max().unwrap_or(Duration::ZERO);
    let longest = longest
        .max(of.latency + jitter(of.jitter))
        .max(of.turnaround);
    let busy = of
        .on
        .iter()
        .filter_map(|on| on.busy)
        .max()
        .unwrap_or(Duration::ZERO);
    let settled = (2 * longest).max(busy) + of.line.bytes_time(REPLY_BYTES);
    settled + of.idle() + Duration::from_millis(5)
}

/// Sends each probe to a device.
fn ask(
    of: &Description,
    peer: &mut dyn Peer,
    probes: &[Probe],
    time: Duration,
) -> Result<Asked, String> {
    if let Some(boot) = of.boot {
        let until = peer.now() + boot;
        // A program may write without a pause.
        while peer.hear(until)?.is_some() && peer.now() <= until {}
    }
    let mut speaker = Speaker::new(of);
    let mut all = Asked::default();
    for probe in probes {
        if probe.listen.is_some() {
            // Messages that a port has stored are older than the time to listen.
            speaker.exchange(peer, &[], Duration::ZERO, &mut |_| false)?;
        }
        let time = probe.listen.unwrap_or(time);
        let start = peer.now();
        let heard = speaker.exchange(peer, &probe.bytes, time, &mut |_| false)?;
        let answers = heard.frames.iter();
        let answers = answers.filter_map(|(latency, frame)| answer(of, probe, *latency, frame));
        all.answers.push(answers.collect());
        all.took.push(peer.now() - start);
    }
    Ok(all)
}

/// Interprets a frame as an answer to a probe; `None` if the frame is unsolicited.
fn answer(of: &Description, probe: &Probe, latency: Duration, frame: &Frame) -> Option<Answer> {
    let body = of.body(frame)?;
    let mut answer = Answer {
        label: String::new(),
        is_refusal: false,
        latency,
        len: body.len(),
        fields: Vec::new(),
    };
    if of.protocol.is_some() {
        let function = body.get(1).copied().unwrap_or(0);
        answer.is_refusal = function & 0x80 != 0;
        answer.label = match (answer.is_refusal, body.get(2)) {
            (true, Some(code)) => format!("exception {code}"),
            _ => format!("function {function}"),
        };
        if let Some(Asks::Modbus {
            read: Some(read), ..
        }) = probe.asks.as_ref()
            && !answer.is_refusal
            && let Some(bytes) = body.get(3..)
        {
            answer.fields = register_values(of, read, bytes);
        }
        return Some(answer);
    }
    let Some((message, record)) = of.message(frame, From::Device) else {
        UNKNOWN.clone_into(&mut answer.label);
        return Some(answer);
    };
    let index = of
        .messages
        .iter()
        .position(|other| other.name == message.name)?;
    let is_streamed = of
        .every
        .iter()
        .any(|every| every.deed.send.contains(&index));
    let is_asked = match &probe.asks {
        Some(Asks::Messages(asked)) => asked.contains(&index),
        _ => false,
    };
    if is_streamed && !is_asked && probe.listen.is_none() {
        return None;
    }
    message.name().clone_into(&mut answer.label);
    seen(
        message.name(),
        message.fields(),
        &record,
        &mut answer.fields,
    );
    if let Some(cell) = probe.cell {
        register_of(of, cell, &mut answer.fields);
    }
    Some(answer)
}

fn seen(outer: &str, fields: &[field::Field], record: &Record, out: &mut Vec<Seen>) {
    for (name, value) in &record.0 {
        let known = field::find(fields, name);
        let place = format!("{outer}.{name}");
        if let (
            Value::Record(inner),
            Some(field::Field {
                kind: field::Kind::Group(fields),
                ..
            }),
        ) = (value, known)
        {
            seen(&place, fields, inner, out);
            continue;
        }
        let raw = known.and_then(|field| match field.kind {
            field::Kind::Number(number) if field.repeat.is_none() => Some(Raw {
                bytes: field::number_bytes(number, &field.unscaled(value.clone())).0,
                number,
                scale: field.scale.unwrap_or([1.0, 0.0]),
            }),
            _ => None,
        });
        let value = value.clone();
        out.push(Seen { place, value, raw });
    }
}

/// Replaces the bytes of a register with its value.
fn register_of(of: &Description, index: usize, fields: &mut [Seen]) {
    let cells = of.registers.as_ref().map(|all| &all.bytes.cells);
    let Some(cell) = cells.and_then(|cells| cells.get(index)) else {
        return;
    };
    let len = usize::try_from(cell.len).unwrap_or(0);
    for seen in fields {
        let Value::Bytes(bytes) = &seen.value else {
            continue;
        };
        if bytes.len() == len {
            let value = cell.value(bytes);
            *seen = of_cell(of, cell, value);
            return;
        }
    }
}

/// The value of a register as an entry of an answer.
fn of_cell(of: &Description, cell: &registers::Cell, value: Value) -> Seen {
    let raw = match cell.kind {
        registers::CellKind::Number(number) => Some(Raw {
            bytes: cell.bytes(&value),
            number,
            scale: cell.scale.unwrap_or([1.0, 0.0]),
        }),
        _ => None,
    };
    let place = of.variables[cell.variable].name.to_string();
    Seen { place, value, raw }
}

fn register_values(of: &Description, read: &speak::Read, bytes: &[u8]) -> Vec<Seen> {
    let values = speak::values(of, read, bytes)
        .into_iter()
        .map(|(cell, value)| of_cell(of, cell, value));
    values.collect()
}

/// Values of all answers, grouped by place.
fn samples<'a>(all: impl Iterator<Item = &'a Answer>) -> BTreeMap<&'a str, Samples<'a>> {
    let mut samples: BTreeMap<&str, Samples<'_>> = BTreeMap::new();
    for seen in all.flat_map(|answer| &answer.fields) {
        samples.entry(&seen.place).or_default().add(seen);
    }
    samples
}
