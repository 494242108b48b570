//! Programs of a few instructions, from their start to their end: processes, threads, signals and
//! timers.

use super::*;
use crate::guest::tests::program::{DATA, ENTRY, Guest, ZEROS, call, exit, if_zero, keeps, rests};

/// Data that are no zeros.
const MARKED: [u8; 256] = [0xEE; 256];
const MARK: u64 = 0xEEEE_EEEE_EEEE_EEEE;

fn words(words: &[u64]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// `mov edi, [place]`, for a call that then gets no first argument.
fn with_first(place: u32, number: i64, args: &[u32]) -> Vec<u8> {
    const MOVES: [u8; 2] = [0xBE, 0xBA];
    let mut code = vec![0x8B, 0x3C, 0x25];
    code.extend(place.to_le_bytes());
    for (to, value) in MOVES.iter().zip(args) {
        code.push(*to);
        code.extend(value.to_le_bytes());
    }
    code.extend(call(number, &[]));
    code
}

/// `mov dword [place], value`.
fn sets(place: u32, value: u32) -> Vec<u8> {
    let mut code = vec![0xC7, 0x04, 0x25];
    code.extend(place.to_le_bytes());
    code.extend(value.to_le_bytes());
    code
}

/// A new process that sleeps for the time at `DATA` and ends with `code`.
fn child_that_sleeps(code: u32) -> Vec<u8> {
    let child = [call(libc::SYS_nanosleep, &[DATA, 0]), exit(code)].concat();
    [call(libc::SYS_fork, &[]), if_zero(&child)].concat()
}

/// 5 ms, and then marked bytes.
fn five() -> Vec<u8> {
    let mut data = words(&[0, 5 * MS]);
    data.extend(MARKED);
    data.truncate(256);
    data
}

/// wait4(2): the status is 7 in its second byte, WNOHANG is 1, `rusage` has 144 bytes. A wait
/// without waiting finds none and writes nothing.
#[test]
fn a_process_waits_for_its_child() {
    let usage = DATA + 16;
    let guest = Guest::runs(
        &five(),
        &[
            &child_that_sleeps(7),
            &keeps(ZEROS),
            &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 8, 1, usage]),
            &keeps(ZEROS + 16),
            &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 24, 1, 0]),
            &keeps(ZEROS + 32),
            // Its usage is still marked here.
            &[0x48, 0x8B, 0x04, 0x25],
            &usage.to_le_bytes(),
            &keeps(ZEROS + 40),
            &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 48, 0, usage]),
            &keeps(ZEROS + 56),
            &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 64, 0, 0]),
            &keeps(ZEROS + 72),
            &rests(),
        ],
    );
    let child = guest.word(ZEROS);
    assert!(child > 1);
    assert_eq!(guest.word(ZEROS + 8), 0);
    assert_eq!((guest.word(ZEROS + 16), guest.word(ZEROS + 32)), (0, 0));
    assert_eq!(guest.word(ZEROS + 40), MARK);
    assert_eq!(
        (guest.word(ZEROS + 48), guest.word(ZEROS + 56)),
        (0x700, child)
    );
    assert_eq!(guest.bytes(usage, 144), [0; 144]);
    assert_eq!(guest.bytes(usage + 144, 8), [0xEE; 8]);
    let none = (-10_i64).cast_unsigned();
    assert_eq!(
        (guest.word(ZEROS + 64), guest.word(ZEROS + 72)),
        (0, none),
        "ECHILD"
    );
    assert_eq!(guest.process.registers().rdx, 0, "its option");
    assert_eq!(guest.bench.now() / MS, 5);
}

