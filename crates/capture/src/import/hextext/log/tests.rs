use super::*;
use crate::import::{Format, read as read_format};
use engine::rig::line::Direction;

const READ: [u8; 8] = [0x01, 0x03, 0x00, 0x00, 0x00, 0x02, 0xC4, 0x0B];
const REPLY: [u8; 9] = [0x01, 0x03, 0x04, 0x00, 0x06, 0x00, 0x05, 0xDA, 0x31];

/// Direction and bytes of each message.
fn told(text: &str) -> Vec<(bool, Vec<u8>)> {
    assert_eq!(Format::detect(text.as_bytes()), Some(Format::Log), "{text}");
    let found = read_format(text.as_bytes(), Format::Log, &Options::default());
    let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
    let pair = |one: &crate::Record| (one.direction == Direction::ToDevice, one.bytes.to_vec());
    found.records().iter().map(pair).collect()
}

/// A read of two registers and its reply, as each of these programs logs it.
#[test]
fn logs_of_programs_are_read_with_their_directions() {
    let expected = [(true, READ.to_vec()), (false, REPLY.to_vec())];
    for text in [
        "Opening /dev/ttyUSB0 at 9600 bauds (N, 8, 1)\n[01][03][00][00][00][02][C4][0B]\n\
         Waiting for a confirmation...\n<01><03><04><00><06><00><05><DA><31>\n",
        "Tx:000123-01 03 00 00 00 02 C4 0B\nRx:000124-01 03 04 00 06 00 05 DA 31\n",
        "[RTU]>Tx > 12:11:23:456 - 01 03 00 00 00 02 C4 0B  \n\
         [RTU]>Rx > 12:11:23:467 - 01 03 04 00 06 00 05 DA 31  \n",
        "[12:11:23][D][uart_debug:114]: >>> 01:03:00:00:00:02:C4:0B\n\
         [12:11:23][D][uart_debug:114]: <<< 01:03:04:00:06:00:05:DA:31\n",
        "2026-11-27 12:11:23,123 DEBUG logging:103 send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\n\
         2026-11-27 12:11:23,143 DEBUG logging:103 recv: 0x1 0x3 0x4 0x0 0x6 0x0 0x5 0xda 0x31 \
         old_data:  addr=None\n",
        "MinimalModbus debug mode. Will write to instrument (expecting 9 bytes back): \
         01 03 00 00 00 02 C4 0B (8 bytes)\nMinimalModbus debug mode. Clearing\n\
         MinimalModbus debug mode. Response from instrument: 01 03 04 00 06 00 05 DA 31 (9 bytes), \
         roundtrip time: 15.1 ms.\n",
        "58\t0.00000335\ta.exe\tIRP_MJ_CREATE\tSerial0\tSUCCESS\tOptions: Open\n\
         59\t0.00000335\ta.exe\tIRP_MJ_WRITE\tSerial0\tSUCCESS\tLength 8: 01 03 00 00 00 02 C4 0B\n\
         60\t0.01551789\ta.exe\tIRP_MJ_READ\tSerial0\tSUCCESS\tLength 9: 01 03 04 00 06 00 05 DA 31\n",
        "[27/11/2026 12:11:23] Open port COM3 (a.exe)\n[27/11/2026 12:11:23] Written data (COM3)\t\n\
         \t01 03 00 00 00 02 c4 0b   ......\u{c4}.        \n[27/11/2026 12:11:23] Read data (COM3)\n\
         \t01 03 04 00 06 00   ......\n\t05 da 31   .\u{da}1     \n",
        "\x1B[0;32mI (357) tx: 01 03 00 00 00 02 c4 0b\x1B[0m\n\
         \x1B[0;32mI (367) rx: 01 03 04 00 06 00 05 da 31\x1B[0m\n",
        "TRACE +0.000 Write 8 bytes: 010300000002c40b\nTRACE +0.011 Read 9 bytes:\n\
         \x20   0103040006000 | ...\n"
            .replace("0103040006000 | ...", "01030400060005da31 | .......1")
            .as_str(),
        "zh:adapter: --> [010300000002c40b]\nzh:adapter: <-- [01030400060005da31]\n",
        "2026-11-28 16:00:00.001 DEBUG port wrote b'\\x01\\x03\\x00\\x00\\x00\\x02\\xc4\\x0b'\n\
         2026-11-28 16:00:00.002 DEBUG port read b''\n\
         2026-11-28 16:00:00,011 DEBUG port read b'\\x01\\x03\\x04\\x00\\x06\\x00\\x05\\xda1'\n",
        "INFO:root:sent bytearray(b'\\x01\\x03\\x00\\x00\\x00\\x02\\xc4\\x0b') and got \
         b\"\\x01\\x03\\x04\\x00\\x06\\x00\\x05\\xda1\"\n",
    ] {
        assert_eq!(told(text), expected, "{text}");
    }
    let avrdude = told("avrdude: Send: 0 [30]   [20] \navrdude: Recv: . [14] . [10] \n");
    assert_eq!(
        avrdude,
        [(true, vec![0x30, 0x20]), (false, vec![0x14, 0x10])]
    );
}

