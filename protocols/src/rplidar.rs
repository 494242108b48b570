//! RPLIDAR A1 lidar: requests of the host, answers and scans of the sensor.
//!
//! ```text
//! request     | A5 | command |                                     command below 80
//!             | A5 | command | size | payload | xor of all before | command from 80 on
//! answer      | A5 5A | length (30 bits) mode (2 bits) u32 | kind | payload |
//! node        | quality(7..2) !S(1) S(0) | angle q6 u15, 1(0) | distance q2 u16 |
//! capsule     | A, xor low | 5, xor high | angle q6 u15, S(15) | 16 cabins of 5 bytes |
//! cabin       | distance(15..2) dtheta(1..0) | the same again | dtheta low nibbles |
//! kind 0x84   | as a capsule, with 32 cabins of 4 bytes of three samples each |
//! ```
//!
//! All words are little-endian. Mode 1 is a stream: the payload repeats without end. Its payloads
//! are nodes of five bytes (standard scan), capsules of 84 (express scan) or of 132 (kind 0x84,
//! three samples in four bytes). The descriptor determines the answers behind it, so the
//! [`Decoder`] stores the last descriptor.
//!
//! Sources: protocol document LR001 v1.0 (2017-05-15), data sheet LD108 v1.0, the vendor's SDK
//! where it differs from them.

mod answer;
mod capsule;
mod decoder;
mod node;
mod request;
#[cfg(test)]
mod tests;
mod ultra;

pub use answer::{
    ANSWER_MAX, Answer, Conf, ConfKey, Descriptor, Health, Info, PAYLOAD_MAX, Reply, SampleRate,
    Status, Transfer, kind,
};
pub use capsule::{CAPSULE_LEN, CAPSULE_SAMPLES, Capsule, CapsuleSample, Sample};
pub use decoder::{Decoder, Frame, Mode};
pub use node::{NODE_LEN, Node};
pub use request::{Command, REQUEST_MAX, Request, RequestDecoder, Requests, code};
pub use ultra::{ULTRA_LEN, ULTRA_SAMPLES, UltraCapsule, lead_q11};

/// Rate of the line, 8N1.
pub const BAUD: u32 = 115_200;
/// First byte of a request, and of a descriptor.
pub const START: u8 = 0xA5;
/// Second byte of a descriptor.
pub const ANSWER_START: u8 = 0x5A;
/// Bytes of a descriptor.
pub const DESCRIPTOR_LEN: usize = 7;
/// Angle units in a turn: 64ths of a degree.
pub const TURN_Q6: u16 = 360 * 64;
