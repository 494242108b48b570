//! An MCAP file: each direction of each link as a channel of raw bytes; lidar turns, the believed
//! way and the map as messages whose schemas Foxglove knows by their names.

use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Attachment, McapError, WriteOptions, Writer};
use protocols::Instant;
use serde_json::{Value, json};

use super::scans::{Scan, scans};
use super::{Belief, Export};
use crate::TOOL;
use crate::capture::Kind;
use crate::rig::line::Direction;
use crate::robots::KeptMap;
use crate::show::render::{self, Cell};

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
    // First, so that a file that is cut off still says whose bytes it holds.
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
    /// Messages of one file may come in any order of time; readers sort.
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
            // JSON has no infinity: a reading that measured nothing is 0 with strength 0.
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
        // As ROS has it: 100 a wall, 0 free, -1 unknown.
        let data: Vec<u8> = rows
            .map(|(x, y)| match render::cell(map, x, y) {
                Cell::Wall => 100,
                Cell::Free => 0,
                Cell::Unknown | Cell::Between => 255,
            })
            .collect();
        let at = absolute(zero, end);
        let text = json!({
            "timestamp": stamp(at),
            "frame_id": "map",
            "pose": pose(0.0, 0.0, 0.0),
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
    /// RFC 4648, section 10.
    #[test]
    fn base64_is_that_of_the_standard() {
        let vectors = ["", "f", "fo", "foo", "foob", "fooba", "foobar"];
        let encoded = [
            "", "Zg==", "Zm8=", "Zm9v", "Zm9vYg==", "Zm9vYmE=", "Zm9vYmFy",
        ];
        assert_eq!(vectors.map(|text| super::base64(text.as_bytes())), encoded);
    }
}
