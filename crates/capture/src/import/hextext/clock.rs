//! Dates and times of lines: with or without a year, a zone, a fraction, a twelve-hour clock.
//!
//! ```text
//! 2026-11-27 12:11:23.5    2026-11-27T12:11:23+02:00    11/27/2026 12:11:23 PM
//! Fri Nov 27 12:11:23 2026      27-Nov-2026 12:11:23      Nov 27 12:11:23, without a year
//! 12:11:23.000501      12:11:23:501      59:58.02      0.000501      +1.5s      24 ms
//! 1682942398.5, 1682942398500      seconds or milliseconds since 1970
//! ```

mod elapsed;
mod turns;

pub(in crate::import) use elapsed::scaled;
pub(in crate::import) use turns::Turns;

use crate::import::text::{decimal_nanos, moment, number as digits, zone};

/// Origin of a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) enum Clock {
    /// 1970, for a date with a time in the zone of the tool's computer.
    Date,
    /// 1970, for a date with a time whose zone is known.
    Utc,
    /// The beginning of an unknown year, which has a 29 February.
    Year,
    /// Midnight, for a time of day.
    Day,
    /// The full hour or the start of the recording, for minutes and seconds.
    Hour,
    /// The start of the recording.
    Seconds,
    /// The start of the recording or the line before, for a number with a plus sign.
    Plus,
}

const SECOND: u64 = 1_000_000_000;
const HALF: u64 = 12 * 3_600 * SECOND;
const DAY: u64 = 2 * HALF;
const HOUR: u64 = 3_600 * SECOND;
/// Maximum number of words before a time within a line.
const WORDS_MAX: usize = 6;
const MONTHS: [&str; 12] = [
    "jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec",
];
const WEEKDAYS: [&str; 7] = ["mon", "tue", "wed", "thu", "fri", "sat", "sun"];
/// Punctuation behind the words of a date.
const MARKS: [char; 5] = [':', ',', ']', ')', '.'];

/// A time that `text` begins with, and the rest of the text; `word` is its first word, and `behind`
/// the text behind that.
pub(super) fn at_beginning<'a>(
    text: &'a str,
    word: &str,
    behind: &'a str,
) -> Option<((u64, Clock), &'a str)> {
    // A bracket may contain all parts of a date.
    if word.contains([' ', 'T'])
        && let Some((at, "")) = dated(word)
    {
        return Some((at, behind));
    }
    if let Some(found) = dated(text) {
        return Some(found);
    }
    let word = word.trim_end_matches([':', ',']);
    if let Some((half, rest)) = next_word(behind)
        && let Some(is_afternoon) = half_of(half)
        && let Some(nanos) = of_day(word).or_else(|| whole_of_day(word))
    {
        return Some(((turned(nanos, is_afternoon), Clock::Day), rest));
    }
    if let Some(nanos) = of_day(word) {
        return Some(((nanos, Clock::Day), behind));
    }
    if let Some(nanos) = of_hour(word) {
        return Some(((nanos, Clock::Hour), behind));
    }
    elapsed::read(word, behind)
}

/// A time among the first words of a line: with a date, `12:11:23` in brackets or after other
/// words, a number since 1970 or with a plus sign, or the milliseconds of ESP-IDF, `I (357)`.
pub(super) fn within(text: &str) -> Option<(u64, Clock)> {
    let is_divider = |c: char| c.is_whitespace() || "[]".contains(c);
    let words = text.split(is_divider).filter(|word| !word.is_empty());
    let words: Vec<&str> = words.take(WORDS_MAX).collect();
    let start = |word: &str| word.as_ptr() as usize - text.as_ptr() as usize;
    let mut dates = words.iter().filter_map(|word| dated(&text[start(word)..]));
    if let Some((at, _)) = dates.next() {
        return Some(at);
    }
    let of_word = |word: &&str| {
        let word = word.trim_end_matches([':', ',']);
        of_day(word).or_else(|| whole_of_day(word))
    };
    if let Some(nanos) = words.iter().find_map(of_word) {
        return Some((nanos, Clock::Day));
    }
    if let Some(found) = words.iter().find_map(|word| elapsed::within(word)) {
        return Some(found);
    }
    let [level, ticks, ..] = words[..] else {
        return None;
    };
    let ticks = ticks
        .strip_prefix('(')
        .and_then(|ticks| ticks.strip_suffix(')'));
    let millis: u64 = ticks.filter(|_| level.len() == 1)?.parse().ok()?;
    Some((millis.checked_mul(1_000_000)?, Clock::Seconds))
}

