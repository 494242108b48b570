use protocols::avr::START;

use crate::memory::StrayWrites;

/// Bus defects of the fielded program; none by default. The ids are those of the project's list of
/// field defects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// The checksum's first byte is stored behind the data, outside the buffer (MA-01).
    pub stores_checksum: bool,
    /// The reply's announced number of bytes is stored instead of the requested one (MA-02).
    pub unbounded_store: bool,
    /// The counter of stored bytes is a signed 8-bit number (MA-03).
    pub signed_counter: bool,
    /// A reply with fewer bytes than requested is accepted; the rest is stale data (MA-04).
    pub takes_short_replies: bool,
    /// An acknowledgement is accepted as data; all bytes are stale (MA-05).
    pub takes_acknowledgements: bool,
    /// A frame without a waiting reader is stored where the last reader's buffer was (MA-06).
    pub writes_when_nobody_waits: bool,
    /// Failures are not counted, so the slave never counts as silent (MA-07).
    pub ignores_failures: bool,
    /// A request is sent while another one waits for its answer (MA-08).
    pub preempts_itself: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        stores_checksum: false,
        unbounded_store: false,
        signed_counter: false,
        takes_short_replies: false,
        takes_acknowledgements: false,
        writes_when_nobody_waits: false,
        ignores_failures: false,
        preempts_itself: false,
    };
}

/// The fielded program's receive interrupt, as far as it stores data. Each data byte goes straight
/// into the caller's buffer, before any check. The counter is compared only after the next byte is
/// stored, so the first byte of the checksum goes one past the data.
#[derive(Clone, Debug)]
pub(super) struct Listener {
    state: State,
    index: i16,
    count: i16,
    pub(super) stray: StrayWrites,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Start,
    Register,
    Count,
    Data,
    /// Number of checksum bytes still to come.
    Checksum(u8),
}

impl Listener {
    pub(super) const fn new() -> Self {
        Self {
            state: State::Start,
            index: 0,
            count: 0,
            stray: StrayWrites::NONE,
        }
    }

    /// Prepares the listener for a new request.
    pub(super) const fn arm(&mut self) {
        self.state = State::Start;
    }

    /// Takes a byte while a reply of `wanted` bytes is expected. `None`: no reader waits, and the
    /// buffer of the last reader now holds other data.
    pub(super) fn take(&mut self, byte: u8, wanted: Option<u8>, defects: &Defects) {
        self.state = match self.state {
            State::Start if byte == START => State::Register,
            State::Start => State::Start,
            State::Register => State::Count,
            State::Count => {
                (self.index, self.count) = (0, i16::from(byte & 0x7F));
                if byte & 0x80 == 0 {
                    State::Checksum(2)
                } else {
                    State::Data
                }
            }
            State::Data => self.store(wanted, defects),
            State::Checksum(2) => State::Checksum(1),
            State::Checksum(_) => State::Start,
        };
    }

    fn store(&mut self, wanted: Option<u8>, defects: &Defects) -> State {
        let room = wanted.map_or(0, i16::from);
        let is_stray = match wanted {
            None => defects.writes_when_nobody_waits,
            Some(_) if self.index < 0 => defects.signed_counter,
            Some(_) if self.index < room => false,
            Some(_) if self.count > room => defects.unbounded_store,
            Some(_) => defects.stores_checksum,
        };
        if is_stray {
            self.stray.note(i32::from(self.index));
        }
        self.index += 1;
        if self.index > i16::from(i8::MAX) && defects.signed_counter {
            self.index = i16::from(i8::MIN);
        }
        if self.index > self.count {
            State::Checksum(1)
        } else {
            State::Data
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec;
    use std::vec::Vec;

    use super::*;

    /// Number of bytes stored outside a buffer of `wanted`, and the offset of the last one.
    fn strays(defects: Defects, wanted: Option<u8>, bytes: &[u8]) -> (u32, i32) {
        let mut listener = Listener::new();
        for byte in bytes {
            listener.take(*byte, wanted, &defects);
        }
        (listener.stray.count, listener.stray.last)
    }

    /// Noise, then a write of `count` bytes with its checksum.
    fn frame(count: u8) -> Vec<u8> {
        let mut bytes = vec![0x55, START, 0x24, 0x80 | count];
        bytes.extend(vec![7; usize::from(count)]);
        bytes.extend([0x01, 0x02]);
        bytes
    }

    const CHECKSUM: Defects = Defects {
        stores_checksum: true,
        ..Defects::NONE
    };

    /// MA-01: one byte behind the data, in each frame; an acknowledgement between them has none.
    #[test]
    fn the_checksum_is_stored_behind_the_data() {
        assert_eq!(strays(CHECKSUM, Some(2), &frame(2)), (1, 2));
        assert_eq!(strays(Defects::NONE, Some(2), &frame(2)).0, 0);
        assert_eq!(strays(CHECKSUM, Some(3), &frame(2)).0, 0);
        let both = [frame(2), frame(2)].concat();
        assert_eq!(strays(CHECKSUM, Some(2), &both), (2, 2));
        let acknowledged = [&[START, 0x24, 0, 0x01, 0x02][..], &frame(2)].concat();
        assert_eq!(strays(CHECKSUM, Some(2), &acknowledged), (1, 2));
        let read = [&[START, 0x24, 3, START, START][..], &frame(2)].concat();
        assert_eq!(strays(CHECKSUM, Some(2), &read), (1, 2));
    }

    /// MA-02: two bytes were requested and four arrive: two of them, and the checksum, are too
    /// many.
    #[test]
    fn a_longer_reply_is_stored_whole() {
        let unbounded_store = Defects {
            unbounded_store: true,
            ..Defects::NONE
        };
        assert_eq!(strays(unbounded_store, Some(2), &frame(4)), (3, 4));
        assert_eq!(strays(unbounded_store, Some(4), &frame(4)).0, 0);
        assert_eq!(strays(CHECKSUM, Some(2), &frame(4)).0, 0);
    }

    /// MA-03: after the 128th byte of a frame of 127 the offset becomes -128.
    #[test]
    fn the_counter_of_bytes_falls_below_zero() {
        let signed_counter = Defects {
            signed_counter: true,
            ..Defects::NONE
        };
        let mut bytes = vec![START, 0x24, 0xFF];
        bytes.extend(vec![7; 128]);
        assert_eq!(strays(signed_counter, Some(10), &bytes).0, 0);
        bytes.extend([7; 2]);
        assert_eq!(strays(signed_counter, Some(10), &bytes), (2, -127));
        assert_eq!(strays(Defects::NONE, Some(10), &bytes).0, 0);
        assert_eq!(strays(signed_counter, Some(10), &frame(2)).0, 0);
    }

    /// MA-06: two bytes and the checksum are stored where the last reader's buffer was.
    #[test]
    fn a_frame_that_nobody_waits_for_is_stored_as_well() {
        let unguarded = Defects {
            writes_when_nobody_waits: true,
            ..Defects::NONE
        };
        assert_eq!(strays(unguarded, None, &frame(2)), (3, 2));
        assert_eq!(strays(unguarded, Some(2), &frame(2)).0, 0);
        assert_eq!(strays(CHECKSUM, None, &frame(2)).0, 0);
    }

    /// An armed listener waits for the start of a frame, independent of earlier bytes.
    #[test]
    fn an_armed_listener_begins_anew() {
        let mut listener = Listener::new();
        listener.take(START, Some(2), &CHECKSUM);
        listener.arm();
        for byte in frame(2) {
            listener.take(byte, Some(2), &CHECKSUM);
        }
        assert_eq!(listener.stray.count, 1);
    }
}
