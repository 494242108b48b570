//! Faults of the motor board and of the RPLIDAR, scheduled by a scenario: every name that the
//! devices know. Each fault is visible in the device's bytes from the third second to the fourth,
//! not before, and in no other device.

use core::time::Duration;
use std::io::{Read as _, Write as _};
use std::path::Path;

use emulators::rplidar::Rplidar;
use emulators::wheel_board::WheelBoard;
use hilrig::ports::{Bench, VirtualPort};
use hilrig::prelude::Device;
use hilrig::scenario::Scenario;
use protocols::Decode as _;
use protocols::peripherals::{Outputs, Sample, SampleDecoder, SampleFormat};
use protocols::rplidar::{Decoder, Frame, Node};

const WINDOW: Duration = Duration::from_millis(100);
/// Number of windows of a session, and the windows of the fault.
const WINDOWS: usize = 90;
const BEGINS: usize = 30;
const ENDS: usize = 40;

/// The client's requests to the lidar, by window: scan; stop, info, health, the typical mode, the
/// desired speed, scan; reset, scan.
const ASKED: [(usize, &[u8]); 9] = [
    (10, &[0xA5, 0x20]),
    (32, &[0xA5, 0x25]),
    (33, &[0xA5, 0x50]),
    (34, &[0xA5, 0x52]),
    (35, &[0xA5, 0x84, 0x04, 0x7C, 0, 0, 0, 0x59]),
    (36, &[0xA5, 0x84, 0x04, 0x01, 0, 0, 0, 0x24]),
    (37, &[0xA5, 0x20]),
    (45, &[0xA5, 0x40]),
    (60, &[0xA5, 0x20]),
];

/// Bytes received in each window.
#[derive(Clone, Debug, Default, PartialEq)]
struct Seen {
    board: Vec<Vec<u8>>,
    lidar: Vec<Vec<u8>>,
}

/// The robot in a room of 1.2 m without its right wall, turning on the spot, without a program.
fn observe(faults: &str) -> Seen {
    let text = format!(
        "schema = 1\nname = \"boards\"\nrobot = \"yellow\"\nduration = \"10s\"\nseed = 3\n\
         [device.lidar.rplidar]\nprofile = \"fw1.29\"\n{faults}\
         [world]\nstart = {{ x_m = 0.6, y_m = 0.6, heading_deg = 0 }}\n[[world.wall]]\n\
         path_m = [[9, 0], [0, 0], [0, 1.2], [9, 1.2]]\n"
    );
    let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("sound");
    let bench = Bench::new(scenario, &source).expect("can be wired");
    let open = |name: &str| {
        let mut port = bench.raw(name).expect("offered");
        port.set_timeout(Duration::ZERO);
        port
    };
    let (mut board, mut lidar) = (open("board"), open("lidar"));
    let mut motor = open("lidar-motor");
    motor.write_all(&[153]).expect("room");
    // The right motor is mounted mirrored, so equal duties turn the robot.
    let turns = Outputs {
        duty: [6_000, 6_000],
        channel: 0,
        enable: true,
    };
    let mut seen = Seen::default();
    for window in 0..WINDOWS {
        board.write_all(&turns.encode()).expect("room");
        for (_, request) in ASKED.iter().filter(|(at, _)| *at == window) {
            lidar.write_all(request).expect("room");
        }
        bench.sleep(WINDOW);
        seen.board.push(taken(&mut board));
        seen.lidar.push(taken(&mut lidar));
    }
    seen
}

fn taken(port: &mut VirtualPort) -> Vec<u8> {
    let (mut all, mut buf) = (Vec::new(), [0; 4096]);
    while let Ok(count @ 1..) = port.read(&mut buf) {
        all.extend(&buf[..count]);
    }
    all
}

fn with(device: &str, name: &str, figure: Option<f64>) -> Seen {
    let figure = figure.map_or(String::new(), |figure| format!("factor = {figure:?}\n"));
    observe(&format!(
        "[[fault]]\nkind = \"device\"\ndevice = \"{device}\"\nfault = \"{name}\"\n{figure}\
         from = \"3s\"\nuntil = \"4s\"\n"
    ))
}

impl Seen {
    fn samples(&self, from: usize, until: usize) -> Vec<Sample> {
        let mut decoder = SampleDecoder::with_format(SampleFormat);
        let bytes = self.board[from..until].concat();
        decoder.push(&bytes).flatten().collect()
    }

    /// Counts gained by a counter.
    fn gained(&self, side: usize, from: usize, until: usize) -> i32 {
        let samples = self.samples(from, until);
        let count = |at: usize| samples[at].counters[side];
        count(samples.len() - 1)
            .wrapping_sub(count(0))
            .cast_signed()
            .into()
    }

