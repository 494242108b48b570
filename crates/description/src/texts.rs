//! Texts and byte strings of a content at their limits, for intentionally unusual inputs.

use core::ops::Range;

use crate::description::Description;
use crate::field::{self, TextEnd, TextPlace};
use crate::message::Layout;
use crate::number::Number;
use crate::schema::message::From;

/// Lengths of usual buffers, and one more: programs copy a text with its NUL into these.
const SIZES: [usize; 9] = [64, 256, 32, 16, 33, 17, 65, 128, 129];
/// Maximum length of a text where nothing else limits it.
const LONGEST: usize = 1024;

/// A content with a changed text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TextChange {
    /// The kind of the change, e.g. `unterminated-text`.
    pub kind: &'static str,
    /// The content; the lengths of the frame and of the text are right.
    pub content: Vec<u8>,
}

impl TextChange {
    /// All kinds.
    pub const KINDS: [&'static str; 5] = [
        "unterminated-text",
        "long-text",
        "longest-text",
        "not-ascii",
        "empty-text",
    ];
}

impl Description {
    /// Sound frames of the message in `content` with a text that is unterminated, as long as the
    /// frame allows, longer than usual buffers, empty, or not ASCII. The most effective changes of
    /// each text come first.
    pub fn text_changes(&self, format: usize, content: &[u8], from: From) -> Vec<TextChange> {
        let Some((body, at_of)) = self.body_places(format, content) else {
            return Vec::new();
        };
        let Some((index, _)) = self.decode(format, &body, from) else {
            return Vec::new();
        };
        let Layout::Fields(fields) = &self.messages[index].layout else {
            return Vec::new();
        };
        let places = field::texts(fields, &body);
        let places = places.iter().filter_map(|place| Text::of(place, &at_of));
        let each: Vec<Vec<TextChange>> = places
            .map(|text| self.changes_of(&text, format, content))
            .collect();
        // The first change of each text, then the second one of each.
        let most = each.iter().map(Vec::len).max().unwrap_or(0);
        let all = (0..most).flat_map(|at| each.iter().filter_map(move |of| of.get(at)));
        all.cloned().collect()
    }

    fn changes_of(&self, text: &Text, format: usize, content: &[u8]) -> Vec<TextChange> {
        let old = &content[text.range.clone()];
        let letter = old.first().copied().filter(|byte| *byte != 0);
        let letter = letter.unwrap_or(b'A');
        let grown = |len: usize| -> Vec<u8> {
            let filled = core::iter::repeat_n(letter, len.saturating_sub(old.len()));
            old.iter().copied().chain(filled).take(len).collect()
        };
        let sound = |bytes: &[u8], is_ended: bool| {
            let changed = text.changed(content, bytes, is_ended)?;
            self.finished(format, changed)
        };
        let longest = |is_ended: bool| {
            let lens = (old.len() + 1..=LONGEST).rev();
            // All limits are those of a length, so a bisection finds the longest.
            let lens: Vec<usize> = lens.collect();
            let at = lens.partition_point(|&len| sound(&grown(len), is_ended).is_none());
            lens.get(at).and_then(|&len| sound(&grown(len), is_ended))
        };
        let mut all: Vec<(&'static str, Option<Vec<u8>>)> = Vec::new();
        let is_terminated = matches!(text.end, TextEnd::Nul);
        if is_terminated {
            all.push(("unterminated-text", sound(old, false)));
        }
        all.push(("long-text", sound(&grown(SIZES[0]), true)));
        all.push(("longest-text", longest(true)));
        if text.is_text {
            let other = vec![0xE9; old.len().max(1)];
            all.push(("not-ascii", sound(&other, true)));
        }
        all.push(("empty-text", sound(&[], true)));
        if is_terminated {
            all.push(("unterminated-text", longest(false)));
        }
        let sizes = SIZES[1..].iter();
        all.extend(sizes.map(|&len| ("long-text", sound(&grown(len), true))));
        let mut found: Vec<TextChange> = Vec::new();
        for (kind, changed) in all {
            let Some(changed) = changed.filter(|changed| *changed != content) else {
                continue;
            };
            if found.iter().all(|one| one.content != changed) {
                found.push(TextChange {
                    kind,
                    content: changed,
                });
            }
        }
        found
    }

    /// `content` with its length, if a frame with it is sound.
    fn finished(&self, format: usize, mut content: Vec<u8>) -> Option<Vec<u8>> {
        self.repair_length(format, &mut content);
        self.frames.0.get(format)?.whole_frame(&content)?;
        Some(content)
    }
}

/// A text within a content.
struct Text {
    range: Range<usize>,
    end: TextEnd,
    is_text: bool,
    /// The number that counts its bytes.
    count: Option<(usize, Number)>,
}

impl Text {
    /// The text at `place` of a body; `at_of` has the position of each byte of the body.
    fn of(place: &TextPlace, at_of: &[usize]) -> Option<Self> {
        let first = at_of.get(place.at).copied();
        // A text without bytes at the end of the body.
        let first = first.or_else(|| at_of.last().map(|last| last + 1))?;
        // A text or number that encloses a hole has no single range.
        let is_whole = |at: usize, len: usize| {
            len == 0
                || at_of
                    .get(at + len - 1)
                    .is_some_and(|last| last + 1 == at_of[at] + len)
        };
        let number = |&(at, number): &(usize, Number)| {
            let is_whole = is_whole(at, number.bytes.into());
            is_whole.then(|| (at_of[at], number))
        };
        let count = match &place.count {
            Some(count) => Some(number(count)?),
            None => None,
        };
        is_whole(place.at, place.len).then_some(Self {
            range: first..first + place.len,
            end: place.end,
            is_text: place.is_text,
            count,
        })
    }