/// waitid(2): SIGCHLD is 17, CLD_EXITED 1, WEXITED 4; `siginfo_t` has the process at 16, its code
/// at 24 and its times at 32 and 40.
#[test]
fn a_process_waits_for_its_child_with_its_data() {
    let (info, usage) = (DATA + 16, ZEROS + 256);
    let guest = Guest::runs(
        &five(),
        &[
            &child_that_sleeps(7),
            &keeps(ZEROS),
            &sets(usage, 5),
            &call(libc::SYS_waitid, &[0, 0, info, 4 | 1, usage]),
            &keeps(ZEROS + 8),
            // Neither the signal of the data nor the usage.
            &[0x48, 0x8B, 0x04, 0x25],
            &info.to_le_bytes(),
            &keeps(ZEROS + 16),
            &[0x48, 0x8B, 0x04, 0x25],
            &usage.to_le_bytes(),
            &keeps(ZEROS + 24),
            &call(libc::SYS_waitid, &[0, 0, info, 4, usage]),
            &keeps(ZEROS + 32),
            &rests(),
        ],
    );
    let child = guest.word(ZEROS);
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 32)), (0, 0));
    assert_eq!(guest.word(ZEROS + 16) & 0xFFFF_FFFF, 0);
    assert_eq!(guest.word(ZEROS + 24), 5);
    assert_eq!(guest.word(info) & 0xFFFF_FFFF, 17);
    assert_eq!(guest.word(info + 8) & 0xFFFF_FFFF, 1);
    assert_eq!(guest.word(info + 16) & 0xFFFF_FFFF, child);
    assert_eq!(guest.word(info + 24) & 0xFFFF_FFFF, 7);
    assert_eq!(guest.bytes(info + 32, 16), [0; 16]);
    assert_eq!(guest.bytes(info + 128, 8), [0xEE; 8]);
    assert_eq!(guest.bytes(usage, 144), [0; 144]);
    assert_eq!(guest.process.registers().r10, 4, "its options");
}

/// vfork(2): the parent goes on when its child has ended.
#[test]
fn a_parent_waits_for_its_borrower() {
    let child = [sets(ZEROS + 64, 3), exit(5)].concat();
    let guest = Guest::runs(
        &[],
        &[
            &call(libc::SYS_vfork, &[]),
            &if_zero(&child),
            &keeps(ZEROS),
            // The child has written to the same memory before.
            &[0x48, 0x8B, 0x04, 0x25],
            &(ZEROS + 64).to_le_bytes(),
            &keeps(ZEROS + 8),
            &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 16, 0, 0]),
            &keeps(ZEROS + 24),
            &rests(),
        ],
    );
    assert!(guest.word(ZEROS) > 1);
    assert_eq!(guest.word(ZEROS + 24), guest.word(ZEROS));
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 16)), (3, 0x500));
    assert_eq!(guest.bench.supervisor.others().count(), 0);
    let notes = guest.bench.supervisor.notes();
    assert!(notes.is_empty(), "{notes:?}");
}

/// With two arguments, the program ends with 9 (`cmp qword [rsp], 2; jne 12`). Otherwise it keeps
/// its stack (`mov r12, rsp`).
fn begin() -> Vec<u8> {
    let mut code = vec![0x48, 0x83, 0x3C, 0x24, 0x02, 0x75, 0x0C];
    code.extend(exit(9));
    code.extend([0x49, 0x89, 0xE4]);
    code
}

/// Executes the program itself with two arguments: `mov rax, [r12+8]`, `mov rdi, rax`.
fn executes_itself() -> Vec<u8> {
    let mut code = vec![0x49, 0x8B, 0x44, 0x24, 0x08];
    code.extend(keeps(ZEROS + 512));
    code.extend(keeps(ZEROS + 520));
    code.extend([0x48, 0x89, 0xC7, 0xBE]);
    code.extend((ZEROS + 512).to_le_bytes());
    code.extend([0x31, 0xD2, 0xB8, 59, 0, 0, 0, 0x0F, 0x05]);
    code.extend(exit(1));
    code
}

#[test]
fn a_borrower_becomes_another_program() {
    let guest = Guest::runs(
        &[],
        &[
            &begin(),
            &call(libc::SYS_vfork, &[]),
            &if_zero(&executes_itself()),
            &keeps(ZEROS),
            &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 16, 0, 0]),
            &keeps(ZEROS + 24),
            &rests(),
        ],
    );
    assert_eq!(guest.word(ZEROS + 24), guest.word(ZEROS));
    assert_eq!(guest.word(ZEROS + 16), 0x900);
    let thread = &guest.bench.supervisor.threads[&guest.process.pid.as_raw()];
    assert_eq!((thread.index, guest.bench.supervisor.born), (0, [2, 2]));
}