/// Bytes that the log cuts, and bytes without a direction among others, are errors that name their
/// line.
#[test]
fn what_a_log_does_not_say_is_an_error() {
    let error = |text: &str| {
        let found = read_format(text.as_bytes(), Format::Log, &Options::default());
        found.expect_err("wrong").to_string()
    };
    let cut = error("1 0.1 a IRP_MJ_WRITE S SUCCESS Length 40: 01 03 AB\n");
    assert!(
        cut.starts_with("line 1") && cut.contains("announces 40 bytes but contains 3"),
        "{cut}"
    );
    let lost = error("send: AB CD EF\nother: AB CD EF\n");
    assert!(
        lost.starts_with("line 2") && lost.contains("no direction"),
        "{lost}"
    );
}

#[test]
fn text_with_numbers_is_no_log_of_bytes() {
    for text in [
        "12:11:23.5 temperature: 42 deg\n12:11:24.5 temperature: 43 deg\n",
        "boot: version 12\nready: 10 20\n",
        "$GPGGA,123519,4807.038,N\r\n",
        "some words of a log\n",
        "",
    ] {
        assert_eq!(look(text.as_bytes()), None, "{text}");
    }
}

/// The digits of a date and a time are no bytes, whatever stands behind them.
#[test]
fn dates_and_times_are_no_bytes() {
    for head in [
        "2026-11-28 16:00:00.001 DEBUG",
        "2026-11-28T16:00:00Z INFO",
        "2026-11-28T16:00:00.5+0100 pi doserd[812]:",
        "2026-11-28T16:00:00+01:00 INFO",
        "[28.11.2026 16:00:00,5]",
        "main 16:00:00.001:",
    ] {
        assert_eq!(piece(&format!("{head} port opened")), None, "{head}");
        let found = piece(&format!("{head} tx: AB 24 0A")).map(|piece| piece.bytes);
        assert_eq!(found, Some(vec![0xAB, 0x24, 0x0A]), "{head}");
    }
    // Without a fraction and a date, three pairs are bytes.
    let found = piece("rx: 12:11:23").map(|piece| piece.bytes);
    assert_eq!(found, Some(vec![0x12, 0x11, 0x23]));
}

/// Messages of a text in any form, as `true` for sent ones, and the notes of the import.
fn imported(text: &str) -> (Vec<(bool, Vec<u8>)>, String) {
    let format = Format::detect(text.as_bytes()).unwrap_or_else(|| panic!("{text}: no form"));
    let found = read_format(text.as_bytes(), format, &Options::default());
    let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
    let pair = |one: &crate::Record| (one.direction == Direction::ToDevice, one.bytes.to_vec());
    let pairs = found.records().iter().map(pair).collect();
    (pairs, found.notes.join("; "))
}

