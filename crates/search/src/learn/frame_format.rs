//! The properties of a frame format that mutations need, learned from bytes or taken from a
//! description.

/// A frame format for mutations. A *content* is a frame without end marker, stuffing and checksum;
/// a changed content can become a frame with a correct checksum again.
pub(crate) trait FrameFormat: core::fmt::Debug + Send + Sync {
    /// Splits `chunk` into frames; bytes behind the last frame count as a frame too.
    fn split<'a>(&self, chunk: &'a [u8]) -> Vec<&'a [u8]>;

    /// The content of `frame`; `None` if `frame` does not have this format.
    fn content(&self, frame: &[u8]) -> Option<Vec<u8>>;

    /// The frame of `content`. Its checksum is changed by `off`, if it has one; 0 gives an intact
    /// frame.
    fn frame(&self, content: &[u8], off: u64) -> Vec<u8>;

    /// Writes the correct length into `content`.
    fn repair_lengths(&self, content: &mut [u8]);

    /// The positions of lengths in `content` with test values; empty: any position may hold a
    /// number.
    fn limits(&self, content: &[u8]) -> Vec<FieldLimits>;

    /// The positions of known fields in `content`, with values at and beyond their limits.
    fn fields(&self, _content: &[u8]) -> Vec<FieldLimits> {
        Vec::new()
    }

    /// Contents with a text of `content` at a limit, each with the kind of its change.
    fn texts(&self, _content: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
        Vec::new()
    }

    /// The format in words.
    fn in_words(&self) -> String;

    /// Whether `frame` is certainly no valid frame: a guessed checksum is no evidence.
    fn is_damaged(&self, frame: &[u8]) -> bool;

    /// Whether contents are text.
    fn is_text(&self) -> bool;
}

/// A number in a content with test values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FieldLimits {
    /// The position of the number.
    pub(crate) range: core::ops::Range<usize>,
    /// The values, as bytes.
    pub(crate) values: Vec<Vec<u8>>,
}
