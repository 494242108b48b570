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
