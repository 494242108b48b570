//! The PC's maps: cells, walls, and the last roadmap.

use alloc::collections::{BTreeMap, VecDeque};
use alloc::vec::Vec;

use super::Failure;
use super::config::{Following, Mapping, NextView, PcConfig, Planning};
use super::drive::Stretch;
use super::link::Sight;
use super::saved;
use crate::cell_map::{Cell, CellMap};
use crate::frontier;
use crate::grid::{FREE, OBSTACLE, UNKNOWN};
use crate::growing_map::NotWritten;
use crate::local_map::{CELL_MM, local_map};
use crate::localise::{Estimate, Votes};
use crate::map_view::MapView;
use crate::pose::{Point, Pose};
use crate::prm::{Dice, plan, plan_once};
use crate::walls::Walls;

/// Margin around the known cells.
const MARGIN: u8 = 2;
/// The fielded program's margin: five around each local map, and five each time the map grows.
const MARGIN_WIDE: u8 = 10;
/// Maximum size, 102.4 m square.
const CELLS_MAX: usize = 1_024 * 1_024;
/// Maximum distance, mm, that 8 bits hold in steps of 10 cm.
const EIGHT_BITS_MM: f32 = 12_700.0;

impl From<NotWritten> for Failure {
    fn from(_: NotWritten) -> Self {
        Self::TooLarge
    }
}

/// Maximum ratio of clearings to sightings of an obstacle.
const DOUBTS: u8 = 2;

/// Number of sightings of a cell as an obstacle, and as free.
#[derive(Clone, Copy, Debug, Default)]
struct Evidence {
    wall: u8,
    free: u8,
}

impl Evidence {
    /// The value of a cell after another look.
    fn after(&mut self, value: u8) -> u8 {
        match value {
            OBSTACLE => self.wall = self.wall.saturating_add(1),
            _ => self.free = self.free.saturating_add(1),
        }
        match self.free > self.wall.saturating_mul(DOUBTS) || self.wall == 0 {
            true => FREE,
            false => OBSTACLE,
        }
    }
}

/// Maps, walls and paths.
#[derive(Clone, Debug)]
pub(super) struct Atlas {
    mapping: Mapping,
    planning: Planning,
    following: Following,
    pub(super) view: NextView,
    pub(super) votes: Votes,
    pub(super) global: CellMap,
    evidence: BTreeMap<Cell, Evidence>,
    pub(super) local: Option<CellMap>,
    pub(super) walls: Walls,
    pub(super) dice: Dice,
    pub(super) vertices: Vec<Point>,
    pub(super) edges: Vec<(usize, usize)>,
    pub(super) way: Vec<Point>,
    pub(super) estimate: Option<Estimate>,
    pub(super) ambiguous: u64,
    pub(super) views: u64,
}

impl Atlas {
    pub(super) fn new(config: &PcConfig) -> Self {
        let margin = if config.mapping.wide_margin {
            MARGIN_WIDE
        } else {
            MARGIN
        };
        Self {
            mapping: config.mapping,
            planning: config.planning,
            following: config.following,
            view: config.view,
            votes: config.votes,
            global: CellMap::new(CELL_MM, margin, CELLS_MAX),
            evidence: BTreeMap::new(),
            local: None,
            walls: Walls::default(),
            dice: Dice::new(config.seed),
            vertices: Vec::new(),
            edges: Vec::new(),
            way: Vec::new(),
            estimate: None,
            ambiguous: 0,
            views: 0,
        }
    }

    /// Clears all maps, walls and paths.
    pub(super) fn clear(&mut self) {
        let margin = if self.mapping.wide_margin {
            MARGIN_WIDE
        } else {
            MARGIN
        };
        self.global = CellMap::new(CELL_MM, margin, CELLS_MAX);
        self.evidence.clear();
        self.local = None;
        self.walls = Walls::default();
        self.vertices.clear();
        self.edges.clear();
        self.way.clear();
    }

