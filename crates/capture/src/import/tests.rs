//! Short samples of each tool's format, against times worked out by hand: at 10,000 baud a byte
//! takes a millisecond and its stop bit a tenth of one.

use super::imported::opposite;
use super::*;
use crate::{Kind, Record};
use engine::rig::line::Direction;
use protocols::LineEvent;

const MS: u64 = 1_000_000;
/// 2026-11-21 07:58:48, by `date -u`, in nanoseconds.
const MOMENT: u64 = 1_795_247_928_000_000_000;

fn options(baud: Option<u32>, sample_rate: Option<u64>) -> Options {
    Options {
        link: "port".to_owned(),
        baud,
        sample_rate,
        ..Options::default()
    }
}

/// Time, direction and bytes.
fn told(
    dump: &[u8],
    format: Format,
    options: &Options,
) -> Result<Vec<(u64, Direction, Vec<u8>)>, String> {
    let imported = read(dump, format, options).map_err(|error| error.to_string())?;
    let record = |one: &Record| (one.at.as_nanos(), one.direction, one.bytes.to_vec());
    Ok(imported.records().iter().map(record).collect())
}

/// Data bits that end with sample 6147 at 1 MHz end 6.147 ms after the start; the byte ends with
/// its stop bit. Without a baud rate, the stop bit has no length.
#[test]
fn a_byte_ends_behind_its_samples() {
    let dump = b"5313-6147 uart-1: FA\n6300-7000 uart-1: 0a\n";
    let at = |nanos, byte| (nanos, Direction::ToMaster, vec![byte]);
    let own = options(Some(10_000), Some(1_000_000));
    let expected = vec![at(6_147_000 + MS / 10, 0xFA), at(7_000_000 + MS / 10, 0x0A)];
    assert_eq!(told(dump, Format::Sigrok, &own), Ok(expected));
    let own = options(None, Some(24_000_000));
    let expected = vec![at(256_125, 0xFA), at(291_666, 0x0A)];
    assert_eq!(told(dump, Format::Sigrok, &own), Ok(expected));
    for rate in [None, Some(0)] {
        let error = told(dump, Format::Sigrok, &options(Some(9_600), rate)).expect_err("no rate");
        assert!(
            error.starts_with("line 1 (byte 0): sample numbers"),
            "{error}"
        );
    }
}

/// Without samples, bytes follow back to back; this needs the baud rate of the line.
#[test]
fn bytes_without_samples_stand_back_to_back() {
    let dump = b"uart-1: FA\n\nuart-1: 0A\n";
    let own = options(Some(10_000), None);
    let at = |nanos, byte| (nanos, Direction::ToMaster, vec![byte]);
    assert_eq!(
        told(dump, Format::Sigrok, &own),
        Ok(vec![at(MS, 0xFA), at(2 * MS, 0x0A)])
    );
    assert!(told(dump, Format::Sigrok, &options(None, None)).is_err());
}

/// A frame error removes the byte that ends where the error begins, and no other; a break is an
/// event.
#[test]
fn a_frame_error_is_said_of_the_byte_before() {
    let kinds = |dump: &[u8]| {
        let imported = read(
            dump,
            Format::Sigrok,
            &options(Some(10_000), Some(1_000_000)),
        );
        let imported = imported.expect("sound");
        let kinds = imported.records().iter().map(|one| one.kind);
        kinds.collect::<Vec<_>>()
    };
    let framing = Kind::Line(LineEvent::FramingError);
    let own = b"0-10 uart-1: 01\n10-20 uart-1: 02\n20-22 uart-1: Frame error\n";
    assert_eq!(kinds(own), [Kind::Data, framing]);
    let other = b"0-10 uart-1: 01\n21-22 uart-1: Frame error\n";
    assert_eq!(kinds(other), [Kind::Data, framing]);
    let broken = b"0-10 uart-1: Break condition\n10-12 uart-1: Frame error\n";
    assert_eq!(kinds(broken), [Kind::Line(LineEvent::Break), framing]);
    let error = told(
        b"uart-1: start\n",
        Format::Sigrok,
        &options(Some(10_000), None),
    );
    assert!(error.expect_err("no byte").contains("found \"start\""));
    let error = told(
        b"0-1 spi-1: 01\n",
        Format::Sigrok,
        &options(Some(10_000), None),
    );
    assert!(
        error
            .expect_err("no uart")
            .contains("expected \"FROM-TO uart-1: XX\"")
    );
}

