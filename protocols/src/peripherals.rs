//! Messages between a microcontroller's core and hardware that has no serial port: counters of
//! wheel encoders, PWM, one multiplexed ADC, pins.
//!
//! On a real board these are registers of the chip, so this wire is the rig's own. The hardware
//! samples them each millisecond, as the program's fastest loop does.
//!
//! ```text
//! sample   80 | left counter 3 | right counter 3 | ADC 2 | supply 2 | channel, button 1
//! outputs  81 | left duty 2 | right duty 2 | channel, enable 1
//! ```
//!
//! Values are cut into groups of seven bits, the lowest first. Only a first byte has its top bit
//! set, so a decoder is in sync again at the next frame.

use crate::{Candidate, Decoder, Format, FrameError};

/// First byte of a sample.
const SAMPLE: u8 = 0x80;
/// First byte of outputs.
const OUTPUTS: u8 = 0x81;
/// Bytes of a sample.
pub const SAMPLE_LEN: usize = 12;
/// Bytes of outputs.
pub const OUTPUTS_LEN: usize = 6;
/// The largest value of the ADC, at its reference voltage.
pub const ADC_MAX: u16 = 4_095;
/// The largest duty: always high.
pub const DUTY_MAX: u16 = 10_000;
/// Channels of the ADC's multiplexer.
pub const CHANNELS: u8 = 8;

/// Inputs from the hardware in one millisecond.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sample {
    /// Counters of the left and right wheel's encoder, which wrap.
    pub counters: [u16; 2],
    /// Value of the ADC, 0 to [`ADC_MAX`], for [`channel`](Self::channel).
    pub adc: u16,
    /// Channel of the multiplexer that the value is of, below [`CHANNELS`].
    pub channel: u8,
    /// Supply voltage, in units of a hundredth of a volt, 0 to 16383.
    pub supply_cv: u16,
    /// Whether the user button is down.
    pub button: bool,
}

/// Outputs of the program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outputs {
    /// Duty of the left and right motor's PWM, 0 to [`DUTY_MAX`].
    pub duty: [u16; 2],
    /// Channel of the ADC's multiplexer, below [`CHANNELS`].
    pub channel: u8,
    /// Whether the motor drivers are on.
    pub enable: bool,
}

impl Sample {
    /// The sample's frame; values that are too large are cut to their bits.
    pub fn encode(&self) -> [u8; SAMPLE_LEN] {
        let [left, right] = self.counters.map(u32::from).map(groups);
        let (adc, supply) = (groups(self.adc.into()), groups(self.supply_cv.into()));
        let last = self.channel & 0x07 | u8::from(self.button) << 3;
        [
            SAMPLE, left[0], left[1], left[2], right[0], right[1], right[2], adc[0], adc[1],
            supply[0], supply[1], last,
        ]
    }

    fn parse(bytes: [u8; SAMPLE_LEN]) -> Self {
        let [_, l0, l1, l2, r0, r1, r2, a0, a1, s0, s1, last] = bytes;
        Self {
            counters: [value([l0, l1, l2]), value([r0, r1, r2])],
            adc: value([a0, a1, 0]).min(ADC_MAX),
            channel: last & 0x07,
            supply_cv: value([s0, s1, 0]),
            button: last & 0x08 != 0,
        }
    }
}

impl Outputs {
    /// The frame; values that are too large are cut to their maximum.
    pub fn encode(&self) -> [u8; OUTPUTS_LEN] {
        let duty = self.duty.map(|duty| groups(duty.min(DUTY_MAX).into()));
        let last = self.channel & 0x07 | u8::from(self.enable) << 3;
        let [left, right] = duty;
        [OUTPUTS, left[0], left[1], right[0], right[1], last]
    }

    fn parse(bytes: [u8; OUTPUTS_LEN]) -> Self {
        let [_, l0, l1, r0, r1, last] = bytes;
        Self {
            duty: [[l0, l1, 0], [r0, r1, 0]].map(|bytes| value(bytes).min(DUTY_MAX)),
            channel: last & 0x07,
            enable: last & 0x08 != 0,
        }
    }
}

/// Frames of the hardware.
#[derive(Clone, Copy, Debug, Default)]
pub struct SampleFormat;

/// Finds [`Sample`]s.
pub type SampleDecoder = Decoder<SampleFormat, SAMPLE_LEN>;

impl Format for SampleFormat {
    type Frame = Sample;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        judge(bytes, SAMPLE, SAMPLE_LEN)
    }

    fn frame(&self, bytes: &[u8]) -> Sample {
        bytes.try_into().map(Sample::parse).unwrap_or_default()
    }
}

/// Frames of the program.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutputsFormat;

/// Finds [`Outputs`].
pub type OutputsDecoder = Decoder<OutputsFormat, OUTPUTS_LEN>;