    /// Loads a saved map; its walls are only as accurate as its cells.
    pub(super) fn load(&mut self, map: &MapView<'_>) -> Result<(), NotWritten> {
        self.clear();
        let [x, y] = map.origin_mm();
        let half = map.cell_mm() / 2.0;
        let low = self.global.cell_of(Point::new(x + half, y + half))?;
        for (row, cells) in (low.y..).zip(map.rows()) {
            for (column, value) in (low.x..).zip(cells) {
                let cell = Cell::new(column, row);
                self.global.set(cell, *value)?;
                if *value != UNKNOWN {
                    self.evidence.entry(cell).or_default().after(*value);
                }
            }
        }
        Ok(())
    }

    /// Takes the faces of the map's cells for known walls: after [`load`](Self::load) the pose is
    /// corrected by them, to about half a cell.
    pub(super) fn trust_cells(&mut self) {
        self.walls.add_faces(saved::faces(&self.global));
    }

    /// Pose of the robot by the known walls.
    pub(super) fn corrected(&self, sight: &Sight) -> Pose {
        match self.mapping.odometry_alone {
            true => sight.pose,
            false => self.walls.corrected(sight.pose, &sight.lines),
        }
    }

    /// Pose of a robot that has rolled by an unknown distance.
    pub(super) fn recovered(&self, sight: &Sight) -> Pose {
        match self.mapping.odometry_alone {
            true => sight.pose,
            false => self.walls.recovered(sight.pose, &sight.lines),
        }
    }

    /// Enters the scan `sight`, taken from `pose`, into the map.
    pub(super) fn add(&mut self, pose: Pose, sight: &Sight) -> Result<(), NotWritten> {
        let limited = |mm: f32| match self.mapping.eight_bits {
            true => mm.clamp(-EIGHT_BITS_MM, EIGHT_BITS_MM),
            false => mm,
        };
        let placed = Pose::new(limited(pose.x_mm), limited(pose.y_mm), pose.heading);
        let local = local_map(placed, &sight.lines)?;
        match self.mapping.odometry_alone {
            true => self.global.merge(&local)?,
            false => self.weigh(&local)?,
        }
        self.local = Some(local);
        self.walls.add(placed, &sight.lines);
        self.views += 1;
        Ok(())
    }

    /// Enters the cells of a look, each weighted by all earlier looks: a wall from one bad look
    /// must not block the path forever.
    fn weigh(&mut self, local: &CellMap) -> Result<(), NotWritten> {
        let known = local.iter().filter(|(_, value)| *value != UNKNOWN);
        for (cell, value) in known {
            let value = self.evidence.entry(cell).or_default().after(value);
            self.global.set(cell, value)?;
        }
        Ok(())
    }

    /// The course's choice of the next view.
    pub(super) fn random_view(&mut self) -> Option<Cell> {
        frontier::random_view(&self.global, &self.global.eroded(), &mut self.dice)
    }

    /// Whether the program sends the robot the pose that the walls give.
    pub(super) fn corrects(&self) -> bool {
        !self.mapping.odometry_alone && !self.walls.is_empty()
    }

    /// The points of a path over `map`, without the start; `None` if no path leads there. The
    /// roadmap can be read afterwards.
    pub(super) fn plan(&mut self, map: &CellMap, from: Pose, to: Point) -> Option<VecDeque<Point>> {
        let start = map.cell_of(from.position()).ok()?;
        let end = map.cell_of(to).ok()?;
        let (roadmap, way) = match self.planning {
            Planning::Retried => plan(map, start, end, &mut self.dice),
            Planning::Once => plan_once(map, start, end, &mut self.dice),
        };
        let centre = |cell: &Cell| map.centre_of(*cell);
        self.vertices = roadmap.vertices.iter().map(centre).collect();
        self.edges = roadmap.edges;
        let way = way?;
        let between = way.get(1..way.len().saturating_sub(1)).unwrap_or(&[]);
        let via = between.iter().map(centre);
        self.way = core::iter::once(from.position())
            .chain(via)
            .chain([to])
            .collect();
        Some(self.way.iter().skip(1).copied().collect())
    }

