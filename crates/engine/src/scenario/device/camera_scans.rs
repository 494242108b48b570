//! Pictures of a depth camera as scans, from its rows of depths.

use protocols::perception::{MESSAGE_MAX, Message};
use protocols::{Decode as _, Decoder};

use super::scan::{Beam, ScanDecoder};
use crate::codec::wire::Wire as _;
use crate::codec::{MessageFormat, Perception};

/// Pictures of a depth camera.
#[derive(Clone, Debug)]
pub struct CameraScans {
    /// Viewing direction of the camera.
    ahead: f64,
    place_m: [f64; 2],
    decoder: Decoder<MessageFormat, MESSAGE_MAX>,
}

impl CameraScans {
    /// For a camera with the viewing direction `ahead`, radians counter-clockwise from straight
    /// ahead. Its position on the robot is x and y, metres ahead and to the left.
    pub fn new(ahead: f64, place_m: [f64; 2]) -> Self {
        Self {
            ahead,
            place_m,
            decoder: Decoder::default(),
        }
    }

    fn beams(&self, message: &[u8]) -> Option<Vec<Beam>> {
        // The two numbers of each measured value: right and ahead, or bearing and range.
        let beams: Vec<Beam> = match Message::decode(message).ok()? {
            Message::DepthRow(row) if row.focal_tenths > 0 => {
                let focal = f64::from(row.focal_tenths) / 10.0;
                let middle = (row.depths_mm().len() as f64 - 1.0) / 2.0;
                let columns = row.depths_mm().enumerate().filter(|(_, mm)| *mm > 0);
                let beam = |(column, mm): (usize, u16)| {
                    let depth_m = f64::from(mm) / 1e3;
                    let right_m = (column as f64 - middle) * depth_m / focal;
                    Beam {
                        bearing: self.ahead + libm::atan2(-right_m, depth_m),
                        distance_m: libm::hypot(depth_m, right_m),
                    }
                };
                columns.map(beam).collect()
            }
            Message::Scan(scan) => {
                let [first, step] = [scan.first_urad, scan.step_urad].map(f64::from);
                let ranges = scan.ranges_mm().enumerate().filter(|(_, mm)| *mm > 0);
                let beam = |(index, mm): (usize, u16)| Beam {
                    bearing: self.ahead + (first + step * index as f64) / 1e6,
                    distance_m: f64::from(mm) / 1e3,
                };
                ranges.map(beam).collect()
            }
            _ => return None,
        };
        let seen = beams.into_iter().map(|beam| beam.seen_from(self.place_m));
        Some(seen.collect())
    }
}

impl ScanDecoder for CameraScans {
    fn push(&mut self, bytes: &[u8]) -> Option<Vec<Beam>> {
        let told: Vec<_> = self.decoder.push(bytes).flatten().collect();
        let mut scans = told.iter().map(|told| self.beams(Perception::bytes(told)));
        scans.rfind(Option::is_some).flatten()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::perception::{DepthRow, Scan};

    /// Three columns of a camera with a focal length of 10 pixels, 0.3 m ahead. The middle column
    /// sees a depth of 1 m. The right column sees a depth of 2 m, which is 0.2 m to the right. The
    /// scan has a range of 500 mm to the left.
    #[test]
    fn depths_and_ranges_become_beams_from_the_middle_of_the_robot() {
        let mut scans = CameraScans::new(0.0, [0.3, 0.0]);
        let mut message = [0; 64];
        let len = DepthRow::encode(100, &[0, 1_000, 2_000], &mut message);
        let beams = scans.push(&message[..len]).expect("a picture");
        let [ahead, right] = beams[..] else {
            panic!("{beams:?}")
        };
        assert!((ahead.distance_m - 1.3).abs() < 1e-9 && ahead.bearing.abs() < 1e-9);
        let place = [
            right.distance_m * libm::cos(right.bearing),
            right.distance_m * libm::sin(right.bearing),
        ];
        assert!(
            (place[0] - 2.3).abs() < 1e-9 && (place[1] + 0.2).abs() < 1e-9,
            "{place:?}"
        );
        let len = Scan::encode(1_500_000, 1_000, &[500], &mut message);
        let mut scans = CameraScans::new(0.0, [0.0; 2]);
        let beams = scans.push(&message[..len]).expect("a scan");
        assert!((beams[0].bearing - 1.5).abs() < 1e-9);
        assert!((beams[0].distance_m - 0.5).abs() < 1e-9);
    }
}
