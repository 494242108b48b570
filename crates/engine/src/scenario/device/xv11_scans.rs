//! Turns of an XV-11 from its packets.

use core::f64::consts::TAU;

use protocols::Decode as _;
use protocols::xv11;

use super::scan::{Beam, ScanDecoder};

/// Turns of an XV-11.
#[derive(Clone, Debug)]
pub struct Xv11Scans {
    /// Bearing of the first reading.
    first_bearing: f64,
    place_m: [f64; 2],
    decoder: xv11::Decoder,
    ranges_mm: [u16; 360],
}

impl Xv11Scans {
    /// For a lidar whose first reading has the bearing `first_bearing`, radians counter-clockwise
    /// from straight ahead.
    pub fn new(first_bearing: f64) -> Self {
        Self {
            first_bearing,
            place_m: [0.0; 2],
            decoder: xv11::Decoder::default(),
            ranges_mm: [0; 360],
        }
    }

    /// The same on a lidar that sits at x and y on the robot, metres ahead and to the left.
    #[must_use]
    pub const fn at(self, place_m: [f64; 2]) -> Self {
        Self { place_m, ..self }
    }

    fn beams(&self) -> Vec<Beam> {
        let bearing = |degree: u16| self.first_bearing + f64::from(degree) / 360.0 * TAU;
        let beams = (0..).zip(self.ranges_mm).filter(|&(_, mm)| mm > 0);
        let beam = |(degree, mm)| Beam {
            bearing: bearing(degree),
            distance_m: f64::from(mm) / 1000.0,
        };
        beams.map(|one| beam(one).seen_from(self.place_m)).collect()
    }
}

impl ScanDecoder for Xv11Scans {
    fn push(&mut self, bytes: &[u8]) -> Option<Vec<Beam>> {
        let mut whole = None;
        let frames: Vec<xv11::Frame> = self.decoder.push(bytes).flatten().collect();
        for frame in frames {
            let first = usize::from(frame.index()) * xv11::READINGS_PER_FRAME;
            for (slot, reading) in self.ranges_mm[first..].iter_mut().zip(frame.readings()) {
                *slot = match reading {
                    xv11::Reading::Range { distance_mm, .. } => distance_mm,
                    xv11::Reading::Invalid { .. } => 0,
                };
            }
            if usize::from(frame.index()) == xv11::FRAMES_PER_TURN - 1 {
                whole = Some(self.beams());
                self.ranges_mm = [0; 360];
            }
        }
        whole
    }
}