/// The fraction is in microseconds, padded to nine digits, unless one is too large for this.
#[test]
fn blocks_of_socat_tell_both_directions() {
    let right = b"> 2026/11/21 07:58:48.000761120  length=3 from=0 to=2\n fa a0 0a   ...\n--\n";
    let left = b"< 2026/11/21 07:58:49.000000002  length=1 from=0 to=0\n 41\n--\n";
    let nanos = b"< 2026/11/21 07:58:49.001000000  length=1 from=0 to=0\n 42\n--\n";
    let own = options(None, None);
    let one = (
        MOMENT + 761_120_000,
        Direction::ToMaster,
        vec![0xFA, 0xA0, 0x0A],
    );
    let other = (MOMENT + 1_000_002_000, Direction::ToDevice, vec![0x41]);
    let both = [&right[..], b"socat: a word of its own\n", &left[..]].concat();
    assert_eq!(told(&both, Format::Socat, &own), Ok(vec![one, other]));
    let found = told(&[&left[..], &nanos[..]].concat(), Format::Socat, &own).expect("sound");
    assert_eq!(
        [found[0].0, found[1].0],
        [MOMENT + 1_000_000_002, MOMENT + 1_001_000_000]
    );
    let reversed = Options {
        direction: Direction::ToDevice,
        ..own.clone()
    };
    let found = told(&both, Format::Socat, &reversed).expect("sound");
    assert_eq!(
        [found[0].1, found[1].1],
        [Direction::ToDevice, Direction::ToMaster]
    );
    let error = |dump: &[u8]| told(dump, Format::Socat, &own).expect_err("unsound");
    // Without -v, no text follows the bytes, and all bytes are on one line.
    let plain =
        b"> 2026/11/21 07:58:48.000761120  length=20 from=0 to=19\n 00 01 02 03 04 05 06 07 \
                  08 09 0a 0b 0c 0d 0e 0f 10 11 12 13\n";
    let found = told(plain, Format::Socat, &own).expect("sound");
    assert_eq!(found[0].2, (0..20).collect::<Vec<u8>>());
    assert!(error(&plain[..90]).ends_with("the last block ends after 11 of 20 bytes"));
    assert!(error(b"> nonsense\n").contains("expected \"> YYYY/MM/DD"));
    let long = b"> 2026/11/21 07:58:48.000761120  length=1 from=0 to=2\n fa a0\n--\n";
    assert!(error(long).contains("expected 1 to 1 bytes"));
}

/// The port follows the colon; counter and text are options.
#[test]
fn blocks_of_jpnevulator_name_their_port() {
    let dump = b"2026-11-21 07:58:48.596918: A\n00000000\tFA A0 0A 41\t...A\nFB\n\
                 2026-11-21 07:58:49.000001:\n01\n2026-11-21 07:58:50.000000: B\n";
    let own = options(None, None);
    let imported = read(dump, Format::Jpnevulator, &own).expect("sound");
    let links: Vec<&str> = imported.links().iter().map(|link| &*link.name).collect();
    assert_eq!(links, ["A", "port", "B"]);
    let of = |at: usize| {
        let record = &imported.records()[at];
        (record.link, record.at.as_nanos(), record.bytes.to_vec())
    };
    assert_eq!(
        of(0),
        (0, MOMENT + 596_918_000, vec![0xFA, 0xA0, 0x0A, 0x41, 0xFB])
    );
    assert_eq!(of(1), (1, MOMENT + 1_000_001_000, vec![1]));
    assert_eq!(imported.records().len(), 2);
    assert!(told(b"FA\n", Format::Jpnevulator, &own).is_err());
    let seventeen = b"2026-11-21 07:58:48.596918: A\n01 02 03 04 05 06 07 08 09 10 11 12 13 14 15 \
                      16 17\n";
    assert!(told(seventeen, Format::Jpnevulator, &own).is_err());
}

/// Each record has sixteen bytes; its time is the end of the last one.
#[test]
fn bytes_alone_take_the_time_of_their_line() {
    let own = options(Some(10_000), None);
    let found = told(&[7; 20], Format::Raw, &own).expect("sound");
    let lens: Vec<(u64, usize)> = found.iter().map(|it| (it.0, it.2.len())).collect();
    assert_eq!(lens, [(16 * MS, 16), (20 * MS, 4)]);
    // An assumed rate is noted: 16 characters of ten bits at 115,200 baud are 1,388,888 ns.
    let assumed = read(&[7; 20], Format::Raw, &options(None, None)).expect("assumed");
    assert_eq!(assumed.records()[0].at.as_nanos(), 1_388_888);
    assert!(assumed.notes[0].contains("assumed 115200 baud"));
    let error = told(b"[08:00:04.460] hello\n", Format::Raw, &own).expect_err("stamped");
    assert!(error.contains("without -t"), "{error}");
    assert!(told(b"[08:00:04.46] hello\n", Format::Raw, &own).is_ok());
    let nothing = told(b"", Format::Raw, &own).expect_err("nothing");
    assert!(
        nothing.contains("expected bytes in the form of raw"),
        "{nothing}"
    );
}

