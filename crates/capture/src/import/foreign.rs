//! Known kinds of files that cannot be imported, each with the next step.

use std::path::Path;

use super::text::{lines, number, utf8};
use super::{raw, textlog};

/// A known kind of file.
struct Foreign {
    is: fn(&[u8], &str) -> bool,
    message: &'static str,
}

/// The next step for a file of a known kind that is no dump of a serial line.
pub(super) fn refusal(bytes: &[u8], path: &Path) -> Option<String> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    let extension = extension.unwrap_or_default().to_ascii_lowercase();
    let is = |foreign: &&Foreign| (foreign.is)(bytes, &extension);
    let found = FOREIGN.iter().find(is)?;
    Some(found.message.to_owned())
}

const fn foreign(is: fn(&[u8], &str) -> bool, message: &'static str) -> Foreign {
    Foreign { is, message }
}

const FOREIGN: &[Foreign] = &[
    foreign(
        |_, extension| extension == "sal",
        "this is a capture of Saleae Logic 2; in Logic 2 export the Async Serial analyzers \
         (Data > Export Table, hexadecimal) or the channels (File > Export Raw Data, CSV)",
    ),
    foreign(
        |bytes, extension| {
            extension == "logicdata"
                || has(&bytes[..bytes.len().min(64)], b"serialization::archive")
        },
        "this is a capture of Saleae Logic 1 (.logicdata); open it in Logic 1 and use Options > \
         Export data: CSV, all samples as times and channels",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"btsnoop\0"),
        "this is a Bluetooth HCI log (btsnoop); export the bytes of its serial channel: tshark -r \
         FILE -Y btrfcomm.data -T fields -e btrfcomm.data > bytes.hex, then import bytes.hex",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"\x89MCAP0\r\n"),
        "this is an MCAP file; export the capture as CSV or pcapng where it was recorded: hilrig \
         export CAPTURE -o FILE.csv",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"#ROSBAG") || bytes.starts_with(b"SQLite format 3\0"),
        "this is a ROS bag or a database; write the bytes of the serial topic to a file and import \
         that with --format raw",
    ),
    foreign(
        |bytes, extension| {
            let names = ["fst", "lxt", "lxt2", "vzt", "ghw"];
            names.contains(&extension) && !bytes.starts_with(b"$")
        },
        "this is a compressed waveform; convert it to VCD: fst2vcd FILE > FILE.vcd (or lxt2vcd, \
         vzt2vcd of GTKWave)",
    ),
    foreign(
        |bytes, extension| {
            bytes.starts_with(b"LOGG") || bytes.starts_with(b"MDF ") || extension == "blf"
        },
        "this is a log of Vector tools (.blf, .mf4); export the serial or LIN channel as text \
         there; hilrig has no CAN",
    ),
    foreign(
        |bytes, _| any_line(bytes, |line| line.starts_with(b";$FILEVERSION=")),
        "this is a trace of a CAN bus (PCAN), which has frames and no serial bytes; hilrig has no \
         CAN",
    ),
    foreign(
        |_, extension| ["dmslog", "dmslog8", "spm", "spml", "logx"].contains(&extension),
        "this is a session of a serial port monitor; export it there as text or CSV with bytes in \
         hex, then import that file",
    ),
    foreign(
        |_, extension| ["kvdat", "dwf3work", "dwf3logic", "la", "xlog"].contains(&extension),
        "this is a session of a logic analyzer's program; export the channels there as VCD or CSV, \
         then import that file",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"ULog\x01\x12\x35"),
        "this is a flight log (ULog) with values and no bytes of a line",
    ),
    foreign(
        |bytes, _| bytes.starts_with(&[0xA3, 0x95, 0x80, 0x80]),
        "this is a flight log (DataFlash) with values and no bytes of a line",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"{\\rtf") || bytes.starts_with(b"\xD0\xCF\x11\xE0"),
        "this is a document of an office program; save it as plain text or CSV, then import that",
    ),
    foreign(
        |bytes, _| {
            let text = utf8(&bytes[..bytes.len().min(1 << 16)]).trim_start();
            text.starts_with("peers:") && text.contains("packets:")
        },
        "this is Wireshark's YAML of a conversation; choose Show as Hex Dump there and save that, \
         or import the pcap file",
    ),
    foreign(
        |bytes, _| {
            let text = utf8(&bytes[..bytes.len().min(1 << 12)]);
            text.contains("<pdml") || text.contains("<psml")
        },
        "this is Wireshark's XML; import the pcap file itself",
    ),
    foreign(
        |bytes, _| is_levels(bytes),
        "these are levels of channels without times; export them with the times of the changes, or \
         name the rate in the first line: ; Samplerate: 1 MHz",
    ),
    foreign(
        |bytes, _| any_line(bytes, |line| line.starts_with(b"Acquisition with ")),
        "these are samples of sigrok-cli as text (-O bits, hex or ascii), eight of one channel a \
         byte; write them with -O csv, -O vcd or -o FILE.sr, then import that",
    ),
    foreign(
        |bytes, _| any_line(bytes, is_usbmon),
        "this is usbmon's text, which shows 32 bytes of a transfer at most; record with tcpdump -i \
         usbmon1 -w FILE.pcapng, then import that",
    ),
    foreign(
        |bytes, _| is_base64(bytes),
        "this looks like base64; decode it first: base64 -d FILE > bytes.bin, then --format raw",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"\xFD7zXZ\0"),
        "this file is compressed by xz; unpack it first: xz -dk FILE",
    ),
    foreign(
        |bytes, _| {
            bytes.starts_with(b"BZh") && bytes.get(4..10) == Some(b"\x31\x41\x59\x26\x53\x59")
        },
        "this file is compressed by bzip2; unpack it first: bzip2 -dk FILE",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"\x28\xB5\x2F\xFD"),
        "this file is compressed by zstd; unpack it first: zstd -dk FILE",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"7z\xBC\xAF\x27\x1C") || bytes.starts_with(b"Rar!\x1A\x07"),
        "this is a 7z or RAR archive; unpack it first: 7z x FILE",
    ),
    foreign(
        |bytes, _| bytes.get(257..262) == Some(b"ustar"),
        "this is a tar archive; unpack it first: tar -xf FILE",
    ),
    foreign(
        |bytes, _| all_lines(bytes, is_intel_hex),
        "this is a firmware image (Intel HEX), not the traffic of a line; if its content is wanted \
         all the same: objcopy -I ihex -O binary FILE FILE.bin, then --format raw",
    ),
    foreign(
        |bytes, _| all_lines(bytes, is_s_record),
        "this is a firmware image (S-records), not the traffic of a line; if its content is wanted \
         all the same: objcopy -I srec -O binary FILE FILE.bin, then --format raw",
    ),
    foreign(
        |bytes, _| bytes.starts_with(b"\x7FELF") || bytes.starts_with(b"MZ"),
        "this is a program, not the traffic of a line",
    ),
    foreign(
        |bytes, _| {
            let pictures = [
                &b"\x89PNG\r\n\x1A\n"[..],
                b"\xFF\xD8\xFF",
                b"GIF8",
                b"%PDF-",
            ];
            pictures.iter().any(|magic| bytes.starts_with(magic))
        },
        "this is a picture or a document; copy its hex text into a text file and import that",
    ),
    foreign(
        |bytes, _| {
            let head = utf8(&bytes[..bytes.len().min(64)])
                .trim_start()
                .to_ascii_lowercase();
            head.starts_with("<!doctype html") || head.starts_with("<html")
        },
        "this is a web page; copy its hex text into a text file and import that",
    ),
    foreign(
        |bytes, _| any_line(bytes, is_socat_text),
        "socat -v writes text, which does not show all bytes; record with socat -x -v",
    ),
    foreign(
        |bytes, _| any_line(bytes, raw::is_stamped) && !textlog::is_text(bytes),
        "tio wrote times between bytes that are no text: log without -t and import that with \
         --format raw",
    ),
    foreign(
        |bytes, _| any_line(bytes, is_other_annotation),
        "these are annotations of a sigrok decoder that is no UART; decode the line with -P \
         uart:baudrate=N:rx=CHANNEL --protocol-decoder-jsontrace, or import the .sr file",
    ),
    foreign(
        |bytes, _| any_line(bytes, is_candump),
        "this is a log of a CAN bus, which has frames and no serial bytes; hilrig has no CAN",
    ),
    foreign(
        |bytes, _| {
            let text = utf8(bytes).trim_start();
            text.starts_with('[') && text.contains("\"_source\"") && text.contains("\"layers\"")
        },
        "this is tshark's JSON; export the bytes instead: tshark -r FILE.pcapng -T fields -e \
         frame.time_epoch -e data.data > bytes.hex, or import the .pcapng",
    ),
];

