//! The state of a run at one time, serialised once for all pages.

use std::sync::Arc;

use axum::extract::ws::Utf8Bytes;

use super::map_layers::Layer;

/// The immutable data for all pages.
#[derive(Debug, Default)]
pub(super) struct Snapshot {
    /// Number of the run: a restart gets another one.
    pub(super) run: u64,
    /// Constant data of a run, as JSON.
    pub(super) stage: Utf8Bytes,
    /// Frequently updated data, as JSON.
    pub(super) fast: Utf8Bytes,
    /// Occasionally updated data, as JSON.
    pub(super) slow: Numbered,
    /// The last scan, as JSON.
    pub(super) scan: Numbered,
    /// Additional drawings of the robot, as JSON.
    pub(super) overlays: Numbered,
    /// The verdicts so far, as JSON.
    pub(super) checks: Numbered,
    /// The maps.
    pub(super) layers: Vec<Arc<Layer>>,
}

impl Snapshot {
    /// All data in one message, for a page that goes back in time.
    ///
    /// ```text
    /// | length of the JSON u32 | {now, slow, scan, overlays, checks} | rows as in a message |
    /// ```
    pub(super) fn whole(&self) -> Vec<u8> {
        let texts = [&self.fast, &self.slow.text, &self.scan.text];
        let [now, slow, scan] = texts.map(|text| text.as_str());
        let (overlays, checks) = (&self.overlays.text, &self.checks.text);
        let json = format!(
            r#"{{"now":{now},"slow":{slow},"scan":{scan},"overlays":{overlays},"checks":{checks}}}"#
        );
        let len = u32::try_from(json.len()).unwrap_or(u32::MAX);
        let rows = Layer::whole(&self.layers);
        [&len.to_le_bytes()[..], json.as_bytes(), &rows].concat()
    }
}

/// A text with its version number.
#[derive(Clone, Debug, Default)]
pub(super) struct Numbered {
    pub(super) number: u64,
    pub(super) text: Utf8Bytes,
}

impl Numbered {
    /// The first version.
    pub(super) fn new(text: &str) -> Self {
        Self {
            number: 0,
            text: Utf8Bytes::from(text),
        }
    }

    /// Replaces the text with a new version.
    pub(super) fn renew(&mut self, text: String) {
        self.number += 1;
        self.text = text.into();
    }
}
