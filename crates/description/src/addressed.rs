//! Requests that a device answers: field values that its entries test, such as the address, and the
//! registers that a request can name.

use crate::behaviour::{On, Trigger};
use crate::description::Description;
use crate::expr::Scope;
use crate::message::Message;
use crate::registers::Cell;
use crate::value::{Record, Value};

/// A request for one register of a table that messages read and write.
#[derive(Clone, Debug)]
pub(crate) struct RegisterRequest {
    /// The register, by its index in the table.
    pub(crate) cell: usize,
    /// Values of the fields that name the register.
    pub(crate) values: Record,
    /// The field that holds the bytes to be written; `None` if the request reads.
    pub(crate) data: Option<String>,
}

/// The state of a device at its start.
struct AtStart<'a>(&'a Description);

impl Scope for AtStart<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        if name == "own_address" {
            return Some(Value::Int(self.0.address.unwrap_or(1).into()));
        }
        let variables = self.0.variables.iter();
        let known = variables
            .into_iter()
            .find(|variable| *variable.name == *name);
        known.map(|variable| variable.initial.clone())
    }
}

/// The values of a request, then the state of the device.
struct Asked<'a>(&'a Record, AtStart<'a>);

impl Scope for Asked<'_> {
    fn value(&self, name: &str) -> Option<Value> {
        let own = self.0.get(name.strip_prefix("request.").unwrap_or(name));
        own.cloned().or_else(|| self.1.value(name))
    }
}

/// The field of requests that holds the address of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct AddressField {
    name: String,
    /// Other values that entries test, e.g. that of a broadcast.
    special: Vec<i128>,
}

impl AddressField {
    /// The address that a request asks for; `None` if it asks for none, or for all devices.
    pub(crate) fn asked(&self, request: &Record) -> Option<i128> {
        let asked = request.get(&self.name)?.as_int()?;
        (!self.special.contains(&asked)).then_some(asked)
    }
}

/// An address that no description tests by its number.
const OF_ITS_OWN: i128 = 1 << 100;

/// A device of which only the address is known.
struct OnlyAddress;

impl Scope for OnlyAddress {
    fn value(&self, name: &str) -> Option<Value> {
        (name == "own_address").then_some(Value::Int(OF_ITS_OWN))
    }
}

/// Maximum number of request values that are tried.
const TRIALS_MAX: usize = 2_000;

impl Description {
    /// Values of `message` that the device answers in its start state, derived from `plain`: one
    /// record for each entry with a reply, e.g. with the device's address. Returns `plain` if no
    /// entry replies.
    pub fn answered(&self, message: &Message, plain: &Record) -> Vec<Record> {
        let mut like = plain.clone();
        if let Some(request) = self.register_requests(message).first() {
            for (name, value) in &request.values.0 {
                like.set(name, value.clone());
            }
        }
        let entries: Vec<&On> = self.entries(message).collect();
        let trials = self.trials(message, &entries, &like);
        let first = |values: &Record| {
            let scope = Asked(values, AtStart(self));
            entries.iter().position(|on| {
                let when = on.deed.when.as_ref();
                when.is_none_or(|when| when.eval(&scope).is_ok_and(|value| value.is_true()))
            })
        };
        let replies = entries.iter().enumerate();
        let replies = replies.filter(|(_, on)| !on.deed.send.is_empty());
        let mut found: Vec<Record> = Vec::new();
        for (index, _) in replies {
            let fitting = trials.iter().find(|values| first(values) == Some(index));
            found.extend(fitting.filter(|values| !found.contains(values)).cloned());
        }
        if found.is_empty() {
            found.push(like);
        }
        found
    }

