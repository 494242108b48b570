//! Reads and writes of a port as strace shows them, ideally with -f -tt -xx -s 99999.
//!
//! ```text
//! 12:11:23.000501 write(3</dev/ttyUSB0>, "\xab\x24\x0a\x00\xd9", 5) = 5
//! [pid  1234] read(3, "\253$\n", 4096) = 3
//! 1234 <... read resumed>"\x31", 1) = 1
//! ```
//!
//! A descriptor belongs to one file from `open` to `close`. The port is the file that is a
//! terminal, by its path or by its calls; else the file that is both read and written; else the
//! only one that is open for both, or the only one of the log. A time is that of the beginning of
//! the call; for a resumed call, that of its end.

mod files;

use std::collections::BTreeMap;

use files::{Files, Opening};

use super::Look;
use super::hextext::escape;
use super::hextext::{Clock, Turns};
use super::imported::{ImportError, Imported, Options};
use super::text::{Line, decimal_nanos, lines, moment, number};
use crate::Kind;

/// One line of the log.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Call {
    pid: u64,
    at: Option<(u64, Clock)>,
    name: String,
    /// The file descriptor, and its path if the line contains it.
    fd: Option<u64>,
    path: Option<String>,
    bytes: Option<Vec<u8>>,
    /// Whether the text of the bytes ends with "...".
    is_cut: bool,
    result: Option<i64>,
    is_resumed: bool,
    is_unfinished: bool,
    /// The baud rate of a TCSETS.
    baud: Option<u32>,
    /// The path that -y prints behind the result.
    result_path: Option<String>,
    /// The two descriptors of a pipe.
    pair: Option<[u64; 2]>,
    words: Words,
}

/// Words of a call's arguments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Words {
    is_read_write: bool,
    is_terminal: bool,
    is_duplicate: bool,
    shares_files: bool,
}

impl Words {
    fn of(arguments: &str) -> Self {
        Self {
            is_read_write: arguments.contains("O_RDWR"),
            is_terminal: arguments.contains(", TC"),
            is_duplicate: arguments.contains("F_DUPFD"),
            shares_files: arguments.contains("CLONE_FILES"),
        }
    }
}

/// A transfer of a file.
struct Transfer<'a> {
    line: Line<'a>,
    nanos: Option<u64>,
    /// Index of the file.
    file: usize,
    is_read: bool,
    bytes: Vec<u8>,
    is_cut: bool,
}

/// The process and the time that a line begins with, and the rest.
fn head(text: &str) -> Option<(Call, &str)> {
    let mut call = Call::default();
    let mut rest = text.trim_start();
    if let Some((pid, behind)) = rest
        .strip_prefix("[pid")
        .and_then(|rest| rest.split_once(']'))
    {
        (call.pid, rest) = (number(pid.trim())?, behind.trim_start());
    }
    // A process id and a time, or one of them.
    for _ in 0..2 {
        let Some((word, behind)) = rest.split_once(' ') else {
            break;
        };
        if let Some(at) = time(word) {
            (call.at, rest) = (Some(at), behind.trim_start());
        } else if let Some(pid) = number(word).filter(|_| call.pid == 0) {
            (call.pid, rest) = (pid, behind.trim_start());
        } else {
            break;
        }
    }
    Some((call, rest))
}

