//! What goes wrong on a line, as data: when, where, how often.
//!
//! A fault is first a *rate* ("one byte in a hundred") and becomes a list of *strikes* ("byte 1234,
//! bit 3") while the run goes. The strikes are what a saved case holds: they mean the same in every
//! later version, a seed does not.

use std::collections::BTreeMap;
use std::collections::VecDeque;

use emulators::rng::Rng;
use protocols::Instant;
use serde::{Deserialize, Serialize};

/// What happens to a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Damage {
    /// One bit is inverted; 0 is the least significant, larger numbers wrap at 8.
    Flip {
        /// Which bit.
        bit: u8,
    },
    /// The byte never arrives.
    Drop,
    /// Another byte arrives before it.
    Insert {
        /// The other byte.
        value: u8,
    },
    /// The byte arrives twice.
    Duplicate,
}

/// The kinds of [`Damage`], without their details.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum DamageKind {
    /// See [`Damage::Flip`].
    Flip,
    /// See [`Damage::Drop`].
    Drop,
    /// See [`Damage::Insert`].
    Insert,
    /// See [`Damage::Duplicate`].
    Duplicate,
}

impl DamageKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Flip, Self::Drop, Self::Insert, Self::Duplicate];

    fn with_detail(self, detail: u8) -> Damage {
        match self {
            Self::Flip => Damage::Flip { bit: detail % 8 },
            Self::Drop => Damage::Drop,
            Self::Insert => Damage::Insert { value: detail },
            Self::Duplicate => Damage::Duplicate,
        }
    }
}

/// A span of time, its end excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First instant inside.
    pub from: Instant,
    /// First instant after.
    pub until: Instant,
}

impl Window {
    /// The whole run.
    pub const ALWAYS: Self = Self {
        from: Instant::ZERO,
        until: Instant::from_nanos(u64::MAX),
    };

    /// Whether nothing lies inside.
    pub fn is_empty(self) -> bool {
        self.until <= self.from
    }

    /// Whether `now` lies inside.
    pub fn contains(self, now: Instant) -> bool {
        self.from <= now && now < self.until
    }
}

/// Number of a fault in the schedule of a run: its place in the list, counted from zero.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct FaultId(pub usize);

impl core::fmt::Display for FaultId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.fmt(f)
    }
}

/// Damage that strikes at random.
#[derive(Clone, Debug)]
struct Rate {
    id: FaultId,
    kind: DamageKind,
    window: Window,
    /// Chance per byte, 0 to 1.
    chance: f64,
    rng: Rng,
}

/// One byte that was, or is to be, damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Strike {
    /// Number of the byte on its line, counted from zero as sent.
    pub byte: u64,
    /// What happens to it.
    pub damage: Damage,
}

/// All that goes wrong on one direction of a link.
#[derive(Clone, Debug, Default)]
pub struct LineFaults {
    rates: Vec<Rate>,
    planned: BTreeMap<u64, Vec<Damage>>,
    cuts: Vec<(FaultId, Window)>,
    struck: VecDeque<Strike>,
}

impl LineFaults {
    /// Adds damage at random: `chance` per byte, drawn from `rng` for every byte of the run,
    /// inside the window or not, so that changing one fault never shifts another.
    pub fn add_rate(
        &mut self,
        id: FaultId,
        kind: DamageKind,
        window: Window,
        chance: f64,
        rng: Rng,
    ) {
        self.rates.push(Rate {
            id,
            kind,
            window,
            chance,
            rng,
        });
    }

    /// Adds damage to a certain byte.
    pub fn add_strike(&mut self, strike: Strike) {
        self.planned
            .entry(strike.byte)
            .or_default()
            .push(strike.damage);
    }

    /// Adds a time in which nothing gets through.
    pub fn add_cut(&mut self, id: FaultId, window: Window) {
        self.cuts.push((id, window));
    }

    /// Ends a fault that has a window at `at`, if it would go on for longer.
    pub fn end(&mut self, id: FaultId, at: Instant) {
        let rates = self
            .rates
            .iter_mut()
            .map(|rate| (rate.id, &mut rate.window));
        let cuts = self.cuts.iter_mut().map(|(id, window)| (*id, window));
        for (_, window) in rates.chain(cuts).filter(|(found, _)| *found == id) {
            window.until = window.until.min(at);
        }
    }

    /// Takes back damage to a certain byte; whether it was still to come.
    pub fn remove_strike(&mut self, strike: Strike) -> bool {
        let Some(damages) = self.planned.get_mut(&strike.byte) else {
            return false;
        };
        let place = damages.iter().position(|&damage| damage == strike.damage);
        place.map(|place| damages.remove(place)).is_some()
    }

