//! Settings and queues of a port in real time: the kernel's pseudo-terminal drops parity and
//! character sizes, and does not know that the line takes time. This module stores the settings and
//! reports them to the rig.

use std::os::fd::OwnedFd;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{PidfdFlags, PidfdGetfdFlags, pidfd_getfd, pidfd_open};
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};
use serde_json::json;

use super::super::call::Call;
use super::super::memory::Memory;
use super::super::settings::{
    errno_of, flushes, is_settings, read_back, serial, waits_until_sent, wanted,
};
use super::Tracer;
use super::launch::{TIOCGSERIAL, TIOCSSERIAL};
use crate::transport::Settings;

/// Result of a request.
pub(super) enum Done {
    ByKernel,
    /// The call must wait until all written bytes have left.
    Later,
    With(i64),
}

/// Whether this module answers the request.
pub(super) const fn is_one(request: u64, argument: u64) -> bool {
    is_settings(request)
        || matches!(
            request,
            libc::TIOCOUTQ | libc::TCFLSH | TIOCGSERIAL | TIOCSSERIAL
        )
        || (request == libc::TCSBRK && argument != 0)
}

/// A copy of a stopped thread's file.
pub(super) fn copy_of(pid: Pid, fd: u64) -> Option<OwnedFd> {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let process = status.lines().find_map(|line| line.strip_prefix("Tgid:"))?;
    let process = rustix::process::Pid::from_raw(process.trim().parse().ok()?)?;
    let process = pidfd_open(process, PidfdFlags::empty()).ok()?;
    pidfd_getfd(process, i32::try_from(fd).ok()?, PidfdGetfdFlags::empty()).ok()
}

/// Whether the port behind a file has hung up.
pub(super) fn is_hung_up(file: &OwnedFd) -> bool {
    let mut fds = [PollFd::new(file, PollFlags::empty())];
    let polled = poll(&mut fds, Some(&Timespec::default()));
    polled.is_ok() && fds[0].revents().contains(PollFlags::HUP)
}

impl Tracer {
    /// Answers a request about settings or queues.
    pub(super) fn about_terminal(
        &mut self,
        pid: Pid,
        call: &Call,
        port: (u64, &str),
        file: &OwnedFd,
    ) -> Done {
        let [_, request, argument, ..] = call.args;
        let (device, name) = port;
        let result = match request {
            libc::TCFLSH => {
                // The kernel executes the rest of the request.
                if matches!(
                    i32::try_from(argument),
                    Ok(libc::TCOFLUSH | libc::TCIOFLUSH)
                ) {
                    self.ask(name, &json!({"do": "modem", "port": name, "discard": true}));
                }
                return Done::ByKernel;
            }
            libc::TIOCOUTQ => {
                self.ask(name, &json!({"do": "modem", "port": name}));
                let waiting = i32::try_from(self.waiting).unwrap_or(i32::MAX);
                Memory(pid).write(argument, &waiting.to_ne_bytes())
            }
            TIOCGSERIAL | TIOCSSERIAL => {
                let flags = self.serial_flags.entry(device).or_default();
                serial(Memory(pid), request == TIOCSSERIAL, argument, flags)
            }
            _ if request == libc::TCSBRK || waits_until_sent(request) => {
                self.ask(name, &json!({"do": "modem", "port": name}));
                if self.waiting > 0 {
                    return Done::Later;
                }
                self.once_sent(pid, call, (device, name), file)
            }
            _ => match self.settings(pid, call, (device, name), file) {
                Ok(true) => Ok(()),
                Ok(false) => return Done::ByKernel,
                Err(errno) => Err(errno),
            },
        };
        Done::With(code(result))
    }

    /// Executes the request after all written bytes have left.
    pub(super) fn once_sent(
        &mut self,
        pid: Pid,
        call: &Call,
        port: (u64, &str),
        file: &OwnedFd,
    ) -> Result<(), Errno> {
        match call.args[1] {
            libc::TCSBRK => Ok(()),
            _ => self.settings(pid, call, port, file).map(|_| ()),
        }
    }

    /// Reads or changes settings; returns whether the request is complete without the kernel.
    fn settings(
        &mut self,
        pid: Pid,
        call: &Call,
        (device, name): (u64, &str),
        file: &OwnedFd,
    ) -> Result<bool, Errno> {
        let [_, request, argument, ..] = call.args;
        let mut termios = tcgetattr(file).map_err(errno_of)?;
        let kernel = Settings::of_kernel(&termios);
        let told = self.settings.get(&device);
        let before = told.map_or(kernel, |told| told.merged(&kernel));
        if let Some(bytes) = read_back(&before, request) {
            if told.is_none() {
                return Ok(false);
            }
            Memory(pid).write(argument, &bytes)?;
            return Ok(true);
        }
        let wanted = wanted(Memory(pid), &before, request, argument)?;
        set(file, &mut termios, &wanted, flushes(request))?;
        self.settings.insert(device, wanted);
        let modes = [wanted.input, wanted.control];
        self.ask(name, &json!({"do": "modem", "port": name, "modes": modes}));
        Ok(true)
    }
}

/// Sets the supported part of `wanted` in the kernel.
fn set(
    file: &OwnedFd,
    termios: &mut Termios,
    wanted: &Settings,
    flushes: bool,
) -> Result<(), Errno> {
    wanted.for_kernel().put_into(termios).map_err(errno_of)?;
    let when = match flushes {
        true => OptionalActions::Flush,
        false => OptionalActions::Now,
    };
    tcsetattr(file, when, termios).map_err(errno_of)
}

/// The result for the program.
pub(super) fn code(result: Result<(), Errno>) -> i64 {
    result.map_or_else(|errno| -i64::from(errno as i32), |()| 0)
}
