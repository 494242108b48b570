//! Behaviour of a program while it runs.

use crate::support::*;

/// The robot's own program as a foreign one, which finds its ports only by the directory. The
/// success of its mission depends on the machine here, and is judged in virtual time.
#[test]
fn a_sound_robot_finds_its_ports_and_goes_on() {
    let bench = Bench::new("sound", "5s", "");
    let dut = format!("{} dut --dir \"$HILRIG_DIR\"", env!("CARGO_BIN_EXE_hilrig"));
    let mission = std::fs::read_to_string(short()).expect("it is there");
    let near = mission.replace("[[1.2, 1.2], [2.2, 1.2]]", "[[1.1, 1.2]]");
    assert!(near != mission, "{mission}");
    std::fs::write(bench.folder.join("near.toml"), near).expect("a fresh file");
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_hilrig"))
        .current_dir(&bench.folder)
        .args(["run", "near.toml", "--out", "out"])
        .args(["--exec", &dut, "--exec-wait", "60s"])
        .output();
    let ended = bench.ended(output.expect("the binary is built"));
    let connected = ended.check("program-connected");
    assert_eq!(connected.0, "pass", "{}", ended.said);
    assert!(connected.1.contains("lidar"), "{}", connected.1);
    assert_eq!(ended.check("program-alive").0, "pass", "{}", ended.said);
    assert_eq!(ended.check("program-reads").0, "pass", "{}", ended.said);
    assert_eq!(ended.check("program-goes-on").0, "pass", "{}", ended.said);
    assert!(ended.log.contains("opened"), "{}", ended.log);
}

