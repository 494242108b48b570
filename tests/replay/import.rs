//! Dumps of other tools: each dump comes from the tool itself if it is free software.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use hilrig::capture::import::{Format, Options, read};
use hilrig::capture::{Capture, Kind};
use hilrig::rig::line::Direction;
use proptest::prelude::*;
use protocols::{Instant, LineEvent};
use serialport::{SerialPort as _, TTYPort};

use crate::support::*;
use crate::tools::{has, printed};

/// Bytes that pass through each tool: every value, line ends, a lidar's packet head.
fn sample() -> Vec<u8> {
    let mut bytes = b"\n\r\n--\n> \xFA\xA0\0\0".to_vec();
    bytes.extend(0..=255);
    bytes
}

/// Bytes that the command imports from `dump`, separately for each direction.
fn imported(folder: &Path, dump: &str, more: &[&str]) -> [Vec<u8>; 2] {
    let arguments = [&["import", dump, "-o", "out.pcapng"][..], more].concat();
    let (status, said, error) = hilrig(folder, &arguments);
    assert_eq!(status.code(), Some(0), "{said}{error}");
    let capture = Capture::read(&folder.join("out.pcapng")).expect("written");
    [Direction::ToMaster, Direction::ToDevice].map(|way| crate::record::bytes(&capture, way))
}

/// socat passes bytes from left to right, `cat` sends them back.
#[test]
fn what_socat_dumped_is_imported_in_both_directions() {
    if !has("socat") {
        return;
    }
    let folder = folder("socat");
    let dump = File::create(folder.join("dump.txt")).expect("fresh");
    let mut socat = Command::new("socat");
    socat.args(["-x", "-v", "-", "SYSTEM:cat"]).stderr(dump);
    let socat = socat.stdin(Stdio::piped()).stdout(Stdio::null());
    let mut child = socat.spawn().expect("it is there");
    let mut input = child.stdin.take().expect("piped");
    input.write_all(&sample()).expect("it reads");
    drop(input);
    assert!(child.wait().expect("our own child").success());
    assert_eq!(imported(&folder, "dump.txt", &[]), [sample(), sample()]);
}

/// A pseudo-terminal in raw mode, and its path.
fn terminal() -> (TTYPort, TTYPort, String) {
    let (ours, theirs) = TTYPort::pair().expect("a pseudo-terminal");
    let path = theirs.name().expect("the far end has a path");
    (ours, theirs, path)
}

#[test]
fn what_jpnevulator_dumped_is_imported() {
    if !has("jpnevulator") {
        return;
    }
    let folder = folder("jpnevulator");
    for options in [&[][..], &["--ascii", "--byte-count"]] {
        let (mut ours, _theirs, path) = terminal();
        let dump = File::create(folder.join("dump.txt")).expect("fresh");
        let mut tool = Command::new("jpnevulator");
        tool.args(["--read", "--timing-print", "--timing-delta", "1000"]);
        let count = format!("--count={}", sample().len());
        tool.args(["--tty", &path, &count]).args(options);
        let child = tool.stdin(Stdio::null()).stdout(dump).spawn();
        let mut tool = Running(Some(child.expect("it is there")));
        ours.write_all(&sample()).expect("there is room");
        let child = tool.0.as_mut().expect("running");
        wait_until("the dump", || child.try_wait().expect("ours").is_some());
        let [received, sent] = imported(&folder, "dump.txt", &[]);
        assert_eq!((received, sent), (sample(), vec![]));
    }
}

/// The log contains the received bytes one by one; it is imported as raw bytes.
#[test]
fn what_tio_logged_is_imported() {
    if !has("tio") {
        return;
    }
    let folder = folder("tio");
    let log = folder.join("tio.log");
    let (mut ours, _theirs, path) = terminal();
    let mut tio = Command::new("tio");
    let file = format!("--log-file={}", log.display());
    tio.args(["--no-autoconnect", "--log", &file, &path]);
    let tio = tio.stdin(Stdio::piped()).stdout(Stdio::null());
    let tio = Running(Some(
        tio.stderr(Stdio::null()).spawn().expect("it is there"),
    ));
    // tio discards bytes from before its connection, and does not report the connection.
    wait_until("a first byte", || {
        ours.write_all(&[0x55; 64]).expect("there is room");
        fs::read(&log).is_ok_and(|log| !log.is_empty())
    });
    ours.write_all(&sample()).expect("there is room");
    // The log is written to the file when a buffer is full: further bytes flush it.
    let sample = sample();
    let found = || {
        let log = fs::read(&log).unwrap_or_default();
        log.windows(sample.len())
            .position(|window| window == sample)
    };
    wait_until("the log", || {
        ours.write_all(&[0xAA; 64]).expect("there is room");
        found().is_some()
    });
    let first = found().expect("it is there");
    drop(tio);
    let more = ["--format", "raw", "--baud", "115200"];
    let [received, _] = imported(&folder, "tio.log", &more);
    let (before, rest) = received.split_at(first);
    assert!(before.iter().all(|&byte| byte == 0x55));
    assert_eq!(rest[..sample.len()], sample);
    assert!(rest[sample.len()..].iter().all(|&byte| byte == 0xAA));
}

