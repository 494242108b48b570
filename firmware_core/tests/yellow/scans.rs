//! YE3 and D2: the lidar's driver and its set of turns.

use firmware_core::Inspect;
use firmware_core::pose::Point;
use firmware_core::robots::yellow::{Config, Yellow};
use protocols::rplidar::Command;

use crate::bench::{Bench, SECOND, cast, square};

/// A robot in the middle of a square of 2 m, three seconds after the lidar's start.
fn seen(id: Option<&str>, nodes_per_turn: f64, sigma_mm: f64) -> Bench {
    let mut bench = match id {
        None => Bench::new(square(2.0)),
        Some(id) => Bench::with_defect(square(2.0), id),
    };
    bench.lidar.nodes_per_turn = nodes_per_turn;
    bench.lidar.sigma_mm = sigma_mm;
    bench.run_for(4 * SECOND);
    bench
}

fn points(bench: &Bench) -> &[Point] {
    Inspect::scan(&bench.robot)
}

/// Distance of a point from the walls, along its beam, mm.
fn error_mm(bench: &Bench, point: &Point) -> f64 {
    let (x, y) = (f64::from(point.x_mm), f64::from(point.y_mm));
    let [bx, by, heading] = bench.body;
    let truth = cast(&bench.walls, bx, by, heading + libm::atan2(y, x)) * 1e3;
    libm::hypot(x, y) - truth
}

fn rms_mm(bench: &Bench) -> f64 {
    let errors = points(bench).iter().map(|point| error_mm(bench, point));
    let squares: Vec<f64> = errors.map(|error| error * error).collect();
    libm::sqrt(squares.iter().sum::<f64>() / squares.len() as f64)
}

/// D2: over 5 x 720 points the noise falls by sqrt 5 = 2.24, +-20 %: to 13.4 mm (11.2 to 16.8) from
/// 30 mm. A turn of 720 nodes gives each half degree one sample.
#[test]
fn d2_the_noise_of_five_turns_falls_by_the_root_of_five() {
    let bench = seen(None, 720.0, 30.0);
    assert_eq!(points(&bench).len(), 720);
    let factor = 30.0 / rms_mm(&bench);
    println!("D2: noise falls by {factor}");
    assert!((1.79..=2.68).contains(&factor), "{factor}");
}

/// YL-05: five copies of one turn contain no more information than one turn.
#[test]
fn d2_the_noise_of_five_copies_does_not_fall() {
    let factor = 30.0 / rms_mm(&seen(Some("YL-05"), 720.0, 30.0));
    println!("D2, fielded: noise falls by {factor}");
    assert!(factor < 1.1, "{factor}");
}

/// A real A1 gives 364 samples a turn. Half of the directions have fewer than three samples of
/// their own and use those of their neighbours. The result must have no holes, and less noise than
/// one turn.
#[test]
fn a_turn_of_364_samples_leaves_no_holes() {
    let bench = seen(None, 363.6, 30.0);
    let factor = 30.0 / rms_mm(&bench);
    println!("364 a turn: {} points, {factor}", points(&bench).len());
    assert!(points(&bench).len() >= 700, "{}", points(&bench).len());
    assert!(factor > 1.5, "{factor}");
}

/// Angles are clockwise on the wire and counter-clockwise in the robot: a wall 0.5 m to the left,
/// one 0.8 m to the right, and the robot faces +x.
#[test]
fn left_is_left() {
    let mut bench = Bench::new(vec![[-9.0, 0.5, 9.0, 0.5], [-9.0, -0.8, 9.0, -0.8]]);
    bench.run_for(4 * SECOND);
    let beside: Vec<_> = points(&bench)
        .iter()
        .filter(|it| it.x_mm.abs() < 20.0)
        .collect();
    assert!(beside.iter().any(|it| (it.y_mm - 500.0).abs() < 5.0));
    assert!(beside.iter().any(|it| (it.y_mm + 800.0).abs() < 5.0));
    assert_eq!(beside.iter().filter(|it| it.y_mm > 510.0).count(), 0);
}

