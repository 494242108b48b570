//! Mapping of a log with the robot's own mapper.

use core::time::Duration;

use crate::mapping::{Accuracy, Graph, Kind, Sheet, WallPoint};
use emulators::world::Pose as Place;
use firmware_core::grid::{Grid, UNKNOWN};
use firmware_core::pose::Pose;
use firmware_core::scan::Scan;
use firmware_core::slam::{Certainty, Mapper, Mode, Pushes, Settings};
use protocols::Instant;

use super::look::{Jump, Look, SoFar, Sureness};
use super::motion::change;
use super::{Log, Shot};
use realtime::clock::{Clock, thread_cpu_time};

/// Number of cells along an edge of a log's map: 102 m at the usual 50 mm.
pub const CELLS: usize = 2048;
/// Default edge of a cell.
pub const CELL_MM: f32 = 50.0;

/// The map of a log.
pub type LogGrid = Grid<CELLS, CELLS>;
type LogMapper = Mapper<CELLS, CELLS>;

/// Time of the search in the seed report: 14 ms plus 0.15 ms per try. Its number of tries depends
/// on this time, so the model is used instead of the host's clock.
const SEARCH_BASE_US: u64 = 14_000;
const SEARCH_TRY_US: u64 = 150;
/// Maximum motion between two scans of a log without odometry: a person carries the lidar slowly.
const UNMEASURED_MM: f32 = 100.0;
const UNMEASURED_RAD: f32 = 0.1;
/// Stack size of the working thread: a mapper of this size is on the stack before it moves to the
/// heap.
const STACK: usize = 64 << 20;

/// The settings for every log: the algorithm of the seed report, or ours.
pub fn settings(mode: Mode, cell_mm: f32) -> Settings {
    let settings = match mode {
        Mode::Core => Settings {
            pushes: Pushes::Unlikely,
            ..Settings::core(cell_mm)
        },
        Mode::Document => Settings {
            resolution_mm: cell_mm,
            hole_mm: 12.0 * cell_mm,
            ..Settings::document()
        },
    };
    #[expect(clippy::cast_precision_loss, reason = "a thousand or two")]
    let middle = CELLS as f32 / 2.0 * cell_mm;
    Settings {
        start: Pose::new(middle, middle, 0.0),
        ..settings
    }
}

/// Share of a scan on known walls below which it counts as poor.
const POOR: f64 = 0.5;

/// The result of a log.
#[derive(Debug)]
pub struct Survey {
    /// Time (s) and pose of each scan, in metres in the log's frame.
    pub way: Vec<(f64, Place)>,
    /// The drawn part of the map, in the log's frame.
    pub map: Sheet,
    /// Number of scans with an uncertain pose.
    pub doubtful: usize,
    /// Number of scans that matched several places.
    pub ambiguous: usize,
    /// Number of loops that were removed again; only if the mapper closes loops.
    pub dropped_loops: usize,
    /// Number of parts of the map that were not joined; only if the mapper closes loops.
    pub parts: Option<usize>,
    /// The part of each scan, from 1; only if the mapper closes loops.
    pub scan_parts: Vec<usize>,
    /// Share of the path that only scan matching confirms, 0 to 1; 1 if the map has several parts.
    /// Only if the mapper closes loops and the log has odometry.
    pub doubt: Option<f64>,
    /// Number of unknown motions across which only one place was recognised.
    pub unsure_joins: usize,
    /// The accuracy of the map, if the mapper states it.
    pub accuracy: Option<Accuracy>,
    /// Number of scans outside the map.
    pub outside: usize,
    /// Scans for which the mapper's pose is far from the odometry.
    pub jumps: Vec<Jump>,
    /// The uncertainty of each scan's pose; only if the mapper closes loops.
    pub sureness: Vec<Sureness>,
    /// The pose graph; only if the mapper closes loops.
    pub graph: Graph,
    /// Points of the walls; only if the mapper closes loops.
    pub walls: Vec<WallPoint>,
    /// Processing time of each scan.
    pub took: Vec<Duration>,
    /// Processor time of all threads, including observers, if the system reports it.
    pub cpu: Option<Duration>,
}

