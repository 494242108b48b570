//! Data that the PC receives, and the robot's reaction to data from the PC.

use core::time::Duration;

use firmware_core::robots::rescue::Config;
use firmware_core::{Inspect, Master};
use protocols::pcui::{self, HEADER_LEN, seal};

use crate::bench::{Bench, SECOND, flat};

/// Field defects PU-06 and PU-18: poses and text inside map rows damaged both. All data for the PC
/// must be whole frames.
#[test]
fn the_pc_hears_whole_frames_only() {
    let mut bench = Bench::new(flat(), 1);
    bench.send_waypoints(&[[1000, 2000], [1000, 1000]]);
    bench.run_for(15 * SECOND);
    assert_eq!((bench.heard.errors, bench.heard_discarded()), (0, 0));
    assert_eq!(bench.counter("radio queue overflows"), 0);
}

/// Seed report: the pose each 50 ms, also while the search occupies the processor; field defect
/// SL-13: psi stays within a turn.
#[test]
fn the_pose_comes_each_50_ms() {
    let mut bench = Bench::searching(flat(), 2);
    bench.run_for(10 * SECOND);
    let times: Vec<_> = bench.heard.properties.iter().map(|(at, _)| *at).collect();
    assert!((199..=201).contains(&times.len()), "{}", times.len());
    let longest = times.windows(2).map(|pair| pair[1] - pair[0]).max();
    assert!(longest < Some(Duration::from_millis(70)), "{longest:?}");
    let (_, map) = bench.heard.properties[0];
    assert_eq!(
        (map.resolution_mm, map.size_mm, map.layers),
        (10, [3000, 3000], 1)
    );
    assert_eq!(
        (map.position_mm, map.psi_deg),
        ([1000, 1000], 90),
        "the start pose"
    );
}

/// All 300 rows in turn; paced for the radio they take some seconds.
#[test]
fn the_rows_come_round_in_order() {
    let mut bench = Bench::new(flat(), 3);
    bench.run_for(30 * SECOND);
    let rows = &bench.heard.rows;
    assert!(rows.len() > 900, "{}", rows.len());
    assert!(rows.windows(2).all(|pair| pair[1] == (pair[0] + 1) % 300));
    let per_second = bench.heard_bytes / 30;
    assert!(per_second <= 12_500, "{per_second} bytes a second");
}

/// Seed figure S7: 300 x 300 cells take 1.953 s at 460800 baud with ten bits a byte. With 20 bytes
/// of header for each of 300 rows and a pose each 50 ms, the time is 2.1 s; run-length encoding
/// shortens it.
#[test]
fn an_unpaced_map_needs_no_longer_than_the_line() {
    let mut config = Config::default();
    config.pc_link.pace_bytes_per_s = None;
    let mut bench = Bench::with_config(flat(), 4, config);
    bench.run_for(10 * SECOND);
    let (rows, bytes) = (bench.heard.rows.len(), bench.heard_bytes);
    bench.run_for(10 * SECOND);
    let per_pass = (bench.heard_bytes - bytes) * 300 / (bench.heard.rows.len() - rows);
    assert!(bench.heard_bytes - bytes > 440_000, "the line is kept busy");
    assert!(per_pass < 97_000, "{per_pass} bytes a pass");
}

/// Fielded program: the robot returns the list; here with the numbers that the robot assigned, in
/// order.
#[test]
fn a_received_list_comes_back() {
    let mut bench = Bench::new(flat(), 5);
    bench.send_waypoints(&[[1000, 2000], [-20, 5]]);
    bench.run_for(SECOND);
    let echo = bench.heard.echoes.last().expect("an echo");
    let seen: Vec<_> = echo
        .iter()
        .map(|waypoint| (waypoint.id, waypoint.previous, waypoint.position_mm))
        .collect();
    assert_eq!(seen, [(0, -1, [1000, 2000]), (1, 0, [-20, 5])]);

    bench.send_waypoints(&[]);
    bench.run_for(SECOND);
    assert_eq!(bench.heard.echoes.last(), Some(&Vec::new()));
}

/// Field defects PU-12 and PU-13: lists of 21 or more waypoints overran a queue of 200 bytes. The
/// robot's list holds 100.
#[test]
fn the_longest_list_is_taken_in_one_burst() {
    let mut bench = Bench::new(flat(), 6);
    let list: Vec<_> = (0..100).map(|n| [n, n]).collect();
    bench.send_waypoints(&list);
    bench.run_for(SECOND);
    assert_eq!(bench.robot.waypoints().all().len(), 100);
    assert_eq!(bench.heard.echoes.last().map(Vec::len), Some(100));
}