/// No time, length or word of a line becomes a byte, and no bytes or lines get lost without a note.
#[test]
fn a_line_gives_its_bytes_and_nothing_else() {
    const REQUEST: [u8; 3] = [0x10, 0x5B, 0x01];
    const REPLY: [u8; 2] = [0xE5, 0xAF];
    let expected = [(true, REQUEST.to_vec()), (false, REPLY.to_vec())];
    for text in [
        "10:00:00 DEBUG TX: 10 5B 01\n10:00:01 ERROR timeout\n10:00:03 DEBUG RX: E5 AF\n",
        "1774742394 TX: 10 5B 01\n1774742395 ERROR timeout\n1774742396 RX: E5 AF\n",
        "20260328 100000 TX: 10 5B 01\n20260328 100001 no reply\n20260328 100002 RX: E5 AF\n",
        "10:00:00 TX 10 5B 01\n10:00:01 RX E5 AF ok\n",
        "10:00:00 TX 10 5B 01 (retry)\n10:00:01 RX E5 AF <ACK>\n",
        "10:00:00.000 TX (3): 10 5B 01\n10:00:00.100 RX (2): E5 AF\n",
        "TX [3]: 10 5B 01\nRX [2]: E5 AF\n",
        "TX 3: 10 5B 01\nRX 2: E5 AF\n",
        "TX len=3 10 5B 01\nRX len=02 E5 AF\n",
        "ttyS0 >> 10 5B 01\nttyS0 << E5 AF\n",
        "ttyS0 > 10 5B 01\nttyS0 < E5 AF\n",
        "10:00:00.000 -> 10 5B 01\n10:00:00.100 <- E5 AF\n",
        "0.000 TX: 10 5B 01 RX: E5 AF\n",
        "10:00:00.000 -> 10 5B 01 <- E5 AF\n",
        "PC -> METER: 10 5B 01\nMETER -> PC: E5 AF\n",
        "[10:00:00.000] PC -> METER 10 5B 01\n[10:00:00.100] METER -> PC E5 AF\n",
        "Nov 27 10:00:00 pi N1->N2: [105B01]\nNov 27 10:00:01 pi N2->N1: [E5AF]\n",
        "10:00:00 DEBUG bus host > dev 10 5B 01\n10:00:01 DEBUG bus dev > host E5 AF\n",
        "master: 10 5B 01\nslave: E5 AF\n",
        "host: 10 5B 01\ndevice: E5 AF\n",
        "client: 10 5B 01\nserver: E5 AF\n",
        "request: 10 5B 01\nresponse: E5 AF\n",
        "out: 10 5B 01\nin: E5 AF\n",
        "send: 10 5B 01\nrecv: E5 AF\n",
        "[bus] master: 10 5B 01\n[bus] slave: E5 AF\n",
        "2026-11-27 10:00:00 cmd: 10 5B 01\n2026-11-27 10:00:01 ack: E5 AF\n",
        "modbus slave rx: 10 5B 01\nmodbus slave tx: E5 AF\n",
        "TX: 10 5B 01  .[.\nRX: E5 AF  \u{e5}\u{af}\n",
    ] {
        assert_eq!(imported(text).0, expected, "{text}");
    }
    // Characters that look like bytes.
    let shown = "TX: 10 5B 01  .[.\n1.5 s later RX: 41 42 |AB|\nRX: 30 31 41 42  01AB\n";
    let found: Vec<Vec<u8>> = imported(shown).0.into_iter().map(|one| one.1).collect();
    assert_eq!(found[1..], [b"AB".to_vec(), b"01AB".to_vec()]);
    // Printable bytes are bytes, too, behind directions.
    let printable = "23:59:55.123 -> 02 73 52 4E 03\n23:59:55.153 <- 02 73 52 41 03\n";
    let found = imported(printable).0;
    assert_eq!(found[0], (true, vec![0x02, 0x73, 0x52, 0x4E, 0x03]));
    for lost in [
        "RX E5 ACK",
        "RX: E5 02 ?? 16",
        "RX: E5 0",
        "RX: E5 02 03 ?? 16",
        "RX: E5 02 03 1G 16",
        "RX: E5 02 03 116 16",
    ] {
        let (found, notes) = imported(&format!("TX: 10 5B 01\n{lost}\nRX: E5 AF\n"));
        assert_eq!(found, expected, "{lost}");
        assert!(
            notes.contains("line 2") && notes.contains("left out"),
            "{lost}: {notes}"
        );
    }
    // Only the last byte of a line is cut.
    let (found, notes) = imported("TX: 10 5B 01\nRX: E5 02 03 0\nRX: E5 AF\n");
    assert_eq!(found[1], (false, vec![0xE5, 2, 3]));
    assert!(notes.contains("cut inside a byte, line 2"), "{notes}");
}

