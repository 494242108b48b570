//! Signals from 32 to 64, for a thread that has stopped at one.
//!
//! Without unsafe code, a supervisor can only deliver signals up to 31. So it borrows one of these.
//! While all other signals are blocked, the borrowed one gets the handler of the real one. The
//! kernel creates the frame of that handler, with its stack, its floating point registers and the
//! information about the signal. Then the supervisor corrects number and masks in the frame, and
//! the thread continues.
//!
//! ```text
//!  stop at 35        SIGSTKFLT gets the handler of 35; sent; stop; goes on by one step
//!  handler(16, ..)   16 -> 35, masks of before and of 35, SIGSTKFLT gets its own handler back
//!  handler(35, ..)   goes on
//! ```

use nix::libc;
use nix::sys::ptrace;
use nix::sys::signal::Signal;
use nix::unistd::Pid;

use super::inject::{Hands, NotMade};
use super::memory::Memory;
use super::pending::Pending;

/// The borrowed signal: no program sends it.
const LENT: Signal = Signal::SIGSTKFLT;
/// Number of bytes below its stack pointer that a program may use.
const RED_ZONE: u64 = 128;
/// Length of the signal masks that the kernel accepts.
const MASK_LEN: u64 = 8;
const SIG_SETMASK: u64 = 2;
const SIG_DFL: u64 = 0;
const SIG_IGN: u64 = 1;
const SA_SIGINFO: u64 = 4;
const SA_NODEFER: u64 = 0x4000_0000;
const SA_RESETHAND: u64 = 0x8000_0000;
/// Offset of the signal mask in the context of a handler; the kernel restores this mask after the
/// handler.
const CONTEXT_MASK: u64 = 296;
/// Results with which the kernel stores how an interrupted call continues.
const ERESTARTSYS: i64 = -512;
const ERESTARTNOINTR: i64 = -513;
const ERESTARTNOHAND: i64 = -514;
const ERESTART_RESTARTBLOCK: i64 = -516;
/// Number of borrowed bytes below the stack, and the offsets of their parts.
const SCRATCH: usize = 128;
const NEW_MASK: u64 = 0;
const OLD_MASK: u64 = 8;
const ITS_ACTION: u64 = 16;
const LENT_ACTION: u64 = 48;
const OLD_ACTION: u64 = 80;

/// State of the thread after a delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Delivered {
    /// The thread can continue, at the handler or where it was.
    Goes,
    /// The signal has no handler and kills the process.
    Fatal,
    /// The thread has ended, with this status.
    Ended(i32),
    /// The signal cannot be delivered.
    Refused,
}

/// A program's action for a signal, in the kernel's format.
#[derive(Clone, Copy, Debug)]
struct Action {
    handler: u64,
    flags: u64,
    restorer: u64,
    mask: u64,
}

impl Action {
    fn read(memory: Memory, place: u64) -> Result<Self, NotMade> {
        let word = |index: u64| memory.u64(place.wrapping_add(8 * index));
        Ok(Self {
            handler: word(0)?,
            flags: word(1)?,
            restorer: word(2)?,
            mask: word(3)?,
        })
    }

    fn bytes(self) -> [u8; 32] {
        let words = [self.handler, self.flags, self.restorer, self.mask];
        let mut bytes = [0; 32];
        for (to, word) in bytes.chunks_exact_mut(8).zip(words) {
            to.copy_from_slice(&word.to_ne_bytes());
        }
        bytes
    }
}

/// Borrowed memory below a thread's stack.
struct Scratch {
    memory: Memory,
    place: u64,
    before: [u8; SCRATCH],
}

impl Scratch {
    fn borrow(tid: Pid, stack: u64) -> Result<Self, NotMade> {
        let memory = Memory(tid);
        // A stack pointer may be anything.
        let place = stack.wrapping_sub(RED_ZONE + SCRATCH as u64) & !15;
        if place.checked_add(SCRATCH as u64).is_none() {
            return Err(NotMade::Refused);
        }
        let mut before = [0; SCRATCH];
        memory.read(place, &mut before)?;
        Ok(Self {
            memory,
            place,
            before,
        })
    }

    fn give_back(&self) {
        let _ = self.memory.write(self.place, &self.before);
    }
}

/// The kernel's bit of a signal.
const fn bit(signal: i32) -> u64 {
    1 << (signal - 1)
}

