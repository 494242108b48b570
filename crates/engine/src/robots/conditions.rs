//! Conditions on the state of a run: their current values, and whether the robot has the named
//! items.

mod values;

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::axis::Axis;
use super::instruments::Instruments;
use super::log_rules;
pub(crate) use super::log_rules::Known;
use crate::codec::Codec;
use crate::near;
use crate::rig::Rig;
use crate::rig::direction::Direction;
use crate::scenario::device::DeviceValue;
use crate::scenario::{
    Action, AxisCondition, Condition, DeviceSpec, DirectionSpec, EventCondition, Figure, Flaw,
    FrameCondition, Operand, Quantity, RegisterCondition, RobotCondition,
};
use values::{check_bit, check_frame, check_name};

/// A cell of a map that was never seen.
const UNKNOWN: u8 = 127;
/// Sources of log entries that are neither a device nor a link; the PC of a built-in robot may be
/// outside of the rig.
const SOURCES: [&str; 4] = ["pc", "program", "rig", "robot"];

/// A run at one moment, as conditions see it.
pub(crate) struct Moment<'a> {
    /// The rig.
    pub(crate) rig: &'a Rig,
    /// The robot's observable state.
    pub(crate) instruments: &'a dyn Instruments,
    /// The axes, if they were read already.
    pub(crate) axes: Option<&'a [Axis]>,
    /// The devices of the scenario.
    pub(crate) devices: &'a BTreeMap<String, DeviceSpec>,
    /// Waypoints visited, and those of the mission.
    pub(crate) waypoints: [usize; 2],
}

/// The value of a condition.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Reading {
    /// Whether the condition holds; `None` if the value cannot be compared.
    pub(crate) holds: Option<bool>,
    /// The value, if there is one for display.
    pub(crate) value: Option<Operand>,
}

impl Moment<'_> {
    /// The current value of `condition`; `None` if there is no value, or if the condition does not
    /// refer to the state.
    pub(crate) fn reading(&self, condition: &Condition) -> Option<Reading> {
        let compared = |op: crate::scenario::Op, found: Operand, wanted: &Operand| Reading {
            holds: op.compares(&found, wanted),
            value: Some(found),
        };
        match condition {
            Condition::Register(register) => {
                let found = self.register(register)?;
                Some(compared(register.op, found, &register.value))
            }
            Condition::Pose(place) => {
                let pose = self.rig.world.pose();
                let [x, y] = place.near_m;
                let metres = libm::hypot(pose.x - x, pose.y - y);
                let value = Some(Operand::Number((metres * 1000.0).round() / 1000.0));
                let holds = Some(metres <= place.within_m);
                Some(Reading { holds, value })
            }
            Condition::Map(map) => {
                let share = self.known_share()?;
                let value = Some(Operand::Number((share * 1e4).round() / 1e4));
                let holds = Some(share >= map.known_min);
                Some(Reading { holds, value })
            }
            Condition::Visited(count) => Some(Reading {
                holds: Some(self.waypoints[0] >= *count),
                #[expect(clippy::cast_precision_loss, reason = "a number of waypoints")]
                value: Some(Operand::Number(self.waypoints[0] as f64)),
            }),
            Condition::Axis(axis) => {
                let found = self.axis(axis)?;
                Some(compared(axis.op, found.into(), &axis.value.into()))
            }
            Condition::Robot(RobotCondition { of, op, value }) => {
                let found = self.robot(*of);
                Some(compared(*op, found.into(), &(*value).into()))
            }
            _ => None,
        }
    }

    /// Share of known cells of the robot's map, or of the map that its station received.
    pub(crate) fn known_share(&self) -> Option<f64> {
        let station = || self.instruments.station(self.rig)?.map();
        let map = self.instruments.map(self.rig).or_else(station)?;
        let cells = map.cells();
        let known = cells.iter().filter(|&&cell| cell != UNKNOWN).count();
        Some(known as f64 / cells.len().max(1) as f64)
    }

    fn axes(&self) -> Cow<'_, [Axis]> {
        match self.axes {
            Some(axes) => Cow::Borrowed(axes),
            None => Cow::Owned(self.instruments.axes(self.rig)),
        }
    }

    fn axis(&self, wanted: &AxisCondition) -> Option<f64> {
        let axes = self.axes();
        let axis = axes.iter().find(|axis| axis.name == wanted.name)?;
        match wanted.of {
            Figure::SetPoint => Some(axis.set_point),
            Figure::Actual => axis.actual,
        }
    }

    fn robot(&self, of: Quantity) -> f64 {
        let world = &self.rig.world;
        match of {
            Quantity::SpeedMS => world.speed(),
            Quantity::TurnRateDegS => world.turn_rate().to_degrees(),
            Quantity::XM => world.pose().x,
            Quantity::YM => world.pose().y,
            Quantity::HeadingDeg => emulators::world::wrap_angle(world.pose().theta).to_degrees(),
            #[expect(clippy::cast_precision_loss, reason = "a number of contacts")]
            Quantity::Contacts => world.contact_count() as f64,
            Quantity::ClearanceM => world.clearance(),
        }
    }

    fn register(&self, wanted: &RegisterCondition) -> Option<Operand> {
        let byte = wanted
            .address
            .and_then(|address| u8::try_from(address).ok());
        let byte = byte.and_then(|address| self.rig.register(&wanted.device, address));
        if let Some(byte) = byte {
            return Some(Operand::Number(byte.into()));
        }
        let values = self.values(&wanted.device).into_iter();
        let is_it = |value: &DeviceValue| match &wanted.name {
            Some(name) => value.name == *name,
            None => value.address == wanted.address,
        };
        values.into_iter().find(is_it).map(|value| value.value)
    }

    /// The values of a device: its own, or those that the robot displays for the device.
    fn values(&self, device: &str) -> Vec<DeviceValue> {
        let own = self.devices.get(device);
        let own = own.map_or(Vec::new(), |spec| spec.values(self.rig, device));
        if !own.is_empty() {
            return own;
        }
        let panels = self.instruments.panels(self.rig).into_iter();
        let panels = panels.filter(|panel| panel.name.split(' ').next() == Some(device));
        let rows = panels.flat_map(|panel| panel.rows);
        let value = |row: super::PanelRow| DeviceValue {
            address: row.address,
            name: row.name.into_owned(),
            value: Operand::from_words(&row.value),
        };
        rows.map(value).collect()
    }
}

