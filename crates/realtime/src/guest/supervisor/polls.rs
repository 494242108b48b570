//! Waiting for several files at once.

use core::time::Duration;
use std::sync::Arc;

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use protocols::Instant;
use rustix::event::{PollFd, PollFlags, Timespec, epoll, poll};

use super::clocks::{low_i32, nanos, timespec};
use super::files::{File, Kind};
use super::{Memory, On, Outcome, Supervisor, Wait};
use crate::guest::call::Call;

/// Maximum number of files in one wait, and of files of a `select`.
const FILES_MAX: u64 = 4096;
const SELECTED_MAX: i32 = 1024;
/// Length of a `pollfd`, and of an `epoll_event` on this processor, bytes.
pub(super) const POLLFD: usize = 8;
/// Length of the request in a `pollfd`: all fields except the answer.
const WANTED: usize = 6;
const EPOLL_EVENT: usize = 12;
/// Maximum number of stored pipes of a thread's selects.
const QUIET_MAX: usize = 16;
/// Maximum number of pieces of memory that the kernel writes in one call (UIO_MAXIOV).
const PIECES_MAX: usize = 1024;

impl Supervisor {
    pub(super) fn poll(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let memory = Memory(Pid::from_raw(tid));
        let [address, _, timeout, ..] = call.args;
        let entries = self.noted_entries(tid, call)?;
        let deadline = match call.number {
            libc::SYS_poll => self.millis_from(tid, low_i32(timeout)),
            _ => self.timespec_from(tid, timeout, 1)?,
        };
        let wanted = entries.chunks_exact(POLLFD).map(|entry| {
            let fd = i32::from_ne_bytes([entry[0], entry[1], entry[2], entry[3]]);
            (fd, u16::from_ne_bytes([entry[4], entry[5]]))
        });
        let wanted: Vec<(i32, u16)> = wanted.collect();
        let found = self.look_at(tid, &wanted);
        let ready = found.iter().filter(|&&flags| flags != 0).count();
        let is_time_up = deadline.is_some_and(|at| self.stage.now() >= at);
        if ready == 0 && !is_time_up {
            return Ok(wait_until(deadline));
        }
        // Write only the answers, because another thread may change the requests meanwhile.
        let answers: Vec<[u8; 2]> = found.iter().map(|flags| flags.to_ne_bytes()).collect();
        let places = (WANTED as u64..).step_by(POLLFD);
        let places = places.map(|at| address.wrapping_add(at));
        let places: Vec<_> = places
            .zip(answers.iter().map(<[u8; 2]>::as_slice))
            .collect();
        for part in places.chunks(PIECES_MAX) {
            memory.write_all(part.iter().copied())?;
        }
        if call.number == libc::SYS_ppoll {
            self.tell_rest(memory, timeout, deadline, 1)?;
        }
        Ok(Outcome::Answer(i64::try_from(ready).unwrap_or(0)))
    }

    /// The entries of a `poll`, read once: the awaited events do not change during the wait.
    fn noted_entries(&mut self, tid: i32, call: &Call) -> Result<Vec<u8>, Errno> {
        let thread = self.threads.get_mut(&tid).ok_or(Errno::ESRCH)?;
        if !thread.watched.is_empty() {
            let noted = thread.watched.chunks_exact(WANTED);
            return Ok(noted
                .flat_map(|wanted| wanted.iter().chain(&[0; POLLFD - WANTED]))
                .copied()
                .collect());
        }
        let entries = entries(tid, call)?;
        thread.watched = wanted_of(&entries);
        Ok(entries)
    }

    /// The sets and the time of a `select`, read once.
    fn noted_sets(&mut self, tid: i32, call: &Call) -> Result<([Vec<u8>; 3], [u8; 16]), Errno> {
        let thread = self.threads.get_mut(&tid).ok_or(Errno::ESRCH)?;
        let (_, len) = size_of_sets(call.args[0]);
        if !thread.watched.is_empty() {
            let set = |index: usize| thread.watched[index * len..(index + 1) * len].to_vec();
            return Ok(([set(0), set(1), set(2)], thread.timeout));
        }
        let (sets, time) = sets(tid, call)?;
        (thread.watched, thread.timeout) = (sets.concat(), time);
        Ok((sets, time))
    }

