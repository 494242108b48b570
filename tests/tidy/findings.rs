//! Findings of users, attackers and measurements, each with the test that failed before the fix.
//!
//! The numbers are those of the list of findings; comments use them. A finding that is no fault, or
//! is not fixed, has a heading in FIDELITY.md instead.

use std::collections::BTreeSet;

use crate::files::{all, functions};

/// Protection against the return of a finding.
enum Kept {
    /// These tests.
    Tests(&'static [&'static str]),
    /// The finding is not fixed; the reason is below this heading of FIDELITY.md.
    Left(&'static str),
}

use Kept::{Left, Tests};

/// Number, description, and protection.
#[rustfmt::skip]
const FINDINGS: &[(&str, &str, Kept)] = &[
    ("U3", "a case of a one-way dump was red for ever, one of a foreign program tested ours", Tests(&[
        "a_dump_of_one_direction_becomes_a_case_of_its_decoder",
        "a_case_of_a_foreign_program_says_which_program_it_tests",
    ])),
    ("U4", "a closed pipe was a panic", Tests(&["u4_a_reader_who_has_seen_enough_ends_no_command"])),
    ("U5", "fuzz --exec blamed programs for devices beyond their ports, and for reading slowly", Tests(&[
        "u5_a_rule_is_broken_only_by_who_can_reach_its_device",
        "who_reads_slowly_but_steadily_does_not_hang",
    ])),
    ("U9", "starts and waypoints at infinity were taken", Tests(&[
        "a_start_beyond_the_horizon_is_refused", "a_waypoint_beyond_the_horizon_is_refused",
    ])),
    ("U10", "results overwritten in silence, torn imports, cut captures, a limit not named", Tests(&[
        "u10_two_runs_never_share_a_folder", "u10_an_import_is_whole_or_not_there",
        "u10_a_span_beyond_a_week_names_its_limit",
        "a_cut_or_broken_capture_is_told_up_to_the_damage",
        "an_interrupted_run_without_a_program_leaves_its_folder_too",
    ])),
    ("U11", "keys on no page, and sessions that always failed if saved early", Tests(&[
        "every_key_of_the_schema_stands_on_the_page",
        "u11_a_session_saved_early_does_not_fail_of_its_mission",
    ])),
    ("R1", "all scenarios repeated the same missions in one room", Tests(&[
        "worlds_are_the_scenarios_own_or_made_up_and_every_mission_can_be_done",
    ])),
    ("R2", "minimised cases lost their cause", Tests(&[
        "encoders_that_stick_stay_to_blame", "a_radio_that_is_cut_for_ever_stays_to_blame",
        "an_obstacle_in_the_door_stays_to_blame", "a_blinded_lidar_stays_to_blame",
        "a_drive_that_is_off_stays_to_blame",
    ])),
    ("R3", "a campaign lost finished runs, two processes did the same ones", Tests(&[
        "a_kill_at_any_moment_loses_no_finished_run",
        "a_second_process_is_refused_until_the_first_is_dead",
    ])),
    ("R4", "the robot dithered at a corner", Tests(&[
        "a_robot_at_a_corner_finds_its_way_round", "a_robot_at_a_corner_leaves_it_behind",
    ])),
    ("R5", "a lost pose was never found again", Tests(&[
        "the_whole_map_is_searched_ever_more_rarely",
        "an_unseen_motion_is_looked_for_until_a_scan_fits_or_the_world_has_changed",
    ])),
    ("R6", "it drove off right after its lidar came back", Tests(&[
        "a_robot_whose_lidar_has_come_back_waits_for_two_further_turns",
    ])),
    ("R7", "recordings died of a moved file and overwrote others", Tests(&[
        "a_file_that_was_moved_away_ends_nothing", "a_rig_that_is_started_again_overwrites_no_capture",
        "a_file_that_is_there_already_is_not_overwritten", "a_disk_without_room_is_told_at_once",
    ])),
    ("R8", "notes beside the ports were written through links", Tests(&[
        "a_note_is_not_written_through_a_link", "the_record_is_not_written_through_a_link",
    ])),
    ("R9", "a day of silence looked like a hang", Tests(&[
        "a_day_of_silence_in_a_capture_is_played_as_a_minute",
        "a_day_of_silence_is_played_as_a_minute_and_told",
    ])),
    ("R10", "clients were blamed for a late rig", Tests(&[
        "a_rig_that_was_stopped_loses_nothing_and_blames_nobody",
    ])),
    ("R11", "memory, connections and verdicts without bounds", Tests(&[
        "more_walls_than_a_scene_can_have_are_refused_before_they_are_read",
        "silent_clients_keep_nobody_out", "foreign_origins_and_hosts_are_refused",
        "a_full_disk_costs_the_files_and_not_the_verdicts",
    ])),
    ("R12", "a replay threw verdicts away, checks passed with nothing to watch", Tests(&[
        "a_runs_capture_is_replayed_by_the_command",
    ])),
    ("L1", "lidar clients were blamed for a late rig", Tests(&[
        "a_rig_that_was_stopped_loses_nothing_and_blames_nobody",
    ])),
    ("L2", "a character of the next header in the boot text", Tests(&[
        "the_boot_text_ends_where_a_turn_begins",
    ])),
    ("L3", "a capture's own blocks were read as the lidar's bytes", Tests(&[
        "of_a_capture_only_what_the_lidar_sent_is_read",
    ])),
    ("L4", "the unfinished tail was in no count", Tests(&[
        "every_byte_is_in_a_frame_or_outside_also_at_the_end",
    ])),
    ("L5", "clients were blamed for the scenario's own PC", Tests(&[
        "a_client_reaches_what_hangs_on_its_port_and_nothing_else",
    ])),
    ("L6", "a port handed over whole packets only", Tests(&[
        "a_client_behind_an_adapter_reads_pieces_of_packets",
        "an_rplidars_turns_do_not_depend_on_where_its_stream_is_cut",
    ])),
    ("L7", "a corner that a beam meets was nearly always a double dot", Tests(&[
        "l7_a_beam_that_meets_a_corner_is_a_double_dot_in_8_of_71_turns",
        "l7_where_a_corner_lies_in_the_dot_decides_how_often_it_is_double",
    ])),
    ("P1", "the fielded PC program could not read its port", Tests(&[
        "a_pc_program_that_sets_no_rate_reads_every_frame",
    ])),
    ("P2", "the PC's port was promised where there is none", Tests(&[
        "the_table_names_the_pcs_end_only_if_it_is_wanted",
    ])),
    ("P3", "a frame cut at the end was in no count", Tests(&[
        "every_byte_is_in_a_frame_or_outside_also_at_the_end",
    ])),
    ("P4", "exhibits that passed without their defect", Tests(&[
        "exhibits_read_no_switch_themselves", "every_defect_of_navigation_shows_and_only_with_its_switch",
        "a_write_lands_in_the_header_of_its_own_acknowledgement",
    ])),
    ("P5", "the model of the fielded PC program differed from it", Tests(&[
        "p5_a_map_that_is_not_square_is_painted_over_itself", "p5_a_plain_row_is_as_long_as_it_is",
        "p5_a_coded_row_may_end_in_a_lone_count_of_0", "p5_a_second_size_keeps_the_map",
    ])),
    ("P6", "docs of functions without their errors, figures without unit", Left("Docs of items")),
    ("F1", "memory of the AVR base behind its map was wrong", Tests(&[
        "f1_the_memory_behind_the_map_is_that_of_the_chip",
        "f1_a_read_over_the_end_of_the_sensors_is_the_chips",
    ])),
    ("F2", "a write over 53 or 59 was answered wrongly", Tests(&[
        "f2_a_write_that_covers_59_is_acknowledged_with_that_byte",
        "f2_a_write_over_53_does_not_redirect_its_remaining_bytes",
        "f2_a_pointer_that_is_overwritten_stays",
    ])),
    ("F3", "a write over the motors' state had no effect", Tests(&[
        "f3_a_write_over_the_motors_state_changes_it",
    ])),
    ("F4", "the map of the 2014 build lay where that of 2015 lies", Tests(&[
        "f4_the_map_of_2014_begins_one_byte_higher",
    ])),
    ("F5", "requests back to back had 1.2 answers over phases, the chip has 2.9", Left(
        "AVR base, requests back to back",
    )),
    ("F6", "public tools did not wait for the radio's answer", Tests(&[
        "f6_the_waits_of_six_public_tools_are_long_enough", "f6_the_silence_can_be_set",
    ])),
    ("F7", "the client at the right rate was blamed", Tests(&[
        "f7_the_line_that_the_module_tells_is_the_one_it_uses",
    ])),
    ("F8", "statistics told the emulated XV-11 from a real one", Tests(&[
        "f8_a_classifier_hardly_tells_real_windows_from_emulated_ones",
        "f8_the_speed_wanders_over_teeth_as_captured",
        "f8_reflectivity_varies_smoothly_along_a_wall",
        "f8_teeth_stay_in_place_while_the_speed_wanders", "each_fault_is_found_in_its_group",
    ])),
    ("F9", "figures of the room were judged, 2.1 had the noise of 2.4", Tests(&[
        "f9_figures_of_the_room_are_not_judged_against_another_room", "f9_the_noise_of_2_1_is_its_own",
    ])),
    ("F10", "a scan request right behind a stop was thrown away", Tests(&[
        "f10_a_scan_right_behind_a_stop_is_answered",
        "f10_requests_back_to_back_are_answered_in_their_order",
    ])),
    ("F11", "firmware 1.29 of the RPLIDAR had not the modes of real units", Tests(&[
        "f11_firmware_1_29_tells_its_five_modes_and_streams_each",
        "f11_scans_of_the_kind_84_show_the_same_room",
    ])),
    ("F12", "the start text was another, and missing at power-up", Tests(&[
        "f12_a_reset_and_power_up_print_the_start_text",
    ])),
    ("F13", "the RPLIDAR had no invalid readings", Tests(&[
        "f13_edges_and_spots_give_no_measurement", "f13_the_quality_says_valid_or_not",
    ])),
    ("F14", "the odometer went on without its sensor, and had no bootloader", Tests(&[
        "f14_a_sensor_that_is_lost_silences_the_board",
        "f14_a_board_without_sensor_says_so_until_it_has_one",
        "f14_the_later_sketch_prints_as_on_the_chip", "opening_the_port_begins_anew",
    ])),
    ("F15", "a board without its encoder said 0 for ever", Tests(&[
        "f15_a_board_without_its_encoder_is_refused",
    ])),
    ("F16", "walls in a world without a robot were taken in silence", Tests(&[
        "a_world_and_what_measures_it_are_told_where_there_is_no_robot",
    ])),
    ("F17", "chips on I2C could not be used from outside and forgot registers", Tests(&[
        "f17_frames_keep_messages_apart", "f17_registers_keep_what_is_written",
        "f17_a_sample_is_ready_at_the_sample_rate", "f17_the_fifo_holds_samples_until_they_are_read",
        "f17_an_odd_address_is_none", "f17_ann_mode_tells_the_slice_of_the_echo",
        "f17_nobody_answers_a_general_call_and_a_busy_bus_reads_ff",
    ])),
    ("F18", "the phone's packets were not checked to their end", Tests(&[
        "f18_bytes_behind_a_packet_of_the_phone_make_it_bad",
    ])),
    ("F18, the rest", "address patterns, kill and fader, details of yellow", Left(
        "Phone of the car and radio of yellow",
    )),
    ("T1", "conversions of time, parity, and the limit of two rates", Tests(&[
        "conversions_agree_with_arithmetic_by_hand", "every_bit_of_a_character_is_counted",
        "lines_agree_up_to_one_per_cent", "lines_of_another_coding_never_agree",
    ])),
    ("T2", "words, digits and limits of panel, radio and PC link", Tests(&[
        "on_and_off_are_told_apart", "ragged_payloads_mean_nothing", "a_frame_needs_all_its_room",
        "pixels_end_with_their_frame", "a_frame_too_long_for_its_decoder_is_told",
        "each_question_has_its_word", "an_address_is_twelve_digits", "a_line_coding_has_three_figures",
        "families_have_names", "a_list_knows_how_long_it_is",
    ])),
    ("T3", "the radio out of reach, its overflow; torn reads and mounts of the base", Tests(&[
        "out_of_reach_begins_and_ends_by_its_name", "an_overflow_is_told_with_its_size",
        "a_lost_carrier_needs_no_poll", "a_carry_during_the_copy_tears_the_count",
        "each_sensor_looks_where_its_name_says",
    ])),
    ("T4", "late and doubled teeth, edges of the dot", Tests(&[
        "a_lock_takes_fifteen_even_teeth", "after_a_doubled_tooth_slots_are_a_tooth_ahead",
        "a_head_that_stops_is_given_up_after_20_ms", "the_dot_on_an_edge_is_what_the_draw_says",
        "a_dot_that_hardly_touches_is_seen_in_between",
    ])),
    ("T5", "the wall law, sides, stalls, arcs, and what an idle line frees", Tests(&[
        "what_is_near_ahead_is_turned_away_from", "the_nearest_ahead_is_told_for_each_side",
        "a_side_once_taken_is_kept_unless_the_other_is_much_better",
        "a_goal_that_comes_no_nearer_is_reached_after_three_seconds",
        "the_fielded_law_brings_one_side_back", "an_arc_ends_on_its_circle",
        "a_frame_that_an_idle_line_frees_must_be_the_answer", "a_post_beside_the_way_is_reached_later",
    ])),
    ("T6", "the least traffic that counts as busy", Tests(&[
        "t6_ten_bytes_a_second_all_the_time_are_busy",
    ])),
];

