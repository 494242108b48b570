//! Modem lines and breaks between a program and a board that a scenario describes, in real and in
//! virtual time.

use crate::support::{BEGIN, Ended, folder, run_in};

/// An Arduino that is ready 200 ms after its reset; "busy N" clears CTS, "ring N" rings.
const BOARD: &str = r#"
schema = 1
name = "sonar"
robot = "none"
duration = "120s"
[device.sonar.text]
baud = 9600
resets_on = "dtr"
boot = "200ms"
greeting = "up"
unknown = "?"
raises = { cts = "ready", dcd = "count", ri = "bell" }
command = [
    { request = "ready {ready}", reply = "ok" },
    { request = "count {count}", reply = "was {count}" },
    { request = "bell {bell}", reply = "ok" },
]
variable = [{ name = "ready", initial = 1 }, { name = "count" }, { name = "bell" }]
"#;

/// The requests of the client to the board; each line of output is the result of one.
const CLIENT: &str = "\
import fcntl, select, struct, termios, threading
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
def lines():
    bits = struct.unpack('I', fcntl.ioctl(fd, termios.TIOCMGET, bytes(4)))[0]
    names = ['DTR', 'RTS', 'CTS', 'DSR', 'CAR', 'RNG']
    return [name for name in names if bits & getattr(termios, 'TIOCM_' + name)]
def line(most=60):
    text, end = b'', time.monotonic() + most
    while not text.endswith(b'\\n') and time.monotonic() < end:
        if select.select([fd], [], [], 0.05)[0]:
            text += os.read(fd, 1)
    return text.decode().strip()
def ask(text):
    os.write(fd, text.encode() + b'\\r\\n')
    return line()
print('opened', line())
print(*lines())
print(ask('count 5'), *lines())
low = lambda request: fcntl.ioctl(fd, request, struct.pack('I', termios.TIOCM_DTR))
low(termios.TIOCMBIC)
print('low', line(0.4))
low(termios.TIOCMBIS)
print('reset', line(), *lines())
def ring():
    time.sleep(0.5)
    os.write(fd, b'bell 1\\r\\n')
    time.sleep(0.5)
    os.write(fd, b'bell 0\\r\\n')
threading.Thread(target=ring).start()
fcntl.ioctl(fd, 0x545C, termios.TIOCM_RNG)
print('rang', *lines())
print(line(), line())
modes = termios.tcgetattr(fd)
modes[2] |= termios.CRTSCTS
termios.tcsetattr(fd, termios.TCSANOW, modes)
print(ask('ready 0'), *lines())
os.write(fd, b'count 9\\r\\n')
print('held', line(0.5))
termios.tcsendbreak(fd, 0)
os.close(fd)
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
print('reopened', line(), flush=True)
os._exit(0)
";

const WANTED: [&str; 8] = [
    "opened up",
    "DTR RTS CTS DSR",
    "was 5 DTR RTS CTS DSR CAR",
    "low",
    "reset up DTR RTS CTS DSR",
    "rang DTR RTS CTS DSR",
    "ok ok",
    "ok DTR RTS DSR",
];

fn run(name: &str, more: &[&str]) -> Ended {
    // The process number differs from run to run, which --check would report.
    let begin = BEGIN.replace(
        "print('group', os.getpgrp(), flush=True)",
        "print('begins')",
    );
    let program = format!("{begin}{CLIENT}");
    let files = [("sonar.toml", BOARD), ("program.py", &program)];
    run_in(&folder(name), &files, "exec python3 program.py", more)
}

fn judge(ended: &Ended) {
    let said: Vec<&str> = ended.log.lines().skip(1).map(str::trim_end).collect();
    assert_eq!(said[..8], WANTED, "{}\n{}", ended.said, ended.log);
    // What CTS holds back is not sent. A port that is closed and opened at once resets the board.
    assert_eq!(said[8..], ["held", "reopened up"]);
    // A break between two lines, without a reset, is a NUL.
    let events = ended.events();
    assert!(events.contains("sonar break"), "{events}");
    assert_eq!(events.matches("board-reset").count(), 3, "{events}");
}

/// The same results in both: only the source of the time differs.
#[test]
fn a_board_is_reset_by_dtr_and_sets_lines_in_real_and_in_virtual_time() {
    let real = std::thread::spawn(|| run("board-real", &[]));
    let ended = run("board-virtual", &["--virtual", "--check"]);
    judge(&ended);
    let (status, detail) = ended.check("deterministic");
    assert_eq!(status, "pass", "{detail}");
    judge(&real.join().expect("it runs"));
}
