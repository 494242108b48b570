//! The receiving end of the bus: bytes with their times become requests.
//!
//! Two receivers, chosen by [`ReceiverKind`]. The fielded one is a state machine in the receive
//! interrupt that never looks back:
//!
//! ```text
//! WAIT -AB-> REGISTER -> COUNT -+-> CHECKSUM -> CHECKSUM -> request, deaf until it is answered
//!                               +-> DATA x N -^      any state but WAIT: given up when quiet
//! ```
//!
//! The other keeps misread bytes and searches them again, so that a stray start byte costs nothing.

use core::time::Duration;

use protocols::avr::{self, ChecksumOrder};
use protocols::{Decode, FrameError, Instant};

use super::journal::{Journal, rules};
use super::memory::Memory;
use super::profile::{Quirks, ReceiverKind};
use super::request::Request;
use super::ticks::{DIVIDER, Ticks};

/// Result of received bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Heard {
    /// A request is complete.
    Request(Request),
    /// The receiver wrote over the memory below its buffer, and the processor ran away.
    Crash,
}

/// Bytes inside a frame that follow later than this are reported: the fielded firmware loses one
/// frame in 25 for each millisecond.
const GAP_REPORTED: Duration = Duration::from_millis(1);

/// The receiver of either kind.
#[derive(Clone, Debug)]
pub(super) enum Receiver {
    Interrupt(Interrupt),
    Buffered(Buffered),
}

impl Receiver {
    pub(super) fn new(quirks: &Quirks) -> Self {
        match quirks.receiver {
            ReceiverKind::Interrupt => Self::Interrupt(Interrupt::new(quirks.checksum)),
            ReceiverKind::Buffered { idle_gap, .. } => {
                Self::Buffered(Buffered::new(quirks.checksum, idle_gap))
            }
        }
    }

    /// Whether no frame has begun.
    pub(super) fn is_waiting(&self) -> bool {
        match self {
            Self::Interrupt(receiver) => receiver.frame.is_empty(),
            Self::Buffered(receiver) => receiver.decoder.pending() == 0,
        }
    }

    /// Additional work of the receive interrupt for `byte`.
    pub(super) fn work(&self, byte: u8) -> Duration {
        match self {
            Self::Interrupt(receiver) => receiver.work(byte),
            Self::Buffered(_) => Duration::ZERO,
        }
    }

    /// Receives a byte that ended at `at` and adds its result to `heard`. The fielded receiver
    /// stores the data of a write in `memory` at once, if given.
    pub(super) fn byte(
        &mut self,
        at: Instant,
        byte: u8,
        memory: Option<&mut Memory>,
        journal: &mut Journal,
        heard: &mut Vec<Heard>,
    ) {
        match self {
            Self::Interrupt(receiver) => heard.extend(receiver.byte(at, byte, memory, journal)),
            Self::Buffered(receiver) => receiver.byte(at, byte, journal, heard),
        }
    }

    /// Time at which an unfinished frame is discarded if no byte follows.
    pub(super) fn deadline(&self, divider: Divider) -> Option<Instant> {
        match self {
            Self::Interrupt(receiver) => receiver.deadline(divider),
            Self::Buffered(receiver) => receiver.deadline(),
        }
    }

    /// Discards the unfinished frame at its deadline; adds the frames that it hid to `heard`.
    pub(super) fn expire(&mut self, at: Instant, journal: &mut Journal, heard: &mut Vec<Heard>) {
        match self {
            Self::Interrupt(receiver) => receiver.give_up(at, journal),
            Self::Buffered(receiver) => receiver.give_up(at, journal, heard),
        }
    }
}

/// The divider that ends unfinished frames, as the fielded receiver sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Divider {
    pub(super) ticks: Ticks,
    /// Start of the main loop, which checks the result.
    pub(super) main_loop_from: Instant,
}

