//! Measures of Yellow.

mod correlation;
mod maps;
mod missions;
mod sight;
mod threads;
mod walls;

pub(super) use maps::{LOCAL_MAP, ROADMAP};
pub(super) use missions::{ARRIVAL, GLOBAL_MAP, LOST_COMMANDS, MARGIN, NEXT_VIEW, REACTIVE};
pub(super) use sight::LOCALISED;
pub(super) use threads::THREADS;
pub(super) use walls::{AVERAGING, LINES, REGIONS};
