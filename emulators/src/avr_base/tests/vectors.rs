//! Bytes observed on the wire of field firmware b77a6df in a simulated ATmega2560, one test a row,
//! and the same sequences for the documented base.

use super::*;

fn fielded() -> Bench {
    Bench::new(in_phase(Profile::Rcj2015))
}

fn documented() -> Bench {
    Bench::new(in_phase(Profile::Document))
}

/// Checks a row of the table: the reply to the request, and that it began in the measured window. A
/// task before the reply can make that window longer.
fn row(bench: &mut Bench, request: &str, reply: &str) {
    assert_eq!(bench.ask(&hex(request)), hex(reply));
    let latency = bench.latency.map(|latency| latency.as_micros());
    let window = match bench.base.profile() {
        Profile::Document => 50..=50,
        Profile::Rcj2015 | Profile::Rcj2014 => 18..=1_252,
    };
    assert!(
        latency.is_some_and(|at| window.contains(&at)),
        "{latency:?}"
    );
}

const ERROR: &str = "AB FF 00 01 AA";
const ERROR_LOW_FIRST: &str = "AB FF 00 AA 01";

#[test]
fn ten_registers_are_read() {
    let zeros = "00 00 00 00 00 00 00 00 00 00";
    let reply = format!("AB 24 8A {zeros} 01 59");
    row(&mut fielded(), "AB 24 0A 00 D9", &reply);
    let reply = format!("AB 24 8A {zeros} 59 01");
    row(&mut documented(), "AB 24 0A D9 00", &reply);
}

#[test]
fn three_registers_are_written_and_read_back() {
    let mut bench = fielded();
    row(&mut bench, "AB 2E 83 14 EC 00 02 5C", "AB 2E 00 00 D9");
    row(&mut bench, "AB 2E 03 00 DC", "AB 2E 83 14 EC 00 02 5C");
    // The memory, read past the wire, is the same.
    let seen = [46, 47, 48].map(|address| bench.base.peek(address));
    assert_eq!(seen, [Some(0x14), Some(0xEC), Some(0)]);

    let mut bench = documented();
    row(&mut bench, "AB 2E 83 14 EC 00 5C 02", "AB 2E 00 D9 00");
    row(&mut bench, "AB 2E 03 DC 00", "AB 2E 83 14 EC 00 5C 02");
}

#[test]
fn a_wrong_checksum_is_refused_and_nothing_written() {
    let mut bench = fielded();
    row(&mut bench, "AB 24 0A 00 00", ERROR);
    row(&mut bench, "AB 2E 83 14 EC 00 02 5D", ERROR);
    assert_eq!(bench.read(46, 3), [0, 0, 0]);

    let mut bench = documented();
    row(&mut bench, "AB 24 0A 00 00", ERROR_LOW_FIRST);
    row(&mut bench, "AB 2E 83 14 EC 00 5D 02", ERROR_LOW_FIRST);
    assert_eq!(bench.read(46, 3), [0, 0, 0]);
}

#[test]
fn nothing_is_read_on_request() {
    row(&mut fielded(), "AB 24 00 00 CF", "AB 24 80 01 4F");
    row(&mut fielded(), "AB 00 00 00 AB", "AB 00 80 01 2B");
    row(&mut documented(), "AB 24 00 CF 00", "AB 24 80 4F 01");
}

#[test]
fn writing_nothing_is_acknowledged_and_restarts_the_motor_time_out() {
    let mut bench = fielded();
    bench.write(46, &[20, 20, 0]);
    bench.run(Duration::from_millis(900));
    row(&mut bench, "AB 2E 80 01 59", "AB 2E 00 00 D9");
    bench.run(Duration::from_millis(900));
    assert_eq!(bench.base.set_points(), [20, 20]);
}

#[test]
fn noise_before_a_frame_is_skipped() {
    let skipped = "AB 24 80 01 4F";
    row(&mut fielded(), "00 11 FF AB 24 00 00 CF", skipped);
    let skipped = "AB 24 80 4F 01";
    row(&mut documented(), "00 11 FF AB 24 00 CF 00", skipped);
}

/// AB AB 24 01 00 reads as a request for 36 registers from 171 on with checksum 0100; the D0 after
/// it comes while the base is busy.
#[test]
fn an_extra_start_byte_costs_the_fielded_base_the_request() {
    let mut bench = fielded();
    assert_eq!(bench.ask(&hex("AB AB 24 01 00 D0")), hex(ERROR));
    assert_eq!(bench.read(36, 1), [0]);
    row(&mut documented(), "AB AB 24 01 D0 00", "AB 24 81 00 50 01");
}

#[test]
fn of_frames_back_to_back_only_the_first_is_answered() {
    let two = hex("AB 24 01 00 D0 AB 25 01 00 D1");
    let three = hex("AB 24 01 00 D0 AB 25 01 00 D1 AB 26 01 00 D2");
    let only = hex("AB 24 81 00 01 50");
    assert_eq!(fielded().ask(&two), only);
    assert_eq!(fielded().ask(&three), only);
}

#[test]
fn the_documented_base_answers_frames_back_to_back_one_by_one() {
    let two = hex("AB 24 01 D0 00 AB 25 01 D1 00");
    let both = hex("AB 24 81 00 50 01 AB 25 81 00 51 01");
    assert_eq!(documented().ask(&two), both);
}

