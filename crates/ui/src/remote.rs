//! The page's PC program on a port, for an external robot: no rig, no world, only the messages of
//! the robot.

use core::time::Duration;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError};

use protocols::{Instant, LineConfig, LineEvent};
use serde_json::{Value, json};

use super::command::{Answer, Command};
use super::desk::{SHOW_EVERY, look_at_map};
use super::figures::short_pose;
use super::hub::Hub;
use super::map_layers::MapLayer;
use super::snapshot::{Numbered, Snapshot};
use super::timeline::Sample;
use super::told;
use engine::robots::{Gesture, Hand, RemoteStation, StationView};
use realtime::transport::{Serial, Transport};
use show::view::Outline;

/// Interval between two attempts to open a port.
const RETRY: Duration = Duration::from_millis(500);
/// Maximum number of commands and chunks per turn.
const AT_ONCE: usize = 64;

/// A PC on a port.
pub struct Remote {
    hub: Arc<Hub>,
    path: PathBuf,
    line: LineConfig,
    station: Box<dyn RemoteStation>,
    wants_port: bool,
    port: Option<Serial>,
    retry_at: Instant,
    trouble: Option<String>,
    hand: Hand,
    layer: MapLayer,
    slow: Numbered,
    shown_at: Option<Instant>,
}

impl Remote {
    /// A PC that opens the port at `path` as soon as possible, and again after each disconnection.
    pub fn new(
        station: Box<dyn RemoteStation>,
        path: &Path,
        line: LineConfig,
        hub: Arc<Hub>,
    ) -> Self {
        Self {
            hub,
            path: path.to_owned(),
            line,
            station,
            wants_port: false,
            port: None,
            retry_at: Instant::ZERO,
            trouble: None,
            hand: Hand::default(),
            layer: MapLayer::new("pc"),
            slow: Numbered::new("{}"),
            shown_at: None,
        }
    }

    /// The station's knowledge at `now`.
    pub fn view(&self, now: Instant) -> StationView {
        self.station.view(now)
    }

    /// One turn at `now`: executes commands of pages, communicates with the robot, shows its
    /// messages.
    pub fn turn(&mut self, now: Instant) {
        for _ in 0..AT_ONCE {
            let Some(envelope) = self.hub.next_command() else {
                break;
            };
            if let Err(refusal) = self.obey(now, &envelope.command) {
                envelope.answer(Answer::Refused(refusal));
            }
        }
        if let Some(gesture) = self.hand.tick(now) {
            drop(self.does(now, gesture));
        }
        self.open(now);
        self.carry(now);
        self.show(now);
    }

    fn obey(&mut self, now: Instant, command: &Command) -> Result<(), String> {
        if let Command::Drive { axes } = command {
            return match self.hand.hold(now, axes) {
                Some(gesture) => self.does(now, gesture).inspect_err(|_| self.hand.let_go()),
                None => Ok(()),
            };
        }
        let gesture = command.gesture();
        let gesture = gesture.ok_or("there is no rig behind this page, only a robot")?;
        if matches!(gesture, Gesture::Mode(_) | Gesture::Disconnect) {
            self.hand.let_go();
        }
        self.does(now, gesture)
    }

    fn does(&mut self, now: Instant, gesture: Gesture) -> Result<(), String> {
        let action = self.station.answer(gesture)?;
        self.station.perform(now, &action)
    }

    /// Opens and closes the port as the PC requests.
    fn open(&mut self, now: Instant) {
        while let Some(change) = self.station.line_change(self.station.port()) {
            self.wants_port = change == LineEvent::Opened;
            if !self.wants_port {
                self.port = None;
            }
        }
        if !self.wants_port || self.port.is_some() || now < self.retry_at {
            return;
        }
        self.retry_at = now + RETRY;
        match Serial::open(&self.path, self.line) {
            Ok(port) => {
                self.port = Some(port);
                self.trouble = None;
            }
            Err(error) => self.trouble = Some(error.to_string()),
        }
    }

    /// Transfers bytes in both directions. The robot counts as connected after its first bytes.
    fn carry(&mut self, now: Instant) {
        let mut buf = [0; 1024];
        let end = self.station.port();
        for _ in 0..AT_ONCE {
            let Some(port) = &mut self.port else {
                break;
            };
            match port.read(&mut buf) {
                Ok(0) => break,
                Ok(len) => self.station.receive(end, now, &buf[..len]),
                Err(error) => {
                    self.trouble = Some(error.to_string());
                    self.port = None;
                    self.wants_port = false;
                    self.station.line_event(end, now, LineEvent::Closed);
                }
            }
        }
        self.station.tick(now);
        drop(self.station.take_events());
        if let Some(port) = &mut self.port {
            while let len @ 1.. = self.station.transmit(end, &mut buf) {
                port.write(&buf[..len]);
            }
        }
    }

    fn show(&mut self, now: Instant) {
        if self.shown_at.is_some_and(|at| now - at < SHOW_EVERY) {
            return;
        }
        self.shown_at = Some(now);
        if let Some(map) = self.station.map() {
            look_at_map(&mut self.layer, map);
        }
        let slow = json!({"type": "slow", "lanes": [], "panels": self.station.panels(),
                          "counters": [], "faults": []});
        self.slow.renew(slow.to_string());
        let believed = self.station.stated_pose().map(short_pose);
        let mut timeline = self
            .hub
            .timeline
            .write()
            .unwrap_or_else(PoisonError::into_inner);
        if timeline.wants_sample(now) {
            let sample = Sample {
                at: now,
                truth: None,
                believed,
                tallies: &[],
                figures: &[],
            };
            timeline.sample(&sample);
        }
        if timeline.wants_moment(now) {
            timeline.moment(now, self.snapshot(now, believed));
        }
        drop(timeline);
        self.hub.show(self.snapshot(now, believed));
    }

    fn snapshot(&self, now: Instant, believed: Option<[f64; 3]>) -> Snapshot {
        let fast = json!({
            "type": "now",
            "run": 1,
            "at_ns": now.as_nanos(),
            "looked_ns": now.as_nanos(),
            "paused": false,
            "speed": 1.0,
            "truth": null,
            "believed": believed,
            "mode": null,
            "pc": self.station.view(now),
            "trouble": self.trouble,
            "maps": [self.layer.last().head],
            "scene": null,
        });
        Snapshot {
            run: 1,
            stage: self.stage().to_string().into(),
            fast: fast.to_string().into(),
            slow: self.slow.clone(),
            scan: Numbered::new("{}"),
            overlays: Numbered::new("{}"),
            checks: Numbered::new("{}"),
            layers: vec![self.layer.last()],
        }
    }

    fn stage(&self) -> Value {
        json!({
            "type": "stage",
            "run": 1,
            "kind": "pc",
            "name": self.path.display().to_string(),
            "description": "a robot on a port",
            "seed": null,
            "scene": null,
            "footprint": Outline::Circle([0.0, 0.0, self.station.radius_m()]),
            "links": [],
            "pace": false,
            "speed_max": 1,
            "pc": true,
            "modes": self.station.modes(),
            "mode_words": told::mode_words(&*self.station),
            "place_acts": self.station.place_acts(),
            "keys": self.station.keys(),
        })
    }
}
