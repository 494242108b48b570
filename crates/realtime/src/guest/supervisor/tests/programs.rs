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
            &[0x48, 0x8B, 0x04, 0x25],
            &(info + 32).to_le_bytes(),
            &keeps(ZEROS + 40),
            &call(libc::SYS_waitid, &[0, 0, info, 4, usage]),
            &keeps(ZEROS + 32),
            &rests(),
        ],
    );
    let child = guest.word(ZEROS);
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 32)), (0, 0));
    assert_eq!(guest.word(ZEROS + 16) & 0xFFFF_FFFF, 0);
    assert_eq!((guest.word(ZEROS + 24), guest.word(ZEROS + 40)), (5, MARK));
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

/// kill(2): by its number, by that of its group, which is negative (`neg edi` is F7 DF), or by a
/// handle. The child has ended before its killer goes on.
#[test]
fn a_process_kills_its_child_at_once() {
    let by_number = with_first(ZEROS, libc::SYS_kill, &[9]);
    let mut by_group = with_first(ZEROS, libc::SYS_kill, &[9]);
    by_group.splice(7..7, [0xF7, 0xDF]);
    // pidfd_open(2), then pidfd_send_signal with neither data nor flags.
    let by_handle = [
        with_first(ZEROS, libc::SYS_pidfd_open, &[0]),
        keeps(ZEROS + 32),
        vec![0x41, 0xBA, 0, 0, 0, 0],
        with_first(ZEROS + 32, libc::SYS_pidfd_send_signal, &[9, 0]),
    ];
    for kill in [by_number, by_group, by_handle.concat()] {
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
    // The copy, and an entry of poll with it.
    let copy = [
        with_first(ZEROS, libc::SYS_dup, &[]),
        keeps(ZEROS + 8),
        keeps(ZEROS + 128),
        sets(ZEROS + 132, 1),
    ]
    .concat();
    let poll = [
        call(libc::SYS_poll, &[ZEROS + 128, 1, 1]),
        keeps(ZEROS + 24),
    ]
    .concat();
    let close = with_first(ZEROS, libc::SYS_close, &[]);
    let sleep = call(libc::SYS_nanosleep, &[DATA + 40, 0]);
    let read = with_first(ZEROS + 8, libc::SYS_read, &[ZEROS + 64, 8]);
    // A millisecond after it was closed early, the copy is not ready yet.
    let late = [sleep, close.clone()].concat();
    for (before, is_ready, millis) in [(&close, 0, 5), (&late, 1, 9)] {
        let guest = Guest::runs(
            &data,
            &[
                &create,
                &set,
                &copy,
                before,
                &poll,
                &read,
                &keeps(ZEROS + 16),
                &rests(),
            ],
        );
        assert_eq!((guest.word(ZEROS + 16), guest.word(ZEROS + 64)), (8, 1));
        assert_eq!(guest.word(ZEROS + 24), is_ready);
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
    assert_eq!(guest.bench.supervisor.fault(), Some("program+0x1b1"));
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

/// rseq(2) would write the real number of the processor into memory: ENOSYS is 38. A set without a
/// processor is invalid: EINVAL is 22.
#[test]
fn a_program_sees_the_first_processor() {
    let guest = Guest::runs(
        &MARKED,
        &[
            &call(libc::SYS_getcpu, &[DATA, DATA + 8]),
            &keeps(ZEROS),
            &call(libc::SYS_sched_getaffinity, &[0, 8, ZEROS + 8]),
            &keeps(ZEROS + 16),
            &call(libc::SYS_sched_setaffinity, &[0, 8, ZEROS + 64]),
            &keeps(ZEROS + 24),
            &call(libc::SYS_rseq, &[ZEROS + 128, 32, 0, 7]),
            &keeps(ZEROS + 32),
            &rests(),
        ],
    );
    assert_eq!(
        (guest.word(ZEROS), guest.word(DATA)),
        (0, 0xEEEE_EEEE_0000_0000)
    );
    assert_eq!(guest.word(DATA + 8), 0xEEEE_EEEE_0000_0000);
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 16)), (1, 8));
    assert_eq!(guest.word(ZEROS + 24).cast_signed(), -22);
    assert_eq!(guest.word(ZEROS + 32).cast_signed(), -38);
}

