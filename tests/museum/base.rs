//! The base's firmware. Bytes and times: field-bug catalogue, section a, and the observed behaviour
//! of build b77a6df on the wire.

use super::{assert_figure, figure, shown, wing_holds};

#[test]
fn every_defect_of_the_base_shows_and_only_in_the_fielded_builds() {
    wing_holds(&["AV-", "H-AV-"]);
}

/// Both variants receive the same bytes: the sound base has the fielded byte order.
#[test]
fn the_write_that_never_stops_is_the_catalogues() {
    let av_02 = shown("AV-02");
    for side in [&av_02.defective, &av_02.sound] {
        assert_eq!(side.sent_by("master"), "AB 2D 83 00 14 14 01 83");
    }
    assert_eq!(av_02.defective.sent_by("base"), "AB 2D 00 00 D8");
    assert_eq!(
        figure(&av_02.defective, "wheels after 10 s of silence"),
        "turning"
    );
}

#[test]
fn a_foreign_checksum_order_is_answered_by_the_error_frame() {
    let av_01 = shown("AV-01");
    assert_eq!(av_01.defective.sent_by("base"), "AB FF 00 01 AA");
    assert_eq!(figure(&av_01.sound, "bytes of the reply"), "15");
}

#[test]
fn a_write_behind_the_map_is_applied_and_looks_refused() {
    assert_figure("AV-03b", "the memory", "applied", "left alone");
    let av_03b = shown("AV-03b");
    assert!(av_03b.defective.sent_by("base").contains("AB FF 00 01 AA"));
    let told = figure(&av_03b.defective, "the write as the master reads it");
    assert_eq!(told, "refused");
}

/// 12000 mV are 2EE0 hex, of which the high byte 2E = 46 remains.
#[test]
fn twelve_volts_read_as_46_millivolts() {
    assert_figure(
        "AV-05",
        "battery as the master decodes it, mV",
        "46",
        "12000",
    );
}

#[test]
fn of_two_requests_back_to_back_one_is_answered() {
    assert_figure("AV-07", "of two requests answered", "1", "2");
}

#[test]
fn the_build_of_2014_goes_full_ahead_for_minus_twenty() {
    assert_figure("H-AV-2", "right set-point in force", "35", "-20");
    let h_av_1 = shown("H-AV-1");
    assert_eq!(
        figure(&h_av_1.sound, "wheels after 5 s of silence"),
        "at rest"
    );
}

/// P4: a write to address 59 changes the header of its own acknowledgement.
#[test]
fn a_write_lands_in_the_header_of_its_own_acknowledgement() {
    assert_figure(
        "AV-03c",
        "register that the acknowledgement of 59 names",
        "9D",
        "none",
    );
}
