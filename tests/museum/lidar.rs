//! The lidar's stream. Bytes and figures: field-bug catalogue, section c.

use super::{assert_figure, figure, shown, wing_holds};

#[test]
fn every_defect_of_the_lidars_stream_shows_and_only_with_its_switch() {
    wing_holds(&["XV-"]);
}

#[test]
fn the_second_packet_fails_by_the_sum_of_the_first() {
    assert_figure(
        "XV-01",
        "checksum of the second packet",
        "3028 for 519B",
        "as sent",
    );
}

/// A flipped bit 5 of the high byte adds 8192 mm to 1000 mm.
#[test]
fn a_flipped_bit_is_eight_metres() {
    assert_figure(
        "XV-02",
        "first distance",
        "9192 mm",
        "none, the packet is rejected",
    );
}

#[test]
fn damaged_indices_write_where_the_catalogue_says() {
    let places = "360, 380, 64896, 65532";
    assert_figure(
        "XV-03",
        "places written beside the array of 360",
        places,
        "none",
    );
}

/// 21 turns are 1890 packets, the first of which is cut.
#[test]
fn the_false_lock_is_for_ever() {
    assert_figure("XV-04", "writes beside the array", "1889", "0");
    assert_figure("XV-04", "packets of 21 turns taken", "0", "1889");
}

/// The catalogue's count is 119 of 2000 with other random numbers: about one in seventeen.
#[test]
fn a_lost_byte_hits_memory_about_once_in_seventeen_turns() {
    let xv_05 = shown("XV-05");
    let name = "of 2000 turns that lost a byte, with a write beside the array";
    let hit: u32 = figure(&xv_05.defective, name).parse().expect("a count");
    assert!((80..=160).contains(&hit), "{hit}");
    assert_eq!(figure(&xv_05.sound, name), "0");
}
