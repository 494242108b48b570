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
