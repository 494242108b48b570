//! Values of a robot in groups, for page and report.

use std::borrow::Cow;

use serde::Serialize;

/// A group of values for page and report.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Panel {
    /// Name of the group, e.g. `base registers`.
    pub name: String,
    /// The values.
    pub rows: Vec<PanelRow>,
}

/// A value of a panel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PanelRow {
    /// Name of the value.
    pub name: Cow<'static, str>,
    /// Address in the device, if it has one.
    pub address: Option<u32>,
    /// Current value as text.
    pub value: String,
    /// Unit of the value, empty if it has none.
    pub unit: Cow<'static, str>,
}
