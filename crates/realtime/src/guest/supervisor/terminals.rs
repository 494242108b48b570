//! Requests of a program to a port other than bytes: settings, queues, modem lines, breaks.

use std::os::unix::fs::MetadataExt as _;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

use super::clocks::low_i32;
use super::files::{File, Kind};
use super::{Memory, On, Outcome, Supervisor, Wait};
use crate::Traffic;
use crate::guest::call::Call;
use crate::guest::launch::{TIOCGICOUNT, TIOCGSERIAL, TIOCMIWAIT, TIOCSSERIAL};
use crate::guest::settings::{
    errno_of, flushes, is_settings, read_back, serial, waits_until_sent, wanted,
};
use crate::inputs::INPUTS;

/// A request that `libc` does not know for this system.
const TIOCGEXCL: u64 = 0x8004_5440;
/// The capability that lets a process open a port despite TIOCEXCL.
const CAP_SYS_ADMIN: u32 = 21;

/// Length of the result of TIOCGICOUNT: twenty numbers, of which the first four count changes of
/// lines.
const ICOUNT_LEN: usize = 80;

impl Supervisor {
    pub(super) fn ioctl(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [fd, request, argument, ..] = call.args;
        // Most requests are about other terminals and sockets.
        if !is_of_ports(request) {
            self.sets_notice_by_ioctl(tid, call);
            // A signal reports a new size of a terminal.
            self.is_signalled |= self.has_terminals;
            return Ok(Outcome::Kernel);
        }
        let file = self.file(tid, low_i32(fd));
        let Some((Kind::Port(port), file)) = file.map(|file| (file.kind, file)) else {
            return Ok(Outcome::Kernel);
        };
        if !only_asks(request) {
            self.stage.touch();
        }
        let memory = Memory(Pid::from_raw(tid));
        match request {
            libc::FIONREAD => {
                self.stage.settle(port, &file.fd);
                let terminal = self.stage.terminal(port);
                let (unread, is_held) = terminal.map_or((0, false), |it| (it.unread(), it.holds()));
                if let Some(thread) = self.threads.get_mut(&tid) {
                    thread.asks_port = is_held;
                }
                put_number(memory, argument, unread)
            }
            libc::TIOCOUTQ => put_number(memory, argument, self.stage.backlog(port)),
            libc::TIOCEXCL | libc::TIOCNXCL => {
                self.stage.slot(port).is_exclusive = request == libc::TIOCEXCL;
                Ok(Outcome::Answer(0))
            }
            TIOCGEXCL => put_number(memory, argument, self.stage.slot(port).is_exclusive.into()),
            libc::TCFLSH => self.flush(port, &file, low_i32(argument)),
            libc::TCXONC => self.flow(port, low_i32(argument)),
            TIOCGSERIAL | TIOCSSERIAL => {
                let flags = &mut self.stage.slot(port).serial_flags;
                serial(memory, request == TIOCSSERIAL, argument, flags)?;
                Ok(Outcome::Answer(0))
            }
            _ if is_settings(request) => self.settings(memory, port, &file, [request, argument]),
            libc::TCSBRK if argument != 0 => Ok(match self.once_sent(port) {
                Some(wait) => wait,
                None => Outcome::Answer(0),
            }),
            TIOCMIWAIT => Ok(self.wait_for_line(tid, port, argument)),
            _ => self.modem(memory, port, request, argument),
        }
    }

    /// Waits until one of the lines in `wanted` has changed since the call began.
    fn wait_for_line(&mut self, tid: i32, port: usize, wanted: u64) -> Outcome {
        let now = self.stage.line_changes(port);
        let Some(thread) = self.threads.get_mut(&tid) else {
            return Outcome::Kernel;
        };
        let before = *thread.lines_before.get_or_insert(now);
        let has_changed = |index: usize| {
            wanted & u64::from(INPUTS[index].bit) != 0 && before[index] != now[index]
        };
        match (0..INPUTS.len()).any(has_changed) {
            true => Outcome::Answer(0),
            false => Outcome::Block(Wait {
                on: On::Files,
                deadline: None,
            }),
        }
    }