/// Delay until the main loop checks the expired count; a byte in between saves the frame. Shortest
/// measured time to the loss of a frame: 0.113 ms.
const MAIN_LOOP_PASS: Duration = Duration::from_micros(100);
/// Longest usable count of the fielded receiver, whose counter is signed.
const COUNT_MAX: u8 = 126;
/// Length of a frame of count 127 after which the counter has run once through the memory below the
/// buffer. Such a frame alone does no visible harm; with 300 bytes more the processor crashed.
const CRASH_AFTER: usize = 3 + 256;

/// The fielded state machine.
#[derive(Clone, Debug)]
pub(super) struct Interrupt {
    order: ChecksumOrder,
    /// The frame so far; empty while waiting for a start byte.
    frame: Vec<u8>,
    last: Instant,
    /// A write of 127 bytes: where the next byte goes, from the buffer on.
    runaway: Option<Runaway>,
}

/// State of a frame whose end the receiver has missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Runaway {
    Data(i8),
    /// The count itself was overwritten and has been reached: the last byte of a checksum.
    Checksum,
}

impl Interrupt {
    fn new(order: ChecksumOrder) -> Self {
        Self {
            order,
            frame: Vec::new(),
            last: Instant::ZERO,
            runaway: None,
        }
    }

    fn byte(
        &mut self,
        at: Instant,
        byte: u8,
        mut memory: Option<&mut Memory>,
        journal: &mut Journal,
    ) -> Option<Heard> {
        let quiet = at - self.last;
        self.last = at;
        if self.frame.is_empty() {
            if byte == avr::START {
                self.frame.push(byte);
            } else {
                stray(at, byte, journal);
            }
            return None;
        }
        report_gap(at, quiet, &self.frame, journal);
        if let (Some(runaway), Some(memory)) = (self.runaway, &mut memory) {
            return self.run_away(at, runaway, byte, memory);
        }
        if let Some(memory) = &mut memory {
            self.store(byte, memory);
        }
        self.frame.push(byte);
        let &control = self.frame.get(2)?;
        let is_write = control & 0x80 != 0;
        let count = control & 0x7F;
        if is_write && count > COUNT_MAX {
            self.runaway = memory.map(|_| Runaway::Data(0));
            return self.overflow(at, journal);
        }
        let data = if is_write { usize::from(count) } else { 0 };
        if self.frame.len() < 5 + data {
            return None;
        }
        let bytes = core::mem::take(&mut self.frame);
        Some(Heard::Request(self.request(at, bytes, journal)))
    }

    /// Cycles of the interrupt beyond the 101 for a byte that it ignores: stray byte and start,
    /// register, count, data, and the two bytes of the checksum.
    fn work(&self, byte: u8) -> Duration {
        let is_write = self.frame.get(2).is_some_and(|control| control & 0x80 != 0);
        let data = self
            .frame
            .get(2)
            .map_or(0, |control| usize::from(control & 0x7F));
        let first_sum = 3 + if is_write { data } else { 0 };
        let cycles = match self.frame.len() {
            0 if byte == avr::START => 12,
            0 => 4,
            1 => 9,
            2 => 25,
            len if len < first_sum => 26,
            len if len == first_sum && is_write => 36,
            len if len == first_sum => 11,
            _ => 16,
        };
        Duration::from_nanos(cycles * 125 / 2)
    }

    /// Stores the count at its place in the memory. Data and the first byte of the checksum go to
    /// the receive buffer.
    fn store(&self, byte: u8, memory: &mut Memory) {
        match self.frame.as_slice() {
            [_, _] => memory.hold_control(byte),
            [_, _, control, data @ ..] if control & 0x80 != 0 => {
                let index = i8::try_from(data.len()).unwrap_or(i8::MAX);
                if data.len() <= usize::from(control & 0x7F) {
                    memory.store(index, byte);
                }
            }
            _ => {}
        }
    }

