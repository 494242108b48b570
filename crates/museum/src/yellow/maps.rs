//! Maps, paths and localisation on the PC.

use firmware_core::grid::{FREE, OBSTACLE, UNKNOWN};
use firmware_core::map_view::MapView;
use firmware_core::robots::yellow::pc::{PcCommand, PcConfig, TaskState};

use super::desk::{BY, Desk, closed, config, room};
use crate::{Bug, Observation, Variant};

const MAPS: &str = "PC's program, maps";
const WAYS: &str = "PC's program, navigation";

pub(super) const ROWS: [Bug; 7] = [
    Bug::new(
        "YP-06",
        MAPS,
        "positions are cell numbers of 8 bits: everything beyond 12.7 m is drawn at 12.7 m",
        BY,
        yp_06,
    ),
    Bug::new(
        "YP-07",
        MAPS,
        "the map grows by a wide margin and keeps it",
        BY,
        yp_07,
    ),
    Bug::new(
        "YP-08",
        MAPS,
        "scans are drawn at the pose of the odometry: 8 cm of slip draw a second row of walls",
        BY,
        yp_08,
    ),
    Bug::new(
        "YP-09",
        WAYS,
        "one roadmap of 100 points: in narrow corridors every second one contains no path",
        BY,
        yp_09,
    ),
    Bug::new(
        "YP-09b",
        MAPS,
        "views are chosen at random: the robot tries without end to see cells behind a crack",
        "the PC's program with the way YP-09",
        yp_09b,
    ),
    Bug::new(
        "YP-10",
        WAYS,
        "a goal is repeated only if the robot has not moved: never if it stopped halfway",
        BY,
        yp_10,
    ),
    Bug::new(
        "YP-11",
        WAYS,
        "of two similar rooms the first match is used: the robot may receive a wrong pose",
        BY,
        yp_11,
    ),
];

/// A desk whose robot has scanned a closed room once.
fn looked(config: PcConfig, at: [f32; 2]) -> Desk {
    let mut desk = Desk::new(config);
    desk.at = at;
    desk.walls = room(at);
    desk.run(400);
    desk.command(PcCommand::MapStart);
    desk.run_task(30_000);
    desk
}

fn yp_06(variant: Variant) -> Observation {
    let desk = looked(config(variant, "YP-06"), [20.05, 0.05]);
    let map = desk.pc.global_map().expect("there was a look");
    let right = map.origin_mm()[0] + cells(map.width()) * map.cell_mm();
    let mut seen = Observation::default();
    let name = "right edge of the map of a room at 20 m, m";
    seen.figure(name, format!("{:.1}", right / 1_000.0));
    seen.judged(right < 16_000.0)
}

fn yp_07(variant: Variant) -> Observation {
    let desk = looked(config(variant, "YP-07"), [0.05, 0.05]);
    let map = desk.pc.global_map().expect("there was a look");
    let is_known = |column: &usize| {
        let cells = (0..map.height()).filter_map(|row| map.get(*column, row));
        cells.into_iter().any(|cell| cell != UNKNOWN)
    };
    let unknown = (0..map.width()).take_while(|column| !is_known(column));
    let unknown = unknown.count();
    let mut seen = Observation::default();
    let name = "unknown columns beside the outermost wall";
    seen.figure(name, unknown);
    seen.judged(unknown > 5)
}

/// The robot stays in its position, but its believed pose is 8 cm farther at the second scan.
fn yp_08(variant: Variant) -> Observation {
    let mut desk = looked(config(variant, "YP-08"), [0.05, 0.05]);
    let before = walls(&desk);
    desk.off[0] += 0.08;
    desk.run(400);
    desk.command(PcCommand::MapStart);
    desk.run_task(30_000);
    let after = walls(&desk);
    let mut seen = Observation::default();
    seen.figure("cells of wall after one look", before);
    seen.figure("after another one, 8 cm of slip later", after);
    seen.judged(after > before + 20)
}

fn walls(desk: &Desk) -> usize {
    let map = desk.pc.global_map().expect("there was a look");
    map.cells().iter().filter(|cell| **cell == OBSTACLE).count()
}

#[expect(clippy::cast_precision_loss, reason = "hundreds of cells")]
fn cells(count: usize) -> f32 {
    count as f32
}

/// A saved map.
struct Saved {
    width: usize,
    cells: Vec<u8>,
}

impl Saved {
    /// A map whose cell at a column and row is given by `cell`.
    fn of(width: usize, height: usize, cell: impl Fn(usize, usize) -> u8) -> Self {
        let rows = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let cells = rows.map(|(column, row)| cell(column, row)).collect();
        Self { width, cells }
    }

    fn view(&self) -> MapView<'_> {
        MapView::new(self.width, 100.0, [0.0; 2], &self.cells)
    }
}

/// Middle of a cell, metres.
fn middle(cell: u8) -> f32 {
    f32::from(cell) / 10.0 + 0.05
}

/// A desk with this map and the robot in the cell `at`.
fn with_map(config: PcConfig, map: &Saved, at: [u8; 2]) -> Desk {
    let mut desk = Desk::new(config);
    desk.pc.load_map(&map.view()).expect("a small map");
    desk.at = at.map(middle);
    desk.run(400);
    desk
}