    /// Reads or changes the settings of the client's terminal.
    fn settings(
        &mut self,
        memory: Memory,
        port: usize,
        file: &File,
        [request, argument]: [u64; 2],
    ) -> Result<Outcome, Errno> {
        let Some(terminal) = self.stage.terminal(port) else {
            return Ok(Outcome::Kernel);
        };
        let before = *terminal.settings();
        if let Some(bytes) = read_back(&before, request) {
            memory.write(argument, &bytes)?;
            return Ok(Outcome::Answer(0));
        }
        if waits_until_sent(request)
            && let Some(wait) = self.once_sent(port)
        {
            return Ok(wait);
        }
        let wanted = wanted(memory, &before, request, argument)?;
        if flushes(request) {
            self.flush(port, file, libc::TCIFLUSH)?;
        }
        self.stage.set_terminal(port, wanted, &file.fd);
        // The kernel's terminal stays raw, but its polling uses these values.
        let mut termios = tcgetattr(&file.fd).map_err(errno_of)?;
        wanted.waits_into(&mut termios);
        tcsetattr(&file.fd, OptionalActions::Now, &termios).map_err(errno_of)?;
        Ok(Outcome::Answer(0))
    }

    fn flush(&mut self, port: usize, file: &File, which: i32) -> Result<Outcome, Errno> {
        if !matches!(which, libc::TCIFLUSH | libc::TCOFLUSH | libc::TCIOFLUSH) {
            return Err(Errno::EINVAL);
        }
        if which != libc::TCOFLUSH {
            // Otherwise the kernel would deliver the bytes in flight later.
            self.stage.settle(port, &file.fd);
            tcflush(&file.fd, QueueSelector::IFlush).map_err(errno_of)?;
            self.stage.forget_unread(port);
        }
        if which != libc::TCIFLUSH {
            self.stage.discard_sent(port).map_err(|_| Errno::EIO)?;
        }
        Ok(Outcome::Answer(0))
    }

    /// Stops or continues sending of the client, or requests this of the other end.
    fn flow(&mut self, port: usize, what: i32) -> Result<Outcome, Errno> {
        let Some(terminal) = self.stage.terminal(port) else {
            return Ok(Outcome::Kernel);
        };
        match what {
            libc::TCOOFF | libc::TCOON => terminal.suspend(what == libc::TCOOFF),
            libc::TCIOFF | libc::TCION => terminal.send_flow(what == libc::TCIOFF),
            _ => return Err(Errno::EINVAL),
        }
        Ok(Outcome::Answer(0))
    }

    /// Whether opening `path` is refused: another program uses the port exclusively, and this one
    /// lacks the capability.
    pub(super) fn is_refused(&mut self, tid: i32, call: &Call, path: &str) -> bool {
        if !self.stage.has_exclusive() {
            return false;
        }
        let from = match (call.number, low_i32(call.args[0])) {
            (libc::SYS_openat, fd) if fd != libc::AT_FDCWD => format!("/proc/{tid}/fd/{fd}"),
            _ => format!("/proc/{tid}/cwd"),
        };
        let data = std::fs::metadata(std::path::Path::new(&from).join(path));
        let port = data.ok().and_then(|data| self.stage.port_of(data.rdev()));
        port.is_some_and(|port| self.stage.slot(port).is_exclusive) && !may_do_everything(tid)
    }

    /// Waits until all written bytes have left; `None` if they have.
    fn once_sent(&self, port: usize) -> Option<Outcome> {
        (self.stage.backlog(port) > 0).then_some(Outcome::Block(Wait {
            on: On::Line,
            deadline: None,
        }))
    }

