//! Vectors by hand, the Arduino's rounding, and the fielded host's verification.

extern crate std;

use std::string::String;
use std::vec::Vec;

use proptest::prelude::*;

use super::*;
use crate::Decode as _;

fn printed(number: f32) -> String {
    let mut text = String::new();
    print_float(&mut text, number, 2).unwrap();
    text
}

fn content(line: &Text) -> &str {
    str::from_utf8(line.content()).unwrap()
}

/// By hand, 0.865 also by a second implementation of 32-bit arithmetic. 2.125 is exact and rounds
/// up, where C's `printf` rounds to even. 0.865 is 0.8650000095 in 32 bits and should be 0.87, but
/// 0.86999999 times ten loses the last digit. 20000.125 has 1/512 as its last place: 0.005 more
/// gives 67 of 512 behind the point.
#[test]
fn floats_are_printed_in_the_arduino_way() {
    let cases = [
        (0.0, "0.00"),
        (1.0, "1.00"),
        (0.004, "0.00"),
        (0.006, "0.01"),
        (-0.001, "-0.00"),
        (-1.239, "-1.24"),
        (2.125, "2.13"),
        (0.865, "0.86"),
        (20_000.125, "20000.13"),
        (16_777_216.0, "16777216.00"),
        (4_294_967_040.0, "4294967040.00"),
        (5e9, "ovf"),
        (-5e9, "ovf"),
        (f32::INFINITY, "inf"),
        (f32::NAN, "nan"),
    ];
    for (number, text) in cases {
        assert_eq!(printed(number), text, "{number}");
    }
    let mut whole = String::new();
    print_float(&mut whole, 2.6, 0).unwrap();
    assert_eq!(whole, "3");
}

/// The line holds 1.25 m, 0.5 rad/s, 1.5 rad or 85.9437 degrees, and 12.345 s. The sums are 1.25 +
/// 0.5 + 85.9437 + 12.345 = 100.0387; 1.25 + 0.00625 + 1.5 + 12345 = 12347.75625.
#[test]
fn each_dialect_is_laid_out_by_hand() {
    let measured = Measurement {
        distance_m: 1.25,
        rate_rad_s: 0.5,
        yaw_rad: 1.5,
        time_ms: 12_345,
    };
    let line = |dialect: Dialect| std::format!("{:?}", dialect.line(&measured));
    assert_eq!(
        line(Dialect::Seed),
        r"Text(1.25*0.50*85.94*12.35*100.04*\r\n)"
    );
    assert_eq!(
        line(Dialect::AsCoded),
        r"Text(1.25*0.50*1.50*12345*12347.76*\r\n)"
    );
    let fixed = Dialect::Fixed.line(&measured);
    assert!(content(&fixed).starts_with("1250*500*1500*12345*"));
    let read = Dialect::Fixed.read(fixed.content()).unwrap();
    assert_eq!((read.distance_m, read.rate_rad_s), (1.25, 0.5));
    assert_eq!((read.yaw_rad, read.time_s), (1.5, 12.345));
    let read = Dialect::Seed
        .read(b"1.25*0.50*180.00*12.35*194.10*")
        .unwrap();
    assert_eq!(read.yaw_rad, core::f64::consts::PI);
    assert_eq!(read.time_s, 12.35);
}

/// The published check value of CRC-16 with first value FFFF and polynomial 1021.
#[test]
fn the_crc_has_its_published_check_value() {
    assert_eq!(crc16(b"123456789"), 0x29B1);
    assert_eq!(
        [0.0015, -0.0015, 0.0, 1e9].map(thousandths),
        [2, -2, 0, i32::MAX]
    );
}

