use core::fmt;
use core::ops::Range;
use core::time::Duration;

use super::answers::Answers;
use super::any_decoder::{AnyDecoder, Erased, NoFrames};
use super::floor::Floor;
use super::lua::Lua;
use super::wire::{Choices, Target, Wire};
use crate::registry::Named;
use crate::rig::direction::Direction;

/// A wire format that can be recognised from its bytes: a row of the table.
///
/// [`of`](Self::of) makes a row from a [`Wire`], which is enough for `decode`, `shrink` and `fuzz`.
/// The `with_` functions add knowledge that is not in the format itself.
#[derive(Clone, Copy)]
pub struct Codec {
    name: &'static str,
    about: &'static str,
    format: Format,
    target: Target,
    idle: Duration,
    floor: Floor,
    answers: Answers,
    other_order: Option<OtherOrder>,
    figures: Option<fn(&[u8]) -> String>,
    lua: Option<Lua>,
}

/// The functions for the bytes of a row.
#[derive(Clone, Copy)]
enum Format {
    /// A format that is a type.
    Typed {
        decoder: fn() -> Box<dyn AnyDecoder>,
        repair: fn(&mut [u8]),
        build: fn(&mut Choices<'_>, &mut Vec<u8>),
        frame_at: fn(&[u8]) -> Option<usize>,
    },
    /// A format that was created while the process ran.
    Own(&'static dyn OwnFormat),
}

/// A wire format that is a value instead of a type: the format of a description.
pub trait OwnFormat: Send + Sync {
    /// A fresh decoder.
    fn decoder(&self) -> Box<dyn AnyDecoder>;

    /// A new decoder of the bytes in this direction, if the directions have different formats.
    fn decoder_towards(&self, _direction: Direction) -> Box<dyn AnyDecoder> {
        self.decoder()
    }

    /// Corrects lengths and checksum of the damaged `frame`, if it still has room for them.
    fn repair(&self, frame: &mut [u8]);

    /// Appends a valid frame, made of `choices`, to `out`.
    fn build(&self, choices: &mut Choices<'_>, out: &mut Vec<u8>);

    /// The same format with the bytes of its checksums swapped, if it has checksums of several
    /// bytes.
    fn other_order(&self) -> Option<Box<dyn OwnFormat>> {
        None
    }

    /// How pauses of the line affect the frames.
    fn pause(&self) -> Pause {
        Pause::Discards
    }

    /// The names of the values of a field; `None` if it can have other values.
    fn names_of_field(&self, _field: &str) -> Option<Vec<&str>> {
        None
    }

    /// Names of the fields that frames in this direction have; `None` if they are not known, or the
    /// same as the [vocabulary](Self::vocabulary).
    fn field_names(&self, _direction: Direction) -> Option<Vec<&str>> {
        None
    }

    /// All words, without numbers, that the printed frames of this direction can contain. `None` if
    /// a frame can have other names or contain any text; with `beside_texts`, texts are ignored.
    fn vocabulary(&self, _direction: Direction, _beside_texts: bool) -> Option<Vec<&str>> {
        None
    }
}

/// How a pause of the line affects the frames of a format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pause {
    /// A pause only discards a partial frame: its bytes tell the length of each frame.
    Discards,
    /// A pause ends only those frames whose bytes do not tell their length.
    EndsUnknown,
    /// Only a pause shows the end of some formats.
    Ends,
}

/// Idle time after which a partial frame is discarded, unless a row sets its own: longer than any
/// gap that a device leaves inside a frame.
pub const IDLE: Duration = Duration::from_millis(50);

/// The same format with the bytes of its checksum swapped.
#[derive(Clone, Copy, Debug)]
pub enum OtherOrder {
    /// Devices with either order exist. Only the program that expects one order shows which one is
    /// wrong.
    Row(&'static Codec),
    /// Test for swapped checksums, which no device sends: counts of frames whose checksum is valid
    /// with swapped bytes, and in the right order.
    Wrong(fn(&[u8]) -> [u64; 2]),
}

impl Codec {
    /// The row of `W`; the help of commands prints `about`.
    pub const fn of<W: Wire + 'static>(about: &'static str) -> Self {
        Self {
            format: Format::Typed {
                decoder: || Box::new(Erased::<W>::new()),
                repair: W::repair,
                build: W::build,
                frame_at: W::frame_at,
            },
            ..Self::plain(W::NAME, about, Target::of::<W>())
        }
    }

    /// The row of a format that is a value; it has no fuzz target.
    pub const fn own(
        name: &'static str,
        about: &'static str,
        format: &'static dyn OwnFormat,
    ) -> Self {
        Self {
            format: Format::Own(format),
            ..Self::plain(name, about, Target::bytes(name))
        }
    }

    const fn plain(name: &'static str, about: &'static str, target: Target) -> Self {
        Self {
            name,
            about,
            format: Format::Typed {
                decoder: || Box::new(NoFrames),
                repair: |_| {},
                build: |_, _| {},
                frame_at: |_| None,
            },
            target,
            idle: IDLE,
            floor: Floor::CHECKED,
            answers: Answers::PLAIN,
            other_order: None,
            figures: None,
            lua: None,
        }
    }

    /// Whether the format is a value instead of a type.
    pub const fn is_own(&self) -> bool {
        matches!(self.format, Format::Own(_))
    }

    /// Sets the name of the row in `hilrig fuzz` and of its corpus.
    #[must_use]
    pub const fn fuzzed_as(mut self, name: &'static str) -> Self {
        self.target.name = name;
        self
    }

    /// Sets the number of cases that a fuzzer tries in one round.
    #[must_use]
    pub const fn with_round(mut self, cases: u64) -> Self {
        self.target.round = cases;
        self
    }

    /// Sets the idle time after which a partial frame is discarded.
    #[must_use]
    pub const fn with_idle(mut self, idle: Duration) -> Self {
        self.idle = idle;
        self
    }

    /// Sets the minimum evidence for recognising the format; without a checksum, it must be much
    /// larger than [`Floor::CHECKED`].
    #[must_use]
    pub const fn with_floor(mut self, floor: Floor) -> Self {
        self.floor = floor;
        self
    }

    /// Sets how the answers of a program are distinguished.
    #[must_use]
    pub const fn with_answers(mut self, answers: Answers) -> Self {
        self.answers = answers;
        self
    }

    /// Sets the test for a swapped checksum for `decode --diagnose`.
    #[must_use]
    pub const fn with_other_order(mut self, other: OtherOrder) -> Self {
        self.other_order = Some(other);
        self
    }

    /// Adds figures of a whole stream, for `decode --summary`: lines without a line end.
    #[must_use]
    pub const fn with_figures(mut self, figures: fn(&[u8]) -> String) -> Self {
        self.figures = Some(figures);
        self
    }

    /// Adds the row's part of the dissector.
    #[must_use]
    pub const fn with_lua(mut self, lua: Lua) -> Self {
        self.lua = Some(lua);
        self
    }

    /// Name as on the command line.
    pub const fn name(&self) -> &'static str {
        self.name
    }

    /// One-line description.
    pub const fn about(&self) -> &'static str {
        self.about
    }

