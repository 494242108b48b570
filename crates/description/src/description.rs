//! A device that has been described.

use core::fmt;
use core::time::Duration;
use std::borrow::Cow;
use std::sync::Arc;

use protocols::{FrameError, LineConfig};

use crate::behaviour::{After, Every, Fault, On};
use crate::compile::{Compiler, Files};
use crate::error::{DescriptionError, Places};
use crate::framing::{Cutter, Frame, Frames, Unused, cutter};
use crate::message::Message;
use crate::modbus;
use crate::registers::Registers;
use crate::schema::Schema;
use crate::schema::message::From;
use crate::state::Variable;
use crate::value::Record;

/// A description that was read and found sound. Many devices and decoders share one.
#[derive(Clone)]
pub struct Description {
    /// The text that it was read from.
    pub(crate) text: Arc<str>,
    pub(crate) name: String,
    pub(crate) about: String,
    pub(crate) documents: Vec<String>,
    pub(crate) line: LineConfig,
    pub(crate) is_half_duplex: bool,
    pub(crate) turnaround: Duration,
    pub(crate) echoes: bool,
    pub(crate) address: Option<u32>,
    pub(crate) latency: Duration,
    pub(crate) jitter: Option<Duration>,
    pub(crate) watchdog: Option<Duration>,
    pub(crate) boot: Option<Duration>,
    pub(crate) protocol: Option<Protocol>,
    pub(crate) frames: Frames,
    pub(crate) messages: Vec<Message>,
    pub(crate) variables: Arc<Vec<Variable>>,
    pub(crate) registers: Option<Registers>,
    pub(crate) on: Vec<On>,
    pub(crate) every: Vec<Every>,
    pub(crate) after: Vec<After>,
    pub(crate) faults: Vec<Fault>,
    pub(crate) fault_names: &'static [&'static str],
    pub(crate) program: Option<String>,
}

/// A protocol that the tool knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// Modbus RTU.
    ModbusRtu,
    /// Modbus ASCII.
    ModbusAscii,
}

impl fmt::Debug for Description {
    /// The text that it was read from: all the rest follows from it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Description {
    /// Reads a description; `file` is for messages, `files` reads files that it names.
    ///
    /// # Errors
    /// All that is wrong with it, each with its line and key.
    pub fn parse(file: &str, text: &str, files: Files<'_>) -> Result<Arc<Self>, DescriptionError> {
        let mut places = Places::of(text);
        match toml::from_str::<Schema>(text) {
            Ok(schema) => Compiler::new(places, &schema, files)
                .compile(file)
                .map(Arc::new),
            Err(error) => {
                places.refused(&error);
                Err(places.into_error(file))
            }
        }
    }

