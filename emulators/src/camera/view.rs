//! View of the camera on the world.

use core::f64::consts::PI;

use protocols::Instant;
use protocols::perception::Marker;

use super::{Camera, CameraConfig, Output, PlacedMarker, Views, encoded};
use crate::world::{Pose, Row, World, wrap_angle};

/// Tangent of the largest angle above or below the axis at which a marker is in the picture: half
/// of 480 rows over 525 pixels.
const HALF_HEIGHT: f64 = 240.0 / 525.0;
/// Depths at which a marker is recognised, metres: nearer it leaves the picture, farther it is too
/// small.
const MARKER_RANGE_M: [f64; 2] = [0.4, 4.0];
/// Maximum angle at which a marker is recognised: 70 degrees from its normal.
const MARKER_ASIDE_RAD: f64 = 70.0 / 180.0 * PI;
/// A marker's own support hides the marker only if it is nearer by this, metres.
const MARKER_DEPTH_M: f64 = 0.05;
/// Error of a marker's position: standard deviation, part of its depth.
const MARKER_NOISE: f64 = 0.005;

impl Views {
    pub(super) fn of(config: &CameraConfig, world: &World) -> Self {
        let scene = world.scene();
        let lower = |marker: &PlacedMarker| scene.slice(marker.at_m[2].min(config.height_m));
        Self {
            camera: scene.slice(config.height_m),
            markers: config.markers.iter().map(lower).collect(),
        }
    }
}

impl Camera {
    /// Focal length, pixels.
    fn focal_px(&self) -> f64 {
        f64::from(self.config.columns) / 2.0 / libm::tan(self.config.field_rad / 2.0)
    }

    /// Pose of the camera.
    fn pose(&self, world: &World) -> Pose {
        let body = world.pose();
        let place = body.offset(self.config.x_m, self.config.y_m);
        Pose::new(place.x, place.y, body.theta + self.config.yaw_rad)
    }

    /// First bearing of a scan, counter-clockwise, and from one to the next, microradians.
    fn bearings_urad(&self) -> (i32, i32) {
        let steps = f64::from(self.config.columns.max(2) - 1);
        let urad = |rad: f64| {
            #[expect(clippy::cast_possible_truncation, reason = "at most a half turn")]
            let whole = (rad * 1e6).round() as i32;
            whole
        };
        let field = self.config.field_rad;
        (urad(-field / 2.0), urad(field / steps))
    }

    /// The row of one picture as a message.
    pub(super) fn measure(&mut self, now: Instant, world: &World) -> Vec<u8> {
        let mut values = Vec::with_capacity(self.config.columns.into());
        match self.config.output {
            Output::Depths => self.measure_depths(now, world, &mut values),
            Output::Scan => self.measure_ranges(now, world, &mut values),
        }
        let (focal_px, scan) = (self.focal_px(), self.bearings_urad());
        encoded(self.config.output, focal_px, scan, &values)
    }

    fn measure_depths(&mut self, now: Instant, world: &World, values: &mut Vec<u16>) {
        let row = Row {
            camera: self.pose(world),
            focal_px: self.focal_px(),
        };
        let mut columns = core::mem::take(&mut self.columns);
        columns.resize(self.config.columns.into(), 0.0);
        if let Some(views) = &self.views {
            views.camera.draw_row(now, row, &mut columns);
        }
        let depth = |inverse: f64| (inverse > 0.0).then(|| 1.0 / inverse);
        values.extend(columns.iter().map(|it| self.value(depth(*it))));
        self.columns = columns;
    }

    fn measure_ranges(&mut self, now: Instant, world: &World, values: &mut Vec<u16>) {
        let (pose, (first, step)) = (self.pose(world), self.bearings_urad());
        let [_, farthest] = self.config.range_m;
        for column in 0..self.config.columns {
            let urad = f64::from(first) + f64::from(step) * f64::from(column);
            let view = self.views.as_ref().map(|views| &views.camera);
            let angle = pose.theta + urad / 1e6;
            let hit = view.and_then(|view| view.cast_ray(now, pose.point(), angle, farthest));
            values.push(self.value(hit.map(|hit| hit.distance)));
        }
    }

    /// Measured value of a true depth, millimetres; 0 without a measurement.
    fn value(&mut self, depth_m: Option<f64>) -> u16 {
        let gaps = self.config.gaps.max(self.faults.blind);
        let (is_gap, error) = (self.gap_dice.chance(gaps), self.depth_noise.bell());
        let [least, greatest] = self.config.range_m;
        let measured = depth_m.map(|depth| depth + error * self.config.noise_m * depth * depth);
        let measured = measured.filter(|depth| (least..=greatest).contains(depth));
        match measured {
            Some(depth_m) if !is_gap => word(depth_m * 1e3),
            _ => 0,
        }
    }

    /// The messages of the markers in one picture.
    pub(super) fn recognise(&mut self, now: Instant, world: &World) -> Vec<Vec<u8>> {
        let pose = self.pose(world);
        let mut messages = Vec::new();
        for index in 0..self.config.markers.len() {
            let errors = [self.marker_noise.gauss(), self.marker_noise.gauss()];
            let marker = self.config.markers[index];
            let seen = self.seen(marker, pose).filter(|_| self.faults.blind < 1.0);
            let Some([right, down, ahead]) = seen else {
                continue;
            };
            let [x, y, _] = marker.at_m;
            let (dx, dy) = (x - pose.x, y - pose.y);
            let range = libm::hypot(dx, dy);
            let angle = libm::atan2(dy, dx);
            let view = self.views.as_ref().map(|views| &views.markers[index]);
            let before = range - MARKER_DEPTH_M;
            if view.is_some_and(|view| view.cast_ray(now, pose.point(), angle, before).is_some()) {
                continue;
            }
            let [aside, along] = errors.map(|error| error * MARKER_NOISE * ahead);
            let turned = marker.facing_rad - pose.theta;
            let told = Marker {
                id: marker.id,
                place_mm: [right + aside, down, ahead + along].map(millimetres),
                normal: [-libm::sin(turned), libm::cos(turned)].map(ten_thousandths),
            };
            messages.push(told.encode().to_vec());
        }
        messages
    }

