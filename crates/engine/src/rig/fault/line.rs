//! All faults of one direction of a link.

mod calm;
mod message;

use core::time::Duration;
use std::collections::{BTreeMap, VecDeque};

use emulators::rng::Rng;
use protocols::{Instant, LineConfig};

use super::{Activity, Budget, Damage, DamageKind, Effect, FaultId, Gate, Strike, Trigger, Window};
use crate::rig::line::{Mark, MarkDamage};

/// Maximum number of strikes that are stored for the saved case. Later strikes take effect but are
/// not stored.
pub const STRIKES_MAX: usize = 1 << 20;

#[derive(Clone, Debug)]
struct Entry {
    id: FaultId,
    activity: Activity,
    effect: Effect,
    /// Number of bytes with drawn random numbers, among all counted bytes.
    drawn: u64,
}

/// Indices of the entries to check. Recomputed after each change.
#[derive(Clone, Debug, Default)]
struct Order {
    is_known: bool,
    /// Entries with random damage that have begun or wait for an event, and are not over.
    striking: Vec<usize>,
    /// Entries with random damage that begin later, the next one last.
    later: Vec<usize>,
    /// Entries with other effects.
    others: Vec<usize>,
    /// Entries that wait for an event.
    waiting: Vec<usize>,
    /// A time in which no entry is active.
    calm: Option<Window>,
}

/// All faults of one direction of a link.
#[derive(Clone, Debug, Default)]
pub struct LineFaults {
    entries: Vec<Entry>,
    order: Order,
    /// Number of bytes counted since the line has had faults.
    counted: u64,
    planned: BTreeMap<u64, Vec<Damage>>,
    struck: VecDeque<Strike>,
    /// End of each struck byte on the line.
    struck_at: VecDeque<Instant>,
    wire: Wire,
}

/// State of damage for the following bytes.
#[derive(Clone, Debug, Default)]
struct Wire {
    /// Number of bytes still to be garbled, and the inverted bits.
    burst: (u16, u8),
    /// Bytes still to be lost unless the sender pauses.
    truncated: u16,
    /// A byte that is swapped with the next one.
    held: Option<u8>,
    /// End of the last bytes of the sender.
    quiet_from: Instant,
    /// Number of frames that have begun.
    frames: u64,
}

/// Output of the line for consecutive bytes of the sender.
#[derive(Debug, Default)]
pub(crate) struct Passed {
    /// The bytes.
    pub(crate) bytes: Vec<u8>,
    /// Pauses of the sender: the index in `bytes` of the byte after each, and its duration.
    pub(crate) pauses: Vec<(usize, Duration)>,
    /// Bytes with a parity error.
    pub(crate) parity_errors: u32,
    /// Characters with a parity error: read values and positions.
    pub(crate) marks: Vec<Mark>,
    /// Maximum number of bytes that are delivered at once.
    pub(crate) piece: Option<usize>,
    /// Delay of the bytes.
    pub(crate) late: Duration,
    /// Whether the sender receives its own bytes.
    pub(crate) echo: bool,
    /// The active faults.
    pub(crate) effects: Vec<&'static str>,
}

impl LineFaults {
    /// Adds a fault.
    pub fn add(&mut self, id: FaultId, activity: Activity, effect: Effect) {
        self.entries.push(Entry {
            id,
            activity,
            effect,
            drawn: self.counted,
        });
        self.order.is_known = false;
    }

    /// Adds random damage with `chance` per byte. Random numbers are drawn from `rng` for every
    /// byte of the run, inside the window or not, so that a change of one fault never shifts
    /// another one. Numbers for bytes before the window are drawn at its start; bytes after the
    /// window need none.
    pub fn add_rate(
        &mut self,
        id: FaultId,
        kind: DamageKind,
        window: Window,
        chance: f64,
        rng: Rng,
    ) {
        let (left, rng) = (None, Box::new(rng));
        let effect = Effect::Strikes {
            kind,
            chance,
            left,
            rng,
        };
        self.add(id, window.into(), effect);
    }

    /// Adds damage to a certain byte.
    pub fn add_strike(&mut self, strike: Strike) {
        self.planned
            .entry(strike.byte)
            .or_default()
            .push(strike.damage);
    }

