//! Reads and writes of a port as strace shows them, ideally with -f -tt -xx -s 99999.
//!
//! ```text
//! 12:11:23.000501 write(3</dev/ttyUSB0>, "\xab\x24\x0a\x00\xd9", 5) = 5
//! [pid  1234] read(3, "\253$\n", 4096) = 3
//! 1234 <... read resumed>"\x31", 1) = 1
//! ```
//!
//! The port is the file descriptor whose path is a terminal, from -y or from its `open`. Without a
//! path, the port is the only descriptor of the log. A time is that of the beginning of the call;
//! for a resumed call, that of its end.

use std::collections::BTreeMap;

use super::Look;
use super::hextext::escape;
use super::hextext::{Clock, Turns};
use super::imported::{ImportError, Imported, Options};
use super::roles::link_of_path;
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
}

/// A transfer of a descriptor.
struct Transfer<'a> {
    line: Line<'a>,
    nanos: Option<u64>,
    fd: u64,
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
    call.result = arguments.rsplit_once(" = ").and_then(|(_, result)| {
        let word = result.split([' ', '<']).next()?;
        word.parse().ok()
    });
    let is_transfer =
        ["read", "write", "pread64", "pwrite64", "readv", "writev"].contains(&call.name.as_str());
    if is_transfer || call.name.starts_with("open") {
        call.data(arguments)?;
    }
    let rate = arguments.split_once("{B").filter(|_| call.name == "ioctl");
    call.baud = rate.and_then(|(_, rate)| {
        let end = rate.find(|c: char| !c.is_ascii_digit())?;
        rate[..end].parse().ok()
    });
    Some(call)
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
        let path = arguments[end..].strip_prefix('<');
        self.path = path.and_then(|path| Some(path.split_once('>')?.0.to_owned()));
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

/// Whether a path is that of a terminal.
fn is_port(path: &str) -> bool {
    [
        "/dev/tty",
        "/dev/serial",
        "/dev/pts/",
        "/dev/cu",
        "/dev/rfcomm",
        "COM",
    ]
    .iter()
    .any(|start| path.starts_with(start))
        && path != "/dev/tty"
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
    let mut paths: BTreeMap<u64, String> = BTreeMap::new();
    let mut rates: BTreeMap<u64, u32> = BTreeMap::new();
    let mut started: BTreeMap<(u64, String), Call> = BTreeMap::new();
    let mut transfers: Vec<Transfer<'_>> = Vec::new();
    let times = times(bytes, out);
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
        }
        if call.name.starts_with("open") {
            let path = call.bytes.and_then(|bytes| String::from_utf8(bytes).ok());
            let fd = call.result.and_then(|fd| u64::try_from(fd).ok());
            paths.extend(fd.zip(path));
            continue;
        }
        let Some(fd) = call.fd else { continue };
        paths.extend(call.path.take().map(|path| (fd, path)));
        rates.extend(call.baud.map(|baud| (fd, baud)));
        let is_read = call.name.contains("read");
        let count = call.result.and_then(|count| usize::try_from(count).ok());
        let (Some(mut bytes), Some(count)) = (call.bytes, count) else {
            continue;
        };
        if !is_read && !call.name.contains("write") {
            continue;
        }
        let is_cut = call.is_cut && bytes.len() < count;
        bytes.truncate(count);
        transfers.push(Transfer {
            line,
            nanos: times.get(&line.number).copied(),
            fd,
            is_read,
            bytes,
            is_cut,
        });
    }
    transfers.retain(|one| !one.bytes.is_empty());
    let chosen = chosen(&transfers, &paths, options)?;
    // A port that was opened twice is one link.
    let (mut names, mut links) = (Vec::<String>::new(), Vec::new());
    for &fd in &chosen {
        let name = match (chosen.len(), paths.get(&fd)) {
            (1, _) => options.link.clone(),
            (_, Some(path)) => link_of_path(path),
            (_, None) => format!("fd-{fd}"),
        };
        let known = names.iter().position(|known| *known == name);
        links.push((fd, known.unwrap_or(names.len())));
        if known.is_none() {
            let baud = options.baud.or(rates.get(&fd).copied()).unwrap_or(0);
            out.link_at(&name, baud);
            names.push(name);
        }
    }
    emit(&transfers, &links, options, out)
}

/// The descriptors that are ports.
fn chosen(
    transfers: &[Transfer<'_>],
    paths: &BTreeMap<u64, String>,
    options: &Options,
) -> Result<Vec<u64>, ImportError> {
    let mut all: Vec<u64> = transfers.iter().map(|one| one.fd).collect();
    all.sort_unstable();
    all.dedup();
    let path = |fd: &u64| paths.get(fd).map_or("", String::as_str);
    if !options.channels.is_empty() {
        let is = |fd: &u64, name: &String| fd.to_string() == *name || path(fd) == name;
        all.retain(|fd| options.channels.iter().any(|name| is(fd, name)));
        return match all.is_empty() {
            true => Err(ImportError::of_file(
                "--channel: expected the number or the path of a file descriptor of the log",
            )),
            false => Ok(all),
        };
    }
    let ports: Vec<u64> = all.iter().copied().filter(|fd| is_port(path(fd))).collect();
    let others: Vec<u64> = all.iter().copied().filter(|&fd| fd > 2).collect();
    match (&ports[..], &others[..], &all[..]) {
        ([_, ..], _, _) => Ok(ports),
        (_, [_], _) => Ok(others),
        (_, [], [_]) => Ok(all),
        _ => {
            let named = all
                .iter()
                .map(|fd| format!("{fd} {}", path(fd)).trim_end().to_owned());
            let named = named.collect::<Vec<_>>().join(", ");
            Err(ImportError::of_file(format!(
                "the file descriptor of the port is not clear: {named}; --channel FD selects \
                 one, or trace with strace -y, which prints the paths"
            )))
        }
    }
}

fn emit(
    transfers: &[Transfer<'_>],
    links: &[(u64, usize)],
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    out.clock = "virtual";
    let link_of = |fd| {
        links
            .iter()
            .find(|(of, _)| *of == fd)
            .map(|(_, link)| *link)
    };
    let own = || transfers.iter().filter(|one| link_of(one.fd).is_some());
    if let Some(cut) = own().find(|one| one.is_cut) {
        return Err(cut
            .line
            .wrong("strace cut these bytes (\"...\"): trace again with -s 99999"));
    }
    let is_timed = own().all(|one| one.nanos.is_some());
    if !is_timed {
        out.note("the log has no times: calls follow each other each millisecond; strace -tt");
    }
    for (index, one) in (0_u64..).zip(own()) {
        let nanos = match one.nanos.filter(|_| is_timed) {
            Some(nanos) => nanos,
            None => index * 1_000_000,
        };
        out.line = one.line.number;
        out.push(
            link_of(one.fd).unwrap_or(0),
            nanos,
            options.way(one.is_read),
            Kind::Data,
            &one.bytes,
        );
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

    /// 10 and 11 ms after the start with -r, where each line counts; 100 ms past midnight.
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
    }
}
