//! An MCAP file. Each direction of each link is a channel of raw bytes. Lidar turns, the believed
//! path and the map are messages with schemas that Foxglove knows by name.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Attachment, McapError, WriteOptions, Writer};
use protocols::Instant;
use serde_json::{Value, json};

use super::scans::{Scan, scans};
use super::{Belief, Export};
use crate::Kind;
use engine::TOOL;
use engine::rig::line::Direction;
use engine::robots::KeptMap;
use show::render::{self, Cell};

struct Out {
    writer: Writer<Cursor<Vec<u8>>>,
    messages: u32,
}

pub(super) fn write(export: &Export<'_>) -> Result<(Vec<u8>, String), McapError> {
    let options = WriteOptions::new().compression(None).library(TOOL);
    let writer = options.create(Cursor::new(Vec::new()))?;
    let mut out = Out {
        writer,
        messages: 0,
    };
    let zero = export.recorded.zero;
    // The sections come first, so that a cut file still names the source of its bytes.
    for section in &export.capture.sections {
        if !section.scenario.is_empty() {
            out.writer.attach(&Attachment {
                log_time: zero.as_nanos(),
                create_time: zero.as_nanos(),
                name: "scenario.toml".to_owned(),
                media_type: "application/toml".to_owned(),
                data: section.scenario.as_bytes().into(),
            })?;
        }
    }
    out.bytes(export)?;
    let scans = scans(export.recorded);
    out.scans(&scans, zero)?;
    if let Some(belief) = export.belief {
        out.belief(belief, zero, export.recorded.end)?;
    }
    out.writer.finish()?;
    let words = format!("{} messages, {} lidar turns", out.messages, scans.len());
    Ok((out.writer.into_inner().into_inner(), words))
}

impl Out {
    /// Writes a message. The messages of a file may come in any order of time; readers sort them.
    fn message(&mut self, channel_id: u16, at: Instant, data: &[u8]) -> Result<(), McapError> {
        let header = MessageHeader {
            channel_id,
            sequence: self.messages,
            log_time: at.as_nanos(),
            publish_time: at.as_nanos(),
        };
        self.messages += 1;
        self.writer.write_to_known_channel(&header, data)
    }

    fn bytes(&mut self, export: &Export<'_>) -> Result<(), McapError> {
        let mut channels = BTreeMap::new();
        for (link, interface) in export.capture.links.iter().enumerate() {
            for direction in [Direction::ToMaster, Direction::ToDevice] {
                let topic = format!("/{}/{}", interface.name, direction.name());
                let metadata = BTreeMap::from([
                    ("baud".to_owned(), interface.baud.to_string()),
                    ("direction".to_owned(), direction.name().to_owned()),
                ]);
                let encoding = "application/octet-stream";
                let id = self.writer.add_channel(0, &topic, encoding, &metadata)?;
                channels.insert((link, direction as usize), id);
            }
        }
        for record in &export.capture.records {
            let channel = channels.get(&(record.link, record.direction as usize));
            if let (Kind::Data, Some(&channel)) = (record.kind, channel)
                && !record.bytes.is_empty()
            {
                self.message(channel, record.at, &record.bytes)?;
            }
        }
        Ok(())
    }

    fn known(&mut self, topic: &str, schema: &str, fields: &[&str]) -> Result<u16, McapError> {
        let properties: serde_json::Map<String, Value> = fields
            .iter()
            .map(|field| ((*field).to_owned(), json!({})))
            .collect();
        let text = json!({ "title": schema, "type": "object", "properties": properties });
        let text = text.to_string();
        let id = self
            .writer
            .add_schema(schema, "jsonschema", text.as_bytes())?;
        self.writer.add_channel(id, topic, "json", &BTreeMap::new())
    }