/// The first word, which is a bracketed text or ends at a space, and the rest.
pub(super) fn next_word(text: &str) -> Option<(&str, &str)> {
    for (open, close) in [('[', ']'), ('(', ')')] {
        if let Some(inside) = text.strip_prefix(open)
            && let Some((word, behind)) = inside.split_once(close)
        {
            let behind = behind.trim_start_matches([':', ',']);
            return Some((word.trim(), behind.trim_start()));
        }
    }
    let end = text.find([' ', '\t']).unwrap_or(text.len());
    let (word, behind) = text.split_at(end);
    (!word.is_empty()).then(|| (word, behind.trim_start()))
}

/// Whether a word is a time of day without a fraction, also in brackets.
pub(super) fn is_time_of_day(word: &str) -> bool {
    let word = word.trim_matches(|c: char| "[](),:".contains(c));
    word.len() == 8 && whole_of_day(word).is_some()
}

/// A year, if it is known, a month and a day.
type Date = (Option<u64>, u64, u64);

/// A date and a time that `text` begins with, and the rest of the text.
fn dated(text: &str) -> Option<((u64, Clock), &str)> {
    let (first, behind) = cut(text)?;
    if let Some((date, time)) = first.split_once('T')
        && let Some(date) = numeric(date)
    {
        return finished(date, time, behind);
    }
    let (second, behind_second) = cut(behind)?;
    if let Some(date) = numeric(first.trim_end_matches(MARKS)) {
        // Two numbers and a time without a fraction may also be bytes.
        let is_sure = date.0.is_some() || !first.contains('-') || second.contains(['.', ',']);
        return finished(date, second, behind_second).filter(|_| is_sure);
    }
    let (first, behind) = match is_one_of(first, &WEEKDAYS) {
        Some(_) => (second, behind_second),
        None => (first, behind),
    };
    let ((month, day), behind) = match first.split_once('-') {
        // 27-Nov-2026
        Some((day, rest)) => {
            let (month, year) = rest.split_once('-')?;
            let date = (Some(number(year, 4)?), month_of(month)?, number(day, 2)?);
            let (time, behind) = cut(behind)?;
            return finished(date, time, behind);
        }
        None => {
            let (second, behind) = cut(behind)?;
            let pair = match month_of(first) {
                Some(month) => (month, number(second.trim_end_matches(MARKS), 2)?),
                None => (month_of(second)?, number(first.trim_end_matches(MARKS), 2)?),
            };
            (pair, behind)
        }
    };
    let (word, behind) = cut(behind)?;
    if let Some(year) = number(word.trim_end_matches(MARKS), 4) {
        let (time, behind) = cut(behind)?;
        return finished((Some(year), month, day), time, behind);
    }
    // The year may stand behind the time.
    let last =
        cut(behind).and_then(|(year, rest)| Some((number(year.trim_end_matches(MARKS), 4)?, rest)));
    match last.filter(|(year, _)| (1970..=2500).contains(year)) {
        Some((year, rest)) => finished((Some(year), month, day), word, rest),
        None => finished((None, month, day), word, behind),
    }
}

/// The time on a date, with the half of the day and the zone behind it, and the rest of the text.
fn finished<'a>(date: Date, time: &str, behind: &'a str) -> Option<((u64, Clock), &'a str)> {
    let time = time.trim_end_matches([':', ',', ']', ')']);
    let (time, mut east) = without_zone(time);
    let mut nanos = of_day(time).or_else(|| whole_of_day(time))?;
    let mut rest = behind;
    if let Some((half, behind)) = cut(rest)
        && let Some(is_afternoon) = half_of(half)
    {
        (nanos, rest) = (turned(nanos, is_afternoon), behind.trim_start());
    }
    if let Some((word, behind)) = cut(rest).filter(|_| east.is_none())
        && let word = word.trim_end_matches(MARKS)
        && (word.len() >= "+0200".len() || word.starts_with(['U', 'G']))
        && let Some(found) = zone(word)
    {
        (east, rest) = (Some(found), behind);
    }
    let (year, month, day) = date;
    // A leap year has all dates.
    let on = |year: u64| moment(&format!("{year}-{month}-{day}"), "00:00:00", '-');
    let Some(year) = year else {
        let day = on(1972)? - on_first(1972)?;
        return Some(((day * SECOND + nanos, Clock::Year), rest));
    };
    let nanos = on(year)?.checked_mul(SECOND)?.checked_add(nanos)?;
    let Some(east) = east else {
        return Some(((nanos, Clock::Date), rest));
    };
    let nanos = nanos.checked_add_signed(east.checked_neg()?.checked_mul(1_000_000_000)?)?;
    Some(((nanos, Clock::Utc), rest))
}

