//! Watches a line for conditions on its bytes or frames.

use protocols::Instant;

use crate::Shared;
use crate::codec::{Codec, RegisterNames, Stream, Stretch, What, value_in};
use crate::rig::line::Direction;
use crate::rig::trace::{Side, Tap};
use crate::robots::conditions::{Moment, Reading};
use crate::scenario::{BytesCondition, DeviceSpec, DirectionSpec, Flaw, FrameCondition, Operand};
use crate::shared::WeakShared;

/// Number of bytes that are kept for the words of a frame: longer than any frame.
const TAIL: usize = 4096;
/// Maximum number of moments that are kept between two updates of the rules.
const FOUND_MAX: usize = 4096;

/// Pattern in the bytes of a line.
#[derive(Clone)]
pub(super) enum Wanted {
    /// A number of bytes, and the number still missing.
    Count { of: u64, left: u64 },
    /// A sequence of bytes, and its matched beginning.
    Pattern { pattern: Vec<u8>, tail: Vec<u8> },
    /// A frame, in the line's protocol.
    Frame(Box<Frames>),
}

/// Frames of a line.
#[derive(Clone)]
pub(super) struct Frames {
    wanted: FrameCondition,
    codec: &'static Codec,
    stream: Stream,
    heard: Instant,
    /// Names of the registers, if the line belongs to a slave that the scenario defines.
    names: Option<RegisterNames>,
    /// The last bytes, and the number of all bytes.
    tail: Vec<u8>,
    fed: u64,
    /// Whether bytes arrived since the last pause.
    is_open: bool,
}

impl Frames {
    fn new(
        wanted: FrameCondition,
        codec: &'static Codec,
        names: Option<RegisterNames>,
        now: Instant,
    ) -> Self {
        let direction = Direction::from(wanted.direction);
        Self {
            wanted,
            codec,
            stream: Stream::towards(codec, direction),
            heard: now,
            names,
            tail: Vec::new(),
            fed: 0,
            is_open: false,
        }
    }

    fn take(&mut self, at: Instant, bytes: &[u8], found: &mut Found) {
        self.pause(at, found);
        self.heard = at;
        self.is_open |= !bytes.is_empty();
        self.fed += bytes.len() as u64;
        self.tail.extend_from_slice(bytes);
        let surplus = self.tail.len().saturating_sub(TAIL);
        self.tail.drain(..surplus);
        let stretches = self.stream.push(bytes);
        self.count(at, stretches, found);
    }

    /// Ends a frame that only a silence ends, if the line was silent long enough at `now`. The
    /// frame counts at the end of that silence.
    fn pause(&mut self, now: Instant, found: &mut Found) {
        let end = self.heard + self.codec.idle();
        if !self.is_open || now <= end {
            return;
        }
        self.is_open = false;
        let stretches = self.stream.idle();
        self.count(end, stretches, found);
    }

    fn count(&mut self, at: Instant, stretches: Vec<Stretch>, found: &mut Found) {
        for stretch in stretches {
            if let What::Frame(words) = stretch.what {
                let words = self.named(&stretch.bytes).unwrap_or(words);
                found.frames += 1;
                if let Some(reading) = self.reading(&words) {
                    found.add(at, reading);
                }
                found.last = words;
            }
        }
    }

    /// Words of the frame at `place`, with the names of the slave's own registers.
    fn named(&self, place: &core::ops::Range<u64>) -> Option<String> {
        let names = self.names.as_ref()?;
        let begin = self.fed - self.tail.len() as u64;
        let index = |at: u64| usize::try_from(at.checked_sub(begin)?).ok();
        names.words(self.tail.get(index(place.start)?..index(place.end)?)?)
    }

    /// The reading of a frame; `None` if the condition does not apply to the frame.
    fn reading(&self, words: &str) -> Option<Reading> {
        let FrameCondition {
            contains,
            field,
            op,
            value,
            ..
        } = &self.wanted;
        if !words.contains(&**contains) {
            return None;
        }
        let Some((field, wanted)) = field.as_ref().zip(value.as_ref()) else {
            return Some(Reading {
                holds: Some(true),
                value: None,
            });
        };
        let value = Operand::from_words(value_in(words, field)?);
        Some(Reading {
            holds: op.compares(&value, wanted),
            value: Some(value),
        })
    }
}

