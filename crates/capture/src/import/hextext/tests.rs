use super::*;
use crate::import::{Format, read as read_format};
use engine::rig::line::Direction;

/// Messages of a text: time in microseconds, direction (true: to the device), bytes.
fn told(text: &str) -> Result<Vec<(u64, bool, Vec<u8>)>, String> {
    let options = Options {
        baud: Some(1_000_000),
        ..Options::default()
    };
    let imported = read_format(text.as_bytes(), Format::Hex, &options);
    let imported = imported.map_err(|error| error.to_string())?;
    let records = imported.records().iter().map(|one| {
        let is_sent = one.direction == Direction::ToDevice;
        (one.at.as_nanos() / 1000, is_sent, one.bytes.to_vec())
    });
    Ok(records.collect())
}

fn bytes(text: &str) -> Vec<u8> {
    let told = told(text).unwrap_or_else(|error| panic!("{text:?}: {error}"));
    told.into_iter().flat_map(|(_, _, bytes)| bytes).collect()
}

/// A read of the register bus in all common spellings.
#[test]
fn all_spellings_are_the_same_bytes() {
    let expected = [0xAB, 0x24, 0x0A, 0x00, 0xD9];
    for text in [
        "AB 24 0A 00 D9\n",
        "ab240a00d9",
        "AB:24:0A:00:D9",
        "AB-24-0A-00-D9",
        "AB,24,0A,00,D9\r\n",
        "AB;24;0A;00;D9",
        "0xAB 0x24 0xA 0x0 0xD9",
        "[0xab, 0x24, 0x0a, 0x00, 0xd9]",
        "{0xAB,0x24,\n 0x0A,0x00, 0xD9}",
        "\\xAB\\x24\\x0A\\x00\\xD9",
        "b'\\xab$\\n\\x00\\xd9'",
        "\"\\253$\\n\\0\\xD9\"",
        "ABh 24h 0Ah 00h D9h",
        "$AB $24 $0A $00 $D9",
        "AB 24 0A # a comment\n00 D9 // another",
        "AB 24 /* of\nC */ 0A 00 D9",
        "AB 24 0A 00 D9 ; read ten registers",
        "AB 24 0A 00 D9   .$...",
        "AB 24 0A 00 D9  |.$...|",
        "static const uint8_t read[] = {\n 0xAB, 0x24, 0x0A, 0x00, 0xD9\n};\nint read_len = 5;",
    ] {
        assert_eq!(bytes(text), expected, "{text:?}");
    }
}

/// Times worked out by hand; a line without a prefix continues the previous message.
#[test]
fn times_and_directions_before_the_bytes_are_read() {
    let both = vec![(501, true, vec![0xAB]), (1_500, false, vec![0x24, 0x0A])];
    for text in [
        "0.000501 TX: AB\n0.001500 RX: 24\n0A\n",
        "[0.000501] > AB\n[0.001500] < 24 0A",
        "00:00:00.000501 -> AB\n00:00:00.001500 <- 24 0A",
        "(0.501ms) send AB\n(1.5ms) recv 24 0A",
        "0.501 ms TX AB\n1.500 ms RX 24 0A",
        "+501 us TX AB\n+1500 us RX 24 0A",
        "[501us] TX AB\n[1500us] RX 24 0A",
        "[TX] 0.000501 AB\n[RX] 0.001500 24 0A",
        "0.000501 out AB\n0.0015 in 240A",
        "0.000501 TX:\nAB\n0.001500 RX:\n24 0A\n",
        "0.000501 TX - AB\n0.001500 RX - 24 0A\n",
    ] {
        assert_eq!(told(text), Ok(both.clone()), "{text:?}");
    }
    // 1,795,247,928 s by `date -u`.
    let date = 1_795_247_928_000_000;
    for text in [
        "2026-11-21 07:58:48.5 AB",
        "[2026-11-21T07:58:48.5Z] AB",
        "2026/11/21 07:58:48,5: AB",
        "[21.11.2026 07:58:48.5] AB",
    ] {
        assert_eq!(
            told(text),
            Ok(vec![(date + 500_000, false, vec![0xAB])]),
            "{text:?}"
        );
    }
    let over_midnight = told("23:59:59.9 AB\n00:00:00.1 24\n").expect("sound");
    assert_eq!(over_midnight[1].0 - over_midnight[0].0, 200_000);
}

