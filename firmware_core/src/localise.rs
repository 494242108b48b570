//! Localisation of a robot on a known map from its scan of walls. For the part of a robot's program
//! that runs on a PC; feature `host`.
//!
//! The scan is placed on the map at each of 360 headings and each free cell. The score counts
//! scanned walls on walls of the map, minus walls of the map in the robot's line of sight. Only few
//! cells are checked, those of walls in whole rows, so a map of 128 x 128 cells takes a fraction of
//! a second.

use alloc::vec::Vec;
use core::f32::consts::TAU;

use crate::cell_map::{Cell, CellMap};
use crate::grid::{FREE, OBSTACLE};
use crate::local_map::{CELL_MM, Segment};
use crate::pose::{Point, Pose, PoseChange, normalised, sin_cos};

/// Number of headings tried, one a degree.
pub const HEADINGS: usize = 360;
/// Above this ratio of the second-best score to the best, the position is not certain.
pub const AMBIGUOUS_RATIO: f32 = 0.9;
/// A second position is different if it lies farther away than this, in cells.
const APART_CELLS: f32 = 3.0;
/// A second position is also different if its heading differs by more than this, in degrees.
const APART_DEG: usize = 30;
/// The heading is the mean of the votes within these degrees of the best one.
const MEAN_DEG: usize = 10;
/// Spacing of points that a beam passes, mm, and their minimum distance before a wall.
const THROUGH_MM: f32 = 200.0;
const BEFORE_MM: f32 = 200.0;
/// Maximum distance of a wall that is used: the lidar's range, in cells.
const REACH: i32 = 60;
/// A position with at most 1 / this number of the walls matched is ruled out at once: its free line
/// of sight is then not checked.
const FEW_PARTS: i32 = 2;
/// The same limit as a score: a position that fits again later has at least this score.
const FEW: u8 = 100;
/// Weight of a wall, and of a cell beside one.
const ON_WALL: i16 = 2;
const BESIDE: i16 = 1;

/// Rule that combines the scores of all headings to one position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Votes {
    /// The best score of all wins; the headings that fit there nearly as well give the heading.
    /// Votes of all headings find fewer positions, because most votes are for wrong ones: one look
    /// finds 39 of 40 places with this rule, 32 with added and 29 with multiplied votes.
    #[default]
    Best,
    /// Each heading votes for its best cell with the score there, and with less for the eight
    /// around it; votes are added: the course's report.
    Added,
    /// As [`Added`](Self::Added), but votes multiply, and the heading is that of the single best
    /// match, at any cell: the fielded program.
    Multiplied,
}

/// Estimated pose of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The pose with the most votes; in the middle of a cell.
    pub pose: Pose,
    /// Quality of the fit, at most 1.
    pub score: f32,
    /// The best different pose.
    pub second: Pose,
    /// Distance of the second pose, in cells.
    pub second_cells: f32,
    /// Score of the second pose divided by the first one's.
    pub ratio: f32,
}

impl Estimate {
    /// Whether the second pose fits nearly as well.
    pub fn is_ambiguous(&self) -> bool {
        self.ratio > AMBIGUOUS_RATIO
    }
}

/// Scores of all positions and headings.
#[derive(Clone, Debug, PartialEq)]
pub struct Matches {
    low: Cell,
    width: usize,
    height: usize,
    /// Index of each free cell in the scores.
    places: Vec<Option<u32>>,
    free: Vec<Cell>,
    /// Scores of all headings for each position; 255 is 1.
    scores: Vec<u8>,
}

impl Matches {
    /// Scores of `lines`, in the robot's frame, everywhere on `map`; `None` if there are no lines,
    /// or no cell is free.
    pub fn new(map: &CellMap, lines: &[Segment]) -> Option<Self> {
        let mut matches = Self::of(map)?;
        let walls = Walls::new(map);
        let mut sums = alloc::vec![0_i16; matches.width * matches.height];
        for heading in 0..HEADINGS {
            let seen = Seen::new(lines, heading);
            let most = i32::try_from(seen.walls.len()).ok()? * i32::from(ON_WALL);
            if most == 0 {
                return None;
            }
            sums.fill(0);
            for cell in &seen.walls {
                walls.add(*cell, &mut sums, matches.width);
            }
            for (place, cell) in matches.free.iter().enumerate() {
                let mut sum = matches
                    .index(*cell)
                    .map_or(0, |index| i32::from(sums[index]));
                if sum * FEW_PARTS > most {
                    sum -= walls.crossed(*cell, &seen.through);
                }
                let score = (sum * 255 / most).clamp(0, 255);
                matches.scores[place * HEADINGS + heading] = u8::try_from(score).unwrap_or(0);
            }
        }
        Some(matches)
    }

