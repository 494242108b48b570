//! Every fault has an effect, and there is none without the fault.

use protocols::rplidar::Status;

use super::*;

/// Runs the same with and without the fault: `shows` must distinguish them.
fn assert_shows(fault: Fault, figure: Option<f64>, config: &Config, shows: fn(&mut Bench) -> bool) {
    let [mut broken, mut sound] = pair(fault, figure, config);
    assert!(shows(&mut broken), "{fault:?} does not show");
    assert!(!shows(&mut sound), "{fault:?} shows without it");
}

fn fw129() -> Config {
    config(Profile::Fw129, MotorControl::default())
}

fn shows(fault: Fault, shows: fn(&mut Bench) -> bool) {
    assert_shows(fault, None, &fw129(), shows);
}

/// Share of the bytes of a second of scan that are in sound nodes, percent.
fn sound_share(bench: &mut Bench) -> usize {
    bench.scan();
    bench.nodes().len() * 5 * 100 / bench.bytes.len().max(1)
}

fn scan_starts(bench: &mut Bench) -> bool {
    bench
        .ask(Command::Scan)
        .windows(7)
        .any(|window| window == SCAN)
}

#[test]
fn every_fault_is_found_by_its_name() {
    for fault in Fault::ALL {
        assert_eq!(Fault::from_name(fault.name()), Some(fault));
        assert!(Fault::NAMES.contains(&fault.name()));
    }
    assert_eq!(Fault::from_name("broken"), None);
    assert_eq!(
        Fault::named("slow", Some(3.0)),
        Some((Fault::Dust, Some(3.0)))
    );
    assert_eq!(plain().lidar.known_faults().len(), Fault::ALL.len() + 1);
}

/// Field bug 23: silence, also after requests; on power-up the start text comes.
#[test]
fn off_is_silent() {
    shows(Fault::Off, |bench| bench.ask(Command::Info).is_empty());
    let [mut bench, _] = pair(Fault::Off, None, &fw129());
    Device::set_fault(&mut bench.lidar, bench.now, "off", None, false);
    assert_eq!(bench.run_ms(1_000).bytes.len(), 64);
    assert_eq!(bench.ask(Command::Info).len(), 27);
}

#[test]
fn a_restart_ends_the_scan_and_prints_the_text() {
    let run = |breaks: bool| {
        let mut bench = plain();
        bench.scan();
        Device::set_fault(&mut bench.lidar, bench.now, "restart", None, breaks);
        bench.bytes.clear();
        bench.run_ms(1_000).bytes.len()
    };
    assert_eq!(run(true), 64);
    assert!(run(false) > 9_000);
}

#[test]
fn a_stuck_head_gives_no_nodes() {
    shows(Fault::Stuck, |bench| bench.scan().bytes.is_empty());
}

/// The motor's drive, 1350 - 1.615 * v, equals its friction with the fault, 150 + 1000 + 0.385 * v,
/// at v = 100 rpm instead of 330.
#[test]
fn a_slow_head_gives_more_nodes_in_a_turn() {
    let run = |slow: bool| {
        let mut bench = plain();
        Device::set_fault(&mut bench.lidar, bench.now, "slow", None, slow);
        bench.scan();
        bench.lidar.speed_rpm()
    };
    assert!((95.0..105.0).contains(&run(true)));
    assert!((329.0..331.0).contains(&run(false)));
    let dusty = Some(1_000.0);
    assert_shows(Fault::Dust, dusty, &fw129(), |bench| {
        bench.scan().lidar.speed_rpm() < 200.0
    });
}

