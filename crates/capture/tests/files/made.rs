//! Files made by the tools themselves.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::*;

/// The dumped bytes: every value, line ends, repeated rows, a short last row.
fn sample() -> Vec<u8> {
    let mut bytes = b"\n\r\n--\n> \xFA\xA0\0\0".to_vec();
    bytes.extend(0..=255);
    bytes.extend([7; 64]);
    bytes.extend(b"tail\xFF");
    bytes
}

/// Whether a tool is installed. CI must have it; elsewhere a visible message says that it is
/// missing.
fn has(tool: &str) -> bool {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path).any(|folder| folder.join(tool).is_file());
    if !found {
        assert!(std::env::var_os("CI").is_none(), "CI needs {tool}");
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED: files of {tool}: it is not installed"
        );
    }
    found
}

fn folder(name: &str) -> PathBuf {
    let name = format!("files-{name}-{}", std::process::id());
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&path);
    fs::create_dir_all(&path).expect("the target folder can be written");
    path
}

/// The output of a shell command in `folder`.
fn shell(folder: &Path, line: &str) -> Vec<u8> {
    let mut command = Command::new("sh");
    command
        .args(["-c", line])
        .current_dir(folder)
        .stdin(Stdio::null());
    let output = command.output().expect("a shell");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{line}: {said}");
    output.stdout
}

/// A tool, and commands that print a dump of src.bin.
const DUMPS: [(&str, &str); 38] = [
    ("xxd", "xxd src.bin"),
    ("xxd", "xxd -g1 -u src.bin"),
    ("xxd", "xxd -c 7 src.bin"),
    ("xxd", "xxd -e src.bin"),
    ("xxd", "xxd -b src.bin"),
    ("xxd", "xxd -p src.bin"),
    ("xxd", "xxd -i src.bin"),
    ("xxd", "xxd -i < src.bin"),
    ("xxd", "xxd -a src.bin"),
    ("xxd", "xxd -d src.bin"),
    ("hexdump", "hexdump -C src.bin"),
    ("hexdump", "hexdump src.bin"),
    ("hexdump", "hexdump -x src.bin"),
    ("hexdump", "hexdump -v -e '16/1 \"%02x \" \"\\n\"' src.bin"),
    (
        "hexdump",
        "hexdump -v -e '\"%08_ax  \" 16/1 \"%02X \" \"\\n\"' src.bin",
    ),
    ("od", "od src.bin"),
    ("od", "od -x src.bin"),
    ("od", "od -c src.bin"),
    ("od", "od -b src.bin"),
    ("od", "od -t x1 src.bin"),
    ("od", "od -t x1z -A x src.bin"),
    ("od", "od -A d -t u1 src.bin"),
    ("od", "od -A n -v -t x1 src.bin"),
    ("od", "od -A n -v -t u1 src.bin"),
    ("od", "od -A n -v -b src.bin"),
    ("od", "od -t x1 -c src.bin"),
    ("od", "od -t x8 src.bin"),
    ("hexyl", "hexyl --color never src.bin"),
    ("hexyl", "hexyl src.bin"),
    (
        "python3",
        "python3 -c \"print(open('src.bin','rb').read())\"",
    ),
    (
        "python3",
        "python3 -c \"print(list(open('src.bin','rb').read()))\"",
    ),
    (
        "python3",
        "python3 -c \"print(open('src.bin','rb').read().hex(' '))\"",
    ),
    (
        "python3",
        "python3 -c \"print(open('src.bin','rb').read().hex('-').upper())\"",
    ),
    (
        "python3",
        "python3 -c \"[print(bytes([b])) for b in open('src.bin','rb').read()]\"",
    ),
    ("hexdump", "hexdump -C src.bin | gzip"),
    ("zip", "od -t x1 src.bin > d.txt; zip -q - d.txt"),
    ("iconv", "xxd src.bin | sed 's/$/\\r/' | iconv -t UTF-16"),
    (
        "text2pcap",
        "od -A x -t x1 -v src.bin > d.txt; text2pcap -q -l 147 d.txt - 2>/dev/null",
    ),
];