    fn scans(&mut self, scans: &[Scan], zero: Instant) -> Result<(), McapError> {
        if scans.is_empty() {
            return Ok(());
        }
        let fields = [
            "timestamp",
            "frame_id",
            "pose",
            "start_angle",
            "end_angle",
            "ranges",
            "intensities",
        ];
        let channel = self.known("/scan", "foxglove.LaserScan", &fields)?;
        for scan in scans {
            let at = absolute(zero, scan.at);
            let last = scan.ranges.len() as f64 - 1.0;
            // JSON has no infinity: a missing reading is 0 with strength 0.
            let ranges: Vec<f64> = scan
                .ranges
                .iter()
                .map(|range| range.unwrap_or(0.0))
                .collect();
            let text = json!({
                "timestamp": stamp(at),
                "frame_id": "robot",
                "pose": pose(0.0, 0.0, 0.0),
                "start_angle": scan.start,
                "end_angle": scan.start + last.to_radians(),
                "ranges": ranges,
                "intensities": scan.strengths,
            });
            self.message(channel, at, text.to_string().as_bytes())?;
        }
        Ok(())
    }

    fn belief(&mut self, belief: &Belief, zero: Instant, end: Instant) -> Result<(), McapError> {
        let fields = ["timestamp", "frame_id", "pose"];
        let channel = self.known("/pose", "foxglove.PoseInFrame", &fields)?;
        for &(at, place) in &belief.way {
            let at = absolute(zero, at);
            let text = json!({
                "timestamp": stamp(at),
                "frame_id": "map",
                "pose": pose(place.x, place.y, place.theta),
            });
            self.message(channel, at, text.to_string().as_bytes())?;
        }
        let Some(map) = belief.map.as_ref().map(KeptMap::view) else {
            return Ok(());
        };
        let fields = [
            "timestamp",
            "frame_id",
            "pose",
            "column_count",
            "cell_size",
            "row_stride",
            "cell_stride",
            "fields",
            "data",
        ];
        let channel = self.known("/map", "foxglove.Grid", &fields)?;
        let cell = f64::from(map.cell_mm()) / 1000.0;
        let rows = (0..map.height()).flat_map(|y| (0..map.width()).map(move |x| (x, y)));
        // The ROS convention: 100 a wall, 0 free, -1 unknown.
        let data: Vec<u8> = rows
            .map(|(x, y)| match render::cell(map, x, y) {
                Cell::Wall => 100,
                Cell::Free => 0,
                Cell::Unknown | Cell::Between => 255,
            })
            .collect();
        let at = absolute(zero, end);
        let [x, y] = map.origin_mm().map(|mm| f64::from(mm) / 1000.0);
        let text = json!({
            "timestamp": stamp(at),
            "frame_id": "map",
            "pose": pose(x, y, 0.0),
            "column_count": map.width(),
            "cell_size": { "x": cell, "y": cell },
            "row_stride": map.width(),
            "cell_stride": 1,
            // Type 2 is INT8.
            "fields": [{ "name": "occupancy", "offset": 0, "type": 2 }],
            "data": base64(&data),
        });
        self.message(channel, at, text.to_string().as_bytes())
    }
}

fn absolute(zero: Instant, at: Instant) -> Instant {
    zero + (at - Instant::ZERO)
}

fn stamp(at: Instant) -> Value {
    let nanos = at.as_nanos();
    json!({ "sec": nanos / 1_000_000_000, "nsec": nanos % 1_000_000_000 })
}

fn pose(x: f64, y: f64, theta: f64) -> Value {
    let (z, w) = libm::sincos(theta / 2.0);
    json!({
        "position": { "x": x, "y": y, "z": 0.0 },
        "orientation": { "x": 0.0, "y": 0.0, "z": z, "w": w },
    })
}

