use core::time::Duration;

use firmware_core::robots::rescue::{Config, Rescue};
use firmware_core::{Inspect, Master};
use protocols::avr::{self, ChecksumOrder, Frame};
use protocols::{Decode, Instant, Port};

use super::{BASE, LIDAR, RADIO};
use crate::fuzz::session::step::{Spoil, Step};
use crate::fuzz::session::tape::Tape;
use crate::fuzz::subject::{Behaviour, Violation, size};
use engine::codec::wire::Wire;
use engine::codec::{self, BUS, PCUI, What, XV11};
use engine::rig::line::Direction;

const MS: Duration = Duration::from_millis(1);
const ORDER: ChecksumOrder = ChecksumOrder::LowFirst;
/// Idle time after which a partial frame is discarded: gaps of the radio are shorter than 40 ms,
/// and the program waits for 100 ms.
const IDLE_MS: u32 = 100;
/// A pause that is certainly longer.
const QUIET_MS: u32 = 150;
/// A valid frame of the PC: an order to stop.
const ORDER_TO_STOP: &[u8] = b"PCUI_MSG\x03\x00\x00\x00\x00\x00STA\x00\x00\x00";
/// Number of orders at the end.
const ORDERS: u32 = 40;
/// Maximum number of requests that are answered in a millisecond.
const REQUESTS_MAX: usize = 8;

/// The environment of the program.
pub(super) struct Around<'a> {
    program: Box<Rescue>,
    now: Instant,
    /// The requests to the simulated base, and its registers: it stands still and has a battery of
    /// 12 V.
    requests: avr::Decoder,
    registers: [u8; 256],
    spoils: Vec<Spoil>,
    late: Option<(Instant, Vec<u8>)>,
    /// The last request, and all bytes on its line since then.
    asked: Option<Frame>,
    answers: Vec<u8>,
    answered: u64,
    /// Bytes on each line since its last silence, and numbers of frames before that.
    heard: [Vec<u8>; 3],
    frames: [u64; 3],
    tape: &'a mut Tape,
}

impl<'a> Around<'a> {
    pub(super) fn new(config: Config, tape: &'a mut Tape) -> Self {
        let mut registers = [0; 256];
        // 12000 mV, 90 per cent.
        registers[33..36].copy_from_slice(&[0xE0, 0x2E, 90]);
        Self {
            program: Box::new(Rescue::new(config)),
            now: Instant::ZERO,
            requests: avr::Decoder::new(ORDER),
            registers,
            spoils: Vec::new(),
            late: None,
            asked: None,
            answers: Vec::new(),
            answered: 0,
            heard: [const { Vec::new() }; 3],
            frames: [0; 3],
            tape,
        }
    }

    pub(super) fn live_through(&mut self, steps: &[Step]) -> Result<(), Violation> {
        // The first requests are sent and answered before any damage.
        self.wait(50)?;
        for step in steps {
            match step {
                Step::Wait(ms) => self.wait(*ms)?,
                Step::Reply(spoil) => self.spoils.push(*spoil),
                Step::Send(port, bytes) => self.send(*port, bytes)?,
            }
        }
        self.wait(QUIET_MS)?;
        self.judge_ears()
    }

    /// Checks that the program receives one of many orders, whatever came before: together they
    /// have more bytes than the longest frame.
    fn judge_ears(&mut self) -> Result<(), Violation> {
        let before = self.counter("radio frames");
        for _ in 0..ORDERS {
            self.send(RADIO, ORDER_TO_STOP)?;
        }
        if self.counter("radio frames") == before {
            let detail = format!("none of {ORDERS} orders after a pause was heard");
            return Err(Violation::new("the-radio-is-not-deaf", detail));
        }
        self.wait(QUIET_MS)
    }

    fn wait(&mut self, ms: u32) -> Result<(), Violation> {
        for _ in 0..ms {
            self.now += MS;
            if let Some((_, bytes)) = self.late.take_if(|(at, _)| *at <= self.now) {
                self.reply(&bytes)?;
            }
            self.program.poll(self.now);
            // Bytes that were held back by a damaged count may be taken as an answer only now.
            self.judge_answer()?;
            self.serve()?;
            // As many bytes as the line transmits in this time.
            let mut buf = [0; 46];
            let len = self.program.transmit(Rescue::RADIO, &mut buf);
            self.tape
                .note(RADIO, self.now, Direction::ToDevice, &buf[..len]);
            self.program.transmit(Rescue::MOTOR, &mut buf);
        }
        self.judge_memory(|| "in a pause".to_owned())?;
        if ms >= IDLE_MS {
            self.judge_frames()?;
        }
        Ok(())
    }

