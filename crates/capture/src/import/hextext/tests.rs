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