    fn modem(
        &mut self,
        memory: Memory,
        port: usize,
        request: u64,
        argument: u64,
    ) -> Result<Outcome, Errno> {
        let lines = self.stage.modem(port);
        match request {
            libc::TIOCMGET => memory.write(argument, &lines.to_ne_bytes())?,
            libc::TIOCMBIS => self.stage.set_modem(port, lines | memory.u32(argument)?),
            libc::TIOCMBIC => self.stage.set_modem(port, lines & !memory.u32(argument)?),
            libc::TIOCMSET => self.stage.set_modem(port, memory.u32(argument)?),
            libc::TCSBRK | libc::TCSBRKP | libc::TIOCSBRK => self.stage.send_break(port),
            TIOCGICOUNT => {
                let mut counters = [0; ICOUNT_LEN];
                let counts = self.stage.line_changes(port).map(u32::to_ne_bytes).concat();
                counters[..counts.len()].copy_from_slice(&counts);
                let Traffic {
                    from_client,
                    to_client,
                } = self.stage.traffic(port);
                let damaged = self.stage.terminal(port).map(|it| it.damaged_count());
                let [framing, parity, breaks] = damaged.unwrap_or_default();
                let low = |count: u64| u32::try_from(count & 0xFFFF_FFFF).unwrap_or_default();
                // The next numbers: received, sent, framing errors, overruns, parity errors,
                // breaks.
                let more = [low(to_client), low(from_client), framing, 0, parity, breaks];
                let more = more.map(u32::to_ne_bytes).concat();
                counters[counts.len()..counts.len() + more.len()].copy_from_slice(&more);
                memory.write(argument, &counters)?;
            }
            _ => {}
        }
        Ok(Outcome::Answer(0))
    }
}

/// Whether a request changes nothing at a port.
const fn only_asks(request: u64) -> bool {
    matches!(
        request,
        libc::FIONREAD | libc::TIOCOUTQ | libc::TIOCMGET | TIOCMIWAIT | TIOCGICOUNT
    )
}

fn put_number(memory: Memory, address: u64, number: usize) -> Result<Outcome, Errno> {
    let number = i32::try_from(number).unwrap_or(i32::MAX);
    memory.write(address, &number.to_ne_bytes())?;
    Ok(Outcome::Answer(0))
}

/// Whether the process of `tid` has this capability.
fn may_do_everything(tid: i32) -> bool {
    let status = std::fs::read_to_string(format!("/proc/{tid}/status")).unwrap_or_default();
    let rights = status.lines().find_map(|line| line.strip_prefix("CapEff:"));
    let rights = rights.and_then(|rights| u64::from_str_radix(rights.trim(), 16).ok());
    rights.is_some_and(|rights| rights >> CAP_SYS_ADMIN & 1 != 0)
}

