//! The PC program. Bytes and figures: field-bug catalogue, sections e and f.

use super::{assert_figure, figure, shown, wing_holds};

#[test]
fn every_defect_of_the_pc_program_shows_and_only_in_the_fielded_one() {
    wing_holds(&["UI-"]);
}

#[test]
fn a_flipped_id_paints_28() {
    assert_figure(
        "UI-01",
        "first pixels of the row",
        "28, 28, 28",
        "14, 28, 42",
    );
}

#[test]
fn six_odd_frames_make_the_program_deaf() {
    assert_figure(
        "UI-02",
        "of 6 invalid frames, those after which the program ignores all others",
        "6",
        "0",
    );
}

/// -10 and -90 displayed without their sign.
#[test]
fn negative_figures_are_shown_without_their_sign() {
    let name = "x, y and psi as shown";
    assert_figure("UI-03", name, "65526, 0, 65446", "-10, 0, -90");
    assert_figure("UI-04", "waypoint as shown", "65516, 5", "-20, 5");
}

/// UI-05 produces the list that PU-07 uses.
#[test]
fn the_wrong_waypoint_is_deleted_and_the_deadly_list_is_sent() {
    assert_figure("UI-05", "numbers in the list", "0, 1, 0", "0, 1, 2");
    let deadly = b"\x14\x00\x10\x02\x00\x00LWP\x02\x00\
        \x02\x00\x02\x00\x00\x01\x00\xFF\xFF\x05\x00\x05\x00\x00\x00\x00\x01\x00";
    let ui_05 = shown("UI-05");
    let sent = &ui_05.defective.wire.last().expect("it was sent").bytes;
    assert!(sent.ends_with(deadly), "{sent:02X?}");
}

#[test]
fn clicks_without_a_place_are_sent() {
    assert_figure("UI-06", "waypoint sent", "(-150, 500)", "nothing");
    assert_figure("UI-07", "waypoint sent", "(0, 0)", "nothing");
}

#[test]
fn rows_and_columns_are_lost() {
    assert_figure(
        "UI-09",
        "pixels from the top",
        "1, 2, 9, 9, 9, 9, 0, 0",
        "1, 2, 3, 4, 9, 9, 9, 9",
    );
    assert_figure("UI-10", "column 299, not told", "0", "127");
}

#[test]
fn a_deleted_waypoint_ends_the_robots_program() {
    assert_figure("PU-08", "numbers in the list", "1, 2", "0, 1");
    assert_figure("PU-08", "the program", "has ended", "runs");
}

/// A list of 57 waypoints has 2 + 9 * 57 = 515 bytes, more than the fielded 511; the frame is 17
/// bytes longer. Our PC program accepts 100 waypoints.
#[test]
fn the_57th_waypoint_is_on_the_screen_only() {
    let pu_13 = shown("PU-13");
    assert_eq!(figure(&pu_13.defective, "waypoints on the screen"), "57");
    assert_eq!(figure(&pu_13.defective, "waypoints of the robot"), "56");
    assert_eq!(figure(&pu_13.sound, "waypoints on the screen"), "57");
    assert_eq!(figure(&pu_13.sound, "waypoints of the robot"), "57");
    let bytes = pu_13
        .defective
        .wire
        .last()
        .expect("it was sent")
        .bytes
        .len();
    assert_eq!(bytes, 532);
}