/// signal(7): a signal above 31 ends a process by default. Its status is the signal.
#[test]
fn a_signal_above_31_ends_a_program() {
    // `mov edi, eax; mov esi, 35; mov eax, 62; syscall`: kill(itself, 35).
    let kills_itself = {
        let mut code = call(libc::SYS_getpid, &[]);
        code.extend([0x89, 0xC7, 0xBE, 35, 0, 0, 0, 0xB8, 62, 0, 0, 0, 0x0F, 0x05]);
        code.extend(rests());
        code
    };
    let guest = Guest::runs(&[], &[&kills_itself]);
    assert_eq!(guest.status(), Some(35));
    let guest = Guest::runs(
        &[],
        &[
            &call(libc::SYS_fork, &[]),
            &if_zero(&kills_itself),
            &keeps(ZEROS),
            &call(libc::SYS_wait4, &[u32::MAX, ZEROS + 8, 0, 0]),
            &keeps(ZEROS + 16),
            &rests(),
        ],
    );
    assert_eq!(guest.word(ZEROS + 16), guest.word(ZEROS));
    assert_eq!(guest.word(ZEROS + 8), 35);
    assert!(guest.bench.supervisor.fatal.is_empty());
}

/// timer_create(2): `sigevent` has a value, a signal and the notice (SIGEV_SIGNAL is 0). The data
/// of the signal have SI_TIMER (-2) at 8, the timer at 16, its overrun at 20 and the value at 24.
/// By hand: it expires after 1, 2, 3, 4 and 5 ms, and is looked at after 5.5 ms: four overruns.
#[test]
fn a_timer_counts_its_expirations() {
    let data = words(&[
        0,
        MS,
        0,
        MS,
        0x2000,
        0x1122_3344_5566_7788,
        14,
        0,
        0,
        5_500_000,
    ]);
    let mut set = vec![0x41, 0xBA, 0, 0, 0, 0];
    set.extend(with_first(ZEROS, libc::SYS_timer_settime, &[0, DATA]));
    let wait = |place| call(libc::SYS_rt_sigtimedwait, &[DATA + 32, place, 0, 8]);
    let guest = Guest::runs(
        &data,
        &[
            &blocks(),
            &call(libc::SYS_timer_create, &[1, DATA + 40, ZEROS]),
            &keeps(ZEROS + 8),
            &set,
            &keeps(ZEROS + 16),
            &call(libc::SYS_nanosleep, &[DATA + 64, 0]),
            &wait(ZEROS + 64),
            &keeps(ZEROS + 24),
            &wait(ZEROS + 256),
            &keeps(ZEROS + 32),
            &rests(),
        ],
    );
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 16)), (0, 0));
    assert_eq!((guest.word(ZEROS + 24), guest.word(ZEROS + 32)), (14, 14));
    for (place, overrun) in [(ZEROS + 64, 4), (ZEROS + 256, 0)] {
        assert_eq!(guest.word(place) & 0xFFFF_FFFF, 14);
        assert_eq!(guest.word(place + 8) & 0xFFFF_FFFF, 0xFFFF_FFFE);
        let timer = guest.word(ZEROS) & 0xFFFF_FFFF;
        assert_eq!(guest.word(place + 16), overrun << 32 | timer);
        assert_eq!(guest.word(place + 24), 0x1122_3344_5566_7788);
    }
    assert_eq!(guest.bench.now() / MS, 6);
}

