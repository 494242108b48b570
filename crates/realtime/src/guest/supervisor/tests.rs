//! A supervisor whose guest is this very process: its memory, its files, no stop.
//!
//! The kernel is not told what becomes of a call, so a test sees what it would be told.

use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use std::fs::{File, OpenOptions};
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::PathBuf;

use engine::rig::Paced as _;
use engine::scenario::Scenario;
use nix::libc;

mod programs;

use super::*;
use crate::Realtime;
use crate::clock::SimClock;
use crate::exec::{self, Ports};
use crate::guest::tests::own;
use crate::transport::PortDir;

/// "mm=700" and its line end every 100 ms; a character takes 1.0417 ms.
const RIG: &str = "
schema = 1
name = \"sonar\"
robot = \"none\"
duration = \"3s\"
device.sonar.text.baud = 9600
device.sonar.text.terminator = \"\\n\"
device.sonar.text.unknown = \"?\"
device.sonar.text.periodic = { line = \"mm=700\", period = \"100ms\" }
device.sonar.text.command = [{ request = \"ping\", reply = \"pong\" }]
";

/// Counts benches: each has a folder of its own.
static BENCHES: AtomicU32 = AtomicU32::new(0);

/// What becomes of a call.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::guest) enum Told {
    Answer(i64),
    Kernel,
    Yield(i64),
    Leaves,
    /// It waits, up to a time in nanoseconds.
    Waits(On, Option<u64>),
}

impl From<Outcome> for Told {
    fn from(outcome: Outcome) -> Self {
        match outcome {
            Outcome::Answer(result) => Self::Answer(result),
            Outcome::Kernel => Self::Kernel,
            Outcome::Yield(result) => Self::Yield(result),
            Outcome::Leave(_) => Self::Leaves,
            Outcome::Block(wait) => Self::Waits(wait.on, wait.deadline.map(Instant::as_nanos)),
        }
    }
}

/// An error as a call answers it.
pub(in crate::guest) fn error(errno: Errno) -> Told {
    Told::Answer(-i64::from(errno as i32))
}

pub(in crate::guest) const MS: u64 = 1_000_000;

/// The supervisor and its guest.
pub(in crate::guest) struct Bench {
    pub(in crate::guest) supervisor: Supervisor,
    pub(in crate::guest) tid: i32,
    pub(in crate::guest) dir: PortDir,
    pub(in crate::guest) folder: Folder,
    mouth: (std::io::PipeReader, std::io::PipeWriter),
}

/// A stage with the ports of `rig`, in a folder of its own.
pub(in crate::guest) fn staged(
    rig: &str,
) -> (
    Stage,
    PortDir,
    PathBuf,
    (std::io::PipeReader, std::io::PipeWriter),
) {
    let (scenario, source) = Scenario::from_text(rig).expect("valid");
    let name = std::thread::current()
        .name()
        .unwrap_or("main")
        .replace("::", "-");
    let folder = std::env::temp_dir().join(format!(
        "hilrig-{}-{}-{name}",
        std::process::id(),
        BENCHES.fetch_add(1, Ordering::Relaxed)
    ));
    let (mut run, seats, dir) = exec::stage(&scenario, &source, &folder).expect("a free folder");
    let mut ports = Ports::default();
    let mut realtime = Realtime::new(SimClock::default());
    for seat in seats {
        let path = seat.transport.path().canonicalize().expect("it is there");
        ports.add(&seat.end.name, path, true);
        realtime.serve(seat.end, seat.transport);
    }
    realtime.plug_in_of(0, &scenario, run.rig_of_mut(0));
    let mouth = std::io::pipe().expect("the system has pipes");
    let pipe = File::from(OwnedFd::from(mouth.1.try_clone().expect("it is open")));
    let data = pipe.metadata().expect("it is open");
    let wait = Duration::from_secs(60);
    let stage = Stage::new(run, realtime, ports, wait, (data.dev(), data.ino()));
    (stage, dir, folder, mouth)
}

impl Bench {
    pub(in crate::guest) fn new() -> Self {
        Self::of(RIG)
    }

    pub(in crate::guest) fn of(rig: &str) -> Self {
        Self::with(rig, Supervision::default())
    }

    pub(in crate::guest) fn with(rig: &str, supervision: Supervision) -> Self {
        let (stage, dir, folder, mouth) = staged(rig);
        let settings = Settings {
            seed: 1,
            supervision,
        };
        let supervisor = Supervisor::new(&[], stage, settings, None, None);
        let mut supervisor = supervisor.expect("no program");
        supervisor.add_thread(own(), own(), None);
        supervisor.queue.clear();
        let mut bench = Self {
            supervisor,
            tid: own().as_raw(),
            dir,
            folder: Folder(folder),
            mouth,
        };
        bench.thread().state = State::Running;
        bench
    }

    /// The thread of this process.
    pub(in crate::guest) fn thread(&mut self) -> &mut Thread {
        let thread = self.supervisor.threads.get_mut(&self.tid);
        thread.expect("it was added")
    }

    /// This process.
    pub(in crate::guest) fn process(&mut self) -> &mut Process {
        let process = self.supervisor.processes.get_mut(&self.tid);
        process.expect("it was added")
    }

    /// Another thread, of no process that there is.
    pub(in crate::guest) fn add(&mut self, tid: i32, process: i32, state: State) -> &mut Thread {
        let [thread, process] = [tid, process].map(Pid::from_raw);
        self.supervisor.add_thread(thread, process, None);
        self.supervisor.queue.retain(|&it| it != tid);
        let thread = self.supervisor.threads.get_mut(&tid).expect("new");
        thread.state = state;
        thread
    }

    /// Opens the port, as the guest would.
    pub(in crate::guest) fn opens(&mut self, name: &str) -> File {
        let port = OpenOptions::new()
            .read(true)
            .write(true)
            .custom_flags(libc::O_NOCTTY)
            .open(self.dir.path().join(name));
        let port = port.expect("it is published");
        self.supervisor.stage.touch();
        self.supervisor.stage.carry().expect("it stays");
        port
    }

    /// The terminal passes on each byte as it is.
    pub(in crate::guest) fn raw(&mut self) {
        let terminal = self.supervisor.stage.terminal(0).expect("it is there");
        assert!(terminal.is_transparent(), "{:?}", terminal.settings());
    }

    /// The pipe for what the guest says.
    pub(in crate::guest) fn mouth(&self) -> std::io::PipeWriter {
        self.mouth.1.try_clone().expect("it is open")
    }

    pub(in crate::guest) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// The guest begins a call.
    pub(in crate::guest) fn begins(&mut self, number: i64, args: &[u64]) -> Call {
        let call = Call::made(number, args);
        let now = self.supervisor.stage.now();
        let thread = self.thread();
        thread.call = Some(call);
        thread.entered = now;
        thread.state = State::Running;
        thread.is_at_end = false;
        thread.is_woken = false;
        thread.progress = 0;
        thread.lines_before = None;
        thread.opens = None;
        thread.watched.clear();
        call
    }

    /// The guest makes a call.
    pub(in crate::guest) fn calls(&mut self, number: i64, args: &[u64]) -> Told {
        let call = self.begins(number, args);
        self.supervisor.outcome(self.tid, &call).into()
    }

    /// The guest tries its call once more.
    pub(in crate::guest) fn again(&mut self) -> Told {
        let call = self.thread().call.expect("it has begun one");
        self.supervisor.outcome(self.tid, &call).into()
    }

    /// Time passes.
    pub(in crate::guest) fn passes(&mut self, millis: u64) {
        let length = Duration::from_millis(millis);
        self.supervisor.stage.pass(length).expect("the port stays");
    }

    pub(in crate::guest) fn now(&self) -> u64 {
        self.supervisor.stage.now().as_nanos()
    }

    /// Lets time pass until the port has brought so many bytes.
    pub(in crate::guest) fn brings(&mut self, count: usize) {
        let stage = &mut self.supervisor.stage;
        while stage.terminal(0).is_none_or(|it| it.unread() < count) {
            stage.leap(None, false).expect("the port stays");
            assert!(stage.now() < Instant::from_secs(3), "it sends each 100 ms");
        }
    }
}

/// A folder that goes with its bench.
pub(in crate::guest) struct Folder(PathBuf);

impl Folder {
    pub(in crate::guest) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The number of a file, as a call takes it.
pub(in crate::guest) fn fd(file: &impl std::os::fd::AsRawFd) -> u64 {
    file.as_raw_fd().unsigned_abs().into()
}

#[test]
fn the_bench_opens_its_port_and_hears_it() {
    let mut bench = Bench::new();
    let port = bench.opens("sonar");
    bench.brings(7);
    let room = crate::guest::tests::Room::new(16);
    let got = bench.calls(libc::SYS_read, &[fd(&port), room.at(0), 16]);
    assert_eq!(got, Told::Answer(7));
    assert_eq!(&room.bytes()[..7], b"mm=700\n");
    let _ = port.as_raw_fd();
}

fn waits_for(on: On, deadline_ms: Option<u64>) -> State {
    let deadline = deadline_ms.map(Instant::from_millis);
    State::Blocked(Wait { on, deadline })
}

/// Those whose time has come may run: by their deadline, then by the beginning of their wait.
#[test]
fn threads_whose_time_has_come_may_run_in_order() {
    let mut bench = Bench::new();
    let own = bench.tid;
    assert_eq!(bench.supervisor.next_deadline(), None);
    for (tid, deadline, at) in [
        (1_000_001, Some(30), 5),
        (1_000_002, Some(20), 9),
        (1_000_003, Some(20), 7),
        (1_000_004, Some(40), 1),
        (1_000_005, None, 2),
    ] {
        bench
            .add(tid, own, waits_for(On::Others, deadline))
            .blocked_at = at;
    }
    let at = |ms| Some(Instant::from_millis(ms));
    assert_eq!(bench.supervisor.next_deadline(), at(20));
    bench.process().alarm.at = at(15);
    assert_eq!(bench.supervisor.next_deadline(), at(15));
    bench.process().alarm.at = None;
    bench.passes(19);
    bench.supervisor.expire();
    assert!(bench.supervisor.queue.is_empty());
    bench.passes(11);
    bench.supervisor.expire();
    assert_eq!(bench.supervisor.queue, [1_000_003, 1_000_002, 1_000_001]);
    let state = bench.supervisor.threads[&1_000_002].state;
    assert!(matches!(state, State::Ready(Next::Attempt)));
    bench
        .supervisor
        .delay(1_000_005, Duration::from_millis(3), Next::Call);
    assert_eq!(bench.supervisor.next_deadline(), at(33));
}

/// Threads that wait for files try in the order of their waits, and keep it.
#[test]
fn threads_try_for_their_files_in_order() {
    let mut bench = Bench::new();
    let own = bench.tid;
    let nap = crate::guest::tests::Room::of_words(&[0, 0]);
    let tries = |bench: &mut Bench, ran: Option<i32>| {
        bench.supervisor.retry_files(ran);
        core::mem::take(&mut bench.supervisor.queue)
    };
    // A call that is done at once, and one that waits for ever.
    let done = Call::made(libc::SYS_clock_getres, &[1, 0]);
    let never = Call::made(libc::SYS_pause, &[]);
    for (tid, on, call, at) in [
        (1_000_001, On::Files, done, 5),
        (1_000_002, On::Line, done, 3),
        (1_000_003, On::Others, done, 1),
        (1_000_004, On::Queue, done, 2),
        (1_000_005, On::Files, never, 4),
    ] {
        let thread = bench.add(tid, own, waits_for(on, None));
        (thread.blocked_at, thread.call) = (at, Some(call));
    }
    assert_eq!(tries(&mut bench, None), [1_000_002, 1_000_001]);
    let thread = &bench.supervisor.threads[&1_000_005];
    assert!(
        thread.is_blocked() && thread.blocked_at == 4,
        "it keeps its place"
    );
    bench.supervisor.has_queues_changed = true;
    assert_eq!(tries(&mut bench, None), [1_000_004]);
    assert!(!bench.supervisor.has_queues_changed);
    bench
        .supervisor
        .set_state(1_000_001, waits_for(On::Files, None));
    let thread = bench.supervisor.threads.get_mut(&1_000_001).expect("added");
    thread.waits_for_ports = true;
    assert!(
        tries(&mut bench, Some(1_000_001)).is_empty(),
        "only it ran, and waits for ports"
    );
    assert_eq!(tries(&mut bench, Some(1_000_002)), [1_000_001]);
    let _ = nap;
}

#[test]
fn programs_and_processes_are_counted() {
    let mut bench = Bench::new();
    let own = bench.tid;
    assert!(bench.supervisor.have_all_ended() && bench.supervisor.is_anybody_there());
    bench.supervisor.roots.insert(own, None);
    assert!(!bench.supervisor.have_all_ended());
    assert_eq!(bench.supervisor.status(own), None);
    bench.supervisor.roots.insert(own, Some(0x300));
    assert!(bench.supervisor.have_all_ended());
    assert_eq!(
        (bench.supervisor.status(own), bench.supervisor.status(7)),
        (Some(0x300), None)
    );
    bench.add(1_000_001, 1_000_001, State::Running);
    assert_eq!(bench.supervisor.others().collect::<Vec<_>>(), [1_000_001]);
    assert!(bench.supervisor.is_launched(own));
    bench.supervisor.launchers.insert(own);
    assert!(!bench.supervisor.is_launched(own));
    bench.supervisor.note("one".to_owned());
    bench.supervisor.note("two".to_owned());
    bench.supervisor.note("one".to_owned());
    assert_eq!(bench.supervisor.notes(), ["one", "two"]);
    bench.supervisor.processes.clear();
    assert!(!bench.supervisor.is_anybody_there());
}

#[test]
fn the_calls_of_busy_threads_are_named() {
    let mut bench = Bench::new();
    let own = bench.tid;
    assert_eq!(bench.supervisor.last_calls(), "thread 0 at no call yet");
    bench.begins(libc::SYS_read, &[]);
    let outside = bench.add(1_000_001, own, State::Outside);
    outside.call = Some(Call::made(libc::SYS_read, &[]));
    outside.outside = Some(Call::made(libc::SYS_fcntl, &[]));
    let expected = "thread 0 at read, thread 1 at fcntl";
    assert_eq!(bench.supervisor.last_calls(), expected);
    for tid in [own, 1_000_001] {
        bench.supervisor.set_state(tid, waits_for(On::Others, None));
    }
    assert_eq!(bench.supervisor.last_calls(), "all threads wait");
}

/// While all threads wait, time moves to the first deadline, and a thread that waits for its line
/// tries again at each step.
#[test]
fn time_passes_while_all_threads_wait() {
    let mut bench = Bench::new();
    bench.thread().state = waits_for(On::Others, Some(4));
    bench.supervisor.let_time_pass().expect("the port stays");
    assert_eq!(
        (bench.now(), &bench.supervisor.queue),
        (4 * MS, &VecDeque::from([bench.tid]))
    );
    assert!(!bench.supervisor.is_changed);
    bench.supervisor.queue.clear();
    bench.thread().state = waits_for(On::Line, None);
    bench.supervisor.let_time_pass().expect("the port stays");
    assert!(bench.supervisor.is_changed && bench.now() == 14 * MS);
    // In a turn the first of the queue runs, and without one time passes.
    bench.thread().state = waits_for(On::Others, Some(20));
    bench.supervisor.turn().expect("the port stays");
    assert_eq!((bench.now(), bench.supervisor.ran), (20 * MS, None));
}

/// Signals of a thread come before its turn; what it did is news for others.
#[test]
fn a_turn_is_that_of_the_first_in_the_queue() {
    let mut bench = Bench::new();
    let own = bench.tid;
    bench.thread().call = Some(Call::made(libc::SYS_pause, &[]));
    bench.thread().state = State::Ready(Next::Attempt);
    bench.supervisor.queue.push_back(own);
    bench.supervisor.turn().expect("the port stays");
    assert!(bench.thread().is_blocked() && bench.thread().slice == 0);
    assert_eq!(
        (bench.supervisor.ran, bench.supervisor.is_changed),
        (Some(own), false)
    );
    assert!(
        bench.supervisor.is_signalled,
        "one may have come since it was ready"
    );
    bench.add(1_000_001, own, State::Ready(Next::Attempt));
    let other = bench.supervisor.threads.get_mut(&1_000_001).expect("added");
    other.call = Some(Call::made(libc::SYS_pause, &[]));
    bench.supervisor.queue.push_back(1_000_001);
    bench.supervisor.turn().expect("the port stays");
    assert_eq!(
        (bench.supervisor.ran, bench.supervisor.is_changed),
        (Some(1_000_001), true)
    );
    bench.supervisor.trouble = Some(GuestError::Restart);
    bench.supervisor.held_over = Some((own, Next::Attempt));
    assert!(matches!(bench.supervisor.turn(), Err(GuestError::Restart)));
    assert!(bench.supervisor.trouble.is_none());
}

impl Bench {
    /// The thread of this process waits for ever.
    pub(in crate::guest) fn waits(&mut self) {
        self.thread().state = waits_for(On::Others, None);
    }
}

impl Supervisor {
    /// This launcher has not become its program yet.
    pub(in crate::guest) fn launches(&mut self, root: i32) {
        self.launchers.insert(root);
    }
}

/// A program has ended with this status of the system.
pub(in crate::guest) fn ends_with(supervisor: &mut Supervisor, root: i32, status: i32) {
    supervisor.roots.insert(root, Some(status));
}

/// A further thread of the debugged process.
pub(in crate::guest) const OTHER: i32 = 1_000_002;

/// A debugger is there for the process `pid`, which stands and has one more thread.
pub(in crate::guest) fn debugs(bench: &mut Bench, pid: i32) {
    bench.add(pid, pid, State::Running);
    bench.add(OTHER, pid, State::Running);
    bench.supervisor.begin_debugging(Wanted::Nothing);
    let debugging = bench.supervisor.debugging.as_mut();
    debugging.expect("begun").process = Some(pid);
}

pub(in crate::guest) fn is_ready(supervisor: &mut Supervisor, tid: i32) {
    supervisor.set_state(tid, State::Ready(Next::Go(None)));
}

/// The step that a debugger wants.
pub(in crate::guest) fn step_of(supervisor: &Supervisor) -> Option<(i32, core::ops::Range<u64>)> {
    let step = supervisor.debugging.as_ref()?.step.as_ref()?;
    Some((step.tid, step.within.clone()))
}

/// The debugger holds this thread; it goes on first.
pub(in crate::guest) fn holds(supervisor: &mut Supervisor, tid: i32) {
    let debugging = supervisor.debugging.as_mut().expect("begun");
    debugging.held = Some((tid, Next::Go(None)));
}

/// The debugger holds no thread any more.
pub(in crate::guest) fn lets_go(supervisor: &mut Supervisor) {
    supervisor.debugging.as_mut().expect("begun").held = None;
}

/// The launcher `root` takes the place of the process of this test.
pub(in crate::guest) fn adopts(bench: &mut Bench, root: Pid) {
    let supervisor = &mut bench.supervisor;
    supervisor.threads.clear();
    supervisor.processes.clear();
    supervisor.queue.clear();
    supervisor.born = [0; 2];
    supervisor.roots.insert(root.as_raw(), None);
    supervisor.launchers.insert(root.as_raw());
    supervisor.add_thread(root, root, None);
}

/// Whether the first thread of this process waits for a signal.
pub(in crate::guest) fn pauses(supervisor: &Supervisor, process: Pid) -> bool {
    let thread = supervisor.threads.get(&process.as_raw());
    let call = thread.filter(|it| it.is_blocked()).and_then(|it| it.call);
    call.is_some_and(|call| call.number == libc::SYS_pause)
}
