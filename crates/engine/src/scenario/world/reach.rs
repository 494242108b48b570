//! Checks that all coordinates of a world are in range.

use super::WorldSpec;
use crate::scenario::{ScenarioError, Source};

/// Farthest coordinate of a world, metres.
const REACH_MAX_M: f64 = 10_000.0;
/// Largest rotation of a push, degrees.
const TURN_MAX_DEG: f64 = 36_000.0;

impl WorldSpec {
    /// Checks every coordinate before other values are derived from it.
    pub(super) fn check_reach(&self, source: &Source) -> Result<(), ScenarioError> {
        let mut far = None;
        let mut look = |key: &str, index: Option<usize>, span, places: &[[f64; 2]]| {
            let is_far = |value: &f64| !(-REACH_MAX_M..=REACH_MAX_M).contains(value);
            let place = places.iter().find(|place| place.iter().any(is_far));
            if let (None, Some(&place)) = (&far, place) {
                let index = index.map_or_else(String::new, |index| format!("[{index}]"));
                far = Some((format!("world.{key}{index}"), span, place));
            }
        };
        if let Some(bounds) = &self.bounds {
            look("bounds", None, None, &[bounds.min_m, bounds.max_m]);
        }
        for (index, spec) in self.wall.iter().enumerate() {
            look(
                "wall",
                Some(index),
                Some(spec.span()),
                &spec.get_ref().path_m,
            );
        }
        for (index, spec) in self.polygon.iter().enumerate() {
            let corners = &spec.get_ref().corners_m;
            look("polygon", Some(index), Some(spec.span()), corners);
        }
        for (index, spec) in self.pillar.iter().enumerate() {
            look(
                "pillar",
                Some(index),
                Some(spec.span()),
                &spec.get_ref().at_m,
            );
        }
        for (index, spec) in self.moving.iter().enumerate() {
            look(
                "moving",
                Some(index),
                Some(spec.span()),
                &spec.get_ref().path_m,
            );
        }
        for (index, spec) in self.heat.iter().enumerate() {
            let heat = spec.get_ref();
            look(
                "heat",
                Some(index),
                Some(spec.span()),
                &[heat.from_m, heat.to_m],
            );
        }
        for (index, spec) in self.slick.iter().enumerate() {
            let slick = spec.get_ref();
            look(
                "slick",
                Some(index),
                Some(spec.span()),
                &[slick.min_m, slick.max_m],
            );
        }
        for (index, spec) in self.line.iter().enumerate() {
            let line = spec.get_ref();
            look(
                "line",
                Some(index),
                Some(spec.span()),
                &[line.from_m, line.to_m],
            );
        }
        for (index, push) in self.push.iter().enumerate() {
            look("push", Some(index), None, &[push.by_m]);
        }
        let mut pushes = self.push.iter().enumerate();
        if let Some((index, push)) = pushes.find(|(_, push)| push.turn_deg.abs() > TURN_MAX_DEG) {
            let turn = push.turn_deg;
            let message = format!("is {turn:?}, expected -{TURN_MAX_DEG} to {TURN_MAX_DEG}");
            return Err(source.invalid(None, format!("world.push[{index}].turn_deg"), message));
        }
        let Some((key, span, [x, y])) = far else {
            return Ok(());
        };
        let message = format!(
            "reaches {x:?}, {y:?}, expected coordinates within {REACH_MAX_M} m of the origin"
        );
        Err(source.invalid(span, key, message))
    }
}