    fn of(map: &CellMap) -> Option<Self> {
        let (width, height) = map.size();
        let (mut places, mut free) = (Vec::new(), Vec::new());
        for (cell, value) in map.iter() {
            let place = u32::try_from(free.len()).ok();
            places.push(place.filter(|_| value == FREE));
            if value == FREE {
                free.push(cell);
            }
        }
        let scores = alloc::vec![0; free.len() * HEADINGS];
        let matches = Self {
            low: map.low(),
            width: usize::try_from(width).ok()?,
            height: usize::try_from(height).ok()?,
            places,
            free,
            scores,
        };
        (!matches.free.is_empty()).then_some(matches)
    }

    fn index(&self, cell: Cell) -> Option<usize> {
        let along = |at: i32, low: i32, size: usize| {
            let along = usize::try_from(at - low).ok();
            along.filter(|along| *along < size)
        };
        let x = along(cell.x, self.low.x, self.width)?;
        Some(along(cell.y, self.low.y, self.height)? * self.width + x)
    }

    fn place(&self, cell: Cell) -> Option<usize> {
        let place = self.places[self.index(cell)?]?;
        usize::try_from(place).ok()
    }

    fn score(&self, place: usize, heading: usize) -> u8 {
        self.scores[place * HEADINGS + heading]
    }

    /// Combines these matches with `later` ones, taken after the robot moved by `change`: poses
    /// must fit both times.
    #[must_use]
    pub fn then(&self, change: PoseChange, later: &Self) -> Self {
        let mut both = later.clone();
        #[expect(clippy::cast_possible_truncation, reason = "at most 360")]
        let turn = libm::roundf(change.turn.to_degrees()) as i32;
        for heading in 0..HEADINGS {
            let before = turned_by(heading, -turn);
            let (sin, cos) = sin_cos((before as f32).to_radians());
            let shift = [
                cos * change.forward_mm - sin * change.left_mm,
                sin * change.forward_mm + cos * change.left_mm,
            ];
            #[expect(clippy::cast_possible_truncation, reason = "metres")]
            let [x, y] = shift.map(|mm| libm::roundf(mm / CELL_MM) as i32);
            for (place, cell) in later.free.iter().enumerate() {
                let new = later.score(place, heading);
                let old = match new > FEW {
                    true => self.best_near(Cell::new(cell.x - x, cell.y - y), before),
                    false => 0,
                };
                let product = u16::from(old) * u16::from(new) / 255;
                let product = u8::try_from(product).unwrap_or(u8::MAX);
                both.scores[place * HEADINGS + heading] = product;
            }
        }
        both
    }

    /// The best score near a position: odometry and rounding are not exact.
    fn best_near(&self, cell: Cell, heading: usize) -> u8 {
        let places = cell.block().filter_map(|near| self.place(near));
        let turns = [-2, 0, 2].map(|turn| turned_by(heading, turn));
        places
            .flat_map(|place| turns.map(|heading| self.score(place, heading)))
            .max()
            .unwrap_or(0)
    }