/// Times in seconds of the records from the first one on, and the notes.
fn times(text: &str) -> (Vec<u64>, u64, String) {
    let format = Format::detect(text.as_bytes()).unwrap_or_else(|| panic!("{text}: no form"));
    let found = read_format(text.as_bytes(), format, &Options::default());
    let found = found.unwrap_or_else(|error| panic!("{text}: {error}"));
    let at: Vec<u64> = found
        .records()
        .iter()
        .map(|one| one.at.as_millis() / 1_000)
        .collect();
    let apart = at.iter().map(|one| one - at[0]).collect();
    (apart, at[0], found.notes.join("; "))
}

/// 1,795,773,600 s by `date -u -d '2026-11-27 10:00:00' +%s`. A zone is subtracted, and a log that
/// changes its zone stays in order; only times without a zone are local ones.
#[test]
fn a_zone_counts() {
    const AT: u64 = 1_795_773_600;
    for (first, second, is_local) in [
        (
            "2026-11-27T12:00:00.0+02:00",
            "2026-11-27T12:00:01.0+02:00",
            false,
        ),
        (
            "2026-11-27 12:00:00 +0200",
            "2026-11-27 11:00:01 +0100",
            false,
        ),
        (
            "[2026-11-27T10:00:00.0Z]",
            "[2026-11-27T10:00:01.0Z]",
            false,
        ),
        (
            "2026-11-27T05:00:00-05:00 pi x:",
            "2026-11-27T05:00:01-05:00 pi x:",
            false,
        ),
        ("2026-11-27 10:00:00.0", "2026-11-27 10:00:01.0", true),
    ] {
        let text = format!("{first} TX 10 5B 01\n{second} RX E5 AF\n");
        let (apart, begin, notes) = times(&text);
        assert_eq!((apart, begin), (vec![0, 1], AT), "{text}");
        assert_eq!(notes.contains("local times"), is_local, "{text}: {notes}");
    }
}

/// 10:00 on one day and 11:00 on the next are 25 hours apart, also from one year to the next.
#[test]
fn days_without_a_year_count() {
    for (first, second) in [
        ("Nov 27 10:00:00 pi", "Nov 28 11:00:00 pi"),
        ("Dec 31 10:00:00", "Jan  1 11:00:00"),
        ("11-27 10:00:00.000", "11-28 11:00:00.000"),
        ("27.11. 10:00:00", "28.11. 11:00:00"),
        ("[main] Nov 27 10:00:00", "[main] Nov 28 11:00:00"),
        ("Fri Nov 27 10:00:00 2026", "Sat Nov 28 11:00:00 2026"),
    ] {
        let text = format!("{first} TX: 10 5B 01\n{second} RX: E5 AF\n");
        assert_eq!(times(&text).0, [0, 25 * 3_600], "{text}");
    }
    // Times of several forms are left out, and a note says so.
    let (_, _, notes) = times("10:00:00.5 TX: 10 5B 01\nnext: RX: E5 AF\n");
    assert!(notes.contains("line 2 has no time"), "{notes}");
}

/// Lines half a second before midnight and after it, and one at 1:05:02 in the afternoon.
#[test]
fn a_clock_of_twelve_hours_may_have_a_date() {
    let at = |text: &str| prefix::split(text).0.at.expect("a time").0 / 1_000_000;
    let day = 24 * 3_600 * 1_000;
    let before = at("03/28/2026 11:59:59.500 PM RX E5");
    assert_eq!(before % day, day - 500);
    assert_eq!(at("03/29/2026 12:00:00.100 AM TX 10"), before + 600);
    let afternoon = (13 * 3_600 + 5 * 60 + 2) * 1_000;
    assert_eq!(at("[3/28/2026 1:05:02 PM] TX 10") % day, afternoon);
}

