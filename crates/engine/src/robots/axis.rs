//! The axes of a robot.

use std::borrow::Cow;

use serde::Serialize;

/// An axis with its command and its motion: a wheel, a steering, a gripper.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Axis {
    /// Its name.
    pub name: Cow<'static, str>,
    /// Unit of the values, empty if they have none.
    pub unit: &'static str,
    /// Set-point, as accepted by the device that drives the axis.
    pub set_point: f64,
    /// Greatest valid set-point in both directions.
    pub limit: Option<f64>,
    /// Actual value, if it is known.
    pub actual: Option<f64>,
}
