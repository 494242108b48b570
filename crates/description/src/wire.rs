//! Several devices on one wire, as on RS-485: all receive each request, the addressed one replies.

use std::sync::Arc;

use emulators::device::{BrokenRules, Device, Event, earliest};
use emulators::world::World;
use protocols::{Instant, LineConfig, LineEvent, Port};

use crate::compile::COMMON_FAULTS;
use crate::device::Described;
use crate::device::shared::WRONG_ADDRESS;
use crate::value::Value;

/// Devices that share a line; also used for a single device.
#[derive(Clone)]
pub struct Wire {
    units: Vec<(String, Described)>,
    fault_names: &'static [&'static str],
    /// The device that is sending a frame; others wait for its end.
    sender: Option<usize>,
    /// The violations of all devices together.
    broken: BrokenRules,
    /// Number of moments of each device's log that are in `broken`.
    counted: Vec<u64>,
}

/// The reason why devices cannot share a wire.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WireError(pub String);

impl Wire {
    /// Devices with their names on one wire.
    ///
    /// # Errors
    /// If there is no device, or two devices have different lines, the same name or the same
    /// address.
    pub fn new(mut units: Vec<(String, Described)>) -> Result<Self, WireError> {
        let Some((_, first)) = units.first() else {
            return Err(WireError(
                "no device is on the wire, expected at least one".to_owned(),
            ));
        };
        for (index, (name, unit)) in units.iter().enumerate() {
            let before = &units[..index];
            if unit.line_config(Described::UART) != first.line_config(Described::UART) {
                let message = format!("\"{name}\" and \"{}\" have different lines", units[0].0);
                return Err(WireError(format!(
                    "{message}, expected the same baud rate and format on one wire"
                )));
            }
            if before.iter().any(|(other, _)| other == name) {
                let message =
                    format!("two devices are called \"{name}\", expected one name for each");
                return Err(WireError(message));
            }
            let twin = before
                .iter()
                .find(|(_, other)| other.address() == unit.address());
            if let Some((other, _)) = twin {
                let address = unit.address();
                return Err(WireError(format!(
                    "\"{name}\" and \"{other}\" have the address {address}, expected one for each"
                )));
            }
        }
        let addresses: Arc<[u32]> = units.iter().map(|(_, unit)| unit.address()).collect();
        for (_, unit) in &mut units {
            unit.join(addresses.clone());
        }
        let fault_names = match &units[..] {
            [(_, only)] => only.known_faults(),
            many => names_of_faults(many),
        };
        Ok(Self {
            counted: vec![0; units.len()],
            units,
            fault_names,
            sender: None,
            broken: BrokenRules::default(),
        })
    }

    /// The devices with their names.
    pub fn units(&self) -> impl Iterator<Item = (&str, &Described)> {
        self.units.iter().map(|(name, unit)| (name.as_str(), unit))
    }

    /// Sets the variable called `name`; of several devices it is `DEVICE.NAME`.
    ///
    /// # Errors
    /// If there is no such variable, or it cannot have this value.
    pub fn set(&mut self, name: &str, value: Value) -> Result<(), String> {
        if let [(_, only)] = &mut self.units[..] {
            return only.set(name, value);
        }
        let mut units = self.units.iter_mut();
        let found = units.find_map(|(unit, device)| {
            let inner = name.strip_prefix(unit.as_str())?.strip_prefix('.')?;
            Some((device, inner))
        });
        match found {
            Some((device, inner)) => device.set(inner, value),
            None => Err(format!(
                "is \"{name}\", expected DEVICE.NAME with a device of the wire"
            )),
        }
    }

    /// The rules that the descriptions name in `violation`.
    pub fn own_rules(&self) -> Vec<&'static str> {
        let all = self
            .units
            .iter()
            .flat_map(|(_, device)| &device.description().on);
        all.filter_map(|on| on.violation).collect()
    }

    /// The names of the values of a variable, which of several devices is `DEVICE.NAME`; `None` if
    /// it can have other values.
    pub fn names_of_value(&self, name: &str) -> Option<Vec<&str>> {
        if let [(_, only)] = &self.units[..] {
            return only.description().names_of_variable(name);
        }
        let mut units = self.units.iter();
        let (device, inner) = units.find_map(|(unit, device)| {
            let inner = name.strip_prefix(unit.as_str())?.strip_prefix('.')?;
            Some((device, inner))
        })?;
        device.description().names_of_variable(inner)
    }

    /// The variables of all devices: address of the register, name, value, value in words.
    pub fn values(&self, now: Instant, world: &World) -> Vec<(Option<u32>, String, Value, String)> {
        let is_single = self.units.len() == 1;
        let rows = self.units.iter().flat_map(|(unit, device)| {
            let rows = device.values(now, world).into_iter();
            rows.map(move |(at, name, value, words)| match is_single {
                true => (at, name, value, words),
                false => (at, format!("{unit}.{name}"), value, words),
            })
        });
        rows.collect()
    }
}