/// Levels of a line at 8 samples a bit: idle, then each byte with its stop bit at this level.
fn samples(bytes: &[(u8, u8)]) -> Vec<u8> {
    let mut levels = vec![1; 40];
    for &(byte, stop) in bytes {
        let bits = (0..8).map(|bit| byte >> bit & 1);
        for bit in core::iter::once(0).chain(bits).chain([stop]) {
            levels.extend([bit; 8]);
        }
        levels.extend([1; 20]);
    }
    levels
}

/// At 921,600 samples a second, a bit of 115,200 baud is 8 samples. The first stop bit ends 40 + 80
/// samples from the start, at 130,208 ns; a byte without stop bit is a framing error.
#[test]
fn what_sigrok_decoded_is_imported_with_its_times() {
    if !has("sigrok-cli") {
        return;
    }
    let folder = folder("sigrok");
    let levels = samples(&[(0xFA, 1), (0x0A, 1), (0x55, 0), (0x00, 1), (0xFF, 1)]);
    fs::write(folder.join("logic.bin"), levels).expect("writable");
    let mut sigrok = Command::new("sigrok-cli");
    sigrok.args(["-I", "binary:numchannels=1:samplerate=921600"]);
    sigrok.arg("-i").arg(folder.join("logic.bin"));
    sigrok.args(["-P", "uart:baudrate=115200:rx=0", "-A"]);
    sigrok.args(["uart=rx-data:rx-warnings", "--protocol-decoder-samplenum"]);
    fs::write(folder.join("dump.txt"), printed(&mut sigrok)).expect("writable");
    let more = ["--samplerate", "921600", "--baud", "115200"];
    let [received, _] = imported(&folder, "dump.txt", &more);
    assert_eq!(received, [0xFA, 0x0A, 0x00, 0xFF]);
    let capture = Capture::read(&folder.join("out.pcapng")).expect("written");
    let first = capture.records[0].at.as_nanos();
    assert!(first.abs_diff(130_208) <= 2, "{first}");
    assert_eq!(capture.records[2].kind, Kind::Line(LineEvent::FramingError));
    let no_rate = hilrig(
        &folder,
        &["import", "dump.txt", "-o", "x", "--baud", "115200"],
    );
    assert_eq!(no_rate.0.code(), Some(2));
    let expected = "error: dump.txt: line 1 (byte 0): sample numbers: expected --samplerate\n";
    assert_eq!(no_rate.2, expected);
}

/// Runs `program` with `arguments` in `folder` and writes its output to `dump.txt` there.
fn dumped(folder: &Path, program: &str, arguments: &[&str]) {
    let mut tool = Command::new(program);
    tool.args(arguments).current_dir(folder);
    fs::write(folder.join("dump.txt"), printed(&mut tool)).expect("writable");
}