    /// The readiness of each file, as the kernel's flags.
    fn look_at(&mut self, tid: i32, wanted: &[(i32, u16)]) -> Vec<u16> {
        let files: Vec<Option<Arc<File>>> = wanted
            .iter()
            .map(|&(fd, _)| self.file(tid, fd).filter(|_| fd >= 0))
            .collect();
        let are_held = files.iter().flatten().all(|file| self.holds(file));
        let is_any_held = are_held || files.iter().flatten().any(|file| self.holds(file));
        let pipes = files.iter().zip(wanted);
        let pipes = pipes.filter(|(file, _)| file.as_ref().is_some_and(|it| it.is_inner()));
        let pipes = pipes.map(|(_, &(fd, _))| fd);
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.waits_for_ports = are_held;
            thread.asks_port = is_any_held;
            for fd in pipes {
                // Keep the latest ones: pyserial has two for each port.
                thread.quiet.retain(|&other| other != fd);
                thread.quiet.push(fd);
            }
            let surplus = thread.quiet.len().saturating_sub(QUIET_MAX);
            thread.quiet.drain(..surplus);
        }
        let mut polled: Vec<PollFd<'_>> = files
            .iter()
            .zip(wanted)
            .filter_map(|(file, &(_, flags))| {
                let file = file.as_ref().filter(|file| !self.holds(file))?;
                let flags = PollFlags::from_bits_retain(flags);
                Some(PollFd::new(&file.fd, flags))
            })
            .collect();
        let done = match polled.is_empty() {
            true => Ok(0),
            false => poll(&mut polled, Some(&Timespec::default())),
        };
        let mut found = polled.iter().map(|one| match done {
            Ok(_) => one.revents().bits(),
            Err(_) => 0,
        });
        let not_open = PollFlags::NVAL.bits();
        let looks = files.iter().zip(wanted);
        looks
            .map(|(file, &(fd, flags))| match file.as_deref() {
                Some(file) if file.kind == Kind::Signals => {
                    found.next();
                    match self.has_signal(tid, file) {
                        true => flags & PollFlags::IN.bits(),
                        false => 0,
                    }
                }
                // The supervisor reads this file all the time, in wall time.
                Some(file) if file.kind == Kind::Mouth => {
                    found.next();
                    flags & PollFlags::OUT.bits()
                }
                Some(file) if self.holds(file) => {
                    let Kind::Port(port) = file.kind else {
                        return 0;
                    };
                    self.held_readiness(port, flags)
                }
                Some(file) => {
                    let found = found.next().unwrap_or(0);
                    match file.kind {
                        Kind::Port(port) => self.port_readiness(port, flags, found),
                        Kind::Gone => {
                            self.stage.note_fruitless();
                            found
                        }
                        _ => found,
                    }
                }
                None if fd < 0 => 0,
                None => not_open,
            })
            .collect()
    }

    /// Whether the port's terminal, and not the kernel, knows the readiness.
    fn holds(&mut self, file: &File) -> bool {
        let Kind::Port(port) = file.kind else {
            return false;
        };
        self.stage.terminal(port).is_some_and(|it| it.holds())
    }

    /// Readiness of a port whose terminal holds its bytes; output is ready unless stopped.
    fn held_readiness(&mut self, port: usize, wanted: u16) -> u16 {
        let Some(terminal) = self.stage.terminal(port) else {
            return 0;
        };
        let mut found = PollFlags::empty();
        if terminal.is_polled_readable() {
            found |= PollFlags::IN | PollFlags::RDNORM;
        }
        if !terminal.is_stopped() {
            found |= PollFlags::OUT | PollFlags::WRNORM;
        }
        wanted & found.bits()
    }

    /// The readiness of a port for which the kernel reports `found`.
    fn port_readiness(&mut self, port: usize, wanted: u16, found: u16) -> u16 {
        let Some(terminal) = self.stage.terminal(port) else {
            return found;
        };
        let mut found = found;
        if terminal.is_at_end() {
            found |= wanted & (PollFlags::IN | PollFlags::RDNORM).bits();
        }
        if terminal.is_stopped() {
            found &= !(PollFlags::OUT | PollFlags::WRNORM).bits();
        }
        found
    }

    pub(super) fn select(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let memory = Memory(Pid::from_raw(tid));
        let [count, read, write, except, timeout, _] = call.args;
        let unit = match call.number {
            libc::SYS_select => 1_000,
            _ => 1,
        };
        let addresses = [read, write, except];
        let (count, len) = size_of_sets(count);
        let (sets, time) = self.noted_sets(tid, call)?;
        let deadline = match timeout {
            0 => None,
            _ => Some(self.deadline_after(tid, time, unit)?),
        };
        let kinds = [PollFlags::IN, PollFlags::OUT, PollFlags::PRI];
        let found = self.select_from(tid, count, &sets, kinds);
        if found.contains(&None) {
            return Err(Errno::EBADF);
        }
        let is_time_up = deadline.is_some_and(|at| self.stage.now() >= at);
        let mut ready = 0;
        let mut results = [(); 3].map(|()| vec![0_u8; len]);
        for (place, flags) in found.into_iter().flatten() {
            let (byte, bit) = (place / 8, 1_u8 << (place % 8));
            for (index, kind) in kinds.into_iter().enumerate() {
                let is_wanted = sets[index][byte] & bit != 0;
                if is_wanted && is_selected(kind, flags) {
                    results[index][byte] |= bit;
                    ready += 1;
                }
            }
        }
        if ready == 0 && !is_time_up {
            return Ok(wait_until(deadline));
        }
        let rest = deadline.map(|deadline| self.rest_until(deadline, unit));
        let rest = rest.as_ref().map(|rest| (timeout, rest.as_slice()));
        let places = results.iter().map(Vec::as_slice).zip(addresses);
        let places = places.map(|(bytes, address)| (address, bytes));
        memory.write_all(places.chain(rest))?;
        Ok(Outcome::Answer(ready))
    }

    /// The files of three sets with the readiness of each; `None` if a file is not open.
    fn select_from(
        &mut self,
        tid: i32,
        count: usize,
        sets: &[Vec<u8>; 3],
        kinds: [PollFlags; 3],
    ) -> Vec<Option<(usize, PollFlags)>> {
        let mut wanted = Vec::new();
        for place in 0..count {
            let is_in = |set: &Vec<u8>| set[place / 8] & (1 << (place % 8)) != 0;
            let mut flags = PollFlags::empty();
            for (set, kind) in sets.iter().zip(kinds) {
                if is_in(set) {
                    flags |= kind;
                }
            }
            if !flags.is_empty() {
                wanted.push((i32::try_from(place).unwrap_or(-1), flags.bits()));
            }
        }
        let found = self.look_at(tid, &wanted);
        let found = wanted.into_iter().zip(found).map(|((fd, _), flags)| {
            let flags = PollFlags::from_bits_retain(flags);
            let place = usize::try_from(fd).unwrap_or_default();
            (!flags.contains(PollFlags::NVAL)).then_some((place, flags))
        });
        found.collect()
    }

    pub(super) fn epoll(&mut self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let [fd, address, most, timeout, ..] = call.args;
        let deadline = match call.number {
            libc::SYS_epoll_pwait2 => self.timespec_from(tid, timeout, 1)?,
            _ => self.millis_from(tid, low_i32(timeout)),
        };
        let most = usize::try_from(low_i32(most)).map_err(|_| Errno::EINVAL)?;
        // Such a set sees the readiness of a port only with the bytes themselves.
        self.stage.settle_all();
        let file = self.file(tid, low_i32(fd)).ok_or(Errno::EBADF)?;
        let mut events = Vec::with_capacity(most.clamp(1, 4096));
        let buffer = rustix::buffer::spare_capacity(&mut events);
        match epoll::wait(&file.fd, buffer, Some(&Timespec::default())) {
            Ok(_) => {}
            Err(errno) => return Err(Errno::from_raw(errno.raw_os_error())),
        }
        let mut signals = self.epoll_signals(tid, fd)?;
        signals.truncate(most.saturating_sub(events.len()));
        let is_time_up = deadline.is_some_and(|at| self.stage.now() >= at);
        if events.is_empty() && signals.is_empty() && !is_time_up {
            return Ok(wait_until(deadline));
        }
        let mut bytes = Vec::with_capacity(events.len() * EPOLL_EVENT);
        for event in &events {
            // These fields are copied first, because the event is a packed structure.
            let (flags, data) = (event.flags, event.data);
            bytes.extend(flags.bits().to_ne_bytes());
            bytes.extend(data.u64().to_ne_bytes());
        }
        for (flags, data) in &signals {
            bytes.extend(flags.to_ne_bytes());
            bytes.extend(data.to_ne_bytes());
        }
        Memory(Pid::from_raw(tid)).write(address, &bytes)?;
        let count = events.len() + signals.len();
        Ok(Outcome::Answer(i64::try_from(count).unwrap_or(0)))
    }

    /// The deadline of a wait of this many milliseconds; negative: none.
    fn millis_from(&self, tid: i32, millis: i32) -> Option<Instant> {
        let millis = u64::try_from(millis).ok()?;
        Some(self.entered(tid) + Duration::from_millis(millis))
    }

    /// The deadline of a wait whose length is two numbers at `address`, seconds and multiples of
    /// `unit` ns; `None` at address 0.
    pub(super) fn timespec_from(
        &self,
        tid: i32,
        address: u64,
        unit: i64,
    ) -> Result<Option<Instant>, Errno> {
        if address == 0 {
            return Ok(None);
        }
        let mut time = [0; 16];
        Memory(Pid::from_raw(tid)).read(address, &mut time)?;
        self.deadline_after(tid, time, unit).map(Some)
    }

    /// The deadline of a wait whose length is two numbers: seconds and multiples of `unit` ns.
    fn deadline_after(&self, tid: i32, time: [u8; 16], unit: i64) -> Result<Instant, Errno> {
        let [seconds, parts] = [0, 8].map(|at| {
            let mut number = [0; 8];
            number.copy_from_slice(&time[at..at + 8]);
            i64::from_ne_bytes(number)
        });
        // Microseconds may exceed a second.
        let carry = parts / (1_000_000_000 / unit);
        let parts = parts % (1_000_000_000 / unit) * unit;
        let nanos = nanos([seconds.saturating_add(carry), parts])?;
        let length = Duration::from_nanos(nanos.cast_unsigned());
        Ok(self.entered(tid) + length)
    }

    /// Writes the remaining time to memory, as the kernel does.
    fn tell_rest(
        &self,
        memory: Memory,
        address: u64,
        deadline: Option<Instant>,
        unit: i64,
    ) -> Result<(), Errno> {
        let Some(deadline) = deadline else {
            return Ok(());
        };
        memory.write(address, &self.rest_until(deadline, unit))
    }

    /// The remaining time until `deadline` as two numbers: seconds and multiples of `unit` ns.
    fn rest_until(&self, deadline: Instant, unit: i64) -> [u8; 16] {
        let left = deadline - self.stage.now();
        let [seconds, nanos] = timespec(i64::try_from(left.as_nanos()).unwrap_or(i64::MAX));
        let mut rest = [0; 16];
        rest[..8].copy_from_slice(&seconds.to_ne_bytes());
        rest[8..].copy_from_slice(&(nanos / unit).to_ne_bytes());
        rest
    }
}

