//! The program's view of its processor. All threads share the processor on which hilrig was
//! started, so its number differs from run to run. The program always sees the first processor.

use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;

use super::clocks::low_i32;
use super::{Memory, Supervisor};
use crate::guest::call::Call;

/// The first processor, as a bit.
pub(super) const FIRST: u64 = 1;
/// Length of a set of up to 64 processors, bytes.
const SET: usize = 8;

impl Supervisor {
    /// Handles getcpu, rseq, sched_getaffinity and sched_setaffinity.
    pub(super) fn sees_processor(&mut self, tid: i32, call: &Call) {
        let done = match call.number {
            libc::SYS_getcpu => processor_number(tid, call),
            libc::SYS_sched_getaffinity => self.tell_processors(tid, call),
            libc::SYS_sched_setaffinity => self.wants_processors(tid, call),
            // With this registration, the kernel would write the processor's number into the
            // program's memory.
            _ => Err(Errno::ENOSYS),
        };
        let answer = match done {
            // The process does not belong to the program.
            Err(Errno::ESRCH) => return,
            Err(errno) => -i64::from(errno as i32),
            Ok(answer) => answer,
        };
        let _ = call.answer(Pid::from_raw(tid), answer);
    }

    fn tell_processors(&self, tid: i32, call: &Call) -> Result<i64, Errno> {
        let [of, len, place, ..] = call.args;
        let processors = self.threads.get(&aim(tid, of)).ok_or(Errno::ESRCH)?;
        let set = processors.processors.to_ne_bytes();
        let len = usize::try_from(low_i32(len)).map_err(|_| Errno::EINVAL)?;
        if len < SET || !len.is_multiple_of(SET) {
            return Err(Errno::EINVAL);
        }
        Memory(Pid::from_raw(tid)).write(place, &set)?;
        Ok(i64::try_from(SET).unwrap_or(0))
    }

    /// Stores the requested set of processors; the thread stays on its processor.
    fn wants_processors(&mut self, tid: i32, call: &Call) -> Result<i64, Errno> {
        let [of, len, place, ..] = call.args;
        let thread = self.threads.get_mut(&aim(tid, of)).ok_or(Errno::ESRCH)?;
        let len = usize::try_from(low_i32(len)).unwrap_or(SET).min(SET);
        let mut set = [0; SET];
        Memory(Pid::from_raw(tid)).read(place, &mut set[..len])?;
        let set = u64::from_ne_bytes(set) & possible();
        if set == 0 {
            return Err(Errno::EINVAL);
        }
        thread.processors = set;
        Ok(0)
    }

    /// Gives a new thread or process the set of its creator.
    pub(super) fn inherit_processors(&mut self, from: i32, to: i32) {
        let processors = self.threads.get(&from).map(|thread| thread.processors);
        if let (Some(processors), Some(thread)) = (processors, self.threads.get_mut(&to)) {
            thread.processors = processors;
        }
    }
}

/// The thread to which a call refers; 0 is the caller.
fn aim(tid: i32, of: u64) -> i32 {
    match low_i32(of) {
        0 => tid,
        other => other,
    }
}

fn processor_number(tid: i32, call: &Call) -> Result<i64, Errno> {
    let [processor, node, ..] = call.args;
    for place in [processor, node].into_iter().filter(|&place| place != 0) {
        Memory(Pid::from_raw(tid)).write(place, &[0; 4])?;
    }
    Ok(0)
}