    /// `content` with these bytes as text, and with or without the end of the text.
    fn changed(&self, content: &[u8], bytes: &[u8], is_ended: bool) -> Option<Vec<u8>> {
        let mut bytes = bytes.to_vec();
        let mut behind = self.range.end;
        match self.end {
            TextEnd::Nul if is_ended => {}
            TextEnd::Nul => behind += 1,
            TextEnd::Padding if bytes.len() > self.range.len() => return None,
            TextEnd::Padding => bytes.resize(self.range.len(), 0),
            TextEnd::Count | TextEnd::Frame => {}
        }
        let mut changed = content.to_vec();
        if let Some((at, number)) = self.count {
            let most = u64::MAX >> (64 - 8 * u32::from(number.bytes));
            let len = u64::try_from(bytes.len()).ok().filter(|len| *len <= most)?;
            let mut written = Vec::new();
            number.put(len, &mut written);
            changed
                .get_mut(at..at + written.len())?
                .copy_from_slice(&written);
        }
        if behind > changed.len() {
            return None;
        }
        changed.splice(self.range.start..behind, bytes);
        Some(changed)
    }
}

/// The bytes of a body, and the position of each in the content.
pub(crate) type Body = (Vec<u8>, Vec<usize>);

impl Description {
    /// The body of a content: the bytes outside the holes, each with its position.
    pub(crate) fn body_places(&self, format: usize, content: &[u8]) -> Option<Body> {
        let framing = self.frames.0.get(format)?;
        let (mut body, mut at_of) = (Vec::new(), Vec::new());
        for (at, byte) in content.iter().enumerate() {
            let mut holes = framing.holes.iter();
            if !holes.any(|(hole, len)| (*hole..hole + len).contains(&at)) {
                body.push(*byte);
                at_of.push(at);
            }
        }
        Some((body, at_of))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::Decode as _;

    /// A device with each kind of text: ended by NUL, counted by a prefix and by a field, padded,
    /// and up to the end of the frame. The length of a frame has one byte.
    const DEVICE: &str = r#"
        name = "texts"
        about = "x"
        line = { baud = 9600 }
        frame = { sync = [0x55], length = { at = 1, type = "u8", counts = "frame" }, checksum = "sum8" }
        message = [
          { name = "named", from = "device", fields = [{ type = "u8", value = 1 }, { name = "n", type = "strz" }, { name = "v", type = "u16le" }] },
          { name = "last", from = "device", fields = [{ type = "u8", value = 2 }, { name = "n", type = "strz" }] },
          { name = "prefixed", from = "device", fields = [{ type = "u8", value = 3 }, { name = "n", type = "str", prefix = "u8" }] },
          { name = "counted", from = "device", fields = [{ type = "u8", value = 4 }, { name = "len", type = "u8" }, { name = "n", type = "str", size = "len" }] },
          { name = "padded", from = "device", fields = [{ type = "u8", value = 5 }, { name = "n", type = "str", size = 6 }] },
          { name = "rest", from = "device", fields = [{ type = "u8", value = 6 }, { name = "n", type = "str", size = "rest" }] },
        ]
        every = [{ period = "1s", send = "last" }]
        "#;

    #[test]
    fn texts_are_changed_up_to_their_limits() {
        let of = Description::parse("texts", DEVICE, &|_| Err(String::new())).expect("sound");
        let cases: [(&[u8], usize); 6] = [
            (b"\x55\x00\x01abc\0\x12\x34", 10),
            (b"\x55\x00\x02abc\0", 10),
            (b"\x55\x00\x03\x03abc", 9),
            (b"\x55\x00\x04\x03abc", 9),
            (b"\x55\x00\x05abc\0\0\0", 2),
            (b"\x55\x00\x06abc", 9),
        ];
        for (content, least) in cases {
            let mut content = content.to_vec();
            of.repair_length(0, &mut content);
            let changes = of.text_changes(0, &content, From::Device);
            assert!(changes.len() >= least, "{content:?}: {changes:?}");
            for change in &changes {
                let frame = of.assemble(0, &change.content).expect("a frame");
                let mut cutter = of.cutter();
                let found: Vec<_> = cutter.push(&frame).collect();
                assert!(matches!(found[..], [Ok(_)]), "{change:?}: {found:?}");
                assert!(TextChange::KINDS.contains(&change.kind), "{change:?}");
            }
            let kinds: Vec<_> = changes.iter().map(|one| one.kind).collect();
            let is_nul = content[2] < 3;
            assert_eq!(kinds.contains(&"unterminated-text"), is_nul, "{kinds:?}");
            let longest = changes.iter().map(|one| one.content.len()).max();
            // A frame has at most 255 bytes, of which the checksum takes one.
            let expected = if content[2] == 5 { content.len() } else { 254 };
            assert_eq!(longest, Some(expected), "{content:?}");
        }
        // By hand: the text without its NUL, the number behind it, the length less by one.
        let content = b"\x55\x0a\x01abc\0\x12\x34";
        let first = &of.text_changes(0, content, From::Device)[0];
        assert_eq!(first.kind, "unterminated-text");
        assert_eq!(first.content, b"\x55\x09\x01abc\x12\x34");
    }
}
