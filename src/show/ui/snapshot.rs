//! A run as it is at one snapshot, written out once for all pages.

use std::sync::Arc;

use axum::extract::ws::Utf8Bytes;

use super::map_layers::Layer;

/// What every page may get. Nothing in it ever changes.
#[derive(Debug)]
pub(super) struct Snapshot {
    /// Which run: another one after each restart.
    pub(super) run: u64,
    /// What stays the same through a run, as JSON.
    pub(super) stage: Utf8Bytes,
    /// What is worth telling often, as JSON.
    pub(super) fast: Utf8Bytes,
    /// What is worth telling now and then, as JSON.
    pub(super) slow: Numbered,
    /// The last scan, as JSON.
    pub(super) scan: Numbered,
    /// What the robot has to show besides, as JSON.
    pub(super) overlays: Numbered,
    /// The maps.
    pub(super) layers: Vec<Arc<Layer>>,
}

/// A text and which one of its kind it is.
#[derive(Clone, Debug)]
pub(super) struct Numbered {
    pub(super) number: u64,
    pub(super) text: Utf8Bytes,
}

impl Numbered {
    /// The first one.
    pub(super) fn new(text: &str) -> Self {
        Self {
            number: 0,
            text: Utf8Bytes::from(text),
        }
    }

    /// Another one.
    pub(super) fn renew(&mut self, text: String) {
        self.number += 1;
        self.text = text.into();
    }
}
