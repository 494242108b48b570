//! A CARMEN log: odometry and lidar turns, one message a line.
//!
//! `ROBOTLASER1` contains its angles and takes the whole turn. `FLASER` does not contain them:
//! readers take the step from a `PARAM` line or assume a half circle. For `FLASER`, the front 181
//! rays are written, from right to left. The poses are the believed poses of the program.

use core::fmt::Write as _;

use super::scans::{READINGS, Scan, scans};
use super::{Export, ExportError};

/// Layout of lidar turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Laser {
    /// The whole turn
    #[default]
    Robotlaser1,
    /// The front half, which every reader takes
    Flaser,
}

/// Maximum range in the log, beyond the lidar's range; a reading of this value means no reading.
const RANGE_MAX_M: f64 = 8.0;
/// Rays of the half circle, both ends included.
const FRONT: usize = 181;

pub(super) fn write(export: &Export<'_>) -> Result<(Vec<u8>, String), ExportError> {
    let scans = scans(export.recorded);
    if scans.is_empty() {
        return Err(ExportError::Nothing("no link carries a lidar's turns"));
    }
    let mut out = format!(
        "# poses are the program's belief; times begin with the capture\n\
         PARAM laser_front_laser_resolution 1.0 0 hilrig 0\n\
         PARAM robot_front_laser_max {RANGE_MAX_M:.1} 0 hilrig 0\n"
    );
    for scan in &scans {
        let pose = export.belief.and_then(|belief| belief.pose_at(scan.at));
        let pose = pose.unwrap_or_default();
        let place = format!("{:.6} {:.6} {:.6}", pose.x, pose.y, pose.theta);
        let stamp = format!("{0} hilrig {0}\n", scan.at);
        write!(out, "ODOM {place} 0 0 0 {stamp}").expect("a string takes everything");
        out += &match export.laser {
            Laser::Robotlaser1 => robot_laser(scan, &place),
            Laser::Flaser => front(scan, &place),
        };
        out += &stamp;
    }
    let words = match export.belief {
        Some(_) => format!("{} turns", scans.len()),
        None => format!("{} turns, without poses", scans.len()),
    };
    Ok((out.into_bytes(), words))
}

fn range(reading: Option<f64>) -> f64 {
    reading.unwrap_or(RANGE_MAX_M)
}

fn robot_laser(scan: &Scan, place: &str) -> String {
    let step = 1_f64.to_radians();
    let field = step * (READINGS - 1) as f64;
    let start = scan.start;
    let mut line = format!(
        "ROBOTLASER1 0 {start:.8} {field:.8} {step:.10} {RANGE_MAX_M:.1} 0.01 0 {READINGS}"
    );
    for &reading in &scan.ranges {
        write!(line, " {:.3}", range(reading)).expect("a string takes everything");
    }
    line += &format!(" 0 {place} {place} 0 0 0 0 0 ");
    line
}

fn front(scan: &Scan, place: &str) -> String {
    let mut line = format!("FLASER {FRONT}");
    for degree in 0..FRONT {
        let bearing = degree as f64 - 90.0;
        let index = (bearing - scan.start.to_degrees()).round();
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a whole number of one turn"
        )]
        #[expect(clippy::cast_sign_loss, reason = "not negative")]
        let index = index.rem_euclid(READINGS as f64) as usize;
        write!(line, " {:.3}", range(scan.ranges[index])).expect("a string takes everything");
    }
    line += &format!(" {place} {place} ");
    line
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::*;

    /// Reading k is k centimetres; the first ray points `start_deg` degrees from ahead.
    fn scan(start_deg: f64) -> Scan {
        Scan {
            link: "lidar".to_owned(),
            at: Instant::from_secs(1),
            start: start_deg.to_radians(),
            ranges: (0..READINGS).map(|k| Some(k as f64 / 100.0)).collect(),
            strengths: vec![0.0; READINGS],
        }
    }

    fn words(line: &str) -> Vec<&str> {
        line.split(' ').collect()
    }

    /// The front runs from the right, -90 degrees, to the left, +90. It starts 90 readings after a
    /// first reading at the back, and 270 after one ahead. The pose follows the readings, twice.
    #[test]
    fn the_front_goes_from_right_to_left() {
        let front_of = |start_deg| front(&scan(start_deg), "1 2 3");
        let line = front_of(-180.0);
        let of = words(&line);
        assert_eq!(of[..4], ["FLASER", "181", "0.900", "0.910"]);
        assert_eq!(of[182..], ["2.700", "1", "2", "3", "1", "2", "3", ""]);
        let line = front_of(0.0);
        let of = words(&line);
        assert_eq!(of[2..4], ["2.700", "2.710"]);
        assert_eq!((of[91], of[92], of[182]), ("3.590", "0.000", "0.900"));
        // A first reading to the left, +90, is 180 degrees after the right.
        let line = front_of(90.0);
        let of = words(&line);
        assert_eq!((of[2], of[92], of[182]), ("1.800", "2.700", "0.000"));
    }

    /// Start -pi, 359 steps of a degree, the maximum range, and all readings from the first one on;
    /// 8 m for missing readings.
    #[test]
    fn the_whole_turn_says_its_angles() {
        let mut turn = scan(-180.0);
        turn.ranges[1] = None;
        let line = robot_laser(&turn, "1 2 3");
        let of = words(&line);
        let head = [
            "ROBOTLASER1",
            "0",
            "-3.14159265",
            "6.26573201",
            "0.0174532925",
        ];
        assert_eq!(of[..5], head);
        assert_eq!(
            of[5..12],
            ["8.0", "0.01", "0", "360", "0.000", "8.000", "0.020"]
        );
        assert_eq!(of[368..370], ["3.590", "0"]);
        assert_eq!(of[370..376], ["1", "2", "3", "1", "2", "3"]);
    }
}
