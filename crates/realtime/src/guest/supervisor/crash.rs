//! The place of a program at a signal such as SIGSEGV: the program's own code nearest to the fault.
//! So two crashes with one cause are recognised as one.

use nix::libc;
use nix::unistd::Pid;

use super::{Call, Memory, Supervisor};

/// Number of words of the stack that are searched for a return address in the program.
const WORDS_MAX: u64 = 1024;

impl Supervisor {
    /// Stores the place of `tid`, if `signal` reports a fault.
    pub(super) fn note_fault(&mut self, tid: i32, signal: i32) {
        let faults = [
            libc::SIGSEGV,
            libc::SIGBUS,
            libc::SIGFPE,
            libc::SIGILL,
            libc::SIGABRT,
            libc::SIGTRAP,
        ];
        if faults.contains(&signal) {
            self.fault = place(Pid::from_raw(tid));
        }
    }

    /// The place of the last fault, e.g. `robot+0x1139`.
    pub(crate) fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }
}

/// The instruction at which `tid` has stopped, or the first return address on its stack that lies
/// in the program itself: a library is seldom the cause.
fn place(tid: Pid) -> Option<String> {
    let call = Call::of(tid).ok()?;
    let exe = std::fs::read_link(format!("/proc/{tid}/exe")).ok()?;
    let maps = std::fs::read_to_string(format!("/proc/{tid}/maps")).ok()?;
    let own: Vec<Mapping> = maps
        .lines()
        .filter_map(|line| Mapping::read(line, exe.to_str()?))
        .collect();
    let find = |address: u64| own.iter().find_map(|mapping| mapping.offset(address));
    let offset = find(call.instruction()).or_else(|| {
        let words = (0..WORDS_MAX).map(|word| call.stack().wrapping_add(8 * word));
        let words = words.map_while(|at| Memory(tid).u64(at).ok());
        words.into_iter().find_map(find)
    })?;
    let name = exe.file_name()?.to_string_lossy();
    Some(format!("{name}+{offset:#x}"))
}

/// A mapping of the program's code in memory.
struct Mapping {
    from: u64,
    to: u64,
    offset: u64,
}

impl Mapping {
    /// The mapping in a line of `/proc/PID/maps`, if it is code of `exe`.
    fn read(line: &str, exe: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let (range, rights, offset) = (words.next()?, words.next()?, words.next()?);
        let path = line.find('/').map(|at| &line[at..])?;
        let (from, to) = range.split_once('-')?;
        let number = |digits| u64::from_str_radix(digits, 16).ok();
        let mapping = Self {
            from: number(from)?,
            to: number(to)?,
            offset: number(offset)?,
        };
        (path == exe && rights.contains('x')).then_some(mapping)
    }

    /// The offset of `address` in the file, if it lies in this mapping.
    fn offset(&self, address: u64) -> Option<u64> {
        let is_here = (self.from..self.to).contains(&address);
        is_here.then(|| address - self.from + self.offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_of_the_program_is_told_from_libraries_and_data() {
        let code = "55555000-55556000 r-xp 00001000 08:01 7     /srv/a/robot";
        let mapping = Mapping::read(code, "/srv/a/robot").expect("code");
        assert_eq!(mapping.offset(0x5555_5139), Some(0x1139));
        assert_eq!(mapping.offset(0x5555_6000), None);
        let library = "7f000000-7f001000 r-xp 00000000 08:01 9     /usr/lib/libc.so.6";
        assert!(Mapping::read(library, "/srv/a/robot").is_none());
        let data = "55557000-55558000 rw-p 00002000 08:01 7     /srv/a/robot";
        assert!(Mapping::read(data, "/srv/a/robot").is_none());
    }

    use crate::guest::supervisor::tests::Bench;
    use crate::guest::tests::Stopped;

    /// The instruction of the program itself, or the nearest return address of it on the stack.
    #[test]
    fn a_fault_is_named_by_the_programs_own_code() {
        let stopped = Stopped::new();
        let pid = stopped.pid;
        let exe = std::fs::read_link(format!("/proc/{pid}/exe")).expect("it runs");
        let maps = std::fs::read_to_string(format!("/proc/{pid}/maps")).expect("it runs");
        let name = exe.to_str().expect("text");
        let code = maps
            .lines()
            .find_map(|line| Mapping::read(line, name))
            .expect("it has code");
        let file = exe
            .file_name()
            .expect("a file")
            .to_string_lossy()
            .into_owned();
        stopped.change(|registers| registers.rip = code.from + 0x10);
        let expected = format!("{file}+{:#x}", code.offset + 0x10);
        assert_eq!(place(pid).as_deref(), Some(&*expected));
        // Elsewhere, with a return address as the third word of the stack.
        let stack = stopped.registers().rsp - 512;
        let words = [1, 2, code.from + 0x20, code.from + 0x30];
        for (index, word) in words.into_iter().enumerate() {
            let at = stack + 8 * index as u64;
            Memory(pid)
                .write(at, &u64::to_ne_bytes(word))
                .expect("its stack");
        }
        stopped.change(|registers| {
            registers.rip = 8;
            registers.rsp = stack;
        });
        let expected = format!("{file}+{:#x}", code.offset + 0x20);
        assert_eq!(place(pid).as_deref(), Some(&*expected));
        let mut bench = Bench::new();
        for (signal, is_fault) in [
            (11, true),
            (7, true),
            (8, true),
            (4, true),
            (6, true),
            (5, true),
            (15, false),
            (9, false),
        ] {
            bench.supervisor.fault = None;
            bench.supervisor.note_fault(pid.as_raw(), signal);
            let found = bench.supervisor.fault();
            assert_eq!(found, is_fault.then_some(&*expected), "{signal}");
        }
        assert_eq!(code.offset(code.from - 1), None);
        assert_eq!(
            code.offset(code.to - 1),
            Some(code.to - 1 - code.from + code.offset)
        );
        assert_eq!(code.offset(code.to), None);
    }
}