/// Delivers `signal` to the thread `tid` of `process`, which has stopped at it. `told` replaces the
/// kernel's information about the signal for the handler.
pub(super) fn deliver(process: i32, tid: Pid, signal: i32, told: Option<&[u8]>) -> Delivered {
    match try_to(process, tid, signal, told) {
        Ok(delivered) => delivered,
        Err(NotMade::Ended(status)) => Delivered::Ended(status),
        Err(NotMade::Refused) => Delivered::Refused,
    }
}

fn try_to(process: i32, tid: Pid, signal: i32, told: Option<&[u8]>) -> Result<Delivered, NotMade> {
    let memory = Memory(tid);
    let registers = ptrace::getregs(tid)?;
    let mut info = ptrace::getsiginfo(tid)?;
    // While a call waits with its own mask, this is that mask.
    let held = Pending::of(process, tid.as_raw()).blocked;
    let mut hands = Hands::of(tid, registers)?;
    let [of, thread] = [process, tid.as_raw()].map(|id| u64::from(id.cast_unsigned()));
    let [number, lent] = [signal, LENT as i32].map(|id| u64::from(id.cast_unsigned()));

    let scratch = Scratch::borrow(tid, registers.rsp)?;
    let at = scratch.place;
    let asked = [number, 0, at + ITS_ACTION, MASK_LEN];
    hands.call(libc::SYS_rt_sigaction, &asked)?;
    let action = Action::read(memory, at + ITS_ACTION)?;
    if matches!(action.handler, SIG_DFL | SIG_IGN) {
        scratch.give_back();
        hands.send_again(process)?;
        ptrace::setregs(tid, undisturbed(registers))?;
        return Ok(match action.handler {
            SIG_DFL => Delivered::Fatal,
            _ => Delivered::Goes,
        });
    }
    let is_held_back = action.flags & SA_NODEFER == 0;
    let own = if is_held_back { bit(signal) } else { 0 };
    let substitute = Action {
        flags: action.flags | SA_NODEFER,
        ..action
    };
    memory.write(at + NEW_MASK, &(!bit(LENT as i32)).to_ne_bytes())?;
    memory.write(at + LENT_ACTION, &substitute.bytes())?;
    let masks = [SIG_SETMASK, at + NEW_MASK, at + OLD_MASK, MASK_LEN];
    hands.call(libc::SYS_rt_sigprocmask, &masks)?;
    let lends = [lent, at + LENT_ACTION, at + OLD_ACTION, MASK_LEN];
    hands.call(libc::SYS_rt_sigaction, &lends)?;
    let old_mask = memory.u64(at + OLD_MASK)?;
    let old_action = Action::read(memory, at + OLD_ACTION)?;
    hands.call(libc::SYS_tgkill, &[of, thread, lent])?;
    hands.stop_at(LENT)?;
    scratch.give_back();

    // The kernel again decides how the interrupted call continues.
    ptrace::setregs(tid, registers)?;
    info.si_signo = LENT as i32;
    ptrace::setsiginfo(tid, &info)?;
    ptrace::step(tid, LENT)?;
    hands.next_stop()?;
    let mut begun = ptrace::getregs(tid)?;
    if begun.rip != action.handler {
        // The stack has no room for the frame: the program gets the usual error of the kernel.
        return Ok(Delivered::Goes);
    }
    if action.flags & SA_SIGINFO != 0 {
        match told {
            Some(told) => memory.write(begun.rsi, told)?,
            None => memory.write(begun.rsi, &signal.to_ne_bytes())?,
        }
    }
    memory.write(
        begun.rdx.wrapping_add(CONTEXT_MASK),
        &old_mask.to_ne_bytes(),
    )?;
    begun.rdi = number;
    begun.orig_rax = u64::MAX;

    hands.become_like(begun);
    let scratch = Scratch::borrow(tid, begun.rsp)?;
    let at = scratch.place;
    memory.write(at + OLD_ACTION, &old_action.bytes())?;
    hands.call(
        libc::SYS_rt_sigaction,
        &[lent, at + OLD_ACTION, 0, MASK_LEN],
    )?;
    if action.flags & SA_RESETHAND != 0 {
        let default = Action {
            handler: SIG_DFL,
            ..action
        };
        memory.write(at + LENT_ACTION, &default.bytes())?;
        let resets = [number, at + LENT_ACTION, 0, MASK_LEN];
        hands.call(libc::SYS_rt_sigaction, &resets)?;
    }
    hands.send_again(process)?;
    let mask = held | action.mask | own;
    memory.write(at + NEW_MASK, &mask.to_ne_bytes())?;
    let masks = [SIG_SETMASK, at + NEW_MASK, 0, MASK_LEN];
    hands.call(libc::SYS_rt_sigprocmask, &masks)?;
    scratch.give_back();
    ptrace::setregs(tid, begun)?;
    Ok(Delivered::Goes)
}

