use core::time::Duration;

use protocols::{Instant, LineConfig, xv11};

use super::Config;
use crate::lidar_motor::LidarMotor;
use crate::memory::StrayWrites;
use crate::packets::Packets;
use crate::scan::{Turn, TurnAssembler};

/// Silence after which the robot counts as blind: more than a whole turn.
const SILENCE_MAX: Duration = Duration::from_millis(300);
/// Time without a complete turn after which the robot counts as blind.
const TURNLESS_MAX: Duration = Duration::from_millis(700);
/// Turns after the first one behind a silence before the robot drives again: the lidar may fail
/// again.
const STEADY_TURNS: u8 = 2;
/// Maximum number of missing packets in a row, of 90 a turn, with which the robot still drives. An
/// obstacle narrower than these 40 degrees at the robot's clearance was visible a scan or two ago.
const GAP_MAX: u8 = 10;
/// Idle time after which a partial packet is discarded. The value is uncritical: a packet that
/// begins inside a broken one is found anyway.
const IDLE_GAP: Duration = Duration::from_millis(20);
const TARGET_RPM: f32 = 300.0;
const PACKETS: u32 = 90;

/// The lidar's parser, turn assembler and motor regulator.
#[derive(Clone, Debug)]
pub(super) struct Lidar {
    line: LineConfig,
    decoder: Packets,
    assembler: TurnAssembler,
    motor: LidarMotor,
    received_at: Instant,
    packet_at: Instant,
    turn_at: Instant,
    has_turn: bool,
    /// Whether a turn was complete since the last silence.
    sees: bool,
    /// Turns still to come before the lidar counts as steady.
    unsteady: u8,
    /// Defect: the whole program waits for the lidar (XV-08).
    waits: bool,
    is_blocked: bool,
    /// Defect: the motor gets its start duty whenever the stream is lost (XV-09).
    kicks: bool,
    pub(super) counters: Counters,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Counters {
    pub(super) packets: u32,
    pub(super) lost_packets: u32,
    pub(super) bad_packets: u32,
    pub(super) turns: u32,
    pub(super) skipped_turns: u32,
    pub(super) silences: u32,
}

impl Counters {
    /// All counters at 0.
    const NONE: Self = Self {
        packets: 0,
        lost_packets: 0,
        bad_packets: 0,
        turns: 0,
        skipped_turns: 0,
        silences: 0,
    };
}

impl Lidar {
    pub(super) const fn new(line: LineConfig, config: &Config) -> Self {
        Self {
            line,
            decoder: Packets::with_defects(config.defects.packets),
            assembler: TurnAssembler::with_defects(config.mounting, config.defects.scan),
            motor: LidarMotor::new(TARGET_RPM),
            received_at: Instant::ZERO,
            packet_at: Instant::ZERO,
            turn_at: Instant::ZERO,
            has_turn: false,
            sees: false,
            unsteady: 0,
            waits: config.defects.own.waits_for_lidar,
            is_blocked: false,
            kicks: config.defects.own.kicks_motor,
            counters: Counters::NONE,
        }
    }

    pub(super) fn receive(&mut self, now: Instant, bytes: &[u8]) {
        if now - self.received_at >= IDLE_GAP {
            self.line_broke();
        }
        self.received_at = now;
        let mut input = bytes;
        while let Some(packet) = self.decoder.step(&mut input) {
            match packet {
                Ok(packet) => {
                    let behind = (input.len() + self.decoder.pending()) as u64;
                    self.take(self.line.byte_end(now, behind), &packet);
                }
                Err(_) => {
                    self.counters.bad_packets = self.counters.bad_packets.saturating_add(1);
                    if self.kicks {
                        self.motor.kick();
                    }
                }
            }
        }
    }

    pub(super) fn line_broke(&mut self) {
        self.decoder.idle();
    }

    /// Checks for silence.
    pub(super) fn tick(&mut self, now: Instant) {
        self.motor.tick(now);
        let is_silent = now - self.packet_at >= SILENCE_MAX || now - self.turn_at >= TURNLESS_MAX;
        if self.waits {
            self.is_blocked = self.sees && is_silent;
        } else if self.sees && is_silent {
            self.sees = false;
            self.has_turn = false;
            self.unsteady = STEADY_TURNS + 1;
            self.counters.silences = self.counters.silences.saturating_add(1);
        }
    }

