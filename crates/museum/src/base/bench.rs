use core::time::Duration;

use emulators::Device;
use emulators::avr_base::profile::Profile;
use emulators::avr_base::{AvrBase, AvrBaseConfig, Quirks};
use emulators::device::next_poll;
use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::Instant;
use protocols::avr::{BAUD, ChecksumOrder, Frame};

use crate::{Observation, Variant};
use engine::codec::BUS_HIGH_FIRST;

pub(super) const MS: Duration = Duration::from_millis(1);
/// Longer than any divider count or idle gap: earlier bytes have no effect.
const PAUSE: Duration = Duration::from_millis(30);
/// Longer than any reply takes.
const REPLY: Duration = Duration::from_millis(4);

/// A base on a bench: a master that writes bytes at exact times, and a robot on an open floor.
pub(super) struct Bench {
    pub(super) base: AvrBase,
    pub(super) world: World,
    pub(super) now: Instant,
    pub(super) seen: Observation,
    received: Vec<u8>,
    /// When the first byte of the answer to what was asked last was ready.
    pub(super) answered_at: Option<Instant>,
}

/// The documented base, but with the fielded byte order, so that it understands the same bytes.
const SOUND: Quirks = Quirks {
    checksum: ChecksumOrder::HighFirst,
    ..Profile::Document.quirks()
};

/// `variant` of the base; the defective one is `build`. All its tasks began with the run.
pub(super) fn config(variant: Variant, build: Profile) -> AvrBaseConfig {
    AvrBaseConfig {
        profile: build,
        quirks: (!variant.is_defective()).then_some(SOUND),
        phase: Some(Duration::ZERO),
        ..AvrBaseConfig::default()
    }
}

/// An open floor.
pub(super) fn floor(walls: Vec<Shape>, body: BodyConfig) -> World {
    let scene = Scene::new(walls, vec![]).expect("at most one wall");
    World::new(scene, body, Pose::default(), 1).expect("a body at the origin")
}

impl Bench {
    /// The build of 2015, or the sound base.
    pub(super) fn new(variant: Variant) -> Self {
        Self::of(config(variant, Profile::Rcj2015))
    }

    /// A base 10 ms after the start, well away from any of its tasks.
    pub(super) fn of(config: AvrBaseConfig) -> Self {
        Self::in_world(config, floor(vec![], BodyConfig::default().ideal()))
    }

    pub(super) fn in_world(config: AvrBaseConfig, world: World) -> Self {
        let mut bench = Self {
            base: AvrBase::new(config, 7),
            world,
            now: Instant::ZERO,
            seen: Observation::default(),
            received: Vec::new(),
            answered_at: None,
        };
        bench.run(10 * MS);
        bench
    }

    /// Advances like a rig: from deadline to deadline.
    pub(super) fn run(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.now = next_poll(&self.base, self.now, end);
            self.poll();
        }
    }

    fn poll(&mut self) {
        self.world.advance(self.now);
        self.base.poll(self.now, &mut self.world);
        let mut buf = [0; 256];
        let len = self.base.transmit(AvrBase::BUS, &mut buf);
        if len > 0 {
            self.answered_at.get_or_insert(self.now);
            self.received.extend(&buf[..len]);
        }
    }

    /// Puts `bytes` on the wire, one every 10 us.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        self.seen.bytes("master", &BUS_HIGH_FIRST, bytes);
        self.put(bytes);
    }

    /// The same without a note of it.
    fn put(&mut self, bytes: &[u8]) {
        let byte_time = Duration::from_nanos(10_000_000_000 / u64::from(BAUD));
        for &byte in bytes {
            self.run(byte_time);
            self.base.receive(AvrBase::BUS, self.now, &[byte]);
            self.poll();
        }
        self.answered_at = None;
    }

    /// Whether `bytes`, the first of which begins at `at`, are answered within 4 ms; without a note
    /// of it.
    pub(super) fn answers_at(&mut self, at: Instant, bytes: &[u8]) -> bool {
        self.run(at - self.now);
        self.put(bytes);
        self.run(REPLY);
        !core::mem::take(&mut self.received).is_empty()
    }

    /// Bytes sent by the base since the last call.
    pub(super) fn take(&mut self) -> Vec<u8> {
        let received = core::mem::take(&mut self.received);
        self.seen.bytes("base", &BUS_HIGH_FIRST, &received);
        received
    }

    /// Sends `bytes` after a pause and returns only their answer.
    pub(super) fn ask(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.run(PAUSE);
        self.received.clear();
        self.ask_on(bytes)
    }

    /// The same without a pause: the base's tasks have not written over what was there.
    pub(super) fn ask_on(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.send(bytes);
        self.run(REPLY);
        self.take()
    }

    pub(super) fn write(&mut self, register: u8, data: &[u8]) -> Vec<u8> {
        self.ask(write(register, data).as_bytes())
    }

    /// The data of the reply, or nothing if it is no reply to this read.
    pub(super) fn read(&mut self, register: u8, count: u8) -> Vec<u8> {
        let reply = self.ask(read(register, count).as_bytes());
        let data = reply.get(3..3 + usize::from(count)).unwrap_or_default();
        if write(register, data).as_bytes() == reply {
            data.to_vec()
        } else {
            Vec::new()
        }
    }

    /// The ticks of the left wheel as the master reads them; `None` if it gets no answer.
    pub(super) fn left_ticks(&mut self) -> Option<i32> {
        Some(i32::from_le_bytes(self.read(36, 4).try_into().ok()?))
    }

    /// Whether the robot moves, as a figure.
    pub(super) fn moving(&mut self, name: &'static str) -> bool {
        let moves = self.world.is_moving();
        self.seen
            .figure(name, if moves { "turning" } else { "at rest" });
        moves
    }

    /// What was seen, with its verdict.
    pub(super) fn judged(self, has_defect: bool) -> Observation {
        self.seen.judged(has_defect)
    }
}

pub(super) fn read(register: u8, count: u8) -> Frame {
    Frame::read(register, count, ChecksumOrder::HighFirst)
}

pub(super) fn write(register: u8, data: &[u8]) -> Frame {
    Frame::write(register, data, ChecksumOrder::HighFirst)
}

/// What the fielded base says to a frame that it could not accept; also the acknowledgement of
/// register 255.
pub(super) const ERROR: [u8; 5] = [0xAB, 0xFF, 0x00, 0x01, 0xAA];
