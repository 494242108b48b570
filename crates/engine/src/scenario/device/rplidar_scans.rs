//! Turns of an RPLIDAR from its nodes or capsules.

use core::f64::consts::TAU;

use protocols::Decode as _;
use protocols::rplidar::{Capsule, Decoder, Frame, Node, Sample, UltraCapsule};

use super::scan::{Beam, ScanDecoder};

/// Maximum number of beams of a turn that are kept. The fastest scan has 7874 at one turn a second.
const BEAMS_MAX: usize = 8_192;

/// Turns of an RPLIDAR.
#[derive(Clone, Debug)]
pub struct RplidarScans {
    /// Bearing of the sensor's angle 0.
    zero_bearing: f64,
    place_m: [f64; 2],
    decoder: Decoder,
    /// The received part of the current turn; `None` before its first sample.
    turn: Option<Vec<Beam>>,
    /// The last capsule. Its angles can be computed only with the next capsule.
    last: Option<Capsule>,
    /// The last capsule of the kind 0x84.
    last_ultra: Option<UltraCapsule>,
}

impl RplidarScans {
    /// For a lidar whose angle 0 has the bearing `zero_bearing`, radians counter-clockwise from
    /// straight ahead.
    pub fn new(zero_bearing: f64) -> Self {
        Self {
            zero_bearing,
            place_m: [0.0; 2],
            decoder: Decoder::default(),
            turn: None,
            last: None,
            last_ultra: None,
        }
    }

    /// The same on a lidar that sits at x and y on the robot, metres ahead and to the left.
    #[must_use]
    pub fn at(self, place_m: [f64; 2]) -> Self {
        Self { place_m, ..self }
    }

    /// Adds a beam at `turns` clockwise from the sensor's angle 0.
    fn add(&mut self, turns: f64, distance_m: f64) {
        let beam = Beam {
            bearing: self.zero_bearing - turns * TAU,
            distance_m,
        };
        let beam = beam.seen_from(self.place_m);
        if let Some(turn) = self.turn.as_mut().filter(|turn| turn.len() < BEAMS_MAX) {
            turn.push(beam);
        }
    }

    /// The turn that ends here, if its beginning was received.
    fn end_turn(&mut self) -> Option<Vec<Beam>> {
        self.turn.replace(Vec::new())
    }

    fn node(&mut self, node: Node) -> Option<Vec<Beam>> {
        let whole = if node.starts_turn() {
            self.end_turn()
        } else {
            None
        };
        if let Some(mm) = node.distance_mm() {
            self.add(f64::from(node.angle_deg()) / 360.0, f64::from(mm) / 1e3);
        }
        whole
    }

    fn capsule(&mut self, capsule: Capsule) -> Option<Vec<Beam>> {
        let last = self.last.replace(capsule).filter(|_| !capsule.is_first())?;
        let angles = [last.start_angle_q6(), capsule.start_angle_q6()];
        self.samples(&last.samples(&capsule), angles)
    }

    fn ultra(&mut self, capsule: UltraCapsule) -> Option<Vec<Beam>> {
        let last = self.last_ultra.replace(capsule);
        let last = last.filter(|_| !capsule.is_first())?;
        let angles = [last.start_angle_q6(), capsule.start_angle_q6()];
        self.samples(&last.samples(&capsule), angles)
    }

    /// The samples between two capsules with these start angles. A turn ends with the capsule in
    /// which the angle passes 0.
    fn samples(&mut self, samples: &[Sample], [from, to]: [u16; 2]) -> Option<Vec<Beam>> {
        for sample in samples.iter().filter(|sample| sample.distance_mm > 0) {
            let turns = f64::from(sample.angle_deg()) / 360.0;
            self.add(turns, f64::from(sample.distance_mm) / 1e3);
        }
        if to < from { self.end_turn() } else { None }
    }
}

impl ScanDecoder for RplidarScans {
    fn push(&mut self, bytes: &[u8]) -> Option<Vec<Beam>> {
        let mut whole = None;
        let frames: Vec<Frame> = self.decoder.push(bytes).flatten().collect();
        for frame in frames {
            let ended = match frame {
                Frame::Node(node) => self.node(node),
                Frame::Capsule(capsule) => self.capsule(capsule),
                Frame::Ultra(capsule) => self.ultra(capsule),
                // A scan begins or ends: the current turn is incomplete.
                _ => {
                    (self.turn, self.last, self.last_ultra) = (None, None, None);
                    None
                }
            };
            whole = ended.or(whole);
        }
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::rplidar::{CapsuleSample, Descriptor};

    /// A beam in whole degrees and millimetres.
    fn told(beam: &Beam) -> (i64, i64) {
        let whole = |value: f64| format!("{value:.0}").parse().expect("a number");
        (
            whole(beam.bearing.to_degrees()),
            whole(beam.distance_m * 1e3),
        )
    }

    /// Checks the bearings: angles count clockwise from ahead, so 90 degrees is to the right. On a
    /// sensor that looks backwards, 90 degrees is to the left: -180 - 90. A turn is complete only
    /// if its first node was received.
    #[test]
    fn a_turn_of_nodes_ends_where_the_next_begins() {
        let node = |starts: bool, degrees: u16, mm: u16| {
            *Node::new(starts, 47, degrees * 64, mm * 4).as_bytes()
        };
        let nodes = [
            node(false, 300, 500),
            node(true, 0, 1000),
            node(false, 90, 2000),
            node(false, 180, 0),
            node(true, 0, 1000),
            node(false, 90, 2000),
        ];
        let bytes = [&Descriptor::nodes().as_bytes()[..], nodes.as_flattened()].concat();
        let turn = RplidarScans::new(0.0).push(&bytes).expect("a whole turn");
        let beams: Vec<_> = turn.iter().map(told).collect();
        assert_eq!(beams, [(0, 1000), (-90, 2000)]);

        let mut behind = RplidarScans::new(TAU / 2.0).at([-0.5, 0.0]);
        let pieces: Vec<Vec<Beam>> = bytes.chunks(3).filter_map(|b| behind.push(b)).collect();
        // 1 m behind the sensor, which sits half a metre behind the middle.
        assert_eq!(pieces.len(), 1);
        assert_eq!(told(&pieces[0][0]), (180, 1500));
    }

    /// Capsules of 90 degrees each, all samples 1 m away: the turn that begins in the second one
    /// has the 128 samples of four capsules.
    #[test]
    fn a_turn_of_capsules_has_all_their_samples() {
        let sample = CapsuleSample {
            distance_mm: 1000,
            dtheta_q3: 0,
        };
        let capsule = |index: u16| {
            let angle = (300 + index * 90) % 360 * 64;
            *Capsule::new(index == 0, angle, &[sample; 32]).as_bytes()
        };
        let capsules: Vec<[u8; 84]> = (0..7).map(capsule).collect();
        let bytes = [
            &Descriptor::capsules().as_bytes()[..],
            capsules.as_flattened(),
        ]
        .concat();
        let turn = RplidarScans::new(0.0).push(&bytes).expect("a whole turn");
        assert_eq!(turn.len(), 128);
        assert!(turn.iter().all(|beam| told(beam).1 == 1000));
    }
}