    /// Right, down and ahead of a marker that is in the picture and can be read, metres.
    fn seen(&self, marker: PlacedMarker, pose: Pose) -> Option<[f64; 3]> {
        let [x, y, above] = marker.at_m;
        let (sin, cos) = libm::sincos(pose.theta);
        let (dx, dy) = (x - pose.x, y - pose.y);
        let (ahead, left) = (dx * cos + dy * sin, dy * cos - dx * sin);
        let down = self.config.height_m - above;
        let is_near = (MARKER_RANGE_M[0]..=MARKER_RANGE_M[1]).contains(&ahead);
        let is_within = left.abs() <= ahead * libm::tan(self.config.field_rad / 2.0)
            && down.abs() <= ahead * HALF_HEIGHT;
        let back = libm::atan2(-dy, -dx);
        let is_facing = wrap_angle(marker.facing_rad - back).abs() <= MARKER_ASIDE_RAD;
        (is_near && is_within && is_facing).then_some([-left, down, ahead])
    }
}

/// The nearest whole number in the range of a word.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cast stops at the limits"
)]
pub(super) const fn word(value: f64) -> u16 {
    // As `round`, without a call into a library for each pixel. The number is the one below a half:
    // with a half, the sum for the number below it would be 1.
    const HALF: f64 = 0.5 - 0.25 * f64::EPSILON;
    (value + HALF) as u16
}

#[expect(clippy::cast_possible_truncation, reason = "a few metres")]
const fn millimetres(metres: f64) -> i32 {
    (metres * 1e3).round() as i32
}

#[expect(clippy::cast_possible_truncation, reason = "at most one")]
const fn ten_thousandths(part: f64) -> i16 {
    (part * 1e4).round() as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;

    /// A camera 0.3 m above the floor at the origin, which sees a marker there.
    fn seen(at_m: [f64; 3], facing_rad: f64) -> Option<[f64; 3]> {
        let config = CameraConfig {
            height_m: 0.3,
            ..CameraConfig::default()
        };
        let marker = PlacedMarker {
            id: 1,
            at_m,
            facing_rad,
        };
        Camera::new(config, 1, "camera").seen(marker, Pose::default())
    }

    /// Half of 62.6 degrees to either side are 0.608 m a metre, half of 480 rows of 525 pixels
    /// 0.457 m up and down; 0.4 m and 4 m ahead a marker is as near and as far as can be.
    #[test]
    fn a_marker_is_seen_within_the_picture() {
        let is_seen = |x, y, z| seen([x, y, z], PI).is_some();
        assert!(is_seen(0.4, 0.0, 0.3) && is_seen(4.0, 0.0, 0.3));
        assert!(!is_seen(0.39, 0.0, 0.3) && !is_seen(4.01, 0.0, 0.3) && !is_seen(-1.0, 0.0, 0.3));
        for metres in [1.0, 2.0] {
            let (aside, above) = (0.608 * metres, 0.457 * metres);
            assert!(is_seen(metres, aside - 0.001, 0.3) && is_seen(metres, 0.001 - aside, 0.3));
            assert!(!is_seen(metres, aside + 0.001, 0.3) && !is_seen(metres, -aside - 0.001, 0.3));
            assert!(is_seen(metres, 0.0, 0.3 + above) && is_seen(metres, 0.0, 0.3 - above));
            let (high, low) = (0.302 + above, 0.298 - above);
            assert!(!is_seen(metres, 0.0, high) && !is_seen(metres, 0.0, low));
        }
        assert_eq!(seen([2.0, 0.5, 0.25], PI), Some([-0.5, 0.3 - 0.25, 2.0]));
    }

    /// Seen from ahead, a marker faces back. The camera still reads it 70 degrees to either side.
    #[test]
    fn a_marker_is_read_up_to_70_degrees_aside() {
        let is_read = |degrees: f64| seen([1.0, 0.0, 0.3], degrees.to_radians()).is_some();
        assert!([110.1, 180.0, 249.9, -110.1].into_iter().all(is_read));
        assert!(![109.9, 250.1, 0.0, -109.9].into_iter().any(is_read));
        // From 45 degrees aside it is read up to 115 degrees.
        let is_read = |degrees: f64| seen([1.0, 0.5, 0.3], degrees.to_radians()).is_some();
        assert!(is_read(136.7) && is_read(276.5) && !is_read(136.5) && !is_read(276.7));
    }

    /// Every half of the range, and the numbers next to it, round as the library does.
    #[test]
    fn words_are_rounded_as_the_library_does() {
        for half in 0..2 * u32::from(u16::MAX) {
            let half = f64::from(half) / 2.0;
            for value in [half.next_down(), half, half.next_up()] {
                assert_eq!(f64::from(word(value)), value.round().abs(), "{value}");
            }
        }
    }

    #[test]
    fn figures_of_messages_are_whole() {
        assert_eq!([word(1.5), word(70_000.0), word(-3.0)], [2, u16::MAX, 0]);
        assert_eq!([millimetres(0.0126), millimetres(-1.0)], [13, -1_000]);
        assert_eq!(
            [ten_thousandths(0.5), ten_thousandths(-1.0)],
            [5_000, -10_000]
        );
    }
}