    /// Answers the program's requests.
    fn serve(&mut self) -> Result<(), Violation> {
        for _ in 0..REQUESTS_MAX {
            let mut buf = [0; 64];
            let len = self.program.transmit(Rescue::BASE, &mut buf);
            if len == 0 {
                break;
            }
            self.tape
                .note(BASE, self.now, Direction::ToDevice, &buf[..len]);
            let requests: Vec<Frame> = self.requests.push(&buf[..len]).flatten().collect();
            for request in requests {
                self.answers.clear();
                self.answer(&request)?;
            }
        }
        Ok(())
    }

    fn answer(&mut self, request: &Frame) -> Result<(), Violation> {
        self.asked = Some(*request);
        let register = request.register();
        let count = usize::from(request.count());
        let reply = if request.is_write() {
            Frame::read(register, 0, ORDER)
        } else {
            let from = usize::from(register);
            let data: Vec<u8> = (from..from + count)
                .map(|at| self.registers[at % 256])
                .collect();
            Frame::write(register, &data, ORDER)
        };
        let spoil = (!self.spoils.is_empty()).then(|| self.spoils.remove(0));
        let mut bytes = reply.as_bytes().to_vec();
        match spoil {
            None => {}
            Some(Spoil::Late(ms)) => {
                self.late = Some((self.now + MS * u32::from(ms), bytes));
                return Ok(());
            }
            Some(spoil) => spoilt(&mut bytes, spoil),
        }
        self.reply(&bytes)
    }

    fn reply(&mut self, bytes: &[u8]) -> Result<(), Violation> {
        if bytes.is_empty() {
            return Ok(());
        }
        self.now += Duration::from_micros(100);
        self.receive(BASE, bytes)
    }

    fn send(&mut self, port: usize, bytes: &[u8]) -> Result<(), Violation> {
        if bytes.is_empty() {
            return Ok(());
        }
        self.receive(port, bytes)?;
        self.serve()
    }

    fn receive(&mut self, port: usize, bytes: &[u8]) -> Result<(), Violation> {
        self.tape.note(port, self.now, Direction::ToMaster, bytes);
        self.heard[port].extend(bytes);
        let is_base = port == BASE;
        if is_base {
            self.answers.extend(bytes);
        }
        let ports = [Rescue::LIDAR, Rescue::BASE, Rescue::RADIO];
        let port_of: Port = ports[port];
        self.program.receive(port_of, self.now, bytes);
        if is_base {
            self.judge_answer()?;
        }
        self.judge_memory(|| words_of(port, bytes))
    }

    /// Checks that the program has neither ended nor written beyond its buffers.
    fn judge_memory(&self, when: impl Fn() -> String) -> Result<(), Violation> {
        if self.program.is_dead() {
            let detail = format!("it ended at {} s, {}", self.now, when());
            return Err(Violation::new("the-program-goes-on", detail));
        }
        let mut found = Ok(());
        self.program.stray_writes(&mut |buffer, stray| {
            found = Err(Violation::new(
                format!("writes-stay-in-their-buffers: {buffer}"),
                format!(
                    "{} writes beside the {buffer}, from element {} to {}, {}",
                    stray.count,
                    stray.first,
                    stray.last,
                    when()
                ),
            ));
        });
        found
    }

    /// Checks each accepted answer: register, direction and count must match the request.
    fn judge_answer(&mut self) -> Result<(), Violation> {
        let answered = self.counter("base answers");
        let before = core::mem::replace(&mut self.answered, answered);
        let Some(asked) = self.asked.as_ref().filter(|_| answered > before) else {
            return Ok(());
        };
        let count = if asked.is_write() {
            0
        } else {
            0x80 | asked.count()
        };
        let fits = |frame: &[u8]| {
            codec::Avr::<codec::LowFirst>::frame_at(frame).is_some()
                && [frame[1], frame[2]] == [asked.register(), count]
        };
        let mut starts = 0..self.answers.len();
        if starts.any(|start| fits(&self.answers[start..])) {
            return Ok(());
        }
        let kind = if asked.is_write() {
            "a write"
        } else {
            "a read"
        };
        Err(Violation::new(
            format!("an-answer-fits-its-question: {kind}"),
            format!(
                "{:02X?} was taken for the answer to {:02X?}",
                self.answers,
                asked.as_bytes()
            ),
        ))
    }