    /// Stores a byte of a frame without end. The index wraps from 127 to -128. Below the buffer
    /// lies the request with its count. If that is overwritten the frame ends after all, with a
    /// wrong checksum.
    fn run_away(
        &mut self,
        at: Instant,
        runaway: Runaway,
        byte: u8,
        memory: &mut Memory,
    ) -> Option<Heard> {
        let Runaway::Data(index) = runaway else {
            self.frame.clear();
            self.runaway = None;
            let bytes = vec![avr::START, avr::ERROR_REGISTER, 0, 0, 0];
            let valid = false;
            return Some(Heard::Request(Request { at, bytes, valid }));
        };
        memory.store(index, byte);
        let count = memory.request_control() & 0x7F;
        self.runaway = Some(if count <= COUNT_MAX && index == count.cast_signed() {
            Runaway::Checksum
        } else {
            Runaway::Data(index.wrapping_add(1))
        });
        None
    }

    /// A counter that has passed 127 is negative and never reaches its end.
    fn overflow(&mut self, at: Instant, journal: &mut Journal) -> Option<Heard> {
        if self.frame.len() == 3 {
            journal.violation(at, rules::COUNT_TOO_LARGE, &self.frame, || {
                "write of 127 bytes; this firmware counts to 126".into()
            });
        }
        if self.frame.len() < CRASH_AFTER {
            return None;
        }
        self.frame.clear();
        Some(Heard::Crash)
    }

    fn request(&self, at: Instant, bytes: Vec<u8>, journal: &mut Journal) -> Request {
        let (body, sum) = bytes.split_at(bytes.len() - 2);
        let found = match self.order {
            ChecksumOrder::LowFirst => u16::from_le_bytes([sum[0], sum[1]]),
            ChecksumOrder::HighFirst => u16::from_be_bytes([sum[0], sum[1]]),
        };
        let expected = avr::checksum(body);
        if found != expected {
            bad_checksum(at, &bytes, u32::from(expected), u32::from(found), journal);
        }
        Request {
            at,
            valid: found == expected,
            bytes,
        }
    }

    fn deadline(&self, divider: Divider) -> Option<Instant> {
        if self.frame.is_empty() {
            return None;
        }
        let expired = divider
            .ticks
            .after(self.last, DIVIDER, 1)
            .max(divider.main_loop_from);
        Some(expired + MAIN_LOOP_PASS)
    }

    fn give_up(&mut self, at: Instant, journal: &mut Journal) {
        cut_off(at, &self.frame, journal);
        self.frame.clear();
        self.runaway = None;
    }
}

/// The sound receiver.
#[derive(Clone, Debug)]
pub(super) struct Buffered {
    decoder: avr::Decoder,
    idle_gap: Duration,
    last: Instant,
}

impl Buffered {
    const fn new(order: ChecksumOrder, idle_gap: Duration) -> Self {
        Self {
            decoder: avr::Decoder::new(order),
            idle_gap,
            last: Instant::ZERO,
        }
    }

    fn byte(&mut self, at: Instant, byte: u8, journal: &mut Journal, heard: &mut Vec<Heard>) {
        let quiet = at - self.last;
        self.last = at;
        let fresh = self.decoder.pending() == 0;
        if !fresh {
            report_gap(at, quiet, &[byte], journal);
        }
        if fresh && byte != avr::START {
            stray(at, byte, journal);
        }
        self.search(at, &[byte], journal, heard);
    }

    /// Searches for frames after one more byte or on an idle line. A rejected candidate becomes an
    /// invalid request; the base forgives it if a good frame follows closely.
    fn search(&mut self, at: Instant, bytes: &[u8], journal: &mut Journal, heard: &mut Vec<Heard>) {
        for outcome in self.decoder.push(bytes) {
            let (bytes, valid) = match outcome {
                Ok(frame) => (frame.as_bytes().to_vec(), true),
                Err(FrameError::Checksum { expected, found }) => {
                    bad_checksum(at, bytes, expected, found, journal);
                    (vec![avr::START, avr::ERROR_REGISTER, 0, 0, 0], false)
                }
                Err(_) => continue,
            };
            heard.push(Heard::Request(Request { at, bytes, valid }));
        }
    }