/// Seconds from 1970 to the first of January.
fn on_first(year: u64) -> Option<u64> {
    moment(&format!("{year}-1-1"), "00:00:00", '-')
}

/// The first word, and the rest.
fn cut(text: &str) -> Option<(&str, &str)> {
    let text = text.trim_start();
    let end = text.find([' ', '\t']).unwrap_or(text.len());
    let (word, rest) = text.split_at(end);
    (!word.is_empty()).then(|| (word, rest.trim_start()))
}

/// A number of at most `most` digits, and of two at least if it may have more.
fn number(text: &str, most: usize) -> Option<u64> {
    let is_number = text.bytes().all(|byte| byte.is_ascii_digit());
    let fits = if most > 2 {
        text.len() == most
    } else {
        text.len() <= most
    };
    text.parse().ok().filter(|_| is_number && fits)
}

/// The index of a word in `names`, which may be longer.
fn is_one_of(word: &str, names: &[&str]) -> Option<usize> {
    let word = word.trim_end_matches(MARKS);
    let is_word = word.len() >= 3 && word.bytes().all(|byte| byte.is_ascii_alphabetic());
    let begin = word.get(..3)?.to_ascii_lowercase();
    let found = names.iter().position(|name| *name == begin);
    found.filter(|_| is_word && word.len() <= "wednesday".len())
}

/// The number of a month from its name.
fn month_of(word: &str) -> Option<u64> {
    is_one_of(word, &MONTHS).map(|index| index as u64 + 1)
}

/// A date of numbers: 2026-11-27, 2026/11/27, 27.11.2026, 27/11/2026 or 11/27/2026; 11-27, 27.11
/// or 27/11 without a year.
fn numeric(date: &str) -> Option<Date> {
    let parts = date
        .split(['-', '.', '/'])
        .map(|part| number(part, part.len().max(2)));
    let parts: Option<Vec<u64>> = parts.collect();
    let year = date.as_bytes().get(..4).filter(|_| date.len() > 4);
    let has_year_first = year.is_some_and(|year| year.iter().all(u8::is_ascii_digit));
    let (year, pair) = match parts?[..] {
        [year, month, day] if has_year_first => return Some((Some(year), month, day)),
        [first, second, year] if year >= 1970 => (Some(year), [first, second]),
        [first, second] => (None, [first, second]),
        _ => return None,
    };
    // The day comes first, unless the second number cannot be a month; behind the style of ISO
    // 8601, with dashes, the month does.
    let [first, second] = pair;
    let is_month_first = second > 12 || (year.is_none() && date.contains('-') && first <= 12);
    let (month, day) = if is_month_first {
        (first, second)
    } else {
        (second, first)
    };
    ((1..=12).contains(&month) && (1..=31).contains(&day)).then_some((year, month, day))
}

/// Whether a word is the second half of a twelve-hour clock, or the first.
fn half_of(word: &str) -> Option<bool> {
    match word.trim_end_matches(MARKS).to_ascii_uppercase().as_str() {
        "AM" => Some(false),
        "PM" => Some(true),
        _ => None,
    }
}

/// A time of a twelve-hour clock.
const fn turned(nanos: u64, is_afternoon: bool) -> u64 {
    nanos % HALF + if is_afternoon { HALF } else { 0 }
}

/// `12:11:23`, without a fraction.
fn whole_of_day(word: &str) -> Option<u64> {
    Some(moment("1970-01-01", word, '-')? * SECOND)
}

