//! A bare RPLIDAR and a client that was written for a serial port, in virtual time.

use core::time::Duration;
use std::io::{Read as _, Write as _};
use std::path::Path;

use hilrig::ports::{Bench, VirtualPort};
use hilrig::scenario::Scenario;
use protocols::Decode as _;
use protocols::rplidar::{Command, Decoder, Frame, Info, Node, Reply, Status};

/// An RPLIDAR without a robot under it in a square room of 2.4 m, its angle 0 towards a wall.
fn room(keys: &str) -> Bench {
    let text = format!(
        "schema = 1\nname = \"test\"\nrobot = \"custom\"\nduration = \"20s\"\nseed = 4\n\
         [device.lidar.rplidar]\n{keys}\n\
         [world]\nstart = {{ x_m = 1.5, y_m = 1.5, heading_deg = 90 }}\n[[world.wall]]\n\
         path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n"
    );
    let (scenario, source) = Scenario::parse(Path::new("<test>"), text).expect("sound");
    Bench::new(scenario, &source).expect("can be wired")
}

/// The client of the lidar.
struct Client {
    port: VirtualPort,
    decoder: Decoder,
    bytes: Vec<u8>,
}

impl Client {
    fn new(bench: &Bench) -> Self {
        let mut port = bench.port("lidar").expect("offered");
        port.set_timeout(Duration::from_millis(100));
        Self {
            port,
            decoder: Decoder::default(),
            bytes: Vec::new(),
        }
    }

    fn say(&mut self, command: Command) {
        let request = command.request();
        self.port.write_all(request.as_bytes()).expect("room");
        self.port.flush().expect("sent");
    }

    /// Frames received until the line is quiet or `len` bytes are there.
    fn take(&mut self, len: usize) -> Vec<Frame> {
        let mut bytes = vec![0; len];
        let mut taken = 0;
        while let Ok(more @ 1..) = self.port.read(&mut bytes[taken..]) {
            taken += more;
        }
        self.bytes.extend(&bytes[..taken]);
        self.decoder.push(&bytes[..taken]).flatten().collect()
    }

    fn ask(&mut self, command: Command) -> Vec<Frame> {
        self.say(command);
        self.take(200)
    }
}

fn info(frames: &[Frame]) -> Option<Info> {
    match frames {
        [Frame::Answer(answer)] => match answer.reply() {
            Reply::Info(info) => Some(info),
            _ => None,
        },
        _ => None,
    }
}

fn health(frames: &[Frame]) -> Option<Status> {
    match frames {
        [Frame::Answer(answer)] => match answer.reply() {
            Reply::Health(health) => Some(health.status),
            _ => None,
        },
        _ => None,
    }
}

/// Requests a scan and takes `len` bytes; the first of them wait for the rotation. Returns the
/// nodes.
fn scan(client: &mut Client, len: usize) -> Vec<Node> {
    client.port.set_timeout(Duration::from_secs(3));
    client.say(Command::Scan);
    let frames = client.take(len);
    assert!(matches!(frames[0], Frame::Stream(_)), "{:?}", frames[0]);
    let node = |frame: &Frame| match frame {
        Frame::Node(node) => Some(*node),
        _ => None,
    };
    frames.iter().filter_map(node).collect()
}

/// Distance of the wall at an angle, mm: 1.2 m to each side.
fn wall_mm(angle_deg: f32) -> f32 {
    let angle = f64::from(angle_deg).to_radians();
    let nearest = 1200.0 / libm::fabs(libm::cos(angle)).max(libm::fabs(libm::sin(angle)));
    format!("{nearest}").parse().expect("a number")
}

/// The first requests of a vendor's client, and a turn whose ranges are those of the room. 5.5
/// turns a second with a sample each 508 us are 358 nodes a turn; sigma is 0.25 % of the range.
/// Some nodes have no distance.
#[test]
fn a_client_gets_a_turn_that_agrees_with_the_room() {
    let bench = room("profile = \"fw1.29\"");
    let mut client = Client::new(&bench);
    assert_eq!(client.ask(Command::Stop), []);
    let told = info(&client.ask(Command::Info)).expect("an answer");
    assert_eq!((told.model, told.firmware), (0x18, (1, 29)));
    let status = health(&client.ask(Command::Health));
    assert_eq!(status, Some(Status::Good));

    let nodes = scan(&mut client, 7 + 5 * 1_000);
    let starts: Vec<usize> = (0..nodes.len())
        .filter(|&at| nodes[at].starts_turn())
        .collect();
    let turn = &nodes[starts[0]..starts[1]];
    assert!((350..=366).contains(&turn.len()), "{} nodes", turn.len());
    let measured = turn.iter().filter(|node| node.distance_q2() > 0);
    assert!(measured.clone().count() * 10 > turn.len() * 8);
    for node in measured {
        let (angle, found) = (node.angle_deg(), node.distance_mm().expect("a wall"));
        let wall = wall_mm(angle);
        assert!(
            (found / wall - 1.0).abs() < 0.02,
            "{found} mm at {angle}, expected {wall}"
        );
    }
}

