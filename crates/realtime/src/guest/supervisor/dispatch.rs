//! Selects the handler of each call.

use nix::libc;
use nix::unistd::Pid;

use super::clocks::low_i32;
use super::{Memory, Outcome, Supervisor, Wait};
use crate::guest::call::{self, Call, FUTEX_REQUEUE, FUTEX_WAIT, FUTEX_WAKE};
use crate::guest::launch::{NOTICES, show_child};
use crate::guest::links::Link;
use crate::guest::trace::Record;

impl Supervisor {
    pub(super) fn record(&mut self, tid: i32, call: &Call, outcome: &Outcome) {
        let result = match outcome {
            Outcome::Answer(result) | Outcome::Yield(result) => Some(*result),
            Outcome::Kernel | Outcome::Leave(_) => None,
            Outcome::Block(_) => return,
        };
        let thread = self.threads.get(&tid).map_or(0, |thread| thread.index);
        self.calls.add(Record {
            at: self.stage.now(),
            thread,
            number: call.number,
            looks: 0,
            result,
        });
    }

    /// The decision about a call.
    pub(super) fn outcome(&mut self, tid: i32, call: &Call) -> Outcome {
        let memory = Memory(Pid::from_raw(tid));
        let done = match call.number {
            libc::SYS_clock_gettime
            | libc::SYS_clock_getres
            | libc::SYS_clock_settime
            | libc::SYS_gettimeofday
            | libc::SYS_time
            | libc::SYS_times => self.look_at_clock(memory, call),
            libc::SYS_nanosleep | libc::SYS_clock_nanosleep => self.sleep(tid, call),
            libc::SYS_pause => Ok(Outcome::Block(Wait::for_ever())),
            libc::SYS_sched_yield => Ok(Outcome::Yield(0)),
            libc::SYS_getrandom => self.random(tid, call),
            libc::SYS_futex => self.futex(tid, call),
            libc::SYS_rt_sigsuspend | libc::SYS_rt_sigtimedwait => self.wait_for_signal(tid, call),
            _ if self.is_interrupted_at_once(tid, call) => Ok(Outcome::Kernel),
            libc::SYS_poll | libc::SYS_ppoll => self.poll(tid, call),
            libc::SYS_select | libc::SYS_pselect6 => self.select(tid, call),
            libc::SYS_epoll_wait | libc::SYS_epoll_pwait | libc::SYS_epoll_pwait2 => {
                self.epoll(tid, call)
            }
            libc::SYS_read
            | libc::SYS_readv
            | libc::SYS_recvfrom
            | libc::SYS_recvmsg
            | libc::SYS_accept
            | libc::SYS_accept4 => self.read(tid, call),
            libc::SYS_recvmmsg => self.receive_many(tid, call),
            libc::SYS_write | libc::SYS_writev | libc::SYS_sendto | libc::SYS_sendmsg => {
                self.write(tid, call)
            }
            libc::SYS_open | libc::SYS_openat | libc::SYS_openat2 => Ok(self.open(tid, call)),
            libc::SYS_ioctl => self.ioctl(tid, call),
            libc::SYS_alarm | libc::SYS_setitimer | libc::SYS_getitimer => {
                self.interval_timer(tid, call)
            }
            libc::SYS_timerfd_create | libc::SYS_timerfd_settime | libc::SYS_timerfd_gettime => {
                self.timer_file(tid, call)
            }
            libc::SYS_timer_create
            | libc::SYS_timer_settime
            | libc::SYS_timer_gettime
            | libc::SYS_timer_getoverrun
            | libc::SYS_timer_delete => self.posix_timer(tid, call),
            libc::SYS_fcntl | libc::SYS_flock => self.lock_file(tid, call),
            libc::SYS_adjtimex
            | libc::SYS_clock_adjtime
            | libc::SYS_settimeofday
            | libc::SYS_getrusage
            | libc::SYS_sysinfo => self.tell(tid, call),
            libc::SYS_mq_timedreceive | libc::SYS_mq_timedsend => self.message(tid, call),
            libc::SYS_msgrcv | libc::SYS_msgsnd | libc::SYS_semop | libc::SYS_semtimedop => {
                self.queue(tid, call)
            }
            _ => Ok(self.about_processes(tid, call)),
        };
        done.unwrap_or_else(Outcome::from)
    }

