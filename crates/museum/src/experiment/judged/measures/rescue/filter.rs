//! The map's ramp, and the search after a push.

use core::time::Duration;

use emulators::rng::Rng;
use emulators::world::{BodyConfig, Fixture, Point as Place, Pose as Truth, Scene, Shape, World};
use engine::robots::instruments::in_metres;
use engine::scenario::world::PushSpec;
use engine::scenario::{Span, TuningSpec};
use firmware_core::pose::{Point, Pose};
use firmware_core::robots::rescue::Rescue;
use firmware_core::scan::Scan;
use firmware_core::slam::{Mapper, Settings};
use protocols::Instant;

use crate::experiment::Plan;
use crate::experiment::judged::Measured;
use crate::experiment::judged::measures::rescue::{WEIGHT, as_reported};
use crate::experiment::judged::measures::{Measure, Model, Told, by_seed};
use crate::experiment::push::ROOM;
use crate::experiment::runs::{Spread, start};

/// Figure 3: the ramp that a beam draws into the map.
pub(in super::super) const RAMP: Measure = Measure {
    name: "ramp",
    planted: "a hole a quarter wider",
    perform: ramp,
};

/// Width of the ramp's foot in the published program, mm.
const HOLE_MM: f32 = 350.0;
/// Number of scans after which the map no longer changes.
const SCANS: usize = 400;

fn ramp(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let drawn = by_seed(plan, tell, |seed| {
        // An obstacle at 0.6 to 1.05 m.
        let far_mm = 600.0 + 50.0 * f32::from(u8::try_from(seed % 10).unwrap_or_default());
        drawn(far_mm, model.pick(HOLE_MM, 1.25 * HOLE_MM))
    });
    let mut measured = Measured::default();
    let offsets = (-300..=300).step_by(10);
    let median = |offset: i32| {
        let offset = f64::from(offset);
        let values = drawn.iter().filter_map(|curve| {
            let found = curve.iter().find(|[x, _]| (x - offset).abs() < 5.0);
            found.map(|[_, y]| *y)
        });
        [offset, Spread::of(values).median]
    };
    measured.curve("value of a cell", offsets.map(median));
    let half = |curve: &Vec<[f64; 2]>| {
        10.0 * curve.iter().filter(|[_, value]| *value >= 127.5).count() as f64
    };
    measured.value("width at half the height (mm)", drawn.iter().map(half));
    let peak = |curve: &Vec<[f64; 2]>| curve.iter().map(|[_, y]| *y).fold(0.0, f64::max);
    measured.value("value at the obstacle", drawn.iter().map(peak));
    measured
}

/// Distance from the obstacle along the beam, mm, and the value of the cell there.
fn drawn(far_mm: f32, hole_mm: f32) -> Vec<[f64; 2]> {
    let settings = Settings {
        hole_mm,
        weight: WEIGHT,
        start: Pose::new(1_005.0, 1_505.0, 0.0),
        ..Settings::document()
    };
    let mut mapper: Box<Mapper> = Box::new(Mapper::new(settings));
    let points = [Point::new(far_mm, 0.0)];
    let scan = Scan::from_points(&points, Instant::ZERO, Instant::ZERO);
    for _ in 0..SCANS {
        mapper.draw(&scan, [0, 0]);
    }
    let value = |cell: u16| {
        let middle_mm = 10.0 * f64::from(cell) + 5.0;
        let value = mapper.grid().get(usize::from(cell), 150)?;
        let offset = middle_mm - 1_005.0 - f64::from(far_mm);
        // Nothing is drawn behind the ramp.
        let is_seen = middle_mm > 1_005.0 && offset <= f64::from(hole_mm) / 2.0;
        is_seen.then_some([offset, f64::from(value)])
    };
    (0..300_u16).filter_map(value).collect()
}

/// Figure 8: the search after a push.
pub(in super::super) const PUSH: Measure = Measure {
    name: "push",
    planted: "30 tries of each search",
    perform: push,
};

const PUSH_AT_MS: u64 = 10_000;
const PUSH_M: [f64; 2] = [0.0, 0.4];
/// Time at which the pose has settled: the report takes the final position from its own log.
const SETTLED_MS: u64 = 14_000;
/// Searches of the report's log.
const REPORTED: usize = 6;
/// Error, mm, below which the report's log ends.
const BACK_MM: f64 = 30.0;

/// A candidate in the log that is better than all before.
#[derive(Clone, Copy)]
struct Better {
    search: usize,
    at: [f64; 2],
}

/// Log of a push; distances from the final position, mm.
struct Log {
    better: Vec<Better>,
    /// Results of the searches.
    found: Vec<[f64; 2]>,
    /// Distances along the push between these results and the true end of the push, mm.
    off: Vec<f64>,
}

