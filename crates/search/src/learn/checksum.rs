//! Detection of the checksum in a set of frames: tries all known algorithms over the likely ranges.
//!
//! A candidate is claimed only with evidence. Each *different* value that fits adds the bits of the
//! checksum; the logarithm of the number of candidates is subtracted. Therefore no checksum is
//! claimed for random bytes.

use std::collections::BTreeSet;

use super::sums::{self, Sum};

mod choice;

pub(crate) use choice::infer;

/// Minimum evidence for a claim, bits.
const CLAIMED_BITS: f64 = 20.0;
/// Minimum evidence for a guess, bits, if all frames fit.
const GUESSED_BITS: f64 = 7.0;
/// One frame in this many may not fit: captures contain damaged frames.
const DAMAGED_SHARE: usize = 5;
/// Number of frames that do not fit, before any fits, after which a candidate is dropped.
const MISSES_FIRST: usize = 5;
/// Maximum number of header bytes that a checksum does not cover.
const START_MAX: usize = 5;
/// Minimum number of covered bytes that suffices behind any skipped header.
const ROOM_MAX: usize = 4;
/// Maximum number of bytes behind a checksum, e.g. a terminator.
const TAIL_MAX: usize = 2;
/// Maximum offset of a checksum in a header.
const HEAD_MAX: usize = 12;
/// Maximum number of examined frames.
const FRAMES_MAX: usize = 64;
/// Maximum evidence of a sum over bytes of which only one changes, bits.
const COPY_BITS: f64 = 16.0;
/// Evidence from a `*` before two hexadecimal digits, bits: NMEA 0183.
const NMEA_BITS: f64 = 14.0;

/// The encoding of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// Bytes, least significant first.
    Little,
    /// Bytes, most significant first.
    Big,
    /// Two digits per byte, `A` to `F`.
    Upper,
    /// Two digits per byte, `a` to `f`.
    Lower,
}

impl Encoding {
    const fn len(self, bytes: usize) -> usize {
        match self {
            Self::Little | Self::Big => bytes,
            Self::Upper | Self::Lower => 2 * bytes,
        }
    }

    fn write(self, value: u64, bytes: usize) -> Vec<u8> {
        let little = &value.to_le_bytes()[..bytes];
        match self {
            Self::Little => little.to_vec(),
            Self::Big => little.iter().rev().copied().collect(),
            Self::Upper => format!("{value:0width$X}", width = 2 * bytes).into_bytes(),
            Self::Lower => format!("{value:0width$x}", width = 2 * bytes).into_bytes(),
        }
    }

    fn read(self, field: &[u8]) -> Option<u64> {
        let number = |value: u64, byte: &u8| value << 8 | u64::from(*byte);
        match self {
            Self::Little => Some(field.iter().rev().fold(0, number)),
            Self::Big => Some(field.iter().fold(0, number)),
            Self::Upper | Self::Lower => {
                let is_upper = self == Self::Upper;
                let is_digit = |byte: &u8| match byte {
                    b'0'..=b'9' => true,
                    b'A'..=b'F' => is_upper,
                    b'a'..=b'f' => !is_upper,
                    _ => false,
                };
                let text = core::str::from_utf8(field).ok()?;
                let is_number = field.iter().all(is_digit);
                is_number.then(|| u64::from_str_radix(text, 16).ok())?
            }
        }
    }
}

/// The position of the value and the bytes that it covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// `tail` bytes before the end; covers all bytes before it, except the last `gap` bytes.
    End { tail: usize, gap: usize },
    /// At this offset; covers all bytes behind it, and those before it if `is_whole`.
    Head { at: usize, is_whole: bool },
    /// At this offset; covers the bytes before it: the checksum of a header.
    Front { at: usize },
}

/// A checksum with its position in frames.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Checksum {
    sum: &'static Sum,
    encoding: Encoding,
    place: Place,
    /// Number of bytes at the beginning that it does not cover.
    start: usize,
    /// A constant that is added.
    free: u64,
    /// Whether the evidence suffices for a claim.
    pub(crate) is_sure: bool,
    /// Evidence, bits.
    pub(crate) bits: f64,
    /// Constant bytes between the covered range and the value, and behind the value.
    fixed: [u8; TAIL_MAX + 1],
    /// An algorithm of another width that fits the same frames, and the number of bytes at the
    /// beginning that it does not cover.
    twin: Option<(&'static Sum, usize)>,
}

/// The name as the catalogue and descriptions write it: `CRC-16/MODBUS`.
pub(crate) fn shown(name: &str) -> String {
    let crc = name
        .strip_prefix("CRC_")
        .and_then(|rest| rest.split_once('_'));
    match crc {
        Some((width, rest)) => format!("CRC-{width}/{}", rest.replace('_', "-")),
        None => name.to_owned(),
    }
}