/// Dumps of a file in every layout of these tools, in archives and in encodings of Windows.
#[test]
fn what_dump_tools_wrote_is_imported() {
    let folder = folder("dumps");
    let bytes = [&sample()[..], &[7; 64], b"tail\xFF"].concat();
    fs::write(folder.join("src.bin"), &bytes).expect("writable");
    let rows: [(&str, &[&str]); 20] = [
        ("xxd", &["src.bin"]),
        ("xxd", &["-g1", "-u", "-c", "8", "src.bin"]),
        ("xxd", &["-e", "src.bin"]),
        ("xxd", &["-b", "src.bin"]),
        ("xxd", &["-p", "src.bin"]),
        ("xxd", &["-i", "src.bin"]),
        ("hexdump", &["-C", "src.bin"]),
        ("hexdump", &["src.bin"]),
        ("hexdump", &["-b", "src.bin"]),
        ("hexdump", &["-c", "src.bin"]),
        ("hexdump", &["-d", "src.bin"]),
        ("hexdump", &["-o", "src.bin"]),
        ("od", &["src.bin"]),
        ("od", &["-t", "x1", "src.bin"]),
        ("od", &["-A", "x", "-t", "x1z", "src.bin"]),
        ("od", &["-c", "src.bin"]),
        ("od", &["-t", "u1", "src.bin"]),
        ("od", &["-t", "d1", "src.bin"]),
        ("od", &["-t", "x4", "src.bin"]),
        ("od", &["-A", "n", "-v", "-t", "x1", "src.bin"]),
    ];
    for (program, arguments) in rows.into_iter().filter(|(program, _)| has(program)) {
        dumped(&folder, program, arguments);
        let found = imported(&folder, "dump.txt", &[]);
        assert_eq!(found, [bytes.clone(), vec![]], "{program} {arguments:?}");
        let text = fs::read_to_string(folder.join("dump.txt")).expect("text");
        let windows = text.replace('\n', "\r\n");
        let wide = windows.encode_utf16().flat_map(u16::to_le_bytes);
        let wide: Vec<u8> = [0xFF, 0xFE].into_iter().chain(wide).collect();
        for text in [
            windows.clone().into_bytes(),
            [b"\xEF\xBB\xBF", windows.as_bytes()].concat(),
            wide,
        ] {
            fs::write(folder.join("dump.txt"), text).expect("writable");
            assert_eq!(
                imported(&folder, "dump.txt", &[])[0],
                bytes,
                "{program} {arguments:?}"
            );
        }
        if has("zip") && has("gzip") {
            let _ = fs::remove_file(folder.join("d.zip"));
            printed(
                Command::new("zip")
                    .args(["-q", "d.zip", "dump.txt"])
                    .current_dir(&folder),
            );
            assert_eq!(imported(&folder, "d.zip", &[])[0], bytes, "zip");
            printed(
                Command::new("gzip")
                    .args(["-kf", "dump.txt"])
                    .current_dir(&folder),
            );
            assert_eq!(imported(&folder, "dump.txt.gz", &[])[0], bytes, "gzip");
        }
    }
}

/// Packets from Wireshark's tools, of private link types; network packets are refused.
#[test]
fn what_wireshark_wrote_is_imported() {
    if !has("text2pcap") || !has("od") {
        return;
    }
    let folder = folder("wireshark");
    fs::write(folder.join("src.bin"), sample()).expect("writable");
    dumped(&folder, "od", &["-A", "x", "-t", "x1", "-v", "src.bin"]);
    for (link_type, kind) in [("147", "pcap"), ("162", "pcapng")] {
        let mut tool = Command::new("text2pcap");
        tool.args(["-q", "-F", kind, "-l", link_type, "dump.txt", "packets"]);
        printed(tool.current_dir(&folder));
        assert_eq!(imported(&folder, "packets", &[]), [sample(), vec![]]);
        let (status, said, _) = hilrig(&folder, &["decode", "packets", "--summary"]);
        assert_eq!((status.code(), said.is_empty()), (Some(0), false));
    }
    let mut tool = Command::new("text2pcap");
    printed(
        tool.args(["-q", "-l", "1", "dump.txt", "packets"])
            .current_dir(&folder),
    );
    for verb in [
        &["import", "packets", "-o", "x.pcapng"][..],
        &["decode", "packets"],
    ] {
        let (status, _, error) = hilrig(&folder, verb);
        assert_eq!(status.code(), Some(2));
        assert!(
            error.contains("Ethernet") && error.contains("tshark -r FILE"),
            "{error}"
        );
    }
}

