//! `camera`: a depth camera with a detector of markers.

use core::any::Any;

use emulators::camera::{Camera, CameraConfig, Output, PlacedMarker, RATE};
use emulators::rng::Rng;
use protocols::LineConfig;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};
use toml::de::ValueDeserializer;

use super::camera_scans::CameraScans;
use super::scan::ScanDecoder;
use super::{
    BuildContext, Built, DeviceKind, MountSpec, PortInfo, Settings, read_settings, schema_of,
};
use crate::codec;
use crate::rig::LinkKind;
use crate::scenario::{ScenarioError, Span};

/// Settings of a depth camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraSpec {
    /// Mount on the robot; in the middle, looking ahead, if not given. The robot's program does not
    /// know it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<MountSpec>,
    /// Height above the floor, metres, 0 to 5; 0.34 if not given. The camera does not see lower
    /// objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 5.0))]
    pub height_m: Option<f64>,
    /// Horizontal field of view, degrees, 1 to 120; 62.6 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1.0, max = 120.0))]
    pub field_deg: Option<f64>,
    /// Columns of a row, 2 to 700; 640 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 2, max = 700))]
    pub columns: Option<u16>,
    /// Period of pictures; 33.3 ms if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub period: Option<Span>,
    /// Standard deviation of a depth at 1 m, metres, 0 to 0.1; 0.00143 if not given. It grows with
    /// the square of the depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 0.1))]
    pub noise_m: Option<f64>,
    /// Share of the columns that have no depth, 0 to 1; 0.02 if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub gaps: Option<f64>,
    /// Whether the camera sends scans, i.e. ranges at even bearings, instead of rows of depths.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub scans: bool,
    /// The run's seed shuffles the numbers of the markers.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub numbers_by_seed: bool,
    /// The markers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub marker: Vec<MarkerSpec>,
}

/// A marker in the world, which the camera recognises.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MarkerSpec {
    /// Its number.
    pub id: u16,
    /// Position of its middle, metres: x, y, and height above the floor.
    pub at_m: [f64; 3],
    /// Viewing direction, degrees counter-clockwise from +x.
    pub facing_deg: f64,
}

const EXAMPLE: &str = r#"[device.camera.camera]
mount = { x_m = 0.1, heading_deg = 5 }
height_m = 0.34
field_deg = 70
columns = 351
period = "100ms"
noise_m = 0.002
gaps = 0.05
scans = true
numbers_by_seed = true

[[device.camera.camera.marker]]
id = 10
at_m = [2.0, 1.0, 0.2]
facing_deg = 180
"#;

/// The kind `camera`.
pub const CAMERA: &dyn DeviceKind = &CameraKind;

struct CameraKind;

impl DeviceKind for CameraKind {
    fn name(&self) -> &'static str {
        "camera"
    }

    fn about(&self) -> &'static str {
        "Depth camera with a detector of markers"
    }

    fn example(&self) -> &'static str {
        EXAMPLE
    }

    fn schema(&self, generator: &mut SchemaGenerator) -> Schema {
        schema_of::<CameraSpec>(generator)
    }

    fn parse(&self, settings: ValueDeserializer<'_>) -> Result<Box<dyn Settings>, toml::de::Error> {
        read_settings::<CameraSpec>(settings)
    }

    fn scanner(&self, settings: &dyn Settings) -> Option<Box<dyn ScanDecoder>> {
        let settings: &dyn Any = settings;
        let mount = settings.downcast_ref::<CameraSpec>()?.mount;
        let mount = mount.unwrap_or_default();
        let place_m = [mount.x_m, mount.y_m];
        Some(Box::new(CameraScans::new(
            mount.heading_deg.to_radians(),
            place_m,
        )))
    }

    fn build(&self, context: &BuildContext<'_>) -> Result<Built, ScenarioError> {
        let spec: &CameraSpec = context.settings()?;
        let config = spec.config(context)?;
        let line = LineConfig::new_8n1(RATE);
        let port = |name, port, connect| {
            PortInfo::uart(name, port, line, connect)
                .on(LinkKind::Datagram)
                .at_any_rate(line)
                .speaking(&codec::PERCEPTION)
        };
        Ok(Built {
            device: Box::new(Camera::new(config, context.seed, context.name)),
            ports: vec![
                port("scan", Camera::SCAN, "the robot's input for scans"),
                port("markers", Camera::MARKERS, "the robot's input for markers").optional(),
            ],
        })
    }
}

impl CameraSpec {
    fn config(&self, context: &BuildContext<'_>) -> Result<CameraConfig, ScenarioError> {
        let mount = self.mount.unwrap_or_default();
        mount.check(context)?;
        context.within("height_m", self.height_m, 0.0..=5.0)?;
        context.within("field_deg", self.field_deg, 1.0..=120.0)?;
        context.within("columns", self.columns.map(f64::from), 2.0..=700.0)?;
        context.within("noise_m", self.noise_m, 0.0..=0.1)?;
        context.within("gaps", self.gaps, 0.0..=1.0)?;
        let period_s = self.period.map(|period| period.0.as_secs_f64());
        context.within("period", period_s, 0.001..=60.0)?;
        for marker in &self.marker {
            let [x, y, z] = marker.at_m;
            let farthest = [x, y, z, marker.facing_deg / 10.0].map(f64::abs);
            let farthest = farthest.into_iter().fold(0.0, f64::max);
            context.within("marker.at_m", Some(farthest), 0.0..=1_000.0)?;
        }
        let usual = CameraConfig::default();
        let mut ids: Vec<u16> = self.marker.iter().map(|marker| marker.id).collect();
        if self.numbers_by_seed {
            deal(&mut ids, context.seed);
        }
        let marker = |(marker, id): (&MarkerSpec, u16)| PlacedMarker {
            id,
            at_m: marker.at_m,
            facing_rad: marker.facing_deg.to_radians(),
        };
        Ok(CameraConfig {
            x_m: mount.x_m,
            y_m: mount.y_m,
            yaw_rad: mount.heading_deg.to_radians(),
            height_m: self.height_m.unwrap_or(usual.height_m),
            field_rad: self.field_deg.map_or(usual.field_rad, f64::to_radians),
            columns: self.columns.unwrap_or(usual.columns),
            period: self.period.map_or(usual.period, |period| period.0),
            noise_m: self.noise_m.unwrap_or(usual.noise_m),
            gaps: self.gaps.unwrap_or(usual.gaps),
            output: match self.scans {
                true => Output::Scan,
                false => Output::Depths,
            },
            markers: self.marker.iter().zip(ids).map(marker).collect(),
            ..usual
        })
    }
}

/// A random order of `ids`; all orders are equally likely (Fisher and Yates).
fn deal(ids: &mut [u16], seed: u64) {
    let mut dice = Rng::stream(seed, "camera.numbers");
    for last in (1..ids.len()).rev() {
        let drawn = dice.below(last as u64 + 1);
        ids.swap(last, usize::try_from(drawn).unwrap_or(last));
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Three numbers have six orders. 100 seeds give each order, and one seed always gives the same
    /// order.
    #[test]
    fn numbers_are_dealt_out_by_the_seed() {
        let dealt = |seed| {
            let mut ids = [10, 11, 12];
            deal(&mut ids, seed);
            ids
        };
        let orders: BTreeSet<[u16; 3]> = (0..100).map(dealt).collect();
        assert_eq!(orders.len(), 6);
        assert_eq!(dealt(7), dealt(7));
        deal(&mut [], 1);
    }
}
