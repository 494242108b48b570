//! Lines with their positions, and the numbers in them.

use super::ImportError;

/// A line without its line end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line<'a> {
    pub(super) number: usize,
    pub(super) offset: usize,
    pub(super) text: &'a [u8],
}

impl Line<'_> {
    pub(super) fn wrong(&self, message: impl Into<String>) -> ImportError {
        ImportError {
            line: self.number,
            offset: self.offset,
            message: message.into(),
        }
    }
}

/// Lines that end with LF or CR LF; with CR if the bytes contain no LF.
pub(super) fn lines(bytes: &[u8]) -> impl Iterator<Item = Line<'_>> {
    let mut offset = 0;
    let end = line_end(bytes);
    bytes
        .split_inclusive(move |&byte| byte == end)
        .zip(1..)
        .map(move |(whole, number)| {
            let text = whole.strip_suffix(b"\n").unwrap_or(whole);
            let text = text.strip_suffix(b"\r").unwrap_or(text);
            let line = Line {
                number,
                offset,
                text,
            };
            offset += whole.len();
            line
        })
}

/// The last byte of each line: LF, or CR if the bytes contain no LF.
pub(super) fn line_end(bytes: &[u8]) -> u8 {
    if bytes.contains(&b'\n') { b'\n' } else { b'\r' }
}

/// Text of a line; a line that is not UTF-8 becomes empty and fits no format.
pub(super) fn utf8(text: &[u8]) -> &str {
    core::str::from_utf8(text).unwrap_or_default()
}

/// Parses digits only, unlike `parse`, which also accepts a sign; no dump has signs.
pub(super) fn number(text: &str) -> Option<u64> {
    let is_digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|_| is_digits)
}

/// `12:34:56` as seconds of the day.
fn seconds(text: &str) -> Option<u64> {
    let mut parts = text.splitn(3, ':').map(number);
    let [hour, minute, second] = [parts.next()??, parts.next()??, parts.next()??];
    let fits = hour < 24 && minute < 60 && second <= 60;
    fits.then_some(hour * 3600 + minute * 60 + second)
}

/// Days from 1970-01-01 to a date of the Gregorian calendar, whose parts are separated by `mark`.
fn days(text: &str, mark: char) -> Option<u64> {
    let mut parts = text.splitn(3, mark).map(number);
    let [year, month, day] = [parts.next()??, parts.next()??, parts.next()??];
    if !(1970..=2500).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // The year begins in March, so that the leap day is its last day.
    let year = if month <= 2 { year - 1 } else { year };
    let month = (month + 9) % 12;
    let day_of_year = (153 * month + 2) / 5 + day - 1;
    // 719,468 days from 0000-03-01 to 1970-01-01.
    Some(year * 365 + year / 4 - year / 100 + year / 400 + day_of_year - 719_468)
}

/// Seconds since 1970 for a date and a time of day.
pub(super) fn moment(date: &str, time: &str, mark: char) -> Option<u64> {
    Some(days(date, mark)? * 86_400 + seconds(time)?)
}

/// Seconds east of Greenwich of a zone: `Z`, `UTC`, `GMT`, `+02:00`, `-0530` or `+02`.
pub(super) fn zone(text: &str) -> Option<i64> {
    if matches!(text, "Z" | "UTC" | "GMT") {
        return Some(0);
    }
    let sign = match text.as_bytes().first()? {
        b'+' => 1,
        b'-' => -1,
        _ => return None,
    };
    let digits = match text[1..].split_once(':') {
        Some((hours, minutes)) if hours.len() == 2 => format!("{hours}{minutes}"),
        Some(_) => return None,
        None => text[1..].to_owned(),
    };
    let (hours, minutes) = match digits.len() {
        2 => (number(&digits)?, 0),
        4 if digits.is_ascii() => (number(&digits[..2])?, number(&digits[2..])?),
        _ => return None,
    };
    let fits = hours <= 14 && minutes < 60;
    let seconds = i64::try_from(hours * 3_600 + minutes * 60).ok();
    seconds.map(|seconds| sign * seconds).filter(|_| fits)
}

/// The note about times such as `0,001`.
pub(super) const DECIMAL_COMMA: &str = "the comma in the times is taken as the decimal mark";