#[test]
fn dumps_of_the_tools_are_read() {
    let folder = folder("dumps");
    fs::write(folder.join("src.bin"), sample()).expect("writable");
    let mut wrong = Vec::new();
    for (tool, line) in DUMPS {
        if !has(tool) {
            continue;
        }
        let dump = shell(&folder, line);
        match imported(&dump, "dump.txt", &Options::default()) {
            Ok(import) if import.told == received(&sample()) => {}
            Ok(import) => {
                let len = import.told.first().map_or(0, |one| one.1.len());
                wrong.push(format!("{line}: {:?}, {len} bytes", import.format));
            }
            Err(error) => wrong.push(format!("{line}: {error}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Levels of two lines at eight and two thirds samples a bit, with idle times that are no whole
/// number of bits.
fn logic() -> Vec<u8> {
    const BIT_NANOS: u64 = 1_000_000_000 / 115_200;
    let mut levels = vec![3_u8; 100];
    let mut at = 100_000;
    let mut until = |at: u64, level: u8| {
        while (levels.len() as u64) * 1_000 < at {
            levels.push(level);
        }
    };
    for (mask, bytes) in (0..3).flat_map(|_| [(2_u8, &ASK[..]), (1, &ANSWER[..])]) {
        for (index, &byte) in (0_u8..).zip(bytes) {
            let bits = (0..8).map(|bit| byte >> bit & 1 == 1);
            for bit in core::iter::once(false).chain(bits).chain([true]) {
                at += BIT_NANOS;
                until(at, if bit { 3 } else { 3 & !mask });
            }
            // Some characters have a pause before them.
            if index % 3 == 0 {
                at += 23_700;
                until(at, 3);
            }
        }
        at += 500_300;
        until(at, 3);
    }
    levels
}

/// The rate is derived although the idle times are no whole number of bits.
#[test]
fn traces_of_sigrok_are_read_without_a_rate() {
    if !has("sigrok-cli") {
        return;
    }
    let folder = folder("sigrok");
    fs::write(folder.join("logic.bin"), logic()).expect("writable");
    let raw = "sigrok-cli -I binary:numchannels=2:samplerate=1000000 -i logic.bin";
    shell(&folder, &format!("{raw} -o two.sr"));
    let uart = "-P uart:baudrate=115200:rx=0:tx=1";
    let decoded = format!("sigrok-cli -i two.sr {uart} -A uart=rx-data:tx-data");
    let turns = || (0..3).flat_map(|_| conversation()).collect::<Told>();
    for line in [
        "cat two.sr".to_owned(),
        "sigrok-cli -i two.sr -O vcd".to_owned(),
        "sigrok-cli -i two.sr -O csv".to_owned(),
        "sigrok-cli -i two.sr -O csv:time=true".to_owned(),
        format!("{decoded} --protocol-decoder-jsontrace"),
    ] {
        let file = shell(&folder, &line);
        let import = imported(&file, "file", &Options::default());
        let import = import.unwrap_or_else(|error| panic!("{line}: {error}"));
        assert_eq!(import.told, turns(), "{line}: {:?}", import.format);
        if !line.contains("jsontrace") {
            assert_eq!(import.bauds, [115_200], "{line}");
        }
        // The first byte ends ten bits after sample 100, at 86.8 us plus 100 us.
        assert!(
            import.times[0].abs_diff(186_800) < 12_000,
            "{line}: {}",
            import.times[0]
        );
    }
    for kind in ["bits", "hex", "ascii"] {
        let file = shell(&folder, &format!("sigrok-cli -i two.sr -O {kind}"));
        let error = imported(&file, "file", &Options::default()).expect_err("samples");
        assert!(error.contains("-O csv"), "{kind}: {error}");
    }
}

/// A trace of a program that writes to a terminal and reads the echo. Without the start of a
/// version manager, and with other files cut at 99 bytes, the log is a seventieth as long.
#[test]
fn a_trace_of_strace_is_read() {
    if !has("strace") || !has("python3") {
        return;
    }
    let folder = folder("strace");
    let program = "import os, tty, time\n\
                   a, b = os.openpty(); tty.setraw(a); tty.setraw(b)\n\
                   fd = os.open(os.ttyname(b), os.O_RDWR | os.O_NOCTTY)\n\
                   os.write(fd, bytes([1,3,0,0,0,2,0xC4,0x0B]))\n\
                   os.write(a, bytes([1,3,4,0,6,0,5,0xDA,0x31]))\n\
                   os.read(fd, 100)\n";
    fs::write(folder.join("p.py"), program).expect("writable");
    for options in [
        "-f -tt -xx -y",
        "-ttt -x",
        "-e trace=read,write,openat -yy -T -xx",
        "-r -x -f",
    ] {
        let line = format!(
            "strace -e trace=read,write,openat {options} -s 99 -o log \
             \"$(python3 -c 'import sys; print(sys.executable)')\" -I -S p.py >/dev/null 2>&1 \
             || true; cat log"
        );
        let log = shell(&folder, &line);
        if log.is_empty() {
            let _ = writeln!(std::io::stderr(), "SKIPPED: strace may not trace here");
            return;
        }
        let text = String::from_utf8_lossy(&log).into_owned();
        let fd = text
            .lines()
            .rfind(|line| line.contains("read(") && line.contains(", 100)"));
        let fd = fd.and_then(|line| line.split("read(").nth(1)?.split([',', '<']).next());
        let options_of = Options {
            channels: fd.map(str::to_owned).into_iter().collect(),
            ..Options::default()
        };
        let import = imported(&log, "log", &options_of);
        let import = import.unwrap_or_else(|error| panic!("{options}: {error}"));
        assert_eq!(import.told, conversation(), "{options}");
    }
}
