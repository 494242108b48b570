//! Experiments of the reports, repeated in the rig: a table and a plot beside the report's figures.
//!
//! ```text
//! experiment --plan: seeds--> runs in virtual time --> findings: table, plot, figures
//! ```
//!
//! Each experiment is a row of [`all`]. Its findings come only from runs. The figure of the report
//! is printed beside them as text, without a verdict: the reader judges the accuracy of the model.

mod car;
mod heading;
pub mod judged;
mod loss;
mod mazes;
mod plot;
mod push;
mod regulator;
mod runs;
mod table;
mod tries;
mod turning;

use core::ops::Range;

pub use plot::Plot;
pub use table::Table;

/// Plan of an experiment.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// The first seed.
    pub first_seed: u64,
    /// Number of consecutive seeds.
    pub seeds: u64,
    /// Number of parallel runs.
    pub jobs: usize,
}

impl Plan {
    fn seeds(&self) -> Range<u64> {
        self.first_seed..self.first_seed.saturating_add(self.seeds)
    }

    fn count(&self) -> usize {
        usize::try_from(self.seeds).unwrap_or(usize::MAX).max(1)
    }
}

/// A result figure, and the figure of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// A short description.
    pub name: String,
    /// Our figure with its unit.
    pub ours: String,
    /// The figure of the report; empty if it has none.
    pub report: &'static str,
}

impl Figure {
    fn new(name: impl Into<String>, ours: impl Into<String>, report: &'static str) -> Self {
        Self {
            name: name.into(),
            ours: ours.into(),
            report,
        }
    }
}

/// Results of an experiment.
#[derive(Clone, Debug)]
pub struct Findings {
    /// The whole table.
    pub table: Table,
    /// Our version of the report's plot.
    pub plot: Plot,
    /// Figures that summarise the result.
    pub figures: Vec<Figure>,
}

/// An experiment of a report.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Name on the command line.
    pub name: &'static str,
    /// Short description of the experiment.
    pub about: &'static str,
    /// Place in the report.
    pub place: &'static str,
    /// Default seeds.
    pub seeds: Range<u64>,
    /// Performs the experiment; calls back with the number of finished runs and of all runs.
    pub perform: fn(&Plan, &(dyn Fn(usize, usize) + Sync)) -> Findings,
}

/// All experiments.
pub const fn all() -> &'static [Experiment] {
    &EXPERIMENTS
}

const EXPERIMENTS: [Experiment; 12] = [
    Experiment {
        name: "push",
        about: "a robot at rest is pushed by 40 cm within a second: error against the truth afterwards",
        place: "rescue robot, figure 8",
        seeds: 1..21,
        perform: push::perform,
    },
    Experiment {
        name: "turning",
        about: "20 minutes along walls: how far the map turns, with the report's cures and without",
        place: "rescue robot, figure 7",
        seeds: 1..21,
        perform: turning::perform,
    },
    Experiment {
        name: "tries",
        about: "error of the pose by the number of tries of a search",
        place: "rescue robot, page 15",
        seeds: 1..21,
        perform: tries::by_number,
    },
    Experiment {
        name: "settings",
        about: "points, weights and hole width of the report's mapper against each other",
        place: "rescue robot, pages 14 to 16 and 22",
        seeds: 1..21,
        perform: tries::by_settings,
    },
    Experiment {
        name: "regulator",
        about: "time of each search while the number of tries is regulated",
        place: "rescue robot, page 16 and figure 9",
        seeds: 1..11,
        perform: regulator::perform,
    },
    Experiment {
        name: "loss",
        about: "map rows lost by the radio module against its baud rate",
        place: "rescue robot, page 8",
        seeds: 1..6,
        perform: loss::perform,
    },
    Experiment {
        name: "heading",
        about: "wheels that slip: error of the dead-reckoned heading with a gyroscope and without",
        place: "rescue robot, outlook on page 22",
        seeds: 1..21,
        perform: heading::perform,
    },
    Experiment {
        name: "mazes",
        about: "mazes of five sizes, searched; time and path against a robot that knows the map",
        place: "rescue robot, pages 1, 5 and 22",
        seeds: 7_000..7_020,
        perform: mazes::perform,
    },
    car::LEVELS,
    car::CIRCLE,
    car::HALL,
    car::WALL,
];