/// Distances below 150 mm and above 5 m are rejected: walls at 5.1 m and at 4.9 m, at 140 mm and at
/// 160 mm.
#[test]
fn d2_what_is_too_near_or_too_far_is_left_out() {
    let mut bench = Bench::new(vec![[5.1, -9.0, 5.1, 9.0], [-4.9, -9.0, -4.9, 9.0]]);
    bench.run_for(4 * SECOND);
    assert!(points(&bench).iter().all(|it| it.x_mm < 0.0));
    assert!(points(&bench).iter().any(|it| it.x_mm < -4_890.0));
    let mut bench = Bench::new(vec![[0.14, -9.0, 0.14, 9.0], [-0.16, -9.0, -0.16, 9.0]]);
    bench.run_for(4 * SECOND);
    let ranges = || points(&bench).iter().map(|it| it.x_mm.hypot(it.y_mm));
    assert!(ranges().all(|range_mm| range_mm >= 149.0));
    assert!(ranges().any(|range_mm| range_mm < 165.0));
}

/// YE3: a lost byte costs at most 10 bytes, two nodes, whichever byte it is; the set stays correct.
#[test]
fn ye3_a_lost_byte_costs_two_nodes() {
    for lost in 0..5 {
        let mut bench = Bench::new(square(2.0));
        bench.run_for(3 * SECOND);
        let (before, began) = (bench.counter("lidar nodes"), bench.now);
        bench.lidar.lose_in = Some(100 + lost);
        bench.run_for(SECOND / 10);
        let sent = 2 * (bench.now - began).as_millis() as u64;
        let missing = sent - (bench.counter("lidar nodes") - before);
        assert!(missing <= 2, "byte {lost}: {missing} nodes");
        bench.run_for(2 * SECOND);
        let worst = points(&bench).iter().map(|it| error_mm(&bench, it).abs());
        assert!(worst.fold(0.0, f64::max) < 20.0, "byte {lost}");
    }
}

/// Bytes of 0 get lost, including one in the first node of each turn, whose angle is below two
/// degrees. Sets still arrive: a wall that moved from 1 m to 1.5 m is at 1.5 m two seconds later,
/// and no other point exists.
#[test]
fn a_turn_without_its_first_node_ends_all_the_same() {
    let mut bench = seen(None, 363.6, 5.0);
    bench.lidar.strips_nul = true;
    bench.walls = square(3.0);
    bench.run_for(2 * SECOND);
    let worst = points(&bench).iter().map(|it| error_mm(&bench, it).abs());
    let worst = worst.fold(0.0, f64::max);
    assert!(points(&bench).len() > 600, "{}", points(&bench).len());
    assert!(worst < 30.0, "{worst} mm");
}

/// YL-01: groups of five are never realigned; after the lost byte, hardly any of them is a node.
#[test]
fn ye3_the_fielded_driver_stays_misaligned() {
    let mut bench = Bench::with_defect(square(2.0), "YL-01");
    bench.run_for(3 * SECOND);
    assert_eq!(bench.counter("lidar groups bad"), 0);
    bench.lidar.lose_in = Some(100);
    bench.run_for(10 * SECOND);
    // 2000 nodes a second were sent; by chance, a quarter of the wrong offsets look like a node.
    let bad = bench.counter("lidar groups bad");
    assert!(bad > 10_000, "{bad}");
}

/// The motor starts at once at 0.6 of 255, and the first request follows a second later.
#[test]
fn the_lidar_is_started_as_its_motor_needs() {
    let mut bench = Bench::new(square(2.0));
    bench.run_for(2 * SECOND);
    assert_eq!(bench.lidar.duty, 153);
    let [(at, command)] = bench.lidar.requests[..] else {
        panic!("{:?}", bench.lidar.requests);
    };
    assert_eq!(command, Command::Scan);
    assert!((1_000..=1_010).contains(&at.as_millis()), "{at}");
}

