//! The frame format of a description, for mutations: a content is a frame with its length field,
//! without markers, stuffing and checksums.

use std::sync::Arc;

use description::{Description, From};
use protocols::Decode as _;

use super::frame_format::{FieldLimits, FrameFormat};

/// Number of examples of each message of the device.
const EXAMPLES: usize = 4;

/// The frames of a description. If there are several formats, the first byte of a content is the
/// index of its format.
#[derive(Clone, Debug)]
pub(crate) struct DescribedFormat(Arc<Description>, From);

impl DescribedFormat {
    /// The format of the device's frames.
    pub(crate) fn of(description: &Arc<Description>) -> Self {
        Self(description.clone(), From::Device)
    }

    /// The format of the driver's frames.
    pub(crate) fn of_requests(description: &Arc<Description>) -> Self {
        Self(description.clone(), From::Host)
    }

    /// Frames that this end may send.
    pub(crate) fn examples(&self) -> Vec<Vec<u8>> {
        let mut state = 1_u64;
        let mut choice = |below: u64| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 16) % below.max(1)
        };
        let messages = self.0.messages().iter();
        let other = match self.1 {
            From::Host => From::Device,
            _ => From::Host,
        };
        let messages = messages.filter(|message| message.from() != other);
        let mut frames = Vec::new();
        for message in messages {
            for _ in 0..EXAMPLES {
                let values = message.example(&mut choice);
                frames.extend(self.0.frame(message, &values));
            }
        }
        frames
    }

    fn has_prefix(&self) -> bool {
        self.0.formats() > 1
    }

    /// The format of a content, and the content itself.
    fn parted<'a>(&self, content: &'a [u8]) -> (usize, &'a [u8]) {
        match content.split_first() {
            Some((first, rest)) if self.has_prefix() => {
                (usize::from(*first) % self.0.formats(), rest)
            }
            _ => (0, content),
        }
    }

    fn places(&self, content: &[u8], lengths: bool) -> Vec<FieldLimits> {
        let (format, plain) = self.parted(content);
        let before = content.len() - plain.len();
        let places = self.0.number_places(format, plain, self.1).into_iter();
        let places = places.filter(|place| place.is_length == lengths);
        let limits = places.map(|place| FieldLimits {
            range: place.range.start + before..place.range.end + before,
            values: place.values,
        });
        limits.collect()
    }
}

impl FrameFormat for DescribedFormat {
    fn split<'a>(&self, chunk: &'a [u8]) -> Vec<&'a [u8]> {
        let mut cutter = self.0.cutter_for(self.1);
        let (mut frames, mut rest, mut from) = (Vec::new(), chunk, 0);
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
                from = end;
            }
        }
        if from < chunk.len() {
            frames.push(&chunk[from..]);
        }
        frames
    }

    fn content(&self, frame: &[u8]) -> Option<Vec<u8>> {
        let mut cutter = self.0.cutter_for(self.1);
        let mut found: Vec<_> = cutter.push(frame).flatten().collect();
        cutter.idle();
        found.extend(cutter.push(&[]).flatten());
        let [one] = &found[..] else { return None };
        let content = self.0.content(one)?;
        Some(match self.has_prefix() {
            true => [&[u8::try_from(one.format).ok()?][..], &content].concat(),
            false => content,
        })
    }

    fn frame(&self, content: &[u8], off: u64) -> Vec<u8> {
        let (format, plain) = self.parted(content);
        let frame = self.0.assemble(format, plain);
        let mut frame = frame.unwrap_or_else(|| plain.to_vec());
        if off != 0 {
            self.0.spoil(format, &mut frame);
        }
        frame
    }

    fn repair_lengths(&self, content: &mut [u8]) {
        let (format, plain) = self.parted(content);
        let before = content.len() - plain.len();
        self.0.repair_length(format, &mut content[before..]);
    }

    fn limits(&self, content: &[u8]) -> Vec<FieldLimits> {
        self.places(content, true)
    }

    fn fields(&self, content: &[u8]) -> Vec<FieldLimits> {
        self.places(content, false)
    }

    fn texts(&self, content: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
        let (format, plain) = self.parted(content);
        let before = &content[..content.len() - plain.len()];
        let changes = self.0.text_changes(format, plain, self.1).into_iter();
        let whole = changes.map(|change| (change.kind, [before, &change.content].concat()));
        whole.collect()
    }

    fn in_words(&self) -> String {
        format!("as {} is described", self.0.name())
    }

    fn is_damaged(&self, frame: &[u8]) -> bool {
        self.content(frame).is_none()
    }

    fn is_text(&self) -> bool {
        let messages = self.0.messages();
        let other = match self.1 {
            From::Host => From::Device,
            _ => From::Host,
        };
        let mut told = messages.iter().filter(|message| message.from() != other);
        !messages.is_empty() && told.all(|message| message.text().is_some())
    }
}
