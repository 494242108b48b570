//! Defects of the fielded program by number.

use firmware_core::robots::apollo13::Defects;

/// Enables a defect.
type Switch = fn(&mut Defects);

/// All defects of the program.
const SWITCHES: [(&str, Switch); 8] = [
    ("AF-01", |it| it.reads_cr_as_nl = true),
    ("AF-02", |it| it.loses_frames = true),
    ("AF-03", |it| it.sums_exactly = true),
    ("AF-04", |it| it.floods = true),
    ("AF-05", |it| it.odometry.wrong_side = true),
    ("AF-06", |it| it.arbiter.both_persist = true),
    ("AF-07", |it| it.arbiter.never_silent = true),
    ("AF-08", |it| it.gates_as_fielded = true),
];

/// The numbers of all defects.
pub(super) fn ids() -> impl Iterator<Item = &'static str> {
    SWITCHES.iter().map(|(id, _)| *id)
}

/// Enables the defect `id`; returns whether it exists.
pub(super) fn switch_on(defects: &mut Defects, id: &str) -> bool {
    let found = SWITCHES.iter().find(|(known, _)| *known == id);
    if let Some((_, switch)) = found {
        switch(defects);
    }
    found.is_some()
}