/// Without times a character takes 10 us at 1 Mbaud, and lines are four characters apart.
#[test]
fn lines_without_times_stay_apart() {
    let line = |micros, byte| (micros, false, vec![byte]);
    assert_eq!(told("AB\n24"), Ok(vec![line(10, 0xAB), line(60, 0x24)]));
    // Wrapped at sixteen bytes, as `xxd -p -c 16` does.
    let wrapped = format!("{}\n{}\nFE", "FA".repeat(16), "FB".repeat(16));
    let times: Vec<u64> = told(&wrapped)
        .expect("sound")
        .iter()
        .map(|one| one.0)
        .collect();
    assert_eq!(times, [160, 320, 330]);
}

/// Three pairs with colons are bytes. A number of several bytes has no known byte order. A word is
/// not a number.
#[test]
fn what_has_two_meanings_is_not_guessed() {
    assert_eq!(bytes("12:11:23"), [0x12, 0x11, 0x23]);
    assert!(
        told("0x240A")
            .expect_err("a word")
            .contains("which one was first")
    );
    assert!(
        told("AB 24 read")
            .expect_err("a word")
            .contains("found \"read\"")
    );
    assert!(
        told("AB 2")
            .expect_err("a digit")
            .contains("pairs of hex digits")
    );
    assert!(
        told("AB 24   xy")
            .expect_err("other text")
            .contains("the same bytes as text")
    );
    assert!(
        told("0.5 AB\n00:00:01.0 24")
            .expect_err("clocks")
            .contains("same form")
    );
    assert!(
        told("AB\n0.5 24")
            .expect_err("no time")
            .contains("expected a time")
    );
    assert!(told("'\\xAB").expect_err("open").contains("closing"));
}

#[test]
fn only_what_can_be_nothing_else_is_sure() {
    let look = |text: &str| look(text.as_bytes());
    assert_eq!(look("AB 24 0A 00 D9"), Some(Look::Surely));
    assert_eq!(look("0x01 0x02"), Some(Look::Surely));
    assert_eq!(look("01 03 00 00 00 02"), Some(Look::Perhaps));
    assert_eq!(look("AB"), Some(Look::Perhaps));
    // Decimal numbers, as an odometer sends them.
    assert_eq!(look("12 34 56 78 90 12 34 56 78"), None);
    assert_eq!(look("1250*500*1500*12345*D147*\r\n"), None);
    assert_eq!(look("$GPGGA,123519,4807.038,N"), None);
    assert_eq!(look("some words of a log\n"), None);
    assert_eq!(look(""), None);
}

