//! Lidar turns from the bytes of a link.

use emulators::xv11::Mount;
use protocols::xv11::{self, Reading};
use protocols::{Decode as _, Instant};

use crate::replay::{Passage, Recorded};
use engine::codec::{self, PERCEPTION, RPLIDAR, XV11};
use engine::scenario::device::camera_scans::CameraScans;
use engine::scenario::device::rplidar_scans::RplidarScans;
use engine::scenario::device::scan::{Beam, ScanDecoder};

/// Readings of a turn, one a degree.
pub(super) const READINGS: usize = 360;

/// One turn of a lidar.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scan {
    /// Name of its link.
    pub link: String,
    /// Time of its last bytes, from the start of the capture.
    pub at: Instant,
    /// Bearing of the first reading, radians counter-clockwise from ahead; each next reading is a
    /// degree farther.
    pub start: f64,
    /// Metres; `None`: no reading, or its packet did not arrive.
    pub ranges: Vec<Option<f64>>,
    /// Strength of each reading; 0 for missing readings and for a lidar without strength.
    pub strengths: Vec<f64>,
}

/// The turns on all links that carry a lidar's packets, in order of time. A turn is left out if
/// fewer than half its packets arrived, or if its beginning is missing.
pub(crate) fn scans(recorded: &Recorded) -> Vec<Scan> {
    let mut scans: Vec<Scan> = recorded.links.iter().flat_map(turns).collect();
    scans.sort_by_key(|scan| scan.at);
    scans
}

/// The turns on a link, if it is a lidar's.
fn turns(passage: &Passage) -> Vec<Scan> {
    let first = passage.arrivals.iter().flat_map(|one| &one.bytes).copied();
    let first: Vec<u8> = first.take(1 << 16).collect();
    match codec::guess(&first) {
        Some(codec) if *codec == XV11 => turns_of_packets(passage),
        // Angle 0 of the sensor, or the camera's axis, is assumed to be ahead.
        Some(codec) if *codec == RPLIDAR => turns_by(RplidarScans::new(0.0), passage),
        Some(codec) if *codec == PERCEPTION => turns_by(CameraScans::new(0.0, [0.0; 2]), passage),
        _ => Vec::new(),
    }
}

/// Turns from `decoder`: the nearest reading in each degree.
fn turns_by(mut decoder: impl ScanDecoder, passage: &Passage) -> Vec<Scan> {
    let mut scans = Vec::new();
    for arrival in &passage.arrivals {
        scans.extend(decoder.push(&arrival.bytes).map(|beams| Scan {
            link: passage.link.clone(),
            at: arrival.at,
            start: 0.0,
            ranges: nearest(&beams),
            strengths: vec![0.0; READINGS],
        }));
    }
    scans
}

/// The nearest beam in each degree counter-clockwise from ahead, metres.
fn nearest(beams: &[Beam]) -> Vec<Option<f64>> {
    let mut ranges: Vec<Option<f64>> = vec![None; READINGS];
    for beam in beams {
        let degree = beam.bearing.to_degrees().round();
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a whole number of one turn"
        )]
        #[expect(clippy::cast_sign_loss, reason = "not negative")]
        let index = degree.rem_euclid(READINGS as f64) as usize % READINGS;
        let known = ranges[index].unwrap_or(f64::INFINITY);
        ranges[index] = Some(known.min(beam.distance_m));
    }
    ranges
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

