//! Blocking writes to pipes and sockets: such a write takes all bytes or waits. The supervisor
//! writes piece by piece, so that no thread waits in the kernel for a reader that is stopped.

use nix::errno::Errno;
use nix::libc;
use rustix::event::PollFlags;
use rustix::fs::{FileType, fstat};
use rustix::net::{SendFlags, SocketType, send, sockopt};

use super::files::File;
use super::streams::{buffers, gather, lens, waits_by_flag};
use super::{On, Outcome, Supervisor, Wait};
use crate::guest::call::Call;

/// Number of bytes that a pipe with any room takes at once.
const PIPE_PAGE: usize = 4096;

/// A file that takes bytes without message boundaries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sink {
    Pipe,
    Socket,
}

impl Supervisor {
    pub(super) fn write_stream(
        &mut self,
        tid: i32,
        call: &Call,
        file: &File,
    ) -> Result<Outcome, Errno> {
        let waits = waits_by_flag(call);
        // A small write fits wherever there is any room. Messages with an address or with rights
        // must stay whole.
        let is_plain = match call.number {
            libc::SYS_write | libc::SYS_writev => true,
            libc::SYS_sendto => call.args[4] == 0,
            _ => false,
        };
        let sink = sink_of(file).filter(|_| is_plain && waits && !file.never_waits());
        let total = match sink {
            Some(_) => lens(&buffers(tid, call)?),
            None => 0,
        };
        let Some(sink) = sink.filter(|_| total > PIPE_PAGE) else {
            return self.when_ready(tid, file, PollFlags::OUT, waits);
        };
        let buffers = buffers(tid, call)?;
        let mut done = self.threads.get(&tid).map_or(0, |thread| thread.progress);
        while done < total && !file.readiness(PollFlags::OUT).is_empty() {
            let bytes = gather(tid, &buffers, done, PIPE_PAGE)?;
            match put(file, sink, &bytes) {
                Ok(len) => done += len,
                Err(Errno::EAGAIN) => break,
                // The kernel reports the error to the program, also by a signal.
                Err(_) if done == 0 => return Ok(Outcome::Kernel),
                Err(_) => return Ok(Outcome::Answer(i64::try_from(done).unwrap_or(0))),
            }
        }
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.progress = done;
        }
        self.is_changed = true;
        match done == total {
            true => Ok(Outcome::Answer(i64::try_from(done).unwrap_or(0))),
            false => Ok(Outcome::Block(Wait {
                on: On::Files,
                deadline: None,
            })),
        }
    }
}

fn sink_of(file: &File) -> Option<Sink> {
    let mode = fstat(&file.fd).ok()?.st_mode;
    match FileType::from_raw_mode(mode) {
        FileType::Fifo => Some(Sink::Pipe),
        FileType::Socket => {
            let is_stream = sockopt::socket_type(&file.fd).ok()? == SocketType::STREAM;
            is_stream.then_some(Sink::Socket)
        }
        _ => None,
    }
}

fn put(file: &File, sink: Sink, bytes: &[u8]) -> Result<usize, Errno> {
    let flags = SendFlags::DONTWAIT | SendFlags::NOSIGNAL;
    let done = match sink {
        Sink::Pipe => rustix::io::write(&file.fd, bytes),
        Sink::Socket => send(&file.fd, bytes, flags),
    };
    done.map_err(|errno| Errno::from_raw(errno.raw_os_error()))
}