impl Wanted {
    pub(super) fn bytes(bytes: &BytesCondition) -> Result<Self, Flaw> {
        Ok(match (bytes.pattern()?, bytes.count.unwrap_or(1)) {
            (Some(pattern), _) => Self::Pattern {
                pattern,
                tail: Vec::new(),
            },
            (None, of) => Self::Count { of, left: of },
        })
    }

    pub(super) fn frame(frame: &FrameCondition, moment: &Moment<'_>) -> Result<Self, Flaw> {
        let codec = moment.codec(frame)?;
        let device = moment.devices.get(&frame.link);
        let names = device.and_then(DeviceSpec::register_names);
        let frames = Frames::new(frame.clone(), codec, names, moment.rig.now());
        Ok(Self::Frame(Box::new(frames)))
    }

    /// Takes more bytes of the line.
    fn take(&mut self, at: Instant, bytes: &[u8], found: &mut Found) {
        let is_in = Reading {
            holds: Some(true),
            value: None,
        };
        found.bytes += bytes.len() as u64;
        match self {
            Self::Count { of, left } => {
                *left = left.saturating_sub(bytes.len() as u64);
                if *left == 0 {
                    *left = *of;
                    found.add(at, is_in);
                }
            }
            Self::Pattern { pattern, tail } => {
                tail.extend_from_slice(bytes);
                if tail.windows(pattern.len()).any(|part| part == *pattern) {
                    found.add(at, is_in);
                }
                let kept = tail.len().saturating_sub(pattern.len() - 1);
                tail.drain(..kept);
            }
            Self::Frame(frames) => frames.take(at, bytes, found),
        }
    }
}

/// Results of a watch.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    /// Whether the condition has held once.
    pub(super) has_held: bool,
    /// Moments since the last call that took them.
    moments: Vec<(Instant, Reading)>,
    /// Number of bytes on the line. The following fields have the counts of frames and readings,
    /// and the last frame as text.
    pub(super) bytes: u64,
    pub(super) frames: u64,
    pub(super) readings: u64,
    /// Number of moments beyond [`FOUND_MAX`] between two updates.
    pub(super) lost: u64,
    pub(super) last: String,
}

impl Found {
    fn add(&mut self, at: Instant, reading: Reading) {
        self.has_held |= reading.holds == Some(true);
        self.readings += 1;
        if self.moments.len() < FOUND_MAX {
            self.moments.push((at, reading));
        } else {
            self.lost += 1;
        }
    }
}

/// A watch on one direction of a link.
#[derive(Clone)]
pub(super) struct LineWatch {
    link: usize,
    direction: Direction,
    wanted: Wanted,
    /// Whether the watch stops when the condition holds for the first time.
    is_once: bool,
    pub(super) found: Found,
}

impl LineWatch {
    pub(super) fn new(
        link: usize,
        direction: DirectionSpec,
        wanted: Wanted,
        is_once: bool,
    ) -> Self {
        Self {
            link,
            direction: Direction::from(direction),
            wanted,
            is_once,
            found: Found::default(),
        }
    }

    /// Ends a frame that only a silence ends, if the line was silent long enough at `now`.
    pub(super) fn pause(&mut self, now: Instant) {
        let Self { wanted, found, .. } = self;
        if let Wanted::Frame(frames) = wanted
            && !(self.is_once && found.has_held)
        {
            frames.pause(now, found);
        }
    }

    /// Takes the moments found since the last call.
    pub(super) fn take_moments(&mut self) -> Vec<(Instant, Reading)> {
        core::mem::take(&mut self.found.moments)
    }
}

/// All watches. A watch is removed when its owner drops it.
#[derive(Clone, Default)]
pub(super) struct LineWatches(Shared<Vec<WeakShared<LineWatch>>>);

impl LineWatches {
    /// Whether no line is watched.
    pub(super) fn is_empty(&self) -> bool {
        self.0.lock().is_empty()
    }

    /// Adds a watch. It starts to work when these watches become a tap of the rig.
    pub(super) fn add(&self, watch: LineWatch) -> Shared<LineWatch> {
        let watch = Shared::new(watch);
        self.0.lock().push(watch.downgrade());
        watch
    }
}

