//! A payload as text: message name and fields.
//!
//! A payload does not contain its sender. Some fields belong to the robot's messages only
//! (odometry, scan, lines, IR), some to the PC's only. A decoder ignores the fields of the other
//! side's message, and an encoder omits them.

use core::fmt::Write as _;

use protocols::telemetry::PAYLOAD_MAX;
use protocols::telemetry::message::{ANY_HEADING, MessageError, Pose, Telecommand, Telemetry};

use crate::hex;

/// Maximum number of printed bytes of an invalid payload.
const TOLD_MAX: usize = 16;

/// A payload as text.
pub(super) fn of(payload: &[u8]) -> String {
    let told = Telemetry::decode(payload).ok();
    if let Some(told) = told.filter(|told| is_whole(payload, |out| told.encode(out)))
        && is_of_the_robot(&told)
    {
        return telemetry(&told);
    }
    let command = Telecommand::decode(payload).ok();
    match command.filter(|command| is_whole(payload, |out| command.encode(out))) {
        Some(command) => telecommand(&command),
        None => plain(payload),
    }
}

/// Whether a payload is a message of either side.
pub(super) fn is_message(payload: &[u8]) -> bool {
    let told = Telemetry::decode(payload).ok();
    let command = || Telecommand::decode(payload).ok();
    !payload.is_empty()
        && (told.is_some_and(|told| is_whole(payload, |out| told.encode(out)))
            || command().is_some_and(|command| is_whole(payload, |out| command.encode(out))))
}

/// Whether encoding a decoded message gives all fields of the payload.
fn is_whole(payload: &[u8], encode: impl FnOnce(&mut [u8]) -> Result<usize, MessageError>) -> bool {
    let mut out = [0; PAYLOAD_MAX];
    encode(&mut out).is_ok_and(|len| out.get(..len) == Some(payload))
}

/// A payload with only time and state is a command: the robot always sends more.
const fn is_of_the_robot(told: &Telemetry) -> bool {
    told.odometry.is_some()
        || told.lidar.is_some()
        || told.lines.is_some()
        || told.infrared.is_some()
}

fn telemetry(told: &Telemetry) -> String {
    let mut parts = Vec::new();
    parts.extend(told.state.map(|state| state.name().to_owned()));
    parts.extend(
        told.odometry
            .as_ref()
            .map(|it| format!("at {}", pose(it.pose))),
    );
    if let Some(infrared) = &told.infrared {
        let metres = infrared.distances_m.iter();
        let metres: Vec<String> = metres.map(|metres| rounded(*metres)).collect();
        parts.push(format!("IR {} m", metres.join(" ")));
    }
    parts.extend(
        told.lidar
            .as_ref()
            .map(|it| count(it.points.len(), "point")),
    );
    parts.extend(told.lines.as_ref().map(|it| count(it.len(), "line")));
    format!(
        "telemetry at {} ms: {}",
        told.timestamp_ms,
        parts.join(", ")
    )
}

fn telecommand(command: &Telecommand) -> String {
    let mut parts = Vec::new();
    parts.extend(command.state.map(|state| state.name().to_owned()));
    parts.extend(command.velocities.map(|speed| {
        let [linear, angular] = [speed.linear_m_s, speed.angular_rad_s].map(rounded);
        format!("drive {linear} m/s {angular} rad/s")
    }));
    parts.extend(
        command
            .corrected_pose
            .map(|it| format!("is at {}", pose(it))),
    );
    parts.extend(command.desired_pose.map(|it| format!("go to {}", pose(it))));
    parts.extend(
        command
            .lidar_step_deg
            .map(|step| format!("send a scan each {step} deg")),
    );
    parts.extend(command.lines.map(|_| "send lines".to_owned()));
    if let Some(reactive) = command.reactive {
        let speed = reactive.speed_m_s.map(|it| format!(" {} m/s", rounded(it)));
        parts.push(format!("reactive{}", speed.unwrap_or_default()));
    }
    format!(
        "command at {} ms: {}",
        command.timestamp_ms,
        parts.join(", ")
    )
}