/// fcntl(2): F_SETLK is 6, F_SETLKW 7. A lock has its kind (F_WRLCK is 1) and where it counts from
/// (SEEK_SET 0, SEEK_CUR 1, SEEK_END 2), 16 bits each; its start, its length and a process.
#[test]
fn a_process_waits_for_a_range_of_another_one() {
    // The child has the bytes 0 to 9 until it ends after 5 ms; the parent wants some after 1 ms.
    let child = [
        with_first(ZEROS, libc::SYS_fcntl, &[6, DATA + 32]),
        call(libc::SYS_nanosleep, &[DATA, 0]),
        exit(0),
    ];
    for (from, start, millis) in [
        (0, 5, 5),
        (0, 9, 5),
        (0, 10, 1),
        // The file's position is 20, its length 100.
        (1, -11, 5),
        (1, -10, 1),
        (2, -91, 5),
        (2, -90, 1),
    ] {
        let start: i64 = start;
        let from: u64 = from;
        let mut data = words(&[0, 5 * MS, 0, MS, 1, 0, 10, 0]);
        data.extend(words(&[1 | from << 16, start.cast_unsigned(), 3, 0]));
        data.extend(b"x\0");
        let guest = Guest::runs(
            &data,
            &[
                &call(libc::SYS_memfd_create, &[DATA + 96, 0]),
                &keeps(ZEROS),
                &with_first(ZEROS, libc::SYS_ftruncate, &[100]),
                &with_first(ZEROS, libc::SYS_lseek, &[20, 0]),
                &call(libc::SYS_fork, &[]),
                &if_zero(&child.concat()),
                &call(libc::SYS_nanosleep, &[DATA + 16, 0]),
                &with_first(ZEROS, libc::SYS_fcntl, &[7, DATA + 64]),
                &keeps(ZEROS + 8),
                &rests(),
            ],
        );
        assert_eq!(guest.word(ZEROS + 8), 0);
        assert_eq!(guest.bench.now() / MS, millis, "{from} {start}");
        let notes = guest.bench.supervisor.notes();
        assert!(notes.is_empty(), "it waits in virtual time: {notes:?}");
    }
}

/// Code that keeps the address of its own clocks in r13, from the auxiliary vector behind the one
/// argument: AT_SYSINFO_EHDR is 33. Behind the kernel's page is the code of clock_gettime.
fn finds_clocks() -> Vec<u8> {
    let own = crate::guest::inject::kernel_page(own()).expect("a page of the kernel");
    let len = u32::try_from(own.1.len()).expect("short");
    let mut code = vec![
        0x48, 0x8D, 0x74, 0x24, 0x20, 0x48, 0x83, 0x3E, 33, 0x74, 0x06,
    ];
    code.extend([0x48, 0x83, 0xC6, 0x10, 0xEB, 0xF4, 0x4C, 0x8B, 0x6E, 0x08]);
    code.extend([0x49, 0x81, 0xC5]);
    code.extend(len.to_le_bytes());
    code
}

/// `mov edi, clock; mov esi, place; call r13`.
fn looks(clock: u32, place: u32) -> Vec<u8> {
    let mut code = vec![0xBF];
    code.extend(clock.to_le_bytes());
    code.push(0xBE);
    code.extend(place.to_le_bytes());
    code.extend([0x41, 0xFF, 0xD5]);
    code
}

/// Each look takes 1 us, with a stop or without. Nothing else takes time here.
#[test]
fn a_program_reads_its_clocks_without_a_stop() {
    let guest = Guest::runs(
        &[],
        &[
            &finds_clocks(),
            &looks(1, ZEROS),
            &looks(1, ZEROS + 16),
            &looks(0, ZEROS + 32),
            &call(libc::SYS_clock_gettime, &[1, ZEROS + 48]),
            &looks(1, ZEROS + 64),
            &rests(),
        ],
    );
    assert_eq!((guest.word(ZEROS), guest.word(ZEROS + 8)), (1_000, 1_000));
    assert_eq!(guest.word(ZEROS + 24), 2_000);
    assert_eq!(
        (guest.word(ZEROS + 32), guest.word(ZEROS + 40)),
        (1_767_225_600, 3_000)
    );
    assert_eq!(
        (guest.word(ZEROS + 56), guest.word(ZEROS + 72)),
        (4_000, 5_000)
    );
    let supervisor = &guest.bench.supervisor;
    assert_eq!((supervisor.looks, supervisor.served), (4, 0));
    // Four looks, clock_gettime and pause.
    assert_eq!((supervisor.calls.count, guest.bench.now()), (6, 6_000));
}

