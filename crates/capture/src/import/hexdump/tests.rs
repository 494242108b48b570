use super::*;

/// Output of the tools for the same 37 bytes: xxd 2022-01-14, hexdump of util-linux 2.38.1, od of
/// coreutils 9.1, tshark 4.0.17 (`-x`). The first row occurs twice more, so that `*` appears.
fn source() -> Vec<u8> {
    let row = b"\xAB\x24\x0A\x00\xD9\xAB$ ab\x00\x01\x02\x03\x04\x05";
    [&row[..], row, b"ASCI\xFF"].concat()
}

fn bytes(text: &str) -> Result<Vec<u8>, String> {
    let rows = rows(text.as_bytes(), &mut Vec::new()).map_err(|error| error.to_string())?;
    let fit = chunks(&rows).map_err(|error| error.to_string())?;
    Ok(fit
        .chunks
        .into_iter()
        .flat_map(|chunk| chunk.bytes)
        .collect())
}

#[test]
fn every_layout_is_read_with_the_same_bytes() {
    for (name, text) in [
        (
            "xxd",
            "00000000: ab24 0a00 d9ab 2420 6162 0001 0203 0405  .$....$ ab......\n\
             00000010: ab24 0a00 d9ab 2420 6162 0001 0203 0405  .$....$ ab......\n\
             00000020: 4153 4349 ff                             ASCI.\n",
        ),
        (
            "xxd -g1 -c8",
            "00000000: ab 24 0a 00 d9 ab 24 20  .$....$ \n\
             00000008: 61 62 00 01 02 03 04 05  ab......\n\
             00000010: ab 24 0a 00 d9 ab 24 20  .$....$\n\
             00000018: 61 62 00 01 02 03 04 05  ab......\n\
             00000020: 41 53 43 49 ff           ASCI.\n",
        ),
        (
            "xxd -e",
            "00000000: 000a24ab 2024abd9 01006261 05040302  .$....$ ab......\n\
             00000010: 000a24ab 2024abd9 01006261 05040302  .$....$ ab......\n\
             00000020: 49435341       ff                    ASCI.\n",
        ),
        (
            "hexdump -C",
            "00000000  ab 24 0a 00 d9 ab 24 20  61 62 00 01 02 03 04 05  |.$....$ ab......|\n\
             *\n\
             00000020  41 53 43 49 ff                                    |ASCI.|\n\
             00000025\n",
        ),
        (
            "hexdump",
            "0000000 24ab 000a abd9 2024 6261 0100 0302 0504\n*\n\
             0000020 5341 4943 00ff                         \n0000025\n",
        ),
        (
            "od",
            "0000000 022253 000012 125731 020044 061141 000400 001402 002404\n*\n\
             0000040 051501 044503 000377\n0000045\n",
        ),
        (
            "od -t x1",
            "0000000 ab 24 0a 00 d9 ab 24 20 61 62 00 01 02 03 04 05\n*\n\
             0000040 41 53 43 49 ff\n0000045\n",
        ),
        (
            "od -A x -t x1z",
            "000000 ab 24 0a 00 d9 ab 24 20 61 62 00 01 02 03 04 05  >.$....$ ab......<\n*\n\
             000020 41 53 43 49 ff                                   >ASCI.<\n000025\n",
        ),
        (
            "od -A d -b",
            "0000000 253 044 012 000 331 253 044 040 141 142 000 001 002 003 004 005\n*\n\
             0000032 101 123 103 111 377\n0000037\n",
        ),
        (
            "od -t u1",
            "0000000 171  36  10   0 217 171  36  32  97  98   0   1   2   3   4   5\n*\n\
             0000040  65  83  67  73 255\n0000045\n",
        ),
        (
            "od -t d1",
            "0000000  -85   36   10    0  -39  -85   36   32   97   98    0    1    2    3    4    5\n\
             *\n0000040   65   83   67   73   -1\n0000045\n",
        ),
        (
            "od -c",
            "0000000 253   $  \\n  \\0 331 253   $       a   b  \\0 001 002 003 004 005\n*\n\
             0000040   A   S   C   I 377\n0000045\n",
        ),
        (
            "od -t x4",
            "0000000 000a24ab 2024abd9 01006261 05040302\n*\n0000040 49435341 000000ff\n0000045\n",
        ),
        (
            "hexdump -d",
            "0000000   09387   00010   43993   08228   25185   00256   00770   01284\n*\n\
             0000020   21313   18755   00255                                        \n0000025\n",
        ),
    ] {
        assert_eq!(look(text.as_bytes()), Some(Look::Surely), "{name}");
        assert_eq!(bytes(text), Ok(source()), "{name}");
    }
}

