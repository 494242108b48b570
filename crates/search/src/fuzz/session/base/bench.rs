use core::time::Duration;

use emulators::Device;
use emulators::avr_base::{AvrBase, AvrBaseConfig};
use emulators::device::next_poll;
use emulators::world::{BodyConfig, Pose, Scene, Shape, Wheel, World};
use protocols::Instant;
use protocols::avr::{Frame, registers};

use super::ORDER;
use crate::fuzz::session::tape::Tape;
use crate::fuzz::subject::{Behaviour, Violation};
use engine::codec::wire::Wire;
use engine::codec::{Avr, LowFirst};
use engine::rig::line::Direction;

/// After this silence every request has been answered and forgotten: the slowest task of the
/// fielded base runs every 25.1 ms.
pub(super) const QUIET_MS: u32 = 30;
/// Maximum time that motors run without messages: one second ("no messages for a short time",
/// measured 980 to 1006 ms) and one period of the regulator.
const SILENCE_MAX: Duration = Duration::from_millis(1_100);
/// Longer than `SILENCE_MAX`, to check that the motors stop.
const END_MS: u32 = 1_400;
/// Maximum set-point of the regulator (field firmware; the document gives no figure).
const SET_POINT_MAX: i16 = 35;
/// Number of wheel edges that a base may report late, or lose while it starts.
const EDGES_MAX: i64 = 8;
const BYTE: Duration = Duration::from_micros(10);
const WHEELS: [Wheel; 2] = [Wheel::Left, Wheel::Right];
const SIDES: [&str; 2] = ["left", "right"];

/// The length of the frame at the beginning of `bytes`, according to the slow reference decoder.
pub(super) fn frame_len(bytes: &[u8]) -> Option<usize> {
    Avr::<LowFirst>::frame_at(bytes)
}

/// A master on the bus that knows the rules of a base.
pub(super) struct Master<'a> {
    base: AvrBase,
    world: World,
    now: Instant,
    /// All bytes sent, and the bytes received since the last check.
    sent: Vec<u8>,
    heard: Vec<u8>,
    /// End of the last valid frame, and of the last byte.
    spoke_at: Instant,
    byte_at: Instant,
    /// Set-points that a valid write has requested, for each wheel.
    asked: [Vec<i16>; 2],
    /// First register of the last valid write, and whether a write went beyond the registers.
    last_write: Option<u8>,
    wrote_beyond: bool,
    started: [i64; 2],
    behaviour: &'a mut Behaviour,
    tape: &'a mut Tape,
}

impl<'a> Master<'a> {
    pub(super) fn new(
        config: AvrBaseConfig,
        behaviour: &'a mut Behaviour,
        tape: &'a mut Tape,
    ) -> Self {
        let scene = Scene::new(Vec::<Shape>::new(), vec![]).expect("an open floor");
        let body = BodyConfig::default().ideal();
        let world = World::new(scene, body, Pose::default(), 1).expect("room for it");
        let started = WHEELS.map(|wheel| world.encoder_ticks(wheel));
        Self {
            base: AvrBase::new(config, 7),
            world,
            now: Instant::ZERO,
            sent: Vec::new(),
            heard: Vec::new(),
            spoke_at: Instant::ZERO,
            byte_at: Instant::ZERO,
            asked: [const { Vec::new() }; 2],
            last_write: None,
            wrote_beyond: false,
            started,
            behaviour,
            tape,
        }
    }

    /// Lets time pass, from deadline to deadline of the base.
    fn run(&mut self, time: Duration) -> Result<(), Violation> {
        let end = self.now + time;
        while self.now < end {
            self.now = next_poll(&self.base, self.now, end);
            self.poll()?;
        }
        Ok(())
    }

    fn poll(&mut self) -> Result<(), Violation> {
        self.world.advance(self.now);
        self.base.poll(self.now, &mut self.world);
        let mut buf = [0; 256];
        let len = self.base.transmit(AvrBase::BUS, &mut buf);
        self.heard.extend(&buf[..len]);
        self.tape
            .note(0, self.now, Direction::ToMaster, &buf[..len]);
        self.look_at_motors()
    }

    /// Checks the laws that hold at any time.
    fn look_at_motors(&self) -> Result<(), Violation> {
        let set_points = self.base.set_points();
        for side in 0..2 {
            let point = set_points[side];
            if point != 0 && !self.asked[side].contains(&point) {
                let (wheel, asked) = (SIDES[side], &self.asked[side]);
                return Err(Violation::new(
                    "set-points-are-as-written",
                    format!("the {wheel} wheel has {point}, written were {asked:?}"),
                ));
            }
        }
        let silence = self.now - self.spoke_at;
        if set_points != [0, 0] && silence > SILENCE_MAX {
            let [left, right] = set_points;
            return Err(Violation::new(
                format!("motors-stop-in-silence: {}", self.after()),
                format!("{left}, {right} still on after {} ms", silence.as_millis()),
            ));
        }
        Ok(())
    }

    /// Preceding events, as far as they distinguish causes.
    fn after(&self) -> String {
        match self.last_write {
            _ if self.wrote_beyond => "after a write beyond the registers".to_owned(),
            Some(register) => format!("after a write that began at register {register}"),
            None => "after no write".to_owned(),
        }
    }

    pub(super) fn wait(&mut self, ms: u32) -> Result<(), Violation> {
        self.run(Duration::from_millis(u64::from(ms)))
    }

