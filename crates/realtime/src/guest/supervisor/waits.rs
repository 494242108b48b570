//! Waits for children: the supervisor makes the kernel's call without waiting, and again when a
//! child has ended.

use nix::libc;
use nix::sys::ptrace;
use nix::unistd::Pid;

use super::{Memory, On, Outcome, Supervisor, Wait, is_death};
use crate::guest::call::Call;

/// Length of the data about a child's use of the processor, bytes.
const RUSAGE: usize = 144;
/// Offset and length of these data in the result of `waitid`: `si_utime` and `si_stime`.
const INFO_TIMES: u64 = 32;
const INFO_TIMES_LEN: usize = 16;

impl Supervisor {
    pub(super) fn wait_for_child(&mut self, tid: i32, call: &Call) -> Outcome {
        let pid = Pid::from_raw(tid);
        let (index, place) = match call.number {
            libc::SYS_wait4 => (2, call.args[1]),
            _ => (3, call.args[2]),
        };
        let nohang = u64::from(libc::WNOHANG.unsigned_abs());
        let options = call.args[index];
        let usage = match call.number {
            libc::SYS_wait4 => call.args[3],
            _ => call.args[4],
        };
        let is_hasty = options & nohang != 0;
        let tells_times = call.number == libc::SYS_waitid && place != 0;
        if is_hasty && usage == 0 && !tells_times && self.fatal.is_empty() {
            return Outcome::Kernel;
        }
        if tells_times {
            let _ = Memory(pid).write(place, &[0; 4]);
        }
        let asked = call.with(pid, index, options | nohang);
        if asked.is_err() || ptrace::syscall(pid, None).is_err() {
            return Outcome::Kernel;
        }
        let Some((_, status)) = self.wait_for(tid) else {
            return Outcome::Kernel;
        };
        if is_death(status) {
            self.died(tid, status);
            return Outcome::Kernel;
        }
        let Ok(end) = Call::of(pid) else {
            return Outcome::Kernel;
        };
        let has_found_none = match call.number {
            libc::SYS_wait4 => end.result() == 0,
            _ => end.result() == 0 && Memory(pid).u32(place).is_ok_and(|signal| signal == 0),
        };
        if !has_found_none && usage != 0 {
            // The system's processor time is hidden.
            let _ = Memory(pid).write(usage, &[0; RUSAGE]);
        }
        if !has_found_none && end.result() == 0 && tells_times {
            let _ = Memory(pid).write(place.wrapping_add(INFO_TIMES), &[0; INFO_TIMES_LEN]);
        }
        if let Ok(child) = i32::try_from(end.result())
            && let Some(signal) = self.fatal.remove(&child)
            && call.number == libc::SYS_wait4
            && place != 0
        {
            let _ = Memory(pid).write(place, &signal.to_ne_bytes());
        }
        if !has_found_none || is_hasty {
            // The program's thread continues from here; its option is restored.
            let _ = end.with_result(pid, index, options, end.result());
            return Outcome::Kernel;
        }
        // The thread makes the call again when it continues.
        let _ = end.with_result_again(pid, index, options, call.number);
        self.set_at_end(tid, true);
        Outcome::Block(Wait {
            on: On::Child,
            deadline: None,
        })
    }

    pub(super) fn set_at_end(&mut self, tid: i32, is_at_end: bool) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.is_at_end = is_at_end;
        }
    }
}
