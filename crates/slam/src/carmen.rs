//! CARMEN logs: one message per line, `name fields.. time host time`.
//!
//! `FLASER n r1..rn x y theta odom_x odom_y odom_theta` has no angles: it covers a half circle from
//! right to left, unless `PARAM laser_front_laser_resolution` defines another resolution.
//! `ROBOTLASER1` contains its angles.
//!
//! A log that was corrected by a mapper contains the mapper's poses instead of the odometry.
//! Between two scans the poses differ by odometry only, so the odometry is recovered from there.
//! The jump at each scan is the mapper's correction and is left out.

mod fields;
mod wheels;

use emulators::world::Pose;

use super::finding::{Findings, Kind};
use super::motion::between;
use super::stamps::LogClock;
use super::{FARTHEST_M, Log, Shot, end_points};
use fields::{Fields, Refusal, refusal};
use wheels::{Chain, PoseKind};

/// Maximum distance of a laser from the origin of the robot, metres.
const LASER_FAR_M: f64 = 3.0;

/// The reason why a log cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct CarmenError(String);

/// Reads a log. Unusable messages are skipped and counted; an error is returned only if no scan is
/// left.
pub fn read(bytes: &[u8]) -> Result<Log, CarmenError> {
    let mut reader = Reader::default();
    let is_whole = bytes.is_empty() || bytes.ends_with(b"\n");
    let lines = bytes.split(|byte| *byte == b'\n').count();
    for (number, line) in (1..).zip(bytes.split(|byte| *byte == b'\n')) {
        let is_cut = number == lines && !is_whole;
        if let Err(what) = reader.line(number, &String::from_utf8_lossy(line)) {
            let kind = if is_cut { Kind::Cut } else { what.kind };
            let place = format_args!("line {number}");
            reader
                .findings
                .add(kind, place, format_args!("{}", what.words));
        }
    }
    reader.log()
}

/// A scan in the log.
struct Laser {
    line: usize,
    ranges: Vec<f64>,
    first: f64,
    step: f64,
    farthest_m: f64,
    /// The poses of laser and robot in the log's frame.
    laser: Pose,
    robot: Pose,
    stamp: f64,
}

enum Message {
    Odometry { pose: Pose, stamp: f64 },
    Laser(Laser),
}

/// The `PARAM` lines about the front laser.
#[derive(Default)]
struct Params {
    resolution_deg: Option<f64>,
    offset_m: f64,
}

#[derive(Default)]
struct Reader {
    params: Params,
    messages: Vec<Message>,
    findings: Findings,
    ignored: u64,
    /// Whether the log states that a mapper wrote its poses.
    is_corrected: bool,
}

impl Reader {
    fn line(&mut self, number: usize, line: &str) -> Result<(), Refusal> {
        let mut fields = Fields::of(line);
        match fields.next() {
            None => {}
            Some(name) if name.starts_with('#') => {}
            Some("PARAM") => self.param(&mut fields),
            Some("ODOM") => {
                let pose = fields.pose("x y theta")?;
                fields.skip(3);
                let stamp = fields.number("time")?;
                self.messages.push(Message::Odometry { pose, stamp });
            }
            Some("FLASER") => {
                let laser = self.front(number, &mut fields)?;
                self.messages.push(Message::Laser(laser));
            }
            Some("ROBOTLASER1") => {
                let laser = robot_laser(number, &mut fields)?;
                self.messages.push(Message::Laser(laser));
            }
            // The effective number of particles of a mapper.
            Some("NEFF") => {
                self.is_corrected = true;
                self.ignored += 1;
            }
            Some(name)
                if name
                    .chars()
                    .all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_') =>
            {
                self.ignored += 1;
            }
            Some(name) => {
                let shown: String = name.chars().take(20).collect();
                let words = format!("\"{}\" is no name of a message", shown.escape_debug());
                return Err(refusal(Kind::Unreadable, words));
            }
        }
        Ok(())
    }

    fn param(&mut self, fields: &mut Fields<'_>) {
        let (Some(name), Some(value)) = (fields.next(), fields.next()) else {
            return;
        };
        let Some(value) = value.parse::<f64>().ok().filter(|value| value.is_finite()) else {
            return;
        };
        match name {
            "laser_front_laser_resolution" if value > 0.0 => {
                self.params.resolution_deg = Some(value);
            }
            // `robot_front_laser_max` is the maximum range for navigation, not of the laser: in
            // some logs a third of the readings is beyond it.
            "robot_frontlaser_offset" if value.abs() < LASER_FAR_M => self.params.offset_m = value,
            _ => {}
        }
    }

    fn front(&self, line: usize, fields: &mut Fields<'_>) -> Result<Laser, Refusal> {
        let ranges = fields.ranges()?;
        let laser = fields.pose("x y theta")?;
        let robot = fields.pose("odom_x odom_y odom_theta")?;
        let stamp = fields.number("time")?;
        let count = ranges.len().max(2) as f64;
        let spread = if ranges.len() % 2 == 1 {
            count - 1.0
        } else {
            count
        };
        let half = 180.0 / spread;
        let step = self.params.resolution_deg.unwrap_or(half);
        // A scan that does not cover a half circle is centred straight ahead.
        let first = if (step / half - 1.0).abs() < 0.05 {
            -90.0
        } else {
            -step * (count - 1.0) / 2.0
        };
        Ok(Laser {
            line,
            ranges,
            first: first.to_radians(),
            step: step.to_radians(),
            farthest_m: FARTHEST_M,
            laser,
            robot,
            stamp,
        })
    }