/// Two threads: while one looks at its clocks again and again, the other one has its turn after
/// 1,000 looks and calls. `mov ebx, 2500; ..; dec ebx; jnz ..`.
#[test]
fn looks_at_clocks_are_part_of_a_turn() {
    let mut round = looks(1, ZEROS + 64);
    let back = 256 - (round.len() + 4);
    round.extend([0xFF, 0xCB, 0x75, u8::try_from(back).expect("short")]);
    let thread = [looks(1, ZEROS), call(libc::SYS_exit, &[0])];
    let guest = Guest::runs(
        &[],
        &[
            &finds_clocks(),
            &call(libc::SYS_clone, &[THREAD, ZEROS + 4_096]),
            &if_zero(&thread.concat()),
            &[0xBB, 0xC4, 0x09, 0, 0],
            &round,
            &rests(),
        ],
    );
    // The other thread looks after the first turn: 999 looks, and the one that ends it.
    let other = guest.word(ZEROS + 8);
    assert!((999_000..=1_002_000).contains(&other), "{other}");
    let last = guest.word(ZEROS + 72);
    assert!((2_500_000..=2_503_000).contains(&last), "{last}");
}

/// The path of the port, at `DATA + 64`, as the bench publishes it.
fn with_port(bench: &Bench, mut data: Vec<u8>) -> Vec<u8> {
    let path = bench.path("sonar");
    data.resize(64, 0);
    data.extend(path.as_os_str().as_encoded_bytes());
    data.push(0);
    data
}

/// Opens the port: openat(AT_FDCWD, .., O_RDWR | O_NOCTTY).
fn opens_port() -> Vec<u8> {
    let opens = call(libc::SYS_openat, &[u32::MAX - 99, DATA + 64, 0o402, 0]);
    [opens, keeps(ZEROS)].concat()
}

/// Reads bytes one by one in a loop: `mov r14d, place; mov ebx, count; mov edi, [ZEROS]; mov rsi,
/// r14; mov edx, 1; mov eax, 0; syscall; inc r14; dec ebx; jnz ..`.
fn reads_one_by_one(place: u32, count: u32) -> Vec<u8> {
    let mut code = vec![0x49, 0xC7, 0xC6];
    code.extend(place.to_le_bytes());
    code.push(0xBB);
    code.extend(count.to_le_bytes());
    let mut round = vec![0x8B, 0x3C, 0x25];
    round.extend(ZEROS.to_le_bytes());
    round.extend([0x4C, 0x89, 0xF6, 0xBA, 1, 0, 0, 0]);
    round.extend(call(libc::SYS_read, &[]));
    round.extend([0x49, 0xFF, 0xC6, 0xFF, 0xCB]);
    let back = 256 - (round.len() + 2);
    round.extend([0x75, u8::try_from(back).expect("short")]);
    code.extend(round);
    code
}

/// By hand: 9600 baud are 1.041667 ms per byte. The lines of 7 bytes begin at 100, 200 and 300 ms:
/// the last byte of the third is there at 307.2917 ms.
#[test]
fn a_program_reads_its_port() {
    let bench = Bench::new();
    let data = with_port(&bench, Vec::new());
    let guest = Guest::runs_in(
        bench,
        &data,
        &[&opens_port(), &reads_one_by_one(ZEROS + 64, 21), &rests()],
    );
    assert_eq!(guest.bytes(ZEROS + 64, 22), b"mm=700\nmm=700\nmm=700\n\0");
    let now = guest.bench.now();
    assert!((307_291_666..307_300_000).contains(&now), "{now}");
    let supervisor = &guest.bench.supervisor;
    assert!(supervisor.served > 0, "some reads have caused no stop");
    assert_eq!(supervisor.calls.count, 23, "openat, 21 reads and pause");
    let traffic = guest.bench.supervisor.stage.traffic(0);
    assert_eq!((traffic.to_client, traffic.from_client), (21, 0));
}

