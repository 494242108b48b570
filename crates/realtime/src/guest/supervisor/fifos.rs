//! Opening of named pipes, which waits for the other side. In the kernel this would be a deadlock,
//! because the supervisor stops all other threads meanwhile.

use std::collections::BTreeSet;
use std::fs::File;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use nix::libc;
use nix::unistd::Pid;

use super::clocks::low_i32;
use super::{Memory, Next, On, Outcome, Supervisor, Wait};
use crate::guest::call::Call;
use crate::guest::task::FifoSide;

/// Both sides of a pipe, kept open until the threads that open it have finished.
#[derive(Debug)]
pub(super) struct Meeting {
    _both: OwnedFd,
    on_their_way: BTreeSet<i32>,
}

impl Supervisor {
    /// Opens `path`, which may be a named pipe.
    pub(super) fn open_fifo(&mut self, tid: i32, call: &Call, path: &str) -> Outcome {
        let flags = match call.number {
            libc::SYS_open => call.args[1],
            libc::SYS_openat => call.args[2],
            // The flags are the first word of a structure in memory.
            _ => Memory(Pid::from_raw(tid)).u64(call.args[2]).unwrap_or(0),
        };
        let flags = low_i32(flags);
        let mode = flags & libc::O_ACCMODE;
        if flags & libc::O_NONBLOCK != 0 || mode == libc::O_RDWR {
            return Outcome::Kernel;
        }
        let place = self.place(tid, call, path);
        let found = std::fs::metadata(&place);
        let Some(found) = found.ok().filter(|data| data.file_type().is_fifo()) else {
            return Outcome::Kernel;
        };
        let side = FifoSide {
            file: (found.dev(), found.ino()),
            writes: mode == libc::O_WRONLY,
        };
        if self.has_other_side(side) {
            return Outcome::Kernel;
        }
        if let Some(partner) = self.partner(side) {
            // An opening for reading and writing never waits, and neither do later openings of the
            // same pipe.
            let both = File::options().read(true).write(true).open(&place);
            if let Ok(both) = both {
                self.meetings.push(Meeting {
                    _both: both.into(),
                    on_their_way: [tid, partner].into(),
                });
            }
            self.ready(partner, Next::Go(None));
            return Outcome::Kernel;
        }
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.opens = Some(side);
        }
        Outcome::Block(Wait {
            on: On::Files,
            deadline: None,
        })
    }

    /// Ends a meeting for a thread that has finished the call, or has ended.
    pub(super) fn end_meeting(&mut self, tid: i32) {
        if self.meetings.is_empty() {
            return;
        }
        for meeting in &mut self.meetings {
            meeting.on_their_way.remove(&tid);
        }
        self.meetings
            .retain(|meeting| !meeting.on_their_way.is_empty());
    }

    /// The path by which this process finds the program's `path`.
    fn place(&self, tid: i32, call: &Call, path: &str) -> PathBuf {
        if path.starts_with('/') {
            return PathBuf::from(path);
        }
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        let folder = low_i32(call.args[0]);
        let from = match call.number {
            libc::SYS_openat | libc::SYS_openat2 if folder != libc::AT_FDCWD => {
                format!("fd/{folder}")
            }
            _ => "cwd".to_owned(),
        };
        Path::new(&format!("/proc/{process}/{from}")).join(path)
    }

    /// A thread that waits to open the opposite side.
    fn partner(&self, side: FifoSide) -> Option<i32> {
        let waits = |opens: FifoSide| opens.file == side.file && opens.writes != side.writes;
        let partners = self.threads.values().filter(|thread| {
            let opens = thread.opens.filter(|_| thread.waits_for_files());
            opens.is_some_and(waits)
        });
        let oldest = partners.min_by_key(|thread| thread.index);
        oldest.map(|thread| thread.tid.as_raw())
    }

    /// Whether some process of the program has the other side open.
    fn has_other_side(&self, side: FifoSide) -> bool {
        self.processes.keys().any(|pid| {
            let files = std::fs::read_dir(format!("/proc/{pid}/fd"));
            let mut files = files.into_iter().flatten().flatten();
            files.any(|entry| {
                let data = std::fs::metadata(entry.path());
                let is_it = data.is_ok_and(|data| (data.dev(), data.ino()) == side.file);
                is_it && is_other_side(*pid, &entry.file_name().to_string_lossy(), side)
            })
        })
    }
}