/// A frame that announces 903 bytes is a longer list than the robot accepts: it replies with its
/// present list.
#[test]
fn a_list_that_is_too_long_is_answered_by_the_one_that_there_is() {
    let mut bench = Bench::new(flat(), 6);
    bench.send_waypoints(&[[500, 600]]);
    bench.run_for(SECOND);
    let before = bench.heard.echoes.len();
    let header = *b"PCUI_MSG\x87\x03\x00\x00\x00\x00LWP";
    bench.send(&header);
    bench.run_for(SECOND);
    let places =
        |list: &Vec<pcui::message::Waypoint>| list.iter().map(|one| one.position_mm).collect();
    let echoes: Vec<Vec<_>> = bench.heard.echoes[before..].iter().map(places).collect();
    assert_eq!(echoes, [[[500, 600]]]);
}

/// Field defects PU-01, PU-03, PU-04, PU-05: each of these frames cost the fielded robot the next
/// frame, stopped its receiver for good, or made waypoints from stale memory. A valid list follows
/// each of them.
#[test]
fn damaged_frames_do_not_cost_the_good_one_behind_them() {
    let mut short_list = [0; 64];
    short_list[HEADER_LEN] = 50;
    let len = seal(&mut short_list, *b"LWP", 11).expect("fits");
    let mut empty = [0; 32];
    let empty_len = seal(&mut empty, *b"STA", 0).expect("fits");
    let damaged: [&[u8]; 6] = [
        b"P",
        b"PCUI_",
        b"PCUI_MSG\x00\x80\x00\x00\x00\x00STA",
        &empty[..empty_len],
        &short_list[..len],
        b"time: 5, quality: 7\r\n",
    ];
    for (index, damage) in (0..).zip(damaged) {
        let mut bench = Bench::new(flat(), 7);
        bench.send(damage);
        bench.send_waypoints(&[[index, 1500]]);
        let positions: Vec<_> = bench
            .robot
            .waypoints()
            .all()
            .iter()
            .map(|w| w.position_mm)
            .collect();
        assert_eq!(
            positions,
            [[index, 1500]],
            "behind {}",
            damage.escape_ascii()
        );
    }
}

/// A cut frame must not consume the next frame, which follows after a pause.
#[test]
fn a_cut_off_frame_is_given_up_after_a_pause() {
    let mut bench = Bench::new(flat(), 8);
    bench.send(b"PCUI_MSG\xFF\x01\x00\x00\x00\x00LWP\x38\x00");
    bench.run_for(Duration::from_millis(150));
    bench.send_waypoints(&[[1000, 1500]]);
    assert_eq!(bench.robot.waypoints().all().len(), 1);
    assert_eq!(bench.counter("radio bad frames"), 1);
}

/// The robot's own messages have no meaning as input, and neither has an unknown id.
#[test]
fn frames_without_meaning_are_counted() {
    let mut bench = Bench::new(flat(), 9);
    for id in [*b"MAR", *b"WAY", *b"MPD"] {
        let mut frame = [0; pcui::FRAME_MAX];
        let len = seal(&mut frame, id, 13).expect("fits");
        bench.send(&frame[..len]);
    }
    assert_eq!(bench.counter("radio frames without meaning"), 3);
}

/// A blocked line fills the queue. The lost frames are counted, and no partial frame is sent when
/// the line accepts bytes again.
#[test]
fn a_blocked_line_costs_frames_but_never_halves() {
    let mut bench = Bench::new(flat(), 10);
    bench.radio_is_blocked = true;
    bench.run_for(10 * SECOND);
    assert!(bench.counter("radio queue overflows") > 0);
    bench.radio_is_blocked = false;
    bench.run_for(10 * SECOND);
    assert_eq!((bench.heard.errors, bench.heard_discarded()), (0, 0));
    assert!(bench.heard.properties.len() > 199);
}

/// A program that is polled repeatedly at the same time must not repeat an action.
#[test]
fn polling_twice_is_harmless() {
    let (mut once, mut twice) = (Bench::new(flat(), 11), Bench::new(flat(), 11));
    twice.polls_twice = true;
    for bench in [&mut once, &mut twice] {
        bench.send_waypoints(&[[1000, 1500]]);
        bench.run_for(5 * SECOND);
    }
    let scans = |bench: &Bench| bench.counter("scans");
    assert_eq!(scans(&once), scans(&twice));
    assert_eq!(once.robot.estimate(), twice.robot.estimate());
    assert_eq!(once.heard.rows, twice.heard.rows);
    assert!(once.robot.poll_at().is_some());
}
