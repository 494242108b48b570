//! Registers of a motor board, samples and outputs on one line: frames by a slow reference method.

use hilrig::codec::{BoardFrame, Peripherals, wire};
use proptest::prelude::*;
use protocols::peripherals::{Outputs, Sample};

use crate::protocol::{Protocol, Wire};

/// Finds both kinds of frames and keeps their bytes.
type Decoder = <Peripherals as wire::Wire>::Decoder;

impl Wire for BoardFrame {
    fn wire(&self) -> Vec<u8> {
        <Peripherals as wire::Wire>::bytes(self).to_vec()
    }
}

/// Both directions of the wire.
pub(crate) struct Registers;

impl Protocol for Registers {
    type Decoder = Decoder;

    const TELLING: &'static [u8] = &[0x80, 0x81, 0x82, 0x7F, 0x00];
    const CHECKED: bool = false;

    fn decoder() -> Decoder {
        Decoder::default()
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let len = match bytes.first()? {
            0x80 => 12,
            0x81 => 6,
            _ => return None,
        };
        let rest = bytes.get(1..len)?;
        rest.iter().all(|byte| byte >> 7 == 0).then_some(len)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        let sample = (
            any::<[u16; 2]>(),
            0_u16..4096,
            0_u8..8,
            0_u16..16384,
            any::<bool>(),
        );
        let sample = sample.prop_map(|(counters, adc, channel, supply_cv, button)| {
            let sample = Sample {
                counters,
                adc,
                channel,
                supply_cv,
                button,
            };
            sample.encode().to_vec()
        });
        let outputs = (any::<[u16; 2]>(), 0_u8..8, any::<bool>());
        let outputs = outputs.prop_map(|(duty, channel, enable)| {
            let outputs = Outputs {
                duty,
                channel,
                enable,
            };
            outputs.encode().to_vec()
        });
        prop_oneof![sample, outputs].boxed()
    }
}
