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
    dir: PortDir,
    folder: PathBuf,
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
            folder,
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

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
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
