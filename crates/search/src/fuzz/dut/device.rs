//! Fuzzing of a described device through its line: an emulated one, a device program, or a real
//! device at a port.
//!
//! ```text
//!  description --> requests --> inputs: requests, changed or damaged --+--> the device
//!                                                                      +--> the emulated device
//!                  finding <-- a law is broken <-- replies of both <---+
//! ```
//!
//! An *input* is a list of pieces, and a pause ends it. A device keeps these laws:
//!
//! | law | says |
//! |---|---|
//! | `pieces-change-nothing` | the device replies the same to bytes that arrive one by one |
//! | `damage-is-not-answered` | bytes without a valid frame get no reply |
//! | `answers-again` | after an input without an effect, the next request is answered |
//! | `replies-are-described` | the reply to an unchanged request is a message of the description |
//! | `replies-as-described` | a real device replies with the same messages as the emulated one |
//!
//! If values change with time, replies to several requests at once are compared by their messages.

mod inputs;
mod port;

use core::time::Duration;
use std::path::Path;
use std::sync::Arc;

use description::conform;
use description::peer::{Emulated, Heard, Peer, Speaker};
use description::{Description, From};
use emulators::rng::Rng;
use engine::codec::wire::Stream;
use protocols::{Decode as _, Instant};

use super::super::engine::caught;
use super::super::subject::{Behaviour, Kept, Subject, Violation};
use crate::shrink::{Effort, fewest};
use inputs::{Input, Inputs};
pub use port::{PortFuzz, PortFuzzed, PortPlan, PortStep};

/// Maximum number of inputs of a case.
const INPUTS_MAX: usize = 8;
/// Number of bytes of the choices that make an input.
const CHOICE: usize = 8;
/// Pause between two pieces of an input.
const PIECE_GAP: Duration = Duration::from_millis(2);
/// Number of requests after an input, one of which must be answered.
const TRIES: usize = 3;
/// Maximum number of extra reply times after an input: a long one gets many replies.
const REPLY_TIMES_MAX: usize = 64;
/// Maximum number of these reply times in which only messages of timers arrive.
const STREAMED_MAX: usize = 2;
/// File name of the inputs of a finding.
const INPUTS: &str = "inputs.txt";

/// Makes the device in its start state.
pub type Make = Box<dyn Fn() -> Result<Emulated, String> + Sync>;

/// A described device in virtual time as a subject.
pub struct DescribedDevice {
    description: Arc<Description>,
    make: Make,
    /// The command line, up to the options of one search.
    command: String,
    inputs: Inputs,
    /// A request without an effect, and the kinds of its replies.
    plain: Option<(Vec<u8>, Vec<String>)>,
}

impl DescribedDevice {
    /// The device that `make` makes; `command` is the command line that selects it.
    ///
    /// # Errors
    /// If the device cannot be made, or answers no request of its description.
    pub fn new(
        description: &Arc<Description>,
        make: Make,
        command: String,
    ) -> Result<Self, String> {
        let inputs = Inputs::of(description, true);
        let mut asks = description.asks();
        can_reply(description, asks.len())?;
        asks.sort_by_key(|ask| ask.changes);
        let (mut answered, mut is_heard) = (None, false);
        for ask in &asks {
            let mut bench = Bench::new(description, make()?)?;
            let heard = bench.say(core::slice::from_ref(&ask.bytes))?;
            is_heard |= !heard.frames.is_empty();
            let kinds = description.reply_kinds(&heard);
            if !kinds.is_empty() {
                answered = Some((ask, kinds));
                break;
            }
        }
        let Some((ask, kinds)) = answered else {
            let (name, count) = (description.name(), asks.len());
            return Err(match is_heard {
                true => format!(
                    "{name} sends each reply to its {count} requests also by itself, expected a \
                     reply that only a request causes: {FUZZ_DRIVER}"
                ),
                false => format!(
                    "{name} answers none of the {count} requests of its description, expected one \
                     reply: check that the description is that of the device"
                ),
            });
        };
        let plain = (!ask.changes).then(|| (ask.bytes.clone(), kinds));
        Ok(Self {
            description: description.clone(),
            make,
            command,
            inputs,
            plain,
        })
    }