pub(super) fn has(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

/// Number of lines that are checked.
const LINES: usize = 50;

fn any_line(bytes: &[u8], is: fn(&[u8]) -> bool) -> bool {
    lines(bytes).take(LINES).any(|line| is(line.text))
}

fn all_lines(bytes: &[u8], is: fn(&[u8]) -> bool) -> bool {
    let full = lines(bytes).filter(|line| !line.text.is_empty());
    let mut full = full.take(LINES).peekable();
    full.peek().is_some() && full.all(|line| is(line.text))
}

/// Names of channels, such as `D0`, above nothing but levels: without times.
fn is_levels(bytes: &[u8]) -> bool {
    let full = lines(bytes).map(|line| utf8(line.text).trim());
    let mut full = full.filter(|line| !line.is_empty());
    let cells = |line: &str| -> Vec<String> {
        let cells = line
            .split([',', ';', '\t'])
            .map(|cell| cell.trim().trim_matches('"'));
        cells.map(str::to_ascii_lowercase).collect()
    };
    let is_channel = |name: &String| {
        let prefixes = ["d", "ch", "channel ", "channel", "probe"];
        prefixes.iter().any(|prefix| {
            name.strip_prefix(prefix)
                .is_some_and(|n| number(n).is_some())
        })
    };
    let Some(names) = full
        .next()
        .map(cells)
        .filter(|names| names.iter().all(is_channel))
    else {
        return false;
    };
    let is_level = |cell: &String| cell == "0" || cell == "1";
    let mut rows = full.take(LINES).map(cells).peekable();
    let is_row = |row: Vec<String>| row.len() == names.len() && row.iter().all(is_level);
    rows.peek().is_some() && rows.all(is_row)
}

/// `:`, a length, as many bytes and five more, whose sum is 0.
fn is_intel_hex(text: &[u8]) -> bool {
    let bytes = utf8(text).strip_prefix(':').and_then(engine::hex::bytes);
    bytes.is_some_and(|bytes| {
        let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        bytes
            .first()
            .is_some_and(|&len| bytes.len() == usize::from(len) + 5)
            && sum == 0
    })
}

/// `S`, a digit, a length and as many bytes, whose sum is 255.
fn is_s_record(text: &[u8]) -> bool {
    let Some([b'S', b'0'..=b'9', rest @ ..]) = Some(text) else {
        return false;
    };
    engine::hex::bytes(utf8(rest)).is_some_and(|bytes| {
        let sum = bytes.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte));
        bytes
            .first()
            .is_some_and(|&len| bytes.len() == usize::from(len) + 1)
            && sum == 0xFF
    })
}