/// `xxd -b`, and packets of `tshark -x`, whose offsets begin again.
#[test]
fn binary_digits_and_packets_are_read() {
    let bits = "00000000: 01000001 11111111 00000000  A..\n";
    assert_eq!(bytes(bits), Ok(vec![0x41, 0xFF, 0]));
    let packets = "0000  ab 24 0a 00 d9                                    .$...\n\n\
                   0000  ab 24 84 09                                       .$..\n";
    let rows = rows(packets.as_bytes(), &mut Vec::new()).expect("rows");
    let fit = chunks(&rows).expect("packets");
    let chunks: Vec<&[u8]> = fit.chunks.iter().map(|chunk| &chunk.bytes[..]).collect();
    assert_eq!(chunks, [&b"\xAB\x24\x0A\x00\xD9"[..], b"\xAB\x24\x84\x09"]);
}

/// A text column that happens to look like hex is text, because it shows the same bytes.
#[test]
fn the_text_beside_the_bytes_is_no_data() {
    assert_eq!(bytes("00000000: 6162 6364  abcd\n"), Ok(b"abcd".to_vec()));
    assert_eq!(bytes("00000000: 6162 6364       \n"), Ok(b"abcd".to_vec()));
}

#[test]
fn damage_is_an_error_with_its_line() {
    let error = |text: &str| bytes(text).expect_err("damaged");
    let gap = error("00000000: ab24  .$\n00000004: 0a00  ..\n");
    assert!(
        gap.starts_with("line 1") && gap.contains("4 bytes up to the next"),
        "{gap}"
    );
    let back = error("00000004: ab24  .$\n00000002: 0a00  ..\n");
    assert!(
        back.contains("the offset is 0x2, the bytes before it end at 0x6"),
        "{back}"
    );
    let other = error("00000000: ab24  .$\n00000002: 0a61  .b\n");
    assert!(other.contains("line 2"), "{other}");
    let star = error("0000000 ab 24\n*\n0000005 0a\n0000006\n");
    assert!(star.contains("\"*\""), "{star}");
    assert!(error("0000000 ab24\n*\nffffffffffffffff 00\n").contains("line"));
    assert!(error("hello\n").contains("expected an offset"));
}

