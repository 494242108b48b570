//! The laws of a decoder on one stream. They allocate nothing, so that millions of streams a second
//! can be judged.

use protocols::Decode;

use super::{Broken, Piece, Stream, Wire, kind_of};

/// A decoder with all its output.
struct Listener<W: Wire> {
    decoder: W::Decoder,
    pushed: usize,
    framed: usize,
    /// FNV-1a over frames and errors, in order.
    said: u64,
}

impl<W: Wire> Listener<W> {
    fn new() -> Self {
        Self {
            decoder: W::decoder(),
            pushed: 0,
            framed: 0,
            said: 0xCBF2_9CE4_8422_2325,
        }
    }

    fn discarded(&self) -> usize {
        usize::try_from(self.decoder.discarded()).unwrap_or(usize::MAX)
    }

    fn note(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.said = (self.said ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
        }
    }

    /// Takes the next piece of `all`, after the first `self.pushed` bytes. Calls `each` with each
    /// frame and its start.
    fn receive(
        &mut self,
        mut piece: &[u8],
        mut each: impl FnMut(usize, &<W::Decoder as Decode>::Frame) -> Result<(), Broken>,
    ) -> Result<(), Broken> {
        self.pushed += piece.len();
        while let Some(outcome) = self.decoder.step(&mut piece) {
            match outcome {
                Ok(frame) => {
                    let bytes = W::bytes(&frame);
                    each(self.framed + self.discarded(), &frame)?;
                    self.framed += bytes.len();
                    let head = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
                    self.note(&head.to_le_bytes());
                    self.note(bytes);
                }
                Err(error) => self.note(&[kind_of(error)]),
            }
        }
        let (framed, discarded) = (self.framed, self.discarded());
        let pending = self.decoder.pending();
        if framed + discarded + pending != self.pushed {
            let detail = format!(
                "{} bytes pushed, {framed} in frames, {discarded} discarded, {pending} pending",
                self.pushed
            );
            return Err(Broken::new("bytes-are-accounted-for", detail));
        }
        Ok(())
    }
}

/// Whether the decoder of `W` keeps its laws on `stream`:
///
/// - every byte is in a frame, discarded or pending;
/// - a frame equals the bytes at its position on the wire, is a frame by the slow method too, and
///   is equal again when rebuilt from its parts;
/// - no frame is discarded, see [`Wire::unmistakable_at`];
/// - the split into pieces changes no result;
/// - after a pause nothing is pending.
pub fn keeps_the_laws<W: Wire>(stream: &Stream) -> Result<(), Broken> {
    let mut whole = Listener::<W>::new();
    let mut from = 0;
    for stretch in stream.stretches() {
        judge_stretch(&mut whole, stretch, from)?;
        from += stretch.len();
    }
    let mut pieces = Listener::<W>::new();
    for piece in stream.pieces() {
        match piece {
            Piece::Bytes(bytes) => pieces.receive(bytes, |_, _| Ok(()))?,
            Piece::Idle => {
                pieces.decoder.idle();
                pieces.receive(&[], |_, _| Ok(()))?;
            }
        }
    }
    pieces.decoder.idle();
    pieces.receive(&[], |_, _| Ok(()))?;
    let seen = |one: &Listener<W>| (one.said, one.framed, one.discarded());
    if seen(&pieces) != seen(&whole) {
        let detail = format!(
            "in pieces {} bytes in frames and {} discarded, at once {} and {}",
            pieces.framed,
            pieces.discarded(),
            whole.framed,
            whole.discarded()
        );
        return Err(Broken::new("pieces-change-nothing", detail));
    }
    Ok(())
}

/// Decodes `stretch`, which begins at byte `from` of its stream and ends with a pause.
fn judge_stretch<W: Wire>(
    listener: &mut Listener<W>,
    stretch: &[u8],
    from: usize,
) -> Result<(), Broken> {
    // End of the last frame: the bytes between it and the next frame were discarded.
    let mut end = 0;
    let mut each = |at: usize, frame: &<W::Decoder as Decode>::Frame| {
        let bytes = W::bytes(frame);
        let at = at.checked_sub(from).unwrap_or(usize::MAX);
        let there = stretch.get(at..at.saturating_add(bytes.len()));
        if there != Some(bytes) || W::frame_at(bytes) != Some(bytes.len()) {
            let detail = format!("{bytes:02X?} at byte {at} is no frame of the stream");
            return Err(Broken::new("frames-are-on-the-wire", detail));
        }
        nothing_lost::<W>(stretch, end, at)?;
        end = at + bytes.len();
        W::means_itself(frame)
    };
    listener.receive(stretch, &mut each)?;
    listener.decoder.idle();
    listener.receive(&[], &mut each)?;
    nothing_lost::<W>(stretch, end, stretch.len())?;
    match listener.decoder.pending() {
        0 => Ok(()),
        pending => {
            let detail = format!("{pending} bytes still pending after a pause");
            Err(Broken::new("a-pause-ends-every-wait", detail))
        }
    }
}

/// Checks that no frame begins among the discarded bytes between `from` and `to`.
fn nothing_lost<W: Wire>(stretch: &[u8], from: usize, to: usize) -> Result<(), Broken> {
    match (from..to).find(|&at| W::unmistakable_at(&stretch[at..]).is_some()) {
        None => Ok(()),
        Some(at) => {
            let detail = format!(
                "a frame begins at byte {at} of {} and was lost",
                stretch.len()
            );
            Err(Broken::new("no-frame-is-lost", detail))
        }
    }
}
