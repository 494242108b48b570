//! Requests of Modbus: to a table of registers, with an address.

use core::ops::Range;

use emulators::device::EventKind;
use protocols::Instant;

use super::act::Doer;
use crate::modbus::{self, Wrong};

impl Doer<'_> {
    /// Handles a Modbus frame with its address, which has the bytes `span` of the wire.
    pub(super) fn modbus(&mut self, at: Instant, body: &[u8], span: Range<u64>) {
        let Some((&address, request)) = body.split_first() else {
            return;
        };
        let own = self.device.address();
        let is_broadcast = address == 0;
        if !is_broadcast && u32::from(address) != own {
            return self.device.complain_if_absent(at, address.into(), span);
        }
        if !self.device.place.is_alone {
            self.device.heard.claim(span);
        }
        let description = self.of;
        let Some(registers) = &description.registers else {
            return;
        };
        let values = |index: usize| self.device.state.read(index, at, self.world);
        let answer = modbus::answer(registers, request, &values);
        match &answer.wrong {
            None => {}
            Some(Wrong::Function(function)) => {
                let name = modbus::function_name(*function);
                let detail = format!("function {function}, {name}, is not known");
                self.wrong(at, "unknown-function", detail);
            }
            Some(Wrong::Register(refusal)) => self.refused(at, refusal),
            Some(Wrong::Malformed(detail)) => self.wrong(at, "bad-request", detail.clone()),
        }
        for variable in answer.cut {
            let value = self.device.state.read(variable, at, self.world);
            let name = &description.variables[variable].name;
            let detail = || format!("register {name} cannot be {value}");
            let log = &mut self.device.log;
            log.repeated(at, EventKind::Note, "value-cut", detail);
        }
        for (variable, value) in answer.changes {
            self.device.state.write(variable, value);
        }
        if is_broadcast {
            return;
        }
        let frame = description.frame_of(0, &[&[address][..], &answer.response].concat());
        let latency = self.latency(description.latency, description.jitter);
        if let Some(frame) = frame {
            let due = at + latency.max(description.turnaround);
            self.queue(due, 0, frame);
        }
    }
}
