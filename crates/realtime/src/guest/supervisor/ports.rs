//! Reads and writes of the rig's ports: arrived bytes can be read, written bytes go to the line
//! immediately.

use core::time::Duration;

use nix::errno::Errno;

use super::files::File;
use super::streams::{buffers, gather, lens, scatter};
use super::{On, Outcome, Supervisor, Wait};
use crate::guest::call::Call;
use crate::transport::{Code, Settings};

/// Maximum number of bytes in one read.
const READ_MAX: usize = 64 << 10;
/// Maximum number of bytes that are put into a port at once; the kernel has room for more.
const PIECE: usize = 1024;

impl Supervisor {
    pub(super) fn read_port(
        &mut self,
        tid: i32,
        call: &Call,
        file: &File,
        port: usize,
    ) -> Result<Outcome, Errno> {
        let buffers = buffers(tid, call)?;
        let wanted = lens(&buffers).min(READ_MAX);
        if wanted == 0 {
            return Ok(Outcome::Answer(0));
        }
        self.stage.settle(port, &file.fd);
        let Some(terminal) = self.stage.terminal(port) else {
            return Ok(Outcome::Kernel);
        };
        let settings = *terminal.settings();
        let is_held = terminal.holds();
        if terminal.is_at_end() {
            terminal.took(0);
            return Ok(Outcome::Answer(0));
        }
        let there = terminal.readable(wanted).unwrap_or(0);
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.waits_for_ports = is_held;
            thread.asks_port = is_held;
        }
        if let Some(outcome) = self.not_yet(tid, file, port, &settings, [there, wanted]) {
            return outcome;
        }
        let len = wanted.min(there);
        let held = self.stage.terminal(port).and_then(|it| it.take(len));
        let bytes = match held {
            Some(bytes) => bytes,
            None => {
                let mut bytes = vec![0; len];
                let len = rustix::io::read(&file.fd, &mut bytes)
                    .map_err(|errno| Errno::from_raw(errno.raw_os_error()))?;
                bytes.truncate(len);
                bytes
            }
        };
        self.stage.took(port, bytes.len());
        scatter(tid, &buffers, &bytes)?;
        Ok(Outcome::Answer(i64::try_from(bytes.len()).unwrap_or(0)))
    }

    /// The reason why a read does not return bytes yet, by the rules of VMIN and VTIME, see
    /// termios(3).
    fn not_yet(
        &self,
        tid: i32,
        file: &File,
        port: usize,
        settings: &Settings,
        [there, wanted]: [usize; 2],
    ) -> Option<Result<Outcome, Errno>> {
        let is_canonical = settings.is_canonical();
        let tenths = |count: u8| Duration::from_millis(100 * u64::from(count));
        let (least, time) = match is_canonical {
            true => (1, 0),
            false => (settings.code(Code::Least), settings.code(Code::Time)),
        };
        let wait = |deadline| {
            Some(Ok(Outcome::Block(Wait {
                on: On::Files,
                deadline,
            })))
        };
        let now = self.stage.now();
        if least == 0 {
            let deadline = self.entered(tid) + tenths(time);
            return match there {
                0 if now >= deadline => Some(Ok(Outcome::Answer(0))),
                0 if file.never_waits() => Some(Err(Errno::EAGAIN)),
                0 => wait(Some(deadline)),
                _ => None,
            };
        }
        if there >= usize::from(least).min(wanted) {
            return None;
        }
        if file.never_waits() {
            return (there == 0).then_some(Err(Errno::EAGAIN));
        }
        // Between bytes, the timer starts again with each byte.
        let deadline = (there > 0 && time > 0).then(|| self.stage.heard(port) + tenths(time));
        match deadline {
            Some(at) if now >= at => None,
            deadline => wait(deadline),
        }
    }

    pub(super) fn write_port(
        &mut self,
        tid: i32,
        call: &Call,
        file: &File,
        port: usize,
    ) -> Result<Outcome, Errno> {
        let buffers = buffers(tid, call)?;
        let total = lens(&buffers);
        let mut done = self.threads.get(&tid).map_or(0, |thread| thread.progress);
        while done < total {
            let room = self.stage.room(port).min(PIECE);
            if room == 0 {
                break;
            }
            let bytes = gather(tid, &buffers, done, room)?;
            if self.stage.discards(port) {
                done += bytes.len();
                continue;
            }
            let Some(terminal) = self.stage.terminal(port) else {
                return Ok(Outcome::Kernel);
            };
            let sent = terminal.send(&bytes);
            self.writes_for_debugger(tid, port);
            let mut rest = &sent[..];
            while !rest.is_empty() {
                let len = rustix::io::write(&file.fd, rest)
                    .map_err(|errno| Errno::from_raw(errno.raw_os_error()))?;
                rest = &rest[len..];
                self.stage.stir();
                self.stage.carry().map_err(|_| Errno::EIO)?;
            }
            done += bytes.len();
        }
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.progress = done;
        }
        match done {
            done if done == total => {}
            0 if file.never_waits() => return Err(Errno::EAGAIN),
            _ if file.never_waits() => {}
            _ => {
                return Ok(Outcome::Block(Wait {
                    on: On::Line,
                    deadline: None,
                }));
            }
        }
        Ok(Outcome::Answer(i64::try_from(done).unwrap_or(0)))
    }
}
