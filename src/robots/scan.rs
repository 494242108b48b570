//! Turns of a lidar from the bytes of its link, for page and export.

use core::f64::consts::TAU;

use protocols::Decode as _;
use protocols::xv11;

/// A beam that came back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Counter-clockwise from straight ahead of the robot, radians.
    pub bearing: f64,
    /// Metres from the middle of the robot, or of the lidar where its place is not known.
    pub distance_m: f64,
}

/// Reads whole turns from what a lidar sends.
pub trait ScanDecoder {
    /// Takes more bytes; the last turn that they completed, if any.
    fn push(&mut self, bytes: &[u8]) -> Option<Vec<Beam>>;
}

/// Turns of an XV-11.
#[derive(Clone, Debug)]
pub struct Xv11Scans {
    /// Bearing of the first reading.
    first_bearing: f64,
    decoder: xv11::Decoder,
    ranges_mm: [u16; 360],
}

impl Xv11Scans {
    /// Of a lidar whose first reading looks to `first_bearing`, radians counter-clockwise from
    /// straight ahead.
    pub fn new(first_bearing: f64) -> Self {
        Self {
            first_bearing,
            decoder: xv11::Decoder::default(),
            ranges_mm: [0; 360],
        }
    }

    fn beams(&self) -> Vec<Beam> {
        let bearing = |degree: u16| self.first_bearing + f64::from(degree) / 360.0 * TAU;
        let beams = (0..).zip(self.ranges_mm).filter(|&(_, mm)| mm > 0);
        let beam = |(degree, mm)| Beam {
            bearing: bearing(degree),
            distance_m: f64::from(mm) / 1000.0,
        };
        beams.map(beam).collect()
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