fn is_other_side(pid: i32, fd: &str, side: FifoSide) -> bool {
    let info = std::fs::read_to_string(format!("/proc/{pid}/fdinfo/{fd}"));
    let info = info.unwrap_or_default();
    let flags = info.lines().find_map(|line| line.strip_prefix("flags:"));
    let flags = flags.and_then(|text| i32::from_str_radix(text.trim(), 8).ok());
    flags.is_some_and(|flags| match flags & libc::O_ACCMODE {
        libc::O_RDONLY => side.writes,
        libc::O_WRONLY => !side.writes,
        _ => true,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told};

    use std::os::fd::AsRawFd as _;
    use std::os::unix::fs::OpenOptionsExt as _;

    /// A folder with a named pipe.
    fn with_fifo(name: &str) -> PathBuf {
        let folder =
            std::env::temp_dir().join(format!("hilrig-fifo-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        std::fs::create_dir_all(&folder).expect("a free name");
        let mode = rustix::fs::Mode::from_raw_mode(0o600);
        let kind = rustix::fs::FileType::Fifo;
        rustix::fs::mknodat(rustix::fs::CWD, folder.join("pipe"), kind, mode, 0).expect("ours");
        folder
    }

    /// fifo(7): an opening for reading waits for one for writing, and the other way round; not with
    /// O_NONBLOCK or O_RDWR.
    #[test]
    fn an_opening_waits_for_the_other_side() {
        let mut bench = Bench::new();
        let folder = with_fifo("opens");
        let pipe = folder.join("pipe");
        let path = pipe.to_str().expect("text");
        let open = |bench: &mut Bench, flags: i32| {
            let call = bench.begins(libc::SYS_open, &[8, u64::from(flags.unsigned_abs())]);
            let tid = bench.tid;
            Told::from(bench.supervisor.open_fifo(tid, &call, path))
        };
        let waits = Told::Waits(On::Files, None);
        assert_eq!(open(&mut bench, libc::O_RDONLY), waits);
        let opens = bench.thread().opens.expect("noted");
        assert!(!opens.writes);
        assert_eq!(open(&mut bench, libc::O_WRONLY), waits);
        assert!(
            bench
                .thread()
                .opens
                .is_some_and(|it| it.writes && it.file == opens.file)
        );
        assert_eq!(open(&mut bench, libc::O_RDWR), Told::Kernel);
        assert_eq!(
            open(&mut bench, libc::O_RDONLY | libc::O_NONBLOCK),
            Told::Kernel
        );
        // Another thread waits for the other side: both go on.
        let own = bench.tid;
        let wait = Wait {
            on: On::Files,
            deadline: None,
        };
        let partner = bench.add(1_000_001, own, super::super::State::Blocked(wait));
        partner.opens = Some(FifoSide {
            writes: true,
            ..opens
        });
        assert_eq!(bench.supervisor.partner(opens), Some(1_000_001));
        assert_eq!(
            bench.supervisor.partner(FifoSide {
                writes: true,
                ..opens
            }),
            None
        );
        let elsewhere = FifoSide {
            file: (0, 0),
            ..opens
        };
        assert_eq!(bench.supervisor.partner(elsewhere), None);
        assert_eq!(open(&mut bench, libc::O_RDONLY), Told::Kernel);
        assert_eq!(bench.supervisor.queue, [1_000_001]);
        assert_eq!(bench.supervisor.meetings.len(), 1);
        bench.supervisor.end_meeting(own);
        assert_eq!(
            bench.supervisor.meetings.len(),
            1,
            "the other one is on its way"
        );
        bench.supervisor.end_meeting(1_000_001);
        assert!(bench.supervisor.meetings.is_empty());
        bench.supervisor.end_meeting(own);
        // A side that is open already is waited for no more.
        let both = File::options()
            .read(true)
            .write(true)
            .open(&pipe)
            .expect("ours");
        assert_eq!(open(&mut bench, libc::O_RDONLY), Told::Kernel);
        let reader = File::options()
            .read(true)
            .custom_flags(libc::O_NONBLOCK)
            .open(&pipe);
        let reader = reader.expect("ours");
        drop(both);
        assert_eq!(open(&mut bench, libc::O_WRONLY), Told::Kernel);
        let fd = reader.as_raw_fd().to_string();
        let process = std::process::id().cast_signed();
        let side = |writes| FifoSide { writes, ..opens };
        assert!(is_other_side(process, &fd, side(true)));
        assert!(!is_other_side(process, &fd, side(false)));
        assert!(!is_other_side(process, "9999", side(true)));
        let plain = folder.join("plain");
        std::fs::write(&plain, "").expect("ours");
        let call = bench.begins(libc::SYS_open, &[8, 0]);
        let told = bench
            .supervisor
            .open_fifo(own, &call, plain.to_str().expect("text"));
        assert_eq!(Told::from(told), Told::Kernel);
        let gone = bench.supervisor.open_fifo(own, &call, "/nowhere/at/all");
        assert_eq!(Told::from(gone), Told::Kernel);
        std::fs::remove_dir_all(&folder).expect("ours");
    }

    /// open(2), openat(2), openat2(2): where the flags are, and from which folder a path counts.
    #[test]
    fn a_path_is_found_from_its_folder() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let cwd = u64::from(libc::AT_FDCWD.cast_unsigned());
        let process = format!("/proc/{}", std::process::id());
        for (number, folder, path, expected) in [
            (libc::SYS_open, 7, "/a/b", "/a/b".to_owned()),
            (libc::SYS_openat, 7, "/a/b", "/a/b".to_owned()),
            (libc::SYS_open, 7, "a/b", format!("{process}/cwd/a/b")),
            (libc::SYS_openat, cwd, "a", format!("{process}/cwd/a")),
            (libc::SYS_openat, 7, "a", format!("{process}/fd/7/a")),
            (libc::SYS_openat2, 7, "a", format!("{process}/fd/7/a")),
            (libc::SYS_openat2, cwd, "a", format!("{process}/cwd/a")),
        ] {
            let call = Call::made(number, &[folder]);
            let place = bench.supervisor.place(tid, &call, path);
            assert_eq!(place, Path::new(&expected), "{number} {folder} {path}");
        }
        let folder = with_fifo("flags");
        let path = folder.join("pipe");
        let path = path.to_str().expect("text");
        let write = libc::O_WRONLY.unsigned_abs().into();
        let how = crate::guest::tests::Room::of_words(&[write, 0, 0]);
        for (number, args) in [
            (libc::SYS_open, [0, write, 0]),
            (libc::SYS_openat, [0, 0, write]),
            (libc::SYS_openat2, [0, 0, how.at(0)]),
        ] {
            let call = bench.begins(number, &args);
            let told = bench.supervisor.open_fifo(tid, &call, path);
            assert_eq!(Told::from(told), Told::Waits(On::Files, None));
            assert!(bench.thread().opens.is_some_and(|it| it.writes), "{number}");
        }
        std::fs::remove_dir_all(&folder).expect("ours");
    }

    /// open(2): the access mode of a file is one side of a pipe, or both.
    #[test]
    fn an_open_file_is_the_other_side_or_not() {
        let own = std::process::id().cast_signed();
        let side = |writes| FifoSide {
            file: (0, 0),
            writes,
        };
        let null = |reads, writes| {
            let mut options = std::fs::OpenOptions::new();
            let file = options.read(reads).write(writes).open("/dev/null");
            let file = file.expect("it is there");
            let fd = file.as_raw_fd().to_string();
            [true, false].map(|writes| is_other_side(own, &fd, side(writes)))
        };
        assert_eq!(null(true, false), [true, false]);
        assert_eq!(null(false, true), [false, true]);
        assert_eq!(null(true, true), [true, true]);
        assert!(!is_other_side(own, "9999", side(true)));
    }
}
