//! Bytes that pass while a client and its device have different rates, so that both read garbage.

use protocols::Instant;

/// Number of bytes of a device at a wrong rate that a client may leave behind: a device that sends
/// by itself continues while the client changes its rate or closes the port.
const STRAY: u64 = 64;

/// Rates of a client and of its device, bit/s.
pub(crate) type Rates = (u32, u32);

/// Bytes at different rates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Garbled {
    /// The first pair of different rates at which bytes passed after others had passed at equal
    /// rates, and the time: one end has changed its rate, the other has not.
    pub since: Option<(Rates, Instant)>,
    /// Bytes from client and device that passed garbled since the last right one.
    pub last: [u64; 2],
    /// The same for all bytes after the first right one.
    pub all: [u64; 2],
    was_right: bool,
    passed: [u64; 2],
}

impl Garbled {
    /// Stores the number of bytes that client and device have sent until `now`. `wrong` has the
    /// different rates since the last call: `Some(None)` if they were equal for all of this time,
    /// `None` if they changed in it.
    pub(crate) fn note(&mut self, now: Instant, sent: [u64; 2], wrong: Option<Option<Rates>>) {
        let before = core::mem::replace(&mut self.passed, sent);
        let more = [0, 1].map(|side| sent[side] - before[side].min(sent[side]));
        match wrong {
            Some(Some(rates)) if more != [0; 2] => {
                self.last = [0, 1].map(|side| self.last[side] + more[side]);
                if self.was_right {
                    self.all = [0, 1].map(|side| self.all[side] + more[side]);
                    self.since = self.since.or(Some((rates, now)));
                }
            }
            Some(None) if more != [0; 2] => {
                self.was_right = true;
                self.last = [0; 2];
            }
            _ => {}
        }
    }

    /// Whether the last bytes passed garbled: those of the client, or many of the device.
    pub const fn is_last(&self) -> bool {
        is_many(self.last)
    }

    /// Whether bytes passed garbled after others at the right rate: some of the client, or many of
    /// the device.
    pub const fn is_forgotten(&self) -> bool {
        is_many(self.all)
    }
}

const fn is_many([client, device]: [u64; 2]) -> bool {
    client > 0 || device >= STRAY
}

#[cfg(test)]
mod tests {
    use super::*;

    const WRONG: Option<Option<Rates>> = Some(Some((300, 4800)));
    const RIGHT: Option<Option<Rates>> = Some(None);

    /// A client that tries rates ends at the right one. One that stays at 300 baud while its device
    /// changes to 4800 reads garbage from then on.
    #[test]
    fn a_rate_is_forgotten_if_it_was_right_before() {
        let at = Instant::from_secs;
        let mut tried = Garbled::default();
        tried.note(at(1), [5, 0], WRONG);
        assert!(tried.is_last());
        tried.note(at(2), [5, 0], RIGHT);
        assert!(tried.is_last(), "no byte passed");
        tried.note(at(3), [9, 4], RIGHT);
        assert_eq!(
            (tried.since, tried.is_last(), tried.is_forgotten()),
            (None, false, false)
        );

        tried.note(at(4), [9, 20], None);
        tried.note(at(5), [9, 20 + 63], WRONG);
        assert_eq!(
            (tried.since, tried.is_last()),
            (Some(((300, 4800), at(5))), false)
        );
        tried.note(at(6), [9, 20 + 64], WRONG);
        assert!(tried.is_last());
        tried.note(at(7), [10, 90], RIGHT);
        assert_eq!(
            (tried.since, tried.is_last()),
            (Some(((300, 4800), at(5))), false)
        );
        assert_eq!((tried.all, tried.is_forgotten()), ([0, 64], true));
        tried.note(at(8), [11, 90], WRONG);
        assert!(tried.is_last());
    }
}
