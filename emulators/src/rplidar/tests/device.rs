//! Requests and answers.

use proptest::prelude::*;
use protocols::rplidar::{SampleRate, Status};

use super::*;

/// Real bytes (A1M8 1.29): model 18, firmware 1D 01, hardware 07; serial number of the same kind.
#[test]
fn info_is_that_of_a_real_sensor() {
    let mut bench = Bench::new(config(Profile::Fw129, MotorControl::Pwm), room(1.0));
    let bytes = bench.ask(Command::Info);
    assert_eq!(bytes[..7], [0xA5, 0x5A, 0x14, 0, 0, 0, 0x04]);
    assert_eq!(bytes[7..11], [0x18, 0x1D, 0x01, 0x07]);
    assert_eq!(bytes[11..15], [0xEB, 0xB3, 0x99, 0xF6]);
    assert_eq!(bytes.len(), 27);
}

#[test]
fn health_and_sample_rate_are_answered() {
    let mut bench = plain();
    assert_eq!(
        bench.ask(Command::Health),
        [0xA5, 0x5A, 3, 0, 0, 0, 0x06, 0, 0, 0]
    );
    let rate = answer(&bench.ask(Command::SampleRate)).expect("answered");
    let expected = SampleRate {
        standard_us: 500,
        express_us: 250,
    };
    assert_eq!(rate.reply(), Reply::SampleRate(expected));
}

/// The answers of an A1M8 of 2022 to requests for every key of every mode (published as a comment
/// of an Arduino sketch): five modes, sample times in 256ths of a microsecond, 12 m, kinds 81, 82,
/// 84.
/// The typical mode is Sensitivity, as drivers print it.
#[test]
fn f11_firmware_1_29_tells_its_five_modes_and_streams_each() {
    let bench = || Bench::new(config(Profile::Fw129, MotorControl::default()), room(1.0));
    let value = |key, mode| bench().ask(Command::Conf { key, mode })[11..].to_vec();
    assert_eq!(value(0x70, None), [5, 0]);
    assert_eq!(value(0x7C, None), [3, 0]);
    let modes: [(&str, u32, u8); 5] = [
        ("Standard", 130_048, 0x81),
        ("Express", 65_024, 0x82),
        ("Boost", 32_512, 0x84),
        ("Sensitivity", 32_512, 0x84),
        ("Stability", 51_456, 0x84),
    ];
    for (mode, (name, time, kind)) in (0_u8..).zip(modes) {
        let of = |key| value(key, Some(mode.into()));
        assert_eq!(of(0x7F), [name.as_bytes(), &[0]].concat());
        assert_eq!(of(0x71), time.to_le_bytes());
        assert_eq!(of(0x74), 3_072_u32.to_le_bytes());
        assert_eq!(of(0x75), [kind]);
        let begins = bench().ask(match mode {
            0 => Command::Scan,
            _ => Command::ExpressScan { mode },
        });
        assert_eq!((begins.len(), begins[6]), (7, kind), "{name}");
    }
    let rate = answer(&bench().ask(Command::SampleRate)).expect("answered");
    let expected = SampleRate {
        standard_us: 508,
        express_us: 254,
    };
    assert_eq!(rate.reply(), Reply::SampleRate(expected));
    assert!(bench().ask(Command::ExpressScan { mode: 5 }).is_empty());
}

/// Firmware 1.24: three modes with 2.0, 4.0 and 8.0 K samples a second and a range of 12.0 m each.
#[test]
fn conf_is_answered_from_firmware_1_24_on() {
    let ask = |profile, key, mode| {
        let mut bench = Bench::new(config(profile, MotorControl::Pwm), room(1.0));
        bench.ask(Command::Conf { key, mode })
    };
    let value = |key, mode| {
        let bytes = ask(Profile::Fw124, key, mode);
        assert_eq!((bytes[6], &bytes[7..11]), (0x20, &key.to_le_bytes()[..]));
        bytes[11..].to_vec()
    };
    assert_eq!(value(0x70, None), [3, 0]);
    assert_eq!(value(0x71, Some(0)), (500_u32 << 8).to_le_bytes());
    assert_eq!(value(0x71, Some(1)), (250_u32 << 8).to_le_bytes());
    assert_eq!(value(0x71, Some(2)), (125_u32 << 8).to_le_bytes());
    assert_eq!(value(0x74, Some(1)), [0, 12, 0, 0]);
    assert_eq!(
        [0, 1, 2].map(|mode| value(0x75, Some(mode))),
        [[0x81], [0x82], [0x84]]
    );
    assert_eq!(value(0x7F, Some(1)), b"Express\0");
    assert_eq!(value(0x7F, Some(9)), []);
    assert_eq!(ask(Profile::Fw129, 0x70, None).len(), 13);
    assert_eq!(ask(Profile::Fw120, 0x70, None), []);
}

