//! The slots of a turn: when each is due, and how readings become packets.

use protocols::Instant;
use protocols::xv11::{RawReading, Reading};

use super::encoder::PHASE_SLOTS;
use crate::lidar::rotor::nanos;

/// Duration of a measurement: at a (shown) speed of more than 320 rpm every second slot is skipped.
/// Users report "sparse data above 320 rpm", and the doubled tooth of the "hand in box" capture
/// shows it at 351 rpm.
const MEASUREMENT_S: f64 = 60.0 / 320.0 / 360.0;

/// A run of slots from one known edge on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pace {
    /// The edge.
    pub(super) edge: Instant,
    /// Number of the first slot behind it.
    pub(super) first: u16,
    /// Slots in the run.
    pub(super) count: u16,
    /// Time of a slot, as the firmware assumes.
    pub(super) slot_s: f64,
    /// Angle of the head at the edge, degrees.
    pub(super) angle_deg: f64,
    /// True speed of the head from there on.
    pub(super) deg_per_s: f64,
}

impl Pace {
    /// Time of slot `index` of the run.
    pub(super) fn due(&self, index: u16) -> Instant {
        self.edge + nanos((f64::from(index) + PHASE_SLOTS) * self.slot_s)
    }

    /// Angle of the head at `at`, degrees.
    pub(super) fn angle_at(&self, at: Instant) -> f64 {
        self.angle_deg + self.deg_per_s * (at - self.edge).as_secs_f64()
    }

    /// Whether every second slot must be skipped.
    pub(super) fn is_rushed(&self) -> bool {
        self.slot_s < MEASUREMENT_S
    }
}

/// The turn being measured.
#[derive(Clone, Debug)]
pub(super) struct Scan {
    pub(super) pace: Option<Pace>,
    /// Next slot of the pace.
    index: u16,
    /// Time at which the current packet will be full, or would be in a longer run. Stored, because
    /// it is read far more often than it changes.
    full_at: Option<Instant>,
    /// Readings of the current packet so far.
    readings: [RawReading; 4],
    /// Whether the current packet began with its first reading.
    whole: bool,
    /// Speed word of the current packet, written at its beginning.
    word: u16,
    /// Readings still spoilt by a late tooth.
    pub(super) resync: u8,
    /// Strength of the reading before, which some error codes carry.
    pub(super) strength: u16,
    /// Whether the reading before was measured.
    pub(super) measured: bool,
}

/// A packet that is full.
#[derive(Clone, Copy, Debug)]
pub(super) struct Full {
    /// 0 to 89.
    pub(super) index: u8,
    pub(super) word: u16,
    pub(super) readings: [RawReading; 4],
}

impl Scan {
    pub(super) fn new() -> Self {
        Self {
            pace: None,
            index: 0,
            full_at: None,
            readings: [RawReading([0; 4]); 4],
            whole: false,
            word: 0,
            resync: 0,
            strength: 0,
            measured: false,
        }
    }

    /// Continues with `pace` at its slot `index`. A partial packet is kept only if its next slot is
    /// the next one.
    pub(super) fn follow(&mut self, pace: Pace, index: u16) {
        let before = self.slot();
        self.pace = Some(pace);
        self.index = index;
        self.foresee();
        if before.is_none_or(|slot| slot % 360 != (pace.first + index) % 360) {
            self.whole = false;
        }
    }

    /// Stops measuring.
    pub(super) fn stop(&mut self) {
        self.pace = None;
        self.full_at = None;
        self.whole = false;
        self.resync = 0;
        self.measured = false;
    }

    /// The next slot of the turn, not yet wrapped; `None` without a pace.
    pub(super) fn slot(&self) -> Option<u16> {
        self.pace.map(|pace| pace.first + self.index)
    }

    /// Position of the next slot in its pace.
    pub(super) const fn index(&self) -> u16 {
        self.index
    }

    /// The next slot and its time; `None` when the run is over.
    pub(super) fn next(&self) -> Option<(u16, Instant)> {
        let pace = self.pace.filter(|pace| self.index < pace.count)?;
        Some((pace.first + self.index, pace.due(self.index)))
    }

    /// Time at which the current packet will be full; `None` if the run ends before.
    pub(super) const fn full_at(&self) -> Option<Instant> {
        self.full_at
    }

    fn foresee(&mut self) {
        self.full_at = self.pace.and_then(|pace| {
            let last = self.index + 3 - (pace.first + self.index) % 4;
            (last < pace.count).then(|| pace.due(last))
        });
    }

    /// End of the last slot of the run.
    pub(super) fn end(&self) -> Option<Instant> {
        self.pace.map(|pace| pace.due(pace.count))
    }

