//! Lines of all common rates, generated bit by bit: with jitter, coarse samples, parity, and idle
//! of any length between the characters.

use super::*;

/// Parameters of a generated line.
#[derive(Clone, Copy)]
struct Made {
    line: LineConfig,
    /// Nanoseconds per sample; none if changes are exact.
    sample: u64,
    /// Maximum delay of an edge, nanoseconds.
    jitter: u64,
    /// Maximum idle time between two characters, thousandths of a bit.
    idle: u64,
}

impl Made {
    fn new(baud: u32) -> Self {
        Self {
            line: LineConfig::new_8n1(baud),
            sample: 0,
            jitter: 0,
            idle: 40_000,
        }
    }
}

/// A reproducible sequence of random numbers.
struct Chance(u64);

impl Chance {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % limit.max(1)
    }
}

fn levels(made: Made, bytes: &[u8]) -> Levels {
    let mut chance = Chance(u64::from(made.line.baud));
    let mut levels = Levels {
        first: true,
        ..Levels::default()
    };
    let bit = |bits1000: u64| bits1000 * 1_000_000 / u64::from(made.line.baud);
    let mut start = bit(30_000 + chance.below(5_000));
    for &byte in bytes {
        let mut bits = vec![false];
        bits.extend((0..made.line.data_bits).map(|index| byte >> index & 1 == 1));
        let is_odd = bits.iter().filter(|bit| **bit).count() % 2 == 1;
        match made.line.parity {
            Parity::None => {}
            Parity::Even => bits.push(is_odd),
            Parity::Odd => bits.push(!is_odd),
        }
        bits.extend(vec![true; usize::from(made.line.stop_bits)]);
        for (index, &level) in (0_u64..).zip(&bits) {
            let exact = start + bit(index * 1_000) + chance.below(made.jitter + 1);
            let sampled = match made.sample {
                0 => exact,
                sample => exact.div_ceil(sample) * sample,
            };
            levels.set(sampled, level);
        }
        start += bit(1_000 * bits.len() as u64 + chance.below(made.idle + 1));
    }
    levels.end = start + bit(30_000);
    levels
}

/// Bytes of all kinds.
fn mixed(count: usize) -> Vec<u8> {
    let mut chance = Chance(7);
    let byte = |_| u8::try_from(chance.below(256)).expect("a byte");
    (0..count).map(byte).collect()
}

fn told(made: Made, bytes: &[u8]) -> Option<LineConfig> {
    derived(&levels(made, bytes), None, None)
}

/// Idle of a fractional number of bits, or no idle, at each rate; also with few bytes.
#[test]
fn every_usual_rate_is_told_whatever_the_idle() {
    for baud in RATES {
        for idle in [0, 3_333, 9_000_000] {
            for count in [6, 40] {
                let made = Made {
                    idle,
                    ..Made::new(baud)
                };
                let found = told(made, &mixed(count));
                assert_eq!(found, Some(made.line), "{baud} idle {idle} count {count}");
            }
        }
    }
}

/// Samples at a rate that is no multiple, down to five samples per bit.
#[test]
fn a_rate_is_told_from_coarse_samples() {
    for (baud, sample) in [
        (115_200, 1_000),
        (115_200, 1_667),
        (57_600, 3_000),
        (9_600, 20_000),
        (921_600, 200),
        (460_800, 417),
        (76_800, 2_000),
        (74_880, 1_000),
        (256_000, 500),
        (31_250, 5_000),
    ] {
        let made = Made {
            sample,
            ..Made::new(baud)
        };
        assert_eq!(told(made, &mixed(200)), Some(made.line), "{baud} {sample}");
    }
}

/// Edges late by up to an eighth of a bit.
#[test]
fn a_rate_is_told_in_spite_of_jitter() {
    for baud in [1_200, 9_600, 38_400, 115_200, 250_000, 1_000_000, 3_000_000] {
        let jitter = 125_000_000 / u64::from(baud);
        let made = Made {
            jitter,
            ..Made::new(baud)
        };
        assert_eq!(told(made, &mixed(200)), Some(made.line), "{baud}");
    }
}

#[test]
fn parity_and_stop_bits_are_told() {
    for (data_bits, parity, stop_bits) in [
        (8, Parity::Even, 1),
        (8, Parity::Odd, 1),
        (8, Parity::Even, 2),
        (7, Parity::Even, 1),
        (7, Parity::Odd, 2),
        (7, Parity::None, 1),
    ] {
        for (baud, idle) in [(9_600, 0), (19_200, 12_345), (115_200, 700)] {
            let line = LineConfig {
                baud,
                data_bits,
                parity,
                stop_bits,
            };
            let made = Made {
                line,
                idle,
                ..Made::new(baud)
            };
            let text = b"the quick brown fox jumps over 13 lazy dogs.\r\n".repeat(3);
            let found = told(made, &text).expect("a line");
            let is = (found.baud, found.data_bits, found.parity);
            assert_eq!(is, (baud, data_bits, parity), "{line:?} idle {idle}");
            let read = characters(&levels(made, &text), found);
            assert!(bytes(&read).eq(text.iter().copied()), "{line:?}");
        }
    }
    let made = Made {
        line: LineConfig {
            stop_bits: 2,
            ..LineConfig::new_8n1(9_600)
        },
        ..Made::new(9_600)
    };
    let found = told(made, &mixed(100)).expect("a line");
    assert_eq!((found.baud, found.parity), (9_600, Parity::None));
    assert!(bytes(&characters(&levels(made, &mixed(100)), found)).eq(mixed(100)));
}

/// Derived from many bytes; few bytes are not sufficient.
#[test]
fn a_rate_that_nobody_uses_is_told() {
    for baud in [62_500, 10_400, 83_300, 45_500, 312_000, 7_812] {
        let found = told(Made::new(baud), &mixed(200)).map(|line| line.baud);
        let found = found.expect("a rate");
        assert!(found.abs_diff(baud) * 200 < baud, "{baud}: {found}");
    }
}

/// A clock, a servo signal, noise, and an empty line.
#[test]
fn what_is_no_uart_has_no_rate() {
    let of = |changes: Vec<u64>| Levels {
        first: true,
        end: changes.last().map_or(0, |last| last + 1_000_000),
        changes,
        is_open: false,
    };
    assert_eq!(derived(&Levels::default(), None, None), None);
    let clock = of((1..2_000).map(|at| at * 500).collect());
    assert_eq!(derived(&clock, None, None), None);
    let servo = of((0..400)
        .map(|at| 1_000_000 + at / 2 * 20_000_000 + at % 2 * 1_500_000)
        .collect());
    assert_eq!(derived(&servo, None, None), None);
    assert_eq!(derived(&servo.inverted(), None, None), None);
    let mut chance = Chance(3);
    let mut at = 0;
    let noise = (0..2_000).map(|_| {
        at += 100 + chance.below(20_000);
        at
    });
    assert_eq!(derived(&of(noise.collect()), None, None), None);
}

/// A given rate stays, even if another one fits better.
#[test]
fn what_is_given_stays() {
    let made = Made::new(9_600);
    let levels = levels(made, &mixed(50));
    let even = with_coding((8, Parity::Even));
    assert_eq!(derived(&levels, Some(9_600), None), Some(made.line));
    assert_eq!(derived(&levels, None, Some(even)), None);
    assert_eq!(derived(&levels, Some(4_800), None), None);
}
