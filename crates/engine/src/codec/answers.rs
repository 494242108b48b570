//! How a fuzzer tells the answers of a program apart.

/// How a fuzzer distinguishes the answers of a program, and which requests are worth sending.
#[derive(Clone, Copy, Debug)]
pub struct Answers {
    /// Positions of the bytes that select the kind of a frame.
    pub kind: fn(&[u8]) -> &[u8],
    /// Number of bytes before a frame's payload.
    pub head: usize,
    /// Whether a frame reports that another one was bad.
    pub is_refusal: fn(&[u8]) -> bool,
    /// Range of each of the first [`Choices`](super::wire::Choices) of a frame that is likely to be
    /// answered: the minimum value, and the number of values from there on. Half of the requests
    /// are built from such choices.
    pub likely: &'static [(u8, u8)],
}

impl Answers {
    /// All frames have one kind, and no frame is a refusal.
    pub const PLAIN: Self = Self {
        kind: |frame| frame.get(..1).unwrap_or(frame),
        head: 1,
        is_refusal: |_| false,
        likely: &[],
    };
}
