use super::matching::Placement;
use crate::grid::{Grid, UNKNOWN};
use crate::pose::Pose;

/// Agreement of a scan with the known map. Points on cells that were never drawn count as unknown,
/// unless their beam crosses a known wall. A robot that looks into a new room is not lost; one that
/// seems to look through walls is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Evidence {
    /// Points on cells that look like wall.
    hits: u32,
    /// Points on cells that were seen free, or that lie behind walls.
    misses: u32,
    /// All points.
    of: u32,
}

/// Minimum difference to unknown of a cell that was seen free.
const FREE_MARGIN: u8 = 20;
/// Minimum value of a certain wall.
const WALL: u8 = 200;
/// Points of the document's search.
const ENOUGH: u32 = 36;
/// Number of positions along a beam at which walls are searched: walls are a few cells thick.
const WAY_PARTS: i16 = 32;
const WAY: core::ops::Range<i16> = 14..31;

impl Evidence {
    /// Looks all points up.
    pub(super) fn of<const W: usize, const H: usize>(
        grid: &Grid<W, H>,
        points: &[[i16; 2]],
        pose: Pose,
    ) -> Self {
        let placement = Placement::new(pose, grid.resolution_mm());
        let value_at = |(x, y): (i32, i32)| {
            let at = usize::try_from(x).ok().zip(usize::try_from(y).ok());
            at.and_then(|(x, y)| grid.get(x, y)).unwrap_or(UNKNOWN)
        };
        let is_wall = |point: &[i16; 2], part: i16| {
            let cell = placement.cell(point.map(|x| x / WAY_PARTS * part));
            let seen = match value_at(cell) {
                UNKNOWN => in_gap(value_at, cell),
                seen => seen,
            };
            seen > WALL
        };
        let mut evidence = Self {
            of: super::count_u32(points.len()),
            ..Self::default()
        };
        for point in points {
            let cell = placement.cell(*point);
            let end = match value_at(cell) {
                UNKNOWN => in_gap(value_at, cell),
                seen => seen,
            };
            if end > UNKNOWN || (UNKNOWN - FREE_MARGIN..UNKNOWN).contains(&end) {
                evidence.hits += 1;
            } else if end < UNKNOWN || WAY.into_iter().any(|part| is_wall(point, part)) {
                evidence.misses += 1;
            }
        }
        evidence
    }

    /// Share of the known points that agree, 0 to 1; 1 if less than a quarter of the points are
    /// known.
    pub(super) fn agreement(&self) -> f32 {
        let telling = self.hits + self.misses;
        if telling * 4 < self.of {
            1.0
        } else {
            self.hits as f32 / telling.max(1) as f32
        }
    }

    /// Whether the evidence for its pose exceeds that of `other` by more than chance: agreeing
    /// minus disagreeing points, by an eighth of all points.
    pub(super) const fn exceeds(&self, other: &Self) -> bool {
        self.hits + other.misses >= other.hits + self.misses + self.of / 8
    }

    /// Whether the evidence of this pose clearly exceeds that of `other`, so that the scan belongs
    /// here: at most the share `remains` of the disagreement is left. A pose without known points
    /// has no disagreement either, but is not better for that. Nor is a pose with only a handful of
    /// known points, because they fit many poses.
    pub(super) fn outweighs(&self, other: &Self, remains: f32) -> bool {
        self.tells_something()
            && self.is_enough()
            && self.exceeds(other)
            && 1.0 - self.agreement() < (1.0 - other.agreement()) * remains
    }

    /// Whether three points of eight are known: in a room that was seen from one position only, its
    /// far walls have gaps.
    pub(super) const fn tells_something(&self) -> bool {
        (self.hits + self.misses) * 8 >= self.of * 3
    }

    /// Whether there are as many points as the document's search takes. The rest of a turn that was
    /// mostly lost fits a square room in four orientations.
    pub(super) const fn is_enough(&self) -> bool {
        self.of >= ENOUGH
    }

    /// Whether there are enough points and most of them are known.
    pub(super) const fn is_plain(&self) -> bool {
        self.is_enough() && self.is_broad()
    }

    /// Whether most points are known.
    pub(super) const fn is_broad(&self) -> bool {
        (self.hits + self.misses) * 2 >= self.of
    }
}

