//! The seed report's Monte-Carlo search: random candidates around a base pose. In the last two
//! thirds of the tries a better candidate becomes the base and halves the spread.

use super::matching::{Placement, Tally, tally, whole};
use super::settings::{Defects, Settings};
use crate::grid::Grid;
use crate::pose::{Pose, normalised, sin_cos};
use crate::random::Pcg32;

/// Result of a search.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub(super) pose: Pose,
    /// Sums over all points.
    pub(super) tally: Tally,
    pub(super) tries: u32,
    /// Tries with a point on the map.
    pub(super) on_map: u32,
}

/// A try that was better than all earlier ones.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Improvement {
    /// Number of the try in the search.
    pub index: u32,
    /// The candidate.
    pub pose: Pose,
    /// Mean map value at the end points, 0 to 255.
    pub value: f32,
}

/// Maximum number of stored improvements; the seed report shows a search with 32.
pub const IMPROVEMENTS_MAX: usize = 48;

/// The first improvements of a search.
#[derive(Clone, Debug)]
pub(super) struct Improvements {
    /// Mean map value at the search's start.
    pub(super) start: f32,
    list: [Improvement; IMPROVEMENTS_MAX],
    len: usize,
}

impl<const W: usize, const H: usize> super::Mapper<W, H> {
    /// Mean map value at the start of the document's last search, 0 to 255.
    pub const fn search_start(&self) -> f32 {
        self.improvements.start
    }
}

impl Improvements {
    pub(super) const NONE: Self = Self {
        start: 0.0,
        list: [Improvement {
            index: 0,
            pose: Pose {
                x_mm: 0.0,
                y_mm: 0.0,
                heading: 0.0,
            },
            value: 0.0,
        }; IMPROVEMENTS_MAX],
        len: 0,
    };

    pub(super) fn all(&self) -> &[Improvement] {
        &self.list[..self.len]
    }

    fn push(&mut self, index: u32, pose: Pose, value: f32) {
        if let Some(slot) = self.list.get_mut(self.len) {
            *slot = Improvement { index, pose, value };
            self.len += 1;
        }
    }
}

/// The centre of the candidates, with precomputed sine and cosine.
struct Base {
    pose: Pose,
    x_cells: f32,
    y_cells: f32,
    sin: f32,
    cos: f32,
}

impl Base {
    fn new(pose: Pose, resolution_mm: f32) -> Self {
        let (sin, cos) = sin_cos(pose.heading);
        Self {
            pose,
            x_cells: pose.x_mm / resolution_mm,
            y_cells: pose.y_mm / resolution_mm,
            sin,
            cos,
        }
    }
}

/// A shift from a base pose: millimetres of the world, radians.
#[derive(Clone, Copy)]
struct Shift {
    x_mm: f32,
    y_mm: f32,
    turn: Turn,
}

/// A turn, with precomputed sine and cosine.
#[derive(Clone, Copy)]
struct Turn {
    angle: f32,
    sin: f32,
    cos: f32,
}

impl Turn {
    #[inline]
    fn by(degrees: f32) -> Self {
        let angle = degrees.to_radians();
        let (sin, cos) = small_sin_cos(angle);
        Self { angle, sin, cos }
    }
}

/// The turns of candidates: whole degrees, few enough for a table.
struct Turns([Turn; 2 * Self::REACH]);

impl Turns {
    /// Degrees to each side.
    const REACH: usize = 10;

    fn new() -> Self {
        let degrees = |index: usize| index as f32 - Self::REACH as f32;
        Self(core::array::from_fn(|index| Turn::by(degrees(index))))
    }

    /// A random turn: from the table, or computed if the spread is wider or 0.
    #[inline]
    fn drawn(&self, random: &mut Pcg32, spread_deg: u32) -> Turn {
        let degrees = offset(random, spread_deg);
        let index = whole(degrees + Self::REACH as f32);
        let known = usize::try_from(index)
            .ok()
            .and_then(|index| self.0.get(index));
        known.copied().unwrap_or_else(|| Turn::by(degrees))
    }
}

impl Base {
    fn pose(&self, shift: Shift) -> Pose {
        Pose {
            x_mm: self.pose.x_mm + shift.x_mm,
            y_mm: self.pose.y_mm + shift.y_mm,
            heading: normalised(self.pose.heading + shift.turn.angle),
        }
    }

    #[inline]
    fn placement(&self, shift: Shift, cells_per_mm: f32) -> Placement {
        let Turn { sin, cos, .. } = shift.turn;
        Placement::from_parts(
            self.x_cells + shift.x_mm * cells_per_mm,
            self.y_cells + shift.y_mm * cells_per_mm,
            self.sin * cos + self.cos * sin,
            self.cos * cos - self.sin * sin,
        )
    }
}

