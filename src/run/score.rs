//! How well the program knew where it was and what the world looks like, measured against truth.

use emulators::world::{Point, Pose as TruePose, Shape, World};
use firmware_core::map_view::MapView;
use protocols::Instant;

/// The program's pose beside the true one, at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePair {
    /// The moment that the estimate is about.
    pub at: Instant,
    /// Where the robot was.
    pub truth: TruePose,
    /// Where the program says it was, in metres and radians.
    pub estimate: TruePose,
}

impl PosePair {
    /// Distance between the two, in mm.
    pub fn error_mm(&self) -> f64 {
        self.truth.point().distance(self.estimate.point()) * 1000.0
    }

    /// Angle between the two, in degrees, never negative.
    pub fn error_deg(&self) -> f64 {
        emulators::world::wrap_angle(self.truth.theta - self.estimate.theta)
            .to_degrees()
            .abs()
    }
}

/// Root mean square and worst case of the pose errors of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseError {
    /// Position.
    pub rms_mm: f64,
    /// Heading.
    pub rms_deg: f64,
    /// Position, worst.
    pub max_mm: f64,
    /// Heading, worst.
    pub max_deg: f64,
}

/// The errors of `pairs`; `None` if there are none.
pub(crate) fn pose_error(pairs: &[PosePair]) -> Option<PoseError> {
    if pairs.is_empty() {
        return None;
    }
    let count = pairs.len() as f64;
    let mut sum = PoseError::default();
    for pair in pairs {
        let (mm, deg) = (pair.error_mm(), pair.error_deg());
        sum.rms_mm += mm * mm / count;
        sum.rms_deg += deg * deg / count;
        sum.max_mm = sum.max_mm.max(mm);
        sum.max_deg = sum.max_deg.max(deg);
    }
    Some(PoseError {
        rms_mm: sum.rms_mm.sqrt(),
        rms_deg: sum.rms_deg.sqrt(),
        ..sum
    })
}

/// Value from which a cell counts as occupied: three quarters of the way from unknown to certain.
pub(crate) const OCCUPIED: u8 = 190;

/// Whether a cell is part of a wall as a person would see it: dark, and a ridge across the map
/// along x or y. tinySLAM draws walls as broad slopes, whose flanks are no walls.
pub(crate) fn is_wall(map: MapView<'_>, x: usize, y: usize) -> bool {
    let at = |dx: isize, dy: isize| {
        let cell = x.checked_add_signed(dx).zip(y.checked_add_signed(dy));
        cell.and_then(|(x, y)| map.get(x, y)).unwrap_or(127)
    };
    let here = at(0, 0);
    let ridge = |dx: isize, dy: isize| {
        here >= at(-dx, -dy)
            && here >= at(dx, dy)
            && here > at(-3 * dx, -3 * dy)
            && here > at(3 * dx, 3 * dy)
    };
    here >= OCCUPIED && (ridge(1, 0) || ridge(0, 1))
}

/// How map and world agree on walls.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WallOverlap {
    /// Share of the walls that an ideal lidar would have seen on the robot's way and that the map
    /// shows within one cell, or as many as are allowed.
    pub found: f64,
    /// Share of the map's wall cells that have a true wall within as many.
    pub right: f64,
}

impl WallOverlap {
    /// The worse of the two.
    pub fn least(&self) -> f64 {
        self.found.min(self.right)
    }
}

/// Reach of the ideal lidar, metres.
const REACH_M: f64 = 6.0;

/// A bit per cell of the map.
struct Cells {
    width: usize,
    height: usize,
    cell_m: f64,
    origin_m: [f64; 2],
    bits: Vec<bool>,
}

impl Cells {
    fn like(map: MapView<'_>) -> Self {
        let (width, height) = (map.width(), map.height());
        Self {
            width,
            height,
            cell_m: f64::from(map.cell_mm()) / 1000.0,
            origin_m: map.origin_mm().map(|mm| f64::from(mm) / 1000.0),
            bits: vec![false; width * height],
        }
    }

    fn mark(&mut self, place: Point) {
        let [x0, y0] = self.origin_m;
        let (x, y) = ((place.x - x0) / self.cell_m, (place.y - y0) / self.cell_m);
        let inside = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64;
        if inside {
            #[expect(clippy::cast_possible_truncation, reason = "inside the grid")]
            #[expect(clippy::cast_sign_loss, reason = "inside the grid")]
            let (x, y) = (x as usize, y as usize);
            self.bits[y * self.width + x] = true;
        }
    }

    fn iter(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let marked = self.bits.iter().enumerate().filter(|(_, bit)| **bit);
        marked.map(|(index, _)| (index % self.width, index / self.width))
    }

    /// Whether one is marked at most `reach` cells away along x and y.
    fn is_near(&self, x: usize, y: usize, reach: usize) -> bool {
        let ys = y.saturating_sub(reach)..=(y + reach).min(self.height - 1);
        ys.into_iter().any(|y| {
            let xs = x.saturating_sub(reach)..=(x + reach).min(self.width - 1);
            self.bits[y * self.width..][xs].contains(&true)
        })
    }
}