impl Wire {
    /// Adds the new entries of the devices' logs to the common count.
    fn count(&mut self) {
        let logs = self
            .units
            .iter()
            .filter_map(|(_, unit)| unit.broken_rules());
        if logs.map(BrokenRules::seen).eq(self.counted.iter().copied()) {
            return;
        }
        let mut moments = Vec::new();
        for ((_, unit), counted) in self.units.iter().zip(&mut self.counted) {
            let Some(log) = unit.broken_rules() else {
                continue;
            };
            moments.extend(log.since(*counted).0);
            *counted = log.seen();
        }
        moments.sort_by_key(|(at, _)| *at);
        let logs = self
            .units
            .iter()
            .filter_map(|(_, unit)| unit.broken_rules());
        let mut fresh: Vec<(&'static str, u64)> = Vec::new();
        for (rule, count) in logs.flat_map(BrokenRules::iter) {
            match fresh.iter_mut().find(|(known, _)| *known == rule) {
                Some((_, sum)) => *sum += count,
                None => fresh.push((rule, count)),
            }
        }
        for (rule, count) in self.broken.iter() {
            if let Some((_, fresh)) = fresh.iter_mut().find(|(known, _)| *known == rule) {
                *fresh -= count;
            }
        }
        let last = moments.last().map(|(at, _)| *at);
        for (at, rule) in moments {
            match fresh.iter_mut().find(|(known, _)| *known == rule) {
                Some((_, left @ 1..)) => {
                    *left -= 1;
                    self.broken.count(at, rule);
                }
                _ => self.broken.note(at, rule),
            }
        }
        // Violations whose moments a log does not keep any more.
        for (rule, left) in fresh {
            (0..left).for_each(|_| self.broken.count(last.unwrap_or_default(), rule));
        }
    }
}

/// The names of all faults with a static lifetime, as a rig requires them: common faults such as
/// `off` for all devices at once, and every fault of one device as `NAME.FAULT`.
fn names_of_faults(units: &[(String, Described)]) -> &'static [&'static str] {
    let single = units.iter().flat_map(|(name, unit)| {
        let faults = unit.known_faults().iter();
        faults.map(move |fault| crate::compile::forever(&format!("{name}.{fault}")))
    });
    let names: Vec<&'static str> = COMMON_FAULTS.into_iter().chain(single).collect();
    Vec::leak(names)
}

impl Device for Wire {
    fn receive(&mut self, port: Port, now: Instant, bytes: &[u8]) {
        for (_, unit) in &mut self.units {
            unit.receive(port, now, bytes);
        }
    }

    fn line_event(&mut self, port: Port, now: Instant, event: LineEvent) {
        for (_, unit) in &mut self.units {
            unit.line_event(port, now, event);
        }
    }

    fn poll(&mut self, now: Instant, world: &mut World) {
        for (_, unit) in &mut self.units {
            unit.poll(now, world);
        }
        // Bytes on a shared wire break a rule only if no device knows them, and then once.
        if self.units.iter().any(|(_, unit)| unit.has_heard()) {
            Described::settle(self.units.iter_mut().map(|(_, unit)| unit));
        }
        if self.units.len() > 1 {
            self.count();
        }
    }

    fn transmit(&mut self, port: Port, buf: &mut [u8]) -> usize {
        let ready = |units: &[(String, Described)], at: &usize| units[*at].1.may_send(port);
        let sender = self.sender.filter(|at| ready(&self.units, at));
        let next = || (0..self.units.len()).find(|at| ready(&self.units, at));
        self.sender = sender.or_else(next);
        match self.sender {
            Some(at) => self.units[at].1.transmit(port, buf),
            None => 0,
        }
    }

    fn may_send(&self, port: Port) -> bool {
        self.units.iter().any(|(_, unit)| unit.may_send(port))
    }

    fn poll_at(&self) -> Option<Instant> {
        earliest(self.units.iter().map(|(_, unit)| unit.poll_at()))
    }

    fn line_config(&self, port: Port) -> LineConfig {
        self.units[0].1.line_config(port)
    }

    fn known_faults(&self) -> &'static [&'static str] {
        self.fault_names
    }

    fn takes_figure(&self, fault: &str) -> bool {
        let mut units = self.units.iter();
        if let [(_, only)] = &self.units[..] {
            return only.takes_figure(fault);
        }
        units.any(|(name, unit)| {
            let own = fault.strip_prefix(name.as_str());
            own.and_then(|rest| rest.strip_prefix('.'))
                .is_some_and(|own| unit.takes_figure(own))
        })
    }

    fn set_fault(&mut self, now: Instant, fault: &str, figure: Option<f64>, begins: bool) {
        let is_single = self.units.len() == 1;
        for (name, unit) in &mut self.units {
            let own = fault
                .strip_prefix(name.as_str())
                .and_then(|rest| rest.strip_prefix('.'));
            match own {
                Some(own) if !is_single => unit.set_fault(now, own, figure, begins),
                _ if is_single || COMMON_FAULTS.contains(&fault) => {
                    unit.set_fault(now, fault, figure, begins);
                }
                _ => {}
            }
        }
    }

    fn broken_rules(&self) -> Option<&BrokenRules> {
        match &self.units[..] {
            [(_, unit)] => unit.broken_rules(),
            _ => Some(&self.broken),
        }
    }

    fn unframed(&self) -> u64 {
        let units = self.units.iter().map(|(_, unit)| unit.unframed());
        units.min().unwrap_or(0)
    }

    fn logs(&self) -> Vec<&BrokenRules> {
        self.units
            .iter()
            .flat_map(|(_, unit)| unit.logs())
            .collect()
    }

    fn take_events(&mut self) -> Vec<Event> {
        let is_single = self.units.len() == 1;
        let mut all = Vec::new();
        for (name, unit) in &mut self.units {
            all.extend(unit.take_events().into_iter().map(|event| match is_single {
                true => event,
                // Of all devices of the wire, none has the address.
                false if event.rule == WRONG_ADDRESS => event,
                false => Event {
                    detail: format!("{name}: {}", event.detail),
                    ..event
                },
            }));
        }
        all.sort_by_key(|event| event.at);
        all
    }
}