impl Format for OutputsFormat {
    type Frame = Outputs;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        judge(bytes, OUTPUTS, OUTPUTS_LEN)
    }

    fn frame(&self, bytes: &[u8]) -> Outputs {
        bytes.try_into().map(Outputs::parse).unwrap_or_default()
    }
}

fn judge(bytes: &[u8], first: u8, len: usize) -> Candidate {
    if bytes[0] != first {
        return Candidate::Noise;
    }
    let found = 1 + bytes[1..].iter().take_while(|byte| **byte < 0x80).count();
    if found >= len {
        Candidate::Complete(len)
    } else if found < bytes.len() {
        let found = u32::try_from(found).unwrap_or(u32::MAX);
        Candidate::Rejected(FrameError::Truncated { found })
    } else {
        Candidate::Incomplete
    }
}

/// Groups of seven bits, the lowest first.
const fn groups(value: u32) -> [u8; 3] {
    let [low, high, highest, _] =
        (value & 0x7F | (value & 0x3F80) << 1 | (value & 0x1F_C000) << 2).to_le_bytes();
    [low, high, highest]
}

fn value(groups: [u8; 3]) -> u16 {
    let [low, high, highest] = groups.map(u16::from);
    low | high << 7 | (highest & 0x03) << 14
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Decode as _;

    /// 0xFFFF is 7F 7F 03, 0x8081 is 01 01 02, 4095 is 7F 1F, 1150 is 7E 08, 10000 is 10 4E.
    #[test]
    fn frames_are_laid_out_by_hand() {
        let sample = Sample {
            counters: [0xFFFF, 0x8081],
            adc: 4_095,
            channel: 5,
            supply_cv: 1_150,
            button: true,
        };
        let bytes = [0x80, 0x7F, 0x7F, 3, 1, 1, 2, 0x7F, 0x1F, 0x7E, 8, 0x0D];
        assert_eq!(sample.encode(), bytes);
        let mut decoder = SampleDecoder::default();
        assert_eq!(decoder.push(&bytes).next(), Some(Ok(sample)));
        let outputs = Outputs {
            duty: [10_000, 5_000],
            channel: 2,
            enable: true,
        };
        let bytes = [0x81, 0x10, 0x4E, 0x08, 0x27, 0x0A];
        assert_eq!(outputs.encode(), bytes);
        let mut decoder = OutputsDecoder::default();
        assert_eq!(decoder.push(&bytes).next(), Some(Ok(outputs)));
    }

    #[test]
    fn duties_beyond_the_whole_are_the_whole() {
        let outputs = Outputs {
            duty: [u16::MAX, 0],
            ..Outputs::default()
        };
        assert_eq!(outputs.encode()[1..3], [0x10, 0x4E]);
        let mut decoder = OutputsDecoder::default();
        let frame = decoder.push(&[0x81, 0x7F, 0x7F, 0, 0, 0]).next();
        assert_eq!(
            frame.map(|frame| frame.map(|it| it.duty[0])),
            Some(Ok(10_000))
        );
    }

    /// Off is bit 3 clear, whatever the channel is; 4096 of the ADC, 00 20, is
    /// beyond its reference.
    #[test]
    fn switches_that_are_off_are_read_so() {
        let mut decoder = OutputsDecoder::default();
        let outputs = Outputs {
            channel: 7,
            ..Outputs::default()
        };
        assert_eq!(
            decoder.push(&[0x81, 0, 0, 0, 0, 7]).next(),
            Some(Ok(outputs))
        );
        let mut decoder = SampleDecoder::default();
        let sample = Sample {
            adc: 4_095,
            channel: 7,
            ..Sample::default()
        };
        let bytes = [0x80, 0, 0, 0, 0, 0, 0, 0, 0x20, 0, 0, 7];
        assert_eq!(decoder.push(&bytes).next(), Some(Ok(sample)));
    }

    /// The next frame's first byte shows that this frame ended after five bytes.
    #[test]
    fn a_frame_that_is_cut_is_reported_at_once() {
        let mut decoder = SampleDecoder::default();
        let truncated = Some(Err(FrameError::Truncated { found: 5 }));
        assert_eq!(decoder.push(&[0x80, 1, 2, 3, 4, 0x80]).next(), truncated);
    }

    /// A lost byte costs its frame and no other.
    #[test]
    fn the_frame_behind_a_lost_byte_is_found() {
        let sample = Sample {
            counters: [1_000, 2_000],
            ..Sample::default()
        };
        let bytes = sample.encode();
        for lost in 0..SAMPLE_LEN {
            let mut decoder = SampleDecoder::default();
            let mut found = 0;
            for at in 0..3 * SAMPLE_LEN {
                if at != lost {
                    let frames = decoder.push(&bytes[at % SAMPLE_LEN..][..1]);
                    found += frames.filter(|frame| *frame == Ok(sample)).count();
                }
            }
            assert_eq!(found, 2, "without byte {lost}");
        }
    }
}