/// By hand: "ping" and its line end are 5 bytes, and so is "pong": 10.417 ms in all. The
/// device answers 200 us after a request.
#[test]
fn a_program_asks_its_port() {
    let bench = Bench::new();
    let data = with_port(&bench, b"ping\n".to_vec());
    let guest = Guest::runs_in(
        bench,
        &data,
        &[
            &opens_port(),
            &with_first(ZEROS, libc::SYS_write, &[DATA, 5]),
            &keeps(ZEROS + 8),
            &reads_one_by_one(ZEROS + 64, 5),
            &rests(),
        ],
    );
    assert_eq!(
        (guest.word(ZEROS + 8), guest.bytes(ZEROS + 64, 6)),
        (5, b"pong\n\0".to_vec())
    );
    let now = guest.bench.now();
    assert!((10_616_666..10_630_000).contains(&now), "{now}");
}

/// FIONREAD is 0x541B. A program that asks again and again waits, and asks less and less often.
#[test]
fn a_program_counts_the_bytes_of_its_port() {
    // `mov edi, [ZEROS]; mov esi, FIONREAD; mov edx, ZEROS + 8; mov eax, 16; syscall;
    // cmp dword [ZEROS + 8], 7; jne ..`.
    let mut round = with_first(ZEROS, libc::SYS_ioctl, &[0x541B, ZEROS + 8]);
    round.extend([0x83, 0x3C, 0x25]);
    round.extend((ZEROS + 8).to_le_bytes());
    round.push(7);
    let back = 256 - (round.len() + 2);
    round.extend([0x75, u8::try_from(back).expect("short")]);
    let bench = Bench::new();
    let data = with_port(&bench, Vec::new());
    let guest = Guest::runs_in(bench, &data, &[&opens_port(), &round, &rests()]);
    assert_eq!(guest.word(ZEROS + 8), 7);
    let now = guest.bench.now();
    assert!((107_291_666..108_400_000).contains(&now), "{now}");
    let supervisor = &guest.bench.supervisor;
    assert!(
        supervisor.idled > Duration::from_millis(90),
        "{:?}",
        supervisor.idled
    );
    assert!(supervisor.calls.count < 2_000, "{}", supervisor.calls.count);
}

/// pselect6(2) with a timeout: two lines are read byte by byte, each after a select. The sets are a
/// word each; the file is number 9, by dup2.
#[test]
fn a_program_selects_its_port() {
    // `mov r14d, place; mov ebx, 14`.
    let mut code = vec![0x49, 0xC7, 0xC6];
    code.extend((ZEROS + 64).to_le_bytes());
    code.extend([0xBB, 14, 0, 0, 0]);
    let mut round = sets(ZEROS + 8, 1 << 9);
    // 0 s, and 500,000,000 ns, at ZEROS + 16.
    round.extend(sets(ZEROS + 24, 500_000_000));
    // The number of the call comes last, as in a C library.
    let mut select = call(libc::SYS_pselect6, &[10, ZEROS + 8, 0, 0, ZEROS + 16]);
    let len = select.len();
    select[..len - 2].rotate_left(5);
    round.extend(select);
    // `mov edi, 9; mov rsi, r14; mov edx, 1; ..; add r14, rax; sub ebx, eax`.
    round.extend([0xBF, 9, 0, 0, 0, 0x4C, 0x89, 0xF6, 0xBA, 1, 0, 0, 0]);
    round.extend(call(libc::SYS_read, &[]));
    round.extend([0x49, 0x01, 0xC6, 0x29, 0xC3]);
    let back = 256 - (round.len() + 2);
    round.extend([0x75, u8::try_from(back).expect("short")]);
    code.extend(round);
    let bench = Bench::new();
    let data = with_port(&bench, Vec::new());
    let guest = Guest::runs_in(
        bench,
        &data,
        &[
            &opens_port(),
            &with_first(ZEROS, libc::SYS_dup2, &[9]),
            &code,
            &rests(),
        ],
    );
    assert_eq!(guest.bytes(ZEROS + 64, 15), b"mm=700\nmm=700\n\0");
    assert_eq!(guest.word(ZEROS + 8), 1 << 9, "the file is ready");
    assert!(guest.bench.supervisor.served > 0);
    let now = guest.bench.now();
    assert!((207_291_666..207_300_000).contains(&now), "{now}");
}

