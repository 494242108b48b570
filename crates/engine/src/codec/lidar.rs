//! Figures of a lidar's stream.

use std::collections::{BTreeMap, BTreeSet};

use protocols::xv11::{self, Reading, turn};
use protocols::{Decode, FrameError};

/// Distances and strengths of the readings of one kind.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Ranges {
    /// Number of readings.
    pub count: u64,
    /// Minimum and maximum distance.
    pub distance_mm: Option<[u16; 2]>,
    /// Minimum and maximum strength.
    pub strength: Option<[u16; 2]>,
}

impl Ranges {
    fn add(&mut self, distance_mm: u16, strength: u16) {
        self.count += 1;
        let wider = |range: Option<[u16; 2]>, value: u16| {
            let [low, high] = range.unwrap_or([value; 2]);
            Some([low.min(value), high.max(value)])
        };
        self.distance_mm = wider(self.distance_mm, distance_mm);
        self.strength = wider(self.strength, strength);
    }

    fn write(&self, name: &str, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (Some([near, far]), Some([dim, bright])) = (self.distance_mm, self.strength) else {
            return Ok(());
        };
        write!(f, "\n{name}: {near}..{far} mm, strength {dim}..{bright}")
    }
}

/// Counts of one stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lidar {
    /// Sound frames: packets, or turns of the old firmware.
    pub frames: u64,
    /// Candidates with a wrong checksum; turns have none.
    pub bad: u64,
    /// Bytes in no frame.
    pub outside: u64,
    /// Bytes at the end that begin an incomplete frame.
    pub cut: u64,
    /// Readings with a distance.
    pub ok: Ranges,
    /// Readings with the strength warning.
    pub weak: Ranges,
    /// Readings without a distance, by their code.
    pub invalid: BTreeMap<u8, u64>,
    /// Speed words of the packets in order of size.
    pub speeds: Vec<u16>,
    /// Differences between consecutive packet indices, modulo 90, with their counts.
    pub steps: BTreeMap<u8, u64>,
    /// Distances in bytes from one turn's header to the next's.
    pub gaps: BTreeSet<u64>,
    /// Period words of the turns.
    pub periods: BTreeSet<u16>,
    /// Position and content of the boot text.
    pub boot: Option<(usize, String)>,
}

impl Lidar {
    /// Statistics of packets.
    pub fn of_packets(bytes: &[u8]) -> Self {
        let mut counts = Self::default();
        let mut decoder = xv11::Decoder::default();
        let mut last = None;
        counts.count(&mut decoder, bytes, xv11::FRAME_LEN, |counts, frame, _| {
            frame.readings().iter().for_each(|&one| counts.reading(one));
            counts.speeds.push(frame.speed().0);
            if let Some(last) = last.replace(frame.index()) {
                let step = (frame.index() + 90 - last) % 90;
                *counts.steps.entry(step).or_default() += 1;
            }
        });
        counts.speeds.sort_unstable();
        counts.boot = boot_text(bytes, &[xv11::START]);
        counts
    }

    /// Statistics of turns.
    pub fn of_turns(bytes: &[u8]) -> Self {
        let mut counts = Self::default();
        let mut decoder = turn::Decoder::default();
        let mut last = None;
        counts.count(
            &mut decoder,
            bytes,
            turn::FRAME_LEN,
            |counts, frame, end| {
                (0..360).for_each(|degree| counts.reading(frame.reading(degree)));
                counts.periods.insert(frame.period());
                if let Some(last) = last.replace(end) {
                    counts.gaps.insert((end - last) as u64);
                }
            },
        );
        counts.boot = boot_text(bytes, &turn::HEADER);
        counts
    }

    /// Turns per minute: minimum, median, mean, maximum. `None` without packets.
    pub fn rpm(&self) -> Option<[f64; 4]> {
        let rpm = |word: u16| f64::from(word) / 64.0;
        let (first, last) = (self.speeds.first()?, self.speeds.last()?);
        let count = self.speeds.len();
        let sum: f64 = self.speeds.iter().map(|&word| rpm(word)).sum();
        let middle = [self.speeds[(count - 1) / 2], self.speeds[count / 2]].map(rpm);
        let median = (middle[0] + middle[1]) / 2.0;
        Some([rpm(*first), median, sum / count as f64, rpm(*last)])
    }

    fn count<D: Decode>(
        &mut self,
        decoder: &mut D,
        bytes: &[u8],
        frame_len: usize,
        mut add: impl FnMut(&mut Self, &D::Frame, usize),
    ) {
        let mut rest = bytes;
        while let Some(outcome) = decoder.step(&mut rest) {
            match outcome {
                Ok(frame) => {
                    let end = bytes.len() - rest.len() - decoder.pending();
                    self.frames += 1;
                    add(self, &frame, end);
                }
                Err(FrameError::Checksum { .. }) => self.bad += 1,
                Err(_) => {}
            }
        }
        // Less than a frame is left. The decoder would have discarded bytes that do not begin a
        // frame.
        self.cut = decoder.pending() as u64;
        self.outside = bytes.len() as u64 - self.frames * frame_len as u64;
    }

