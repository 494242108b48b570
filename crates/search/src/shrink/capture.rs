use core::mem::take;
use std::collections::{BTreeMap, BTreeSet};

use bytes::BytesMut;
use protocols::{FrameError, LineConfig};

use super::{Effort, fewest};
use capture::decode::pause::Pauses;
use capture::{Capture, Kind, Record};
use engine::codec::{self, Codec, Stream, What};
use engine::rig::line::Direction;

/// A frame, a stretch of bytes outside frames, or a line event: kept or removed as a whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unit {
    /// The record in the capture.
    pub record: Record,
    /// The format, if the unit is a valid frame.
    pub frame: Option<&'static Codec>,
}

impl Unit {
    /// Link and direction.
    fn lane(&self) -> (usize, bool) {
        let record = &self.record;
        (record.link, record.direction == Direction::ToDevice)
    }

    /// Changes the bytes; clones keep the original bytes.
    fn change(&mut self, change: impl FnOnce(&mut [u8])) {
        let mut bytes = BytesMut::from(take(&mut self.record.bytes));
        change(&mut bytes);
        self.record.bytes = bytes.freeze();
    }
}

/// The units of `capture` in order of their ends. Bytes of an unknown format stay as recorded.
pub fn units(capture: &Capture) -> Vec<Unit> {
    let mut lanes: BTreeMap<(usize, bool), Vec<Heard<'_>>> = BTreeMap::new();
    let mut turned = BTreeSet::new();
    for record in &capture.records {
        let lane = (record.link, record.direction == Direction::ToDevice);
        let is_data = record.kind == Kind::Data;
        let is_turned = is_data && turned.remove(&lane);
        if is_data {
            turned.insert((lane.0, !lane.1));
        }
        lanes.entry(lane).or_default().push((record, is_turned));
    }
    let lanes = lanes.into_values();
    let mut units: Vec<Unit> = lanes.flat_map(|lane| cut(&lane, capture)).collect();
    units.sort_by_key(|unit| (unit.record.at, unit.record.link));
    for (number, unit) in (0..).zip(&mut units) {
        unit.record.sequence = Some(number);
    }
    units
}

/// A record of a lane, and whether the other direction sent bytes since the one before.
type Heard<'a> = (&'a Record, bool);

