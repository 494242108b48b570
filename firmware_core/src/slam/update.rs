//! Drawing a scan into the map: free along each beam, then a hole of rising and falling values
//! around its end (seed report, map update; checked against the profile of the field code).
//!
//! ```text
//! 255            /\
//!               /  \         derr cells up to the hit, derr cells down to the end of the hole
//!   0 _________/    \
//!     robot       hit  end
//! ```

use super::settings::Rounding;
use crate::grid::OBSTACLE;

/// One ray, in cells, from the lidar to the end of the hole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ray {
    pub(super) from: (i32, i32),
    pub(super) hit: (i32, i32),
    pub(super) end: (i32, i32),
}

/// How strongly a ray is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Ink {
    /// Part of the new value, of 256.
    pub(super) weight: u16,
    pub(super) rounding: Rounding,
    /// Draw holes shorter than two cells as the fielded code on its processor would: not at all.
    pub(super) loses_short_holes: bool,
}

/// A line of cells: the long axis advances in every step, the short one when the error overflows.
struct Line {
    /// Index of the current cell.
    at: isize,
    long: isize,
    short: isize,
    error: i32,
    straight: i32,
    diagonal: i32,
}

impl Line {
    #[inline]
    fn step(&mut self) {
        let crosses = self.error > 0;
        self.at += self.long + if crosses { self.short } else { 0 };
        self.error += if crosses {
            self.diagonal
        } else {
            self.straight
        };
    }
}

/// Draws `ray` from its start up to its end or the map's edge; nothing if it starts outside.
#[expect(
    clippy::cast_possible_wrap,
    clippy::cast_possible_truncation,
    reason = "sizes <= 8191"
)]
pub(super) fn draw<const W: usize, const H: usize>(cells: &mut [[u8; W]; H], ray: &Ray, ink: Ink) {
    let (x, y) = ray.from;
    let (width, height) = (W as i32, H as i32);
    if x < 0 || x >= width || y < 0 || y >= height {
        return;
    }
    let (dx, dy) = (ray.end.0 - x, ray.end.1 - y);
    let steep = dy.abs() >= dx.abs();
    let (long, short) = if steep {
        (dy.abs(), dx.abs())
    } else {
        (dx.abs(), dy.abs())
    };
    let (x_step, y_step) = (dx.signum() as isize, dy.signum() as isize * W as isize);
    let mut line = Line {
        at: (y * width + x) as isize,
        long: if steep { y_step } else { x_step },
        short: if steep { x_step } else { y_step },
        error: 2 * short - long,
        straight: 2 * short,
        diagonal: 2 * (short - long),
    };
    let half_hole = if steep {
        (ray.end.1 - ray.hit.1).abs()
    } else {
        (ray.end.0 - ray.hit.0).abs()
    };
    // Room before the edge on each axis; along the short one, cells are left after `short_room`.
    let room = |at: i32, step: i32, size: i32| if step > 0 { size - 1 - at } else { at };
    let (x_room, y_room) = (room(x, dx, width), room(y, dy, height));
    let (long_room, short_room) = if steep {
        (y_room, x_room)
    } else {
        (x_room, y_room)
    };
    let steps = long
        .min(long_room)
        .min(steps_inside(long, short, short_room));
    let hole = Hole::new(long, half_hole, ink);
    let free_steps = hole.begins_after.clamp(-1, steps);
    let cells = cells.as_flattened_mut();
    for _ in 0..=free_steps {
        blend(cells, &line, 0, ink);
        line.step();
    }
    let mut value = Ramp::new(hole);
    for _ in (free_steps + 1)..=steps {
        blend(cells, &line, value.next(), ink);
        line.step();
    }
}

/// The hole at the end of a ray, along its long axis.
#[derive(Clone, Copy)]
struct Hole {
    /// Last step that is still free; negative if the hole begins at the robot.
    begins_after: i32,
    /// Steps from the hole's begin to the hit, and from the hit to its end.
    half: i32,
    /// Height of a step, and the remainder that is spread over the steps.
    rise: i32,
    rest: i32,
}

impl Hole {
    fn new(long: i32, half: i32, ink: Ink) -> Self {
        let peak = i32::from(OBSTACLE);
        let (half, rise, rest) = match half {
            0 if ink.loses_short_holes => (0, 0, 0),
            0 => (1, peak, 0),
            half => (half, peak / half, peak % half),
        };
        Self {
            begins_after: long - 2 * half,
            half,
            rise,
            rest,
        }
    }
}

/// Values along the hole: up to 255 at the hit and down again, the remainder of the division
/// spread as a line-drawing error.
struct Ramp {
    hole: Hole,
    step: i32,
    value: i32,
    error: i32,
}

impl Ramp {
    /// At the hole's begin, or at the robot if that lies within the hole.
    fn new(hole: Hole) -> Self {
        let mut ramp = Self {
            hole,
            step: 0,
            value: 0,
            error: hole.half / 2,
        };
        for _ in hole.begins_after..-1 {
            ramp.next();
        }
        ramp
    }

    #[inline]
    fn next(&mut self) -> u16 {
        let Hole {
            half, rise, rest, ..
        } = self.hole;
        if self.step < half {
            self.value += rise;
            self.error += rest;
            if self.error > half {
                self.value += 1;
                self.error -= half;
            }
        } else {
            self.value -= rise;
            self.error -= rest;
            if self.error < 0 {
                self.value -= 1;
                self.error += half;
            }
        }
        self.step += 1;
        u16::try_from(self.value.clamp(0, 255)).expect("clamped")
    }
}

#[inline]
fn blend(cells: &mut [u8], line: &Line, value: u16, ink: Ink) {
    let Some(cell) = usize::try_from(line.at)
        .ok()
        .and_then(|at| cells.get_mut(at))
    else {
        return;
    };
    let old = u16::from(*cell);
    let mixed = (256 - ink.weight) * old + ink.weight * value;
    let up = match ink.rounding {
        Rounding::Corrected if value > old => 255,
        _ => 0,
    };
    let [_, new] = (mixed + up).to_le_bytes();
    *cell = new;
}

/// Steps after which a line is still within `room` cells of its start along the short axis.
const fn steps_inside(long: i32, short: i32, room: i32) -> i32 {
    if short == 0 {
        i32::MAX
    } else {
        long * (2 * room + 1) / (2 * short)
    }
}