    /// The fuzz target for `hilrig fuzz`.
    pub const fn target(&self) -> &Target {
        &self.target
    }

    /// Idle time after which a partial frame is discarded.
    pub const fn idle(&self) -> Duration {
        self.idle
    }

    /// Whether a pause of this length in the output of a program ends a frame. It never does if the
    /// bytes tell the length of each frame: a stalled line may split such a frame.
    pub fn is_ended_by(&self, pause: Duration) -> bool {
        self.pause() != Pause::Discards && pause > self.idle
    }

    /// How pauses of the line affect the frames.
    pub fn pause(&self) -> Pause {
        match self.format {
            Format::Own(format) => format.pause(),
            Format::Typed { .. } => Pause::Discards,
        }
    }

    /// Minimum share of bytes in frames for a guess of this format, per cent.
    pub const fn least_share(&self) -> u8 {
        self.floor.share
    }

    /// The minimum evidence for recognising the format.
    pub const fn floor(&self) -> &Floor {
        &self.floor
    }

    /// The method of distinguishing answers.
    pub const fn answers(&self) -> &Answers {
        &self.answers
    }

    /// The other byte order of the checksum, if the tool distinguishes it.
    pub const fn other_order(&self) -> Option<OtherOrder> {
        self.other_order
    }

    /// The same format with the bytes of its checksums swapped, if the format is a value that knows
    /// it. Like all rows, it exists until the process ends.
    pub fn own_other_order(&self) -> Option<&'static Self> {
        let Format::Own(format) = self.format else {
            return None;
        };
        let other: &'static dyn OwnFormat = Box::leak(format.other_order()?);
        let row = Self::own(self.name, self.about, other).with_idle(self.idle);
        Some(Box::leak(Box::new(row)))
    }

    /// The names of the values of a field; `None` if it can have other values or if its values are
    /// unknown.
    pub fn names_of_field(&self, field: &str) -> Option<Vec<&'static str>> {
        match self.format {
            Format::Typed { .. } => None,
            Format::Own(format) => format.names_of_field(field),
        }
    }

    /// As [`OwnFormat::field_names`]; without such names, the [vocabulary](OwnFormat::vocabulary)
    /// without texts. `None` for a built-in format.
    pub fn field_names(&self, towards: Direction) -> Option<Vec<&'static str>> {
        let Format::Own(format) = self.format else {
            return None;
        };
        let own = format.field_names(towards);
        own.or_else(|| format.vocabulary(towards, true))
    }

    /// As [`OwnFormat::vocabulary`]; `None` for a built-in format.
    pub fn vocabulary(&self, towards: Direction, beside_texts: bool) -> Option<Vec<&'static str>> {
        match self.format {
            Format::Typed { .. } => None,
            Format::Own(format) => format.vocabulary(towards, beside_texts),
        }
    }

    /// Its part of the dissector, if it has one.
    pub const fn lua(&self) -> Option<&Lua> {
        self.lua.as_ref()
    }

    /// Corrects lengths and checksum of the damaged or cut `frame`, if it still has room for them.
    pub fn repair(&self, frame: &mut [u8]) {
        match self.format {
            Format::Typed { repair, .. } => repair(frame),
            Format::Own(format) => format.repair(frame),
        }
    }

    /// Appends a valid frame, made of `choices`, to `out`.
    pub fn build(&self, choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        match self.format {
            Format::Typed { build, .. } => build(choices, out),
            Format::Own(format) => format.build(choices, out),
        }
    }

    /// The length of the frame at the start of `bytes`, by the slow reference decoder of the
    /// format.
    pub fn frame_at(&self, bytes: &[u8]) -> Option<usize> {
        match self.format {
            Format::Typed { frame_at, .. } => frame_at(bytes),
            Format::Own(format) => {
                let (mut decoder, mut rest) = (format.decoder(), bytes);
                let first = decoder.step(&mut rest)?.ok()?;
                let end = bytes.len() - rest.len() - decoder.pending();
                (end == first).then_some(first)
            }
        }
    }

    /// Figures of a whole stream, lines without a line end, if the format has figures.
    pub fn figures(&self, bytes: &[u8]) -> Option<String> {
        self.figures.map(|figures| figures(bytes))
    }

    /// Number of bytes in valid frames.
    pub fn framed(&self, bytes: &[u8]) -> u64 {
        len_of(&self.frames(bytes))
    }

    /// As [`framed`](Self::framed), for bytes in this direction.
    pub fn framed_towards(&self, bytes: &[u8], direction: Direction) -> u64 {
        len_of(&self.frames_towards(bytes, direction))
    }

    /// Positions of the valid frames in `bytes`.
    pub fn frames(&self, bytes: &[u8]) -> Vec<Range<u64>> {
        frames_if(self.decoder(), bytes, |_| true)
    }

    /// As [`frames`](Self::frames), for bytes in this direction.
    pub fn frames_towards(&self, bytes: &[u8], direction: Direction) -> Vec<Range<u64>> {
        frames_if(self.decoder_towards(direction), bytes, |_| true)
    }

    /// Byte ranges of the valid frames in `bytes` with plausible values.
    pub fn plausible_frames(&self, bytes: &[u8]) -> Vec<Range<u64>> {
        frames_if(self.decoder(), bytes, |decoder| decoder.is_plausible())
    }

    pub(super) fn decoder(&self) -> Box<dyn AnyDecoder> {
        match self.format {
            Format::Typed { decoder, .. } => decoder(),
            Format::Own(format) => format.decoder(),
        }
    }

    pub(super) fn decoder_towards(&self, direction: Direction) -> Box<dyn AnyDecoder> {
        match self.format {
            Format::Typed { decoder, .. } => decoder(),
            Format::Own(format) => format.decoder_towards(direction),
        }
    }
}

fn len_of(frames: &[Range<u64>]) -> u64 {
    frames.iter().map(|one| one.end - one.start).sum()
}

fn frames_if(
    mut decoder: Box<dyn AnyDecoder>,
    bytes: &[u8],
    is: fn(&dyn AnyDecoder) -> bool,
) -> Vec<Range<u64>> {
    let (mut frames, mut rest) = (Vec::new(), bytes);
    for is_over in [false, true] {
        if is_over {
            decoder.idle();
        }
        while let Some(outcome) = decoder.step(&mut rest) {
            if let Ok(len) = outcome
                && is(&*decoder)
            {
                let end = (bytes.len() - rest.len() - decoder.pending()) as u64;
                frames.push(end - len as u64..end);
            }
        }
    }
    frames
}

impl Named for Codec {
    fn name(&self) -> &str {
        self.name
    }
}

/// Names are unique, so they identify rows.
impl PartialEq for Codec {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Codec {}

impl fmt::Debug for Codec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Codec({})", self.name)
    }
}