fn turns_of_packets(passage: &Passage) -> Vec<Scan> {
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

/// Minimum number of packets of a valid turn.
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

#[cfg(test)]
mod tests {
    use protocols::rplidar::{Descriptor, Node};

    use super::*;
    use crate::replay::Arrival;

    /// Bytes from a lidar, one piece each millisecond.
    fn passage(pieces: impl Iterator<Item = impl AsRef<[u8]>>) -> Passage {
        let arrivals = (0..).zip(pieces).map(|(ms, bytes)| Arrival {
            at: Instant::from_millis(ms),
            bytes: bytes.as_ref().to_vec(),
        });
        Passage {
            link: "lidar".to_owned(),
            arrivals: arrivals.collect(),
            ..Passage::default()
        }
    }

    /// Angles are clockwise from ahead on the wire, counter-clockwise in the scan: 90 degrees
    /// become 270. The turn ends with the first node of the next.
    #[test]
    fn nodes_of_an_rplidar_become_degrees_to_the_left() {
        let node =
            |starts, degrees: u16, mm: u16| *Node::new(starts, 15, degrees * 64, mm * 4).as_bytes();
        let nodes = [
            node(true, 0, 1000),
            node(false, 90, 2000),
            node(false, 90, 1500),
            node(false, 180, 0),
            node(true, 0, 1000),
            node(false, 1, 1000),
        ];
        let whole = [&Descriptor::nodes().as_bytes()[..], nodes.as_flattened()].concat();
        let links = vec![passage(whole.chunks(5))];
        let scans = scans(&Recorded {
            links,
            ..Recorded::default()
        });
        let [scan] = &scans[..] else {
            panic!("{scans:?}");
        };
        let measured = (0..)
            .zip(&scan.ranges)
            .filter_map(|(k, range)| Some((k, (*range)?)));
        let measured: Vec<(usize, f64)> = measured.collect();
        assert_eq!(measured, [(0, 1.0), (270, 1.5)]);
    }

    /// A camera sends six scans of 30 ranges, from straight ahead to the left, a degree apart.
    #[test]
    fn scans_of_a_camera_become_turns() {
        use protocols::perception;
        let scan = |mm: u16| {
            let mut message = [0; 128];
            let len = perception::Scan::encode(0, 17_453, &[mm; 30], &mut message);
            message[..len].to_vec()
        };
        let sent: Vec<_> = (0..3).flat_map(|_| [scan(1_000), scan(2_000)]).collect();
        let links = vec![passage(sent.iter())];
        let found = scans(&Recorded {
            links,
            ..Recorded::default()
        });
        let times: Vec<_> = found.iter().map(|scan| scan.at.as_millis()).collect();
        assert_eq!(times, [0, 1, 2, 3, 4, 5]);
        for (scan, range) in found.iter().zip([1.0, 2.0].into_iter().cycle()) {
            let expected: Vec<_> = (0..360)
                .map(|degree| (degree < 30).then_some(range))
                .collect();
            assert_eq!(scan.ranges, expected);
        }
    }

    /// A packet holds four degrees. A turn that lost more than half of its packets is invalid; a
    /// turn ends where the next one begins.
    #[test]
    fn packets_of_an_xv11_become_turns() {
        let packet = |index: u8| {
            let readings = core::array::from_fn(|reading: usize| {
                let degree = usize::from(index) * 4 + reading;
                let distance_mm = 1_000 + u16::try_from(degree).expect("small");
                let (strength, weak) = (u16::from(index), false);
                xv11::RawReading::from(Reading::Range {
                    distance_mm,
                    strength,
                    weak,
                })
            });
            *xv11::Frame::new(index, xv11::SpeedWord(19_200), readings).as_bytes()
        };
        let turns = |turns: &[core::ops::Range<u8>]| {
            let packets = turns.iter().cloned().flatten().map(packet);
            turns_of_packets(&passage(packets))
        };
        let found = turns(&[0..90, 0..45, 0..44]);
        let times: Vec<_> = found.iter().map(|scan| scan.at.as_millis()).collect();
        assert_eq!(times, [89, 134]);
        assert_eq!(found[0].ranges.len(), 360);
        for degree in [0, 1, 90, 359] {
            let range = 1.0 + degree as f64 / 1_000.0;
            assert_eq!(found[0].ranges[degree], Some(range));
            assert_eq!(found[0].strengths[degree], (degree / 4) as f64);
        }
        assert_eq!(
            (found[1].ranges[179], found[1].ranges[180]),
            (Some(1.179), None)
        );
    }
}
