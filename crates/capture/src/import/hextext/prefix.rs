//! Time and direction before the bytes of a line.

use crate::import::text::{decimal_nanos, moment};

/// Origin of a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) enum Clock {
    /// 1970, for a date with a time.
    Date,
    /// Midnight, for a time of day.
    Day,
    /// The start of the recording.
    Seconds,
}

/// Text before the bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::import) struct Prefix {
    pub(in crate::import) at: Option<(u64, Clock)>,
    /// Whether the host sent the bytes; `None` if the line has no direction.
    pub(in crate::import) is_sent: Option<bool>,
    /// Whether the direction is only an arrow to the right after the time, which the Arduino IDE
    /// and PlatformIO write before received text.
    pub(in crate::import) is_arrow: bool,
    /// Number of bytes that the line states behind its direction.
    pub(in crate::import) told: Option<usize>,
}

/// Words for bytes that the host sent.
const SENT: [&str; 13] = [
    "tx", "send", "sent", "sending", "out", "write", "wrote", "written", "host", "->", "-->", ">",
    ">>",
];
/// Words for bytes that the host received.
const RECEIVED: [&str; 13] = [
    "rx",
    "recv",
    "received",
    "receiving",
    "rcv",
    "in",
    "read",
    "device",
    "<-",
    "<--",
    "<",
    "<<",
    "receive",
];

/// The prefix of a line, and the rest.
pub(in crate::import) fn split(text: &str) -> (Prefix, &str) {
    let (mut prefix, mut rest) = (Prefix::default(), text.trim_start());
    loop {
        let Some((word, behind)) = next_word(rest) else {
            return (prefix, rest);
        };
        if let Some((at, behind)) = time(word, behind).filter(|_| prefix.at.is_none()) {
            (prefix.at, rest) = (Some(at), behind);
        } else if let Some(is_sent) = direction(word).filter(|_| prefix.is_sent.is_none()) {
            prefix.is_arrow = prefix.at.is_some() && matches!(word, "->" | ">");
            (prefix.is_sent, rest) = (Some(is_sent), behind);
        } else if prefix != Prefix::default() && matches!(word, "-" | "|" | ":" | ",") {
            rest = behind;
        } else if let Some((told, behind)) = stated(rest).filter(|_| prefix.is_sent.is_some()) {
            (prefix.told, rest) = (Some(told), behind);
        } else {
            return (prefix, rest);
        }
    }
}

/// The number of bytes that a text begins with, and the rest: `(10):`, `[10]:`, `10:` or `len=10`;
/// without the colon only if so many numbers follow.
fn stated(text: &str) -> Option<(usize, &str)> {
    let lower = text.get(..8).unwrap_or(text).to_ascii_lowercase();
    let name = ["length=", "len=", "n=", "size="];
    if let Some(name) = name.iter().find(|name| lower.starts_with(**name)) {
        let (count, behind) = digits(&text[name.len()..])?;
        return Some((count, behind.trim_start_matches([':', ',']).trim_start()));
    }
    let (count, behind) = match text.chars().next()? {
        '(' => bracketed(&text[1..], ')')?,
        '[' => bracketed(&text[1..], ']')?,
        _ => {
            let (count, behind) = digits(text)?;
            behind.starts_with(": ").then_some((count, behind))?
        }
    };
    let is_marked = behind.starts_with(':');
    let behind = behind.trim_start_matches(':').trim_start();
    let is_count = behind.split_whitespace().count() == count;
    (is_marked || is_count).then_some((count, behind))
}

fn bracketed(text: &str, close: char) -> Option<(usize, &str)> {
    let (count, behind) = digits(text)?;
    Some((count, behind.strip_prefix(close)?))
}

/// A decimal number at the beginning, and the rest.
fn digits(text: &str) -> Option<(usize, &str)> {
    let end = text
        .find(|c: char| !c.is_ascii_digit())
        .unwrap_or(text.len());
    Some((text[..end].parse().ok()?, &text[end..]))
}

/// The first word, which is a bracketed text or ends at a space, and the rest.
fn next_word(text: &str) -> Option<(&str, &str)> {
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

fn direction(word: &str) -> Option<bool> {
    let word = word.trim_end_matches([':', ',']).to_ascii_lowercase();
    let is_in = |words: &[&str]| words.contains(&word.as_str());
    match (is_in(&SENT), is_in(&RECEIVED)) {
        (true, _) => Some(true),
        (_, true) => Some(false),
        _ => None,
    }
}

/// A time that begins with `word`, and the rest of the text.
fn time<'a>(word: &str, behind: &'a str) -> Option<((u64, Clock), &'a str)> {
    let word = word.trim_end_matches([':', ',']);
    // A bracket may contain both parts of a date.
    if let Some((date, time)) = word.split_once([' ', 'T']) {
        let (time, half) = match time.split_once(' ') {
            Some((time, half @ ("AM" | "PM"))) => (time, half),
            _ => (time, ""),
        };
        if let Some(nanos) = date_and_time(date, time) {
            return Some(((half_of_date(nanos, half), Clock::Date), behind));
        }
    }
    if let Some((time, rest)) = next_word(behind)
        && let Some(nanos) = date_and_time(word, time.trim_end_matches([':', ',']))
    {
        return Some(match next_word(rest) {
            Some((half, rest)) if matches!(half.trim_end_matches(','), "AM" | "PM") => {
                let half = half.trim_end_matches(',');
                ((half_of_date(nanos, half), Clock::Date), rest)
            }
            _ => ((nanos, Clock::Date), rest),
        });
    }
    if let Some((time, rest)) = next_word(behind)
        && matches!(time, "AM" | "PM")
        && let Some(nanos) = of_day(word).or_else(|| whole_of_day(word))
    {
        return Some(((half_of_day(nanos, time), Clock::Day), rest));
    }
    if let Some(nanos) = of_day(word) {
        return Some(((nanos, Clock::Day), behind));
    }
    let (digits, unit) = match word.strip_suffix("ms") {
        Some(digits) => (digits, 1_000),
        None => (word.strip_suffix('s').unwrap_or(word), 1),
    };
    let digits = digits.strip_prefix('+').unwrap_or(digits);
    let (whole, fraction) = digits.split_once('.')?;
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if !is_number(whole) || !is_number(fraction) {
        return None;
    }
    Some(((decimal_nanos(digits)? / unit, Clock::Seconds), behind))
}

