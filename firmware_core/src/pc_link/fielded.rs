//! Defects of the fielded program on the PC link, and its receiver.

use core::time::Duration;

use protocols::pcui::message::encode_map_properties;
use protocols::pcui::{self, FIELDED_PAYLOAD_MAX, FRAME_MAX, Frame, HEADER_LEN, MAGIC};
use protocols::{Decode, FrameError, Instant};

use super::{PcLink, READY_AFTER, SHORT_QUEUE, View, WAITING_MAX, next_period, properties};

/// Defects of the fielded program on the PC link; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// A byte that interrupts the start word cannot begin a new one (PU-01).
    pub forgets_to_restart: bool,
    /// The low half of the checksum is sign-extended before the halves are combined (PU-02).
    pub signed_checksum: bool,
    /// A length is compared as a signed number; the program waits for a negative one forever
    /// (PU-03).
    pub signed_length: bool,
    /// A frame without payload takes a byte of the next one (PU-04).
    pub wants_a_byte: bool,
    /// A list of waypoints is read by its own count, beyond its payload (PU-05).
    pub believes_the_count: bool,
    /// Poses are written into the middle of a row that is being sent (PU-06).
    pub unlocked: bool,
    /// The receive queue holds 200 bytes, and one is taken per row sent (PU-12).
    pub short_queue: bool,
    /// One received byte is checked per row sent (PU-14).
    pub byte_per_row: bool,
    /// Bytes received while the link is switched off are kept and used later (PU-15).
    pub keeps_while_off: bool,
    /// A byte before the first millisecond is over ends the program (PU-16).
    pub not_ready_at_first: bool,
    /// Once the send queue was full, every byte is sent twice (PU-17).
    pub sends_twice: bool,
    /// Debug text is written into rows (PU-18).
    pub prints_text: bool,
    /// The lidar's bytes are passed on, between the frames (XV-12).
    pub raw_lidar: bool,
    /// The heading counts full turns until 16 bits overflow (SL-13).
    pub counts_psi: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        forgets_to_restart: false,
        signed_checksum: false,
        signed_length: false,
        wants_a_byte: false,
        believes_the_count: false,
        unlocked: false,
        short_queue: false,
        byte_per_row: false,
        keeps_while_off: false,
        not_ready_at_first: false,
        sends_twice: false,
        prints_text: false,
        raw_lidar: false,
        counts_psi: false,
    };

    /// Whether frames are received by the fielded receiver.
    pub(super) const fn of_receiver(&self) -> bool {
        self.forgets_to_restart
            || self.signed_checksum
            || self.signed_length
            || self.wants_a_byte
            || self.believes_the_count
    }

    /// Whether received bytes wait in a queue.
    pub(super) const fn queues(&self) -> bool {
        self.short_queue || self.byte_per_row
    }
}

/// The heading on the wire as the fielded code counts it: not normalised, then cut to 16 bits
/// (SL-13).
#[derive(Clone, Debug)]
pub(super) struct CountedPsi(i32);

impl CountedPsi {
    /// The initial heading, psi 90.
    pub(super) const fn new() -> Self {
        Self(90)
    }

    /// The next heading, less than half a turn from the last.
    #[expect(clippy::cast_possible_truncation, reason = "that is the fault")]
    pub(super) const fn count(&mut self, psi_deg: i16) -> i16 {
        self.0 += (psi_deg as i32 - self.0 + 180).rem_euclid(360) - 180;
        self.0 as i16
    }
}

/// The fielded receiver: takes one byte after the other and reads none twice.
#[derive(Clone, Debug)]
pub(super) struct Receiver {
    /// Header, then payload; bytes of earlier payloads stay until they are overwritten.
    bytes: [u8; FRAME_MAX],
    len: usize,
    /// The receiver waits for a payload longer than possible.
    is_deaf: bool,
}

impl Receiver {
    pub(super) const fn new() -> Self {
        Self {
            bytes: [0; FRAME_MAX],
            len: 0,
            is_deaf: false,
        }
    }

