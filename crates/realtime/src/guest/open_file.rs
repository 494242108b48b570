//! A file of the program: the supervisor's copy and its kind.

use std::os::fd::OwnedFd;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{OFlags, fcntl_getfl};

/// The kind of a file, for the handling of waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Reading and writing never wait.
    Prompt,
    /// A port of the rig.
    Port(usize),
    /// A file that the supervisor answers, with its index.
    Told(usize),
    /// A former port of the rig that has hung up: no call waits there.
    Gone,
    /// The system's source of random bytes.
    Chance,
    /// The program's output, which is read in wall time.
    Mouth,
    /// Signals (signalfd). The set of signals is read each time, because `signalfd4` can change it
    /// in an open file.
    Signals,
    /// Pipes, sockets, events: may wait.
    Stream,
}

/// The type of a file, because a call that a type does not support fails at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Pipe,
    Socket,
    /// Events that are counted (eventfd): reads and writes of at least [`EVENT`] bytes may wait.
    Counter,
    /// Timers, signals, changes of folders: only reads may wait, under the same condition as for a
    /// counter.
    Events,
    Other,
}

/// Length of the shortest read of events that may wait; a shorter one fails (eventfd(2)).
pub(super) const EVENT: usize = 8;

impl Form {
    /// The form of a file without a name in any folder, by its entry in `/proc/self/fd`.
    pub(super) fn of_nameless(entry: &str) -> Self {
        match entry
            .trim_start_matches("anon_inode:")
            .trim_matches(['[', ']'])
        {
            "eventfd" => Self::Counter,
            "timerfd" | "signalfd" | "inotify" | "fanotify" | "userfaultfd" | "perf_event" => {
                Self::Events
            }
            _ => Self::Other,
        }
    }
}

/// A file of the program.
#[derive(Debug)]
pub(super) struct File {
    pub(super) fd: OwnedFd,
    pub(super) kind: Kind,
    pub(super) form: Form,
    /// The number of the device, for a character device.
    pub(super) device: Option<u64>,
    /// The flags of its opening. They never change, and are the same for copies.
    opened: OFlags,
}

impl File {
    pub(super) fn new(fd: OwnedFd, (kind, form, device): (Kind, Form, Option<u64>)) -> Self {
        let opened = fcntl_getfl(&fd).unwrap_or(OFlags::RDWR);
        Self {
            fd,
            kind,
            form,
            device,
            opened,
        }
    }

    /// Whether it was opened for reading.
    pub(super) fn is_readable(&self) -> bool {
        matches!(self.access(), Some(OFlags::RDONLY | OFlags::RDWR))
    }

    /// Whether it was opened for writing.
    pub(super) fn is_writable(&self) -> bool {
        matches!(self.access(), Some(OFlags::WRONLY | OFlags::RDWR))
    }

    /// The access mode; `None` if the file is only a location (O_PATH).
    fn access(&self) -> Option<OFlags> {
        (!self.opened.contains(OFlags::PATH)).then_some(self.opened & OFlags::RWMODE)
    }

    /// Whether only calls that the supervisor stops can put data into it: a pipe, or a counter.
    pub(super) const fn is_inner(&self) -> bool {
        matches!(self.kind, Kind::Stream) && matches!(self.form, Form::Pipe | Form::Counter)
    }

    /// Whether calls on this file must not wait.
    pub(super) fn never_waits(&self) -> bool {
        fcntl_getfl(&self.fd).is_ok_and(|flags| flags.contains(OFlags::NONBLOCK))
    }

    /// The part of `wanted` that is ready now.
    pub(super) fn readiness(&self, wanted: PollFlags) -> PollFlags {
        let mut fds = [PollFd::new(&self.fd, wanted)];
        match poll(&mut fds, Some(&Timespec::default())) {
            Ok(_) => fds[0].revents(),
            Err(_) => PollFlags::empty(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{File as Opened, OpenOptions};

    use rustix::fs::open;

    use super::*;

    fn of(fd: impl Into<OwnedFd>) -> [bool; 2] {
        let file = File::new(fd.into(), (Kind::Prompt, Form::Other, None));
        [file.is_readable(), file.is_writable()]
    }

    /// Checks the access modes O_RDONLY, O_WRONLY, O_RDWR, the 3 of drivers, and O_PATH: open(2).
    #[test]
    fn a_file_is_read_and_written_as_it_was_opened() {
        let options = |read, write| OpenOptions::new().read(read).write(write).open("/dev/null");
        assert_eq!(of(Opened::open("/dev/null").expect("there")), [true, false]);
        assert_eq!(of(options(false, true).expect("there")), [false, true]);
        assert_eq!(of(options(true, true).expect("there")), [true, true]);
        let flags = |flags| open("/dev/null", flags, rustix::fs::Mode::empty()).expect("there");
        assert_eq!(of(flags(OFlags::RWMODE)), [false, false]);
        assert_eq!(of(flags(OFlags::PATH)), [false, false]);
    }

    #[test]
    fn nameless_files_are_known_by_their_entries() {
        for (entry, form) in [
            ("anon_inode:[eventfd]", Form::Counter),
            ("anon_inode:[timerfd]", Form::Events),
            ("anon_inode:inotify", Form::Events),
            ("anon_inode:[eventpoll]", Form::Other),
            ("anon_inode:[pidfd]", Form::Other),
        ] {
            assert_eq!(Form::of_nameless(entry), form, "{entry}");
        }
    }

    #[test]
    fn each_kind_of_nameless_file_has_its_form() {
        for name in [
            "timerfd",
            "signalfd",
            "inotify",
            "fanotify",
            "userfaultfd",
            "perf_event",
        ] {
            let entry = format!("anon_inode:[{name}]");
            assert_eq!(Form::of_nameless(&entry), Form::Events, "{entry}");
        }
        assert_eq!(Form::of_nameless("eventfd"), Form::Counter);
    }

    /// Only what is written by stopped calls: pipes and counters.
    #[test]
    fn a_pipe_or_a_counter_is_filled_by_calls_alone() {
        let inner = |kind, form| {
            let null = Opened::open("/dev/null").expect("there");
            File::new(null.into(), (kind, form, None)).is_inner()
        };
        assert!(inner(Kind::Stream, Form::Pipe) && inner(Kind::Stream, Form::Counter));
        assert!(!inner(Kind::Stream, Form::Socket) && !inner(Kind::Stream, Form::Events));
        assert!(!inner(Kind::Mouth, Form::Pipe) && !inner(Kind::Prompt, Form::Other));
    }

    #[test]
    fn a_file_may_be_opened_without_waiting() {
        let (ears, mouth) = std::io::pipe().expect("pipes");
        let of = |fd: OwnedFd| File::new(fd, (Kind::Stream, Form::Pipe, None));
        let file = of(ears.into());
        assert!(!file.never_waits());
        assert_eq!(file.readiness(PollFlags::IN), PollFlags::empty());
        std::io::Write::write_all(&mut &mouth, b"x").expect("room");
        assert_eq!(file.readiness(PollFlags::IN), PollFlags::IN);
        assert_eq!(file.readiness(PollFlags::OUT), PollFlags::empty());
        rustix::io::ioctl_fionbio(&file.fd, true).expect("ours");
        assert!(file.never_waits(), "it is asked each time");
    }
}