/// At the start of the run no text comes, because the sensor has long been on. After a reset and on
/// power-up the 64 bytes that users show come, 671.5 ms later.
#[test]
fn f12_a_reset_and_power_up_print_the_start_text() {
    let texts = [
        "RP LIDAR System.\r\nFirmware Ver 1.20 - rtm, HW Ver 0\r\nModel: 18\r\n",
        "RP LIDAR System.\r\nFirmware Ver 1.24 - rc0, HW Ver 5\r\nModel: 18\r\n",
        "RP LIDAR System.\r\nFirmware Ver 1.29 - rtm, HW Ver 7\r\nModel: 18\r\n",
    ];
    for (profile, text) in Profile::ALL.into_iter().zip(texts) {
        assert_eq!(text.len(), 64);
        let mut bench = Bench::new(config(profile, MotorControl::Pwm), room(1.0));
        assert!(bench.run_ms(3_000).bytes.is_empty());
        assert!(bench.ask(Command::Reset).is_empty());
        assert!(bench.run_ms(651).bytes.is_empty());
        assert_eq!(bench.run_ms(1).bytes, text.as_bytes());
        Device::set_fault(&mut bench.lidar, bench.now, "off", None, true);
        bench.run_ms(2_000).bytes.clear();
        Device::set_fault(&mut bench.lidar, bench.now, "off", None, false);
        assert_eq!(bench.run_ms(1_000).bytes, text.as_bytes());
        assert_eq!(Profile::from_name(profile.name()), Some(profile));
    }
}

/// A reset takes 671.5 ms, in which requests are discarded; 4 ms after the text one is taken.
#[test]
fn requests_during_a_reset_are_discarded() {
    let mut bench = plain();
    bench.send(&[0xA5, 0x40]).run_ms(600);
    assert_eq!(bench.send(&[0xA5, 0x50]).run_ms(76).bytes.len(), 64);
    assert_eq!(bench.rules(), ["reset", "request-while-busy"]);
    assert_eq!(bench.send(&[0xA5, 0x50]).run_ms(20).bytes.len(), 64 + 27);
}

/// LR001 tells the host to wait 1 ms after a stop. The vendor's library for Arduino does not (stop
/// and scan in one write), and real sensors scan.
#[test]
fn f10_a_scan_right_behind_a_stop_is_answered() {
    let mut bench = plain();
    bench.scan();
    for request in [&[0xA5, 0x20][..], &[0xA5, 0x82, 5, 0, 0, 0, 0, 0, 0x22]] {
        bench.bytes.clear();
        bench.send(&[&[0xA5, 0x25], request].concat()).run_ms(20);
        let begins = bench.bytes.windows(2).filter(|two| *two == [0xA5, 0x5A]);
        assert_eq!(begins.count(), 1, "{request:02X?}");
        bench.run_ms(500);
        assert_eq!(bench.lidar.state(), State::Scanning);
    }
    assert_eq!(bench.rules(), ["rotation-stable"; 3]);
}

/// Requests back to back are answered in their order, whatever their number and kind.
#[test]
fn f10_requests_back_to_back_are_answered_in_their_order() {
    let kinds = |requests: &[u8]| {
        let mut bench = plain();
        bench.send(requests).run_ms(20);
        let kinds = bench.frames().into_iter().map(|frame| match frame {
            Frame::Answer(answer) => answer.kind(),
            Frame::Stream(descriptor) => descriptor.kind(),
            other => panic!("{other:?}"),
        });
        (kinds.collect::<Vec<_>>(), bench.rules().len())
    };
    assert_eq!(kinds(&[0xA5, 0x50, 0xA5, 0x52]), (vec![0x04, 0x06], 0));
    let all = [0xA5, 0x25, 0xA5, 0x52, 0xA5, 0x50, 0xA5, 0x59, 0xA5, 0x20];
    assert_eq!(kinds(&all), (vec![0x06, 0x04, 0x15, 0x81], 0));
    // A stop after a scan ends the scan, and the sensor answers the request after the stop.
    assert_eq!(
        kinds(&[0xA5, 0x20, 0xA5, 0x25, 0xA5, 0x50]),
        (vec![0x81, 0x04], 0)
    );
    // If too many requests arrive, the last ones are reported and lost.
    let (answered, told) = kinds(&[0xA5, 0x52].repeat(20));
    assert_eq!((answered.len(), told), (16, 4));
}

/// The five seconds of a request begin with its first byte: another one does not prolong them.
#[test]
fn five_seconds_run_from_the_first_byte() {
    let mut bench = plain();
    bench.send(&[0xA5]).run_ms(4_900).send(&[0xF0]).run_ms(50);
    assert!(bench.rules().is_empty());
    bench.run_ms(100);
    assert_eq!(bench.rules(), ["request-cut"]);
}

