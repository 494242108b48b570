//! Readings of conditions as text.

use crate::robots::conditions::Reading;
use crate::scenario::Condition;

/// `axis left, set-point is 0.52`.
pub(super) fn told(condition: &Condition, reading: &Reading) -> String {
    let value = match &reading.value {
        Some(value) => format!(" is {value}"),
        None => String::new(),
    };
    match condition {
        Condition::Frame(frame) => match &frame.field {
            Some(field) => format!("{field} on {}{value}", frame.link),
            None => condition.to_string(),
        },
        Condition::Register(one) => match (&one.name, one.address) {
            (Some(name), _) => format!("{} {name}{value}", one.device),
            (None, address) => {
                let address = address.unwrap_or_default();
                format!("{} register {address}{value}", one.device)
            }
        },
        Condition::Pose(place) => {
            let [x, y] = place.near_m;
            format!("distance from {x}, {y}{value} m")
        }
        Condition::Map(_) => format!("known share of the map{value}"),
        Condition::Visited(_) => format!("number of visited waypoints{value}"),
        Condition::Axis(axis) => format!("axis {}, {}{value}", axis.name, axis.of.name()),
        Condition::Robot(robot) => format!("{}{value}", robot.of.name()),
        Condition::Contact(_) => match &reading.value {
            Some(speed) => format!("contact at {speed} m/s"),
            None => "contact".to_owned(),
        },
        other => other.to_string(),
    }
}
