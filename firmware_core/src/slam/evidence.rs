use super::matching::Placement;
use crate::grid::{Grid, UNKNOWN};
use crate::pose::Pose;

/// How a scan agrees with what the map already knows. Points on cells that were never drawn say
/// nothing, unless their beam runs through a known wall: a robot that looks into a new room is not
/// lost, one that looks through walls is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Evidence {
    /// Points on cells that look like wall.
    hits: u32,
    /// Points on cells that were seen free, or behind walls.
    misses: u32,
    /// All points.
    of: u32,
}

/// How much darker than unknown a cell is that was seen free.
const FREE_MARGIN: u8 = 20;
/// A cell that is surely wall.
const WALL: u8 = 200;
/// Eighths of a beam's length at which it is looked for walls.
const WAY: [i16; 3] = [4, 6, 7];

impl Evidence {
    /// Looks all points up.
    pub(super) fn of<const W: usize, const H: usize>(
        grid: &Grid<W, H>,
        points: &[[i16; 2]],
        pose: Pose,
    ) -> Self {
        let placement = Placement::new(pose, grid.resolution_mm());
        let value = |point| {
            let (x, y) = placement.cell(point);
            let at = usize::try_from(x).ok().zip(usize::try_from(y).ok());
            at.and_then(|(x, y)| grid.get(x, y)).unwrap_or(UNKNOWN)
        };
        let mut evidence = Self {
            of: super::count_u32(points.len()),
            ..Self::default()
        };
        for point in points {
            let end = value(*point);
            if end > UNKNOWN || (UNKNOWN - FREE_MARGIN..UNKNOWN).contains(&end) {
                evidence.hits += 1;
            } else if end < UNKNOWN
                || WAY
                    .iter()
                    .any(|part| value(point.map(|x| x / 8 * part)) > WALL)
            {
                evidence.misses += 1;
            }
        }
        evidence
    }

    /// Part of the telling points that agree, 0 to 1; 1 if less than a quarter tell anything.
    pub(super) fn agreement(&self) -> f32 {
        let telling = self.hits + self.misses;
        if telling * 4 < self.of {
            1.0
        } else {
            self.hits as f32 / telling.max(1) as f32
        }
    }

    /// Whether most points tell something.
    pub(super) const fn is_broad(&self) -> bool {
        (self.hits + self.misses) * 2 >= self.of
    }
}
