//! The PC's end of the telemetry link, and the PC program on a bench with a robot that executes
//! commands at once.

use firmware_core::Master;
use firmware_core::robots::yellow::pc::{PcCommand, PcConfig, PcProgram, TaskState};
use protocols::telemetry::message::{
    Line, Odometry, Pose, State, Telecommand, Telemetry as Message,
};
use protocols::telemetry::{Decoder, PAYLOAD_MAX};
use protocols::{Decode, Instant};

use super::bench::{flipped, frame};
use crate::{Bug, Observation, Variant};
use engine::codec::TELEMETRY;

const SENDING: &str = "PC's program, telemetry link";
const WITH_YP_01: &str = "the PC's program with this defect; both send one command a frame";

pub(super) const ROWS: [Bug; 5] = [
    Bug::new(
        "YP-01",
        SENDING,
        "the PC sends one command per telemetry frame: orders wait in a queue, five leave it a second",
        BY,
        yp_01,
    ),
    Bug::new(
        "YP-02",
        SENDING,
        "the PC sends one byte per millisecond, a quarter of the line's capacity",
        BY,
        yp_02,
    ),
    Bug::new(
        "YP-03",
        SENDING,
        "a request empties the queue: waiting drive commands are lost",
        WITH_YP_01,
        yp_03,
    ),
    Bug::new(
        "YP-04",
        SENDING,
        "the PC sends a request once: if it is lost, the PC waits for its answer without end",
        BY,
        yp_04,
    ),
    Bug::new(
        "YP-05",
        SENDING,
        "the PC accepts a frame with a wrong checksum: a flipped bit moves the robot on the map",
        BY,
        yp_05,
    ),
];

/// Name of the switched element.
pub(super) const BY: &str = "the PC's program with this defect";

/// Settings of the program for `variant`; the defective one has the defect `id`.
pub(super) fn config(variant: Variant, id: &str) -> PcConfig {
    let sound = PcConfig::default();
    match variant {
        Variant::Defective => sound.with_defect(id).expect("exhibits name known defects"),
        Variant::Sound => sound,
    }
}

/// The program, and a robot that always faces along x.
pub(super) struct Desk {
    pub(super) pc: PcProgram,
    now_ms: u64,
    /// True position of the robot, metres.
    pub(super) at: [f32; 2],
    /// Error of its odometry.
    pub(super) off: [f32; 2],
    /// Ends of the walls around it, metres in the world.
    pub(super) walls: Vec<[f32; 4]>,
    /// Number of goals to which the robot drives only half of the distance.
    pub(super) stops_halfway: u32,
    /// Whether telecommands get lost.
    pub(super) is_deaf: bool,
    state: State,
    wants_lines: bool,
    decoder: Decoder,
    /// Commands that the robot received, with their times.
    pub(super) commands: Vec<(u64, Telecommand)>,
}

impl Desk {
    pub(super) fn new(config: PcConfig) -> Self {
        Self {
            pc: PcProgram::new(config),
            now_ms: 0,
            at: [0.0; 2],
            off: [0.0; 2],
            walls: Vec::new(),
            stops_halfway: 0,
            is_deaf: false,
            state: State::Off,
            wants_lines: false,
            decoder: Decoder::default(),
            commands: Vec::new(),
        }
    }

    pub(super) fn now(&self) -> Instant {
        Instant::from_millis(self.now_ms)
    }

    pub(super) fn command(&mut self, command: PcCommand) {
        let taken = self.pc.command(self.now(), command);
        taken.expect("exhibits ask for what is possible");
        self.pc.poll(self.now());
    }

    pub(super) fn run(&mut self, ms: u64) {
        for _ in 0..ms {
            self.step();
        }
    }

    /// Runs until the task has ended, at most for the given time; returns its result.
    pub(super) fn run_task(&mut self, ms: u64) -> &'static str {
        let end = self.now_ms + ms;
        while self.now_ms < end && self.pc.task_state() == TaskState::InProgress {
            self.step();
        }
        self.pc.status()
    }

    fn step(&mut self) {
        self.now_ms += 1;
        if self.now_ms.is_multiple_of(200) {
            let frame = self.told();
            self.pc.receive(PcProgram::TELEMETRY, self.now(), &frame);
        }
        self.pc.poll(self.now());
        let mut buf = [0; 256];
        let len = self.pc.transmit(PcProgram::TELEMETRY, &mut buf);
        let frames: Vec<_> = self.decoder.push(&buf[..len]).flatten().collect();
        for frame in frames {
            let command = Telecommand::decode(frame.payload());
            let command = command.expect("the program's own message");
            if !self.is_deaf {
                self.commands.push((self.now_ms, command));
                self.obey(&command);
            }
        }
    }

    fn obey(&mut self, command: &Telecommand) {
        self.wants_lines |= command.lines.is_some();
        if let Some(pose) = command.corrected_pose {
            self.off = [pose.x - self.at[0], pose.y - self.at[1]];
        }
        self.state = command.state.unwrap_or(self.state);
        if let Some(goal) = command.desired_pose {
            let part = if self.stops_halfway > 0 { 0.5 } else { 1.0 };
            self.stops_halfway = self.stops_halfway.saturating_sub(1);
            let way = [0, 1].map(|axis| [goal.x, goal.y][axis] - self.at[axis] - self.off[axis]);
            self.at = [0, 1].map(|axis| self.at[axis] + way[axis] * part);
            self.state = State::Off;
        }
    }

    /// The robot's telemetry, with its lines if the PC requested them.
    fn told(&mut self) -> Vec<u8> {
        let [x, y] = [0, 1].map(|axis| self.at[axis] + self.off[axis]);
        let asked = core::mem::take(&mut self.wants_lines);
        let lines = self.walls.iter().map(|wall| self.line(*wall)).collect();
        message_frame(&Message {
            timestamp_ms: u32::try_from(self.now_ms).unwrap_or(u32::MAX),
            state: Some(self.state),
            odometry: Some(odometry(x, y)),
            lines: asked.then_some(lines),
            ..Message::default()
        })
    }

    /// A wall as the robot sees it, millimetres.
    fn line(&self, [x0, y0, x1, y1]: [f32; 4]) -> Line {
        let end = |x: f32, y: f32| Pose {
            x: (x - self.at[0]) * 1_000.0,
            y: (y - self.at[1]) * 1_000.0,
            alpha: 0.0,
        };
        Line {
            start: end(x0, y0),
            end: end(x1, y1),
        }
    }

    pub(super) fn counter(&self, wanted: &str) -> u64 {
        let mut found = 0;
        self.pc.counters(&mut |name, value| {
            if name == wanted {
                found = value;
            }
        });
        found
    }
}

