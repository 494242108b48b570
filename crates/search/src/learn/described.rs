//! The frame format of a description, for mutations: a content is a frame with its length field,
//! without markers, stuffing and checksums.

use std::sync::Arc;

use description::{Description, From, Message};
use protocols::Decode as _;

use super::frame_format::{FieldLimits, FrameFormat};

/// Number of examples of each message of the device.
const EXAMPLES: usize = 4;

/// The frames of the descriptions of all devices on a wire. If there are several formats, the first
/// byte of a content is the index of its format.
#[derive(Clone, Debug)]
pub(crate) struct DescribedFormat {
    /// The descriptions, each once.
    units: Vec<Arc<Description>>,
    from: From,
}

impl DescribedFormat {
    /// The format of the device's frames.
    pub(crate) fn of(description: &Arc<Description>) -> Self {
        Self {
            units: vec![description.clone()],
            from: From::Device,
        }
    }

    /// The format of the driver's frames.
    pub(crate) fn of_requests(description: &Arc<Description>) -> Self {
        Self {
            from: From::Host,
            ..Self::of(description)
        }
    }

    /// The format of the frames of several devices on a wire, or of their driver; `None` without a
    /// device.
    pub(crate) fn of_wire(descriptions: &[Arc<Description>], from: From) -> Option<Self> {
        let mut units: Vec<Arc<Description>> = Vec::new();
        for one in descriptions {
            if !units.iter().any(|unit| unit.is_same(one)) {
                units.push(one.clone());
            }
        }
        (!units.is_empty()).then_some(Self { units, from })
    }

    /// Frames that this end may send.
    pub(crate) fn examples(&self) -> Vec<Vec<u8>> {
        self.units
            .iter()
            .flat_map(|of| examples(of, self.from))
            .collect()
    }

    /// The formats of all units: each with its unit, and its index there.
    fn formats(&self) -> impl Iterator<Item = (usize, usize)> {
        let units = self.units.iter().enumerate();
        units.flat_map(|(unit, of)| (0..of.formats()).map(move |format| (unit, format)))
    }

    fn has_prefix(&self) -> bool {
        self.formats().nth(1).is_some()
    }

    /// The unit and the format of a content, and the content itself.
    fn parted<'a>(&self, content: &'a [u8]) -> (&Description, usize, &'a [u8]) {
        let (index, plain) = match content.split_first() {
            Some((first, rest)) if self.has_prefix() => (usize::from(*first), rest),
            _ => (0, content),
        };
        let index = index % self.formats().count().max(1);
        let (unit, format) = self.formats().nth(index).unwrap_or_default();
        (&self.units[unit], format, plain)
    }

    fn places(&self, content: &[u8], lengths: bool) -> Vec<FieldLimits> {
        let (of, format, plain) = self.parted(content);
        let before = content.len() - plain.len();
        let places = of.number_places(format, plain, self.from).into_iter();
        let places = places.filter(|place| place.is_length == lengths);
        let limits = places.map(|place| FieldLimits {
            range: place.range.start + before..place.range.end + before,
            values: place.values,
        });
        limits.collect()
    }

    /// The content of a frame of one unit, and whether it is a message of the unit.
    fn content_in(&self, unit: usize, frame: &[u8]) -> Option<(bool, Vec<u8>)> {
        let of = &self.units[unit];
        let mut cutter = of.cutter_for(self.from);
        let mut found: Vec<_> = cutter.push(frame).flatten().collect();
        cutter.idle();
        found.extend(cutter.push(&[]).flatten());
        let [one] = &found[..] else { return None };
        let content = of.content(one)?;
        let own = (unit, one.format);
        let index = self.formats().position(|format| format == own)?;
        let content = match self.has_prefix() {
            true => [&[u8::try_from(index).ok()?][..], &content].concat(),
            false => content,
        };
        Some((of.message(one, self.from).is_some(), content))
    }
}

