//! Statistics of a sensor's stream: the same figures from a real capture and from the emulator, for
//! comparison side by side.
//!
//! [`Statistics::of`] reads any stream of either format; [`rows`](Statistics::rows) are its figures
//! with stable names. One capture shows steady turning, a hand, the coast-down and the restart.
//! [`hand_in_box`] is the emulator's version of it, and [`CAPTURED`] has its figures.

mod blind;
mod coast;
mod compare;
mod figures;
mod logistic;
mod noise;
mod replica;
#[cfg(test)]
mod tests;
mod turns;
mod twin;

use std::collections::BTreeMap;

use protocols::xv11::{self, Frame, RawReading, Reading, turn};
use protocols::{Decode, Format};

use coast::Teeth;
use noise::Repeats;

pub use blind::{Figure, Told, blind};
pub use compare::{Column, compare};
pub use figures::{CAPTURED, Row};
pub use noise::{BIN_MM, Bin};
pub use replica::hand_in_box;

/// Figures of one stream. Counts unless said otherwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Statistics {
    /// Number of bytes of the stream.
    pub bytes: u64,
    /// Verified packets of 22 bytes.
    pub packets: u64,
    /// Whole turns of 1446 bytes, firmware 2.1.
    pub turns: u64,
    /// Bytes outside packets and turns.
    pub outside: u64,
    /// Packets with a distance, and those among them whose checksum is right only because a carry
    /// is dropped. Packets without a distance are left out: those of a stall are all equal.
    pub carry_dropped: [u64; 2],
    /// Distances without strength warning.
    pub plain: u64,
    /// Distances with it.
    pub weak: u64,
    /// Readings without distance, by error code.
    pub codes: BTreeMap<u8, u64>,
    /// Steps of the packet index, modulo 90.
    pub index_steps: BTreeMap<u8, u64>,
    /// Changes of the speed word in unbroken sequences of packets, by index modulo 6.
    pub word_changes: [u64; 6],
    /// Readings with code 0x21, by angle modulo 24, while every index followed the last.
    pub skipped_at: [u64; 24],
    /// Readings whose code contains a strength, and the number of those with the strength of the
    /// previous reading.
    pub carried: [u64; 2],
    /// Median of strength times distance squared, in units of 1e8, over plain readings.
    pub strength_d2: f64,
    /// Farthest distance with strength warning, millimetres.
    pub weak_max_mm: u16,
    /// Share of the readings below 650 mm whose warning follows the law
    /// [`is_weak`](super::is_weak).
    pub weak_as_law: f64,
    /// Median speed, turns per minute.
    pub rpm_median: f64,
    /// Highest speed shown.
    pub rpm_max: f64,
    /// Lowest speed shown.
    pub rpm_min: f64,
    /// Repeatability by distance.
    pub noise: Vec<Bin>,
    /// Duration of the last coast-down from 290 to 185 rpm, and from there to 75 rpm; seconds by
    /// tooth times.
    pub coast_s: Option<[f64; 2]>,
    /// Packets that show the last speed before the processor restarts.
    pub stalled_packets: u64,
    /// Bytes of the packet that a restart cut, as far as a boot text follows.
    pub cut_bytes: Option<u64>,
    /// The boot text, from the first character to the prompt.
    pub boot_text: Option<String>,
}

impl Statistics {
    /// Figures of `bytes`, packets or turns, whichever there is more of.
    pub fn of(bytes: &[u8]) -> Self {
        let mut reader = Reader::default();
        let mut decoder = xv11::Decoder::default();
        decoder
            .push(bytes)
            .filter_map(Result::ok)
            .for_each(|frame| reader.frame(&frame));
        let mut turns = turn::Decoder::default();
        turns
            .push(bytes)
            .filter_map(Result::ok)
            .for_each(|turn| reader.turn(&turn));
        let mut statistics = reader.finish();
        statistics.bytes = bytes.len() as u64;
        let inside =
            statistics.packets * xv11::FRAME_LEN as u64 + statistics.turns * turn::FRAME_LEN as u64;
        statistics.outside = statistics.bytes.saturating_sub(inside);
        (statistics.cut_bytes, statistics.boot_text) = boot(bytes);
        statistics
    }

    /// All readings.
    pub fn readings(&self) -> u64 {
        self.plain + self.weak + self.codes.values().sum::<u64>()
    }
}

/// The last complete boot text, and the number of bytes of a packet before it.
fn boot(bytes: &[u8]) -> (Option<u64>, Option<String>) {
    const TITLE: &[u8] = b"\n\rPiccolo";
    let title = bytes.windows(TITLE.len()).rposition(|w| w == TITLE);
    // Two characters of greeting come before the title.
    let Some(start) = title.and_then(|at| at.checked_sub(2)) else {
        return (None, None);
    };
    let text = &bytes[start..];
    let text = match text.iter().position(|&byte| byte == b'#') {
        Some(prompt) => &text[..=prompt],
        None => text,
    };
    let before = &bytes[..start];
    let longest = before.len().min(xv11::FRAME_LEN - 1);
    let cut = (1..=longest).rev().find(|&len| {
        let tail = &before[before.len() - len..];
        let whole = before[..before.len() - len].last_chunk::<{ xv11::FRAME_LEN }>();
        tail[0] == xv11::START
            && whole.is_none_or(|frame| frame[0] == xv11::START)
            && matches!(xv11::Packets.judge(tail), protocols::Candidate::Incomplete)
    });
    let text = String::from_utf8_lossy(text).into_owned();
    (cut.map(|len| len as u64), Some(text))
}

