//! Files of a traced program: a descriptor's number means another file after each close and open.

use std::collections::BTreeMap;

use super::Call;
use crate::import::roles::link_of_path;

/// A file from its opening to its closing.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Opening {
    /// Number of the first descriptor.
    pub(super) fd: u64,
    /// Path in the call that opened the file.
    path: Option<String>,
    /// Path that `strace -y` prints.
    shown: Option<String>,
    /// The baud rate of the last TCSETS.
    pub(super) baud: Option<u32>,
    is_read_write: bool,
    /// Whether a call that only terminals support succeeded.
    is_terminal: bool,
    /// Whether the file has positions (pread) or is a library: no serial port.
    is_seekable: bool,
}

impl Opening {
    fn path(&self) -> Option<&str> {
        self.shown.as_deref().or(self.path.as_deref())
    }

    /// Whether the option `--channel` names this file.
    pub(super) fn is_named(&self, name: &str) -> bool {
        self.fd.to_string() == name
            || [&self.path, &self.shown]
                .into_iter()
                .flatten()
                .any(|path| path == name)
    }

    /// Whether the program has inherited this standard stream.
    pub(super) fn is_standard(&self) -> bool {
        self.fd <= 2 && self.path.is_none()
    }

    pub(super) fn is_port(&self) -> bool {
        let paths = || [&self.path, &self.shown].into_iter().flatten();
        !self.is_seekable
            && !paths().any(|path| path == "/dev/tty")
            && (self.is_terminal || paths().any(|path| is_port(path)))
    }

    pub(super) const fn is_read_write(&self) -> bool {
        self.is_read_write
    }

    pub(super) const fn is_seekable(&self) -> bool {
        self.is_seekable
    }

    /// Name in messages: the number and the path, if known.
    pub(super) fn label(&self) -> String {
        format!("{} {}", self.fd, self.path().unwrap_or(""))
            .trim_end()
            .to_owned()
    }

    /// Name in a note.
    pub(super) fn name(&self) -> String {
        let path = self.path().map(str::to_owned);
        path.unwrap_or_else(|| format!("file descriptor {}", self.fd))
    }

    /// Name of the link; a port that was opened twice is one link.
    pub(super) fn link(&self) -> String {
        let path = self.path().map(link_of_path);
        path.unwrap_or_else(|| format!("fd-{}", self.fd))
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
}

/// Calls besides `open` whose result is a new descriptor.
const OPENING: [&str; 12] = [
    "socket",
    "accept",
    "accept4",
    "epoll_create",
    "epoll_create1",
    "eventfd",
    "eventfd2",
    "memfd_create",
    "timerfd_create",
    "signalfd4",
    "inotify_init1",
    "pidfd_open",
];

/// First bytes of a library or program.
const ELF: &[u8] = b"\x7fELF";

/// Descriptors of one process; `None` after a close.
type Table = BTreeMap<u64, Option<usize>>;

/// All files of the log and the descriptors of its processes.
#[derive(Debug, Default)]
pub(super) struct Files {
    openings: Vec<Opening>,
    tables: Vec<Table>,
    /// Table of each process; threads share one.
    table_of: BTreeMap<u64, usize>,
    /// The last file of each descriptor, for a thread whose creation is not in the log.
    latest: Table,
}

impl Files {
    pub(super) fn all(&self) -> &[Opening] {
        &self.openings
    }

    /// Follows a finished call that is no transfer.
    pub(super) fn follow(&mut self, call: &Call) {
        let result = call.result.and_then(|result| u64::try_from(result).ok());
        let (Some(result), name) = (result, call.name.as_str()) else {
            return;
        };
        match (name, call.fd) {
            ("close", Some(fd)) => self.close(call.pid, fd),
            ("dup" | "dup2" | "dup3", Some(_)) => self.duplicate(call, result),
            ("fcntl" | "fcntl64", Some(_)) if call.words.is_duplicate => {
                self.duplicate(call, result);
            }
            ("fork" | "vfork" | "clone" | "clone3", _) => {
                self.clone_table(call.pid, result, call.words.shares_files);
            }
            ("ioctl", Some(_)) => {
                let file = self.of(call);
                self.openings[file].is_terminal |= call.words.is_terminal;
                self.openings[file].baud = call.baud.or(self.openings[file].baud);
            }
            ("pipe" | "pipe2", _) => {
                for fd in call.pair.into_iter().flatten() {
                    self.open(call.pid, fd, Opening::default());
                }
            }
            _ if name.starts_with("open") || name == "creat" || OPENING.contains(&name) => {
                let path = call.bytes.clone().filter(|_| !OPENING.contains(&name));
                let opening = Opening {
                    path: path.and_then(|bytes| String::from_utf8(bytes).ok()),
                    shown: call.result_path.clone(),
                    is_read_write: call.words.is_read_write,
                    ..Opening::default()
                };
                self.open(call.pid, result, opening);
            }
            _ => {}
        }
    }

