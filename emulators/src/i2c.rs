//! Chips with registers on an I2C bus, each as a device of its own.
//!
//! ```text
//! write   | address u7, 0 | register | data ... |       no data: the register to read from
//! read    | address u7, 1 | count |                  -> | count bytes |
//! ```
//!
//! A message of the link is a transaction. In a read a real master clocks as many bytes as it
//! wants; here the message states the number. A chip that does not acknowledge does not answer.
//!
//! For a master outside the rig, a terminal may merge or split messages. Such a master puts each
//! message into a frame, and each frame gets an answer:
//!
//! ```text
//! frame   | 01 | length | message |
//! answer  | 01 | status | length | bytes |       status 0: acknowledged, 1: not
//! ```
//!
//! A microcontroller clocks byte by byte, so the number of bytes is known only at the end. It sends
//! a request at the beginning of a transaction and reports its end. A register pointer moves by the
//! bytes taken.
//!
//! ```text
//! begin   | 02 | 2 | address u7, direction | most |
//! answer  | 02 | status | length | bytes |            no bytes of a write or a busy chip
//! end     | 03 | length | address u7, 0 | register | data ... |            no answer
//! end     | 04 | 1 | bytes that were taken |                               no answer
//! ```
//!
//! No message begins with 01 to 04: addresses that the standard reserves.

use core::time::Duration;
use std::collections::VecDeque;

use protocols::{Instant, LineConfig, Port};

use crate::device::{BrokenRules, Device, Event, earliest};
use crate::event_log::EventLog;
use crate::world::World;

/// Messages that wait at most; further ones are lost.
const QUEUE_MAX: usize = 16;
/// From the end of a request to the beginning of the answer: a bus does not wait.
const LATENCY: Duration = Duration::from_micros(5);
/// Rate of the bus.
const BUS: LineConfig = LineConfig::new_8n1(100_000);
/// Rate of answers to a microcontroller, which keeps the times of the bus by itself.
const AT_ONCE: LineConfig = LineConfig::new_8n1(10_000_000);
/// First byte of a frame.
const FRAME: u8 = 0x01;
/// A microcontroller's transaction begins.
const BEGIN: u8 = 0x02;
/// The transaction ends: the written bytes.
const END_WRITE: u8 = 0x03;
/// The transaction ends: the number of bytes read.
const END_READ: u8 = 0x04;
/// All chips receive a write to this address, and none answers a read.
const GENERAL_CALL: u8 = 0x00;

/// A chip whose master reads and writes registers. The register counts up within a transaction.
///
/// Time never runs backwards between calls. The world is that of the call's `now`. Answers must
/// depend on the chip's model alone, not on how often the chip is called.
pub trait RegisterChip: Clone {
    /// Whether the chip acknowledges the first byte of a transaction, `address` without the lowest
    /// bit.
    fn acknowledges(&self, now: Instant, address: u8) -> bool;

    /// Takes `data` for the registers from `register` on; never empty.
    fn write(&mut self, now: Instant, register: u8, data: &[u8], world: &World);

    /// Fills `data` from the registers from `register` on; missing registers read 0.
    fn read(&mut self, now: Instant, register: u8, data: &mut [u8], world: &World);

    /// First register of the next read after `count` bytes from `register` on.
    fn next_register(&self, register: u8, count: u8) -> u8 {
        register.wrapping_add(count)
    }

    /// Whether the chip is present but busy: a master that reads from `address` gets no
    /// acknowledge, and all ones.
    fn is_busy(&self, _now: Instant, _address: u8) -> bool {
        false
    }

    /// As [`Device::known_faults`].
    fn known_faults(&self) -> &'static [&'static str];

    /// As [`Device::set_fault`].
    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool);

    /// Log for the master's mistakes.
    fn log(&mut self) -> &mut Log;
}

/// A chip's log.
#[derive(Clone, Debug, Default)]
pub struct Log(pub(crate) EventLog);

/// A chip that is alone on its bus.
#[derive(Clone, Debug)]
pub struct OnBus<C> {
    chip: C,
    /// Start of the next read.
    register: u8,
    requests: VecDeque<(Instant, Vec<u8>, Framing)>,
    /// Bytes of an incomplete frame.
    begun: Vec<u8>,
    answers: VecDeque<Vec<u8>>,
    line: LineConfig,
    /// Time at which the chip's log next updates a count.
    told_at: Option<Instant>,
    broken: BrokenRules,
}

/// Whether a message came in a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Framing {
    Plain,
    Framed,
    /// A transaction that has begun.
    Begun,
    /// The end of one that wrote.
    Written,
    /// The end of one that read.
    Taken,
}