/// Maps `log`; `look` gets the state after each scan.
pub fn survey(
    log: &Log,
    settings: Settings,
    clock: &(dyn Clock + Sync),
    look: &mut (dyn FnMut(&Look<'_>) + Send),
) -> Survey {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(STACK);
        let work = move || run(log, settings, clock, look);
        let worker = thread
            .spawn_scoped(scope, work)
            .expect("a host has room for a thread");
        worker
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

fn run(
    log: &Log,
    settings: Settings,
    clock: &dyn Clock,
    look: &mut dyn FnMut(&Look<'_>),
) -> Survey {
    #[expect(clippy::cast_possible_truncation, reason = "an angle")]
    let heading = log.start.theta as f32;
    let settings = Settings {
        start: Pose::new(settings.start.x_mm, settings.start.y_mm, heading),
        ..settings
    };
    let mut mapper: Box<LogMapper> = Box::new(Mapper::new(settings));
    let middle = [log.start.x, log.start.y];
    let mut survey = Survey::empty(log.shots.len());
    let before = thread_cpu_time();
    for (done, shot) in log.shots.iter().enumerate() {
        let (began, jumps) = (clock.now(), survey.jumps.len());
        let certainty = survey.take(&mut mapper, shot, done == 0, middle);
        survey.took.push(clock.now() - began);
        look(&Look {
            done: done + 1,
            shot,
            pose: survey.way[done].1,
            sureness: None,
            jump: survey.jumps.get(jumps).copied(),
            so_far: &OnGrid {
                way: &survey.way,
                grid: mapper.grid(),
                middle,
            },
        });
        survey.doubtful += usize::from(certainty == Certainty::Doubtful);
        survey.ambiguous += usize::from(certainty == Certainty::Ambiguous);
    }
    survey.cpu = before.and_then(|before| thread_cpu_time()?.checked_sub(before));
    survey.map = sheet(mapper.grid(), middle);
    survey
}

/// The result of the robot's own mapper so far.
struct OnGrid<'a> {
    way: &'a [(f64, Place)],
    grid: &'a LogGrid,
    middle: [f64; 2],
}

impl SoFar for OnGrid<'_> {
    fn way(&self) -> Vec<Place> {
        self.way.iter().map(|(_, place)| *place).collect()
    }

    fn map(&self, _cell_m: f64) -> Sheet {
        sheet(self.grid, self.middle)
    }
}

impl Survey {
    /// An empty survey with room for `scans` scans.
    pub(super) fn empty(scans: usize) -> Self {
        Self {
            way: Vec::with_capacity(scans),
            map: Sheet {
                corner: [0.0; 2],
                cell_m: 1.0,
                width: 0,
                height: 0,
                cells: Vec::new(),
            },
            doubtful: 0,
            ambiguous: 0,
            dropped_loops: 0,
            parts: None,
            scan_parts: Vec::new(),
            doubt: None,
            unsure_joins: 0,
            accuracy: None,
            outside: 0,
            jumps: Vec::new(),
            sureness: Vec::new(),
            graph: Graph::default(),
            walls: Vec::new(),
            took: Vec::with_capacity(scans),
            cpu: None,
        }
    }

    fn take(
        &mut self,
        mapper: &mut LogMapper,
        shot: &Shot,
        is_first: bool,
        middle: [f64; 2],
    ) -> Certainty {
        let scan = Scan::from_points(&shot.points, Instant::ZERO, Instant::ZERO);
        // The path begins with the first scan, whatever the earlier odometry was.
        if !is_first {
            mapper.predict(change(shot.moved));
        }
        if !shot.is_measured {
            mapper.doubt(UNMEASURED_MM, UNMEASURED_RAD);
        }
        let wheels = mapper.pose();
        let outcome = mapper.integrate(&scan, [0, 0]);
        self.jumps
            .extend(Jump::between(shot.at_s, wheels, outcome.pose));
        let took = SEARCH_BASE_US + u64::from(outcome.tries) * SEARCH_TRY_US;
        mapper.search_time(Duration::from_micros(took));
        self.outside += usize::from(mapper.grid().cell_of(outcome.pose.position()).is_none());
        let start = mapper.settings().start;
        let [x, y, heading] = [
            outcome.pose.x_mm - start.x_mm,
            outcome.pose.y_mm - start.y_mm,
            outcome.pose.heading,
        ]
        .map(f64::from);
        let [x, y] = [x / 1000.0 + middle[0], y / 1000.0 + middle[1]];
        self.way.push((shot.at_s, Place::new(x, y, heading)));
        outcome.certainty
    }

    /// Number of edges between keyframes that are not neighbours.
    pub fn loop_edges(&self) -> usize {
        let edges = self.graph.edges.iter();
        edges.filter(|edge| edge.kind == Kind::Loop).count()
    }

    /// Loop closures, as pairs of robot poses.
    pub fn loops(&self) -> Vec<[Place; 2]> {
        self.graph.loops()
    }

    /// Number of scans of which less than half lies on known walls.
    pub fn poor(&self) -> usize {
        let scans = self.sureness.iter();
        scans.filter(|sure| sure.quality < POOR).count()
    }

    /// Median, maximum and sum of the processing times.
    pub fn times(&self) -> [Duration; 3] {
        let mut sorted = self.took.clone();
        sorted.sort_unstable();
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or_default();
        let longest = sorted.last().copied().unwrap_or_default();
        [median, longest, sorted.iter().sum()]
    }
}

/// The drawn part of the grid with a margin; `middle` is the centre of the grid.
fn sheet(grid: &LogGrid, middle: [f64; 2]) -> Sheet {
    let cell_m = f64::from(grid.resolution_mm()) / 1000.0;
    let [x0, x1, y0, y1] = drawn(grid).unwrap_or([CELLS / 2, CELLS / 2, CELLS / 2, CELLS / 2]);
    let [x0, y0] = [x0, y0].map(|cell| cell.saturating_sub(MARGIN));
    let [x1, y1] = [x1, y1].map(|cell| (cell + MARGIN).min(CELLS - 1));
    let metres = |cell: usize| (cell as f64 - CELLS as f64 / 2.0) * cell_m;
    Sheet {
        corner: [metres(x0) + middle[0], metres(y0) + middle[1]],
        cell_m,
        width: x1 - x0 + 1,
        height: y1 - y0 + 1,
        cells: (y0..=y1)
            .flat_map(|y| &grid.rows()[y][x0..=x1])
            .copied()
            .collect(),
    }
}

/// Width of the margin, cells.
const MARGIN: usize = 8;

/// First and last drawn column and row; `None` if the grid is empty.
fn drawn(grid: &LogGrid) -> Option<[usize; 4]> {
    let mut bounds = [usize::MAX, 0, usize::MAX, 0];
    for (y, row) in grid.rows().iter().enumerate() {
        let mut known = row.iter().enumerate().filter(|(_, cell)| **cell != UNKNOWN);
        let Some((first, _)) = known.next() else {
            continue;
        };
        let last = known.next_back().map_or(first, |(last, _)| last);
        bounds = [
            bounds[0].min(first),
            bounds[1].max(last),
            bounds[2].min(y),
            bounds[3].max(y),
        ];
    }
    (bounds[0] <= bounds[1]).then_some(bounds)
}
