//! Decoders of frames of any type, behind one interface.

use protocols::{Decode, FrameError};

use super::wire::Wire;

/// A decoder of frames of any type. It gives their length, or their text on request.
pub trait AnyDecoder: Send {
    /// Like [`Decode::step`], with the frame's length.
    fn step(&mut self, input: &mut &[u8]) -> Option<Result<usize, FrameError>>;
    /// The last frame as text.
    fn words(&self) -> String;
    /// Whether the values of the last frame are possible.
    fn is_plausible(&self) -> bool {
        true
    }
    /// Like [`Decode::idle`].
    fn idle(&mut self);
    /// Like [`Decode::pending`].
    fn pending(&self) -> usize;
    /// Takes bytes of the other direction, in their order of time: a request can determine the
    /// names of the fields in its reply.
    fn beside(&mut self, _bytes: &[u8]) {}
    /// A copy with the same state.
    fn copy(&self) -> Box<dyn AnyDecoder>;
}

impl Clone for Box<dyn AnyDecoder> {
    fn clone(&self) -> Self {
        (**self).copy()
    }
}

/// The decoder of a row without a format.
pub(super) struct NoFrames;

impl AnyDecoder for NoFrames {
    fn step(&mut self, input: &mut &[u8]) -> Option<Result<usize, FrameError>> {
        *input = &[];
        None
    }

    fn words(&self) -> String {
        String::new()
    }

    fn idle(&mut self) {}

    fn pending(&self) -> usize {
        0
    }

    fn copy(&self) -> Box<dyn AnyDecoder> {
        Box::new(Self)
    }
}

/// The decoder of a type.
pub(super) struct Erased<W: Wire> {
    decoder: W::Decoder,
    last: Option<<W::Decoder as Decode>::Frame>,
}

impl<W: Wire> Erased<W> {
    pub(super) fn new() -> Self {
        let decoder = W::decoder();
        let last = None;
        Self { decoder, last }
    }
}

impl<W: Wire + 'static> AnyDecoder for Erased<W> {
    fn step(&mut self, input: &mut &[u8]) -> Option<Result<usize, FrameError>> {
        let outcome = self.decoder.step(input)?;
        Some(outcome.map(|frame| W::bytes(self.last.insert(frame)).len()))
    }

    fn words(&self) -> String {
        self.last.as_ref().map(W::words).unwrap_or_default()
    }

    fn is_plausible(&self) -> bool {
        self.last.as_ref().is_some_and(W::is_plausible)
    }

    fn idle(&mut self) {
        self.decoder.idle();
    }

    fn pending(&self) -> usize {
        self.decoder.pending()
    }

    fn copy(&self) -> Box<dyn AnyDecoder> {
        let (decoder, last) = (self.decoder.clone(), self.last.clone());
        Box::new(Self { decoder, last })
    }
}
