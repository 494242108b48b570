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
    /// Time at which the first byte of the last reply was ready.
    pub(super) answered_at: Option<Instant>,
}

/// The documented base, but with the fielded byte order, so that both accept the same bytes.
const SOUND: Quirks = Quirks {
    checksum: ChecksumOrder::HighFirst,
    ..Profile::Document.quirks()
};

/// Configuration of `variant`; the defective one is `build`. All tasks begin with the run.
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
    /// A bench with the build of 2015 or the sound base.
    pub(super) fn new(variant: Variant) -> Self {
        Self::of(config(variant, Profile::Rcj2015))
    }

    /// A bench with a base 10 ms after the start, well away from all periodic tasks.
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

    /// Advances time from deadline to deadline, as a rig does.
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

    /// Puts `bytes` on the wire without recording them.
    fn put(&mut self, bytes: &[u8]) {
        let byte_time = Duration::from_nanos(10_000_000_000 / u64::from(BAUD));
        for &byte in bytes {
            self.run(byte_time);
            self.base.receive(AvrBase::BUS, self.now, &[byte]);
            self.poll();
        }
        self.answered_at = None;
    }

    /// Whether the base replies within 4 ms to `bytes`, whose first byte begins at `at`. Nothing is
    /// recorded.
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

    /// Sends `bytes` after a pause and returns only the reply to them.
    pub(super) fn ask(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.run(PAUSE);
        self.received.clear();
        self.ask_on(bytes)
    }

    /// Sends `bytes` without a pause: the base's tasks have not yet overwritten the previous data.
    pub(super) fn ask_on(&mut self, bytes: &[u8]) -> Vec<u8> {
        self.send(bytes);
        self.run(REPLY);
        self.take()
    }

    pub(super) fn write(&mut self, register: u8, data: &[u8]) -> Vec<u8> {
        self.ask(write(register, data).as_bytes())
    }

    /// Data of the reply; empty if the reply does not belong to this read.
    pub(super) fn read(&mut self, register: u8, count: u8) -> Vec<u8> {
        let reply = self.ask(read(register, count).as_bytes());
        let data = reply.get(3..3 + usize::from(count)).unwrap_or_default();
        if write(register, data).as_bytes() == reply {
            data.to_vec()
        } else {
            Vec::new()
        }
    }

    /// Ticks of the left wheel as the master reads them; `None` without a reply.
    pub(super) fn left_ticks(&mut self) -> Option<i32> {
        Some(i32::from_le_bytes(self.read(36, 4).try_into().ok()?))
    }

    /// Records whether the robot moves, as a figure.
    pub(super) fn moving(&mut self, name: &'static str) -> bool {
        let moves = self.world.is_moving();
        self.seen
            .figure(name, if moves { "turning" } else { "at rest" });
        moves
    }

    /// The observation with its verdict.
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

/// Reply of the fielded base to a frame that it could not accept; also its acknowledgement of
/// register 255.
pub(super) const ERROR: [u8; 5] = [0xAB, 0xFF, 0x00, 0x01, 0xAA];
