//! YE13 and YE2's over-size scan: content and times of the telemetry.

use protocols::telemetry::PAYLOAD_MAX;
use protocols::telemetry::message::{LinesRequest, State, Telecommand, Telemetry};

use crate::bench::{Bench, SECOND, square};

/// YE13: a message each 200 +-10 ms, by its first byte on the wire.
#[test]
fn ye13_telemetry_comes_each_200_ms() {
    let mut bench = Bench::new(square(2.0));
    bench.run_for(20 * SECOND);
    let starts: Vec<_> = bench.heard.iter().map(|(at, _)| at.as_millis()).collect();
    assert!((99..=101).contains(&starts.len()), "{}", starts.len());
    for pair in starts.windows(2) {
        assert!((190..=210).contains(&(pair[1] - pair[0])), "{pair:?}");
    }
}

/// Content: time, state, pose in metres, three distances. The base message has about 50 bytes
/// (B1.2; here it includes three distances and their own time).
#[test]
fn the_base_message_is_short() {
    let mut bench = Bench::new(square(1.0));
    bench.run_for(2 * SECOND);
    let (at, told) = bench.heard.last().expect("telemetry");
    assert!(at.as_millis().abs_diff(u64::from(told.timestamp_ms)) <= 1);
    assert_eq!(
        (told.state, &told.lidar, &told.lines),
        (Some(State::Off), &None, &None)
    );
    let infrared = told.infrared.as_ref().expect("distances");
    // Walls 0.5 m ahead, sensors on a ring of 9 cm: distances of 0.41 m ahead and 0.487 m at 60
    // degrees. There, noise of 15 mV is 17 mm.
    for (read, truth) in infrared.distances_m.iter().zip([0.41, 0.487, 0.487]) {
        assert!((read - truth).abs() < 0.06, "{read} {truth}");
    }
    let len = bench.payloads.last().map_or(0, Vec::len);
    assert!((40..=60).contains(&len), "{len}");
}

/// The next message with a scan of this step, and the number of messages before it.
fn scan(bench: &mut Bench, step: u32) -> (usize, Telemetry, usize) {
    // The message of this time is already in flight.
    bench.run_for(SECOND / 20);
    let before = bench.heard.len();
    bench.send(&Telecommand {
        lidar_step_deg: Some(step),
        ..Telecommand::default()
    });
    bench.run_until(3 * SECOND, |bench| bench.heard.len() > before);
    let waited = bench.heard.len() - before;
    let (_, told) = bench.heard[before].clone();
    (waited, told, bench.payloads[before].len())
}

/// Step 10: 36 points; step 2: 180 points and 1789 +-10 % bytes (B1.2); every point is correct.
#[test]
fn scans_are_told_as_fine_as_asked() {
    let mut bench = Bench::new(square(2.0));
    bench.run_for(4 * SECOND);
    for (step, least, most) in [(10, 380, 480), (2, 1_600, 1_970)] {
        let (_, told, len) = scan(&mut bench, step);
        let points = told.lidar.expect("the scan").points;
        assert_eq!(points.len(), 360 / step as usize);
        assert!((least..=most).contains(&len), "step {step}: {len} bytes");
        for point in points.iter().filter(|it| it.angle_deg % 90 == 0) {
            assert!((point.distance_mm - 1_000).abs() < 15, "{point:?}");
            assert_eq!(point.quality, 47);
        }
        bench.run_for(SECOND);
    }
    assert_eq!(bench.counter("over-size answers"), 0);
}

/// Step 1 would be 3525 bytes for a buffer of 3200: the reply is the finest scan that fits, and is
/// counted.
#[test]
fn ye2_a_scan_that_is_too_large_is_thinned_out() {
    let mut bench = Bench::new(square(2.0));
    bench.run_for(4 * SECOND);
    let (_, told, len) = scan(&mut bench, 1);
    let points = told.lidar.expect("the scan").points;
    assert_eq!((points.len(), points[1].angle_deg), (180, 2));
    assert!(len <= PAYLOAD_MAX);
    assert_eq!(bench.counter("over-size answers"), 1);
    // Step 0 is no sensible request; the reply has every degree, thinned out as well.
    bench.run_for(SECOND);
    assert_eq!(
        scan(&mut bench, 0).1.lidar.expect("the scan").points.len(),
        180
    );
}

/// YF-04: the fielded buffer still holds the previous message, which is sent again.
#[test]
fn ye2_the_fielded_robot_sends_the_old_message_again() {
    let mut bench = Bench::with_defect(square(2.0), "YF-04");
    bench.run_for(4 * SECOND);
    bench.run_for(SECOND / 20);
    let old = bench.payloads.last().cloned();
    let (_, told, _) = scan(&mut bench, 1);
    assert_eq!((told.lidar, bench.payloads.last().cloned()), (None, old));
}

/// A long reply occupies the line for half a second; telemetry then returns to its grid.
#[test]
fn telemetry_goes_on_behind_a_long_answer() {
    let mut bench = Bench::new(square(2.0));
    bench.run_for(4 * SECOND);
    scan(&mut bench, 2);
    bench.run_for(SECOND);
    assert_eq!(bench.counter("telemetry skipped"), 2);
    assert!(bench.heard.iter().all(|(at, _)| at.as_millis() % 200 <= 10));
}

/// The lines of four walls, 1 m away, are sent once per request.
#[test]
fn lines_are_told_when_asked_for() {
    let mut bench = Bench::new(square(2.0));
    bench.run_for(4 * SECOND);
    bench.send(&Telecommand {
        lines: Some(LinesRequest::default()),
        ..Telecommand::default()
    });
    bench.run_for(SECOND);
    let told: Vec<_> = bench
        .heard
        .iter()
        .filter_map(|(_, it)| it.lines.as_ref())
        .collect();
    let [lines] = told[..] else {
        panic!("{} answers", told.len());
    };
    assert_eq!(lines.len(), 4);
    for end in lines.iter().flat_map(|line| [line.start, line.end]) {
        assert!((end.x.abs() - 1_000.0).abs() < 30.0 && (end.y.abs() - 1_000.0).abs() < 30.0);
    }
    // The PC may set other figures: with a tolerance of 2 m a room is one line or none.
    bench.send(&Telecommand {
        lines: Some(LinesRequest {
            tolerance_mm: 3_000,
            ..LinesRequest::default()
        }),
        ..Telecommand::default()
    });
    bench.run_for(SECOND);
    let last = bench
        .heard
        .iter()
        .filter_map(|(_, it)| it.lines.as_ref())
        .next_back();
    assert!(last.is_some_and(|lines| lines.len() <= 1));
}