    /// Whether nothing was ever planned to go wrong.
    pub fn is_clean(&self) -> bool {
        self.rates.is_empty() && self.planned.is_empty() && self.cuts.is_empty()
    }

    /// Every byte damaged so far, in order; cuts are not in the list.
    pub fn struck(&self) -> impl Iterator<Item = &Strike> {
        self.struck.iter()
    }

    /// Damage to certain bytes that is still to come, in order.
    pub fn to_come(&self) -> impl Iterator<Item = Strike> {
        let planned = self.planned.iter();
        planned
            .flat_map(|(&byte, damages)| damages.iter().map(move |&damage| Strike { byte, damage }))
    }

    /// How many strikes there were so far.
    pub(crate) fn struck_len(&self) -> usize {
        self.struck.len()
    }

    /// Whether nothing gets through at `now`.
    pub(crate) fn is_cut(&self, now: Instant) -> bool {
        self.cuts.iter().any(|(_, cut)| cut.contains(now))
    }

    /// What the far end gets of `byte`, the `number`-th on this line, sent at `now`.
    pub fn strike(&mut self, number: u64, byte: u8, now: Instant, out: &mut Vec<u8>) {
        let mut damages = self.planned.remove(&number).unwrap_or_default();
        for rate in &mut self.rates {
            // Two draws per byte whatever comes of them, see `add_rate`.
            let hit = rate.rng.chance(rate.chance);
            let detail = rate.rng.next_u64().to_le_bytes()[0];
            if hit && rate.window.contains(now) {
                damages.push(rate.kind.with_detail(detail));
            }
        }
        self.struck.extend(damages.iter().map(|&damage| Strike {
            byte: number,
            damage,
        }));
        if self.is_cut(now) {
            return;
        }
        apply(byte, &damages, out);
    }
}

fn apply(mut byte: u8, damages: &[Damage], out: &mut Vec<u8>) {
    let mut copies = 1_usize;
    for &damage in damages {
        match damage {
            Damage::Flip { bit } => byte ^= 1 << (bit % 8),
            Damage::Drop => copies = 0,
            Damage::Insert { value } => out.push(value),
            Damage::Duplicate => copies *= 2,
        }
    }
    out.extend(core::iter::repeat_n(byte, copies));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(faults: &mut LineFaults, bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        for (number, &byte) in (0..).zip(bytes) {
            faults.strike(number, byte, Instant::from_micros(number), &mut out);
        }
        out
    }

    #[test]
    fn each_damage_hits_the_byte_it_names() {
        let strike = |byte, damage| Strike { byte, damage };
        let mut faults = LineFaults::default();
        faults.add_strike(strike(0, Damage::Flip { bit: 7 }));
        faults.add_strike(strike(1, Damage::Drop));
        faults.add_strike(strike(2, Damage::Insert { value: 0xEE }));
        faults.add_strike(strike(3, Damage::Duplicate));
        assert_eq!(
            through(&mut faults, &[1, 2, 3, 4, 5]),
            [0x81, 0xEE, 3, 4, 4, 5]
        );
        assert_eq!(faults.struck().count(), 4);
    }

    #[test]
    fn a_cut_silences_its_window_only() {
        let mut faults = LineFaults::default();
        let window = Window {
            from: Instant::from_micros(1),
            until: Instant::from_micros(3),
        };
        faults.add_cut(FaultId(0), window);
        assert_eq!(through(&mut faults, &[1, 2, 3, 4]), [1, 4]);
    }

    /// What a random fault did, written down and run again, does the same.
    #[test]
    fn recorded_strikes_repeat_what_the_rate_did() {
        let bytes: Vec<u8> = (0..=255).cycle().take(4000).collect();
        let mut random = LineFaults::default();
        for kind in DamageKind::ALL {
            random.add_rate(
                FaultId(0),
                kind,
                Window::ALWAYS,
                0.02,
                Rng::stream(1, &format!("{kind:?}")),
            );
        }
        let first = through(&mut random, &bytes);
        assert_ne!(first, bytes);

        let mut recorded = LineFaults::default();
        random
            .struck()
            .for_each(|&strike| recorded.add_strike(strike));
        assert_eq!(through(&mut recorded, &bytes), first);
    }

    #[test]
    fn a_rate_of_zero_touches_nothing() {
        let mut faults = LineFaults::default();
        for kind in DamageKind::ALL {
            let rng = Rng::stream(1, "none");
            faults.add_rate(FaultId(0), kind, Window::ALWAYS, 0.0, rng);
        }
        assert_eq!(through(&mut faults, &[7; 1000]), [7; 1000]);
    }
}
