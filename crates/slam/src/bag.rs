//! Recordings of messages: MCAP files and rosbag2 in SQLite, and folders of either. Our own MCAP
//! files contain every byte of a robot's links; others contain laser scans and poses, as JSON with
//! Foxglove's schemas or as CDR of ROS 2.

mod cdr;
pub mod db3;
pub mod folder;
mod json;
#[cfg(feature = "mcap")]
pub mod mcap;
mod sqlite;
pub mod unpack;

use std::borrow::Cow;
use std::collections::BTreeMap;

use emulators::world::Pose;
use protocols::Instant;

use super::finding::{Findings, Kind};
use super::messages::{Beams, Said, log};
use super::{BEAMS_MAX, Log};
#[cfg(feature = "mcap")]
use capture::replay::Arrival;
use capture::replay::Recorded;

/// The reason why a recording cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct BagError(String);

/// The content of a recording.
#[derive(Debug, Default)]
pub struct Contents {
    /// The bytes of links that reached the master, with the times in the file.
    pub recorded: Recorded,
    /// The scenario of the recording.
    pub scenario: Option<String>,
    /// Messages and parts that were skipped.
    pub findings: Findings,
    scans: BTreeMap<String, Vec<Said<Beams>>>,
    poses: BTreeMap<(Trust, String), Vec<Said<Pose>>>,
}

/// Kinds of poses, from measured motion to an estimate; the first one available is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Trust {
    /// Wheel odometry.
    Odometry,
    /// The believed pose of a program.
    Belief,
}

/// The interpretation of a topic.
#[derive(Clone, Copy, Debug)]
enum Meaning {
    /// Bytes of the link with this index.
    #[cfg(feature = "mcap")]
    Bytes(usize),
    JsonScan,
    JsonPose,
    CdrScan,
    CdrOdometry,
    CdrPose,
}

impl Meaning {
    /// The interpretation of messages with this encoding and schema.
    fn of(encoding: &str, schema: &str) -> Option<Self> {
        Some(match (encoding, schema) {
            ("json", "foxglove.LaserScan") => Self::JsonScan,
            ("json", "foxglove.PoseInFrame") => Self::JsonPose,
            ("cdr", "sensor_msgs/msg/LaserScan") => Self::CdrScan,
            ("cdr", "nav_msgs/msg/Odometry") => Self::CdrOdometry,
            ("cdr", "geometry_msgs/msg/PoseStamped") => Self::CdrPose,
            _ => return None,
        })
    }

    const fn is_cdr(self) -> bool {
        matches!(self, Self::CdrScan | Self::CdrOdometry | Self::CdrPose)
    }
}

impl Contents {
    /// Whether the recording contains bytes of links of a known robot.
    pub fn has_bytes(&self) -> bool {
        self.recorded
            .links
            .iter()
            .any(|link| !link.arrivals.is_empty())
    }

    /// Converts the messages to a log, with the laser that has the most messages and the most
    /// reliable poses.
    ///
    /// # Errors
    /// If no scan is left.
    pub fn log(mut self) -> Result<Log, BagError> {
        let most = self.scans.iter().max_by_key(|(_, scans)| scans.len());
        let Some(topic) = most.map(|(topic, _)| topic.clone()) else {
            return Err(self.nothing("contains no laser scan"));
        };
        let scans = self.scans.remove(&topic).unwrap_or_default();
        let (source, poses) = self.poses.pop_first().unzip();
        let told = self.findings.told().first().cloned();
        let mut log = log(scans, &poses.unwrap_or_default(), self.findings);
        log.notes.push(match source {
            Some((Trust::Odometry, name)) => format!("scans of {topic}, odometry of {name}"),
            Some((Trust::Belief, name)) => {
                format!("scans of {topic}; no wheels: the estimated poses of {name} replace them")
            }
            None => format!("scans of {topic}, no odometry"),
        });
        if log.shots.is_empty() {
            let told = told.or_else(|| log.findings.told().first().cloned());
            let told = told.map_or(String::new(), |told| format!("; {told}"));
            return Err(BagError(format!("none of its scans can be used{told}")));
        }
        Ok(log)
    }

    fn nothing(&self, what: &str) -> BagError {
        let told = self.findings.told().first();
        let told = told.map_or(String::new(), |told| format!("; {told}"));
        BagError(format!(
            "{what}, expected foxglove.LaserScan in JSON, sensor_msgs/msg/LaserScan in CDR, or \
             the bytes that hilrig export writes{told}"
        ))
    }