fn odometry(x: f32, y: f32) -> Odometry {
    Odometry {
        pose: Pose { x, y, alpha: 0.0 },
        ..Odometry::default()
    }
}

fn message_frame(message: &Message) -> Vec<u8> {
    let mut payload = [0; PAYLOAD_MAX];
    let len = message.encode(&mut payload).expect("a few lines fit");
    frame(&payload[..len])
}

/// Walls from corner to corner, and back to the first.
pub(super) fn closed(corners: &[[f32; 2]]) -> Vec<[f32; 4]> {
    let next = corners.iter().cycle().skip(1);
    let walls = corners.iter().zip(next);
    walls.map(|(a, b)| [a[0], a[1], b[0], b[1]]).collect()
}

/// A room of 2 m around the robot; its walls lie in the middle of cells if the robot does.
pub(super) fn room([x, y]: [f32; 2]) -> Vec<[f32; 4]> {
    let [low, high] = [-1.0, 1.0];
    closed(&[
        [x + low, y + low],
        [x + high, y + low],
        [x + high, y + high],
        [x + low, y + high],
    ])
}

const AHEAD: PcCommand = PcCommand::Manual {
    linear_m_s: 0.1,
    angular_rad_s: 0.0,
};

fn yp_01(variant: Variant) -> Observation {
    let mut desk = Desk::new(config(variant, "YP-01"));
    desk.run(1_000);
    for _ in 0..3 {
        desk.command(AHEAD);
    }
    desk.run(1_000);
    let times = desk.commands.iter().take(3).map(|(at, _)| at - 1_000);
    let times: Vec<u64> = times.collect();
    let mut seen = Observation::default();
    let name = "three orders of one moment arrive after, ms";
    seen.figure(name, format!("{times:?}"));
    seen.judged(times.last().is_some_and(|last| *last >= 500))
}

fn yp_02(variant: Variant) -> Observation {
    let mut desk = Desk::new(config(variant, "YP-02"));
    desk.run(1_000);
    desk.command(PcCommand::Stop);
    let (mut sent, mut buf) = (Vec::new(), [0; 64]);
    for ms in 1_000..1_005 {
        desk.pc.poll(Instant::from_millis(ms));
        let len = desk.pc.transmit(PcProgram::TELEMETRY, &mut buf);
        sent.extend(&buf[..len]);
    }
    let mut seen = Observation::default();
    seen.bytes("PC", &TELEMETRY, &sent);
    seen.figure("bytes of the order after 5 ms", sent.len());
    seen.judged(sent.len() == 5)
}

fn yp_03(variant: Variant) -> Observation {
    let queued = config(variant, "YP-03").with_defect("YP-01");
    let mut desk = Desk::new(queued.expect("it is known"));
    desk.run(1_000);
    desk.command(AHEAD);
    desk.command(PcCommand::Stop);
    desk.run(1_000);
    let lost = desk.counter("lost in queue");
    let drives = desk.commands.iter();
    let drives = drives.filter(|(_, command)| command.velocities.is_some());
    let drives = drives.count();
    let mut seen = Observation::default();
    seen.figure("commands lost in the queue", lost);
    seen.figure("speeds that the robot was told", drives);
    seen.judged(lost > 0 && drives == 0)
}

/// For three seconds, in which the PC requests the lines, no byte reaches the robot.
fn yp_04(variant: Variant) -> Observation {
    let mut desk = Desk::new(config(variant, "YP-04"));
    desk.walls = room([0.0; 2]);
    desk.run(1_000);
    desk.command(PcCommand::MapStart);
    desk.run(1_000);
    desk.is_deaf = true;
    desk.run(3_000);
    desk.is_deaf = false;
    let status = desk.run_task(20_000);
    let mut seen = Observation::default();
    let name = "the map, 20 s after a gap of 3 s in the link";
    seen.figure(name, status);
    seen.judged(status == "in progress")
}

fn yp_05(variant: Variant) -> Observation {
    let mut desk = Desk::new(config(variant, "YP-05"));
    let told = Message {
        state: Some(State::Off),
        odometry: Some(odometry(0.25, 0.0)),
        ..Message::default()
    };
    let sound = message_frame(&told);
    let mut seen = Observation::default();
    for bytes in [sound.clone(), flipped(sound)] {
        seen.bytes("robot", &TELEMETRY, &bytes);
        desk.now_ms += 200;
        desk.pc.receive(PcProgram::TELEMETRY, desk.now(), &bytes);
        desk.pc.poll(desk.now());
    }
    let x_mm = desk.pc.believed_pose().map_or(0.0, |pose| pose.x_mm);
    seen.figure("where the robot is for the PC, mm", x_mm);
    seen.judged(x_mm > 900.0)
}
