//! The PC without a rig, for a real robot on a port.

use std::collections::VecDeque;
use std::path::Path;

use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use emulators::{Device, Event};
use firmware_core::Master as _;
use firmware_core::map_view::MapView;
use firmware_core::robots::yellow::pc::{PcConfig, PcProgram};
use protocols::{Instant, LineConfig, LineEvent, Port};

use super::body::RADIUS_M;
use super::script::script;
use super::station::PcStation;
use crate::robots::station::{DriveKeys, PlaceAct};
use crate::robots::{Gesture, RemoteStation, Station, StationView};
use crate::scenario::{Action, Scenario, Span, Step};

/// A mission without a step: the PC connects.
const IDLE: &str = "schema = 1\nname = \"remote\"\nrobot = \"yellow\"\nduration = \"1s\"\n\
    [world]\nstart = { x_m = 0, y_m = 0, heading_deg = 0 }\n";

/// The PC, and its requests for the port.
struct Remote {
    station: PcStation,
    /// A world for the interface of devices; the station never uses it.
    nowhere: World,
    changes: VecDeque<LineEvent>,
}

/// The PC with the coding of its port. The robot's odometry is the frame of its maps.
pub(super) fn remote() -> (Box<dyn RemoteStation>, LineConfig) {
    let (scenario, source) =
        Scenario::parse(Path::new("remote"), IDLE.to_owned()).expect("all that is needed");
    let script = script(&scenario.mission, &source).expect("it has no step");
    let program = PcProgram::new(PcConfig::default());
    let line = program.line_config(PcProgram::TELEMETRY);
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("nothing in it");
    let nowhere = World::new(scene, BodyConfig::default(), Pose::default(), 0);
    let remote = Remote {
        station: PcStation::new(program, script),
        nowhere: nowhere.expect("nothing is in the way"),
        changes: VecDeque::from([LineEvent::Opened]),
    };
    (Box::new(remote), line)
}

impl Device for Remote {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        self.station.receive(port, now, bytes);
    }

    /// A lost port is requested again.
    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        self.station.line_event(port, now, event);
        if event == LineEvent::Closed {
            self.changes.push_back(LineEvent::Opened);
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        self.station.poll(now, world);
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        self.station.transmit(port, buf)
    }

    fn line_change(&mut self, _: Port) -> Option<LineEvent> {
        self.changes.pop_front()
    }

    fn poll_at(&self) -> Option<Instant> {
        self.station.poll_at()
    }

    fn line_config(&self, port: Port) -> LineConfig {
        self.station.line_config(port)
    }

    fn take_events(&mut self) -> Vec<Event> {
        self.station.take_events()
    }
}

impl Station for Remote {
    fn modes(&self) -> &'static [&'static str] {
        self.station.modes()
    }

    fn place_acts(&self) -> &'static [PlaceAct] {
        self.station.place_acts()
    }

    fn keys(&self) -> Option<DriveKeys> {
        self.station.keys()
    }

    fn view(&self, now: Instant) -> StationView {
        self.station.view(now)
    }

    fn map(&self) -> Option<MapView<'_>> {
        Station::map(&self.station)
    }

    fn stated_pose(&self) -> Option<Pose> {
        self.station.stated_pose()
    }

    fn answer(&self, gesture: Gesture) -> Result<Action, String> {
        self.station.answer(gesture)
    }

    fn insert_step(&mut self, mission: usize, index: usize, step: &Step) -> Result<(), String> {
        self.station.insert_step(mission, index, step)
    }
}

impl RemoteStation for Remote {
    fn port(&self) -> Port {
        PcProgram::TELEMETRY
    }

    fn perform(&mut self, now: Instant, action: &Action) -> Result<(), String> {
        match action {
            Action::Connect => self.changes.push_back(LineEvent::Opened),
            Action::Disconnect => self.changes.push_back(LineEvent::Closed),
            _ => {}
        }
        let at = Span(now - Instant::ZERO);
        // Inserted behind all executed steps: the script has no steps of a mission.
        self.station
            .insert_step(0, 0, &Step::at(at, action.clone()))?;
        self.tick(now);
        Ok(())
    }

    fn tick(&mut self, now: Instant) {
        self.station.poll(now, &mut self.nowhere);
    }

    fn radius_m(&self) -> f64 {
        RADIUS_M
    }
}
