use protocols::Instant;

use super::Yellow;
use crate::Inspect;
use crate::map_view::MapView;
use crate::memory::StrayWrites;
use crate::pose::{Point, Pose};

impl Inspect for Yellow {
    /// The pose by odometry: this robot makes no map.
    fn estimate(&self) -> Option<(Instant, Pose)> {
        self.posed_at.map(|at| (at, self.wheels.pose()))
    }

    fn map(&self) -> Option<MapView<'_>> {
        None
    }

    /// The newest set of the lidar.
    fn scan(&self) -> &[Point] {
        self.lidar.scans.points()
    }

    fn mode(&self) -> &'static str {
        self.machine.mode().name()
    }

    fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        let (lidar, radio) = (&self.lidar.counters, &self.radio.counters);
        let named = [
            ("board samples", self.counters.samples),
            ("board samples bad", self.counters.bad_samples),
            ("encoder samples disbelieved", self.wheels.disbelieved()),
            ("lidar nodes", lidar.nodes),
            ("lidar resyncs", lidar.resyncs),
            ("lidar groups bad", self.lidar.bad_groups()),
            ("lidar readings astray", self.lidar.scans.stray.count),
            ("lidar turns", lidar.turns),
            ("lidar sets", self.lidar.scans.sets),
            ("lidar silences", lidar.silences),
            ("lidar restarts", lidar.restarts),
            ("telecommands", radio.telecommands),
            ("telecommands refused", self.counters.refused),
            ("radio bad frames", radio.bad_frames),
            ("radio bad messages", radio.bad_messages),
            ("radio echoes", radio.echoes),
            ("telemetry", radio.telemetry),
            ("telemetry skipped", radio.skipped),
            ("over-size answers", radio.over_size),
            ("lines left out", radio.lines_left_out),
            ("manual time-outs", self.machine.time_outs),
            ("arrivals", self.machine.arrivals),
            ("manoeuvres interrupted", self.machine.interruptions),
            ("escapes", self.reactive.escapes),
            ("line errors", self.counters.line_errors),
        ];
        for (name, count) in named {
            report(name, u64::from(count));
        }
    }

    fn stray_writes(&self, report: &mut dyn FnMut(&'static str, StrayWrites)) {
        let stray = self.lidar.scans.stray;
        if stray.count > 0 {
            report("distances", stray);
        }
    }
}