#[test]
fn who_reads_to_the_end_passes_and_is_told_where_everything_is() {
    let bench = Bench::new(
        "reads",
        "3s",
        "\
print(os.environ['HILRIG_SEED'], os.path.isfile(os.environ['HILRIG_SCENARIO']))
print(os.environ['HILRIG_PORT_SONAR'] == os.environ['HILRIG_DIR'] + '/sonar', flush=True)
fd = port()
while True:
    os.read(fd, 1)
",
    );
    let ended = bench.run(&["--seed", "7"]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
    assert!(ended.log.contains("7 True\nTrue\n"), "{}", ended.log);
    assert_eq!(ended.check("program-connected").1, "opened sonar");
}

#[test]
fn who_never_opens_its_port_fails_and_the_port_is_named() {
    let bench = Bench::new("never", "3s", "time.sleep(600)\n");
    let ended = bench.run(&["--exec-wait", "200ms"]);
    assert_eq!(ended.failed(), ["program-connected"], "{}", ended.said);
    let detail = "opened none of sonar within 0.2 s";
    assert_eq!(ended.check("program-connected").1, detail);
    ended.assert_is_failure();
}

/// The program has sent something, so the rig starts a second later, not after its full wait.
#[test]
fn who_opens_one_port_and_not_the_other_fails_and_the_other_is_named() {
    let bench = Bench::new(
        "one",
        "1s",
        "fd = port()\nos.write(fd, b'ping\\r\\n')\nwhile True:\n    os.read(fd, 100)\n",
    );
    let ended = bench.run(&["--exec-needs", "base"]);
    assert_eq!(ended.failed(), ["program-connected"], "{}", ended.said);
    let detail = "never opened base; opened sonar";
    assert_eq!(ended.check("program-connected").1, detail);
    ended.assert_is_failure();
}

/// The run is long, because time by which a busy machine was late does not count.
#[test]
fn who_opens_and_never_reads_hangs() {
    let bench = Bench::new("hangs", "8s", "fd = port()\ntime.sleep(600)\n");
    let ended = bench.run(&[]);
    assert_eq!(ended.failed(), ["program-reads"], "{}", ended.said);
    let detail = ended.check("program-reads").1;
    assert!(detail.contains("2 s: sonar at "), "{detail}");
    ended.assert_is_failure();
}

/// The system blocks a parent until its child of `vfork` has started; this child first waits for
/// another process to write to a pipe. The parent cannot shorten this wait. A page of the parent's
/// code that a slow disk must load blocks it, too.
#[test]
fn who_is_held_up_by_the_system_is_not_charged() {
    let python = "\
fd = port()
os.read(fd, 100)
os.mkfifo('out/gate')
subprocess.Popen(['sh', '-c', 'sleep 2.5; echo > out/gate'])
waits = [(os.POSIX_SPAWN_OPEN, 0, 'out/gate', os.O_RDONLY, 0)]
os.posix_spawn('/bin/true', ['true'], {}, file_actions=waits)
while True:
    os.read(fd, 100)
";
    let ended = Bench::new("held-up", "4s", python).run(&[]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
}

/// The program reads one byte a second, while ninety arrive: there are always unread bytes.
#[test]
fn who_reads_slowly_but_steadily_does_not_hang() {
    let python = "fd = port()\nwhile True:\n    os.read(fd, 1)\n    time.sleep(1)\n";
    let bench = Bench::new("slow", "4s", python);
    let ended = bench.run(&[]);
    assert_eq!(ended.failed(), Vec::<&str>::new(), "{}", ended.said);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
}

/// The program sends a request before it opens the next port: the rig must not wait until all ports
/// are open.
#[test]
fn who_waits_for_an_answer_before_it_opens_the_next_port_gets_it() {
    let python = "\
fd = port()
os.write(fd, b'ping\\r\\n')
heard = b''
while b'pong' not in heard:
    heard += os.read(fd, 100)
base = os.open(os.environ['HILRIG_PORT_BASE'], os.O_RDWR | os.O_NOCTTY)
while True:
    os.read(fd, 100)
";
    let ended = Bench::new("asks", "3s", python).run(&["--exec-needs", "base"]);
    assert_eq!(ended.check("program-connected").0, "pass", "{}", ended.said);
    assert_eq!(ended.code, Some(0), "{}", ended.said);
}

/// Contradictory options are reported before anything is started.
#[test]
fn a_port_that_there_is_not_cannot_be_needed() {
    let bench = Bench::new("unknown", "1s", "");
    let output = bench.command(&["--exec-needs", "radar"]).output();
    let output = output.expect("the binary is built");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("--exec-needs radar: no such port"), "{said}");
}

/// A device that is off, or whose line to it is cut, to the end: its driver was not observed. The
/// time before the fault is enough, and so is a device that hears and is not heard.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_driver_of_a_device_that_is_off_to_the_end_is_not_passed() {
    let meter = "schema = 1\nname = \"sonar\"\nrobot = \"none\"\nduration = \"2s\"\n\
                 device.sonar = { description = \"modbus-meter\" }\n[[fault]]\n";
    let asks = "import select\nfd = port()\nwhile True:\n    \
                os.write(fd, bytes.fromhex('010300000002c40b'))\n    \
                while select.select([fd], [], [], 0.1)[0]:\n        \
                os.read(fd, 99)\n";
    for (name, fault, is_observed) in [
        ("off", "kind = \"off\"\ndevice = \"sonar\"", false),
        (
            "cut-to",
            "kind = \"cut\"\nlink = \"sonar\"\ndirection = \"to-device\"",
            false,
        ),
        (
            "cut-from",
            "kind = \"cut\"\nlink = \"sonar\"\ndirection = \"to-master\"",
            true,
        ),
        (
            "off-later",
            "kind = \"off\"\ndevice = \"sonar\"\nfrom = \"500ms\"",
            true,
        ),
    ] {
        let bench = Bench::new(name, "2s", asks);
        let file = bench.folder.join("sonar.toml");
        std::fs::write(&file, format!("{meter}{fault}\n")).expect("a rig");
        let ended = bench.run(&["--virtual"]);
        let is_said = ended.said.contains("nothing was observed");
        assert_eq!(is_said, !is_observed, "{name}: {}", ended.said);
        let expected: &[&str] = if is_observed {
            &[]
        } else {
            &["program-goes-on"]
        };
        assert_eq!(ended.failed(), expected, "{name}: {}", ended.said);
        assert_eq!(ended.code, Some(i32::from(!is_observed)), "{name}");
    }
}

/// A program that writes more than the line takes, and asks again at once while the buffer is full.
/// Time passes to the next byte that leaves, not a microsecond for each call: that would be some
/// three million calls.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_write_to_a_full_buffer_waits_for_the_line() {
    let program = "\
fd = port()
os.set_blocking(fd, False)
left, calls = b'x' * 7200, 0
while left:
    calls += 1
    try:
        left = left[os.write(fd, left):]
    except BlockingIOError:
        pass
print('calls', calls, flush=True)
";
    let ended = Bench::new("floods", "12s", program).run(&["--virtual", "--exec-may-end"]);
    let calls = ended.log.split("calls ").nth(1).map(str::trim);
    let calls = calls.and_then(|calls| calls.parse::<u64>().ok());
    assert!(calls.is_some_and(|calls| calls < 50_000), "{}", ended.log);
}
