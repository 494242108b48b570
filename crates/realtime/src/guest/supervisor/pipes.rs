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

#[cfg(test)]
mod tests {
    use std::io::Read as _;

    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told, fd};
    use crate::guest::tests::Room;

    /// pipe(7): up to 4,096 bytes are written together once there is room; a longer write fills
    /// the pipe and waits. A pipe has 65,536 bytes.
    #[test]
    fn a_long_write_waits_for_its_reader() {
        let mut bench = Bench::new();
        let bytes = Room::of(
            &(0..70_000)
                .map(|byte: u32| byte.to_le_bytes()[0])
                .collect::<Vec<u8>>(),
        );
        let (mut ears, mouth) = std::io::pipe().expect("pipes");
        let args = |len| [fd(&mouth), bytes.at(0), len];
        let write = libc::SYS_write;
        assert_eq!(bench.calls(write, &args(4_096)), Told::Kernel);
        let waits = Told::Waits(On::Files, None);
        assert_eq!(bench.calls(write, &args(70_000)), waits);
        assert_eq!(bench.thread().progress, 65_536);
        assert_eq!(bench.again(), waits);
        let mut got = vec![0; 65_536];
        ears.read_exact(&mut got).expect("they are there");
        assert_eq!(got, bytes.bytes()[..65_536]);
        bench.supervisor.is_changed = false;
        assert_eq!(bench.again(), Told::Answer(70_000));
        assert!(bench.supervisor.is_changed);
        let mut rest = vec![0; 4_464];
        ears.read_exact(&mut rest).expect("they are there");
        assert_eq!(rest, bytes.bytes()[65_536..70_000]);
        assert_eq!(bench.calls(write, &args(4_097)), Told::Answer(4_097));
        drop(ears);
        // The kernel tells the program, by SIGPIPE as well; behind a part it is not told.
        assert_eq!(bench.calls(write, &args(5_000)), Told::Kernel);
        bench.thread().progress = 7;
        assert_eq!(bench.again(), Told::Answer(7));
    }

    #[test]
    fn other_writes_are_the_kernels_when_there_is_room() {
        let mut bench = Bench::new();
        let bytes = Room::new(8_192);
        let long = |file: u64| [file, bytes.at(0), 8_192, 0, 0];
        let (one, _other) = std::os::unix::net::UnixStream::pair().expect("sockets");
        assert_eq!(
            bench.calls(libc::SYS_write, &long(fd(&one))),
            Told::Answer(8_192)
        );
        assert_eq!(
            bench.calls(libc::SYS_sendto, &long(fd(&one))),
            Told::Answer(8_192)
        );
        let mut flag = long(fd(&one));
        flag[3] = 0x40;
        assert_eq!(bench.calls(libc::SYS_sendto, &flag), Told::Kernel);
        let mut address = long(fd(&one));
        address[4] = 8;
        assert_eq!(bench.calls(libc::SYS_sendto, &address), Told::Kernel);
        assert_eq!(
            bench.calls(libc::SYS_sendmsg, &[fd(&one), 8, 0]),
            Told::Kernel
        );
        let (one, _other) = std::os::unix::net::UnixDatagram::pair().expect("sockets");
        assert_eq!(bench.calls(libc::SYS_write, &long(fd(&one))), Told::Kernel);
        one.set_nonblocking(true).expect("ours");
        assert_eq!(bench.calls(libc::SYS_write, &long(fd(&one))), Told::Kernel);
        let (one, _other) = std::os::unix::net::UnixStream::pair().expect("sockets");
        one.set_nonblocking(true).expect("ours");
        assert_eq!(bench.calls(libc::SYS_write, &long(fd(&one))), Told::Kernel);
        let fault = [fd(&one), 8, 8_192];
        one.set_nonblocking(false).expect("ours");
        let told = bench.calls(libc::SYS_write, &fault);
        assert_eq!(told, crate::guest::supervisor::tests::error(Errno::EFAULT));
    }

    /// A socket with a full buffer: the rest waits for its reader.
    #[test]
    fn a_long_write_to_a_socket_waits() {
        let mut bench = Bench::new();
        let bytes = Room::new(2_000_000);
        let (one, other) = std::os::unix::net::UnixStream::pair().expect("sockets");
        let args = [fd(&one), bytes.at(0), 2_000_000];
        let waits = Told::Waits(On::Files, None);
        assert_eq!(bench.calls(libc::SYS_write, &args), waits);
        let done = bench.thread().progress;
        assert!(done > 0 && done < 2_000_000, "{done}");
        let mut buf = vec![0; done];
        (&other).read_exact(&mut buf).expect("they are there");
        assert_eq!(bench.again(), waits);
        assert!(bench.thread().progress > done);
    }
}