#[test]
fn a_process_becomes_another_program() {
    let guest = Guest::runs(&[], &[&begin(), &executes_itself()]);
    assert_eq!(guest.status(), Some(0x900));
    assert_eq!(guest.bench.supervisor.born, [1, 1]);
}

/// The flags of a thread of a C library: CLONE_VM, FS, FILES, SIGHAND, THREAD and SYSVSEM.
const THREAD: u32 = 0x5_0F00;

/// FUTEX_WAIT is 0, FUTEX_WAKE 1. The thread ends by `exit`, 60.
#[test]
fn a_thread_wakes_another_one() {
    let thread = [
        sets(ZEROS, 1),
        call(libc::SYS_futex, &[ZEROS, 1, 5]),
        keeps(ZEROS + 8),
        call(libc::SYS_exit, &[0]),
    ];
    let guest = Guest::runs(
        &[],
        &[
            &call(libc::SYS_clone, &[THREAD, ZEROS + 4_096]),
            &if_zero(&thread.concat()),
            &keeps(ZEROS + 16),
            &call(libc::SYS_futex, &[ZEROS, 0, 0, 0]),
            &keeps(ZEROS + 24),
            &rests(),
        ],
    );
    assert_eq!((guest.word(ZEROS), guest.word(ZEROS + 8)), (1, 1));
    assert!(guest.word(ZEROS + 16) > 1);
    assert_eq!(guest.word(ZEROS + 24), 0);
    let supervisor = &guest.bench.supervisor;
    assert_eq!((supervisor.threads.len(), supervisor.born), (1, [2, 1]));
    let process = &supervisor.processes[&guest.process.pid.as_raw()];
    assert!(!process.shares_memory, "it is one process");
}

/// The first thread ends before the other one, which ends the process with its own code.
#[test]
fn a_process_lives_as_long_as_its_threads() {
    let thread = [call(libc::SYS_nanosleep, &[DATA, 0]), exit(6)];
    let guest = Guest::runs(
        &five(),
        &[
            &call(libc::SYS_clone, &[THREAD, ZEROS + 4_096]),
            &if_zero(&thread.concat()),
            &call(libc::SYS_exit, &[4]),
        ],
    );
    assert_eq!(guest.status(), Some(0x600));
    assert!(!guest.bench.supervisor.is_anybody_there());
}

/// A process in the memory of its parent (CLONE_VM and SIGCHLD) shares it; one by fork does not.
#[test]
fn processes_may_share_memory() {
    let child = [sets(ZEROS, 3), rests()].concat();
    let shares = |code: &[u8]| {
        let mut data = five();
        data.truncate(16);
        let guest = Guest::runs(
            &data,
            &[
                code,
                &if_zero(&child),
                &call(libc::SYS_nanosleep, &[DATA, 0]),
                &rests(),
            ],
        );
        let processes = guest.bench.supervisor.processes.values();
        let shared: Vec<bool> = processes.map(|it| it.shares_memory).collect();
        (shared, guest.word(ZEROS))
    };
    let clone = call(libc::SYS_clone, &[0x100 | 17, ZEROS + 4_096]);
    assert_eq!(shares(&clone), (vec![true, true], 3));
    assert_eq!(shares(&call(libc::SYS_fork, &[])), (vec![false, false], 0));
    let clone = call(libc::SYS_clone, &[17, 0]);
    assert_eq!(shares(&clone), (vec![false, false], 0));
}

