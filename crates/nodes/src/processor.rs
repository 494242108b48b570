//! One processor for a rig and its node programs.
//!
//! Rig and program take turns, so a second processor gains nothing, and waking a process on another
//! one takes ten times as long as the exchange itself.

use core::cell::RefCell;
use core::marker::PhantomData;
use std::collections::BTreeMap;
use std::fs;
use std::sync::{Mutex, PoisonError};

use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

/// Processors that threads of this process are kept on, and by how many.
static KEPT: Mutex<BTreeMap<usize, u32>> = Mutex::new(BTreeMap::new());

/// Maximum number of processes of one program that are moved.
const FAMILY_MAX: usize = 64;

thread_local! {
    /// Where this thread is kept.
    static HERE: RefCell<Option<Here>> = const { RefCell::new(None) };
}

/// The processor that a thread is kept on.
#[derive(Clone)]
struct Here {
    /// Processors before that.
    before: CpuSet,
    kept: usize,
    /// Programs that share it.
    programs: u32,
}

/// Keeps this thread and one node program on one processor until it is dropped. All node programs
/// of a thread share one.
#[derive(Debug)]
pub(crate) struct SameProcessor {
    program: Option<Pid>,
    /// The thread that was moved is the one to be released.
    of_this_thread: PhantomData<*const ()>,
}

impl SameProcessor {
    /// `None`: the system refuses, or this thread may run on one processor only.
    pub(crate) fn keep(program: Option<Pid>) -> Option<Self> {
        HERE.with_borrow_mut(|here| {
            let here = match here {
                Some(here) => here,
                None => here.insert(Here::choose()?),
            };
            here.programs += 1;
            move_all(program, &only(here.kept));
            Some(Self {
                program,
                of_this_thread: PhantomData,
            })
        })
    }
}

impl Here {
    /// Moves this thread to the processor that fewest runs are on, so that the workers of a
    /// campaign keep apart.
    fn choose() -> Option<Self> {
        let before = sched_getaffinity(None).ok()?;
        if before.count() < 2 {
            return None;
        }
        let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        let now = sched_getcpu();
        let allowed = (0..CpuSet::MAX_CPU).filter(|&cpu| before.is_set(cpu));
        let kept = allowed.min_by_key(|cpu| {
            let runs = all.get(cpu).copied().unwrap_or_default();
            (runs, *cpu != now)
        })?;
        sched_setaffinity(None, &only(kept)).ok()?;
        *all.entry(kept).or_default() += 1;
        Some(Self {
            before,
            kept,
            programs: 0,
        })
    }
}

impl Drop for SameProcessor {
    fn drop(&mut self) {
        HERE.with_borrow_mut(|place| {
            let Some(here) = place else {
                return;
            };
            move_all(self.program, &here.before);
            here.programs -= 1;
            if here.programs > 0 {
                return;
            }
            let _ = sched_setaffinity(None, &here.before);
            let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(runs) = all.get_mut(&here.kept) {
                *runs = runs.saturating_sub(1);
            }
            *place = None;
        });
    }
}

fn only(cpu: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(cpu);
    set
}

/// Moves a program with the processes that it has started: a shell may stand before it. One that
/// has ended meanwhile is left out.
fn move_all(program: Option<Pid>, to: &CpuSet) {
    let mut family: Vec<Pid> = program.into_iter().collect();
    let mut next = 0;
    while let Some(&pid) = family.get(next) {
        next += 1;
        let _ = sched_setaffinity(Some(pid), to);
        let number = pid.as_raw_nonzero();
        let children = fs::read_to_string(format!("/proc/{number}/task/{number}/children"));
        let children = children.unwrap_or_default();
        let children = children.split_whitespace();
        let children = children.filter_map(|child| child.parse().ok().and_then(Pid::from_raw));
        family.extend(children.take(FAMILY_MAX.saturating_sub(family.len())));
    }
}

#[cfg(test)]
mod tests {
    use std::process::{Child, Command, Stdio};

    use super::*;

    fn allowed(pid: Option<Pid>) -> u32 {
        sched_getaffinity(pid).expect("a set").count()
    }

    /// A shell with a program behind it.
    fn program() -> (Child, Pid) {
        let mut shell = Command::new("sh");
        shell.args(["-c", "cat; exit 0"]).stdin(Stdio::piped());
        let child = shell.spawn().expect("a shell");
        let pid = i32::try_from(child.id()).ok().and_then(Pid::from_raw);
        (child, pid.expect("a number"))
    }

    /// A thread is on one processor with its programs as long as one of them is kept there. Both
    /// may run anywhere before and afterwards.
    #[test]
    fn a_thread_and_its_programs_are_kept_and_released() {
        let before = allowed(None);
        if before < 2 {
            assert!(SameProcessor::keep(None).is_none());
            return;
        }
        let [(mut one, first), (mut other, second)] = [program(), program()];
        let kept = SameProcessor::keep(Some(first)).expect("two processors");
        assert_eq!(
            [None, Some(first), Some(second)].map(allowed),
            [1, 1, before]
        );
        let also = SameProcessor::keep(Some(second)).expect("the same one");
        assert_eq!(allowed(Some(second)), 1);
        drop(kept);
        assert_eq!(
            [None, Some(first), Some(second)].map(allowed),
            [1, before, 1]
        );
        drop(also);
        assert_eq!([None, Some(second)].map(allowed), [before, before]);
        for child in [&mut one, &mut other] {
            drop(child.stdin.take());
            assert!(child.wait().expect("it ends").success());
        }
    }
}
