//! `--ui`: the running mapper on a page.

use std::path::Path;

use clap::Args;

use crate::cli::CliError;
use crate::slam::look::Look;
use crate::slam::survey::Survey;
#[cfg(feature = "ui")]
use {
    crate::cli::stop::Stop,
    crate::cli::ui::ListenArgs,
    crate::realtime::clock::{Clock as _, WallClock},
    crate::robots::{Overlay, OverlayRole, Panel, PanelRow},
    crate::slam::motion::moved,
    ::ui::{Hub, Known, MapperDesk, Server},
    core::time::Duration,
    emulators::world::Pose,
    protocols::Instant,
    std::borrow::Cow,
    std::sync::Arc,
};

/// The option for the page.
#[derive(Debug, Args)]
pub(super) struct PageArgs {
    /// Show the running mapper on a page in the browser, at this TCP port of this machine or any
    /// free one: at a hundred times the log's pace, or as set on the page; it stays until Ctrl-C
    #[cfg(feature = "ui")]
    #[arg(long = "ui", value_name = "PORT", num_args = 0..=1, require_equals = true,
          default_missing_value = "0")]
    port: Option<u16>,
}

impl PageArgs {
    /// Starts the page for the log at `path` with `scans` scans, if one is wanted.
    #[cfg(feature = "ui")]
    pub(super) fn start(&self, path: &Path, scans: usize) -> Result<Page, CliError> {
        let Some(port) = self.port else {
            return Ok(Page(None));
        };
        let (hub, clock) = (Hub::new(), WallClock::start());
        let server = ListenArgs::local(port).serve("--ui", Arc::clone(&hub))?;
        let name = path.file_name().unwrap_or(path.as_os_str());
        let desk = MapperDesk::new(hub, &name.to_string_lossy(), clock.now());
        Ok(Page(Some(Box::new(Open {
            desk,
            _server: server,
            stop: Stop::new(None)?,
            clock,
            scans,
            tally: Tally::default(),
            last: None,
        }))))
    }

    /// Always `None`: this build has no page.
    #[cfg(not(feature = "ui"))]
    pub(super) fn start(&self, _path: &Path, _scans: usize) -> Result<Page, CliError> {
        Ok(Page())
    }
}