    fn log(mut self) -> Result<Log, CarmenError> {
        let lasers = self
            .messages
            .iter()
            .filter(|m| matches!(m, Message::Laser(_)));
        let all = lasers.count();
        let kind = if self.is_corrected {
            PoseKind::Corrected
        } else {
            PoseKind::of(&self.messages)
        };
        let mut notes = vec![kind.words().to_owned()];
        if self.ignored > 0 {
            notes.push(format!(
                "{} messages of other kinds were skipped",
                self.ignored
            ));
        }
        let by_number = stamps_are_useless(&self.messages);
        if by_number {
            notes.push("many scans have the same time: scan numbers replace the times".to_owned());
        }
        let mut chain = Chain::new(kind);
        let mut clock = LogClock::default();
        let mut shots = Vec::new();
        let messages = core::mem::take(&mut self.messages);
        let mut number = 0;
        for message in messages {
            match message {
                Message::Odometry { pose, .. } => chain.odometry(pose),
                Message::Laser(laser) => {
                    chain.scan(&laser);
                    let at_s = if by_number {
                        f64::from(number)
                    } else {
                        laser.stamp
                    };
                    number += 1;
                    let accepted = clock.accepts(at_s);
                    let place = laser.line;
                    if !accepted {
                        let place = format_args!("line {place}");
                        let what = format_args!("a scan of {at_s} s, earlier than the one before");
                        self.findings.add(Kind::Backwards, place, what);
                        continue;
                    }
                    let (points, absurd) = points_of(&laser, &self.params);
                    self.findings.absurd_readings += u64::from(absurd);
                    if points.is_empty() {
                        let what =
                            format_args!("none of {} beams has a distance", laser.ranges.len());
                        self.findings
                            .add(Kind::Blind, format_args!("line {place}"), what);
                        continue;
                    }
                    let (moved, has_measured) = chain.take();
                    shots.push(Shot {
                        at_s,
                        moved,
                        is_measured: has_measured || shots.is_empty(),
                        points,
                    });
                }
            }
        }
        if shots.is_empty() {
            let first = self
                .findings
                .told()
                .first()
                .map_or(String::new(), |s| format!("; {s}"));
            let what = if all == 0 {
                "no FLASER or ROBOTLASER1 line in it, expected a CARMEN log"
            } else {
                "none of its scans can be used"
            };
            return Err(CarmenError(format!("{what}{first}")));
        }
        Ok(Log {
            start: Pose::default(),
            shots,
            findings: self.findings,
            notes,
        })
    }
}

fn points_of(laser: &Laser, params: &Params) -> (Vec<firmware_core::pose::Point>, u32) {
    // If the two poses are not in the same frame, only `PARAM` defines the position of the laser.
    // If they are equal, both are those of the laser, as in corrected logs.
    let apart = between(laser.robot, laser.laser);
    let is_near = libm::hypot(apart.x, apart.y) < LASER_FAR_M;
    let seat = if is_near {
        apart
    } else {
        Pose::new(params.offset_m, 0.0, 0.0)
    };
    let bearing = |index: usize| laser.first + index as f64 * laser.step;
    end_points(
        laser.ranges.iter().copied(),
        bearing,
        |_| seat,
        laser.farthest_m,
    )
}

fn robot_laser(line: usize, fields: &mut Fields<'_>) -> Result<Laser, Refusal> {
    fields.skip(1);
    let first = fields.number("start_angle")?;
    fields.skip(1);
    let step = fields.number("angular_resolution")?;
    let farthest_m = fields.number("maximum_range")?;
    fields.skip(2);
    if first.abs() > 7.0 || step.abs() > 1.6 || step == 0.0 {
        let words = format!("start_angle {first}, angular_resolution {step}, expected radians");
        return Err(refusal(Kind::Absurd, words));
    }
    let ranges = fields.ranges()?;
    let remissions = fields.count("remissions")?;
    fields.skip(remissions);
    let laser = fields.pose("laser_pose")?;
    let robot = fields.pose("robot_pose")?;
    fields.skip(5);
    let stamp = fields.number("time")?;
    let farthest_m = if farthest_m > 0.0 {
        farthest_m
    } else {
        FARTHEST_M
    };
    Ok(Laser {
        line,
        ranges,
        first,
        step,
        farthest_m,
        laser,
        robot,
        stamp,
    })
}

/// Epoch times with six digits give many scans the same time.
fn stamps_are_useless(messages: &[Message]) -> bool {
    let mut stamps: Vec<u64> = messages
        .iter()
        .filter_map(|message| match message {
            Message::Laser(laser) => Some(laser.stamp.to_bits()),
            Message::Odometry { .. } => None,
        })
        .collect();
    let all = stamps.len();
    stamps.sort_unstable();
    stamps.dedup();
    stamps.len() * 10 < all * 9
}