/// Examples of the messages that an end may send.
fn examples(of: &Description, from: From) -> Vec<Vec<u8>> {
    let mut state = 1_u64;
    let mut choice = |below: u64| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 16) % below.max(1)
    };
    let mut frames = Vec::new();
    for message in sent(of, from) {
        for _ in 0..EXAMPLES {
            let values = message.example(&mut choice);
            frames.extend(of.frame(message, &values));
        }
    }
    frames
}

/// The messages that an end may send.
fn sent(of: &Description, from: From) -> impl Iterator<Item = &Message> {
    let other = match from {
        From::Host => From::Device,
        _ => From::Host,
    };
    let messages = of.messages().iter();
    messages.filter(move |message| message.from() != other)
}

/// Splits `chunk` into frames of a description; also returns the number of bytes in valid ones.
fn split<'a>(of: &Description, from: From, chunk: &'a [u8]) -> (usize, Vec<&'a [u8]>) {
    let mut cutter = of.cutter_for(from);
    let (mut frames, mut rest, mut from, mut valid) = (Vec::new(), chunk, 0, 0);
    for is_over in [false, true] {
        if is_over {
            cutter.idle();
        }
        while let Some(outcome) = cutter.step(&mut rest) {
            let Ok(frame) = outcome else { continue };
            let end = chunk.len() - rest.len() - cutter.pending();
            let start = end - frame.bytes.len();
            if start > from {
                frames.push(&chunk[from..start]);
            }
            frames.push(&chunk[start..end]);
            valid += end - start;
            from = end;
        }
    }
    if from < chunk.len() {
        frames.push(&chunk[from..]);
    }
    (valid, frames)
}

impl FrameFormat for DescribedFormat {
    fn split<'a>(&self, chunk: &'a [u8]) -> Vec<&'a [u8]> {
        let splits = self.units.iter().map(|of| split(of, self.from, chunk));
        // The first of those with the most bytes in frames.
        let best = splits.rev().max_by_key(|(valid, _)| *valid);
        best.map_or_else(Vec::new, |(_, frames)| frames)
    }

    fn content(&self, frame: &[u8]) -> Option<Vec<u8>> {
        let units = 0..self.units.len();
        let found = units.filter_map(|unit| self.content_in(unit, frame));
        let best = found.rev().max_by_key(|(is_message, _)| *is_message);
        best.map(|(_, content)| content)
    }

    fn frame(&self, content: &[u8], off: u64) -> Vec<u8> {
        let (of, format, plain) = self.parted(content);
        let frame = of.assemble(format, plain);
        let mut frame = frame.unwrap_or_else(|| plain.to_vec());
        if off != 0 {
            of.spoil(format, &mut frame);
        }
        frame
    }

    fn repair_lengths(&self, content: &mut [u8]) {
        let (of, format, plain) = self.parted(content);
        let before = content.len() - plain.len();
        of.repair_length(format, &mut content[before..]);
    }

    fn limits(&self, content: &[u8]) -> Vec<FieldLimits> {
        self.places(content, true)
    }

    fn fields(&self, content: &[u8]) -> Vec<FieldLimits> {
        self.places(content, false)
    }

    fn texts(&self, content: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
        let (of, format, plain) = self.parted(content);
        let before = &content[..content.len() - plain.len()];
        let changes = of.text_changes(format, plain, self.from).into_iter();
        let whole = changes.map(|change| (change.kind, [before, &change.content].concat()));
        whole.collect()
    }

    fn in_words(&self) -> String {
        let names: Vec<&str> = self.units.iter().map(|of| of.name()).collect();
        match &names[..] {
            [name] => format!("as {name} is described"),
            names => format!("as {} are described", names.join(" and ")),
        }
    }

    fn is_damaged(&self, frame: &[u8]) -> bool {
        self.content(frame).is_none()
    }

    fn is_text(&self) -> bool {
        let all = |of: &Arc<Description>| {
            let mut sent = sent(of, self.from);
            !of.messages().is_empty() && sent.all(|message| message.text().is_some())
        };
        self.units.iter().all(all)
    }
}
