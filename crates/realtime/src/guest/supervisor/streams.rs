//! Reads and writes: a call that may wait is executed when it can be executed.

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use rustix::event::PollFlags;
use rustix::net::sockopt::{self, Timeout};

use super::clocks::low_i32;
use super::files::{EVENT, File, Form, Kind};
use super::{Memory, On, Outcome, Supervisor, Wait};
use crate::guest::call::Call;

impl Supervisor {
    pub(super) fn read(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let fd = low_i32(call.args[0]);
        let Some(file) = self.file(tid, fd) else {
            // For the detection of busy waiting, the supervisor must see that this call has no
            // success.
            return match fd < 0 {
                true => Err(Errno::EBADF),
                false => Ok(Outcome::Kernel),
            };
        };
        if let Some(outcome) = unsupported(tid, call, &file, file.is_readable())? {
            return Ok(outcome);
        }
        match file.kind {
            Kind::Prompt | Kind::Mouth => Ok(Outcome::Kernel),
            Kind::Port(port) => self.read_port(tid, call, &file, port),
            Kind::Told(which) => self.read_told(tid, call, &file, which),
            Kind::Gone => {
                self.stage.note_fruitless();
                Ok(Outcome::Kernel)
            }
            Kind::Chance => {
                let total = lens(&buffers(tid, call)?);
                let bytes = self.chance(tid, total.min(1 << 20));
                scatter(tid, &buffers(tid, call)?, &bytes)?;
                Ok(Outcome::Answer(i64::try_from(bytes.len()).unwrap_or(0)))
            }
            Kind::Stream => {
                if let Some(outcome) = self.read_timer(tid, call, &file) {
                    return outcome;
                }
                let waits = waits_by_flag(call) && !file.never_waits();
                // For the detection of busy waiting, the supervisor must see that this call has no
                // success.
                if !waits && is_plain_receive(call) && file.readiness(PollFlags::IN).is_empty() {
                    return Err(Errno::EAGAIN);
                }
                self.when_ready(tid, &file, PollFlags::IN, waits)
            }
            Kind::Signals => Ok(self.read_signals(tid, &file)),
        }
    }

    pub(super) fn write(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let fd = low_i32(call.args[0]);
        let Some(file) = self.file(tid, fd) else {
            return Ok(Outcome::Kernel);
        };
        if let Some(outcome) = unsupported(tid, call, &file, file.is_writable())? {
            return Ok(outcome);
        }
        // A terminal of the program itself may send signals: Ctrl-C.
        if file.kind == Kind::Stream && file.device.is_some() {
            self.types(&file);
        }
        match file.kind {
            Kind::Prompt | Kind::Told(_) | Kind::Mouth | Kind::Chance | Kind::Signals => {
                Ok(Outcome::Kernel)
            }
            // Among these files, only a counter takes bytes.
            Kind::Stream if file.form == Form::Events => Ok(Outcome::Kernel),
            Kind::Port(port) => self.write_port(tid, call, &file, port),
            Kind::Gone => {
                self.stage.note_fruitless();
                Ok(Outcome::Kernel)
            }
            Kind::Stream => self.write_stream(tid, call, &file),
        }
    }

    /// Handles recvmmsg: it waits for the first message here; the kernel waits if the program wants
    /// more messages.
    pub(super) fn receive_many(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [fd, _, count, flags, ..] = call.args.map(low_i32);
        let file = self.file(tid, fd).ok_or(Errno::EBADF)?;
        if file.form != Form::Socket {
            return Err(Errno::ENOTSOCK);
        }
        if count > 1 && flags & (libc::MSG_WAITFORONE | libc::MSG_DONTWAIT) == 0 {
            self.note("recvmmsg is done by the kernel".to_owned());
        }
        let waits = flags & libc::MSG_DONTWAIT == 0;
        self.when_ready(tid, &file, PollFlags::IN, waits)
    }