    /// Adds a time in which all bytes are lost.
    pub fn add_cut(&mut self, id: FaultId, window: Window) {
        self.add(id, window.into(), Effect::Cut);
    }

    /// Ends a fault with a window at `at`, if it would continue for longer.
    pub fn end(&mut self, id: FaultId, at: Instant) {
        let entries = self.entries.iter_mut().filter(|entry| entry.id == id);
        entries.for_each(|entry| entry.activity.end(at));
        self.order.is_known = false;
    }

    /// Changes the window of a fault that has one.
    pub(crate) fn move_to(&mut self, id: FaultId, window: Window) {
        let entries = self.entries.iter_mut().filter(|entry| entry.id == id);
        entries.for_each(|entry| entry.activity.window = window);
        self.order.is_known = false;
    }

    /// Removes a fault that has not begun.
    pub(crate) fn leave_out(&mut self, id: FaultId) {
        self.entries.retain(|entry| entry.id != id);
        self.order.is_known = false;
    }

    /// Renumbers the faults.
    pub(crate) fn renumber(&mut self, to: impl Fn(FaultId) -> FaultId) {
        let entries = self.entries.iter_mut();
        entries.for_each(|entry| entry.id = to(entry.id));
    }

    /// Activity of the fault, as far as known.
    pub fn activity(&self, id: FaultId) -> Option<&Activity> {
        let mut entries = self.entries.iter();
        let entry = entries.find(|entry| entry.id == id)?;
        Some(&entry.activity)
    }

    /// Removes damage to a certain byte; returns whether the byte was not yet sent.
    pub fn remove_strike(&mut self, strike: Strike) -> bool {
        let Some(damages) = self.planned.get_mut(&strike.byte) else {
            return false;
        };
        let place = damages.iter().position(|&damage| damage == strike.damage);
        place.map(|place| damages.remove(place)).is_some()
    }

    /// Whether no fault is active or planned, and no effect continues.
    pub fn is_clean(&self) -> bool {
        self.entries.is_empty() && self.planned.is_empty() && self.wire.is_clean()
    }

    /// Every byte damaged so far, in order, at most [`STRIKES_MAX`].
    pub fn struck(&self) -> impl Iterator<Item = &Strike> {
        self.struck.iter()
    }

    /// Every byte damaged so far with its end on the line, in order.
    pub fn struck_times(&self) -> impl Iterator<Item = (Strike, Instant)> {
        self.struck
            .iter()
            .copied()
            .zip(self.struck_at.iter().copied())
    }

    /// Damage to certain bytes that are not sent yet, in order.
    pub fn to_come(&self) -> impl Iterator<Item = Strike> {
        let planned = self.planned.iter();
        planned
            .flat_map(|(&byte, damages)| damages.iter().map(move |&damage| Strike { byte, damage }))
    }

    /// Number of damaged bytes so far.
    pub(crate) fn struck_len(&self) -> usize {
        self.struck.len()
    }

    /// Number of sent bytes that wait for another byte.
    pub(crate) const fn held(&self) -> u64 {
        self.wire.held.is_some() as u64
    }

    /// The actual coding at `now` of a sender with `line`.
    pub(crate) fn sender_line(&self, line: LineConfig, now: Instant) -> LineConfig {
        let active = self.others();
        active
            .filter(|entry| entry.activity.is_active(now))
            .fold(line, |line, entry| match &entry.effect {
                Effect::WrongBaud(rate) => rate.of(line, now - entry.activity.window.from),
                _ => line,
            })
    }

    /// The effect that withholds bytes that arrive at `at`, if any.
    pub(crate) fn gate(&self, at: Instant) -> Option<Gate> {
        let gates = self.others().filter_map(|entry| {
            let fifo = match entry.effect {
                Effect::Stall => None,
                Effect::Overrun { fifo } => Some(fifo),
                _ => return None,
            };
            // Bytes that arrive at the start of the fault were sent before and pass. This also
            // holds if the fault begins when another byte is sent.
            let spell = entry
                .activity
                .spell_at(at)
                .filter(|spell| spell.from < at)?;
            let opens = spell.until;
            Some(Gate { opens, fifo })
        });
        gates.max_by_key(|gate| gate.opens)
    }