/// Sine and cosine by the first terms of their series: exact to single precision up to half a
/// radian, and to the matcher's 14 places far beyond.
#[inline]
fn small_sin_cos(angle: f32) -> (f32, f32) {
    if angle.abs() > 0.5 {
        return sin_cos(angle);
    }
    let square = angle * angle;
    let sin = angle * (1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0)));
    let cos = 1.0 - square / 2.0 * (1.0 - square / 12.0 * (1.0 - square / 30.0));
    (sin, cos)
}

/// Tries `tries` candidates around `predicted`.
pub(super) fn run<const W: usize, const H: usize>(
    grid: &Grid<W, H>,
    settings: &Settings,
    points: &[[i16; 2]],
    predicted: Pose,
    tries: u32,
    (random, improvements): (&mut Pcg32, &mut Improvements),
) -> Found {
    let defects = settings.defects;
    let resolution_mm = grid.resolution_mm();
    let cells_per_mm = 1.0 / resolution_mm;
    let mut base = Base::new(predicted, resolution_mm);
    let here = Placement::new(predicted, resolution_mm);
    let mut best = (predicted, tally(grid.rows(), points, &here));
    let mut spread = u32::from(settings.search.spread_mm);
    let mut spread_deg = u32::from(settings.search.spread_deg);
    let mut on_map = u32::from(best.1.inside > 0);
    let turns = Turns::new();
    improvements.len = 0;
    improvements.start = mean(best.1, points);
    for index in 0..tries {
        let shift = Shift {
            x_mm: offset(random, spread),
            y_mm: offset(random, spread),
            turn: turns.drawn(random, spread_deg),
        };
        let found = tally(grid.rows(), points, &base.placement(shift, cells_per_mm));
        on_map += u32::from(found.inside > 0);
        if rank(found, defects) <= rank(best.1, defects) {
            continue;
        }
        best = (base.pose(shift), found);
        improvements.push(index, best.0, mean(found, points));
        if index > tries / 3 {
            base = Base::new(best.0, resolution_mm);
            if !defects.never_narrows {
                spread = halved(spread, defects.spread_reaches_zero);
                spread_deg = halved(spread_deg, defects.heading_spread_reaches_zero);
            }
        }
    }
    Found {
        pose: best.0,
        tally: best.1,
        tries: tries.saturating_add(1),
        on_map,
    }
}

/// Mean value of the cells at the end points.
fn mean(found: Tally, points: &[[i16; 2]]) -> f32 {
    found.sum as f32 / points.len().max(1) as f32
}

/// Score that compares candidates: the mean over all points, or over those on the map (SL-10).
#[inline]
fn rank(tally: Tally, defects: Defects) -> i64 {
    if defects.outside_is_free {
        (i64::from(tally.sum) * 1024)
            .checked_div(i64::from(tally.inside))
            .unwrap_or(-1)
    } else {
        i64::from(tally.sum)
    }
}

const fn halved(spread: u32, reaches_zero: bool) -> u32 {
    match spread / 2 {
        0 if !reaches_zero => 1,
        half => half,
    }
}