/// Parses seconds with a fraction of up to nine digits as nanoseconds; also `8.6e-05`. The decimal
/// mark may be a comma.
pub(super) fn decimal_nanos(text: &str) -> Option<u64> {
    if text.matches(',').count() == 1 && !text.contains('.') {
        return decimal_nanos(&text.replace(',', "."));
    }
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    if let Some(whole) = number(whole)
        && fraction.bytes().all(|byte| byte.is_ascii_digit())
    {
        let digits: String = fraction
            .chars()
            .chain("000000000".chars())
            .take(9)
            .collect();
        return whole
            .checked_mul(1_000_000_000)?
            .checked_add(number(&digits)?);
    }
    let plain = |byte: u8| byte.is_ascii_digit() || b".eE+-".contains(&byte);
    let seconds: f64 = text.parse().ok().filter(|_| text.bytes().all(plain))?;
    let nanos = (seconds * 1e9).round();
    #[expect(clippy::cast_possible_truncation, reason = "within the range, rounded")]
    let nanos = (0.0..1e18).contains(&nanos).then_some(nanos as i64)?;
    u64::try_from(nanos).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `date -u -d ... +%s`.
    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(moment("2026/11/21", "07:58:48", '/'), Some(1_795_247_928));
        assert_eq!(moment("2024-02-29", "00:00:00", '-'), Some(1_709_164_800));
        assert_eq!(moment("1970-01-01", "00:00:01", '-'), Some(1));
        assert_eq!(moment("2026/13/21", "07:58:48", '/'), None);
        assert_eq!(moment("2026/11/21", "24:00:00", '/'), None);
    }

    #[test]
    fn seconds_may_have_a_fraction_or_an_exponent() {
        assert_eq!(decimal_nanos("0.000105"), Some(105_000));
        assert_eq!(decimal_nanos("12"), Some(12_000_000_000));
        assert_eq!(decimal_nanos("8.6e-05"), Some(86_000));
        assert_eq!(decimal_nanos("0,000105"), Some(105_000));
        assert_eq!(decimal_nanos("8,6e-05"), Some(86_000));
        assert_eq!(decimal_nanos("1,234,567"), None);
        assert_eq!(decimal_nanos("1.234,5"), None);
        assert_eq!(decimal_nanos("-1"), None);
        assert_eq!(decimal_nanos("inf"), None);
        assert_eq!(decimal_nanos(""), None);
    }

    #[test]
    fn a_line_knows_its_place() {
        let places: Vec<_> = lines(b"a\r\n\nbc")
            .map(|l| (l.number, l.offset, l.text))
            .collect();
        assert_eq!(places, [(1, 0, &b"a"[..]), (2, 3, b""), (3, 4, b"bc")]);
    }

    #[test]
    fn a_line_may_end_with_cr_alone() {
        let texts = |bytes| lines(bytes).map(|l| (l.number, l.offset, l.text)).collect();
        let expected: Vec<_> = vec![(1, 0, &b"a"[..]), (2, 2, b"b")];
        let found: Vec<_> = texts(b"a\rb\r");
        assert_eq!(found, expected);
        // With an LF in the file, a CR within a line is a character.
        let found: Vec<_> = texts(b"a\rb\n");
        assert_eq!(found, [(1, 0, &b"a\rb"[..])]);
    }

    #[test]
    fn a_zone_is_hours_and_minutes() {
        for (text, seconds) in [
            ("Z", Some(0)),
            ("UTC", Some(0)),
            ("+02:00", Some(7_200)),
            ("-0530", Some(-19_800)),
            ("+14", Some(50_400)),
            ("+15", None),
            ("+0260", None),
            ("+2:00", None),
            ("+1:0000", None),
            ("0200", None),
            ("+\u{e9}\u{e9}", None),
            ("", None),
        ] {
            assert_eq!(zone(text), seconds, "{text}");
        }
    }

    /// `date -u -d ... +%s`: the ends of months and years, leap years of all kinds.
    #[test]
    fn each_day_follows_the_one_before() {
        let seconds = |date| moment(date, "00:00:00", '-');
        assert_eq!(seconds("1970-12-31"), Some(31_449_600));
        assert_eq!(seconds("1971-01-01"), Some(31_536_000));
        assert_eq!(seconds("2000-02-28"), Some(951_696_000));
        assert_eq!(seconds("2000-03-01"), Some(951_868_800));
        assert_eq!(seconds("2100-02-28"), Some(4_107_456_000));
        assert_eq!(seconds("2100-03-01"), Some(4_107_542_400));
        assert_eq!(seconds("2400-12-31"), Some(13_601_001_600));
        assert_eq!(seconds("2500-12-31"), Some(16_756_675_200));
    }

    #[test]
    fn what_is_in_no_calendar_or_on_no_clock_is_none() {
        let is = |date, time| moment(date, time, '/').is_some();
        for date in ["1970/01/01", "2500/12/31", "2026/01/31"] {
            assert!(is(date, "23:59:60") && is(date, "00:00:00"), "{date}");
        }
        let dates = [
            "1969/12/31",
            "2501/01/01",
            "2026/00/01",
            "2026/01/00",
            "2026/01/32",
        ];
        let more = ["2026-01-01", "2026/01", "2026/01/01/01", "2026/+1/01", "//"];
        for date in dates.into_iter().chain(more) {
            assert!(!is(date, "00:00:00"), "{date}");
        }
        for time in [
            "00:60:00", "00:00:61", "24:00:00", "00:00", "0:0:0:0", "-1:00:00", "",
        ] {
            assert!(!is("2026/01/01", time), "{time}");
        }
        assert_eq!(moment("1970/01/02", "01:02:03", '/'), Some(86_400 + 3_723));
    }

    #[test]
    fn a_number_has_digits_only() {
        assert_eq!(
            ["0", "007", "18446744073709551615"].map(number),
            [Some(0), Some(7), Some(u64::MAX)]
        );
        assert_eq!(
            ["", "+1", "-1", "1 ", "0x1", "18446744073709551616"].map(number),
            [None; 6]
        );
    }

    /// Nine digits count; a tenth is cut, not rounded. 1e9 s and more with an exponent are no time.
    #[test]
    fn seconds_are_told_to_the_nanosecond_and_within_reason() {
        assert_eq!(decimal_nanos("1.5"), Some(1_500_000_000));
        assert_eq!(decimal_nanos("0.1234567899"), Some(123_456_789));
        assert_eq!(decimal_nanos("18446744073.709551615"), Some(u64::MAX));
        assert_eq!(decimal_nanos("18446744073.709551616"), None);
        assert_eq!(decimal_nanos("99999999999"), None);
        assert_eq!(decimal_nanos("1.2.3"), None);
        assert_eq!(decimal_nanos("1.5E+1"), Some(15_000_000_000));
        assert_eq!(decimal_nanos("1e9"), None);
        assert_eq!(decimal_nanos("-1e-3"), None);
        assert_eq!(decimal_nanos("nan"), None);
    }

    #[test]
    fn what_is_wrong_names_its_line_and_place() {
        let line = lines(b"a\nbc\n").nth(1).expect("two lines");
        let wrong = line.wrong("no");
        assert_eq!((wrong.line, wrong.offset, &*wrong.message), (2, 2, "no"));
        assert_eq!((utf8(b"ab"), utf8(b"\xFF")), ("ab", ""));
    }
    /// 2000 was a leap year by the rule of 400 years; 2100 is none. `date -u -d ... +%s`.
    #[test]
    fn days_are_counted_over_leap_years() {
        for (date, seconds) in [
            ("1970-01-01", Some(0)),
            ("1970-12-31", Some(31_449_600)),
            ("2000-02-29", Some(951_782_400)),
            ("2000-03-01", Some(951_868_800)),
            ("2100-03-01", Some(4_107_542_400)),
            ("2500-12-31", Some(16_756_675_200)),
            ("1969-12-31", None),
            ("2501-01-01", None),
            ("2026-00-01", None),
            ("2026-01-00", None),
            ("2026-01-32", None),
            ("2026-01", None),
        ] {
            assert_eq!(moment(date, "00:00:00", '-'), seconds, "{date}");
        }
    }

    #[test]
    fn a_time_of_day_has_three_parts_within_their_limits() {
        let of = [
            "23:59:60", "01:02:03", "00:60:00", "00:00:61", "24:00:00", "1:2", "+1:00:00",
        ];
        let found = of.map(seconds);
        assert_eq!(
            found,
            [Some(86_400), Some(3_723), None, None, None, None, None]
        );
        assert_eq!(
            (number("012"), number(""), number("-1"), number("1a")),
            (Some(12), None, None, None)
        );
        assert_eq!((line_end(b"a\r\nb"), line_end(b"a\rb")), (b'\n', b'\r'));
        assert_eq!((utf8(b"a"), utf8(b"\xFF")), ("a", ""));
        // A fraction of more than nine digits is cut; too large a number is none.
        assert_eq!(decimal_nanos("1.1234567899"), Some(1_123_456_789));
        assert_eq!(decimal_nanos("99999999999"), None);
        assert_eq!(decimal_nanos("1e9"), None);
    }

    /// Four bytes that are no digits of ASCII, cut within a character.
    #[test]
    fn a_zone_has_digits_of_ascii() {
        assert_eq!((zone("+1\u{e9}2"), zone("-01:30")), (None, Some(-5_400)));
        assert_eq!((zone("+0060"), zone("+0059")), (None, Some(3_540)));
        assert_eq!(
            (zone("+1400"), zone("+1500"), zone("x0200")),
            (Some(50_400), None, None)
        );
    }
}
