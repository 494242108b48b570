//! The camera's last scan: depths by columns, or ranges by bearings.

use alloc::vec::Vec;

use protocols::perception::{DepthRow, Scan};

use crate::particles::Beam;
use crate::pose::Point;

/// Ranges that the camera can measure, metres: defaults of the fielded conversion.
const RANGE_M: [f64; 2] = [0.45, 10.0];
/// Number of adjacent columns without a depth that are no gap: there is no object in range.
const NOTHING_COLUMNS: usize = 12;
/// Maximum share of gaps among the columns with an object. With more gaps the camera counts as
/// blind, and unseen space may hold obstacles.
const GAPS_MAX: f64 = 0.1;

/// The direction of a column or bearing.
#[derive(Clone, Copy, Debug, Default)]
struct Direction {
    bearing_rad: f64,
    /// Ahead and to the left of a point one unit away; in a row, one unit of depth.
    ahead: f64,
    left: f64,
    /// Range of that point, metres.
    range: f64,
}

/// Parameters that define the directions: focal length and columns, or first bearing, step and
/// number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Lens {
    #[default]
    None,
    Row(u16, usize),
    Scan(i32, i32, usize),
}

/// The last row or scan.
#[derive(Clone, Debug, Default)]
pub(super) struct Sight {
    lens: Lens,
    directions: Vec<Direction>,
    /// Millimetres; 0 is no reading.
    values_mm: Vec<u16>,
}

impl Sight {
    pub(super) fn take_row(&mut self, row: &DepthRow<'_>) {
        self.values_mm.clear();
        self.values_mm.extend(row.depths_mm());
        let focal = f64::from(row.focal_tenths) / 10.0;
        if focal <= 0.0 {
            self.values_mm.clear();
        }
        let count = self.values_mm.len();
        let middle = (count as f64 - 1.0) / 2.0;
        self.fit(Lens::Row(row.focal_tenths, count), |column| {
            let left = (middle - column) / focal;
            Direction {
                bearing_rad: libm::atan(left),
                ahead: 1.0,
                left,
                range: libm::sqrt(1.0 + left * left),
            }
        });
    }

    pub(super) fn take_scan(&mut self, scan: &Scan<'_>) {
        self.values_mm.clear();
        self.values_mm.extend(scan.ranges_mm());
        let (first, step) = (scan.first_urad, scan.step_urad);
        let lens = Lens::Scan(first, step, self.values_mm.len());
        self.fit(lens, |index| {
            let bearing_rad = (f64::from(first) + f64::from(step) * index) / 1e6;
            let (left, ahead) = libm::sincos(bearing_rad);
            Direction {
                bearing_rad,
                ahead,
                left,
                range: 1.0,
            }
        });
    }

    /// Computes the directions of `lens`, unless they are already those of the last one.
    fn fit(&mut self, lens: Lens, direction: impl Fn(f64) -> Direction) {
        if self.lens != lens {
            self.lens = lens;
            let all = 0..self.values_mm.len();
            self.directions = all.map(|index| direction(index as f64)).collect();
        }
    }

    /// All readings in range, each with its direction, metres.
    fn readings(&self) -> impl Iterator<Item = (&Direction, f64)> {
        let all = self.directions.iter().zip(&self.values_mm);
        let read = all.filter(|(_, mm)| **mm > 0);
        let metres = read.map(|(direction, mm)| (direction, f64::from(*mm) / 1e3));
        metres.filter(|(direction, metres)| {
            (RANGE_M[0]..=RANGE_M[1]).contains(&(metres * direction.range))
        })
    }

    /// Whether the camera measured anything.
    pub(super) fn has_reading(&self) -> bool {
        self.readings().next().is_some()
    }

    /// Positions of all readings in range, for a camera `camera_ahead_m` ahead on the car.
    pub(super) fn put_points(&self, camera_ahead_m: f64, points: &mut Vec<Point>) {
        points.clear();
        points.extend(self.readings().map(|(direction, metres)| {
            let along = [
                camera_ahead_m + metres * direction.ahead,
                metres * direction.left,
            ];
            #[expect(clippy::cast_possible_truncation, reason = "an observer needs 24 bits")]
            let [x_mm, y_mm] = along.map(|m| (m * 1_000.0) as f32);
            Point::new(x_mm, y_mm)
        }));
    }