/// The CRC has capitals: small letters are another line.
#[test]
fn a_crc_in_small_letters_is_refused() {
    let mut refused = 0;
    for time_ms in 0..20 {
        let measured = Measurement {
            time_ms,
            ..Measurement::default()
        };
        let line = Dialect::Fixed.line(&measured);
        let small = content(&line).to_lowercase();
        if small != content(&line) {
            let read = Dialect::Fixed.read(small.as_bytes());
            assert_eq!(read, Err(LineError::Number { field: 4 }), "{small}");
            refused += 1;
        }
    }
    assert!(refused > 0);
}

/// The first line of a run without a sensor, an empty line, too few fields, a bad figure, a sum
/// that is off by 0.04 where 0.025 + 1/1024 is allowed.
#[test]
fn lines_that_say_nothing_are_told_apart() {
    use LineError as E;
    let read = |line: &str| Dialect::AsCoded.read(line.as_bytes());
    let error = read("Could not find a valid MPU6050 sensor, check wiring!");
    assert_eq!(error, Err(E::Text));
    assert_eq!(read(""), Err(E::Text));
    assert_eq!(read("1.00*0.00*"), Err(E::Fields { found: 2 }));
    assert_eq!(
        read("1.00*0.00*0.00*9000*9001.00*x"),
        Err(E::Fields { found: 5 })
    );
    assert_eq!(read("1.00*nan*0.00*9000*nan*"), Err(E::Number { field: 1 }));
    assert_eq!(
        read(".00*0.00*0.00*9000*9000.00*"),
        Err(E::Number { field: 0 })
    );
    assert!(read("1.00*0.00*0.00*9000*9001.02*").is_ok());
    assert!(matches!(
        read("1.00*0.00*0.00*9000*9001.04*"),
        Err(E::Sum { .. })
    ));
}

/// Of zeros a sum may be off by 5 times 0.005, and by no more: a 32-bit 0 has no last place.
#[test]
fn a_sum_may_be_off_by_what_rounding_does_to_five_figures() {
    let is_read = |sum: &str| {
        let line = std::format!("0.00*0.00*0.00*0*{sum}*");
        Dialect::AsCoded.read(line.as_bytes()).is_ok()
    };
    assert_eq!(["0.025", "-0.025"].map(is_read), [true; 2]);
    assert_eq!(["0.0251", "-0.0251"].map(is_read), [false; 2]);
}

/// 160 bytes are the longest line, with its end.
#[test]
fn a_line_is_waited_for_up_to_160_bytes() {
    use crate::FrameError;
    let mut decoder = Decoder::default();
    assert_eq!(decoder.push(&[b'a'; 159]).count(), 0);
    assert_eq!(decoder.push(b"\n").filter(Result::is_ok).count(), 1);
    let mut decoder = Decoder::default();
    assert_eq!(decoder.push(&[b'a'; 159]).count(), 0);
    let (max, found) = (160, 160);
    let error = Some(Err(FrameError::Length { max, found }));
    assert_eq!(decoder.push(b"a").next(), error);
}

/// The distance in metres, the heading in radians, the time in milliseconds.
#[test]
fn a_line_as_coded_is_read_by_hand() {
    let read = Dialect::AsCoded.read(b"1.25*0.50*1.50*12345*12347.76*");
    let reading = Reading {
        distance_m: 1.25,
        rate_rad_s: 0.5,
        yaw_rad: 1.5,
        time_s: 12.345,
    };
    assert_eq!(read, Ok(reading));
}

#[test]
fn errors_of_lines_tell_what_was_found() {
    use LineError as E;
    let (expected, found) = (1.0, 1.5);
    let sum = E::Sum { expected, found };
    let (expected, found) = (0x29B1, 0xA);
    let told = [
        (E::Text, "line has no figures"),
        (E::Fields { found: 2 }, "line has 2 fields"),
        (E::Number { field: 1 }, "field 1 is no number"),
        (sum, "sum is 1.50, expected 1.00"),
        (E::Crc { expected, found }, "CRC is 000A, expected 29B1"),
    ];
    for (error, text) in told {
        assert_eq!(std::format!("{error}"), text);
    }
}

