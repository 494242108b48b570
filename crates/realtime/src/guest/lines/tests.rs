//! A rig that answers from a list, and a client in this process.

use rustix::pty::{OpenptFlags, ioctl_tiocgptpeer, openpt, unlockpt};
use std::os::fd::OwnedFd;

use super::super::settings::{TCGETS2, TCSETS2};
use super::*;
use crate::guest::tests::program::{DATA, ZEROS, call, exit, if_zero, keeps, rests};
use crate::guest::tests::{Room, own, program};
use nix::errno::Errno;
use std::os::fd::AsRawFd as _;

/// A tracer whose rig answers with these lines, and what it hears.
fn tracer(answers: &str) -> (Tracer, BufReader<UnixStream>) {
    let (near, mut far) = UnixStream::pair().expect("sockets");
    far.write_all(answers.as_bytes()).expect("room");
    let tracer = Tracer {
        rig: Some(Rig(BufReader::new(near))),
        ports: BTreeMap::from([(7, "sonar".to_owned())]),
        dir: PathBuf::from("/nowhere"),
        settings: BTreeMap::new(),
        serial_flags: BTreeMap::new(),
        waiting: 0,
        lines: BTreeMap::new(),
        known: BTreeSet::new(),
        waiters: BTreeMap::new(),
        halted: BTreeSet::new(),
        fatal: BTreeMap::new(),
        ended: VecDeque::new(),
    };
    (tracer, BufReader::new(far))
}

fn heard(far: &mut BufReader<UnixStream>) -> Value {
    let mut line = String::new();
    far.read_line(&mut line).expect("it was sent");
    serde_json::from_str(&line).expect("JSON")
}

const OK: &str = "{\"ok\":true}\n";

/// As a shell has it: the code, or 128 and the signal (wait(2)).
#[test]
fn an_end_is_a_code() {
    for (status, code) in [
        (0, 0),
        (0x300, 3),
        (0xFF00, 255),
        (9, 137),
        (0x8B, 139),
        (15, 143),
    ] {
        assert_eq!(code_of(status), code, "{status:x}");
    }
    // Clients' sides of pseudo-terminals have the numbers 136 to 143.
    for (major, expected) in [
        (135, false),
        (136, true),
        (143, true),
        (144, false),
        (4, false),
    ] {
        assert_eq!(
            is_pseudo_terminal(rustix::fs::makedev(major, 3)),
            expected,
            "{major}"
        );
    }
}

