//! Motor control of the base: the speed regulator's run, and the timeout that stops the motors.

use core::time::Duration;

use protocols::Instant;
use protocols::avr::registers;

use super::drive::{Regulator, speed};
use super::memory;
use super::profile::{Registers, Watchdog};
use super::request::{Request, RequestKind};
use super::ticks::{DIVIDER, REGULATOR};
use super::{AvrBase, SET_POINT_REGISTERS, WHEELS};
use crate::world::{Drive, World};

/// Delay between the expiry of the motor watchdog and its effect, for a processor that answers
/// after a fixed time.
const WATCHDOG_LAG: Duration = Duration::from_micros(42);

impl AvrBase {
    /// Restarts the watchdog for a valid request that is processed at `at`.
    pub(super) fn restart_watchdog(&mut self, at: Instant, request: &Request) {
        match self.quirks.watchdog {
            Watchdog::AnyFrame { timeout } => self.watchdog_at = Some(request.at + timeout),
            Watchdog::Divider { counts, .. } => {
                let drives = registers::SPEED_LEFT_TO..=registers::MOTOR_STANDBY;
                if request.kind() != RequestKind::Write || !drives.contains(&request.register()) {
                    return;
                }
                if self.is_measured() {
                    self.chip.watchdog_counts = Some(counts);
                } else {
                    self.watchdog_at = Some(self.ticks.after(at, DIVIDER, counts) + WATCHDOG_LAG);
                }
            }
        }
    }

    /// Stops the motors because the master has been silent for too long.
    pub(super) fn motor_watchdog(&mut self, at: Instant, world: &mut World) {
        self.watchdog_at = None;
        self.chip.watchdog_counts = None;
        let speeds = self.set_points();
        let [left, right] = speeds;
        let mut effect = "motors stop";
        match self.quirks.watchdog {
            Watchdog::Divider {
                clears: Registers::Kept,
                ..
            } => effect = "without effect: the registers keep the speeds",
            Watchdog::Divider { .. } => self.clear_set_points(),
            Watchdog::AnyFrame { .. } => {
                self.clear_set_points();
                for side in &mut self.sides {
                    side.regulator = Regulator::default();
                }
                if self.motors.driven {
                    for wheel in WHEELS {
                        world.set_drive(wheel, Drive::Brake);
                    }
                }
            }
        }
        if speeds != [0; 2] {
            self.motors.reason = "watchdog";
            let detail = format!("silence at speeds {left}, {right}: {effect}");
            self.journal.note(at, "watchdog", detail);
        }
        if let Watchdog::AnyFrame { .. } = self.quirks.watchdog {
            self.tell_motors(at, false);
        }
    }

    /// The motors' state, as the fielded builds have it in their memory.
    pub(super) fn motor_state(&self) -> memory::Motors {
        let sides = &self.sides;
        memory::Motors {
            counted: sides.map(|side| side.counted),
            power: sides.map(|side| side.regulator.power),
            is: sides.map(|side| side.is),
            to: sides.map(|side| side.set_point),
            count: sides.map(|side| side.counter.count()),
            edges: sides.map(|side| side.counter.edges()),
            off: self.switched_off[0],
            off_unseen: self.switched_off[1],
            sum: sides.map(|side| side.regulator.sum),
        }
    }

    /// Takes the motors' state that the master has overwritten. Set-points come from their
    /// registers in the next pass.
    pub(super) fn take_motor_state(&mut self, state: &memory::Motors) {
        for (index, side) in self.sides.iter_mut().enumerate() {
            side.counted = state.counted[index];
            side.is = state.is[index];
            side.regulator.power = state.power[index];
            side.regulator.sum = state.sum[index];
            let counter = &mut side.counter;
            if [counter.count(), counter.edges()] != [state.count[index], state.edges[index]] {
                counter.overwrite(state.count[index], state.edges[index]);
            }
        }
        self.switched_off = [state.off, state.off_unseen];
    }

    fn clear_set_points(&mut self) {
        for (side, address) in self.sides.iter_mut().zip(SET_POINT_REGISTERS) {
            self.memory.set(address, 0);
            side.set_point = 0;
        }
    }

    /// One run of the speed regulator.
    pub(super) fn regulate(&mut self, at: Instant, world: &mut World) {
        let periods = self.ticks.runs(self.regulated, self.now, REGULATOR).max(1);
        let periods = i32::try_from(periods).unwrap_or(i32::MAX);
        self.regulated = self.now;
        self.regulator_at = self.ticks.after(self.now, REGULATOR, 1);
        self.look_at_wheels(world);
        let set_points = self.set_points();
        let enabled = self.motors_enabled();
        let held = self.motors.held;
        for ((side, wheel), set_point) in self.sides.iter_mut().zip(WHEELS).zip(set_points) {
            let count = side.counter.count();
            // A rig that comes late sees several periods at once.
            let ticks = count.wrapping_sub(side.counted) / periods;
            side.counted = count;
            side.is = speed(ticks);
            let drive = side.regulator.step(self.quirks.gains, set_point, side.is);
            let drive = if enabled { drive } else { Drive::Coast };
            let is_held = held[wheel as usize];
            world.set_drive(wheel, if is_held { Drive::Brake } else { drive });
        }
        self.tell_motors(at, enabled && set_points != [0; 2]);
    }

    /// Notes when the motors start and end to be driven.
    pub(super) fn tell_motors(&mut self, at: Instant, driven: bool) {
        if driven == self.motors.driven {
            return;
        }
        self.motors.driven = driven;
        if driven {
            let [left, right] = self.set_points();
            let detail = format!("speeds {left}, {right} ticks per 40 ms");
            self.journal.note(at, "motors-on", detail);
            self.motors.reason = "set-point";
            return;
        }
        let reason = if self.is_stopped() {
            "stop-button"
        } else if !self.motors_enabled() {
            "stand-by"
        } else {
            self.motors.reason
        };
        self.journal.note(at, "motors-stopped", reason.into());
    }
}
