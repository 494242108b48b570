//! Lidar turns from the bytes of a link.

use emulators::xv11::Mount;
use protocols::xv11::{self, Reading};
use protocols::{Decode as _, Instant};

use crate::capture::replay::{Passage, Recorded};
use crate::codec::{self, XV11};

/// Readings of a turn, one a degree.
pub(super) const READINGS: usize = 360;

/// One turn of a lidar.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scan {
    /// Name of its link.
    pub link: String,
    /// When its last packet had arrived, from the beginning of the capture.
    pub at: Instant,
    /// Bearing of the first reading, radians counter-clockwise from ahead; the others follow by a
    /// degree each.
    pub start: f64,
    /// Metres; `None`: nothing measured, or its packet did not arrive.
    pub ranges: Vec<Option<f64>>,
    /// Strength of each measured reading, 0 for the others.
    pub strengths: Vec<f64>,
}

/// The turns on all links that carry a lidar's packets, in order of time. A turn with fewer than
/// half its packets is left out.
pub(crate) fn scans(recorded: &Recorded) -> Vec<Scan> {
    let links = recorded.links.iter().filter(|one| is_lidar(one));
    let mut scans: Vec<Scan> = links.flat_map(turns).collect();
    scans.sort_by_key(|scan| scan.at);
    scans
}

fn is_lidar(passage: &Passage) -> bool {
    let first = passage.arrivals.iter().flat_map(|one| &one.bytes).copied();
    let first: Vec<u8> = first.take(1 << 16).collect();
    codec::guess(&first) == Some(&XV11)
}

struct Turn {
    ranges: Vec<Option<f64>>,
    strengths: Vec<f64>,
    packets: usize,
}

impl Turn {
    fn new() -> Self {
        Self {
            ranges: vec![None; READINGS],
            strengths: vec![0.0; READINGS],
            packets: 0,
        }
    }
}

fn turns(passage: &Passage) -> Vec<Scan> {
    let mut decoder = xv11::Decoder::default();
    let mut scans = Vec::new();
    let (mut turn, mut last, mut heard) = (Turn::new(), 0, Instant::ZERO);
    for arrival in &passage.arrivals {
        for frame in decoder.push(&arrival.bytes).flatten() {
            if frame.index() <= last && turn.packets > 0 {
                scans.extend(whole(
                    &passage.link,
                    heard,
                    core::mem::replace(&mut turn, Turn::new()),
                ));
            }
            (last, heard) = (frame.index(), arrival.at);
            turn.packets += 1;
            let first = usize::from(frame.index()) * 4;
            for (reading, degree) in frame.readings().into_iter().zip(first..) {
                if let Reading::Range {
                    distance_mm,
                    strength,
                    ..
                } = reading
                {
                    turn.ranges[degree] = Some(f64::from(distance_mm) / 1000.0);
                    turn.strengths[degree] = f64::from(strength);
                }
            }
        }
    }
    scans.extend(whole(&passage.link, heard, turn));
    scans
}

/// Packets from which on a turn says something.
const PACKETS_MIN: usize = 45;

fn whole(link: &str, at: Instant, turn: Turn) -> Option<Scan> {
    (turn.packets >= PACKETS_MIN).then(|| Scan {
        link: link.to_owned(),
        at,
        start: Mount::default().yaw_deg.to_radians(),
        ranges: turn.ranges,
        strengths: turn.strengths,
    })
}
