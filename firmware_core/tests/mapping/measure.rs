//! Figures of a run: pose errors, walls found.

use crate::world::{MOUNTING, Wall, World};
use firmware_core::grid::Grid;
use firmware_core::pose::{Pose, normalised};
use firmware_core::scan::Scan;
use firmware_core::slam::{Mapper, Outcome, Settings};

/// Errors of the believed pose over a run.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Errors {
    count: f64,
    squares_mm: f64,
    squares_rad: f64,
    pub(crate) worst_mm: f32,
    pub(crate) worst_deg: f32,
}

impl Errors {
    pub(crate) fn add(&mut self, truth: Pose, believed: Pose) {
        let mm = truth.position().distance_mm(believed.position());
        let angle = normalised(truth.heading - believed.heading).abs();
        self.count += 1.0;
        self.squares_mm += f64::from(mm * mm);
        self.squares_rad += f64::from(angle * angle);
        self.worst_mm = self.worst_mm.max(mm);
        self.worst_deg = self.worst_deg.max(angle.to_degrees());
    }

    pub(crate) fn rms_mm(&self) -> f64 {
        (self.squares_mm / self.count).sqrt()
    }

    pub(crate) fn rms_deg(&self) -> f64 {
        (self.squares_rad / self.count).sqrt().to_degrees()
    }
}

/// Method of making scans from turns of the lidar.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Sense {
    /// The correct method: motion within a turn is removed.
    #[default]
    Deskewed,
    /// The motion within the turn is kept.
    Raw,
    /// The report's first version. The mapper wakes every 200 ms, independently of the lidar's
    /// turn, and takes the content of the buffer: the newest beams from this turn, the others from
    /// the turn before. The two clocks differ by one per cent.
    Unsynchronised,
}

/// Beams by which the read position of the free-running task shifts each turn.
const DRIFT_BEAMS: usize = 4;

/// A mapper in a world, and the last odometry pose that it received.
pub(crate) struct Run<const W: usize = 300, const H: usize = 300> {
    pub(crate) world: World,
    pub(crate) mapper: Box<Mapper<W, H>>,
    pub(crate) errors: Errors,
    pub(crate) sense: Sense,
    seen: Pose,
    /// State of the free-running task: its read position, and the distances of the turn before.
    looks_at: usize,
    before: [u16; 360],
}

impl<const W: usize, const H: usize> Run<W, H> {
    pub(crate) fn new(world: World, settings: Settings) -> Self {
        let settings = Settings {
            start: world.truth(),
            ..settings
        };
        Self {
            world,
            mapper: Box::new(Mapper::new(settings)),
            errors: Errors::default(),
            sense: Sense::default(),
            seen: Pose::default(),
            looks_at: 0,
            before: [0; 360],
        }
    }

    /// The believed pose.
    pub(crate) fn pose(&self) -> Pose {
        self.mapper.pose()
    }

    /// Stands still for a second, so that motors and mapper settle.
    pub(crate) fn stop(&mut self) {
        self.world.command = [0.0; 2];
        self.steps(5);
    }

    /// A person pushes the robot for a second, by this many millimetres per millisecond.
    pub(crate) fn push_by(&mut self, [x, y]: [f64; 2]) {
        self.world.push = [x, y, 0.0];
        self.steps(5);
        self.world.push = [0.0; 3];
    }

    /// Advances this many turns of the lidar.
    pub(crate) fn steps(&mut self, count: u32) {
        for _ in 0..count {
            self.step();
        }
    }

    /// Passes one turn of the lidar through the mapper.
    pub(crate) fn step(&mut self) -> Outcome {
        self.world.turn();
        let scan = self.scan();
        self.before = self.world.assembler.turn().distances_mm;
        let reckoned = self.world.odometry.pose_at(scan.end);
        self.mapper.predict(self.seen.change_to(reckoned));
        self.seen = reckoned;
        let outcome = self.mapper.integrate(&scan, self.world.wheel_speeds());
        let took = 14_000 + u64::from(outcome.tries) * 26 + u64::from(outcome.points) * 3457 / 1000;
        self.mapper
            .search_time(core::time::Duration::from_micros(took));
        self.errors.add(self.world.truth(), outcome.pose);
        outcome
    }