fn call(text: &str) -> Option<Call> {
    let (mut call, rest) = head(text)?;
    let arguments = match rest.strip_prefix("<... ") {
        Some(resumed) => {
            let (name, behind) = resumed.split_once(" resumed>")?;
            (call.name, call.is_resumed) = (name.to_owned(), true);
            behind
        }
        None => {
            let (name, behind) = rest.split_once('(')?;
            let is_name =
                |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_';
            if name.is_empty() || !name.bytes().all(is_name) {
                return None;
            }
            call.name = name.to_owned();
            call.descriptor(behind);
            behind
        }
    };
    call.is_unfinished = arguments.contains("<unfinished ...>");
    if let Some((_, result)) = arguments.rsplit_once(" = ") {
        let word = result.split([' ', '<']).next();
        call.result = word.and_then(|word| word.parse().ok());
        call.result_path = shown_path(result.trim_start_matches(|c: char| c.is_ascii_digit()));
    }
    call.words = match call.name.as_str() {
        "read" | "write" => Words::default(),
        _ => Words::of(arguments),
    };
    call.pair = arguments.split_once('[').and_then(|(_, pair)| {
        let (first, second) = pair.split_once(']')?.0.split_once(", ")?;
        let fd = |text: &str| number(text.split('<').next()?);
        Some([fd(first)?, fd(second)?])
    });
    let is_transfer =
        ["read", "write", "pread64", "pwrite64", "readv", "writev"].contains(&call.name.as_str());
    if is_transfer || call.name.starts_with("open") || call.name == "creat" {
        call.data(arguments)?;
    }
    let rate = arguments.split_once("{B").filter(|_| call.name == "ioctl");
    call.baud = rate.and_then(|(_, rate)| {
        let end = rate.find(|c: char| !c.is_ascii_digit())?;
        rate[..end].parse().ok()
    });
    Some(call)
}

/// The path that -y prints behind a descriptor: `</dev/ttyUSB0>`, with -yy
/// `</dev/ttyUSB0<char 188:0>>`, with -xx each character as `\x2f`.
fn shown_path(text: &str) -> Option<String> {
    let (path, _) = text.strip_prefix('<')?.split_once('>')?;
    let path = path.split('<').next()?;
    let (mut bytes, mut chars) = (Vec::new(), path.chars());
    while let Some(c) = chars.next() {
        match c {
            '\\' => bytes.push(escape(&mut chars)?),
            c => bytes.extend_from_slice(c.encode_utf8(&mut [0; 4]).as_bytes()),
        }
    }
    Some(String::from_utf8_lossy(&bytes).into_owned())
}

/// `12:11:23.000501`, `12:11:23`, or seconds.
fn time(word: &str) -> Option<(u64, Clock)> {
    let (whole, fraction) = word.split_once('.').unwrap_or((word, "0"));
    if whole.contains(':') {
        let seconds = moment("1970-01-01", whole, '-')?;
        let nanos = seconds * 1_000_000_000 + decimal_nanos(&format!("0.{fraction}"))?;
        return Some((nanos, Clock::Day));
    }
    let nanos = decimal_nanos(word).filter(|_| word.contains('.'))?;
    Some((nanos, Clock::Seconds))
}

/// Times of the lines from the first one on, which may be distances (`strace -r`) or go past
/// midnight; notes about them.
fn times(bytes: &[u8], out: &mut Imported) -> BTreeMap<usize, u64> {
    let at = |line: Line<'_>| {
        let (head, _) = head(core::str::from_utf8(line.text).ok()?)?;
        Some((line.number, head.at?))
    };
    let all: Vec<(usize, (u64, Clock))> = lines(bytes).filter_map(at).collect();
    let Some((_, (_, clock))) = all.first().copied() else {
        return BTreeMap::new();
    };
    let nanos = || all.iter().map(|(_, (nanos, _))| *nanos);
    // Distances are never dates.
    const SINCE_2001: u64 = 1_000_000_000_000_000_000;
    let are_distances =
        clock == Clock::Seconds && !nanos().is_sorted() && nanos().all(|at| at < SINCE_2001);
    if are_distances {
        out.note("the times are taken as distances from the line before (strace -r)");
    }
    let (mut turns, mut sum) = (Turns::of(clock, nanos()), 0_u64);
    let times = all.iter().map(|&(line, (nanos, _))| {
        sum = sum.saturating_add(nanos);
        let at = if are_distances {
            sum
        } else {
            turns.nanos(nanos, line)
        };
        (line, at)
    });
    let times = times.collect();
    turns.note().into_iter().for_each(|note| out.note(note));
    times
}

impl Call {
    fn descriptor(&mut self, arguments: &str) {
        let end = arguments.find(|c: char| !c.is_ascii_digit()).unwrap_or(0);
        self.fd = number(&arguments[..end]);
        self.path = shown_path(&arguments[end..]);
    }