/// A header of socat in the middle of the output of `-v` alone: it follows the sent bytes directly.
fn is_socat_text(text: &[u8]) -> bool {
    let text = utf8(text);
    ["> 20", "< 20"].iter().any(|mark| {
        let place = text.find(mark);
        place.is_some_and(|at| at > 0 && text[at..].contains("  length="))
    })
}

/// `12-34 i2c-1: Start`, or without samples.
fn is_other_annotation(text: &[u8]) -> bool {
    let Some((head, _)) = utf8(text).split_once(": ") else {
        return false;
    };
    let decoder = match head.split_once(' ') {
        Some((range, decoder)) => {
            let ends = range.split_once('-');
            let are = |(from, to)| number(from).is_some() && number(to).is_some();
            if !ends.is_some_and(are) {
                return false;
            }
            decoder
        }
        None => head,
    };
    let Some((name, number_of)) = decoder.rsplit_once('-') else {
        return false;
    };
    const DECODERS: [&str; 8] = [
        "i2c",
        "spi",
        "can",
        "lin",
        "onewire_link",
        "jtag",
        "swd",
        "ps2",
    ];
    DECODERS.contains(&name) && number(number_of).is_some()
}

/// `ffff88003a2c3c00 1234567890 S Bo:1:005:2 -115 5 = ab240a00 d9`.
fn is_usbmon(text: &[u8]) -> bool {
    let words: Vec<&str> = utf8(text).split_ascii_whitespace().collect();
    let [tag, time, event, address, ..] = words[..] else {
        return false;
    };
    let is_tag = tag.len() >= 8 && tag.bytes().all(|byte| byte.is_ascii_hexdigit());
    let starts = ["Bo:", "Bi:", "Co:", "Ci:", "Io:", "Ii:"];
    is_tag
        && number(time).is_some()
        && matches!(event, "S" | "C" | "E")
        && starts.iter().any(|start| address.starts_with(start))
}