/// Two lines of a logic analyzer: as sigrok's own session, as VCD, as CSV, as a trace. The rate is
/// derived from the pulses; sample 40 + 80 of 921,600 a second ends the first byte.
#[test]
fn what_a_logic_analyzer_saw_is_imported_with_both_directions() {
    if !has("sigrok-cli") {
        return;
    }
    let folder = folder("levels");
    let [rx, tx] = [b"lidar: 42 mm\n".to_vec(), b"start\n".to_vec()];
    let with_stop = |bytes: &[u8]| bytes.iter().map(|&byte| (byte, 1)).collect::<Vec<_>>();
    let (rx_levels, tx_levels) = (samples(&with_stop(&rx)), samples(&with_stop(&tx)));
    let levels = rx_levels
        .iter()
        .zip(tx_levels.iter().chain(core::iter::repeat(&1)));
    let levels: Vec<u8> = levels.map(|(rx, tx)| rx | tx << 1).collect();
    fs::write(folder.join("logic.bin"), levels).expect("writable");
    let sigrok = |arguments: &[&str]| {
        printed(
            Command::new("sigrok-cli")
                .args(arguments)
                .current_dir(&folder),
        )
    };
    let raw = "binary:numchannels=2:samplerate=921600";
    sigrok(&["-I", raw, "-i", "logic.bin", "-o", "two.sr"]);
    let write = |name: &str, arguments: &[&str]| {
        let all = [&["-i", "two.sr"][..], arguments].concat();
        fs::write(folder.join(name), sigrok(&all)).expect("writable");
    };
    write("two.vcd", &["-O", "vcd"]);
    write("two.csv", &["-O", "csv"]);
    let decoder = [
        "-P",
        "uart:baudrate=115200:rx=0:tx=1",
        "-A",
        "uart=rx-data:tx-data",
    ];
    write(
        "two.json",
        &[&decoder[..], &["--protocol-decoder-jsontrace"]].concat(),
    );
    for file in ["two.sr", "two.vcd", "two.csv", "two.json"] {
        assert_eq!(
            imported(&folder, file, &[]),
            [rx.clone(), tx.clone()],
            "{file}"
        );
        let capture = Capture::read(&folder.join("out.pcapng")).expect("written");
        let first = capture.records[0].at.as_nanos();
        // A trace contains the end of the data bits, a bit earlier.
        assert!(first.abs_diff(130_208) <= 9_000, "{file}: {first}");
    }
    let channel = ["--channel", "1", "--from", "program"];
    assert_eq!(
        imported(&folder, "two.sr", &channel),
        [vec![], tx],
        "one channel"
    );
    let (status, _, error) = hilrig(&folder, &["import", "two.sr", "-o", "x", "--baud", "9600"]);
    assert_eq!(status.code(), Some(2));
    assert!(error.contains("is no UART at 9600 baud"), "{error}");
}

/// The output of socat -x without -v, and of -v alone, which cannot be imported.
#[test]
fn what_socat_dumped_in_hex_alone_is_imported() {
    if !has("socat") {
        return;
    }
    let folder = folder("socat-x");
    for (option, is_read) in [("-x", true), ("-v", false)] {
        let dump = File::create(folder.join("dump.txt")).expect("fresh");
        let mut socat = Command::new("socat");
        socat.args([option, "-", "SYSTEM:cat"]).stderr(dump);
        let mut child = socat
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("there");
        let mut input = child.stdin.take().expect("piped");
        input.write_all(&sample()).expect("it reads");
        drop(input);
        assert!(child.wait().expect("our own child").success());
        if is_read {
            assert_eq!(imported(&folder, "dump.txt", &[]), [sample(), sample()]);
            continue;
        }
        let (status, _, error) = hilrig(&folder, &["import", "dump.txt", "-o", "x.pcapng"]);
        assert_eq!(status.code(), Some(2));
        assert!(error.contains("socat -x"), "{error}");
    }
}

/// A capture is exported as CSV and VCD and imported with the same bytes and directions.
#[test]
fn what_we_export_we_import() {
    let folder = folder("own-forms");
    let hex = "0.001 TX: AB 24 0A 00 D9\n0.002 RX: AB 24 84 09 09 00 01 0A 0D\n0.004 TX: 41 42\n";
    fs::write(folder.join("a.hex"), hex).expect("writable");
    let more = ["--baud", "115200", "--link", "base"];
    let before = imported(&folder, "a.hex", &more);
    fs::rename(folder.join("out.pcapng"), folder.join("a.pcapng")).expect("there");
    for file in ["b.csv", "b.vcd"] {
        let (status, _, error) = hilrig(&folder, &["export", "a.pcapng", "-o", file]);
        assert_eq!(status.code(), Some(0), "{error}");
        assert_eq!(
            imported(&folder, file, &["--baud", "115200"]),
            before,
            "{file}"
        );
        let capture = Capture::read(&folder.join("out.pcapng")).expect("written");
        assert_eq!(capture.links[0].name, "base", "{file}");
    }
}

