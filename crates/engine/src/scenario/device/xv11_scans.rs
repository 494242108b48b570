//! Turns of an XV-11 from its packets.

use core::f64::consts::TAU;

use protocols::Decode as _;
use protocols::xv11;

use super::scan::{Beam, ScanDecoder};

/// Turns of an XV-11. A turn ends with its last packet, or, if the line has lost that one, with the
/// first packet of the next turn.
#[derive(Clone, Debug)]
pub struct Xv11Scans {
    /// Bearing of the first reading.
    first_bearing: f64,
    place_m: [f64; 2],
    decoder: xv11::Decoder,
    ranges_mm: [u16; 360],
    /// Index of the last packet of an incomplete turn.
    last: Option<usize>,
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
            last: None,
        }
    }

    /// The same on a lidar that sits at x and y on the robot, metres ahead and to the left.
    #[must_use]
    pub const fn at(self, place_m: [f64; 2]) -> Self {
        Self { place_m, ..self }
    }

    /// Ends the turn and returns its beams.
    fn end(&mut self) -> Vec<Beam> {
        let beams = self.beams();
        self.ranges_mm = [0; 360];
        beams
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
            let index = usize::from(frame.index());
            if self.last.take().is_some_and(|last| index <= last) {
                whole = Some(self.end());
            }
            let first = index * xv11::READINGS_PER_FRAME;
            for (slot, reading) in self.ranges_mm[first..].iter_mut().zip(frame.readings()) {
                *slot = match reading {
                    xv11::Reading::Range { distance_mm, .. } => distance_mm,
                    xv11::Reading::Invalid { .. } => 0,
                };
            }
            match index == xv11::FRAMES_PER_TURN - 1 {
                true => whole = Some(self.end()),
                false => self.last = Some(index),
            }
        }
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use xv11::{Frame, RawReading, SpeedWord};

    /// Turns of four readings of 1 m a packet; the first turn lost its last two packets. It ends
    /// with the first packet of the second turn, which ends with its own last packet.
    #[test]
    fn a_turn_without_its_last_packet_ends_with_the_next_turn() {
        let mut scans = Xv11Scans::new(0.0);
        let reading = RawReading([0xE8, 0x03, 100, 0]);
        let mut push = |index: usize| {
            let index = u8::try_from(index).unwrap();
            let frame = Frame::new(index, SpeedWord(19_200), [reading; 4]);
            scans.push(frame.as_bytes()).map(|beams| beams.len())
        };
        assert!((0..88).all(|index| push(index).is_none()));
        assert_eq!(push(0), Some(352));
        assert!((1..89).all(|index| push(index).is_none()));
        assert_eq!(push(89), Some(360));
        assert_eq!(push(0), None);
    }
}
