//! The robot's program on a bench: a base that replies at once, a lidar as packets, a PC as bytes.

use core::time::Duration;

use firmware_core::robots::rescue::{Config, Rescue};
use firmware_core::{Inspect, Master};
use protocols::avr::{self, ChecksumOrder, Frame, registers};
use protocols::pcui::message::Mode;
use protocols::xv11::{self, RawReading, Reading, SpeedWord};
use protocols::{Decode, Instant};

use super::{Observation, Variant};
use engine::codec::PCUI;

pub(super) const MS: Duration = Duration::from_millis(1);

/// Settings of the program for `variant`; the defective one has the defect `id`.
pub(super) fn config(variant: Variant, id: &str) -> Config {
    let sound = Config {
        checksum_order: ChecksumOrder::HighFirst,
        ..Config::default()
    };
    match variant {
        Variant::Defective => sound.with_defect(id).expect("exhibits name known defects"),
        Variant::Sound => sound,
    }
}

/// A distance with good signal strength.
pub(super) fn range(distance_mm: u16) -> Reading {
    Reading::Range {
        distance_mm,
        strength: 200,
        weak: false,
    }
}

/// A packet at 300 turns a minute with four equal readings.
pub(super) fn packet(index: u8, reading: Reading) -> xv11::Frame {
    packet_at(300, index, reading)
}

pub(super) fn packet_at(rpm: u16, index: u8, reading: Reading) -> xv11::Frame {
    xv11::Frame::new(index, SpeedWord(rpm * 64), [RawReading::from(reading); 4])
}

/// The program and its surroundings.
pub(super) struct Robot {
    pub(super) program: Box<Rescue>,
    pub(super) now: Instant,
    pub(super) seen: Observation,
    /// The base's registers.
    pub(super) registers: [u8; 128],
    /// Requests that reached the base.
    pub(super) requests: usize,
    decoder: avr::Decoder,
    /// Bytes received by the PC.
    pub(super) radio: Vec<u8>,
    /// Last duty that the lidar's motor received.
    pub(super) duty: Option<u8>,
    /// Reading of every beam; `None`: the lidar is unplugged.
    pub(super) scene: Option<Reading>,
    sent_packets: u64,
}

impl Robot {
    pub(super) fn new(variant: Variant, id: &str) -> Self {
        Self::of(config(variant, id))
    }

    /// A robot that explores from the start.
    pub(super) fn exploring(variant: Variant, id: &str) -> Self {
        Self::of(Config {
            initial_mode: Mode::Exploration,
            ..config(variant, id)
        })
    }

    pub(super) fn of(config: Config) -> Self {
        Self {
            decoder: avr::Decoder::new(config.checksum_order),
            program: Box::new(Rescue::new(config)),
            now: Instant::ZERO,
            seen: Observation::default(),
            registers: [0; 128],
            requests: 0,
            radio: Vec::new(),
            duty: None,
            scene: None,
            sent_packets: 0,
        }
    }

    /// Advances time in steps of one millisecond.
    pub(super) fn run(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.now += MS;
            self.turn_lidar();
            self.program.poll(self.now);
            self.serve_base();
            let mut buf = [0; 46];
            let len = self.program.transmit(Rescue::RADIO, &mut buf);
            self.radio.extend(&buf[..len]);
            if self.program.transmit(Rescue::MOTOR, &mut buf) == 1 {
                self.duty = Some(buf[0]);
            }
        }
    }

    /// Feeds a packet each 2.222 ms.
    fn turn_lidar(&mut self) {
        let due = self.now.as_nanos() * 450 / 1_000_000_000;
        while self.sent_packets < due {
            let index = u8::try_from(self.sent_packets % 90).expect("below 90");
            self.sent_packets += 1;
            if let Some(reading) = self.scene {
                let packet = packet(index, reading);
                self.program
                    .receive(Rescue::LIDAR, self.now, packet.as_bytes());
            }
        }
    }

    fn serve_base(&mut self) {
        for _ in 0..8 {
            let mut buf = [0; 64];
            let len = self.program.transmit(Rescue::BASE, &mut buf);
            if len == 0 {
                return;
            }
            let requests: Vec<Frame> = self.decoder.push(&buf[..len]).flatten().collect();
            for request in requests {
                self.requests += 1;
                let reply = self.answer(&request);
                self.now += Duration::from_micros(100);
                self.program
                    .receive(Rescue::BASE, self.now, reply.as_bytes());
            }
        }
    }

    fn answer(&mut self, request: &Frame) -> Frame {
        let (first, count) = (
            usize::from(request.register()),
            usize::from(request.count()),
        );
        let order = ChecksumOrder::HighFirst;
        if request.is_write() {
            self.registers[first..first + count].copy_from_slice(request.data());
            Frame::read(request.register(), 0, order)
        } else {
            Frame::write(
                request.register(),
                &self.registers[first..first + count],
                order,
            )
        }
    }

    /// The PC sends `bytes`.
    pub(super) fn send(&mut self, bytes: &[u8]) {
        self.seen.bytes("PC", &PCUI, bytes);
        self.program.receive(Rescue::RADIO, self.now, bytes);
    }

    /// Last set-points that the base received.
    pub(super) fn set_points(&self) -> [i8; 2] {
        [registers::SPEED_LEFT_TO, registers::SPEED_RIGHT_TO]
            .map(|register| self.registers[usize::from(register)].cast_signed())
    }

    /// Records the base's set-points.
    pub(super) fn note_set_points(&mut self, name: &'static str) -> [i8; 2] {
        let [left, right] = self.set_points();
        self.seen.figure(name, format!("{left}, {right}"));
        [left, right]
    }

    /// A counter of the program.
    pub(super) fn counter(&self, name: &str) -> u64 {
        let mut found = 0;
        self.program.counters(&mut |known, value| {
            if known == name {
                found = value;
            }
        });
        found
    }

    pub(super) fn judged(self, has_defect: bool) -> Observation {
        self.seen.judged(has_defect)
    }
}

/// Records whether the program still runs; returns whether it has ended.
pub(super) fn note_end(robot: &mut Robot) -> bool {
    let before = robot.radio.len();
    robot.run(500 * MS);
    let (ended, silent) = (robot.program.is_dead(), robot.radio.len() == before);
    let told = if ended { "has ended" } else { "runs" };
    robot.seen.figure("the program", told);
    robot.seen.figure(
        "bytes to the PC in half a second",
        robot.radio.len() - before,
    );
    ended && silent
}