    /// Entries without random damage; all entries until the order is known.
    fn others(&self) -> impl Iterator<Item = &Entry> {
        let is_known = self.order.is_known;
        let all = if is_known { 0 } else { self.entries.len() };
        let others = if is_known { self.order.others.len() } else { 0 };
        let others = self.order.others[..others].iter();
        let others = others.map(|&index| &self.entries[index]);
        self.entries[..all].iter().chain(others)
    }

    /// Updates the lists of entries that matter from `now` on. Time never decreases.
    fn look(&mut self, now: Instant) {
        let (entries, order) = (&self.entries, &mut self.order);
        if !order.is_known {
            *order = Order {
                is_known: true,
                ..Order::default()
            };
            for (index, entry) in entries.iter().enumerate() {
                let activity = &entry.activity;
                if activity.trigger.is_some() {
                    order.waiting.push(index);
                }
                if !matches!(entry.effect, Effect::Strikes { .. }) {
                    order.others.push(index);
                } else if activity.trigger.is_some() {
                    order.striking.push(index);
                } else {
                    order.later.push(index);
                }
            }
            let begin = |index: &usize| entries[*index].activity.window.from;
            order
                .later
                .sort_by_key(|index| core::cmp::Reverse(begin(index)));
        }
        let has_begun = |index: &&usize| entries[**index].activity.window.from <= now;
        while let Some(&index) = order.later.last().filter(has_begun) {
            order.later.pop();
            let place = order.striking.partition_point(|other| *other < index);
            order.striking.insert(place, index);
        }
        let is_over = |index: &usize| entries[*index].activity.is_over(now);
        order.striking.retain(|index| !is_over(index));
    }

    /// Passes `sent` through the faults; its first byte has number `first` on this line. A sender
    /// with `line` sends the bytes back to back from `start` on.
    pub(crate) fn pass(
        &mut self,
        first: u64,
        sent: &[u8],
        start: Instant,
        line: LineConfig,
        budget: &mut Budget,
        passed: &mut Passed,
    ) {
        self.notice(first, sent.len() as u64, start, line);
        self.look(start);
        let mut hosts = Vec::new();
        let mut is_cut = false;
        for &index in &self.order.others {
            let entry = &mut self.entries[index];
            if !entry.activity.is_active(start) {
                continue;
            }
            match &mut entry.effect {
                Effect::Host(damage) => hosts.push(*damage),
                Effect::Echo => passed.echo = true,
                Effect::Cut => is_cut = true,
                Effect::ShortRead { len } => {
                    passed.piece = Some(passed.piece.unwrap_or(*len).min(*len));
                }
                Effect::Latency { by } => passed.late += *by,
                Effect::Jitter { by, rng } => {
                    let most = u64::try_from(by.as_nanos()).unwrap_or(u64::MAX - 1);
                    passed.late += Duration::from_nanos(rng.below(most + 1));
                }
                Effect::Strikes { .. } => continue,
                Effect::Stall | Effect::Overrun { .. } | Effect::WrongBaud(_) => {}
            }
            passed.effects.push(entry.effect.words());
        }
        let len = sent.len() as u64;
        if hosts.is_empty() && self.is_harmless(first, len) {
            self.count(len, start, line);
            if passed.effects.is_empty() {
                self.order.calm = self.calm_from(start);
            }
            if !is_cut {
                passed.bytes.extend_from_slice(sent);
            }
            return;
        }
        for (number, &byte) in (first..).zip(sent) {
            let damages = self.damages(number, start, budget);
            if self.struck_at.len() < self.struck.len() {
                let at = start + line.bytes_time(number - first + 1);
                self.struck_at.resize(self.struck.len(), at);
            }
            let byte = hosts.iter().try_fold(byte, |byte, damage| damage.of(byte));
            if !is_cut {
                self.wire.apply(byte, &damages, passed);
            }
        }
        self.wire.quiet_from = start + line.bytes_time(len);
    }

    /// Counts `len` bytes that no fault changes.
    fn count(&mut self, len: u64, start: Instant, line: LineConfig) {
        self.counted += len;
        self.wire.quiet_from = start + line.bytes_time(len);
    }

    /// Whether no byte of the `len` from number `first` on can be damaged, and no random number is
    /// drawn for any. Usual case: a line whose faults have not begun or are over.
    fn is_harmless(&self, first: u64, len: u64) -> bool {
        self.order.striking.is_empty()
            && self.wire.is_clean()
            && (self.planned.is_empty() || self.planned.range(first..first + len).next().is_none())
    }