/// readlink(2) of the program's own file, by dup2 number 77: the name that it was given.
#[test]
fn a_port_has_the_name_that_the_program_was_given() {
    let bench = Bench::new();
    let path = bench.path("sonar");
    let data = with_port(&bench, b"/proc/self/fd/77\0".to_vec());
    let guest = Guest::runs_in(
        bench,
        &data,
        &[
            &opens_port(),
            &with_first(ZEROS, libc::SYS_dup2, &[77]),
            &call(libc::SYS_readlink, &[DATA, ZEROS + 64, 200]),
            &keeps(ZEROS + 8),
            &rests(),
        ],
    );
    let text = path.as_os_str().as_encoded_bytes();
    assert_eq!(guest.word(ZEROS + 8), text.len() as u64);
    assert_eq!(guest.bytes(ZEROS + 64, text.len()), text);
}

/// A program that waits for its port is put back: its memory, its registers and what it has read.
#[test]
fn a_program_is_put_back_to_a_moment() {
    let bench = Bench::new();
    let data = with_port(&bench, Vec::new());
    let mut bench = bench;
    let process = crate::guest::tests::program::starts(
        &mut bench,
        &data,
        &[opens_port(), reads_one_by_one(ZEROS + 64, 100)].concat(),
    );
    let tid = process.pid.as_raw();
    let reads = |bench: &mut Bench, count: u64| {
        for _ in 0..2_000 {
            let thread = &bench.supervisor.threads[&tid];
            let waits = matches!(thread.state, State::Blocked(wait) if wait.on == On::Files);
            let first = u64::from(ZEROS + 64);
            if waits && process.registers().rsi == first + count {
                return;
            }
            bench.supervisor.turn().expect("it is supervised");
        }
        panic!("it does not read");
    };
    let text = || {
        let mut bytes = [0; 15];
        let memory = Memory(process.pid);
        memory
            .read((ZEROS + 64).into(), &mut bytes)
            .expect("its memory");
        bytes
    };
    reads(&mut bench, 7);
    let (moment, registers) = (bench.supervisor.moment(), process.registers());
    let moment = moment.expect("it waits for its port");
    let then = bench.now();
    reads(&mut bench, 14);
    assert_eq!(&text(), b"mm=700\nmm=700\n\0");
    for _ in 0..2 {
        // The rig has no byte on its way.
        bench.passes(20);
        assert!(bench.supervisor.put_back(&moment));
        assert_eq!(&text(), b"mm=700\n\0\0\0\0\0\0\0\0");
        let now = process.registers();
        let found = (now.rip, now.rsi, now.rbx, now.r14);
        assert_eq!(
            found,
            (registers.rip, registers.rsi, registers.rbx, registers.r14)
        );
        assert_eq!(bench.now(), then);
        let thread = &bench.supervisor.threads[&tid];
        assert!(matches!(thread.state, State::Blocked(wait) if wait.on == On::Files));
        reads(&mut bench, 14);
        assert_eq!(&text(), b"mm=700\nmm=700\n\0");
    }
    // Another set of mappings or files is another program.
    bench.supervisor.is_signalled = true;
    assert!(bench.supervisor.moment().is_none());
    assert!(!bench.supervisor.put_back(&moment));
}

