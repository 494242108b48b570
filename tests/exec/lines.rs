//! Modem lines in real time, for a program on the ports of a run.

use crate::support::{BEGIN, Ended, folder, run_in};

/// A lidar whose head the adapter runs while DTR is low.
const LIDAR: &str = "\
schema = 1
name = \"sonar\"
robot = \"custom\"
duration = \"120s\"
device.sonar.rplidar = { profile = \"fw1.29\", motor = \"dtr\" }
[world]
start = { x_m = 1.0, y_m = 1.4, heading_deg = 0 }
[[world.wall]]
path_m = [[0, 0], [2.6, 0], [2.6, 2.2], [0, 2.2], [0, 0]]
";

fn run_with_lines(name: &str, program: &str) -> Ended {
    let program = format!("{BEGIN}{program}");
    let files = [("sonar.toml", LIDAR), ("program.py", &program)];
    let command = format!(
        "exec {} with -- python3 program.py",
        env!("CARGO_BIN_EXE_hilrig")
    );
    run_in(&folder(name), &files, &command, &[])
}

/// The adapter runs the lidar's head while DTR is low. Opening raises DTR, so a scan gives no nodes
/// until the program lowers it. The lines read back as they were set, also in a child of the
/// program.
#[test]
fn dtr_reads_back_and_stops_the_motor_of_a_lidar() {
    let program = "\
import fcntl, struct, termios, select
fd = os.open(os.environ['HILRIG_PORT_SONAR'], os.O_RDWR | os.O_NOCTTY)
def lines():
    bits = struct.unpack('I', fcntl.ioctl(fd, termios.TIOCMGET, bytes(4)))[0]
    names = ['DTR', 'RTS', 'CTS', 'DSR', 'CAR']
    return [name for name in names if bits & getattr(termios, 'TIOCM_' + name)]
def change(request, line):
    fcntl.ioctl(fd, request, struct.pack('I', line))
def hears(seconds, least):
    count, end = 0, time.monotonic() + seconds
    while count < least and time.monotonic() < end:
        if select.select([fd], [], [], 0.05)[0]:
            count += len(os.read(fd, 4096))
    return count >= least
print(*lines())
os.write(fd, b'\\xa5\\x20')
print('stands', not hears(0.3, 20))
change(termios.TIOCMBIC, termios.TIOCM_DTR)
print(*lines())
print('turns', hears(60, 1000))
change(termios.TIOCMSET, termios.TIOCM_DTR)
if os.fork() == 0:
    print(*lines(), flush=True)
    os._exit(0)
os.wait()
termios.tcsendbreak(fd, 0)
sys.stdout.flush()
sys.exit(5)
";
    let ended = run_with_lines("lines", program);
    let said: Vec<&str> = ended.log.lines().skip(1).collect();
    let wanted = [
        "DTR RTS CTS DSR CAR",
        "stands True",
        "RTS CTS DSR CAR",
        "turns True",
        "DTR CTS DSR CAR",
    ];
    assert_eq!(said, wanted, "{}", ended.said);
    // The exit is reported as that of a program without supervision.
    let (_, detail) = ended.check("program-alive");
    assert!(detail.contains("exit code 5"), "{detail}");
    assert!(
        !ended.failed().contains(&"no-children-left"),
        "{}",
        ended.said
    );
}

/// A query right after opening shows the effect of opening: the lines are on, and a line that was
/// cleared at once stays off. The rig may be anywhere in its cycle then, so a single try could
/// succeed by luck. A client that closes and reopens a port faster than the rig polls it has
/// switched the lines off and on nevertheless.
#[test]
fn lines_are_up_for_who_asks_right_after_opening() {
    let program = "\
import fcntl, struct, termios
DTR, RTS = termios.TIOCM_DTR, termios.TIOCM_RTS
def outputs(fd):
    return struct.unpack('I', fcntl.ioctl(fd, termios.TIOCMGET, bytes(4)))[0] & (DTR | RTS)
up = lowered = 0
for _ in range(16):
    fd = port()
    up += outputs(fd) == DTR | RTS
    os.close(fd)
    fd = port()
    fcntl.ioctl(fd, termios.TIOCMBIC, struct.pack('I', DTR))
    time.sleep(0.1)
    lowered += outputs(fd) == RTS
    os.close(fd)
print('up', up, 'lowered', lowered)
sys.exit(5)
";
    let ended = run_with_lines("reopened", program);
    let said: Vec<&str> = ended.log.lines().skip(1).collect();
    assert_eq!(said, ["up 16 lowered 16"], "{}", ended.said);
}