/// Whether a word is a time of day without a fraction, also in brackets.
pub(super) fn is_time_of_day(word: &str) -> bool {
    let word = word.trim_matches(|c: char| "[](),:".contains(c));
    word.len() == 8 && whole_of_day(word).is_some()
}

/// `12:11:23`, without a fraction.
fn whole_of_day(word: &str) -> Option<u64> {
    Some(moment("1970-01-01", word, '-')? * 1_000_000_000)
}

/// A time among the first words of a line: `12:11:23` in brackets or after other words, or the
/// milliseconds of ESP-IDF, `I (357)`.
pub(super) fn within(text: &str) -> Option<(u64, Clock)> {
    let is_divider = |c: char| c.is_whitespace() || "[]".contains(c);
    let words = text.split(is_divider).filter(|word| !word.is_empty());
    let words: Vec<&str> = words.take(6).collect();
    let of_word = |word: &&str| {
        let word = word.trim_end_matches([':', ',']);
        of_day(word).or_else(|| whole_of_day(word))
    };
    if let Some(nanos) = words.iter().find_map(of_word) {
        return Some((nanos, Clock::Day));
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

/// Converts a time of a twelve-hour clock.
fn half_of_day(nanos: u64, half: &str) -> u64 {
    const HALF: u64 = 12 * 3_600 * 1_000_000_000;
    match half {
        "PM" => nanos % HALF + HALF,
        _ => nanos % HALF,
    }
}

/// Converts a date with a time of a twelve-hour clock, if `half` is one of its halves.
fn half_of_date(nanos: u64, half: &str) -> u64 {
    const DAY: u64 = 24 * 3_600 * 1_000_000_000;
    match half {
        "" => nanos,
        _ => nanos - nanos % DAY + half_of_day(nanos % DAY, half),
    }
}

/// `12:11:23.000501`, `12:11:23:501` or `12:11:23.000,501`; the fraction is required, because three
/// pairs may also be bytes.
fn of_day(word: &str) -> Option<u64> {
    let colons = word.matches(':').count();
    let (time, fraction) = match word.rsplit_once(':') {
        Some((time, fraction)) if colons == 3 && fraction.len() == 3 => (time, fraction),
        _ => word.split_once(['.', ','])?,
    };
    let fraction = fraction.replacen(',', "", 1);
    let seconds = moment("1970-01-01", time, '-')?;
    let is_number = !fraction.is_empty() && fraction.bytes().all(|byte| byte.is_ascii_digit());
    let fraction = decimal_nanos(&format!("0.{fraction}")).filter(|_| is_number)?;
    Some(seconds * 1_000_000_000 + fraction)
}

/// A time without its zone: `Z`, `+01:00` or `-0500`. The times of a file have the same zone.
fn without_zone(time: &str) -> &str {
    let digits = |zone: &&str| matches!(zone.replace(':', "").len(), 3 | 5);
    let zone = time.find(['+', '-']).map(|at| &time[at..]).filter(digits);
    let is_number = |zone: &&str| zone[1..].bytes().all(|byte| b"0123456789:".contains(&byte));
    let end = zone.filter(is_number).map_or(0, str::len);
    time[..time.len() - end].trim_end_matches('Z')
}

/// A date as 2026-11-27, 2026/11/27, 27.11.2026, 27/11/2026 or 11/27/2026, and a time with or
/// without fraction.
fn date_and_time(date: &str, time: &str) -> Option<u64> {
    let turned: String;
    let (date, mark) = match date.split(['.', '/']).collect::<Vec<_>>()[..] {
        [first, second, year] if year.len() == 4 => {
            // The day comes first, unless the second number cannot be a month.
            let is_month_first = second.parse::<u8>().is_ok_and(|second| second > 12);
            turned = match is_month_first {
                true => format!("{year}-{first}-{second}"),
                false => format!("{year}-{second}-{first}"),
            };
            (&*turned, '-')
        }
        _ if date.contains('/') => (date, '/'),
        _ => (date, '-'),
    };
    let time = without_zone(time);
    let (time, fraction) = match time.rsplit_once(':') {
        Some((whole, fraction)) if time.matches(':').count() == 3 => (whole, fraction),
        _ => time.split_once(['.', ',']).unwrap_or((time, "0")),
    };
    let seconds = moment(date, time, mark)?.checked_mul(1_000_000_000)?;
    Some(seconds + decimal_nanos(&format!("0.{fraction}"))?)
}
