//! Settings as words of text, for firmware on a simulated board: what a scenario says reaches the
//! board as `KEY=VALUE`.

use core::fmt::Display;
use core::str::FromStr;

use crate::pose::Pose;

/// Takes a key and its value.
pub type Report<'a> = dyn FnMut(&'static str, &dyn Display) + 'a;

/// Reports the start pose.
pub(super) fn tell_start(start: Pose, report: &mut Report<'_>) {
    report("x_mm", &start.x_mm);
    report("y_mm", &start.y_mm);
    report("heading", &start.heading);
}

/// Sets a number of the start pose; `None`: the key is another one.
pub(super) fn set_start(
    start: &mut Pose,
    key: &str,
    value: &str,
) -> Option<Result<(), &'static str>> {
    let place = match key {
        "x_mm" => &mut start.x_mm,
        "y_mm" => &mut start.y_mm,
        "heading" => &mut start.heading,
        _ => return None,
    };
    Some(number(value).map(|number| *place = number))
}

/// The number that `value` is.
pub(super) fn number<T: FromStr>(value: &str) -> Result<T, &'static str> {
    value.parse().map_err(|_| "expected a number")
}