#[test]
fn the_devices_of_a_folder_are_its_ports() {
    let folder = std::env::temp_dir().join(format!("hilrig-ports-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a free name");
    std::os::unix::fs::symlink("/dev/null", folder.join("null")).expect("ours");
    std::fs::write(folder.join("note"), "").expect("ours");
    let device = std::fs::metadata("/dev/null").expect("it is there").rdev();
    let ports = ports_in(&folder).expect("it is there");
    assert_eq!(ports, BTreeMap::from([(device, "null".to_owned())]));
    std::fs::remove_dir_all(&folder).expect("ours");
    assert!(ports_in(&folder).is_err());
}

/// TIOCMGET: DTR 2, RTS 4, CTS 0x20, DCD 0x40, RI 0x80, DSR 0x100 (ioctl_tty(2)).
#[test]
fn lines_are_told_by_the_rig() {
    let answer = |keys: &str| format!("{{\"ok\":true,{keys}}}\n");
    let answers = [
        answer("\"dtr\":true,\"cts\":false,\"waiting\":9"),
        answer("\"rts\":true,\"ri\":true"),
        answer("\"cts\":true,\"dcd\":true,\"dsr\":true"),
    ];
    let (mut tracer, mut far) = tracer(&answers.concat());
    assert_eq!(
        (tracer.ask("sonar", &json!({"a": 1})), tracer.waiting),
        (2, 9)
    );
    assert_eq!(heard(&mut far), json!({"a": 1}));
    assert_eq!(
        (tracer.ask("sonar", &json!({})), tracer.waiting),
        (4 | 0x80, 0)
    );
    assert_eq!(tracer.ask("base", &json!({})), 0x20 | 0x40 | 0x100);
    tracer.waiting = 5;
    drop(far);
    // The rig has ended: lines are as they were, and nothing is waited for.
    assert_eq!(
        (tracer.ask("sonar", &json!({})), tracer.waiting),
        (4 | 0x80, 0)
    );
    assert!(tracer.rig.is_none());
    assert_eq!(tracer.ask("base", &json!({})), 0x160);
    assert_eq!(tracer.ask("other", &json!({})), 0);
}

/// What the rig is asked for each request, and what the program gets.
#[test]
fn requests_about_lines_are_wishes() {
    let lines = "{\"ok\":true,\"dtr\":true,\"cts\":true}\n";
    let room = Room::of(&6_u32.to_ne_bytes());
    let change = |request, argument: u64| {
        let (mut tracer, mut far) = tracer(lines);
        let done = tracer.change(Memory(own()), "sonar", request, argument);
        drop(tracer);
        let mut line = String::new();
        if far.read_line(&mut line).is_err() {
            // It was told once that its answer was not read.
            far.read_line(&mut line).expect("told once");
        }
        (
            done,
            serde_json::from_str::<Value>(&line).unwrap_or_default(),
        )
    };
    let wish = |dtr: Option<bool>, rts: Option<bool>| -> Value {
        json!({"do": "modem", "port": "sonar", "dtr": dtr, "rts": rts})
    };
    let at = room.at(0);
    for (request, word, expected) in [
        (libc::TIOCMBIS, 6_u32, wish(Some(true), Some(true))),
        (libc::TIOCMBIS, 2, wish(Some(true), None)),
        (libc::TIOCMBIC, 4, wish(None, Some(false))),
        (libc::TIOCMBIC, 0x20, wish(None, None)),
        (libc::TIOCMSET, 2, wish(Some(true), Some(false))),
        (libc::TIOCMSET, 0, wish(Some(false), Some(false))),
    ] {
        room.put(0, &word.to_ne_bytes());
        assert_eq!(
            change(request, at),
            (Some(Ok(())), expected),
            "{request:x} {word}"
        );
        assert_eq!(room.numbers()[0].cast_unsigned(), word, "untouched");
        assert_eq!(change(request, 8), (Some(Err(Errno::EFAULT)), Value::Null));
    }
    let asks = json!({"do": "modem", "port": "sonar"});
    assert_eq!(change(libc::TIOCMGET, at), (Some(Ok(())), asks.clone()));
    assert_eq!(room.numbers(), [0x22]);
    assert_eq!(change(libc::TIOCMGET, 8), (Some(Err(Errno::EFAULT)), asks));
    let breaks = json!({"do": "modem", "port": "sonar", "break": true});
    for request in [libc::TIOCSBRK, libc::TCSBRK, libc::TCSBRKP] {
        assert_eq!(
            change(request, 0),
            (Some(Ok(())), breaks.clone()),
            "{request:x}"
        );
    }
    assert_eq!(change(libc::TIOCCBRK, 0), (Some(Ok(())), Value::Null));
    let counts = Room::of(&[0xFF; 88]);
    assert_eq!(
        change(launch::TIOCGICOUNT, counts.at(0)),
        (Some(Ok(())), Value::Null)
    );
    assert_eq!(counts.bytes(), [vec![0; 80], vec![0xFF; 8]].concat());
}

/// A pseudo-terminal: its other end and its client's.
fn terminal() -> [OwnedFd; 2] {
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY;
    let rig = openpt(flags).expect("Linux has some");
    unlockpt(&rig).expect("it is new");
    let client = ioctl_tiocgptpeer(&rig, flags).expect("it is new");
    [rig, client]
}

fn about(tracer: &mut Tracer, file: &OwnedFd, request: u64, argument: u64) -> Done {
    let call = Call::made(libc::SYS_ioctl, &[3, request, argument]);
    tracer.about_terminal(own(), &call, (7, "sonar"), file)
}

/// What the kernel of a pseudo-terminal drops is kept here: parity and seven bits, 0o400 and 0o40.
#[test]
fn settings_are_kept_and_told_to_the_rig() {
    let [_rig, client] = terminal();
    let (mut tracer, mut far) = tracer(&OK.repeat(9));
    let room = Room::new(44);
    let read = |tracer: &mut Tracer| about(tracer, &client, TCGETS2, room.at(0));
    assert!(
        matches!(read(&mut tracer), Done::ByKernel),
        "nothing is special yet"
    );
    let mut words = [0_u32; 11];
    [words[0], words[2]] = [0o20, 0o10_640];
    [words[9], words[10]] = [250_000; 2];
    room.put(0, &words.map(u32::to_ne_bytes).concat());
    assert!(matches!(
        about(&mut tracer, &client, TCSETS2, room.at(0)),
        Done::With(0)
    ));
    let told = heard(&mut far);
    assert_eq!(
        told,
        json!({"do": "modem", "port": "sonar", "modes": [0o20, 0o10_640]})
    );
    room.put(0, &[0; 44]);
    assert!(matches!(read(&mut tracer), Done::With(0)));
    let modes = |room: &Room| room.numbers()[2].cast_unsigned() & 0o10_660;
    assert_eq!(
        (room.numbers()[0], modes(&room), room.numbers()[9]),
        (0o20, 0o10_640, 250_000)
    );
    assert!(matches!(
        about(&mut tracer, &client, libc::TCGETS, 8),
        Done::With(-14)
    ));
    assert!(matches!(
        about(&mut tracer, &client, libc::TCSETS, 8),
        Done::With(-14)
    ));
    // TCSETSW waits until all has left, and does it then.
    let (mut tracer, _far) = self::tracer("{\"waiting\":3}\n{\"waiting\":0}\n{}\n");
    assert!(matches!(
        about(&mut tracer, &client, libc::TCSETSW, room.at(0)),
        Done::Later
    ));
    assert!(tracer.settings.is_empty());
    assert!(matches!(
        about(&mut tracer, &client, libc::TCSETSW, room.at(0)),
        Done::With(0)
    ));
    assert_eq!(tracer.settings.len(), 1);
    let null = OwnedFd::from(std::fs::File::open("/dev/null").expect("it is there"));
    let told = about(&mut tracer, &null, libc::TCSETS, room.at(0));
    assert!(matches!(told, Done::With(-25)), "ENOTTY: no terminal");
}

#[test]
fn the_queues_of_a_line_are_the_rigs() {
    let [_rig, client] = terminal();
    let answers = "{\"waiting\":300}\n{\"waiting\":2}\n{\"waiting\":0}\n{}\n{}\n";
    let (mut tracer, mut far) = tracer(answers);
    let room = Room::new(4);
    let done = about(&mut tracer, &client, libc::TIOCOUTQ, room.at(0));
    assert!(matches!(done, Done::With(0)) && room.numbers() == [300]);
    let plain = json!({"do": "modem", "port": "sonar"});
    assert_eq!(heard(&mut far), plain);
    assert!(matches!(
        about(&mut tracer, &client, libc::TCSBRK, 1),
        Done::Later
    ));
    assert!(matches!(
        about(&mut tracer, &client, libc::TCSBRK, 1),
        Done::With(0)
    ));
    assert_eq!([heard(&mut far), heard(&mut far)], [plain.clone(), plain]);
    // tcflush(3): 0 is the input, which the kernel has; 1 the output, 2 both.
    let discards = json!({"do": "modem", "port": "sonar", "discard": true});
    for which in [1, 2] {
        assert!(matches!(
            about(&mut tracer, &client, libc::TCFLSH, which),
            Done::ByKernel
        ));
        assert_eq!(heard(&mut far), discards, "{which}");
    }
    for which in [0, 9, u64::MAX] {
        assert!(matches!(
            about(&mut tracer, &client, libc::TCFLSH, which),
            Done::ByKernel
        ));
    }
    drop(tracer);
    let mut rest = String::new();
    far.read_line(&mut rest).expect("open");
    assert!(rest.is_empty(), "{rest}");
    let (mut tracer, _far) = self::tracer("");
    let room = Room::of(&[0xFF; 72]);
    room.put(16, &0x2000_u32.to_ne_bytes());
    let done = about(&mut tracer, &client, launch::TIOCSSERIAL, room.at(0));
    assert!(matches!(done, Done::With(0)));
    assert_eq!(tracer.serial_flags, BTreeMap::from([(7, 0x2000)]));
    let done = about(&mut tracer, &client, launch::TIOCGSERIAL, room.at(0));
    assert!(matches!(done, Done::With(0)) && room.numbers()[4] == 0x2000 && room.numbers()[0] == 0);
}

/// poll(2): POLLHUP at a terminal whose other end is gone.
#[test]
fn a_port_hangs_up_with_its_other_end() {
    let [rig, client] = terminal();
    assert!(!terminals::is_hung_up(&client));
    let copy = terminals::copy_of(
        own(),
        std::os::fd::AsRawFd::as_raw_fd(&client)
            .unsigned_abs()
            .into(),
    );
    assert!(copy.is_some_and(|copy| !terminals::is_hung_up(&copy)));
    drop(rig);
    assert!(terminals::is_hung_up(&client));
    assert!(terminals::copy_of(own(), 9_999).is_none());
    assert!(terminals::copy_of(Pid::from_raw(-1), 0).is_none());
    for (request, argument, expected) in [
        (libc::TIOCOUTQ, 0, true),
        (libc::TCFLSH, 0, true),
        (launch::TIOCGSERIAL, 0, true),
        (launch::TIOCSSERIAL, 0, true),
        (libc::TCGETS, 0, true),
        (libc::TCSBRK, 1, true),
        (libc::TCSBRK, 0, false),
        (libc::TIOCMGET, 1, false),
    ] {
        assert_eq!(
            terminals::is_one(request, argument),
            expected,
            "{request:x}"
        );
    }
    assert_eq!(terminals::code(Ok(())), 0);
    assert_eq!(terminals::code(Err(Errno::EIO)), -5);
}

/// A file of a process that is a port of the rig, or a terminal whose plug was out.
#[test]
fn a_port_is_found_behind_a_file() {
    let (mut tracer, _far) = tracer("");
    let [_rig, client] = terminal();
    let fd = std::os::fd::AsRawFd::as_raw_fd(&client)
        .unsigned_abs()
        .into();
    assert_eq!(tracer.port_at(own(), fd), None);
    assert!(tracer.ports.is_empty(), "they are looked for anew");
    let null = std::fs::File::open("/dev/null").expect("it is there");
    let device = null.metadata().expect("open").rdev();
    tracer.ports.insert(device, "null".to_owned());
    let fd = std::os::fd::AsRawFd::as_raw_fd(&null).unsigned_abs().into();
    assert_eq!(tracer.port_at(own(), fd), Some((device, "null".to_owned())));
    assert_eq!(tracer.port_at(own(), 9_999), None);
    let zero = std::fs::File::open("/dev/zero").expect("it is there");
    let fd = std::os::fd::AsRawFd::as_raw_fd(&zero).unsigned_abs().into();
    assert_eq!(tracer.port_at(own(), fd), None);
    assert!(!tracer.ports.is_empty(), "no terminal");
}

/// Follows a program with these data and this code, whose port is the other end of a terminal. The
/// rig answers with these lines, and has ended then. The system's status, and what the rig heard.
fn follows(data: &[u8], code: &[&[u8]], answers: &[&str]) -> (i32, Vec<Value>) {
    let [_master, slave] = terminal();
    let device = rustix::fs::fstat(&slave).expect("open").st_rdev;
    let path = std::fs::read_link(format!("/proc/self/fd/{}", slave.as_raw_fd()));
    let path = path.expect("it has a name");
    let mut all = data.to_vec();
    all.resize(64, 0);
    all.extend(path.as_os_str().as_encoded_bytes());
    let folder =
        std::env::temp_dir().join(format!("hilrig-follows-{}-{device}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a free name");
    let [_, filter] = launch::filters();
    let process = program::becomes(&folder, &filter, &all, &code.concat());
    // A launcher stops before it becomes its program.
    process.change(|registers| registers.rip -= 1);
    ptrace::cont(process.pid, None).expect("it stands");
    let (mut tracer, far) = tracer(&answers.concat());
    tracer.ports = BTreeMap::from([(device, "sonar".to_owned())]);
    far.get_ref()
        .shutdown(std::net::Shutdown::Write)
        .expect("open");
    let status = tracer.follow(process.pid.as_raw()).expect("it is traced");
    core::mem::forget(process);
    drop(tracer);
    std::fs::remove_dir_all(&folder).expect("ours");
    let lines = far.lines().map_while(Result::ok);
    let heard = lines.map(|line| serde_json::from_str(&line).expect("JSON"));
    (status, heard.collect())
}

/// The code of a program's end is the number at `place`.
fn ends_with(place: u32) -> Vec<u8> {
    let mut code = vec![0x8B, 0x3C, 0x25];
    code.extend(place.to_le_bytes());
    code.extend(call(libc::SYS_exit_group, &[]));
    code
}

/// `mov edi, [ZEROS]`, and a request to the port that is open there.
fn requests(request: u32, argument: u32) -> Vec<u8> {
    let mut code = vec![0x8B, 0x3C, 0x25];
    code.extend(ZEROS.to_le_bytes());
    code.push(0xBE);
    code.extend(request.to_le_bytes());
    code.push(0xBA);
    code.extend(argument.to_le_bytes());
    code.extend(call(libc::SYS_ioctl, &[]));
    code.extend(keeps(ZEROS + 8));
    code
}

/// O_RDWR and O_NOCTTY.
fn opens() -> Vec<u8> {
    [call(libc::SYS_open, &[DATA + 64, 0o402, 0]), keeps(ZEROS)].concat()
}

/// wait(2): a code is in the second byte, a signal in the first one. SIGILL is 4 (`ud2`, 0F 0B); a
/// signal above 31 is passed on as it is.
#[test]
fn a_program_is_followed_to_its_end() {
    assert_eq!(follows(&[], &[&exit(3)], &[]).0, 0x300);
    assert_eq!(follows(&[], &[&[0x0F, 0x0B]], &[]).0, 4);
    // `mov edi, eax; mov esi, 35; mov eax, 62; syscall`: kill(itself, 35).
    let kills = [0x89, 0xC7, 0xBE, 35, 0, 0, 0, 0xB8, 62, 0, 0, 0, 0x0F, 0x05];
    let own = call(libc::SYS_getpid, &[]);
    assert_eq!(follows(&[], &[&own, &kills, &exit(1)], &[]).0, 35);
    // A child that ends with 7, and SIGCHLD, which does nothing.
    let waits = [
        call(libc::SYS_fork, &[]),
        if_zero(&exit(7)),
        call(libc::SYS_wait4, &[u32::MAX, ZEROS, 0, 0]),
        ends_with(ZEROS + 1),
    ];
    assert_eq!(follows(&[], &[&waits.concat()], &[]).0, 0x700);
}

/// TIOCMGET is 0x5415; DTR is 2, CTS 0x20 (ioctl_tty(2)).
#[test]
fn a_program_reads_the_lines_of_its_port() {
    let lines = "{\"ok\":true,\"dtr\":true,\"cts\":true}\n";
    let code = [opens(), requests(0x5415, ZEROS + 16), ends_with(ZEROS + 16)];
    let (status, heard) = follows(&[], &[&code.concat()], &[lines]);
    assert_eq!(status, 0x2200);
    assert_eq!(heard, [json!({"do": "modem", "port": "sonar"})]);
    // Another file is a matter of the kernel: ENOTTY is 25, as the low byte of its negative.
    let code = [
        call(libc::SYS_memfd_create, &[DATA, 0]),
        keeps(ZEROS),
        requests(0x5415, ZEROS + 16),
        ends_with(ZEROS + 8),
    ];
    let (status, heard) = follows(&[], &[&code.concat()], &[lines]);
    assert_eq!((status, heard), (0xE700, Vec::new()));
}

/// TIOCMIWAIT is 0x545C: a change of CTS, which comes with the fourth answer. Without a rig it is
/// an error: EIO is 5.
#[test]
fn a_program_waits_for_a_line_of_its_port() {
    let low = "{\"ok\":true,\"cts\":false}\n";
    let high = "{\"ok\":true,\"cts\":true}\n";
    let code = [opens(), requests(0x545C, 0x20), ends_with(ZEROS + 8)];
    let code = code.concat();
    let (status, heard) = follows(&[], &[&code], &[low, low, low, high]);
    assert_eq!(status, 0);
    assert_eq!(heard, vec![json!({"do": "modem", "port": "sonar"}); 4]);
    let (status, _) = follows(&[], &[&code], &[low, low]);
    assert_eq!(status, 0xFB00);
    // Another line.
    let dcd = "{\"ok\":true,\"dcd\":true}\n";
    let (status, heard) = follows(&[], &[&code], &[low, dcd, dcd, high]);
    assert_eq!((status, heard.len()), (0, 4));
}

/// Children and threads are followed as well: each asks for the lines of its port and ends with the
/// low byte of the answer, DTR (2) and CTS (0x20).
#[test]
fn children_and_threads_are_followed() {
    let lines = "{\"ok\":true,\"dtr\":true,\"cts\":true}\n";
    let asks = [requests(0x5415, ZEROS + 16), ends_with(ZEROS + 16)].concat();
    let waits = [
        call(libc::SYS_wait4, &[u32::MAX, ZEROS + 32, 0, 0]),
        ends_with(ZEROS + 33),
    ]
    .concat();
    // A thread ends the whole process by its exit_group; the first one rests.
    let thread = call(libc::SYS_clone, &[0x5_0F00, ZEROS + 4_096]);
    for (creates, then) in [
        (call(libc::SYS_fork, &[]), &waits),
        (call(libc::SYS_vfork, &[]), &waits),
        (call(libc::SYS_clone, &[17, 0]), &waits),
        (thread, &rests()),
    ] {
        let code = [&opens()[..], &creates, &if_zero(&asks), then].concat();
        let (status, heard) = follows(&[], &[&code], &[lines]);
        assert_eq!((status, heard.len()), (0x2200, 1), "{creates:x?}");
    }
}
