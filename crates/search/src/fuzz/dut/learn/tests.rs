//! Mutants of frames whose format was learned.

use std::collections::BTreeSet;

use super::*;
use crate::learn::FrameFormat;
use crate::learn::tests::sensor_frames;

/// Half of the mutants have a correct checksum and another content, some have a wrong checksum,
/// some are intact and come in chunks.
#[test]
fn mutants_are_sound_frames_damage_and_other_deliveries() {
    let frames = sensor_frames(6);
    let mut gathered = Gathered::default();
    frames
        .iter()
        .for_each(|frame| gathered.unasked(frame.clone()));
    let Seeds {
        format, contents, ..
    } = gathered.learned(None);
    let material = Material {
        format: &*format,
        contents: &contents,
    };
    let is_sound = |frame: &[u8]| {
        let content = format.content(frame);
        content.is_some_and(|content| format.frame(&content, 0) == frame)
    };
    let rng = &mut Rng::stream(1, "test");
    let mut kinds = BTreeSet::new();
    let [mut other, mut wrong, mut delivered] = [0; 3];
    for _ in 0..1000 {
        let mutant = mutate::mutant(&material, &frames[0], rng);
        let whole = mutant.pieces.concat();
        kinds.insert(mutant.kind);
        match is_sound(&whole) {
            true if whole != frames[0] => other += 1,
            false => wrong += 1,
            true => {}
        }
        if !mutant.is_altered {
            assert_eq!(whole, frames[0], "{}", mutant.kind);
            delivered += 1;
        }
    }
    assert!(
        other > 500 && wrong > 100 && delivered > 20,
        "{other} {wrong} {delivered}"
    );
    for kind in [
        "wrong-length",
        "short",
        "limit-of-16-bits",
        "wrong-checksum",
        "twice",
        "bytewise",
    ] {
        assert!(kinds.contains(kind), "{kind}");
    }
}

/// Shipped devices with binary frames: a changed field stays in a frame with correct checksums, a
/// length may be wrong, and a value lies at a limit of its field or beyond.
#[test]
fn mutants_of_a_described_format_have_fields_at_their_limits() {
    use protocols::Decode as _;
    for name in ["cobs-sensor", "gps"] {
        let text = description::shipped::text(name).expect("shipped");
        let nothing = |_: &str| Err(String::new());
        let of = description::Description::parse(name, text, &nothing).expect("sound");
        let format = DescribedFormat::of(&of);
        let frames = format.examples();
        let Seeds {
            format, contents, ..
        } = Gathered::default().learned(Some(format));
        let material = Material {
            format: &*format,
            contents: &contents,
        };
        let rng = &mut Rng::stream(1, "described");
        let (mut limits, mut sound) = (0, 0);
        for at in 0..600 {
            let frame = &frames[at % frames.len()];
            let mutant = mutate::mutant(&material, frame, rng);
            if mutant.kind != "field-at-limit" {
                continue;
            }
            limits += 1;
            let mut cutter = of.cutter();
            let whole = mutant.pieces.concat();
            sound += usize::from(cutter.push(&whole).flatten().count() == 1);
        }
        assert!(limits > 30, "{name}: {limits}");
        assert_eq!(sound, limits, "{name}: each is a sound frame");
    }
}

/// Splitting a frame into its content and assembling it again gives the same frame, for each
/// format.
#[test]
fn described_frames_are_taken_apart_and_put_together() {
    for (name, text) in description::shipped::ALL {
        let nothing = |_: &str| Err(String::new());
        let of = description::Description::parse(name, text, &nothing).expect("sound");
        let format = DescribedFormat::of(&of);
        // Line ends and prompts around a content come from the description.
        for frame in format.examples() {
            let content = FrameFormat::content(&format, &frame).expect("a frame");
            let again = FrameFormat::frame(&format, &content, 0);
            assert_eq!(
                FrameFormat::content(&format, &again),
                Some(content),
                "{name}"
            );
        }
    }
}
