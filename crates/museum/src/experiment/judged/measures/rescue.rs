//! Measures of the rescue robot.

mod filter;
mod link;
mod mapping;
mod search;

pub(super) use filter::{FILTER, PUSH, RAMP};
pub(super) use link::{BYTES, LIDAR, ODOMETER, RADIO, SMEAR, TRANSFER};
pub(super) use mapping::{CORRIDOR, MISSION, PEOPLE, TURNING};
pub(super) use search::{POINTS, REGULATOR, SEARCH_TIME, SEARCH_TIME_360, TRIES, WEIGHTS};
