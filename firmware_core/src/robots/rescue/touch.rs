//! Reactions of the robot to touches of its display, and the data for the display.

use core::f32::consts::FRAC_PI_4;

use protocols::Instant;
use protocols::pcui::message::Mode;

use super::config::Display;
use super::screen::{Action, Figures, Hit, Notice, Switches, View};
use super::{Phase, Rescue};
use crate::Inspect;
use crate::pose::Pose;

impl Rescue {
    /// Rows sent to the display, and taps received from it.
    pub const fn display_traffic(&self) -> [u32; 2] {
        let counters = self.screen.display().counters();
        [counters.rows, counters.taps]
    }

    /// Draws a little, in the time that the search leaves: the fielded program's display also had
    /// the lowest priority.
    pub(super) fn refresh_screen(&mut self, now: Instant) {
        let is_busy = matches!(self.phase, Phase::Matched { .. });
        if self.config.display == Display::None || is_busy || !self.screen.has_work(now) {
            return;
        }
        let pose = self.mapper.pose();
        let (lidar, base, pc) = (
            &self.lidar.counters,
            self.drive.link().counters(),
            self.pc.counters(),
        );
        let wire = pose.to_wire();
        let health = match (self.drive.is_silent(), self.lidar.sees()) {
            (true, _) => Notice::BaseSilent,
            (false, false) => Notice::LidarSilent,
            (false, true) => Notice::AllWell,
        };
        let view = View {
            map: self.mapper.grid(),
            pose,
            scan: self.scan.points(),
            waypoints: &self.waypoints,
            mode: self.mode,
            mode_name: Inspect::mode(self),
            health,
            battery: self.drive.battery(),
            switches: self.switches,
            figures: Figures {
                pose: [wire.x_mm, wire.y_mm, heading_deg(pose)],
                scans: self.counters.scans,
                lost_packets: lidar.lost_packets,
                base_retries: base.retries,
                rows_sent: pc.rows,
                arrivals: self.counters.arrivals,
            },
        };
        self.screen.refresh(now, &view);
    }

    /// Executes the action of a touch.
    pub(super) fn touched(&mut self, now: Instant, hit: Hit) {
        match hit {
            Hit::Button(action) => self.pressed(now, action),
            Hit::Map(cells, _) if self.switches.waypoints => self.add_waypoint(now, cells),
            Hit::Map(cells, is_double) => self.place_robot(now, cells, is_double),
        }
    }

    fn pressed(&mut self, now: Instant, action: Action) {
        let toggle = |switch: &mut bool| *switch = !*switch;
        match action {
            Action::Order(mode) => {
                self.ordered_at = now;
                self.set_mode(now, mode);
            }
            Action::Mapping => toggle(&mut self.switches.mapping),
            Action::Scan => toggle(&mut self.switches.scan),
            Action::SetWaypoints => toggle(&mut self.switches.waypoints),
            Action::ClearMap => self.clear_map(now),
            Action::ClearWaypoints => {
                self.waypoints.clear();
                self.waypoints_touched(now);
                self.screen.notices.push(now, Notice::WaypointsCleared);
            }
            Action::Lidar => self.switch_lidar(),
            Action::PcLink => {
                toggle(&mut self.switches.pc_link);
                // A partial frame from before must not be completed by a later one (field defect
                // PU-15).
                self.pc.line_broke();
            }
            Action::Reset => {
                self.set_mode(now, Mode::Stop);
                self.waypoints.clear();
                self.pc.echo_waypoints();
                self.mapper.restart();
                self.matched = None;
                self.switches = Switches::AT_START;
                self.lidar.switch_on();
                self.screen.notices.push(now, Notice::Reset);
            }
            Action::Show(_) | Action::Messages => {}
        }
    }

    fn switch_lidar(&mut self) {
        self.switches.lidar = !self.switches.lidar;
        if self.switches.lidar {
            self.lidar.switch_on();
        } else {
            self.lidar.switch_off();
        }
    }

    /// Starts a new map around the robot's believed pose.
    fn clear_map(&mut self, now: Instant) {
        let pose = self.pose_at(now);
        self.mapper.restart();
        self.mapper.set_pose(pose);
        let place = self.drive.odometry.pose_at(now);
        self.matched = self.matched.map(|_| (now, place));
        self.navigator.reset();
        self.screen.notices.push(now, Notice::MapCleared);
    }

    /// Appends a waypoint.
    fn add_waypoint(&mut self, now: Instant, cells: [f32; 2]) {
        let cell_mm = self.mapper.grid().resolution_mm();
        #[expect(clippy::cast_possible_truncation, reason = "saturates beyond 32 m")]
        let place = cells.map(|cells| (cells * cell_mm) as i16);
        if self.waypoints.push(place, 0).is_err() {
            self.counters.refused_waypoints = self.counters.refused_waypoints.saturating_add(1);
            self.screen.notices.push(now, Notice::WaypointRefused);
        }
        self.waypoints_touched(now);
    }

    /// Follows a list of waypoints from the display, as one from the PC. The robot starts, or stops
    /// if the list is empty, and sends the list to the PC.
    fn waypoints_touched(&mut self, now: Instant) {
        self.pc.echo_waypoints();
        self.follow_waypoints(now);
    }

    /// Sets the pose of a robot at rest; a double tap turns it by 45 degrees clockwise instead, in
    /// which direction the fielded angle psi grows.
    fn place_robot(&mut self, now: Instant, cells: [f32; 2], is_double: bool) {
        if self.mode != Mode::Stop {
            self.screen.notices.push(now, Notice::StopFirst);
            return;
        }
        let pose = self.mapper.pose();
        let [x_mm, y_mm] = cells.map(|cells| cells * self.mapper.grid().resolution_mm());
        let turn = if is_double { -FRAC_PI_4 } else { 0.0 };
        self.mapper
            .set_pose(Pose::new(x_mm, y_mm, pose.heading + turn));
        self.screen.notices.push(now, Notice::PoseSet);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "at most 180 degrees")]
fn heading_deg(pose: Pose) -> i16 {
    libm::roundf(pose.heading.to_degrees()) as i16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heading_is_told_in_whole_degrees() {
        let told = [0.0, 0.4, 89.6, -0.6, -179.4, 180.0].map(|degrees: f32| {
            let heading = degrees.to_radians();
            heading_deg(Pose {
                heading,
                ..Pose::default()
            })
        });
        assert_eq!(told, [0, 0, 90, -1, -179, 180]);
    }
}