/// Field bug 19: the turns of an uneven head have different lengths.
#[test]
fn an_uneven_head_gives_varying_turns() {
    let adapter = config(Profile::Fw129, MotorControl::Dtr);
    assert_shows(Fault::Uneven, None, &adapter, |bench| {
        bench.scan().run_ms(10_000);
        let nodes = bench.nodes();
        let starts = (0..).zip(&nodes).filter(|(_, node)| node.starts_turn());
        let starts: Vec<usize> = starts.map(|(index, _)| index).collect();
        let turns = starts.windows(2).map(|pair| pair[1] - pair[0]);
        turns.clone().max().expect("turns") - turns.min().expect("turns") > 5
    });
}

#[test]
fn garbage_damages_every_packet() {
    shows(Fault::Garbage, |bench| {
        let sound = bench.lidar.profile.info().answer();
        bench.ask(Command::Info) != sound.as_bytes()
    });
    shows(Fault::Garbage, |bench| sound_share(bench) < 90);
}

/// One byte of each packet is changed, and no more than that.
#[test]
fn garbage_changes_one_byte_of_each_packet() {
    let [mut broken, mut sound] = pair(Fault::Garbage, None, &fw129());
    let [broken, sound] = [&mut broken, &mut sound].map(|bench| {
        bench.ask(Command::Info);
        bench.scan().bytes.clone()
    });
    let len = broken.len().min(sound.len());
    assert!(len > 5_000);
    let packets = broken[..len]
        .chunks_exact(5)
        .zip(sound[..len].chunks_exact(5));
    for (one, other) in packets {
        let changed = one.iter().zip(other).filter(|(a, b)| a != b).count();
        assert_eq!(changed, 1, "{one:02X?} {other:02X?}");
    }
}

#[test]
fn wrong_distances_are_a_tenth_too_long() {
    shows(Fault::Wrong, |bench| {
        bench.scan();
        let mm = bench
            .nodes()
            .iter()
            .filter_map(|node| node.distance_mm())
            .fold(9e9, f32::min);
        (1_080.0..1_120.0).contains(&mm)
    });
}

#[test]
fn a_dark_sensor_sends_invalid_nodes() {
    shows(Fault::Dark, |bench| {
        bench.scan();
        let nodes = bench.nodes();
        nodes.len() > 1_900 && nodes.iter().all(|node| node.distance_q2() == 0)
    });
}

/// Manual LD108: the sensor watches the power of its laser.
#[test]
fn a_failed_laser_is_a_protection_stop() {
    shows(Fault::LaserOff, |bench| {
        bench.scan();
        bench.health().map(|health| health.status) == Some(Status::Error)
    });
}

/// Field bug 20: silence after minutes; the usual figure is 120 s.
#[test]
fn a_protection_stop_comes_after_minutes() {
    shows(Fault::ProtectionStop, |bench| {
        bench.scan().run_ms(110_000);
        assert_eq!(bench.lidar.state(), State::Scanning);
        bench.run_ms(10_000);
        bench.lidar.state() == State::ProtectionStop
    });
}

#[test]
fn a_health_warning_is_told() {
    shows(Fault::HealthWarning, |bench| {
        let status = bench.health().map(|health| health.status);
        bench.scan();
        status == Some(Status::Warning) && bench.nodes().len() > 1_900
    });
}

/// Field bugs 3 and 9: one byte of 200 is lost, so one node of 40 is damaged.
#[test]
fn a_loose_cable_loses_bytes() {
    assert_shows(Fault::ByteLoss, Some(200.0), &fw129(), |bench| {
        bench.scan();
        // A sample of five bytes comes each 508 us: 1,969 in a second.
        let lost = 1_969_usize * 5 - bench.bytes.len();
        (20..100).contains(&lost)
    });
}

/// Field bug 24: 64 bytes are lost, once. A burst of any length ends with its fault.
#[test]
fn a_burst_ends_with_its_fault() {
    let mut bench = plain();
    bench.scan();
    bench
        .lidar
        .set_fault(bench.now, Fault::Burst, Some(f64::MAX));
    bench.run_ms(100).bytes.clear();
    assert_eq!(bench.run_ms(100).bytes.len(), 0);
    bench.lidar.clear_fault(bench.now, Fault::Burst);
    assert!(bench.run_ms(100).bytes.len() > 500, "5 bytes, 200 a turn");
}