    /// Decodes the consecutive texts in quotes.
    fn data(&mut self, arguments: &str) -> Option<()> {
        let mut rest = arguments;
        while let Some((_, inside)) = rest.split_once('"') {
            let bytes = self.bytes.get_or_insert_default();
            let mut chars = inside.chars();
            loop {
                match chars.next()? {
                    '"' => break,
                    '\\' => bytes.push(escape(&mut chars)?),
                    c => bytes.push(u8::try_from(c).ok()?),
                }
            }
            rest = chars.as_str();
            self.is_cut |= rest.starts_with("...");
        }
        Some(())
    }
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let head = lines(bytes).take(400);
    let is_transfer = |line: &Line<'_>| {
        let call = core::str::from_utf8(line.text).ok().and_then(call);
        call.is_some_and(|call| {
            ["read", "write"].contains(&call.name.as_str())
                && call.bytes.is_some()
                && (call.result.is_some() || call.is_resumed || call.is_unfinished)
        })
    };
    (head.filter(is_transfer).count() > 0).then_some(Look::Surely)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let times = times(bytes, out);
    let (files, transfers) = transfers(bytes, &times);
    let chosen = chosen(&transfers, files.all(), options)?;
    // A port that was opened twice is one link.
    let name = |file: usize| files.all()[file].link();
    let is_one = chosen.iter().all(|&file| name(file) == name(chosen[0]));
    let mut links = BTreeMap::new();
    for &file in &chosen {
        let rates = chosen.iter().filter(|&&other| name(other) == name(file));
        let rate = rates.filter_map(|&other| files.all()[other].baud).next();
        let baud = options.baud.or(rate).unwrap_or(0);
        let link = match is_one {
            true => out.link_at(&options.link, baud),
            false => out.link_at(&name(file), baud),
        };
        links.insert(file, link);
    }
    note_others(&transfers, files.all(), &chosen, out);
    emit(&transfers, &links, options, out)
}

/// The files of the log, and all reads and writes with bytes.
fn transfers<'a>(bytes: &'a [u8], times: &BTreeMap<usize, u64>) -> (Files, Vec<Transfer<'a>>) {
    let mut files = Files::default();
    let mut started: BTreeMap<(u64, String), Call> = BTreeMap::new();
    let mut transfers: Vec<Transfer<'_>> = Vec::new();
    for line in lines(bytes) {
        let Some(mut call) = core::str::from_utf8(line.text).ok().and_then(call) else {
            continue;
        };
        if call.is_unfinished {
            started.insert((call.pid, call.name.clone()), call);
            continue;
        }
        if call.is_resumed
            && let Some(begun) = started.remove(&(call.pid, call.name.clone()))
        {
            call.fd = begun.fd;
            call.path = begun.path.or(call.path);
            call.bytes = begun.bytes.or(call.bytes);
            call.is_cut |= begun.is_cut;
            call.baud = begun.baud.or(call.baud);
            call.words = begun.words;
        }
        let is_read = call.name.contains("read");
        if !is_read && !call.name.contains("write") {
            files.follow(&call);
            continue;
        }
        let count = call.result.and_then(|count| usize::try_from(count).ok());
        let (Some(mut bytes), Some(count), Some(_)) = (call.bytes.take(), count, call.fd) else {
            continue;
        };
        let is_cut = call.is_cut && bytes.len() < count;
        bytes.truncate(count);
        if bytes.is_empty() {
            continue;
        }
        transfers.push(Transfer {
            line,
            nanos: times.get(&line.number).copied(),
            file: files.of_transfer(&call, &bytes),
            is_read,
            bytes,
            is_cut,
        });
    }
    (files, transfers)
}

