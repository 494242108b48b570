//! A description that has been read and checked.

use core::fmt;
use core::time::Duration;
use std::borrow::Cow;
use std::sync::Arc;

use protocols::{Decode as _, FrameError, LineConfig};

use crate::behaviour::{After, Every, Fault, On, Trigger};
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

/// A description that was read and found valid. Devices and decoders share it.
#[derive(Clone)]
pub struct Description {
    /// The source text of the description.
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

/// A built-in protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// Modbus RTU.
    ModbusRtu,
    /// Modbus ASCII.
    ModbusAscii,
}

impl fmt::Debug for Description {
    /// Prints the source text: all other fields follow from it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Description {
    /// Reads a description; `file` is used in error messages, `files` reads files that the text
    /// names.
    ///
    /// # Errors
    /// If the text is not a description; lists all problems, each with line and key.
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

    /// Whether `self` and `other` have the same source text.
    pub fn is_same(&self, other: &Self) -> bool {
        self.text == other.text
    }

    /// The name of the device.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// A description of the device in one line.
    pub fn about(&self) -> &str {
        &self.about
    }

    /// Documents on which the description is based.
    pub fn documents(&self) -> &[String] {
        &self.documents
    }

    /// Coding of the device's line.
    pub const fn line(&self) -> LineConfig {
        self.line
    }

    /// The address on the wire, if the device has one.
    pub const fn address(&self) -> Option<u32> {
        self.address
    }

    /// The same device with another address.
    ///
    /// # Errors
    /// If the device has no address, or not this one.
    pub fn with_address(self: &Arc<Self>, address: u32) -> Result<Arc<Self>, String> {
        if self.address.is_none() && self.protocol.is_none() {
            return Err(format!("{} has no address", self.name));
        }
        self.check_address(address)?;
        let address = Some(address);
        let other = Self::clone(self);
        Ok(Arc::new(Self { address, ..other }))
    }

    /// Checks that a device of this protocol can answer at `address`.
    ///
    /// # Errors
    /// If the protocol excludes the address; with the reason and the allowed addresses.
    pub fn check_address(&self, address: u32) -> Result<(), String> {
        self.protocol
            .map_or(Ok(()), |_| modbus::check_address(address))
    }

    /// The same device with the bytes of each checksum swapped; `None` if no checksum has several
    /// bytes.
    pub fn with_swapped_checksums(&self) -> Option<Arc<Self>> {
        let mut formats = self.frames.0.as_ref().clone();
        let mut is_other = false;
        for framing in &mut formats {
            for check in framing.checks.iter_mut().filter(|check| check.width > 1) {
                check.is_little = !check.is_little;
                is_other = true;
            }
            // Computed from the checksums; frames are judged without it, too.
            framing.plain = None;
        }
        let frames = self.frames.with_formats(Arc::new(formats));
        let other = Self::clone(self);
        is_other.then(|| Arc::new(Self { frames, ..other }))
    }

    /// The protocol, if it is a built-in one.
    pub const fn protocol(&self) -> Option<Protocol> {
        self.protocol
    }

    /// The command line of the program that implements the device, if there is one.
    pub fn program(&self) -> Option<&str> {
        self.program.as_deref()
    }

    /// Idle time after which a partial frame is discarded.
    pub fn idle(&self) -> Duration {
        let idle = self.frames.0.iter().map(|frame| frame.idle);
        idle.max().unwrap_or(Duration::from_millis(50))
    }

    /// The messages of the device.
    pub fn messages(&self) -> &[Message] {
        &self.messages
    }

    /// The names of all faults; a fault of the description has a one-line text, a common fault has
    /// none.
    pub fn faults(&self) -> impl Iterator<Item = (&'static str, &str)> {
        self.fault_names.iter().map(|&name| {
            let own = self.faults.iter().find(|fault| fault.name == name);
            (name, own.map_or("", |fault| fault.about.as_str()))
        })
    }

    /// Whether the key `factor` of a scenario changes the effect of this fault.
    pub(crate) fn takes_figure(&self, fault: &str) -> bool {
        let own = self.faults.iter().find(|own| own.name == fault);
        own.map_or(matches!(fault, "wrong" | "slow"), |own| {
            let mut set = own.set.iter();
            set.any(|(_, expr)| expr.names().contains(&"factor"))
        })
    }

