//! Decoder of a UART from the level of a line over time.

use protocols::{LineConfig, LineEvent, Parity};

/// Level of a line over time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Levels {
    /// The level before the first change.
    pub(super) first: bool,
    /// Times of the changes, each to the other level.
    pub(super) changes: Vec<u64>,
    /// End of the recording, as far as the file tells it.
    pub(super) end: u64,
    /// Whether the file holds only changes, and ends with the last one of all channels: the levels
    /// stay behind it.
    pub(super) is_open: bool,
}

impl Levels {
    /// Sets the level at `at`; an equal level changes nothing.
    pub(super) fn set(&mut self, at: u64, level: bool) {
        // If the time decreases in the file, the last time is kept.
        let at = self.changes.last().map_or(at, |last| at.max(*last));
        if self.last() != level {
            self.changes.push(at);
        }
        self.end = self.end.max(at);
    }

    fn last(&self) -> bool {
        self.first ^ !self.changes.len().is_multiple_of(2)
    }

    /// Whether the line stays idle behind the end, so that the last character is complete: its bits
    /// behind the last change are high.
    fn stays_idle(&self) -> bool {
        self.is_open && self.last()
    }

    /// The levels up to this many changes.
    pub(super) fn first_changes(&self, count: usize) -> Self {
        let changes = &self.changes[..self.changes.len().min(count)];
        Self {
            first: self.first,
            end: self.changes.get(count).copied().unwrap_or(self.end),
            changes: changes.to_vec(),
            is_open: self.is_open && count >= self.changes.len(),
        }
    }

    /// Lengths of the pulses between changes.
    pub(super) fn pulses(&self) -> Vec<u64> {
        self.changes
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .collect()
    }

    /// The inverted levels.
    pub(super) fn inverted(mut self) -> Self {
        self.first = !self.first;
        self
    }
}

/// A decoded element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Read {
    /// A character.
    Byte(u8),
    /// A line error or a break.
    Event(LineEvent),
}

/// Reason why a line cannot be a UART at its rate: too few of its pulses are whole numbers of bits,
/// or too many characters lack their stop bit. `None` if it can be one.
pub(super) fn doubt(levels: &Levels, line: LineConfig, read: &[(u64, Read)]) -> Option<String> {
    let is_bad = |read: &Read| *read == Read::Event(LineEvent::FramingError);
    let bad = read.iter().filter(|(_, read)| is_bad(read)).count();
    if bad * 5 > read.len() {
        let count = read.len();
        return Some(format!("{bad} of {count} characters have no stop bit"));
    }
    let bit = 1_000_000_000 / u64::from(line.baud.max(1));
    let pulses = levels.pulses();
    let short = pulses.iter().filter(|&&pulse| pulse * 2 < bit).count();
    (short * 5 > pulses.len()).then(|| {
        let count = pulses.len();
        format!("{short} of {count} pulses are shorter than half a bit")
    })
}

/// All characters and events, each with the end of its last stop bit. Idle is high.
pub(super) fn characters(levels: &Levels, line: LineConfig) -> Vec<(u64, Read)> {
    let mut out = Vec::new();
    let recorded = match levels.stays_idle() {
        true => u64::MAX,
        false => levels.end,
    };
    let mut cursor = Cursor { levels, passed: 0 };
    let bit = |bits2: u64| bits2 * 500_000_000 / u64::from(line.baud.max(1));
    let data_bits = u64::from(line.data_bits);
    let has_parity = line.parity != Parity::None;
    let stop_at = 1 + data_bits + u64::from(has_parity);
    let mut from = 0;
    while let Some(start) = cursor.falls_at(from) {
        // A pulse shorter than half a bit is no start bit.
        if cursor.level_at(start + bit(1)) {
            from = start + bit(1);
            continue;
        }
        let mut level = |bits: u64| cursor.level_at(start + bit(2 * bits + 1));
        let mut byte = 0_u8;
        for index in 0..data_bits {
            byte |= u8::from(level(1 + index)) << index;
        }
        let parity = has_parity.then(|| level(1 + data_bits));
        let has_stop = level(stop_at);
        let end = start + bit(2 * (stop_at + u64::from(line.stop_bits)));
        if start + bit(2 * stop_at + 1) > recorded {
            return out;
        }
        if !has_stop {
            let is_break = byte == 0 && parity != Some(true);
            let event = if is_break {
                LineEvent::Break
            } else {
                LineEvent::FramingError
            };
            out.push((end, Read::Event(event)));
            // The next start bit begins after the line was idle again.
            from = cursor
                .rises_at(start + bit(2 * stop_at + 1))
                .unwrap_or(u64::MAX);
            continue;
        }
        let is_odd = byte.count_ones() % 2 == 1;
        let is_sound = match (line.parity, parity) {
            (Parity::Even, Some(bit)) => bit == is_odd,
            (Parity::Odd, Some(bit)) => bit != is_odd,
            _ => true,
        };
        let read = match is_sound {
            true => Read::Byte(byte),
            false => Read::Event(LineEvent::ParityError),
        };
        out.push((end, read));
        from = start + bit(2 * stop_at + 1);
    }
    out
}

