//! Measures of the model car.

mod drift;
mod driving;
mod places;
mod sensors;

pub(super) use drift::DRIFT;
pub(super) use driving::{LEVELS, STEERING, WALL};
pub(super) use places::{BLOCKED, GATES, GOAL, LOCALISED, MAPPING, MARKERS};
pub(super) use sensors::{ENCODER, HALL, HEIGHTS, LINES, PULSES, STOP};
