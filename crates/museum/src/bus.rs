//! The master's side of the register bus.

use core::time::Duration;

use firmware_core::base_link::{BaseLink, Outcome, Request};
use protocols::Instant;
use protocols::avr::{ChecksumOrder, Frame};
use protocols::pcui::message::Message;
use protocols::{Decode, pcui};

use super::robot::{MS, Robot, config};
use super::{Bug, Observation, Variant};
use engine::codec::{BUS_HIGH_FIRST, PCUI};

const MASTER: &str = "robot's program, bus";

pub(super) const ROWS: [Bug; 10] = [
    Bug::mutant(
        "MA-01",
        MASTER,
        "every valid reply writes a byte of its checksum one past the reader's buffer",
        ma_01,
    ),
    Bug::mutant(
        "MA-02",
        MASTER,
        "a reply with a count damaged to 126 writes 117 bytes behind a buffer of 10",
        ma_02,
    ),
    Bug::mutant(
        "MA-03",
        MASTER,
        "a reply of 127 bytes wraps the counter: writes below the buffer",
        ma_03,
    ),
    Bug::mutant(
        "MA-04",
        MASTER,
        "a reply of two bytes to a read of ten is accepted; the other bytes keep old values",
        ma_04,
    ),
    Bug::mutant(
        "MA-05",
        MASTER,
        "an acknowledgement is taken for data: the pose jumps",
        ma_05,
    ),
    Bug::mutant(
        "MA-06",
        MASTER,
        "a frame without a waiting reader is written to the buffer of a finished read",
        ma_06,
    ),
    Bug::mutant(
        "MA-07",
        MASTER,
        "the master does not notice a base that stays silent",
        ma_07,
    ),
    Bug::mutant(
        "MA-08",
        MASTER,
        "the read of the battery interrupts the read of the encoders: answers get mixed",
        ma_08,
    ),
    Bug::mutant(
        "MA-09",
        MASTER,
        "before the first answer the battery counts as empty: a false warning",
        ma_09,
    ),
    Bug::mutant(
        "MA-10",
        MASTER,
        "20 ticks in 40 ms are reported as 2 mm/s",
        ma_10,
    ),
];

const WHEELS: Request = Request::read(36, 10);
const BATTERY: Request = Request::read(33, 3);
/// The fielded base's answer to a read of the wheels: left 0x01020304, right -2.
const REPLY: [u8; 15] = [
    0xAB, 0x24, 0x8A, 0x04, 0x03, 0x02, 0x01, 0xFE, 0xFF, 0xFF, 0xFF, 0x14, 0xEC, 0x06, 0x5E,
];

/// The link, and the base's side of the wire.
struct Line {
    link: BaseLink,
    now: Instant,
    seen: Observation,
    requests: usize,
}

impl Line {
    fn new(variant: Variant, id: &str) -> Self {
        let defects = config(variant, id).defects.base;
        let timeout = Duration::from_millis(5);
        Self {
            link: BaseLink::with_defects(ChecksumOrder::HighFirst, timeout, defects),
            now: Instant::ZERO,
            seen: Observation::default(),
            requests: 0,
        }
    }

    fn submit(&mut self, request: Request) {
        self.now += Duration::from_millis(50);
        self.link.submit(self.now, request);
        self.transmit();
    }

    fn transmit(&mut self) {
        let mut buf = [0; 64];
        let len = self.link.transmit(&mut buf);
        if len > 0 {
            self.seen.bytes("master", &BUS_HIGH_FIRST, &buf[..len]);
            self.requests += 1;
        }
    }

    fn reply(&mut self, bytes: &[u8]) {
        self.now += Duration::from_micros(250);
        self.seen.bytes("base", &BUS_HIGH_FIRST, bytes);
        self.link.receive(self.now, bytes);
        self.transmit();
    }

    /// The left encoder from the reply to the read in flight; `None` without a reply.
    fn left(&mut self) -> Option<i32> {
        let done = self.link.take_completion()?;
        let left = match done.outcome {
            Outcome::Data(data) => i32::from_le_bytes(*data.first_chunk()?),
            Outcome::Written | Outcome::Failed => return None,
        };
        Some(left)
    }

    /// Sends a request and its reply; returns the left encoder.
    fn ask(&mut self, request: Request, reply: &[u8]) -> Option<i32> {
        self.submit(request);
        self.reply(reply);
        self.left()
    }

