//! Frames on a wire that several devices share: bytes that one device knows are no error for the
//! others.

use core::ops::Range;

use emulators::device::EventKind;
use protocols::{Decode as _, Instant};

use super::Described;

/// The rule: a request for an address that no device of the link has.
pub(crate) const WRONG_ADDRESS: &str = "wrong-address";
/// Maximum number of addresses in its words.
const ADDRESSES_MAX: usize = 8;

/// A frame that breaks a rule as such, whatever device it is for.
#[derive(Clone, Debug)]
pub(super) struct Complaint {
    pub(super) at: Instant,
    pub(super) rule: &'static str,
    pub(super) detail: String,
    pub(super) bytes: Vec<u8>,
    /// The bytes that break the rule, by their numbers on the wire.
    pub(super) spans: Vec<Range<u64>>,
    /// The number of bytes on the wire at `at`.
    pub(super) end: u64,
}

/// Frames and bytes that a device on a shared wire heard since the last [`Described::settle`].
#[derive(Clone, Debug, Default)]
pub(super) struct Heard {
    /// Number of bytes that passed the device.
    passed: u64,
    /// The bytes of frames that it knows.
    known: Vec<Range<u64>>,
    /// The bytes of frames that are for it.
    claimed: Vec<Range<u64>>,
    complaints: Vec<Complaint>,
    /// Complaints that were logged, as long as the same one of another device may follow: time,
    /// rule and number of bytes on the wire.
    logged: Vec<(Instant, &'static str, u64)>,
}

impl Heard {
    /// Counts bytes that passed the device.
    pub(super) fn pass(&mut self, count: usize) {
        self.passed += count as u64;
    }

    /// Number of bytes that passed the device.
    pub(super) const fn passed(&self) -> u64 {
        self.passed
    }

    /// Records the bytes of a frame that the device knows.
    pub(super) fn know(&mut self, span: Range<u64>) {
        self.known.push(span);
    }

    /// Records the bytes of a frame that is for the device.
    pub(super) fn claim(&mut self, span: Range<u64>) {
        self.claimed.push(span);
    }

    /// The last `len` bytes before the last `behind` ones.
    pub(super) fn span(&self, len: usize, behind: usize) -> Range<u64> {
        let end = self.passed.saturating_sub(behind as u64);
        end.saturating_sub(len as u64)..end
    }

    /// Whether the device knows all of the bytes that break the rule; a request for no address of
    /// the link is a known frame, so there the bytes must be for the device.
    fn covers(&self, rule: &str, span: &Range<u64>) -> bool {
        let frames = match rule {
            WRONG_ADDRESS => &self.claimed,
            _ => &self.known,
        };
        let mut from = span.start;
        for known in frames {
            if known.start <= from {
                from = from.max(known.end);
            }
        }
        from >= span.end
    }
}

impl Complaint {
    pub(super) const fn new(at: Instant, rule: &'static str, detail: String) -> Self {
        Self {
            at,
            rule,
            detail,
            bytes: Vec::new(),
            spans: Vec::new(),
            end: 0,
        }
    }
}

impl Described {
    /// Logs a frame that breaks a rule; on a shared wire only if no other device knows its bytes.
    pub(super) fn complain(&mut self, mut of: Complaint) {
        if !self.place.is_alone {
            of.end = self.heard.passed;
            return self.heard.complaints.push(of);
        }
        self.log_complaint(of);
    }

    /// Logs a request, in the bytes `span`, if no device of the link has the asked address.
    pub(super) fn complain_if_absent(&mut self, at: Instant, asked: i128, span: Range<u64>) {
        let mut known = self.link_addresses.iter();
        if known.any(|known| i128::from(*known) == asked) {
            return;
        }
        let known = self.link_addresses.iter().take(ADDRESSES_MAX);
        let known: Vec<String> = known.map(u32::to_string).collect();
        let more = match self.link_addresses.len() > ADDRESSES_MAX {
            true => ", ..",
            false => "",
        };
        let detail = format!(
            "asked address {asked}, which no device of this link has ({}{more})",
            known.join(", ")
        );
        self.complain(Complaint {
            spans: vec![span],
            ..Complaint::new(at, WRONG_ADDRESS, detail)
        });
    }

    fn log_complaint(&mut self, of: Complaint) {
        let (at, rule, detail) = (of.at, of.rule, of.detail);
        match &of.bytes[..] {
            [] => self.log.repeated(at, EventKind::Violation, rule, || detail),
            bytes => self.log.violation(at, rule, detail, bytes),
        }
    }

    /// Whether [`settle`](Self::settle) has something to do.
    pub(crate) const fn has_heard(&self) -> bool {
        let heard = &self.heard;
        let is_over = heard.known.is_empty() && heard.claimed.is_empty();
        !(is_over && heard.complaints.is_empty() && heard.logged.is_empty())
    }

    /// The number of the first byte of which the device does not know yet whether it belongs to a
    /// frame.
    fn undecided(&self) -> u64 {
        let pending = match self.faults.is_off() {
            true => 0,
            false if self.silent.is_empty() && self.is_silence_framed => 0,
            false if self.is_silence_framed => self.silent_len,
            false => self.cutter.pending() as u64,
        };
        self.heard.passed.saturating_sub(pending)
    }

    /// Logs the frames that no device of a wire knows, each once. A frame waits until no other
    /// device can be within a longer frame around it.
    pub(crate) fn settle<'a>(units: impl Iterator<Item = &'a mut Self>) {
        let mut units: Vec<&mut Self> = units.collect();
        for index in 0..units.len() {
            let mut open = Vec::new();
            for of in core::mem::take(&mut units[index].heard.complaints) {
                let mut others = units
                    .iter()
                    .enumerate()
                    .filter(|(other, _)| *other != index);
                let end = of.spans.iter().map(|span| span.end).max().unwrap_or(0);
                if others.clone().any(|(_, other)| other.undecided() < end) {
                    open.push(of);
                    continue;
                }
                let is_known = |span: &Range<u64>| {
                    let mut heard = others.clone().map(|(_, other)| &other.heard);
                    heard.any(|heard| heard.covers(of.rule, span))
                };
                let is_excused = !of.spans.is_empty() && of.spans.iter().all(is_known);
                // Of the same complaints, the first one stays.
                let key = (of.at, of.rule, of.end);
                let is_same = others.any(|(_, other)| other.heard.logged.contains(&key));
                if !is_excused && !is_same {
                    let unit = &mut units[index];
                    unit.heard.logged.push(key);
                    unit.log_complaint(of);
                }
            }
            units[index].heard.complaints = open;
        }
        let decided = units.iter().map(|unit| unit.undecided()).min().unwrap_or(0);
        let open = units.iter().flat_map(|unit| &unit.heard.complaints);
        let first = open.flat_map(|of| &of.spans).map(|span| span.start).min();
        let needed = first.unwrap_or(decided).min(decided);
        for unit in units {
            unit.heard.known.retain(|known| known.end > needed);
            unit.heard.claimed.retain(|claimed| claimed.end > needed);
            unit.heard.logged.retain(|(.., end)| *end > needed);
        }
    }
}