#[test]
fn a_burst_is_lost_once() {
    let run = |breaks| {
        let mut bench = plain();
        bench.scan();
        Device::set_fault(&mut bench.lidar, bench.now, "burst", None, breaks);
        bench.bytes.clear();
        bench.run_ms(1_000);
        let first = bench.bytes.len();
        bench.bytes.clear();
        (first, bench.run_ms(1_000).bytes.len())
    };
    let ((with, later), (without, _)) = (run(true), run(false));
    assert!((60..=69).contains(&(without - with)), "{with} {without}");
    assert!(later > 9_900);
}

/// Field bug 2: nodes and a torn one come before the answer. 8 nodes and 3 bytes.
#[test]
fn an_unclean_stop_leaves_nodes_before_the_answer() {
    shows(Fault::UncleanStop, |bench| {
        bench.scan();
        bench.bytes.clear();
        bench.send(&[0xA5, 0x25]).run_ms(20);
        let torn = bench.bytes.len() % 5;
        let info = bench.ask(Command::Info).len();
        (torn, info) == (3, 27)
    });
}

/// Field bugs 4 and 10: on 4 of 5 starts the check bits are wrong from the first node on.
#[test]
fn a_torn_start_misaligns_the_first_node() {
    let torn = |faults: Vec<_>| {
        let mut bench = Bench::new(Config { faults, ..fw129() }, room(1.0));
        bench.run_ms(3_000);
        let mut torn = 0;
        for _ in 0..50 {
            bench.bytes.clear();
            bench.send(&[0xA5, 0x20]).run_ms(90);
            torn += u32::from(bench.bytes.len() > 7);
            bench.send(&[0xA5, 0x25]).run_ms(20);
        }
        torn
    };
    // 40 of 50 with a deviation of 2.8; after a sound start only the descriptor arrives in 90 ms.
    let with = torn(vec![(Fault::TornStart, None)]);
    assert!((30..=49).contains(&with), "{with}");
    assert_eq!(torn(Vec::new()), 0);
}

/// Field bug 5: the descriptors of a foreign sensor begin with AA 55.
#[test]
fn a_foreign_sensor_begins_with_aa_55() {
    shows(Fault::Foreign, |bench| {
        bench.ask(Command::Info).starts_with(&[0xAA, 0x55, 0x14])
    });
}

/// Field bug 3: the announced length is one byte too large.
#[test]
fn a_descriptor_announces_one_byte_too_many() {
    shows(Fault::DescriptorLength, |bench| {
        bench.ask(Command::Info)[2] == 0x15
    });
}

/// Field bug 7: the sensor starts a scan in 70 % of the attempts.
#[test]
fn three_of_ten_scan_requests_are_ignored() {
    let started = |faults: Vec<_>| {
        let mut bench = Bench::new(Config { faults, ..fw129() }, room(1.0));
        (0..100).filter(|_| scan_starts(&mut bench)).count()
    };
    // 70 of 100 starts, with a deviation of 4.6.
    let with = started(vec![(Fault::DeafStart, None)]);
    assert!((50..=90).contains(&with), "{with}");
    assert_eq!(started(Vec::new()), 100);
}

/// Field bug 1: conf 01 without a value.
#[test]
fn an_empty_conf_holds_the_key_only() {
    shows(Fault::ConfEmpty, |bench| {
        let (key, mode) = (0x01, None);
        bench.ask(Command::Conf { key, mode }) == [0xA5, 0x5A, 4, 0, 0, 0, 0x20, 1, 0, 0, 0]
    });
}