    /// The device of a description, emulated.
    ///
    /// # Errors
    /// If the description has no request with a reply.
    pub fn emulated(description: &Arc<Description>, command: String) -> Result<Self, String> {
        let of = description.clone();
        let make = Box::new(move || Ok(conform::emulated(&of, SEED)));
        Self::new(description, make, command)
    }

    fn inputs_of(&self, choices: &[u8]) -> Vec<Input> {
        let seeds = choices.chunks(CHOICE).take(INPUTS_MAX);
        let seeds = seeds.map(|part| {
            let byte = |seed: u64, byte: &u8| seed << 8 | u64::from(*byte);
            part.iter().fold(part.len() as u64, byte)
        });
        seeds
            .map(|seed| self.inputs.next(&mut Rng::stream(seed, "device.input")))
            .collect()
    }

    /// Sends the inputs to the device, and judges its replies.
    fn judge(&self, inputs: &[Input], behaviour: &mut Behaviour) -> Result<(), Violation> {
        let broken = |error: String| Violation::new("device-works", error);
        let made = || (self.make)().map_err(broken);
        let mut whole = Bench::new(&self.description, made()?.paced()).map_err(broken)?;
        let mut single =
            Bench::new(&self.description, made()?.paced().bytewise()).map_err(broken)?;
        let mut is_plain = true;
        for input in inputs {
            let at = whole.peer.now().max(single.peer.now());
            let [heard, other] = [&mut whole, &mut single].map(|bench| {
                bench.wait_until(at)?;
                bench.say_all(&input.pieces)
            });
            let (heard, other) = (heard.map_err(broken)?, other.map_err(broken)?);
            let kinds = self.description.reply_kinds(&heard);
            for kind in &kinds {
                behaviour.named(kind, 1);
            }
            if self.inputs.has_request(&input.bytes())
                && kinds.iter().any(|kind| kind == conform::UNKNOWN)
            {
                let detail = "it replies with a frame that is no message of its description";
                return Err(Violation::new("replies-are-described", detail));
            }
            is_damage(&self.description, input, &kinds)?;
            is_plain &= self.description.keeps_state(&input.bytes());
            if let Some((request, expected)) = self.plain.as_ref().filter(|_| is_plain) {
                answers_again(&self.description, &mut whole, request, expected)?;
                answers_again(&self.description, &mut single, request, expected)?;
            }
            let rules = [&whole, &single].map(|bench| bench.peer.broken_rules());
            for (rule, count) in &rules[0] {
                behaviour.named(rule, *count);
            }
            let replies = [&heard, &other].map(|heard| self.replies(input, heard));
            if replies[0] != replies[1] || rules[0] != rules[1] {
                return Err(Violation::new(
                    "pieces-change-nothing",
                    format!(
                        "to all bytes at once it replies {:02X?} and logs {:?}, to single bytes \
                         {:02X?} and {:?}",
                        replies[0], rules[0], replies[1], rules[1]
                    ),
                ));
            }
        }
        Ok(())
    }

    /// The replies to `input`, for a comparison.
    fn replies(&self, input: &Input, heard: &Heard) -> Vec<Vec<u8>> {
        let of = &self.description;
        // The reply to the first of several requests may have begun when the others arrive byte by
        // byte: then the others are answered at another time, with other values.
        if of.changes_with_time() && requests_in(of, input) > 1 {
            let kinds = of.reply_kinds(heard).into_iter();
            return kinds.map(String::into_bytes).collect();
        }
        // A message of a timer may come before or after a request that is still arriving.
        let frames = heard.frames.iter().map(|(_, frame)| frame);
        let frames = frames.filter(|frame| !of.is_unasked(frame));
        frames.map(|frame| frame.bytes.to_vec()).collect()
    }

    fn judged(&self, inputs: &[Input]) -> Result<(), Violation> {
        caught(|| self.judge(inputs, &mut Behaviour::default()))
    }
}

/// Seed of an emulated device.
const SEED: u64 = 4711;

/// The alternative to fuzzing a device whose replies cannot be observed.
const FUZZ_DRIVER: &str = "fuzz the program that receives its data, with hilrig fuzz --exec PROGRAM \
                           --description DEVICE";

/// Rejects a description without a request that gets a reply.
fn can_reply(of: &Description, requests: usize) -> Result<(), String> {
    let name = of.name();
    match requests {
        0 => Err(format!(
            "{name} only sends: its description has no request, expected one with a reply: \
             {FUZZ_DRIVER}"
        )),
        _ if of.has_replies() => Ok(()),
        count => Err(format!(
            "{name} has no reply to any of the {count} requests of its description, expected one: \
             {FUZZ_DRIVER}"
        )),
    }
}