/// All bytes of a request arrive within 5 s, or the request is discarded.
#[test]
fn half_a_request_is_forgotten_after_five_seconds() {
    let mut bench = plain();
    bench.send(&[0xA5]).run_ms(4_900).send(&[0x50]).run_ms(20);
    assert_eq!(bench.bytes.len(), 27);
    bench.send(&[0xA5]).run_ms(5_100).send(&[0x50]).run_ms(20);
    assert_eq!(bench.bytes.len(), 27);
    assert_eq!(bench.rules(), ["request-cut", "stray-bytes"]);
    // The whole request is discarded, not only its first byte, so none is found inside.
    bench.send(&[0xA5, 0x82, 0x05, 0xA5, 0x50]).run_ms(5_100);
    assert_eq!(bench.bytes.len(), 27);
    assert_eq!(bench.ask(Command::Info).len(), 27);
}

#[test]
fn damaged_and_unknown_requests_are_reported_and_survived() {
    let mut bench = plain();
    bench.send(&[0xA5, 0x82, 5, 0, 0, 0, 0, 0, 0x23]).run_ms(20);
    bench.send(&[0xA5, 0x33]).run_ms(20);
    bench
        .send(Command::MotorSpeed { rpm: 600 }.request().as_bytes())
        .run_ms(20);
    let rules = bench.rules();
    assert!(rules.contains(&"request-damaged"), "{rules:?}");
    assert!(rules.contains(&"request-unknown"), "{rules:?}");
    assert!(rules.contains(&"request-not-supported"), "{rules:?}");
    assert_eq!(bench.ask(Command::Info).len(), 27);
}

/// DTR low runs the adapter's motor; the client's opening of the port pulls it high.
#[test]
fn dtr_stops_and_starts_the_motor_of_the_adapter() {
    let mut bench = Bench::new(config(Profile::Fw129, MotorControl::Dtr), room(1.0));
    let speed = |bench: &mut Bench, level| {
        bench.lidar.receive(Rplidar::DTR, bench.now, &[level]);
        bench
            .run_ms(5_000)
            .send(&[0xA5, 0x21])
            .run_ms(20)
            .send(&[0xA5, 0x25])
            .run_ms(20);
        bench.lidar.speed_rpm()
    };
    assert_eq!(speed(&mut bench, 1), 0.0);
    // The head makes 7.36 turns a second.
    assert!((438.0..445.0).contains(&speed(&mut bench, 0)));
}

/// The accessory board takes PWM 660 of 1023: 675 * 0.645 - 75 = 360 rpm. It reports its presence.
#[test]
fn f0_drives_the_motor_of_an_accessory_board_only() {
    let speed = |motor| {
        let mut bench = Bench::new(config(Profile::Fw129, motor), room(1.0));
        bench
            .send(&[0xA5, 0xF0, 0x02, 0x94, 0x02, 0xC1])
            .run_ms(5_000);
        let board = answer(&bench.ask(Command::AccBoard))
            .expect("answered")
            .payload()[0];
        bench.scan();
        (board, bench.lidar.speed_rpm(), bench.rules())
    };
    let (board, rpm, _) = speed(MotorControl::Command);
    assert!(board == 1 && (350.0..370.0).contains(&rpm), "{board} {rpm}");
    let (board, rpm, rules) = speed(MotorControl::Pwm);
    assert_eq!((board, rpm), (0, 0.0));
    assert_eq!(rules[0], "motor-not-wired");
}

#[test]
fn a_sensor_that_nobody_reads_drops_whole_packets() {
    let mut bench = plain();
    bench.send(&[0xA5, 0x20]);
    bench.lidar.poll(Instant::from_secs(5), &mut bench.world);
    assert!(bench.lidar.dropped() > 1_000);
    bench.take();
    assert!(bench.bytes.len() <= 4_096);
    assert_eq!(bench.frames().len(), 1 + (bench.bytes.len() - 7) / 5);
}

#[test]
fn the_same_seed_gives_the_same_bytes_however_often_it_is_polled() {
    let run = |step_us: u64| {
        let mut bench = Bench::new(config(Profile::Fw129, MotorControl::Dtr), room(0.7));
        bench.send(&[0xA5, 0x20]);
        for at in (1..=3_000_000 / step_us).map(|n| Instant::from_micros(n * step_us)) {
            bench.lidar.poll(at, &mut bench.world);
            bench.take();
        }
        bench.bytes
    };
    assert_eq!(run(300), run(100_000));
    assert!(run(300).len() > 10_000);
}

#[test]
fn health_of_a_sound_sensor_is_good() {
    assert_eq!(plain().health(), Some(Health::default()));
    assert_eq!(Health::default().status, Status::Good);
}