/// Field bug 1 as reported: key 01 (speed and duty) is empty, 7C (the typical mode, 3) is not.
#[test]
fn one_key_may_be_empty_alone() {
    let [mut bench, _] = pair(Fault::ConfEmpty, Some(1.0), &fw129());
    let mut ask = |key| bench.ask(Command::Conf { key, mode: None });
    assert_eq!(ask(0x01), [0xA5, 0x5A, 4, 0, 0, 0, 0x20, 1, 0, 0, 0]);
    assert_eq!(
        ask(0x7C),
        [0xA5, 0x5A, 6, 0, 0, 0, 0x20, 0x7C, 0, 0, 0, 3, 0]
    );
}

/// Field bug 15: mode 5 is reported, with a name and times, and a request for it has no answer. If
/// the sensor reports another mode as the typical one, a client gets that one.
#[test]
fn a_typical_mode_may_be_one_that_is_not_streamed() {
    shows(Fault::TypicalMode, |bench| {
        let (key, mode) = (0x7C, None);
        bench.ask(Command::Conf { key, mode })
            == [0xA5, 0x5A, 6, 0, 0, 0, 0x20, 0x7C, 0, 0, 0, 5, 0]
    });
    let [mut bench, _] = pair(Fault::TypicalMode, None, &fw129());
    assert!(bench.ask(Command::ExpressScan { mode: 5 }).is_empty());
    let (key, mode) = (0x7F, Some(5));
    assert!(
        bench
            .ask(Command::Conf { key, mode })
            .ends_with(b"Stability\0")
    );
    let (key, mode) = (0x70, None);
    // The reported number of modes stays 5.
    assert_eq!(
        bench.ask(Command::Conf { key, mode }),
        [0xA5, 0x5A, 6, 0, 0, 0, 0x20, 0x70, 0, 0, 0, 5, 0]
    );
    let [mut bench, _] = pair(Fault::TypicalMode, Some(2.0), &fw129());
    assert_eq!(bench.ask(Command::ExpressScan { mode: 2 }).len(), 7);
}

/// Field bug 10: an answer has a descriptor and no data.
#[test]
fn an_empty_answer_is_a_descriptor_only() {
    shows(Fault::EmptyAnswer, |bench| {
        bench.ask(Command::Info) == [0xA5, 0x5A, 0, 0, 0, 0, 0x04]
    });
}

/// Field bug 13: answers come two seconds late.
#[test]
fn late_answers_come_after_two_seconds() {
    shows(Fault::LateAnswers, |bench| {
        let at_once = bench.ask(Command::Info).len();
        at_once == 0 && bench.run_ms(2_000).bytes.len() == 27
    });
}

/// Field bugs 3 and 13: the line has the rate of another sensor.
#[test]
fn a_wrong_rate_is_that_of_another_sensor() {
    shows(Fault::WrongRate, |bench| {
        bench.lidar.line_config(Rplidar::UART) == LineConfig::new_8n1(256_000)
    });
}

/// Field bug 12: "cannot start scan". 400 mA are less than the 500 to 600 of a start; with the head
/// turning 300 are enough.
#[test]
fn a_weak_supply_restarts_the_sensor_when_a_scan_begins() {
    shows(Fault::WeakSupply, |bench| {
        let at_rest = scan_starts(bench);
        let rules = bench.rules();
        assert!(scan_starts(bench.run_ms(2_000)), "the head turns now");
        !at_rest && rules == ["brown-out"]
    });
    assert_shows(Fault::WeakSupply, Some(200.0), &fw129(), |bench| {
        !scan_starts(bench.run_ms(2_000))
    });
}

/// Field bug 6: a request behind a stop without a pause has no effect.
#[test]
fn a_slow_stop_discards_what_follows() {
    shows(Fault::SlowStop, |bench| {
        bench.send(&[0xA5, 0x25]).run_ms(100);
        let soon = bench.ask(Command::Info).len();
        bench.run_ms(500);
        soon == 0 && bench.ask(Command::Info).len() == 27
    });
}