    /// The most likely pose of the robot.
    pub fn estimate(&self, votes: Votes) -> Option<Estimate> {
        let peaks: Vec<(usize, u8)> = (0..HEADINGS)
            .map(|heading| {
                let scored = (0..self.free.len()).map(|place| (place, self.score(place, heading)));
                scored.fold((0, 0), |best, one| if one.1 > best.1 { one } else { best })
            })
            .collect();
        let best = (0..HEADINGS).max_by_key(|heading| peaks[*heading].1)?;
        let (winner, heading) = match votes {
            Votes::Best => {
                let winner = peaks[best].0;
                (winner, mean(best, |heading| self.fit(winner, heading)))
            }
            Votes::Added => {
                let winner = self.winner(&peaks, votes);
                let vote = |heading: usize| self.vote(peaks[heading], winner);
                let order = |one: &usize, other: &usize| vote(*one).total_cmp(&vote(*other));
                let best = (0..HEADINGS).max_by(order)?;
                (winner, mean(best, vote))
            }
            Votes::Multiplied => (self.winner(&peaks, votes), (best as f32).to_radians()),
        };
        let pose = self.pose(winner, heading);
        #[expect(clippy::cast_possible_truncation, reason = "at most 360")]
        #[expect(clippy::cast_sign_loss, reason = "brought above 0")]
        let degrees = libm::roundf(heading.to_degrees() + 360.0) as usize % HEADINGS;
        let score = [-1, 0, 1].map(|turn| self.score(winner, turned_by(degrees, turn)));
        let score = score.into_iter().max()?.max(1);
        let (second, place, other) = self.second(winner, degrees);
        Some(Estimate {
            pose,
            score: f32::from(score) / 255.0,
            second: self.pose(place, (other as f32).to_radians()),
            second_cells: self.free[place].distance(self.free[winner]),
            ratio: f32::from(second) / f32::from(score),
        })
    }

    fn winner(&self, peaks: &[(usize, u8)], votes: Votes) -> usize {
        let mut belief = alloc::vec![1.0_f32; self.free.len()];
        for (peak, score) in peaks {
            let score = f32::from(*score) / 255.0;
            for cell in self.free[*peak].block() {
                let vote = score * kernel(self.free[*peak], cell);
                if let Some(place) = self.place(cell) {
                    match votes {
                        Votes::Multiplied => belief[place] *= 1.0 + vote,
                        _ => belief[place] += vote,
                    }
                }
            }
        }
        let order = |one: &usize, other: &usize| belief[*one].total_cmp(&belief[*other]);
        (0..belief.len()).max_by(order).unwrap_or(0)
    }

    /// Fit of a heading at a position, scaled such that only good fits count.
    fn fit(&self, place: usize, heading: usize) -> f32 {
        libm::powf(f32::from(self.score(place, heading)) / 255.0, 4.0)
    }

    /// A heading's vote for `winner`.
    fn vote(&self, (peak, score): (usize, u8), winner: usize) -> f32 {
        f32::from(score) * kernel(self.free[peak], self.free[winner])
    }

    /// The best score that differs from the winner, with its position and heading.
    fn second(&self, winner: usize, degrees: usize) -> (u8, usize, usize) {
        let mut best = (0, winner, degrees);
        for (place, cell) in self.free.iter().enumerate() {
            let is_elsewhere = cell.distance(self.free[winner]) > APART_CELLS;
            for heading in 0..HEADINGS {
                let score = self.score(place, heading);
                if score > best.0 && (is_elsewhere || apart(heading, degrees) > APART_DEG) {
                    best = (score, place, heading);
                }
            }
        }
        best
    }

    fn pose(&self, place: usize, heading: f32) -> Pose {
        let cell = self.free[place];
        let middle = |along: i32| (along as f32 + 0.5) * CELL_MM;
        Pose::new(middle(cell.x), middle(cell.y), normalised(heading % TAU))
    }
}

/// The weighted circular mean of the headings near the best one. Other headings are left out,
/// because a square room gives four clusters.
fn mean(best: usize, weight: impl Fn(usize) -> f32) -> f32 {
    let near = (0..HEADINGS).filter(|heading| apart(*heading, best) <= MEAN_DEG);
    let (sin, cos) = near.fold((0.0, 0.0), |(x, y), heading| {
        let (sin, cos) = sin_cos((heading as f32).to_radians());
        (x + sin * weight(heading), y + cos * weight(heading))
    });
    libm::atan2f(sin, cos)
}

/// Weight of a vote for `peak` at `cell`.
fn kernel(peak: Cell, cell: Cell) -> f32 {
    match ((peak.x - cell.x).abs(), (peak.y - cell.y).abs()) {
        (0, 0) => 1.0,
        (0, 1) | (1, 0) => 0.75,
        (1, 1) => 0.5,
        _ => 0.0,
    }
}

fn turned_by(heading: usize, degrees: i32) -> usize {
    let heading = i32::try_from(heading).unwrap_or(0) + degrees;
    usize::try_from(heading.rem_euclid(360)).unwrap_or(0)
}