/// Files of other known kinds, and damaged ones: each error has its next step, and no capture
/// remains.
#[test]
fn foreign_and_broken_files_are_refused_with_the_next_step() {
    let folder = folder("foreign");
    let saleae = "name,type,start_time,duration,data,error,ack,address,read\n\
                  \"I2C\",\"data\",0.0002,8e-05,0xA0,,true,,\n";
    for (name, content, step) in [
        ("a.sal", &b"PK\x05\x06"[..], "Export Table"),
        (
            "a.logicdata",
            b"\x16\0\0\0serialization::archive",
            "Export data",
        ),
        ("a.hex", b":0100000000FF\n:00000001FF\n", "objcopy"),
        ("a.xz", b"\xFD7zXZ\0abc", "xz -dk"),
        ("a.csv", saleae.as_bytes(), "--channel NAME"),
        ("b.txt", b"12-34 i2c-1: Start\n", "jsontrace"),
        (
            "c.txt",
            b"00000000: ab24  .$\n00000004: 0a00  ..\n",
            "--format",
        ),
        ("d.zip", b"PK\x03\x04cut", "copy it again"),
        (
            "e.vcd",
            b"$timescale 1 us $end $var wire 8 ! bus $end $enddefinitions $end",
            "one bit",
        ),
        ("f.json", b"{\"traceEvents\": [", "trace of sigrok-cli"),
        ("g.log", b"motor started at last\n", "--format raw"),
        ("h.pcap", b"\xD4\xC3\xB2\xA1\x02\0\x04\0", "no packets"),
    ] {
        fs::write(folder.join(name), content).expect("writable");
        let (status, _, error) = hilrig(&folder, &["import", name, "-o", "x.pcapng"]);
        assert_eq!(status.code(), Some(2), "{name}");
        assert!(error.contains(step), "{name}: {error}");
        assert!(!folder.join("x.pcapng").exists(), "{name}");
    }
}

fn options() -> Options {
    Options {
        link: "line".to_owned(),
        baud: Some(115_200),
        sample_rate: Some(1_000_000),
        ..Options::default()
    }
}

/// Records in a dump: time, direction, kind, bytes.
fn records(text: &str) -> Vec<(u64, Direction, Kind, Vec<u8>)> {
    let format = Format::detect(text.as_bytes()).expect("one of the known forms");
    let imported = read(text.as_bytes(), format, &options()).expect("sound");
    let records = imported.records().iter();
    let tuple = |r: &capture::Record| (r.at.as_nanos(), r.direction, r.kind, r.bytes.to_vec());
    records.map(tuple).collect()
}

/// Formats from the analyzer's source. The start of the byte is given; at 115,200 baud the byte
/// ends 86,805 ns later.
#[test]
fn saleaes_two_tables_are_imported() {
    let way = Direction::ToMaster;
    let old = "Time [s],Value,Parity Error,Framing Error\r\n0.000105,0xFA,,\r\n\
               0.000200,0x55,,Error\r\n0.000300,0x7,Error,\r\n";
    let expected = [
        (191_805, way, Kind::Data, vec![0xFA]),
        (286_805, way, Kind::Line(LineEvent::FramingError), vec![]),
        (386_805, way, Kind::Other(8), vec![]),
    ];
    assert_eq!(records(old), expected);
    let new = "name,type,start_time,duration,data,error\n\
               \"Async Serial\",\"data\",0.0001,8.6e-05,0xFA,\n\
               \"Async Serial\",\"data\",0.0002,8.6e-05,0x0A,framing\n";
    let expected = [
        (186_000, way, Kind::Data, vec![0xFA]),
        (286_000, way, Kind::Line(LineEvent::FramingError), vec![]),
    ];
    assert_eq!(records(new), expected);
}