impl Log {
    /// Index of the last search before the pose moved by a twentieth of the push.
    fn first(&self) -> usize {
        let moved = self.found.iter().position(|at| at[1] < 380.0);
        moved.unwrap_or(self.found.len()).saturating_sub(1)
    }

    /// Index of the first search that ends near the final position.
    fn last(&self) -> usize {
        let near = self.found.iter().position(|at| at[1] < BACK_MM);
        near.unwrap_or(self.found.len())
    }

    /// The candidates from the first search that moved to the last one.
    fn shown(&self) -> impl Iterator<Item = Better> + '_ {
        let range = self.first() + 1..=self.last();
        let shown = self.better.iter();
        shown
            .copied()
            .filter(move |one| range.contains(&one.search))
    }
}

fn push(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let logs = by_seed(plan, tell, |seed| log(seed, model.pick(None, Some(30))));
    let mut measured = Measured::default();
    // The report's first bar is the position before the first search.
    let farthest = |log: &Log| {
        let before = log.found.get(log.first()).map_or(f64::NAN, |at| at[1]);
        log.shown().map(|one| one.at[1]).fold(before, f64::max)
    };
    measured.value(
        "largest distance along the push (mm)",
        logs.iter().map(farthest),
    );
    let across = |log: &Log| Spread::of(log.shown().map(|one| one.at[0])).median;
    measured.value(
        "distance across the push, median (mm)",
        logs.iter().map(across),
    );
    let searches = |log: &Log| log.last().saturating_sub(log.first()) as f64;
    measured.value("searches", logs.iter().map(searches));
    let better = logs.iter().map(|log| log.shown().count() as f64);
    measured.value("better candidates", better);
    let end = |log: &Log| {
        let off = log.off.get(log.first() + REPORTED);
        off.copied().unwrap_or(f64::NAN)
    };
    measured.value(
        "distance from the truth after six searches (mm)",
        logs.iter().map(end),
    );
    let median = |search: usize| {
        let at = logs.iter();
        let at = at.filter_map(|log| log.found.get(log.first() + search).map(|at| at[1]));
        [search as f64, Spread::of(at).median]
    };
    measured.curve("end of each search", (0..8).map(median));
    measured
}

/// Figure 4: the scores of the candidates rise.
pub(in super::super) const FILTER: Measure = Measure {
    name: "filter",
    planted: "a robot whose wheels do not spin",
    perform: filter,
};

/// Motion that the spinning wheels report, mm: 1.30 and 0.60 cells of the sketch, from picture (b)
/// to picture (d). The sketch's ramp falls from 255 to 0 in four cells, that of the robot in half
/// of its foot.
const SPUN_MM: [f32; 2] = [
    1.30 * HOLE_MM / 2.0 / SKETCH_CELLS,
    0.60 * HOLE_MM / 2.0 / SKETCH_CELLS,
];
const SKETCH_CELLS: f32 = 4.0;
/// Scans of the resting robot before its wheels spin.
const RESTING: usize = 100;
/// Noise of a distance, metres: the lidar's within a room.
const NOISE_M: f64 = 0.002;
/// Pose of the robot, in the world and in its map.
const AT: Truth = Truth::new(1.5, 1.2, core::f64::consts::FRAC_PI_2);
const PLACE: Pose = Pose {
    x_mm: 1_500.0,
    y_mm: 1_200.0,
    heading: core::f32::consts::FRAC_PI_2,
};
/// Error of a start by chance: half of the spread of the candidates.
const SPREAD_MM: f64 = 50.0;
const SPREAD_DEG: f64 = 5.0;

fn filter(plan: &Plan, model: Model, tell: &Told<'_>) -> Measured {
    let by_mm = model.pick(SPUN_MM, [0.0; 2]);
    let found = by_seed(plan, tell, |seed| searched(by_mm, seed));
    let mut measured = Measured::default();
    let names = [
        "score of the search, last against first",
        "score at the end of the search",
        "distance from the true position after the search (mm)",
    ];
    for (index, name) in names.into_iter().enumerate() {
        measured.value(name, found.iter().map(|one| one[index]));
    }
    measured
}

/// A robot rests in the room and draws its map. Then its wheels report a motion, and it searches
/// its position once. The rise of the score, the last score, and the error, mm.
fn searched(by_mm: [f32; 2], seed: u64) -> [f64; 3] {
    let mut bench = Resting::new(seed, None);
    let [x, y] = by_mm;
    let off = bench.found_after(Pose::new(x, y, 0.0));
    let start = f64::from(bench.mapper.search_start());
    let last = bench.mapper.improvements().last();
    let last = last.map_or(start, |last| f64::from(last.value));
    [last / start, 1_024.0 * last, off]
}

/// A robot that rests in the room of figure 8, with the report's mapper.
pub(super) struct Resting {
    mapper: Box<Mapper>,
    world: World,
    dice: Rng,
}