    fn deadline(&self) -> Option<Instant> {
        (self.decoder.pending() > 0).then(|| self.last + self.idle_gap)
    }

    fn give_up(&mut self, at: Instant, journal: &mut Journal, heard: &mut Vec<Heard>) {
        let pending = self.decoder.pending();
        journal.violation(at, rules::FRAME_CUT_OFF, &[], || {
            format!("the line went quiet after {pending} bytes of a frame")
        });
        self.decoder.idle();
        let before = heard.len();
        self.search(at, &[], journal, heard);
        // An idle line is no reason to answer unreadable bytes.
        let mut index = 0;
        heard.retain(|heard| {
            index += 1;
            index <= before || matches!(heard, Heard::Request(request) if request.valid)
        });
    }
}

fn stray(at: Instant, byte: u8, journal: &mut Journal) {
    journal.violation(at, rules::STRAY_BYTES, &[byte], || {
        format!("byte {byte:02X} outside a frame")
    });
}

fn report_gap(at: Instant, quiet: Duration, bytes: &[u8], journal: &mut Journal) {
    if quiet > GAP_REPORTED {
        journal.violation(at, rules::GAP_IN_FRAME, bytes, || {
            format!("{} us of silence inside a frame", quiet.as_micros())
        });
    }
}

fn bad_checksum(at: Instant, bytes: &[u8], expected: u32, found: u32, journal: &mut Journal) {
    journal.violation(at, rules::BAD_CHECKSUM, bytes, || {
        format!("checksum is {found:04X}, expected {expected:04X}")
    });
}

fn cut_off(at: Instant, frame: &[u8], journal: &mut Journal) {
    journal.violation(at, rules::FRAME_CUT_OFF, frame, || {
        format!("the line went quiet after {} bytes of a frame", frame.len())
    });
}

#[cfg(test)]
mod tests {
    use super::super::memory::MAP_2015;
    use super::*;

    fn buffered() -> Buffered {
        Buffered::new(ChecksumOrder::HighFirst, Duration::from_millis(2))
    }

    fn at(micros: u64) -> Instant {
        Instant::from_nanos(micros * 1_000)
    }

    /// The bytes come 10 us after each other, followed by a pause. Returns, for the requests of
    /// each receiver, whether each request is valid.
    fn heard(bytes: &[u8]) -> (Vec<bool>, Vec<bool>) {
        let (mut receiver, mut journal) = (buffered(), Journal::default());
        let (mut now, mut heard) = (100, Vec::new());
        for byte in bytes {
            receiver.byte(at(now), *byte, &mut journal, &mut heard);
            now += 10;
        }
        let before = heard.len();
        if let Some(deadline) = receiver.deadline() {
            assert_eq!(deadline, at(now - 10) + Duration::from_millis(2));
            receiver.give_up(deadline, &mut journal, &mut heard);
        }
        let is_sound = |heard: &Heard| matches!(heard, Heard::Request(request) if request.valid);
        let sound: Vec<bool> = heard.iter().map(is_sound).collect();
        (sound[..before].to_vec(), sound[before..].to_vec())
    }

    /// AB + 24 + 0A = D9. The last byte of a write of four bytes is missing. After the pause the
    /// receiver finds the frame within that write if it is valid; an invalid one gets no answer. A
    /// frame refused before the pause stays refused.
    #[test]
    fn a_pause_sets_free_what_an_unfinished_frame_hid() {
        let (sound, wrong) = (
            [0xAB, 0x24, 0x0A, 0x00, 0xD9],
            [0xAB, 0x24, 0x0A, 0x00, 0xDA],
        );
        assert_eq!(heard(&sound), (vec![true], vec![]));
        assert_eq!(heard(&wrong), (vec![false], vec![]));
        let open = [0xAB, 0x10, 0x84];
        assert_eq!(
            heard(&[&open[..], &sound[..]].concat()),
            (vec![], vec![true])
        );
        assert_eq!(heard(&[&open[..], &wrong[..]].concat()), (vec![], vec![]));
        let both = [&wrong[..], &open[..], &sound[..]].concat();
        assert_eq!(heard(&both), (vec![false], vec![true]));
        let both = [&wrong[..], &open[..], &wrong[..]].concat();
        assert_eq!(heard(&both), (vec![false], vec![]));
    }

