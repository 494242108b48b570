use protocols::Instant;
use protocols::pcui::message::Mode;

use super::{Progress, Rescue};
use crate::Inspect;
use crate::map_view::MapView;
use crate::memory::StrayWrites;
use crate::pose::{Point, Pose};

impl Inspect for Rescue {
    fn estimate(&self) -> Option<(Instant, Pose)> {
        self.matched.map(|(at, _)| (at, self.mapper.pose()))
    }

    fn map(&self) -> Option<MapView<'_>> {
        Some(self.mapper.grid().view())
    }

    fn scan(&self) -> &[Point] {
        self.scan.points()
    }

    fn mode(&self) -> &'static str {
        if self.drive.is_silent() {
            return "base silent";
        }
        match self.mode {
            Mode::Stop => "stop",
            Mode::Manual => "manual",
            _ if !self.lidar.sees() => "lidar silent",
            Mode::Exploration => "exploration",
            _ if self.is_lost() => "lost",
            _ if self.is_off_map() => "off the map",
            Mode::Waypoint => "waypoint",
            Mode::Explore => match self.explore.progress() {
                Progress::Seeks => "explore",
                Progress::GoesHome => "home",
                Progress::IsHome => "is home",
            },
        }
    }

    fn stray_writes(&self, report: &mut dyn FnMut(&'static str, StrayWrites)) {
        let buffers = [
            ("reply buffer", self.drive.link().stray_writes()),
            ("distances", self.lidar.stray_writes()),
            ("waypoint list", self.waypoints.stray_writes()),
        ];
        for (buffer, stray) in buffers.into_iter().filter(|(_, stray)| stray.count > 0) {
            report(buffer, stray);
        }
    }

    fn is_done(&self) -> Option<bool> {
        Some(self.search_progress()? == Progress::IsHome)
    }

    fn victims(&self, report: &mut dyn FnMut(Point)) {
        self.victims
            .all()
            .iter()
            .for_each(|victim| report(victim.place));
    }

    fn is_dead(&self) -> bool {
        self.has_ended()
    }

    fn counters(&self, report: &mut dyn FnMut(&'static str, u64)) {
        let (lidar, base, pc) = (
            &self.lidar.counters,
            self.drive.link().counters(),
            self.pc.counters(),
        );
        let named = [
            ("scans", self.counters.scans),
            ("lidar packets", lidar.packets),
            ("lidar packets lost", lidar.lost_packets),
            ("lidar packets bad", lidar.bad_packets),
            ("lidar turns", lidar.turns),
            ("lidar turns skipped", lidar.skipped_turns),
            ("lidar silences", lidar.silences),
            ("base answers", base.answered),
            ("base retries", base.retries),
            ("base failures", base.failures),
            ("base silences", self.drive.silences),
            ("base unsolicited", base.unsolicited),
            ("base errors", base.errors),
            ("base bad frames", base.bad_frames),
            ("base queue overflows", base.overflows),
            (
                "encoder readings disbelieved",
                self.drive.odometry.disbelieved(),
            ),
            ("set-points expired", self.drive.expired),
            ("wheels stalled", self.drive.stall.stalls),
            ("radio frames", pc.received),
            ("radio bad frames", pc.bad_frames),
            ("radio frames without meaning", pc.meaningless),
            ("radio frames sent", pc.sent),
            ("map rows sent", pc.rows),
            ("radio queue overflows", self.pc.overflows()),
            ("waypoints reached", self.counters.arrivals),
            ("waypoints refused", self.counters.refused_waypoints),
            ("views", self.explore.views().into()),
            ("manual fallbacks", self.counters.fallbacks),
            ("line errors", self.counters.line_errors),
        ];
        for (name, value) in named {
            report(name, u64::from(value));
        }
    }
}
