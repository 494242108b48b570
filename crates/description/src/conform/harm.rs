//! Bytes that a device could take for a request with an effect, even if it does not verify
//! checksums, ends frames by their length instead of a silence, or starts in the middle.

use std::sync::Arc;

use protocols::Decode as _;

use super::probes;
use crate::behaviour::Trigger;
use crate::description::{Description, Protocol};
use crate::framing::{Frame, Frames, cutter};
use crate::schema::behaviour::EventSpec;
use crate::schema::message::From;

/// Modbus functions that only read.
const READS: core::ops::RangeInclusive<u8> = 1..=4;
/// Number of bytes of a request with one of them, with address and CRC.
const READ_LEN: usize = 8;
/// Maximum number of bytes of a Modbus RTU frame (serial line specification V1.02, section 2.5.1).
const RTU_MAX: usize = 256;

impl Description {
    /// Whether `bytes`, which a pause ends, leave the state of a device unchanged: they are known
    /// requests without an effect, or no device can find another request in them. A device may
    /// ignore checksums, end frames by their length, or start in the middle.
    pub fn is_harmless(&self, bytes: &[u8]) -> bool {
        if self.has_effect_of(EventSpec::Refused) {
            return false;
        }
        self.is_request_without_effect(bytes)
            || self.is_checked()
                && !self.has_effect_of(EventSpec::BadFrame)
                && self.holds_known_only(bytes)
                && !self.may_hold_effect(bytes)
    }

    /// Like [`is_harmless`](Self::is_harmless), for bytes that are sent once or twice and then
    /// followed by `next`: a device that waits for the rest of a frame takes it from there.
    pub fn is_harmless_before(&self, bytes: &[u8], next: &[u8]) -> bool {
        self.is_harmless(bytes)
            && (self.is_request_without_effect(bytes)
                || !self.may_hold_effect(&[bytes, bytes, next, next].concat()))
    }

    /// Whether a request may follow bytes after which a device waits for the rest of a frame.
    pub fn may_follow_damage(&self, request: &[u8]) -> bool {
        !self.may_hold_effect(&request.repeat(2))
    }

    /// Whether `bytes`, which a pause ends, leave the state of a device unchanged if it verifies
    /// checksums and ends frames as described.
    pub fn keeps_state(&self, bytes: &[u8]) -> bool {
        if self.ends_with_silence() {
            let all = self.whole(bytes);
            return all.map_or(self.is_checked(), |frame| self.leaves_state(&frame));
        }
        let frames = self.frames_in(&self.frames_of(From::Host), bytes);
        let is_known = frames.iter().all(|frame| self.leaves_state(frame));
        is_known && (self.is_checked() || self.is_request_without_effect(bytes))
    }

    /// Whether the bytes hold a Modbus frame with a correct checksum and another address than the
    /// device's. Other devices on the line answer it.
    pub fn is_for_others(&self, bytes: &[u8]) -> bool {
        let Some(own) = self.address.filter(|_| self.protocol.is_some()) else {
            return false;
        };
        if self.protocol == Some(Protocol::ModbusRtu) {
            return (0..bytes.len()).any(|at| u32::from(bytes[at]) != own && has_crc(&bytes[at..]));
        }
        let frames = self.frames_in(&self.frames_of(From::Host), bytes);
        let mut bodies = frames.iter().filter_map(|frame| self.body(frame));
        bodies.any(|body| {
            body.first()
                .is_some_and(|address| u32::from(*address) != own)
        })
    }

    /// Whether the bytes are frames that a driver sends, without an effect and without other
    /// bytes between them. A pause in the middle of them is as likely as in other requests.
    fn is_request_without_effect(&self, bytes: &[u8]) -> bool {
        if self.protocol == Some(Protocol::ModbusRtu) && bytes.len() != READ_LEN {
            return false;
        }
        if self.ends_with_silence() {
            let all = self.whole(bytes);
            return all.is_ok_and(|frame| self.leaves_state(&frame));
        }
        let mut cutter = self.cutter_of(From::Host);
        let mut found: Vec<_> = cutter.push(bytes).collect();
        let is_whole = cutter.pending() == 0 && cutter.discarded() == 0;
        cutter.idle();
        found.extend(cutter.push(&[]));
        is_whole
            && found
                .iter()
                .all(|frame| frame.as_ref().is_ok_and(|frame| self.leaves_state(frame)))
    }

    /// Whether all requests have a checksum.
    fn is_checked(&self) -> bool {
        let formats = self.frames_of(From::Host);
        let mut used = (0..self.formats()).filter(|format| formats.looks_for(*format));
        used.all(|format| !self.frames.0[format].checks.is_empty())
    }

    /// Whether an event has an effect by the description.
    fn has_effect_of(&self, event: EventSpec) -> bool {
        let own = Trigger::Event(event);
        let mut on = self.on.iter().filter(|on| on.trigger == own);
        let mut after = self.after.iter().filter(|after| after.trigger == own);
        on.any(|on| !on.deed.set.is_empty() || on.write.is_some() || on.restarts)
            || after.any(|after| !after.deed.set.is_empty())
    }

