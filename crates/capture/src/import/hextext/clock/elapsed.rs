//! Times as numbers with or without a unit.
//!
//! ```text
//! 24.185 ms    24ms    [24 ms]    335215us    +0.024s    0.024185
//! ```

use super::{Clock, next_word};
use crate::import::text::number;

/// Time that `word` holds, perhaps with its unit in the next word, and the rest of the text.
/// A number without a unit counts in seconds and needs a fraction: other numbers may be bytes.
pub(super) fn read<'a>(word: &str, behind: &'a str) -> Option<((u64, Clock), &'a str)> {
    let word = word.strip_prefix('+').unwrap_or(word);
    let end = word.find(|c: char| !c.is_ascii_digit() && c != '.');
    let (digits, unit) = word.split_at(end.unwrap_or(word.len()));
    let (nanos, behind) = if unit.is_empty() {
        let next = next_word(behind).filter(|_| !behind.starts_with(['[', '(']));
        let next = next.and_then(|(unit, rest)| Some((unit_nanos(unit)?, rest)));
        match next {
            Some((unit, rest)) => (scaled(digits, unit)?, rest),
            None => (
                scaled(digits, SECOND).filter(|_| digits.contains('.'))?,
                behind,
            ),
        }
    } else {
        (scaled(digits, unit_nanos(unit.trim_start())?)?, behind)
    };
    Some(((nanos, Clock::Seconds), behind))
}

const SECOND: u64 = 1_000_000_000;

/// Nanoseconds of a unit of time.
fn unit_nanos(word: &str) -> Option<u64> {
    match word.trim_end_matches([':', ',']) {
        "ns" | "nsec" | "nsecs" | "nanos" | "nanosecond" | "nanoseconds" => Some(1),
        // The micro sign and the Greek letter.
        "us" | "\u{b5}s" | "\u{3bc}s" | "usec" | "usecs" | "micros" | "microsecond"
        | "microseconds" => Some(1_000),
        "ms" | "msec" | "msecs" | "millis" | "millisecond" | "milliseconds" => Some(1_000_000),
        "s" | "sec" | "secs" | "second" | "seconds" => Some(SECOND),
        "min" | "mins" | "minute" | "minutes" => Some(60 * SECOND),
        _ => None,
    }
}

/// Nanoseconds of a decimal number of units; digits below one nanosecond are cut.
fn scaled(digits: &str, unit: u64) -> Option<u64> {
    let (whole, fraction) = match digits.split_once('.') {
        Some((whole, fraction)) => (whole, fraction),
        None => (digits, "0"),
    };
    number(fraction)?;
    let nine: String = fraction
        .chars()
        .chain("000000000".chars())
        .take(9)
        .collect();
    let parts = u128::from(number(&nine)?) * u128::from(unit) / u128::from(SECOND);
    let nanos = number(whole)?.checked_mul(unit)?;
    nanos.checked_add(u64::try_from(parts).ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn time(text: &str) -> Option<(u64, &str)> {
        let (word, behind) = next_word(text)?;
        let ((nanos, _), rest) = read(word.trim_end_matches([':', ',']), behind)?;
        Some((nanos, rest))
    }

    /// 24.185 ms are 24,185,000 ns; a unit counts whether a space separates it or not.
    #[test]
    fn a_unit_counts_with_and_without_a_space() {
        for text in [
            "24.185 ms TX 01",
            "24.185ms TX 01",
            "+24.185 ms TX 01",
            "[24.185 ms] TX 01",
            "24.185 ms: TX 01",
            "24185us TX 01",
            "24185 us TX 01",
            "[24185us] TX 01",
            "24185 \u{b5}s TX 01",
            "24185\u{3bc}s TX 01",
            "24185000 ns TX 01",
            "24.185 msec TX 01",
            "0.024185 s TX 01",
            "0.024185 sec TX 01",
            "0.024185 TX 01",
        ] {
            assert_eq!(time(text), Some((24_185_000, "TX 01")), "{text}");
        }
        assert_eq!(time("[24ms] TX"), Some((24_000_000, "TX")));
        assert_eq!(time("2 min TX"), Some((120_000_000_000, "TX")));
        // Nine digits of a fraction count.
        assert_eq!(time("1.9999999999 ns TX"), Some((1, "TX")));
    }

    #[test]
    fn other_numbers_are_no_times() {
        for text in [
            "24 TX 01",
            "24 [ms] TX",
            "24x TX",
            "1.2.3 TX",
            ".5 TX",
            "5. TX",
            "ms TX",
            "AB 24",
            "18446744073709551615 s TX",
        ] {
            assert_eq!(time(text), None, "{text}");
        }
    }
}