/// Eight rows of each tool, one of them damaged in each way: the others keep their bytes, and what
/// is lost is counted.
#[test]
fn a_damaged_row_costs_its_own_bytes() {
    let source: Vec<u8> = (0..128_u8).map(|n| n.wrapping_mul(37) ^ 0x5A).collect();
    let cells = |row: &[u8], group: usize| {
        let groups = row.chunks(group);
        let group = |group: &[u8]| group.iter().map(|byte| format!("{byte:02x}")).collect();
        groups.map(group).collect::<Vec<String>>().join(" ")
    };
    let text = |row: &[u8]| -> String {
        let shown = |byte: &u8| match byte {
            b' '..=b'~' => char::from(*byte),
            _ => '.',
        };
        row.iter().map(shown).collect()
    };
    let dumps: [(&str, Vec<String>); 4] = [
        ("xxd", {
            let row = |(n, row): (usize, &[u8])| {
                format!("{:08x}: {}  {}", 16 * n, cells(row, 2), text(row))
            };
            source.chunks(16).enumerate().map(row).collect()
        }),
        ("hexdump -C", {
            let row = |(n, row): (usize, &[u8])| {
                let halves = [&row[..8], &row[8..]].map(|half| cells(half, 1));
                format!("{:08x}  {}  |{}|", 16 * n, halves.join("  "), text(row))
            };
            source.chunks(16).enumerate().map(row).collect()
        }),
        ("od -t x1", {
            let row = |(n, row): (usize, &[u8])| format!("{:07o} {}", 16 * n, cells(row, 1));
            source.chunks(16).enumerate().map(row).collect()
        }),
        ("hexdump", {
            let word = |pair: &[u8]| format!("{:02x}{:02x}", pair[1], pair[0]);
            let row = |(n, row): (usize, &[u8])| {
                let words: Vec<String> = row.chunks(2).map(word).collect();
                format!("{:07x} {}", 16 * n, words.join(" "))
            };
            source.chunks(16).enumerate().map(row).collect()
        }),
    ];
    /// Damages a row; returns the result, and how many of the row's bytes are kept. Bytes before
    /// and behind the row are always kept.
    type Damage = fn(&str) -> (String, usize);
    let damages: [(&str, Damage); 5] = [
        ("missing", |_| (String::new(), 0)),
        ("cut behind four bytes", |row| {
            let digits = row.split_once(' ').expect("an offset").1;
            let mut count = 0;
            let is_eighth = |c: char| {
                count += usize::from(c.is_ascii_hexdigit());
                count == 8
            };
            let end = digits.find(is_eighth).expect("eight digits") + 1;
            (row[..row.len() - digits.len() + end].to_owned(), 4)
        }),
        ("a changed offset", |row| (row.replacen('0', "7", 1), 0)),
        ("no offset", |row| (row.replacen('0', "?", 1), 0)),
        ("no digit", |row| {
            let (offset, digits) = row.split_once(' ').expect("an offset");
            let first = digits.trim_start().chars().next().expect("a digit");
            (format!("{offset} {}", digits.replacen(first, "?", 1)), 0)
        }),
    ];
    for (tool, rows_of_it) in &dumps {
        for (name, damage) in &damages {
            for at in 1..8 {
                let mut lines = rows_of_it.clone();
                let (line, kept) = damage(&lines[at]);
                lines[at] = line;
                let dump = lines.join("\n") + "\n";
                let case = format!("{tool}, {name}, row {at}:\n{dump}");
                let mut expected = source.clone();
                expected.drain(16 * at + kept..16 * (at + 1));
                let found = rows(dump.as_bytes(), &mut Vec::new()).map_err(|e| e.to_string());
                let fit = found.and_then(|rows| chunks(&rows).map_err(|e| e.to_string()));
                let fit = fit.unwrap_or_else(|error| panic!("{case}{error}"));
                let bytes: Vec<u8> = fit
                    .chunks
                    .iter()
                    .flat_map(|one| one.bytes.clone())
                    .collect();
                assert_eq!(bytes, expected, "{case}");
                assert_eq!(look(dump.as_bytes()), Some(Look::Surely), "{case}");
                // The length of a dump whose last row is lost is unknown.
                if at < 7 {
                    let note = fit.losses.note().expect("a note");
                    let lost = format!("{} bytes are lost", 16 - kept);
                    assert!(note.contains(&lost), "{case}{note}");
                }
            }
        }
    }
    // A file that ends within a row, or within an offset.
    for (_, rows_of_it) in &dumps {
        let dump = rows_of_it.join("\n");
        let start = dump.rfind('\n').expect("rows") + 1;
        for end in start..dump.len() {
            let found =
                bytes(&dump[..end]).unwrap_or_else(|error| panic!("{}: {error}", &dump[..end]));
            let is_begun = found.len() >= 112 && source.starts_with(&found);
            assert!(is_begun, "{}: {} bytes", &dump[..end], found.len());
        }
    }
}

/// Guards against the loss of half a file as "one damaged row". Of two dumps in a file the second
/// one begins at another address, so all of its offsets are lower.
#[test]
fn many_rows_that_do_not_fit_are_an_error() {
    let rows = |from: usize| (0..20).map(move |n| format!("{:08x}: ab24  .$\n", from + 2 * n));
    let two: String = rows(0x1000).chain(rows(0x200)).collect();
    assert!(
        bytes(&two)
            .expect_err("two dumps")
            .contains("rows are missing")
    );
    // Far apart: no count overflows.
    let far = "00000000: ab24  .$\nfffffffffffffff0: ab24  .$\n";
    assert!(bytes(&far.repeat(3)).is_err());
}

/// An offset of a tebibyte, in a row of characters whose last blanks may be lost: it is no number
/// of blanks.
#[test]
fn a_damaged_offset_costs_no_memory() {
    let text = "0000000   a   b\n20000000000000   c\n";
    assert!(
        bytes(text)
            .expect_err("damaged")
            .contains("rows are missing")
    );
}