/// A position in the changes that only moves forward.
struct Cursor<'a> {
    levels: &'a Levels,
    passed: usize,
}

impl Cursor<'_> {
    fn level_at(&mut self, at: u64) -> bool {
        let changes = &self.levels.changes;
        while changes.get(self.passed).is_some_and(|&change| change <= at) {
            self.passed += 1;
        }
        self.levels.first ^ !self.passed.is_multiple_of(2)
    }

    /// The next change to low at or after `from`.
    fn falls_at(&mut self, from: u64) -> Option<u64> {
        self.changes_to(false, from)
    }

    fn rises_at(&mut self, from: u64) -> Option<u64> {
        self.changes_to(true, from)
    }

    fn changes_to(&mut self, level: bool, from: u64) -> Option<u64> {
        let changes = &self.levels.changes;
        while changes
            .get(self.passed)
            .is_some_and(|&change| change < from)
        {
            self.passed += 1;
        }
        // The change at an even index leaves the first level.
        let is_wanted = |index: usize| (self.levels.first ^ index.is_multiple_of(2)) == level;
        let next = if is_wanted(self.passed) {
            self.passed
        } else {
            self.passed + 1
        };
        changes.get(next).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels of back-to-back bytes from `start` on; a bit lasts `bit` ns.
    fn levels(bytes: &[u8], start: u64, bit: u64) -> Levels {
        let mut levels = Levels {
            first: true,
            ..Levels::default()
        };
        let mut at = start;
        for &byte in bytes {
            let bits = (0..8).map(|index| byte >> index & 1 == 1);
            for level in core::iter::once(false).chain(bits).chain([true]) {
                levels.set(at, level);
                at += bit;
            }
        }
        levels.end = at + 20 * bit;
        levels
    }

    fn bytes(read: &[(u64, Read)]) -> Vec<u8> {
        let byte = |(_, read): &(u64, Read)| match read {
            Read::Byte(byte) => Some(*byte),
            Read::Event(_) => None,
        };
        read.iter().filter_map(byte).collect()
    }

    /// A bit of 10 us is 100,000 baud; the first byte ends ten bits after its start.
    #[test]
    fn bytes_are_read_with_the_end_of_their_stop_bit() {
        let sent = [0xAB, 0x24, 0x0A, 0x00, 0xD9, 0xFF];
        let levels = levels(&sent, 50_000, 10_000);
        let read = characters(&levels, LineConfig::new_8n1(100_000));
        assert_eq!(bytes(&read), sent);
        assert_eq!(read[0].0, 150_000);
    }

    /// A file of changes ends with the last one, behind the fourth bit of 0xF0. Samples that end
    /// there hold an incomplete character, and so does a line that is low at the end.
    #[test]
    fn the_last_character_of_a_file_of_changes_is_whole() {
        let line = LineConfig::new_8n1(100_000);
        for byte in [0x0F, 0xF0, 0x80, 0xFF, 0x41] {
            let mut levels = levels(&[0x55, byte], 10_000, 10_000);
            levels.end = *levels.changes.last().expect("a start bit");
            levels.is_open = true;
            assert_eq!(bytes(&characters(&levels, line)), [0x55, byte]);
        }
        let mut samples = levels(&[0x55, 0xF0], 10_000, 10_000);
        samples.end = *samples.changes.last().expect("a start bit");
        assert_eq!(bytes(&characters(&samples, line)), [0x55]);
        let cut = Levels {
            first: true,
            changes: vec![10_000],
            end: 10_000,
            is_open: true,
        };
        assert_eq!(characters(&cut, line), []);
    }

    /// 0x55 with a low stop bit is a framing error, a long low level a break; then reading
    /// continues. With parity: 0x03 has two ones, so its even parity bit is 0.
    #[test]
    fn wrong_characters_are_events() {
        let mut levels = levels(&[0x55], 10_000, 10_000);
        levels.set(100_000, false);
        levels.set(150_000, true);
        levels.set(300_000, false);
        levels.set(900_000, true);
        levels.end = 2_000_000;
        let read = characters(&levels, LineConfig::new_8n1(100_000));
        let events: Vec<Read> = read.iter().map(|(_, read)| *read).collect();
        let expected = [LineEvent::FramingError, LineEvent::Break].map(Read::Event);
        assert_eq!(events, expected);
        let even = LineConfig {
            parity: Parity::Even,
            ..LineConfig::new_8n1(100_000)
        };
        let mut levels = Levels {
            first: true,
            changes: vec![10_000, 20_000, 40_000, 110_000],
            end: 500_000,
            is_open: false,
        };
        assert_eq!(characters(&levels, even), [(120_000, Read::Byte(3))]);
        levels.changes = vec![10_000, 20_000, 40_000, 100_000];
        let wrong = [(120_000, Read::Event(LineEvent::ParityError))];
        assert_eq!(characters(&levels, even), wrong);
    }
    #[test]
    fn changes_are_found_from_a_time_on() {
        let levels = Levels {
            first: true,
            changes: vec![10, 20, 30],
            end: 90,
            is_open: false,
        };
        let cursor = || Cursor {
            levels: &levels,
            passed: 0,
        };
        let falls = [0, 10, 11, 30, 31].map(|from| cursor().falls_at(from));
        assert_eq!(falls, [Some(10), Some(10), Some(30), Some(30), None]);
        let rises = [0, 20, 21].map(|from| cursor().rises_at(from));
        assert_eq!(rises, [Some(20), Some(20), None]);
        let at = [9, 10, 19, 20, 30].map(|at| cursor().level_at(at));
        assert_eq!(at, [true, false, false, true, false]);
    }

    /// A time before the last one counts as the last one; an equal level is no change.
    #[test]
    fn levels_are_set_in_order() {
        let mut levels = Levels {
            first: true,
            ..Levels::default()
        };
        for (at, level) in [(5, true), (10, false), (8, true), (30, true)] {
            levels.set(at, level);
        }
        assert_eq!((&*levels.changes, levels.end), (&[10, 10][..], 30));
        levels.changes = vec![10, 20, 30];
        levels.is_open = true;
        assert_eq!(levels.pulses(), [10, 10]);
        let first = levels.first_changes(2);
        assert_eq!(
            (&*first.changes, first.end, first.is_open),
            (&[10, 20][..], 30, false)
        );
        let all = levels.first_changes(3);
        assert_eq!(
            (&*all.changes, all.end, all.is_open),
            (&[10, 20, 30][..], 30, true)
        );
        assert!(!levels.stays_idle() && levels.clone().inverted().stays_idle());
    }

    /// Eight data bits, even parity and two stop bits: the end is twelve bits behind the start. A
    /// recording that ends in the middle of the first stop bit holds the character.
    #[test]
    fn a_character_ends_with_its_last_stop_bit() {
        let line = LineConfig {
            parity: Parity::Even,
            stop_bits: 2,
            ..LineConfig::new_8n1(100_000)
        };
        let mut levels = Levels {
            first: true,
            changes: vec![10_000, 20_000, 40_000, 110_000],
            end: 115_000,
            is_open: false,
        };
        assert_eq!(characters(&levels, line), [(130_000, Read::Byte(3))]);
        levels.end = 114_999;
        assert_eq!(characters(&levels, line), []);
        // A pulse of less than half a bit before it is no start bit.
        levels.changes.splice(0..0, [1_000, 5_999]);
        levels.end = 500_000;
        assert_eq!(characters(&levels, line), [(130_000, Read::Byte(3))]);
    }

    /// One in five characters without a stop bit is allowed, and one in five pulses of less than
    /// half a bit, which is 5 us at 100,000 baud.
    #[test]
    fn a_line_with_many_errors_is_no_uart() {
        let line = LineConfig::new_8n1(100_000);
        let of = |pulses: &[u64], bad: usize, sound: usize| {
            let mut levels = Levels::default();
            let mut at = 10_000;
            levels.changes.push(at);
            for pulse in pulses {
                at += pulse;
                levels.changes.push(at);
            }
            let bad = vec![(0, Read::Event(LineEvent::FramingError)); bad];
            let read = [bad, vec![(0, Read::Byte(1)); sound]].concat();
            doubt(&levels, line, &read)
        };
        let long = [10_000; 5];
        assert_eq!(of(&long, 1, 4), None);
        assert_eq!(
            of(&long, 1, 3).as_deref(),
            Some("1 of 4 characters have no stop bit")
        );
        assert_eq!(of(&[4_999, 10_000, 10_000, 10_000, 10_000], 0, 9), None);
        let short = "1 of 4 pulses are shorter than half a bit";
        assert_eq!(
            of(&[4_999, 10_000, 10_000, 10_000], 0, 9).as_deref(),
            Some(short)
        );
        assert_eq!(of(&[5_000; 4], 0, 9), None);
        assert_eq!(of(&[], 0, 0), None);
    }

    /// 0x03 has two ones: its odd parity bit is 1, from 90 us behind the start on.
    #[test]
    fn an_odd_parity_is_checked() {
        let odd = LineConfig {
            parity: Parity::Odd,
            ..LineConfig::new_8n1(100_000)
        };
        let mut levels = Levels {
            first: true,
            changes: vec![10_000, 20_000, 40_000, 100_000],
            end: 500_000,
            is_open: false,
        };
        assert_eq!(characters(&levels, odd), [(120_000, Read::Byte(3))]);
        levels.changes[3] = 110_000;
        let wrong = [(120_000, Read::Event(LineEvent::ParityError))];
        assert_eq!(characters(&levels, odd), wrong);
    }
}