impl core::fmt::Display for Checksum {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let encoding = match (self.encoding, self.sum.bytes) {
            (Encoding::Upper | Encoding::Lower, _) => "in hexadecimal digits, ",
            (_, 1) => "",
            (Encoding::Little, _) => "low byte first, ",
            (Encoding::Big, _) => "high byte first, ",
        };
        write!(f, "{}, {encoding}", shown(self.sum.name))?;
        match self.place {
            Place::End { tail: 0, .. } => f.write_str("at the end")?,
            Place::End { tail, .. } => write!(f, "{tail} bytes before the end")?,
            Place::Head { at, .. } => write!(f, "at byte {at}")?,
            Place::Front { at } => write!(f, "at byte {at}, of the header")?,
        }
        let from = |f: &mut core::fmt::Formatter<'_>, start| match (self.place, start) {
            (Place::Head { .. }, _) | (_, 0) => Ok(()),
            (_, start) => write!(f, ", of the bytes from {start}"),
        };
        from(f, self.start)?;
        let Some((twin, start)) = self.twin else {
            return Ok(());
        };
        write!(f, "; or {}", shown(twin.name))?;
        from(f, start)?;
        f.write_str(": both fit all frames")
    }
}

/// The position of a checksum, and its surroundings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Placed {
    /// Number of bytes at the beginning that it does not cover.
    pub(crate) start: usize,
    /// Constant bytes between the covered range and the value.
    pub(crate) gap: Vec<u8>,
    /// Constant bytes behind the value.
    pub(crate) tail: Vec<u8>,
    /// Number of bytes of the value, and of its field.
    pub(crate) bytes: usize,
    pub(crate) len: usize,
    pub(crate) is_big: bool,
    pub(crate) is_hex: bool,
    /// The offset of a checksum in a header, and the first and last byte that it covers.
    pub(crate) head: Option<[usize; 3]>,
}

impl Checksum {
    /// The name of the algorithm in descriptions; `None` if it has none.
    pub(crate) fn described(&self) -> Option<String> {
        match self.sum.name {
            name if name.starts_with("CRC") => Some(shown(name)),
            name => sums::described(name, self.free).map(str::to_owned),
        }
    }

    /// Whether the evidence suffices for a checksum, though perhaps not for one algorithm.
    pub(crate) const fn is_present(&self) -> bool {
        self.is_sure || self.twin.is_some()
    }