/// Whether a request may be one that a port answers in its own way.
const fn is_of_ports(request: u64) -> bool {
    is_settings(request)
        || matches!(
            request,
            libc::FIONREAD
                | libc::TIOCOUTQ
                | libc::TIOCEXCL
                | libc::TIOCNXCL
                | TIOCGEXCL
                | TIOCGSERIAL
                | TIOCSSERIAL
                | libc::TCFLSH
                | libc::TCXONC
                | libc::TCSBRK
                | libc::TCSBRKP
                | libc::TIOCSBRK
                | libc::TIOCCBRK
                | libc::TIOCMGET
                | libc::TIOCMBIS
                | libc::TIOCMBIC
                | libc::TIOCMSET
                | TIOCMIWAIT
                | TIOCGICOUNT
        )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::settings::TCGETS2;
    use crate::guest::supervisor::State;
    use crate::guest::supervisor::tests::{Bench, Told, error, fd};
    use crate::guest::tests::{Room, Stopped};

    const DTR: u32 = 2;
    const RTS: u32 = 4;
    /// CTS, DCD and DSR are on where no device sets them.
    const USUAL: u32 = 0x20 | 0x40 | 0x100;

    fn ioctl(bench: &mut Bench, port: &std::fs::File, request: u64, argument: u64) -> Told {
        bench.calls(libc::SYS_ioctl, &[fd(port), request, argument])
    }

    /// ioctl_tty(2): modem lines are read and set as a whole, or some of them.
    #[test]
    fn modem_lines_are_set_and_read() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let room = Room::new(80);
        let lines = |bench: &mut Bench| {
            assert_eq!(
                ioctl(bench, &port, libc::TIOCMGET, room.at(0)),
                Told::Answer(0)
            );
            room.numbers()[0].cast_unsigned()
        };
        assert_eq!(
            lines(&mut bench),
            USUAL | DTR | RTS,
            "an opening raises both"
        );
        let word = |lines: u32| Room::of(&lines.to_ne_bytes());
        for (request, given, expected) in [
            (libc::TIOCMBIC, DTR, RTS),
            (libc::TIOCMBIS, DTR, DTR | RTS),
            (libc::TIOCMBIC, DTR | RTS, 0),
            (libc::TIOCMBIS, RTS | 0x20, RTS),
            (libc::TIOCMSET, DTR, DTR),
            (libc::TIOCMSET, 0x1E0, 0),
        ] {
            let word = word(given);
            assert_eq!(
                ioctl(&mut bench, &port, request, word.at(0)),
                Told::Answer(0)
            );
            assert_eq!(lines(&mut bench), USUAL | expected, "{request:x} {given:x}");
        }
        assert_eq!(
            ioctl(&mut bench, &port, libc::TIOCMSET, 8),
            error(Errno::EFAULT)
        );
        let wait = Told::Waits(On::Files, None);
        assert_eq!(ioctl(&mut bench, &port, TIOCMIWAIT, 0x1E0), wait);
        assert_eq!(bench.again(), wait);
        // The driver's count of changes: CTS, DSR, RI, DCD.
        bench.thread().lines_before = Some([0, 0, 1, 0]);
        assert_eq!(bench.again(), Told::Answer(0));
        assert_eq!(ioctl(&mut bench, &port, TIOCMIWAIT, 0x160), wait);
        bench.thread().lines_before = Some([0, 0, 1, 0]);
        assert_eq!(bench.again(), wait, "RI is not wanted");
    }

    /// serial_icounter_struct: changes of the four lines, then received, sent, framing errors,
    /// overruns, parity errors, breaks.
    #[test]
    fn a_driver_counts_what_passes() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        bench.supervisor.stage.begin();
        let room = Room::of(&[0xA5; 88]);
        let text = Room::of(b"abc");
        assert_eq!(
            bench.calls(libc::SYS_write, &[fd(&port), text.at(0), 3]),
            Told::Answer(3)
        );
        bench.brings(7);
        let received = bench.supervisor.stage.traffic(0).to_client;
        let received = i32::try_from(received).expect("few");
        assert_eq!(
            ioctl(&mut bench, &port, TIOCGICOUNT, room.at(0)),
            Told::Answer(0)
        );
        let mut expected = vec![0; 22];
        [expected[4], expected[5]] = [received, 3];
        expected[20..].fill(i32::from_ne_bytes([0xA5; 4]));
        assert_eq!(room.numbers(), expected);
    }

    #[test]
    fn the_queues_of_a_port_are_counted() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        bench.supervisor.stage.begin();
        let room = Room::of(&[0xFF; 4]);
        let text = Room::of(&[b'x'; 100]);
        let count = |bench: &mut Bench, request| {
            assert_eq!(ioctl(bench, &port, request, room.at(0)), Told::Answer(0));
            room.numbers()[0]
        };
        assert_eq!(count(&mut bench, libc::FIONREAD), 0);
        assert_eq!(count(&mut bench, libc::TIOCOUTQ), 0);
        bench.brings(7);
        assert_eq!(count(&mut bench, libc::FIONREAD), 7);
        assert!(bench.thread().asks_port);
        assert_eq!(
            bench.calls(libc::SYS_write, &[fd(&port), text.at(0), 100]),
            Told::Answer(100)
        );
        let queued = count(&mut bench, libc::TIOCOUTQ);
        assert!((98..=100).contains(&queued), "{queued}");
        // tcdrain(3) is TCSBRK with an argument: it waits until all has left, 104 ms.
        let waits = Told::Waits(On::Line, None);
        assert_eq!(ioctl(&mut bench, &port, libc::TCSBRK, 1), waits);
        // tcflush(3): 0 is the input, 1 the output, 2 both.
        assert_eq!(ioctl(&mut bench, &port, libc::TCFLSH, 0), Told::Answer(0));
        assert_eq!(count(&mut bench, libc::FIONREAD), 0);
        assert!(count(&mut bench, libc::TIOCOUTQ) > 90);
        assert_eq!(ioctl(&mut bench, &port, libc::TCFLSH, 1), Told::Answer(0));
        assert_eq!(count(&mut bench, libc::TIOCOUTQ), 0);
        assert_eq!(ioctl(&mut bench, &port, libc::TCSBRK, 1), Told::Answer(0));
        bench.brings(3);
        assert_eq!(
            bench.calls(libc::SYS_write, &[fd(&port), text.at(0), 100]),
            Told::Answer(100)
        );
        assert_eq!(ioctl(&mut bench, &port, libc::TCFLSH, 1), Told::Answer(0));
        assert!(count(&mut bench, libc::FIONREAD) >= 3, "the input stays");
        assert_eq!(
            bench.calls(libc::SYS_write, &[fd(&port), text.at(0), 100]),
            Told::Answer(100)
        );
        assert_eq!(ioctl(&mut bench, &port, libc::TCFLSH, 2), Told::Answer(0));
        assert_eq!(
            (
                count(&mut bench, libc::FIONREAD),
                count(&mut bench, libc::TIOCOUTQ)
            ),
            (0, 0)
        );
        for wrong in [3, u64::MAX] {
            assert_eq!(
                ioctl(&mut bench, &port, libc::TCFLSH, wrong),
                error(Errno::EINVAL)
            );
        }
    }

    /// tcflow(3): TCOOFF is 0, TCOON 1, TCIOFF 2, TCION 3. VSTOP is the 10th character.
    #[test]
    fn output_is_suspended_and_goes_on() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let stopped = |bench: &mut Bench| {
            let terminal = bench.supervisor.stage.terminal(0);
            terminal.expect("it is there").is_stopped()
        };
        for (what, expected) in [
            (0, true),
            (1, false),
            (0, true),
            (2, true),
            (3, true),
            (1, false),
        ] {
            assert_eq!(
                ioctl(&mut bench, &port, libc::TCXONC, what),
                Told::Answer(0)
            );
            assert_eq!(stopped(&mut bench), expected, "{what}");
        }
        let terminal = bench.supervisor.stage.terminal(0).expect("it is there");
        let mut bytes = terminal.settings().bytes();
        (bytes[17 + 8], bytes[17 + 9]) = (0x11, 0x13);
        let settings = terminal.settings().with(&bytes);
        terminal.set(settings);
        terminal.take_own();
        ioctl(&mut bench, &port, libc::TCXONC, 2);
        ioctl(&mut bench, &port, libc::TCXONC, 3);
        let terminal = bench.supervisor.stage.terminal(0).expect("it is there");
        assert_eq!(terminal.take_own(), [0x13, 0x11]);
        assert_eq!(
            ioctl(&mut bench, &port, libc::TCXONC, 4),
            error(Errno::EINVAL)
        );
    }

    #[test]
    fn settings_are_those_that_were_set() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let room = Room::new(44);
        assert_eq!(
            ioctl(&mut bench, &port, TCGETS2, room.at(0)),
            Told::Answer(0)
        );
        let mut bytes = room.bytes();
        assert_eq!(bytes[36..44], [9_600_u32; 2].map(u32::to_ne_bytes).concat());
        // CRTSCTS is 0o20000000000, IXON 0o2000; 19200 bit/s are 14.
        bytes[17 + 6] = 9;
        bytes[0..4].copy_from_slice(&0o2000_u32.to_ne_bytes());
        bytes[8..12].copy_from_slice(&0o276_u32.to_ne_bytes());
        room.put(0, &bytes);
        for request in [libc::TCSETS, libc::TCSETSW, libc::TCSETSF] {
            assert_eq!(
                ioctl(&mut bench, &port, request, room.at(0)),
                Told::Answer(0)
            );
        }
        let terminal = bench.supervisor.stage.terminal(0).expect("it is there");
        let settings = *terminal.settings();
        assert_eq!((settings.input, settings.control), (0o2000, 0o276));
        assert_eq!(
            (
                settings.speeds,
                settings.code(crate::transport::Code::Least)
            ),
            ([19_200; 2], 9)
        );
        room.put(0, &[0; 44]);
        assert_eq!(
            ioctl(&mut bench, &port, libc::TCGETS, room.at(0)),
            Told::Answer(0)
        );
        assert_eq!(room.bytes()[..36], settings.bytes()[..36]);
        assert_eq!(room.bytes()[36..], [0; 8]);
        // The requests that wait do that for bytes that have not left; F discards the input.
        bench.supervisor.stage.begin();
        bench.brings(3);
        let text = Room::of(&[b'x'; 100]);
        bench.calls(libc::SYS_write, &[fd(&port), text.at(0), 100]);
        let unread = |bench: &mut Bench| bench.supervisor.stage.terminal(0).map(|it| it.unread());
        let waits = Told::Waits(On::Line, None);
        room.put(0, &bytes);
        assert_eq!(ioctl(&mut bench, &port, libc::TCSETSW, room.at(0)), waits);
        assert_eq!(ioctl(&mut bench, &port, libc::TCSETSF, room.at(0)), waits);
        assert_eq!(
            ioctl(&mut bench, &port, libc::TCSETS, room.at(0)),
            Told::Answer(0)
        );
        assert!(unread(&mut bench) >= Some(3));
        ioctl(&mut bench, &port, libc::TCFLSH, 1);
        assert_eq!(
            ioctl(&mut bench, &port, libc::TCSETSW, room.at(0)),
            Told::Answer(0)
        );
        assert!(unread(&mut bench) >= Some(3));
        assert_eq!(
            ioctl(&mut bench, &port, libc::TCSETSF, room.at(0)),
            Told::Answer(0)
        );
        assert_eq!(unread(&mut bench), Some(0));
        assert_eq!(
            ioctl(&mut bench, &port, libc::TCSETS, 8),
            error(Errno::EFAULT)
        );
        assert_eq!(
            ioctl(&mut bench, &port, libc::TCGETS, 8),
            error(Errno::EFAULT)
        );
    }

    /// TIOCEXCL and TIOCNXCL (ioctl_tty(2)): further openings are refused, except for processes
    /// with CAP_SYS_ADMIN, 21.
    #[test]
    fn a_port_may_be_exclusive() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let room = Room::of(&[0xFF; 4]);
        let is_exclusive = |bench: &mut Bench| {
            assert_eq!(ioctl(bench, &port, TIOCGEXCL, room.at(0)), Told::Answer(0));
            room.numbers()[0]
        };
        assert_eq!(is_exclusive(&mut bench), 0);
        let tid = bench.tid;
        let path = bench.path("sonar");
        let path = path.to_str().expect("text").to_owned();
        let call = Call::made(libc::SYS_open, &[]);
        assert!(!bench.supervisor.is_refused(tid, &call, &path));
        assert_eq!(ioctl(&mut bench, &port, libc::TIOCEXCL, 0), Told::Answer(0));
        assert_eq!(is_exclusive(&mut bench), 1);
        let may = may_do_everything(tid);
        assert_eq!(bench.supervisor.is_refused(tid, &call, &path), !may);
        assert!(!bench.supervisor.is_refused(tid, &call, "/dev/null"));
        assert_eq!(ioctl(&mut bench, &port, libc::TIOCNXCL, 0), Told::Answer(0));
        assert_eq!(is_exclusive(&mut bench), 0);
        assert!(!may_do_everything(-1));
    }

    #[test]
    fn the_flags_of_a_chip_are_kept() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let room = Room::of(&[0xFF; 72]);
        assert_eq!(
            ioctl(&mut bench, &port, TIOCGSERIAL, room.at(0)),
            Told::Answer(0)
        );
        assert_eq!(room.bytes(), [0; 72]);
        room.put(16, &0x2000_u32.to_ne_bytes());
        assert_eq!(
            ioctl(&mut bench, &port, TIOCSSERIAL, room.at(0)),
            Told::Answer(0)
        );
        room.put(0, &[0xFF; 72]);
        assert_eq!(
            ioctl(&mut bench, &port, TIOCGSERIAL, room.at(0)),
            Told::Answer(0)
        );
        assert_eq!(room.numbers()[4], 0x2000);
    }

    #[test]
    fn requests_are_those_of_ports_or_not() {
        for request in [
            libc::FIONREAD,
            libc::TIOCOUTQ,
            libc::TIOCEXCL,
            libc::TIOCNXCL,
            TIOCGEXCL,
            TIOCGSERIAL,
            TIOCSSERIAL,
            libc::TCFLSH,
            libc::TCXONC,
            libc::TCSBRK,
            libc::TCSBRKP,
            libc::TIOCSBRK,
            libc::TIOCCBRK,
            libc::TIOCMGET,
            libc::TIOCMBIS,
            libc::TIOCMBIC,
            libc::TIOCMSET,
            TIOCMIWAIT,
            TIOCGICOUNT,
            libc::TCGETS,
        ] {
            assert!(is_of_ports(request), "{request:x}");
            let asks = [
                libc::FIONREAD,
                libc::TIOCOUTQ,
                libc::TIOCMGET,
                TIOCMIWAIT,
                TIOCGICOUNT,
            ];
            assert_eq!(only_asks(request), asks.contains(&request), "{request:x}");
        }
        assert!(!is_of_ports(libc::TIOCGWINSZ) && !is_of_ports(libc::FIOCLEX));
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let null = std::fs::File::open("/dev/null").expect("it is there");
        assert_eq!(ioctl(&mut bench, &port, libc::TIOCGWINSZ, 8), Told::Kernel);
        assert_eq!(ioctl(&mut bench, &null, libc::TIOCMGET, 8), Told::Kernel);
        assert!(!bench.supervisor.is_signalled);
        bench.supervisor.has_terminals = true;
        assert_eq!(ioctl(&mut bench, &port, libc::TIOCSWINSZ, 8), Told::Kernel);
        assert!(
            bench.supervisor.is_signalled,
            "the size of a terminal is told by a signal"
        );
        for request in [libc::TIOCCBRK, libc::TIOCSBRK, libc::TCSBRKP] {
            assert_eq!(ioctl(&mut bench, &port, request, 0), Told::Answer(0));
        }
    }

    /// capset(2): version 3, the process itself, and six words without a capability.
    #[test]
    fn an_exclusive_port_is_refused_without_the_capability() {
        let process = Stopped::that_calls();
        let (pid, place) = (process.pid, process.registers().rsp - 2_048);
        let mut words = [0_u32; 8];
        words[0] = 0x2008_0522;
        let bytes = words.map(u32::to_ne_bytes);
        let written = Memory(pid).write(place, bytes.as_flattened());
        written.expect("its stack");
        assert_eq!(process.makes(libc::SYS_capset, &[place, place + 8]), 0);
        assert!(!may_do_everything(pid.as_raw()));
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let path = bench.path("sonar");
        let path = path.to_str().expect("text").to_owned();
        let tid = pid.as_raw();
        bench.add(tid, tid, State::Running);
        let by_path = Call::made(libc::SYS_open, &[]);
        // AT_FDCWD is -100.
        let in_folder = Call::made(libc::SYS_openat, &[(-100_i64).cast_unsigned()]);
        assert!(!bench.supervisor.is_refused(tid, &by_path, &path));
        assert_eq!(ioctl(&mut bench, &port, libc::TIOCEXCL, 0), Told::Answer(0));
        for call in [by_path, in_folder] {
            assert!(bench.supervisor.is_refused(tid, &call, &path));
            assert!(!bench.supervisor.is_refused(tid, &call, "/dev/null"));
        }
        // A name in a folder that it has open.
        let folder = path.strip_suffix("sonar").expect("its name");
        let text = [folder.as_bytes(), &[0]].concat();
        Memory(pid).write(place, &text).expect("its stack");
        let opened = process.makes(libc::SYS_open, &[place, 0]);
        let in_it = Call::made(libc::SYS_openat, &[opened.cast_unsigned()]);
        assert!(bench.supervisor.is_refused(tid, &in_it, "sonar"));
        assert!(!bench.supervisor.is_refused(tid, &in_folder, "sonar"));
    }

    /// tcsendbreak(3): TCSBRK without an argument waits for nothing; with one it is tcdrain.
    #[test]
    fn a_break_is_sent_while_bytes_leave() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        bench.supervisor.stage.begin();
        let text = Room::of(&[b'x'; 100]);
        let write = [fd(&port), text.at(0), 100];
        assert_eq!(bench.calls(libc::SYS_write, &write), Told::Answer(100));
        let waits = Told::Waits(On::Line, None);
        assert_eq!(ioctl(&mut bench, &port, libc::TCSBRK, 1), waits);
        assert_eq!(ioctl(&mut bench, &port, libc::TCSBRK, 0), Told::Answer(0));
    }
}