/// kill(2): by its number, or by that of its group, which is negative (`neg edi` is F7 DF). The
/// child has ended before its killer goes on.
#[test]
fn a_process_kills_its_child_at_once() {
    let by_number = with_first(ZEROS, libc::SYS_kill, &[9]);
    let mut by_group = with_first(ZEROS, libc::SYS_kill, &[9]);
    by_group.splice(7..7, [0xF7, 0xDF]);
    for kill in [by_number, by_group] {
        let child = [call(libc::SYS_setpgid, &[0, 0]), rests()].concat();
        let guest = Guest::runs(
            &five(),
            &[
                &call(libc::SYS_fork, &[]),
                &if_zero(&child),
                &keeps(ZEROS),
                &call(libc::SYS_nanosleep, &[DATA, 0]),
                &kill,
                &keeps(ZEROS + 8),
                &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 16, 1, 0]),
                &keeps(ZEROS + 24),
                &rests(),
            ],
        );
        assert_eq!(guest.word(ZEROS + 8), 0);
        assert_eq!(guest.word(ZEROS + 24), guest.word(ZEROS));
        assert_eq!(guest.word(ZEROS + 16), 9);
        assert_eq!(guest.bench.supervisor.others().count(), 0);
    }
}

/// Data of a timer: its interval and its first time, in seconds and nanoseconds or microseconds;
/// then a mask of signals.
fn once(unit_of_five_ms: u64, mask: u64) -> Vec<u8> {
    words(&[0, 0, 0, unit_of_five_ms, mask])
}

/// Blocks the signals at `DATA + 32`: SIG_BLOCK is 0.
fn blocks() -> Vec<u8> {
    call(libc::SYS_rt_sigprocmask, &[0, DATA + 32, 0, 8])
}

/// signalfd(2): SIGALRM is 14, its bit 0x2000; the data have 128 bytes and begin with the number.
/// ITIMER_REAL is 0, EPOLL_CTL_ADD 1.
#[test]
fn a_process_reads_its_signals() {
    let timer = call(libc::SYS_setitimer, &[0, DATA, 0]);
    let signalfd = call(libc::SYS_signalfd4, &[u32::MAX, DATA + 32, 8, 0]);
    let read = with_first(ZEROS, libc::SYS_read, &[ZEROS + 64, 128]);
    let guest = Guest::runs(
        &once(5_000, 0x2000),
        &[
            &blocks(),
            &timer,
            &signalfd,
            &keeps(ZEROS),
            &read,
            &keeps(ZEROS + 8),
            &rests(),
        ],
    );
    assert_eq!(guest.word(ZEROS + 8), 128);
    assert_eq!(guest.word(ZEROS + 64) & 0xFFFF_FFFF, 14);
    assert_eq!(guest.bench.now() / MS, 5);
    // One that never waits (O_NONBLOCK) fails with EAGAIN, 11.
    let signalfd = call(libc::SYS_signalfd4, &[u32::MAX, DATA + 32, 8, 0o4_000]);
    let guest = Guest::runs(
        &once(5_000, 0x2000),
        &[
            &blocks(),
            &signalfd,
            &keeps(ZEROS),
            &read,
            &keeps(ZEROS + 8),
            &rests(),
        ],
    );
    assert_eq!(guest.word(ZEROS + 8).cast_signed(), -11);
}

/// poll(2): one entry of file, wanted (POLLIN is 1) and found.
#[test]
fn a_process_polls_its_signals() {
    let timer = call(libc::SYS_setitimer, &[0, DATA, 0]);
    let signalfd = call(libc::SYS_signalfd4, &[u32::MAX, DATA + 32, 8, 0]);
    let poll = |millis| call(libc::SYS_poll, &[ZEROS, 1, millis]);
    let guest = Guest::runs(
        &once(5_000, 0x2000),
        &[
            &blocks(),
            &signalfd,
            &keeps(ZEROS),
            &sets(ZEROS + 4, 1),
            &poll(3),
            &keeps(ZEROS + 8),
            &timer,
            &poll(100),
            &keeps(ZEROS + 16),
            &rests(),
        ],
    );
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 16)), (0, 1));
    assert_eq!(guest.word(ZEROS + 4) & 0xFFFF_FFFF, 0x1_0001);
    assert_eq!(guest.bench.now() / MS, 8);
}