/// od's 0000040 is 32, hexdump's is 64. The last row distinguishes them if it is not full.
#[test]
fn repeated_rows_are_counted_by_the_tools_own_offsets() {
    let row = "0000000 24ab 000a abd9 2024 6261 0100 0302 0504\n*\n";
    let of_od = format!("{row}0000040 5341\n0000042\n");
    assert_eq!(bytes(&of_od).map(|bytes| bytes.len()), Ok(34));
    let of_hexdump = format!("{row}0000040 5341                                   \n0000042\n");
    assert_eq!(bytes(&of_hexdump).map(|bytes| bytes.len()), Ok(66));
    let error = bytes(&format!("{row}0000040\n")).expect_err("either");
    assert!(error.contains("od -A x"), "{error}");
}

/// A row of decimal figures and a lone row prove nothing.
#[test]
fn other_text_is_no_dump() {
    for text in [
        "12345 67 89\n",
        "2026 11 27\n",
        "",
        "abcd\n",
        "1000 12\n1001 13\n",
    ] {
        assert_eq!(look(text.as_bytes()), None, "{text:?}");
    }
}

/// Rulers, prompts, words of a log, addresses and frames around the same rows.
#[test]
fn what_stands_around_the_rows_is_no_data() {
    for (name, text) in [
        (
            "Format-Hex of PowerShell",
            "           Path: C:\\a.bin\n\n\
             \x20          00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F\n\n\
             00000000   AB 24 0A 00 D9 AB 24 20 61 62 00 01 02 03 04 05  \u{ab}$..\u{d9}\u{ab}$ ab......\n\
             00000010   AB 24 0A 00 D9 AB 24 20 61 62 00 01 02 03 04 05  \u{ab}$..\u{d9}\u{ab}$ ab......\n\
             00000020   41 53 43 49 FF                                   ASCI\u{ff}\n",
        ),
        (
            "a prompt",
            "pi@host:~$ hexdump -C a.bin\n\
             00000000  ab 24 0a 00 d9 ab 24 20  61 62 00 01 02 03 04 05  |.$....$ ab......|\n\
             *\n00000020  41 53 43 49 ff                                    |ASCI.|\n\
             00000025\npi@host:~$\n",
        ),
        (
            "the kernel's print_hex_dump",
            "[   12.345678] uart: 00000000: ab 24 0a 00 d9 ab 24 20 61 62 00 01 02 03 04 05  .$....$ ab......\n\
             [   12.345678] uart: 00000010: ab 24 0a 00 d9 ab 24 20 61 62 00 01 02 03 04 05  .$....$ ab......\n\
             [   12.345679] uart: 00000020: 41 53 43 49 ff                                   ASCI.\n",
        ),
        (
            "ESP_LOG_BUFFER_HEXDUMP",
            "I (357) uart: 0x3ffb4280   ab 24 0a 00 d9 ab 24 20  61 62 00 01 02 03 04 05  |.$....$ ab......|\n\
             I (357) uart: 0x3ffb4290   ab 24 0a 00 d9 ab 24 20  61 62 00 01 02 03 04 05  |.$....$ ab......|\n\
             I (358) uart: 0x3ffb42a0   41 53 43 49 ff                                    |ASCI.|\n",
        ),
        (
            "x/16xb of gdb",
            "0x20000000 <buf>:\t0xab\t0x24\t0x0a\t0x00\t0xd9\t0xab\t0x24\t0x20\n\
             0x20000008 <buf+8>:\t0x61\t0x62\t0x00\t0x01\t0x02\t0x03\t0x04\t0x05\n\
             0x20000010 <buf+16>:\t0xab\t0x24\t0x0a\t0x00\t0xd9\t0xab\t0x24\t0x20\n\
             0x20000018 <buf+24>:\t0x61\t0x62\t0x00\t0x01\t0x02\t0x03\t0x04\t0x05\n\
             0x20000020 <buf+32>:\t0x41\t0x53\t0x43\t0x49\t0xff\n",
        ),
        (
            "hexyl",
            "\u{250c}\u{2500}\u{2500}\u{2510}\n\
             \u{2502}00000000\u{2502} ab 24 0a 00 d9 ab 24 20 \u{250a} 61 62 00 01 02 03 04 05 \u{2502}\u{d7}$_0\u{d7}\u{d7}$ \u{250a}ab0\u{2022}\u{2022}\u{2022}\u{2022}\u{2022}\u{2502}\n\
             \u{2502}*       \u{2502}                         \u{250a}                         \u{2502}        \u{250a}        \u{2502}\n\
             \u{2502}00000020\u{2502} 41 53 43 49 ff          \u{250a}                         \u{2502}ASCI\u{d7}   \u{250a}        \u{2502}\n\
             \u{2514}\u{2500}\u{2500}\u{2518}\n",
        ),
        (
            "od -t x1c",
            "0000000  ab  24  0a  00  d9  ab  24  20  61  62  00  01  02  03  04  05\n\
             \x20       253   $  \\n  \\0 331 253   $       a   b  \\0 001 002 003 004 005\n\
             *\n0000040  41  53  43  49  ff\n\x20         A   S   C   I 377\n0000045\n",
        ),
    ] {
        assert_eq!(bytes(text), Ok(source()), "{name}");
        assert_eq!(look(text.as_bytes()), Some(Look::Surely), "{name}");
    }
}