/// A whole number from `-spread` to `spread - 1`. With a spread of 0 the processor's remainder is
/// the random number itself.
#[inline]
fn offset(random: &mut Pcg32, spread: u32) -> f32 {
    (i64::from(random.below(2 * spread)) - i64::from(spread)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Point;
    use crate::slam::matching::EndPoints;
    use proptest::prelude::*;

    /// A pillar of one cell in the middle of free space: only the exact pose scores.
    fn pillar() -> Grid<300, 300> {
        let mut grid = Grid::new(10.0);
        grid.rows_mut().as_flattened_mut().fill(0);
        grid.set(200, 150, 255);
        grid
    }

    fn points(at: &[Point]) -> EndPoints {
        let mut points = EndPoints::EMPTY;
        points.set(at.iter().copied(), 10.0);
        points
    }

    const CENTRE: Pose = Pose {
        x_mm: 1505.0,
        y_mm: 1505.0,
        heading: 0.0,
    };

    /// Range of candidates around the base for a spread, over many draws: the document's interval
    /// is [-s, s - 1].
    fn reach(spread: u32) -> (f32, f32) {
        let mut random = Pcg32::new(3);
        (0..20_000)
            .map(|_| offset(&mut random, spread))
            .fold((0.0, 0.0), |(low, high), value| {
                (f32::min(low, value), f32::max(high, value))
            })
    }

    #[test]
    fn candidates_fill_the_documents_interval() {
        assert_eq!(reach(100), (-100.0, 99.0));
        assert_eq!(reach(10), (-10.0, 9.0));
        assert_eq!(reach(1), (-1.0, 0.0));
    }

    /// SL-01: seven halvings reduce 100 mm to 0, and the remainder by zero is the random number
    /// itself: candidates a million metres away. With the lower limit they stay at a millimetre.
    #[test]
    fn the_spread_never_reaches_zero() {
        let after = |halvings, reaches_zero| {
            (0..halvings).fold(100, |spread, _| halved(spread, reaches_zero))
        };
        assert_eq!(
            (after(6, false), after(7, false), after(20, false)),
            (1, 1, 1)
        );
        assert_eq!((after(6, true), after(7, true)), (1, 0));
        let (low, high) = reach(0);
        assert!(low == 0.0 && high > 2e9, "{low} {high}");
    }

    /// SL-02: four halvings reduce 10 degrees to 0, which turns the robot by any angle.
    #[test]
    fn the_headings_spread_never_reaches_zero() {
        let spread = |reaches_zero| (0..4).fold(10, |spread, _| halved(spread, reaches_zero));
        assert_eq!((spread(false), spread(true)), (1, 0));
    }

    /// SL-10: near the map's edge a single point on a wall inside scores higher than a full match
    /// of mean 200.
    #[test]
    fn one_good_point_inside_does_not_beat_many() {
        let alone = Tally {
            sum: 255,
            inside: 1,
        };
        let full = Tally {
            sum: 36 * 200,
            inside: 36,
        };
        let sound = Defects::default();
        let fielded = Defects {
            outside_is_free: true,
            ..sound
        };
        assert!(rank(full, sound) > rank(alone, sound));
        assert_eq!(
            (rank(alone, fielded), rank(full, fielded)),
            (261_120, 204_800)
        );
    }

    /// The map rises towards a wall 150 mm ahead. In the first third candidates reach 99 mm, and no
    /// later one around the old base is better than the best of those: the document's base moves
    /// only with a *new* best. At 99 mm the point lies in column 195, 25 below the summit.
    #[test]
    fn the_best_pose_within_the_spread_is_found() {
        let mut grid = pillar();
        for x in 170..=215 {
            for y in 130..170 {
                grid.set(
                    x,
                    y,
                    u8::try_from(255 - 5 * (200_usize).abs_diff(x)).unwrap(),
                );
            }
        }
        let scan = points(&[Point::new(350.0, 0.0)]);
        let settings = Settings::document();
        let mut random = Pcg32::new(1);
        let found = run(
            &grid,
            &settings,
            scan.all(),
            CENTRE,
            1000,
            (&mut random, &mut Improvements::NONE.clone()),
        );
        assert_eq!((found.tally.sum, found.tries), (230, 1001));
    }

    /// H-SL-1: towards a summit, a search that never narrows ends farther down on average.
    #[test]
    fn narrowing_brings_the_search_nearer_to_the_summit() {
        let mut grid = pillar();
        for x in 100..300 {
            for y in 50..250 {
                let apart = (200_usize).abs_diff(x) + (150_usize).abs_diff(y);
                grid.set(
                    x,
                    y,
                    u8::try_from(255_usize.saturating_sub(6 * apart)).unwrap(),
                );
            }
        }
        let scan = points(&[Point::new(450.0, 0.0)]);
        let mean = |never_narrows| {
            let mut settings = Settings::document();
            settings.defects.never_narrows = never_narrows;
            let sums = (0..200_u64).map(|seed| {
                let mut random = Pcg32::new(seed);
                run(
                    &grid,
                    &settings,
                    scan.all(),
                    CENTRE,
                    60,
                    (&mut random, &mut Improvements::NONE.clone()),
                )
                .tally
                .sum
            });
            sums.sum::<u32>() / 200
        };
        assert!(
            mean(false) >= mean(true) + 3,
            "{} {}",
            mean(false),
            mean(true)
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// For any map, the answer is never worse than staying.
        #[test]
        fn the_search_never_returns_a_worse_pose(seed: u64, tries in 0_u32..300, cell: u8) {
            let mut grid = pillar();
            grid.rows_mut().as_flattened_mut()[40_000..50_000].fill(cell);
            let scan = points(&[Point::new(500.0, 0.0), Point::new(-100.0, 80.0)]);
            let here = tally(grid.rows(), scan.all(), &Placement::new(CENTRE, 10.0));
            let mut random = Pcg32::new(seed);
            let mut log = Improvements::NONE.clone();
            let points = scan.all();
            let settings = Settings::document();
            let found = run(&grid, &settings, points, CENTRE, tries, (&mut random, &mut log));
            prop_assert!(found.tally.sum >= here.sum);
        }
    }

    #[test]
    fn short_series_are_as_good_as_the_library() {
        for step in -2000_i16..=2000 {
            let angle = f32::from(step) / 1000.0;
            let ((s0, c0), (s1, c1)) = (small_sin_cos(angle), sin_cos(angle));
            assert!((s0 - s1).abs() < 1e-6 && (c0 - c1).abs() < 1e-6, "{angle}");
        }
    }
}