/// The entries of a `poll`.
pub(super) fn entries(tid: i32, call: &Call) -> Result<Vec<u8>, Errno> {
    let [address, count, ..] = call.args;
    if count > FILES_MAX {
        return Err(Errno::EINVAL);
    }
    let mut entries = vec![0; POLLFD * usize::try_from(count).unwrap_or_default()];
    Memory(Pid::from_raw(tid)).read(address, &mut entries)?;
    Ok(entries)
}

/// The requests in the entries of a `poll`, without the answers.
fn wanted_of(entries: &[u8]) -> Vec<u8> {
    let wanted = entries.chunks_exact(POLLFD).map(|entry| &entry[..WANTED]);
    wanted.collect::<Vec<_>>().concat()
}

/// Number of files in the sets of a `select`, and the length of each set.
fn size_of_sets(count: u64) -> (usize, usize) {
    let count = low_i32(count).clamp(0, SELECTED_MAX);
    let count = usize::try_from(count).unwrap_or_default();
    (count, count.div_ceil(64) * 8)
}

/// The three sets of a `select`, and its time.
fn sets(tid: i32, call: &Call) -> Result<([Vec<u8>; 3], [u8; 16]), Errno> {
    let [count, read, write, except, timeout, _] = call.args;
    let (_, len) = size_of_sets(count);
    let mut sets = [(); 3].map(|()| vec![0_u8; len]);
    let mut time = [0; 16];
    let places = sets.iter_mut().map(Vec::as_mut_slice);
    let places = places.chain([&mut time[..]]);
    let places = [read, write, except, timeout].into_iter().zip(places);
    Memory(Pid::from_raw(tid)).read_all(places)?;
    Ok((sets, time))
}