impl Tap for LineWatches {
    fn record(&mut self, link: usize, direction: Direction, side: Side, at: Instant, bytes: &[u8]) {
        if side == Side::Sent {
            return;
        }
        self.0.lock().retain(|watch| {
            let Some(watch) = watch.upgrade() else {
                return false;
            };
            let mut watch = watch.lock();
            let is_over = watch.is_once && watch.found.has_held;
            if watch.link == link && !is_over {
                let is_own = watch.direction == direction;
                let LineWatch { wanted, found, .. } = &mut *watch;
                match wanted {
                    _ if is_own => wanted.take(at, bytes, found),
                    Wanted::Frame(frames) => frames.stream.beside(bytes),
                    _ => {}
                }
            }
            true
        });
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use super::*;
    use crate::codec::BUS_HIGH_FIRST;

    impl Wanted {
        /// Whether the pattern has been found.
        fn is_in(&mut self, at: Instant, bytes: &[u8]) -> bool {
            let mut found = Found::default();
            self.take(at, bytes, &mut found);
            found.has_held
        }
    }

    fn count(of: u64) -> Wanted {
        Wanted::Count { of, left: of }
    }

    fn frames(contains: &str, field: Option<&str>) -> Wanted {
        let wanted = FrameCondition {
            link: "base".to_owned(),
            direction: DirectionSpec::ToDevice,
            contains: contains.to_owned(),
            field: field.map(str::to_owned),
            op: crate::scenario::Op::Greater,
            value: field.map(|_| Operand::Number(19.0)),
        };
        Wanted::Frame(Box::new(Frames::new(
            wanted,
            &BUS_HIGH_FIRST,
            None,
            Instant::ZERO,
        )))
    }

    /// A pattern across the border of two chunks is found, and half of it is not enough.
    #[test]
    fn a_pattern_is_found_however_the_bytes_are_cut() {
        let pattern = || Wanted::Pattern {
            pattern: vec![1, 2, 3],
            tail: Vec::new(),
        };
        let mut wanted = pattern();
        let hits = [&[1_u8][..], &[2], &[9], &[1, 2], &[3, 4]];
        let found = hits.map(|bytes| wanted.is_in(Instant::ZERO, bytes));
        assert_eq!(found, [false, false, false, false, true]);
        assert!(pattern().is_in(Instant::ZERO, &[0, 1, 2, 3]));
    }

    /// Five bytes in any chunks, and five more.
    #[test]
    fn so_many_bytes_are_counted() {
        let mut wanted = count(5);
        let found = [2, 0, 2, 1, 0, 5].map(|len| wanted.is_in(Instant::ZERO, &vec![7; len]));
        assert_eq!(found, [false, false, false, true, false, true]);
        assert!(count(5).is_in(Instant::ZERO, &[7; 6]));
    }

    /// The golden write of the seed's bus chapter: speeds 20 and -20, high byte of the sum first. A
    /// frame without the field has no value.
    #[test]
    fn the_field_of_a_frame_is_compared() {
        let write = [0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C];
        for (field, readings) in [
            ("speed_left_to", vec![Some(true)]),
            ("speed_right_to", vec![Some(false)]),
            ("speed", vec![]),
        ] {
            let mut wanted = frames("", Some(field));
            let mut found = Found::default();
            wanted.take(Instant::ZERO, &write[..3], &mut found);
            // The copy continues in the middle of the frame.
            let mut copy = wanted.clone();
            copy.take(Instant::ZERO, &write[3..], &mut found);
            let moments = found.moments.iter().map(|(_, reading)| reading.holds);
            assert_eq!(moments.collect::<Vec<_>>(), readings, "{field}");
            assert_eq!(found.frames, 1, "{field}");
        }
    }

    /// Of a pattern of three bytes, at most the last two received bytes are kept, because they may
    /// begin it.
    #[test]
    fn no_more_is_kept_than_may_begin_the_pattern() {
        let mut wanted = Wanted::Pattern {
            pattern: vec![1, 1, 2],
            tail: Vec::new(),
        };
        for (bytes, kept) in [
            (&[1_u8][..], &[1_u8][..]),
            (&[9, 8, 7], &[8, 7]),
            (&[1, 1], &[1, 1]),
        ] {
            assert!(!wanted.is_in(Instant::ZERO, bytes));
            let Wanted::Pattern { tail, .. } = &wanted else {
                unreachable!("it is one");
            };
            assert_eq!(tail, kept);
        }
        assert!(wanted.is_in(Instant::ZERO, &[2]));
    }

    /// The golden read of ten registers from 36 (field firmware b77a6df) in two halves: a pause as
    /// long as the protocol's idle time does not split it, a longer one does.
    #[test]
    fn a_frame_is_found_unless_a_pause_cuts_it() {
        let is_found_after = |pause: Duration| {
            let mut wanted = frames("36", None);
            let begin = Instant::from_secs(1);
            assert!(!wanted.is_in(begin, &[0xAB, 0x24]));
            wanted.is_in(begin + pause, &[0x0A, 0x00, 0xD9])
        };
        let idle = BUS_HIGH_FIRST.idle();
        assert!(is_found_after(idle));
        assert!(!is_found_after(idle + Duration::from_nanos(1)));
    }

    /// An incomplete write, a pause, and a complete write (the golden one of the seed's bus
    /// chapter). A copy at any byte finds the frame like the original, and none twice.
    #[test]
    fn a_copy_knows_the_pauses() {
        let write = [0xAB, 0x2E, 0x83, 0x14, 0xEC, 0x00, 0x02, 0x5C];
        let late = Instant::from_secs(1);
        let bytes: Vec<(Instant, u8)> = write[..4]
            .iter()
            .map(|byte| (Instant::ZERO, *byte))
            .chain(write.map(|byte| (late, byte)))
            .collect();
        for cut in 0..=bytes.len() {
            let (mut wanted, mut found) = (frames("", None), Found::default());
            for (index, (at, byte)) in bytes.iter().enumerate() {
                if index == cut {
                    wanted = wanted.clone();
                }
                wanted.take(*at, &[*byte], &mut found);
            }
            assert_eq!(found.frames, 1, "copied before byte {cut}");
        }
    }

    /// A watch counts only bytes of its own line, and only while a condition waits.
    #[test]
    fn a_watch_hears_its_own_line_alone() {
        let mut watches = LineWatches::default();
        let direction = DirectionSpec::ToMaster;
        let watch = watches.add(LineWatch::new(1, direction, count(1), true));
        let (to_master, to_device) = (Direction::ToMaster, Direction::ToDevice);
        watches.record(1, to_master, Side::Sent, Instant::ZERO, &[1]);
        watches.record(1, to_device, Side::Received, Instant::ZERO, &[1]);
        watches.record(0, to_master, Side::Received, Instant::ZERO, &[1]);
        assert!(!watch.lock().found.has_held);
        watches.record(1, to_master, Side::Received, Instant::ZERO, &[1]);
        assert!(watch.lock().found.has_held);
        watches.record(1, to_master, Side::Received, Instant::ZERO, &[]);
        assert!(watch.lock().found.has_held);
        assert_eq!(watches.0.lock().len(), 1);
        drop(watch);
        watches.record(1, to_master, Side::Received, Instant::ZERO, &[1]);
        assert!(watches.0.lock().is_empty());
    }

    /// 4,096 moments are kept between two updates; a reading that does not hold counts as well.
    #[test]
    fn further_moments_are_only_counted() {
        let mut found = Found::default();
        let reading = |holds| Reading {
            holds: Some(holds),
            value: None,
        };
        for _ in 0..FOUND_MAX {
            found.add(Instant::ZERO, reading(false));
        }
        assert_eq!(
            (found.moments.len(), found.lost, found.has_held),
            (4_096, 0, false)
        );
        for _ in 0..2 {
            found.add(Instant::ZERO, reading(true));
        }
        assert_eq!(
            (found.moments.len(), found.lost, found.has_held),
            (4_096, 2, true)
        );
        assert_eq!(found.readings, 4_098);
        let watch = |is_once| LineWatch::new(0, DirectionSpec::ToDevice, count(1), is_once);
        let mut watch = watch(false);
        watch.found = found;
        assert_eq!(
            (watch.take_moments().len(), watch.take_moments().len()),
            (4_096, 0)
        );
    }

    /// The bytes are counted in all forms. A watch that is not for one time continues after it has
    /// held.
    #[test]
    fn a_watch_that_is_not_once_continues() {
        let direction = DirectionSpec::ToMaster;
        let after = |is_once: bool| {
            let mut watches = LineWatches::default();
            assert!(watches.is_empty());
            let watch = watches.add(LineWatch::new(1, direction, count(2), is_once));
            assert!(!watches.is_empty());
            for _ in 0..4 {
                watches.record(1, Direction::ToMaster, Side::Received, Instant::ZERO, &[1]);
            }
            let found = &watch.lock().found;
            (found.bytes, found.readings)
        };
        assert_eq!([after(true), after(false)], [(2, 1), (4, 2)]);
    }
}
