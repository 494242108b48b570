//! Figures of a lidar's stream.

use std::collections::BTreeMap;

use protocols::xv11::{self, Reading, turn};
use protocols::{Decode, FrameError};

/// Counts of one stream.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Lidar {
    /// Sound frames: packets, or turns of the old firmware.
    pub frames: u64,
    /// Candidates whose checksum was wrong; turns have none.
    pub bad: u64,
    /// Bytes in no frame, without those at the end that are too few for one.
    pub outside: u64,
    /// Readings with a distance.
    pub ok: u64,
    /// Readings with the strength warning.
    pub weak: u64,
    /// Readings without a distance, by their code.
    pub invalid: BTreeMap<u8, u64>,
}

impl Lidar {
    /// Of packets.
    pub fn of_packets(bytes: &[u8]) -> Self {
        let mut counts = Self::default();
        let mut decoder = xv11::Decoder::default();
        counts.count(&mut decoder, bytes, xv11::FRAME_LEN, |counts, frame| {
            frame.readings().iter().for_each(|&one| counts.reading(one));
        });
        counts
    }

    /// Of turns.
    pub fn of_turns(bytes: &[u8]) -> Self {
        let mut counts = Self::default();
        let mut decoder = turn::Decoder::default();
        counts.count(&mut decoder, bytes, turn::FRAME_LEN, |counts, frame| {
            (0..360).for_each(|degree| counts.reading(frame.reading(degree)));
        });
        counts
    }

    fn count<D: Decode>(
        &mut self,
        decoder: &mut D,
        bytes: &[u8],
        frame_len: usize,
        readings: impl Fn(&mut Self, &D::Frame),
    ) {
        let (mut rest, mut last_end) = (bytes, 0);
        while let Some(outcome) = decoder.step(&mut rest) {
            match outcome {
                Ok(frame) => {
                    last_end = bytes.len() - rest.len() - decoder.pending();
                    self.frames += 1;
                    readings(self, &frame);
                }
                Err(FrameError::Checksum { .. }) => self.bad += 1,
                Err(_) => {}
            }
        }
        let judged = last_end.max((bytes.len() + 1).saturating_sub(frame_len));
        self.outside = judged as u64 - self.frames * frame_len as u64;
    }

    fn reading(&mut self, reading: Reading) {
        match reading {
            Reading::Range { weak: false, .. } => self.ok += 1,
            Reading::Range { weak: true, .. } => self.weak += 1,
            Reading::Invalid { code, .. } => *self.invalid.entry(code).or_default() += 1,
        }
    }
}

impl core::fmt::Display for Lidar {
    /// Two lines: frames, readings.
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self {
            frames,
            bad,
            outside,
            ok,
            weak,
            ..
        } = self;
        writeln!(
            f,
            "{frames} good frames, {bad} bad-checksum candidates, {outside} bytes outside frames"
        )?;
        let invalid: u64 = self.invalid.values().sum();
        write!(
            f,
            "readings: {ok} ok, {weak} strength warnings, {invalid} invalid"
        )?;
        for (code, count) in &self.invalid {
            write!(f, ", {count} x 0x{code:02X}")?;
        }
        Ok(())
    }
}