/// Heads with times and directions, as PuTTY's log of raw data and curl's trace have them; a
/// conversation as Wireshark shows it; packets with their headers.
#[test]
fn heads_tell_times_and_directions() {
    use crate::import::{Format, read as read_format};
    let told = |text: &str| {
        let found = read_format(text.as_bytes(), Format::Hexdump, &Options::default());
        let found = found.map_err(|error| error.to_string())?;
        let one = |one: &crate::Record| {
            let is_sent = one.direction == engine::rig::line::Direction::ToDevice;
            (is_sent, one.bytes.to_vec())
        };
        Ok::<_, String>(found.records().iter().map(one).collect::<Vec<_>>())
    };
    let expected = vec![
        (true, b"\xAB\x24\x0A".to_vec()),
        (false, b"\x00\xD9".to_vec()),
    ];
    for text in [
        "Outgoing raw data at 2026-11-27 12:11:23\n  00000000  ab 24 0a    .$.\n\
         Incoming raw data at 2026-11-27 12:11:24\n  00000000  00 d9    ..\n",
        "=~=~=~=~=~=~= PuTTY log 2026.11.27 12:11:23 =~=~=~=~=\r\n\
         Event Log: Opening serial device COM3\r\nEvent Log: Configuring baud rate 9600\r\n\
         Outgoing raw data at 2026-11-27 12:11:23\r\n  00000000  ab 24 0a    .$.\r\n\
         Incoming raw data at 2026-11-27 12:11:24\r\n  00000000  00 d9    ..\r\n",
        "=> Send data, 3 bytes (0x3)\n0000: ab 24 0a    .$.\n<= Recv data, 2 bytes (0x2)\n\
         0000: 00 d9    ..\n",
        "00000000  ab 24 0a                                          .$.\n\
         \x20   00000000  00 d9                                             ..\n",
    ] {
        assert_eq!(told(text), Ok(expected.clone()), "{text}");
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Hexdump));
    }
    let packet = "12:11:23.000501 IP a.1 > b.2: Flags [P.], length 4\n\
                  \t0x0000:  4500 002c 1234 4000 4006 0000 7f00 0001  E..,.4@.@.......\n";
    assert!(
        told(packet)
            .expect_err("headers")
            .contains("with their headers")
    );
    let lost = "0000  ab 24 0a 00\nwords\n0010  00 d9\n";
    assert!(told(lost).expect_err("lost").contains("rows are missing"));
}

/// The text column of a lone row has two bytes or more before it, behind offset 0.
#[test]
fn a_lone_row_needs_a_text() {
    for (offset, rest, expected) in [
        ("0000", " 41 42  A.", true),
        ("0000", " 41  A.", false),
        ("0010", " 41 42  A.", false),
        ("0000", " 41 42", false),
        ("0000", "", false),
    ] {
        assert_eq!(has_text(offset, rest), expected, "{offset} {rest}");
    }
}

/// Imports a dump: times in milliseconds from the first record, bytes, and notes.
fn imported(text: &str) -> (Vec<(u64, Vec<u8>)>, Vec<String>) {
    let mut out = Imported::new();
    read(text.as_bytes(), &Options::default(), &mut out).expect(text);
    let first = out.records().first().map_or(0, |one| one.at.as_millis());
    let records = out.records().iter();
    let records = records.map(|one| (one.at.as_millis() - first, one.bytes.to_vec()));
    (records.collect(), out.notes)
}