/// Bytes without a valid frame get no reply, or one that the description has for them.
fn is_damage(of: &Description, input: &Input, kinds: &[String]) -> Result<(), Violation> {
    let described = of.damage_kinds();
    let mut others = kinds
        .iter()
        .filter(|kind| !described.contains(&kind.as_str()));
    if others.next().is_none() || holds_frame(of, &input.pieces) {
        return Ok(());
    }
    let detail = format!(
        "after \"{}\" it replies {}, although the bytes hold no valid frame",
        input.kind,
        kinds.join(", ")
    );
    Err(Violation::new("damage-is-not-answered", detail))
}

/// The number of frames of a driver in an input.
fn requests_in(of: &Description, input: &Input) -> usize {
    let mut cutter = of.cutter_of(From::Host);
    let count = cutter.push(&input.bytes()).flatten().count();
    cutter.idle();
    count + cutter.push(&[]).flatten().count()
}

/// Whether a driver's frame is in the pieces of an input, in all of them or in one. Where a
/// silence ends frames, a device may also end them by their length.
fn holds_frame(of: &Description, pieces: &[Vec<u8>]) -> bool {
    let all = pieces.concat();
    let mut parts = pieces.iter().chain([&all]);
    parts.any(|part| {
        if of.ends_with_silence() && of.whole(part).is_ok() {
            return true;
        }
        let mut cutter = of.cutter_of(From::Host);
        let mut found = cutter.push(part).any(|frame| frame.is_ok());
        cutter.idle();
        found |= cutter.push(&[]).any(|frame| frame.is_ok());
        found
    })
}

/// One of a few requests is answered as usual.
fn answers_again<P: Peer>(
    of: &Description,
    bench: &mut Bench<'_, P>,
    request: &[u8],
    expected: &[String],
) -> Result<(), Violation> {
    for _ in 0..TRIES {
        let heard = bench.say(&[request.to_vec()]);
        let heard = heard.map_err(|error| Violation::new("device-works", error))?;
        let kinds = of.reply_kinds(&heard);
        if expected.iter().all(|kind| kinds.contains(kind)) {
            return Ok(());
        }
    }
    let detail = format!(
        "it does not answer {TRIES} requests {request:02X?} with {}",
        expected.join(", ")
    );
    Err(Violation::new("answers-again", detail))
}

/// A device and the driver's end of its line.
struct Bench<'a, P> {
    peer: P,
    speaker: Speaker<'a>,
    /// Time after an input in which replies are received.
    time: Duration,
    /// Minimum time between two inputs or requests.
    gap: Duration,
    /// Earliest time of the next one.
    next_at: Instant,
}

impl<'a, P: Peer> Bench<'a, P> {
    /// The device behind `peer`, when it has started.
    fn new(description: &'a Arc<Description>, mut peer: P) -> Result<Self, String> {
        let until = peer.now() + description.boot_time();
        // A program may write without a pause.
        while peer.hear(until)?.is_some() && peer.now() <= until {}
        Ok(Self {
            next_at: peer.now(),
            gap: Duration::ZERO,
            peer,
            speaker: Speaker::new(description),
            time: description.reply_time(),
        })
    }

    /// Waits until the next bytes may be sent.
    fn pace(&mut self) -> Result<(), String> {
        let now = self.peer.now();
        if now < self.next_at {
            self.wait(self.next_at - now)?;
        }
        self.next_at = self.peer.now() + self.gap;
        Ok(())
    }

    /// Sends an input and receives the replies.
    fn say(&mut self, pieces: &[Vec<u8>]) -> Result<Heard, String> {
        self.pace()?;
        let mut all = Heard::default();
        for (number, piece) in (1..).zip(pieces) {
            let time = match number == pieces.len() {
                true => self.time,
                false => PIECE_GAP,
            };
            let (speaker, peer) = (&mut self.speaker, &mut self.peer);
            let heard = match number {
                1 => speaker.exchange(peer, piece, time, &mut |_| false)?,
                _ => speaker.exchange_now(peer, piece, time, &mut |_| false)?,
            };
            all.frames.extend(heard.frames);
            all.stray += heard.stray;
        }
        Ok(all)
    }

