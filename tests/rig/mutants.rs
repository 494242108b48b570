//! The fielded program's defects in the whole rig: devices, lines and world, one defect at a time.
//! Each row's sign is false without the defect. The museum's list names the defects that no
//! campaign can show, with the reason; their exhibits catch them.

mod occasions;
mod signs;

use core::time::Duration;

use firmware_core::robots::rescue::{Config, Rescue};
use hilrig::run::Run;
use protocols::Instant;

use super::{in_a_room, start};

/// A defect in the rig.
struct Row {
    id: &'static str,
    /// Text added to the scenario of an empty room, to make the defect visible.
    occasion: fn() -> String,
    /// Time at which the sign is checked.
    after_ms: u64,
    /// The sign of the defect.
    sign: fn(&Run) -> bool,
}

const fn row(
    id: &'static str,
    occasion: fn() -> String,
    after_ms: u64,
    sign: fn(&Run) -> bool,
) -> Row {
    Row {
        id,
        occasion,
        after_ms,
        sign,
    }
}

#[rustfmt::skip]
const ROWS: [Row; 44] = {
    use occasions as o;
    use signs as s;
    [
        row("MA-01", o::way, 3_000, s::memory_is_hurt),
        row("MA-02", o::count_of_126, 3_000, s::memory_is_hurt),
        row("MA-04", o::short_reply, 3_000, s::encoders_jump),
        row("MA-05", o::acknowledgement, 3_000, s::encoders_jump),
        row("MA-06", o::late_base, 8_000, s::memory_is_hurt),
        row("MA-07", o::no_base, 6_000, s::base_is_believed),
        row("MA-08", o::way, 3_000, s::base_complains),
        row("MA-09", o::way, 0, s::battery_is_empty),
        row("MA-10", o::way, 6_000, s::speed_is_told_in_tenths),
        row("XV-01", o::way, 5_000, s::no_scan),
        row("XV-02", o::flipped_lidar, 8_000, s::draws_beyond_the_walls),
        row("XV-03", o::noisy_lidar, 5_000, s::memory_is_hurt),
        row("XV-04", o::noisy_lidar, 5_000, s::memory_is_hurt),
        row("XV-05", o::noisy_lidar, 5_000, s::memory_is_hurt),
        row("XV-06", o::noisy_lidar, 8_000, s::turns_are_lost),
        row("XV-08", o::no_lidar, 8_000, s::pc_hears_nothing),
        row("XV-11", o::dark_exploration, 8_000, s::moves),
        row("XV-12", o::way, 4_000, s::pc_hears_noise),
        row("SL-02", o::way_with_other_dice, 20_000, s::is_lost),
        row("SL-04", o::no_beams, 40_000, s::scan_takes_long),
        row("SL-05", o::spin, 10_000, s::only_what_it_saw_at_rest),
        row("SL-06", o::rest, 15_000, s::no_black_in_the_map),
        row("SL-07", o::backwards_in_the_dark, 7_000, s::believes_wrong),
        row("SL-12", o::rest, 10_000, s::hardly_a_wall_in_the_map),
        row("SL-14", o::mapping_off, 8_350, s::is_lost),
        row("PU-01", o::stray_p, 2_400, s::no_waypoints),
        row("PU-02", o::list_of_high_sum, 5_000, s::no_waypoints),
        row("PU-03", o::negative_length, 6_000, s::no_waypoints),
        row("PU-04", o::frame_without_payload, 2_400, s::no_waypoints),
        row("PU-05", o::list_that_lies, 5_000, s::phantoms),
        row("PU-06", o::way, 5_000, s::pc_hears_noise),
        row("PU-07", o::link_to_nobody, 5_000, s::has_ended),
        row("PU-09", o::two_behind_one, 5_000, s::memory_is_hurt),
        row("PU-10", o::shorter_list, 14_000, s::target_is_nowhere),
        row("PU-11", o::empty_list, 6_000, s::explores),
        row("PU-12", o::list_of_21, 5_000, s::no_waypoints),
        row("PU-14", o::list_of_20, 2_000, s::no_waypoints),
        row("PU-15", o::list_while_off, 9_000, s::half_a_list),
        row("PU-18", o::way, 5_000, s::pc_hears_noise),
        row("PU-20", o::by_hand, 7_000, s::hand_is_forgotten),
        row("PU-21", o::hand_gone, 9_000, s::hand_is_obeyed),
        row("NV-01", o::past_the_seam, 5_500, s::turned_right),
        row("NV-02", o::two_turns, 13_000, s::stays_on_the_spot),
        row("NV-04", o::stop, 6_700, s::moves),
    ]
};

/// Whether the row's sign is true, with its defect or without. Signs of the mapper are compared
/// with the same mapping method.
fn shows(row: &Row, defect: Option<&str>) -> bool {
    let program = match defect {
        Some(id) => format!("[program]\ndefects = [\"{id}\"]\n"),
        None if row.id.starts_with("SL-") => "[program]\nmapper = \"document\"\n".to_owned(),
        None => String::new(),
    };
    let mut text = (row.occasion)();
    match text.find("[program]\n") {
        // If the occasion has settings of the program, the defect is added to them.
        Some(at) => text.insert_str(
            at + "[program]\n".len(),
            program.strip_prefix("[program]\n").unwrap_or(""),
        ),
        None => text += &program,
    }
    let mut run = start(in_a_room("60s", &text));
    run.go_on_until(Instant::ZERO + Duration::from_millis(row.after_ms));
    (row.sign)(&run)
}

fn all_show(prefixes: &[&str]) {
    let of_wing = |row: &&Row| prefixes.iter().any(|prefix| row.id.starts_with(prefix));
    let found: Vec<_> = ROWS
        .iter()
        .filter(of_wing)
        .map(|row| (row.id, shows(row, Some(row.id)), shows(row, None)))
        .filter(|&(_, with, without)| !with || without)
        .collect();
    assert_eq!(found, [], "number, sign with the defect, sign without");
}

#[test]
fn the_rig_tells_the_masters_defects() {
    all_show(&["MA-"]);
}

#[test]
fn the_rig_tells_the_lidars_defects() {
    all_show(&["XV-"]);
}

#[test]
fn the_rig_tells_the_mappers_defects() {
    all_show(&["SL-"]);
}

#[test]
fn the_rig_tells_the_defects_of_radio_and_navigation() {
    all_show(&["PU-", "NV-"]);
}

/// Every switch is a row or one of the defects that no campaign can show. Some of these have a row:
/// bytes that no fault of a campaign makes show them.
#[test]
fn every_defect_is_told_by_the_rig_or_has_its_reason() {
    let hidden = museum::hidden();
    let hidden = hidden.iter().map(|one| &*one.id);
    let hidden = hidden.filter(|id| Config::default().with_defect(id).is_some());
    let mut listed: Vec<_> = ROWS.iter().map(|row| row.id).chain(hidden).collect();
    let mut known: Vec<_> = Config::defects().collect();
    listed.sort_unstable();
    listed.dedup();
    known.sort_unstable();
    assert_eq!(listed, known);
}

fn program(run: &Run) -> &Rescue {
    run.rig.program_as().expect("the rescue robot")
}
