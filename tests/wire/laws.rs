//! The laws of every decoder, each a function of the decoder under test. The same laws judge ours
//! (at the end of this file) and the mutants (in `mutants.rs`).

use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::TestCaseError;
use protocols::{Decode, FrameError};

use crate::damage::Damage;
use crate::protocol::{Protocol, Wire, cut_frame, cuts, frames, one_damage, pieces, scan, stream};

type Verdict = Result<(), TestCaseError>;
type Oracle = fn(&[u8]) -> Option<usize>;

/// Output of a decoder: frames as bytes, and errors.
type Outcome = Vec<Result<Vec<u8>, FrameError>>;

fn feed<D: Decode<Frame: Wire>>(decoder: &mut D, bytes: &[u8]) -> Outcome {
    let frames = decoder.push(bytes);
    frames
        .map(|frame| frame.map(|frame| frame.wire()))
        .collect()
}

/// All results from `bytes` followed by an idle line.
fn decode<D: Decode<Frame: Wire>>(decoder: &mut D, bytes: &[u8]) -> Vec<Vec<u8>> {
    let mut outcome = feed(decoder, bytes);
    decoder.idle();
    outcome.extend(feed(decoder, &[]));
    outcome.into_iter().filter_map(Result::ok).collect()
}

/// Frames and errors are the same in any pieces, also around a pause.
pub(crate) fn chunking_changes_nothing<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    [before, after]: [&[u8]; 2],
    cuts: &[Index],
) -> Verdict {
    let run = |cuts: &[Index]| {
        let mut decoder = new();
        let mut outcome = Vec::new();
        for piece in pieces(before, cuts) {
            outcome.extend(feed(&mut decoder, piece));
        }
        decoder.idle();
        for piece in pieces(after, cuts) {
            outcome.extend(feed(&mut decoder, piece));
        }
        (outcome, decoder.pending(), decoder.discarded())
    };
    prop_assert_eq!(run(cuts), run(&[]));
    Ok(())
}

/// After each piece, every byte is in a frame, discarded or pending. After a pause and one more
/// call, none is pending.
pub(crate) fn every_byte_is_accounted_for<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    bytes: &[u8],
    cuts: &[Index],
) -> Verdict {
    let mut decoder = new();
    let (mut pushed, mut framed) = (0, 0);
    for piece in pieces(bytes, cuts) {
        framed += framed_bytes(&feed(&mut decoder, piece));
        pushed += piece.len();
        let discarded = usize::try_from(decoder.discarded()).expect("a short stream");
        prop_assert_eq!(framed + discarded + decoder.pending(), pushed);
    }
    decoder.idle();
    framed += framed_bytes(&feed(&mut decoder, &[]));
    let discarded = usize::try_from(decoder.discarded()).expect("a short stream");
    prop_assert_eq!((framed + discarded, decoder.pending()), (pushed, 0));
    Ok(())
}

fn framed_bytes(outcome: &Outcome) -> usize {
    outcome.iter().flatten().map(Vec::len).sum()
}

/// Dropping the iterator of `push` half-way feeds the rest nevertheless: the next push continues
/// after the last byte.
pub(crate) fn an_iterator_dropped_early_feeds_the_rest<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    bytes: &[u8],
    taken: usize,
) -> Verdict {
    let mut dropped = new();
    let _ = dropped.push(bytes).take(taken).count();
    let mut whole = new();
    feed(&mut whole, bytes);
    prop_assert_eq!(
        (dropped.pending(), dropped.discarded()),
        (whole.pending(), whole.discarded())
    );
    Ok(())
}

/// The frames are those that the naive scanner finds.
pub(crate) fn decodes_as_the_naive_scanner<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    bytes: &[u8],
    frame_at: Oracle,
) -> Verdict {
    prop_assert_eq!(decode(&mut new(), bytes), scan(bytes, frame_at));
    Ok(())
}

