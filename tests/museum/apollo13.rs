//! The model car: figures worked out by hand or from the catalogue.

use hilrig::museum::{self, Live};

use super::{assert_figure, figure, shown, wing_holds};

#[test]
fn every_defect_of_the_car_shows_and_the_sound_one_does_not() {
    wing_holds(&["AF-"]);
    let not_live: Vec<&str> = museum::catalogue()
        .filter(|bug| bug.id.starts_with("AF-") && matches!(bug.live, Live::Not(_)))
        .map(|bug| bug.id)
        .collect();
    assert_eq!(not_live, ["AF-16", "AF-22", "AF-23", "AF-24", "AF-25"]);
}

/// The byte 0D is 13, a carriage return; the byte 0A is 10, a newline.
#[test]
fn a_carriage_return_makes_10_cm_of_13() {
    assert_figure("AF-01", "13 cm ahead are read as, m", "0.10", "0.13");
    assert_figure("AF-02", "frames behind a stray zero", "0", "1");
    assert_figure("AF-10", "40 cm ahead after ten frames, m", "none", "0.40");
}

/// The battery is read from its low byte 1C and the first byte of the next frame, 00: 28 mV.
#[test]
fn a_lost_byte_makes_a_battery_of_28_millivolts() {
    assert_figure("AF-09", "battery, mV", "28", "7200");
}

/// 3.7 s minus the loop are 368 to 372 lines.
#[test]
fn no_line_of_a_curve_is_believed() {
    let curve = shown("AF-03");
    let number = |name| -> u32 { figure(&curve.sound, name).parse().expect("a number") };
    assert!((365..=375).contains(&number("lines in the curve")));
    assert_eq!(number("of them believed"), number("lines in the curve"));
    assert_figure(
        "AF-03",
        "of them believed",
        "0",
        &number("of them believed").to_string(),
    );
}

/// 2 bytes go out each millisecond, 1000 times a second, or each 20 ms, 50 times a second. 2000 of
/// 11520 bytes a second are 17 per cent.
#[test]
fn commands_each_millisecond_take_a_sixth_of_the_line() {
    assert_figure("AF-04", "bytes in a second", "2000", "100");
    assert_figure("AF-04", "of the line, per cent", "17", "0");
}

/// The fielded scale is 25 of 2000, which is 0.205 of the sensor's 0.061. So 0.36 rad/s with a bias
/// of 0.5 degrees a second gives 0.076 rad/s. 5 s at 5.1 degrees a second are 26 degrees.
#[test]
fn rates_and_turns_are_those_of_the_catalogue() {
    assert_figure("AF-12", "0.36 rad/s are told as", "0.08", "0.36");
    let turned = shown("AF-15");
    let degrees: f64 = figure(&turned.defective, "turned in 5 s, degrees")
        .parse()
        .expect("it is");
    assert!((22.0..=26.0).contains(&degrees), "{degrees}");
}

/// Of 1343 edges in 1000 polls, 657 count and 343 pairs cancel; see the encoder's own test.
#[test]
fn a_polled_encoder_loses_half_and_then_runs_backwards() {
    assert_figure("AF-11", "counted at 0.22 m/s", "1.00", "1.00");
    let shown = shown("AF-11");
    assert_eq!(figure(&shown.sound, "counted at 0.90 m/s"), "1.00");
    assert!(figure(&shown.defective, "counted at 0.90 m/s").starts_with("-0.2"));
}

/// Steering value 1 is 5.2 degrees, value 0 is 6.0. Half a radian along the circle of 15 degrees
/// ends 0.2416 m to the left and 0.4300 m ahead. With the report's sign, atan(0.1247 / 0.0214) is
/// 80.3 degrees.
#[test]
fn laws_of_the_report_lead_elsewhere() {
    assert_figure("AF-17", "5.9 degrees become", "5.2", "6.0");
    assert_figure("AF-18", "steering to where 15 degrees lead", "80.3", "15.0");
}

/// The goal is the gate's middle with the car's own heading, 0, whatever the gate's direction.
#[test]
fn the_fielded_gates_are_anywhere() {
    assert_figure(
        "AF-19",
        "goal in a gate 2 m behind the car, m ahead",
        "-2.00",
        "none",
    );
    assert_figure("AF-20", "heading in a gate of 45 degrees", "0", "45");
    // 0.3 m from one of thirty sightings.
    assert_figure("AF-21", "off the gate's middle, m", "0.30", "0.01");
}
