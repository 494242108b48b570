//! Yellow's programs. Bytes and figures: knowledge of the robot's public code, part B.

use super::{assert_figure, figure, shown, wing_holds};

#[test]
fn every_defect_of_yellows_link_shows_and_only_with_its_switch() {
    wing_holds(&["YF-"]);
}

#[test]
fn every_defect_of_yellows_lidar_driver_shows_and_only_with_its_switch() {
    wing_holds(&["YL-"]);
}

#[test]
fn every_defect_of_yellows_states_and_manoeuvres_shows_and_only_with_its_switch() {
    wing_holds(&["YS-", "YA-"]);
}

#[test]
fn every_defect_of_yellows_driving_shows_and_only_with_its_switch() {
    wing_holds(&["YM-", "YR-"]);
}

#[test]
fn every_defect_of_yellows_lines_shows_and_only_with_its_switch() {
    wing_holds(&["YN-"]);
}

#[test]
fn every_defect_of_yellows_pc_shows_and_only_with_its_switch() {
    wing_holds(&["YP-"]);
}

/// A flipped bit makes 3F800000, 1.0, of 3E800000, 0.25. The sound program detects the wrong
/// checksum and stands still.
#[test]
fn a_flipped_bit_is_one_metre_a_second() {
    let name = "speed after 0.25 with a flipped bit, m/s";
    assert_figure("YF-01", name, "1", "0");
    let name = "where the robot is for the PC, mm";
    assert_figure("YP-05", name, "1000", "250");
}

/// 360 points on the link are 3525 bytes for a buffer of 3200; 180 of them fit.
#[test]
fn an_answer_that_is_too_long_is_the_message_before() {
    let name = "the answer is younger than the message before by, ms";
    assert_figure("YF-04", name, "0", "200");
    assert_figure("YF-04", "points of the scan", "0", "180");
}

/// Two groups a millisecond; up to half of the groups at a wrong offset look like nodes by chance.
#[test]
fn hardly_a_group_is_a_node_once_a_byte_is_lost() {
    for id in ["YL-01", "YL-01b", "YL-01c", "YL-02"] {
        let of_two_thousand = shown(id);
        let bad = figure(&of_two_thousand.defective, "of them without a node's bits");
        let bad: u32 = bad.parse().expect("a count");
        assert!((900..=2_001).contains(&bad), "{id}: {bad}");
    }
}

/// The mean of 970, 970, 1000, 1030 and 1030 mm without the extremes is 1000.
#[test]
fn five_copies_jump_where_five_turns_stand() {
    let yl_05 = shown("YL-05");
    let name = "distance ahead in two sets, mm";
    assert_eq!(figure(&yl_05.sound, name), "1000 and 1000");
    let told = figure(&yl_05.defective, name);
    let turns = ["970", "1000", "1030"];
    let seen = told.split(" and ").collect::<Vec<_>>();
    assert!(seen.iter().all(|one| turns.contains(one)), "{told}");
    assert_ne!(seen[0], seen[1]);
}

/// The long direction instead of the short 0.28 rad: 0.28 - 2 pi = -6.0.
#[test]
fn the_long_way_is_six_radians() {
    assert_figure(
        "YA-01",
        "turned from heading 3.0 to -3.0, rad",
        "-6.0",
        "0.3",
    );
}

/// 5 counts of 0.19635 mm; the fielded program uses the left wheel's previous value 0.
#[test]
fn a_wrap_costs_a_wheel_its_way() {
    assert_figure(
        "YM-01",
        "distance of 5 counts across the counter's end, mm",
        "0.49",
        "0.98",
    );
}

/// A chord of 180 mm, shifted by half of the 9.8 mrad of 9 counts.
#[test]
fn half_a_turn_on_one_wheel_is_off_by_a_millimetre() {
    assert_figure(
        "YM-02",
        "position error after half a turn on one wheel, mm",
        "0.9",
        "0.0",
    );
}

/// Worked out by hand: with 9 V instead of 12, the speed n for a target n* is n = 3/4 (K (n* - n) +
/// n*/40) 40. The right motor runs backwards, where K = 0.1: n = 3.75/4 n*, which is 6.25 % short.
#[test]
fn a_weak_battery_costs_some_per_cent_without_an_integral_part() {
    let ym_03 = shown("YM-03");
    let name = "slower than asked for, per cent";
    let [fielded, sound] = [&ym_03.defective, &ym_03.sound]
        .map(|side| figure(side, name).parse::<f64>().expect("a number"));
    assert!((fielded - 6.25).abs() < 1.0, "{fielded}");
    assert!(sound.abs() < 0.5, "{sound}");
}

/// B4: 2.1 m/s and 13.4 rad/s with walls at 0.2, 0.15 and 0.25 m and a nominal 0.5 m/s. B3: a wall
/// at 0.8 m is read as 0.38 m.
#[test]
fn the_fielded_formulas_say_what_was_evaluated() {
    assert_figure("YR-01", "wanted turn, rad/s", "13.4", "1.0");
    assert_figure("YR-02", "read of a wall at 0.8 m, m", "0.38", "0.80");
}

#[test]
fn an_octagon_has_less_than_eight_walls() {
    assert_eq!(figure(&shown("YN-01").sound, "walls of an octagon"), "8");
    assert_figure("YN-02", "lines of two rows of two points", "1", "0");
    assert_figure("YN-03", "lines of two points", "1", "0");
    assert_figure("YN-04", "lines of three points", "0", "1");
    assert_eq!(figure(&shown("YN-05").sound, "lines of one wall"), "1");
}

/// Telemetry each 200 ms carries one order.
#[test]
fn orders_of_one_moment_go_out_with_the_frames() {
    let name = "three orders of one moment arrive after, ms";
    assert_figure("YP-01", name, "[200, 400, 600]", "[1, 1, 1]");
    assert_figure("YP-03", "speeds that the robot was told", "0", "1");
}

/// The wall at 20.05 + 1 m lies in the cell that ends at 21.1, with at most two cells of margin.
/// The fielded program has 12.7 m instead of 20.05.
#[test]
fn eight_bits_end_at_12_7_metres() {
    let yp_06 = shown("YP-06");
    let name = "right edge of the map of a room at 20 m, m";
    let [fielded, sound] = [&yp_06.defective, &yp_06.sound]
        .map(|side| figure(side, name).parse::<f64>().expect("metres"));
    assert!((21.1..21.35).contains(&sound), "{sound}");
    assert!((13.7..14.05).contains(&fielded), "{fielded}");
}