/// Sent frames arrive, in order, at once and without loss.
pub(crate) fn sent_frames_arrive<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    sent: &[Vec<u8>],
) -> Verdict {
    let mut decoder = new();
    let outcome = feed(&mut decoder, &sent.concat());
    prop_assert_eq!(outcome, sent.iter().cloned().map(Ok).collect::<Outcome>());
    prop_assert_eq!((decoder.pending(), decoder.discarded()), (0, 0));
    Ok(())
}

/// One damaged byte costs at most two frames, and no invalid frame comes out.
///
/// A weak sum sometimes lets a wrong candidate pass. Such a frame is valid, so no decoder could
/// reject it. The frames that it covers are not counted as losses.
pub(crate) fn one_damaged_byte_costs_at_most_two_frames<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    sent: &[Vec<u8>],
    damage: Damage,
    frame_at: Oracle,
    checked: bool,
) -> Verdict {
    let mut bytes = sent.concat();
    damage.apply(&mut bytes);
    let got = decode(&mut new(), &bytes);
    let (lost, unsent) = compare(sent, &got);
    for frame in &unsent {
        prop_assert_eq!(frame_at(frame), Some(frame.len()), "{:02X?}", frame);
    }
    prop_assert!(
        lost <= 2 || (checked && !unsent.is_empty()),
        "{} frames lost",
        lost
    );
    Ok(())
}

/// A cut frame does not damage the frame after it.
pub(crate) fn a_cut_frame_costs_nothing_behind_it<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    cut: &[u8],
    sent: &[Vec<u8>],
    frame_at: Oracle,
    checked: bool,
) -> Verdict {
    let bytes = [cut, &sent.concat()].concat();
    let got = decode(&mut new(), &bytes);
    let (lost, unsent) = compare(sent, &got);
    for frame in &unsent {
        prop_assert_eq!(frame_at(frame), Some(frame.len()), "{:02X?}", frame);
    }
    // A cut turn of firmware 2.1 looks like a whole one: it takes its missing bytes from the next
    // turn, whose header is then gone.
    let allowed = usize::from(!checked && cut.len() >= 4);
    prop_assert!(
        lost <= allowed || (checked && !unsent.is_empty()),
        "{} frames lost",
        lost
    );
    Ok(())
}

/// Number of frames of `sent` that are missing in `got`, and of frames of `got` that were never
/// sent, by the longest common subsequence. A damaged frame may be equal to a frame that was sent
/// much later. A simple comparison would then count everything between them as lost.
fn compare(sent: &[Vec<u8>], got: &[Vec<u8>]) -> (usize, Vec<Vec<u8>>) {
    // common[i][j]: frames that the rests from `i` on and from `j` on have in common.
    let mut common = vec![vec![0; got.len() + 1]; sent.len() + 1];
    for i in (0..sent.len()).rev() {
        for j in (0..got.len()).rev() {
            common[i][j] = if sent[i] == got[j] {
                common[i + 1][j + 1] + 1
            } else {
                common[i + 1][j].max(common[i][j + 1])
            };
        }
    }
    let (mut i, mut unsent) = (0, Vec::new());
    for (j, frame) in got.iter().enumerate() {
        while i < sent.len() && sent[i] != *frame && common[i + 1][j] == common[i][j] {
            i += 1;
        }
        if i < sent.len() && sent[i] == *frame {
            i += 1;
        } else {
            unsent.push(frame.clone());
        }
    }
    (sent.len() - common[0][0], unsent)
}

/// A damaged frame that equals a later one counts as one lost frame, not as all between them.
#[test]
fn frames_are_compared_by_what_they_have_in_common() {
    let [a, b, c] = [1, 2, 3].map(|byte| vec![byte]);
    let sent = [&a, &b, &b, &b, &c].map(Clone::clone);
    let got = [&c, &b, &b, &b, &c].map(Clone::clone);
    assert_eq!(compare(&sent, &got), (1, vec![c.clone()]));
    assert_eq!(compare(&sent, &sent), (0, vec![]));
    assert_eq!(compare(&sent, &[]), (5, vec![]));
    assert_eq!(compare(&sent, core::slice::from_ref(&b)), (4, vec![]));
}