#[test]
fn a_dump_that_begins_later_is_noted() {
    let missing = |text: &str| {
        let notes = imported(text).1;
        notes.into_iter().find(|note| note.contains("begins at"))
    };
    let row = "ab24 0a00  .$..\n";
    assert_eq!(missing(&format!("00000000: {row}")), None);
    let note = "the dump begins at offset 16: the bytes before it are missing";
    assert_eq!(missing(&format!("00000010: {row}")).as_deref(), Some(note));
}

/// Each row of a log that begins a message has its own time, in milliseconds since the start.
#[test]
fn each_message_of_a_log_has_the_time_of_its_row() {
    let text = "I (100) uart: 0000: 0a 0b 0c 0d\nI (250) uart: 0000: 0e 0f 10 11\n";
    let expected = [(0, vec![10, 11, 12, 13]), (150, vec![14, 15, 16, 17])];
    assert_eq!(imported(text).0, expected);
    assert_eq!(words(&Row::Head("a".to_owned())), Some("a"));
    let row = |before: &str| Row::At {
        offset: String::new(),
        rest: String::new(),
        before: before.to_owned(),
        is_indented: false,
    };
    assert_eq!((words(&row("")), words(&row("b"))), (None, Some("b")));
}

/// The row before, repeated as often as it fits between both offsets.
#[test]
fn repeated_rows_fill_whole_rows() {
    let filled = |reached, offset, row: &[u8]| {
        let mut chunk = vec![9];
        fill(&mut chunk, reached, offset, row).map(|()| chunk)
    };
    assert_eq!(filled(2, 6, &[1, 2]), Ok(vec![9, 1, 2, 1, 2]));
    assert_eq!(filled(2, 2, &[1, 2]), Ok(vec![9]));
    assert!(filled(2, 5, &[1, 2]).is_err() && filled(6, 2, &[1, 2]).is_err());
    assert!(filled(0, 4, &[]).is_err());
}

/// A missing row between rows of a memory at a high address costs its sixteen bytes.
#[test]
fn a_missing_row_at_a_high_address_is_counted() {
    let row = |index: usize| {
        let at = 0x3FFB_4280_usize + 16 * index;
        let cells: String = (0..16)
            .map(|n| format!(" {:02x}", 16 * index + n))
            .collect();
        format!("{at:08x}: {cells}\n")
    };
    let text: String = (0..8).filter(|index| *index != 3).map(row).collect();
    let expected: Vec<u8> = (0..48).chain(64..128).collect();
    assert_eq!(bytes(&text), Ok(expected));
    let rows = rows(text.as_bytes(), &mut Vec::new()).expect("rows");
    let losses = chunks(&rows).expect("few losses").losses;
    assert_eq!((losses.rows, losses.bytes), (1, 16));
}

/// A full last row does not tell whether its offset is octal or hex.
#[test]
fn a_full_last_row_does_not_tell_the_offsets() {
    let row = "24ab 000a abd9 2024 6261 0100 0302 0504";
    let error = bytes(&format!("0000000 {row}\n*\n0000040 {row}\n")).expect_err("either");
    assert!(
        error.contains("may be octal (od) or hex (hexdump)"),
        "{error}"
    );
}

/// A row whose offset cannot be read is damage: the rows around it stay one message. Words before
/// offset 0 begin another message, also in a file with such a row.
#[test]
fn damage_begins_no_message() {
    let row = |at: usize| format!("{at:08x}: 41 42 43 44 45 46 47 48 49 4a 4b 4c 4d 4e 4f 50\n");
    let dump: String = (0..8).map(|index| row(16 * index)).collect();
    let messages = |text: &str| {
        let rows = rows(text.as_bytes(), &mut Vec::new()).expect("rows");
        let fit = chunks(&rows).expect("a dump");
        fit.chunks
            .iter()
            .map(|chunk| chunk.bytes.len())
            .collect::<Vec<_>>()
    };
    let damaged = dump.replacen("00000030", "?0000030", 1);
    assert_eq!(messages(&damaged), [112]);
    let two = format!("first\n{damaged}second\n{dump}");
    assert_eq!(messages(&two), [112, 128]);
}
