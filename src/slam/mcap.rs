//! MCAP files: ours, which hold every byte of a robot's links, and others' with laser scans and
//! poses as messages, JSON by Foxglove's schemas or CDR by ROS 2's.

mod cdr;
mod json;

use core::panic::AssertUnwindSafe;
use std::collections::BTreeMap;
use std::panic::catch_unwind;

use ::mcap::records::Record;
use ::mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use ::mcap::{McapError as FileError, parse_record};
use emulators::world::Pose;
use protocols::Instant;

use super::finding::{Findings, Kind};
use super::messages::{Beams, Said, log};
use super::{BEAMS_MAX, Log};
use crate::capture::replay::{Arrival, Passage, Recorded};
use crate::rig::line::Direction;

/// A file that cannot be used at all.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct McapError(String);

/// What a file holds.
#[derive(Debug, Default)]
pub struct Contents {
    /// The bytes of links, as far as they reached the master; times are the file's own.
    pub recorded: Recorded,
    /// The scenario that they are of.
    pub scenario: Option<String>,
    /// What cannot be used.
    pub findings: Findings,
    scans: BTreeMap<String, Vec<Said<Beams>>>,
    poses: BTreeMap<(Trust, String), Vec<Said<Pose>>>,
}

/// How far poses are somebody's measurement of motion; the least is taken first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Trust {
    /// The wheels'.
    Odometry,
    /// Some program's belief.
    Belief,
}

/// What is understood of a channel.
enum Channel {
    Bytes(usize),
    JsonScan,
    JsonPose,
    CdrScan,
    CdrOdometry,
    CdrPose,
    /// Nothing.
    Other,
}

/// Reads a file, up to where it is damaged.
pub fn read(bytes: &[u8]) -> Contents {
    let mut reader = Reader::default();
    // The library computes with lengths that a damaged file names, and may run over.
    if catch_unwind(AssertUnwindSafe(|| read_into(&mut reader, bytes))).is_err() {
        let what = format_args!("lengths that make no sense");
        let place = format_args!("the rest");
        reader.contents.findings.add(Kind::Unreadable, place, what);
    }
    reader.contents.in_order()
}

fn read_into(reader: &mut Reader, bytes: &[u8]) {
    let mut rest = bytes;
    let options = LinearReaderOptions::default().with_record_length_limit(bytes.len());
    let mut records = LinearReader::new_with_options(options);
    while let Some(event) = records.next_event() {
        let taken = match event {
            Ok(LinearReadEvent::ReadRequest(wanted)) => {
                let (now, later) = rest.split_at(wanted.min(rest.len()));
                records.insert(wanted)[..now.len()].copy_from_slice(now);
                records.notify_read(now.len());
                rest = later;
                continue;
            }
            Ok(LinearReadEvent::Record { opcode, data }) => parse_record(opcode, data)
                .map_err(|error| (Kind::Unreadable, error))
                .map(|record| reader.take(record)),
            Err(error @ (FileError::UnexpectedEof | FileError::UnexpectedEoc)) => {
                Err((Kind::Cut, error))
            }
            Err(error) => Err((Kind::Unreadable, error)),
        };
        if let Err((kind, error)) = taken {
            let offset = bytes.len() - rest.len();
            let (place, what) = (format_args!("before byte {offset}"), words(&error));
            reader
                .contents
                .findings
                .add(kind, place, format_args!("{what}"));
            if !matches!(error, FileError::Parse(_)) {
                break;
            }
        }
    }
}

/// The error, and what helps.
fn words(error: &FileError) -> String {
    match error {
        FileError::UnsupportedCompression(name) => format!(
            "chunks are compressed by {name}, expected none: `mcap compress --compression none`"
        ),
        other => other.to_string(),
    }
}

impl Contents {
    /// Whether there are links whose bytes can be understood, if it is known whose they are.
    pub fn has_bytes(&self) -> bool {
        self.recorded
            .links
            .iter()
            .any(|link| !link.arrivals.is_empty())
    }

    /// The log of the messages: the laser that has most of them, and the most trustworthy poses.
    ///
    /// # Errors
    /// If no scan is left.
    pub fn log(mut self) -> Result<Log, McapError> {
        let most = self.scans.iter().max_by_key(|(_, scans)| scans.len());
        let Some(topic) = most.map(|(topic, _)| topic.clone()) else {
            return Err(self.nothing("no laser's scan in it"));
        };
        let scans = self.scans.remove(&topic).unwrap_or_default();
        let (source, poses) = self.poses.pop_first().unzip();
        let told = self.findings.told().first().cloned();
        let mut log = log(scans, &poses.unwrap_or_default(), self.findings);
        log.notes.push(match source {
            Some((Trust::Odometry, name)) => format!("scans of {topic}, odometry of {name}"),
            Some((Trust::Belief, name)) => {
                format!("scans of {topic}; somebody's belief, {name}, stands in for the wheels")
            }
            None => format!("scans of {topic}, nobody's odometry"),
        });
        if log.shots.is_empty() {
            let told = told.or_else(|| log.findings.told().first().cloned());
            let told = told.map_or(String::new(), |told| format!("; {told}"));
            return Err(McapError(format!("none of its scans can be used{told}")));
        }
        Ok(log)
    }

    fn nothing(&self, what: &str) -> McapError {
        let told = self.findings.told().first();
        let told = told.map_or(String::new(), |told| format!("; {told}"));
        McapError(format!(
            "{what}, expected foxglove.LaserScan in JSON, sensor_msgs/msg/LaserScan in CDR, or \
             the bytes that hilrig export writes{told}"
        ))
    }