    /// All readings in range as beams; directions without an object become beams of infinite range,
    /// if the floor `is_open`.
    pub(super) fn beams(&self, is_open: bool) -> Vec<Beam> {
        let beam = |(direction, metres): (&Direction, f64)| Beam {
            bearing_rad: direction.bearing_rad,
            range_m: metres * direction.range,
        };
        let mut beams: Vec<Beam> = self.readings().map(beam).collect();
        if is_open {
            beams.extend(self.nothing());
        }
        beams
    }

    /// Beams for pieces of the row that have no depth at all.
    fn nothing(&self) -> Vec<Beam> {
        let (mut beams, mut gaps, mut at) = (Vec::new(), 0, 0);
        for run in self
            .values_mm
            .chunk_by(|one, next| (*one == 0) == (*next == 0))
        {
            let is_empty = run.first() == Some(&0);
            if is_empty && run.len() >= NOTHING_COLUMNS {
                let directions = self.directions.iter().skip(at).take(run.len());
                beams.extend(directions.map(|direction| Beam {
                    bearing_rad: direction.bearing_rad,
                    range_m: f64::INFINITY,
                }));
            } else if is_empty {
                gaps += run.len();
            }
            at += run.len();
        }
        // A row without any depth may also come from a covered lens.
        let seen = self.values_mm.len() - beams.len();
        match gaps as f64 > GAPS_MAX * seen as f64 || seen == 0 {
            true => Vec::new(),
            false => beams,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocols::perception::{MESSAGE_MAX, Message};

    /// A row of 5 columns at a focal length of 2 pixels, with the given `depths_mm`.
    fn sight(focal_tenths: u16, depths_mm: &[u16]) -> Sight {
        let mut bytes = [0; MESSAGE_MAX];
        let len = DepthRow::encode(focal_tenths, depths_mm, &mut bytes);
        let Ok(Message::DepthRow(row)) = Message::decode(&bytes[..len]) else {
            panic!("no row");
        };
        let mut sight = Sight::default();
        sight.take_row(&row);
        sight
    }

    /// Columns -2 to 2 over 2 pixels: 1 unit to the left at the first column, so a depth of 1 m is
    /// 1.414 m away at 45 degrees. 300 mm is too near, 0 is no reading.
    #[test]
    fn a_depth_is_ahead_and_a_range_is_along_its_column() {
        let sight = sight(20, &[1_000, 0, 2_000, 300, 1_000]);
        let beams = sight.beams(true);
        let told: Vec<[f64; 2]> = beams
            .iter()
            .map(|it| [it.bearing_rad, it.range_m])
            .collect();
        let eighth = core::f64::consts::FRAC_PI_4;
        let root = core::f64::consts::SQRT_2;
        let expected = [[eighth, root], [0.0, 2.0], [-eighth, root]];
        assert_eq!(told.len(), 3);
        for (told, expected) in told.iter().zip(expected) {
            assert!((told[0] - expected[0]).abs() < 1e-12 && (told[1] - expected[1]).abs() < 1e-12);
        }
        let mut points = Vec::new();
        sight.put_points(0.3, &mut points);
        assert_eq!(points[0], Point::new(1_300.0, 1_000.0));
    }

    /// Twelve adjacent columns without a depth are open, eleven are gaps. A camera that is blind,
    /// completely or in parts, shows no open floor.
    #[test]
    fn a_wide_piece_without_depths_is_open() {
        let open = |depths: &[u16]| {
            let beams = sight(5_000, depths).beams(true);
            beams.iter().filter(|it| it.range_m.is_infinite()).count()
        };
        let mut row = [2_000_u16; 400];
        row[100..111].fill(0);
        assert_eq!(open(&row), 0);
        row[100..112].fill(0);
        assert_eq!(open(&row), 12);
        let shut = sight(5_000, &row).beams(false);
        assert!(shut.iter().all(|it| it.range_m.is_finite()));
        // 41 single gaps of 388 columns are more than a tenth.
        (0..41).for_each(|at| row[120 + 2 * at] = 0);
        assert_eq!(open(&row), 0);
        assert_eq!(open(&[0; 400]), 0);
    }
}