/// Compares the walls of `map` with those of the scene, as seen from `way`. A wall may be drawn one
/// cell from where it is, or `within_mm`.
pub(crate) fn wall_overlap(
    map: MapView<'_>,
    world: &World,
    way: &[TruePose],
    within_mm: Option<f64>,
) -> WallOverlap {
    let cells = within_mm.unwrap_or_default() / f64::from(map.cell_mm());
    #[expect(clippy::cast_possible_truncation, reason = "at most 1000")]
    #[expect(clippy::cast_sign_loss, reason = "not negative")]
    let reach = (cells as usize).max(1);
    let mut drawn = Cells::like(map);
    for y in 0..map.height() {
        for x in 0..map.width() {
            drawn.bits[y * drawn.width + x] = is_wall(map, x, y);
        }
    }
    let mut seen = Cells::like(map);
    let degrees = (0..360_u16).map(|degree| f64::from(degree).to_radians());
    let degrees = degrees.map(|angle| (angle, libm::sin(angle), libm::cos(angle)));
    let degrees: Vec<(f64, f64, f64)> = degrees.collect();
    for pose in way {
        for &(angle, sin, cos) in &degrees {
            if let Some(hit) = world
                .scene()
                .cast_ray(Instant::ZERO, pose.point(), angle, REACH_M)
            {
                let place = Point::new(pose.x + hit.distance * cos, pose.y + hit.distance * sin);
                seen.mark(place);
            }
        }
    }
    let mut solid = Cells::like(map);
    for fixture in world.scene().fixtures() {
        let step = solid.cell_m / 4.0;
        outline(&fixture.shape, step, |place| solid.mark(place));
    }
    WallOverlap {
        found: share(&seen, &drawn, reach),
        right: share(&drawn, &solid, reach),
    }
}

fn share(of: &Cells, near: &Cells, reach: usize) -> f64 {
    let (mut all, mut good) = (0_u32, 0_u32);
    for (x, y) in of.iter() {
        all += 1;
        good += u32::from(near.is_near(x, y, reach));
    }
    if all == 0 {
        0.0
    } else {
        f64::from(good) / f64::from(all)
    }
}

/// Calls `visit` with points along the outline, at most `step` metres apart.
pub(crate) fn outline(shape: &Shape, step: f64, mut visit: impl FnMut(Point)) {
    let mut line = |from: Point, to: Point| {
        let steps = (from.distance(to) / step).ceil().max(1.0);
        let mut done = 0.0;
        while done <= steps {
            let part = done / steps;
            visit(Point::new(
                from.x + (to.x - from.x) * part,
                from.y + (to.y - from.y) * part,
            ));
            done += 1.0;
        }
    };
    match shape {
        Shape::Wall { from, to } => line(*from, *to),
        Shape::Polygon { corners } => {
            for (index, corner) in corners.iter().enumerate() {
                line(*corner, corners[(index + 1) % corners.len()]);
            }
        }
        Shape::Circle { center, radius_m } => {
            let at = |degree: u16| {
                let angle = f64::from(degree).to_radians();
                let (sin, cos) = (libm::sin(angle), libm::cos(angle));
                Point::new(center.x + radius_m * cos, center.y + radius_m * sin)
            };
            for degree in (0..360).step_by(5) {
                line(at(degree), at(degree + 5));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use emulators::world::{BodyConfig, Scene};

    use super::*;

    fn pair(dx: f64, dtheta: f64) -> PosePair {
        let truth = TruePose::new(1.0, 1.0, 3.0);
        let estimate = TruePose::new(1.0 + dx, 1.0, 3.0 + dtheta);
        PosePair {
            at: Instant::ZERO,
            truth,
            estimate,
        }
    }

    /// 30 mm and 40 mm: the mean square is 1250. Headings of 3 and 3 + pi/2 lie on both sides of
    /// the seam at pi.
    #[test]
    fn errors_are_root_mean_squares() {
        let half_turn = core::f64::consts::FRAC_PI_2;
        let error = pose_error(&[pair(0.03, 0.0), pair(0.04, half_turn)]).expect("two pairs");
        assert!((error.rms_mm - 1250_f64.sqrt()).abs() < 1e-9);
        assert!((error.max_mm - 40.0).abs() < 1e-9);
        assert!((error.max_deg - 90.0).abs() < 1e-9);
        assert!((error.rms_deg - 4050_f64.sqrt()).abs() < 1e-9);
    }

    /// A wall along x at 0.55 m, drawn 30 mm farther up: three cells are too far for one, and near
    /// enough for 30 mm.
    #[test]
    fn a_wall_may_be_drawn_so_far_from_where_it_is() {
        let wall = Shape::Wall {
            from: Point::new(0.0, 0.555),
            to: Point::new(1.0, 0.555),
        };
        let scene = Scene::new([wall], Vec::new()).expect("one wall");
        let start = TruePose::new(0.5, 0.2, 0.0);
        let world = World::new(scene, BodyConfig::default(), start, 1).expect("room for it");
        let mut cells = vec![127; 100 * 100];
        cells[58 * 100..59 * 100].fill(255);
        let map = MapView::new(100, 10.0, [0.0; 2], &cells);
        let share = |within_mm| wall_overlap(map, &world, &[start], within_mm).least();
        assert_eq!([None, Some(29.0)].map(share), [0.0; 2]);
        assert_eq!(share(Some(30.0)), 1.0);
    }

    #[test]
    fn no_estimate_has_no_error() {
        assert_eq!(pose_error(&[]), None);
    }
}