#[test]
fn a_second_frame_500_us_later_is_answered() {
    let mut bench = fielded();
    bench.ask(&hex("AB 24 01 00 D0"));
    bench.send(&hex("AB 24 01 00 D0"));
    bench.run(Duration::from_micros(500));
    bench.send(&hex("AB 25 01 00 D1"));
    bench.run(MS);
    assert_eq!(bench.take(), hex("AB 24 81 00 01 50 AB 25 81 00 01 51"));
}

#[test]
fn a_read_past_the_end_leaks_the_request_behind_the_registers() {
    row(&mut fielded(), "AB 35 01 00 E1", "AB 35 81 35 01 96");
    let leak = fielded().read(53, 16);
    // Register, count, and at last the checksum of this very request (AB + 35 + 10 = 00F0).
    assert_eq!((leak[0], leak[1]), (0x35, 0x10));
    assert_eq!(leak[4..6], [0xF0, 0x00]);
    row(&mut documented(), "AB 35 01 E1 00", ERROR_LOW_FIRST);
}

#[test]
fn any_address_is_read() {
    let mut bench = fielded();
    assert_eq!(bench.read(255, 1).len(), 1);
    assert_eq!(bench.read(200, 1).len(), 1);
    assert_eq!(bench.read(0, 127).len(), 127);
    let mut bench = documented();
    assert_eq!(bench.read(255, 1).len(), 0);
    assert_eq!(bench.read(0, 127).len(), 0);
    assert_eq!(bench.read(0, 53).len(), 53);
}

#[test]
fn a_write_to_register_255_looks_like_an_error_and_is_done() {
    let mut bench = fielded();
    // The distance that lies there was measured at 100.4 ms, and is again at 251 ms.
    bench.run(110 * MS);
    assert_eq!(bench.write(255, &[0x55]), hex(ERROR));
    assert_eq!(bench.read(255, 1), [0x55]);
}

#[test]
fn a_write_over_the_request_is_acknowledged_with_a_wrong_register() {
    let mut bench = fielded();
    assert_eq!(bench.write(50, &[0x55; 10]), hex("AB 55 00 01 00"));
    assert_eq!(bench.read(50, 3), [0x55; 3]);
}

#[test]
fn a_long_write_behind_the_registers_is_survived() {
    let mut bench = fielded();
    assert_eq!(bench.write(53, &[0x11; 126]), hex("AB 11 00 00 BC"));
    assert_eq!(bench.read(36, 1), [0]);
}

#[test]
fn a_write_of_127_bytes_is_never_answered() {
    let mut bench = fielded();
    assert_eq!(bench.write(0, &[0; 127]), [0_u8; 0]);
    assert_eq!(bench.read(36, 1), [0]);
}

/// In the simulator the processor ran away; on the robot its watchdog restarts it after a second,
/// and the main loop comes up five seconds later.
#[test]
fn three_hundred_bytes_behind_a_write_of_127_crash_the_processor() {
    let mut bench = fielded();
    bench.run(PAUSE);
    let mut flood = Frame::write(0, &[0; 127], bench.order())
        .as_bytes()
        .to_vec();
    flood.extend([0; 300]);
    // Within one count of the divider, so that the unfinished frame is not discarded: from just
    // after 50.2 ms on, 4.3 ms long.
    bench.run(Duration::from_micros(50_300) - (bench.now - Instant::ZERO));
    bench.send(&flood);
    let crashed = bench.notes();
    assert_eq!(crashed[0].1, "crashed", "{crashed:?}");
    assert_eq!(bench.ask(&hex("AB 24 01 00 D0")), [0_u8; 0]);
    bench.run(Duration::from_secs(1));
    assert_eq!(bench.base.led(), Led::Blink { hue: 1 });
    bench.run(Duration::from_secs(7));
    assert_eq!(bench.read(36, 1), [0]);
}

#[test]
fn a_write_to_a_measured_speed_is_acknowledged_and_lost() {
    let mut bench = fielded();
    assert_eq!(bench.write(44, &[77]), hex("AB 2C 00 00 D7"));
    assert_eq!(bench.read(44, 1), [0]);
    assert_eq!(documented().write(44, &[77]), hex(ERROR_LOW_FIRST));
}

#[test]
fn registers_that_nobody_feeds_keep_what_is_written() {
    let mut bench = fielded();
    for register in [13, 14, 17, 18, 34] {
        bench.write(register, &[0x5A]);
        assert_eq!(bench.read(register, 1), [0x5A]);
    }
}

#[test]
fn set_points_beyond_the_limit_read_back_as_written() {
    let mut bench = fielded();
    bench.write(46, &[100, 0x9C]);
    assert_eq!(bench.read(46, 2), [0x64, 0x9C]);
    assert_eq!(bench.base.set_points(), [35, -35]);
    let mut bench = documented();
    bench.write(46, &[100, 0x9C]);
    assert_eq!(bench.read(46, 2), [35, 0xDD]);
}

/// The report documents registers 0 to 52: even a request for nothing must name one of them.
#[test]
fn the_documented_base_refuses_every_register_beyond_the_map() {
    let mut bench = documented();
    for register in 53..=255 {
        let request = Frame::read(register, 0, bench.order());
        assert_eq!(bench.ask(request.as_bytes()), hex(ERROR_LOW_FIRST));
    }
    assert_eq!(bench.read(52, 1), [0]);
}