    /// The field that the entries compare with `own_address`; `None` without such an entry.
    pub(crate) fn address_field(&self) -> Option<AddressField> {
        let whens = self.on.iter().filter_map(|on| on.deed.when.as_ref());
        let compared: Vec<(String, i128)> = whens
            .flat_map(|when| when.compared(&OnlyAddress))
            .filter_map(|(name, value)| Some((name, value.as_int()?)))
            .collect();
        let own = compared.iter().find(|(_, value)| *value == OF_ITS_OWN)?;
        let same = compared.iter().filter(|(name, _)| *name == own.0);
        let values = same.map(|(_, value)| *value);
        Some(AddressField {
            name: own.0.clone(),
            special: values.filter(|value| *value != OF_ITS_OWN).collect(),
        })
    }

    /// Returns `like` and its variants with the values that the conditions of `entries` test.
    fn trials(&self, message: &Message, entries: &[&On], like: &Record) -> Vec<Record> {
        let names = message.names();
        let mut trials = vec![like.clone()];
        let whens = entries.iter().filter_map(|on| on.deed.when.as_ref());
        let compared = whens.flat_map(|when| when.compared(&AtStart(self)));
        let compared = compared.map(|(name, value)| {
            let plain = name.strip_prefix("request.").map(str::to_owned);
            (plain.unwrap_or(name), value)
        });
        let mut fields: Vec<(String, Vec<Value>)> = Vec::new();
        for (name, value) in compared.filter(|(name, _)| names.contains(&name.as_str())) {
            let index = fields.iter().position(|(known, _)| *known == name);
            let index = index.unwrap_or_else(|| {
                fields.push((name, Vec::new()));
                fields.len() - 1
            });
            let near = match value.as_int() {
                Some(int) => vec![Value::Int(int), Value::Int(int - 1), Value::Int(int + 1)],
                None => vec![value],
            };
            for value in near {
                if !fields[index].1.contains(&value) {
                    fields[index].1.push(value);
                }
            }
        }
        for (name, values) in fields {
            let before = trials.clone();
            for value in values {
                if trials.len() > TRIALS_MAX {
                    return trials;
                }
                trials.extend(before.iter().map(|trial| {
                    let mut trial = trial.clone();
                    trial.set(&name, value.clone());
                    trial
                }));
            }
        }
        trials
    }

    /// The entries for a message.
    fn entries<'a>(&'a self, message: &'a Message) -> impl Iterator<Item = &'a On> {
        let index = self
            .messages
            .iter()
            .position(|other| other.name == message.name);
        let entries = self.on.iter();
        entries.filter(move |on| match on.trigger {
            Trigger::Message(of) => Some(of) == index,
            Trigger::AnyMessage => true,
            Trigger::Event(_) => false,
        })
    }

    /// The requests of `message` that name one register each.
    pub(crate) fn register_requests(&self, message: &Message) -> Vec<RegisterRequest> {
        let Some(registers) = &self.registers else {
            return Vec::new();
        };
        let names = message.names();
        let is_field = |name: &str| names.contains(&name);
        let read = self.entries(message).find_map(|on| {
            let with = on.deed.with.iter();
            with.filter_map(|(_, expr)| expr.registers_read())
                .find(|(at, count)| is_field(at) && is_field(count))
        });
        let write = self.entries(message).find_map(|on| {
            let (at, data) = on.write.as_ref()?;
            let names = (at.name()?, data.name()?);
            (is_field(names.0) && is_field(names.1)).then_some(names)
        });
        let cells = registers.bytes.cells.iter().enumerate();
        let request = |(index, cell): (usize, &Cell)| {
            let at = Value::Int(cell.at.into());
            let mut values = Record::default();
            match (read, write) {
                (Some((first, count)), _) => {
                    values.set(first, at);
                    values.set(count, Value::Int(cell.len.into()));
                }
                (None, Some((first, _))) => values.set(first, at),
                (None, None) => return None,
            }
            let data = read
                .map_or(write, |_| None)
                .map(|(_, data)| data.to_owned());
            Some(RegisterRequest {
                cell: index,
                values,
                data,
            })
        };
        cells.filter_map(request).collect()
    }
}