    fn reading(&mut self, reading: Reading) {
        match reading {
            Reading::Range {
                distance_mm,
                strength,
                weak,
            } => {
                let ranges = if weak { &mut self.weak } else { &mut self.ok };
                ranges.add(distance_mm, strength);
            }
            Reading::Invalid { code, .. } => *self.invalid.entry(code).or_default() += 1,
        }
    }
}

/// Common part of the banners of all generations, after two letters and a line end.
const BANNER: &[u8] = b"\n\rPiccolo";
/// Maximum length of the printed text.
const TEXT_MAX: usize = 400;

/// Position of the banner, and the text from there to a frame's `header`. The old firmware's banner
/// begins with a letter.
fn boot_text(bytes: &[u8], header: &[u8]) -> Option<(usize, String)> {
    let at = bytes
        .windows(BANNER.len())
        .position(|part| part == BANNER)?;
    let greeted = [&b"OK"[..], b":)"]
        .iter()
        .any(|hello| bytes[..at].ends_with(hello));
    let start = if greeted { at - 2 } else { at };
    let is_text = |byte: &&u8| matches!(byte, b' '..=b'~' | b'\r' | b'\n' | b'\t');
    let mut len = bytes[start..].iter().take_while(is_text).count();
    let is_header = |&at: &usize| {
        let next = &bytes[start + at..];
        // At the end of all bytes, a single byte of the header may also be a letter of the text.
        next.len() >= 2 && next.iter().zip(header).all(|(a, b)| a == b)
    };
    len = (0..len).find(is_header).unwrap_or(len);
    let text = &bytes[start..start + len.min(TEXT_MAX)];
    Some((start, text.escape_ascii().to_string()))
}

impl core::fmt::Display for Lidar {
    /// Prints the available data, one line each: frames, speed, readings, ranges, boot text.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let (frames, bad, outside) = (self.frames, self.bad, self.outside);
        write!(
            f,
            "{frames} good frames, {bad} bad-checksum candidates, {outside} bytes outside frames"
        )?;
        if self.cut > 0 {
            write!(f, ", {} of them begin a frame that was cut off", self.cut)?;
        }
        if let Some([min, median, mean, max]) = self.rpm() {
            write!(
                f,
                "\nrpm min {min:.2} median {median:.2} mean {mean:.2} max {max:.2}"
            )?;
        }
        let mut steps: Vec<_> = self.steps.iter().collect();
        steps.sort_by_key(|&(step, count)| (core::cmp::Reverse(count), step));
        for (index, (step, count)) in steps.iter().take(8).enumerate() {
            let gap = if index == 0 { "\nindex steps:" } else { "," };
            write!(f, "{gap} {count} x {step}")?;
        }
        if !self.periods.is_empty() {
            let words: Vec<_> = self
                .periods
                .iter()
                .map(|word| format!("{word:#06x}"))
                .collect();
            let gaps: Vec<_> = self.gaps.iter().map(u64::to_string).collect();
            let (words, gaps) = (words.join(" "), gaps.join(" "));
            write!(
                f,
                "\nperiod words: {words}\nbytes from header to header: {gaps}"
            )?;
        }
        let invalid: u64 = self.invalid.values().sum();
        let (ok, weak) = (self.ok.count, self.weak.count);
        write!(
            f,
            "\nreadings: {ok} ok, {weak} strength warnings, {invalid} invalid"
        )?;
        for (code, count) in &self.invalid {
            write!(f, ", {count} x 0x{code:02X}")?;
        }
        self.ok.write("ok", f)?;
        self.weak.write("strength warnings", f)?;
        match &self.boot {
            Some((at, text)) => write!(f, "\nboot text at byte {at}: \"{text}\""),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First packet of the capture "hand in box", fw 2.4.
    const PACKET: &[u8; xv11::FRAME_LEN] =
        b"\xFA\xA0\x4E\x4A\x27\x01\x05\x04\x27\x01\xD7\x03\x26\x01\x29\x04\x26\x01\xF0\x03\x3C\x5C";

    /// Eight independent clients counted more bytes than the summary showed.
    #[test]
    fn every_byte_is_in_a_frame_or_outside_also_at_the_end() {
        let noise = Lidar::of_packets(&[&PACKET[..], b"some text"].concat());
        assert_eq!((noise.frames, noise.outside, noise.cut), (1, 9, 0));
        let cut = Lidar::of_packets(&[&PACKET[..], &PACKET[..21]].concat());
        assert_eq!((cut.frames, cut.bad, cut.outside, cut.cut), (1, 0, 21, 21));
        let said = cut.to_string();
        let tail = "21 bytes outside frames, 21 of them begin a frame that was cut off\n";
        assert!(said.contains(tail), "{said}");
    }

    /// The old firmware's header begins with 5A, the letter Z; a Z of the text is no header.
    #[test]
    fn the_boot_text_ends_where_a_turn_begins() {
        let mut bytes = b":)\n\rPiccolo Z\n\r# abort".to_vec();
        bytes.extend(turn::HEADER);
        bytes.resize(bytes.len() + turn::FRAME_LEN - turn::HEADER.len(), 0);
        let lidar = Lidar::of_turns(&bytes);
        let text = ":)\\n\\rPiccolo Z\\n\\r# abort".to_owned();
        assert_eq!((lidar.frames, lidar.boot), (1, Some((0, text))));
    }
}