/// Value of an unseen cell in a gap between two beams, which is a few cells wide: that of the cells
/// on both sides of the gap. A robot that has never moved has such gaps everywhere but near itself,
/// and a turn by half a beam puts all points into them.
fn in_gap(value_at: impl Fn((i32, i32)) -> u8, (x, y): (i32, i32)) -> u8 {
    const SIDES: [(i32, i32); 4] = [(2, 0), (0, 2), (2, 2), (2, -2)];
    for (dx, dy) in SIDES {
        let (a, b) = (value_at((x + dx, y + dy)), value_at((x - dx, y - dy)));
        let (low, high) = (a.min(b), a.max(b));
        if high < UNKNOWN - FREE_MARGIN || low > UNKNOWN {
            return high;
        }
    }
    UNKNOWN
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall at cell 20 of a row that was seen free up to there; everything else is unknown.
    fn wall() -> Grid<40, 3> {
        let mut grid = Grid::new(10.0);
        (0..20).for_each(|x| grid.set(x, 1, 0));
        grid.set(20, 1, 255);
        grid
    }

    /// The robot looks along the row from cell 2: distances in cells.
    fn agreement(distances: &[i16]) -> f32 {
        let mut points = [[0; 2]; 8];
        for (point, distance) in points.iter_mut().zip(distances) {
            *point = [distance * 16, 0];
        }
        let pose = Pose::new(25.0, 15.0, 0.0);
        Evidence::of(&wall(), &points[..distances.len()], pose).agreement()
    }

    #[test]
    fn points_on_walls_agree_and_points_in_the_open_do_not() {
        assert!((agreement(&[18, 18, 18, 10]) - 0.75).abs() < 1e-6);
    }

    #[test]
    fn points_behind_walls_contradict() {
        assert!(agreement(&[24, 24, 24, 24]) < 0.01);
    }

    #[test]
    fn points_in_unknown_places_say_nothing() {
        let mut up = [[0, 16 * 5]; 4];
        up[0] = [16 * 18, 0];
        let evidence = Evidence::of(&wall(), &up, Pose::new(25.0, 15.0, 0.0));
        assert!((evidence.agreement() - 1.0).abs() < 1e-6 && !evidence.is_broad());
    }

    #[test]
    fn a_handful_of_points_is_not_enough() {
        let points = [[0; 2]; 36];
        let pose = Pose::new(25.0, 15.0, 0.0);
        let is_enough = |count| Evidence::of(&wall(), &points[..count], pose).is_enough();
        assert!(is_enough(36) && !is_enough(35));
    }

    /// A cell beside a comb of beams: between two free cells a point disagrees; between two cells
    /// of a wall it agrees; behind the wall it disagrees.
    #[test]
    fn a_gap_between_two_beams_is_what_its_sides_are() {
        let mut grid = Grid::<40, 9>::new(10.0);
        for y in [2, 6] {
            (0..20).for_each(|x| grid.set(x, y, 0));
            grid.set(20, y, 255);
        }
        let pose = Pose::new(25.0, 45.0, 0.0);
        let at = |x: i16| Evidence::of(&grid, &[[x * 16, 0]], pose);
        assert!(at(18).agreement() > 0.99 && at(18).tells_something());
        assert!(at(10).agreement() < 0.01 && at(30).agreement() < 0.01);
    }

    fn evidence(hits: u32, misses: u32, of: u32) -> Evidence {
        Evidence { hits, misses, of }
    }

    /// One known point of four is enough, one of five is not.
    #[test]
    fn a_quarter_of_the_points_tells_whether_a_scan_agrees() {
        let agreement = |hits, misses, of| evidence(hits, misses, of).agreement();
        assert_eq!(agreement(0, 1, 4), 0.0);
        assert_eq!(agreement(0, 1, 5), 1.0);
        assert_eq!(agreement(3, 1, 16), 0.75);
    }

    /// A pose is better if its agreeing less its disagreeing points are more by an eighth of all
    /// points. Of 80 points that is 10: 20 - 5 = 15 is 10 more than 8 - 3 or 9 - 4.
    #[test]
    fn a_place_is_better_by_an_eighth_of_all_points() {
        let here = evidence(20, 5, 80);
        assert!(here.exceeds(&evidence(8, 3, 80)) && here.exceeds(&evidence(9, 4, 80)));
        assert!(!here.exceeds(&evidence(8, 2, 80)) && !here.exceeds(&evidence(9, 3, 80)));
        assert!(evidence(2, 1, 8).exceeds(&evidence(0, 0, 8)));
        assert!(!evidence(1, 1, 8).exceeds(&evidence(0, 0, 8)));
    }

    /// Three known points of eight are enough to tell something; four of eight count as most of
    /// them.
    #[test]
    fn points_that_hit_or_miss_tell_something() {
        assert!(evidence(2, 1, 8).tells_something() && !evidence(1, 1, 8).tells_something());
        assert!(evidence(0, 6, 16).tells_something() && !evidence(5, 0, 16).tells_something());
        assert!(evidence(3, 1, 8).is_broad() && !evidence(2, 1, 8).is_broad());
        assert!(evidence(8, 0, 16).is_broad() && !evidence(0, 7, 16).is_broad());
    }

    /// 127 was never seen; values darker by up to 20 are wall or its edge, lighter ones are free.
    #[test]
    fn a_cell_is_wall_from_a_little_below_unknown_on() {
        let seen = [0, 106, 107, 126, 128, 200].map(|value| {
            let mut grid = Grid::<9, 1>::new(10.0);
            grid.set(4, 0, value);
            let found = Evidence::of(&grid, &[[64, 0]], Pose::new(5.0, 5.0, 0.0));
            [found.hits, found.misses, found.of]
        });
        let [hit, miss] = [[1, 0, 1], [0, 1, 1]];
        assert_eq!(seen, [miss, miss, hit, hit, hit, hit]);
    }

    /// A gap takes the value of the cells two cells away on both sides, along an axis or a
    /// diagonal. A value on one side only, or a wall on one side and free space on the other, gives
    /// none.
    #[test]
    fn a_gap_is_two_cells_from_its_sides() {
        let gap = |sides: [((i32, i32), u8); 2]| {
            let value_at = |cell| {
                sides
                    .iter()
                    .find(|(at, _)| *at == cell)
                    .map_or(127, |it| it.1)
            };
            in_gap(value_at, (10, 20))
        };
        for (dx, dy) in [(2, 0), (0, 2), (2, 2), (2, -2)] {
            let sides = [(10 + dx, 20 + dy), (10 - dx, 20 - dy)];
            let of = |one, other| gap([(sides[0], one), (sides[1], other)]);
            assert_eq!([of(0, 0), of(0, 90), of(106, 5)], [0, 90, 106]);
            assert_eq!([of(255, 255), of(128, 200)], [255, 200]);
            assert_eq!(
                [of(0, 127), of(255, 127), of(0, 255), of(107, 0)],
                [UNKNOWN; 4]
            );
        }
        assert_eq!(gap([((11, 20), 0), ((9, 20), 0)]), UNKNOWN);
    }

    /// Of 64 points half disagree at the first pose. The second pose outweighs it if less than half
    /// as many, less than a quarter of all, disagree there. It also needs 24 known points, 23 are
    /// too few, and more than 35 points in all. Its agreeing less its disagreeing points must be 8
    /// more than at the first pose.
    #[test]
    fn a_place_outweighs_another_by_half_of_its_disagreement() {
        let here = evidence(32, 32, 64);
        let outweighs = |there: Evidence| there.outweighs(&here, 0.5);
        assert!(outweighs(evidence(49, 15, 64)) && !outweighs(evidence(48, 16, 64)));
        assert!(!outweighs(evidence(32, 32, 64)) && !outweighs(evidence(0, 64, 64)));
        assert!(outweighs(evidence(24, 0, 64)) && !outweighs(evidence(23, 0, 64)));
        let few = evidence(0, 35, 35);
        assert!(!evidence(35, 0, 35).outweighs(&few, 0.5));
        assert!(evidence(36, 0, 36).outweighs(&few, 0.5));
        // A quarter disagrees at the first pose, so less than an eighth may at the second: 56 of 64
        // is exactly that.
        let here = evidence(48, 16, 64);
        assert!(evidence(57, 7, 64).outweighs(&here, 0.5));
        assert!(!evidence(56, 8, 64).outweighs(&here, 0.5));
        // All points agree at the second pose, but only 7 of 64 more than at the first.
        let here = evidence(27, 1, 64);
        assert!(!evidence(33, 0, 64).outweighs(&here, 0.5));
        assert!(evidence(34, 0, 64).outweighs(&here, 0.5));
    }
}