/// 1 + 0.5 + 2.25 + 4 is 7.75, all of them exact in 32 bits.
#[test]
fn the_exact_sum_wants_five_figures() {
    assert!(passes_exact_sum(b"1.00*0.50*2.25*4.00*7.75*"));
    assert!(!passes_exact_sum(b"1.00*0.50*2.25*4.00*7.76*"));
    assert!(!passes_exact_sum(b"1.00*0.50*2.25*4.00*"));
    assert!(!passes_exact_sum(b"1.00*0.50*2.25*x*7.75*"));
}

/// A line of the later sketch is `#` and ten figures; it has no sum to verify.
#[test]
fn the_later_sketch_has_ten_figures_and_no_sum() {
    let raw = Raw::read(b"#1.25*0.01*0.02*0.50*0.10*0.20*9.81*12.00*-3.00*40.00*").unwrap();
    assert_eq!(raw.distance, 1.25);
    assert_eq!(raw.rates, [0.01, 0.02, 0.5]);
    assert_eq!(raw.accelerations, [0.1, 0.2, 9.81]);
    assert_eq!(raw.field, [12.0, -3.0, 40.0]);
    assert_eq!(Raw::read(b"1*2*3*4*5*6*7*8*9*10*"), Err(LineError::Text));
    assert_eq!(Raw::read(b"#1*2*3*"), Err(LineError::Fields { found: 3 }));
}

/// Line ends CR LF and LF, and the LF LF of a terminal that turns CR into LF, which adds an empty
/// line.
#[test]
fn lines_end_in_any_of_three_ways() {
    let mut decoder = Decoder::default();
    let bytes = b"1*\r\n2*\n3*\n\n4*\r\n";
    let lines: Vec<_> = decoder.push(bytes).map(Result::unwrap).collect();
    let lines: Vec<_> = lines.iter().map(content).collect();
    assert_eq!(lines, ["1*", "2*", "3*", "", "4*"]);
    let endless = [b'a'; 2 * LINE_MAX];
    assert_eq!(decoder.push(&endless).filter(Result::is_ok).count(), 0);
    let lines: Vec<_> = decoder.push(b"b\n5*\n").filter_map(Result::ok).collect();
    assert_eq!(lines.last().map(content), Some("5*"));
}

/// Numbers below 1 from a small generator (the multiplier is Knuth's), the same in every run.
fn chance(state: &mut u64) -> f32 {
    *state = state
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    let high = u16::try_from(*state >> 48).unwrap();
    f32::from(high) / 65_536.0
}

/// Lines of a hundred that a host with an exact comparison accepts, between two uptimes.
fn believed(from_s: f32, to_s: f32, measure: impl Fn(&mut u64, f32) -> [f32; 3], sum: Sum) -> f64 {
    const LINES: u32 = 20_000;
    let mut state = 13;
    let mut count = 0;
    for _ in 0..LINES {
        let time_s = from_s + (to_s - from_s) * chance(&mut state);
        #[expect(
            clippy::cast_sign_loss,
            clippy::cast_possible_truncation,
            reason = "hours"
        )]
        let time_ms = (time_s * 1000.0) as u32;
        let [distance_m, rate_rad_s, yaw_rad] = measure(&mut state, time_s);
        let mut line = Text::default();
        for figure in [distance_m, rate_rad_s, yaw_rad] {
            line.field(figure);
        }
        let figures = [distance_m, rate_rad_s, yaw_rad, float(time_ms)];
        let _ = write!(line, "{time_ms}*");
        line.field(match sum {
            Sum::AsCoded => coded_sum(figures),
            Sum::Right => figures.into_iter().sum(),
        });
        count += u32::from(passes_exact_sum(line.content()));
    }
    100.0 * f64::from(count) / f64::from(LINES)
}

#[derive(Clone, Copy)]
enum Sum {
    AsCoded,
    Right,
}

