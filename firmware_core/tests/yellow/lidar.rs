//! The lidar of the bench: it replies to scan, health and reset requests, and can be silent.

use core::time::Duration;

use protocols::rplidar::{Command, Descriptor, Health, Node, RequestDecoder, Status};
use protocols::{Decode, Instant};

use crate::bench::{Wall, cast};

/// Xorshift.
pub(crate) struct Dice(u64);

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(crate) fn gauss(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Phase {
    Idle,
    Scanning,
    /// Protection Stop.
    Stopped,
    /// After a reset; the start text follows.
    Restarting(Instant),
}

/// The rotating head of a lidar.
pub(crate) struct Lidar {
    pub(crate) duty: u8,
    pub(crate) sigma_mm: f64,
    /// 2000 samples a second make 364 at 5.5 turns a second.
    pub(crate) nodes_per_turn: f64,
    /// Number of bytes after which one is lost.
    pub(crate) lose_in: Option<usize>,
    /// Whether the transport drops bytes of value 0.
    pub(crate) strips_nul: bool,
    /// Time from which on nodes are sent.
    pub(crate) even_at: Instant,
    /// Requests so far.
    pub(crate) requests: Vec<(Instant, Command)>,
    phase: Phase,
    angle: f64,
    starts_turn: bool,
    decoder: RequestDecoder,
    answer: Vec<u8>,
    dice: Dice,
}

impl Lidar {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            duty: 0,
            sigma_mm: 0.0,
            nodes_per_turn: 363.6,
            lose_in: None,
            strips_nul: false,
            even_at: Instant::ZERO,
            requests: Vec::new(),
            phase: Phase::Idle,
            angle: 0.0,
            starts_turn: true,
            decoder: RequestDecoder::default(),
            answer: Vec::new(),
            dice: Dice::new(seed),
        }
    }

    /// Enters Protection Stop: silence until a reset.
    pub(crate) fn stop(&mut self) {
        self.phase = Phase::Stopped;
    }

    pub(crate) fn receive(&mut self, now: Instant, bytes: &[u8]) {
        let commands: Vec<_> = self.decoder.push(bytes).flatten().collect();
        for command in commands.iter().filter_map(|request| request.command()) {
            self.requests.push((now, command));
            match (command, self.phase) {
                (Command::Scan, Phase::Idle | Phase::Scanning) => {
                    self.answer.extend(Descriptor::nodes().as_bytes());
                    self.phase = Phase::Scanning;
                    self.starts_turn = true;
                }
                (Command::Health, phase) => {
                    let status = match phase {
                        Phase::Stopped => Status::Error,
                        _ => Status::Good,
                    };
                    let health = Health { status, error: 1 };
                    self.answer.extend(health.answer().as_bytes());
                }
                (Command::Reset, _) => {
                    let at = now + Duration::from_millis(200);
                    self.phase = Phase::Restarting(at);
                }
                _ => {}
            }
        }
    }

    /// Bytes of this millisecond: two samples.
    pub(crate) fn step(&mut self, now: Instant, body: [f64; 3], walls: &[Wall]) -> Vec<u8> {
        let mut bytes = core::mem::take(&mut self.answer);
        if let Phase::Restarting(at) = self.phase
            && now >= at
        {
            bytes
                .extend(b"RP LIDAR System.\r\nFirmware Ver 1.29 - 1.29, HW Ver 7\r\nModel: 18\r\n");
            self.phase = Phase::Idle;
        }
        if self.phase == Phase::Scanning && self.duty > 0 && now >= self.even_at {
            for _ in 0..2 {
                bytes.extend(self.node(body, walls));
            }
        }
        if self.strips_nul {
            bytes.retain(|byte| *byte != 0);
        }
        if let Some(left) = self.lose_in {
            if left < bytes.len() {
                bytes.remove(left);
                self.lose_in = None;
            } else {
                self.lose_in = Some(left - bytes.len());
            }
        }
        bytes
    }

    fn node(&mut self, body: [f64; 3], walls: &[Wall]) -> [u8; 5] {
        self.angle += 360.0 / self.nodes_per_turn;
        if self.angle >= 360.0 {
            self.angle -= 360.0;
            self.starts_turn = true;
        }
        let way = body[2] - self.angle.to_radians();
        let distance_mm = cast(walls, body[0], body[1], way) * 1e3;
        let noisy = distance_mm + self.sigma_mm * self.dice.gauss();
        let is_valid = (150.0..6_000.0).contains(&noisy);
        let distance_q2 = if is_valid {
            (noisy * 4.0 + 0.5) as u16
        } else {
            0
        };
        let quality = if is_valid { 47 } else { 0 };
        let starts = core::mem::take(&mut self.starts_turn);
        let angle_q6 = (self.angle * 64.0 + 0.5) as u16 % (360 * 64);
        *Node::new(starts, quality, angle_q6, distance_q2).as_bytes()
    }
}
