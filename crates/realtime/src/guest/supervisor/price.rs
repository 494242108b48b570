//! The price of computing: a thread's computing time passes before its next call, for this thread
//! only. Other threads run meanwhile, as on other processors.

use core::time::Duration;

use super::{Flow, Next, Supervisor};
use crate::clock::processor_time;
use crate::guest::computing::Computing;
use crate::guest::programs::files_of;

impl Supervisor {
    /// Processor time of the process of `tid`, if computing is measured. One thread runs at a time,
    /// so an increase belongs to that thread.
    pub(super) fn processor_time_of(&self, tid: i32) -> Option<Duration> {
        self.computing.as_ref().filter(|it| it.measures())?;
        processor_time(self.threads.get(&tid)?.process)
    }

    /// Records the computing of a thread that has stopped. `before` is the processor time of its
    /// process when the thread continued.
    pub(super) fn has_computed(&mut self, tid: i32, before: Option<Duration>) {
        let Some((before, now)) = before.zip(self.processor_time_of(tid)) else {
            return;
        };
        let index = self.threads.get(&tid).map(|thread| thread.index);
        if let (Some(index), Some(computing)) = (index, &mut self.computing) {
            computing.used(index, now.saturating_sub(before));
        }
    }

    /// Makes the last computing free, because the thread only waited for another one in a loop
    /// without a call.
    pub(super) fn forgive_computing(&mut self, tid: i32) {
        let index = self.threads.get(&tid).map(|thread| thread.index);
        if let (Some(index), Some(computing)) = (index, &mut self.computing) {
            computing.forgive(index);
        }
    }

    /// Records the program of a process that has executed another program.
    pub(super) fn note_program(&mut self, process: i32) {
        if let Some(computing) = &mut self.computing {
            computing.runs(files_of(process));
        }
    }

    /// Lets a thread that begins a call wait until its computing before the call has passed.
    pub(super) fn charge_computing(&mut self, tid: i32) -> Option<Flow> {
        if self.stage.is_frozen {
            return None;
        }
        let thread = self.threads.get(&tid)?;
        let number = thread.call?.number;
        let charge = self.computing.as_mut()?.charge(thread.index, number);
        if charge.is_zero() {
            return None;
        }
        self.delay(tid, charge, Next::Charged);
        Some(Flow::Stays)
    }

    /// All charges of the run so far.
    pub(in crate::guest) const fn computing(&self) -> Option<&Computing> {
        self.computing.as_ref()
    }

    /// Uses the charges of an earlier run of the same program, up to its end.
    pub(in crate::guest) fn charge_again(&mut self, earlier: Computing) {
        self.computing = Some(earlier.again());
    }
}

#[cfg(test)]
mod tests {
    use nix::libc;

    use super::*;
    use crate::exec::Cpu;
    use crate::guest::call::Call;
    use crate::guest::supervisor::State;
    use crate::guest::supervisor::tests::{Bench, MS};

    /// A supervisor that charges three times the processor time.
    fn bench() -> Bench {
        let mut bench = Bench::new();
        bench.supervisor.computing = Computing::new(Cpu::Scale(3_000), None);
        bench
    }

    /// 2 ms and the free 10 us.
    const COMPUTED: Duration = Duration::from_micros(2_010);

    /// The process of this test has used some time, so this much less is before.
    fn computes(bench: &mut Bench) {
        let tid = bench.tid;
        let computing = bench.supervisor.computing.as_mut().expect("set");
        let index = bench.supervisor.threads[&tid].index;
        computing.used(index, COMPUTED);
    }

    /// By hand: 3 times 2 ms pass before the call, and once.
    #[test]
    fn computing_passes_before_the_next_call() {
        let mut bench = bench();
        let tid = bench.tid;
        bench.begins(libc::SYS_getpid, &[]);
        assert!(bench.supervisor.charge_computing(tid).is_none());
        assert!(bench.supervisor.late.is_empty());
        computes(&mut bench);
        let flow = bench.supervisor.charge_computing(tid);
        assert!(matches!(flow, Some(Flow::Stays)));
        let at = protocols::Instant::from_nanos(6 * MS);
        assert_eq!(bench.supervisor.late, [(at, tid)]);
        assert!(matches!(bench.thread().state, State::Ready(Next::Charged)));
        assert!(bench.supervisor.charge_computing(tid).is_none(), "once");
        // A run that is frozen takes no time; a thread without a call makes none.
        computes(&mut bench);
        bench.supervisor.stage.is_frozen = true;
        assert!(bench.supervisor.charge_computing(tid).is_none());
        bench.supervisor.stage.is_frozen = false;
        bench.thread().call = None;
        assert!(bench.supervisor.charge_computing(tid).is_none());
        assert!(bench.supervisor.charge_computing(-7).is_none());
        bench.thread().call = Some(Call::made(libc::SYS_getpid, &[]));
        assert!(bench.supervisor.charge_computing(tid).is_some());
        let charged = bench.supervisor.computing().expect("set").charged;
        assert_eq!(charged, Duration::from_millis(12));
        bench.supervisor.computing = None;
        assert!(bench.supervisor.charge_computing(tid).is_none());
        assert!(bench.supervisor.computing().is_none());
    }

    #[test]
    fn a_thread_that_only_waited_is_charged_nothing() {
        let mut bench = bench();
        let tid = bench.tid;
        bench.begins(libc::SYS_getpid, &[]);
        computes(&mut bench);
        bench.supervisor.forgive_computing(-7);
        bench.supervisor.forgive_computing(tid);
        assert!(bench.supervisor.charge_computing(tid).is_none());
    }

    /// The processor time of this very process is more than one nanosecond, and never less than
    /// before.
    #[test]
    fn processor_time_is_that_of_the_process() {
        let mut bench = bench();
        let tid = bench.tid;
        let used = |bench: &Bench| bench.supervisor.computing().expect("set").used;
        let time = bench.supervisor.processor_time_of(tid).expect("measured");
        assert!(time > Duration::from_nanos(1));
        assert!(bench.supervisor.processor_time_of(tid) >= Some(time));
        assert_eq!(bench.supervisor.processor_time_of(-7), None);
        bench.supervisor.has_computed(tid, None);
        assert_eq!(used(&bench), Duration::ZERO);
        // All of the time, less the free 10 us.
        bench.supervisor.has_computed(tid, Some(Duration::ZERO));
        assert!(used(&bench) + Duration::from_micros(10) >= time);
        bench.supervisor.computing = None;
        assert_eq!(bench.supervisor.processor_time_of(tid), None);
    }

    /// A recorded run measures nothing; the files that run are noted.
    #[test]
    fn a_run_charges_again_what_an_earlier_one_charged() {
        let mut bench = bench();
        let tid = bench.tid;
        bench.begins(libc::SYS_getpid, &[]);
        computes(&mut bench);
        assert!(bench.supervisor.charge_computing(tid).is_some());
        bench.supervisor.note_program(tid);
        let earlier = bench.supervisor.computing().expect("set").clone();
        let exe = std::env::current_exe().expect("it runs");
        let name = exe.file_name().expect("a file").to_string_lossy();
        let programs = earlier.spec().programs;
        assert!(
            programs.iter().any(|it| it.starts_with(&*name)),
            "{programs:?}"
        );
        let mut again = Bench::new();
        again.supervisor.charge_again(earlier);
        again.begins(libc::SYS_getpid, &[]);
        assert!(again.supervisor.charge_computing(tid).is_some());
        let charged = again.supervisor.computing().expect("set").charged;
        assert_eq!(charged, Duration::from_millis(6));
    }
}
