//! Other sources of time, processor time and random values in the system than its clocks: the
//! supervisor answers from virtual time and the run's seed, or adds a note.

use emulators::rng::Rng;
use nix::errno::Errno;
use nix::libc;
use nix::unistd::Pid;
use rustix::fs::{SeekFrom, seek, tell};
use rustix::net::sockopt;

use super::clocks::{low_i32, timespec};
use super::files::{File, Kind};
use super::streams::{buffers, lens, scatter};
use super::{Memory, Outcome, Supervisor};
use crate::guest::call::Call;
use crate::guest::links::Link;

const SECOND: i64 = 1_000_000_000;
/// Lengths of results, and the offsets of times in them.
const TIMEX: usize = 208;
const TIMEX_TIME: usize = 72;
const TIMEX_TICK: usize = 88;
const RUSAGE: usize = 144;
const SYSINFO: usize = 112;
/// Memory of the machine that the program sees: 8 GiB, half of it free.
const MEMORY: u64 = 8 << 30;

/// Files that are answered by the supervisor.
const TOLD: [&str; 5] = [
    "/proc/uptime",
    "/proc/loadavg",
    "/proc/sys/kernel/random/uuid",
    "/proc/sys/kernel/random/boot_id",
    "/proc/sys/kernel/random/entropy_avail",
];
/// Beginnings of files with data about the outside world.
const OUTSIDE: [&str; 17] = [
    "/proc/stat",
    "/proc/meminfo",
    "/proc/vmstat",
    "/proc/interrupts",
    "/proc/softirqs",
    "/proc/diskstats",
    "/proc/timer_list",
    "/proc/schedstat",
    "/proc/pressure",
    "/proc/net/",
    "/dev/rtc",
    "/dev/ptp",
    "/dev/hwrng",
    "/dev/cpu/",
    "/sys/class/rtc",
    "/sys/class/thermal",
    "/sys/class/hwmon",
];
/// Such files in the folder of a process.
const OUTSIDE_OF_PROCESS: [&str; 7] = [
    "stat",
    "status",
    "statm",
    "sched",
    "schedstat",
    "io",
    "timers",
];

/// Whether a file has data about the outside world.
fn is_outside(path: &str) -> bool {
    let of_process = path
        .strip_prefix("/proc/")
        .and_then(|rest| rest.split_once('/'));
    let is_process = |name: &str| {
        name == "self" || name == "thread-self" || name.bytes().all(|byte| byte.is_ascii_digit())
    };
    OUTSIDE.iter().any(|known| path.starts_with(known))
        || of_process.is_some_and(|(process, name)| {
            let name = name.rsplit('/').next().unwrap_or(name);
            is_process(process) && OUTSIDE_OF_PROCESS.contains(&name)
        })
}

impl Supervisor {
    /// Handles adjtimex, clock_adjtime, settimeofday, getrusage and sysinfo.
    pub(super) fn tell(&self, tid: i32, call: &Call) -> Result<Outcome, Errno> {
        let memory = Memory(Pid::from_raw(tid));
        let [first, second, ..] = call.args;
        match call.number {
            libc::SYS_adjtimex | libc::SYS_clock_adjtime => {
                let place = if call.number == libc::SYS_adjtimex {
                    first
                } else {
                    second
                };
                if memory.u32(place)? != 0 {
                    return Err(Errno::EPERM);
                }
                let mut timex = [0; TIMEX];
                let [seconds, nanos] = timespec(self.shown(libc::CLOCK_REALTIME.into()));
                let words = [
                    (TIMEX_TIME, seconds),
                    (TIMEX_TIME + 8, nanos / 1_000),
                    (TIMEX_TICK, 10_000),
                ];
                for (at, word) in words {
                    timex[at..at + 8].copy_from_slice(&word.to_ne_bytes());
                }
                memory.write(place, &timex)?;
            }
            libc::SYS_getrusage => {
                let mut usage = [0; RUSAGE];
                // These are the values that `wait4` reports for each child.
                if low_i32(first) == libc::RUSAGE_CHILDREN {
                    memory.write(second, &usage)?;
                    return Ok(Outcome::Answer(0));
                }
                let [seconds, nanos] = timespec(self.shown(libc::CLOCK_PROCESS_CPUTIME_ID.into()));
                usage[..8].copy_from_slice(&seconds.to_ne_bytes());
                usage[8..16].copy_from_slice(&(nanos / 1_000).to_ne_bytes());
                memory.write(second, &usage)?;
            }
            libc::SYS_sysinfo => {
                let mut info = [0; SYSINFO];
                let uptime = self.shown(libc::CLOCK_BOOTTIME.into()) / SECOND;
                info[..8].copy_from_slice(&uptime.to_ne_bytes());
                info[32..40].copy_from_slice(&MEMORY.to_ne_bytes());
                info[40..48].copy_from_slice(&(MEMORY / 2).to_ne_bytes());
                info[80..82].copy_from_slice(&1_u16.to_ne_bytes());
                info[104..108].copy_from_slice(&1_u32.to_ne_bytes());
                memory.write(first, &info)?;
            }
            _ => return Err(Errno::EPERM),
        }
        Ok(Outcome::Answer(0))
    }