/// Field bug 25: the start stops the motor.
#[test]
fn inverted_dtr_stops_the_motor_at_the_start() {
    let adapter = config(Profile::Fw129, MotorControl::Dtr);
    assert_shows(Fault::DtrInverted, None, &adapter, |bench| {
        bench.lidar.receive(Rplidar::DTR, bench.now, &[0]);
        bench.run_ms(3_000).scan().lidar.speed_rpm() == 0.0
    });
}

/// DTR is low until it is set, which stops the head of an inverted adapter; the level counts
/// when the polarity changes, too.
#[test]
fn inverted_dtr_counts_from_the_start() {
    let adapter = config(Profile::Fw129, MotorControl::Dtr);
    let [mut inverted, mut sound] = pair(Fault::DtrInverted, None, &adapter);
    let speed = |bench: &mut Bench| bench.run_ms(3_000).scan().lidar.speed_rpm();
    assert_eq!(speed(&mut inverted), 0.0);
    assert!(speed(&mut sound) > 400.0);
    let now = inverted.now;
    inverted.lidar.clear_fault(now, Fault::DtrInverted);
    assert!(speed(&mut inverted) > 400.0);
}

/// Field bug 16: an index of 360 and more.
#[test]
fn angles_pass_360_degrees() {
    let run = |faults: Vec<_>| {
        let mut bench = Bench::new(Config { faults, ..fw129() }, room(20.0));
        bench.scan();
        let most = bench.nodes().iter().map(|node| node.angle_q6()).max();
        most.expect("nodes") / 64
    };
    assert!((360..=367).contains(&run(vec![(Fault::AnglePast360, None)])));
    assert_eq!(run(Vec::new()), 359);
}

/// Distance ahead, to the right, behind and to the left, decimetres, in a room with its walls at 1,
/// 2, 3 and 4 m.
fn compass(fault: Option<Fault>) -> [u16; 4] {
    let corners = [(-3.0, -2.0), (1.0, -2.0), (1.0, 4.0), (-3.0, 4.0)];
    let corners = corners.map(|(x, y)| Point::new(x, y)).to_vec();
    let faults = fault.into_iter().map(|fault| (fault, None)).collect();
    let mut bench = Bench::new(Config { faults, ..fw129() }, world(corners));
    bench.scan();
    let nodes = bench.nodes();
    [0, 90, 180, 270].map(|deg: u16| {
        let near =
            |node: &&Node| node.angle_q6().abs_diff(deg * 64) < 128 && node.distance_q2() > 0;
        let distance_q2 = nodes.iter().find(near).expect("a turn").distance_q2();
        (distance_q2 + 200) / 400
    })
}

/// Field bug 17: the picture is mirrored or turned.
#[test]
fn a_scan_can_be_mirrored_or_turned() {
    assert_eq!(compass(None), [10, 20, 30, 40]);
    assert_eq!(compass(Some(Fault::Mirrored)), [10, 40, 30, 20]);
    assert_eq!(compass(Some(Fault::Turned)), [20, 30, 40, 10]);
}

/// Figures by the reports of the clients; every other fault has none.
#[test]
fn usual_figures_are_those_of_the_reports() {
    let with_figure = Fault::ALL.into_iter().filter_map(|fault| {
        let figure = fault.usual_figure()?;
        Some((fault.name(), figure))
    });
    let expected = [
        ("dust", 400.0),
        ("uneven", 100.0),
        ("wrong", 1.1),
        ("protection-stop", 120.0),
        ("byte-loss", 20_000.0),
        ("burst", 64.0),
        ("unclean-stop", 8.0),
        ("torn-start", 0.8),
        ("deaf-start", 0.3),
        ("conf-empty", 0.0),
        ("typical-mode", 5.0),
        ("late-answers", 2.0),
        ("weak-supply", 400.0),
        ("slow-stop", 0.5),
        ("turned", 90.0),
    ];
    assert!(with_figure.eq(expected));
}