/// Tests and headings of `kept` that do not exist, if `defined` are all functions.
fn missing(kept: &Kept, defined: &BTreeSet<&str>, fidelity: &str) -> Vec<String> {
    match kept {
        Tests(names) => names
            .iter()
            .filter(|name| !defined.contains(**name))
            .map(|name| (*name).to_owned())
            .collect(),
        Left(heading) => {
            let line = format!("## {heading}");
            let is_there = fidelity.lines().any(|other| other == line);
            Vec::from_iter((!is_there).then_some(line))
        }
    }
}

#[test]
fn every_finding_has_its_test_or_its_reason() {
    let sample: BTreeSet<&str> = functions("fn a_test() {}\nfn gone_by() {}").collect();
    assert!(missing(&Tests(&["a_test"]), &sample, "").is_empty());
    assert_eq!(missing(&Tests(&["a_test", "gone"]), &sample, ""), ["gone"]);
    assert!(missing(&Left("Why"), &sample, "# F\n## Why\n").is_empty());
    assert_eq!(missing(&Left("Why"), &sample, "## Why not\n"), ["## Why"]);

    let sources = all(&[".rs"]);
    let defined: BTreeSet<&str> = sources
        .iter()
        .flat_map(|file| functions(&file.text))
        .collect();
    let pages = all(&["FIDELITY.md"]);
    for (number, what, kept) in FINDINGS {
        let gone = missing(kept, &defined, &pages[0].text);
        assert!(gone.is_empty(), "{number}, {what}: there is no {gone:?}");
        let is_empty = matches!(kept, Tests([]));
        assert!(!is_empty && !what.is_empty(), "{number}");
    }
    let mut numbers: Vec<_> = FINDINGS.iter().map(|(number, ..)| number).collect();
    numbers.dedup();
    assert_eq!(numbers.len(), FINDINGS.len());
}