    pub(super) fn take(
        &mut self,
        byte: u8,
        defects: &Defects,
    ) -> Option<Result<Frame, FrameError>> {
        if self.is_deaf {
            return None;
        }
        if self.len < MAGIC.len() && byte != MAGIC[self.len] {
            let begins = byte == MAGIC[0] && !defects.forgets_to_restart;
            self.len = usize::from(begins);
            return None;
        }
        let wants_more = self.len >= HEADER_LEN && self.payload_len() == 0;
        if !wants_more {
            self.bytes[self.len] = byte;
        }
        self.len += 1;
        if self.len < HEADER_LEN {
            return None;
        }
        if self.len == HEADER_LEN {
            if let Some(error) = self.judge_length(defects) {
                return Some(Err(error));
            }
            if self.payload_len() == 0 && !defects.wants_a_byte {
                return self.finish(defects);
            }
            return None;
        }
        if self.is_deaf || self.len < HEADER_LEN + self.payload_len().max(1) {
            return None;
        }
        self.finish(defects)
    }

    fn payload_len(&self) -> usize {
        usize::from(u16::from_le_bytes([self.bytes[8], self.bytes[9]]))
    }

    fn judge_length(&mut self, defects: &Defects) -> Option<FrameError> {
        let found = u16::from_le_bytes([self.bytes[8], self.bytes[9]]);
        if usize::from(found) <= FIELDED_PAYLOAD_MAX {
            return None;
        }
        if defects.signed_length && found.cast_signed() < 0 {
            self.is_deaf = true;
            return None;
        }
        self.len = 0;
        let max = u32::try_from(FIELDED_PAYLOAD_MAX).expect("511");
        let found = u32::from(found);
        Some(FrameError::Length { max, found })
    }

    fn finish(&mut self, defects: &Defects) -> Option<Result<Frame, FrameError>> {
        self.len = 0;
        let len = self.payload_len();
        let [low_0, low_1, high_0, high_1] = *self.bytes[10..].first_chunk().expect("a header");
        let high = u32::from(u16::from_le_bytes([high_0, high_1])) << 16;
        let low = u16::from_le_bytes([low_0, low_1]);
        let low = if defects.signed_checksum {
            i32::from(low.cast_signed()).cast_unsigned()
        } else {
            u32::from(low)
        };
        let (found, expected) = (high | low, pcui::checksum(&self.bytes[HEADER_LEN..][..len]));
        if found != expected {
            return Some(Err(FrameError::Checksum { expected, found }));
        }
        let len = match &self.bytes[14..17] {
            b"LWP" if defects.believes_the_count => self.announced_list(),
            b"STA" if defects.wants_a_byte && len == 0 => 3,
            _ => len,
        };
        self.frame(len).map(Ok)
    }

    /// Length of a list with its announced number of waypoints, limited by the buffer.
    fn announced_list(&self) -> usize {
        let count = u16::from_le_bytes([self.bytes[HEADER_LEN], self.bytes[HEADER_LEN + 1]]);
        (2 + 9 * usize::from(count)).min(FIELDED_PAYLOAD_MAX)
    }

    /// The frame in the buffer.
    fn frame(&self, len: usize) -> Option<Frame> {
        let mut bytes = self.bytes;
        let id = *self.bytes[14..].first_chunk().expect("a header");
        let end = pcui::seal(&mut bytes, id, len)?;
        let mut decoder = pcui::Decoder::with_format(pcui::Framing);
        decoder.push(&bytes[..end]).next()?.ok()
    }
}

/// Behaviour of the fielded program where it differs from [`PcLink`].
impl PcLink {
    /// Takes received bytes as the fielded program did, where its receiver differed.
    pub(super) fn stumble(&mut self, now: Instant, input: &mut &[u8]) {
        let defects = &self.settings.defects;
        if defects.not_ready_at_first && now < Instant::ZERO + READY_AFTER {
            self.fielded.is_dead = true;
        }
        if !defects.queues() {
            return;
        }
        let most = if defects.short_queue {
            SHORT_QUEUE
        } else {
            WAITING_MAX
        };
        for byte in core::mem::take(input) {
            if self.fielded.waiting.len() < most {
                self.fielded.waiting.push(&[*byte]);
            }
        }
    }

