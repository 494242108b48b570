//! The names that expressions and messages of a device read.

use std::borrow::Cow;

use super::Described;
use crate::expr::Scope;
use crate::state::Reading;
use crate::value::{Record, Value};

/// The scope of behaviour expressions: fields of a request, then the state.
pub(super) struct Seen<'a> {
    pub(super) request: &'a Record,
    pub(super) reading: Reading<'a>,
    pub(super) device: &'a Described,
}

impl Scope for Seen<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        if let Some(name) = name.strip_prefix("request.") {
            return self.request.get(name).cloned();
        }
        if let Some(value) = self.request.get(name) {
            return Some(value.clone());
        }
        match name {
            "own_address" => Some(Value::Int(self.device.address().into())),
            name => self.reading.value(name),
        }
    }

    fn find(&self, name: &str) -> Option<Cow<'_, Value>> {
        let plain = name.strip_prefix("request.");
        let asked = self.request.get(plain.unwrap_or(name));
        match (asked, plain, name) {
            (Some(value), ..) => Some(Cow::Borrowed(value)),
            (None, Some(_), _) => None,
            (None, None, "own_address") => self.value(name).map(Cow::Owned),
            (None, None, name) => self.reading.find(name),
        }
    }

    fn registers(&self, address: i128, count: i128) -> Option<Vec<u8>> {
        let registers = self.device.description.registers.as_ref()?;
        let (at, count) = (u32::try_from(address).ok()?, u32::try_from(count).ok()?);
        let Reading { state, now, world } = self.reading;
        let values = |index: usize| state.look(index, now, world);
        let cut = &mut Vec::new();
        let bytes = registers.bytes.read(at, count.min(4_096), &values, cut);
        bytes.ok()
    }
}

/// The scope that fills a message: explicit values, then the state, then the request.
pub(super) struct Filled<'a> {
    pub(super) given: Record,
    pub(super) seen: Seen<'a>,
}

impl Scope for Filled<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        let given = self.given.get(name).cloned();
        given
            .or_else(|| self.seen.reading.value(name))
            .or_else(|| self.seen.value(name))
    }

    fn find(&self, name: &str) -> Option<Cow<'_, Value>> {
        match self.given.get(name) {
            Some(value) => Some(Cow::Borrowed(value)),
            None => {
                let state = self.seen.reading.find(name);
                state.or_else(|| self.seen.find(name))
            }
        }
    }

    fn registers(&self, address: i128, count: i128) -> Option<Vec<u8>> {
        self.seen.registers(address, count)
    }
}
