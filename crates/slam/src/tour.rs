//! Mapping of a log with the mapper that closes loops, and localisation on an existing map.

use crate::mapping::{Localiser, Mapper, Outcome, Settings, Sheet, Shot, UNKNOWN, WallPoint};
use emulators::world::Pose as Place;
use firmware_core::pose::{Point, Pose};

use super::Log;
use super::look::{Jump, Look, SoFar, Sureness};
use super::motion::moved;
use super::survey::Survey;
use realtime::clock::{Clock, thread_cpu_time};

/// The settings of the mapper.
#[derive(Clone, Copy, Debug)]
pub struct Wish {
    /// Edge of a cell of the map, metres.
    pub cell_m: f64,
    /// Whether loop closures are searched.
    pub closes_loops: bool,
    /// Errors of the odometry, relative to the usual ones.
    pub noise: f64,
}

impl Default for Wish {
    fn default() -> Self {
        Self {
            cell_m: 0.05,
            closes_loops: true,
            noise: 1.0,
        }
    }
}

/// Maps `log`; `look` gets the state after each scan.
pub fn tour(log: &Log, wish: &Wish, clock: &dyn Clock, look: &mut dyn FnMut(&Look<'_>)) -> Survey {
    let mut mapper = Mapper::new(Settings {
        closes_loops: wish.closes_loops,
        start: log.start,
        noise: wish.noise,
    });
    let before = thread_cpu_time();
    let mut survey = each_scan(log, clock, look, &mut mapper);
    mapper.finish();
    survey.map = mapper.sheet(wish.cell_m);
    survey.cpu = before.and_then(|before| thread_cpu_time()?.checked_sub(before));
    let times = log.shots.iter().map(|shot| shot.at_s);
    survey.way = times.zip(mapper.way()).collect();
    survey.ambiguous = mapper.ambiguous();
    survey.dropped_loops = mapper.dropped_loops();
    survey.parts = mapper.parts();
    if survey.parts.is_some() {
        survey.scan_parts = mapper.scan_parts();
    }
    survey.doubt = mapper.doubt();
    survey.unsure_joins = mapper.unsure_joins();
    survey.accuracy = mapper.accuracy();
    survey.walls = mapper.walls();
    survey.graph = mapper.graph().clone();
    survey
}

/// Locates each scan of `log` on a known map, which does not change.
pub fn locate(
    log: &Log,
    walls: &[WallPoint],
    wish: &Wish,
    clock: &dyn Clock,
    look: &mut dyn FnMut(&Look<'_>),
) -> Survey {
    let settings = Settings {
        start: log.start,
        noise: wish.noise,
        ..Settings::default()
    };
    let mut found = OnMap {
        localiser: Localiser::new(settings, walls),
        walls,
    };
    let before = thread_cpu_time();
    let mut survey = each_scan(log, clock, look, &mut found);
    survey.cpu = before.and_then(|before| thread_cpu_time()?.checked_sub(before));
    let times = log.shots.iter().map(|shot| shot.at_s);
    survey.way = times.zip(found.way()).collect();
    survey.map = drawn(walls, wish.cell_m);
    survey
}

/// Finds the pose of each scan.
trait Finder: SoFar {
    fn find(&mut self, shot: &Shot<'_>) -> Outcome;
}

impl Finder for Mapper {
    fn find(&mut self, shot: &Shot<'_>) -> Outcome {
        self.take(shot)
    }
}

impl SoFar for Mapper {
    fn way(&self) -> Vec<Place> {
        self.way()
    }

    fn map(&self, cell_m: f64) -> Sheet {
        self.sheet(cell_m)
    }

    fn keyframes(&self) -> usize {
        self.graph().poses.len()
    }

    fn loops(&self) -> Vec<[Place; 2]> {
        self.graph().loops()
    }
}

/// A localiser on a given map.
struct OnMap<'a> {
    localiser: Localiser,
    walls: &'a [WallPoint],
}

impl Finder for OnMap<'_> {
    fn find(&mut self, shot: &Shot<'_>) -> Outcome {
        self.localiser.take(shot)
    }
}

impl SoFar for OnMap<'_> {
    fn way(&self) -> Vec<Place> {
        self.localiser.way().to_vec()
    }

    fn map(&self, cell_m: f64) -> Sheet {
        drawn(self.walls, cell_m)
    }
}