    /// Sorts by time: messages of a recording may be in any order.
    pub fn sort(&mut self) {
        let scans = self.scans.values_mut();
        scans.for_each(|scans| scans.sort_by_key(|said| said.logged));
        for link in &mut self.recorded.links {
            link.arrivals.sort_by_key(|arrival| arrival.at);
        }
    }
}

impl Contents {
    /// Adds a message, or records why it was skipped.
    fn message(&mut self, topic: &str, meaning: Meaning, logged: Instant, data: &[u8]) {
        if let Err(refusal) = self.understood(topic, meaning, logged, data) {
            let place = format_args!("{topic} at {logged} s");
            self.findings
                .add(refusal.0, place, format_args!("{}", refusal.1));
        }
    }

    fn understood(
        &mut self,
        topic: &str,
        meaning: Meaning,
        logged: Instant,
        data: &[u8],
    ) -> Result<(), Refusal> {
        // A recorder may compress single messages: CDR never begins like that.
        let data = if meaning.is_cdr() && data.starts_with(unpack::ZSTD) {
            let unpacked = unpack::zstd(data, unpack::BYTES_MAX).whole();
            Cow::Owned(unpacked.map_err(|what| (Kind::Unreadable, what))?)
        } else {
            Cow::Borrowed(data)
        };
        let data = &*data;
        let mut belief = |trust, heard: Heard<Pose>| {
            let poses = self.poses.entry((trust, topic.to_owned())).or_default();
            poses.push(heard.at(logged));
        };
        match meaning {
            #[cfg(feature = "mcap")]
            Meaning::Bytes(link) => {
                let bytes = data.to_vec();
                let arrivals = &mut self.recorded.links[link].arrivals;
                arrivals.push(Arrival { at: logged, bytes });
                self.recorded.end = self.recorded.end.max(logged);
            }
            Meaning::JsonScan | Meaning::CdrScan => {
                let scan = match meaning {
                    Meaning::JsonScan => json::scan(data),
                    _ => cdr::scan(data),
                };
                let scan = scan?.at(logged);
                self.scans.entry(topic.to_owned()).or_default().push(scan);
            }
            Meaning::JsonPose => {
                let (frame, pose) = json::pose_in_frame(data)?;
                let trust = match frame.as_str() {
                    "odom" => Trust::Odometry,
                    _ => Trust::Belief,
                };
                belief(trust, pose);
            }
            Meaning::CdrOdometry => belief(Trust::Odometry, cdr::odometry(data)?),
            Meaning::CdrPose => belief(Trust::Belief, cdr::pose_stamped(data)?),
        }
        Ok(())
    }
}

/// The reason why a message is skipped.
type Refusal = (Kind, String);

/// A decoded message, with its own time if it has one.
struct Heard<T> {
    at_s: f64,
    what: T,
}

impl<T> Heard<T> {
    fn at(self, logged: Instant) -> Said<T> {
        let by_log = logged.as_nanos() as f64 / 1e9;
        Said {
            at_s: if self.at_s > 0.0 { self.at_s } else { by_log },
            logged,
            what: self.what,
        }
    }
}

/// Maximum distance from the origin that is plausible, metres.
const FAR_M: f64 = 1e5;

/// A planar pose from a position and a quaternion.
fn pose([x, y]: [f64; 2], [qx, qy, qz, qw]: [f64; 4]) -> Result<Pose, Refusal> {
    let theta = libm::atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz));
    if [x, y].iter().all(|part| part.abs() < FAR_M) && theta.is_finite() {
        Ok(Pose::new(x, y, theta))
    } else {
        let words = format!("pose {x} {y} {theta}: expected less than {FAR_M} m");
        Err((Kind::Absurd, words))
    }
}

/// Accepts beams with plausible numbers.
fn checked(beams: Beams) -> Result<Beams, Refusal> {
    let (first, step, beam_s) = (beams.first, beams.step, beams.beam_s);
    let (count, turn) = (beams.ranges.len(), step * beams.ranges.len() as f64);
    // NaN fails both comparisons.
    let is_sound = first.abs() < 7.0 && turn.abs() < 7.0 && (0.0..0.1).contains(&beam_s);
    if !is_sound || count > BEAMS_MAX {
        let words = format!(
            "{count} beams from {first} rad by {step} rad and {beam_s} s: expected a turn at most"
        );
        return Err((Kind::Absurd, words));
    }
    Ok(beams)
}