    /// Whether a frame is a known request without an effect.
    fn leaves_state(&self, frame: &Frame) -> bool {
        self.effect(frame) == Some(false)
    }

    /// Whether a frame is a request with an effect; `None` if it is unknown.
    fn effect(&self, frame: &Frame) -> Option<bool> {
        let body = self.body(frame)?;
        if self.protocol.is_some() {
            return body.get(1).map(|function| !READS.contains(function));
        }
        let (index, _) = self.decode(frame.format, &body, From::Host)?;
        Some(probes::changes(self, index))
    }

    /// The formats of the driver's frames without their checksums.
    fn unchecked_frames(&self) -> Frames {
        let mut formats = self.frames.0.to_vec();
        for format in &mut formats {
            format.checks.clear();
            format.plain = None;
        }
        self.frames_of(From::Host).with_formats(Arc::new(formats))
    }

    /// The frames that a device cuts out of bytes, which a silence ends.
    fn frames_in(&self, formats: &Frames, bytes: &[u8]) -> Vec<Frame> {
        let mut cutter = cutter(formats.clone());
        let mut found: Vec<Frame> = cutter.push(bytes).flatten().collect();
        cutter.idle();
        found.extend(cutter.push(&[]).flatten());
        if formats.ends_with_silence() {
            found.extend(formats.whole(bytes));
        }
        found
    }

    /// Whether all frames that begin at the first byte or behind another frame are known requests
    /// without an effect, whatever their checksums are.
    fn holds_known_only(&self, bytes: &[u8]) -> bool {
        let is_known = |formats: &Frames| {
            let frames = self.frames_in(formats, bytes);
            frames.iter().all(|frame| self.leaves_state(frame))
        };
        match self.protocol {
            Some(Protocol::ModbusRtu) => {
                let functions = bytes.chunks(READ_LEN).filter_map(|frame| frame.get(1));
                { functions }.all(|function| READS.contains(function))
            }
            _ => is_known(&self.unchecked_frames()) && is_known(&self.frames_of(From::Host)),
        }
    }

    /// Whether a device that starts at any byte could find a request with an effect.
    fn may_hold_effect(&self, bytes: &[u8]) -> bool {
        match self.protocol {
            Some(Protocol::ModbusRtu) => (0..bytes.len()).any(|at| may_be_other_rtu(&bytes[at..])),
            Some(Protocol::ModbusAscii) => (0..bytes.len())
                .any(|at| (at == 0 || bytes[at] == b':') && may_be_other_ascii(&bytes[at..])),
            None => {
                let formats = self.unchecked_frames();
                let suffixes = (0..bytes.len()).map(|at| &bytes[at..]);
                let prefixes = (1..bytes.len()).map(|end| &bytes[..end]);
                let ends_anywhere = formats.ends_with_silence();
                let mut parts = suffixes.chain(prefixes.filter(|_| ends_anywhere));
                parts.any(|part| {
                    let frames = self.frames_in(&formats, part);
                    frames.iter().any(|frame| self.effect(frame) == Some(true))
                })
            }
        }
    }
}

/// Minimum number of bytes of a request with a function of the application protocol specification
/// V1.1b3, with address and CRC; `None` for functions that it does not define.
const fn least_len(function: u8) -> Option<usize> {
    Some(match function {
        // Exception status, event counter and log, server's number.
        7 | 11 | 12 | 17 => 4,
        // A queue.
        24 => 6,
        // Other interfaces.
        43 => 7,
        // Writes of one, diagnosis; writes of several, also in the shorter form of their response.
        5 | 6 | 8 | 15 | 16 => 8,
        // A mask.
        22 => 10,
        // Records of files.
        20 | 21 => 12,
        // An exchange.
        23 => 13,
        _ => return None,
    })
}

/// Whether `bytes` can begin with a request of another function than a read: the bytes are enough
/// for a function that Modbus defines, or any function has a correct CRC.
fn may_be_other_rtu(bytes: &[u8]) -> bool {
    let Some(&function) = bytes.get(1) else {
        return false;
    };
    !READS.contains(&function)
        && (least_len(function).is_some_and(|len| bytes.len() >= len) || has_crc(bytes))
}

/// Whether the CRC of Modbus RTU is correct behind four or more of the bytes.
fn has_crc(bytes: &[u8]) -> bool {
    let mut crc = 0xFFFF_u16;
    for (len, byte) in (1..).zip(&bytes[..bytes.len().min(RTU_MAX)]) {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            crc = match crc & 1 {
                1 => crc >> 1 ^ 0xA001,
                _ => crc >> 1,
            };
        }
        // With its own checksum the value is 0.
        if crc == 0 && len >= 4 {
            return true;
        }
    }
    false
}

/// Whether a line that begins here, with or without its colon, can have another function than a
/// read.
fn may_be_other_ascii(bytes: &[u8]) -> bool {
    let digits = bytes.strip_prefix(b":").unwrap_or(bytes);
    match digits.get(2..4) {
        None => false,
        Some([b'0', low]) => !(b'1'..=b'4').contains(low),
        Some(_) => true,
    }
}