/// Processes each scan.
fn each_scan(
    log: &Log,
    clock: &dyn Clock,
    look: &mut dyn FnMut(&Look<'_>),
    finder: &mut dyn Finder,
) -> Survey {
    let mut survey = Survey::empty(log.shots.len());
    let mut here = log.start;
    for (done, shot) in log.shots.iter().enumerate() {
        let began = clock.now();
        let ends: Vec<[f32; 2]> = shot.points.iter().map(metres).collect();
        let outcome = finder.find(&Shot {
            moved: shot.moved,
            is_measured: shot.is_measured,
            ends: &ends,
        });
        survey.took.push(clock.now() - began);
        // The path begins with the first scan, whatever the earlier odometry was.
        let wheels = if done == 0 {
            here
        } else {
            moved(here, shot.moved)
        };
        let jump = Jump::between(shot.at_s, millimetres(wheels), millimetres(outcome.pose));
        let jump = jump.filter(|_| shot.is_measured);
        survey.jumps.extend(jump);
        survey.sureness.push(sureness(&outcome));
        here = outcome.pose;
        look(&Look {
            done: done + 1,
            shot,
            pose: here,
            sureness: survey.sureness.last().copied(),
            jump,
            so_far: &*finder,
        });
    }
    let sure = survey.sureness.iter();
    survey.doubtful = sure.filter(|sure| sure.is_doubtful).count();
    survey
}

/// Maximum number of cells in a picture of walls.
const CELLS_MAX: f64 = 64e6;

/// The walls as cells of this edge, or larger cells if there would be too many; all other cells are
/// unknown.
fn drawn(walls: &[WallPoint], cell_m: f64) -> Sheet {
    let places = || walls.iter().map(|wall| wall.at.map(f64::from));
    let least = places().fold([f64::MAX; 2], |a, b| [a[0].min(b[0]), a[1].min(b[1])]);
    let most = places().fold([f64::MIN; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
    let mut cell_m = cell_m;
    while (most[0] - least[0] + 2.0) * (most[1] - least[1] + 2.0) / (cell_m * cell_m) > CELLS_MAX {
        cell_m *= 2.0;
    }
    let corner = least.map(|metres| (libm::floor(metres / cell_m) - 10.0) * cell_m);
    let cell = |metres: f64, axis: usize| {
        #[expect(clippy::cast_possible_truncation, reason = "a few thousand")]
        #[expect(clippy::cast_sign_loss, reason = "inside")]
        let cell = ((metres - corner[axis]) / cell_m) as usize;
        cell
    };
    let (width, height) = (cell(most[0], 0) + 11, cell(most[1], 1) + 11);
    let mut cells = vec![UNKNOWN; width * height];
    for [x, y] in places() {
        cells[cell(y, 1) * width + cell(x, 0)] = u8::MAX;
    }
    Sheet {
        corner,
        cell_m,
        width,
        height,
        cells,
    }
}

fn sureness(outcome: &Outcome) -> Sureness {
    Sureness {
        quality: outcome.quality,
        deviation: [0, 1, 2].map(|axis| libm::sqrt(outcome.covariance[axis][axis].max(0.0))),
        is_doubtful: outcome.is_doubtful,
    }
}

fn metres(point: &Point) -> [f32; 2] {
    [point.x_mm / 1000.0, point.y_mm / 1000.0]
}

#[expect(clippy::cast_possible_truncation, reason = "millimetres of a building")]
fn millimetres(place: Place) -> Pose {
    Pose::new(
        (place.x * 1000.0) as f32,
        (place.y * 1000.0) as f32,
        place.theta as f32,
    )
}