impl Framing {
    fn of(first: u8) -> Option<Self> {
        match first {
            FRAME => Some(Self::Framed),
            BEGIN => Some(Self::Begun),
            END_WRITE => Some(Self::Written),
            END_READ => Some(Self::Taken),
            _ => None,
        }
    }
}

/// The registers of a transaction that begins with `from`: behind FF comes 00.
pub(crate) fn registers(from: u8) -> impl Iterator<Item = u8> {
    (from..=u8::MAX).chain((0..=u8::MAX).cycle())
}

impl<C: RegisterChip> OnBus<C> {
    /// The bus.
    pub const BUS: Port = Port(0);

    /// `chip` on a bus of 100 kbit/s.
    pub fn new(chip: C) -> Self {
        Self {
            chip,
            register: 0,
            requests: VecDeque::new(),
            begun: Vec::new(),
            answers: VecDeque::new(),
            line: BUS,
            told_at: None,
            broken: BrokenRules::default(),
        }
    }

    /// The chip.
    pub const fn chip(&self) -> &C {
        &self.chip
    }

    /// Executes a transaction; returns the bytes read, `None` without an acknowledge.
    fn obey(&mut self, now: Instant, message: &[u8], world: &World) -> Option<Vec<u8>> {
        let (&address, rest) = message.split_first()?;
        let count = rest.first().copied().unwrap_or(0);
        let reads = address & 1 != 0;
        if reads && self.chip.is_busy(now, address & 0xFE) {
            return Some(vec![0xFF; usize::from(count)]);
        }
        let is_nobodys = reads && address & 0xFE == GENERAL_CALL;
        if is_nobodys || !self.chip.acknowledges(now, address & 0xFE) {
            return None;
        }
        let mut read = Vec::new();
        if reads {
            read.resize(usize::from(count), 0);
            if count > 0 {
                self.chip.read(now, self.register, &mut read, world);
            }
            self.register = self.chip.next_register(self.register, count);
        } else if let [register, data @ ..] = rest {
            self.register = *register;
            if !data.is_empty() {
                self.chip.write(now, *register, data, world);
            }
        }
        Some(read)
    }

    /// Bytes that a microcontroller would read in a transaction that begins now; the register
    /// stays.
    fn begin(&mut self, now: Instant, message: &[u8], world: &World) -> Option<Vec<u8>> {
        let (&address, rest) = message.split_first()?;
        let register = self.register;
        let is_busy = self.chip.is_busy(now, address & 0xFE);
        let chosen = match address & 1 == 0 {
            true => self.chip.acknowledges(now, address).then(Vec::new),
            false if is_busy => None,
            false => self.obey(now, &[address, *rest.first()?], world),
        };
        self.register = register;
        chosen
    }

    /// Executes a message and answers it.
    fn serve(&mut self, now: Instant, message: &[u8], framing: Framing, world: &World) {
        match framing {
            Framing::Plain | Framing::Framed => {
                let read = self.obey(now, message, world);
                self.answer(read, framing);
            }
            Framing::Begun => {
                let read = self.begin(now, message, world);
                self.answer(read, framing);
            }
            Framing::Written => drop(self.obey(now, message, world)),
            Framing::Taken => {
                let count = message.first().copied().unwrap_or(0);
                self.register = self.chip.next_register(self.register, count);
            }
        }
    }

    fn answer(&mut self, read: Option<Vec<u8>>, framing: Framing) {
        let (first, line) = match framing {
            Framing::Begun => (BEGIN, AT_ONCE),
            _ => (FRAME, BUS),
        };
        self.line = line;
        let read = match framing {
            Framing::Plain => read.unwrap_or_default(),
            _ => {
                let status = u8::from(read.is_none());
                let read = read.unwrap_or_default();
                let len = u8::try_from(read.len()).unwrap_or(u8::MAX);
                [&[first, status, len], &read[..]].concat()
            }
        };
        if !read.is_empty() {
            self.answers.push_back(read);
        }
    }

    /// Takes the messages out of the frames that are there.
    fn unframe(&mut self, at: Instant) {
        while let [first, rest @ ..] = &self.begun[..] {
            let Some(framing) = Framing::of(*first) else {
                // Damage has torn the message, so the start of the next one is unknown.
                return self.begun.clear();
            };
            let Some((&len, rest)) = rest.split_first() else {
                return;
            };
            let Some(message) = rest.get(..usize::from(len)) else {
                return;
            };
            let message = message.to_vec();
            self.begun.drain(..2 + usize::from(len));
            self.queue(at, message, framing);
        }
    }