/// `12:11:23.000501`, `12:11:23:501` or `12:11:23.000,501`; the fraction is required, because three
/// pairs may also be bytes.
fn of_day(word: &str) -> Option<u64> {
    let (word, _) = without_zone(word);
    let colons = word.matches(':').count();
    let (time, fraction) = match word.rsplit_once(':') {
        Some((time, fraction)) if colons == 3 && fraction.len() == 3 => (time, fraction),
        _ => word.split_once(['.', ','])?,
    };
    let fraction = fraction.replacen(',', "", 1);
    let seconds = moment("1970-01-01", time, '-')?;
    let is_number = !fraction.is_empty() && fraction.bytes().all(|byte| byte.is_ascii_digit());
    let fraction = decimal_nanos(&format!("0.{fraction}")).filter(|_| is_number)?;
    Some(seconds * SECOND + fraction)
}

/// `59:58.02`, minutes and seconds; the fraction is required, as in [`of_day`].
fn of_hour(word: &str) -> Option<u64> {
    let (minutes, rest) = word.split_once(':')?;
    let (seconds, fraction) = rest.split_once(['.', ','])?;
    let minutes = digits(minutes).filter(|_| minutes.len() <= 4)?;
    let seconds = number(seconds, 2).filter(|&seconds| seconds <= 60)?;
    let fraction = digits(fraction).and(decimal_nanos(&format!("0.{fraction}")))?;
    Some((minutes * 60 + seconds) * SECOND + fraction)
}

/// A time without its zone, and the zone's seconds east of Greenwich: `Z`, `+01:00`, `-0500` or
/// `+01`.
fn without_zone(time: &str) -> (&str, Option<i64>) {
    let at = time.find(['+', '-', 'Z']).unwrap_or(time.len());
    match zone(&time[at..]) {
        Some(east) => (&time[..at], Some(east)),
        None => (time, None),
    }
}

/// Puts the times of a file of an unknown year in order: without a 29 February, the later dates are
/// a day earlier, and the next year follows December.
pub(super) struct Years {
    leap_day: u64,
    before: u64,
    last: u64,
}

impl Years {
    /// The years of these times.
    pub(super) fn of(times: impl Iterator<Item = u64>) -> Self {
        const LEAP_DAY: u64 = 31 + 28;
        let mut times = times;
        Self {
            leap_day: match times.any(|at| at / DAY == LEAP_DAY) {
                true => u64::MAX,
                false => LEAP_DAY,
            },
            before: 0,
            last: 0,
        }
    }