/// The processors of this machine, as bits; all bits if the system does not report them.
fn possible() -> u64 {
    let text = std::fs::read_to_string("/sys/devices/system/cpu/possible").unwrap_or_default();
    let last = text.trim().rsplit(['-', ',']).next();
    let last: Option<u32> = last.and_then(|last| last.parse().ok());
    last.map_or(u64::MAX, |last| u64::MAX >> (63 - last.min(63)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::Bench;
    use crate::guest::tests::Room;

    /// What a thread is answered; the kernel is told of it, which this process does not see.
    fn set_of(bench: &Bench, args: [u64; 3], number: i64) -> Result<i64, Errno> {
        let call = Call::made(number, &args);
        match number {
            libc::SYS_getcpu => processor_number(bench.tid, &call),
            _ => bench.supervisor.tell_processors(bench.tid, &call),
        }
    }

    /// getcpu(2) and sched_getaffinity(2), whose call of the system has the length of what it has
    /// written: whole words, and the first processor alone.
    #[test]
    fn a_program_sees_the_first_processor() {
        let bench = Bench::new();
        let room = Room::of(&[0xFF; 16]);
        let get = libc::SYS_sched_getaffinity;
        assert_eq!(set_of(&bench, [0, 8, room.at(0)], get), Ok(8));
        assert_eq!(room.words(), [1, u64::MAX]);
        assert_eq!(set_of(&bench, [0, 128, room.at(8)], get), Ok(8));
        assert_eq!(room.words(), [1, 1]);
        let own = u64::from(bench.tid.unsigned_abs());
        assert_eq!(set_of(&bench, [own, 8, room.at(0)], get), Ok(8));
        assert_eq!(set_of(&bench, [1, 8, room.at(0)], get), Err(Errno::ESRCH));
        for len in [0, 7, 9, 12, u64::MAX] {
            assert_eq!(
                set_of(&bench, [0, len, room.at(0)], get),
                Err(Errno::EINVAL),
                "{len}"
            );
        }
        assert_eq!(set_of(&bench, [0, 8, 8], get), Err(Errno::EFAULT));
        let room = Room::of(&[0xFF; 16]);
        let number = libc::SYS_getcpu;
        assert_eq!(set_of(&bench, [room.at(0), room.at(8), 0], number), Ok(0));
        assert_eq!(room.numbers(), [0, -1, 0, -1]);
        assert_eq!(set_of(&bench, [0, 0, 0], number), Ok(0));
        assert_eq!(set_of(&bench, [8, 0, 0], number), Err(Errno::EFAULT));
    }

    /// sched_setaffinity(2): EINVAL without any processor of the machine.
    #[test]
    fn a_program_gets_the_processors_that_it_wants() {
        let mut bench = Bench::new();
        let room = Room::of_words(&[u64::MAX, u64::MAX]);
        let wants = |bench: &mut Bench, args: [u64; 3]| {
            let call = Call::made(libc::SYS_sched_setaffinity, &args);
            let done = bench.supervisor.wants_processors(bench.tid, &call);
            done.map(|_| bench.thread().processors)
        };
        assert_eq!(wants(&mut bench, [0, 16, room.at(0)]), Ok(possible()));
        room.put(0, &[1]);
        assert_eq!(wants(&mut bench, [0, 1, room.at(0)]), Ok(1));
        room.put(0, &[0xFF]);
        assert_eq!(wants(&mut bench, [0, u64::MAX, room.at(0)]), Ok(possible()));
        room.put(0, &[0; 8]);
        assert_eq!(wants(&mut bench, [0, 8, room.at(0)]), Err(Errno::EINVAL));
        assert_eq!(wants(&mut bench, [0, 8, 8]), Err(Errno::EFAULT));
        assert_eq!(wants(&mut bench, [1, 8, room.at(0)]), Err(Errno::ESRCH));
        bench.thread().processors = 0b101;
        let tid = bench.tid;
        bench.add(1_000_001, tid, super::super::State::Running);
        let of = |bench: &Bench| bench.supervisor.threads[&1_000_001].processors;
        assert_eq!(of(&bench), 1);
        bench.supervisor.inherit_processors(tid, 1_000_001);
        assert_eq!(of(&bench), 0b101);
        bench.supervisor.inherit_processors(-7, 1_000_001);
        assert_eq!(of(&bench), 0b101);
    }

    /// As many as the system counts.
    #[test]
    fn the_processors_of_the_machine_are_bits() {
        let text = std::fs::read_to_string("/sys/devices/system/cpu/possible");
        let Ok(text) = text else { return };
        let last = text
            .trim()
            .rsplit('-')
            .next()
            .and_then(|it| it.parse::<u32>().ok());
        let count = last.expect("a list") + 1;
        assert_eq!(possible().count_ones(), count.min(64));
        assert_eq!(possible() & 1, 1);
    }
}
