//! `touch-panel`: a display that can be touched.

use emulators::touch_panel::{HEIGHT, Tap, TouchPanel, WIDTH};
use protocols::LineConfig;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::{BuildContext, Built, DeviceKind, PortInfo, Settings, read_settings, schema_of};
use crate::scenario::{ScenarioError, Span};

/// Settings of a touch display.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TouchPanelSpec {
    /// Times and positions of touches.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tap: Vec<TapSpec>,
}

/// A touch of a tenth of a second.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TapSpec {
    /// Time of the touch.
    pub at: Span,
    /// Column 0 to 479 and row 0 to 271, counted from the upper left corner, pixels.
    pub place: [u16; 2],
}

const EXAMPLE: &str = r#"[device.display.touch-panel]

[[device.display.touch-panel.tap]]
at = "2s"
place = [100, 50]
"#;

/// The kind `touch-panel`.
pub const TOUCH_PANEL: &dyn DeviceKind = &TouchPanelKind;

struct TouchPanelKind;

impl DeviceKind for TouchPanelKind {
    fn name(&self) -> &'static str {
        "touch-panel"
    }

    fn about(&self) -> &'static str {
        "Display that can be touched"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<TouchPanelSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<TouchPanelSpec>(settings)
    }

    fn is_own(&self) -> bool {
        false
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &TouchPanelSpec = context.settings()?;
        let source = context.source;
        let outside = spec.tap.iter().find(|tap| {
            let [x, y] = tap.place.map(usize::from);
            x >= WIDTH || y >= HEIGHT
        });
        if let Some(TapSpec { place: [x, y], .. }) = outside {
            let message = format!("is {x}, {y}, expected a position on {WIDTH} x {HEIGHT} pixels");
            let key = format!("{}.tap", context.key());
            return Err(source.invalid(source.find("place"), key, message));
        }
        let taps = spec.tap.iter().map(|tap| Tap {
            at: tap.at.instant(),
            place: tap.place,
        });
        let line = LineConfig::new_8n1(protocols::panel::BAUD);
        let uart = PortInfo::uart(
            "uart",
            TouchPanel::UART,
            line,
            "the robot's display, optional",
        );
        Ok(Built {
            device: Box::new(TouchPanel::new(taps.collect())),
            ports: vec![uart.in_pieces(64).optional()],
        })
    }
}