    /// Nanoseconds from the beginning of the first year.
    pub(super) fn nanos(&mut self, at: u64) -> u64 {
        let is_later = at / DAY > self.leap_day;
        let at = at - if is_later { DAY } else { 0 };
        let days = if self.leap_day == u64::MAX { 366 } else { 365 };
        if at + self.before + days / 2 * DAY < self.last {
            self.before += days * DAY;
        }
        self.last = at + self.before;
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn time(text: &str) -> Option<(u64, Clock)> {
        let (word, behind) = next_word(text)?;
        let ((nanos, clock), _) = at_beginning(text, word, behind)?;
        Some((nanos / 1_000_000, clock))
    }

    /// 1,795,781,483 s by `date -u -d '2026-11-27 12:11:23' +%s`; two hours are 7,200 s.
    #[test]
    fn a_date_may_have_words_and_a_zone() {
        const AT: u64 = 1_795_781_483_000;
        for text in [
            "2026-11-27 12:11:23 x",
            "2026/11/27 12:11:23: x",
            "27.11.2026 12:11:23 x",
            "11/27/2026 12:11:23 PM x",
            "[27/11/2026 12:11:23] x",
            "Fri Nov 27 12:11:23 2026 x",
            "[Fri Nov 27 12:11:23 2026] x",
            "Nov 27, 2026 12:11:23 PM x",
            "27 Nov 2026 12:11:23 x",
            "Friday, 27 November 2026 12:11:23 x",
            "27-Nov-2026 12:11:23 x",
        ] {
            assert_eq!(time(text), Some((AT, Clock::Date)), "{text}");
        }
        for (text, hours) in [
            ("2026-11-27T12:11:23Z x", 0),
            ("2026-11-27T12:11:23.000+02:00 x", 2),
            ("2026-11-27 12:11:23+0200 x", 2),
            ("2026-11-27 12:11:23 +0200 x", 2),
            ("[2026-11-27 12:11:23.0 +02:00] x", 2),
            ("2026-11-27 12:11:23-05 x", -5),
            ("27-Nov-2026 12:11:23 UTC x", 0),
        ] {
            let expected = AT.saturating_add_signed(-3_600_000 * hours);
            assert_eq!(time(text), Some((expected, Clock::Utc)), "{text}");
        }
        assert_eq!(
            within("main: [2026-11-27 12:11:23] tx"),
            Some((AT * 1_000_000, Clock::Date))
        );
    }

    /// 27 November is day 331 of a leap year, from 0 on.
    #[test]
    fn a_date_may_lack_its_year() {
        const AT: u64 = (331 * 24 + 12) * 3_600_000 + (11 * 60 + 23) * 1_000;
        for text in [
            "Nov 27 12:11:23 pi x",
            "27 Nov 12:11:23.000 x",
            "11-27 12:11:23.000 x",
            "27.11. 12:11:23 x",
            "27/11 12:11:23 x",
            "11/27 12:11:23 x",
        ] {
            assert_eq!(time(text), Some((AT, Clock::Year)), "{text}");
        }
        // Five bytes with two kinds of dividers.
        assert_eq!(time("11-27 12:11:23 AB"), None);
    }

    /// 28 February and 1 March are one day apart in most years; a year has 365 days.
    #[test]
    fn days_of_an_unknown_year_are_in_order() {
        let apart = |texts: &[&str]| {
            let at = |text: &&str| time(text).expect("a date").0 * 1_000_000;
            let times: Vec<u64> = texts.iter().map(at).collect();
            let mut years = Years::of(times.iter().copied());
            let times: Vec<u64> = times.into_iter().map(|at| years.nanos(at)).collect();
            times
                .windows(2)
                .map(|pair| (pair[1] - pair[0]) / DAY)
                .collect::<Vec<_>>()
        };
        let [feb, leap, mar] = ["Feb 28 01:00:00 x", "Feb 29 01:00:00 x", "Mar 1 01:00:00 x"];
        assert_eq!(apart(&[feb, mar]), [1]);
        assert_eq!(apart(&[feb, leap, mar]), [1, 1]);
        assert_eq!(
            apart(&["Dec 31 01:00:00 x", "Jan 1 01:00:00 x", feb]),
            [1, 58]
        );
    }
    #[test]
    fn numbers_and_names_of_dates() {
        let found = [("12", 2), ("1", 2), ("2026", 4)].map(|(text, most)| number(text, most));
        assert_eq!(found, [Some(12), Some(1), Some(2_026)]);
        let wrong = [("123", 2), ("26", 4), ("20266", 4), ("1a", 2), ("", 2)];
        assert_eq!(wrong.map(|(text, most)| number(text, most)), [None; 5]);
        let days = ["Monday,", "sun", "Wednesday"].map(|word| is_one_of(word, &WEEKDAYS));
        assert_eq!(days, [Some(0), Some(6), Some(2)]);
        let none = ["mo", "wednesdays", "sun1", "abc"].map(|word| is_one_of(word, &WEEKDAYS));
        assert_eq!(none, [None; 4]);
        assert_eq!(
            (month_of("Nov."), month_of("january"), month_of("x")),
            (Some(11), Some(1), None)
        );
    }

    /// The day comes before the month, unless only the other order is a date, or with dashes and
    /// without a year.
    #[test]
    fn dates_of_numbers_by_hand() {
        for (text, date) in [
            ("2026-11-27", (Some(2_026), 11, 27)),
            ("2026/11/27", (Some(2_026), 11, 27)),
            ("27.11.2026", (Some(2_026), 11, 27)),
            ("11/27/2026", (Some(2_026), 11, 27)),
            ("05/06/2026", (Some(2_026), 6, 5)),
            ("11-27", (None, 11, 27)),
            ("27.11", (None, 11, 27)),
            ("05-06", (None, 5, 6)),
            ("5/6", (None, 6, 5)),
            ("12-12", (None, 12, 12)),
            ("31.1", (None, 1, 31)),
        ] {
            assert_eq!(numeric(text), Some(date), "{text}");
        }
        for text in [
            "27/13", "1-2-3", "0-5", "32.1", "1.0", "2026", "a-b", "1-2-3-4",
        ] {
            assert_eq!(numeric(text), None, "{text}");
        }
    }

    /// 12:11:23 is 43,883 s after midnight.
    #[test]
    fn times_of_day_and_hour_need_a_fraction() {
        let at = |micros: u64| Some(43_883 * SECOND + micros * 1_000);
        assert_eq!(of_day("12:11:23.000501"), at(501));
        assert_eq!(of_day("12:11:23:501"), at(501_000));
        assert_eq!(
            (of_day("12:11:23.000,501"), of_day("12:11:23.5Z")),
            (at(501), at(500_000))
        );
        for word in [
            "12:11:23",
            "12:11:23.",
            "12:11:23:50",
            "12:11:23.x",
            "12:11.5",
        ] {
            assert_eq!(of_day(word), None, "{word}");
        }
        assert_eq!(of_hour("59:58.02"), Some(3_598 * SECOND + SECOND / 50));
        assert_eq!(of_hour("1234:05,5"), Some(74_045 * SECOND + SECOND / 2));
        assert_eq!(of_hour("59:60.0"), Some(3_600 * SECOND));
        for word in ["12345:05.5", "59:61.0", "59:058.0", "59:58", "59:58.x"] {
            assert_eq!(of_hour(word), None, "{word}");
        }
    }

    #[test]
    fn a_twelve_hour_clock_has_two_halves() {
        let of = |hour: u64, is_afternoon| {
            turned(hour * 3_600 * SECOND, is_afternoon) / (3_600 * SECOND)
        };
        assert_eq!(
            [of(12, false), of(1, false), of(12, true), of(1, true)],
            [0, 1, 12, 13]
        );
        assert_eq!(
            (half_of("pm,"), half_of("AM"), half_of("x")),
            (Some(true), Some(false), None)
        );
    }

    #[test]
    fn a_time_is_found_among_the_first_words() {
        assert_eq!(
            within("I (357) wifi: x"),
            Some((357_000_000, Clock::Seconds))
        );
        assert_eq!((within("II (357) x"), within("I 357 x")), (None, None));
        let noon = Some((43_883 * SECOND, Clock::Day));
        assert_eq!(within("a b c d e 12:11:23, x"), noon);
        assert_eq!(
            (within("a b c d e f 12:11:23"), within("[12:11:23] x")),
            (None, noon)
        );
        let dated = Some((1_795_781_483 * SECOND, Clock::Date));
        assert_eq!(within("log 2026-11-27 12:11:23 x"), dated);
        assert_eq!(within("x Nov 27 12:11:23 2026 y"), dated);
        assert_eq!(
            within("x Nov 27 12:11:23 y"),
            Some((28_642_283 * SECOND, Clock::Year))
        );
        assert!(is_time_of_day("[12:11:23],") && !is_time_of_day("1:11:23"));
    }

    #[test]
    fn a_bracketed_text_is_one_word() {
        assert_eq!(next_word("[a b]: c d"), Some(("a b", "c d")));
        assert_eq!(next_word("(1), x"), Some(("1", "x")));
        assert_eq!(
            (next_word("a\tb c"), next_word("[a b")),
            (Some(("a", "b c")), Some(("[a", "b")))
        );
        assert_eq!(next_word(""), None);
    }

    /// Twelve may be a month, so the day comes first.
    #[test]
    fn a_second_number_of_twelve_is_a_month() {
        assert_eq!(numeric("5/12"), Some((None, 12, 5)));
        assert_eq!(numeric("5/12/2026"), Some((Some(2_026), 12, 5)));
        assert_eq!(numeric("5/13/2026"), Some((Some(2_026), 5, 13)));
        assert_eq!(numeric("12-13"), Some((None, 12, 13)));
        assert_eq!(numeric("13-12"), Some((None, 12, 13)));
        assert_eq!(numeric("1/1/1969"), None);
    }

    /// Without a 29 February, day 200 of a leap year is the day 199 of the file. A date that is 182
    /// days or less before the last one is of the same year.
    #[test]
    fn a_date_far_before_the_last_one_is_of_the_next_year() {
        let days = |second: u64| {
            let times = [200 * DAY, second * DAY];
            let mut years = Years::of(times.into_iter());
            times.map(|at| years.nanos(at) / DAY)
        };
        assert_eq!(days(17), [199, 17]);
        assert_eq!(days(16), [199, 365 + 16]);
        // With one, a year has 366 days; half of it are 183.
        let mut years = Years::of([59 * DAY].into_iter());
        let found = [200, 17, 16].map(|day| years.nanos(day * DAY) / DAY);
        assert_eq!(found, [200, 17, 16]);
        let mut years = Years::of([59 * DAY].into_iter());
        let found = [200, 16].map(|day| years.nanos(day * DAY) / DAY);
        assert_eq!(found, [200, 366 + 16]);
    }
}