/// The page, if there is one.
pub(super) struct Page(#[cfg(feature = "ui")] Option<Box<Open>>);

#[cfg(not(feature = "ui"))]
impl Page {
    /// Does nothing: this build has no page.
    pub(super) fn look(&mut self, _look: &Look<'_>) {}

    /// Does nothing: this build has no page.
    pub(super) fn stay(&mut self, _survey: &Survey) {}
}

#[cfg(feature = "ui")]
struct Open {
    desk: MapperDesk,
    _server: Server,
    stop: Stop,
    clock: WallClock,
    scans: usize,
    tally: Tally,
    last: Option<Known>,
}

/// The counts.
#[cfg(feature = "ui")]
#[derive(Default)]
struct Tally {
    first_s: Option<f64>,
    way_m: f64,
    doubtful: usize,
    jumps: usize,
    loops: usize,
}

#[cfg(feature = "ui")]
impl Page {
    /// Shows the state after a scan, if an update is due.
    pub(super) fn look(&mut self, look: &Look<'_>) {
        if let Some(open) = &mut self.0 {
            open.look(look);
        }
    }

    /// Shows the result of a finished log until the user ends the page.
    pub(super) fn stay(&mut self, survey: &Survey) {
        let Some(open) = &mut self.0 else {
            return;
        };
        open.show_last(survey);
        if open.stop.signal().is_none() {
            println!("the page stays until Ctrl-C");
        }
        open.desk.end();
        while !open.stop.is_due(open.clock.now()) {
            open.desk.stay(&open.clock);
        }
    }
}

/// Longest log on the timeline, seconds: three years.
#[cfg(feature = "ui")]
const LONGEST_S: f64 = 1e8;

#[cfg(feature = "ui")]
impl Open {
    fn look(&mut self, look: &Look<'_>) {
        let first_s = *self.tally.first_s.get_or_insert(look.shot.at_s);
        let since_s = (look.shot.at_s - first_s).clamp(0.0, LONGEST_S);
        let at = Instant::ZERO + Duration::from_secs_f64(since_s);
        let stop = &self.stop;
        let is_ended = || stop.signal().is_some();
        self.desk.wait(at, &self.clock, &is_ended);
        self.count(look);
        let began = self.clock.now();
        let is_watched = self.stop.signal().is_none() && self.desk.is_due(began);
        if is_watched || look.done == self.scans {
            let known = self.known(look);
            self.desk.show(&known, began, &self.clock);
            self.last = Some(known);
        }
    }

    fn count(&mut self, look: &Look<'_>) {
        self.tally.way_m += libm::hypot(look.shot.moved.x, look.shot.moved.y);
        if let Some(jump) = look.jump {
            self.tally.jumps += 1;
            let (far_m, turned) = (jump.far_m, jump.turned_deg);
            let words = format!("{far_m:.2} m and {turned:.1} degrees away from the wheels");
            self.desk.tell("jump", words);
        }
        if look.sureness.is_some_and(|sure| sure.is_doubtful) {
            self.tally.doubtful += 1;
            let words = "too little of the scan is on walls: the pose follows the odometry";
            self.desk.tell("doubtful", words.to_owned());
        }
    }

    /// Shows the final state: the last optimisation may have moved the poses.
    fn show_last(&mut self, survey: &Survey) {
        let Some(mut known) = self.last.take() else {
            return;
        };
        let way: Vec<Pose> = survey.way.iter().map(|(_, pose)| *pose).collect();
        known.pose = way.last().copied().unwrap_or(known.pose);
        known.overlays = overlays(&way, &survey.loops());
        let map = &survey.map;
        if map.width.max(map.height) <= CELLS_MAX {
            known.size = [map.width, map.height];
            known.cell_m = map.cell_m;
            known.corner_m = map.corner;
            known.cells.clone_from(&map.cells);
        }
        if let Some(parts) = survey.parts.filter(|parts| *parts > 1) {
            let words = format!("the map has {parts} parts; their relative positions are unknown");
            self.desk.tell("not-joined", words);
        }
        self.desk.show(&known, self.clock.now(), &self.clock);
    }

    fn known(&mut self, look: &Look<'_>) -> Known {
        let way = look.so_far.way();
        let loops = look.so_far.loops();
        if loops.len() > self.tally.loops {
            let more = loops.len() - self.tally.loops;
            self.desk
                .tell("seen-again", format!("places seen again: {more}"));
        }
        self.tally.loops = loops.len();
        let map = look.so_far.map(cell_m(&way));
        let ends = look.shot.points.iter().flat_map(|point| {
            let [x, y] = [point.x_mm, point.y_mm].map(|mm| f64::from(mm) / 1000.0);
            let end = moved(look.pose, Pose::new(x, y, 0.0));
            [end.x, end.y]
        });
        Known {
            state: format!("{} of {} scans", look.done, self.scans),
            pose: look.pose,
            scan: ends.collect(),
            overlays: overlays(&way, &loops),
            panels: self.panels(look),
            size: [map.width, map.height],
            cell_m: map.cell_m,
            corner_m: map.corner,
            cells: map.cells,
        }
    }

    fn panels(&self, look: &Look<'_>) -> Vec<Panel> {
        let row = |name: &'static str, value: String, unit: &'static str| PanelRow {
            name: Cow::Borrowed(name),
            address: None,
            value,
            unit: Cow::Borrowed(unit),
        };
        let count = |name, count: usize| row(name, count.to_string(), "");
        let tally = &self.tally;
        let mut panels = vec![Panel {
            name: "mapper".to_owned(),
            rows: vec![
                count("scans", look.done),
                row("way by the wheels", format!("{:.1}", tally.way_m), "m"),
                count("keyframes", look.so_far.keyframes()),
                count("places seen again", tally.loops),
                count("jumps", tally.jumps),
                count("doubtful scans", tally.doubtful),
            ],
        }];
        panels.extend(look.sureness.map(|sure| {
            let [x, y, heading] = sure.deviation;
            let mm = |metres: f64| format!("{:.1}", metres * 1000.0);
            let degrees = format!("{:.2}", heading.to_degrees());
            Panel {
                name: "newest scan".to_owned(),
                rows: vec![
                    row(
                        "on known walls",
                        format!("{:.0}", sure.quality * 100.0),
                        "%",
                    ),
                    row("deviation along x", mm(x), "mm"),
                    row("deviation along y", mm(y), "mm"),
                    row("deviation of heading", degrees, "deg"),
                ],
            }
        }));
        panels
    }
}

/// Maximum number of columns and rows of a map that a page draws once.
#[cfg(feature = "ui")]
const CELLS_MAX: usize = 6000;
/// Maximum number of cells along the longer edge of a map that a page draws many times a second.
#[cfg(feature = "ui")]
const CELLS_ACROSS: f64 = 800.0;
/// Margin of the map around the path so far, metres.
#[cfg(feature = "ui")]
const SEEN_M: f64 = 10.0;

/// Cell size that keeps a map of this path below the maximum number of cells, metres.
#[cfg(feature = "ui")]
fn cell_m(way: &[Pose]) -> f64 {
    let span = |axis: fn(&Pose) -> f64| {
        let least = way.iter().map(axis).fold(f64::MAX, f64::min);
        let most = way.iter().map(axis).fold(f64::MIN, f64::max);
        (most - least).max(0.0) + 2.0 * SEEN_M
    };
    let across = span(|pose| pose.x).max(span(|pose| pose.y));
    let mut cell_m = 0.05;
    while across / cell_m > CELLS_ACROSS {
        cell_m *= 2.0;
    }
    cell_m
}

/// Maximum number of points in an overlay's line.
#[cfg(feature = "ui")]
const PLACES_MAX: usize = 1900;
/// Maximum number of drawn loop closures.
#[cfg(feature = "ui")]
const LOOPS_MAX: usize = 900;

#[cfg(feature = "ui")]
fn overlays(way: &[Pose], loops: &[[Pose; 2]]) -> Vec<Overlay> {
    let place = |pose: &Pose| [pose.x, pose.y];
    let each = way.len().div_ceil(PLACES_MAX).max(1);
    let places = way.iter().rev().step_by(each).map(place);
    let trace = Overlay::new("way", OverlayRole::Guess).line(places);
    let each = loops.len().div_ceil(LOOPS_MAX).max(1);
    let again = Overlay::new("places seen again", OverlayRole::Possible);
    let ends = loops.iter().step_by(each).map(|ends| ends.each_ref());
    let again = ends.fold(again, |all, ends| all.line(ends.map(place)));
    vec![trace, again]
}