/// A zone behind the time takes neither the time nor the direction away.
#[test]
fn a_zone_is_no_part_of_the_bytes() {
    for zone in ["", "Z", "+0100", "+01:00", "-0530", "+01"] {
        let line =
            |fraction: &str, rest: &str| format!("2026-11-28T10:11:12.{fraction}{zone} {rest}\n");
        let text = line("500000", ">> aa01") + &line("501000", " << 55");
        let told = told(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
        let [(first, true, asked), (second, false, answer)] = &told[..] else {
            panic!("{zone}: {told:?}");
        };
        assert_eq!(
            (second - first, &**asked, &**answer),
            (1_000, &[0xAA, 1][..], &[0x55][..])
        );
    }
}

/// Each line keeps its own time if the file ends its lines with CR alone.
#[test]
fn lines_may_end_with_cr_alone() {
    assert_eq!(
        told("0.000501 TX: AB\r0.001500 RX: 24 0A\r"),
        Ok(vec![
            (501, true, vec![0xAB]),
            (1_500, false, vec![0x24, 0x0A])
        ])
    );
}

/// Times in microseconds of a text in any form, and the notes.
fn times(text: &str) -> (Vec<u64>, String) {
    let format = Format::detect(text.as_bytes()).unwrap_or_else(|| panic!("{text}: no form"));
    let found = read_format(text.as_bytes(), format, &Options::default());
    let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
    let times = found.records().iter().map(|one| one.at.as_nanos() / 1000);
    (times.collect(), found.notes.join("; "))
}

/// The times are 500, 500 + 1,000 and 1,500 + 200 us. A line without bytes is a pause, too.
#[test]
fn times_with_a_plus_sign_are_pauses_if_they_do_not_increase() {
    for text in [
        "+0.0005 TX AB\n+0.001 RX 24\n+0.0002 TX 0A\n",
        "+500us TX AB\n+1000us RX 24\n+200us TX 0A\n",
        "[+0.0005] TX AB\n[+0.001] RX 24\n[+0.0002] TX 0A\n",
        "+0.0005 TX:\nAB\n+0.001 RX:\n24\n+0.0002 TX: 0A\n",
        "+0.0003 # open\n+0.0002 TX AB\n+0.001 RX 24\n+0.0002 TX 0A\n",
        "Time,Direction,Data\n+0.0005,TX,AB\n+0.0009,,\n+0.0001,RX,24\n+0.0002,TX,0A\n",
        "time_us,dir,data\n+500,TX,AB\n+1000,RX,24\n+200,TX,0A\n",
        "TRACE +0.0005 Write 2 bytes: AB01\nTRACE +0.0004 no reply\nTRACE +0.0006 Read 2 bytes: \
         24AF\nTRACE +0.0002 Write 2 bytes: 0AFF\n",
    ] {
        let (at, notes) = times(text);
        assert_eq!(at, [500, 1_500, 1_700], "{text}");
        let is_noted = notes.contains("pauses") && !notes.contains("backwards");
        assert!(is_noted, "{text}: {notes}");
    }
    assert_eq!(times("+0.0005 TX AB\n+0.0005 RX 24\n").0, [500, 1_000]);
    let (at, notes) = times("+0.0005 TX AB\n+0.001 RX 24\n");
    assert_eq!(at, [500, 1_000]);
    assert!(notes.contains("since the start"), "{notes}");
}

/// If the clock was set back, or the lines are out of order, a note counts these lines and names
/// the first one.
#[test]
fn times_that_go_backwards_are_noted_in_all_forms() {
    for text in [
        "0.002 TX AB\n0.001 RX 24\n0.003 TX 0A\n",
        "00:00:00.002 TX AB\n00:00:00.001 RX 24\n00:00:00.003 TX 0A\n",
        "0.002 sent AB CD EF ok\n0.001 read AB CD EF ok\n0.003 sent AB CD EF ok\n",
        "1970/01/01 00:00:00.002 TX AB\n1970/01/01 00:00:00.001 RX 24\n1970/01/01 00:00:00.003 TX 0A\n",
        "0.002,TX,AB\n0.001,RX,24\n0.003,TX,0A\n",
        "[0.002] TX: Hello\n[0.001] RX: You\n[0.003] TX: Bye\n",
        "000000.002 TX   0000  AB\n000000.001 RX   0000  24\n000000.003 TX   0000  0A\n",
    ] {
        let head = if text.starts_with("0.002,") {
            "time,dir,data\n"
        } else {
            ""
        };
        let (at, notes) = times(&format!("{head}{text}"));
        assert_eq!(at, [2_000, 1_000, 3_000], "{text}");
        let line = if head.is_empty() { 2 } else { 3 };
        let expected = format!("go backwards at line {line}:");
        assert!(notes.contains(&expected), "{text}: {notes}");
    }
    let (_, notes) = times("0.3 TX AB\n0.2 RX 24\n0.1 TX 0A\n");
    assert!(notes.contains("line 2, and at 1 more places"), "{notes}");
}

/// Lines half a second before the clock begins again, and after it. Lines that are a little late
/// keep their time.
#[test]
fn a_clock_may_begin_again() {
    for (first, second) in [
        ("23:59:59.9", "00:00:00.4"),
        ("59:59.90", "00:00.40"),
        ("59:59.90", "60:00.40"),
        ("1:59:59.9", "2:00:00.4"),
        ("11/27/2026 11:59:59.900 PM", "11/28/2026 12:00:00.400 AM"),
    ] {
        let (at, notes) = times(&format!("{first} TX AB\n{second} RX 24\n"));
        assert_eq!(at[1] - at[0], 500_000, "{first}");
        assert!(!notes.contains("backwards"), "{notes}");
        assert_eq!(notes.contains("begin"), second.starts_with("00"), "{notes}");
    }
    let (at, notes) = times("23:59:59.8 TX AB\n00:00:00.1 RX 24\n23:59:59.9 TX 0A\n");
    assert_eq!([at[1] - at[0], at[1] - at[2]], [300_000, 200_000]);
    assert!(notes.contains("backwards at line 3"), "{notes}");
    assert_eq!(
        times("59:58.02 TX AB\n59:59.03 RX 24").0,
        [3_598_020_000, 3_599_030_000]
    );
}

/// 1,732,871,400 s by `date -u`.
#[test]
fn seconds_since_1970_are_a_date() {
    for text in [
        "[1732871400.5] TX: AB 24\n",
        "(1732871400.5) TX: AB 24\n",
        "1732871400.5 TX: AB 24\n",
        "1732871400.500000: TX: AB 24\n",
        "1732871400500 TX AB 24\n",
        "[DEBUG] [1732871400.500000000] [base]: Sent 3 bytes: AB 24 0A\n",
        "ts,dir,data\n1732871400.5,TX,AB24\n",
        "ts,dir,data\n1732871400500,TX,AB24\n",
    ] {
        let (at, _) = times(text);
        assert_eq!(at, [1_732_871_400_500_000], "{text}");
        let format = Format::detect(text.as_bytes()).expect("a form");
        let found = read_format(text.as_bytes(), format, &Options::default()).expect("sound");
        assert_eq!(found.clock, "utc", "{text}");
    }
}

/// The bytes of these messages are shown in part: each line is counted.
#[test]
fn bytes_that_the_tool_cut_are_noted() {
    for (lines, count) in [
        (["TX: 01 03 00 ...", "RX: 01 03 04"], 1),
        (["TX: 01 03 00...", "RX: 01 03 04..."], 2),
        (["TX: 01 03 00 \u{2026}", "RX: 01 03 04"], 1),
        (["TX: [0x01, 0x03, 0x00, ...]", "RX: [0x01, 0x03, 0x04]"], 1),
        (["sent 01 03 00 ... C4 0B", "read 01 03 04"], 1),
        (["sent 01 03 00 (5 more bytes)", "read 01 03 04"], 1),
        (["sent 01 03 00 (truncated)", "read 01 03 04"], 1),
        (["sent 01 03 00 14 more bytes", "read 01 03 04"], 1),
        (["TX 01 03 00 14 more bytes", "RX 01 03 04 99 more"], 2),
        (["TX: 01 03 00 (14 more bytes)", "RX: 01 03 04"], 1),
        (["TX: 01 03 00 +14 more", "RX: 01 03 04"], 1),
        (["TX 01 03 00 ... (truncated)", "RX 01 03 04"], 1),
        (
            [
                "10:00:00.000 RX 01 03 00 14 more bytes",
                "10:00:00.100 TX 01 03 04",
            ],
            1,
        ),
        (
            [
                "10:00:00.000 RX 01 03 00 [...] (14 more bytes)",
                "10:00:00.100 RX 01 03 04 ... (truncated)",
            ],
            2,
        ),
        (
            [
                "log: sent b'\\x01\\x03\\x00'...",
                "log: read b'\\x01\\x03\\x04'",
            ],
            1,
        ),
    ] {
        let text = lines.join("\n");
        let format = Format::detect(text.as_bytes()).unwrap_or_else(|| panic!("{text}: no form"));
        let found = read_format(text.as_bytes(), format, &Options::default());
        let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
        let bytes: Vec<&[u8]> = found.records().iter().map(|one| &*one.bytes).collect();
        assert_eq!(bytes, [&[1, 3, 0][..], &[1, 3, 4]], "{text}");
        let expected = format!("of {count} messages");
        let notes = found.notes.join("; ");
        assert!(
            notes.contains(&expected) && notes.contains("is line 1"),
            "{text}: {notes}"
        );
    }
    // The only line of a file.
    let text = "10:00:00.000 RX 01 03 ... (truncated)\n";
    let format = Format::detect(text.as_bytes()).expect("a form");
    let found = read_format(text.as_bytes(), format, &Options::default()).expect("bytes");
    let bytes: Vec<&[u8]> = found.records().iter().map(|one| &*one.bytes).collect();
    assert_eq!(bytes, [&[1, 3][..]]);
    let (_, notes) = times("0.1 TX: 01 02 03 04  ....\n0.2 RX: 30 31 00  01.\n");
    assert!(!notes.contains("only the first"), "{notes}");
}

/// A number that states how many bytes follow, in all forms; 001 is decimal in a log.
#[test]
fn numbers_of_other_kinds_are_no_hex_bytes() {
    for (text, expected) in [
        (
            "TX 3 10 5B 01\nRX 2 E5 AF\n",
            [&[0x10, 0x5B, 1][..], &[0xE5, 0xAF]],
        ),
        (
            "(3) 10 5B 01\n(2) E5 AF\n",
            [&[0x10, 0x5B, 1], &[0xE5, 0xAF]],
        ),
        (
            "len=3: 10 5B 01\nlen=2: E5 AF\n",
            [&[0x10, 0x5B, 1], &[0xE5, 0xAF]],
        ),
        (
            "TX [len 3] 10 5B 01\nRX [len 2] E5 AF\n",
            [&[0x10, 0x5B, 1], &[0xE5, 0xAF]],
        ),
        (
            "01: 10 5B 01\n02: E5 AF\n",
            [&[0x10, 0x5B, 1], &[0xE5, 0xAF]],
        ),
        (
            "port TX 3 10 5B 01\nopened\nport RX 2 E5 AF\n",
            [&[0x10, 0x5B, 1], &[0xE5, 0xAF]],
        ),
        ("TX: 001 003 000\nRX: 001 255\n", [&[1, 3, 0], &[1, 255]]),
        ("TX: 001 003 000\nRX: 001 011\n", [&[1, 3, 0], &[1, 11]]),
        ("TX: [10, 30, 0]\nRX: [1, 255]\n", [&[10, 30, 0], &[1, 255]]),
        (
            "INFO sent [10, 30, 20] ok\nINFO got [1, 255] ok\n",
            [&[10, 30, 20], &[1, 255]],
        ),
        (
            "INFO sent [10, 30, 5]\nINFO wait\nINFO got [-1, 12]\n",
            [&[10, 30, 5], &[255, 12]],
        ),
        (
            "INFO sent [0a, 30, 05]\nINFO wait\nINFO got [10, 12]\n",
            [&[10, 48, 5], &[16, 18]],
        ),
    ] {
        let format = Format::detect(text.as_bytes()).unwrap_or_else(|| panic!("{text}: no form"));
        let found = read_format(text.as_bytes(), format, &Options::default());
        let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
        let bytes: Vec<&[u8]> = found.records().iter().map(|one| &*one.bytes).collect();
        assert_eq!(bytes, expected, "{text}");
    }
}

/// 1 December is four days behind 27 November; with the day first, it is in January.
#[test]
fn all_dates_of_a_file_have_one_order() {
    const DAYS: u64 = 4 * 86_400 * 1_000_000;
    for text in [
        "11/27/2026 10:00:00.5 TX AB 24\n12/01/2026 10:00:00.5 RX AB 24\n",
        "[11/27/2026 10:00:00 AM] port TX AB 24 0A\n[12/1/2026 10:00:00 AM] port RX AB 24 0A\n",
        "time,dir,data\n11/27/2026 10:00:00,TX,AB24\n12/01/2026 10:00:00,RX,AB24\n",
        "11/27/2026 10:00:00 Hello\n12/01/2026 10:00:00 World\n",
        "11/27/2026 10:00:00 TX\n0000: AB 24 0A 00\n12/01/2026 10:00:00 RX\n0000: AB 24 0A 00\n",
    ] {
        let (at, notes) = times(text);
        assert_eq!(at[1] - at[0], DAYS, "{text}");
        assert!(!notes.contains("day/month"), "{text}: {notes}");
        let unknown = text.replace("11/27", "11/06").replace("12/01", "12/06");
        let (_, notes) = times(&unknown.replace("12/1/", "12/06/"));
        assert!(notes.contains("day/month/year"), "{text}: {notes}");
    }
}

/// The frame stands behind the direction; other hex numbers of the line are remarks.
#[test]
fn the_bytes_behind_a_direction_are_those_of_the_line() {
    for (text, expected) in [
        (
            "TX: 01 03 C4 | CRC=0BC4\nRX: 01 03 DA | CRC=DA31\n",
            [&[1, 3, 0xC4][..], &[1, 3, 0xDA]],
        ),
        (
            "send: 0x1 0x3 0xc4\nrecv: 0xda 0x31 old_data: 0x1 0x3 0x4 0x0 addr=None\n",
            [&[1, 3, 0xC4], &[0xDA, 0x31]],
        ),
        (
            "send: 0x1 0x3 0xc4\nrecv: 0x1 0x3\nProcessing: 0x1 0x3\n",
            [&[1, 3, 0xC4], &[1, 3]],
        ),
        (
            "bus write <Buffer 01 03 c4>\nbus read <Buffer 01 03>\n",
            [&[1, 3, 0xC4], &[1, 3]],
        ),
        (
            "log sent [10 30 20]\nlog received [10 40]\n",
            [&[10, 30, 20], &[10, 40]],
        ),
        (
            "(10:00:00.5) (>>) 01h 03h C4h (3)\n(10:00:00.6) (<<) 01h 03h (2)\n",
            [&[1, 3, 0xC4], &[1, 3]],
        ),
        (
            "[10:00:00.5] 01 03 04 00 06 00\n[10:00:00.6] 00 05 da 31\n",
            [&[1, 3, 4, 0, 6, 0], &[0, 5, 0xDA, 0x31]],
        ),
        (
            "[10:00:00.5] 01 03 04 00 06 00\n[10:00:00.6] 00 05 10 31\n",
            [&[1, 3, 4, 0, 6, 0], &[0, 5, 0x10, 0x31]],
        ),
        (
            "TX 00000001 11111111\nRX 10000000 00000000",
            [&[1, 255], &[128, 0]],
        ),
        (
            "10:00:00.5 [TX] - AT<CR><LF>\n10:00:00.6 [RX] - OK<CR><LF>\n",
            [b"AT\r\n", b"OK\r\n"],
        ),
        (
            "[0.5] TX: AT\\r\\n\n[0.6] RX: OK\\r\\n\n",
            [b"AT\r\n", b"OK\r\n"],
        ),
    ] {
        let format = Format::detect(text.as_bytes()).unwrap_or_else(|| panic!("{text}: no form"));
        let found = read_format(text.as_bytes(), format, &Options::default());
        let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
        let bytes: Vec<&[u8]> = found.records().iter().map(|one| &*one.bytes).collect();
        assert_eq!(bytes, expected, "{text}");
    }
}

/// Decimal lists and binary numbers with directions are certain, other numbers may be text.
#[test]
fn numbers_of_other_bases_are_certain_in_lists_or_with_directions() {
    for (text, expected) in [
        ("171 36 10 0 217\n", Some(Look::Perhaps)),
        ("[171, 36, 10, 0, 217]\n", Some(Look::Surely)),
        ("TX: 171 36 10\nRX: 200 1 2\n", Some(Look::Perhaps)),
        ("TX: 00000001 00000011\n", Some(Look::Surely)),
        ("00000001 00000011\n", Some(Look::Perhaps)),
        // Times before digits that are hardly chance: a byte below 0x10 is among them.
        ("12:00:00.1 10 20 30 40 50 60 70 80\n", None),
        ("12:00:00.1 10 20 30 40 50 60 70 08\n", Some(Look::Perhaps)),
        ("10 20 30 40 50 60 70 08\n", None),
        ("10 20 30 40 50 60 70\n", Some(Look::Perhaps)),
        (
            "12:00:00.1 10 2A 30 40 50 60 70 80 90 11 12 13 14 15 16 17 18\n",
            Some(Look::Surely),
        ),
        ("10 2A 30 40 50 60 70 80 90\n", None),
        ("10 2A 30 40 50 60 70 80\n", Some(Look::Surely)),
        ("0x10\n", Some(Look::Perhaps)),
        // One direction before nothing but pairs; a damaged byte leaves it open.
        ("TX: 10 20 30\n", Some(Look::Surely)),
        (
            "TX: 10 20\nTX: 10 30\nTX: 10 40\nTX: 1Z\n",
            Some(Look::Perhaps),
        ),
        ("10\n", None),
    ] {
        assert_eq!(look(text.as_bytes()), expected, "{text}");
    }
}

/// At 10,000 baud a byte takes a millisecond, and a pause between messages four. Lines of eight
/// bytes are one stream, as tools wrap it; lines of seven, a longer last one, and lines with a
/// direction are messages.
#[test]
fn lines_of_a_usual_width_are_one_stream() {
    let ends = |text: &str| -> Vec<u64> {
        let options = Options {
            baud: Some(10_000),
            ..Options::default()
        };
        let mut out = Imported::new();
        read(text.as_bytes(), &options, &mut out).expect(text);
        let records = out.records().iter();
        records.map(|one| one.at.as_millis()).collect()
    };
    let eight = "AB 01 02 03 04 05 06 07\n";
    let seven = "AB 01 02 03 04 05 06\n";
    assert_eq!(ends(&eight.repeat(2)), [8, 16]);
    assert_eq!(ends(&format!("{eight}{seven}")), [8, 15]);
    assert_eq!(ends(&seven.repeat(2)), [7, 18]);
    assert_eq!(ends(&format!("{eight}{seven}{eight}")), [8, 19, 31]);
    assert_eq!(
        ends(&format!("{eight}AB 01 02 03 04 05 06 07 08\n")),
        [8, 21]
    );
    assert_eq!(ends(&format!("TX: {eight}TX: {eight}")), [8, 20]);
    assert_eq!(ends(eight), [8]);
}

/// An arrow behind each time means nothing; with one to the left among them, both are directions.
#[test]
fn arrows_behind_times_tell_a_direction_if_there_are_two() {
    use engine::rig::line::Direction;
    let of = |second: &str| {
        let text = format!("12:00:00.1 -> AB 01\n12:00:00.2 {second} 24 02\n");
        let mut out = Imported::new();
        read(text.as_bytes(), &Options::default(), &mut out).expect("sound");
        let ways: Vec<Direction> = out.records().iter().map(|one| one.direction).collect();
        let is_noted = out
            .notes
            .iter()
            .any(|note| note.contains("arrow behind the times"));
        (ways, is_noted)
    };
    let (to, from) = (Direction::ToDevice, Direction::ToMaster);
    assert_eq!(of("->"), (vec![from, from], true));
    assert_eq!(of("<-"), (vec![to, from], false));
}

/// Assumptions about the digits are noted.
#[test]
fn assumed_digits_are_noted() {
    let has = |text: &str, words: &str| {
        let mut out = Imported::new();
        read(text.as_bytes(), &Options::default(), &mut out).expect(text);
        out.notes.iter().any(|note| note.contains(words))
    };
    let (letter, groups) = ("no digit is a letter", "groups of four or more digits");
    assert!(has("01 02 10 20\n", letter) && !has("AB 02 10 20\n", letter));
    assert!(!has("0x01 0x02\n", letter));
    assert!(has("AB24 0A00\n", groups) && !has("AB 24\n", groups));
    assert!(has("[171, 36]\n", "taken as decimal") && !has("AB 24\n", "taken as decimal"));
    assert!(has("00000001 00000010\n", "taken as binary"));
    assert!(has("253 044 012 000 331\n", "taken as octal"));
    assert!(has("AB 4 0 D\n", "without leading zeros"));
}

/// Numbers that may be decimal or hex are no text of hex.
#[test]
fn numbers_of_an_unknown_base_have_no_format() {
    assert_eq!(look(b"10 20\n30 3 40\n"), None);
    assert_eq!(look(b"10 20\n30 40\n"), Some(Look::Perhaps));
}