    /// The name of the algorithm.
    pub(crate) const fn name(&self) -> &'static str {
        self.sum.name
    }

    /// The position, if a description can express it. An end of the covered range of 0 means the
    /// end of the frame.
    pub(crate) fn placed(&self) -> Option<Placed> {
        let (tail, gap, head) = match self.place {
            Place::End { tail, gap } => (tail, gap, None),
            Place::Front { at } => (0, 0, Some([at, self.start, at])),
            Place::Head {
                at,
                is_whole: false,
            } => (0, 0, Some([at, at + self.len(), 0])),
            // The bytes of the checksum count as 0, which has no effect on sums only.
            Place::Head { at, is_whole: true } if self.sum.skips_zeros() => {
                (0, 0, Some([at, 0, 0]))
            }
            Place::Head { .. } => return None,
        };
        let is_hex = matches!(self.encoding, Encoding::Upper | Encoding::Lower);
        Some(Placed {
            start: self.start,
            gap: self.fixed[..gap].to_vec(),
            tail: self.fixed[gap..gap + tail].to_vec(),
            bytes: self.sum.bytes,
            len: self.len(),
            is_big: is_hex || self.encoding == Encoding::Big,
            is_hex,
            head,
        })
    }

    /// Number of bytes of the field and its surroundings at the end.
    pub(crate) const fn len_behind(&self) -> usize {
        match self.place {
            Place::End { tail, gap } => tail + gap + self.len(),
            Place::Head { .. } | Place::Front { .. } => self.len(),
        }
    }

    /// Number of bytes of the field.
    const fn len(&self) -> usize {
        self.encoding.len(self.sum.bytes)
    }

    /// The offset of the field in `body`.
    fn at(&self, body: &[u8]) -> Option<usize> {
        let at = match self.place {
            Place::End { tail, gap } => {
                let at = body.len().checked_sub(tail + self.len())?;
                (at > self.start + gap).then_some(at)?
            }
            Place::Head { at, .. } | Place::Front { at } => at,
        };
        (at + self.len() <= body.len()).then_some(at)
    }

    /// The checksum of the covered bytes, if the field is at `at`.
    fn over(&self, body: &[u8], at: usize) -> u64 {
        let behind = &body[at + self.len()..];
        let value = match self.place {
            Place::End { gap, .. } => self.sum.of([&body[self.start..at - gap]]),
            Place::Head { is_whole: true, .. } => self.sum.of([&body[..at], behind]),
            Place::Head { .. } => self.sum.of([behind]),
            Place::Front { .. } => self.sum.of([&body[self.start.min(at)..at]]),
        };
        self.sum.with(value, self.free)
    }

    /// Whether the checksum of `body` is correct.
    pub(crate) fn holds(&self, body: &[u8]) -> bool {
        let at = self.at(body);
        at.is_some_and(|at| {
            let value = self.encoding.read(&body[at..at + self.len()]);
            value == Some(self.over(body, at))
        })
    }

    /// `body` without the field and its constant surroundings.
    pub(crate) fn without(&self, body: &[u8]) -> Option<Vec<u8>> {
        let at = self.at(body)?;
        Some(match self.place {
            Place::End { gap, .. } => body[..at - gap].to_vec(),
            Place::Head { .. } | Place::Front { .. } => {
                [&body[..at], &body[at + self.len()..]].concat()
            }
        })
    }

    /// `content` with a correct field; its value is changed by `off`.
    pub(crate) fn put(&self, content: &[u8], off: u64) -> Vec<u8> {
        let mut body = content.to_vec();
        let field = vec![0; self.len()];
        let at = match self.place {
            Place::End { tail, gap } => {
                body.extend(&self.fixed[..gap]);
                let at = body.len();
                body.extend(&field);
                body.extend(&self.fixed[gap..gap + tail]);
                at
            }
            Place::Head { at, .. } | Place::Front { at } => {
                let at = at.min(body.len());
                body.splice(at..at, field);
                at
            }
        };
        let start = match self.place {
            // A body that is shorter than the skipped header has no covered bytes.
            Place::End { gap, .. } => self.start.min(at - gap),
            Place::Head { .. } => 0,
            Place::Front { .. } => self.start.min(at),
        };
        let value = Self { start, ..*self }.over(&body, at) ^ off;
        let field = self.encoding.write(value, self.sum.bytes);
        body.splice(at..at + field.len(), field);
        body
    }

    /// The evidence that `bodies` carry this checksum, bits, without the correction for the number
    /// of candidates; `None` if too many bodies do not fit.
    fn evidence(&mut self, bodies: &[&[u8]]) -> Option<f64> {
        let allowed = match bodies.len() {
            0..5 => 0,
            len => len / DAMAGED_SHARE,
        };
        if self.sum.is_free {
            // Of the constants that the first frames require, uses the most frequent one.
            let needed = bodies.iter().take(5).filter_map(|body| {
                let at = self.at(body)?;
                let value = self.encoding.read(&body[at..at + self.len()])?;
                Some(self.sum.free(self.over(body, at), value))
            });
            let needed: Vec<u64> = needed.collect();
            let count = |one: &&u64| needed.iter().filter(|other| other == one).count();
            self.free = *needed.iter().max_by_key(count)?;
        }
        let (mut misses, mut values) = (0, BTreeSet::new());
        let mut ranges = BTreeSet::new();
        for body in bodies {
            if self.holds(body) && self.is_fixed(body, bodies[0]) {
                let at = self.at(body)?;
                values.insert(&body[at..at + self.len()]);
                ranges.insert(self.without(body));
            } else {
                misses += 1;
                if misses > allowed || values.is_empty() && misses >= MISSES_FIRST {
                    return None;
                }
            }
        }
        // A free constant costs one value; 0 and all ones are common constants.
        let is_usual = sums::described(self.sum.name, self.free).is_some();
        let one = usize::from(self.sum.is_free && !is_usual);
        let known = values.len().min(ranges.len()).saturating_sub(one);
        let each = self.bits_each(&values);
        let mut bits = (each * known) as f64 + self.sum.prior();
        // Of equally good candidates prefers the simplest one.
        bits -= 0.2 * self.start as f64;
        bits += match self.place {
            Place::End { .. } if is_usual || !self.sum.is_free => 1.0,
            Place::End { .. } => 0.5,
            Place::Head { .. } | Place::Front { .. } => 0.0,
        };
        // The sum of a single changing byte is a copy of that byte, e.g. a repeated counter.
        // A usual constant is evidence: it depends on all other bytes.
        if self.sum.is_free && varying(ranges.iter().flatten().map(Vec::as_slice)) < 2 {
            let constant = if is_usual {
                self.sum.bits() as f64
            } else {
                0.0
            };
            bits = bits.min(COPY_BITS + constant);
        }
        let Place::End { gap: 1, .. } = self.place else {
            return Some(bits);
        };
        let is_nmea = self.fixed[0] == b'*' && self.sum.bytes == 1 && self.start == 1;
        let is_xor = self.sum.name == "exclusive or" && self.free == 0;
        let starts = bodies[0].first().is_some_and(|byte| b"$!".contains(byte));
        let more = if is_nmea && is_xor && starts {
            NMEA_BITS
        } else {
            0.0
        };
        Some(bits + more)
    }

    /// The evidence of one value of `fields`, bits. Constant parts of the field give none.
    fn bits_each(&self, fields: &BTreeSet<&[u8]>) -> usize {
        let all = self.sum.bits();
        match varying(fields.iter().copied()) {
            0 => all,
            // The high bits of a sum over small values are constant: narrower sums fit as well.
            _ if self.sum.is_free => {
                let mut values = fields.iter().filter_map(|field| self.encoding.read(field));
                let first = values.next().unwrap_or(0);
                let varying = values.fold(0, |bits, value| bits | (value ^ first));
                let low = |byte: &u8| (u8::BITS - byte.leading_zeros()) as usize;
                varying.to_le_bytes().iter().map(low).sum()
            }
            count => all * count.min(self.len()) / self.len(),
        }
    }

    /// Whether the surroundings of the field are the same in `body` and `first`.
    fn is_fixed(&self, body: &[u8], first: &[u8]) -> bool {
        self.around(body) == self.around(first)
    }

    fn around<'a>(&self, body: &'a [u8]) -> Option<[&'a [u8]; 2]> {
        let Place::End { gap, .. } = self.place else {
            return Some([&[], &[]]);
        };
        let at = self.at(body)?;
        Some([&body[at - gap..at], &body[at + self.len()..]])
    }
}