/// Whether a line of an exhibit reads a switch of the program, instead of only passing it on.
fn reads_switch(line: &str) -> bool {
    const FIELDS: [&str; 3] = ["defects.", ".defects)", "Defects::FIELDED"];
    let code = line.trim_start();
    let is_code = !code.starts_with("//");
    let after = |field: &str| code.split_once(field).map(|(_, rest)| rest.to_owned());
    // `if`, `match` and operators read a value; passing it to a program as a whole does not.
    let looks = ["if ", "match ", "||", "&&", "!", "=="]
        .iter()
        .any(|word| code.contains(word));
    is_code && looks && FIELDS.iter().any(|field| after(field).is_some())
}

/// P4: an exhibit that reads a switch and imitates the program would still show the defect after
/// the program has lost it.
#[test]
fn exhibits_read_no_switch_themselves() {
    assert!(reads_switch(
        "    if defects.wraps_one_side || defects.counts_turns {"
    ));
    assert!(!reads_switch(
        "        let defects = config(variant, id).defects.base;"
    ));
    let files = all(&[".rs"]);
    let museum = files
        .iter()
        .filter(|file| file.path.starts_with("crates/museum/src/"));
    let mut looked_at = 0;
    for file in museum {
        looked_at += 1;
        for (number, line) in file.product_lines() {
            assert!(!reads_switch(line), "{}:{number}: {line}", file.path);
        }
    }
    assert!(looked_at > 10, "{looked_at}");
}
