//! One processor for a rig and its node programs.
//!
//! Rig and program alternate, so a second processor gains nothing. Waking a process on another
//! processor takes ten times as long as the exchange itself.

use std::collections::BTreeMap;
use std::fs;
use std::sync::{Mutex, PoisonError};

use rustix::process::Pid;
use rustix::thread::{CpuSet, gettid, sched_getaffinity, sched_getcpu, sched_setaffinity};

/// Maximum number of moved processes of one program.
const FAMILY_MAX: usize = 64;

/// Threads of this process that are bound to one processor, by thread id.
static KEPT: Mutex<BTreeMap<i32, Here>> = Mutex::new(BTreeMap::new());

/// The binding of a thread.
struct Here {
    /// The processors allowed before.
    before: CpuSet,
    kept: usize,
    /// Number of programs that share the processor.
    programs: u32,
}

/// Binds the current thread and one node program to one processor until it is dropped, by any
/// thread. All node programs of a thread share one processor.
#[derive(Debug)]
pub(crate) struct SameProcessor {
    program: Option<Pid>,
    thread: Pid,
}

impl SameProcessor {
    /// `None` if the system refuses, or if this thread may run on one processor only.
    pub(crate) fn keep(program: Option<Pid>) -> Option<Self> {
        let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        let thread = gettid();
        let number = thread.as_raw_nonzero().get();
        if !all.contains_key(&number) {
            let here = Here::choose(&all)?;
            all.insert(number, here);
        }
        let here = all.get_mut(&number)?;
        here.programs += 1;
        move_all(program, &only(here.kept));
        Some(Self { program, thread })
    }
}

impl Here {
    /// Moves this thread to the processor with the fewest bound threads, so that the workers of a
    /// campaign are separate.
    fn choose(all: &BTreeMap<i32, Self>) -> Option<Self> {
        let before = sched_getaffinity(None).ok()?;
        if before.count() < 2 {
            return None;
        }
        let now = sched_getcpu();
        let allowed = (0..CpuSet::MAX_CPU).filter(|&cpu| before.is_set(cpu));
        let kept = allowed.min_by_key(|cpu| {
            let others = all.values().filter(|here| here.kept == *cpu).count();
            (others, *cpu != now)
        })?;
        sched_setaffinity(None, &only(kept)).ok()?;
        Some(Self {
            before,
            kept,
            programs: 0,
        })
    }
}

impl Drop for SameProcessor {
    fn drop(&mut self) {
        let mut all = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        let number = self.thread.as_raw_nonzero().get();
        let Some(here) = all.get_mut(&number) else {
            return;
        };
        move_all(self.program, &here.before);
        here.programs -= 1;
        if here.programs == 0 {
            let _ = sched_setaffinity(Some(self.thread), &here.before);
            all.remove(&number);
        }
    }
}

fn only(cpu: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(cpu);
    set
}

/// Moves all threads of a program and of its children, because a shell may be the parent and the
/// program may answer in another thread than its first. Processes that have ended are ignored.
fn move_all(program: Option<Pid>, to: &CpuSet) {
    let mut family: Vec<Pid> = program.into_iter().collect();
    let mut next = 0;
    while let Some(&pid) = family.get(next) {
        next += 1;
        for thread in threads(pid) {
            let _ = sched_setaffinity(Some(thread), to);
            let (process, thread) = (pid.as_raw_nonzero(), thread.as_raw_nonzero());
            let children = fs::read_to_string(format!("/proc/{process}/task/{thread}/children"));
            let children = children.unwrap_or_default();
            let children = children.split_whitespace().filter_map(number);
            family.extend(children.take(FAMILY_MAX.saturating_sub(family.len())));
        }
    }
}

/// Threads of a process.
fn threads(process: Pid) -> Vec<Pid> {
    let tasks = fs::read_dir(format!("/proc/{}/task", process.as_raw_nonzero()));
    let names = tasks.into_iter().flatten().flatten();
    names
        .filter_map(|task| number(task.file_name().to_str()?))
        .collect()
}

fn number(word: &str) -> Option<Pid> {
    word.parse().ok().and_then(Pid::from_raw)
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead as _, BufReader};
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

    /// A thread other than the program's first moves as well: QEMU computes in one.
    #[test]
    fn all_threads_of_a_program_move() {
        if allowed(None) < 2 {
            return;
        }
        let mut shell = Command::new("python3");
        let waits = "import sys, threading; t = threading.Thread(target=sys.stdin.read); t.start(); \
                     print(t.native_id, flush=True)";
        shell.args(["-c", waits]);
        shell.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = shell.spawn().expect("Python");
        let mut line = String::new();
        let output = child.stdout.take().expect("a pipe");
        BufReader::new(output).read_line(&mut line).expect("a line");
        let thread = number(line.trim());
        let kept = SameProcessor::keep(number(&child.id().to_string())).expect("two processors");
        assert_eq!(allowed(thread), 1);
        drop(kept);
        assert_eq!(allowed(thread), allowed(None));
        drop(child.stdin.take());
        assert!(child.wait().expect("it ends").success());
    }

    /// A thread shares one processor with its programs while one of them is bound. Before and
    /// afterwards both may run on any processor.
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