#[test]
fn a_form_shows_in_its_first_lines() {
    let detected = |dump: &[u8]| Format::detect(dump).map(Format::name);
    assert_eq!(detected(b"word\n5313-6147 uart-1: FA\n"), Some("sigrok"));
    let block = b"> 2026/11/21 07:58:48.000761120  length=3 from=0 to=2\n";
    assert_eq!(detected(block), Some("socat"));
    assert_eq!(
        detected(b"2026-11-21 07:58:48.596918: A\n"),
        Some("jpnevulator")
    );
    assert_eq!(detected(b"nothing of the kind\n"), None);
    // Pairs of digits behind TX and RX are hex, also if few have a letter.
    let few = b"10:00:00.000 RX: 24 07 00 00 12 dd\n10:00:00.500 RX: 24 07 00 01 15 41\n";
    assert_eq!(detected(few), Some("hex"));
    let late = [&b"\n".repeat(50)[..], &block[..]].concat();
    assert_eq!(detected(&late), None);
    assert_eq!(detected(&late[1..]), Some("socat"));
    assert_eq!(opposite(Direction::ToDevice), Direction::ToMaster);
}

/// The marks of all formats, and why a file that looks like one is none.
#[test]
fn the_error_about_an_unknown_file_names_all_formats() {
    let words = looked_for(b"nothing");
    assert!(
        words.starts_with("this file has none of the forms"),
        "{words}"
    );
    for row in FORMATS {
        assert!(
            words.contains(row.name) && words.contains(row.mark),
            "{}",
            row.name
        );
    }
    let dump = looked_for(b"00000000: ab24  .$\n00000009: 0a00  ..\n");
    assert!(dump.contains("\nas a dump with offsets: line "), "{dump}");
    assert_eq!(hexdump::doubt(b"words\n"), None);
    // One and two digits may be decimal or hex; with letters there is no doubt about the base.
    let doubt = hextext::doubt(b"1 3 0 10").expect("two bases");
    assert!(doubt.contains("may be decimal or hex"), "{doubt}");
    assert!(looked_for(b"1 3 0 10").ends_with(&doubt));
    let none = [&b"AB 24"[..], b"", b"1 3 0 10 x", b"\xFF 1 3", b"10 20"].map(hextext::doubt);
    assert_eq!(none, [const { None }; 5]);
}

/// A file of this tool: its clock, its format, its links and its records.
#[test]
fn an_import_is_written_as_a_capture() {
    let found = read(
        b"[12:00:00.5] TX: AB 24\n",
        Format::Hex,
        &options(Some(9_600), None),
    );
    let file = found.expect("sound").to_pcapng(Format::Hex);
    let capture = crate::Capture::of(&file);
    let section = &capture.sections[0];
    let facts = ["imported", "clock"].map(|key| section.fact(key));
    assert_eq!(facts, [Some("hex"), Some("virtual")]);
    assert_eq!(
        (&*capture.links[0].name, capture.links[0].baud),
        ("port", 9_600)
    );
    assert_eq!(&capture.records[0].bytes[..], [0xAB, 0x24]);
}

/// Only socat writes its heads; pairs of digits could also come from a device.
#[test]
fn a_format_is_certain_if_only_its_tool_writes_it() {
    let of = |text: &str| {
        let opened = open(text.as_bytes(), Path::new("a.txt")).expect("no other kind");
        (opened.format, opened.is_certain)
    };
    let block = "> 2026/11/21 07:58:48.000761120  length=3 from=0 to=2\n fa a0 0a\n";
    assert_eq!(of(block), (Some(Format::Socat), true));
    assert_eq!(of("10 20 30\n"), (Some(Format::Hex), false));
    assert_eq!(of("nothing of the kind\n"), (None, false));
    // A line that is cut inside a byte does not change the format.
    let cut = "[12:00:00.5] TX: AB 24\n[12:00:00.6] RX: AB 24\n[12:00:00.7] TX: AB 24 0A 1\n";
    assert_eq!(of(cut), (Some(Format::Hex), true));
}