fn apart(one: usize, other: usize) -> usize {
    let apart = one.abs_diff(other);
    apart.min(HEADINGS - apart)
}

/// Observation of a robot in the middle of cell (0, 0): cells of walls, and cells that beams pass
/// through.
struct Seen {
    walls: Vec<Cell>,
    through: Vec<Cell>,
}

impl Seen {
    fn new(lines: &[Segment], heading: usize) -> Self {
        let robot = Pose::new(0.0, 0.0, (heading as f32).to_radians());
        let turned = || lines.iter().map(|line| line.to_world(robot));
        let on_walls = turned().flat_map(|line| line.points(CELL_MM / 4.0));
        let before = turned().flat_map(|line| line.points(THROUGH_MM));
        let through = before.flat_map(|target| {
            let far = target.distance_mm(Point::default());
            let part = (far - BEFORE_MM).max(0.0) / far.max(1.0);
            let end = Point::new(target.x_mm * part, target.y_mm * part);
            Segment::new(Point::default(), end).points(THROUGH_MM)
        });
        Self {
            walls: cells(on_walls),
            through: cells(through),
        }
    }
}

/// The cells of points, each once.
fn cells(points: impl Iterator<Item = Point>) -> Vec<Cell> {
    let along = |mm: f32| libm::floorf(mm / CELL_MM + 0.5);
    let cell = |point: Point| {
        let [x, y] = [along(point.x_mm), along(point.y_mm)];
        let is_near = x.abs() < REACH as f32 && y.abs() < REACH as f32;
        #[expect(clippy::cast_possible_truncation, reason = "less than 60")]
        is_near.then(|| Cell::new(x as i32, y as i32))
    };
    let mut cells: Vec<Cell> = points.filter_map(cell).collect();
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// The map's walls, with a margin of empty cells.
struct Walls {
    /// Weights of walls, which extend a little beyond the walls.
    weights: Vec<i16>,
    low: Cell,
    width: usize,
}

impl Walls {
    fn new(map: &CellMap) -> Self {
        let (width, height) = map.size();
        let size = |cells: i32| usize::try_from(cells + 2 * REACH).unwrap_or(0);
        let low = map.low();
        let (width, height) = (size(width), size(height));
        let mut walls = Self {
            weights: alloc::vec![0; width * height],
            low: Cell::new(low.x - REACH, low.y - REACH),
            width,
        };
        for (cell, _) in map.iter().filter(|(_, value)| *value == OBSTACLE) {
            for near in cell.neighbours() {
                let at = walls.index(near);
                walls.weights[at] = walls.weights[at].max(BESIDE);
            }
            let at = walls.index(cell);
            walls.weights[at] = ON_WALL;
        }
        walls
    }

    /// Index of a cell; the cell must be nearer to the map than `REACH`.
    fn index(&self, cell: Cell) -> usize {
        let along = |at: i32, low: i32| usize::try_from(at - low).unwrap_or(0);
        along(cell.y, self.low.y) * self.width + along(cell.x, self.low.x)
    }

    /// Adds the weights at `offset` from each cell of the map to its sum.
    fn add(&self, offset: Cell, sums: &mut [i16], width: usize) {
        let first = Cell::new(self.low.x + REACH + offset.x, self.low.y + REACH + offset.y);
        let first = self.index(first);
        for (row, sums) in sums.chunks_exact_mut(width).enumerate() {
            let from = first + row * self.width;
            for (sum, weight) in sums.iter_mut().zip(&self.weights[from..from + width]) {
                *sum += weight;
            }
        }
    }

    /// The weights of walls at these offsets from `place`.
    fn crossed(&self, place: Cell, offsets: &[Cell]) -> i32 {
        let offsets = offsets.iter();
        let at = offsets.map(|off| self.index(Cell::new(place.x + off.x, place.y + off.y)));
        let on_walls = at.filter(|at| self.weights[*at] == ON_WALL).count();
        i32::try_from(on_walls).unwrap_or(0) * i32::from(ON_WALL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(map: &mut CellMap, low: Cell, width: i32, height: i32) {
        for y in 0..=height {
            for x in 0..=width {
                let is_wall = [0, width].contains(&x) || [0, height].contains(&y);
                let value = if is_wall { OBSTACLE } else { FREE };
                map.set(Cell::new(low.x + x, low.y + y), value)
                    .expect("fits");
            }
        }
    }

    /// The walls of a room of 3 m by 2 m around a robot 1 m from its left and its lower wall, by
    /// hand; it looks along the longer side.
    fn walls() -> Vec<Segment> {
        let corners = [
            (-1e3, -1e3),
            (2e3, -1e3),
            (2e3, 1e3),
            (-1e3, 1e3),
            (-1e3, -1e3),
        ];
        let corners = corners.map(|(x, y)| Point::new(x, y));
        corners
            .windows(2)
            .map(|pair| Segment::new(pair[0], pair[1]))
            .collect()
    }

    /// A room of 3 m by 2 m looks the same turned by half.
    #[test]
    fn a_room_that_looks_the_same_both_ways_is_ambiguous() {
        let mut map = CellMap::new(CELL_MM, 0, 10_000);
        room(&mut map, Cell::new(5, 5), 30, 20);
        let matches = Matches::new(&map, &walls()).expect("walls");
        let estimate = matches.estimate(Votes::Best).expect("places");
        assert!(estimate.is_ambiguous(), "{estimate:?}");
        // The walls are in columns 5 and 35 and in rows 5 and 25. The cell 1 m from two of them is
        // (15, 15), or, turned by half, (25, 15).
        let turned = [estimate.pose, estimate.second].map(|pose| pose.heading.abs() > 1.5);
        let places = [estimate.pose, estimate.second].map(|pose| (pose.x_mm, pose.y_mm));
        let truth = places[usize::from(turned[0])];
        assert_ne!(turned[0], turned[1]);
        assert!((truth.0 - 1_550.0).abs() <= 100.0 && (truth.1 - 1_550.0).abs() <= 100.0);
    }

    /// A robot that knows to be in the left half drives half a metre ahead. Two positions fit then;
    /// the reachable one is chosen.
    #[test]
    fn what_was_seen_before_counts() {
        let mut map = CellMap::new(CELL_MM, 0, 10_000);
        room(&mut map, Cell::new(5, 5), 30, 20);
        let mut left = map.clone();
        for cell in map.iter().map(|(cell, _)| cell).filter(|cell| cell.x > 18) {
            let value = if map.is_free(cell) { 127 } else { OBSTACLE };
            left.set(cell, value).expect("inside");
        }
        let ahead = Pose::new(500.0, 0.0, 0.0);
        let from_behind: Vec<_> = walls().iter().map(|wall| wall.to_world(ahead)).collect();
        let known = Matches::new(&left, &from_behind).expect("walls");
        let later = Matches::new(&map, &walls()).expect("walls");
        let change = PoseChange {
            forward_mm: 500.0,
            ..PoseChange::NONE
        };
        let estimate = known.then(change, &later).estimate(Votes::Best);
        let estimate = estimate.expect("places");
        assert!(!estimate.is_ambiguous(), "{estimate:?}");
        let off = estimate
            .pose
            .position()
            .distance_mm(Point::new(1_550.0, 1_550.0));
        assert!(
            off < 150.0 && estimate.pose.heading.abs() < 0.05,
            "{estimate:?}"
        );
    }

    /// A second, smaller room is a different position; without lines or free cells there is no
    /// result.
    #[test]
    fn nothing_is_found_where_nothing_is_to_be_seen() {
        let mut map = CellMap::new(CELL_MM, 0, 10_000);
        assert_eq!(Matches::new(&map, &walls()), None);
        room(&mut map, Cell::new(0, 0), 10, 10);
        assert_eq!(Matches::new(&map, &[]), None);
    }

    #[test]
    fn headings_are_a_circle() {
        let turned = [(0, -1), (359, 2), (90, 30)].map(|(from, by)| turned_by(from, by));
        assert_eq!(turned, [359, 1, 120]);
        let angles = [(350, 10), (10, 350), (0, 180), (5, 15)].map(|(one, two)| apart(one, two));
        assert_eq!(angles, [20, 20, 180, 10]);
        // Headings 352 and 12 are 10 degrees to either side of 2; 13 is one degree too far.
        let weight = |heading| match heading {
            352 | 12 => 1.0,
            13 => 100.0,
            _ => 0.0,
        };
        assert!((mean(2, weight).to_degrees() - 2.0).abs() < 1e-3);
    }

    /// The report's weights: one for the cell, one for the four cells at its edges, one for the
    /// four at its corners.
    #[test]
    fn d2_votes_of_360_headings_are_worth_less_beside_their_cell() {
        assert_eq!(HEADINGS, 360);
        let at = |x, y| kernel(Cell::new(7, -3), Cell::new(7 + x, -3 + y));
        assert_eq!(at(0, 0), 1.0);
        assert_eq!([at(1, 0), at(-1, 0), at(0, 1), at(0, -1)], [0.75; 4]);
        assert_eq!([at(1, 1), at(-1, 1), at(1, -1), at(-1, -1)], [0.5; 4]);
        assert_eq!([at(2, 0), at(0, 2), at(-2, 1)], [0.0; 3]);
    }

    /// The middles of cells are at multiples of 100 mm. Points 60 cells, 6 m, or more away are too
    /// far.
    #[test]
    fn points_fall_into_the_cells_around_them() {
        let points = [
            (49.0, 0.0),
            (51.0, -51.0),
            (-49.0, 49.0),
            (5_949.0, 0.0),
            (5_951.0, 0.0),
            (0.0, -5_951.0),
        ];
        let found = cells(points.map(|(x, y)| Point::new(x, y)).into_iter());
        let mut expected = [(0, 0), (1, -1), (59, 0)].map(|(x, y)| Cell::new(x, y));
        expected.sort_unstable();
        assert_eq!(found, expected);
    }

    /// Ten free cells in a row, and these scores by place and heading.
    fn row(scores: &[(usize, usize, u8)]) -> Matches {
        let mut matches = Matches {
            low: Cell::new(-2, 7),
            width: 10,
            height: 1,
            places: (0..10).map(Some).collect(),
            free: (0..10).map(|x| Cell::new(x - 2, 7)).collect(),
            scores: alloc::vec![0; 10 * HEADINGS],
        };
        for (place, heading, score) in scores {
            matches.scores[place * HEADINGS + heading] = *score;
        }
        matches
    }

    fn degrees(pose: Pose) -> f32 {
        pose.heading.to_degrees()
    }

    /// Cells of 100 mm from (-200, 700) on: the fifth has its middle at (250, 750). The scores one
    /// degree to either side are equal, so their weights, the fourth powers, are equal too.
    #[test]
    fn the_best_score_is_the_place() {
        let matches = row(&[(4, 90, 204), (4, 88, 102), (4, 92, 102), (9, 300, 153)]);
        assert!((matches.fit(4, 90) - 0.409_6).abs() < 1e-6 && matches.score(4, 88) == 102);
        assert!((matches.fit(4, 88) - 0.025_6).abs() < 1e-6 && matches.fit(4, 89) == 0.0);
        let estimate = matches.estimate(Votes::Best).expect("places");
        assert_eq!((estimate.pose.x_mm, estimate.pose.y_mm), (250.0, 750.0));
        assert!((degrees(estimate.pose) - 90.0).abs() < 1e-3);
        assert!((estimate.score - 0.8).abs() < 1e-6 && (estimate.ratio - 0.75).abs() < 1e-6);
        assert_eq!((estimate.second.x_mm, estimate.second_cells), (750.0, 5.0));
        assert!((degrees(estimate.second) + 60.0).abs() < 1e-3 && !estimate.is_ambiguous());
        // A weight is the fourth power of the score of 255: 0.4096 at 90 degrees and 0.0256 at 92.
        // So the heading moves by the share 0.0256 / 0.4352 of two degrees.
        let askew = row(&[(4, 90, 204), (4, 92, 102)]).estimate(Votes::Best);
        let heading = degrees(askew.expect("places").pose);
        assert!(
            (heading - 90.0 - 2.0 * 0.025_6 / 0.435_2).abs() < 1e-3,
            "{heading}"
        );
    }

    /// Added, 200 at the fifth cell and three quarters of 150 beside it are more than 240 alone;
    /// the weighted mean of the two headings is 90.36 degrees. Multiplied, the heading is that of
    /// the best score at any cell.
    #[test]
    fn d2_votes_are_added_or_multiplied() {
        let matches = row(&[(4, 90, 200), (5, 91, 150), (9, 200, 240)]);
        let added = matches.estimate(Votes::Added).expect("places");
        assert_eq!(added.pose.x_mm, 250.0);
        assert!(
            (degrees(added.pose) - 90.36).abs() < 1e-2,
            "{}",
            degrees(added.pose)
        );
        assert!((added.score - 200.0 / 255.0).abs() < 1e-6 && (added.ratio - 1.2).abs() < 1e-6);
        assert_eq!(matches.vote((5, 150), 4), 112.5);
        let multiplied = matches.estimate(Votes::Multiplied).expect("places");
        assert_eq!(multiplied.pose.x_mm, 250.0);
        assert!((degrees(multiplied.pose) + 160.0).abs() < 1e-3);
        // Added, the single vote of 210 / 255 = 0.8235 wins over 0.4392 and three quarters of
        // 0.4314. Multiplied, it loses against 1.4392 * 1.3235 = 1.905.
        let matches = row(&[(4, 90, 112), (5, 91, 110), (9, 200, 210)]);
        for votes in [Votes::Added, Votes::Multiplied] {
            let x_mm = matches.estimate(votes).expect("places").pose.x_mm;
            assert_eq!(x_mm, if votes == Votes::Added { 750.0 } else { 250.0 });
        }
    }

    /// Three cells or 30 degrees away it is the same position; four or 31 make a different one.
    #[test]
    fn another_place_is_more_than_three_cells_or_30_degrees_away() {
        let second = |scores: &[(usize, usize, u8)]| row(scores).second(0, 90);
        assert_eq!(second(&[(3, 90, 200)]), (0, 0, 90));
        assert_eq!(second(&[(3, 90, 200), (4, 90, 150)]), (150, 4, 90));
        assert_eq!(second(&[(1, 120, 200), (1, 60, 190)]), (0, 0, 90));
        assert_eq!(second(&[(1, 121, 180), (4, 90, 150)]), (180, 1, 121));
        assert_eq!(second(&[(0, 59, 20)]), (20, 0, 59));
    }

    /// The robot drove a cell ahead, and none to the side. So the earlier score of a cell is that
    /// of the cell behind it: the best within two degrees and a cell around that one. Positions
    /// with a current score of 100 of 255 or less are skipped.
    #[test]
    fn what_fits_both_times_is_the_product() {
        let ahead = PoseChange {
            forward_mm: 104.0,
            ..PoseChange::NONE
        };
        let both = |before: (usize, usize, u8), now: u8| {
            row(&[before]).then(ahead, &row(&[(5, 0, now)])).score(5, 0)
        };
        assert_eq!(both((4, 0, 127), 204), 101);
        assert_eq!([both((4, 0, 255), 101), both((4, 0, 255), 100)], [101, 0]);
        assert_eq!([both((3, 2, 255), 204), both((5, 358, 255), 204)], [204; 2]);
        assert_eq!([both((2, 0, 255), 204), both((6, 0, 255), 204)], [0; 2]);
        assert_eq!([both((4, 3, 255), 204), both((4, 1, 255), 204)], [0; 2]);
        // After a turn by 90 degrees to the left, the cell that was to the left is ahead.
        let turned = PoseChange {
            forward_mm: 0.0,
            left_mm: -100.0,
            turn: core::f32::consts::FRAC_PI_2,
        };
        let now = row(&[(7, 180, 204)]);
        assert_eq!(row(&[(5, 90, 255)]).then(turned, &now).score(7, 180), 204);
        assert_eq!(row(&[(8, 90, 255)]).then(turned, &now).score(7, 180), 0);
    }

    #[test]
    fn cells_off_the_map_have_no_place() {
        let matches = row(&[]);
        let place = |x, y| matches.place(Cell::new(x, y));
        assert_eq!(
            [place(-2, 7), place(7, 7), place(0, 7)],
            [Some(0), Some(9), Some(2)]
        );
        assert_eq!(
            [place(-3, 7), place(8, 7), place(0, 6), place(0, 8)],
            [None; 4]
        );
        assert_eq!(matches.best_near(Cell::new(9, 9), 0), 0);
    }
}
