//! The master's side of the register bus. Bytes and counts: field-bug catalogue, section b.

use super::{assert_figure, shown, wing_holds};

#[test]
fn every_defect_of_the_master_shows_and_only_with_its_switch() {
    wing_holds(&["MA-"]);
}

/// 126 bytes and the first byte of the checksum are 127; ten of them fit.
#[test]
fn a_damaged_count_runs_117_bytes_over_the_buffer() {
    assert_figure("MA-02", "writes beside the buffer", "117", "0");
    assert_figure("MA-01", "the first to offset", "10", "nowhere");
    assert_figure("MA-03", "the first to offset", "-128", "nowhere");
}

/// The short reply 09 09 overwrites only the low half of 01020304.
#[test]
fn a_short_reply_mixes_new_bytes_with_old_ones() {
    assert_figure(
        "MA-04",
        "left encoder",
        "0x01020909",
        "none, the read goes on",
    );
    let sent = shown("MA-04").sound.sent_by("base");
    assert!(sent.ends_with("AB 24 82 09 09 01 63"), "{sent}");
}

/// E0 2E 5A are the battery's bytes; 01 remains of the encoder.
#[test]
fn an_acknowledgement_as_data_is_whatever_lay_there() {
    assert_figure(
        "MA-05",
        "left encoder",
        "0x015a2ee0",
        "none, the read goes on",
    );
}

/// 20 ticks of 0.45379 mm in 40 ms are 227 mm/s.
#[test]
fn twenty_ticks_are_227_millimetres_a_second() {
    assert_figure("MA-10", "speed of the left wheel, mm/s", "2", "227");
}