/// The files of a `poll` or `select` in the format of the program's memory; empty for other calls.
pub(super) fn watched(tid: i32, call: &Call) -> Vec<u8> {
    let watched = match call.number {
        libc::SYS_poll | libc::SYS_ppoll => entries(tid, call).map(|it| wanted_of(&it)),
        libc::SYS_select | libc::SYS_pselect6 => sets(tid, call).map(|(sets, _)| sets.concat()),
        _ => return Vec::new(),
    };
    watched.unwrap_or_default()
}

const fn wait_until(deadline: Option<Instant>) -> Outcome {
    Outcome::Block(Wait {
        on: On::Files,
        deadline,
    })
}

/// Whether a readiness counts for one of select's sets, by the kernel's rules.
fn is_selected(kind: PollFlags, found: PollFlags) -> bool {
    let counts = match kind {
        PollFlags::IN => PollFlags::IN | PollFlags::RDNORM | PollFlags::HUP | PollFlags::ERR,
        PollFlags::OUT => PollFlags::OUT | PollFlags::WRNORM | PollFlags::ERR,
        _ => PollFlags::PRI,
    };
    found.intersects(counts)
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsRawFd as _;

    use super::*;
    use crate::guest::supervisor::tests::{Bench, MS, Told, error, fd};
    use crate::guest::tests::Room;

    /// Sets are whole words of 64 files, of 1024 at most.
    #[test]
    fn sets_of_a_select_have_whole_words() {
        let sizes = [0, 1, 64, 65, 1_024, 4_096].map(size_of_sets);
        let expected = [
            (0, 0),
            (1, 8),
            (64, 8),
            (65, 16),
            (1_024, 128),
            (1_024, 128),
        ];
        assert_eq!(sizes, expected);
        assert_eq!(size_of_sets(u64::MAX), (0, 0), "less than none");
    }

    #[test]
    fn a_poll_is_remembered_without_its_answers() {
        let entries: Vec<u8> = (0..16).collect();
        assert_eq!(
            wanted_of(&entries),
            [0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 12, 13]
        );
        assert!(wanted_of(&[]).is_empty());
    }

    /// The kernel's sets (fs/select.c): an end and an error are readable, an error is writable, and
    /// only urgent data are exceptions.
    #[test]
    fn a_select_counts_ends_and_errors() {
        let kinds = [PollFlags::IN, PollFlags::OUT, PollFlags::PRI];
        for (found, expected) in [
            (PollFlags::IN, [true, false, false]),
            (PollFlags::RDNORM, [true, false, false]),
            (PollFlags::HUP, [true, false, false]),
            (PollFlags::ERR, [true, true, false]),
            (PollFlags::OUT, [false, true, false]),
            (PollFlags::WRNORM, [false, true, false]),
            (PollFlags::PRI, [false, false, true]),
            (PollFlags::empty(), [false; 3]),
        ] {
            assert_eq!(
                kinds.map(|kind| is_selected(kind, found)),
                expected,
                "{found:?}"
            );
        }
    }

    const IN: u16 = 1;
    const OUT: u16 = 4;
    const NVAL: u16 = 0x20;

    /// The entries of a `poll`.
    fn entries_of(files: &[(i32, u16)]) -> Room {
        let entry = |&(fd, wanted): &(i32, u16)| {
            let mut entry = [0xA5; 8];
            entry[..4].copy_from_slice(&fd.to_ne_bytes());
            entry[4..6].copy_from_slice(&wanted.to_ne_bytes());
            entry
        };
        let entries: Vec<[u8; 8]> = files.iter().map(entry).collect();
        Room::of(entries.as_flattened())
    }

    /// The answers in them.
    fn answers(room: &Room) -> Vec<u16> {
        let bytes = room.bytes();
        let entries = bytes.chunks_exact(8);
        entries
            .map(|entry| u16::from_ne_bytes([entry[6], entry[7]]))
            .collect()
    }

    fn waits(until_ms: Option<u64>) -> Told {
        Told::Waits(On::Files, until_ms.map(|ms| ms * MS))
    }

    #[test]
    fn a_poll_answers_what_is_ready_or_waits() {
        let mut bench = Bench::new();
        bench.passes(10);
        let (ears, mut mouth) = std::io::pipe().expect("the system has pipes");
        let [reads, writes] = [ears.as_raw_fd(), mouth.as_raw_fd()];
        let asked = entries_of(&[(reads, IN), (-1, IN)]);
        let poll = libc::SYS_poll;
        let args = |millis: i32| [asked.at(0), 2, u64::from(millis.cast_unsigned())];
        assert_eq!(bench.calls(poll, &args(30)), waits(Some(40)));
        assert_eq!(bench.calls(poll, &args(-1)), waits(None));
        assert_eq!(answers(&asked), [0xA5A5; 2], "untouched");
        assert_eq!(bench.calls(poll, &args(0)), Told::Answer(0));
        assert_eq!(answers(&asked), [0, 0]);
        assert_eq!(bench.calls(poll, &args(30)), waits(Some(40)));
        bench.passes(30);
        assert_eq!(bench.again(), Told::Answer(0));
        std::io::Write::write_all(&mut mouth, b"x").expect("there is room");
        assert_eq!(bench.calls(poll, &args(30)), Told::Answer(1));
        assert_eq!(answers(&asked), [IN, 0]);
        let three = entries_of(&[(writes, OUT), (9_999, IN), (reads, OUT)]);
        assert_eq!(bench.calls(poll, &[three.at(0), 3, 0]), Told::Answer(2));
        assert_eq!(answers(&three), [OUT, NVAL, 0]);
        assert_eq!(
            bench.calls(poll, &[three.at(0), 4_097, 0]),
            error(Errno::EINVAL)
        );
        assert_eq!(bench.calls(poll, &[8, 1, 0]), error(Errno::EFAULT));
        // The program may change what it asked for while it waits: that does not count.
        let other = entries_of(&[(-1, IN)]);
        assert_eq!(bench.calls(poll, &[other.at(0), 1, u64::MAX]), waits(None));
        other.put(0, &reads.to_ne_bytes());
        assert_eq!(bench.again(), waits(None));
    }

    /// poll(2): ppoll has a `timespec`, and the kernel's call writes back what is left of it.
    #[test]
    fn a_ppoll_says_how_much_time_was_left() {
        let mut bench = Bench::new();
        let (ears, mut mouth) = std::io::pipe().expect("the system has pipes");
        let asked = entries_of(&[(ears.as_raw_fd(), IN)]);
        let time = Room::of_words(&[1, 30_000_000]);
        let args = [asked.at(0), 1, time.at(0), 0, 8];
        assert_eq!(bench.calls(libc::SYS_ppoll, &args), waits(Some(1_030)));
        bench.passes(20);
        std::io::Write::write_all(&mut mouth, b"x").expect("there is room");
        assert_eq!(bench.again(), Told::Answer(1));
        assert_eq!(time.words(), [1, 10_000_000]);
        assert_eq!(
            bench.calls(libc::SYS_ppoll, &[asked.at(0), 1, 0, 0, 8]),
            Told::Answer(1)
        );
        time.put(8, &1_000_000_000_u64.to_ne_bytes());
        // A time of too many nanoseconds is taken as a longer one.
        assert_eq!(bench.calls(libc::SYS_ppoll, &args), Told::Answer(1));
        assert_eq!(time.words(), [2, 0]);
        time.put(0, &u64::MAX.to_ne_bytes());
        assert_eq!(bench.calls(libc::SYS_ppoll, &args), error(Errno::EINVAL));
    }

    /// What the terminal of a port holds can be read, and output is ready unless it is stopped.
    #[test]
    fn a_port_is_ready_as_its_terminal_says() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let asked = entries_of(&[(port.as_raw_fd(), IN | OUT | 2)]);
        let only_in = entries_of(&[(port.as_raw_fd(), IN)]);
        let poll = libc::SYS_poll;
        assert_eq!(
            bench.calls(poll, &[only_in.at(0), 1, u64::MAX]),
            waits(None)
        );
        assert!(bench.thread().waits_for_ports && bench.thread().asks_port);
        assert_eq!(
            bench.calls(poll, &[asked.at(0), 1, u64::MAX]),
            Told::Answer(1)
        );
        assert_eq!(answers(&asked), [OUT]);
        bench.brings(1);
        assert_eq!(
            bench.calls(poll, &[asked.at(0), 1, u64::MAX]),
            Told::Answer(1)
        );
        assert_eq!(answers(&asked), [IN | OUT]);
        bench
            .supervisor
            .stage
            .terminal(0)
            .expect("it is there")
            .suspend(true);
        assert_eq!(
            bench.calls(poll, &[asked.at(0), 1, u64::MAX]),
            Told::Answer(1)
        );
        assert_eq!(answers(&asked), [IN]);
        let (ears, _mouth) = std::io::pipe().expect("the system has pipes");
        let both = entries_of(&[(port.as_raw_fd(), IN), (ears.as_raw_fd(), IN)]);
        assert_eq!(bench.calls(poll, &[both.at(0), 2, 0]), Told::Answer(1));
        assert!(!bench.thread().waits_for_ports && bench.thread().asks_port);
        assert_eq!(answers(&both), [IN, 0]);
        assert_eq!(bench.thread().quiet, [ears.as_raw_fd()]);
    }

    /// What a program says is heard all the time; of signals the supervisor knows; pipes of the
    /// last calls are remembered, the latest 16.
    #[test]
    fn files_of_other_kinds_are_ready_as_they_are() {
        let mut bench = Bench::new();
        let mouth = bench.mouth();
        let mask = nix::sys::signal::SigSet::empty();
        let signals = nix::sys::signalfd::SignalFd::new(&mask).expect("the system has them");
        let (ears, mut words) = std::io::pipe().expect("the system has pipes");
        std::io::Write::write_all(&mut words, b"x").expect("there is room");
        let asked = entries_of(&[
            (mouth.as_raw_fd(), IN | OUT),
            (signals.as_raw_fd(), IN),
            (ears.as_raw_fd(), IN),
        ]);
        assert_eq!(
            bench.calls(libc::SYS_poll, &[asked.at(0), 3, 0]),
            Told::Answer(2)
        );
        assert_eq!(answers(&asked), [OUT, 0, IN]);
        let pipes = [(); 17].map(|()| std::io::pipe().expect("the system has pipes"));
        let own = pipes.each_ref().map(|(ears, _)| ears.as_raw_fd());
        let asked = entries_of(&own.map(|fd| (fd, IN)));
        assert_eq!(
            bench.calls(libc::SYS_poll, &[asked.at(0), 17, 0]),
            Told::Answer(0)
        );
        assert_eq!(bench.thread().quiet, own[1..]);
        let first = entries_of(&[(own[3], IN)]);
        assert_eq!(
            bench.calls(libc::SYS_poll, &[first.at(0), 1, 0]),
            Told::Answer(0)
        );
        assert_eq!(bench.thread().quiet.last(), Some(&own[3]));
        assert_eq!(bench.thread().quiet.len(), 16);
    }

    /// select(2): three sets of bits; the answer counts all bits, and the time left is written back
    /// in microseconds, by pselect6 in nanoseconds.
    #[test]
    fn a_select_answers_with_sets() {
        let mut bench = Bench::new();
        let port = bench.opens("sonar");
        let (ears, _mouth) = std::io::pipe().expect("the system has pipes");
        let [port, ears] = [&port.as_raw_fd(), &ears.as_raw_fd()].map(|fd| fd.unsigned_abs());
        let most = u64::from(port.max(ears)) + 1;
        let words = usize::try_from(most).expect("small").div_ceil(64);
        let set = |files: &[u32]| {
            let mut set = vec![0_u64; words];
            for &fd in files {
                set[fd as usize / 64] |= 1 << (fd % 64);
            }
            set
        };
        let [reads, writes, excepts] =
            [set(&[port, ears]), set(&[port]), set(&[port])].map(|set| Room::of_words(&set));
        let time = Room::of_words(&[0, 30_000]);
        let (select, pselect) = (libc::SYS_select, libc::SYS_pselect6);
        let args = |sets: [u64; 3], time: u64| [most, sets[0], sets[1], sets[2], time, 0];
        let only_read = args([reads.at(0), 0, 0], time.at(0));
        assert_eq!(bench.calls(select, &only_read), waits(Some(30)));
        assert_eq!(
            bench.calls(select, &args([reads.at(0), 0, 0], 0)),
            waits(None)
        );
        assert_eq!(reads.words(), set(&[port, ears]), "untouched");
        let all = args([reads.at(0), writes.at(0), excepts.at(0)], time.at(0));
        assert_eq!(bench.calls(select, &all), Told::Answer(1));
        assert_eq!(
            [reads.words(), writes.words(), excepts.words()],
            [set(&[]), set(&[port]), set(&[])]
        );
        assert_eq!(time.words(), [0, 30_000]);
        bench.brings(1);
        let to_bytes = |set: Vec<u64>| {
            set.iter()
                .flat_map(|it| it.to_ne_bytes())
                .collect::<Vec<_>>()
        };
        reads.put(0, &to_bytes(set(&[port, ears])));
        assert_eq!(bench.calls(select, &all), Told::Answer(2));
        assert_eq!(
            [reads.words(), writes.words()],
            [set(&[port]), set(&[port])]
        );
        // Nothing comes until its time is up.
        let quiet = Room::of_words(&set(&[ears]));
        time.put(0, &[1_u64, 2_500_000].map(u64::to_ne_bytes).concat());
        let now = bench.now();
        let args = [most, quiet.at(0), 0, 0, time.at(0), 0];
        let until = Told::Waits(On::Files, Some(now + 3_500 * MS));
        assert_eq!(bench.calls(select, &args), until);
        quiet.put(0, &to_bytes(set(&[])));
        bench.passes(3_499);
        assert_eq!(bench.again(), until, "what it named at first counts");
        bench.passes(1);
        assert_eq!(bench.again(), Told::Answer(0));
        assert_eq!((quiet.words(), time.words()), (set(&[]), vec![0, 0]));
        let now = bench.now();
        time.put(0, &[0_u64, 7_000_000].map(u64::to_ne_bytes).concat());
        quiet.put(0, &to_bytes(set(&[ears])));
        assert_eq!(
            bench.calls(pselect, &args),
            Told::Waits(On::Files, Some(now + 7 * MS))
        );
        let closed = Room::of_words(&[0, 0, 1 << 63]);
        let args = [192, closed.at(0), 0, 0, time.at(0), 0];
        assert_eq!(bench.calls(select, &args), error(Errno::EBADF));
        // Below the number that is given no file is looked at.
        let args = [191, closed.at(0), 0, 0, time.at(0), 0];
        assert_eq!(
            bench.calls(pselect, &args),
            Told::Waits(On::Files, Some(now + 7 * MS))
        );
        time.put(0, &[u64::MAX, 0].map(u64::to_ne_bytes).concat());
        assert_eq!(bench.calls(select, &args), error(Errno::EINVAL));
    }

    /// epoll_wait(2): events of 12 bytes on this processor, at most so many as are asked for.
    #[test]
    fn a_set_of_files_answers_with_events() {
        use rustix::event::epoll::{CreateFlags, EventData, EventFlags, add, create};

        let mut bench = Bench::new();
        let set = create(CreateFlags::empty()).expect("the system has sets");
        let pipes = [(); 2].map(|()| std::io::pipe().expect("the system has pipes"));
        for (index, (ears, _)) in pipes.iter().enumerate() {
            let data = EventData::new_u64(0x0102_0304_0506_0708 + index as u64);
            add(&set, ears, data, EventFlags::IN).expect("it is new");
        }
        let room = Room::of(&[0xA5; 36]);
        let wait = libc::SYS_epoll_wait;
        let args = |most: u64, millis: u64| [fd(&set), room.at(0), most, millis];
        assert_eq!(bench.calls(wait, &args(3, 30)), waits(Some(30)));
        assert_eq!(bench.calls(wait, &args(3, u64::MAX)), waits(None));
        assert_eq!(
            bench.calls(libc::SYS_epoll_pwait, &args(3, 20)),
            waits(Some(20))
        );
        let time = Room::of_words(&[0, 5_000_000]);
        assert_eq!(
            bench.calls(libc::SYS_epoll_pwait2, &args(3, time.at(0))),
            waits(Some(5))
        );
        assert_eq!(
            bench.calls(libc::SYS_epoll_pwait2, &args(3, 0)),
            waits(None)
        );
        assert_eq!(bench.calls(wait, &args(3, 0)), Told::Answer(0));
        for (_, mouth) in &pipes {
            let mut mouth = mouth;
            std::io::Write::write_all(&mut mouth, b"x").expect("there is room");
        }
        assert_eq!(bench.calls(wait, &args(3, u64::MAX)), Told::Answer(2));
        let event = |index: u64| {
            let data = (0x0102_0304_0506_0708 + index).to_ne_bytes();
            [&1_u32.to_ne_bytes()[..], &data].concat()
        };
        let expected = [event(0), event(1), vec![0xA5; 12]].concat();
        assert_eq!(room.bytes(), expected);
        assert_eq!(bench.calls(wait, &args(1, u64::MAX)), Told::Answer(1));
        assert_eq!(bench.calls(wait, &args(u64::MAX, 0)), error(Errno::EINVAL));
        assert_eq!(
            bench.calls(wait, &[9_999, room.at(0), 1, 0]),
            error(Errno::EBADF)
        );
        let null = std::fs::File::open("/dev/null").expect("it is there");
        assert_eq!(
            bench.calls(wait, &[fd(&null), room.at(0), 1, 0]),
            error(Errno::EINVAL)
        );
    }

    #[test]
    fn the_files_of_a_call_are_named_in_memory() {
        let tid = std::process::id().cast_signed();
        let asked = entries_of(&[(3, IN), (-1, OUT)]);
        let of = |number, args: &[u64]| watched(tid, &Call::made(number, args));
        for number in [libc::SYS_poll, libc::SYS_ppoll] {
            let expected = [3, 0, 0, 0, 1, 0, 255, 255, 255, 255, 4, 0];
            assert_eq!(of(number, &[asked.at(0), 2]), expected);
        }
        let set = Room::of_words(&[5]);
        for number in [libc::SYS_select, libc::SYS_pselect6] {
            let words = [[0; 8], 5_u64.to_ne_bytes(), [0; 8]];
            assert_eq!(of(number, &[3, 0, set.at(0), 0]), words.concat());
        }
        assert!(of(libc::SYS_read, &[3, set.at(0), 8]).is_empty());
        assert!(of(libc::SYS_poll, &[8, 1]).is_empty());
    }

    /// Where the kernel holds a port's bytes, it knows the readiness, except that output may be
    /// stopped. POLLIN is 1, POLLOUT 4, POLLRDNORM 64, POLLWRNORM 256.
    #[test]
    fn the_kernel_knows_a_port_that_is_not_stopped() {
        let mut bench = Bench::new();
        let _port = bench.opens("sonar");
        let mut ready = |port, wanted, found| bench.supervisor.port_readiness(port, wanted, found);
        for found in [0, IN, OUT, IN | OUT, 1 | 4 | 64 | 256] {
            assert_eq!(ready(0, IN | OUT, found), found);
        }
        let terminal = bench.supervisor.stage.terminal(0);
        terminal.expect("it is there").suspend(true);
        let mut ready = |found| bench.supervisor.port_readiness(0, IN | OUT, found);
        assert_eq!(ready(1 | 4 | 64 | 256), 1 | 64);
        assert_eq!((ready(OUT), ready(IN)), (0, IN));
    }
}