    /// The part of `way` that the robot at `from` drives before it looks around; the rest stays in
    /// `way`.
    pub(super) fn stretch(
        &self,
        from: Pose,
        way: &mut VecDeque<Point>,
        heading: Option<f32>,
    ) -> Stretch {
        match self.corrects() {
            true => Stretch::cut(self.following, from.position(), way, heading),
            false => Stretch::whole(self.following, way, heading),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::local_map::Segment;

    /// A wall cell with one sighting is free after three clearings, one with two sightings after
    /// five; another sighting makes it a wall again.
    #[test]
    fn what_is_looked_through_is_no_wall() {
        let mut seen = Evidence::default();
        let values = [OBSTACLE, FREE, FREE, FREE, OBSTACLE, FREE, FREE];
        let told = values.map(|value| seen.after(value));
        assert_eq!(told[..5], [OBSTACLE, OBSTACLE, OBSTACLE, FREE, OBSTACLE]);
        assert_eq!(told[5..], [OBSTACLE, FREE]);
        assert_eq!(Evidence::default().after(FREE), FREE);
    }

    /// A cleared map has no cells, no evidence, no walls and no path.
    #[test]
    fn a_place_that_is_forgotten_is_unknown() {
        let mut atlas = Atlas::new(&PcConfig::default());
        let cells = [FREE, OBSTACLE, UNKNOWN, FREE];
        let map = MapView::new(2, CELL_MM, [0.0; 2], &cells);
        atlas.load(&map).expect("small");
        assert_eq!(atlas.evidence.len(), 3);
        let value = |atlas: &Atlas, x, y| {
            let mut cells = atlas.global.iter();
            cells
                .find(|(cell, _)| *cell == Cell::new(x, y))
                .map(|it| it.1)
        };
        assert_eq!(
            [value(&atlas, 0, 0), value(&atlas, 1, 0)],
            [Some(FREE), Some(OBSTACLE)]
        );
        assert_eq!(
            [value(&atlas, 0, 1), value(&atlas, 1, 1)],
            [Some(UNKNOWN), Some(FREE)]
        );
        // Corners with a small error lie in the same cells.
        let map = MapView::new(2, CELL_MM, [99.9, -100.1], &cells);
        atlas.load(&map).expect("small");
        assert_eq!(
            [value(&atlas, 1, -1), value(&atlas, 2, -1)],
            [Some(FREE), Some(OBSTACLE)]
        );
        atlas.way = alloc::vec![Point::new(1.0, 2.0)];
        atlas.vertices = atlas.way.clone();
        atlas.edges = alloc::vec![(0, 0)];
        atlas.clear();
        assert!(atlas.evidence.is_empty() && atlas.way.is_empty() && atlas.local.is_none());
        assert!(atlas.vertices.is_empty() && atlas.edges.is_empty() && !atlas.corrects());
        assert!(atlas.global.iter().all(|(_, value)| value == UNKNOWN));
    }

    /// A wall a metre ahead, seen from 13 m to either side. A program with 8 bits limits its own
    /// position to 12.7 m.
    #[test]
    fn eight_bits_tell_no_more_than_12_7_m() {
        let wall = |eight_bits: bool, at: [f32; 2]| {
            let mut config = PcConfig::default();
            config.mapping.eight_bits = eight_bits;
            let mut atlas = Atlas::new(&config);
            let pose = Pose::new(at[0], at[1], 0.0);
            let line = Segment::new(Point::new(1_050.0, -500.0), Point::new(1_050.0, 500.0));
            let sight = Sight::of(pose, alloc::vec![line]);
            atlas.add(pose, &sight).expect("near");
            assert_eq!(atlas.views, 1);
            let cells = atlas.global.iter();
            let mut walls = cells.filter(|(_, value)| *value == OBSTACLE);
            walls.next().map(|(cell, _)| cell.x)
        };
        assert_eq!(wall(true, [12_600.0, 50.0]), Some(136));
        assert_eq!(wall(true, [13_000.0, 50.0]), Some(137));
        assert_eq!(wall(true, [-13_000.0, 50.0]), Some(-117));
        assert_eq!(wall(false, [13_000.0, 50.0]), Some(140));
        assert_eq!(wall(false, [-13_000.0, 50.0]), Some(-120));
    }
}
