//! The same everywhere.

use crate::scenes::fingerprint;

/// Fingerprint that changes with the mapper, never with the build. `tests/every_build` checks the
/// debug build with the code for x86-64, and debug and release with the code for a Cortex-M4.
const SAME_EVERYWHERE: u64 = 0x6c40_b21c_c5e2_ad7c;

#[test]
fn random_scenes_give_the_same_poses_and_maps_in_every_build() {
    let print = fingerprint();
    assert_eq!(print, SAME_EVERYWHERE, "{print:#018x}");
}