    /// Passes on the lidar's bytes, as the fielded program could be configured to (XV-12).
    pub fn pass_on_raw_lidar(&mut self, bytes: &[u8]) {
        if self.settings.defects.raw_lidar {
            self.tx.push(bytes);
        }
    }

    /// Takes bytes that arrive while the link is switched off: the fielded queue keeps the first
    /// 200.
    pub fn receive_while_off(&mut self, bytes: &[u8]) {
        if self.settings.defects.keeps_while_off {
            let room = SHORT_QUEUE.saturating_sub(self.fielded.waiting.len());
            self.fielded.waiting.push(&bytes[..room.min(bytes.len())]);
        }
    }

    /// A frame of the bytes that were kept while the link was switched off.
    pub(super) fn kept_frame(&mut self) -> Option<Frame> {
        let mut byte = [0];
        while self.settings.defects.keeps_while_off && self.fielded.waiting.pop(&mut byte) == 1 {
            if let Some(frame) = self.next_frame(&mut &byte[..]) {
                return Some(frame);
            }
        }
        None
    }

    /// Sends each queued byte twice.
    pub(super) fn pop_twice(&mut self, buf: &mut [u8]) -> usize {
        let (pairs, _) = buf.as_chunks_mut::<2>();
        let mut count = 0;
        for pair in pairs {
            let mut byte = [0];
            if self.tx.pop(&mut byte) == 0 {
                break;
            }
            *pair = [byte[0]; 2];
            count += 2;
        }
        count
    }

    /// Whether a pose or text is written while a row of `len` bytes is queued at `now`.
    pub(super) fn is_interrupted(&self, now: Instant, len: usize) -> bool {
        let defects = &self.settings.defects;
        let meets_pose = self.pose_at < now + self.time_of(len);
        (defects.unlocked && meets_pose) || (defects.prints_text && self.row % 4 == 1)
    }

    /// Queues a row, with a pose or a line of text within it.
    pub(super) fn queue_torn(&mut self, now: Instant, view: &View<'_>, row: &[u8]) {
        let mut pose = [0; FRAME_MAX];
        let intruder = if self.settings.defects.prints_text {
            &b"Watermark slam: 1\r\n"[..]
        } else {
            self.pose_at = next_period(self.pose_at, self.settings.pose_period, now);
            let len = encode_map_properties(&properties(view), &mut pose);
            &pose[..len.unwrap_or(0)]
        };
        let (head, tail) = row.split_at(row.len() / 2);
        for part in [head, intruder, tail] {
            self.tx.push(part);
        }
        let len = row.len() + intruder.len();
        self.counters.sent = self.counters.sent.saturating_add(2);
        self.passed_at = self.passed_at.max(now) + self.time_of(len);
        self.row_at = self.row_at.max(self.passed_at);
    }

    /// Time to forward `len` bytes.
    fn time_of(&self, len: usize) -> Duration {
        let line = pcui::BAUD / 10;
        let pace = self.settings.pace_bytes_per_s.unwrap_or(line).max(1);
        Duration::from_nanos(len as u64 * 1_000_000_000 / u64::from(pace))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SL-13: 91 turns of 360 degrees are 32760, and a little more is negative; in the other
    /// direction psi is negative at once.
    #[test]
    fn a_counted_psi_wraps_after_91_turns() {
        let turned = |degrees: i32| {
            let mut psi = CountedPsi::new();
            let step = degrees.signum();
            let mut told = 90;
            for now in 0..degrees.abs() {
                let sound = (90 + step * (now + 1)).rem_euclid(360);
                told = psi.count(i16::try_from(sound).expect("less than 360"));
            }
            told
        };
        assert_eq!([turned(360), turned(-100)], [450, -10]);
        assert_eq!([turned(32_677), turned(32_678)], [32_767, -32_768]);
    }
}