    pub(super) fn next_at(&self) -> Instant {
        let motor = self.motor.next_at();
        if self.sees {
            motor
                .min(self.packet_at + SILENCE_MAX)
                .min(self.turn_at + TURNLESS_MAX)
        } else {
            motor
        }
    }

    pub(super) const fn sees(&self) -> bool {
        self.sees
    }

    /// Whether the lidar has worked for a turn or two, without a large gap.
    pub(super) const fn is_steady(&self) -> bool {
        self.unsteady == 0 && self.assembler.turn().gap <= GAP_MAX
    }

    /// Whether the program is blocked because no packet arrives.
    pub(super) const fn is_blocked(&self) -> bool {
        self.is_blocked
    }

    pub(super) const fn stray_writes(&self) -> StrayWrites {
        self.decoder.stray_writes()
    }

    pub(super) const fn has_turn(&self) -> bool {
        self.has_turn
    }

    /// The newest unprocessed turn.
    pub(super) fn take_turn(&mut self) -> &Turn {
        self.has_turn = false;
        self.assembler.turn()
    }

    pub(super) const fn turn_end(&self) -> Instant {
        self.assembler.turn().end
    }

    pub(super) const fn switch_off(&mut self) {
        self.motor.switch_off();
    }

    pub(super) fn switch_on(&mut self) {
        self.motor.switch_on();
    }

    pub(super) fn take_duty(&mut self) -> Option<u8> {
        self.motor.take_duty()
    }