    /// Whether `other` was read from the same text.
    pub fn is_same(&self, other: &Self) -> bool {
        self.text == other.text
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// What it is, in a line.
    pub fn about(&self) -> &str {
        &self.about
    }

    /// Documents that it was written from.
    pub fn documents(&self) -> &[String] {
        &self.documents
    }

    /// Coding of its line.
    pub const fn line(&self) -> LineConfig {
        self.line
    }

    /// Address on its wire, if it has one.
    pub const fn address(&self) -> Option<u32> {
        self.address
    }

    /// The protocol that it speaks, if the tool knows it.
    pub const fn protocol(&self) -> Option<Protocol> {
        self.protocol
    }

    /// The command of the program that is the device, if one is.
    pub fn program(&self) -> Option<&str> {
        self.program.as_deref()
    }

    /// Pause that ends a half-received frame.
    pub fn idle(&self) -> Duration {
        let idle = self.frames.0.iter().map(|frame| frame.idle);
        idle.max().unwrap_or(Duration::from_millis(50))
    }

    /// Its messages.
    pub fn messages(&self) -> &[Message] {
        &self.messages
    }

    /// Names of faults, with a line about each of its own.
    pub fn faults(&self) -> impl Iterator<Item = (&'static str, &str)> {
        self.fault_names.iter().map(|&name| {
            let own = self.faults.iter().find(|fault| fault.name == name);
            (name, own.map_or("", |fault| fault.about.as_str()))
        })
    }

    /// An empty decoder of its frames.
    pub fn cutter(&self) -> Cutter {
        cutter(self.frames.clone())
    }

    /// The frame formats that `from` sends: those that carry a message of that end, or none at all.
    pub(crate) fn frames_of(&self, from: From) -> Frames {
        self.frames.without(self.unsent(from))
    }

    /// The formats that carry messages, but none of the end `from`.
    fn unsent(&self, from: From) -> Unused {
        let is_sent = |format: usize| {
            let mut carried = self
                .messages
                .iter()
                .filter(|message| message.frame == format);
            carried.clone().next().is_none() || carried.any(|message| message.is_from(from))
        };
        let unsent = (0..self.formats()).filter(|format| !is_sent(*format));
        unsent.fold(Unused::default(), Unused::with)
    }

    /// An empty decoder of what `from` seems to have sent: formats of that end come first, others
    /// are looked for as well, as a capture may have its ends mixed up.
    pub fn cutter_for(&self, from: From) -> Cutter {
        cutter(self.frames.without(self.unsent(from).last()))
    }

    /// An empty decoder of the frames that `from` sends.
    pub fn cutter_of(&self, from: From) -> Cutter {
        cutter(self.frames_of(from))
    }

    /// Whether a silence ends the frames that a driver sends: then [`whole`](Self::whole) judges
    /// what came before it.
    pub fn ends_with_silence(&self) -> bool {
        self.frames_of(From::Host).ends_with_silence()
    }

    /// The frame that a driver sent between two silences.
    ///
    /// # Errors
    /// If it is none.
    pub fn whole(&self, bytes: &[u8]) -> Result<Frame, FrameError> {
        self.frames_of(From::Host).whole(bytes)
    }

    /// The body of a frame: what the messages see.
    pub fn body(&self, frame: &Frame) -> Option<Vec<u8>> {
        self.body_of(frame).map(Cow::into_owned)
    }

    /// As [`body`](Self::body), without a copy where that is possible.
    pub(crate) fn body_of<'a>(&self, frame: &'a Frame) -> Option<Cow<'a, [u8]>> {
        self.frames.0.get(frame.format)?.body(&frame.bytes)
    }

    /// The message of a frame that `from` sent, and its values; the first one that fits.
    pub fn message(&self, frame: &Frame, from: From) -> Option<(&Message, Record)> {
        let framing = self.frames.0.get(frame.format)?;
        let body = framing.body(&frame.bytes)?;
        let (index, record) = self.decode(frame.format, &body, from)?;
        Some((&self.messages[index], record))
    }

    pub(crate) fn decode(&self, format: usize, body: &[u8], from: From) -> Option<(usize, Record)> {
        let fitting = self.messages.iter().enumerate();
        let mut fitting =
            fitting.filter(|(_, message)| message.frame == format && message.is_from(from));
        fitting.find_map(|(index, message)| Some((index, message.decode(body)?)))
    }

    /// The frame of a message with these values; `None` if they do not fit.
    pub fn frame(&self, message: &Message, values: &Record) -> Option<Vec<u8>> {
        self.frames
            .0
            .get(message.frame)?
            .frame(&message.encode(values).bytes)
    }

    /// The frame of a body in the format with this index.
    pub fn frame_of(&self, format: usize, body: &[u8]) -> Option<Vec<u8>> {
        self.frames.0.get(format)?.frame(body)
    }

    /// How many frame formats there are.
    pub fn formats(&self) -> usize {
        self.frames.0.len()
    }

    /// Makes length and checksums fit a damaged frame again, as far as there is room.
    pub fn repair(&self, frame: &mut [u8]) {
        for framing in self.frames.0.iter() {
            framing.repair(frame);
        }
    }

    /// A frame in words.
    pub fn words(&self, frame: &Frame) -> String {
        self.words_for(frame, From::Both)
    }

    /// A frame in words that `from` seems to have sent: its messages come first.
    pub fn words_for(&self, frame: &Frame, from: From) -> String {
        let Some(body) = self.body(frame) else {
            return "no frame".to_owned();
        };
        if self.protocol.is_some() {
            return modbus::words(&body);
        }
        let own = self.decode(frame.format, &body, from);
        match own.or_else(|| self.decode(frame.format, &body, From::Both)) {
            Some((index, values)) => self.messages[index].words(&values),
            None => {
                let pairs: Vec<_> = body.iter().map(|byte| format!("{byte:02X}")).collect();
                format!("unknown message: {}", pairs.join(" "))
            }
        }
    }
}