    /// Stores the reading of the next slot; returns the packet that it completes.
    pub(super) fn store(&mut self, reading: RawReading, word: u16) -> Option<Full> {
        let slot = self.slot()? % 360;
        self.index += 1;
        self.strength = u16::from_le_bytes([reading.0[2], reading.0[3]]);
        let place = usize::from(slot % 4);
        if place == 0 {
            self.whole = true;
            self.word = word;
        }
        self.readings[place] = reading;
        if place != 3 {
            return None;
        }
        self.foresee();
        if !self.whole {
            return None;
        }
        self.whole = false;
        Some(Full {
            index: u8::try_from(slot / 4).expect("359 / 4 is 89"),
            word: self.word,
            readings: self.readings,
        })
    }

    /// A missing reading, with the strength of the previous one.
    pub(super) fn excuse(&self, code: u8) -> RawReading {
        RawReading::from(Reading::Invalid {
            code,
            strength: self.strength,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Eight slots of 1 ms from slot 358 on; the edge is at 10 ms, at 30 degrees.
    fn pace() -> Pace {
        Pace {
            edge: Instant::from_millis(10),
            first: 358,
            count: 8,
            slot_s: 1e-3,
            angle_deg: 30.0,
            deg_per_s: 1_000.0,
        }
    }

    fn micros(at: Instant) -> u64 {
        at.as_micros()
    }

    /// A slot is due nine tenths of it behind the edge.
    #[test]
    fn slots_are_due_one_after_the_other() {
        let pace = pace();
        assert_eq!(
            [0, 1, 8].map(|index| micros(pace.due(index))),
            [10_900, 11_900, 18_900]
        );
        assert!((pace.angle_at(Instant::from_millis(12)) - 32.0).abs() < 1e-9);
        let rushed = |slot_s| Pace { slot_s, ..pace }.is_rushed();
        // 320 turns a minute are 0.52083 ms a degree.
        assert!(rushed(0.000_520_8) && !rushed(0.000_520_9));
    }

    /// Slots 358 and 359 are the end of a packet that began before; 0 to 3 are the first whole one,
    /// 4 and 5 the begin of the next.
    #[test]
    fn readings_become_packets() {
        let mut scan = Scan::new();
        assert_eq!(
            (scan.next(), scan.slot(), scan.end(), scan.full_at()),
            (None, None, None, None)
        );
        assert!(scan.store(RawReading([1; 4]), 7).is_none());
        scan.follow(pace(), 0);
        assert_eq!(scan.full_at().map(micros), Some(11_900));
        assert_eq!(scan.end().map(micros), Some(18_900));
        let mut packets = Vec::new();
        for number in 0..8_u8 {
            let (slot, at) = scan.next().expect("a slot");
            assert_eq!(
                (slot, micros(at)),
                (358 + u16::from(number), 10_900 + 1_000 * u64::from(number))
            );
            assert_eq!(scan.index(), u16::from(number));
            packets.extend(scan.store(RawReading([number; 4]), 100 + u16::from(number)));
            if number == 1 {
                assert_eq!(scan.full_at().map(micros), Some(15_900));
            }
            if number == 5 {
                assert_eq!(scan.full_at(), None, "the run ends before");
            }
        }
        assert!(scan.next().is_none());
        let [packet] = &packets[..] else {
            panic!("{packets:?}");
        };
        assert_eq!((packet.index, packet.word), (0, 102));
        assert_eq!(packet.readings.map(|reading| reading.0[0]), [2, 3, 4, 5]);
        assert_eq!(scan.strength, 0x0707);
    }

    /// A partial packet is continued by its next slot only.
    #[test]
    fn a_packet_is_kept_if_its_next_slot_follows() {
        let after = |first: u16| {
            let mut scan = Scan::new();
            scan.follow(Pace { first: 0, ..pace() }, 0);
            scan.store(RawReading([1; 4]), 5);
            scan.store(RawReading([2; 4]), 6);
            scan.follow(Pace { first, ..pace() }, 0);
            scan.store(RawReading([3; 4]), 7);
            scan.store(RawReading([4; 4]), 8)
                .map(|packet| (packet.index, packet.word))
        };
        assert_eq!(
            (after(2), after(362), after(6)),
            (Some((0, 5)), Some((0, 5)), None)
        );
        let mut scan = Scan::new();
        scan.follow(Pace { first: 0, ..pace() }, 0);
        (scan.resync, scan.measured) = (3, true);
        scan.store(RawReading([1; 4]), 5);
        scan.stop();
        assert!(!scan.whole && !scan.measured && scan.resync == 0 && scan.slot().is_none());
        // A missing reading has the strength of the one before.
        let code = scan.excuse(0x21);
        assert_eq!(
            code,
            RawReading::from(Reading::Invalid {
                code: 0x21,
                strength: 0x0101
            })
        );
    }
}