/// The format of a lane, determined from its first bytes.
fn codec_of(lane: &[Heard<'_>]) -> Option<&'static Codec> {
    let mut bytes = Vec::new();
    for (record, _) in lane {
        bytes.extend_from_slice(&record.bytes);
        if bytes.len() > 20_000 {
            break;
        }
    }
    codec::guess(&bytes)
}

fn cut(lane: &[Heard<'_>], capture: &Capture) -> Vec<Unit> {
    let whole = |record: &Record| Unit {
        record: record.clone(),
        frame: None,
    };
    let Some(codec) = codec_of(lane) else {
        return lane.iter().map(|(record, _)| whole(record)).collect();
    };
    let mut units = Vec::new();
    let mut bytes = BytesMut::new();
    // The ends of the records in the concatenated bytes, to find the record in which a unit ends.
    let mut ends: Vec<(usize, &Record)> = Vec::new();
    let mut stream = match lane.first() {
        Some((record, _)) => Stream::towards(codec, record.direction),
        None => return Vec::new(),
    };
    let mut found = Vec::new();
    let mut last = None;
    let pauses = Pauses::of(&capture.sections);
    for &(record, is_turned) in lane {
        if record.kind != Kind::Data {
            units.push(whole(record));
            continue;
        }
        let line = LineConfig::new_8n1(capture.links[record.link].baud.max(1));
        let pause = |last| Pauses::between(last, record.at, record.bytes.len(), line);
        if last.is_some_and(|last| pause(last) > pauses.limit(Some(codec), is_turned)) {
            found.extend(stream.idle());
        }
        last = Some(record.at);
        bytes.extend_from_slice(&record.bytes);
        ends.push((bytes.len(), record));
        found.extend(stream.push(&record.bytes));
    }
    found.extend(stream.idle());
    let bytes = bytes.freeze();
    let mut next = 0;
    for one in found {
        let range = [one.bytes.start, one.bytes.end].map(|at| usize::try_from(at).unwrap_or(0));
        while ends[next].0 < range[1] {
            next += 1;
        }
        let record = ends[next].1;
        units.push(Unit {
            record: Record {
                bytes: bytes.slice(range[0]..range[1]),
                sent: None,
                pieces: Vec::new(),
                comment: String::new(),
                ..record.clone()
            },
            frame: matches!(one.what, What::Frame(_)).then_some(codec),
        });
    }
    units
}

/// `capture` with these units only.
pub fn with_units(capture: &Capture, units: &[Unit]) -> Capture {
    Capture {
        sections: capture.sections.clone(),
        links: capture.links.clone(),
        records: units.iter().map(|unit| unit.record.clone()).collect(),
        ..Capture::default()
    }
}

/// The error in a capture: its first broken frame. If all frames are valid, the first bytes outside
/// frames, which many devices send. The result is the lane and the kind of error, without figures.
pub fn fault_of(capture: &Capture, units: &[Unit]) -> Option<String> {
    let (index, kind) = first_bad(units)?;
    let record = &units[index].record;
    let name = capture
        .links
        .get(record.link)
        .map_or("?", |link| &link.name);
    Some(format!("{name} {}: {kind}", record.direction.name()))
}

const OUTSIDE: &str = "bytes outside of frames";

/// The first broken frame, or else the first bytes outside frames on a lane with frames, and the
/// error. A lane without frames has an unknown format and is not judged.
fn first_bad(units: &[Unit]) -> Option<(usize, &'static str)> {
    let mut formats: BTreeMap<(usize, bool), &'static Codec> = BTreeMap::new();
    for unit in units {
        if let Some(codec) = unit.frame {
            formats.entry(unit.lane()).or_insert(codec);
        }
    }
    let mut bad = units.iter().enumerate().filter_map(|(index, unit)| {
        let is_data = unit.record.kind == Kind::Data && !unit.record.bytes.is_empty();
        let is_bad = is_data && unit.frame.is_none();
        let codec = formats.get(&unit.lane()).filter(|_| is_bad)?;
        Some((index, error_of(&unit.record, codec)))
    });
    let first = bad.next()?;
    if first.1 != OUTSIDE {
        return Some(first);
    }
    bad.find(|(_, kind)| *kind != OUTSIDE).or(Some(first))
}

fn error_of(record: &Record, codec: &'static Codec) -> &'static str {
    let error = codec
        .found_towards(&record.bytes, record.direction)
        .into_iter()
        .find_map(|one| match one.what {
            What::Bad(errors) => errors.first().copied(),
            What::Frame(_) => None,
        });
    match error {
        Some(FrameError::Checksum { .. }) => "a checksum that does not fit",
        Some(FrameError::Length { .. }) => "a length that is not allowed",
        Some(FrameError::Truncated { .. }) => "a frame that was cut off",
        _ => OUTSIDE,
    }
}

/// The smallest set of units with the simplest bytes for which `fails` still returns true. In valid
/// frames payload bytes are set to zero one by one; with `repairs` the checksums are corrected.
///
/// `fails` must return true for all of `units`.
pub fn capture(
    units: &[Unit],
    mut fails: impl FnMut(&[Unit]) -> bool,
    effort: &mut Effort<'_>,
    repairs: Repair,
) -> Vec<Unit> {
    let near = neighbourhood(units, &mut fails, effort);
    let mut best = fewest(near.as_deref().unwrap_or(units), effort, &mut fails);
    for index in 0..best.len() {
        for at in 0..best[index].record.bytes.len() {
            let mut plainer = best.clone();
            let unit = &mut plainer[index];
            if unit.record.bytes[at] == 0 {
                continue;
            }
            unit.change(|bytes| bytes[at] = 0);
            if repairs == Repair::Checksums {
                repair(unit);
            }
            if plainer != best && effort.spend() && fails(&plainer) {
                best = plainer;
            }
        }
    }
    best
}

/// The neighbourhood of the first error for which `fails` still returns true; it nearly always
/// suffices for a long capture. Searches the lane of the error first, then all lanes, and doubles
/// the distance each time.
fn neighbourhood(
    units: &[Unit],
    fails: &mut impl FnMut(&[Unit]) -> bool,
    effort: &mut Effort<'_>,
) -> Option<Vec<Unit>> {
    let (bad, _) = first_bad(units)?;
    let same_lane = |&index: &usize| units[index].lane() == units[bad].lane();
    let own_lane: Vec<usize> = (0..units.len()).filter(same_lane).collect();
    for lane in [own_lane, (0..units.len()).collect()] {
        let middle = lane.partition_point(|&index| index < bad);
        let mut reach = 1;
        while reach < lane.len() {
            let around = middle.saturating_sub(reach)..(middle + reach).min(lane.len());
            let around: Vec<Unit> = lane[around].iter().map(|&i| units[i].clone()).collect();
            if effort.spend() && fails(&around) {
                return Some(around);
            }
            reach *= 2;
        }
    }
    None
}

/// The treatment of the checksum when the payload of a frame changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repair {
    /// The checksum is corrected.
    Checksums,
    /// The checksum is not changed.
    Nothing,
}

fn repair(unit: &mut Unit) {
    if let Some(codec) = unit.frame {
        unit.change(|bytes| codec.repair(bytes));
    }
}

/// `capture` as the bytes of a file.
pub fn to_bytes(capture: &Capture) -> Vec<u8> {
    let mut out = Vec::new();
    capture
        .sections
        .first()
        .cloned()
        .unwrap_or_default()
        .write(&mut out);
    capture.links.iter().for_each(|link| link.write(&mut out));
    for record in &capture.records {
        record.write(u32::try_from(record.link).unwrap_or(u32::MAX), &mut out);
    }
    out
}