    /// Handles the opening of a file with data about the outside world: it is answered, or a note
    /// is added.
    pub(super) fn looks_into(&mut self, path: &str) {
        if TOLD.contains(&path) {
            self.has_told_files = true;
        } else if is_outside(path) {
            self.note(format!("reads {path}"));
        }
    }

    /// Index of a file that the supervisor answers.
    pub(super) fn told_file(&self, fd: &impl std::os::fd::AsRawFd) -> Option<usize> {
        if !self.has_told_files {
            return None;
        }
        let path = std::fs::read_link(format!("/proc/self/fd/{}", fd.as_raw_fd())).ok()?;
        TOLD.iter()
            .position(|told| path == std::path::Path::new(told))
    }

    /// Reads such a file.
    pub(super) fn read_told(
        &mut self,
        tid: i32,
        call: &Call,
        file: &File,
        which: usize,
    ) -> Result<Outcome, Errno> {
        let errno = |errno: rustix::io::Errno| Errno::from_raw(errno.raw_os_error());
        if tell(&file.fd).map_err(errno)? > 0 {
            return Ok(Outcome::Answer(0));
        }
        let text = match which {
            0 => {
                let hundredths = self.shown(libc::CLOCK_BOOTTIME.into()) / (SECOND / 100);
                format!("{}.{:02} 0.00\n", hundredths / 100, hundredths % 100)
            }
            1 => "0.00 0.00 0.00 1/1 1\n".to_owned(),
            2 => uuid(&self.chance(tid, 16)),
            3 => {
                let mut random = Rng::stream(self.settings.seed, "guest.boot");
                let words = [random.next_u64(), random.next_u64()].map(u64::to_le_bytes);
                uuid(words.as_flattened())
            }
            _ => "256\n".to_owned(),
        };
        let buffers = buffers(tid, call)?;
        let len = text.len().min(lens(&buffers));
        scatter(tid, &buffers, &text.as_bytes()[..len])?;
        seek(&file.fd, SeekFrom::Start(text.len() as u64)).map_err(errno)?;
        Ok(Outcome::Answer(i64::try_from(len).unwrap_or(0)))
    }

    /// Handles readlink of a file descriptor: for a port, the result is the name that the program
    /// was given, because the number of its terminal is the system's choice.
    pub(super) fn read_link(&mut self, tid: i32, call: &Call) {
        let pid = Pid::from_raw(tid);
        let link = Link::of(pid, call);
        if let Some((device, text)) = link.unlisted_terminal() {
            if self.stage.port_of(device).is_some() {
                link.answer(pid, call, &text);
            }
            return;
        }
        let Some(fd) = link.path.strip_prefix("/proc/").and_then(|rest| {
            let (process, rest) = rest.split_once('/')?;
            let is_own =
                process == "self" || process == "thread-self" || process == tid.to_string();
            rest.strip_prefix("fd/").filter(|_| is_own)?.parse().ok()
        }) else {
            return;
        };
        let Some(Kind::Port(port)) = self.file(tid, fd).map(|file| file.kind) else {
            return;
        };
        if let Some(name) = self.stage.path_of(port) {
            link.answer(pid, call, &name);
        }
    }

    /// Handles bind and getsockname: a network port that the system chooses is random.
    pub(super) fn names_socket(&mut self, tid: i32, call: &Call) {
        let Some(file) = self.file(tid, low_i32(call.args[0])) else {
            return;
        };
        let domain = sockopt::socket_domain(&file.fd);
        if !matches!(
            domain,
            Ok(rustix::net::AddressFamily::INET | rustix::net::AddressFamily::INET6)
        ) {
            return;
        }
        let mut address = [0; 4];
        let is_bind = call.number == libc::SYS_bind;
        let asked = Memory(Pid::from_raw(tid)).read(call.args[1], &mut address);
        if is_bind && asked.is_ok() && address[2..] != [0, 0] {
            self.has_bound = true;
        } else if is_bind || !self.has_bound {
            self.note(
                "is given a free network port by the system, another one each time".to_owned(),
            );
        }
    }
}