/// Checks of the items that conditions name.
impl Moment<'_> {
    /// Checks that the run has all items that `condition` names.
    ///
    /// # Errors
    /// The first name that is unknown, with the name that was probably meant and the known ones.
    pub(crate) fn check(&self, condition: &Condition) -> Result<(), Flaw> {
        match condition {
            Condition::Bytes(bytes) => self.link(&bytes.link).map(drop),
            Condition::Frame(frame) => check_frame(frame, self.codec(frame)?),
            Condition::Register(register) => self.check_register(register),
            Condition::Event(event) => self.check_event(event),
            Condition::Axis(axis) => self.check_axis(axis),
            Condition::Visited(count) if *count > self.waypoints[1] => {
                let all = self.waypoints[1];
                let message = format!("is {count}, but the mission has {all} waypoints to count");
                Err(Flaw::new("visited", message))
            }
            Condition::Map(_) if self.known_share().is_none() && !self.may_get_a_map() => {
                let message = "the robot has no map that hilrig can read";
                Err(Flaw::new("map", message))
            }
            Condition::Pose(_) => self.check_body("pose"),
            Condition::Robot(_) => self.check_body("robot"),
            Condition::Contact(_) => self.check_body("contact"),
            Condition::All(parts) | Condition::Any(parts) => {
                parts.iter().try_for_each(|part| self.check(part))
            }
            Condition::Not(inner) => self.check(inner),
            Condition::Visited(_) | Condition::Map(_) => Ok(()),
        }
    }

    /// Checks that the run has the items that a step of the rig names.
    ///
    /// # Errors
    /// The first name that is unknown, with the known ones.
    pub(crate) fn check_action(&self, action: &Action) -> Result<(), Flaw> {
        match action {
            Action::Inject(inject) => self.link(&inject.link).map(drop),
            Action::Set(set) => {
                let known: Vec<&str> = self.devices.keys().map(String::as_str).collect();
                if !known.contains(&set.device.as_str()) {
                    return Err(Flaw::new("device", near::expected(&set.device, &known)));
                }
                let values = self.values(&set.device);
                let names: Vec<&str> = values.iter().map(|value| &*value.name).collect();
                match names.contains(&set.name.as_str()) {
                    true => Ok(()),
                    false => Err(Flaw::new("name", near::expected(&set.name, &names))),
                }
            }
            _ => Ok(()),
        }
    }

    /// Number of the link called `name`.
    pub(crate) fn link(&self, name: &str) -> Result<usize, Flaw> {
        let links = self.rig.links();
        let index = links.iter().position(|link| link.name == name);
        index.ok_or_else(|| {
            let all: Vec<&str> = links.iter().map(|link| link.name.as_str()).collect();
            Flaw::new("link", near::expected(name, &all))
        })
    }

    /// The codec of the line of `frame`.
    pub(crate) fn codec(&self, frame: &FrameCondition) -> Result<&'static Codec, Flaw> {
        let link = self.link(&frame.link)?;
        let name = &self.rig.links()[link].name;
        let direction = Direction::from(frame.direction);
        let codec = self.instruments.codec_towards(self.rig, name, direction);
        codec.ok_or_else(|| {
            let spec = self.devices.get(name);
            let way = match frame.direction {
                DirectionSpec::ToMaster => "to-master",
                DirectionSpec::ToDevice => "to-device",
            };
            let message = match spec.map(DeviceSpec::kind) {
                Some("text") => format!(
                    "is the line of a text device, which has no frames with fields: expected `bytes`, \
                     e.g. {{ bytes = {{ link = \"{name}\", direction = \"{way}\", hex = \"44 3D\" }} }}, or the \
                     condition `register` on a variable of {name}; a device with a description has \
                     fields"
                ),
                _ => format!("the protocol of {name} is unknown: expected `bytes`"),
            };
            Flaw::new("link", message)
        })
    }

    fn check_register(&self, register: &RegisterCondition) -> Result<(), Flaw> {
        let device = &register.device;
        if let (Some(address), None) = (register.address, &register.name) {
            let values = self.values(device).into_iter();
            let here = values.filter(|value| value.address == Some(address));
            let names: Vec<String> = here.map(|value| value.name).collect();
            if names.len() > 1 {
                let names = names.join(", ");
                let message = format!("is {address} in several tables, expected name: {names}");
                return Err(Flaw::new("address", message));
            }
        }
        if let Some(found) = self.register(register) {
            let (op, wanted) = (register.op, &register.value);
            let is_wrong =
                self.devices.contains_key(device) && op.compares(&found, wanted).is_none();
            let message = format!(
                "is {wanted}, but {device} shows {found}: expected a value of the same type"
            );
            return match is_wrong {
                true => Err(Flaw::new("value", message)),
                false => {
                    check_bit(&found, register).and_then(|()| self.check_name_of_value(register))
                }
            };
        }
        let known: Vec<&str> = self.rig.device_names().collect();
        if !known.contains(&device.as_str()) {
            return Err(Flaw::new("device", near::expected(device, &known)));
        }
        // The names of values of a program that plays a device are known only after its start.
        let own = self.devices.get(device);
        if register.name.is_some() && own.is_some_and(DeviceSpec::has_late_values) {
            return Ok(());
        }
        let values = self.values(device);
        let Some(name) = &register.name else {
            let address = register.address.unwrap_or_default();
            let known: Vec<String> = values
                .iter()
                .filter_map(|value| value.address.map(|address| address.to_string()))
                .collect();
            let message = match known.is_empty() {
                true => format!("is {address}, but {device} has no registers with numbers"),
                false => format!("is {address}, expected one of {}", known.join(", ")),
            };
            return Err(Flaw::new("address", message));
        };
        let names: Vec<&str> = values.iter().map(|value| &*value.name).collect();
        Err(Flaw::new("name", near::expected(name, &names)))
    }

    /// Checks that the value of `register` can have the wanted name.
    fn check_name_of_value(&self, register: &RegisterCondition) -> Result<(), Flaw> {
        let RegisterCondition { device, name, .. } = register;
        let own = self.devices.get(device).zip(name.as_ref());
        let names = own.and_then(|(own, name)| own.names_of_value(self.rig, device, name));
        check_name(&register.value, names)
    }

    fn check_axis(&self, axis: &AxisCondition) -> Result<(), Flaw> {
        let axes = self.axes();
        if axes.iter().any(|one| one.name == axis.name) {
            return Ok(());
        }
        let all: Vec<&str> = axes.iter().map(|axis| &*axis.name).collect();
        let message = match all.is_empty() {
            true => format!("is {:?}, but the robot has no axes", axis.name),
            false => near::expected(&axis.name, &all),
        };
        Err(Flaw::new("name", message))
    }

    fn check_source(&self, source: &str) -> Result<(), Flaw> {
        let devices = self.rig.device_names();
        let links = self.rig.links().iter().map(|link| link.name.as_str());
        let mut known: Vec<&str> = devices.chain(links).chain(SOURCES).collect();
        known.sort_unstable();
        known.dedup();
        match known.contains(&source) {
            true => Ok(()),
            false => Err(Flaw::new("source", near::expected(source, &known))),
        }
    }

    /// Checks the source of an event, and its rule if all rules of the source are known.
    fn check_event(&self, event: &EventCondition) -> Result<(), Flaw> {
        let Some(source) = &event.source else {
            return Ok(());
        };
        self.check_source(source)?;
        let device = self.devices.get(source);
        let kind = device.map(DeviceSpec::kind);
        let declared = device.and_then(DeviceSpec::events);
        let own = device.map_or(Vec::new(), |device| device.own_rules(self.rig, source));
        match log_rules::unknown(kind, &own, declared, &event.rule) {
            Some(message) => Err(Flaw::new("rule", message)),
            None => Ok(()),
        }
    }

    /// Whether the description of the source, or of any device, names the rule of `event`.
    fn is_own_rule(&self, event: &EventCondition) -> bool {
        let is_meant = |name: &str| event.source.as_ref().is_none_or(|source| source == name);
        let mut devices = self.devices.iter().filter(|(name, _)| is_meant(name));
        devices.any(|(name, device)| device.own_rules(self.rig, name).contains(&&*event.rule))
    }

    /// Knowledge about the rule of `event`, from its name and its source.
    pub(crate) fn known_rule(&self, event: &EventCondition) -> Known {
        let source = event.source.as_ref();
        let device = source.and_then(|source| self.devices.get(source));
        if device.and_then(DeviceSpec::events).is_some() {
            // The wiring has checked the name.
            return Known::Logged;
        }
        if self.is_own_rule(event) {
            return Known::Logged;
        }
        log_rules::known(device.map(DeviceSpec::kind), &event.rule)
    }

    /// The possible names for the first value in `condition` that its device does not have, if the
    /// device shows values only after its start.
    pub(crate) fn missing(&self, condition: &Condition) -> Option<String> {
        match condition {
            Condition::All(parts) | Condition::Any(parts) => {
                parts.iter().find_map(|part| self.missing(part))
            }
            Condition::Not(inner) => self.missing(inner),
            Condition::Register(register) => {
                let device = self.devices.get(&register.device);
                let is_late = device.is_some_and(DeviceSpec::has_late_values);
                is_late.then(|| self.missing_value(register)).flatten()
            }
            _ => None,
        }
    }

    /// The possible names for `register`, if its name is unknown now. A device that has declared no
    /// values yet may have any name.
    pub(crate) fn missing_value(&self, register: &RegisterCondition) -> Option<String> {
        let name = register.name.as_ref()?;
        let own = self.devices.get(&register.device);
        let mut declared = own.map_or(Vec::new(), |own| {
            own.value_names(self.rig, &register.device)
        });
        if declared.is_empty() {
            let shown = self.values(&register.device).into_iter();
            declared.extend(shown.map(|value| value.name));
        }
        let names: Vec<&str> = declared.iter().map(String::as_str).collect();
        let is_there = names.is_empty() || names.contains(&name.as_str());
        (!is_there).then(|| near::expected(name, &names))
    }

    fn check_body(&self, key: &'static str) -> Result<(), Flaw> {
        match self.instruments.has_body() {
            true => Ok(()),
            false => {
                let message = "the scenario has no robot (robot = \"none\")";
                Err(Flaw::new(key, message))
            }
        }
    }

    /// Whether the robot has no map yet but can get one, because its station receives a map.
    fn may_get_a_map(&self) -> bool {
        let station = self.instruments.station(self.rig);
        station.is_some_and(|station| station.has_whole_map().is_some())
    }
}