    /// Messages of one file may come in any order of time.
    fn in_order(mut self) -> Self {
        let scans = self.scans.values_mut();
        scans.for_each(|scans| scans.sort_by_key(|said| said.logged));
        for link in &mut self.recorded.links {
            link.arrivals.sort_by_key(|arrival| arrival.at);
        }
        self
    }
}

/// What is known so far.
#[derive(Default)]
struct Reader {
    contents: Contents,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, (String, Channel)>,
}

impl Reader {
    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let kind = self.kind(&channel);
                self.channels.insert(channel.id, (channel.topic, kind));
            }
            Record::Message { header, data } => {
                let logged = Instant::from_nanos(header.log_time);
                self.message(header.channel_id, logged, &data);
            }
            Record::Attachment { header, data, .. } if header.name == "scenario.toml" => {
                self.contents.scenario = String::from_utf8(data.into_owned()).ok();
            }
            _ => {}
        }
    }

    fn kind(&mut self, channel: &::mcap::records::Channel) -> Channel {
        let schema = self.schemas.get(&channel.schema_id).map_or("", |name| name);
        match (&*channel.message_encoding, schema) {
            ("application/octet-stream", _) => {
                self.link(channel).map_or(Channel::Other, Channel::Bytes)
            }
            ("json", "foxglove.LaserScan") => Channel::JsonScan,
            ("json", "foxglove.PoseInFrame") => Channel::JsonPose,
            ("cdr", "sensor_msgs/msg/LaserScan") => Channel::CdrScan,
            ("cdr", "nav_msgs/msg/Odometry") => Channel::CdrOdometry,
            ("cdr", "geometry_msgs/msg/PoseStamped") => Channel::CdrPose,
            _ => Channel::Other,
        }
    }

    /// The link whose bytes towards the master a channel of ours has.
    fn link(&mut self, channel: &::mcap::records::Channel) -> Option<usize> {
        let (link, direction) = channel.topic.strip_prefix('/')?.rsplit_once('/')?;
        if direction != Direction::ToMaster.name() {
            return None;
        }
        let baud = channel.metadata.get("baud");
        let links = &mut self.contents.recorded.links;
        let known = links.iter().position(|one| one.link == link);
        Some(known.unwrap_or_else(|| {
            links.push(Passage {
                link: link.to_owned(),
                baud: baud.and_then(|baud| baud.parse().ok()).unwrap_or(0),
                ..Passage::default()
            });
            links.len() - 1
        }))
    }

    fn message(&mut self, channel: u16, logged: Instant, data: &[u8]) {
        let Some((topic, kind)) = self.channels.get(&channel) else {
            return;
        };
        let contents = &mut self.contents;
        let mut belief = |trust, what: Result<Heard<Pose>, Refusal>| {
            let heard = what?.at(logged);
            let poses = contents.poses.entry((trust, topic.clone())).or_default();
            poses.push(heard);
            Ok(())
        };
        let done = match kind {
            Channel::Bytes(link) => {
                let links = &mut contents.recorded.links;
                let bytes = data.to_vec();
                links[*link].arrivals.push(Arrival { at: logged, bytes });
                contents.recorded.end = contents.recorded.end.max(logged);
                Ok(())
            }
            Channel::JsonScan | Channel::CdrScan => {
                let scan = match kind {
                    Channel::JsonScan => json::scan(data),
                    _ => cdr::scan(data),
                };
                scan.map(|scan| {
                    let scans = contents.scans.entry(topic.clone()).or_default();
                    scans.push(scan.at(logged));
                })
            }
            Channel::JsonPose => json::pose_in_frame(data).and_then(|(frame, pose)| {
                let trust = match frame.as_str() {
                    "odom" => Trust::Odometry,
                    _ => Trust::Belief,
                };
                belief(trust, Ok(pose))
            }),
            Channel::CdrOdometry => belief(Trust::Odometry, cdr::odometry(data)),
            Channel::CdrPose => belief(Trust::Belief, cdr::pose_stamped(data)),
            Channel::Other => Ok(()),
        };
        if let Err(refusal) = done {
            let place = format_args!("{topic} at {logged} s");
            let what = format_args!("{}", refusal.1);
            self.contents.findings.add(refusal.0, place, what);
        }
    }
}

/// Why a message is left out.
type Refusal = (Kind, String);

/// What a message says, with its own time if it has one.
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

/// Farther than any robot drives, metres.
const FAR_M: f64 = 1e5;

/// A pose in the plane from a place and a turn as quaternion.
fn pose([x, y]: [f64; 2], [qx, qy, qz, qw]: [f64; 4]) -> Result<Pose, Refusal> {
    let theta = libm::atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz));
    if [x, y].iter().all(|part| part.abs() < FAR_M) && theta.is_finite() {
        Ok(Pose::new(x, y, theta))
    } else {
        let words = format!("pose {x} {y} {theta}: no place that robots drive to");
        Err((Kind::Absurd, words))
    }
}

/// Beams whose numbers make sense.
fn checked(beams: Beams) -> Result<Beams, Refusal> {
    let (first, step, beam_s) = (beams.first, beams.step, beams.beam_s);
    let (count, turn) = (beams.ranges.len(), step * beams.ranges.len() as f64);
    // Not-a-number is on neither side of a bound.
    let is_sound = first.abs() < 7.0 && turn.abs() < 7.0 && (0.0..0.1).contains(&beam_s);
    if !is_sound || count > BEAMS_MAX {
        let words = format!(
            "{count} beams from {first} rad by {step} rad and {beam_s} s: expected a turn at most"
        );
        return Err((Kind::Absurd, words));
    }
    Ok(beams)
}