/// epoll_ctl(2): an event is 12 bytes, its flags and the program's own data. A set that does not
/// want input (EPOLLIN is 1) is told of none.
#[test]
fn a_set_of_files_reports_signals() {
    let timer = call(libc::SYS_setitimer, &[0, DATA, 0]);
    let signalfd = call(libc::SYS_signalfd4, &[u32::MAX, DATA + 32, 8, 0]);
    for (flags, expected, millis) in [(1, 1, 5), (4, 0, 100)] {
        let mut data = once(5_000, 0x2000);
        let flags: u32 = flags;
        data.extend(flags.to_le_bytes());
        data.extend(0x1122_3344_5566_7788_u64.to_le_bytes());
        // `mov edx, [ZEROS]`, as the third argument.
        let mut add = vec![0x8B, 0x14, 0x25];
        add.extend(ZEROS.to_le_bytes());
        let mut control = with_first(ZEROS + 8, libc::SYS_epoll_ctl, &[1]);
        control.splice(0..0, add);
        // `mov r10d, DATA + 40`, as the fourth one.
        let mut event = vec![0x41, 0xBA];
        event.extend((DATA + 40).to_le_bytes());
        control.splice(0..0, event);
        // `mov r10d, 100`: milliseconds.
        let mut wait = with_first(ZEROS + 8, libc::SYS_epoll_wait, &[ZEROS + 64, 4]);
        wait.splice(0..0, [0x41, 0xBA, 100, 0, 0, 0]);
        let guest = Guest::runs(
            &data,
            &[
                &blocks(),
                &signalfd,
                &keeps(ZEROS),
                &call(libc::SYS_epoll_create1, &[0]),
                &keeps(ZEROS + 8),
                &control,
                &keeps(ZEROS + 16),
                &timer,
                &wait,
                &keeps(ZEROS + 24),
                &rests(),
            ],
        );
        assert_eq!(guest.word(ZEROS + 16), 0, "it is in the set");
        assert_eq!(guest.word(ZEROS + 24), expected);
        assert_eq!(guest.bench.now() / MS, millis);
        if expected == 1 {
            assert_eq!(guest.word(ZEROS + 64) & 0xFFFF_FFFF, 1);
            assert_eq!(guest.word(ZEROS + 68), 0x1122_3344_5566_7788);
        }
    }
}

/// rt_sigtimedwait(2): the signal is the result, and its number begins the data.
#[test]
fn a_process_waits_for_a_signal() {
    let timer = call(libc::SYS_setitimer, &[0, DATA, 0]);
    let mut data = once(5_000, 0x2000);
    data.extend(words(&[0, 2 * MS]));
    let wait = |timeout| {
        let args = [DATA + 32, ZEROS + 64, timeout, 8];
        call(libc::SYS_rt_sigtimedwait, &args)
    };
    let guest = Guest::runs(
        &data,
        &[
            &blocks(),
            &timer,
            &wait(DATA + 40),
            &keeps(ZEROS),
            &wait(0),
            &keeps(ZEROS + 8),
            &rests(),
        ],
    );
    assert_eq!(guest.word(ZEROS).cast_signed(), -11, "EAGAIN after 2 ms");
    assert_eq!(guest.word(ZEROS + 8), 14);
    assert_eq!(guest.word(ZEROS + 64) & 0xFFFF_FFFF, 14);
    assert_eq!(guest.bench.now() / MS, 5);
}

/// A handler stops the program's sleep: EINTR is 4. It keeps the number of its signal (`mov
/// [ZEROS], rdi`) and returns by rt_sigreturn (15) over its return address.
#[test]
fn a_handler_interrupts_a_sleep() {
    let handler = {
        let mut code = vec![0x48, 0x89, 0x3C, 0x25];
        code.extend(ZEROS.to_le_bytes());
        code.extend([0x48, 0x83, 0xC4, 0x08]);
        code.extend(call(15, &[]));
        code
    };
    // `jmp` over the handler, which is two bytes behind the start.
    let mut code = vec![0xEB, u8::try_from(handler.len()).expect("short")];
    code.extend(handler);
    // Interval and time of the timer; 20 ms; the handler's address, flags (SA_RESTORER), restorer
    // and mask.
    let handler = ENTRY + 2;
    let mut data = words(&[0, 0, 0, 5_000, 0, 20 * MS]);
    data.extend(words(&[handler, 0x0400_0000, handler, 0]));
    let guest = Guest::runs(
        &data,
        &[
            &code,
            &call(libc::SYS_rt_sigaction, &[14, DATA + 48, 0, 8]),
            &call(libc::SYS_setitimer, &[0, DATA, 0]),
            &call(libc::SYS_nanosleep, &[DATA + 32, ZEROS + 16]),
            &keeps(ZEROS + 8),
            &rests(),
        ],
    );
    assert_eq!(guest.word(ZEROS), 14);
    assert_eq!(guest.word(ZEROS + 8).cast_signed(), -4);
    assert_eq!(guest.word(ZEROS + 16), 0);
    // The sleep begins one call after the timer, so 1 us later.
    assert_eq!(guest.word(ZEROS + 24), 15 * MS + 1_000);
}

