//! Checks of keys that have no effect without another one.

use super::Compiler;
use crate::description::Description;
use crate::schema::behaviour::EventSpec;
use crate::schema::message::From;
use span::Span;

impl Compiler<'_> {
    /// Records errors for keys that can have no effect.
    pub(super) fn check_effects(&mut self, description: &Description) {
        // An external program may implement parts that the description only names.
        if description.program.is_some() {
            return;
        }
        self.check_events();
        self.check_safe();
        self.check_faults(description);
        self.check_zeros();
    }

    /// Times of 0 that change nothing, or end each frame at its first byte.
    fn check_zeros(&mut self) {
        let schema = self.schema;
        let is_zero = |time: Option<Span>| time.is_some_and(|span| span.0.is_zero());
        let nothing = "is 0s, which has no effect, expected a longer time, or leave it out";
        let frames = schema.frame.0.iter().enumerate();
        let is_single = schema.frame.0.len() == 1;
        let frames = frames.filter(|(_, frame)| is_zero(frame.idle));
        let frames = frames.map(|(index, _)| match is_single {
            true => "frame.idle".to_owned(),
            false => format!("frame[{index}].idle"),
        });
        let cuts = "is 0s and would end each frame at its first byte, expected a longer time";
        let busy = schema
            .on
            .iter()
            .enumerate()
            .filter(|(_, on)| is_zero(on.busy));
        let busy = busy.map(|(index, _)| format!("on[{index}].busy"));
        let late = schema
            .faults
            .iter()
            .filter(|(_, fault)| is_zero(fault.late));
        let late = late.map(|(name, _)| format!("faults.{name}.late"));
        let wrong = frames.map(|key| (key, cuts));
        let wrong: Vec<_> = wrong
            .chain(busy.chain(late).map(|key| (key, nothing)))
            .collect();
        for (key, message) in wrong {
            self.wrong(key, message);
        }
    }

    fn check_events(&mut self) {
        let schema = self.schema;
        let writes = schema.on.iter().any(|on| on.write.is_some());
        for (index, on) in schema.on.iter().enumerate() {
            let message = match on.event {
                Some(EventSpec::Watchdog) if schema.watchdog.is_none() => {
                    "never happens without a watchdog, expected a time such as watchdog = \"1s\" \
                     at the top of the file"
                }
                Some(EventSpec::Refused) if !writes => {
                    "never happens, expected an [[on]] with \"write\", which a register can refuse"
                }
                _ => continue,
            };
            self.wrong(format!("on[{index}].event"), message);
        }
    }

    fn check_safe(&mut self) {
        let schema = self.schema;
        if schema.watchdog.is_some() {
            return;
        }
        let state = schema.state.iter();
        let state = state.filter(|(_, spec)| spec.0.safe.is_some());
        let mut keys: Vec<String> = state
            .map(|(name, _)| format!("state.{name}.safe"))
            .collect();
        if let Some(all) = &schema.registers {
            let tables = [
                ("coils", &all.coils),
                ("discrete", &all.discrete),
                ("holding", &all.holding),
                ("input", &all.input),
                ("bytes", &all.bytes),
            ];
            for (table, specs) in tables {
                let safe = specs
                    .iter()
                    .enumerate()
                    .filter(|(_, spec)| spec.safe.is_some());
                keys.extend(safe.map(|(index, _)| format!("registers.{table}[{index}].safe")));
            }
        }
        for key in keys {
            let message = "has no effect without a watchdog, expected a time such as watchdog = \
                \"1s\" at the top of the file";
            self.wrong(key, message);
        }
    }

    fn check_faults(&mut self, description: &Description) {
        let sent = description.frames_of(From::Device);
        let formats = description.frames.0.iter().enumerate();
        let mut formats = formats.filter(|(index, _)| sent.looks_for(*index));
        let has_checksum = formats.any(|(_, framing)| !framing.checks.is_empty());
        let schema = self.schema;
        for (name, spec) in &schema.faults {
            if spec.bad_checksum && !has_checksum {
                let message = "has no effect: the frames of the device have no checksum, expected \
                    \"checksum\" in [frame], or another fault";
                self.wrong(format!("faults.{name}.bad_checksum"), message);
            }
            if spec.garbage.is_some() && !spec.restart {
                let message =
                    "has no effect without a restart, expected restart = true in this fault";
                self.wrong(format!("faults.{name}.garbage"), message);
            }
        }
    }
}
