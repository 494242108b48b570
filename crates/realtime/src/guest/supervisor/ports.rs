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

#[cfg(test)]
mod tests {
    use super::*;
    use nix::libc;

    use crate::guest::supervisor::tests::{Bench, MS, Told, error, fd};
    use crate::guest::tests::Room;

    /// Settings with VMIN and VTIME: the 7th and the 6th of the special characters.
    fn settings(bench: &mut Bench, least: u8, tenths: u8) {
        let terminal = bench.supervisor.stage.terminal(0).expect("it is there");
        let mut bytes = terminal.settings().bytes();
        (bytes[17 + 6], bytes[17 + 5]) = (least, tenths);
        let settings = terminal.settings().with(&bytes);
        terminal.set(settings);
    }

    fn waits(until: Option<u64>) -> Told {
        Told::Waits(On::Files, until)
    }

    fn unread(bench: &mut Bench) -> usize {
        bench
            .supervisor
            .stage
            .terminal(0)
            .map_or(0, |it| it.unread())
    }

    /// termios(3), MIN > 0 and TIME == 0: a read waits for MIN bytes, or for all that it wants.
    #[test]
    fn a_read_waits_for_vmin_bytes() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let room = Room::new(16);
        let read = libc::SYS_read;
        let args = |len| [fd(&port), room.at(0), len];
        assert_eq!(bench.calls(read, &args(0)), Told::Answer(0));
        settings(&mut bench, 1, 0);
        assert_eq!(bench.calls(read, &args(16)), waits(None));
        assert!(bench.thread().waits_for_ports && bench.thread().asks_port);
        bench.brings(1);
        assert_eq!(bench.calls(read, &args(16)), Told::Answer(1));
        assert_eq!((room.bytes()[0], unread(&mut bench)), (b'm', 0));
        settings(&mut bench, 3, 0);
        bench.brings(2);
        assert_eq!(bench.calls(read, &args(16)), waits(None));
        assert_eq!(bench.calls(read, &args(2)), Told::Answer(2));
        bench.brings(3);
        assert_eq!(bench.calls(read, &args(2)), Told::Answer(2));
        assert_eq!((&room.bytes()[..2], unread(&mut bench)), (&b"70"[..], 1));
    }

    /// MIN == 0, TIME == 0: at once. MIN == 0, TIME > 0: for one byte, at most so long.
    #[test]
    fn a_read_without_vmin_ends_at_its_time() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let room = Room::new(16);
        let args = [fd(&port), room.at(0), 16];
        settings(&mut bench, 0, 0);
        assert_eq!(bench.calls(libc::SYS_read, &args), Told::Answer(0));
        settings(&mut bench, 0, 2);
        let now = bench.now();
        assert_eq!(
            bench.calls(libc::SYS_read, &args),
            waits(Some(now + 200 * MS))
        );
        bench.brings(1);
        assert_eq!(bench.again(), Told::Answer(1));
        bench.supervisor.stage.is_frozen = true;
        let now = bench.now();
        assert_eq!(
            bench.calls(libc::SYS_read, &args),
            waits(Some(now + 200 * MS))
        );
        bench.passes(199);
        assert_eq!(bench.again(), waits(Some(now + 200 * MS)));
        bench.passes(1);
        assert_eq!(bench.again(), Told::Answer(0));
    }

    /// MIN > 0, TIME > 0: the time counts from each byte on, and not before the first.
    #[test]
    fn a_read_between_bytes_ends_at_its_time() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let room = Room::new(16);
        let args = [fd(&port), room.at(0), 16];
        settings(&mut bench, 200, 3);
        assert_eq!(bench.calls(libc::SYS_read, &args), waits(None));
        bench.brings(1);
        bench.supervisor.stage.is_frozen = true;
        let heard = bench.supervisor.stage.heard(0).as_nanos();
        assert_eq!(bench.again(), waits(Some(heard + 300 * MS)));
        let rest = heard + 300 * MS - bench.now();
        let most = Duration::from_nanos(rest - 1);
        bench.supervisor.stage.pass(most).expect("the port stays");
        assert_eq!(bench.again(), waits(Some(heard + 300 * MS)));
        bench
            .supervisor
            .stage
            .pass(Duration::from_nanos(1))
            .expect("the port stays");
        assert_eq!(bench.again(), Told::Answer(1));
    }

    /// open(2), O_NONBLOCK: EAGAIN in place of a wait.
    #[test]
    fn a_port_that_never_waits_fails_without_bytes() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        rustix::io::ioctl_fionbio(&port, true).expect("ours");
        let room = Room::new(16);
        let args = [fd(&port), room.at(0), 16];
        settings(&mut bench, 5, 0);
        assert_eq!(bench.calls(libc::SYS_read, &args), error(Errno::EAGAIN));
        settings(&mut bench, 0, 1);
        assert_eq!(bench.calls(libc::SYS_read, &args), error(Errno::EAGAIN));
        settings(&mut bench, 5, 0);
        bench.brings(1);
        assert_eq!(bench.calls(libc::SYS_read, &args), Told::Answer(1));
    }

    /// A write takes as much as the line has room for, 4,096 bytes, and waits for more.
    #[test]
    fn a_write_waits_for_room_on_the_line() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        bench.supervisor.stage.begin();
        let bytes = Room::of(&[b'x'; 6_000]);
        let args = |len| [fd(&port), bytes.at(0), len];
        assert_eq!(
            bench.calls(libc::SYS_write, &args(1_500)),
            Told::Answer(1_500)
        );
        let backlog = bench.supervisor.stage.backlog(0);
        assert!((1_498..=1_500).contains(&backlog), "{backlog}");
        let told = bench.calls(libc::SYS_write, &args(4_000));
        assert_eq!(told, Told::Waits(On::Line, None));
        let done = bench.thread().progress;
        assert!((2_596..=2_600).contains(&done), "{done}");
        bench
            .supervisor
            .stage
            .leap(None, true)
            .expect("the port stays");
        assert_eq!(bench.again(), Told::Waits(On::Line, None));
        assert!(bench.thread().progress > done);
        rustix::io::ioctl_fionbio(&port, true).expect("ours");
        bench.passes(20);
        assert!(matches!(
            bench.calls(libc::SYS_write, &args(4_000)),
            Told::Answer(1..=40)
        ));
        assert_eq!(
            bench.calls(libc::SYS_write, &args(4_000)),
            error(Errno::EAGAIN)
        );
        // After the run what the rig does not take is lost.
        bench.supervisor.stage.is_frozen = true;
        assert_eq!(
            bench.calls(libc::SYS_write, &args(4_000)),
            Told::Answer(4_000)
        );
    }
}