/// The number of positions at which `parts` differ; all positions if their lengths differ.
fn varying<'a>(parts: impl Iterator<Item = &'a [u8]>) -> usize {
    let parts: Vec<&[u8]> = parts.collect();
    let Some((first, others)) = parts.split_first() else {
        return 0;
    };
    if others.iter().any(|other| other.len() != first.len()) {
        return usize::MAX;
    }
    let differs = |at: &usize| others.iter().any(|other| other[*at] != first[*at]);
    (0..first.len()).filter(differs).count()
}

/// The candidates of `sum` for frames of at least `shortest` and typically `usual` bytes; `count`
/// is the number of different frames.
fn candidates(sum: &'static Sum, [shortest, usual]: [usize; 2], count: usize) -> Vec<Checksum> {
    let mut all = Vec::new();
    let mut add = |encoding, place, start| {
        all.push(Checksum {
            sum,
            encoding,
            place,
            start,
            free: 0,
            is_sure: false,
            bits: 0.0,
            fixed: [0; TAIL_MAX + 1],
            twin: None,
        });
    };
    let binary = match sum.bytes {
        1 => &[Encoding::Little][..],
        _ => &[Encoding::Little, Encoding::Big],
    };
    let hex = [Encoding::Upper, Encoding::Lower];
    // One or two frames give little evidence: only the likeliest positions are tried.
    let (tails, heads) = if count < 3 {
        (0, 0)
    } else {
        (TAIL_MAX, HEAD_MAX)
    };
    let least = if sum.bytes == 1 { 2 } else { 1 };
    // Two digits carry 8 bits: 7 would make no difference to sums of printable characters.
    let hex = if sum.bits() == 7 { &[][..] } else { &hex };
    for encoding in binary.iter().chain(hex).copied() {
        let is_hex = hex.contains(&encoding);
        let len = encoding.len(sum.bytes);
        for (tail, gap) in (0..=tails).flat_map(|tail| [(tail, 0), (tail, 1)]) {
            if gap > 0 && !is_hex {
                continue;
            }
            for start in 0..=START_MAX {
                let around = tail + gap + len + start;
                let room = |len: usize| len.saturating_sub(around);
                // A checksum over fewer bytes than it skips is implausible. A Roland message with
                // one value skips 5 bytes and covers 4.
                if room(shortest) >= 1 && room(usual) >= least.max(start.min(ROOM_MAX)) {
                    add(encoding, Place::End { tail, gap }, start);
                }
            }
        }
        if is_hex {
            continue;
        }
        for (at, start) in (3..heads).flat_map(|at| [(at, 0), (at, 1), (at, 2)]) {
            if at + len < shortest {
                add(encoding, Place::Front { at }, start);
            }
        }
        for at in 0..heads.min(shortest.saturating_sub(len + 1)) {
            add(encoding, Place::Head { at, is_whole: true }, 0);
            if at > 0 && at + len + 2 <= shortest {
                add(
                    encoding,
                    Place::Head {
                        at,
                        is_whole: false,
                    },
                    0,
                );
            }
        }
    }
    all
}