proptest! {
    /// Any bytes at any time, in any state: no panic, and a reset brings the sensor back.
    #[test]
    fn any_bytes_are_survived(
        pieces in proptest::collection::vec(
            (proptest::collection::vec(prop_oneof![any::<u8>(), Just(0xA5)], 1..12), 0_u64..300),
            1..12,
        ),
        fault in 0..Fault::ALL.len(),
        figure in proptest::option::of(any::<f64>()),
        port in 0_u8..4,
    ) {
        let mut bench = plain();
        let fault = Fault::ALL[fault];
        for (bytes, pause) in pieces {
            bench.lidar.receive(Port(port), bench.now, &bytes);
            bench.send(&bytes).run_ms(pause);
            Rplidar::set_fault(&mut bench.lidar, bench.now, fault, figure);
        }
        bench.lidar.clear_fault(bench.now, fault);
        bench.run_ms(6_000).send(&[0xA5, 0x40]).run_ms(700);
        prop_assert_eq!(bench.ask(Command::Info).len(), 27);
    }
}

/// A break is dropped and noise is judged, only on the host's line. Without supply the sensor
/// notices neither.
#[test]
fn breaks_and_noise_are_told_while_there_is_supply() {
    let told = |port, event, is_off| {
        let mut bench = plain();
        if is_off {
            Device::set_fault(&mut bench.lidar, Instant::ZERO, "off", None, true);
        }
        bench.lidar.take_events();
        bench.lidar.line_event(port, Instant::from_millis(1), event);
        let events = bench.lidar.take_events().into_iter();
        events.map(|event| event.rule).collect::<Vec<_>>()
    };
    assert_eq!(told(Rplidar::UART, LineEvent::Break, false), ["break"]);
    assert_eq!(
        told(Rplidar::UART, LineEvent::FramingError, false),
        ["framing-error"]
    );
    assert_eq!(told(Rplidar::UART, LineEvent::Opened, false), [""; 0]);
    assert_eq!(told(Rplidar::MOTOR, LineEvent::Break, false), [""; 0]);
    assert_eq!(told(Rplidar::UART, LineEvent::Break, true), [""; 0]);
}

/// The A1 cannot set its motor's speed: the request is refused, and a scan continues.
#[test]
fn a_speed_that_is_not_understood_ends_no_scan() {
    let mut bench = plain();
    bench.scan();
    bench.send(Command::MotorSpeed { rpm: 600 }.request().as_bytes());
    bench.bytes.clear();
    bench.run_ms(1_000);
    assert!(bench.bytes.len() > 9_000, "{}", bench.bytes.len());
    assert!(bench.rules().contains(&"request-not-supported"));
}

/// Bytes wait for its own line only.
#[test]
fn an_answer_waits_for_its_line() {
    let mut bench = plain();
    assert!(!bench.lidar.may_send(Rplidar::UART));
    let at = bench.now;
    bench
        .lidar
        .receive(Rplidar::UART, at, Command::Info.request().as_bytes());
    let mut world = room(1.0);
    let soon = at + Duration::from_millis(20);
    bench.lidar.poll(soon, &mut world);
    assert!(bench.lidar.may_send(Rplidar::UART) && !bench.lidar.may_send(Rplidar::DTR));
    let mut buf = [0; 64];
    assert_eq!(bench.lidar.transmit(Rplidar::DTR, &mut buf), 0);
    assert_eq!(bench.lidar.transmit(Rplidar::UART, &mut buf), 27);
    assert!(!bench.lidar.may_send(Rplidar::UART));
}

/// A rest that takes more than 5 s is no part of a request, one that comes in time is.
#[test]
fn half_a_request_waits_for_five_seconds() {
    let answered = |pause_ms: u64| {
        let mut bench = plain();
        let request = Command::Conf {
            key: 0x70,
            mode: None,
        };
        let request = request.request();
        let (head, tail) = request.as_bytes().split_at(4);
        bench.send(head).run_ms(pause_ms);
        bench.bytes.clear();
        bench.send(tail).run_ms(20);
        (bench.rules().contains(&"request-cut"), bench.bytes.len())
    };
    let whole = answered(10);
    assert!(!whole.0);
    assert_eq!(answered(4_900), whole);
    assert!(answered(5_100).0);
    // After a complete request the sensor waits for nothing.
    let mut bench = plain();
    bench.ask(Command::Info);
    bench.run_ms(6_000);
    assert!(!bench.rules().contains(&"request-cut"));
}

#[test]
fn a_stop_ends_the_scan_at_once() {
    let mut bench = plain();
    bench.scan();
    bench.bytes.clear();
    bench.lidar.receive(Rplidar::UART, bench.now, &[0xA5, 0x25]);
    bench.run_ms(1);
    let after = bench.bytes.len();
    bench.run_ms(500);
    assert_eq!(bench.bytes.len(), after);
    assert!(after <= 15, "{after}");
}
