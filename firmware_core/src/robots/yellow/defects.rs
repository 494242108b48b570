//! The defects of the fielded program, each behind its own number.
//!
//! | numbers | are about |
//! |---|---|
//! | YF | framing and messages of the PC link |
//! | YL | lidar driver and its set |
//! | YS | state machine |
//! | YM | motion control and odometry |
//! | YA | manoeuvres to a pose |
//! | YN | lines |
//! | YR | reactive driving |
//!
//! All were found in the public code of the robot; YF-05 follows from the field numbers of its
//! messages.

use super::{Config, autoposition, infrared, lidar, radio, reactive, state, wheels};
use crate::lines;

/// Enabled defects of the fielded program; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Defects of the PC link.
    pub radio: radio::Defects,
    /// Defects of the lidar's driver.
    pub lidar: lidar::Defects,
    /// Defects of the state machine.
    pub state: state::Defects,
    /// Defects of motion control and odometry.
    pub wheels: wheels::Defects,
    /// Defects of manoeuvres.
    pub autoposition: autoposition::Defects,
    /// Defects of the search for lines.
    pub lines: lines::Defects,
    /// Defects of the reactive drive.
    pub reactive: reactive::Defects,
    /// Defects of the IR sensors.
    pub infrared: infrared::Defects,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        radio: radio::Defects::NONE,
        lidar: lidar::Defects::NONE,
        state: state::Defects::NONE,
        wheels: wheels::Defects::NONE,
        autoposition: autoposition::Defects::NONE,
        lines: lines::Defects::NONE,
        reactive: reactive::Defects::NONE,
        infrared: infrared::Defects::NONE,
    };
}

/// Function that enables a defect.
type Switch = fn(&mut Defects);

/// All defects of the program.
#[rustfmt::skip]
const SWITCHES: [(&str, Switch); 25] = [
    ("YF-01", |d| d.radio.framing.deliver_corrupt = true),
    ("YF-02", |d| d.radio.framing.ignore_start = true),
    ("YF-03", |d| d.radio.framing.deaf_while_done = true),
    ("YF-04", |d| d.radio.resends_stale = true),
    ("YF-05", |d| d.radio.obeys_itself = true),
    ("YL-01", |d| d.lidar.unchecked = true),
    ("YL-02", |d| {
        d.lidar.unchecked = true;
        d.lidar.skips_once = true;
    }),
    ("YL-03", |d| d.lidar.scans.whole_degrees = true),
    ("YL-04", |d| {
        d.lidar.notices_no_silence = true;
        d.lidar.scans.never_ages = true;
    }),
    ("YL-05", |d| d.lidar.scans.copies = true),
    ("YS-01", |d| d.state.manual_never_ends = true),
    // In the fielded machine the manoeuvre's end and the erasure of the order are 10 ms apart.
    ("YS-02", |d| {
        d.state.end_erases_order = true;
        d.state.is_slow = true;
    }),
    ("YS-03", |d| d.state.is_slow = true),
    ("YM-01", |d| d.wheels.replaces_jumps = true),
    ("YM-02", |d| d.wheels.end_point_rule = true),
    ("YM-03", |d| d.wheels.proportional_only = true),
    ("YA-01", |d| d.autoposition.turns_the_long_way = true),
    ("YA-02", |d| d.autoposition.keeps_the_step = true),
    ("YN-01", |d| d.lines.merges_below_80_deg = true),
    ("YN-02", |d| d.lines.skips_behind_erased = true),
    ("YN-03", |d| d.lines.duplicates_last = true),
    ("YN-04", |d| d.lines.drops_first = true),
    ("YN-05", |d| d.lines.draws_chords = true),
    ("YR-01", |d| d.reactive.fielded_formula = true),
    ("YR-02", |d| d.infrared.reads_short = true),
];

impl Config {
    /// Numbers of the defects that [`with_defect`](Self::with_defect) knows.
    pub fn defects() -> impl Iterator<Item = &'static str> {
        SWITCHES.iter().map(|(id, _)| *id)
    }

    /// The robot with the defect `id` of the fielded program; `None` if the id is unknown.
    pub fn with_defect(mut self, id: &str) -> Option<Self> {
        let (_, switch) = SWITCHES.iter().find(|(known, _)| *known == id)?;
        switch(&mut self.defects);
        Some(self)
    }

    /// The robot with every defect of the fielded program.
    #[must_use]
    pub fn fielded(mut self) -> Self {
        for (_, switch) in SWITCHES {
            switch(&mut self.defects);
        }
        self
    }
}