    /// A byte 1 ms after the one before is in time; one a microsecond later is reported. The first
    /// byte of a frame may come at any time.
    #[test]
    fn silence_inside_a_frame_is_told_from_a_millisecond_on() {
        let told = |first: u64, second: u64| {
            let (mut receiver, mut journal) = (buffered(), Journal::default());
            let mut heard = Vec::new();
            receiver.byte(at(first), 0xAB, &mut journal, &mut heard);
            receiver.byte(at(first + second), 0x24, &mut journal, &mut heard);
            journal
                .take()
                .into_iter()
                .map(|event| event.rule)
                .collect::<Vec<_>>()
        };
        assert_eq!(told(5_000, 1_000), [""; 0]);
        assert_eq!(told(5_000, 1_001), [rules::GAP_IN_FRAME]);
    }

    /// The third byte is the count. The data of a write follow it into the buffer, with the first
    /// byte of the checksum; a read stores nothing.
    #[test]
    fn the_interrupt_stores_what_a_write_brings() {
        let stored = |frame: &[u8]| {
            let mut receiver = Interrupt::new(ChecksumOrder::LowFirst);
            receiver.frame = frame.to_vec();
            let (mut memory, before) = (Memory::new(MAP_2015), Memory::new(MAP_2015));
            receiver.store(0x77, &mut memory);
            let place = (0..=255).find(|at| memory.get(*at) != before.get(*at));
            assert_eq!(memory == before, place.is_none());
            place
        };
        assert_eq!(stored(&[0xAB]), None);
        assert_eq!(stored(&[0xAB, 0x10]), Some(54));
        let write = [3, 4, 5, 6].map(|len| stored(&[0xAB, 0x10, 0x82, 1, 2, 3][..len]));
        assert_eq!(write, [Some(65), Some(66), Some(67), None]);
        let reads = (3..6).map(|len| stored(&[0xAB, 0x10, 0x02, 1, 2][..len]));
        assert!(reads.into_iter().all(|place| place.is_none()));
    }

    /// Cycles of the interrupt: 12 for a start and 4 for a stray byte, 9 for the register, 25 for
    /// the count, 26 for each byte of data; 36 for the first byte of a checksum behind data and 11
    /// without, 16 for the second. 16 cycles are a microsecond.
    #[test]
    fn a_byte_takes_the_interrupt_as_long_as_its_place_needs() {
        let cycles = |frame: &[u8], byte: u8| {
            let mut receiver = Interrupt::new(ChecksumOrder::LowFirst);
            receiver.frame = frame.to_vec();
            (receiver.work(byte).as_nanos() * 16).div_ceil(1_000)
        };
        assert_eq!([cycles(&[], avr::START), cycles(&[], 0x55)], [12, 4]);
        let write = [0xAB, 0x10, 0x82, 1, 2, 3];
        let of_write = [1, 2, 3, 4, 5, 6].map(|len| cycles(&write[..len], 0));
        assert_eq!(of_write, [9, 25, 26, 26, 36, 16]);
        let of_read = [3, 4].map(|len| cycles(&[0xAB, 0x10, 0x02, 1][..len], 0));
        assert_eq!(of_read, [11, 16]);
        let of_none = [3, 4].map(|len| cycles(&[0xAB, 0x10, 0x80, 1][..len], 0));
        assert_eq!(of_none, [36, 16]);
    }
}