/// futex(2): a word in memory that processes share, at 8 bytes behind the start of a mapping.
/// MAP_SHARED is 1, MAP_FIXED 0x10, MAP_ANONYMOUS 0x20. A private operation (128) is one of a
/// single process: ETIMEDOUT is 110.
#[test]
fn processes_wait_for_a_word_that_they_share() {
    const SHARED: u32 = 0x50_0000;
    let map = call(libc::SYS_mmap, &[SHARED, 4_096, 3, 0x31, u32::MAX]);
    for (wait, wake, woken, result, millis) in [
        (0, 1, 1, 0, 5),
        (128, 1, 0, -110, 9),
        (0, 129, 0, -110, 9),
        (128, 129, 0, -110, 9),
    ] {
        let result: i64 = result;
        let child = [
            call(libc::SYS_nanosleep, &[DATA, 0]),
            call(libc::SYS_futex, &[SHARED + 8, wake, 5]),
            keeps(SHARED + 16),
            exit(0),
        ];
        let guest = Guest::runs(
            &words(&[0, 5 * MS, 0, 9 * MS]),
            &[
                &map,
                &call(libc::SYS_fork, &[]),
                &if_zero(&child.concat()),
                &call(libc::SYS_futex, &[SHARED + 8, wait, 0, DATA + 16]),
                &keeps(ZEROS),
                &rests(),
            ],
        );
        assert_eq!(guest.word(ZEROS).cast_signed(), result, "{wait} {wake}");
        assert_eq!(guest.word(SHARED + 16), woken);
        assert_eq!(guest.bench.now() / MS, millis);
    }
}

/// The same signal, SIGUSR1 (10, bit 0x200), pends for the process and for its thread: it is read
/// and waited for twice.
#[test]
fn a_signal_may_pend_twice() {
    let sends = {
        let mut code = call(libc::SYS_getpid, &[]);
        code.extend(keeps(ZEROS));
        code.extend(with_first(ZEROS, libc::SYS_kill, &[10]));
        // `mov esi, [ZEROS]; mov edx, 10`.
        code.extend([0x8B, 0x34, 0x25]);
        code.extend(ZEROS.to_le_bytes());
        code.extend([0xBA, 10, 0, 0, 0]);
        code.extend(with_first(ZEROS, libc::SYS_tgkill, &[]));
        code
    };
    let mut data = once(0, 0x200);
    data.extend(words(&[0, 2 * MS]));
    let wait = call(
        libc::SYS_rt_sigtimedwait,
        &[DATA + 32, ZEROS + 64, DATA + 40, 8],
    );
    let guest = Guest::runs(
        &data,
        &[
            &blocks(),
            &sends,
            &wait,
            &keeps(ZEROS + 8),
            &wait,
            &keeps(ZEROS + 16),
            &wait,
            &keeps(ZEROS + 24),
            &rests(),
        ],
    );
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 16)), (10, 10));
    assert_eq!(
        guest.word(ZEROS + 24).cast_signed(),
        -11,
        "EAGAIN after 2 ms"
    );
    assert_eq!(guest.bench.now() / MS, 2);
    let signalfd = call(libc::SYS_signalfd4, &[u32::MAX, DATA + 32, 8, 0]);
    let read = with_first(ZEROS + 32, libc::SYS_read, &[ZEROS + 64, 128]);
    let guest = Guest::runs(
        &data,
        &[
            &blocks(),
            &sends,
            &signalfd,
            &keeps(ZEROS + 32),
            &read,
            &keeps(ZEROS + 8),
            &read,
            &keeps(ZEROS + 16),
            &rests(),
        ],
    );
    assert_eq!((guest.word(ZEROS + 8), guest.word(ZEROS + 16)), (128, 128));
}

/// A program that starts itself again is in the list of started ones once.
#[test]
fn started_programs_are_listed_once() {
    let mut bench = Bench::new();
    bench.supervisor.begin_debugging(Wanted::Nothing);
    let guest = Guest::runs_in(bench, &[], &[&begin(), &executes_itself()]);
    let debugging = guest.bench.supervisor.debugging.as_ref().expect("begun");
    assert_eq!(debugging.started(), ["program"]);
    assert_eq!(guest.status(), Some(0x900));
}

