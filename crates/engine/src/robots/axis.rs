//! What a robot moves.

use std::borrow::Cow;

use serde::Serialize;

/// Something that the robot is told to do and does: a wheel, a steering, a gripper.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Axis {
    /// Its name.
    pub name: Cow<'static, str>,
    /// Unit of the figures, empty if they have none.
    pub unit: &'static str,
    /// What it was told to do, as the device that moves it took it.
    pub set_point: f64,
    /// Largest sound set-point, either way.
    pub limit: Option<f64>,
    /// What it does, if that can be told.
    pub actual: Option<f64>,
}