fn to(at: [u8; 2]) -> PcCommand {
    let [x_m, y_m] = at.map(middle);
    PcCommand::Navigate {
        x_m,
        y_m,
        heading_rad: None,
    }
}

/// Six corridors of 0.5 m width and 3.5 m length, joined at alternating ends.
fn serpentine() -> Saved {
    Saved::of(37, 37, |column, row| {
        let is_edge = column == 0 || column == 36 || row == 0 || row == 36;
        let is_open = match row / 6 % 2 {
            0 => column < 6,
            _ => column > 30,
        };
        let is_wall = is_edge || row % 6 == 0 && !is_open;
        if is_wall { OBSTACLE } else { FREE }
    })
}

fn yp_09(variant: Variant) -> Observation {
    let map = serpentine();
    let config = config(variant, "YP-09");
    let found = (0..10).filter(|seed| {
        let config = PcConfig {
            seed: *seed,
            ..config
        };
        let mut desk = with_map(config, &map, [3, 3]);
        desk.command(to([3, 33]));
        desk.run(400);
        let (_, _, way) = desk.pc.roadmap();
        !way.is_empty()
    });
    let found = found.count();
    let mut seen = Observation::default();
    let name = "of 10 roadmaps of a serpentine, those with a way";
    seen.figure(name, found);
    seen.judged(found < 10)
}

/// A room of 2 m whose right wall has a gap of three cells; nothing behind the gap is ever visible.
fn yp_09b(variant: Variant) -> Observation {
    let mut desk = Desk::new(config(variant, "YP-09"));
    desk.at = [0.05, 0.05];
    let corners = [[1.05, 0.22], [1.05, 1.05], [-0.95, 1.05], [-0.95, -0.95]];
    let ends = [[1.05, -0.95], [1.05, -0.12]];
    let way = [&corners[..], &ends[..]].concat();
    let walls = way.windows(2);
    desk.walls = walls
        .map(|ends| [ends[0][0], ends[0][1], ends[1][0], ends[1][1]])
        .collect();
    desk.run(400);
    desk.command(PcCommand::MapStart);
    let status = desk.run_task(60_000);
    let mut seen = Observation::default();
    seen.figure("the map after a minute", status);
    seen.figure("looks", desk.counter("views"));
    seen.judged(status != "done")
}

/// An L-shaped room, so that a robot that stopped halfway can localise itself.
fn yp_10(variant: Variant) -> Observation {
    let map = Saved::of(21, 21, ell);
    let mut desk = with_map(config(variant, "YP-10"), &map, [3, 5]);
    let corners = [[0, 0], [20, 0], [20, 10], [10, 10], [10, 20], [0, 20]];
    desk.walls = closed(&corners.map(|corner| corner.map(middle)));
    desk.stops_halfway = 1;
    desk.command(to([17, 5]));
    let status = desk.run_task(15_000);
    let goals = desk.commands.iter();
    let goals = goals.filter(|(_, command)| command.desired_pose.is_some());
    let goals = goals.count();
    let resends = desk.counter("re-sends");
    let mut seen = Observation::default();
    seen.figure("the drive after 15 s", status);
    seen.figure("goals that the robot was told", goals);
    seen.figure("of them told again", resends);
    seen.judged(desk.pc.task_state() == TaskState::InProgress)
}

/// Two L-shaped rooms side by side without a door; the robot is in the second one.
fn yp_11(variant: Variant) -> Observation {
    let map = Saved::of(55, 22, |column, row| match column {
        0..=20 => ell(column, row),
        30..=50 => ell(column - 30, row),
        _ => UNKNOWN,
    });
    let mut desk = with_map(config(variant, "YP-11"), &map, [35, 5]);
    let corners = [[30, 0], [50, 0], [50, 10], [40, 10], [40, 20], [30, 20]];
    desk.walls = closed(&corners.map(|corner| corner.map(middle)));
    desk.off = [-1.0, 0.3];
    desk.run(400);
    desk.command(PcCommand::Localise);
    desk.run(4_000);
    let mut commands = desk.commands.iter();
    let told = commands.find_map(|(_, command)| command.corrected_pose);
    let estimate = desk.pc.estimate();
    let mut seen = Observation::default();
    let ratio = estimate.map_or(0.0, |found| found.ratio);
    let name = "the second best place, as a part of the best";
    seen.figure(name, format!("{ratio:.2}"));
    let name = "pose told to the robot after one look";
    seen.figure(name, if told.is_some() { "yes" } else { "none" });
    seen.judged(told.is_some())
}

/// A square of 2.1 m without its upper right quarter.
fn ell(column: usize, row: usize) -> u8 {
    let is_inside = row <= 20 && (column <= 10 || row <= 10);
    let is_edge = column == 0
        || row == 0
        || column == 20
        || row == 20
        || column == 10 && row >= 10
        || row == 10 && column >= 10;
    match (is_inside, is_edge) {
        (false, _) => UNKNOWN,
        (true, true) => OBSTACLE,
        (true, false) => FREE,
    }
}
