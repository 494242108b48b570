//! What people look at: the page, the report, maps and pictures, the result folder.

pub mod folder;
mod meaning;
mod metrics;
pub(crate) mod moment;
pub mod render;
pub mod report;
#[cfg(feature = "ui")]
pub(crate) mod ui;
pub mod view;