    fn stray(mut self, expected: [i32; 2]) -> Observation {
        let stray = self.link.stray_writes();
        self.seen.figure("writes beside the buffer", stray.count);
        let place = match stray.count {
            0 => "nowhere".to_owned(),
            _ => stray.first.to_string(),
        };
        self.seen.figure("the first to offset", place);
        let [count, first] = expected;
        let shows = i64::from(stray.count) == i64::from(count) && stray.first == first;
        self.seen.judged(shows)
    }
}

fn ma_01(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-01");
    line.ask(WHEELS, &REPLY);
    line.stray([1, 10])
}

/// 126 bytes and the first byte of the checksum: 117 of them beyond the ten expected.
fn ma_02(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-02");
    line.ask(
        WHEELS,
        Frame::write(36, &[7; 126], ChecksumOrder::HighFirst).as_bytes(),
    );
    line.stray([117, 10])
}

fn ma_03(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-03");
    line.ask(
        WHEELS,
        Frame::write(36, &[7; 127], ChecksumOrder::HighFirst).as_bytes(),
    );
    line.stray([1, -128])
}

fn note_left(line: &mut Line, left: Option<i32>) {
    let told = left.map_or("none, the read goes on".to_owned(), |left| {
        format!("{left:#010x}")
    });
    line.seen.figure("left encoder", told);
}

fn ma_04(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-04");
    line.ask(WHEELS, &REPLY);
    let left = line.ask(WHEELS, &[0xAB, 0x24, 0x82, 0x09, 0x09, 0x01, 0x63]);
    note_left(&mut line, left);
    line.seen.judged(left == Some(0x0102_0909))
}

/// The buffer last held the battery's bytes: 12000 mV, 90 per cent.
fn ma_05(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-05");
    line.ask(WHEELS, &REPLY);
    let battery = Frame::write(33, &[0xE0, 0x2E, 90], ChecksumOrder::HighFirst);
    line.ask(BATTERY, battery.as_bytes());
    let left = line.ask(WHEELS, &[0xAB, 0x24, 0x00, 0x00, 0xCF]);
    note_left(&mut line, left);
    line.seen.judged(left == Some(0x015A_2EE0))
}

/// Three bytes of data, and the first byte of the checksum.
fn ma_06(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-06");
    line.ask(WHEELS, &REPLY);
    line.reply(Frame::write(36, &[0xDE, 0xAD, 0xBE], ChecksumOrder::HighFirst).as_bytes());
    line.stray([4, 0])
}

fn ma_07(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-07");
    for _ in 0..4 {
        line.submit(WHEELS);
        for _ in 0..3 {
            line.now += 5 * MS;
            line.link.tick(line.now);
            line.transmit();
        }
    }
    let (failures, silent) = (line.link.counters().failures, line.link.is_silent());
    line.seen.figure("reads given up", failures);
    line.seen.figure("the base counts as silent", silent);
    line.seen.judged(failures == 4 && !silent)
}

fn ma_08(variant: Variant) -> Observation {
    let mut line = Line::new(variant, "MA-08");
    line.submit(WHEELS);
    line.link.submit(line.now + MS, BATTERY);
    line.transmit();
    let requests = line.requests;
    line.seen
        .figure("requests before the first answer", requests);
    line.reply(&REPLY);
    let strangers = line.link.counters().unsolicited;
    line.seen
        .figure("good answers without a request", strangers);
    line.seen.judged(requests == 2 && strangers == 1)
}

fn ma_09(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "MA-09");
    let battery = robot.program.battery();
    let told = battery.map_or("unknown".to_owned(), |b| format!("{} %", b.percent));
    robot.seen.figure("battery before the first answer", told);
    robot.judged(battery.is_some_and(|battery| battery.percent == 0))
}

/// Registers 44 and 45 are the measured speeds.
fn ma_10(variant: Variant) -> Observation {
    let mut robot = Robot::new(variant, "MA-10");
    robot.registers[44..46].fill(20);
    robot.run(500 * MS);
    let mut decoder = pcui::Decoder::default();
    let frames: Vec<_> = decoder.push(&robot.radio).flatten().collect();
    let mut states = frames.iter().filter(|frame| frame.id() == *b"STA");
    let mut speed = 0;
    if let Some(frame) = states.next_back() {
        robot.seen.bytes("robot", &PCUI, frame.as_bytes());
        if let Ok(Message::State(state)) = frame.message() {
            speed = state.speed_mm_s[0];
        }
    }
    robot.seen.figure("speed of the left wheel, mm/s", speed);
    robot.judged(speed == 2)
}
