//! Decoders with one fault each, and the law that detects the fault. A law that does not detect its
//! mutant proves nothing about our decoders.

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};
use protocols::avr::{Bus, ChecksumOrder, Frame};
use protocols::{Candidate, Decode, Format, FrameError};

use crate::avr::HighFirst;
use crate::laws;
use crate::protocol::{Protocol, cut_frame, cuts, frames, one_damage, stream};

/// The defect of a mutant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Fault {
    /// No fault: the control that keeps every law.
    None,
    /// Throws away the whole rejected candidate, with the frame that may begin inside it.
    DropsCandidate,
    /// Forgets pending bytes at the end of each piece.
    ForgetsBetweenPieces,
    /// Does not count the noise it skips.
    CountsNoNoise,
    /// After a rejected candidate, takes nothing until the line is quiet.
    SulksUntilQuiet,
    /// Has no rule for idle lines.
    NeverGivesUp,
    /// Skips a byte at a second "idle".
    SkipsAfterTwoIdles,
    /// Ignores checksums.
    Believes,
    /// Loses the rest of a piece when the iterator is dropped: it takes the whole piece at once and
    /// keeps only the requested results.
    TakesAllAtOnce,
    /// Indexes past its buffer on the largest count, as the fielded slave does.
    OverrunsOn127,
}

/// A slow decoder of the register bus with one fault.
#[derive(Clone)]
pub(crate) struct Mutant {
    fault: Fault,
    format: Bus,
    buf: Vec<u8>,
    discarded: u64,
    quiet: bool,
    sulking: bool,
    skip: usize,
}

impl Mutant {
    pub(crate) fn new(fault: Fault) -> Self {
        Self {
            fault,
            format: Bus {
                order: ChecksumOrder::HighFirst,
            },
            buf: Vec::new(),
            discarded: 0,
            quiet: false,
            sulking: false,
            skip: 0,
        }
    }

    fn judge(&mut self) -> Candidate {
        let verdict = self.format.judge(&self.buf);
        match (self.fault, verdict) {
            (Fault::Believes, Candidate::Rejected(_)) => Candidate::Complete(self.buf.len()),
            // This happens once: the iterator is dropped while the panic unwinds, and feeds the
            // rest.
            (Fault::OverrunsOn127, _) if self.buf.get(2) == Some(&0xFF) => {
                self.fault = Fault::None;
                panic!("index out of bounds")
            }
            _ => verdict,
        }
    }

    fn discard(&mut self, count: usize) {
        self.buf.drain(..count);
        self.discarded += count as u64;
    }

    fn settle(&mut self) -> Option<Result<Frame, FrameError>> {
        while !self.buf.is_empty() {
            match self.judge() {
                _ if self.sulking => self.discard(self.buf.len()),
                Candidate::Noise => {
                    self.discard(1);
                    self.discarded -= u64::from(self.fault == Fault::CountsNoNoise);
                }
                Candidate::Rejected(error) => {
                    self.sulking = self.fault == Fault::SulksUntilQuiet;
                    let whole = self.fault == Fault::DropsCandidate;
                    self.discard(if whole { self.buf.len() } else { 1 });
                    return Some(Err(error));
                }
                Candidate::Complete(len) => {
                    let frame = self.format.frame(&self.buf[..len]);
                    self.buf.drain(..len);
                    return Some(Ok(frame));
                }
                Candidate::Incomplete if self.quiet => {
                    let found = u32::try_from(self.buf.len()).expect("short");
                    self.discard(1);
                    return Some(Err(FrameError::Truncated { found }));
                }
                Candidate::Incomplete => return None,
            }
        }
        self.quiet = false;
        None
    }
}

impl Decode for Mutant {
    type Frame = Frame;

    fn step(&mut self, input: &mut &[u8]) -> Option<Result<Frame, FrameError>> {
        loop {
            if let Some(outcome) = self.settle() {
                if self.fault == Fault::TakesAllAtOnce {
                    *input = &[];
                }
                return Some(outcome);
            }
            let Some((&byte, rest)) = input.split_first() else {
                if self.fault == Fault::ForgetsBetweenPieces {
                    self.discard(self.buf.len());
                }
                return None;
            };
            *input = rest;
            self.buf.push(byte);
            if self.skip > 0 {
                self.skip -= 1;
                self.discard(1);
            }
        }
    }

    fn idle(&mut self) {
        self.sulking = false;
        if self.fault == Fault::SkipsAfterTwoIdles && self.quiet {
            self.skip += 1;
        }
        self.quiet = self.fault != Fault::NeverGivesUp && !self.buf.is_empty();
    }

    fn pending(&self) -> usize {
        self.buf.len()
    }

    fn discarded(&self) -> u64 {
        self.discarded
    }
}

/// The laws, by name.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Law {
    Chunking,
    Accounting,
    DroppedIterator,
    Naive,
    Identity,
    OneDamage,
    CutFrame,
    IdleTwice,
    Pause,
    AnyBytes,
}