    /// Whether the device measures this variable, as far as the description shows: it has a source,
    /// or a unit and no request sets it.
    pub(crate) fn is_reading(&self, index: usize) -> bool {
        let variable = &self.variables[index];
        if variable.is_measured() {
            return true;
        }
        let mut on = self.on.iter();
        let is_set = on.any(|on| {
            !matches!(on.trigger, Trigger::Event(_))
                && on.deed.set.iter().any(|(set, _)| *set == index)
        });
        let mut cells = self.registers.iter().flat_map(Registers::cells);
        let is_written = cells.any(|cell| cell.is_writable && cell.variable == index);
        !variable.unit.is_empty() && !is_set && !is_written
    }

    /// An empty decoder of the device's frames.
    pub fn cutter(&self) -> Cutter {
        cutter(self.frames.clone())
    }

    /// The frame formats that `from` uses: those with a message of that end, or without any
    /// message.
    pub(crate) fn frames_of(&self, from: From) -> Frames {
        self.frames.without(self.unsent(from)).sent_by(from)
    }

    /// The formats with messages of the other end only.
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

    /// An empty decoder of bytes that `from` probably sent. It tries the formats of that end first,
    /// then all others, because a capture may have mixed up its ends.
    pub fn cutter_for(&self, from: From) -> Cutter {
        let frames = self.frames.without(self.unsent(from).last());
        cutter(frames.sent_by(from))
    }

    /// An empty decoder of the frames that `from` sends.
    pub fn cutter_of(&self, from: From) -> Cutter {
        cutter(self.frames_of(from))
    }

    /// Whether a silence ends the driver's frames: [`whole`](Self::whole) then decodes the bytes
    /// before the silence.
    pub fn ends_with_silence(&self) -> bool {
        self.frames_of(From::Host).ends_with_silence()
    }

    /// Whether only a silence shows the end of the frames of a format.
    pub fn needs_silence(&self) -> bool {
        self.frames.ends_with_unknown_silence()
    }

    /// Whether a silence ends the frames of a format whose length their bytes may not tell.
    pub fn may_need_silence(&self) -> bool {
        self.frames.ends_with_silence()
    }

    /// The number of frames of a driver that follow each other without the silence that ends a
    /// frame, if `bytes` are several frames and nothing else.
    pub fn without_pause(&self, bytes: &[u8]) -> Option<usize> {
        self.protocol?;
        let mut cutter = self.cutter_of(From::Host);
        let mut all = Vec::new();
        all.extend(cutter.push(bytes));
        cutter.idle();
        all.extend(cutter.push(&[]));
        (all.len() > 1 && all.iter().all(Result::is_ok)).then_some(all.len())
    }

    /// Decodes the bytes that a driver sent between two silences as one frame.
    ///
    /// # Errors
    /// If the bytes are not one frame.
    pub fn whole(&self, bytes: &[u8]) -> Result<Frame, FrameError> {
        self.frames_of(From::Host).whole(bytes)
    }

    /// The body of a frame: the bytes that messages decode.
    pub fn body(&self, frame: &Frame) -> Option<Vec<u8>> {
        self.body_of(frame).map(Cow::into_owned)
    }

    /// Like [`body`](Self::body), without a copy where possible.
    pub(crate) fn body_of<'a>(&self, frame: &'a Frame) -> Option<Cow<'a, [u8]>> {
        self.frames.0.get(frame.format)?.body(&frame.bytes)
    }

    /// The first message that fits a frame sent by `from`, and its values.
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

    /// The frame of a message with these values; `None` if the values do not fit.
    pub fn frame(&self, message: &Message, values: &Record) -> Option<Vec<u8>> {
        self.frames
            .0
            .get(message.frame)?
            .frame(&message.encode(values).bytes)
    }

    /// The frame of a body in the format with the index `format`.
    pub fn frame_of(&self, format: usize, body: &[u8]) -> Option<Vec<u8>> {
        self.frames.0.get(format)?.frame(body)
    }

    /// The number of frame formats.
    pub fn formats(&self) -> usize {
        self.frames.0.len()
    }

    /// Corrects the length and the checksums of a damaged frame where they fit into it.
    pub fn repair(&self, frame: &mut [u8]) {
        for framing in self.frames.0.iter() {
            framing.repair(frame);
        }
    }

    /// Describes a frame in words.
    pub fn words(&self, frame: &Frame) -> String {
        self.words_for(frame, From::Both)
    }

    /// Describes in words a frame that `from` probably sent: messages of that end are tried first.
    pub fn words_for(&self, frame: &Frame, from: From) -> String {
        let Some(body) = self.body(frame) else {
            return "no frame".to_owned();
        };
        if self.protocol.is_some() {
            return modbus::words(&body, from);
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