    /// Whether a call is unrelated to time and costs none; the kernel executes it.
    pub(super) fn is_for_free(&mut self, tid: i32, call: &Call) -> bool {
        match call.number {
            libc::SYS_msgctl | libc::SYS_semctl => self.has_queues_changed = true,
            libc::SYS_getcpu
            | libc::SYS_rseq
            | libc::SYS_sched_getaffinity
            | libc::SYS_sched_setaffinity => self.sees_processor(tid, call),
            libc::SYS_setsockopt => {
                self.note("gets the system's time of messages (SO_TIMESTAMP)".to_owned());
            }
            libc::SYS_clone | libc::SYS_clone3 => show_child(Pid::from_raw(tid), call),
            libc::SYS_readlink | libc::SYS_readlinkat => self.read_link(tid, call),
            libc::SYS_lstat | libc::SYS_newfstatat => {
                let link = Link::of(Pid::from_raw(tid), call);
                let terminal = link.unlisted_terminal();
                if terminal.is_some_and(|(device, _)| self.stage.port_of(device).is_some()) {
                    link.answer_status(Pid::from_raw(tid), call);
                }
            }
            libc::SYS_bind | libc::SYS_getsockname => self.names_socket(tid, call),
            // This call is stopped so that the clock page is read before the exec replaces the
            // memory.
            libc::SYS_execve | libc::SYS_execveat => self.stage.stir(),
            libc::SYS_close | libc::SYS_dup2 | libc::SYS_dup3 | libc::SYS_close_range => {
                self.lets_go(tid, call);
            }
            libc::SYS_epoll_ctl
            | libc::SYS_preadv2
            | libc::SYS_pwritev2
            | libc::SYS_splice
            | libc::SYS_tee
            | libc::SYS_vmsplice
            | libc::SYS_sendfile => self.lets_kernel_read(tid, call),
            libc::SYS_fcntl if NOTICES.contains(&low_i32(call.args[1])) => {
                self.sets_notice(tid, call);
            }
            libc::SYS_io_submit => {
                // The files that it reads are described in memory, in many formats.
                self.note("io_submit is done by the kernel".to_owned());
                self.lets_all_go();
            }
            _ => return false,
        }
        true
    }

    /// Calls about processes and signals, and calls without a handler.
    fn about_processes(&mut self, tid: i32, call: &Call) -> Outcome {
        match call.number {
            libc::SYS_wait4 | libc::SYS_waitid => self.wait_for_child(tid, call),
            libc::SYS_exit => self.exits(tid),
            libc::SYS_exit_group => {
                self.dies(tid);
                Outcome::Kernel
            }
            libc::SYS_kill
            | libc::SYS_tkill
            | libc::SYS_tgkill
            | libc::SYS_rt_sigqueueinfo
            | libc::SYS_rt_tgsigqueueinfo
            | libc::SYS_pidfd_send_signal => self.kill(tid, call),
            libc::SYS_rt_sigaction => {
                self.sets_handler(tid, call);
                Outcome::Kernel
            }
            libc::SYS_signalfd | libc::SYS_signalfd4 => {
                self.has_signal_files = true;
                Outcome::Kernel
            }
            libc::SYS_connect => {
                if !is_near(tid, call) {
                    self.note("connects to the network".to_owned());
                }
                Outcome::Kernel
            }
            libc::SYS_io_uring_setup => {
                self.note("io_uring is not available to the program".to_owned());
                nix::errno::Errno::ENOSYS.into()
            }
            // The supervisor wakes threads itself, and the kernel does not know these wake-ups.
            libc::SYS_futex_waitv | FUTEX_WAKE | FUTEX_WAIT | FUTEX_REQUEUE => {
                let name = call::name(call.number);
                self.note(format!("{name} is not available to the program"));
                nix::errno::Errno::ENOSYS.into()
            }
            number => {
                self.note(format!("{} is done by the kernel", call::name(number)));
                Outcome::Kernel
            }
        }
    }
}