    /// Smallest and largest value of the ADC while the fault lasts.
    fn adc(&self) -> [u16; 2] {
        let values = || self.samples(BEGINS + 1, ENDS).into_iter().map(|it| it.adc);
        [values().min().unwrap_or(0), values().max().unwrap_or(0)]
    }
}

/// The figure if one is needed, whether the robot's motion stays the same, and the condition.
type BoardRow = (Option<f64>, bool, fn(&Seen, &Seen) -> bool);

/// At 2.4 V a wheel turns 96 rpm, 1920 counts a second.
fn board_row(name: &str) -> Option<BoardRow> {
    Some(match name {
        "off" => (None, false, |seen, _| {
            seen.samples(BEGINS, ENDS).len() < 3 && seen.samples(ENDS + 1, 50).len() > 890
        }),
        // Before the restart, the counters have counted for 3 s; after it they begin at 0.
        "restart" => (None, false, |seen, plain| {
            let count = |seen: &Seen| seen.samples(BEGINS, BEGINS + 1)[20].counters[0];
            count(plain) > 3_000 && count(seen) < 200
        }),
        "stuck" => (Some(1.0), true, |seen, plain| {
            seen.gained(1, BEGINS + 1, ENDS) == 0
                && seen.gained(0, BEGINS + 1, ENDS) == plain.gained(0, BEGINS + 1, ENDS)
        }),
        "wrong" => (Some(1.5), true, |seen, plain| {
            let [wrong, right] = [seen, plain].map(|seen| seen.gained(0, BEGINS + 1, ENDS));
            (2 * wrong - 3 * right).abs() <= 4
        }),
        "slow" => (None, false, |seen, plain| {
            let [slow, usual] = [seen, plain].map(|seen| seen.gained(0, BEGINS + 5, ENDS));
            (2 * slow - usual).abs() < usual / 20
        }),
        "garbage" => (None, true, |seen, plain| {
            let ([least, most], [_, usual]) = (seen.adc(), plain.adc());
            least < 200 && most > 3_800 && usual < 1_500
        }),
        "blind" => (Some(0.0), true, |seen, plain| {
            let ([_, blind], [_, usual]) = (seen.adc(), plain.adc());
            blind + 100 < usual
        }),
        _ => return None,
    })
}

#[test]
fn each_fault_of_a_motor_board_is_seen_in_its_samples() {
    let plain = observe("");
    let board = WheelBoard::new("board", 1, emulators::wheel_board::Config::default());
    for name in board.known_faults() {
        let (figure, drives_on, holds) = board_row(name).expect(name);
        let seen = with("board", name, figure);
        assert_eq!(seen.board[..BEGINS], plain.board[..BEGINS], "{name} early");
        assert!(holds(&seen, &plain), "{name}");
        if drives_on {
            assert_eq!(seen.lidar, plain.lidar, "{name} in the lidar's stream");
        }
    }
}

/// Values with which a fault is certain to be visible within the second; `None`: not on this robot.
fn lidar_figure(name: &str) -> Option<Option<f64>> {
    Some(match name {
        // The motor of this lidar is driven by a pin.
        "dtr-inverted" => return None,
        "protection-stop" => Some(0.05),
        "torn-start" | "deaf-start" => Some(1.0),
        "byte-loss" => Some(50.0),
        "weak-supply" => Some(200.0),
        _ => None,
    })
}

fn nodes(seen: &Seen, from: usize, until: usize) -> Vec<Node> {
    let mut decoder = Decoder::default();
    let mut bytes = protocols::rplidar::Descriptor::nodes().as_bytes().to_vec();
    bytes.extend(seen.lidar[from..until].concat());
    let node = |frame| match frame {
        Frame::Node(node) => Some(node),
        _ => None,
    };
    let nodes = decoder.push(&bytes).flatten().filter_map(node);
    nodes.collect()
}

/// The lidar sends 2000 nodes a second. After the reset and another start the state is as before: a
/// finished fault has no lasting effect.
#[test]
fn each_fault_of_an_rplidar_is_seen_in_its_stream() {
    let plain = observe("");
    assert!(nodes(&plain, 80, WINDOWS).len() > 1_900);
    let lidar = Rplidar::new("lidar", 1, emulators::rplidar::Config::default());
    let mut seen_faults = 0;
    for name in lidar.known_faults() {
        let Some(figure) = lidar_figure(name) else {
            continue;
        };
        let seen = with("lidar", name, figure);
        assert_eq!(seen.lidar[..BEGINS], plain.lidar[..BEGINS], "{name} early");
        assert_ne!(
            seen.lidar[BEGINS..ENDS],
            plain.lidar[BEGINS..ENDS],
            "{name} is not seen"
        );
        assert_eq!(seen.board, plain.board, "{name} in the board's samples");
        let after = nodes(&seen, 80, WINDOWS).len();
        assert!(after > 1_900, "{name}: {after} nodes afterwards");
        seen_faults += 1;
    }
    assert_eq!(seen_faults, lidar.known_faults().len() - 1);
}