/// Brackets around pairs of digits; one character between them is the byte as text.
#[test]
fn bytes_in_brackets_are_whole() {
    let of = |text: &str| bracketed(text).map(|piece| (piece.bytes, piece.prefix.is_sent));
    for (text, expected) in [
        ("[01][02]", Some((vec![1, 2], Some(true)))),
        ("<01><02>", Some((vec![1, 2], Some(false)))),
        ("x: [01]", Some((vec![1], None))),
        ("x: 0 [30] . [14]", Some((vec![0x30, 0x14], None))),
        ("[01]", None),
        ("[01][02][zz]", None),
        ("[01][02][033]", None),
        ("[01][02] words", None),
        ("[01] ab [02]", None),
        ("words: none", None),
    ] {
        assert_eq!(of(text), expected, "{text}");
    }
}

/// All digits of a time are masked, also in brackets, if a word follows it and no byte.
#[test]
fn a_time_before_words_is_masked_as_a_whole() {
    let of = |text: &str| masked(text).replace(times::MASK, "*");
    assert_eq!(of("[12:11:23] word"), "[**:**:**] word");
    assert_eq!(of("12:11:23 word 12"), "**:**:** word 12");
    assert_eq!(of("12:11:23 AB"), "12:11:23 AB");
    assert_eq!(of("12:11:23.5 AB"), "**:**:**.* AB");
    assert_eq!(of("24 ms AB 12"), "** ms AB 12");
}

/// A text may follow bytes as an aside in brackets, or as the same number of characters; a byte
/// that cannot be read may not.
#[test]
fn a_tail_is_an_aside_or_the_text_of_the_bytes() {
    let found = ["", " ]})>'\"|.,;", " (x", " <x", " #x", " x"].map(is_aside);
    assert_eq!(found, [true, true, true, true, true, false]);
    for (tail, expected) in [
        (" 0", true),
        (" ??", true),
        (" 1G", true),
        (" 116", true),
        (" 1GG", false),
        (" G1", false),
        (" 1234", false),
        ("  0", false),
        ("0", false),
        ("", false),
    ] {
        assert_eq!(is_damaged(tail), expected, "{tail}");
    }
    let run = |len: usize, has_marks| Run {
        bytes: vec![7; len],
        has_marks,
        ..Run::default()
    };
    assert!(is_shown(" ab", &run(2, false)) && !is_shown(" abc", &run(2, false)));
    assert!(is_tail(" words", &run(3, false)) && !is_tail(" words", &run(2, false)));
    assert!(is_tail(" words", &run(1, true)) && !is_tail(" 0 x", &run(3, false)));
}

/// A log has two bytes or more, with a letter among their digits, marks, or both directions. Of
/// eight messages, one line may have no bytes. Each message has a direction or a time.
#[test]
fn a_log_is_no_text_with_some_digits() {
    let is = |text: &str| look(text.as_bytes()).is_some();
    assert!(is("rx: AB 20 30\n") && !is("rx: AB\n"));
    assert!(!is("rx: 10 20 30\nrx: 40 50 60\n") && is("rx: 10 20 30\ntx: 40 50 60\n"));
    assert!(is("rx: 10 20 30 40 50 60 70 AB\n") && !is("rx: 10 20 30 40 50 60 70 80 AB\n"));
    assert!(!is("rx: AB 20 30\nword: AB CD EF\n"));
    let both = |messages: usize, other: usize| {
        let text = "rx: 10 20 30\ntx: 40 50 60\n".repeat(messages / 2);
        is(&(text + &"words alone\n".repeat(other)))
    };
    assert!(both(8, 1) && !both(6, 1) && both(16, 2) && !both(14, 2));
}
