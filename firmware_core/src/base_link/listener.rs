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