/// timerfd_create(2): a copy of the file continues its timer when the other one is closed, before
/// or after it has expired. A read gives the count.
#[test]
fn a_timer_goes_on_in_a_copy_of_its_file() {
    let mut data = once(5 * MS, 0);
    data.extend(words(&[0, 9 * MS]));
    let create = [call(libc::SYS_timerfd_create, &[1, 0]), keeps(ZEROS)].concat();
    // `mov edx, DATA; mov r10d, 0` with the flags 0.
    let set = {
        let mut code = vec![0x41, 0xBA, 0, 0, 0, 0];
        code.extend(with_first(ZEROS, libc::SYS_timerfd_settime, &[0, DATA]));
        code
    };
    let copy = [with_first(ZEROS, libc::SYS_dup, &[]), keeps(ZEROS + 8)].concat();
    let close = with_first(ZEROS, libc::SYS_close, &[]);
    let sleep = call(libc::SYS_nanosleep, &[DATA + 40, 0]);
    let read = with_first(ZEROS + 8, libc::SYS_read, &[ZEROS + 64, 8]);
    for (before, millis) in [(&close, 5), (&[sleep, close.clone()].concat(), 9)] {
        let guest = Guest::runs(
            &data,
            &[
                &create,
                &set,
                &copy,
                before,
                &read,
                &keeps(ZEROS + 16),
                &rests(),
            ],
        );
        assert_eq!((guest.word(ZEROS + 16), guest.word(ZEROS + 64)), (8, 1));
        assert_eq!(guest.bench.now() / MS, millis);
        let process = &guest.bench.supervisor.processes[&guest.process.pid.as_raw()];
        let timers: Vec<u64> = process
            .timers
            .keys()
            .map(|&fd| fd.unsigned_abs().into())
            .collect();
        assert_eq!(timers, [guest.word(ZEROS + 8)]);
    }
}

/// A write without a reader (SIGPIPE is 13), and a fault of memory: `mov [0], eax`.
#[test]
fn a_program_ends_by_a_signal() {
    let write = [0x89, 0x04, 0x25, 0, 0, 0, 0];
    let guest = Guest::runs(&[], &[&[0x90], &write]);
    assert_eq!(guest.status(), Some(11));
    assert_eq!(guest.bench.supervisor.fault(), Some("program+0x179"));
    let pipe = call(libc::SYS_pipe2, &[ZEROS, 0]);
    let close = with_first(ZEROS, libc::SYS_close, &[]);
    let speak = with_first(ZEROS + 4, libc::SYS_write, &[DATA, 8]);
    let guest = Guest::runs(&MARKED, &[&pipe, &close, &speak, &rests()]);
    assert_eq!(guest.status(), Some(13));
}

#[test]
fn chance_is_the_same_for_the_same_seed() {
    let get = call(libc::SYS_getrandom, &[ZEROS, 32, 0]);
    let runs = || Guest::runs(&[], &[&get, &rests()]).bytes(ZEROS, 32);
    let first = runs();
    assert_eq!(runs(), first);
    assert!(first.iter().any(|&byte| byte != first[0]));
    let mut other = Bench::new();
    other.supervisor.settings.seed = 2;
    let other = Guest::runs_in(other, &[], &[&get, &rests()]).bytes(ZEROS, 32);
    assert_ne!(other, first);
}
