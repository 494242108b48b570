//! Decodes messages of the telemetry link and prints their fields, for a comparison with another
//! library of protocol buffers.
//!
//! Each line of standard input is `telemetry HEX` or `telecommand HEX`. The answer is a line: the
//! fields as `path=value` in the order of their numbers, `|`, and the message encoded again, in
//! hexadecimal. Floats are printed as their bits, so that none is rounded. The answer to an invalid
//! message is `error: ..`.

use std::io::{self, BufRead as _, Write as _};

use protocols::telemetry::message::{MessageError, Pose, Telecommand, Telemetry};

/// Maximum number of bytes of a message that is written again.
const ROOM: usize = 65_536;

fn main() -> io::Result<()> {
    let mut out = io::stdout().lock();
    for line in io::stdin().lock().lines() {
        let line = line?;
        let answer = answer(&line).unwrap_or_else(|error| format!("error: {error}"));
        writeln!(out, "{answer}")?;
        out.flush()?;
    }
    Ok(())
}

fn answer(line: &str) -> Result<String, String> {
    let (kind, hex) = line.split_once(' ').unwrap_or((line, ""));
    let bytes = from_hex(hex).ok_or("not hexadecimal")?;
    let words = |error: MessageError| error.to_string();
    let mut room = vec![0; ROOM];
    let (fields, len) = match kind {
        "telemetry" => {
            let message = Telemetry::decode(&bytes).map_err(words)?;
            (telemetry(&message), message.encode(&mut room))
        }
        "telecommand" => {
            let message = Telecommand::decode(&bytes).map_err(words)?;
            (telecommand(&message), message.encode(&mut room))
        }
        _ => return Err("expected telemetry or telecommand".to_owned()),
    };
    let hex: String = room[..len.map_err(words)?]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    Ok(format!("{}|{hex}", fields.0.join(" ")))
}

fn from_hex(hex: &str) -> Option<Vec<u8>> {
    let digits: Option<Vec<u32>> = hex.chars().map(|digit| digit.to_digit(16)).collect();
    let digits = digits.filter(|digits| digits.len() % 2 == 0)?;
    let byte = |pair: &[u32]| u8::try_from(pair[0] << 4 | pair[1]).ok();
    digits.chunks_exact(2).map(byte).collect()
}

/// Fields as they are listed.
#[derive(Default)]
struct Fields(Vec<String>);

impl Fields {
    fn number(&mut self, path: &str, value: impl Into<i64>) {
        self.0.push(format!("{path}={}", value.into()));
    }

    fn float(&mut self, path: &str, value: f32) {
        self.0.push(format!("{path}={:08x}", value.to_bits()));
    }

    fn pose(&mut self, path: &str, pose: &Pose) {
        self.float(&format!("{path}.x"), pose.x);
        self.float(&format!("{path}.y"), pose.y);
        self.float(&format!("{path}.alpha"), pose.alpha);
    }
}

fn telemetry(message: &Telemetry) -> Fields {
    let mut list = Fields::default();
    list.number("timestamp", message.timestamp_ms);
    if let Some(state) = message.state {
        list.number("state.name", state as u8);
    }
    if let Some(odometry) = &message.odometry {
        list.pose("odometry.pose", &odometry.pose);
        for value in &odometry.covariance {
            list.float("odometry.covariance.value", *value);
        }
    }
    if let Some(lidar) = &message.lidar {
        list.number("lidar.timestamp", lidar.timestamp_ms);
        for point in &lidar.points {
            list.number("lidar.point.angle", point.angle_deg);
            list.number("lidar.point.distance", point.distance_mm);
            list.number("lidar.point.quality", point.quality);
        }
    }
    for line in message.lines.iter().flatten() {
        list.pose("lines.line.start", &line.start);
        list.pose("lines.line.end", &line.end);
    }
    if let Some(infrared) = &message.infrared {
        if let Some(timestamp_ms) = infrared.timestamp_ms {
            list.number("infrared.timestamp", timestamp_ms);
        }
        for metres in &infrared.distances_m {
            list.float("infrared.range.distance", *metres);
        }
    }
    list
}

fn telecommand(message: &Telecommand) -> Fields {
    let mut list = Fields::default();
    list.number("timestamp", message.timestamp_ms);
    if let Some(state) = message.state {
        list.number("state.name", state as u8);
    }
    if let Some(velocities) = &message.velocities {
        list.float("velocities.linear", velocities.linear_m_s);
        list.float("velocities.angular", velocities.angular_rad_s);
    }
    if let Some(pose) = &message.corrected_pose {
        list.pose("corrected_pose", pose);
    }
    if let Some(pose) = &message.desired_pose {
        list.pose("desired_pose", pose);
    }
    if let Some(step) = message.lidar_step_deg {
        list.number("lidar_step", step);
    }
    if let Some(lines) = &message.lines {
        list.number("lines.gap", lines.gap_mm);
        list.number("lines.tolerance", lines.tolerance_mm);
        list.number("lines.merge", lines.merge_deg);
    }
    if let Some(reactive) = &message.reactive {
        let values = [
            ("reactive.distance_min", reactive.distance_min_m),
            ("reactive.distance_max", reactive.distance_max_m),
            ("reactive.speed", reactive.speed_m_s),
            ("reactive.turn_gain", reactive.turn_gain),
        ];
        for (path, value) in values {
            if let Some(value) = value {
                list.float(path, value);
            }
        }
    }
    list
}