/// Whole counts of 3.351 mm at 0.22 m/s, and a heading with some drift.
fn straight(state: &mut u64, time_s: f32) -> [f32; 3] {
    let counts = (0.22 * time_s / 0.003_351 * chance(state)).round();
    let rate = 0.008 * (chance(state) - 0.5);
    [counts * 0.003_351, rate, 6.0 * (chance(state) - 0.5)]
}

fn turning(state: &mut u64, time_s: f32) -> [f32; 3] {
    let [distance, _, yaw] = straight(state, time_s);
    [distance, 0.03 + 0.05 * chance(state), yaw]
}

/// Percent by uptime, of a model of the sketch made before this one: straight, in a curve, and in a
/// curve with the sum put right. In a curve the rate is in the line and not in the sum.
#[test]
fn ap3_the_exact_sum_believes_as_many_lines_as_the_table_says() {
    let table = [
        (10.0, 60.0, 72.0, 0.0, 64.0),
        (60.0, 300.0, 71.0, 0.3, 69.0),
        (300.0, 1_200.0, 94.0, 19.0, 93.0),
        (1_200.0, 3_600.0, 98.0, 69.0, 98.0),
        (3_600.0, 14_400.0, 99.0, 92.0, 99.6),
    ];
    let mut wrong = Vec::new();
    for (from, to, ahead, curve, right) in table {
        let found = [
            believed(from, to, straight, Sum::AsCoded),
            believed(from, to, turning, Sum::AsCoded),
            believed(from, to, turning, Sum::Right),
        ];
        if found
            .iter()
            .zip([ahead, curve, right])
            .any(|(a, b)| (a - b).abs() > 5.0)
        {
            wrong.push((from, found));
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

prop_compose! {
    fn measurement()(
        distance_m in -500.0..500.0_f32,
        rate_rad_s in -10.0..10.0_f32,
        yaw_rad in -100.0..100.0_f32,
        time_ms in prop_oneof![0..200_000_u32, any::<u32>()],
    ) -> Measurement {
        Measurement { distance_m, rate_rad_s, yaw_rad, time_ms }
    }
}

proptest! {
    /// Rounding never makes a good line bad, at any uptime.
    #[test]
    fn ap3_our_verification_accepts_every_line(measured in measurement()) {
        for dialect in [Dialect::Seed, Dialect::AsCoded, Dialect::Fixed] {
            let line = dialect.line(&measured);
            let read = dialect.read(line.content());
            prop_assert!(read.is_ok(), "{line:?} {read:?}");
            let off = read.map(|read| (read.distance_m - f64::from(measured.distance_m)).abs());
            prop_assert!(off.is_ok_and(|off| off < 0.0051), "{line:?}");
        }
    }

    /// A line with one wrong byte is not read, and gives no other line.
    #[test]
    fn ap3_the_crc_finds_every_wrong_byte(
        measured in measurement(),
        at in any::<prop::sample::Index>(),
        mask in 1..=u8::MAX,
    ) {
        let line = Dialect::Fixed.line(&measured);
        let mut bytes = line.as_bytes().to_vec();
        // The end of the line carries no figure.
        let at = at.index(bytes.len() - 2);
        bytes[at] ^= mask;
        let mut decoder = Decoder::default();
        for line in decoder.push(&bytes).filter_map(Result::ok) {
            prop_assert!(Dialect::Fixed.read(line.content()).is_err(), "{line:?}");
        }
    }

    #[test]
    fn no_text_makes_a_reader_panic(bytes in prop::collection::vec(
        prop_oneof![Just(b'*'), Just(b'\n'), b'0'..=b'9', any::<u8>()], 0..300
    )) {
        let mut decoder = Decoder::default();
        for line in decoder.push(&bytes).filter_map(Result::ok) {
            let line = line.content();
            for dialect in [Dialect::Seed, Dialect::AsCoded, Dialect::Fixed] {
                let _ = dialect.read(line);
            }
            let _ = (Raw::read(line), passes_exact_sum(line));
        }
    }
}
