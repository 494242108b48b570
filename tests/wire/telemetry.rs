//! Telemetry of the robot yellow: frames by a slow reference method.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::telemetry::{self, FRAME_MAX, Frame};

use crate::protocol::{Protocol, Wire};

impl Wire for Frame {
    fn wire(&self) -> Vec<u8> {
        let mut bytes = vec![0; FRAME_MAX];
        let len = self.encode(&mut bytes).expect("room for the longest");
        bytes.truncate(len);
        bytes
    }
}

/// Both directions of the link.
pub(crate) struct Telemetry;

impl Protocol for Telemetry {
    type Decoder = telemetry::Decoder;

    const TELLING: &'static [u8] = &[0x7E, 0x7D, 0x5E, 0x5D, 0x00];
    const CASES: u32 = 1000;

    fn decoder() -> telemetry::Decoder {
        telemetry::Decoder::default()
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        if bytes.first() != Some(&0x7E) {
            return None;
        }
        let (mut plain, mut at) = (Vec::new(), 1);
        loop {
            let byte = *bytes.get(at)?;
            at += 1;
            plain.push(match byte {
                0x7E => return None,
                0x7D => {
                    at += 1;
                    match bytes.get(at - 1)? {
                        0x5E => 0x7E,
                        0x5D => 0x7D,
                        _ => return None,
                    }
                }
                byte => byte,
            });
            let [high, low, ref rest @ ..] = plain[..] else {
                continue;
            };
            let len = 256 * usize::from(high) + usize::from(low);
            if len > 3200 {
                return None;
            }
            if rest.len() == len + 1 {
                let sum: u32 = rest.iter().map(|&byte| u32::from(byte)).sum();
                return (sum % 256 == 255).then_some(at);
            }
        }
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        let byte = prop_oneof![3 => any::<u8>(), 1 => Just(0x7E), 1 => Just(0x7D)];
        let payload = vec(byte, 0..60);
        let frame = payload.prop_map(|payload| {
            let mut bytes = vec![0; FRAME_MAX];
            let len = telemetry::encode(&payload, &mut bytes).expect("room for the longest");
            bytes.truncate(len);
            bytes
        });
        frame.boxed()
    }
}
