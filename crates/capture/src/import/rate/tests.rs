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

/// Levels of 100,000 baud: each character begins at its time, and changes at these tenths of its
/// bits.
fn drawn(characters: &[(u64, &[u64])]) -> Levels {
    let mut levels = Levels {
        first: true,
        ..Levels::default()
    };
    for (start, tenths) in characters {
        levels.changes.push(*start);
        let changes = tenths.iter().map(|tenth| start + tenth * 1_000);
        levels.changes.extend(changes);
    }
    levels.end = levels.changes.last().map_or(0, |last| last + 1_000_000);
    levels
}

/// `count` times the same characters, a millisecond apart.
fn repeated(parts: &[(usize, &[u64])]) -> Levels {
    let all = parts
        .iter()
        .flat_map(|(count, tenths)| vec![*tenths; *count]);
    let all: Vec<(u64, &[u64])> = (1..).map(|at| at * 1_000_000).zip(all).collect();
    drawn(&all)
}

const LINE: LineConfig = LineConfig::new_8n1(100_000);
/// 0x35: 0, 1 0 1 0 1 1 0 0, 1.
const SEVEN_EDGES: &[u64] = &[10, 20, 30, 40, 50, 70, 90];
/// 0x05: 0, 1 0 1 0 0 0 0 0, 1.
const FIVE_EDGES: &[u64] = &[10, 20, 30, 40, 90];
/// 0x55: all bits alternate.
const SINGLES: &[u64] = &[10, 20, 30, 40, 50, 60, 70, 80, 90];
/// 0xF0: 0, 0 0 0 0 1 1 1 1, 1.
const ONE_LONG: &[u64] = &[50];
/// 0xFF.
const ONE_SHORT: &[u64] = &[10];
/// 0xFE, and no stop bit.
const NO_STOP: &[u64] = &[20, 90, 110];

/// Three digits remain; half a unit is rounded up.
#[test]
fn a_rate_has_three_digits() {
    for (baud, expected) in [
        (0, 0),
        (7, 7),
        (999, 999),
        (1_004, 1_000),
        (1_005, 1_010),
        (9_996, 10_000),
        (115_384, 115_000),
        (115_500, 116_000),
        (1_234_567, 1_230_000),
    ] {
        assert_eq!(rounded(baud), expected, "{baud}");
    }
}

/// More sound than bad characters; one bad character, and one more of each twenty.
#[test]
fn few_characters_may_lack_their_stop_bit() {
    for (sound, bad, expected) in [
        (0, 0, false),
        (1, 0, true),
        (1, 1, false),
        (2, 1, true),
        (3, 2, false),
        (17, 2, false),
        (18, 2, true),
        (37, 3, true),
        (36, 3, false),
    ] {
        let levels = repeated(&[(sound, FIVE_EDGES), (bad, NO_STOP)]);
        assert_eq!(is_framed(&levels, LINE), expected, "{sound} and {bad}");
    }
}

/// The edges of a character lie between its start and its stop bit. Eight bits with parity and two
/// stop bits: 0x01 is odd, so its even parity bit is 1; that of 0x03 is 0.
#[test]
fn edges_count_from_the_start_of_their_character() {
    let levels = drawn(&[(10_000, SINGLES), (110_000, FIVE_EDGES)]);
    let nanos = |edges: &[u64]| -> Vec<f64> { edges.iter().map(|at| *at as f64 * 1e3).collect() };
    assert_eq!(edges(&levels, LINE), [nanos(SINGLES), nanos(FIVE_EDGES)]);
    let even = LineConfig {
        parity: Parity::Even,
        stop_bits: 2,
        ..LINE
    };
    let levels = drawn(&[(10_000, &[10, 20, 90]), (200_000, &[10, 30, 100])]);
    assert_eq!(
        edges(&levels, even),
        [nanos(&[10, 20, 90]), nanos(&[10, 30, 100])]
    );
    assert!(edges(&Levels::default(), LINE).is_empty());
}

/// Pulses of one length are a clock, whether single bits or longer ones. One pulse of thirty has to
/// be a single bit.
#[test]
fn a_line_has_single_bits_and_longer_pulses() {
    let fits = |parts: &[(usize, &[u64])]| fit(&repeated(parts), LINE, 1).is_some();
    assert!(!fits(&[(2, SINGLES)]) && !fits(&[(6, ONE_LONG)]));
    assert!(fits(&[(1, SEVEN_EDGES)]) && fits(&[(1, FIVE_EDGES)]));
    assert!(fits(&[(29, ONE_LONG), (1, ONE_SHORT)]));
    assert!(!fits(&[(30, ONE_LONG), (1, ONE_SHORT)]));
    // 1.4 bits are a single bit, 1.5 and 1.6 bits none.
    assert!(fits(&[(29, ONE_LONG), (1, &[14])]));
    assert!(!fits(&[(29, ONE_LONG), (1, &[15])]));
    assert!(!fits(&[(29, ONE_LONG), (1, &[16])]));
}

