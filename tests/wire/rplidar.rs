//! RPLIDAR requests, by a slow reference method. The laws of the sensor's own bytes are in
//! `corpus.rs`, because a node is valid only behind its descriptor.

use proptest::collection::vec;
use proptest::prelude::*;
use protocols::rplidar::{Command, Request, RequestDecoder, Requests as Format};

use crate::protocol::{Protocol, Wire};

impl Wire for Request {
    fn wire(&self) -> Vec<u8> {
        self.as_bytes().to_vec()
    }
}

/// Frames to the sensor.
pub(crate) struct Requests;

impl Protocol for Requests {
    type Decoder = RequestDecoder;

    const TELLING: &'static [u8] = &[0xA5, 0x20, 0x25, 0x82, 0xF0, 0x02, 0x05];
    const CASES: u32 = 1000;

    fn decoder() -> RequestDecoder {
        RequestDecoder::with_format(Format)
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let &[0xA5, command, ..] = bytes else {
            return None;
        };
        if command < 0x80 {
            return Some(2);
        }
        let end = 3 + usize::from(*bytes.get(2)?);
        let sum = bytes.get(..end)?.iter().fold(0, |sum, byte| sum ^ byte);
        (*bytes.get(end)? == sum).then_some(end + 1)
    }

    fn frame() -> BoxedStrategy<Vec<u8>> {
        let plain = prop_oneof![
            Just(Command::Stop),
            Just(Command::Scan),
            Just(Command::Info),
            (0..3_u8).prop_map(|mode| Command::ExpressScan { mode }),
            any::<u16>().prop_map(|pwm| Command::MotorPwm { pwm }),
        ];
        let known = plain.prop_map(|command| command.request().wire());
        let any = (any::<u8>(), vec(any::<u8>(), 0..20));
        let any = any.prop_map(|(code, payload)| Request::with_payload(code, &payload).wire());
        prop_oneof![3 => known, 1 => any].boxed()
    }
}