    /// Sends `bytes`. The reply is judged only if the line is quiet afterwards, as `is_left_alone`
    /// says.
    pub(super) fn send(&mut self, bytes: &[u8], is_left_alone: bool) -> Result<(), Violation> {
        let quiet = Duration::from_millis(u64::from(QUIET_MS));
        let is_quiet = self.sent.is_empty() || self.now - self.byte_at >= quiet;
        let is_request = is_left_alone && is_quiet && frame_len(bytes) == Some(bytes.len());
        if is_request {
            // A master sends no requests immediately after the start.
            self.run(quiet)?;
            self.heard.clear();
        }
        self.expect(bytes);
        self.tape.note(
            0,
            self.now + BYTE * u32::try_from(bytes.len()).expect("short"),
            Direction::ToDevice,
            bytes,
        );
        for &byte in bytes {
            self.run(BYTE)?;
            self.base.receive(AvrBase::BUS, self.now, &[byte]);
            self.byte_at = self.now;
        }
        if is_request {
            self.run(quiet)?;
            let heard = core::mem::take(&mut self.heard);
            return self.judge_reply(bytes, &heard);
        }
        Ok(())
    }

    /// Records the possible effects of `bytes`, for every position at which a base may find a
    /// frame.
    fn expect(&mut self, bytes: &[u8]) {
        let from = self.sent.len().saturating_sub(140);
        let before = self.sent.len();
        self.sent.extend(bytes);
        for start in from..self.sent.len() {
            let rest = &self.sent[start..];
            let Some(len) = frame_len(rest).filter(|len| start + len > before) else {
                continue;
            };
            let end = u32::try_from(start + len - before).expect("short");
            self.spoke_at = self.now + BYTE * end;
            if rest[2] < 0x80 {
                continue;
            }
            self.last_write = Some(rest[1]);
            self.wrote_beyond |= usize::from(rest[1]) + len - 5 > registers::COUNT;
            for (address, data) in (usize::from(rest[1])..).zip(&rest[3..len - 2]) {
                let first = usize::from(registers::SPEED_LEFT_TO);
                if let Some(side @ (0 | 1)) = address.checked_sub(first) {
                    let asked = i16::from(data.cast_signed());
                    self.asked[side].push(asked.clamp(-SET_POINT_MAX, SET_POINT_MAX));
                }
            }
        }
    }

    /// A request on a quiet line gets one answer: data, an acknowledgement, or the error frame. For
    /// an unknown register only the error frame is correct.
    fn judge_reply(&mut self, request: &[u8], reply: &[u8]) -> Result<(), Violation> {
        let (register, is_write) = (request[1], request[2] >= 0x80);
        let count = request[2] & 0x7F;
        let end = usize::from(register) + usize::from(count);
        let is_there = usize::from(register) < registers::COUNT && end <= registers::COUNT;
        let error = Frame::read(0xFF, 0, ORDER);
        let acknowledged = Frame::read(register, 0, ORDER);
        let is_data = frame_len(reply) == Some(reply.len())
            && reply[1] == register
            && reply[2] == 0x80 | count;
        let kind = match reply {
            [] => 0,
            _ if reply == error.as_bytes() => 1,
            _ if is_write && reply == acknowledged.as_bytes() => 2,
            _ if !is_write && is_data => 3,
            _ => 4,
        };
        let what = [u64::from(is_write), u64::from(is_there), kind];
        self.behaviour
            .note(&[what[0], what[1], what[2], u64::from(register / 4)]);
        let verb = if is_write { "write" } else { "read" };
        let asked = format!("{verb} of {count} from register {register}");
        let found = || format!("a {asked} has the reply {reply:02X?}");
        match (is_there, kind) {
            (true, 1..=3) | (false, 1) => Ok(()),
            (true, _) | (false, 0) => {
                let cause = format!("a-request-is-answered: {verb}");
                Err(Violation::new(cause, found()))
            }
            (false, _) => {
                let cause = format!("what-is-not-there-is-refused: {verb}");
                Err(Violation::new(cause, found()))
            }
        }
    }

    /// Final check: after a silence in which everything must have stopped, the base answers, and
    /// its counts match the wheels.
    pub(super) fn end(mut self) -> Result<(), Violation> {
        self.wait(END_MS)?;
        self.heard.clear();
        let request = Frame::read(registers::ENCODER_LEFT, 8, ORDER);
        self.send(request.as_bytes(), false)?;
        self.wait(QUIET_MS)?;
        let heard = core::mem::take(&mut self.heard);
        if heard.len() != 13 {
            let detail = format!("a read of the counts has the reply {heard:02X?}");
            return Err(Violation::new("the-base-answers-in-the-end", detail));
        }
        for (side, wheel) in WHEELS.into_iter().enumerate() {
            let bytes = heard[3 + 4 * side..].first_chunk().expect("13 bytes");
            let counted = i64::from(i32::from_le_bytes(*bytes));
            let turned = self.world.encoder_ticks(wheel) - self.started[side];
            self.behaviour
                .note(&[9, side as u64, u64::from(turned > 0), u64::from(turned < 0)]);
            if (counted - turned).abs() > EDGES_MAX {
                let name = SIDES[side];
                return Err(Violation::new(
                    format!("encoders-follow-the-wheels: {}", self.after()),
                    format!("the {name} wheel turned {turned} edges, counted were {counted}"),
                ));
            }
        }
        for event in self.base.take_events() {
            self.behaviour.named(event.rule, 1);
        }
        Ok(())
    }
}
