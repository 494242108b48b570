//! The sensor as its host sees it.

mod device;
mod faults;
mod scans;

use core::time::Duration;

use protocols::rplidar::{Answer, Command, Decoder, Frame, Health, Mode, Node, Reply};
use protocols::{Decode, Instant};

use super::*;
use crate::world::{BodyConfig, Point, Pose, Scene, Shape};

const SCAN: [u8; 7] = [0xA5, 0x5A, 0x05, 0x00, 0x00, 0x40, 0x81];

/// A sensor in a world, and the line that receives its bytes.
struct Bench {
    lidar: Rplidar,
    world: World,
    now: Instant,
    bytes: Vec<u8>,
}

/// A square of this half width with the robot in the middle.
fn room(half_m: f64) -> World {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    world(
        corners
            .map(|(x, y)| Point::new(x * half_m, y * half_m))
            .to_vec(),
    )
}

fn world(corners: Vec<Point>) -> World {
    let body = BodyConfig {
        radius_m: 0.05,
        ..BodyConfig::default().ideal()
    };
    let scene = Scene::new([Shape::Polygon { corners }], Vec::new()).expect("an outline");
    World::new(scene, body, Pose::default(), 1).expect("free")
}

fn config(profile: Profile, motor: MotorControl) -> Config {
    Config {
        profile,
        motor,
        ..Config::default()
    }
}

fn plain() -> Bench {
    Bench::new(Config::default(), room(1.0))
}

/// A sensor with one fault from the start, and one without.
fn pair(fault: Fault, figure: Option<f64>, config: &Config) -> [Bench; 2] {
    let mut broken = config.clone();
    broken.faults.push((fault, figure));
    [broken, config.clone()].map(|config| Bench::new(config, room(1.0)))
}

impl Bench {
    fn new(config: Config, world: World) -> Self {
        Self {
            lidar: Rplidar::new("lidar", 7, config),
            world,
            now: Instant::ZERO,
            bytes: Vec::new(),
        }
    }

    fn run_to(&mut self, until: Instant) -> &mut Self {
        while let Some(at) = self.lidar.poll_at().filter(|&at| at <= until) {
            assert!(at >= self.now, "time runs backwards at {at}");
            self.now = at;
            self.lidar.poll(at, &mut self.world);
            self.take();
        }
        self.now = until;
        self
    }

    fn take(&mut self) {
        let mut buf = [0; 4_096];
        let len = self.lidar.transmit(Rplidar::UART, &mut buf);
        self.bytes.extend(&buf[..len]);
    }

    fn run_ms(&mut self, millis: u64) -> &mut Self {
        self.run_to(self.now + Duration::from_millis(millis))
    }

    fn send(&mut self, bytes: &[u8]) -> &mut Self {
        self.lidar.receive(Rplidar::UART, self.now, bytes);
        self
    }

    /// Sends a request, runs for 20 ms and returns the received bytes.
    fn ask(&mut self, command: Command) -> Vec<u8> {
        self.bytes.clear();
        self.send(command.request().as_bytes()).run_ms(20);
        core::mem::take(&mut self.bytes)
    }

    /// Starts a scan and runs it for a second once it streams.
    fn scan(&mut self) -> &mut Self {
        self.send(&[0xA5, 0x20]).run_ms(3_000);
        self.bytes.clear();
        self.run_ms(1_000)
    }

    fn frames(&self) -> Vec<Frame> {
        frames(&self.bytes, Mode::Answers)
    }

    /// Nodes of bytes that begin with one.
    fn nodes(&self) -> Vec<Node> {
        let node = |frame| match frame {
            Frame::Node(node) => Some(node),
            _ => None,
        };
        frames(&self.bytes, Mode::Nodes)
            .into_iter()
            .filter_map(node)
            .collect()
    }

    fn health(&mut self) -> Option<Health> {
        let bytes = self.ask(Command::Health);
        match answer(&bytes)?.reply() {
            Reply::Health(health) => Some(health),
            _ => None,
        }
    }

    fn rules(&mut self) -> Vec<&'static str> {
        let events = self.lidar.take_events();
        events.into_iter().map(|event| event.rule).collect()
    }
}

fn frames(bytes: &[u8], mode: Mode) -> Vec<Frame> {
    let mut decoder = Decoder::default();
    decoder.expect(mode);
    let mut frames: Vec<_> = decoder.push(bytes).flatten().collect();
    decoder.idle();
    frames.extend(decoder.push(&[]).flatten());
    frames
}

/// The last answer in `bytes`.
fn answer(bytes: &[u8]) -> Option<Answer> {
    let answer = |frame| match frame {
        Frame::Answer(answer) => Some(answer),
        _ => None,
    };
    frames(bytes, Mode::Answers)
        .into_iter()
        .filter_map(answer)
        .next_back()
}