/// RFC 4648, section 4.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |index: usize| u32::from(three.get(index).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for digit in 0..4 {
            let value = bits >> (18 - 6 * digit) & 63;
            out.push(match digit <= three.len() {
                true => char::from(DIGITS[value as usize]),
                false => '=',
            });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use emulators::world::Pose;
    use firmware_core::map_view::MapView;
    use protocols::LineEvent;

    use super::super::Laser;
    use super::*;
    use crate::replay::Recorded;
    use crate::{Capture, Interface, Record};

    /// All messages of a file: topic, time, bytes.
    fn raw(out: Out) -> Vec<(String, u64, Vec<u8>)> {
        let mut writer = out.writer;
        writer.finish().expect("it is in memory");
        let bytes = writer.into_inner().into_inner();
        let all = mcap::MessageStream::new(&bytes).expect("a file");
        all.map(|message| {
            let message = message.expect("whole");
            let topic = message.channel.topic.clone();
            (topic, message.log_time, message.data.into_owned())
        })
        .collect()
    }

    /// All messages of a file, their bytes parsed as JSON.
    fn messages(out: Out) -> Vec<(String, u64, Value)> {
        let json = |data: Vec<u8>| serde_json::from_slice(&data).expect("JSON");
        let all = raw(out).into_iter();
        all.map(|(topic, at, data)| (topic, at, json(data)))
            .collect()
    }

    fn empty() -> Out {
        let options = WriteOptions::new().compression(None).library(TOOL);
        let writer = options.create(Cursor::new(Vec::new())).expect("in memory");
        Out {
            writer,
            messages: 0,
        }
    }

    /// Lost bytes did not arrive, and a break has no bytes.
    #[test]
    fn bytes_that_came_are_messages_of_their_link_and_direction() {
        let [to_master, to_device] = [Direction::ToMaster, Direction::ToDevice];
        let line_break = Kind::Line(LineEvent::Break);
        let happened = [
            (to_master, Kind::Data, &[1, 2][..]),
            (to_master, Kind::Data, &[]),
            (to_device, line_break, &[]),
            (to_device, Kind::Data, &[3]),
        ];
        let records = (1..).zip(happened);
        let records = records.map(|(second, (direction, kind, bytes))| Record {
            link: 0,
            sequence: None,
            at: Instant::from_secs(second),
            direction,
            kind,
            bytes: bytes.to_vec().into(),
            sent: None,
            pieces: Vec::new(),
            comment: String::new(),
        });
        let capture = Capture {
            links: vec![Interface::new("base", 9600)],
            records: records.collect(),
            ..Capture::default()
        };
        let export = Export {
            capture: &capture,
            recorded: &Recorded::default(),
            belief: None,
            laser: Laser::default(),
        };
        let mut out = empty();
        out.bytes(&export).expect("in memory");
        let said = |topic: &str, second: u64, bytes: &[u8]| {
            (topic.to_owned(), second * 1_000_000_000, bytes.to_vec())
        };
        let expected = [
            said("/base/to-master", 1, &[1, 2]),
            said("/base/to-device", 4, &[3]),
        ];
        assert_eq!(raw(out), expected);
    }

    /// A capture that began at 5 s. Half a turn is (0, 0, 1, 0) as a quaternion. The map has cells
    /// of 50 mm from (-1 m, 0.5 m) on. The values 255, 0 and 127, a wall, free and unknown, become
    /// 100, 0 and -1: bytes 64 00 FF.
    #[test]
    fn the_way_and_the_map_are_told_in_metres_and_absolute_times() {
        let cells = [255, 0, 127];
        let map = MapView::new(3, 50.0, [-1000.0, 500.0], &cells);
        let theta = core::f64::consts::PI;
        let belief = Belief {
            way: vec![(
                Instant::from_millis(1500),
                Pose {
                    x: 1.0,
                    y: -2.0,
                    theta,
                },
            )],
            map: Some(KeptMap::from(map)),
        };
        let mut out = empty();
        let zero = Instant::from_secs(5);
        out.belief(&belief, zero, Instant::from_secs(2))
            .expect("in memory");
        let all = messages(out);
        let [(pose_topic, pose_at, pose), (map_topic, map_at, map)] = &all[..] else {
            panic!("{all:?}")
        };
        assert_eq!((&**pose_topic, *pose_at), ("/pose", 6_500_000_000));
        assert_eq!(pose["timestamp"], json!({ "sec": 6, "nsec": 500_000_000 }));
        let place = json!({ "x": 1.0, "y": -2.0, "z": 0.0 });
        assert_eq!(pose["pose"]["position"], place);
        assert_eq!(pose["pose"]["orientation"]["z"], 1.0);
        let w = pose["pose"]["orientation"]["w"].as_f64().expect("a number");
        assert!(w.abs() < 1e-12, "{w}");
        assert_eq!((&**map_topic, *map_at), ("/map", 7_000_000_000));
        let corner = json!({ "x": -1.0, "y": 0.5, "z": 0.0 });
        assert_eq!(map["pose"]["position"], corner);
        assert_eq!(
            (&map["column_count"], &map["row_stride"]),
            (&json!(3), &json!(3))
        );
        assert_eq!(map["cell_stride"], 1);
        let edge = map["cell_size"]["x"].as_f64().expect("a number");
        assert!((edge - 0.05).abs() < 1e-9, "{edge}");
        assert_eq!(map["data"], "ZAD/");
    }

    /// 360 readings end 359 degrees after the first; a missing reading is 0.
    #[test]
    fn a_turn_says_its_angles_and_has_no_infinity() {
        let scan = Scan {
            link: "lidar".to_owned(),
            at: Instant::from_secs(1),
            start: 0.0,
            ranges: [Some(1.5), None].into_iter().cycle().take(360).collect(),
            strengths: vec![7.0; 360],
        };
        let mut out = empty();
        out.scans(&[], Instant::ZERO).expect("in memory");
        assert_eq!(out.messages, 0);
        out.scans(&[scan], Instant::from_secs(5))
            .expect("in memory");
        assert_eq!(out.messages, 1);
        let all = messages(out);
        let (topic, at, scan) = &all[0];
        assert_eq!((&**topic, *at), ("/scan", 6_000_000_000));
        assert_eq!(scan["start_angle"], 0.0);
        let end = scan["end_angle"].as_f64().expect("a number");
        assert!((end - 359_f64.to_radians()).abs() < 1e-12, "{end}");
        assert_eq!(
            (&scan["ranges"][0], &scan["ranges"][1]),
            (&json!(1.5), &json!(0.0))
        );
        assert_eq!(scan["ranges"].as_array().map(Vec::len), Some(360));
        assert_eq!(scan["intensities"][359], 7.0);
    }

    /// RFC 4648, section 10.
    #[test]
    fn base64_is_that_of_the_standard() {
        let vectors = ["", "f", "fo", "foo", "foob", "fooba", "foobar"];
        let encoded = [
            "", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy",
        ];
        assert_eq!(vectors.map(|text| base64(text.as_bytes())), encoded);
    }

    /// One record with bytes; only a section with a scenario has an attachment.
    #[test]
    fn a_file_has_the_scenario_of_its_sections() {
        let of = |scenario: &str| {
            let capture = Capture {
                sections: vec![crate::Section {
                    scenario: scenario.to_owned(),
                    ..crate::Section::default()
                }],
                links: vec![Interface::new("a", 9_600)],
                records: vec![Record {
                    link: 0,
                    sequence: None,
                    at: Instant::from_secs(1),
                    direction: Direction::ToMaster,
                    kind: Kind::Data,
                    bytes: vec![7].into(),
                    sent: None,
                    pieces: Vec::new(),
                    comment: String::new(),
                }],
                ..Capture::default()
            };
            let recorded = Recorded::default();
            let export = Export {
                capture: &capture,
                recorded: &recorded,
                belief: None,
                laser: Laser::default(),
            };
            let (bytes, words) = write(&export).expect("written");
            let summary = mcap::Summary::read(&bytes).expect("readable").expect("one");
            let messages = mcap::MessageStream::new(&bytes).expect("a file").count();
            (words, messages, summary.attachment_indexes.len())
        };
        let words = "1 messages, 0 lidar turns".to_owned();
        assert_eq!(of("schema = 1\n"), (words.clone(), 1, 1));
        assert_eq!(of(""), (words, 1, 0));
    }
}
