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

/// Firmware 1.24: three modes, 2.0, 4.0 and 8.0 K samples a second, 12.0 m each.
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
        [value(0x75, Some(0)), value(0x75, Some(1))],
        [[0x81], [0x82]]
    );
    assert_eq!(value(0x7F, Some(1)), b"Express\0");
    assert_eq!(value(0x7F, Some(9)), []);
    assert_eq!(ask(Profile::Fw129, 0x70, None).len(), 13);
    assert_eq!(ask(Profile::Fw120, 0x70, None), []);
}

/// No bytes on power-up; after a reset a text of about 63 bytes that begins with R.
#[test]
fn only_a_reset_prints_the_start_text() {
    for profile in Profile::ALL {
        let mut bench = Bench::new(config(profile, MotorControl::Pwm), room(1.0));
        assert!(bench.run_ms(3_000).bytes.is_empty());
        let text = bench.ask(Command::Reset);
        assert_eq!((text.len(), text[0]), (63, b'R'));
        assert_eq!(Profile::from_name(profile.name()), Some(profile));
    }
}

/// A reset takes 2 ms, in which requests are discarded.
#[test]
fn requests_during_a_reset_are_discarded() {
    let mut bench = plain();
    bench.send(&[0xA5, 0x40]).run_ms(1);
    assert_eq!(bench.send(&[0xA5, 0x50]).run_ms(20).bytes.len(), 63);
    assert_eq!(bench.send(&[0xA5, 0x50]).run_ms(20).bytes.len(), 63 + 27);
}

/// After a stop the sensor takes no request for 1 ms: two byte times are 0.17 ms.
#[test]
fn a_request_right_behind_a_stop_is_discarded() {
    let mut bench = plain();
    bench.send(&[0xA5, 0x25, 0xA5, 0x50]).run_ms(20);
    assert!(bench.bytes.is_empty());
    assert_eq!(bench.rules(), ["request-while-busy"]);
    bench
        .send(&[0xA5, 0x25])
        .run_ms(2)
        .send(&[0xA5, 0x50])
        .run_ms(20);
    assert_eq!(bench.bytes.len(), 27);
}

/// Two requests back to back: the second is complete 0.17 ms behind the first, which is answered
/// after 1 ms, and is discarded.
#[test]
fn a_request_while_another_is_handled_is_discarded() {
    let mut bench = plain();
    bench.send(&[0xA5, 0x50, 0xA5, 0x52]).run_ms(20);
    assert_eq!(bench.bytes.len(), 27);
    assert_eq!(bench.rules(), ["request-while-busy"]);
    bench
        .send(&[0xA5, 0x50])
        .run_ms(2)
        .send(&[0xA5, 0x52])
        .run_ms(20);
    assert_eq!(bench.bytes.len(), 27 + 27 + 10);
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

/// All bytes of a request come within 5 s, or it is discarded.
#[test]
fn half_a_request_is_forgotten_after_five_seconds() {
    let mut bench = plain();
    bench.send(&[0xA5]).run_ms(4_900).send(&[0x50]).run_ms(20);
    assert_eq!(bench.bytes.len(), 27);
    bench.send(&[0xA5]).run_ms(5_100).send(&[0x50]).run_ms(20);
    assert_eq!(bench.bytes.len(), 27);
    assert_eq!(bench.rules(), ["request-cut", "stray-bytes"]);
    // What is discarded hides nothing: the whole request is gone, not only its first byte.
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
    // 7.4 turns a second.
    assert!((440.0..456.0).contains(&speed(&mut bench, 0)));
}

/// The accessory board takes PWM 660 of 1023: 675 * 0.645 - 75 = 360 rpm. It says that it is there.
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
        bench.run_ms(6_000).send(&[0xA5, 0x40]).run_ms(100);
        prop_assert_eq!(bench.ask(Command::Info).len(), 27);
    }
}

/// A break is dropped, noise is judged, on the host's line only; without supply nobody notices.
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

/// The A1 knows no speed of its motor: the request is refused, and a scan goes on.
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
    // After a request that came whole nothing is waited for.
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