    fn scan(&mut self) -> Scan {
        let turn = self.world.assembler.turn();
        match self.sense {
            Sense::Unsynchronised => {
                self.looks_at = (self.looks_at + DRIFT_BEAMS) % 360;
                let mut mixed = turn.clone();
                mixed.distances_mm[self.looks_at..].copy_from_slice(&self.before[self.looks_at..]);
                let part = u32::try_from(self.looks_at).expect("below 360");
                mixed.end = turn.start + (turn.end - turn.start) * part / 360;
                Scan::raw(&mixed, &MOUNTING)
            }
            Sense::Deskewed => self.world.scan(),
            Sense::Raw => Scan::raw(turn, &MOUNTING),
        }
    }

    /// Rests for ten turns, then drives the tour.
    pub(crate) fn tour(&mut self, points: &[[f64; 2]]) {
        for _ in 0..10 {
            self.step();
        }
        for point in points {
            let mut turns = 0;
            while !self.world.steer_to(*point) && turns < 600 {
                self.step();
                turns += 1;
            }
        }
    }
}

/// Whether a cell is a visible wall: high, and a ridge along x or y.
pub(crate) fn is_wall<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    ix: usize,
    iy: usize,
) -> bool {
    let at = |dx: i32, dy: i32| {
        let x = usize::try_from(ix as i32 + dx).ok();
        let y = usize::try_from(iy as i32 + dy).ok();
        x.zip(y).and_then(|(x, y)| grid.get(x, y)).unwrap_or(127)
    };
    let here = at(0, 0);
    let ridge = |dx: i32, dy: i32| {
        let (a, b) = (at(-3 * dx, -3 * dy), at(3 * dx, 3 * dy));
        here > a && here > b && here >= at(-dx, -dy) && here >= at(dx, dy)
    };
    here >= 190 && (ridge(1, 0) || ridge(0, 1))
}

/// Two shares: wall cells of the map within a cell and a half of a true wall; points on visible
/// true walls within this distance of a wall cell.
pub(crate) fn overlap<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    walls: &[Wall],
    tour: &[[f64; 2]],
) -> (f64, f64) {
    let near = 1.5 * f64::from(grid.resolution_mm());
    let (mut cells, mut right) = (0, 0);
    for iy in 0..H {
        for ix in 0..W {
            if !is_wall(grid, ix, iy) {
                continue;
            }
            cells += 1;
            let centre = grid.centre_of(ix, iy);
            let (x, y) = (f64::from(centre.x_mm), f64::from(centre.y_mm));
            right += usize::from(walls.iter().any(|wall| distance(*wall, x, y) <= near));
        }
    }
    let (mut points, mut found) = (0, 0);
    for [x0, y0, x1, y1] in walls {
        let steps = (libm::hypot(x1 - x0, y1 - y0) / 10.0).ceil();
        for step in 0..steps as usize {
            let share = (step as f64 + 0.5) / steps;
            let (x, y) = (x0 + (x1 - x0) * share, y0 + (y1 - y0) * share);
            let seen = tour.iter().any(|[tx, ty]| {
                let way = libm::hypot(x - tx, y - ty);
                crate::world::cast(walls, *tx, *ty, libm::atan2(y - ty, x - tx)) > way - 1.0
            });
            if !seen {
                continue;
            }
            points += 1;
            let res = f64::from(grid.resolution_mm());
            let (cx, cy) = ((x / res).floor() as i32, (y / res).floor() as i32);
            found += usize::from((-1..=1).any(|dy| {
                (-1..=1).any(|dx| {
                    let x = usize::try_from(cx + dx).unwrap_or(usize::MAX);
                    let y = usize::try_from(cy + dy).unwrap_or(usize::MAX);
                    x < W && y < H && is_wall(grid, x, y)
                })
            }));
        }
    }
    (
        f64::from(right as u32) / f64::from(cells.max(1)),
        f64::from(found as u32) / f64::from(points.max(1) as u32),
    )
}

fn distance([x0, y0, x1, y1]: Wall, x: f64, y: f64) -> f64 {
    let (ex, ey) = (x1 - x0, y1 - y0);
    let along = (((x - x0) * ex + (y - y0) * ey) / (ex * ex + ey * ey)).clamp(0.0, 1.0);
    libm::hypot(x - x0 - along * ex, y - y0 - along * ey)
}