/// Takes in a stream, frame by frame.
#[derive(Debug, Default)]
struct Reader {
    statistics: Statistics,
    before: Option<Frame>,
    strength: Option<u16>,
    words: Vec<u16>,
    strengths: Vec<f64>,
    warnings: [u64; 2],
    teeth: Teeth,
    repeats: Repeats,
}

impl Reader {
    fn frame(&mut self, frame: &Frame) {
        let figures = &mut self.statistics;
        figures.packets += 1;
        if frame.raw_readings().iter().any(|raw| raw.0[1] & 0x80 == 0) {
            figures.carry_dropped[0] += 1;
            figures.carry_dropped[1] += u64::from(drops_carry(frame));
        }
        let index = frame.index();
        let step = self.before.map(|before| (index + 90 - before.index()) % 90);
        if let Some(step) = step {
            *figures.index_steps.entry(step).or_default() += 1;
        }
        let steady = step == Some(1);
        if let Some(before) = self.before.filter(|_| steady)
            && before.speed() != frame.speed()
        {
            figures.word_changes[usize::from(index % 6)] += 1;
        }
        self.words.push(frame.speed().0);
        self.teeth.frame(frame);
        self.before = Some(*frame);
        let first = 4 * usize::from(index);
        for (degree, raw) in (first..).zip(frame.raw_readings()) {
            self.reading(degree, raw, steady);
        }
    }

    fn turn(&mut self, turn: &turn::Frame) {
        self.statistics.turns += 1;
        for degree in 0..360 {
            self.reading(degree, turn.raw_reading(degree), true);
        }
    }

    fn reading(&mut self, degree: usize, raw: RawReading, steady: bool) {
        let figures = &mut self.statistics;
        let carried = self.strength;
        match Reading::from(raw) {
            Reading::Range {
                distance_mm,
                strength,
                weak,
            } => {
                self.strength = Some(strength);
                self.range(degree, distance_mm, strength, weak);
            }
            Reading::Invalid { code, strength } => {
                *figures.codes.entry(code).or_default() += 1;
                if code == 0x21 && steady {
                    figures.skipped_at[degree % 24] += 1;
                }
                if matches!(code, 0x21..=0x23 | 0x50 | 0x52) && carried.is_some() {
                    figures.carried[0] += 1;
                    figures.carried[1] += u64::from(carried == Some(strength));
                }
                self.strength = Some(strength);
                self.repeats.gap(degree);
            }
        }
    }

    fn range(&mut self, degree: usize, distance_mm: u16, strength: u16, weak: bool) {
        let figures = &mut self.statistics;
        let mm = f64::from(distance_mm);
        if weak {
            figures.weak += 1;
            figures.weak_max_mm = figures.weak_max_mm.max(distance_mm);
        } else {
            figures.plain += 1;
            self.strengths.push(f64::from(strength) * mm * mm / 1e8);
        }
        if mm < 650.0 {
            self.warnings[0] += 1;
            self.warnings[1] += u64::from(super::is_weak(mm, f64::from(strength)) == weak);
        }
        self.repeats.range(degree, distance_mm);
    }

    fn finish(mut self) -> Statistics {
        let figures = &mut self.statistics;
        self.words.sort_unstable();
        let rpm = |word: Option<&u16>| word.map_or(0.0, |&word| f64::from(word) / 64.0);
        figures.rpm_min = rpm(self.words.first());
        figures.rpm_median = rpm(self.words.get(self.words.len() / 2));
        figures.rpm_max = rpm(self.words.last());
        self.strengths.sort_by(f64::total_cmp);
        figures.strength_d2 = self
            .strengths
            .get(self.strengths.len() / 2)
            .copied()
            .unwrap_or(0.0);
        figures.weak_as_law = share(self.warnings[1], self.warnings[0]);
        figures.noise = self.repeats.bins();
        figures.coast_s = self.teeth.coast_s();
        figures.stalled_packets = self.teeth.stalled_packets();
        self.statistics
    }
}

/// Whether the checksum's fold gives more than 15 bits, so that a carry is dropped.
fn drops_carry(frame: &Frame) -> bool {
    let words = frame.as_bytes()[..20].chunks_exact(2);
    let sum = words.fold(0_u32, |sum, pair| {
        (sum << 1) + u32::from(u16::from_le_bytes([pair[0], pair[1]]))
    });
    (sum & 0x7FFF) + (sum >> 15) > 0x7FFF
}

/// `part` as a share of `all`; zero if `all` is zero.
fn share(part: u64, all: u64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "counts are below 2^53")]
    let (part, all) = (part as f64, all.max(1) as f64);
    part / all
}
