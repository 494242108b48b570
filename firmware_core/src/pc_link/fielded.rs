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
    extern crate std;

    use protocols::rle;

    use super::super::{Counters, Settings};
    use super::*;
    use crate::grid::Grid;
    use crate::pose::Pose;
    use crate::waypoints::Waypoints;

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

    fn fielded(defects: Defects) -> PcLink {
        PcLink::new(Settings {
            defects,
            dialect: rle::Dialect::Lossless,
            ..Settings::default()
        })
    }

    fn at(millis: u64) -> Instant {
        Instant::from_millis(millis)
    }

    fn sent(link: &mut PcLink) -> std::vec::Vec<u8> {
        let mut buf = [0; 4096];
        let count = link.transmit(&mut buf);
        buf[..count].to_vec()
    }

    /// A robot in an unknown map, with a row of 24 bytes.
    fn torn(link: &mut PcLink, now: Instant) -> std::vec::Vec<u8> {
        let map = std::boxed::Box::new(Grid::new(20.0));
        let waypoints = Waypoints::new();
        let view = View {
            map: &map,
            pose: Pose::new(1000.0, 1000.0, core::f32::consts::FRAC_PI_2),
            state: pcui::message::State::default(),
            waypoints: &waypoints,
            diagnosis: pcui::diagnosis::Diagnosis::default(),
            victims: &[],
            readings: pcui::diagnosis::Readings::NONE,
            message: pcui::diagnosis::Text::default(),
        };
        link.queue_torn(now, &view, b"twelve bytestwelve bytes");
        sent(link)
    }

    /// PU-18: 24 bytes of a row and 19 of text take 3.583 ms at 12,000 bytes a second; only each
    /// fourth row is torn.
    #[test]
    fn text_is_printed_into_each_fourth_row() {
        let mut link = fielded(Defects {
            prints_text: true,
            ..Defects::NONE
        });
        let found = torn(&mut link, at(10));
        assert_eq!(found, b"twelve bytesWatermark slam: 1\r\ntwelve bytes");
        let passed = at(10) + Duration::from_nanos(3_583_333);
        assert_eq!((link.passed_at, link.row_at), (passed, passed));
        assert_eq!((link.counters.sent, link.pose_at), (2, Instant::ZERO));
        torn(&mut link, at(11));
        assert_eq!(link.passed_at, passed + Duration::from_nanos(3_583_333));
        let is_torn = [0, 1, 2, 3, 4, 5].map(|row| {
            link.row = row;
            link.is_interrupted(at(10), 24)
        });
        assert_eq!(is_torn, [false, true, false, false, false, true]);
    }

    /// PU-06: 24 bytes take 2 ms; a pose due meanwhile goes into the middle, and the next pose
    /// comes 50 ms later.
    #[test]
    fn a_pose_is_written_into_a_row() {
        let mut link = fielded(Defects {
            unlocked: true,
            ..Defects::NONE
        });
        link.pose_at = at(50);
        assert!(!link.is_interrupted(at(48), 24) && link.is_interrupted(at(49), 24));
        assert!(!fielded(Defects::NONE).is_interrupted(at(49), 24));
        let found = torn(&mut link, at(49));
        assert_eq!(found[..12], *b"twelve bytes");
        assert_eq!(found[12..29], *b"PCUI_MSG\x0D\x00\x53\x03\x00\x00MPD");
        assert_eq!(found[42..], *b"twelve bytes");
        assert_eq!(link.pose_at, at(100));
        assert_eq!(link.passed_at, at(49) + Duration::from_micros(4_500));
        // Without a pace the line limits: 46,080 bytes a second.
        link.settings.pace_bytes_per_s = None;
        assert_eq!(link.time_of(4_608), Duration::from_millis(100));
    }

    /// PU-16, and PU-12: the fielded queue takes 200 bytes and no more.
    #[test]
    fn the_fielded_queue_is_late_and_short() {
        let late = Defects {
            not_ready_at_first: true,
            ..Defects::NONE
        };
        let dies = |nanos, defects| {
            let mut link = fielded(defects);
            link.receive(Instant::from_nanos(nanos), &mut &b"P"[..]);
            link.is_dead()
        };
        assert!(dies(999_999, late) && !dies(1_000_000, late) && !dies(0, Defects::NONE));
        let kept = |defects| {
            let mut link = fielded(defects);
            let mut input = &[0; 600][..];
            assert_eq!(link.receive(at(5), &mut input), None);
            (link.fielded.waiting.len(), input.len())
        };
        let short_queue = Defects {
            short_queue: true,
            ..Defects::NONE
        };
        let byte_per_row = Defects {
            byte_per_row: true,
            ..Defects::NONE
        };
        assert_eq!(
            [kept(short_queue), kept(byte_per_row)],
            [(200, 0), (512, 0)]
        );
        assert_eq!(kept(Defects::NONE), (0, 0));
    }

    /// PU-15: a frame received while the link was off is processed with the next byte, if it fitted
    /// into 200 bytes.
    #[test]
    fn what_came_while_the_link_was_off_is_taken_later() {
        let frame = b"PCUI_MSG\x02\x00\x00\x00\x00\x00LWP\x00\x00";
        let taken = |before: usize, defects| {
            let mut link = fielded(defects);
            link.receive_while_off(&std::vec![0; before]);
            link.receive_while_off(frame);
            link.receive(at(5), &mut &[9][..]).is_some()
        };
        let keeps_while_off = Defects {
            keeps_while_off: true,
            ..Defects::NONE
        };
        assert!(taken(0, keeps_while_off) && taken(181, keeps_while_off));
        assert!(!taken(182, keeps_while_off) && !taken(0, Defects::NONE));
    }

    /// PU-17: each byte is sent twice, and no pair is split.
    #[test]
    fn bytes_are_sent_twice() {
        let mut link = fielded(Defects {
            sends_twice: true,
            ..Defects::NONE
        });
        link.tx.push(b"abc");
        let mut buf = [0; 5];
        assert_eq!((link.pop_twice(&mut buf), &buf[..4]), (4, &b"aabb"[..]));
        assert_eq!((link.pop_twice(&mut buf), &buf[..2]), (2, &b"cc"[..]));
        assert_eq!(link.pop_twice(&mut buf), 0);
        assert_eq!(*link.counters(), Counters::NONE);
    }

    /// XV-12: the fielded program can pass on the lidar's raw bytes; the switch decides.
    #[test]
    fn the_lidar_s_bytes_are_passed_on_if_told() {
        let passed = |raw_lidar| {
            let mut link = fielded(Defects {
                raw_lidar,
                ..Defects::NONE
            });
            link.pass_on_raw_lidar(b"\xFA\xA0");
            sent(&mut link)
        };
        assert_eq!(passed(true), b"\xFA\xA0");
        assert_eq!(passed(false), b"");
    }

    /// Output of the receiver for `bytes`: frames by their payloads, and errors.
    fn taken(defects: Defects, bytes: &[u8]) -> std::vec::Vec<Option<std::vec::Vec<u8>>> {
        let mut receiver = Receiver::new();
        let outcomes = bytes
            .iter()
            .filter_map(|byte| receiver.take(*byte, &defects));
        let payload = |outcome: Result<Frame, FrameError>| Some(outcome.ok()?.payload().to_vec());
        outcomes.map(payload).collect()
    }

    const LIST: &[u8] = b"PCUI_MSG\x02\x00\x07\x00\x00\x00LWP\x03\x04";

    /// PU-01: in "PPCUI_MSG" only a receiver that restarts at the second P finds the frame. A wrong
    /// sum and a length of 512 bytes are refused, and the next frame is found.
    #[test]
    fn a_start_word_that_breaks_off_may_begin_anew() {
        let forgets = Defects {
            forgets_to_restart: true,
            ..Defects::NONE
        };
        let found = [Some(std::vec![3, 4])];
        assert_eq!(taken(Defects::NONE, LIST), found);
        assert_eq!(taken(Defects::NONE, &[b"PC", LIST].concat()), found);
        assert_eq!(taken(forgets, &[b"PC", LIST].concat()), []);
        assert_eq!(taken(forgets, &[b"x", LIST].concat()), found);
        let mut wrong = LIST.to_vec();
        wrong[10] = 8;
        assert_eq!(
            taken(Defects::NONE, &[&wrong, LIST].concat()),
            [None, found[0].clone()]
        );
        let long = b"PCUI_MSG\x00\x02\x00\x00\x00\x00LWP";
        let found = taken(Defects::NONE, &[long, LIST].concat());
        assert_eq!(found, [None, Some(std::vec![3, 4])]);
    }

    /// PU-02: 257 bytes of 0x80 add up to 0x8080, which is negative in 16 bits. PU-03: a length of
    /// 0x8000 is negative as well, and the receiver takes no further frame.
    #[test]
    fn signs_deafen_the_fielded_receiver() {
        let mut frame = b"PCUI_MSG\x01\x01\x80\x80\x00\x00LWP".to_vec();
        frame.extend([0x80; 257]);
        assert_eq!(taken(Defects::NONE, &frame), [Some(std::vec![0x80; 257])]);
        let signed_checksum = Defects {
            signed_checksum: true,
            ..Defects::NONE
        };
        assert_eq!(taken(signed_checksum, &frame), [None]);
        assert_eq!(taken(signed_checksum, LIST), [Some(std::vec![3, 4])]);
        let signed_length = Defects {
            signed_length: true,
            ..Defects::NONE
        };
        let negative = b"PCUI_MSG\x00\x80\x00\x00\x00\x00LWP";
        let both = [negative, LIST].concat();
        assert_eq!(taken(signed_length, &both), []);
        assert_eq!(taken(Defects::NONE, &both), [None, Some(std::vec![3, 4])]);
    }

    /// PU-04: a frame without payload waits for a byte, and takes it. PU-05: a list of two
    /// waypoints that announces three is read as three, 2 + 27 bytes, with stale bytes.
    #[test]
    fn lengths_are_believed_where_they_are_wrong() {
        let empty = b"PCUI_MSG\x00\x00\x00\x00\x00\x00STA";
        let wants_a_byte = Defects {
            wants_a_byte: true,
            ..Defects::NONE
        };
        assert_eq!(taken(Defects::NONE, empty), [Some(std::vec![])]);
        assert_eq!(taken(wants_a_byte, empty), []);
        assert_eq!(taken(wants_a_byte, &[&empty[..], b"P"].concat()).len(), 1);
        let believes = Defects {
            believes_the_count: true,
            ..Defects::NONE
        };
        let list = b"PCUI_MSG\x02\x00\x03\x00\x00\x00LWP\x03\x00";
        let lens = |defects| taken(defects, list)[0].as_ref().map(std::vec::Vec::len);
        assert_eq!([lens(Defects::NONE), lens(believes)], [Some(2), Some(29)]);
        let many = b"PCUI_MSG\x02\x00\xFE\x01\x00\x00LWP\xFF\xFF";
        let found = taken(believes, many);
        assert_eq!(found[0].as_ref().map(std::vec::Vec::len), Some(511));
    }

    /// Each of the receiver's defects alone enables the fielded receiver; those of the sender do
    /// not.
    #[test]
    fn each_fault_of_the_receiver_makes_it_the_fielded_one() {
        let with = |change: fn(&mut Defects)| {
            let mut defects = Defects::NONE;
            change(&mut defects);
            (defects.of_receiver(), defects.queues())
        };
        let of_receiver: [fn(&mut Defects); 5] = [
            |it| it.forgets_to_restart = true,
            |it| it.signed_checksum = true,
            |it| it.signed_length = true,
            |it| it.wants_a_byte = true,
            |it| it.believes_the_count = true,
        ];
        assert_eq!(of_receiver.map(with), [(true, false); 5]);
        let of_queue: [fn(&mut Defects); 2] =
            [|it| it.short_queue = true, |it| it.byte_per_row = true];
        assert_eq!(of_queue.map(with), [(false, true); 2]);
        let of_sender: [fn(&mut Defects); 4] = [
            |_| (),
            |it| it.unlocked = true,
            |it| it.sends_twice = true,
            |it| it.keeps_while_off = true,
        ];
        assert_eq!(of_sender.map(with), [(false, false); 4]);
        // PU-03 alone: the link waits for a negative length forever, as its receiver does.
        let mut link = fielded(Defects {
            signed_length: true,
            ..Defects::NONE
        });
        let mut input = &b"PCUI_MSG\xFF\xFF\x00\x00\x00\x00LWP"[..];
        assert_eq!(link.receive(at(5), &mut input), None);
        let mut input = LIST;
        assert_eq!(link.receive(at(500), &mut input), None);
        let mut link = fielded(Defects::NONE);
        let mut input = LIST;
        assert!(link.receive(at(500), &mut input).is_some());
    }

    /// Psi takes the shorter direction each time: from 90 to -89 it goes back by 179, from 300 to
    /// 20 forward by 80. Half a turn counts as back.
    #[test]
    fn a_counted_psi_takes_the_shorter_way_round() {
        let count = |told: &[i16]| {
            let mut psi = CountedPsi::new();
            told.iter().map(|psi_deg| psi.count(*psi_deg)).last()
        };
        assert_eq!(count(&[271]), Some(-89));
        assert_eq!(count(&[270]), Some(-90));
        assert_eq!(count(&[269]), Some(269));
        assert_eq!(count(&[200, 300, 20]), Some(380));
        assert_eq!(count(&[200, 300, 20, 300]), Some(300));
        assert_eq!(count(&[0, 350, 190, 100, 359]), Some(-361));
    }
}
