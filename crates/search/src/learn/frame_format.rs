//! What a mutation needs to know of a frame format, learned from bytes or taken from a description.

/// A frame format as mutations see it. A *content* is a frame without its end, its stuffing and its
/// checksum: changed contents become frames again whose checksum holds.
pub(crate) trait FrameFormat: core::fmt::Debug + Send + Sync {
    /// Splits `chunk` into frames; what is behind the last one is a frame too.
    fn split<'a>(&self, chunk: &'a [u8]) -> Vec<&'a [u8]>;

    /// The content of `frame`; `None` if that is no frame of this format.
    fn content(&self, frame: &[u8]) -> Option<Vec<u8>>;

    /// The frame of `content`. Its checksum is changed by `off`, if it has one: 0 for a sound
    /// frame.
    fn frame(&self, content: &[u8], off: u64) -> Vec<u8>;

    /// Writes how long `content` is into it.
    fn repair_lengths(&self, content: &mut [u8]);

    /// The places of numbers in `content`, each with values at which a program may fail; empty: any
    /// place may be a number.
    fn limits(&self, content: &[u8]) -> Vec<FieldLimits>;

    /// The places of known fields in `content`, each with values at and beyond its limits.
    fn fields(&self, _content: &[u8]) -> Vec<FieldLimits> {
        Vec::new()
    }

    /// The format in words.
    fn in_words(&self) -> String;

    /// Whether contents are text.
    fn is_text(&self) -> bool;
}

/// A number in a content, and values to be tried there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FieldLimits {
    /// Its place.
    pub(crate) range: core::ops::Range<usize>,
    /// The values, as bytes.
    pub(crate) values: Vec<Vec<u8>>,
}