const ALL: [Law; 10] = [
    Law::Chunking,
    Law::Accounting,
    Law::DroppedIterator,
    Law::Naive,
    Law::Identity,
    Law::OneDamage,
    Law::CutFrame,
    Law::IdleTwice,
    Law::Pause,
    Law::AnyBytes,
];

/// Whether a decoder with `fault` keeps `law` on as many streams as our own decoder must.
fn keeps(law: Law, fault: Fault) -> bool {
    let new = move || Mutant::new(fault);
    let (at, any_bytes) = (
        HighFirst::frame_at,
        proptest::collection::vec(any::<u8>(), 0..300),
    );
    let frame = HighFirst::frame;
    let stream = stream::<HighFirst>;
    match law {
        Law::Chunking => holds((stream(), stream(), cuts()), |(before, after, cuts)| {
            laws::chunking_changes_nothing(new, [&before, &after], &cuts)
        }),
        Law::Accounting => holds((stream(), cuts()), |(bytes, cuts)| {
            laws::every_byte_is_accounted_for(new, &bytes, &cuts)
        }),
        Law::DroppedIterator => holds((stream(), 0_usize..4), |(bytes, taken)| {
            laws::an_iterator_dropped_early_feeds_the_rest(new, &bytes, taken)
        }),
        Law::Naive => holds(stream(), |bytes| {
            laws::decodes_as_the_naive_scanner(new, &bytes, at)
        }),
        Law::Identity => holds(frames::<HighFirst>(6), |sent| {
            laws::sent_frames_arrive(new, &sent)
        }),
        Law::OneDamage => holds(
            (frames::<HighFirst>(8), one_damage::<HighFirst>()),
            |(sent, damage)| {
                laws::one_damaged_byte_costs_at_most_two_frames(new, &sent, damage, at, true)
            },
        ),
        Law::CutFrame => holds(
            (cut_frame::<HighFirst>(), frames::<HighFirst>(4)),
            |(cut, sent)| laws::a_cut_frame_costs_nothing_behind_it(new, &cut, &sent, at, true),
        ),
        Law::IdleTwice => holds((stream(), frames::<HighFirst>(3)), |(before, sent)| {
            laws::idle_twice_is_idle_once(new, &before, &sent)
        }),
        Law::Pause => holds((stream(), frame()), |(before, frame)| {
            laws::a_pause_ends_every_wait(new, &before, &frame)
        }),
        Law::AnyBytes => holds((any_bytes, frame()), |(bytes, frame)| {
            laws::any_bytes_are_survived(new, &bytes, &frame)
        }),
    }
}

/// Runs a law on 1,000 cases that are the same every time: the result of a mutant must not change
/// from day to day.
fn holds<S: Strategy>(cases: S, law: impl Fn(S::Value) -> Result<(), TestCaseError>) -> bool {
    let config = Config {
        cases: 1000,
        failure_persistence: None,
        max_shrink_iters: 0,
        ..Config::default()
    };
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    TestRunner::new_with_rng(config, rng)
        .run(&cases, law)
        .is_ok()
}

/// Without this test, a harness that fails everything would pass for ten good laws.
#[test]
fn a_slow_decoder_without_a_fault_keeps_every_law() {
    for law in ALL {
        assert!(keeps(law, Fault::None), "{law:?}");
    }
}

#[test]
fn dropping_the_whole_candidate_breaks_the_law_of_cut_frames() {
    assert!(!keeps(Law::CutFrame, Fault::DropsCandidate));
}

#[test]
fn dropping_the_whole_candidate_breaks_the_law_of_the_naive_scanner() {
    assert!(!keeps(Law::Naive, Fault::DropsCandidate));
}

#[test]
fn forgetting_between_pieces_breaks_the_law_of_chunking() {
    assert!(!keeps(Law::Chunking, Fault::ForgetsBetweenPieces));
}

#[test]
fn not_counting_noise_breaks_the_law_of_accounting() {
    assert!(!keeps(Law::Accounting, Fault::CountsNoNoise));
}

#[test]
fn sulking_after_an_error_breaks_the_law_of_one_damaged_byte() {
    assert!(!keeps(Law::OneDamage, Fault::SulksUntilQuiet));
}

#[test]
fn believing_any_checksum_breaks_the_law_of_one_damaged_byte() {
    assert!(!keeps(Law::OneDamage, Fault::Believes));
}

#[test]
fn never_giving_up_breaks_the_law_of_pauses() {
    assert!(!keeps(Law::Pause, Fault::NeverGivesUp));
}

#[test]
fn skipping_after_two_idles_breaks_the_law_of_idling() {
    assert!(!keeps(Law::IdleTwice, Fault::SkipsAfterTwoIdles));
}

#[test]
fn taking_all_at_once_breaks_the_law_of_identity() {
    assert!(!keeps(Law::Identity, Fault::TakesAllAtOnce));
}

#[test]
fn an_overrun_on_the_largest_count_breaks_the_law_of_any_bytes() {
    assert!(!keeps(Law::AnyBytes, Fault::OverrunsOn127));
}
