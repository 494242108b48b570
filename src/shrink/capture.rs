use core::time::Duration;
use std::collections::BTreeMap;

use protocols::{FrameError, panel};

use super::{Effort, fewest};
use crate::capture::{Capture, Kind, Record};
use crate::decode::{Protocol, Stream, What};
use crate::fuzz::wire::{Avr, HighFirst, LowFirst, Pcui, Wire, Xv11, Xv11Turns};
use crate::line::Direction;

/// A frame, or a stretch of bytes that are none, or a line event: what is kept or left out whole.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unit {
    /// As it stands in the capture.
    pub record: Record,
    /// The format in which it is a sound frame, if it is one.
    pub frame: Option<Protocol>,
}

/// Pause on a line that ends whatever was being sent on it.
const QUIET: Duration = Duration::from_millis(100);

/// The units of `capture` in the order in which they ended. Bytes of an unknown format stay as
/// they were recorded.
pub fn units(capture: &Capture) -> Vec<Unit> {
    let mut lanes: BTreeMap<(usize, bool), Vec<&Record>> = BTreeMap::new();
    for record in &capture.records {
        let lane = (record.link, record.direction == Direction::ToDevice);
        lanes.entry(lane).or_default().push(record);
    }
    let mut units: Vec<Unit> = lanes.into_values().flat_map(|lane| cut(&lane)).collect();
    units.sort_by_key(|unit| (unit.record.at, unit.record.link));
    for (number, unit) in (0..).zip(&mut units) {
        unit.record.sequence = Some(number);
    }
    units
}

/// The format of a lane, told from its first bytes.
fn protocol_of(lane: &[&Record]) -> Option<Protocol> {
    let mut bytes = Vec::new();
    for record in lane {
        bytes.extend_from_slice(&record.bytes);
        if bytes.len() > 20_000 {
            break;
        }
    }
    Protocol::guess(&bytes)
}

fn cut(lane: &[&Record]) -> Vec<Unit> {
    let whole = |record: &Record| Unit {
        record: record.clone(),
        frame: None,
    };
    let Some(protocol) = protocol_of(lane) else {
        return lane.iter().map(|record| whole(record)).collect();
    };
    let mut units = Vec::new();
    let mut bytes = Vec::new();
    // Where each record's bytes end in all bytes of the lane, to find the record of a unit's end.
    let mut ends: Vec<(usize, &Record)> = Vec::new();
    let mut stream = Stream::new(protocol);
    let mut found = Vec::new();
    let mut last = None;
    for &record in lane {
        if record.kind != Kind::Data {
            units.push(whole(record));
            continue;
        }
        if last.is_some_and(|last| record.at > last && record.at - last > QUIET) {
            found.extend(stream.idle());
        }
        last = Some(record.at);
        bytes.extend_from_slice(&record.bytes);
        ends.push((bytes.len(), record));
        found.extend(stream.push(&record.bytes));
    }
    found.extend(stream.idle());
    let mut next = 0;
    for one in found {
        let range = [one.bytes.start, one.bytes.end].map(|at| usize::try_from(at).unwrap_or(0));
        while ends[next].0 < range[1] {
            next += 1;
        }
        let record = ends[next].1;
        units.push(Unit {
            record: Record {
                bytes: bytes[range[0]..range[1]].to_vec(),
                sent: None,
                pieces: Vec::new(),
                comment: String::new(),
                ..record.clone()
            },
            frame: matches!(one.what, What::Frame(_)).then_some(protocol),
        });
    }
    units
}

/// `capture` with these units and no more.
pub fn with_units(capture: &Capture, units: &[Unit]) -> Capture {
    Capture {
        sections: capture.sections.clone(),
        links: capture.links.clone(),
        records: units.iter().map(|unit| unit.record.clone()).collect(),
        ..Capture::default()
    }
}

/// What is wrong with the bytes of a capture: the first stretch that is no frame, by its lane and
/// the kind of error, without figures.
pub fn fault_of(capture: &Capture, units: &[Unit]) -> Option<String> {
    // Lanes without any frame are of an unknown format, and nothing can be said of them.
    let mut bad = units.iter().filter(|unit| {
        let is_data = unit.record.kind == Kind::Data && !unit.record.bytes.is_empty();
        is_data && unit.frame.is_none() && known(units, unit)
    });
    let first = bad.next()?;
    let name = capture
        .links
        .get(first.record.link)
        .map_or("?", |link| &link.name);
    let direction = match first.record.direction {
        Direction::ToMaster => "to-master",
        Direction::ToDevice => "to-device",
    };
    let error = known_format(units, first).and_then(|protocol| {
        let mut stream = Stream::new(protocol);
        let mut found = stream.push(&first.record.bytes);
        found.extend(stream.idle());
        found.into_iter().find_map(|one| match one.what {
            What::Bad(errors) => errors.first().copied(),
            What::Frame(_) => None,
        })
    });
    let kind = match error {
        Some(FrameError::Checksum { .. }) => "a checksum that does not fit",
        Some(FrameError::Length { .. }) => "a length that is not allowed",
        Some(FrameError::Truncated { .. }) => "a frame that was cut off",
        _ => "bytes outside of frames",
    };
    Some(format!("{name} {direction}: {kind}"))
}

fn known(units: &[Unit], unit: &Unit) -> bool {
    known_format(units, unit).is_some()
}

fn known_format(units: &[Unit], unit: &Unit) -> Option<Protocol> {
    let mut lane = units.iter().filter(|other| {
        other.record.link == unit.record.link && other.record.direction == unit.record.direction
    });
    lane.find_map(|other| other.frame)
}

/// The fewest units, and the plainest bytes in them, for which `fails` still holds. In sound frames
/// the payload is put to zero byte by byte; with `repairs` their checksums are made to fit again.
pub fn capture(
    units: &[Unit],
    mut fails: impl FnMut(&[Unit]) -> bool,
    effort: &mut Effort<'_>,
    repairs: Repair,
) -> Vec<Unit> {
    let mut best = fewest(units, effort, &mut fails);
    for index in 0..best.len() {
        for at in 0..best[index].record.bytes.len() {
            let mut plainer = best.clone();
            let unit = &mut plainer[index];
            if unit.record.bytes[at] == 0 {
                continue;
            }
            unit.record.bytes[at] = 0;
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

/// What happens to the checksum of a frame whose payload was changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repair {
    /// It is made to fit.
    Checksums,
    /// It stays.
    Nothing,
}

fn repair(unit: &mut Unit) {
    let bytes = &mut unit.record.bytes;
    match unit.frame {
        Some(Protocol::Xv11) => Xv11::repair(bytes),
        Some(Protocol::Xv11Turn) => Xv11Turns::repair(bytes),
        Some(Protocol::Bus) => Avr::<LowFirst>::repair(bytes),
        Some(Protocol::BusHighFirst) => Avr::<HighFirst>::repair(bytes),
        Some(Protocol::Pcui) => Pcui::repair(bytes),
        Some(Protocol::Panel) => repair_panel(bytes),
        None => {}
    }
}

fn repair_panel(frame: &mut [u8]) {
    if let Some((body, sum)) = frame.split_last_chunk_mut::<2>()
        && let Some(summed) = body.get(1..)
    {
        *sum = panel::checksum(summed).to_be_bytes();
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
