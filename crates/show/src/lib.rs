//! Presentation of results: the result folder, its report, maps and pictures.

pub mod folder;
pub mod html;
#[cfg(feature = "junit")]
pub mod junit;
pub mod meaning;
mod metrics;
pub mod moment;
pub mod render;
pub mod report;
pub mod shell;
mod summary;
pub mod view;

pub use summary::Summary;
