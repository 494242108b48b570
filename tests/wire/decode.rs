//! Real captures as `hilrig decode` counts and judges them.

use hilrig::capture::decode::diagnose::{Damage, Line, diagnose};
use hilrig::codec::{self, Lidar, XV11, XV11_TURN};

use super::captures::capture;

fn damages(bytes: &[u8]) -> Vec<Damage> {
    diagnose(&Line {
        bytes,
        ..Line::default()
    })
}

/// Counts made by an independent script over the capture "hand in box", fw 2.4.
#[test]
fn the_hand_in_box_has_11451_packets() {
    let Some(bytes) = capture("xv11/xevel_hand_in_box_fw24.bin") else {
        return;
    };
    let lidar = Lidar::of_packets(&bytes);
    assert_eq!(codec::guess(&bytes), Some(&XV11));
    assert_eq!((lidar.frames, lidar.bad, lidar.outside), (11_451, 1, 224));
    assert_eq!((lidar.ok.count, lidar.weak.count), (42_875, 130));
    assert_eq!(lidar.invalid.values().sum::<u64>(), 2799);
    assert_eq!(lidar.invalid[&0x52], 1996);
    assert_eq!(damages(&bytes), []);
}

/// Counts of the same script over the two captures of fw 2.1.
#[test]
fn the_old_firmware_has_22_turns_in_two_captures() {
    for (name, turns, ok, weak, invalid) in [
        (
            "xv11/xevel_sparkfun_noshield_fw21.bin",
            21,
            3452,
            1321,
            2787,
        ),
        ("xv11/xevel_onerun_noshield_fw21.bin", 1, 178, 59, 123),
    ] {
        let Some(bytes) = capture(name) else { return };
        let lidar = Lidar::of_turns(&bytes);
        assert_eq!(codec::guess(&bytes), Some(&XV11_TURN));
        assert_eq!((lidar.frames, lidar.outside), (turns, 0));
        assert_eq!((lidar.ok.count, lidar.weak.count), (ok, weak));
        assert_eq!(lidar.invalid.values().sum::<u64>(), invalid);
        assert_eq!(damages(&bytes), []);
    }
}

/// A field capture of a host that lost each NUL byte. It also has no carriage return, and thirteen
/// times as many line feeds as neighbouring values: a terminal in text mode.
#[test]
fn a_host_that_strips_nul_is_named() {
    let Some(bytes) = capture("../data/neato/slamrs_out.bin") else {
        return;
    };
    let expected = bytes.len() as u64 / 256;
    let found = damages(&bytes);
    assert_eq!(found[0], Damage::NulStripped { expected });
    assert!(matches!(found[1..], [Damage::CrToLf { .. }]), "{found:?}");
}
