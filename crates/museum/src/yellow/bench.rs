//! The program on a bench: wheels that follow their set-points, IR sensors with given values, a
//! lidar in a scene, a PC as bytes.

use core::time::Duration;

use firmware_core::robots::yellow::{Velocity, Yellow};
use firmware_core::{Inspect, Master};
use protocols::peripherals::{OutputsDecoder, OutputsFormat, Sample};
use protocols::telemetry::message::{State, Telecommand, Telemetry};
use protocols::{Decode, Instant, telemetry};

use super::config;
use super::head::Head;
use crate::{Observation, Variant};
use engine::codec::TELEMETRY;

pub(super) const MS: Duration = Duration::from_millis(1);
pub(super) const SECOND: Duration = Duration::from_secs(1);

/// Distance per count: 1200 counts a turn of a wheel of 37.5 mm.
pub(super) const COUNT_M: f64 = core::f64::consts::TAU * 0.0375 / 1_200.0;
/// Half the distance between the wheels.
const HALF_AXLE_M: f64 = 0.09;
/// Maximum turn rate of the motion profile.
const TURN_MAX_RAD_S: f32 = 3.0;

/// The program and its surroundings.
pub(super) struct Robot {
    pub(super) program: Box<Yellow>,
    pub(super) now: Instant,
    pub(super) seen: Observation,
    /// Values of the ADC by channel.
    pub(super) adc: [u16; 8],
    /// Counts of the left and the right wheel, both positive ahead.
    pub(super) counts: [f64; 2],
    pub(super) lidar: Head,
    /// Telemetry received by the PC.
    pub(super) heard: Vec<Telemetry>,
    /// The same telemetry as frames.
    pub(super) sent: Vec<Vec<u8>>,
    channel: u8,
    outputs: OutputsDecoder,
    pc: telemetry::Decoder,
}

impl Robot {
    pub(super) fn new(variant: Variant, id: &str) -> Self {
        Self {
            program: Box::new(Yellow::new(config(variant, id))),
            now: Instant::ZERO,
            seen: Observation::default(),
            // 0.4 V: no obstacle within 0.8 m.
            adc: [496; 8],
            counts: [0.0; 2],
            lidar: Head::default(),
            heard: Vec::new(),
            sent: Vec::new(),
            channel: 0,
            outputs: OutputsDecoder::with_format(OutputsFormat),
            pc: telemetry::Decoder::default(),
        }
    }

    /// Advances time; the wheels reach their set-points at once.
    pub(super) fn run(&mut self, time: Duration) {
        let end = self.now + time;
        while self.now < end {
            self.step();
        }
    }

    /// Runs until `condition` holds, at most for the given time; returns the elapsed time.
    pub(super) fn run_until(
        &mut self,
        most: Duration,
        condition: impl Fn(&Self) -> bool,
    ) -> Duration {
        let began = self.now;
        while self.now - began < most && !condition(self) {
            self.step();
        }
        self.now - began
    }

    /// Advances a millisecond; the wheels follow their set-points.
    pub(super) fn step(&mut self) {
        let Velocity {
            linear_m_s,
            angular_rad_s,
        } = self.program.target();
        let turn = angular_rad_s.clamp(-TURN_MAX_RAD_S, TURN_MAX_RAD_S);
        let rim = f64::from(turn) * HALF_AXLE_M;
        for (count, side) in self.counts.iter_mut().zip([-rim, rim]) {
            *count += (f64::from(linear_m_s) + side) * 0.001 / COUNT_M;
        }
        self.sample();
    }

    /// Advances a millisecond with the current wheel positions.
    pub(super) fn sample(&mut self) {
        self.now += MS;
        let bytes = self.lidar.step();
        if !bytes.is_empty() {
            self.program.receive(Yellow::LIDAR, self.now, &bytes);
        }
        // The right motor is mounted in reverse, and the counters wrap.
        let [left, right] = self.counts.map(|count| {
            #[expect(clippy::cast_possible_truncation, reason = "minutes of driving")]
            let whole = count.floor() as i64;
            whole
        });
        let counters = [left, -right].map(|count| {
            let wrapped = count.rem_euclid(1 << 16);
            u16::try_from(wrapped).expect("below 65536")
        });
        let sample = Sample {
            counters,
            adc: self.adc[usize::from(self.channel)],
            channel: self.channel,
            supply_cv: 1_200,
            button: false,
        };
        let bytes = sample.encode();
        self.program.receive(Yellow::BOARD, self.now, &bytes);
        self.program.poll(self.now);
        self.carry();
    }

    /// Collects the bytes that the program sends.
    fn carry(&mut self) {
        let mut buf = [0; 64];
        let len = self.program.transmit(Yellow::BOARD, &mut buf);
        if let Some(outputs) = self.outputs.push(&buf[..len]).flatten().last() {
            self.channel = outputs.channel;
        }
        let len = self.program.transmit(Yellow::LIDAR, &mut buf);
        self.lidar.receive(&buf[..len]);
        loop {
            let len = self.program.transmit(Yellow::TELEMETRY, &mut buf);
            if len == 0 {
                return;
            }
            for frame in self.pc.push(&buf[..len]).flatten() {
                let told = Telemetry::decode(frame.payload());
                self.heard.push(told.expect("the program's own message"));
                self.sent.push(self::frame(frame.payload()));
            }
        }
    }

    /// The PC sends these bytes, which are recorded.
    pub(super) fn hear(&mut self, bytes: &[u8]) {
        self.seen.bytes("PC", &TELEMETRY, bytes);
        self.program.receive(Yellow::TELEMETRY, self.now, bytes);
    }

    /// The PC sends a telecommand.
    pub(super) fn order(&mut self, command: &Telecommand) {
        self.hear(&framed(command));
    }

    /// The PC orders this state and nothing else.
    pub(super) fn order_state(&mut self, state: State) {
        self.order(&Telecommand {
            state: Some(state),
            ..Telecommand::default()
        });
    }

    pub(super) fn mode(&self) -> &'static str {
        Inspect::mode(&*self.program)
    }

    pub(super) fn counter(&self, wanted: &str) -> u64 {
        let mut found = 0;
        self.program.counters(&mut |name, value| {
            if name == wanted {
                found = value;
            }
        });
        found
    }

    pub(super) fn judged(self, has_defect: bool) -> Observation {
        self.seen.judged(has_defect)
    }
}

/// The frame of a telecommand.
pub(super) fn framed(command: &Telecommand) -> Vec<u8> {
    let mut payload = [0; 256];
    let len = command.encode(&mut payload).expect("every field fits");
    frame(&payload[..len])
}

/// The frame of a payload.
pub(super) fn frame(payload: &[u8]) -> Vec<u8> {
    let mut bytes = [0; telemetry::FRAME_MAX];
    let len = telemetry::encode(payload, &mut bytes).expect("at most 3200 bytes");
    bytes[..len].to_vec()
}

/// `bytes` with one bit flipped, which turns the first value 0.25 into 1.0.
pub(super) fn flipped(mut bytes: Vec<u8>) -> Vec<u8> {
    let quarter = 0.25_f32.to_le_bytes();
    let at = bytes.windows(4).position(|four| four == quarter);
    let at = at.expect("a quarter is in the message");
    bytes[at + 3] ^= 0x01;
    bytes
}