/// The fraction is microseconds, padded to nine digits, as known gaps show. The dump begins
/// 1,795,247,928 s after the epoch, by `date -u`.
#[test]
fn socats_fraction_is_microseconds() {
    let text = "2026/11/21 07:58:48 socat[7] N starting data transfer loop\n\
                > 2026/11/21 07:58:48.000761120  length=3 from=0 to=2\n fa a0 0a\n--\n\
                < 2026/11/21 07:58:48.000761121  length=1 from=0 to=0\n 41      A\n--\n";
    let at = 1_795_247_928_761_120_000;
    let expected = [
        (at, Direction::ToMaster, Kind::Data, vec![0xFA, 0xA0, 0x0A]),
        (at + 1000, Direction::ToDevice, Kind::Data, vec![0x41]),
    ];
    assert_eq!(records(text), expected);
}

#[test]
fn an_error_in_a_dump_is_told_with_its_line_and_byte() {
    let folder = folder("import-errors");
    let says = |text: &str, more: &[&str]| {
        fs::write(folder.join("d.txt"), text).expect("writable");
        let arguments = [&["import", "d.txt", "-o", "x.pcapng"][..], more].concat();
        let (status, _, error) = hilrig(&folder, &arguments);
        assert_eq!(status.code(), Some(2), "{error}");
        assert!(!folder.join("x.pcapng").exists());
        error
    };
    let head = "> 2026/11/21 07:58:48.000761120  length=3 from=0 to=2\n";
    insta::assert_snapshot!(says(&format!("{head} fa a0 zz\n--\n"), &[]), @r#"error: d.txt: line 2 (byte 54): expected 1 to 3 bytes of two hex digits behind spaces, as socat -x writes (socat -v alone does not show all bytes)"#);
    insta::assert_snapshot!(says(&format!("{head} fa a0\n"), &[]), @r#"error: d.txt: line 2 (byte 54): the last block ends after 2 of 3 bytes"#);
    insta::assert_snapshot!(says("2026-11-21 07:58:50.596918: A\nFA A\n", &[]), @r#"error: d.txt: line 2 (byte 30): expected up to 16 bytes of two hex digits with a space between"#);
    insta::assert_snapshot!(says("uart-1: FA\nuart-1: \u{e9}\n", &["--baud", "9600"]), @r#"error: d.txt: line 2 (byte 11): found "\u{e9}", expected two hex digits: choose -A uart=rx-data"#);
    insta::assert_snapshot!(says("Time [s],Value\n0.1,250\n", &[]), @r#"error: d.txt: line 2 (byte 15): found value "250", expected hex as 0xFA: export in hexadecimal"#);
    insta::assert_snapshot!(says("[08:00:04.460] ab\n", &["--format", "raw"]), @r#"error: d.txt: line 1 (byte 0): tio wrote times between the bytes: expected its log without -t"#);
    let unknown = says("hello", &[]);
    assert!(
        unknown.starts_with("error: d.txt: this file has none of the forms"),
        "{unknown}"
    );
    for form in ["socat", "hexdump", "saleae", "--format raw --baud N"] {
        assert!(unknown.contains(form), "{form}: {unknown}");
    }
}

const FORMATS: [Format; 21] = [
    Format::Log,
    Format::SaleaeBinary,
    Format::Table,
    Format::Strace,
    Format::Tlog,
    Format::Text,
    Format::Socat,
    Format::Jpnevulator,
    Format::Interceptty,
    Format::Spy,
    Format::Hex,
    Format::Hexdump,
    Format::Pcap,
    Format::Sigrok,
    Format::Trace,
    Format::Sr,
    Format::Vcd,
    Format::Samples,
    Format::Saleae,
    Format::Csv,
    Format::Raw,
];

/// One valid dump of each format, to be damaged.
const SOUND: [&str; 19] = [
    "> 2026/11/21 07:58:48.000761120  length=4 from=0 to=3\n fa a0 0a   ...\n 41   A\n--\n",
    "2026-11-21 07:58:50.596918: A\n00000000\tFA A0 0A 41\t...A\n",
    "5313-6147 uart-1: FA\n6148-6150 uart-1: Frame error\nuart-1: 0A\n",
    "name,type,start_time,duration,data,error\n\"a\",\"data\",2026-11-21T07:58:50.5,1e-5,0xFA,\n",
    "[08:00:04.460] ab",
    "AB 24 0A 00 D9\n[0.5] TX: \\xAB\\x24\n",
    "00000000: ab24 0a00 d9ab 2420 6162  .$....$ ab\n*\n00000020: 41  A\n",
    "0000000 022253 000012 125731\n*\n0000014 051501\n0000016\n",
    "000000.000 TX   0000  AB 24 0A 00 D9      .$...\n000000.061 RTS  inactive\n",
    "[07:58 50.596918]< 41(A):54(T)\n< 0xab (.)\n> \t0x24 ($)\n",
    "{\"traceEvents\": [{\"ph\": \"E\", \"ts\": 5.0, \"pid\": \"uart-1\", \"tid\": \"TX\", \"name\": \"AB\"}]}",
    "$timescale 1 us $end $var wire 1 ! RX $end $enddefinitions $end\n#0 1!\n#5 0!\n#99 1!\n",
    "; Samplerate: 1 MHz\nlogic\n1\n0\n0\n1\nTime [s],RX\n0.1,1\n0.2,0\n",
    "time_s,link,direction,event,bytes,comment\r\n1.0,a,to-master,data,FAA0,\"b\nc\"\r\n",
    "[12:11:23][D][uart:114]: >>> 01:03:C4\n[12:11:24][D][uart:114]: <<< 01:03 (2 bytes)\n",
    "12:11:23.1 write(3</dev/ttyS0>, \"\\xab$\\n\\0\", 4) = 4\n7 <... read resumed>\"\", 9) = 0\n",
    "time_us;dir;data\n1;TX;AB 24\n2;RX;0A\n{\"ts\": 1, \"dir\": \"rx\", \"data\": [1, 2]}\n",
    "12:11:23.456 -> OK\r\n=~=~=~= PuTTY log 2026.11.27 12:11:23 =~=~\r\n",
    "Outgoing data at 12:11:23\n  00000000  ab 24 0a   .$.\n      00000000  00 d9   ..\n",
];

/// A dump of any content gives records, or an error with a position inside it.
fn judge(bytes: &[u8]) -> Result<(), TestCaseError> {
    for format in FORMATS {
        match read(bytes, format, &options()) {
            Ok(imported) => {
                let again = Capture::of(&imported.to_pcapng(format));
                prop_assert_eq!(&again.records, imported.records());
            }
            // A file without lines has a byte offset, if any.
            Err(error) if error.line == 0 => prop_assert!(error.offset <= bytes.len(), "{error}"),
            Err(error) => {
                prop_assert!(error.line >= 1 && error.offset <= bytes.len(), "{}", error);
                let before = &bytes[..error.offset];
                // A file without LF may end its lines with CR.
                let end = if bytes.contains(&b'\n') { b'\n' } else { b'\r' };
                let lines = before.iter().filter(|&&byte| byte == end).count();
                prop_assert_eq!(lines + 1, error.line);
            }
        }
    }
    let _ = Format::detect(bytes);
    Ok(())
}

proptest! {
    #![proptest_config(crate::thorough::cases(2000))]

    #[test]
    fn no_bytes_panic_an_importer(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        judge(&bytes)?;
    }

    /// Mostly valid text, which exercises more of the parsers than noise.
    #[test]
    fn no_damaged_dump_panics_an_importer(
        which in 0_usize..19,
        edits in prop::collection::vec((0_usize..200, 0_u8..4, any::<u8>()), 1..8),
    ) {
        let mut bytes = SOUND[which].repeat(2).into_bytes();
        for (place, kind, with) in edits {
            let place = place % bytes.len();
            match kind {
                0 if bytes.len() > 1 => { bytes.remove(place); }
                1 => bytes.insert(place, with),
                2 => bytes[place] = b"0123456789 :-\n"[usize::from(with) % 14],
                _ => bytes[place] = with,
            }
        }
        judge(&bytes)?;
    }
}

/// The longest times that a tool can write do not overflow.
#[test]
fn the_end_of_time_is_no_panic() {
    let texts = [
        "18446744073709551615-18446744073709551615 uart-1: FA\n",
        "Time [s],Value\n18446744073,0xFA\n",
        "> 2500/12/31 23:59:60.999999999  length=1 from=0 to=0\n fa\n--\n",
        "> 2026/11/21 07:58:48.1  length=18446744073709551615 from=0 to=0\n fa\n--\n",
    ];
    for text in texts {
        judge(text.as_bytes()).expect("an error, or records");
    }
    let at = Instant::from_nanos(u64::MAX);
    let rate = Options {
        sample_rate: Some(1),
        ..options()
    };
    let far = read(b"9-18446744073 uart-1: FA\n", Format::Sigrok, &rate).expect("just fits");
    assert!(far.records()[0].at < at);
}