fn plain(payload: &[u8]) -> String {
    let told = hex::pairs(&payload[..payload.len().min(TOLD_MAX)]);
    let more = if payload.len() > TOLD_MAX { " .." } else { "" };
    format!("{} bytes: {told}{more}", payload.len())
}

/// Position and heading; `any` heading if the robot may choose.
fn pose(pose: Pose) -> String {
    let mut out = format!("{} {} m", rounded(pose.x), rounded(pose.y));
    let heading = if pose.alpha.to_bits() == ANY_HEADING.to_bits() {
        "any heading".to_owned()
    } else {
        format!("{} rad", rounded(pose.alpha))
    };
    write!(out, " {heading}").expect("a string takes all");
    out
}

/// The value with at most three decimals.
fn rounded(value: f32) -> String {
    let value = (f64::from(value) * 1_000.0).round() / 1_000.0;
    value.to_string()
}

fn count(number: usize, what: &str) -> String {
    let end = if number == 1 { "" } else { "s" };
    format!("{number} {what}{end}")
}

#[cfg(test)]
mod tests {
    use protocols::telemetry::message::{
        Infrared, Lidar, LidarPoint, Line, LinesRequest, Odometry, Reactive, State,
    };

    use super::*;

    fn payload(encode: impl FnOnce(&mut [u8]) -> Result<usize, MessageError>) -> Vec<u8> {
        let mut out = [0; PAYLOAD_MAX];
        let len = encode(&mut out).expect("small");
        out[..len].to_vec()
    }

    #[test]
    fn what_the_robot_tells_is_told() {
        let mut told = Telemetry {
            timestamp_ms: 1_200,
            state: Some(State::AutoReactive),
            odometry: Some(Odometry {
                pose: Pose {
                    x: 1.0,
                    y: -0.25,
                    alpha: 0.123_456,
                },
                ..Odometry::default()
            }),
            infrared: Some(Infrared {
                timestamp_ms: None,
                distances_m: [0.25, 0.5, 0.125].into_iter().collect(),
            }),
            ..Telemetry::default()
        };
        let base =
            "telemetry at 1200 ms: auto-reactive, at 1 -0.25 m 0.123 rad, IR 0.25 0.5 0.125 m";
        assert_eq!(of(&payload(|out| told.encode(out))), base);
        told.lidar = Some(Lidar {
            timestamp_ms: 1_100,
            points: [LidarPoint::default(); 2].into_iter().collect(),
        });
        told.lines = Some([Line::default()].into_iter().collect());
        let more = format!("{base}, 2 points, 1 line");
        assert_eq!(of(&payload(|out| told.encode(out))), more);
    }

    #[test]
    fn what_the_pc_wants_is_told() {
        let pose = Pose {
            x: 2.0,
            y: 0.5,
            alpha: ANY_HEADING,
        };
        let command = Telecommand {
            timestamp_ms: 7,
            state: Some(State::AutoPosition),
            corrected_pose: Some(Pose::default()),
            desired_pose: Some(pose),
            lidar_step_deg: Some(2),
            lines: Some(LinesRequest::default()),
            reactive: Some(Reactive {
                speed_m_s: Some(0.3),
                ..Reactive::default()
            }),
            velocities: None,
        };
        assert_eq!(
            of(&payload(|out| command.encode(out))),
            "command at 7 ms: auto-position, is at 0 0 m 0 rad, go to 2 0.5 m any heading, \
             send a scan each 2 deg, send lines, reactive 0.3 m/s"
        );
        assert_eq!(of(&[0x08, 5, 0x12, 2, 0x08, 1]), "command at 5 ms: off");
    }

    #[test]
    fn what_is_no_message_is_told_in_bytes() {
        assert_eq!(of(&[1, 2]), "2 bytes: 01 02");
        assert_eq!(
            of(&[0x08, 0x85, 0x00]),
            "3 bytes: 08 85 00",
            "5 in a long form"
        );
    }
}