    /// Sends an input and receives all replies: until one reply time passes without any. Messages
    /// of timers delay a reply, so they extend the time, too.
    fn say_all(&mut self, pieces: &[Vec<u8>]) -> Result<Heard, String> {
        let of = self.speaker.description();
        let has_reply = |heard: &Heard| heard.frames.iter().any(|(_, one)| !of.is_unasked(one));
        let mut all = self.say(pieces)?;
        let mut is_over = all.frames.is_empty();
        for round in 0..REPLY_TIMES_MAX {
            if is_over {
                break;
            }
            let (peer, time) = (&mut self.peer, self.time);
            let heard = self.speaker.exchange_now(peer, &[], time, &mut |_| false)?;
            // A device that streams never stops.
            is_over = !has_reply(&heard) && (heard.frames.is_empty() || round >= STREAMED_MAX);
            all.frames.extend(heard.frames);
            all.stray += heard.stray;
        }
        Ok(all)
    }

    /// Lets time pass up to `at`.
    fn wait_until(&mut self, at: Instant) -> Result<(), String> {
        let now = self.peer.now();
        let time = if at > now { at - now } else { Duration::ZERO };
        let none = &mut Heard::default();
        self.speaker.wait(&mut self.peer, time, none)
    }

    /// Lets time pass; replies in it are ignored.
    fn wait(&mut self, time: Duration) -> Result<(), String> {
        let none = self
            .speaker
            .exchange(&mut self.peer, &[], time, &mut |_| false);
        none.map(drop)
    }
}

/// The inputs as text: a piece on each line, `idle` behind each input.
fn to_text(inputs: &[Input]) -> String {
    let mut text = String::new();
    for input in inputs {
        text += &format!("# {}\n", input.kind);
        for piece in &input.pieces {
            text += &engine::hex::pairs(piece);
            text.push('\n');
        }
        text += "idle\n";
    }
    text
}

/// Reads the text of [`to_text`].
fn parse(text: &str) -> Result<Vec<Input>, String> {
    use engine::codec::wire::Piece;
    let stream = Stream::parse(text).map_err(|error| error.to_string())?;
    let mut inputs = vec![Input::default()];
    for piece in stream.pieces() {
        match (piece, inputs.last_mut()) {
            (Piece::Idle, _) => inputs.push(Input::default()),
            (Piece::Bytes([]), _) | (_, None) => {}
            (Piece::Bytes(bytes), Some(input)) => input.pieces.push(bytes.to_vec()),
        }
    }
    inputs.retain(|input| !input.pieces.is_empty());
    match inputs.is_empty() {
        true => Err("holds no input, expected lines of bytes such as 01 03 00 00".to_owned()),
        false => Ok(inputs),
    }
}

impl Subject for DescribedDevice {
    fn name(&self) -> &str {
        self.description.name()
    }

    fn round(&self) -> u64 {
        64
    }

    fn tries(&self) -> u32 {
        300
    }

    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Violation> {
        self.judge(&self.inputs_of(choices), behaviour)
    }

    fn seeds(&self) -> Vec<Vec<u8>> {
        (0..4).map(|seed| vec![seed; 4 * CHOICE]).collect()
    }

    fn in_words(&self, choices: &[u8]) -> String {
        to_text(&self.inputs_of(choices))
    }

    fn keep(&self, choices: &[u8], fault: &Violation, effort: &mut Effort<'_>) -> Kept {
        let small = fewest(&self.inputs_of(choices), effort, |inputs| {
            let judged = self.judged(inputs);
            judged.is_err_and(|other| other.cause == fault.cause)
        });
        Kept {
            fault: self.judged(&small).err().unwrap_or_else(|| fault.clone()),
            files: vec![(INPUTS, to_text(&small).into_bytes())],
        }
    }

    fn case_file(&self) -> &'static str {
        INPUTS
    }

    fn repeat(&self, dir: &Path) -> String {
        format!("{} --repeat {}", self.command, dir.join(INPUTS).display())
    }

    /// Choices cannot be reconstructed from inputs.
    fn choices_of(&self, text: &str) -> Result<Option<Vec<u8>>, String> {
        parse(text).map(|_| None)
    }

    fn repeated(&self, text: &str) -> Result<Result<(), Violation>, String> {
        Ok(self.judged(&parse(text)?))
    }
}

#[cfg(test)]
mod tests;
