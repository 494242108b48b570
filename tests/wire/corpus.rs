//! The entry functions of the fuzzers: over the corpus, over random sessions, and over decoders
//! with one fault each, which they must detect.

use core::panic::AssertUnwindSafe;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};

use hilrig::codec::wire::{Broken, Choices, Stream, Wire, keeps_the_laws};
use hilrig::codec::{self, Avr, HighFirst};
use hilrig::search::fuzz::programs;
use protocols::avr::Frame;

use crate::mutants::{Fault, Mutant};

type Sound = Avr<HighFirst>;

fn files(target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/corpus")
        .join(target);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    let mut files: Vec<_> = entries
        .map(|entry| entry.expect("readable").path())
        .collect();
    files.sort();
    files
}

/// Every stream that once showed a defect, in every change. A target without a corpus fails.
#[test]
fn every_stream_of_the_corpus_keeps_the_laws() {
    for target in codec::targets() {
        let files = files(target.name);
        assert!(!files.is_empty(), "{} has no corpus", target.name);
        for path in files {
            let text = std::fs::read_to_string(&path).expect("readable");
            let stream = Stream::parse(&text);
            let stream = stream.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            let held = (target.check)(&stream);
            held.unwrap_or_else(|broken| panic!("{}: {broken}", path.display()));
        }
    }
}

/// Sessions that made fielded programs fail. Each names its defect and the law that it broke: the
/// defective program still breaks it, and the sound program keeps every law. A program without a
/// corpus fails.
#[test]
fn every_session_of_the_corpus_breaks_its_law_in_the_defective_program_alone() {
    for sound in programs(&[]).expect("without a defect") {
        let files = files(sound.name());
        assert!(!files.is_empty(), "{} has no corpus", sound.name());
        for path in files {
            let text = std::fs::read_to_string(&path).expect("readable");
            let first = text.lines().next().unwrap_or_default();
            let named = first
                .strip_prefix("# defect ")
                .and_then(|line| line.split_once(": "));
            let (defect, law) = named.unwrap_or_else(|| panic!("{}: {first}", path.display()));
            let judged = sound
                .repeated(&text)
                .unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(judged, Ok(()), "{}", path.display());
            let defective = programs(&[defect.to_owned()]).expect("known");
            let defective = defective
                .iter()
                .find(|program| program.name() == sound.name());
            let judged = defective.expect("the same programs").repeated(&text);
            let broken = judged
                .expect("read before")
                .expect_err(&path.display().to_string());
            assert_eq!(broken.law(), law, "{}: {broken:?}", path.display());
        }
    }
}

/// Data of a fuzzer without guidance: the same numbers every time.
fn data(seed: u64) -> Vec<u8> {
    let mut rng = emulators::rng::Rng::stream(seed, "fuzz.data");
    let len = rng.below(400);
    let bytes = (0..len).map(|_| rng.next_u64().to_le_bytes()[7]);
    bytes.collect()
}

#[test]
fn two_thousand_sessions_of_each_format_keep_the_laws() {
    for target in codec::targets() {
        for seed in 0..2000 {
            target.fuzz(&data(seed));
        }
    }
}

/// A checksum repaired after the damage makes the damaged frame a valid one again, so that the
/// code behind the checksum is reached.
#[test]
fn with_repair_damaged_frames_stay_frames() {
    // A write of three bytes to register 46; the first data byte loses its lowest bit.
    let session = |switches| [switches, 0, 46, 0x83, 0x15, 0xEC, 0x00, 13, 3, 0];
    let damaged = Stream::session::<Sound>(&session(0));
    let repaired = Stream::session::<Sound>(&session(1));
    assert_eq!(Sound::frame_at(damaged.bytes()), None);
    assert_eq!(
        repaired.bytes(),
        [0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C]
    );
}

/// The register bus with a decoder that has one fault.
struct Faulty<const FAULT: usize>;

const FAULTS: [Fault; 8] = [
    Fault::None,
    Fault::DropsCandidate,
    Fault::ForgetsBetweenPieces,
    Fault::CountsNoNoise,
    Fault::SulksUntilQuiet,
    Fault::NeverGivesUp,
    Fault::Believes,
    Fault::OverrunsOn127,
];

impl<const FAULT: usize> Wire for Faulty<FAULT> {
    type Decoder = Mutant;
    const NAME: &'static str = "faulty";

    fn decoder() -> Mutant {
        Mutant::new(FAULTS[FAULT])
    }

    fn bytes(frame: &Frame) -> &[u8] {
        Sound::bytes(frame)
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        Sound::build(choices, out);
    }

    fn repair(frame: &mut [u8]) {
        Sound::repair(frame);
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        Sound::frame_at(bytes)
    }

    fn means_itself(frame: &Frame) -> Result<(), Broken> {
        Sound::means_itself(frame)
    }
}

/// The law that the fault broke first in 5,000 sessions; `panic` if the decoder panicked.
fn caught<const FAULT: usize>() -> Option<&'static str> {
    (0..5000).find_map(|seed| {
        let stream = Stream::session::<Sound>(&data(seed));
        let judged = AssertUnwindSafe(|| keeps_the_laws::<Faulty<FAULT>>(&stream));
        match catch_unwind(judged) {
            Ok(held) => held.err().map(|broken| broken.law),
            Err(_) => Some("panic"),
        }
    })
}

/// A control: without it, a judge that rejects everything would pass the tests below.
#[test]
fn a_slow_decoder_without_a_fault_keeps_the_laws_of_fuzzing() {
    assert_eq!(caught::<0>(), None);
}

#[test]
fn each_faulty_decoder_breaks_a_law_within_5000_sessions() {
    let found = [
        caught::<1>(),
        caught::<2>(),
        caught::<3>(),
        caught::<4>(),
        caught::<5>(),
        caught::<6>(),
        caught::<7>(),
    ];
    assert!(found.iter().all(Option::is_some), "{found:?}");
    assert_eq!(found[6], Some("panic"));
}
