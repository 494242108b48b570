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

    use crate::guest::tests::Stopped;

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

    /// A process that stands at a signal, and the address of its code.
    struct AtSignal {
        process: Stopped,
        at: u64,
        /// Its registers there.
        registers: libc::user_regs_struct,
    }

    /// The parts of its code: it goes on with `nop; int3`. A handler stops at `int3` and returns.
    const CODE: [u8; 16] = [
        0x0F, 0x05, 0x90, 0xCC, 0, 0, 0, 0, 0xCC, 0xC3, 0xB8, 0x0F, 0, 0, 0, 0x0F,
    ];
    const GOES_ON: u64 = 2;
    const HANDLER: u64 = 8;
    /// `mov eax, 15; syscall`: rt_sigreturn.
    const RESTORER: u64 = 10;
    const SA_RESTORER: u64 = 0x0400_0000;
    const MINE: i32 = 35;

    impl AtSignal {
        /// `flags` and `mask` are those of its handler; it blocks signal 40, has a handler for the
        /// borrowed signal, and was sent the value 7 with signal 35.
        fn new(handler: Option<u64>, flags: u64, mask: u64) -> Self {
            let process = Stopped::that_calls();
            let code: Vec<u8> = CODE.iter().copied().chain([0x05]).collect();
            let at = process.runs(&code);
            process.change(|registers| registers.rip = at + GOES_ON);
            let it = Self {
                registers: process.registers(),
                process,
                at,
            };
            let place = it.registers.rsp - 8_192;
            let memory = Memory(it.process.pid);
            let action = |number: i32, words: [u64; 4]| {
                let bytes = words.map(u64::to_ne_bytes);
                memory.write(place, bytes.as_flattened()).expect("stack");
                let args = [number.unsigned_abs().into(), place, 0, 8];
                assert_eq!(it.process.makes(libc::SYS_rt_sigaction, &args), 0);
            };
            let handler = handler.unwrap_or(at + HANDLER);
            action(MINE, [handler, flags | SA_RESTORER, at + RESTORER, mask]);
            action(16, [0x1234_5000, SA_RESTORER, at + RESTORER, 0]);
            memory.write(place, &bit(40).to_ne_bytes()).expect("stack");
            let args = [SIG_SETMASK, place, 0, 8];
            assert_eq!(it.process.makes(libc::SYS_rt_sigprocmask, &args), 0);
            // SI_QUEUE (-1), and the value behind two ids.
            let mut info = [0_i32; 32];
            (info[0], info[2], info[6]) = (MINE, -1, 7);
            let bytes = info.map(i32::to_ne_bytes);
            memory.write(place, bytes.as_flattened()).expect("stack");
            let number = u64::from(it.process.pid.as_raw().unsigned_abs());
            let args = [number, number, MINE.unsigned_abs().into(), place];
            assert_eq!(it.process.makes(libc::SYS_rt_tgsigqueueinfo, &args), 0);
            let below: Vec<u8> = (0..=255).cycle().take(8_192).collect();
            memory.write(place, &below).expect("stack");
            assert_eq!(Stopped::signal_of(it.process.goes_on()), MINE);
            assert_eq!(it.process.registers().rip, at + GOES_ON);
            it
        }

        fn delivers(&self, told: Option<&[u8]>) -> Delivered {
            let pid = self.process.pid;
            deliver(pid.as_raw(), pid, MINE, told)
        }

        fn blocked(&self) -> u64 {
            let pid = self.process.pid.as_raw();
            Pending::of(pid, pid).blocked
        }

        /// Handler, flags and mask of a signal.
        fn action(&self, signal: u64) -> [u64; 3] {
            let place = self.process.registers().rsp - 4_096;
            let args = [signal, 0, place, 8];
            assert_eq!(self.process.makes(libc::SYS_rt_sigaction, &args), 0);
            let action = Action::read(Memory(self.process.pid), place).expect("its stack");
            [action.handler, action.flags, action.mask]
        }

        /// Memory below its stack that was there before, in `from..to` bytes below `stack`.
        fn is_kept(&self, stack: u64, from: u64, to: u64) {
            let mut found = vec![0; usize::try_from(to - from).expect("some")];
            let memory = Memory(self.process.pid);
            memory.read(stack - to, &mut found).expect("its stack");
            let start = stack - to - (self.registers.rsp - 8_192);
            let expected = (start..).take(found.len());
            let expected: Vec<u8> = expected.map(|it| it.to_le_bytes()[0]).collect();
            assert_eq!(found, expected);
        }
    }

    fn word(process: &Stopped, place: u64) -> u64 {
        Memory(process.pid).u64(place).expect("its stack")
    }

    /// sigaction(2): a handler gets number, information and context. During it the signal itself,
    /// those of the action's mask and those blocked before are blocked; after it, the last alone.
    #[test]
    fn a_handler_gets_a_signal_above_31() {
        let it = AtSignal::new(None, SA_SIGINFO, bit(36));
        assert_eq!(it.delivers(None), Delivered::Goes);
        let now = it.process.registers();
        assert_eq!((now.rip, now.rdi), (it.at + HANDLER, 35));
        assert_eq!(now.orig_rax, u64::MAX, "it is in no call");
        // Number and error, code and padding, then two ids and the value.
        assert_eq!(word(&it.process, now.rsi), 35);
        assert_eq!(word(&it.process, now.rsi + 8), 0xFFFF_FFFF);
        assert_eq!(word(&it.process, now.rsi + 24), 7);
        assert_eq!(word(&it.process, now.rdx + CONTEXT_MASK), bit(40));
        assert_eq!(it.blocked(), bit(35) | bit(36) | bit(40));
        it.is_kept(it.registers.rsp, 0, 128);
        it.is_kept(now.rsp, 0, 1_024);
        assert_eq!(it.action(16), [0x1234_5000, SA_RESTORER, 0]);
        let expected = [it.at + HANDLER, SA_SIGINFO | SA_RESTORER, bit(36)];
        assert_eq!(it.action(35), expected);
        // It goes through its handler, and on from where it was.
        assert_eq!(Stopped::signal_of(it.process.goes_on()), libc::SIGTRAP);
        assert_eq!(it.process.registers().rip, it.at + HANDLER + 1);
        assert_eq!(Stopped::signal_of(it.process.goes_on()), libc::SIGTRAP);
        let end = it.process.registers();
        assert_eq!((end.rip, end.rsp), (it.at + 4, it.registers.rsp));
        assert_eq!((end.rdi, end.rbx), (it.registers.rdi, it.registers.rbx));
        assert_eq!(it.blocked(), bit(40));
    }

    /// With SA_NODEFER the signal itself is not blocked; with SA_RESETHAND its handler is gone.
    #[test]
    fn a_handler_may_allow_its_signal_and_be_for_once() {
        let flags = SA_NODEFER | SA_RESETHAND;
        let it = AtSignal::new(None, flags, bit(36) | bit(37));
        let told: Vec<u8> = vec![0xEE; 128];
        assert_eq!(it.delivers(Some(&told)), Delivered::Goes);
        let now = it.process.registers();
        assert_eq!((now.rip, now.rdi), (it.at + HANDLER, 35));
        assert_eq!(it.blocked(), bit(36) | bit(37) | bit(40));
        assert_ne!(word(&it.process, now.rsi) & 0xFF, 0xEE, "not requested");
        assert_eq!(it.action(35)[0], SIG_DFL);
        assert_eq!(it.action(16), [0x1234_5000, SA_RESTORER, 0]);
        it.is_kept(now.rsp, 0, 1_024);
        let it = AtSignal::new(None, SA_SIGINFO | SA_NODEFER, 0);
        assert_eq!(it.delivers(Some(&told)), Delivered::Goes);
        let now = it.process.registers();
        for offset in [0, 8, 120] {
            let found = word(&it.process, now.rsi + offset);
            assert_eq!(found.to_ne_bytes(), [0xEE; 8], "{offset}");
        }
        assert_eq!(it.blocked(), bit(40));
        assert_eq!(it.action(35)[0], it.at + HANDLER, "it stays");
    }

    /// signal(7): signals above 31 end a process by default. An ignored one changes nothing.
    #[test]
    fn a_signal_without_a_handler_is_fatal_or_ignored() {
        for (handler, expected) in [(SIG_DFL, Delivered::Fatal), (SIG_IGN, Delivered::Goes)] {
            let it = AtSignal::new(Some(handler), 0, 0);
            assert_eq!(it.delivers(None), expected);
            let now = it.process.registers();
            assert_eq!((now.rip, now.rdi), (it.at + GOES_ON, it.registers.rdi));
            assert_eq!((now.rsp, it.blocked()), (it.registers.rsp, bit(40)));
            it.is_kept(it.registers.rsp, 0, 1_024);
            assert_eq!(it.action(16)[0], 0x1234_5000);
            assert_eq!(Stopped::signal_of(it.process.goes_on()), libc::SIGTRAP);
            assert_eq!(it.process.registers().rip, it.at + 4);
        }
    }

    /// Another signal that comes meanwhile, SIGWINCH (28), is sent again.
    #[test]
    fn another_signal_is_not_lost_by_a_delivery() {
        use nix::sys::signal::kill;

        for (handler, expected) in [(None, Delivered::Goes), (Some(SIG_DFL), Delivered::Fatal)] {
            let it = AtSignal::new(handler, SA_SIGINFO, 0);
            kill(it.process.pid, Signal::SIGWINCH).expect("ours");
            assert_eq!(it.delivers(None), expected);
            let pid = it.process.pid.as_raw();
            let pending = Pending::of(pid, pid);
            assert_eq!(pending.own | pending.common, bit(28));
        }
    }

    /// A stack pointer may be anything, and a process may be gone.
    #[test]
    fn a_signal_is_refused_without_a_stack() {
        let it = AtSignal::new(None, SA_SIGINFO, 0);
        for stack in [0, 200, 4_096] {
            it.process.change(|registers| registers.rsp = stack);
            assert_eq!(it.delivers(None), Delivered::Refused, "{stack}");
        }
        let missing = Pid::from_raw(-7);
        assert_eq!(deliver(-7, missing, MINE, None), Delivered::Refused);
    }
}