    fn queue(&mut self, at: Instant, message: Vec<u8>, framing: Framing) {
        if self.requests.len() < QUEUE_MAX {
            self.requests.push_back((at, message, framing));
        }
    }
}

impl<C: RegisterChip> Device for OnBus<C> {
    fn receive(&mut self, _port: Port, now: Instant, bytes: &[u8]) {
        let at = now + LATENCY;
        let is_framed = bytes
            .first()
            .is_some_and(|first| Framing::of(*first).is_some());
        if !self.begun.is_empty() || is_framed {
            self.begun.extend(bytes);
            self.unframe(at);
        } else {
            self.queue(at, bytes.to_vec(), Framing::Plain);
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        while let Some(request) = self.requests.pop_front_if(|(at, ..)| *at <= now) {
            let (_, message, framing) = request;
            self.serve(now, &message, framing, world);
        }
        let log = &mut self.chip.log().0;
        log.poll(now);
        self.told_at = log.poll_at();
    }

    fn transmit(&mut self, _port: Port, buf: &mut [u8]) -> usize {
        let Some(answer) = self.answers.pop_front() else {
            return 0;
        };
        let len = answer.len().min(buf.len());
        buf[..len].copy_from_slice(&answer[..len]);
        len
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest([self.requests.front().map(|(at, ..)| *at), self.told_at])
    }

    fn line_config(&self, _port: Port) -> LineConfig {
        self.line
    }

    fn known_faults(&self) -> &'static [&'static str] {
        self.chip.known_faults()
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        self.chip.set_fault(now, fault, figure, begins);
    }

