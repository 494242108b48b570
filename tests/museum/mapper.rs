//! The mapper and the odometry. Figures: field-bug catalogue, section d.

use super::{assert_figure, figure, shown, wing_holds};

#[test]
fn every_defect_of_the_mapper_shows_and_only_with_its_switch() {
    wing_holds(&["SL-", "H-SL-"]);
}

#[test]
fn seventeen_overruns_make_65486_tries() {
    assert_figure("SL-03", "tries after 17 overruns", "65486", "0");
    assert_figure("SL-03", "time of the next scan, s", "9.8", "0.0");
}

/// With the report's time per try: 1.06 and 4.66 s after 60 and 300 s. Scans are in time again
/// after 71 s and 21 minutes (1260 s; within half a minute, the precision of the report).
#[test]
fn a_blackout_costs_what_the_catalogue_says() {
    let sl_04 = shown("SL-04");
    let of = |name| figure(&sl_04.defective, name);
    assert_eq!(of("first scan after 60 s without beams, s"), "1.06");
    assert_eq!(of("until scans are in time again, s"), "71");
    assert_eq!(of("first scan after 300 s, s"), "4.66");
    let seconds: u32 = of("until then, s").parse().expect("seconds");
    assert!((1230..=1290).contains(&seconds), "{seconds}");
}

#[test]
fn each_weight_has_its_ceiling() {
    let sound = ["255"; 9].join(", ");
    assert_figure(
        "SL-06",
        "wall after 5000 scans, weights 2 to 10",
        "128, 170, 192, 204, 213, 219, 224, 227, 230",
        &sound,
    );
}

#[test]
fn the_odometrys_errors_are_the_catalogues() {
    assert_figure("SL-07", "y after 100 ticks backwards, mm", "+45.4", "-45.4");
    assert_figure(
        "SL-08",
        "distance of 100 and 99 ticks at psi 720, mm",
        "0.00",
        "45.15",
    );
    assert_figure("SL-09", "x after 100 and 50 ticks, mm", "-2.97", "+1.48");
}

/// One cell of value 255 scores 255 * 1024; in 16 bits, that is -1024.
#[test]
fn one_point_at_the_edge_wins_and_the_score_wraps() {
    let sl_10 = shown("SL-10");
    assert_eq!(
        figure(&sl_10.defective, "score of the place found"),
        "261120"
    );
    assert_figure("SL-11", "score of a full match", "-1024", "261120");
}