    /// Lets the kernel execute the call when it does not have to wait; sockets may have a timeout
    /// of their own.
    pub(super) fn when_ready(
        &self,
        tid: i32,
        file: &File,
        wanted: PollFlags,
        waits: bool,
    ) -> Result<Outcome, Errno> {
        if !waits || file.never_waits() || !file.readiness(wanted).is_empty() {
            return Ok(Outcome::Kernel);
        }
        let which = match wanted {
            PollFlags::OUT => Timeout::Send,
            _ => Timeout::Recv,
        };
        let most = sockopt::socket_timeout(&file.fd, which).ok().flatten();
        let deadline = most.map(|most| self.entered(tid) + most);
        if deadline.is_some_and(|at| self.stage.now() >= at) {
            return Err(Errno::EAGAIN);
        }
        Ok(Outcome::Block(Wait {
            on: On::Files,
            deadline,
        }))
    }
}

/// A call that fails or has no effect at once: because of the file's type or its flags, or because
/// there is nothing to do.
fn unsupported(
    tid: i32,
    call: &Call,
    file: &File,
    is_allowed: bool,
) -> Result<Option<Outcome>, Errno> {
    let is_plain = matches!(
        call.number,
        libc::SYS_read | libc::SYS_readv | libc::SYS_write | libc::SYS_writev
    );
    if !is_plain {
        return match file.form == Form::Socket {
            true => Ok(None),
            false => Err(Errno::ENOTSOCK),
        };
    }
    if !is_allowed {
        return Err(Errno::EBADF);
    }
    let least = match (file.kind, file.form) {
        (Kind::Stream | Kind::Signals, Form::Counter | Form::Events) => EVENT,
        (Kind::Stream, Form::Pipe | Form::Socket) => 1,
        _ => return Ok(None),
    };
    let is_short = lens(&buffers(tid, call)?) < least;
    Ok(is_short.then_some(Outcome::Kernel))
}

/// Whether the call's own flags permit it to wait.
pub(super) fn waits_by_flag(call: &Call) -> bool {
    let flags = match call.number {
        libc::SYS_recvfrom | libc::SYS_sendto => call.args[3],
        libc::SYS_recvmsg | libc::SYS_sendmsg => call.args[2],
        _ => 0,
    };
    low_i32(flags) & libc::MSG_DONTWAIT == 0
}

/// Whether a call only accepts a connection, or receives arrived data of a socket.
fn is_plain_receive(call: &Call) -> bool {
    let flags = match call.number {
        libc::SYS_accept | libc::SYS_accept4 => return true,
        libc::SYS_recvfrom => call.args[3],
        libc::SYS_recvmsg => call.args[2],
        _ => return false,
    };
    low_i32(flags) & !(libc::MSG_DONTWAIT | libc::MSG_PEEK | libc::MSG_NOSIGNAL) == 0
}

/// The buffers of a call that reads or writes: address and length.
pub(super) fn buffers(tid: i32, call: &Call) -> Result<Vec<(u64, usize)>, Errno> {
    let [_, address, len, ..] = call.args;
    match call.number {
        libc::SYS_readv | libc::SYS_writev => Memory(Pid::from_raw(tid)).iovecs(address, len),
        _ => Ok(vec![(address, usize::try_from(len).unwrap_or(usize::MAX))]),
    }
}

/// Total length of all buffers.
pub(super) fn lens(buffers: &[(u64, usize)]) -> usize {
    let lens = buffers.iter().map(|&(_, len)| len);
    lens.fold(0, usize::saturating_add)
}

/// Fills the buffers with `bytes`.
pub(super) fn scatter(tid: i32, buffers: &[(u64, usize)], bytes: &[u8]) -> Result<(), Errno> {
    let mut rest = bytes;
    for &(address, len) in buffers {
        let (now, later) = rest.split_at(len.min(rest.len()));
        Memory(Pid::from_raw(tid)).write(address, now)?;
        rest = later;
    }
    Ok(())
}

/// At most `most` bytes of the buffers, after the first `skip` bytes.
pub(super) fn gather(
    tid: i32,
    buffers: &[(u64, usize)],
    skip: usize,
    most: usize,
) -> Result<Vec<u8>, Errno> {
    let mut bytes = Vec::new();
    let mut skip = skip;
    for &(address, len) in buffers {
        let from = skip.min(len);
        skip -= from;
        let take = (len - from).min(most - bytes.len());
        let start = bytes.len();
        bytes.resize(start + take, 0);
        Memory(Pid::from_raw(tid)).read(address.wrapping_add(from as u64), &mut bytes[start..])?;
    }
    Ok(bytes)
}
