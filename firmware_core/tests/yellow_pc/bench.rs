//! Robot and PC on one link.

use firmware_core::Master;
use firmware_core::pose::Pose;
use firmware_core::robots::yellow::pc::{PcCommand, PcConfig, PcProgram, TaskState};
use protocols::telemetry::message::{State, Telecommand};
use protocols::telemetry::{self, Decoder, FRAME_MAX, PAYLOAD_MAX};
use protocols::{Decode, Instant};

use crate::chance::Chance;
use crate::robot::{At, Errors, Robot};
use crate::world::World;

const STEP_MS: u64 = 10;
const TELEMETRY_MS: u64 = 200;

pub(crate) struct Bench {
    pub(crate) world: World,
    pub(crate) robot: Robot,
    pub(crate) pc: PcProgram,
    pub(crate) now_ms: u64,
    decoder: Decoder,
    chance: Chance,
    /// Share of the drive commands that get lost.
    pub(crate) lost_drives: f64,
    /// Angle by which the goal of the first drive command is rotated about the robot on arrival,
    /// radians.
    pub(crate) first_drive_off: f64,
    /// Share of all frames, in both directions, that get lost.
    pub(crate) lost_frames: f64,
    /// Whether the robot is silent.
    pub(crate) is_cut: bool,
    pub(crate) commands: Vec<(u64, Telecommand)>,
}

pub(crate) fn pose(at: At) -> Pose {
    #[expect(clippy::cast_possible_truncation, reason = "as the program has it")]
    let [x, y, heading] = [at.x * 1e3, at.y * 1e3, at.heading].map(|value| value as f32);
    Pose::new(x, y, heading)
}

impl Bench {
    pub(crate) fn new(world: World, start: At, errors: Errors, config: PcConfig) -> Self {
        Self {
            world,
            robot: Robot::new(start, errors, config.seed),
            pc: PcProgram::new(config),
            now_ms: 0,
            decoder: Decoder::default(),
            chance: Chance::new(config.seed ^ 0xABCD),
            lost_drives: 0.0,
            first_drive_off: 0.0,
            lost_frames: 0.0,
            is_cut: false,
            commands: Vec::new(),
        }
    }

    pub(crate) fn now(&self) -> Instant {
        Instant::from_millis(self.now_ms)
    }

    pub(crate) fn command(&mut self, command: PcCommand) {
        self.pc.command(self.now(), command).expect("taken");
    }

    pub(crate) fn step(&mut self) {
        self.now_ms += STEP_MS;
        let now = self.now();
        self.robot.step(&self.world, 0.01);
        if self.now_ms.is_multiple_of(TELEMETRY_MS) {
            let timestamp_ms = u32::try_from(self.now_ms).expect("short");
            let message = self.robot.tell(&self.world, timestamp_ms);
            let lost = self.chance.unit() < self.lost_frames;
            if !lost && !self.is_cut {
                let mut payload = [0; PAYLOAD_MAX];
                let len = message.encode(&mut payload).expect("fits");
                let mut frame = [0; FRAME_MAX];
                let len = telemetry::encode(&payload[..len], &mut frame).expect("fits");
                self.pc.receive(PcProgram::TELEMETRY, now, &frame[..len]);
                self.pc.poll(now);
            }
        }
        if self.pc.poll_at().is_some_and(|at| at <= now) {
            self.pc.poll(now);
        }
        let mut buf = [0; 4_096];
        let len = self.pc.transmit(PcProgram::TELEMETRY, &mut buf);
        let frames: Vec<_> = self.decoder.push(&buf[..len]).collect();
        for frame in frames {
            let frame = frame.expect("sound");
            let mut command = Telecommand::decode(frame.payload()).expect("a command");
            self.commands.push((self.now_ms, command));
            let is_drive = command.state == Some(State::AutoPosition);
            if let Some(goal) = command.desired_pose.as_mut().filter(|_| is_drive) {
                let off = core::mem::take(&mut self.first_drive_off);
                *goal = self.robot.turned(*goal, off);
            }
            let part = self
                .lost_frames
                .max(if is_drive { self.lost_drives } else { 0.0 });
            if self.chance.unit() >= part {
                self.robot.obey(&command);
            }
        }
    }

    pub(crate) fn run_for(&mut self, seconds: u64) {
        for _ in 0..seconds * 1_000 / STEP_MS {
            self.step();
        }
    }

    /// Runs until the task has ended, at most for the given time; returns the elapsed seconds.
    pub(crate) fn run_task(&mut self, seconds: u64) -> f64 {
        let from = self.now_ms;
        while self.pc.task_state() == TaskState::InProgress && self.now_ms < from + seconds * 1_000
        {
            self.step();
        }
        (self.now_ms - from) as f64 / 1e3
    }

    pub(crate) fn counter(&self, name: &str) -> u64 {
        let mut found = None;
        self.pc.counters(&mut |counter, value| {
            if counter == name {
                found = Some(value);
            }
        });
        found.expect("such a counter")
    }
}