/// Whether a socket is connected to a peer on this machine.
fn is_near(tid: i32, call: &Call) -> bool {
    let mut address = [0; 24];
    let len = usize::try_from(call.args[2])
        .unwrap_or(0)
        .min(address.len());
    let read = Memory(Pid::from_raw(tid)).read(call.args[1], &mut address[..len]);
    let family = i32::from(u16::from_ne_bytes([address[0], address[1]]));
    let own = &address[8..24];
    read.is_err()
        || match family {
            libc::AF_INET => matches!(address[4], 0 | 127),
            libc::AF_INET6 => own[..15].iter().all(|&byte| byte == 0),
            _ => true,
        }
}

#[cfg(test)]
mod tests {
    use nix::errno::Errno;

    use super::super::{Calls, On, State};
    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told, error};
    use crate::guest::tests::Room;

    /// connect(2): sockets of this machine, loopback, and an address that is not given are near.
    #[test]
    fn a_peer_on_this_machine_is_near() {
        let tid = std::process::id().cast_signed();
        let near = |address: &[u8]| {
            let room = Room::of(address);
            let len = address.len() as u64;
            is_near(tid, &Call::made(libc::SYS_connect, &[3, room.at(0), len]))
        };
        let v4 = |first: u8| {
            let mut address = [0; 16];
            address[..2].copy_from_slice(&2_u16.to_ne_bytes());
            address[4..8].copy_from_slice(&[first, 0, 0, 1]);
            address
        };
        assert!(near(&v4(127)) && near(&v4(0)));
        assert!(!near(&v4(10)) && !near(&v4(126)) && !near(&v4(128)));
        let v6 = |at: usize, byte: u8| {
            let mut address = [0; 28];
            address[..2].copy_from_slice(&10_u16.to_ne_bytes());
            address[23] = 1;
            address[at] = byte;
            address
        };
        assert!(near(&v6(23, 1)) && near(&v6(23, 0)) && near(&v6(4, 9)));
        for at in [8, 15, 22] {
            assert!(!near(&v6(at, 1)), "{at}");
        }
        assert!(near(&[1, 0, b'/']), "a path");
        let far = v4(10);
        let room = Room::of(&far);
        let call = |at, len| Call::made(libc::SYS_connect, &[3, at, len]);
        assert!(is_near(tid, &call(8, 16)) && !is_near(tid, &call(room.at(0), 16)));
        assert!(!is_near(tid, &call(room.at(0), 8)));
    }

    #[test]
    fn calls_are_answered_by_the_kernel_or_not_at_all() {
        let mut bench = Bench::new();
        let notes = |bench: &mut Bench| core::mem::take(&mut bench.supervisor.notes);
        assert_eq!(
            bench.calls(libc::SYS_pause, &[]),
            Told::Waits(On::Others, None)
        );
        assert_eq!(bench.calls(libc::SYS_sched_yield, &[]), Told::Yield(0));
        assert_eq!(
            bench.calls(libc::SYS_rt_sigaction, &[0, 0, 0, 8]),
            Told::Kernel
        );
        assert!(!bench.supervisor.has_signal_files);
        assert_eq!(bench.calls(libc::SYS_signalfd4, &[]), Told::Kernel);
        assert!(core::mem::take(&mut bench.supervisor.has_signal_files));
        assert_eq!(bench.calls(libc::SYS_signalfd, &[]), Told::Kernel);
        assert!(bench.supervisor.has_signal_files);
        assert!(notes(&mut bench).is_empty());
        assert_eq!(
            bench.calls(libc::SYS_io_uring_setup, &[]),
            error(Errno::ENOSYS)
        );
        let note = "io_uring is not available to the program";
        assert_eq!(notes(&mut bench), [note]);
        for (number, name) in [
            (libc::SYS_futex_waitv, "futex_waitv"),
            (FUTEX_WAKE, "futex_wake"),
            (FUTEX_WAIT, "futex_wait"),
            (FUTEX_REQUEUE, "futex_requeue"),
        ] {
            assert_eq!(bench.calls(number, &[]), error(Errno::ENOSYS));
            let note = format!("{name} is not available to the program");
            assert_eq!(notes(&mut bench), [note]);
        }
        for (number, name) in [
            (libc::SYS_io_getevents, "io_getevents"),
            (9_999, "call 9999"),
        ] {
            assert_eq!(bench.calls(number, &[]), Told::Kernel);
            assert_eq!(notes(&mut bench), [format!("{name} is done by the kernel")]);
        }
        let far = Room::of(&[2, 0, 0, 80, 10, 0, 0, 1]);
        assert_eq!(
            bench.calls(libc::SYS_connect, &[3, far.at(0), 8]),
            Told::Kernel
        );
        assert_eq!(notes(&mut bench), ["connects to the network"]);
        let near = Room::of(&[2, 0, 0, 80, 127, 0, 0, 1]);
        assert_eq!(
            bench.calls(libc::SYS_connect, &[3, near.at(0), 8]),
            Told::Kernel
        );
        assert!(notes(&mut bench).is_empty());
        assert_eq!(bench.calls(libc::SYS_exit_group, &[0]), Told::Kernel);
        assert!(bench.process().is_dying && bench.process().files.is_empty());
    }

    #[test]
    fn calls_that_have_nothing_to_do_with_time_are_for_free() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        let free = |bench: &mut Bench, number, args: &[u64]| {
            bench.supervisor.is_for_free(tid, &Call::made(number, args))
        };
        for number in [libc::SYS_msgctl, libc::SYS_semctl] {
            bench.supervisor.has_queues_changed = false;
            assert!(free(&mut bench, number, &[]));
            assert!(bench.supervisor.has_queues_changed);
        }
        for number in [
            libc::SYS_getcpu,
            libc::SYS_rseq,
            libc::SYS_clone,
            libc::SYS_readlink,
            libc::SYS_lstat,
            libc::SYS_bind,
            libc::SYS_execve,
            libc::SYS_execveat,
            libc::SYS_epoll_ctl,
            libc::SYS_tee,
        ] {
            assert!(free(&mut bench, number, &[]), "{number}");
        }
        assert!(bench.supervisor.notes().is_empty());
        assert!(free(&mut bench, libc::SYS_setsockopt, &[]));
        let note = "gets the system's time of messages (SO_TIMESTAMP)";
        assert_eq!(core::mem::take(&mut bench.supervisor.notes), [note]);
        assert!(free(&mut bench, libc::SYS_io_submit, &[]));
        assert_eq!(
            bench.supervisor.notes(),
            ["io_submit is done by the kernel"]
        );
        // F_SETFL is 4, F_SETOWN 8, F_SETSIG 10, F_SETOWN_EX 15; F_GETFL is 3, F_SETLKW 7.
        for (request, expected) in [
            (4, true),
            (8, true),
            (10, true),
            (15, true),
            (3, false),
            (7, false),
        ] {
            assert_eq!(
                free(&mut bench, libc::SYS_fcntl, &[9_999, request]),
                expected
            );
        }
        for number in [libc::SYS_read, libc::SYS_nanosleep, libc::SYS_flock] {
            assert!(!free(&mut bench, number, &[]), "{number}");
        }
    }

    #[test]
    fn what_was_decided_is_recorded() {
        let mut bench = Bench::new();
        let tid = bench.tid;
        bench.passes(3);
        let call = Call::made(libc::SYS_read, &[]);
        let mut expected = Calls::new(None).expect("no file");
        for (outcome, result) in [
            (Outcome::Answer(7), Some(Some(7))),
            (Outcome::Yield(8), Some(Some(8))),
            (Outcome::Kernel, Some(None)),
            (Outcome::Leave(State::Ended), Some(None)),
            (Outcome::Block(Wait::for_ever()), None),
        ] {
            bench.supervisor.record(tid, &call, &outcome);
            if let Some(result) = result {
                expected.add(Record {
                    at: protocols::Instant::from_millis(3),
                    thread: 0,
                    number: libc::SYS_read,
                    looks: 0,
                    result,
                });
            }
            assert_eq!(bench.supervisor.calls.part_from(&expected), None);
        }
    }
}