/// Sixteen random bytes in the kernel's text format.
fn uuid(bytes: &[u8]) -> String {
    let mut hex = String::new();
    for (index, &byte) in bytes.iter().take(16).enumerate() {
        let byte = match index {
            6 => byte & 0x0F | 0x40,
            8 => byte & 0x3F | 0x80,
            _ => byte,
        };
        if matches!(index, 4 | 6 | 8 | 10) {
            hex.push('-');
        }
        hex += &format!("{byte:02x}");
    }
    hex + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guest::supervisor::tests::{Bench, Told, error, fd};
    use crate::guest::tests::Room;

    #[test]
    fn a_uuid_is_one_of_version_4() {
        assert_eq!(uuid(&[0xFF; 16]), "ffffffff-ffff-4fff-bfff-ffffffffffff\n");
        assert_eq!(uuid(&[0; 16]), "00000000-0000-4000-8000-000000000000\n");
    }

    #[test]
    fn files_of_processes_tell_of_the_world_outside() {
        for path in [
            "/proc/self/stat",
            "/proc/17/status",
            "/proc/self/task/18/stat",
            "/proc/stat",
        ] {
            assert!(is_outside(path), "{path}");
        }
        for path in [
            "/proc/self/maps",
            "/proc/sys/kernel/stat",
            "/etc/stat",
            "/proc/cpuinfo",
        ] {
            assert!(!is_outside(path), "{path}");
        }
    }

    fn put(bytes: &mut [u8], at: usize, word: &[u8]) {
        bytes[at..at + word.len()].copy_from_slice(word);
    }

    /// adjtimex(2): the calendar and a tick of 10 ms; clock_adjtime has the clock before it. In
    /// `timex` the time is at 72, the tick at 88 (linux/timex.h).
    #[test]
    fn the_calendar_is_not_adjusted() {
        let mut bench = Bench::new();
        bench.passes(1_500);
        let room = Room::of(&[0; 216]);
        let mut expected = vec![0; 216];
        put(&mut expected, 72, &1_767_225_601_i64.to_ne_bytes());
        put(&mut expected, 80, &500_000_i64.to_ne_bytes());
        put(&mut expected, 88, &10_000_i64.to_ne_bytes());
        assert_eq!(
            bench.calls(libc::SYS_adjtimex, &[room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.bytes(), expected);
        room.put(0, &[0; 216]);
        assert_eq!(
            bench.calls(libc::SYS_clock_adjtime, &[8, room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.bytes(), expected);
        room.put(0, &[1]);
        assert_eq!(
            bench.calls(libc::SYS_adjtimex, &[room.at(0)]),
            error(Errno::EPERM)
        );
        assert_eq!(
            bench.calls(libc::SYS_settimeofday, &[room.at(0)]),
            error(Errno::EPERM)
        );
    }

    /// getrusage(2): all of the time is the program's own; that of its children is not told.
    #[test]
    fn the_use_of_the_processor_is_virtual() {
        let mut bench = Bench::new();
        bench.passes(2_500);
        let room = Room::of(&[0xA5; 152]);
        let mut expected = vec![0; 152];
        expected[144..].fill(0xA5);
        let children = u64::from(libc::RUSAGE_CHILDREN.cast_unsigned());
        assert_eq!(
            bench.calls(libc::SYS_getrusage, &[children, room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.bytes(), expected);
        put(&mut expected, 0, &2_i64.to_ne_bytes());
        put(&mut expected, 8, &500_000_i64.to_ne_bytes());
        assert_eq!(
            bench.calls(libc::SYS_getrusage, &[0, room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.bytes(), expected);
    }

    /// sysinfo(2): the machine runs for 1,000 s, has 8 GiB, half of them free, and one process.
    #[test]
    fn the_machine_is_told_the_same_each_time() {
        let mut bench = Bench::new();
        bench.passes(2_500);
        let room = Room::of(&[0xA5; 120]);
        let mut expected = vec![0; 120];
        expected[112..].fill(0xA5);
        put(&mut expected, 0, &1_002_i64.to_ne_bytes());
        put(&mut expected, 32, &8_589_934_592_u64.to_ne_bytes());
        put(&mut expected, 40, &4_294_967_296_u64.to_ne_bytes());
        put(&mut expected, 80, &1_u16.to_ne_bytes());
        put(&mut expected, 104, &1_u32.to_ne_bytes());
        assert_eq!(
            bench.calls(libc::SYS_sysinfo, &[room.at(0)]),
            Told::Answer(0)
        );
        assert_eq!(room.bytes(), expected);
    }

    /// proc(5): seconds since the start, with two digits behind the point, and those of idleness.
    #[test]
    fn files_of_the_machine_are_answered() {
        let mut bench = Bench::new();
        bench.passes(2_570);
        let room = Room::new(64);
        let read = |bench: &mut Bench, path: &str| {
            bench.supervisor.looks_into(path);
            let file = std::fs::File::open(path).expect("Linux has it");
            // Tests close files without a stop.
            bench.process().files.clear();
            let args = [fd(&file), room.at(0), 64];
            let Told::Answer(len) = bench.calls(libc::SYS_read, &args) else {
                panic!("{path} waits");
            };
            assert_eq!(
                bench.calls(libc::SYS_read, &args),
                Told::Answer(0),
                "its end"
            );
            let len = usize::try_from(len).expect("no error");
            String::from_utf8_lossy(&room.bytes()[..len]).into_owned()
        };
        assert_eq!(read(&mut bench, "/proc/uptime"), "1002.57 0.00\n");
        assert_eq!(read(&mut bench, "/proc/loadavg"), "0.00 0.00 0.00 1/1 1\n");
        let (uuid, boot) = (
            "/proc/sys/kernel/random/uuid",
            "/proc/sys/kernel/random/boot_id",
        );
        let [one, other] = [(); 2].map(|()| read(&mut bench, uuid));
        assert!(
            one != other && one.len() == 37 && one.ends_with('\n'),
            "{one}{other}"
        );
        let [one, other] = [(); 2].map(|()| read(&mut bench, boot));
        assert!(one == other && one.len() == 37, "{one}{other}");
        assert_eq!(
            read(&mut bench, "/proc/sys/kernel/random/entropy_avail"),
            "256\n"
        );
        // A short read gets the first bytes.
        bench.process().files.clear();
        let file = std::fs::File::open("/proc/uptime").expect("Linux has it");
        let told = bench.calls(libc::SYS_read, &[fd(&file), room.at(0), 4]);
        assert_eq!((told, &room.bytes()[..4]), (Told::Answer(4), &b"1002"[..]));
        assert!(bench.supervisor.notes().is_empty());
        // Nothing is answered before the program has opened such a file.
        let mut bench = Bench::new();
        assert_eq!(
            bench.calls(libc::SYS_read, &[fd(&file), room.at(0), 4]),
            Told::Kernel
        );
    }

    /// bind(2): a port of the program's own choice is the same each time.
    #[test]
    fn a_port_of_the_systems_choice_is_named() {
        let udp = std::net::UdpSocket::bind("127.0.0.1:0").expect("loopback");
        let address = |port: u16| {
            let mut address = [0; 16];
            put(&mut address, 2, &port.to_be_bytes());
            Room::of(&address)
        };
        let note = ["is given a free network port by the system, another one each time"];
        let calls = |number, port, socket: u64| {
            let mut bench = Bench::new();
            let (tid, at) = (bench.tid, address(port));
            bench
                .supervisor
                .names_socket(tid, &Call::made(number, &[socket, at.at(0), 16]));
            (bench.supervisor.has_bound, bench.supervisor.notes() == note)
        };
        assert_eq!(calls(libc::SYS_bind, 1, fd(&udp)), (true, false));
        assert_eq!(calls(libc::SYS_bind, 256, fd(&udp)), (true, false));
        assert_eq!(calls(libc::SYS_bind, 0, fd(&udp)), (false, true));
        assert_eq!(calls(libc::SYS_getsockname, 1, fd(&udp)), (false, true));
        let (one, _other) = std::os::unix::net::UnixStream::pair().expect("sockets");
        assert_eq!(calls(libc::SYS_bind, 0, fd(&one)), (false, false));
        assert_eq!(calls(libc::SYS_bind, 0, 9_999), (false, false));
        let mut bench = Bench::new();
        let (tid, own, any) = (bench.tid, address(7), address(0));
        let call = |number, room: &Room| Call::made(number, &[fd(&udp), room.at(0), 16]);
        bench
            .supervisor
            .names_socket(tid, &call(libc::SYS_bind, &own));
        bench
            .supervisor
            .names_socket(tid, &call(libc::SYS_getsockname, &any));
        assert!(bench.supervisor.notes().is_empty());
        let v6 = std::net::UdpSocket::bind("[::1]:0");
        if let Ok(v6) = v6 {
            assert_eq!(calls(libc::SYS_bind, 0, fd(&v6)), (false, true));
        }
    }

    #[test]
    fn files_that_tell_of_the_world_outside_are_named() {
        let mut bench = Bench::new();
        for path in [
            "/etc/passwd",
            "/proc/uptime",
            "/proc/self/maps",
            "/dev/null",
        ] {
            bench.supervisor.looks_into(path);
        }
        assert!(bench.supervisor.notes().is_empty() && bench.supervisor.has_told_files);
        bench.supervisor.looks_into("/dev/rtc0");
        bench.supervisor.looks_into("/proc/thread-self/schedstat");
        let expected = ["reads /dev/rtc0", "reads /proc/thread-self/schedstat"];
        assert_eq!(bench.supervisor.notes(), expected);
    }
}
