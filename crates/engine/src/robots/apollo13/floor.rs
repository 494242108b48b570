//! The floor plan for the program: cells that a wall crosses.

use emulators::world::{Bounds, Point, Shape};
use firmware_core::robots::apollo13::floor::FloorPlan;

use crate::scenario::{ScenarioError, Source, WorldSpec};

/// Edge of a cell, metres, as in the fielded maps.
const CELL_M: f64 = 0.05;
/// Free floor around all walls, metres.
const MARGIN_M: f64 = 0.5;
/// Maximum number of cells in a plan: 100 m by 100 m.
const CELLS_MAX: f64 = 4e6;

/// The plan of the mapped objects of `world` that are higher than `height_m`.
///
/// # Errors
/// If the plan is larger than a map can be.
pub(super) fn plan(
    world: &WorldSpec,
    height_m: f64,
    source: &Source,
) -> Result<FloorPlan, ScenarioError> {
    let scene = world.mapped(source)?.slice(height_m);
    if scene.fixtures().is_empty() {
        return Ok(FloorPlan::default());
    }
    let mut canvas = Canvas::around(scene.bounds()).ok_or_else(|| {
        let message = "is larger than a floor plan of 4 million cells of 5 cm";
        source.invalid(source.find("world"), "world", message)
    })?;
    for fixture in scene.fixtures() {
        match &fixture.shape {
            Shape::Wall { from, to } => canvas.draw(*from, *to),
            Shape::Polygon { corners } => {
                let next = corners.iter().cycle().skip(1);
                for (from, to) in corners.iter().zip(next) {
                    canvas.draw(*from, *to);
                }
            }
            Shape::Circle { center, radius_m } => canvas.draw_disc(*center, *radius_m),
        }
    }
    Ok(canvas.plan)
}

struct Canvas {
    plan: FloorPlan,
}

impl Canvas {
    /// An empty plan with room for everything within `bounds`.
    fn around(bounds: Bounds) -> Option<Self> {
        let first = |least: f64| ((least - MARGIN_M) / CELL_M).floor() * CELL_M;
        let origin_m = [first(bounds.min.x), first(bounds.min.y)];
        let cells = |greatest: f64, origin: f64| ((greatest + MARGIN_M - origin) / CELL_M).ceil();
        let [width, height] = [
            cells(bounds.max.x, origin_m[0]),
            cells(bounds.max.y, origin_m[1]),
        ];
        if width * height > CELLS_MAX {
            return None;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "some thousand"
        )]
        let [width, height] = [width, height].map(|cells| cells as usize);
        Some(Self {
            plan: FloorPlan {
                width,
                cell_m: CELL_M,
                origin_m,
                obstacles: vec![false; width * height],
            },
        })
    }

    fn mark(&mut self, x_m: f64, y_m: f64) {
        let [x0, y0] = self.plan.origin_m;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "all is within the plan, with a margin"
        )]
        let [x, y] = [(x_m - x0) / CELL_M, (y_m - y0) / CELL_M].map(|cell| cell as usize);
        if let Some(cell) = self.plan.obstacles.get_mut(y * self.plan.width + x) {
            *cell = true;
        }
    }

    /// Marks all cells that the line crosses, except at corners.
    fn draw(&mut self, from: Point, to: Point) {
        let steps = (from.distance(to) / (CELL_M / 8.0)).ceil().max(1.0);
        let mut step = 0.0;
        while step <= steps {
            let part = step / steps;
            self.mark(
                from.x + (to.x - from.x) * part,
                from.y + (to.y - from.y) * part,
            );
            step += 1.0;
        }
    }

    fn draw_disc(&mut self, center: Point, radius_m: f64) {
        let mut y = -radius_m;
        while y <= radius_m {
            let half = (radius_m * radius_m - y * y).max(0.0).sqrt();
            let at = |x: f64| Point::new(center.x + x, center.y + y);
            self.draw(at(-half), at(half));
            y += CELL_M / 8.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scenario::Scenario;

    /// A wall of 1 m from (0, 0), and three boxes: one is low, one is unmapped, one is on the plan.
    /// The plan starts at (-0.5, -0.5), so cell (10 + 2, 10) is wall, and so on.
    #[test]
    fn what_is_low_or_unmapped_is_not_on_the_plan() {
        let square = |x: f64| {
            let (a, b) = (x, x + 0.2);
            format!("[[world.polygon]]\ncorners_m = [[{a}, 1], [{b}, 1], [{b}, 1.2], [{a}, 1.2]]\n")
        };
        let text = format!(
            "schema = 1\nname = \"t\"\nrobot = \"apollo13\"\nduration = \"1s\"\n[world]\n\
             start = {{ x_m = 0, y_m = 3, heading_deg = 0 }}\n\
             [[world.wall]]\npath_m = [[0.01, 0.01], [1.01, 0.01]]\n\
             {}height_m = 0.30\n{}unmapped = true\n{}height_m = 0.40\n",
            square(0.01),
            square(0.51),
            square(1.01)
        );
        let parsed = Scenario::parse(Path::new("t.toml"), text);
        let (scenario, source) = parsed.expect("sound");
        let plan = plan(&scenario.world, 0.34, &source).expect("small");
        let near = |found: f64, expected: f64| (found - expected).abs() < 1e-9;
        assert!(near(plan.origin_m[0], -0.5) && near(plan.origin_m[1], -0.5));
        let is = |x_m: f64, y_m: f64| {
            #[expect(clippy::cast_possible_truncation, reason = "some cells")]
            let [x, y] = [x_m, y_m].map(|m| ((m + 0.5) / 0.05 + 1e-9) as usize);
            plan.obstacles[y * plan.width + x]
        };
        assert!(is(0.01, 0.01) && is(0.5, 0.01) && !is(0.5, 0.11));
        assert_eq!(
            [0.02, 0.52, 1.02].map(|x| is(x, 1.01)),
            [false, false, true]
        );
    }
}