    /// Checks that the program received every frame on the lines, and no other frame.
    fn judge_frames(&mut self) -> Result<(), Violation> {
        self.frames[RADIO] += frames::<codec::Pcui>(&self.heard[RADIO]);
        self.frames[LIDAR] += frames::<codec::Xv11>(&self.heard[LIDAR]);
        self.heard = [const { Vec::new() }; 3];
        let radio = self.counter("radio frames");
        if radio != self.frames[RADIO] {
            let sent = self.frames[RADIO];
            let cause = if radio < sent {
                "radio-frames-are-heard"
            } else {
                "radio-frames-were-sent"
            };
            let detail = format!("{sent} frames on the line, {radio} heard");
            return Err(Violation::new(cause, detail));
        }
        let lidar = self.counter("lidar packets");
        if lidar != self.frames[LIDAR] {
            let sent = self.frames[LIDAR];
            let cause = if lidar < sent {
                "lidar-packets-are-heard"
            } else {
                "lidar-packets-were-sent"
            };
            let detail = format!("{sent} packets on the line, {lidar} heard");
            return Err(Violation::new(cause, detail));
        }
        Ok(())
    }

    fn counter(&self, name: &str) -> u64 {
        let mut found = 0;
        self.program.counters(&mut |known, value| {
            if known == name {
                found = value;
            }
        });
        found
    }

    /// Records the behaviour of the program.
    pub(super) fn note(&self, behaviour: &mut Behaviour) {
        self.program
            .counters(&mut |name, count| behaviour.named(name, count));
        behaviour.named(Inspect::mode(&*self.program), 1);
        behaviour.note(&[size(self.program.waypoints().all().len() as u64)]);
    }
}

/// The number of frames in `bytes`, according to the slow reference decoder.
fn frames<W: Wire>(bytes: &[u8]) -> u64 {
    let (mut at, mut count) = (0, 0);
    while at < bytes.len() {
        match W::frame_at(&bytes[at..]) {
            Some(len) => (at, count) = (at + len, count + 1),
            None => at += 1,
        }
    }
    count
}

/// Damages a reply.
fn spoilt(bytes: &mut Vec<u8>, spoil: Spoil) {
    let register = bytes[1];
    let made = |frame: Frame| frame.as_bytes().to_vec();
    match spoil {
        Spoil::Nothing | Spoil::Late(_) => bytes.clear(),
        Spoil::Acknowledged => *bytes = made(Frame::read(register, 0, ORDER)),
        Spoil::Error => *bytes = made(Frame::read(avr::ERROR_REGISTER, 0, ORDER)),
        Spoil::Count(control) if control < 0x80 => {
            *bytes = made(Frame::read(register, control, ORDER));
        }
        Spoil::Count(control) => {
            let mut data = bytes[3..bytes.len() - 2].to_vec();
            data.resize(usize::from(control & 0x7F), 0);
            *bytes = made(Frame::write(register, &data, ORDER));
        }
        Spoil::Register(register) => {
            bytes[1] = register;
            codec::Avr::<codec::LowFirst>::repair(bytes);
        }
        Spoil::Flip(byte, bit) => {
            let at = usize::from(byte) % bytes.len();
            bytes[at] ^= 1 << (bit % 8);
        }
        Spoil::Cut(len) => bytes.truncate(usize::from(len)),
        Spoil::Twice => {
            let again = bytes.clone();
            bytes.extend(again);
        }
    }
}

/// Maximum number of displayed characters of the last message.
const WORDS_MAX: usize = 100;

/// The last message in words.
fn words_of(port: usize, bytes: &[u8]) -> String {
    let codec = [&XV11, &BUS, &PCUI][port];
    let words = codec
        .found(bytes)
        .into_iter()
        .map(|found| match found.what {
            What::Frame(words) => words,
            What::Bad(_) => "bytes of no frame".to_owned(),
        });
    let words = words.collect::<Vec<_>>().join("; ");
    let shown: String = words.chars().take(WORDS_MAX).collect();
    let more = if shown.len() < words.len() { ".." } else { "" };
    format!("at {shown}{more}")
}
