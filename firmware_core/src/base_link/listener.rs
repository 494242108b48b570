use protocols::avr::START;

use super::Defects;
use crate::memory::StrayWrites;

/// The fielded program's receive interrupt, as far as it stores: each data byte goes straight into
/// the caller's buffer, before anything is checked. It also stores what follows the data and only
/// then compares its counter, so the first byte of the checksum goes one past the data.
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
    /// So many bytes of the checksum are still to come.
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

    /// A new listener is armed with each request.
    pub(super) const fn arm(&mut self) {
        self.state = State::Start;
    }

    /// A byte comes in while a reply of `wanted` bytes is waited for; `None`: nobody waits, and the
    /// buffer belongs to somebody else by now.
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
