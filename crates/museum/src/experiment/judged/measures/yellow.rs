//! Measures of Yellow.

mod maps;
mod missions;
mod sight;

pub(super) use maps::{LINES, LOCAL_MAP, ROADMAP};
pub(super) use missions::{
    ARRIVAL, GLOBAL_MAP, LOST_COMMANDS, MARGIN, NEXT_VIEW, REACTIVE, THREADS,
};
pub(super) use sight::LOCALISED;
