//! The blind test on the public captures: a plain classifier tries to tell windows of a real
//! capture from windows of the emulated sensor in the same room. 50 % is chance.
//!
//! The captures are not part of the project: without them the tests say so and judge nothing.

use std::io::Write as _;

use emulators::xv11::Profile;
use emulators::xv11::fidelity::{Told, blind};

fn captured(name: &str) -> Option<Vec<u8>> {
    let captures = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/captures");
    let captures = std::path::Path::new(captures);
    if !captures.is_dir() {
        skipped("no captures beside the repository");
        return None;
    }
    let file = captures.join("xv11").join(name);
    Some(std::fs::read(file).expect("the folder has it"))
}

/// Prints the message directly, because the test runner hides the output of passing tests.
fn skipped(reason: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: blind: {reason}");
}

fn told(name: &str, profile: Profile) -> Option<Vec<Told>> {
    let bytes = captured(name)?;
    let told = blind(&bytes, profile, 1).expect("enough turns");
    for group in &told {
        let (group, accuracy) = (group.group, group.accuracy);
        eprintln!("{name}: {group}: {accuracy:.0?} %");
    }
    Some(told)
}

/// Packets, tooth speeds, distances, strengths and codes of firmware 2.4: at most 60 %.
#[test]
fn f8_a_classifier_hardly_tells_real_windows_from_emulated_ones() {
    let Some(groups) = told("xevel_hand_in_box_fw24.bin", Profile::Fw24) else {
        return;
    };
    assert_eq!(groups.len(), 5);
    for group in groups {
        let accuracy = group.accuracy.expect("compared");
        assert!(accuracy <= group.limit(), "{group:?}");
    }
}

/// The mutant: a sensor with the noise of 2.1 differs from the capture of 2.4 in its distances.
#[test]
fn the_noise_of_another_firmware_gives_itself_away() {
    let Some(groups) = told("xevel_hand_in_box_fw24.bin", Profile::Fw21) else {
        return;
    };
    let distances = groups.iter().find(|group| group.group == "distances");
    let accuracy = distances.and_then(|group| group.accuracy);
    assert!(accuracy.expect("compared") > 75.0, "{groups:?}");
}