    /// Counts frames, ends effects at a pause, and starts effects that waited for this frame.
    fn notice(&mut self, first: u64, len: u64, start: Instant, line: LineConfig) {
        // Bytes are not counted without faults: the next byte begins a frame.
        let is_first = first == 0 || self.wire.frames == 0;
        if is_first || start >= self.wire.quiet_from + line.bytes_time(2) {
            self.wire.truncated = 0;
            self.wire.frames += 1;
        }
        self.fire(first + len, self.wire.frames - 1, start);
    }

    /// Starts effects that waited for one of the bytes up to `bytes`, or for this frame.
    fn fire(&mut self, bytes: u64, frame: u64, start: Instant) {
        if self.order.is_known && self.order.waiting.is_empty() {
            return;
        }
        for entry in &mut self.entries {
            let has_come = match entry.activity.trigger {
                None => false,
                Some(Trigger::Byte(byte)) => byte < bytes,
                Some(Trigger::Frame(wanted)) => wanted <= frame,
            };
            if has_come {
                entry.activity.fire(start);
                self.order.is_known = false;
            }
        }
    }

    /// Damage to byte `number`, sent at `now`, the time of the last [`look`](Self::look).
    fn damages(&mut self, number: u64, now: Instant, budget: &mut Budget) -> Vec<Damage> {
        let mut damages = self.planned.remove(&number).unwrap_or_default();
        for &index in &self.order.striking {
            let entry = &mut self.entries[index];
            let Effect::Strikes {
                kind,
                chance,
                left,
                rng,
            } = &mut entry.effect
            else {
                continue;
            };
            for _ in 0..2 * (self.counted - entry.drawn) {
                rng.next_u64();
            }
            entry.drawn = self.counted + 1;
            // Each byte needs two random numbers whatever their result, see `add_rate`.
            let hit = rng.chance(*chance);
            let detail = rng.next_u64().to_le_bytes()[0];
            if hit && *left != Some(0) && entry.activity.is_active(now) && budget.spend(now) {
                *left = left.map(|left| left - 1);
                damages.push(kind.with_detail(detail));
            }
        }
        self.counted += 1;
        if self.struck.len() < STRIKES_MAX {
            self.struck.extend(damages.iter().map(|&damage| Strike {
                byte: number,
                damage,
            }));
        }
        damages
    }
}

impl Wire {
    const fn is_clean(&self) -> bool {
        self.burst.0 == 0 && self.truncated == 0 && self.held.is_none()
    }

    /// Adds the output for `byte`. `None` if an earlier damage removed the byte.
    fn apply(&mut self, byte: Option<u8>, damages: &[Damage], passed: &mut Passed) {
        let waiting = self.held.take();
        let mut byte = byte;
        let mut copies = 1_usize;
        for &damage in damages {
            match damage {
                Damage::Flip { bit } => byte = byte.map(|byte| byte ^ 1 << (bit % 8)),
                Damage::Drop => copies = 0,
                Damage::Insert { value } => passed.bytes.push(value),
                Damage::Duplicate => copies *= 2,
                Damage::Burst { len, mask } => self.burst = (len, mask),
                Damage::Truncate { len } => self.truncated = len,
                Damage::Swap => self.held = byte.take(),
                Damage::ParityError => {
                    if let Some(value) = byte.take() {
                        passed.parity_errors += 1;
                        passed.marks.push(Mark {
                            before: passed.bytes.len(),
                            value,
                            damage: MarkDamage::Parity,
                        });
                    }
                }
                Damage::Idle { by } => passed.pauses.push((passed.bytes.len(), by)),
            }
        }
        if let (left @ 1.., mask) = self.burst {
            byte = byte.map(|byte| byte ^ mask);
            self.burst.0 = left - 1;
        }
        if self.truncated > 0 {
            self.truncated -= 1;
            byte = None;
            self.held = None;
        }
        let copies = copies.min(COPIES_MAX);
        passed.bytes.extend(
            byte.into_iter()
                .flat_map(|byte| core::iter::repeat_n(byte, copies)),
        );
        passed.bytes.extend(waiting);
    }
}

/// Maximum number of copies of one byte, however often it is doubled.
const COPIES_MAX: usize = 64;

#[cfg(test)]
mod tests;