/// The files that are ports.
fn chosen(
    transfers: &[Transfer<'_>],
    files: &[Opening],
    options: &Options,
) -> Result<Vec<usize>, ImportError> {
    let mut all: Vec<usize> = transfers.iter().map(|one| one.file).collect();
    all.sort_unstable();
    all.dedup();
    let only = |of: &[usize], is: &dyn Fn(usize) -> bool| -> Vec<usize> {
        of.iter().copied().filter(|&file| is(file)).collect()
    };
    if !options.channels.is_empty() {
        let names = &options.channels;
        let named = only(&all, &|file| {
            names.iter().any(|name| files[file].is_named(name))
        });
        let streams = only(&named, &|file| !files[file].is_seekable());
        return match (&named[..], &streams[..]) {
            ([], _) => Err(ImportError::of_file(
                "--channel: expected the number or the path of a file descriptor of the log",
            )),
            (_, []) => Ok(named),
            _ => Ok(streams),
        };
    }
    let own = only(&all, &|file| !files[file].is_standard());
    let ports = only(&own, &|file| files[file].is_port());
    if !ports.is_empty() {
        return Ok(ports);
    }
    let rest = match &own[..] {
        [] => all.clone(),
        _ => only(&own, &|file| !files[file].is_seekable()),
    };
    let has = |file: usize, is_read: bool| {
        let is_same = |one: &&Transfer<'_>| files[one.file].name() == files[file].name();
        let mut of = transfers.iter().filter(is_same);
        of.any(|one| one.is_read == is_read && !files[one.file].is_seekable())
    };
    let both = only(&rest, &|file| has(file, true) && has(file, false));
    let open_for_both = only(&rest, &|file| files[file].is_read_write());
    let candidates = [both, open_for_both, rest];
    let candidates = candidates.into_iter().find(|found| !found.is_empty());
    let candidates = candidates.unwrap_or_default();
    let first = candidates.first().map(|&file| files[file].name());
    if candidates
        .iter()
        .all(|&file| Some(files[file].name()) == first)
    {
        return Ok(candidates);
    }
    let mut labels: Vec<String> = all.iter().map(|&file| files[file].label()).collect();
    labels.sort_unstable();
    labels.dedup();
    let more = match labels.len().saturating_sub(LISTED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    labels.truncate(LISTED);
    let named = labels.join(", ");
    Err(ImportError::of_file(format!(
        "the file descriptor of the port is not clear: {named}{more}; --channel FD selects \
         one, or trace with strace -y, which prints the paths"
    )))
}

/// Maximum number of files that an error names.
const LISTED: usize = 8;
/// Maximum number of files that a note names.
const NAMED: usize = 3;

/// Notes the files that are left out, and the number of their bytes.
fn note_others(
    transfers: &[Transfer<'_>],
    files: &[Opening],
    chosen: &[usize],
    out: &mut Imported,
) {
    let mut others: Vec<(String, usize)> = Vec::new();
    for one in transfers.iter().filter(|one| !chosen.contains(&one.file)) {
        let name = files[one.file].name();
        match others.iter_mut().find(|(known, _)| *known == name) {
            Some((_, count)) => *count += one.bytes.len(),
            None => others.push((name, one.bytes.len())),
        }
    }
    if others.is_empty() {
        return;
    }
    let named = others.iter().take(NAMED);
    let named = named.map(|(name, count)| format!("{count} bytes of {name}"));
    let named = named.collect::<Vec<_>>().join(", ");
    let more = match others.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(", and {more} more files"),
    };
    out.note(format!("other files are left out: {named}{more}"));
}

fn emit(
    transfers: &[Transfer<'_>],
    links: &BTreeMap<usize, usize>,
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    out.clock = "virtual";
    let own = || {
        transfers
            .iter()
            .filter_map(|one| Some((one, *links.get(&one.file)?)))
    };
    if let Some((cut, _)) = own().find(|(one, _)| one.is_cut) {
        return Err(cut
            .line
            .wrong("strace cut these bytes (\"...\"): trace again with -s 99999"));
    }
    let is_timed = own().all(|(one, _)| one.nanos.is_some());
    if !is_timed {
        out.note("the log has no times: calls follow each other each millisecond; strace -tt");
    }
    for (index, (one, link)) in (0_u64..).zip(own()) {
        let nanos = match one.nanos.filter(|_| is_timed) {
            Some(nanos) => nanos,
            None => index * 1_000_000,
        };
        out.line = one.line.number;
        let way = options.way(one.is_read);
        out.push(link, nanos, way, Kind::Data, &one.bytes);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    fn told(text: &str) -> Result<Vec<(u64, bool, Vec<u8>)>, String> {
        let found = read_format(text.as_bytes(), Format::Strace, &Options::default());
        let found = found.map_err(|error| error.to_string())?;
        let one = |one: &crate::Record| {
            let is_sent = one.direction == Direction::ToDevice;
            (one.at.as_nanos() / 1_000, is_sent, one.bytes.to_vec())
        };
        Ok(found.records().iter().map(one).collect())
    }

    /// With -r, the times of all lines add up: the calls are 10 and 11 ms after the first one. With
    /// times of the day, a call comes 100 ms later, past midnight.
    #[test]
    fn times_are_distances_or_go_past_midnight() {
        let apart = |text: &str| {
            let found = told(text).expect("sound");
            found
                .iter()
                .map(|one| one.0 - found[0].0)
                .collect::<Vec<_>>()
        };
        let relative = "\
     0.000000 openat(AT_FDCWD, \"/dev/ttyUSB0\", O_RDWR) = 3
     0.005000 write(3, \"\\x01\\x03\", 2) = 2
     0.007000 --- SIGALRM {si_signo=SIGALRM} ---
     0.003000 read(3, \"\\x01\\x83\", 64) = 2
     0.001000 write(3, \"\\x01\\x03\", 2) = 2
";
        assert_eq!(apart(relative), [0, 10_000, 11_000]);
        let midnight = "\
23:59:59.950000 write(3, \"\\x01\\x03\", 2) = 2
00:00:00.050000 read(3, \"\\x01\\x83\", 64) = 2
";
        assert_eq!(apart(midnight), [0, 100_000]);
    }

    /// 12:11:23 is 43,883 s after midnight. The format is that of strace 6.1, with -xx and without.
    #[test]
    fn calls_of_the_port_are_read() {
        let text = "\
12:11:22.900000 openat(AT_FDCWD, \"\\x2f\\x64\\x65\\x76\\x2f\\x74\\x74\\x79\\x55\\x53\\x42\\x30\", O_RDWR) = 3
12:11:22.950000 ioctl(3, TCSETS, {B9600 -opost -isig -icanon -echo ...}) = 0
12:11:23.000501 write(3, \"\\xab\\x24\\x0a\\x00\\xd9\", 5) = 5
12:11:23.000600 write(1, \"\\x68\\x69\", 2) = 2
12:11:23.001000 read(3,  <unfinished ...>
12:11:23.002000 <... read resumed>\"\\xab$\\n\\0\\331\\\"\", 4096) = 6
12:11:23.003000 read(3, \"\", 4096) = 0
";
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Strace));
        let expected = vec![
            (43_883_000_501, true, vec![0xAB, 0x24, 0x0A, 0x00, 0xD9]),
            (
                43_883_002_000,
                false,
                vec![0xAB, 0x24, 0x0A, 0x00, 0xD9, 0x22],
            ),
        ];
        assert_eq!(told(text), Ok(expected));
    }

    /// Imports `text`; the bytes of all records in a row, and the notes.
    fn taken(text: &str, channel: Option<&str>) -> (Vec<u8>, Vec<String>) {
        let options = Options {
            channels: channel.into_iter().map(str::to_owned).collect(),
            ..Options::default()
        };
        let found = read_format(text.as_bytes(), Format::Strace, &options).expect("sound");
        let bytes = found.records().iter().flat_map(|one| one.bytes.to_vec());
        (bytes.collect(), found.notes.clone())
    }

    const LOADED: &str = "\
1.0 openat(AT_FDCWD, \"/lib/libc.so.6\", O_RDONLY|O_CLOEXEC) = 3
1.1 read(3, \"\\x7f\\x45\\x4c\\x46\"..., 832) = 832
";
    const MEASURED: &str = "\
2.0 openat(AT_FDCWD, \"/tmp/ports/meter\", O_RDWR|O_NOCTTY) = 3
2.1 write(3, \"\\xc0\\x01\", 2) = 2
2.2 read(3, \"\\xc0\", 1) = 1
2.3 write(1, \"ok\\n\", 3) = 3
";

    /// Descriptor 3 is libc, then the port, then a table; the cut read of libc is not the port's.
    #[test]
    fn a_descriptor_is_another_file_after_each_opening() {
        let after = "\
2.4 close(3) = 0
2.5 openat(AT_FDCWD, \"/tmp/table\", O_RDONLY) = 3
2.6 read(3, \"abcd\", 4096) = 4
";
        let (bytes, notes) = taken(&format!("{LOADED}{MEASURED}{after}"), None);
        assert_eq!(bytes, [0xC0, 0x01, 0xC0]);
        assert_eq!(
            notes,
            [
                "other files are left out: 4 bytes of /lib/libc.so.6, 3 bytes of file descriptor \
                 1, 4 bytes of /tmp/table"
            ]
        );
        // A log of reads and writes alone has neither openings nor closings.
        let of_transfers = |text: &str| -> String {
            let lines = text.lines().filter(|line| !line.contains("openat"));
            lines.map(|line| format!("{line}\n")).collect()
        };
        let (bytes, _) = taken(&of_transfers(&format!("{LOADED}{MEASURED}")), None);
        assert_eq!(bytes, [0xC0, 0x01, 0xC0]);
    }

    /// The number of a descriptor names the file of it that can be a port; a path names one file.
    #[test]
    fn a_channel_is_a_number_or_a_path() {
        let text = format!("{LOADED}{MEASURED}");
        assert_eq!(taken(&text, Some("3")).0, [0xC0, 0x01, 0xC0]);
        assert_eq!(taken(&text, Some("/tmp/ports/meter")).0, [0xC0, 0x01, 0xC0]);
        assert_eq!(taken(&text, Some("1")).0, *b"ok\n");
    }

    /// Descriptor 5 is a copy of the port; a child's own 3 is another file; a terminal call marks a
    /// port that is read only.
    #[test]
    fn copies_and_processes_keep_their_files() {
        let text = "\
7 1.0 openat(AT_FDCWD, \"/tmp/port\", O_RDONLY) = 3
7 1.1 ioctl(3, TCGETS, {B2400 opost}) = 0
7 1.2 dup(3) = 5
7 1.3 fork() = 8
8 1.4 close(3) = 0
8 1.5 openat(AT_FDCWD, \"/tmp/log\", O_RDWR) = 3
8 1.6 read(3, \"x\", 1) = 1
8 1.7 write(3, \"y\", 1) = 1
7 1.8 read(3, \"a\", 1) = 1
7 1.9 read(5, \"b\", 1) = 1
8 2.0 read(5, \"c\", 1) = 1
";
        assert_eq!(taken(text, None).0, *b"abc");
    }

    #[test]
    fn cut_bytes_and_unknown_ports_are_errors() {
        let cut = told("write(3, \"\\xab\"..., 40) = 40\n").expect_err("cut");
        assert!(
            cut.starts_with("line 1") && cut.contains("-s 99999"),
            "{cut}"
        );
        let two = "write(3, \"\\xab\", 1) = 1\nread(4, \"\\x24\", 1) = 1\n";
        let which = told(two).expect_err("two");
        assert!(
            which.contains("3, 4") && which.contains("--channel FD"),
            "{which}"
        );
        let paths = "write(3</dev/ttyS1>, \"\\xab\", 1) = 1\nread(4</tmp/a>, \"\\x24\", 1) = 1\n";
        assert_eq!(told(paths), Ok(vec![(0, true, vec![0xAB])]));
        // With -xx, "/dev/ttyS1" and "/tmp/a" are in hexadecimal digits.
        let hexadecimal = paths
            .replace(
                "/dev/ttyS1",
                "\\x2f\\x64\\x65\\x76\\x2f\\x74\\x74\\x79\\x53\\x31",
            )
            .replace("/tmp/a", "\\x2f\\x74\\x6d\\x70\\x2f\\x61");
        assert_eq!(told(&hexadecimal), Ok(vec![(0, true, vec![0xAB])]));
    }

    /// Eight of ten descriptors are named.
    #[test]
    fn a_long_list_of_descriptors_is_cut() {
        let text: String = (10..20)
            .map(|fd| format!("read({fd}, \"a\", 1) = 1\n"))
            .collect();
        let which = told(&text).expect_err("ten");
        assert!(
            which.contains("clear: 10, 11, 12, 13, 14, 15, 16, 17 and 2 more; --channel"),
            "{which}"
        );
    }

    /// Only standard streams transfer bytes: one of them may be the port. A channel that names no
    /// file is an error.
    #[test]
    fn a_standard_stream_may_be_the_port() {
        assert_eq!(taken("read(0, \"ab\", 2) = 2\n", None).0, *b"ab");
        let options = Options {
            channels: vec!["9".to_owned()],
            ..Options::default()
        };
        let text = "write(3, \"ab\", 2) = 2\nread(3, \"c\", 1) = 1\n";
        let error = read_format(text.as_bytes(), Format::Strace, &options).expect_err("none");
        assert!(error.message.contains("--channel: expected"), "{error}");
        // A file with positions is taken if it alone is named.
        let seekable = "pread64(3, \"ab\", 2, 0) = 2\n";
        assert_eq!(taken(seekable, Some("3")).0, *b"ab");
        // Bytes are cut at the count of the call, and not beyond the text.
        assert_eq!(taken("write(3, \"abc\"..., 3) = 3\n", None).0, *b"abc");
        assert_eq!(taken("write(3, \"abcd\", 4) = 3\n", None).0, *b"abc");
    }

    /// Bytes of one file are added up; the beginning of a call may be cut.
    #[test]
    fn bytes_of_other_files_are_added_up() {
        let text = format!("{MEASURED}2.4 write(1, \"more\\n\", 5) = 5\n");
        let notes = taken(&text, None).1;
        assert_eq!(
            notes,
            ["other files are left out: 8 bytes of file descriptor 1"]
        );
        let cut =
            "7 1.0 write(3, \"\\xab\"..., 40 <unfinished ...>\n7 1.1 <... write resumed>) = 40\n";
        let error = told(cut).expect_err("cut");
        assert!(error.contains("-s 99999"), "{error}");
    }

    /// Without openings and paths, the file that is both read and written is the port.
    #[test]
    fn a_file_that_is_read_and_written_is_the_port() {
        let both = "write(3, \"\\x01\", 1) = 1\nread(3, \"\\x02\", 1) = 1\n";
        let other = "read(5, \"x\", 1) = 1\n";
        assert_eq!(taken(&format!("{both}{other}"), None).0, [1, 2]);
        assert_eq!(taken(&format!("{other}{both}"), None).0, [1, 2]);
        // A file with positions is none.
        let seekable = "pread64(7, \"ab\", 2, 0) = 2\npwrite64(7, \"ab\", 2, 0) = 2\n";
        assert_eq!(taken(&format!("{seekable}{both}"), None).0, [1, 2]);
        assert!(told(&format!("{seekable}{other}write(6, \"y\", 1) = 1\n")).is_err());
    }

    /// The name of a call has small letters, digits and lines.
    #[test]
    fn a_call_has_a_name() {
        let name = |text: &str| call(text).map(|call| call.name);
        for (text, expected) in [
            ("dup2(3, 7) = 7", "dup2"),
            ("rt_sigaction(SIGINT) = 0", "rt_sigaction"),
            ("12 1.5 close(3) = 0", "close"),
            ("<... read resumed>\"x\", 1) = 1", "read"),
        ] {
            assert_eq!(name(text).as_deref(), Some(expected), "{text}");
        }
        for text in [
            "(3) = 1",
            "Read(3) = 1",
            "a b(3) = 1",
            "read 3",
            "<... read",
        ] {
            assert_eq!(name(text), None, "{text}");
        }
    }
}
