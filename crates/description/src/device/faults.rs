//! Faults of a described device: the common ones and those of the description.

use core::time::Duration;

use emulators::world::World;
use protocols::Instant;

use super::Described;
use crate::state::{Change, Overlay, State};

/// Factor of the fault `wrong` if the scenario sets none.
const WRONG: f64 = 1.2;
/// Factor of the fault `slow` if the scenario sets none.
const SLOW: f64 = 10.0;

/// The active faults with their figures.
#[derive(Clone, Debug, Default)]
pub(super) struct Faults {
    active: Vec<(&'static str, Option<f64>)>,
    /// Whether variables must be frozen at the next poll, which has access to the world.
    is_changed: bool,
}

impl Faults {
    /// Whether the faults changed since the last poll.
    pub(super) const fn is_changed(&self) -> bool {
        self.is_changed
    }

    /// Whether the device has no power.
    pub(super) fn is_off(&self) -> bool {
        self.figure("off").is_some()
    }

    fn figure(&self, name: &str) -> Option<Option<f64>> {
        let found = self.active.iter().find(|(active, _)| *active == name);
        found.map(|(_, figure)| *figure)
    }
}

impl Described {
    /// Begins or ends a fault.
    pub(super) fn change_fault(
        &mut self,
        now: Instant,
        fault: &str,
        figure: Option<f64>,
        begins: bool,
    ) {
        let names = self.description.fault_names;
        let Some(&name) = names.iter().find(|name| **name == fault) else {
            return;
        };
        let was_off = self.faults.is_off();
        self.faults.active.retain(|(active, _)| *active != name);
        if begins {
            self.faults.active.push((name, figure));
        }
        self.faults.is_changed = true;
        let own = self.description.faults.iter().find(|own| own.name == name);
        let restarts = own.is_some_and(|own| own.restarts);
        if (begins && (name == "restart" || restarts)) || (name == "off" && was_off) {
            // Bytes before the reset are lost.
            let lost = self.inbox.drain(..).map(|(_, bytes)| bytes.len());
            self.heard.pass(lost.sum());
        }
        match name {
            "off" if begins => self.log.note(now, "off", "the supply is gone".to_owned()),
            "off" if was_off => self.restart(now, "the supply is back"),
            "restart" if begins => self.restart(now, "a reset"),
            _ if begins && restarts => self.restart(now, name),
            _ => {}
        }
    }

    /// Applies the effects of active faults to the state.
    pub(super) fn lay_faults(&mut self, now: Instant, world: &World) {
        if !core::mem::take(&mut self.faults.is_changed) {
            return;
        }
        let description = self.description.clone();
        let old = core::mem::take(&mut self.state.overlays);
        let frozen = |state: &State, variable: usize| {
            let before = old.iter().find(|overlay| {
                overlay.variable == variable && matches!(overlay.change, Change::Frozen(_))
            });
            before.map_or_else(
                || Change::Frozen(state.read(variable, now, world)),
                |overlay| overlay.change.clone(),
            )
        };
        let mut overlays = Vec::new();
        for &(name, figure) in &self.faults.active {
            let all = 0..description.variables.len();
            let measured = all.filter(|variable| description.is_reading(*variable));
            match name {
                "stuck" => overlays.extend(measured.map(|variable| Overlay {
                    variable,
                    change: frozen(&self.state, variable),
                })),
                "wrong" => overlays.extend(measured.map(|variable| Overlay {
                    variable,
                    change: Change::Factor(figure.unwrap_or(WRONG)),
                })),
                _ => {}
            }
            let Some(own) = description.faults.iter().find(|own| own.name == name) else {
                continue;
            };
            for &variable in &own.freeze {
                let change = frozen(&self.state, variable);
                overlays.push(Overlay { variable, change });
            }
            for (variable, expr) in &own.set {
                let change = Change::Computed {
                    expr: expr.clone(),
                    figure: figure.unwrap_or(1.0),
                };
                overlays.push(Overlay {
                    variable: *variable,
                    change,
                });
            }
        }
        self.state.overlays = overlays;
    }

    fn own_faults(&self) -> impl Iterator<Item = &crate::behaviour::Fault> {
        let own = self.description.faults.iter();
        own.filter(|own| self.faults.figure(own.name).is_some())
    }

    /// Whether a fault stops transmission.
    pub(super) fn is_mute(&self) -> bool {
        self.own_faults().any(|own| own.is_mute)
    }

    /// The delay that faults add.
    pub(super) fn delayed(&self) -> Duration {
        self.own_faults().map(|own| own.late).sum()
    }

    /// A latency with the effects of faults.
    pub(super) fn slowed(&self, latency: Duration) -> Duration {
        let slowed = match self.faults.figure("slow") {
            None => latency,
            Some(figure) => latency.mul_f64(figure.unwrap_or(SLOW).clamp(0.0, 1e6)),
        };
        slowed + self.delayed()
    }

    /// The replacement of a message.
    pub(super) fn replaced(&self, message: usize) -> usize {
        let mut pairs = self.own_faults().flat_map(|own| own.replace.iter());
        let found = pairs.find(|(from, _)| *from == message);
        found.map_or(message, |(_, to)| *to)
    }

    /// A frame with the damage of active faults.
    pub(super) fn spoiled(&mut self, format: usize, mut frame: Vec<u8>) -> Vec<u8> {
        if self.own_faults().any(|own| own.is_bad_checksum) {
            self.description.frames.spoil(format, &mut frame);
        }
        if self.faults.figure("garbage").is_some() {
            for byte in &mut frame {
                *byte = self.random_byte();
            }
        }
        frame
    }

    /// Sends the garbage bytes of a restart.
    pub(super) fn send_garbage(&mut self, now: Instant) {
        let count: usize = self.own_faults().map(|own| own.garbage).sum();
        if count > 0 {
            let bytes = (0..count).map(|_| self.random_byte()).collect();
            self.queue(now, bytes);
        }
    }

    fn random_byte(&mut self) -> u8 {
        u8::try_from(self.dice.below(256)).unwrap_or(0)
    }
}
