//! The robot's end of the PC link, and its navigation. Bytes and figures: field-bug catalogue,
//! sections e and f.

use super::{assert_figure, figure, shown, wing_holds};

#[test]
fn every_defect_of_the_pc_link_shows_and_only_with_its_switch() {
    wing_holds(&["PU-"]);
}

#[test]
fn every_defect_of_navigation_shows_and_only_with_its_switch() {
    wing_holds(&["NV-"]);
}

#[test]
fn a_stray_letter_costs_the_frame() {
    assert_figure("PU-01", "frames received", "0", "1");
    let sent = shown("PU-01").sound.sent_by("PC");
    let golden = "50 50 43 55 49 5F 4D 53 47 03 00 04 00 00 00 53 54 41 01 01 02";
    assert_eq!(sent, golden);
}

#[test]
fn one_header_makes_the_receiver_deaf() {
    assert_figure("PU-03", "of 200 good frames received", "0", "200");
    assert_figure("PU-02", "sum", "8080", "8080");
}

#[test]
fn a_list_of_one_that_says_fifty_yields_49_phantoms() {
    assert_figure("PU-05", "waypoints at (0, 0)", "49", "0");
}

/// The catalogue's list: ids 1 and 0, links -1 and 1.
#[test]
fn a_link_to_nobody_ends_the_program() {
    let pu_07 = shown("PU-07");
    let list =
        "14 00 10 02 00 00 4C 57 50 02 00 02 00 02 00 00 01 00 FF FF 05 00 05 00 00 00 00 01 00";
    assert!(
        pu_07.sound.sent_by("PC").ends_with(list),
        "{}",
        pu_07.sound.sent_by("PC")
    );
    assert_eq!(figure(&pu_07.defective, "the program"), "has ended");
    assert_eq!(figure(&pu_07.sound, "the program"), "runs");
}

#[test]
fn a_freed_target_lies_at_minus_one() {
    assert_figure("PU-10", "target, mm", "[-1, -1]", "[500, 0]");
}

#[test]
fn the_longest_list_overruns_the_queue_in_one_burst() {
    assert_figure("PU-12", "of 21 waypoints taken", "0", "21");
}

#[test]
fn the_last_pixel_is_lost() {
    assert_figure("PU-19", "pixels sent of 300", "299", "300");
    assert_figure("PU-19", "pixel 299, a wall of 255", "127", "255");
}

/// With an error of -340 degrees the left wheel gets 20 + 113 and the right one 20 - 113, each
/// limited to 20. In the sound variant the error is 20 degrees: 20 - 6 and 20.
#[test]
fn the_long_way_round_is_taken() {
    assert_figure(
        "NV-01",
        "wheels at psi -170 towards 170",
        "20, -20: right",
        "13, 20: left",
    );
}