/// Nineteen of twenty edges lie within 0.3 bits of a whole number of bits.
#[test]
fn nearly_all_edges_lie_on_whole_bits() {
    let of = |least, tenths: [u64; 2]| {
        let [first, second] = tenths;
        let parts = [
            (1, SEVEN_EDGES),
            (1, &[10, 20, 30, first, 90]),
            (1, &[10, 20, 30, second, 90]),
            (1, &[10, 20, 90]),
        ];
        fit(&repeated(&parts), LINE, least).map(|fit| fit.spread)
    };
    assert_eq!(of(20, [40, 40]), Some(0.0));
    assert_eq!(of(21, [40, 40]), None);
    // One edge of twenty is 4 us away: the root of 16 / 20 us^2. Two are 4 and 2 us away.
    let spread = of(20, [44, 40]).expect("one is away");
    assert!((spread - 894.427).abs() < 0.001, "{spread}");
    let spread = of(20, [44, 42]).expect("one is away, one is near");
    assert!((spread - 1_000.0).abs() < 0.001, "{spread}");
    let spread = of(20, [36, 42]).expect("one is away, one is near");
    assert!((spread - 1_000.0).abs() < 0.001, "{spread}");
    assert_eq!((of(20, [44, 44]), of(20, [44, 36])), (None, None));
}

/// The edges of characters at exactly 100,000 baud correct an estimate that is a percent off.
#[test]
fn a_rate_is_refined_by_all_edges() {
    let levels = repeated(&[(2, SEVEN_EDGES), (1, FIVE_EDGES)]);
    for baud in [99_000, 100_000, 101_000, 104_000] {
        assert_eq!(refined(&levels, LineConfig { baud, ..LINE }), Some(100_000));
    }
    // One edge after four bits and one after five, each 0.2 bits late: 41 squares of bits to
    // 4.2 * 4 + 5.2 * 5 = 42.8, so 95,794 baud.
    let late = repeated(&[(1, &[42]), (1, &[52])]);
    assert_eq!(refined(&late, LINE), Some(95_794));
    assert_eq!(refined(&Levels::default(), LINE), None);
}

/// At least sixteen characters, nine of ten of them text. The highest bit is the parity, or a stop
/// bit if it is always set.
#[test]
fn seven_bits_have_a_parity_or_a_stop_bit_above_them() {
    let of = |bytes: &[u8]| {
        let made = Made::new(9_600);
        let found = seven_bits(&levels(made, bytes), made.line);
        found.map(|line| (line.data_bits, line.parity))
    };
    // 'A' and 'B' have two ones, 'C' has three.
    let even = [b'A', b'C' | 0x80];
    let odd = [b'A' | 0x80, b'C'];
    assert_eq!(of(&even.repeat(8)), Some((7, Parity::Even)));
    assert_eq!(of(&odd.repeat(8)), Some((7, Parity::Odd)));
    assert_eq!(of(&even.repeat(8)[..15]), None);
    assert_eq!(of(&[b'A' | 0x80; 16]), Some((7, Parity::None)));
    assert_eq!(of(&[b'A'; 16]), None);
    assert_eq!(of(&[&even.repeat(8)[..], b"C"].concat()), None);
    // 0x03 and 0x00 are even and no text: two of twenty are allowed, three of 21 are not.
    let text = even.repeat(9);
    assert_eq!(of(&[&text[..], &[3, 0]].concat()), Some((7, Parity::Even)));
    assert_eq!(of(&[&text[..], &[3, 0, 0]].concat()), None);
    // The first and the last character of text, and the ends of lines, with even parity.
    assert_eq!(
        of(&[0xA0, 0x7E, 0x8D, 0x0A, 0x09].repeat(4)),
        Some((7, Parity::Even))
    );
    let line = LineConfig {
        parity: Parity::Even,
        ..LineConfig::new_8n1(9_600)
    };
    let made = Made {
        line,
        ..Made::new(9_600)
    };
    assert_eq!(seven_bits(&levels(made, &[b'A' | 0x80; 16]), line), None);
}
