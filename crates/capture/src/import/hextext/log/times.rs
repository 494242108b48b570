//! Dates and times of a line, whose digits are no bytes.

/// Forms of dates; `d` is a digit.
const DATES: [&str; 4] = ["dddd-dd-dd", "dddd/dd/dd", "dd.dd.dddd", "dd/dd/dddd"];
/// The character that replaces those of a time.
pub(super) const MASK: char = '\x01';

/// The text with [`MASK`] in place of each date and each time of day.
pub(super) fn masked(text: &str) -> String {
    let bytes = text.as_bytes();
    let mut out = bytes.to_vec();
    let mut at = 0;
    while at < bytes.len() {
        let is_start = at == 0 || !bytes[at - 1].is_ascii_alphanumeric();
        let len = if is_start { time(&bytes[at..]) } else { 0 };
        out[at..at + len].fill(1);
        at += len.max(1);
    }
    String::from_utf8(out).unwrap_or_else(|_| text.to_owned())
}

fn fits(bytes: &[u8], form: &str) -> bool {
    let pairs = bytes.iter().zip(form.bytes());
    bytes.len() >= form.len()
        && pairs.into_iter().all(|(byte, wanted)| match wanted {
            b'd' => byte.is_ascii_digit(),
            wanted => *byte == wanted,
        })
}

/// Whether a time may end before these bytes: more bytes would follow a hex number.
fn is_end(rest: &[u8]) -> bool {
    !rest
        .first()
        .is_some_and(|byte| byte.is_ascii_alphanumeric() || b":-".contains(byte))
}

/// Length of the date or time at the beginning; 0 if there is none.
fn time(bytes: &[u8]) -> usize {
    let Some(date) = DATES.iter().find(|form| fits(bytes, form)) else {
        return of_day(bytes, true);
    };
    let len = date.len();
    let behind = match bytes.get(len) {
        Some(b' ' | b'T') => of_day(&bytes[len + 1..], false),
        _ => 0,
    };
    match behind {
        0 if is_end(&bytes[len..]) => len,
        0 => 0,
        behind => len + 1 + behind,
    }
}

/// Length of a time of day. Without a date before it, only a fraction tells it from three bytes.
fn of_day(bytes: &[u8], needs_fraction: bool) -> usize {
    const SECONDS: usize = "dd:dd:dd".len();
    if !fits(bytes, "dd:dd:dd") {
        return 0;
    }
    let rest = &bytes[SECONDS..];
    let digits = rest.iter().skip(1);
    let digits = digits.take_while(|byte| byte.is_ascii_digit()).count();
    let fraction = match rest.first() {
        Some(b'.' | b',') if digits > 0 => 1 + digits,
        Some(b':') if digits == 3 => 1 + digits,
        _ => 0,
    };
    let zone = zone_len(&rest[fraction..]);
    let is_time = (fraction > 0 || !needs_fraction) && is_end(&rest[fraction + zone..]);
    if is_time {
        SECONDS + fraction + zone
    } else {
        0
    }
}

/// Length of the zone at the beginning: `Z`, `+02:00`, `-0530`, `+02`; 0 if there is none.
fn zone_len(bytes: &[u8]) -> usize {
    let forms = ["+dd:dd", "-dd:dd", "+dddd", "-dddd", "+dd", "-dd", "Z"];
    let is_zone = |form: &&&str| fits(bytes, form) && is_end(&bytes[form.len()..]);
    forms.iter().find(is_zone).map_or(0, |form| form.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The text with its masked characters replaced by stars.
    fn stars(text: &str) -> String {
        masked(text).replace(MASK, "*")
    }

    #[test]
    fn dates_and_times_of_day_are_masked() {
        for (text, length) in [
            ("2026-11-21 07:58:48.5 AB", 21),
            ("2026/11/21 AB", 10),
            ("21.11.2026T07:58:48 AB", 19),
            ("21/11/2026 07:58:48Z AB", 20),
            ("07:58:48.5 AB", 10),
            ("07:58:48,501 AB", 12),
            ("07:58:48:501 AB", 12),
            ("07:58:48.5+02:00 AB", 16),
            ("07:58:48.5-02:00 AB", 16),
            ("07:58:48.5+0530 AB", 15),
            ("07:58:48.5-0530 AB", 15),
            ("07:58:48.5+02 AB", 13),
            ("07:58:48.5-02", 13),
            ("07:58:48.5Z", 11),
        ] {
            let expected = "*".repeat(length) + &text[length..];
            assert_eq!(stars(text), expected, "{text}");
            assert_eq!(stars(&format!("[{text}")), format!("[{expected}"), "{text}");
        }
        assert_eq!(stars("07:58:48.5 x 07:58:49.5"), "********** x **********");
    }

    /// Three pairs of digits may be bytes. Digits behind a letter, or before another sign, may be
    /// bytes as well.
    #[test]
    fn what_may_be_bytes_is_not_masked() {
        for text in [
            "07:58:48 AB",
            "07:58:48. AB",
            "07:58:48:50 AB",
            "07:58:48.5-AB",
            "07:58:48.5:11",
            "x07:58:48.5",
            "2026-11-21-05",
            "2026-11-21a",
            "07:58 48.5",
            "2026-11-2",
        ] {
            assert_eq!(stars(text), text);
        }
    }
}
