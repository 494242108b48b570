//! The PC as the robot's station.

use emulators::pc::{Connection, Pc, PcMap, Script};
use emulators::world::Pose;
use firmware_core::map_view::MapView;
use firmware_core::pose::{Pose as ProgramPose, WirePose};
use protocols::pcui::message::Mode;
use protocols::{Instant, Port};

use super::pc_program::{self, waypoints};
use super::{MODES, pc_action, pc_step, view};
use crate::robots::instruments::in_metres;
use crate::robots::panel::Panel;
use crate::robots::station::{DriveKeys, StationState};
use crate::robots::{Gesture, RemoteStation, Station, StationView};
use crate::scenario::{Action, SetPoint, Step};

/// Number of waypoints in the longest frame: two bytes, and nine for each.
const LIST_MAX: usize = (protocols::pcui::PAYLOAD_MAX - 2) / 9;

/// A PC that opens its port on request.
pub(super) fn alone() -> Pc {
    let script = Script::new(Vec::new()).expect("no steps are within the limits");
    let mut pc = Pc::new(script);
    let opened = pc.perform(Instant::ZERO, emulators::pc::Action::Open);
    opened.expect("has no limits");
    pc
}

const fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Stop => "stop",
        Mode::Exploration => "exploration",
        Mode::Waypoint => "waypoint",
        Mode::Manual => "manual",
        Mode::Explore => "explore",
    }
}

impl Station for Pc {
    fn modes(&self) -> &'static [&'static str] {
        const NAMES: [&str; MODES.len()] = [MODES[0].0, MODES[1].0, MODES[2].0, MODES[3].0];
        &NAMES
    }

    fn mode_words(&self, mode: &str) -> Option<&'static str> {
        match mode {
            "exploration" => Some("Follow walls"),
            "waypoint" => Some("To waypoints"),
            "explore" => Some("Explore, then return"),
            _ => None,
        }
    }

    fn list_max(&self) -> Option<usize> {
        Some(LIST_MAX)
    }

    /// Ticks per 40 ms: a third of a metre a second ahead, half of that to turn.
    fn keys(&self) -> Option<DriveKeys> {
        Some(DriveKeys {
            ahead: SetPoint::list([14, 14]),
            left: SetPoint::list([-8, 8]),
            limit: SetPoint::list([20, 20]),
        })
    }

    fn view(&self, now: Instant) -> StationView {
        let record = self.record();
        let state = record.state.map(|(_, state)| StationState {
            mode: mode_name(state.mode),
            speed: SetPoint::list(state.speed_mm_s),
            to: SetPoint::list(state.set_point),
        });
        let properties = record.map_properties;
        let pose = properties.map(|(_, map)| {
            let [x, y] = map.position_mm;
            [x, y, map.psi_deg]
        });
        let told = properties.map(|(at, _)| at);
        let heard = told.max(record.state.map(|(at, _)| at));
        let since = heard.map(|at| (now - at).as_millis());
        StationView {
            connection: match self.connection() {
                Connection::Closed => "closed",
                Connection::Opening => "opening",
                Connection::Connected(_) => "connected",
            },
            heard_ms: since.map(|ms| u64::try_from(ms).unwrap_or(u64::MAX)),
            state,
            pose,
            size_mm: properties.map(|(_, map)| map.size_mm),
            waypoints: waypoints(self),
            confirmed: self.unconfirmed_waypoints().is_none(),
            rows_missing: self.map().map(PcMap::rows_missing),
            order: self
                .order()
                .map(|order| (mode_name(order.mode), SetPoint::list(order.set_point))),
            bytes: record.counts.bytes,
            bad: record.counts.bad_frames + record.counts.bad_messages + record.counts.bad_rows,
        }
    }

    fn map(&self) -> Option<MapView<'_>> {
        let map = Self::map(self)?;
        let is_map = map.width > 0 && map.resolution_mm > 0;
        let cell_mm = f32::from(map.resolution_mm);
        is_map.then(|| MapView::new(map.width, cell_mm, [0.0; 2], &map.pixels))
    }

    fn has_whole_map(&self) -> Option<bool> {
        Some(self.map_complete_at().is_some())
    }

    fn stated_pose(&self) -> Option<Pose> {
        let (_, map) = self.record().map_properties?;
        let [x_mm, y_mm] = map.position_mm;
        let psi_deg = map.psi_deg;
        Some(in_metres(ProgramPose::from_wire(WirePose {
            x_mm,
            y_mm,
            psi_deg,
        })))
    }

    fn answer(&self, gesture: Gesture) -> Result<Action, String> {
        pc_program::answer(self, gesture).map_err(|refusal| refusal.to_string())
    }

    fn insert_step(&mut self, mission: usize, index: usize, step: &Step) -> Result<(), String> {
        let others = self.steps().saturating_sub(mission);
        let inserted = self.insert(others + index, pc_step(step)?);
        inserted.map_err(|error| error.to_string())
    }
}

impl RemoteStation for Pc {
    fn port(&self) -> Port {
        Self::AIR
    }

    fn perform(&mut self, now: Instant, action: &Action) -> Result<(), String> {
        let done = Self::perform(self, now, pc_action(action)?);
        done.map_err(|error| error.to_string())
    }

    fn tick(&mut self, now: Instant) {
        Self::tick(self, now);
    }

    fn radius_m(&self) -> f64 {
        0.16
    }

    fn panels(&self) -> Vec<Panel> {
        view::diagnosis(self).into_iter().collect()
    }
}