/// A second report of a quiet line has no effect, and neither has one between frames.
pub(crate) fn idle_twice_is_idle_once<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    before: &[u8],
    sent: &[Vec<u8>],
) -> Verdict {
    let run = |times: usize| {
        let mut decoder = new();
        let mut outcome = feed(&mut decoder, before);
        for _ in 0..times {
            decoder.idle();
        }
        outcome.extend(feed(&mut decoder, &sent.concat()));
        (outcome, decoder.pending(), decoder.discarded())
    };
    prop_assert_eq!(run(2), run(1));

    let mut decoder = new();
    for frame in sent {
        decoder.idle();
        prop_assert_eq!(feed(&mut decoder, frame), vec![Ok(frame.clone())]);
    }
    Ok(())
}

/// After a pause, whatever came before it, the first frame is decoded at once.
pub(crate) fn a_pause_ends_every_wait<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    before: &[u8],
    frame: &[u8],
) -> Verdict {
    let mut decoder = new();
    feed(&mut decoder, before);
    decoder.idle();
    feed(&mut decoder, &[]);
    prop_assert_eq!(feed(&mut decoder, frame), vec![Ok(frame.to_vec())]);
    Ok(())
}

/// The decoder survives any bytes, and works as a new one after a pause.
pub(crate) fn any_bytes_are_survived<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    bytes: &[u8],
    frame: &[u8],
) -> Verdict {
    a_pause_ends_every_wait(new, bytes, frame)
}

/// Sent frames arrive: all except the last with the start of the next, the last with a pause.
pub(crate) fn sent_frames_arrive_with_the_next_or_a_pause<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    sent: &[Vec<u8>],
) -> Verdict {
    let mut decoder = new();
    let (last, first) = sent.split_last().expect("one at least");
    let expected = |sent: &[Vec<u8>]| sent.iter().cloned().map(Ok).collect::<Outcome>();
    prop_assert_eq!(feed(&mut decoder, &sent.concat()), expected(first));
    prop_assert_eq!((decoder.pending(), decoder.discarded()), (last.len(), 0));
    decoder.idle();
    prop_assert_eq!(feed(&mut decoder, &[]), vec![Ok(last.clone())]);
    prop_assert_eq!((decoder.pending(), decoder.discarded()), (0, 0));
    Ok(())
}

/// After a pause, reported once or twice, and after any bytes, a frame followed by a pause is
/// decoded.
pub(crate) fn a_pause_ends_every_patient_wait<D: Decode<Frame: Wire>>(
    new: impl Fn() -> D,
    before: &[u8],
    frame: &[u8],
) -> Verdict {
    for pauses in 1..=2 {
        let mut decoder = new();
        feed(&mut decoder, before);
        for _ in 0..pauses {
            decoder.idle();
        }
        feed(&mut decoder, &[]);
        prop_assert_eq!(feed(&mut decoder, frame), vec![]);
        decoder.idle();
        prop_assert_eq!(feed(&mut decoder, &[]), vec![Ok(frame.to_vec())]);
    }
    Ok(())
}