    /// File of a transfer.
    pub(super) fn of_transfer(&mut self, call: &Call, bytes: &[u8]) -> usize {
        let is_positioned = call.name.starts_with('p');
        let mut file = self.of(call);
        if !is_positioned && bytes.starts_with(ELF) && call.name == "read" {
            // The loader opens a library, reads its header first and closes it; a log of reads and
            // writes alone shows neither opening nor closing.
            if self.openings[file].path().is_none() {
                file = self.open(call.pid, call.fd.unwrap_or(0), Opening::default());
            }
            self.openings[file].is_seekable = true;
        } else if is_positioned {
            self.openings[file].is_seekable = true;
        } else if self.openings[file].is_seekable && self.openings[file].path().is_none() {
            file = self.open(call.pid, call.fd.unwrap_or(0), Opening::default());
        }
        file
    }

    /// File of the call's descriptor.
    fn of(&mut self, call: &Call) -> usize {
        let fd = call.fd.unwrap_or(0);
        let own = self.table(call.pid).get(&fd).copied().flatten();
        let known = own.or_else(|| self.latest.get(&fd).copied().flatten());
        let shown = call.path.as_ref();
        let is_other = |file: &usize| {
            let known = self.openings[*file].shown.as_ref();
            known.is_some() && shown.is_some() && known != shown
        };
        let file = match known.filter(|file| !is_other(file)) {
            Some(file) => file,
            None => self.open(call.pid, fd, Opening::default()),
        };
        if let Some(shown) = shown {
            self.openings[file].shown = Some(shown.clone());
        }
        file
    }

    fn table(&mut self, pid: u64) -> &mut Table {
        let next = self.tables.len();
        let table = *self.table_of.entry(pid).or_insert(next);
        if table == next {
            self.tables.push(Table::new());
        }
        &mut self.tables[table]
    }

    fn open(&mut self, pid: u64, fd: u64, opening: Opening) -> usize {
        let file = self.openings.len();
        self.openings.push(Opening { fd, ..opening });
        self.table(pid).insert(fd, Some(file));
        self.latest.insert(fd, Some(file));
        file
    }

    fn close(&mut self, pid: u64, fd: u64) {
        // Another process may still have the file open.
        let own = self.table(pid).insert(fd, None).flatten();
        if own.is_some() && self.latest.get(&fd) == Some(&own) {
            self.latest.insert(fd, None);
        }
    }

    fn duplicate(&mut self, call: &Call, to: u64) {
        let file = self.of(call);
        self.table(call.pid).insert(to, Some(file));
        self.latest.insert(to, Some(file));
    }

