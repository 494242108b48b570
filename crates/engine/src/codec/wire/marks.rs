//! A decoder's reactions to a stream, as numbers. A fuzzer without instrumentation uses them to
//! find streams of a new kind.

use protocols::Decode;
use protocols::hc06::{Command, LineCommand};
use protocols::rle;

use super::{Piece, Stream, Wire, kind_of};

/// Destination of marks.
pub type Mark<'a> = &'a mut dyn FnMut(&[u64]);

const fn size(number: usize) -> u64 {
    (usize::BITS - number.leading_zeros()) as u64
}

/// Marks of a session: the kinds of frames; and each frame or error, regardless of its kind, with
/// the two before it and the size of the discarded bytes in between. With finer marks, every
/// session would be new.
pub(super) fn of_session<W: Wire>(stream: &Stream, mark: Mark<'_>) {
    let mut decoder = W::decoder();
    // No frame and no error yet.
    let mut before = [7, 7];
    let mut discarded = 0;
    let mut hear = |decoder: &mut W::Decoder, mut bytes: &[u8]| {
        while let Some(outcome) = decoder.step(&mut bytes) {
            let kind = match &outcome {
                Ok(frame) => {
                    mark(&[1, W::kind(frame)]);
                    0
                }
                Err(error) => u64::from(kind_of(*error)),
            };
            let lost = usize::try_from(decoder.discarded() - discarded).unwrap_or(usize::MAX);
            discarded = decoder.discarded();
            mark(&[2, kind, before[0], before[1], size(lost)]);
            before = [kind, before[0]];
        }
        mark(&[3, before[0], size(decoder.pending())]);
    };
    for piece in stream.pieces() {
        match piece {
            Piece::Bytes(bytes) => hear(&mut decoder, bytes),
            Piece::Idle => {
                decoder.idle();
                hear(&mut decoder, &[]);
            }
        }
    }
}

/// The end state of the decoder of a coded row.
pub(super) fn of_row(stream: &Stream, mark: Mark<'_>) {
    let mut row = [0; 300];
    let bytes = stream.bytes();
    let runs = bytes.windows(2).filter(|pair| pair[0] != pair[1]).count();
    let end = match rle::decode(bytes, &mut row) {
        Ok(len) => 16 + len as u64 / 8,
        Err(error) => error_number(error),
    };
    mark(&[end, size(bytes.len()), size(runs)]);
}

fn error_number(error: rle::RleError) -> u64 {
    match error {
        rle::RleError::OddLength => 1,
        rle::RleError::TooLong { .. } => 2,
        _ => 3,
    }
}

/// Recognised commands, by their letters.
pub(super) fn of_command(stream: &Stream, mark: Mark<'_>) {
    let bytes = stream.bytes();
    let heads = |most: usize| {
        let head = bytes.iter().take(most);
        head.fold(0, |hash: u64, &byte| (hash << 8) | u64::from(byte))
    };
    let old = Command::parse(bytes).map_or(0, |_| heads(7));
    let new = LineCommand::parse(bytes).map_or(0, |_| heads(8));
    mark(&[old, new, size(bytes.len())]);
    // Progress towards a command: number of letters with which all commands begin.
    let fits = bytes.iter().zip(b"AT+").take_while(|(a, b)| a == b).count();
    mark(&[1, fits as u64, size(bytes.len())]);
}
