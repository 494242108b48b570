//! Time and direction before the bytes of a line.

use crate::import::text::{decimal_nanos, moment};

/// What a time counts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Clock {
    /// 1970, by a date and a time.
    Date,
    /// Midnight, by a time of the day.
    Day,
    /// The start of the recording.
    Seconds,
}

/// What stands before the bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Prefix {
    pub(super) at: Option<(u64, Clock)>,
    /// Whether the host sent the bytes; none if the line does not say.
    pub(super) is_sent: Option<bool>,
}

/// Words of what the host sent.
const SENT: [&str; 13] = [
    "tx", "send", "sent", "sending", "out", "write", "wrote", "written", "host", "->", "-->", ">",
    ">>",
];
/// Words of what it received.
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
pub(super) fn split(text: &str) -> (Prefix, &str) {
    let (mut prefix, mut rest) = (Prefix::default(), text.trim_start());
    loop {
        let Some((word, behind)) = next_word(rest) else {
            return (prefix, rest);
        };
        if let Some((at, behind)) = time(word, behind).filter(|_| prefix.at.is_none()) {
            (prefix.at, rest) = (Some(at), behind);
        } else if let Some(is_sent) = direction(word).filter(|_| prefix.is_sent.is_none()) {
            (prefix.is_sent, rest) = (Some(is_sent), behind);
        } else if prefix != Prefix::default() && matches!(word, "-" | "|" | ":" | ",") {
            rest = behind;
        } else {
            return (prefix, rest);
        }
    }
}

/// The first word: what is in brackets, or up to a space. Behind it what follows.
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

/// A time that begins with `word`, and what is behind it.
fn time<'a>(word: &str, behind: &'a str) -> Option<((u64, Clock), &'a str)> {
    let word = word.trim_end_matches([':', ',']);
    // A bracket may hold both parts of a date.
    if let Some((date, time)) = word.split_once([' ', 'T'])
        && let Some(nanos) = date_and_time(date, time)
    {
        return Some(((nanos, Clock::Date), behind));
    }
    if let Some((time, rest)) = next_word(behind)
        && let Some(nanos) = date_and_time(word, time.trim_end_matches([':', ',']))
    {
        return Some(((nanos, Clock::Date), rest));
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

/// `12:11:23.000501`; the fraction is needed, as three pairs are bytes as well.
fn of_day(word: &str) -> Option<u64> {
    let (time, fraction) = word.split_once(['.', ','])?;
    let seconds = moment("1970-01-01", time, '-')?;
    let is_number = !fraction.is_empty() && fraction.bytes().all(|byte| byte.is_ascii_digit());
    let fraction = decimal_nanos(&format!("0.{fraction}")).filter(|_| is_number)?;
    Some(seconds * 1_000_000_000 + fraction)
}

/// A date as 2026-11-27, 2026/11/27 or 27.11.2026, and a time with or without fraction.
fn date_and_time(date: &str, time: &str) -> Option<u64> {
    let turned: String;
    let (date, mark) = match date.split('.').collect::<Vec<_>>()[..] {
        [day, month, year] if year.len() == 4 => {
            turned = format!("{year}-{month}-{day}");
            (&*turned, '-')
        }
        _ if date.contains('/') => (date, '/'),
        _ => (date, '-'),
    };
    let time = time.trim_end_matches('Z');
    let (time, fraction) = time.split_once(['.', ',']).unwrap_or((time, "0"));
    let seconds = moment(date, time, mark)?.checked_mul(1_000_000_000)?;
    Some(seconds + decimal_nanos(&format!("0.{fraction}"))?)
}