/// All received bytes, and the hash of the run.
fn recorded(keys: &str) -> (Vec<u8>, String) {
    let bench = room(keys);
    let mut client = Client::new(&bench);
    client.ask(Command::Info);
    scan(&mut client, 2_000);
    (client.bytes, bench.judge().trace_hash)
}

#[test]
fn the_same_seed_gives_the_same_scan() {
    assert_eq!(recorded(""), recorded(""));
    assert_ne!(recorded("").0, recorded("profile = \"fw1.24\"").0);
}

/// A fault of the scenario during a scan: from 3 s on the sensor measures nothing. And a fault of
/// the settings: the turn begins at another angle.
#[test]
fn a_fault_of_the_device_shows_in_the_stream() {
    let fault =
        "[[fault]]\nkind = \"device\"\nfault = \"dark\"\ndevice = \"lidar\"\nfrom = \"3s\"\n";
    let bench = room(fault);
    let mut client = Client::new(&bench);
    let nodes = scan(&mut client, 7 + 5 * 8_000);
    let seen = |nodes: &[Node]| nodes.iter().filter(|node| node.distance_q2() > 0).count();
    assert!(seen(&nodes[..500]) > 400);
    assert_eq!(seen(&nodes[nodes.len() - 500..]), 0);

    let bench = room("faults = [\"foreign\"]");
    let mut client = Client::new(&bench);
    client.ask(Command::Info);
    assert!(client.bytes.starts_with(&[0xAA, 0x55]));
}

/// One motor for each kind of control. With the pin, the motor stands still until the first byte.
#[test]
fn the_motor_turns_by_what_is_wired() {
    let bench = room("motor = \"pwm\"");
    let mut client = Client::new(&bench);
    client.say(Command::Scan);
    bench.sleep(Duration::from_secs(2));
    assert_eq!(client.take(1_000).len(), 1, "a descriptor and no nodes");
    let mut pin = bench.raw("lidar-motor").expect("offered");
    pin.write_all(&[153]).expect("room");
    bench.sleep(Duration::from_secs(3));
    let nodes = client.take(1_000).len();
    assert!(nodes > 150, "{nodes} nodes");

    let unknown = room("motor = \"dtr\"")
        .raw("lidar-motor")
        .expect_err("no such pin");
    let known = "no port lidar-motor, expected one of lidar, lidar-dtr";
    assert_eq!(unknown.to_string(), known);
}

/// Errors name the key, the found value and the expected one.
#[test]
fn settings_that_cannot_be_are_refused() {
    let refused = |keys: &str| {
        let text = format!(
            "schema = 1\nname = \"test\"\nrobot = \"none\"\nduration = \"1s\"\n\
             [device.lidar.rplidar]\n{keys}\n"
        );
        let read = Scenario::parse(Path::new("<test>"), text);
        let bench = read.and_then(|(scenario, source)| Bench::new(scenario, &source));
        bench.expect_err("refused").to_string()
    };
    let supply = refused("supply_ma = -1");
    assert!(
        supply.contains("supply_ma") && supply.contains("is -1, expected 0 to 5000"),
        "{supply}"
    );
    let motor = refused("motor = { regulated-rpm = 9000 }");
    assert!(
        motor.contains("motor.regulated-rpm") && motor.contains("0 to 1200"),
        "{motor}"
    );
    let fault = refused("faults = [\"dusty\"]");
    assert!(
        fault.contains("dusty") && fault.contains("unclean-stop"),
        "{fault}"
    );
    let mount = refused("mount = { x_m = 11 }");
    assert!(
        mount.contains("mount.x_m") && mount.contains("-10 to 10"),
        "{mount}"
    );
}