/// Protection Stop is silence. It is detected within a second; the health is requested, and the
/// lidar is reset and restarted. Until then there are no points.
#[test]
fn a_protection_stop_is_noticed_and_ended() {
    let mut bench = Bench::new(square(2.0));
    bench.run_for(4 * SECOND);
    let stopped_at = bench.now;
    bench.lidar.stop();
    bench.run_for(SECOND + SECOND / 10);
    assert_eq!(points(&bench).len(), 0);
    bench.run_for(3 * SECOND);
    let since = bench
        .lidar
        .requests
        .iter()
        .filter(|(at, _)| *at > stopped_at);
    let commands: Vec<_> = since.map(|(_, command)| *command).collect();
    assert_eq!(commands, [Command::Health, Command::Reset, Command::Scan]);
    assert!(points(&bench).len() >= 700);
    assert_eq!(
        (
            bench.counter("lidar silences"),
            bench.counter("lidar restarts")
        ),
        (1, 1)
    );
}

/// YL-04: the fielded program keeps its last ranges forever.
#[test]
fn the_fielded_program_keeps_its_old_ranges() {
    let mut bench = Bench::with_defect(square(2.0), "YL-04");
    bench.run_for(4 * SECOND);
    let before = points(&bench).to_vec();
    bench.lidar.stop();
    bench.run_for(20 * SECOND);
    assert_eq!(
        (points(&bench), bench.lidar.requests.len()),
        (&before[..], 1)
    );
}

/// YL-02: after a restart, the new descriptor of seven bytes counts as data, so that every node is
/// misaligned by two bytes. A driver that restarts its count with each scan (YL-01) is not
/// affected.
#[test]
fn a_header_counted_once_misaligns_the_second_scan() {
    for (id, is_misaligned) in [("YL-01", false), ("YL-02", true)] {
        let mut bench = Bench::with_defect(square(2.0), id);
        bench.run_for(4 * SECOND);
        bench.lidar.stop();
        bench.run_for(3 * SECOND);
        let before = bench.counter("lidar groups bad");
        bench.run_for(3 * SECOND);
        let bad = bench.counter("lidar groups bad") - before;
        assert_eq!(bad > 1_000, is_misaligned, "{id}: {bad}");
    }
}

/// YL-03: index 360 - 0 is outside an array of 360, and fractions of a degree are cut off.
#[test]
fn whole_degrees_leave_the_array() {
    let bench = seen(Some("YL-03"), 720.0, 0.0);
    assert!(bench.counter("lidar readings astray") > 10);
    assert!(points(&bench).iter().all(|it| {
        let half_degrees = libm::atan2f(it.y_mm, it.x_mm).to_degrees() * 2.0;
        (half_degrees / 2.0 - (half_degrees / 2.0).round()).abs() < 0.01
    }));
    assert_eq!(seen(None, 720.0, 0.0).counter("lidar readings astray"), 0);
}

/// The head needs time to reach a constant speed: 2 s without a node after the first request are no
/// silence.
#[test]
fn a_head_that_speeds_up_is_waited_for() {
    let mut bench = Bench::new(square(2.0));
    bench.lidar.even_at = protocols::Instant::from_millis(3_500);
    bench.run_for(5 * SECOND);
    assert_eq!(bench.lidar.requests.len(), 1);
    assert!(points(&bench).len() >= 700);
}

/// A lidar without any reply is reset repeatedly, without other effects.
#[test]
fn a_lidar_that_is_not_there_is_asked_for() {
    use firmware_core::Master as _;
    let mut robot = Yellow::new(Config::DEFAULT);
    let mut requests = Vec::new();
    for millis in 1..10_000 {
        robot.poll(protocols::Instant::from_millis(millis));
        let mut buf = [0; 8];
        let len = robot.transmit(Yellow::LIDAR, &mut buf);
        requests.extend_from_slice(&buf[..len]);
    }
    let round = [0xA5, 0x20, 0xA5, 0x52, 0xA5, 0x40];
    assert!(
        requests.starts_with(&[round, round].concat()),
        "{requests:02X?}"
    );
}