impl Resting {
    /// The robot after it has drawn its map. Searches have this number of tries.
    pub(super) fn new(seed: u64, tries: Option<u16>) -> Self {
        let corners = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]];
        let walls = corners.windows(2).map(|ends| {
            let [from, to] = [ends[0], ends[1]].map(|[x, y]| Place::new(x, y));
            Fixture::from(Shape::Wall { from, to })
        });
        let scene = Scene::new(walls, Vec::new()).expect("sound walls");
        let mut settings = Settings {
            weight: WEIGHT,
            start: PLACE,
            seed,
            ..Settings::document()
        };
        if let Some(tries) = tries {
            settings.budget.start = tries;
            settings.budget.max = tries;
        }
        let world = World::new(scene, BodyConfig::default(), AT, seed).expect("room enough");
        let mut bench = Self {
            mapper: Box::new(Mapper::new(settings)),
            world,
            dice: Rng::stream(seed, "lidar"),
        };
        for _ in 0..RESTING {
            let scan = bench.scan();
            bench.mapper.draw(&scan, [0, 0]);
        }
        bench
    }

    fn scan(&mut self) -> Scan {
        let points: Vec<Point> = (0..360_u16)
            .filter_map(|degree| {
                let bearing = f64::from(degree).to_radians();
                let hit = self.world.cast_ray(AT.point(), AT.theta + bearing, 6.0)?;
                let far_mm = 1e3 * (hit.distance + NOISE_M * self.dice.gauss());
                let (sin, cos) = libm::sincos(bearing);
                #[expect(clippy::cast_possible_truncation, reason = "millimetres")]
                let point = Point::new((far_mm * cos) as f32, (far_mm * sin) as f32);
                Some(point)
            })
            .collect();
        Scan::from_points(&points, Instant::ZERO, Instant::ZERO)
    }

    /// Distance from the true position, mm, that a search ends at. It begins `off` the true pose.
    pub(super) fn found_after(&mut self, off: Pose) -> f64 {
        let pose = Pose::new(
            PLACE.x_mm + off.x_mm,
            PLACE.y_mm + off.y_mm,
            PLACE.heading + off.heading,
        );
        self.mapper.set_pose(pose);
        let scan = self.scan();
        let found = self.mapper.locate(&scan).pose;
        f64::from(found.position().distance_mm(PLACE.position()))
    }

    /// The same from a start that is off by chance, within the spread of the candidates.
    pub(super) fn found_from_anywhere(&mut self) -> f64 {
        let [x, y] = [(); 2].map(|()| self.dice.range(-SPREAD_MM, SPREAD_MM));
        let turn = self.dice.range(-SPREAD_DEG, SPREAD_DEG).to_radians();
        #[expect(clippy::cast_possible_truncation, reason = "millimetres and radians")]
        let off = Pose::new(x as f32, y as f32, turn as f32);
        self.found_after(off)
    }
}

fn log(seed: u64, tries: Option<u16>) -> Log {
    let mut run = start(ROOM, seed, |scenario| {
        let tuning = TuningSpec {
            tries,
            ..TuningSpec::default()
        };
        as_reported(scenario, tuning);
        scenario.world.push = vec![PushSpec {
            at: Span::from_millis(PUSH_AT_MS),
            by_m: PUSH_M,
            turn_deg: 0.0,
            over: Span::from_millis(1_000),
        }];
    });
    let mut last = Instant::from_millis(PUSH_AT_MS);
    let mut log = Log {
        better: Vec::new(),
        found: Vec::new(),
        off: Vec::new(),
    };
    let mut settled = [0.0; 2];
    while run.rig.now() < Instant::from_millis(SETTLED_MS) + Duration::from_secs(1) {
        run.step();
        let found = run.rig.program().and_then(|program| program.estimate());
        let Some((at, estimate)) = found.filter(|(at, _)| *at > last) else {
            continue;
        };
        last = at;
        let place = in_metres(estimate).point();
        settled = [place.x * 1_000.0, place.y * 1_000.0];
        if at < Instant::from_millis(SETTLED_MS) {
            let search = log.found.len();
            log.found.push(settled);
            let program = run.rig.program_as::<Rescue>();
            let better = program.map(Rescue::improvements).unwrap_or_default();
            log.better.extend(better.iter().map(|one| Better {
                search,
                at: [f64::from(one.pose.x_mm), f64::from(one.pose.y_mm)],
            }));
        }
    }
    let truth = 1_000.0 * run.rig.world.pose().y;
    let unsettled = log.found.iter();
    log.off = unsettled.map(|at| (at[1] - truth).abs()).collect();
    let from_end = |at: &mut [f64; 2]| {
        *at = [0, 1].map(|axis| (at[axis] - settled[axis]).abs());
    };
    log.found.iter_mut().for_each(from_end);
    log.better.iter_mut().for_each(|one| from_end(&mut one.at));
    log
}