    fn take_events(&mut self) -> Vec<Event> {
        let log = &mut self.chip.log().0;
        if log.broken().seen() != self.broken.seen() {
            self.broken = log.broken().clone();
        }
        log.take()
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        Some(&self.broken)
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;
    use crate::mpu6050::{Mpu6050, Mpu6050Config};
    use crate::srf08::{Srf08, Srf08Config};
    use crate::world::{BodyConfig, Fixture, Pose, Scene};

    fn transact(mut device: impl Device, messages: &[Vec<u8>]) -> usize {
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let mut world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
        let mut buf = [0; 300];
        let (mut now, mut answered) = (Instant::ZERO, 0);
        for message in messages {
            device.receive(Port(0), now, message);
            now += Duration::from_millis(70);
            device.poll(now, &mut world);
            answered += device.transmit(Port(0), &mut buf);
        }
        answered
    }

    #[test]
    fn registers_begin_anew_behind_the_last() {
        let found: Vec<_> = registers(0xFE).take(4).collect();
        assert_eq!(found, [0xFE, 0xFF, 0x00, 0x01]);
    }

    /// The power register, which reads 40 in a sleeping chip, lies behind 6A: a read from there on
    /// continues with it.
    #[test]
    fn a_read_goes_on_where_the_last_one_ended() {
        let chip = Mpu6050::new(Mpu6050Config::default(), 1, "test");
        let messages = [vec![0xD0, 0x6A], vec![0xD1, 1], vec![0xD1, 1]];
        let mut device = OnBus::new(chip);
        assert_eq!(transact(device.clone(), &messages), 2);
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let mut world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
        for message in messages {
            device.receive(Port(0), Instant::ZERO, &message);
        }
        device.poll(Instant::from_millis(1), &mut world);
        assert_eq!(device.answers, [[0x00], [0x40]]);
    }

    /// A microcontroller asks for up to eight registers from 6A on and takes two. The next one
    /// begins at 6C; the power register 6B, of a chip that sleeps, reads 40.
    #[test]
    fn a_transaction_moves_the_register_by_what_was_taken() {
        let chip = Mpu6050::new(Mpu6050Config::default(), 1, "test");
        let mut device = OnBus::new(chip);
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let mut world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
        let messages: [&[u8]; 7] = [
            &[0x02, 2, 0xD0, 0],
            &[0x03, 2, 0xD0, 0x6A],
            &[0x02, 2, 0xD1, 2],
            &[0x04, 1, 1],
            &[0x02, 2, 0xD1, 1],
            // No chip has this address.
            &[0x02, 2, 0x66, 0],
            &[0x04, 1, 0],
        ];
        for message in messages {
            device.receive(Port(0), Instant::ZERO, message);
        }
        device.poll(Instant::from_millis(1), &mut world);
        let expected: [&[u8]; 4] = [
            &[0x02, 0, 0],
            &[0x02, 0, 2, 0x00, 0x40],
            &[0x02, 0, 1, 0x40],
            &[0x02, 1, 0],
        ];
        assert_eq!(device.answers, expected);
    }

    /// An answer comes 5 us behind its request; of 17 requests at once the last is lost.
    #[test]
    fn a_bus_is_slow_and_its_queue_is_short() {
        let mut device = OnBus::new(Srf08::new(Srf08Config::default(), 1, "test"));
        assert_eq!(device.poll_at(), None);
        let now = Instant::from_millis(1);
        for _ in 0..17 {
            device.receive(Port(0), now, &[0xE1, 1]);
        }
        assert_eq!(device.poll_at(), Some(now + Duration::from_micros(5)));
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let mut world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
        device.poll(now + Duration::from_micros(4), &mut world);
        assert_eq!(device.answers.len(), 0);
        device.poll(now + Duration::from_micros(5), &mut world);
        assert_eq!(device.answers.len(), 16);
    }

    /// A request for no bytes gets no answer; a buffer of two takes two of three bytes.
    #[test]
    fn an_answer_is_as_long_as_asked_for() {
        let ranger = || OnBus::new(Srf08::new(Srf08Config::default(), 1, "test"));
        assert_eq!(transact(ranger(), &[vec![0xE1, 0]]), 0);
        assert_eq!(transact(ranger(), &[vec![0xE1, 3]]), 3);
        let mut device = ranger();
        device.answers.push_back(vec![1, 2, 3]);
        let mut buf = [0; 2];
        assert_eq!(device.transmit(Port(0), &mut buf), 2);
        assert_eq!(buf, [1, 2]);
    }

    /// Messages that a terminal ran together, and one that it tore: each has its answer. A chip
    /// that is not there acknowledges nothing; a message without a frame is handled as usual.
    #[test]
    fn f17_frames_keep_messages_apart() {
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let mut world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
        let mut device = OnBus::new(Mpu6050::new(Mpu6050Config::default(), 1, "test"));
        let all = [
            &[0x01, 3, 0xD0, 0x6B, 0x00][..],
            &[0x01, 3, 0xD0, 0x19, 0x07],
            &[0x01, 2, 0xD0, 0x19],
            &[0x01, 2, 0xD1, 1],
            &[0x01, 2, 0xE1, 1],
            &[0x01, 2, 0xD0, 0x75],
            &[0x01, 2, 0xD1, 1],
        ]
        .concat();
        for (index, piece) in (0_u64..).zip(all.chunks(9)) {
            device.receive(Port(0), Instant::from_millis(index), piece);
        }
        device.poll(Instant::from_millis(100), &mut world);
        let acknowledged = vec![0x01, 0, 0];
        let expected = [
            acknowledged.clone(),
            acknowledged.clone(),
            acknowledged.clone(),
            vec![0x01, 0, 1, 0x07],
            vec![0x01, 1, 0],
            acknowledged,
            vec![0x01, 0, 1, 0x68],
        ];
        assert_eq!(device.answers, expected);
    }

    /// The bus passes faults to the chip, and the chip's events come out of the bus.
    #[test]
    fn a_bus_passes_on_faults_and_events() {
        let mut device = OnBus::new(Srf08::new(Srf08Config::default(), 1, "test"));
        assert_eq!(device.known_faults(), device.chip().known_faults());
        assert_eq!(device.line_config(Port(0)), LineConfig::new_8n1(100_000));
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let mut world = World::new(scene, BodyConfig::default(), Pose::default(), 1).unwrap();
        device.receive(Port(0), Instant::ZERO, &[0xE0, 0, 0x77]);
        device.poll(Instant::from_millis(1), &mut world);
        let rules: Vec<_> = device.take_events().iter().map(|it| it.rule).collect();
        assert_eq!(rules, ["unknown-command"]);
        device.set_fault(Instant::from_millis(1), "off", None, true);
        assert!(!device.chip().acknowledges(Instant::from_millis(1), 0xE0));
    }

    proptest! {
        #[test]
        fn no_transaction_makes_a_chip_panic(
            messages in vec(
                (prop_oneof![Just(0xD0_u8), Just(0xD1), Just(0xE0), Just(0xE1), any::<u8>()],
                 vec(any::<u8>(), 0..20))
                .prop_map(|(address, rest)| [vec![address], rest].concat()),
                0..30,
            ),
        ) {
            let imu = Mpu6050::new(Mpu6050Config::default(), 1, "test");
            transact(OnBus::new(imu), &messages);
            let ranger = Srf08::new(Srf08Config::default(), 1, "test");
            transact(OnBus::new(ranger), &messages);
        }
    }
}
