//! What a program asks of a port besides bytes: rates, queues, modem lines, breaks.

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;

use super::clocks::low_i32;
use super::files::{File, Kind};
use super::{Memory, On, Outcome, Supervisor, Wait};
use crate::guest::call::Call;
use crate::guest::launch::{TIOCGICOUNT, TIOCMIWAIT};
use crate::inputs::INPUTS;

/// Requests of rates that all processors know, but not `libc`'s module for this system.
const TCSETS2: u64 = 0x402C_542B;
const TCSETSW2: u64 = 0x402C_542C;
const TCSETSF2: u64 = 0x402C_542D;
/// Bytes of what the latter fills: twenty numbers, the first four of them changes of lines.
const ICOUNT_LEN: usize = 80;

impl Supervisor {
    pub(super) fn ioctl(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [fd, request, argument, ..] = call.args;
        // Most are about other terminals and sockets.
        if !is_of_ports(request) {
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
                let there = rustix::io::ioctl_fionread(&file.fd).unwrap_or(0);
                let there = i32::try_from(there).unwrap_or(i32::MAX);
                memory.write(argument, &there.to_ne_bytes())?;
                Ok(Outcome::Answer(0))
            }
            libc::TIOCOUTQ => {
                let waiting = i32::try_from(self.stage.backlog(port)).unwrap_or(i32::MAX);
                memory.write(argument, &waiting.to_ne_bytes())?;
                Ok(Outcome::Answer(0))
            }
            // The rig itself opens the port now and then; two programs at one port see each other
            // all the same, by their locks.
            libc::TIOCEXCL | libc::TIOCNXCL => Ok(Outcome::Answer(0)),
            libc::TCFLSH => {
                if matches!(low_i32(argument), libc::TCIFLUSH | libc::TCIOFLUSH) {
                    // What is still on its way the kernel would bring later.
                    self.stage.settle(port, &file.fd);
                    self.stage.forget_unread(port);
                }
                Ok(Outcome::Kernel)
            }
            libc::TCSETSF | TCSETSF2 => Ok(self.once_sent(port, &file, true)),
            libc::TCSETSW | TCSETSW2 => Ok(self.once_sent(port, &file, false)),
            libc::TCSETS | TCSETS2 => Ok(Outcome::Kernel),
            libc::TCSBRK if argument != 0 => Ok(match self.once_sent(port, &file, false) {
                Outcome::Kernel => Outcome::Answer(0),
                wait => wait,
            }),
            TIOCMIWAIT => Ok(self.wait_for_line(tid, port, argument)),
            _ => self.modem(memory, port, request, argument),
        }
    }

    /// Until one of the lines in `wanted` has changed since the call began.
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

    /// The kernel does it once all that was written has left.
    fn once_sent(&mut self, port: usize, file: &File, forgets: bool) -> Outcome {
        if self.stage.backlog(port) > 0 {
            return Outcome::Block(Wait {
                on: On::Line,
                deadline: None,
            });
        }
        if forgets {
            self.stage.settle(port, &file.fd);
            self.stage.forget_unread(port);
        }
        Outcome::Kernel
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

/// Whether a request may be one that a port answers in its own way.
const fn is_of_ports(request: u64) -> bool {
    matches!(
        request,
        libc::FIONREAD
            | libc::TIOCOUTQ
            | libc::TIOCEXCL
            | libc::TIOCNXCL
            | libc::TCFLSH
            | libc::TCSETS
            | libc::TCSETSW
            | libc::TCSETSF
            | TCSETS2
            | TCSETSW2
            | TCSETSF2
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
