//! `peripherals`: registers of a microcontroller's timers, PWM and ADC, as samples and outputs.

use protocols::peripherals::{
    ADC_MAX, Outputs, OutputsDecoder, OutputsFormat, SAMPLE_LEN, Sample, SampleDecoder,
    SampleFormat,
};
use protocols::{Candidate, Decode as _, Decoder, Format};

use super::floor::Floor;
use super::lua::{Lua, LuaField, field};
use super::row::Codec;
use super::wire::{Broken, Choices, Wire, made_again};

/// Samples in one direction, outputs in the other.
pub static PERIPHERALS: Codec =
    Codec::of::<Peripherals>("Timers, PWM and ADC of a motor board, sampled each millisecond")
        .with_floor(Floor {
            check_bits: 16,
            ..Floor::UNCHECKED
        })
        .with_lua(Lua {
            source: include_str!("lua/peripherals.lua"),
            judge: "judge_peripherals",
            tell: "tell_peripherals",
            fields: &FIELDS,
        });

const FIELDS: [LuaField; 7] = [
    field(
        "per_counter",
        "uint16",
        "hilrig.peripherals.counter",
        "Encoder counter",
    ),
    field("per_adc", "uint16", "hilrig.peripherals.adc", "ADC"),
    field(
        "per_channel",
        "uint8",
        "hilrig.peripherals.channel",
        "ADC channel",
    ),
    field(
        "per_supply",
        "double",
        "hilrig.peripherals.supply",
        "Supply (V)",
    ),
    field(
        "per_button",
        "bool",
        "hilrig.peripherals.button",
        "Button down",
    ),
    field(
        "per_duty",
        "double",
        "hilrig.peripherals.duty",
        "Duty (percent)",
    ),
    field(
        "per_enable",
        "bool",
        "hilrig.peripherals.enable",
        "Drivers on",
    ),
];

/// First byte of outputs.
const OUTPUTS: u8 = 0x81;

/// Both directions of the wire.
#[derive(Clone, Copy, Debug)]
pub struct Peripherals;

/// The format of both directions.
#[derive(Clone, Copy, Debug, Default)]
pub struct EitherWay;

/// A frame of either direction.
#[derive(Clone, Debug)]
pub struct BoardFrame {
    bytes: Vec<u8>,
    meaning: Meaning,
}

#[derive(Clone, Copy, Debug)]
enum Meaning {
    Sample(Sample),
    Outputs(Outputs),
}

impl Meaning {
    fn encode(self) -> Vec<u8> {
        match self {
            Self::Sample(sample) => sample.encode().to_vec(),
            Self::Outputs(outputs) => outputs.encode().to_vec(),
        }
    }
}

impl Format for EitherWay {
    type Frame = BoardFrame;

    fn judge(&self, bytes: &[u8]) -> Candidate {
        match SampleFormat.judge(bytes) {
            Candidate::Noise => OutputsFormat.judge(bytes),
            judged => judged,
        }
    }

    fn frame(&self, bytes: &[u8]) -> BoardFrame {
        let meaning = if bytes.first() == Some(&OUTPUTS) {
            Meaning::Outputs(OutputsFormat.frame(bytes))
        } else {
            Meaning::Sample(SampleFormat.frame(bytes))
        };
        let bytes = bytes.to_vec();
        BoardFrame { bytes, meaning }
    }
}

impl Wire for Peripherals {
    type Decoder = Decoder<EitherWay, SAMPLE_LEN>;
    const NAME: &'static str = "peripherals";

    fn decoder() -> Self::Decoder {
        Self::Decoder::default()
    }

    fn bytes(frame: &BoardFrame) -> &[u8] {
        &frame.bytes
    }

    fn words(frame: &BoardFrame) -> String {
        match &frame.meaning {
            Meaning::Sample(sample) => {
                let [left, right] = sample.counters;
                let volts = f64::from(sample.supply_cv) / 100.0;
                let button = if sample.button { ", button" } else { "" };
                let (channel, adc) = (sample.channel, sample.adc);
                format!(
                    "counters {left} {right}, ADC {channel}: {adc} of {ADC_MAX}, {volts} V{button}"
                )
            }
            Meaning::Outputs(outputs) => {
                let [left, right] = outputs.duty.map(|duty| f64::from(duty) / 100.0);
                let drivers = if outputs.enable { "on" } else { "off" };
                let channel = outputs.channel;
                format!("duty {left} % {right} %, drivers {drivers}, ADC {channel}")
            }
        }
    }

    fn build(choices: &mut Choices<'_>, out: &mut Vec<u8>) {
        let kind = choices.byte();
        let meaning = if kind < 128 {
            Meaning::Sample(Sample {
                counters: [choices.word(), choices.word()],
                adc: choices.word() & ADC_MAX,
                channel: kind & 7,
                supply_cv: choices.word() & 0x3FFF,
                button: kind & 8 != 0,
            })
        } else {
            Meaning::Outputs(Outputs {
                duty: [choices.word(), choices.word()],
                channel: kind & 7,
                enable: kind & 8 != 0,
            })
        };
        out.extend(meaning.encode());
    }

    fn repair(frame: &mut [u8]) {
        let first = if frame.len() < SAMPLE_LEN {
            OUTPUTS
        } else {
            0x80
        };
        for (index, byte) in frame.iter_mut().enumerate() {
            *byte = if index == 0 { first } else { *byte & 0x7F };
        }
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let len = match bytes.first()? {
            0x80 => 12,
            0x81 => 6,
            _ => return None,
        };
        let rest = bytes.get(1..len)?;
        rest.iter().all(|byte| *byte < 128).then_some(len)
    }

    fn is_plausible(frame: &BoardFrame) -> bool {
        frame.meaning.encode() == frame.bytes
    }

    /// Values that no hardware has are clamped, so the test compares the meaning.
    fn means_itself(frame: &BoardFrame) -> Result<(), Broken> {
        let made = frame.meaning.encode();
        let again = match frame.meaning {
            Meaning::Sample(_) => {
                let mut decoder = SampleDecoder::default();
                let found = decoder.push(&made).find_map(Result::ok);
                found.map(Meaning::Sample)
            }
            Meaning::Outputs(_) => {
                let mut decoder = OutputsDecoder::default();
                let found = decoder.push(&made).find_map(Result::ok);
                found.map(Meaning::Outputs)
            }
        };
        made_again(&made, &again.map(Meaning::encode).unwrap_or_default())
    }

    fn kind(frame: &BoardFrame) -> u64 {
        let last = frame.bytes.last().copied().unwrap_or_default();
        (frame.bytes.len() as u64) << 8 | u64::from(last)
    }
}
