//! Rate and coding of a line, derived from its levels.
//!
//! Only edges inside characters count: each edge is compared with the beginning of its own
//! character, which is a whole number of bits earlier. The idle time between two characters has no
//! influence.

use protocols::{LineConfig, Parity};

use super::uart::{Levels, Read, characters};

/// Rates that adapters and devices use, bit/s, the slowest first.
const RATES: [u32; 41] = [
    50, 75, 110, 134, 150, 200, 300, 600, 1_200, 1_800, 2_400, 4_800, 9_600, 14_400, 19_200,
    28_800, 31_250, 38_400, 57_600, 74_880, 76_800, 100_000, 115_200, 128_000, 153_600, 230_400,
    250_000, 256_000, 420_000, 460_800, 500_000, 576_000, 921_600, 1_000_000, 1_152_000, 1_500_000,
    2_000_000, 2_500_000, 3_000_000, 3_500_000, 4_000_000,
];
/// Codings that are tried if none is given, the most common first. A second stop bit reads as idle.
const CODINGS: [(u8, Parity); 6] = [
    (8, Parity::None),
    (8, Parity::Even),
    (8, Parity::Odd),
    (7, Parity::Even),
    (7, Parity::Odd),
    (7, Parity::None),
];
/// Maximum number of examined level changes; more would only take longer.
const CHANGES_MAX: usize = 20_000;
/// Minimum number of edges inside characters to derive a common and an uncommon rate.
const EDGES_MIN: usize = 6;
const UNUSUAL_EDGES_MIN: usize = 40;
/// Minimum number of bytes to distinguish seven bits from eight.
const SEVEN_MIN: usize = 16;

/// Quality of the fit of a line to some levels.
#[derive(Clone, Copy, Debug)]
struct Fit {
    line: LineConfig,
    /// Distance of an edge from a whole number of bits, nanoseconds, root mean square.
    spread: f64,
}

/// Derives the rate and the coding of a line, unless they are given.
pub(super) fn derived(
    levels: &Levels,
    baud: Option<u32>,
    coding: Option<LineConfig>,
) -> Option<LineConfig> {
    let levels = &levels.first_changes(CHANGES_MAX);
    let codings: Vec<LineConfig> = match coding {
        Some(coding) => vec![coding],
        None => CODINGS.map(with_coding).to_vec(),
    };
    let found = match baud {
        Some(baud) => codings
            .iter()
            .map(|&coding| LineConfig { baud, ..coding })
            .find(|&line| is_framed(levels, line)),
        None => codings.iter().find_map(|&coding| usual(levels, coding)),
    };
    let unusual = || codings.iter().find_map(|&coding| unusual(levels, coding));
    let found = found.or_else(|| unusual().filter(|_| baud.is_none()))?;
    Some(match coding {
        Some(_) => found,
        None => seven_bits(levels, found).unwrap_or(found),
    })
}

const fn with_coding((data_bits, parity): (u8, Parity)) -> LineConfig {
    LineConfig {
        data_bits,
        parity,
        ..LineConfig::new_8n1(1)
    }
}

/// Whether adapters and devices use this rate.
pub(super) fn is_usual(baud: u32) -> bool {
    RATES.contains(&baud)
}

/// The slowest common rate that fits: at a multiple of the rate, edges also lie on whole bits. Of
/// neighbouring rates, one that fits much better is correct.
fn usual(levels: &Levels, coding: LineConfig) -> Option<LineConfig> {
    let fits = RATES.map(|baud| fit(levels, LineConfig { baud, ..coding }, EDGES_MIN));
    let fits: Vec<Fit> = fits.into_iter().flatten().collect();
    let least = fits.iter().map(|fit| fit.spread).reduce(f64::min)?;
    const NANOS: f64 = 1e9;
    let is_best = |fit: &&Fit| {
        let bit = NANOS / f64::from(fit.line.baud);
        fit.spread <= 1.5 * least + 0.02 * bit
    };
    fits.iter().find(is_best).map(|fit| fit.line)
}

/// Derives an uncommon rate: the bit is first estimated from the shortest pulses, then from all
/// edges.
fn unusual(levels: &Levels, coding: LineConfig) -> Option<LineConfig> {
    let mut pulses = levels.pulses();
    // The longest relevant bit is far shorter.
    pulses.retain(|pulse| *pulse < 1 << 40);
    pulses.sort_unstable();
    // A few glitches may be shorter.
    let shortest = *pulses.get(pulses.len() / 20)?;
    let single: Vec<u64> = pulses
        .into_iter()
        .filter(|&pulse| pulse >= shortest && pulse * 2 < shortest * 3)
        .collect();
    let sum: u64 = single.iter().sum();
    let bit = sum.checked_div(u64::try_from(single.len()).ok()?)?;
    let baud = u32::try_from(1_000_000_000_u64.checked_div(bit)?).ok()?;
    let mut line = LineConfig { baud, ..coding };
    for _ in 0..4 {
        line.baud = refined(levels, line)?;
    }
    line.baud = rounded(line.baud);
    let fit = fit(levels, line, UNUSUAL_EDGES_MIN)?;
    let bit = 1e9 / f64::from(line.baud);
    (fit.spread < 0.12 * bit).then_some(line)
}