/// Laws of every decoder, at whatever time it returns its frames.
macro_rules! laws_of_any {
    () => {
        proptest! {
            #![proptest_config(crate::thorough::cases(P::CASES))]

            #[test]
            fn chunking_changes_nothing(
                before in stream::<P>(), after in stream::<P>(), cuts in cuts(),
            ) {
                super::chunking_changes_nothing(P::decoder, [&before, &after], &cuts)?;
            }

            #[test]
            fn every_byte_is_accounted_for(bytes in stream::<P>(), cuts in cuts()) {
                super::every_byte_is_accounted_for(P::decoder, &bytes, &cuts)?;
            }

            #[test]
            fn an_iterator_dropped_early_feeds_the_rest(
                bytes in stream::<P>(), taken in 0_usize..4,
            ) {
                super::an_iterator_dropped_early_feeds_the_rest(P::decoder, &bytes, taken)?;
            }

            #[test]
            fn decodes_as_the_naive_scanner(bytes in stream::<P>()) {
                super::decodes_as_the_naive_scanner(P::decoder, &bytes, P::frame_at)?;
            }

            #[test]
            fn one_damaged_byte_costs_at_most_two_frames(
                sent in frames::<P>(8), damage in one_damage::<P>(),
            ) {
                super::one_damaged_byte_costs_at_most_two_frames(
                    P::decoder, &sent, damage, P::frame_at, P::CHECKED,
                )?;
            }

            #[test]
            fn a_cut_frame_costs_nothing_behind_it(
                cut in cut_frame::<P>(), sent in frames::<P>(4),
            ) {
                super::a_cut_frame_costs_nothing_behind_it(
                    P::decoder, &cut, &sent, P::frame_at, P::CHECKED,
                )?;
            }
        }
    };
}

/// The tests of one protocol: every law on thousands of streams.
macro_rules! laws {
    ($name:ident, $protocol:ty) => {
        mod $name {
            use super::*;
            type P = $protocol;

            laws_of_any!();

            proptest! {
                #![proptest_config(crate::thorough::cases(P::CASES))]

                #[test]
                fn sent_frames_arrive(sent in frames::<P>(6)) {
                    super::sent_frames_arrive(P::decoder, &sent)?;
                }

                #[test]
                fn idle_twice_is_idle_once(before in stream::<P>(), sent in frames::<P>(3)) {
                    super::idle_twice_is_idle_once(P::decoder, &before, &sent)?;
                }

                #[test]
                fn a_pause_ends_every_wait(before in stream::<P>(), frame in P::frame()) {
                    super::a_pause_ends_every_wait(P::decoder, &before, &frame)?;
                }

                #[test]
                fn any_bytes_are_survived(bytes in any_bytes::<P>(), frame in P::frame()) {
                    super::any_bytes_are_survived(P::decoder, &bytes, &frame)?;
                }
            }
        }
    };
}

/// Laws of a protocol whose decoder holds a frame back until the next one begins or the line is
/// quiet.
macro_rules! laws_of_patient {
    ($name:ident, $protocol:ty) => {
        mod $name {
            use super::*;
            type P = $protocol;

            laws_of_any!();

            proptest! {
                #![proptest_config(crate::thorough::cases(P::CASES))]

                #[test]
                fn sent_frames_arrive_with_the_next_or_a_pause(sent in frames::<P>(6)) {
                    super::sent_frames_arrive_with_the_next_or_a_pause(P::decoder, &sent)?;
                }

                #[test]
                fn a_pause_ends_every_wait(bytes in any_bytes::<P>(), frame in P::frame()) {
                    super::a_pause_ends_every_patient_wait(P::decoder, &bytes, &frame)?;
                }
            }
        }
    };
}

/// Random bytes, often those that the format reacts to.
fn any_bytes<P: Protocol>() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![any::<u8>(), proptest::sample::select(P::TELLING)];
    proptest::collection::vec(byte, 0..3000)
}

laws!(xv11_packets, crate::xv11::Packets);
laws!(xv11_turns, crate::xv11::Turns);
laws!(avr_low_byte_first, crate::avr::LowFirst);
laws!(avr_high_byte_first, crate::avr::HighFirst);
laws!(pcui, crate::pcui::Pcui);
laws!(panel_commands, crate::panel::Commands);
laws!(panel_reports, crate::panel::Reports);
laws!(rplidar_requests, crate::rplidar::Requests);
laws!(telemetry, crate::telemetry::Telemetry);
laws!(peripherals, crate::peripherals::Registers);
laws_of_patient!(car_board, crate::car_board::Board);
laws!(car_commands, crate::car_board::Commands);
laws!(odometer, crate::odometer::Lines);