/// Lines of base64 that are not hex.
fn is_base64(bytes: &[u8]) -> bool {
    let text = utf8(bytes);
    let full = || text.lines().map(str::trim).filter(|line| !line.is_empty());
    let digits = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'+' | b'/' | b'=');
    let is_long = full().next().is_some_and(|line| line.len() >= 16);
    let is_mixed = text
        .bytes()
        .any(|byte| byte.is_ascii_lowercase() && byte > b'f')
        && text.bytes().any(|byte| byte.is_ascii_uppercase())
        && text.bytes().any(|byte| byte.is_ascii_digit());
    let joined: usize = full().map(str::len).sum();
    is_long && is_mixed && joined.is_multiple_of(4) && full().all(|line| line.bytes().all(digits))
}

/// `(1436509052.249713) can0 123#DEADBEEF`, or ` can0  123   [2]  DE AD`.
fn is_candump(text: &[u8]) -> bool {
    let all: Vec<&str> = utf8(text).split_ascii_whitespace().collect();
    let all = match all[..] {
        [time, ref rest @ ..] if time.starts_with('(') && rest.len() > 2 => rest,
        ref all => all,
    };
    if let [bus, id, len, ..] = *all
        && bus.contains("can")
        && u32::from_str_radix(id, 16).is_ok()
        && len.starts_with('[')
        && len.ends_with(']')
    {
        return true;
    }
    let mut words = utf8(text).split_ascii_whitespace();
    let (Some(time), Some(_), Some(frame), None) =
        (words.next(), words.next(), words.next(), words.next())
    else {
        return false;
    };
    let is_time = time.starts_with('(') && time.ends_with(')') && time.contains('.');
    let is_hex = |text: &str| text.bytes().all(|byte| byte.is_ascii_hexdigit());
    is_time
        && frame
            .split_once('#')
            .is_some_and(|(id, data)| is_hex(id) && is_hex(data))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(bytes: &[u8], name: &str) -> String {
        refusal(bytes, Path::new(name)).unwrap_or_default()
    }

    /// Checksums by hand: 00+00+00+01+FF = 100; S9 03 00 00 FC sums to FF.
    #[test]
    fn firmware_images_are_no_traffic() {
        assert!(of(b":0100000000FF\r\n:00000001FF\r\n", "a.hex").contains("Intel HEX"));
        assert!(of(b"S9030000FC\n", "a.srec").contains("S-records"));
        assert_eq!(of(b":0100000000FE\n", "a.hex"), "");
        assert_eq!(of(b"", "a.hex"), "");
    }

    #[test]
    fn a_known_file_names_its_next_step() {
        for (bytes, name, step) in [
            (&b"x"[..], "run.sal", "Export Table"),
            (b"x", "run.LOGICDATA", "Options > Export data"),
            (b"btsnoop\0\0\0\0\x01", "a.log", "tshark"),
            (b"\x89MCAP0\r\n", "a.mcap", "hilrig export"),
            (b"\xFD7zXZ\0", "a.xz", "xz -dk"),
            (b"\x28\xB5\x2F\xFD", "a.zst", "zstd -dk"),
            (b"\x01\x02", "a.fst", "fst2vcd"),
            (b"\x7FELF", "a", "program"),
            (b"12-34 i2c-1: Start\n", "a.txt", "jsontrace"),
            (b"(1436509052.249713) can0 123#DEADBEEF\n", "a.log", "CAN"),
            (
                b"ATI> 2026/11/27 13:47:27.000193  length=5 from=0 to=4\n",
                "a",
                "-x -v",
            ),
            (b"[08:00:04.460] \xFA\n", "a", "without -t"),
            (b"  can0  123   [2]  DE AD\n", "a.log", "CAN"),
            (b"qyQKANkrJAoA2asq\n", "a.txt", "base64 -d"),
            (
                b"ffff88003a2c3c00 1234567890 S Bo:1:005:2 -115 5 = ab240a00 d9\n",
                "a.txt",
                "tcpdump -i usbmon1",
            ),
            (
                b"libsigrok 0.5.2\nAcquisition with 1/1 channels at 1 MHz\n0:ff ff 0f\n",
                "a.txt",
                "-O csv",
            ),
            (b"<!DOCTYPE html>\n", "a", "web page"),
        ] {
            let said = of(bytes, name);
            assert!(said.contains(step), "{name} {bytes:?}: {said}");
        }
        assert_eq!(of(b"$GPGGA,1,2\r\n", "a.nmea"), "");
        assert_eq!(of(b"note: some text\n", "a.txt"), "");
    }
    #[test]
    fn lines_of_candump_are_known() {
        for text in [
            "(1436509052.249713) can0 123#DEADBEEF",
            "(1.5) can0 123#",
            "  can0  123   [2]  DE AD",
            "(1.5) vcan1 7FF [0]",
        ] {
            assert!(is_candump(text.as_bytes()), "{text}");
        }
        for text in [
            "1436509052.249713 can0 123#DE",
            "(1436509052) can0 123#DE",
            "(1.5) can0 12x#DE",
            "(1.5) can0 123#DX",
            "(1.5) can0 123#DE more",
            "can0 123 2 DE AD",
            "can0 xyz [2] DE",
            "port 123 [2] DE",
            "can0 123",
        ] {
            assert!(!is_candump(text.as_bytes()), "{text}");
        }
    }

    /// A head of socat's follows sent bytes on the same line, and has a length.
    #[test]
    fn text_of_socat_has_a_head_inside_a_line() {
        assert!(is_socat_text(
            b"x> 2026/11/27 13:47:27.000193  length=5 from=0 to=4"
        ));
        assert!(is_socat_text(
            b"x< 2026/11/27 13:47:27.000193  length=5 from=0 to=4"
        ));
        for text in [
            &b"> 2026/11/27 13:47:27.000193  length=5 from=0 to=4"[..],
            b"x> 2026/11/27 13:47:27.000193",
            b"x  length=5 from=0",
        ] {
            assert!(!is_socat_text(text), "{text:?}");
        }
    }

    /// Letters of both cases, digits, a whole number of fours, and a first line of sixteen.
    #[test]
    fn base64_has_letters_of_both_cases() {
        for text in [
            "qyQKANkrJAoA2asq",
            "qyQKANkrJAoA2asq\nqyQK\n",
            "qyQKANkrJAoA2a==",
            "qyQKANkr/+oA2asq",
        ] {
            assert!(is_base64(text.as_bytes()), "{text}");
        }
        for text in [
            "qyQKANkrJAoA2as",
            "qyQKANkrJAoA2asqq",
            "qyqkan1rjaoa2asq",
            "QYQKAN1RJAOA2ASQ",
            "qyQKANkrJAoAaasq",
            "abADANabaAaA2afa",
            "qyQKANkr JAoA2as",
            "qyQK\nqyQKANkrJAoA2asq",
        ] {
            assert!(!is_base64(text.as_bytes()), "{text}");
        }
    }

    /// Each part of a line of usbmon, of a record of a firmware image, and of an annotation.
    #[test]
    fn each_part_of_a_known_line_counts() {
        let usbmon = "ffff88003a2c3c00 1234567890 S Bo:1:005:2 -115 5 = ab";
        assert!(is_usbmon(usbmon.as_bytes()));
        assert!(is_usbmon(b"ffff8800 1 C Ii:1:005:2"));
        for (part, other) in [
            ("ffff88003a2c3c00", "ffff880"),
            ("ffff88003a2c3c00", "gfff88003a2c3c00"),
            ("1234567890", "12x"),
            (" S ", " X "),
            ("Bo:", "Xo:"),
        ] {
            let text = usbmon.replace(part, other);
            assert!(!is_usbmon(text.as_bytes()), "{text}");
        }
        // A sum of 0, or of 255; the length counts the bytes.
        assert!(is_intel_hex(b":0100000000FF") && !is_intel_hex(b"0100000000FF"));
        assert!(!is_intel_hex(b":0100000001FF") && !is_intel_hex(b":0200000000FE"));
        assert!(is_s_record(b"S9030000FC") && !is_s_record(b"SA030000FC"));
        assert!(!is_s_record(b"S9030000FB") && !is_s_record(b"S9040000FB"));
        assert!(!is_s_record(b"X9030000FC") && !is_s_record(b""));
        for text in ["12-34 i2c-1: Start", "spi-2: 01", "1-2 onewire_link-1: x"] {
            assert!(is_other_annotation(text.as_bytes()), "{text}");
        }
        for text in [
            "12-34 uart-1: FA",
            "12 i2c-1: Start",
            "a-34 i2c-1: Start",
            "12-b i2c-1: Start",
            "i2c-x: Start",
            "i2c: Start",
            "i2c-1 Start",
        ] {
            assert!(!is_other_annotation(text.as_bytes()), "{text}");
        }
    }

    /// Channels above nothing but levels, one for each channel.
    #[test]
    fn levels_without_times_have_the_names_of_channels() {
        for text in [
            "D0\n0\n1\n",
            "CH1,CH2\n0,1\n",
            "\"Probe1\"\n1\n",
            "channel 2\n0\n",
        ] {
            assert!(is_levels(text.as_bytes()), "{text}");
        }
        for text in [
            "D0\n",
            "D0\n2\n",
            "D0,D1\n0\n",
            "Dx\n0\n",
            "x0\n0\n",
            "",
            "D0,x\n0,1\n",
        ] {
            assert!(!is_levels(text.as_bytes()), "{text}");
        }
    }

    /// Each of the marks at the beginning of a file, and a mark that is not complete.
    #[test]
    fn a_mark_is_known_as_a_whole() {
        let tar = [&[b'x'; 257][..], b"ustar"].concat();
        for (bytes, step) in [
            (&b"BZh9\x31\x41\x59\x26\x53\x59"[..], "bzip2 -dk"),
            (b"7z\xBC\xAF\x27\x1C", "7z x"),
            (b"Rar!\x1A\x07", "7z x"),
            (b"MZ\x90", "a program"),
            (b"\x89PNG\r\n\x1A\n", "a picture"),
            (b"\xFF\xD8\xFF", "a picture"),
            (b"%PDF-1.4", "a picture"),
            (b"  <HTML>", "a web page"),
            (b"#ROSBAG V2.0", "bag"),
            (b"SQLite format 3\0", "bag"),
            (&tar, "tar -xf"),
        ] {
            let said = of(bytes, "a");
            assert!(said.contains(step), "{bytes:02X?}: {said}");
        }
        for bytes in [
            &b"BZh9\x31\x41\x59\x26\x53\x58"[..],
            b"7z\xBC\xAF\x27",
            b"xustar",
        ] {
            assert_eq!(of(bytes, "a"), "", "{bytes:02X?}");
        }
        let layers = "[{\"_source\": {\"layers\": {}}}]";
        assert!(of(layers.as_bytes(), "a.json").contains("tshark"));
        for part in ["[", "\"_source\"", "\"layers\""] {
            let text = layers.replacen(part, "x", 1);
            assert!(!of(text.as_bytes(), "a.json").contains("tshark"), "{text}");
        }
    }
}