    fn clone_table(&mut self, parent: u64, child: u64, is_shared: bool) {
        let copied = self.table(parent).clone();
        let table = match is_shared {
            true => self.table_of[&parent],
            false => self.tables.len(),
        };
        if *self.table_of.entry(child).or_insert(table) == self.tables.len() {
            self.tables.push(copied);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::call;
    use super::*;

    /// The files after the calls of a log.
    fn followed(log: &str) -> Files {
        let mut files = Files::default();
        for line in log.lines() {
            files.follow(&call(line).expect(line));
        }
        files
    }

    /// Number of the file of a transfer.
    fn file(files: &mut Files, line: &str) -> usize {
        let call = call(line).expect(line);
        files.of_transfer(&call, call.bytes.as_deref().unwrap_or_default())
    }

    const PORT: &str = "openat(AT_FDCWD, \"/dev/ttyUSB0\", O_RDWR|O_NOCTTY) = 3";

    #[test]
    fn a_number_means_another_file_after_a_close() {
        let log = format!("{PORT}\nclose(3) = 0\nopen(\"/tmp/x\", O_RDONLY) = 3");
        let mut files = followed(&log);
        assert_eq!(file(&mut files, "write(3, \"x\", 1) = 1"), 1);
        let [port, other] = files.all() else {
            panic!("{:?}", files.all());
        };
        assert!(port.is_port() && port.is_read_write() && !port.is_standard());
        assert!(!other.is_port() && !other.is_read_write());
        assert_eq!(
            (port.label(), port.name()),
            ("3 /dev/ttyUSB0".into(), "/dev/ttyUSB0".into())
        );
        assert!(port.is_named("3") && port.is_named("/dev/ttyUSB0") && !port.is_named("4"));
        // A failed call opens nothing, and closes nothing.
        let failed =
            followed("openat(AT_FDCWD, \"/dev/ttyUSB0\", O_RDWR) = -1 ENOENT (No such file)");
        assert!(failed.all().is_empty());
        let mut open = followed(&format!("{PORT}\nclose(3) = -1 EINTR (x)"));
        assert_eq!(
            (file(&mut open, "write(3, \"x\", 1) = 1"), open.all().len()),
            (0, 1)
        );
    }

    /// After its close a descriptor that is still used is a file of its own.
    #[test]
    fn a_descriptor_without_an_opening_is_a_file() {
        let mut files = followed(&format!("{PORT}\nclose(3) = 0"));
        assert_eq!(file(&mut files, "read(3, \"x\", 1) = 1"), 1);
        assert_eq!(file(&mut files, "read(3, \"y\", 1) = 1"), 1);
        let one = &files.all()[1];
        assert_eq!(
            (one.label(), one.name(), one.link()),
            ("3".into(), "file descriptor 3".into(), "fd-3".into())
        );
        assert_eq!(file(&mut files, "read(0, \"y\", 1) = 1"), 2);
        assert!(files.all()[2].is_standard() && !files.all()[1].is_standard());
    }

    #[test]
    fn copies_of_a_descriptor_are_the_same_file() {
        let log = format!(
            "{PORT}\ndup(3) = 5\ndup2(3, 7) = 7\nfcntl(3, F_DUPFD, 0) = 6\nfcntl(3, F_GETFL) = 2"
        );
        let mut files = followed(&log);
        for fd in [3, 5, 6, 7] {
            assert_eq!(file(&mut files, &format!("write({fd}, \"x\", 1) = 1")), 0);
        }
        assert_eq!(file(&mut files, "write(2, \"x\", 1) = 1"), 1);
    }

    /// A child has a copy of its parent's descriptors; a thread has the same ones.
    #[test]
    fn a_child_keeps_its_own_descriptors() {
        for (begin, expected) in [
            ("fork() = 9", 0),
            ("clone(child_stack=NULL, flags=SIGCHLD) = 9", 0),
            ("clone(child_stack=0x1, flags=CLONE_VM|CLONE_FILES) = 9", 1),
        ] {
            let log = format!("{PORT}\n{begin}\nclose(3) = 0\nopen(\"/tmp/x\", O_RDONLY) = 3");
            let mut files = followed(&log);
            assert_eq!(file(&mut files, "write(3, \"x\", 1) = 1"), 1);
            let of_child = file(&mut files, "[pid 9] write(3, \"x\", 1) = 1");
            assert_eq!(of_child, expected, "{begin}");
        }
        // A thread whose creation is not in the log has the last file of that number.
        let mut files = followed(PORT);
        assert_eq!(file(&mut files, "[pid 8] write(3, \"x\", 1) = 1"), 0);
    }

    #[test]
    fn requests_of_terminals_tell_the_rate() {
        let log = format!(
            "{PORT}\nioctl(3, TCSETS, {{B9600 -opost -isig}}) = 0\nioctl(3, TCGETS, {{c_iflag=0}}) = 0"
        );
        assert_eq!(followed(&log).all()[0].baud, Some(9_600));
        let unnamed =
            followed("socket(AF_INET, SOCK_STREAM, 0) = 3\nioctl(3, TCGETS, 0x1) = -1 ENOTTY (x)");
        assert!(!unnamed.all()[0].is_port());
        let terminal =
            followed("open(\"/tmp/link\", O_RDWR) = 3\nioctl(3, TCGETS, {B9600 opost}) = 0");
        assert!(terminal.all()[0].is_port());
        let own = followed("open(\"/dev/tty\", O_RDWR) = 3\nioctl(3, TCGETS, {B9600 opost}) = 0");
        assert!(!own.all()[0].is_port());
    }

    #[test]
    fn pipes_and_sockets_are_files_without_a_path() {
        let files = followed("pipe([3, 4]) = 0\nsocket(AF_INET, SOCK_STREAM, 0) = 5");
        let fds: Vec<u64> = files.all().iter().map(|one| one.fd).collect();
        assert_eq!(fds, [3, 4, 5]);
        assert!(files.all().iter().all(|one| one.path().is_none()));
    }

    /// The loader reads a library, at a number that is a port afterwards.
    #[test]
    fn a_library_is_no_port() {
        let mut files = Files::default();
        let library = "read(3, \"\\177ELF\\2\\1\", 832) = 6";
        assert_eq!(file(&mut files, library), 1);
        assert!(files.all()[1].is_seekable() && !files.all()[1].is_port());
        assert_eq!(file(&mut files, "read(3, \"x\", 1) = 1"), 2);
        assert!(!files.all()[2].is_seekable());
        assert_eq!(file(&mut files, "pread64(3, \"x\", 1, 64) = 1"), 2);
        assert!(files.all()[2].is_seekable());
        // A file that was opened by its path stays the same one.
        let mut opened = followed(PORT);
        assert_eq!(file(&mut opened, library), 0);
        assert_eq!(file(&mut opened, "write(3, \"x\", 1) = 1"), 0);
    }

    /// With `-y` the path beside a number tells files apart.
    #[test]
    fn a_path_that_is_shown_tells_files_apart() {
        let mut files = Files::default();
        for (line, expected) in [
            ("write(3</dev/ttyUSB0>, \"x\", 1) = 1", 0),
            ("write(3</dev/ttyUSB0>, \"x\", 1) = 1", 0),
            ("write(3</dev/ttyUSB1>, \"x\", 1) = 1", 1),
            ("write(3, \"x\", 1) = 1", 1),
        ] {
            assert_eq!(file(&mut files, line), expected, "{line}");
        }
        assert!(files.all()[1].is_named("/dev/ttyUSB1") && files.all()[1].is_port());
    }

    #[test]
    fn paths_of_ports_begin_as_these() {
        for path in [
            "/dev/ttyS0",
            "/dev/serial/by-id/x",
            "/dev/pts/3",
            "/dev/cu.x",
            "/dev/rfcomm0",
            "COM3",
        ] {
            assert!(is_port(path), "{path}");
        }
        assert!(!is_port("/dev/null") && !is_port("/tmp/COM3"));
    }

    /// Only calls that return a descriptor open a file; those of files have a path.
    #[test]
    fn other_calls_open_nothing() {
        for line in [
            "getpid() = 7",
            "lseek(3, 0, SEEK_SET) = 0",
            "poll([{fd=3}], 1, 5) = 1",
        ] {
            assert!(followed(line).all().is_empty(), "{line}");
        }
        for (line, path) in [
            ("open(\"/tmp/a\", O_RDONLY) = 7", Some("/tmp/a")),
            ("openat(AT_FDCWD, \"/tmp/b\", O_RDONLY) = 7", Some("/tmp/b")),
            ("creat(\"/tmp/c\", 0644) = 7", Some("/tmp/c")),
            ("memfd_create(\"d\", 0) = 7", None),
            ("accept4(4, NULL, NULL, 0) = 7", None),
        ] {
            let files = followed(line);
            let all: Vec<_> = files.all().iter().map(|one| (one.fd, one.path())).collect();
            assert_eq!(all, [(7, path)], "{line}");
        }
    }
}
