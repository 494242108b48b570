//! Scans: rotation, nodes, capsules.

use protocols::LineEvent;
use protocols::rplidar::{Capsule, Status};

use super::*;

/// Duty 0.6 of the robot yellow.
const DUTY: u8 = 153;

fn yellow() -> Bench {
    let mut bench = Bench::new(config(Profile::Fw120, MotorControl::Pwm), room(1.0));
    bench.lidar.receive(Rplidar::MOTOR, Instant::ZERO, &[DUTY]);
    bench
}

/// Nodes between two that start a turn.
fn turns(nodes: &[Node]) -> Vec<usize> {
    let starts = (0..).zip(nodes).filter(|(_, node)| node.starts_turn());
    let starts: Vec<usize> = starts.map(|(index, _)| index).collect();
    starts.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

/// The distance from the middle of a square of 2 m to its wall, millimetres.
fn wall_mm(angle_deg: f64) -> f64 {
    let off = (angle_deg + 45.0).rem_euclid(90.0) - 45.0;
    1_000.0 / libm::cos(off.to_radians())
}

/// The descriptor comes at once, nodes only when the rotation is stable: the head needs 0.5 s and
/// more from rest.
#[test]
fn nodes_wait_for_an_even_rotation() {
    let mut bench = yellow();
    bench.send(&[0xA5, 0x20]).run_ms(2);
    assert_eq!(bench.bytes, SCAN);
    bench.run_ms(500);
    assert_eq!(
        (bench.bytes.len(), bench.lidar.state()),
        (7, State::Starting)
    );
    bench.run_ms(3_000);
    assert_eq!(bench.lidar.state(), State::Scanning);
    assert!(bench.bytes.len() > 1_000);
}

/// FORCE_SCAN is the same without the wait; a head at rest gives one angle.
#[test]
fn a_forced_scan_does_not_wait() {
    let mut bench = Bench::new(config(Profile::Fw120, MotorControl::Pwm), room(1.0));
    bench.send(&[0xA5, 0x21]).run_ms(100);
    assert!(bench.bytes.starts_with(&SCAN));
    bench.bytes.drain(..7);
    let nodes = bench.nodes();
    assert!(nodes.len() > 190, "{}", nodes.len());
    // The angles differ only a little, by the noise of the distance.
    let valid = nodes.iter().filter(|node| node.distance_q2() > 0);
    let angles = valid.map(|node| node.angle_q6());
    let [least, most] = [angles.clone().min(), angles.max()].map(Option::unwrap_or_default);
    assert!(most > 0 && most - least < 8, "{least} {most}");
}

/// A head at rest: the descriptor, and silence without end. No Protection Stop.
#[test]
fn without_a_motor_there_is_only_a_descriptor() {
    let mut bench = Bench::new(config(Profile::Fw120, MotorControl::Pwm), room(1.0));
    bench.send(&[0xA5, 0x20]).run_ms(20_000);
    assert_eq!(
        (bench.bytes.as_slice(), bench.lidar.state()),
        (&SCAN[..], State::Starting)
    );
}

/// YE3: 5.5 turns a second within 5 % at a duty of 0.6; LD108: 2,000 to 2,010 samples a second.
#[test]
fn ye3_yellow_gets_5_5_turns_and_2000_samples_a_second() {
    let mut bench = yellow();
    bench.scan();
    let nodes = bench.nodes();
    assert_eq!(bench.bytes.len(), nodes.len() * 5);
    assert!((2_000..=2_010).contains(&nodes.len()), "{}", nodes.len());
    for turn in turns(&nodes) {
        let per_second = 2_005.0 / turn as f64;
        assert!((5.225..=5.775).contains(&per_second), "{per_second}");
    }
}

/// Data sheet A1M8-R6: a turn has 267 or 268 nodes.
#[test]
fn the_adapter_gives_267_or_268_nodes_in_a_turn() {
    let mut bench = Bench::new(config(Profile::Fw129, MotorControl::Dtr), room(1.0));
    bench.run_ms(3_000).scan().run_ms(20_000);
    let turns = turns(&bench.nodes());
    assert!(turns.len() > 140);
    assert!(
        turns.iter().all(|turn| [267, 268].contains(turn)),
        "{turns:?}"
    );
    assert!(turns.contains(&267) && turns.contains(&268));
}

/// LR001: less than 1 % off, plus the effect of 3.5 jitters of 0.05 degrees on a slanted wall (0.3
/// %). Some samples of plain walls have no distance, because of spots and noise.
#[test]
fn a_square_room_is_measured_as_it_is() {
    let mut bench = plain();
    bench.scan();
    let nodes = bench.nodes();
    let measured = nodes
        .iter()
        .filter_map(|node| Some((node.distance_mm()?, node)));
    for (mm, node) in measured.clone() {
        let deg = f64::from(node.angle_deg());
        let off = f64::from(mm) / wall_mm(deg) - 1.0;
        assert!(off.abs() < 0.013, "{mm} mm at {deg}");
    }
    let share = 100 - measured.count() * 100 / nodes.len();
    assert!((3..=14).contains(&share), "{share} % without a measurement");
}

/// A wall 0.5 m to the right, 2 m elsewhere: clockwise angles, so right is 90 degrees.
#[test]
fn angles_are_clockwise_from_ahead() {
    let corners = [(-2.0, -0.5), (2.0, -0.5), (2.0, 2.0), (-2.0, 2.0)];
    let corners = corners.map(|(x, y)| Point::new(x, y)).to_vec();
    let mut bench = Bench::new(Config::default(), world(corners));
    bench.scan();
    let at = |deg: f32| {
        let nodes = bench.nodes();
        let near = |node: &&Node| (node.angle_deg() - deg).abs() < 2.0 && node.distance_q2() > 0;
        nodes
            .iter()
            .find(near)
            .expect("a turn")
            .distance_mm()
            .expect("near")
    };
    assert!((495.0..505.0).contains(&at(90.0)));
    assert!((1_980.0..2_020.0).contains(&at(270.0)));
}

/// The quality of a valid node is 47 on firmware 1.29, 15 on 1.24, and 10 to 31 by the light on
/// 1.20. That of an invalid node is 0.
#[test]
fn f13_the_quality_says_valid_or_not() {
    for (profile, [least, most]) in [
        (Profile::Fw120, [10, 31]),
        (Profile::Fw124, [15, 15]),
        (Profile::Fw129, [47, 47]),
    ] {
        let nodes = |half_m| {
            let mut bench = Bench::new(config(profile, MotorControl::default()), room(half_m));
            bench.scan();
            bench.nodes()
        };
        let fits = |node: &Node| match node.distance_q2() {
            0 => node.quality() == 0,
            _ => (least..=most).contains(&node.quality()),
        };
        let (near, far) = (nodes(1.0), nodes(20.0));
        assert!(near.iter().all(fits) && far.iter().all(fits));
        assert!(far.iter().all(|node| node.distance_q2() == 0));
        let mean = |nodes: &[Node]| {
            let valid = nodes.iter().map(|node| u32::from(node.quality()));
            let (sum, number) = valid
                .filter(|&one| one > 0)
                .fold((0, 0), |(sum, number), one| (sum + one, number + 1));
            sum / number.max(1)
        };
        // Less light from farther away: only old firmware reports it.
        let is_less = mean(&nodes(4.0)) < mean(&near);
        assert_eq!(is_less, profile == Profile::Fw120);
    }
}

/// The greatest range is 6 m by LD108 and 12 m in later firmware; the least is 0.15 m.
#[test]
fn the_range_depends_on_the_firmware() {
    let sees = |profile, half_m| {
        let mut bench = Bench::new(config(profile, MotorControl::default()), room(half_m));
        bench.scan();
        bench.nodes().iter().any(|node| node.distance_q2() > 0)
    };
    assert!(sees(Profile::Fw120, 5.5) && !sees(Profile::Fw120, 7.0));
    assert!(sees(Profile::Fw124, 7.0) && !sees(Profile::Fw124, 13.0));
    assert!(sees(Profile::Fw124, 0.2) && !sees(Profile::Fw124, 0.1));
}

/// The angles 213, 220, 217, 222: an invalid node lies ahead, so angles go back behind it. Walls of
/// 7 m in the directions of the corners of a room of 5 m are out of reach.
#[test]
fn angles_go_backwards_around_invalid_nodes() {
    let mut bench = Bench::new(config(Profile::Fw120, MotorControl::default()), room(5.0));
    bench.scan();
    let nodes = bench.nodes();
    let steps = |from_valid: bool| {
        let pairs = nodes.windows(2).filter(move |pair| {
            let valid = |node: Node| node.distance_q2() != 0;
            valid(pair[0]) == from_valid && valid(pair[1]) != from_valid
        });
        let step = |pair: &[Node]| {
            let step = pair[1].angle_deg() - pair[0].angle_deg();
            (step + 180.0).rem_euclid(360.0) - 180.0
        };
        pairs.map(step).collect::<Vec<_>>()
    };
    // At 330 rpm and 2,005 samples a second, samples are 0.99 degrees apart. The shift by the
    // distance is 8 degrees less the angle whose sine is 24 mm by 5 to 6 m which gives 7.73 to
    // 7.77.
    assert!(
        steps(true).iter().all(|step| (8.6..8.85).contains(step)),
        "{:?}",
        steps(true)
    );
    assert!(steps(false).iter().all(|step| (-6.85..-6.6).contains(step)));
    assert!(steps(true).len() > 15);
}

/// 4,010 samples a second in capsules of 32; a capsule is decoded with the next.
#[test]
fn an_express_scan_shows_the_same_room() {
    let mut bench = plain();
    bench
        .send(&[0xA5, 0x82, 5, 0, 0, 0, 0, 0, 0x22])
        .run_ms(3_000);
    assert!(
        bench
            .bytes
            .starts_with(&[0xA5, 0x5A, 0x54, 0, 0, 0x40, 0x82])
    );
    let before = bench.bytes.len();
    bench.run_ms(1_000);
    // 4,010 samples a second are 125 or 126 capsules.
    assert!([125, 126].contains(&((bench.bytes.len() - before) / 84)));
    let capsule = |frame| match frame {
        Frame::Capsule(capsule) => Some(capsule),
        _ => None,
    };
    let capsules: Vec<Capsule> = bench.frames().into_iter().filter_map(capsule).collect();
    assert!(capsules[0].is_first() && !capsules[1].is_first());
    let mut measured = 0;
    for pair in capsules.windows(2) {
        let samples = pair[0].samples(&pair[1]).into_iter();
        for sample in samples.filter(|sample| sample.distance_mm > 0) {
            let mm = f64::from(sample.distance_mm);
            let off = mm / wall_mm(f64::from(sample.angle_deg())) - 1.0;
            assert!(off.abs() < 0.02, "{sample:?}");
            measured += 1;
        }
    }
    assert!(measured > 2_000, "{measured}");
}

/// Every mode of the kind 0x84 shows the room by the vendor's arithmetic: 96 samples each 127 or
/// 201 us, whose angles follow from the head's angle and the distance.
#[test]
fn f11_scans_of_the_kind_84_show_the_same_room() {
    for (profile, mode, per_second) in [
        (Profile::Fw124, 2, 8_020),
        (Profile::Fw129, 2, 7_874),
        (Profile::Fw129, 3, 7_874),
        (Profile::Fw129, 4, 4_975),
    ] {
        let mut bench = Bench::new(config(profile, MotorControl::default()), room(1.0));
        let request = Command::ExpressScan { mode }.request();
        bench.send(request.as_bytes()).run_ms(3_000);
        assert!(
            bench
                .bytes
                .starts_with(&[0xA5, 0x5A, 0x84, 0, 0, 0x40, 0x84])
        );
        let before = bench.bytes.len();
        bench.run_ms(2_000);
        let capsules = (bench.bytes.len() - before) / 132;
        assert!(capsules.abs_diff(per_second * 2 / 96) <= 1, "{capsules}");
        let ultra = |frame| match frame {
            Frame::Ultra(capsule) => Some(capsule),
            _ => None,
        };
        let capsules: Vec<_> = bench.frames().into_iter().filter_map(ultra).collect();
        assert!(capsules[0].is_first() && !capsules[1].is_first());
        let (mut measured, mut all) = (0, 0);
        for pair in capsules.windows(2) {
            for sample in pair[0].samples(&pair[1]) {
                all += 1;
                if sample.distance_mm > 0 {
                    let mm = f64::from(sample.distance_mm);
                    let off = mm / wall_mm(f64::from(sample.angle_deg())) - 1.0;
                    assert!(off.abs() < 0.02, "{sample:?}");
                    measured += 1;
                }
            }
        }
        assert!(
            all > 8_000 && measured * 10 > all * 8,
            "{measured} of {all}"
        );
    }
}

/// Field bug 15 (robopeak/rplidar_ros #68): a mode that an A1 does not have gives silence.
#[test]
fn modes_are_those_of_the_firmware() {
    let express = |profile, mode| {
        let mut bench = Bench::new(config(profile, MotorControl::default()), room(1.0));
        bench.ask(Command::ExpressScan { mode }).len()
    };
    assert_eq!(
        [0, 1, 2].map(|mode| express(Profile::Fw120, mode)),
        [7, 0, 0]
    );
    assert_eq!(
        [0, 1, 2, 3].map(|mode| express(Profile::Fw124, mode)),
        [7, 7, 7, 0]
    );
}

/// Field bug 11 (rplidar_sdk #86): a client that dies leaves the sensor streaming.
#[test]
fn a_closed_port_does_not_end_a_scan() {
    let mut bench = plain();
    bench.scan();
    bench
        .lidar
        .line_event(Rplidar::UART, bench.now, LineEvent::Closed);
    bench.bytes.clear();
    assert!(bench.run_ms(1_000).bytes.len() > 9_000);
}

#[test]
fn any_request_ends_a_scan_and_is_then_handled() {
    let mut bench = plain();
    bench.scan();
    let bytes = bench.ask(Command::Info);
    assert_eq!(answer(&bytes).expect("answered").kind(), 0x04);
    assert!(bytes.ends_with(answer(&bytes).expect("answered").as_bytes()));
    assert_eq!(bench.lidar.state(), State::Idle);
    assert!(bench.run_ms(1_000).bytes.is_empty());
}

/// SCAN while scanning begins again, STOP ends it.
#[test]
fn a_second_scan_request_restarts_the_scan() {
    let mut bench = plain();
    bench.scan();
    let bytes = bench.ask(Command::Scan);
    assert_eq!(bytes.windows(7).filter(|window| *window == SCAN).count(), 1);
    bench.run_ms(500);
    assert_eq!(bench.lidar.state(), State::Scanning);
    bench.ask(Command::Stop);
    assert!(bench.run_ms(1_000).bytes.is_empty());
}

/// LD108: a head that stops during a scan protects the sensor. SCAN is then ignored, health says
/// 2, only a reset helps.
#[test]
fn protection_stop_is_silent_until_reset() {
    let mut bench = plain();
    bench.scan();
    Rplidar::set_fault(&mut bench.lidar, bench.now, Fault::Stuck, None);
    bench.run_ms(3_000);
    assert_eq!(bench.lidar.state(), State::ProtectionStop);
    assert!(bench.ask(Command::Scan).is_empty());
    assert!(bench.ask(Command::ForceScan).is_empty());
    assert_eq!(
        bench.health().map(|health| health.status),
        Some(Status::Error)
    );
    bench.lidar.clear_fault(bench.now, Fault::Stuck);
    assert!(bench.ask(Command::Scan).is_empty());
    bench.ask(Command::Reset);
    assert_eq!(bench.run_ms(700).bytes.len(), 64);
    assert_eq!(bench.health(), Some(Health::default()));
    bench.scan();
    assert!(bench.nodes().len() > 1_900);
}

/// A short disturbance pauses the nodes; no descriptor comes when they continue.
#[test]
fn a_head_that_is_freed_in_time_goes_on() {
    let mut bench = plain();
    bench.scan();
    Rplidar::set_fault(&mut bench.lidar, bench.now, Fault::Stuck, None);
    bench.run_ms(500);
    assert_eq!(bench.lidar.state(), State::Starting);
    bench.lidar.clear_fault(bench.now, Fault::Stuck);
    bench.bytes.clear();
    bench.run_ms(1_500);
    assert_eq!(bench.lidar.state(), State::Scanning);
    assert!(!bench.bytes.windows(7).any(|window| window == SCAN));
}
