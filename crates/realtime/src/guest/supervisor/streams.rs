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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, MS, Told, error, fd};
    use crate::guest::tests::Room;

    const ALL: [i64; 9] = [
        libc::SYS_read,
        libc::SYS_write,
        libc::SYS_recvfrom,
        libc::SYS_sendto,
        libc::SYS_recvmsg,
        libc::SYS_sendmsg,
        libc::SYS_accept,
        libc::SYS_accept4,
        libc::SYS_connect,
    ];

    /// recv(2), send(2): MSG_DONTWAIT is 0x40, in the fourth argument, or in the third of the calls
    /// with a message.
    #[test]
    fn a_flag_lets_a_call_not_wait() {
        let waits = |number, args: &[u64]| waits_by_flag(&Call::made(number, args));
        for number in ALL {
            assert!(waits(number, &[0; 6]), "{number}");
            let by_fourth = [libc::SYS_recvfrom, libc::SYS_sendto].contains(&number);
            let by_third = [libc::SYS_recvmsg, libc::SYS_sendmsg].contains(&number);
            assert_eq!(waits(number, &[0, 0, 0, 0x4040]), !by_fourth, "{number}");
            assert_eq!(waits(number, &[0, 0, 0x4040]), !by_third, "{number}");
        }
    }

    /// MSG_PEEK is 2, MSG_NOSIGNAL 0x4000, MSG_ERRQUEUE 0x2000.
    #[test]
    fn a_plain_receive_has_no_other_flags() {
        let is = |number, args: &[u64]| is_plain_receive(&Call::made(number, args));
        for flags in [0, 2, 0x40, 0x4042] {
            assert!(is(libc::SYS_recvfrom, &[9, 9, 9, flags]), "{flags:x}");
            assert!(is(libc::SYS_recvmsg, &[9, 9, flags, 9]), "{flags:x}");
        }
        for flags in [0x2000, 1, 0x2040] {
            assert!(!is(libc::SYS_recvfrom, &[0, 0, 0, flags]), "{flags:x}");
            assert!(!is(libc::SYS_recvmsg, &[0, 0, flags]), "{flags:x}");
        }
        assert!(is(libc::SYS_accept, &[1; 6]) && is(libc::SYS_accept4, &[1; 6]));
        assert!(!is(libc::SYS_read, &[0; 6]) && !is(libc::SYS_sendto, &[0; 6]));
    }

    #[test]
    fn buffers_are_filled_and_emptied_in_their_order() {
        let tid = std::process::id().cast_signed();
        let room = Room::of(b"abcdefghij");
        let parts = [(room.at(0), 2), (room.at(4), 0), (room.at(5), 3)];
        assert_eq!((lens(&parts), lens(&[])), (5, 0));
        assert_eq!(lens(&[(0, usize::MAX), (0, 2)]), usize::MAX);
        let some = |skip, most| gather(tid, &parts, skip, most).expect("own");
        for (skip, most, expected) in [
            (0, 9, &b"abfgh"[..]),
            (0, 1, b"a"),
            (0, 3, b"abf"),
            (1, 3, b"bfg"),
            (2, 9, b"fgh"),
            (3, 1, b"g"),
            (5, 9, b""),
            (9, 9, b""),
        ] {
            assert_eq!(some(skip, most), expected, "{skip} {most}");
        }
        scatter(tid, &parts, b"XYZ").expect("own");
        assert_eq!(room.bytes(), b"XYcdeZghij");
        scatter(tid, &parts, b"1234567").expect("own");
        assert_eq!(room.bytes(), b"12cde345ij");
        assert_eq!(gather(tid, &[(8, 2)], 0, 9), Err(Errno::EFAULT));
        let table = Room::of_words(&[room.at(0), 2, room.at(5), 3]);
        let of = |number, args: &[u64]| buffers(tid, &Call::made(number, args));
        let both = Ok(vec![(room.at(0), 2), (room.at(5), 3)]);
        assert_eq!(of(libc::SYS_readv, &[9, table.at(0), 2]), both);
        assert_eq!(of(libc::SYS_writev, &[9, table.at(0), 2]), both);
        assert_eq!(of(libc::SYS_read, &[9, 77, 2]), Ok(vec![(77, 2)]));
    }

    /// read(2), write(2): EBADF for a file that is not open for that, ENOTSOCK for one that is no
    /// socket; a short read of a counter is the kernel's (eventfd(2)).
    #[test]
    fn a_call_that_is_not_possible_fails_at_once() {
        let mut bench = Bench::new();
        let room = Room::new(16);
        let (ears, mouth) = std::io::pipe().expect("pipes");
        let flags = rustix::event::EventfdFlags::empty();
        let counter = rustix::event::eventfd(0, flags).expect("counters");
        let (one, _other) = std::os::unix::net::UnixStream::pair().expect("sockets");
        let waits = Told::Waits(On::Files, None);
        let [read, write, recv] = [libc::SYS_read, libc::SYS_write, libc::SYS_recvfrom];
        for (number, file, len, expected) in [
            (read, fd(&ears), 1, waits),
            (read, fd(&ears), 0, Told::Kernel),
            (read, fd(&mouth), 1, error(Errno::EBADF)),
            (write, fd(&ears), 1, error(Errno::EBADF)),
            (write, fd(&mouth), 1, Told::Kernel),
            (recv, fd(&ears), 1, error(Errno::ENOTSOCK)),
            (recv, fd(&one), 1, waits),
            (read, fd(&one), 1, waits),
            (read, fd(&one), 0, Told::Kernel),
            (read, fd(&counter), 8, waits),
            (read, fd(&counter), 7, Told::Kernel),
            (write, fd(&counter), 8, Told::Kernel),
            (read, u64::MAX, 1, error(Errno::EBADF)),
            (read, 9_999, 1, Told::Kernel),
            (write, 9_999, 1, Told::Kernel),
        ] {
            let told = bench.calls(number, &[file, room.at(0), len]);
            assert_eq!(told, expected, "{number} {file} {len}");
        }
        let args = [fd(&one), room.at(0), 1, 0x40];
        assert_eq!(bench.calls(recv, &args), error(Errno::EAGAIN));
        // With MSG_OOB it is the kernel's.
        assert_eq!(
            bench.calls(recv, &[fd(&one), room.at(0), 1, 0x41]),
            Told::Kernel
        );
        std::io::Write::write_all(&mut &mouth, b"x").expect("room");
        assert_eq!(bench.calls(read, &[fd(&ears), room.at(0), 1]), Told::Kernel);
    }

    #[test]
    fn files_that_never_wait_are_the_kernels() {
        let mut bench = Bench::new();
        let room = Room::new(16);
        let null = std::fs::File::options()
            .read(true)
            .write(true)
            .open("/dev/null");
        let null = null.expect("each system has it");
        let mouth = bench.mouth();
        for number in [libc::SYS_read, libc::SYS_write] {
            assert_eq!(
                bench.calls(number, &[fd(&null), room.at(0), 1]),
                Told::Kernel
            );
        }
        assert_eq!(
            bench.calls(libc::SYS_write, &[fd(&mouth), room.at(0), 1]),
            Told::Kernel
        );
        // Chance is that of the run, not of the system.
        let chance = std::fs::File::open("/dev/urandom").expect("each system has it");
        let told = bench.calls(libc::SYS_read, &[fd(&chance), room.at(4), 8]);
        assert_eq!(told, Told::Answer(8));
        let first = room.bytes();
        assert!(first[..4] == [0; 4] && first[4..12] != [0; 8] && first[12..] == [0; 4]);
        let mut other = Bench::new();
        assert_eq!(
            other.calls(libc::SYS_read, &[fd(&chance), room.at(4), 8]),
            told
        );
        assert_eq!(room.bytes(), first);
    }

    /// socket(7): SO_RCVTIMEO is the longest wait of a receive, SO_SNDTIMEO of a send.
    #[test]
    fn a_socket_has_a_longest_wait() {
        let mut bench = Bench::new();
        bench.passes(10);
        let room = Room::new(16);
        let (one, _other) = std::os::unix::net::UnixStream::pair().expect("sockets");
        let most = Some(core::time::Duration::from_millis(40));
        one.set_read_timeout(most).expect("ours");
        let args = [fd(&one), room.at(0), 1];
        let until = Told::Waits(On::Files, Some(50 * MS));
        assert_eq!(bench.calls(libc::SYS_recvfrom, &args), until);
        bench.passes(39);
        assert_eq!(bench.again(), until);
        bench.passes(1);
        assert_eq!(bench.again(), error(Errno::EAGAIN));
        one.set_read_timeout(None).expect("ours");
        one.set_write_timeout(most).expect("ours");
        assert_eq!(
            bench.calls(libc::SYS_recvfrom, &args),
            Told::Waits(On::Files, None)
        );
    }

    /// recvmmsg(2): the first message is waited for, unless MSG_DONTWAIT is there.
    #[test]
    fn several_messages_are_received_at_once() {
        let mut bench = Bench::new();
        let (one, other) = std::os::unix::net::UnixDatagram::pair().expect("sockets");
        let (ears, _mouth) = std::io::pipe().expect("pipes");
        let many = libc::SYS_recvmmsg;
        let waits = Told::Waits(On::Files, None);
        assert_eq!(bench.calls(many, &[fd(&one), 8, 1, 0]), waits);
        assert_eq!(bench.calls(many, &[fd(&one), 8, 2, 0x1_0000]), waits);
        assert_eq!(bench.calls(many, &[fd(&one), 8, 2, 0x40]), Told::Kernel);
        assert!(bench.supervisor.notes().is_empty());
        assert_eq!(bench.calls(many, &[fd(&one), 8, 2, 0]), waits);
        assert_eq!(bench.supervisor.notes(), ["recvmmsg is done by the kernel"]);
        assert_eq!(
            bench.calls(many, &[fd(&ears), 8, 1, 0]),
            error(Errno::ENOTSOCK)
        );
        assert_eq!(bench.calls(many, &[9_999, 8, 1, 0]), error(Errno::EBADF));
        other.send(b"x").expect("room");
        assert_eq!(bench.calls(many, &[fd(&one), 8, 1, 0]), Told::Kernel);
    }

    /// timerfd_create(2): such a file takes no bytes. The kernel says so; it is never ready.
    #[test]
    fn a_write_to_a_timer_is_the_kernels() {
        use rustix::time::{TimerfdClockId, TimerfdFlags, timerfd_create};

        let mut bench = Bench::new();
        let clock = TimerfdClockId::Monotonic;
        let timer = timerfd_create(clock, TimerfdFlags::empty()).expect("the system has them");
        let room = Room::new(8);
        let args = [fd(&timer), room.at(0), 8];
        assert_eq!(bench.calls(libc::SYS_write, &args), Told::Kernel);
    }
}