/// Rounds to three digits: a clock and the samples are not more exact.
fn rounded(baud: u32) -> u32 {
    let digits = baud.checked_ilog10().map_or(0, |log| log.saturating_sub(2));
    let unit = 10_u32.pow(digits);
    (baud + unit / 2) / unit * unit
}

/// Refines the rate with all edges inside characters. Each edge gives the length of the bits before
/// it.
fn refined(levels: &Levels, line: LineConfig) -> Option<u32> {
    let bit = 1e9 / f64::from(line.baud.max(1));
    let (mut sum, mut squares) = (0.0, 0.0);
    for offset in edges(levels, line).concat() {
        let bits = (offset / bit).round();
        sum += offset * bits;
        squares += bits * bits;
    }
    let baud = 1e9 * squares / sum;
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the range, rounded"
    )]
    (1.0..1e8).contains(&baud).then_some(baud.round() as u32)
}

/// Times of the edges of each character, nanoseconds from its beginning up to its stop bit.
fn edges(levels: &Levels, line: LineConfig) -> Vec<Vec<f64>> {
    let baud = u64::from(line.baud.max(1));
    let nanos = |half_bits: u64| half_bits * 500_000_000 / baud;
    let has_parity = line.parity != Parity::None;
    let stop_at = 1 + u64::from(line.data_bits) + u64::from(has_parity);
    let whole = nanos(2 * (stop_at + u64::from(line.stop_bits)));
    let read = characters(levels, line);
    let own = read.iter().map(|&(end, _)| {
        let start = end.saturating_sub(whole);
        let first = levels.changes.partition_point(|&change| change <= start);
        let last = start.saturating_add(nanos(2 * stop_at + 1));
        let own = levels.changes[first..].iter();
        let own = own.take_while(|&&change| change < last);
        #[expect(clippy::cast_precision_loss, reason = "a deviation is judged")]
        own.map(|change| (change - start) as f64).collect()
    });
    own.collect()
}

/// Quality of the fit of a line. A line fits only if nearly all edges lie on whole bits, and single
/// bits occur beside longer pulses. Nearly all characters must have correct stop bits and parity.
fn fit(levels: &Levels, line: LineConfig, edges_min: usize) -> Option<Fit> {
    let bit = 1e9 / f64::from(line.baud.max(1));
    let (mut all, mut near, mut squares) = (0_usize, 0_usize, 0.0);
    let (mut pulses, mut singles) = (0_usize, 0_usize);
    for character in edges(levels, line) {
        let mut last = 0.0;
        for offset in character {
            let bits = offset / bit;
            let away = (bits - bits.round()).abs();
            all += 1;
            near += usize::from(away < 0.3);
            squares += away * away * bit * bit;
            pulses += 1;
            singles += usize::from((offset - last) / bit < 1.5);
            last = offset;
        }
    }
    // Pulses of one length are a clock or a servo signal.
    let is_mixed = singles * 30 >= pulses && singles < pulses;
    let is_told = all >= edges_min && near * 20 >= all * 19 && is_mixed;
    if !is_told || !is_framed(levels, line) {
        return None;
    }
    #[expect(clippy::cast_precision_loss, reason = "a deviation is judged")]
    let spread = libm::sqrt(squares / all as f64);
    Some(Fit { line, spread })
}

/// Whether nearly all characters have correct stop bits and parity. The first character may be cut.
fn is_framed(levels: &Levels, line: LineConfig) -> bool {
    let read = characters(levels, line);
    let sound = bytes(&read).count();
    let bad = read.len() - sound;
    sound > bad && bad <= 1 + read.len() / 20
}

fn bytes(read: &[(u64, Read)]) -> impl Iterator<Item = u8> {
    read.iter().filter_map(|(_, read)| match read {
        Read::Byte(byte) => Some(*byte),
        Read::Event(_) => None,
    })
}

/// The line with seven bits, if its eight-bit characters are text whose highest bit is the parity
/// of the others, or a stop bit.
fn seven_bits(levels: &Levels, line: LineConfig) -> Option<LineConfig> {
    if (line.data_bits, line.parity) != (8, Parity::None) {
        return None;
    }
    let read = characters(levels, line);
    let all: Vec<u8> = bytes(&read).collect();
    let is_text = |byte: &&u8| matches!(**byte & 0x7F, b' '..=b'~' | b'\r' | b'\n' | b'\t');
    let text = all.iter().filter(is_text).count();
    if all.len() < SEVEN_MIN || text * 10 < all.len() * 9 {
        return None;
    }
    let high = all.iter().filter(|byte| **byte >= 0x80).count();
    let ones = |odd: u32| all.iter().all(|byte| byte.count_ones() % 2 == odd);
    let parity = match high {
        0 => return None,
        high if high == all.len() => Parity::None,
        _ if ones(0) => Parity::Even,
        _ if ones(1) => Parity::Odd,
        _ => return None,
    };
    let data_bits = 7;
    Some(LineConfig {
        data_bits,
        parity,
        ..line
    })
}

#[cfg(test)]
mod tests;