    /// Speed of the last packet, whole revolutions per minute.
    pub(super) fn speed_rpm(&self) -> u16 {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most 1024 rpm, in a packet"
        )]
        let rpm = libm::roundf(self.assembler.speed_rpm()) as u16;
        rpm
    }

    pub(super) const fn motor_is_too_weak(&self) -> bool {
        self.motor.is_too_weak()
    }

    pub(super) const fn speed_is_stable(&self) -> bool {
        self.motor.is_stable()
    }

    fn take(&mut self, at: Instant, packet: &xv11::Frame) {
        self.counters.packets = self.counters.packets.saturating_add(1);
        self.packet_at = at;
        self.motor.packet(at, packet.speed_rpm());
        let Some(turn) = self.assembler.push(at, packet) else {
            return;
        };
        let lost = PACKETS.saturating_sub(u32::from(turn.packets));
        self.counters.lost_packets = self.counters.lost_packets.saturating_add(lost);
        self.counters.turns = self.counters.turns.saturating_add(1);
        if self.has_turn {
            self.counters.skipped_turns = self.counters.skipped_turns.saturating_add(1);
        }
        self.has_turn = true;
        self.unsteady = self.unsteady.saturating_sub(1);
        self.sees = true;
        self.turn_at = at;
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use protocols::xv11::{Frame, RawReading, SpeedWord};

    use super::*;

    fn lidar() -> Lidar {
        Lidar::new(LineConfig::new_8n1(xv11::BAUD), &Config::default())
    }

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    /// Packets of a turn of 200 ms that begins at `start`, without those in `lost`.
    fn turn(lidar: &mut Lidar, start: u64, lost: core::ops::Range<u8>) {
        for index in (0..90_u8).filter(|index| !lost.contains(index)) {
            let packet = Frame::new(index, SpeedWord(300 * 64), [RawReading([0; 4]); 4]);
            let end = at(start) + Duration::from_micros(2_222) * (u32::from(index) + 1);
            lidar.receive(end, packet.as_bytes());
        }
    }

    /// Two turns; ten packets in a row of the second one are lost before the program asks for it.
    #[test]
    fn turns_and_packets_are_counted() {
        let mut lidar = lidar();
        assert!(!lidar.sees() && !lidar.has_turn());
        turn(&mut lidar, 0, 0..0);
        assert!(lidar.sees() && lidar.has_turn() && lidar.is_steady());
        turn(&mut lidar, 200, 40..50);
        let counters = &lidar.counters;
        assert_eq!((counters.packets, counters.lost_packets), (170, 10));
        assert_eq!((counters.turns, counters.skipped_turns), (2, 1));
        assert!(lidar.is_steady());
        assert_eq!(lidar.take_turn().packets, 80);
        assert!(!lidar.has_turn());
        turn(&mut lidar, 400, 40..51);
        assert!(!lidar.is_steady() && lidar.has_turn());
        assert_eq!(
            (lidar.counters.skipped_turns, lidar.counters.bad_packets),
            (1, 0)
        );
    }

    /// The lidar counts as silent 300 ms after the last packet, or 700 ms after the last whole
    /// turn, not before.
    #[test]
    fn a_lidar_is_silent_without_packets_or_turns() {
        let mut lidar = lidar();
        turn(&mut lidar, 0, 0..0);
        let last = lidar.packet_at;
        assert_eq!(lidar.next_at(), last + Duration::from_millis(300));
        lidar.tick(last + Duration::from_millis(299));
        assert!(lidar.sees() && lidar.counters.silences == 0);
        lidar.tick(last + Duration::from_millis(300));
        assert!(!lidar.sees() && !lidar.has_turn() && lidar.counters.silences == 1);
        // The next due time is that of the motor's restart, after a second.
        assert_eq!(lidar.next_at(), last + Duration::from_secs(1));
        lidar.tick(last + Duration::from_millis(400));
        assert_eq!(lidar.counters.silences, 1);
        let mut lidar = self::lidar();
        turn(&mut lidar, 0, 0..0);
        let turned = lidar.turn_at;
        lidar.packet_at = turned + Duration::from_millis(690);
        assert_eq!(lidar.next_at(), turned + Duration::from_millis(700));
        lidar.tick(turned + Duration::from_millis(699));
        assert!(lidar.sees());
        lidar.tick(turned + Duration::from_millis(700));
        assert!(!lidar.sees());
    }

    /// After a silence the third turn is the first to be trusted.
    #[test]
    fn a_lidar_that_comes_back_is_steady_after_two_turns() {
        let mut lidar = lidar();
        turn(&mut lidar, 0, 0..0);
        lidar.tick(at(2_000));
        let steady = [3_000, 3_200, 3_400].map(|start| {
            turn(&mut lidar, start, 0..0);
            (lidar.sees(), lidar.is_steady())
        });
        assert_eq!(steady, [(true, false), (true, false), (true, true)]);
    }

    /// The packet is complete when its last byte of 86.8 us has passed; half a packet is discarded
    /// after 20 ms.
    #[test]
    fn a_packet_ends_with_its_last_byte() {
        let packet = Frame::new(3, SpeedWord(300 * 64), [RawReading([0; 4]); 4]);
        let mut lidar = lidar();
        let behind = [packet.as_bytes(), &[0; 2][..]].concat();
        lidar.receive(at(50), &behind);
        let line = LineConfig::new_8n1(xv11::BAUD);
        assert_eq!(lidar.packet_at, line.byte_end(at(50), 2));
        let halves = |millis: u64| {
            let mut lidar = self::lidar();
            lidar.receive(at(50), &packet.as_bytes()[..11]);
            lidar.receive(at(50 + millis), &packet.as_bytes()[11..]);
            lidar.counters.packets
        };
        assert_eq!([halves(19), halves(20)], [1, 0]);
        let mut wrong = *packet.as_bytes();
        wrong[5] ^= 1;
        lidar.line_broke();
        lidar.receive(at(500), &wrong);
        lidar.receive(at(501), packet.as_bytes());
        lidar.line_broke();
        assert!(lidar.counters.bad_packets > 0 && lidar.counters.packets == 2);
    }

    /// XV-08: the fielded program waits for its lidar, and then continues normally.
    #[test]
    fn the_fielded_program_waits_for_its_lidar() {
        let mut lidar = lidar();
        lidar.waits = true;
        lidar.tick(at(1_000));
        assert!(!lidar.is_blocked());
        turn(&mut lidar, 1_000, 0..0);
        lidar.tick(at(1_300));
        assert!(!lidar.is_blocked());
        lidar.tick(at(1_600));
        assert!(lidar.is_blocked() && lidar.sees() && lidar.counters.silences == 0);
        turn(&mut lidar, 1_700, 0..0);
        lidar.tick(at(1_910));
        assert!(!lidar.is_blocked());
    }
}
