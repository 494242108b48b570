//! Times as numbers with or without a unit.
//!
//! ```text
//! 24.185 ms    24ms    [24 ms]    335215us    +0.024s    0.024185
//! 1682942398.5      1682942398500      seconds or milliseconds since 1970
//! ```

use engine::hex;

use super::{Clock, next_word};
use crate::import::text::number;

/// Time that `word` holds, perhaps with its unit in the next word, and the rest of the text.
/// A number without a unit counts in seconds and needs a fraction: other numbers may be bytes.
pub(super) fn read<'a>(word: &str, behind: &'a str) -> Option<((u64, Clock), &'a str)> {
    let next = next_word(behind).map(|(word, _)| word.trim_end_matches([':', ',']));
    if let Some(nanos) = since_1970(word, next) {
        return Some(((nanos, Clock::Utc), behind));
    }
    let (word, clock) = match word.strip_prefix('+') {
        Some(word) => (word, Clock::Plus),
        None => (word, Clock::Seconds),
    };
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
    Some(((nanos, clock), behind))
}

/// Time in a word among others: since 1970, or with a plus sign and a fraction.
pub(super) fn within(word: &str) -> Option<(u64, Clock)> {
    let word = word.trim_end_matches([':', ',']);
    if let Some(nanos) = since_1970(word, None) {
        return Some((nanos, Clock::Utc));
    }
    let is_plus = word.starts_with('+') && word.contains('.');
    is_plus.then(|| read(word, "")).flatten().map(|(at, _)| at)
}

/// Nanoseconds since 1970 of `1682942398.5`, or of thirteen digits, milliseconds, or nineteen,
/// nanoseconds. Ten digits may be bytes, unless a word that is no hex number stands behind them.
fn since_1970(word: &str, next: Option<&str>) -> Option<u64> {
    let is_before_word = next.is_some_and(|next| {
        next.starts_with(|c: char| c.is_ascii_alphabetic()) && hex::bytes(next).is_none()
    });
    let unit = match word.find('.').unwrap_or(word.len()) {
        10 if word.len() > "1682942398.".len() || is_before_word => SECOND,
        13 => 1_000_000,
        19 if word.len() == 19 => 1,
        _ => return None,
    };
    // From 2001 to 2033.
    scaled(word, unit).filter(|_| word.starts_with('1'))
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
pub(in crate::import) fn scaled(digits: &str, unit: u64) -> Option<u64> {
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
        // Only nine digits of a fraction count.
        assert_eq!(time("1.9999999999 ns TX"), Some((1, "TX")));
    }

    /// 1,682,942,398 s by `date -u -d '2023-05-01 11:59:58' +%s`.
    #[test]
    fn numbers_since_1970_count_in_the_unit_of_their_digits() {
        for text in [
            "1682942398.500000000 TX",
            "[1682942398.5] TX",
            "(1682942398.5) TX",
            "1682942398.5: TX",
            "1682942398500 TX",
            "1682942398500: TX",
            "1682942398500000000 TX",
        ] {
            let (word, behind) = next_word(text).expect("a word");
            let expected = Some(((1_682_942_398_500_000_000, Clock::Utc), "TX"));
            assert_eq!(read(word.trim_end_matches(':'), behind), expected, "{text}");
        }
        assert_eq!(
            time("1682942398 TX 01"),
            Some((1_682_942_398 * SECOND, "TX 01"))
        );
        for bytes in [
            "1682942398",
            "1682942398 AB",
            "1682942398500000",
            "9682942398500",
            "168294239850x",
        ] {
            assert_eq!(time(bytes), None, "{bytes}");
        }
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

    /// Among other words, a time has a plus sign and a fraction, or counts from 1970.
    #[test]
    fn a_time_among_words_has_a_sign_and_a_fraction() {
        let plus = Some((1_500_000_000, Clock::Plus));
        assert_eq!((within("+1.5"), within("+1.5,")), (plus, plus));
        assert_eq!(
            (within("+5"), within("1.5"), within("5")),
            (None, None, None)
        );
        let date = Some((1_682_942_398_500_000_000, Clock::Utc));
        assert_eq!(within("1682942398.5:"), date);
        assert_eq!(since_1970("1682942398.", None), None);
        assert_eq!(since_1970("1682942398", Some("AB")), None);
        let seconds = Some(1_682_942_398 * SECOND);
        assert_eq!(since_1970("1682942398", Some("TX")), seconds);
        assert_eq!(since_1970("1682942398", Some("12x")), None);
        assert_eq!(since_1970("1682942398500000000.5", None), None);
    }
}