/// A read of a copy takes the expirations: the other file, which does not wait (0o4000), has none
/// left. EAGAIN is 11.
#[test]
fn the_expirations_of_a_timer_are_read_once() {
    let mut data = once(5 * MS, 0);
    data.extend(words(&[0, 9 * MS]));
    let mut set = vec![0x41, 0xBA, 0, 0, 0, 0];
    set.extend(with_first(ZEROS, libc::SYS_timerfd_settime, &[0, DATA]));
    let read = |from, to| with_first(from, libc::SYS_read, &[to, 8]);
    let guest = Guest::runs(
        &data,
        &[
            &call(libc::SYS_timerfd_create, &[1, 0o4_000]),
            &keeps(ZEROS),
            &set,
            &with_first(ZEROS, libc::SYS_dup, &[]),
            &keeps(ZEROS + 8),
            &read(ZEROS, ZEROS + 64),
            &keeps(ZEROS + 16),
            &call(libc::SYS_nanosleep, &[DATA + 40, 0]),
            &read(ZEROS + 8, ZEROS + 72),
            &keeps(ZEROS + 24),
            &read(ZEROS, ZEROS + 80),
            &keeps(ZEROS + 32),
            &rests(),
        ],
    );
    assert_eq!(guest.word(ZEROS + 16).cast_signed(), -11);
    assert_eq!((guest.word(ZEROS + 24), guest.word(ZEROS + 72)), (8, 1));
    assert_eq!(guest.word(ZEROS + 32).cast_signed(), -11);
    assert_eq!((guest.word(ZEROS + 64), guest.word(ZEROS + 80)), (0, 0));
}

/// timer_create(2): SIGALRM (14) ends a program that has no handler for it.
#[test]
fn a_timer_ends_a_program_without_a_handler() {
    let mut data = once(5 * MS, 0);
    data.extend(words(&[0, 14]));
    let mut set = vec![0x41, 0xBA, 0, 0, 0, 0];
    set.extend(with_first(ZEROS, libc::SYS_timer_settime, &[0, DATA]));
    let guest = Guest::runs(
        &data,
        &[
            &call(libc::SYS_timer_create, &[1, DATA + 40, ZEROS]),
            &set,
            &call(libc::SYS_sched_yield, &[]),
            // It waits for a futex, so that it does not rest.
            &call(libc::SYS_futex, &[ZEROS + 64, 0, 0, 0]),
        ],
    );
    assert_eq!(guest.status(), Some(14));
    assert_eq!(guest.bench.now() / MS, 5);
}

/// A child of the debugged process has its own memory, without breakpoints (CC); one that borrows
/// the memory of its parent has them.
#[test]
fn a_child_has_no_breakpoints() {
    for (creates, expected) in [
        (call(libc::SYS_fork, &[]), 0x90),
        (call(libc::SYS_clone, &[17, 0]), 0x90),
        (call(libc::SYS_vfork, &[]), 0xCC),
    ] {
        let mut bench = Bench::new();
        bench.supervisor.begin_debugging(Wanted::NoShell);
        let code = [&creates[..], &if_zero(&exit(0)), &rests(), &[0x90]].concat();
        let at = ENTRY + code.len() as u64 - 1;
        let process = crate::guest::tests::program::starts(&mut bench, &[], &code);
        let pid = process.pid.as_raw();
        let goes_on = |bench: &mut Bench, is_enough: &dyn Fn(&mut Supervisor) -> bool| {
            for _ in 0..100 {
                bench.supervisor.turn().expect("it is supervised");
                if is_enough(&mut bench.supervisor) {
                    return;
                }
            }
            panic!("it does not come to that");
        };
        goes_on(&mut bench, &|it| it.take_stop() == Some(Stop::Loaded(pid)));
        assert!(bench.supervisor.add_break(at));
        // Its turn ends when it waits: for a signal, or for its child.
        let (_, next) = bench.supervisor.take_held().expect("it is loaded");
        bench.supervisor.run_on(pid, next);
        let child = bench.supervisor.others().next().expect("it has one");
        let child = Pid::from_raw(child);
        for (process, expected) in [(process.pid, 0xCC), (child, expected)] {
            let mut byte = [0];
            Memory(process).read(at, &mut byte).expect("its code");
            assert_eq!(byte, [expected]);
        }
    }
}