/// The registers of a thread that repeats its call as if no signal had come.
const fn undisturbed(registers: libc::user_regs_struct) -> libc::user_regs_struct {
    let mut next = registers;
    if registers.orig_rax.cast_signed() < 0 {
        return next;
    }
    next.rax = match registers.rax.cast_signed() {
        ERESTARTSYS | ERESTARTNOINTR | ERESTARTNOHAND => registers.orig_rax,
        ERESTART_RESTARTBLOCK => libc::SYS_restart_syscall.cast_unsigned(),
        _ => return next,
    };
    next.rip -= 2;
    next.orig_rax = u64::MAX;
    next
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the kernel keeps of an action: handler, flags, restorer, mask, in this order.
    #[test]
    fn an_action_is_four_words() {
        let room = crate::guest::tests::Room::of_words(&[9, 1, 2, 3, 4]);
        let memory = Memory(crate::guest::tests::own());
        let action = Action::read(memory, room.at(8)).expect("own");
        assert_eq!(
            [action.handler, action.flags, action.restorer, action.mask],
            [1, 2, 3, 4]
        );
        assert_eq!(action.bytes(), room.bytes()[8..]);
        assert!(Action::read(memory, 8).is_err());
        assert_eq!([1, 2, 34, 64].map(bit), [1, 2, 1 << 33, 1 << 63]);
    }

    /// Below the stack a program keeps 128 bytes to itself; the borrowed 128 bytes begin at a
    /// multiple of 16.
    #[test]
    fn memory_below_a_stack_is_borrowed() {
        let room =
            crate::guest::tests::Room::of(&(0..=255).cycle().take(1_024).collect::<Vec<u8>>());
        let own = crate::guest::tests::own();
        let base = room.at(512) & !15;
        for offset in [0, 1, 15] {
            let scratch = Scratch::borrow(own, base + 256 + offset).expect("own");
            assert_eq!(scratch.place, base, "{offset}");
        }
        let before = room.bytes();
        let scratch = Scratch::borrow(own, base + 256).expect("own");
        scratch.memory.write(base, &[0xEE; 128]).expect("own");
        assert_ne!(room.bytes(), before);
        scratch.give_back();
        assert_eq!(room.bytes(), before);
        assert!(
            Scratch::borrow(own, 255).is_err(),
            "there is nothing below it"
        );
        assert!(Scratch::borrow(own, 4_096).is_err(), "no memory");
    }

    /// ERESTARTSYS 512, ERESTARTNOINTR 513 and ERESTARTNOHAND 514 make the same call again,
    /// ERESTART_RESTARTBLOCK 516 restart_syscall (linux/errno.h).
    #[test]
    fn a_call_goes_on_as_if_no_signal_had_come() {
        let of = |number: i64, result: i64| {
            let mut registers = crate::guest::tests::no_registers();
            registers.orig_rax = number.cast_unsigned();
            registers.rax = result.cast_unsigned();
            registers.rip = 0x1000;
            let next = undisturbed(registers);
            (
                next.orig_rax.cast_signed(),
                next.rax.cast_signed(),
                next.rip,
            )
        };
        for result in [-512, -513, -514] {
            assert_eq!(of(7, result), (-1, 7, 0xFFE), "{result}");
        }
        assert_eq!(of(7, -516), (-1, libc::SYS_restart_syscall, 0xFFE));
        for result in [-4, -515, 0, 5] {
            assert_eq!(of(7, result), (7, result, 0x1000), "{result}");
        }
        assert_eq!(of(-1, -512), (-1, -512, 0x1000), "no call");
        assert_eq!(of(0, -512), (-1, 0, 0xFFE), "read is number 0");
    }
}
