//! Probes: each request with usual values and with values at and beyond limits, damaged and unknown
//! frames, other addresses.

use core::time::Duration;

use crate::behaviour::Trigger;
use crate::description::Description;
use crate::field::{self, Field};
use crate::message::Message;
use crate::registers::{Cell, CellKind};
use crate::schema::message::From;
use crate::speak::{self, Asks, Request};
use crate::value::{Record, Value};

/// A request that is sent to the device.
#[derive(Clone, Debug)]
pub(super) struct Probe {
    /// The name of the request, for reports.
    pub(super) place: String,
    pub(super) bytes: Vec<u8>,
    pub(super) asks: Option<Asks>,
    /// Whether the request may change the device's state.
    pub(super) changes: bool,
    /// Listening time, if not the time of a reply.
    pub(super) listen: Option<Duration>,
    /// Index in the table of the register whose bytes the reply holds.
    pub(super) cell: Option<usize>,
    /// Whether a missing reply is allowed.
    pub(super) is_strange: bool,
    /// Whether the request shows the state that the commands before it left.
    pub(super) is_again: bool,
}

/// Repetitions of each plain request: latencies and measured values need several samples.
const REPEATS: usize = 4;
/// Number of examples of each message.
const EXAMPLES: usize = 3;
/// Maximum listening time.
const LISTEN_MAX: Duration = Duration::from_secs(10);

pub(super) fn of(description: &Description) -> Vec<Probe> {
    let mut probes = Vec::new();
    probes.extend(listening(description, "unsolicited messages"));
    if description.protocol.is_some() {
        modbus(description, &mut probes);
    } else {
        messages(description, &mut probes);
        again(&mut probes);
    }
    damaged(description, &mut probes);
    probes
}

/// A probe that listens to unsolicited messages, if the device sends any.
fn listening(of: &Description, place: &str) -> Option<Probe> {
    let longest = of.every.iter().map(|every| every.period).max()?;
    Some(Probe {
        place: place.to_owned(),
        listen: Some((4 * longest).min(LISTEN_MAX)),
        ..Probe::unasked()
    })
}

impl Probe {
    fn of(place: impl Into<String>, request: Request, changes: bool) -> Self {
        Self {
            place: place.into(),
            bytes: request.bytes,
            asks: Some(request.asks),
            changes,
            listen: None,
            cell: None,
            is_strange: false,
            is_again: false,
        }
    }

    /// A probe that no frame answers.
    pub(super) const fn unasked() -> Self {
        Self {
            place: String::new(),
            bytes: Vec::new(),
            asks: None,
            changes: false,
            listen: None,
            cell: None,
            is_strange: true,
            is_again: false,
        }
    }

    /// The same probe with another time to listen.
    pub(super) fn lasting(&self, time: Duration) -> Self {
        Self {
            listen: Some(time),
            ..self.clone()
        }
    }

    /// The name of a message, with the command before it if there is one.
    pub(super) fn named(&self, message: &str) -> String {
        match self.changes {
            true => format!("{message} after {}", self.place),
            false => message.to_owned(),
        }
    }

    /// Allows the reply to be missing.
    fn strange(self) -> Self {
        Self {
            is_strange: true,
            ..self
        }
    }
}

/// A small generator with a fixed seed: each run sends the same probes.
fn dice(seed: u64) -> impl FnMut(u64) -> u64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move |below| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % below.max(1)
    }
}

fn messages(of: &Description, probes: &mut Vec<Probe>) {
    for (index, message) in of.messages.iter().enumerate() {
        if message.from == From::Device {
            continue;
        }
        let changes = changes(of, index);
        let mut dice = dice(index as u64 + 1);
        let mut examples: Vec<Record> = Vec::new();
        let mut strange = Vec::new();
        for example in 0..EXAMPLES {
            let mut plain = message.example(&mut dice);
            if example == 0 {
                within_state(of, message, &mut plain);
            }
            let answered = of.answered(message, &plain);
            for example in answered {
                if !examples.contains(&example) {
                    examples.push(example);
                }
            }
            // For example a request for another address.
            if !examples.contains(&plain) {
                strange.push(plain);
            }
        }
        let first = examples.first().cloned();
        let repeats = first.iter().cycle().take(REPEATS - 1).cloned();
        for values in examples.iter().cloned().chain(repeats) {
            if let Ok(request) = of.request(message, &values) {
                probes.push(Probe::of(message.name(), request, changes));
            }
        }
        if changes && !examples.is_empty() {
            let listening = listening(of, message.name());
            probes.extend(listening.map(|probe| Probe { changes, ..probe }));
        }
        for values in strange.iter().take(1) {
            if let Ok(request) = of.request(message, values) {
                let place = format!("{} with other values", message.name());
                probes.push(Probe::of(place, request, changes).strange());
            }
        }
        table(of, message, first.as_ref(), probes);
        for values in first.iter().flat_map(|values| beyond(message, values)) {
            if let Ok(request) = of.request(message, &values.1) {
                let place = format!("{} with {} beyond its limits", message.name(), values.0);
                probes.push(Probe::of(place, request, true).strange());
            }
        }
    }
}

/// Sets each field that has the name of a variable to the middle of the variable's limits: a
/// command with random values would only be refused.
fn within_state(of: &Description, message: &Message, values: &mut Record) {
    let names: Vec<_> = values.0.iter().map(|(name, _)| name.clone()).collect();
    for name in names {
        let field = field::find(message.fields(), &name);
        let is_free = field.is_some_and(|field| field.limits.is_none() && field.constant.is_none());
        let variable = of.variables.iter().find(|one| *one.name == *name);
        if let Some([least, most]) = variable.and_then(|one| one.limits).filter(|_| is_free) {
            let step = field.map_or(1.0, step);
            let middle = ((least + most) / 2.0 / step).round() * step;
            values.set(&name, Value::Float(middle));
        }
    }
}

/// Each request that changes nothing, once more: the replies show the state after the commands.
fn again(probes: &mut Vec<Probe>) {
    if !probes.iter().any(|probe| probe.changes) {
        return;
    }
    let mut again: Vec<Probe> = Vec::new();
    for probe in probes.iter() {
        let is_query = probe.asks.is_some() && !probe.changes && !probe.is_strange;
        if is_query && again.iter().all(|other| other.place != probe.place) {
            again.push(Probe {
                changes: true,
                is_again: true,
                ..probe.clone()
            });
        }
    }
    probes.extend(again);
}

/// Requests for each register of a table that messages read and write, and for an address behind
/// its end.
fn table(of: &Description, message: &Message, like: Option<&Record>, probes: &mut Vec<Probe>) {
    let (Some(like), Some(registers)) = (like, &of.registers) else {
        return;
    };
    let cells = &registers.bytes.cells;
    let requests = of.register_requests(message);
    let with = |changed: &Record| {
        let mut values = like.clone();
        for (name, value) in &changed.0 {
            values.set(name, value.clone());
        }
        values
    };
    for request in &requests {
        let cell = &cells[request.cell];
        let name = &of.variables[cell.variable].name;
        let mut probe = |values: &Record, place: String, changes: bool| {
            if let Ok(request_of) = of.request(message, values) {
                probes.push(Probe {
                    cell: (!changes).then_some(request.cell),
                    ..Probe::of(place, request_of, changes)
                });
            }
        };
        match &request.data {
            None => {
                let values = with(&request.values);
                (0..2).for_each(|_| probe(&values, format!("read {name}"), false));
            }
            Some(data) => {
                let mut write = |value: Value, place: String| {
                    let mut values = with(&request.values);
                    values.set(data, Value::Bytes(cell.bytes(&value)));
                    probe(&values, place, true);
                };
                write(value_of(cell, 0.5), format!("write {name}"));
                for value in cell
                    .limits
                    .into_iter()
                    .flat_map(|limits| outside(cell, limits))
                {
                    write(value, format!("write {name} beyond its limits"));
                }
                let initial = of.variables[cell.variable].initial.clone();
                write(initial, format!("write {name}"));
            }
        }
    }
    let end = cells.last().map(|cell| cell.at + cell.len);
    if let (Some(end), Some(last)) = (end, requests.last())
        && last.data.is_none()
    {
        let mut values = with(&last.values);
        if let Some((name, _)) = last.values.0.first() {
            values.set(name, Value::Int(end.into()));
        }
        if let Ok(request) = of.request(message, &values) {
            let place = format!("{} {end}, behind the last register", message.name());
            probes.push(Probe::of(place, request, false).strange());
        }
    }
}

/// The nearest values beyond limits that the register's bytes can hold.
fn outside(cell: &Cell, [least, most]: [f64; 2]) -> Vec<Value> {
    let step = cell.scale.map_or(1.0, |[scale, _]| scale.abs());
    let values = [least - step, most + step].map(Value::Float);
    let holds = |value: &Value| cell.value(&cell.bytes(value)).as_f64() == value.as_f64();
    values.into_iter().filter(holds).collect()
}

/// Whether a message changes the device's state.
pub(super) fn changes(of: &Description, message: usize) -> bool {
    let fits =
        |trigger: Trigger| trigger == Trigger::Message(message) || trigger == Trigger::AnyMessage;
    let on = of
        .on
        .iter()
        .filter(|on| fits(on.trigger))
        .any(|on| !on.deed.set.is_empty() || on.write.is_some() || on.restarts);
    on || of
        .after
        .iter()
        .any(|after| fits(after.trigger) && !after.deed.set.is_empty())
}

/// Records in which one value is beyond the limits of its field, with the name of the field.
fn beyond(message: &Message, values: &Record) -> Vec<(String, Record)> {
    let mut all = Vec::new();
    for (name, _) in &values.0 {
        let Some(field) = field::find(message.fields(), name) else {
            continue;
        };
        let Some([least, most]) = field.limits else {
            continue;
        };
        let step = step(field);
        for value in [least - step, most + step] {
            let mut other = values.clone();
            other.set(name, Value::Float(value));
            all.push((name.to_string(), other));
        }
    }
    all
}

/// The smallest difference between two values of a field.
fn step(field: &Field) -> f64 {
    field.scale.map_or(1.0, |[scale, _]| scale.abs())
}

fn modbus(of: &Description, probes: &mut Vec<Probe>) {
    for (name, function, table) in speak::tables(of) {
        for cell in &table.cells {
            let variable = &of.variables[cell.variable];
            let [at, count] =
                [cell.at, cell.len].map(|value| u16::try_from(value).unwrap_or(u16::MAX));
            let place = format!("read {}", variable.name);
            let read = || Probe::of(&place, speak::read(of, function, at, count), false);
            probes.extend((0..REPEATS).map(|_| read()));
            let mut write = |value: Value, place: String| {
                let request = speak::write(of, function, cell, &value);
                probes.push(Probe::of(place, request, true));
                probes.push(Probe {
                    changes: true,
                    ..read()
                });
            };
            if !cell.is_writable {
                if function == 3 {
                    write(value_of(cell, 0.5), format!("write {}", variable.name));
                }
                continue;
            }
            for share in [0.0, 1.0, 0.5] {
                write(value_of(cell, share), format!("write {}", variable.name));
            }
            if let Some([least, most]) = cell.limits {
                let step = cell.scale.map_or(1.0, |[scale, _]| scale.abs());
                for value in [least - step, most + step] {
                    let place = format!("write {} beyond its limits", variable.name);
                    write(Value::Float(value), place);
                }
            }
            // Restore the initial value.
            write(variable.initial.clone(), format!("write {}", variable.name));
        }
        let end = table.cells.last().map_or(0, |cell| cell.at + cell.len);
        if let Ok(end) = u16::try_from(end) {
            let place = format!("read {name} {end}, behind the last one");
            probes.push(Probe::of(place, speak::read(of, function, end, 1), false));
        }
        let place = format!("read {name} with a count of 0");
        probes.push(Probe::of(place, speak::read(of, function, 0, 0), false));
    }
    // A vendor's own function may have an effect.
    let unknown = speak::raw(of, &[0x41], String::new(), None);
    probes.push(Probe::of("function 65", unknown, true));
}

/// A value within the limits of a register.
fn value_of(cell: &Cell, share: f64) -> Value {
    match (cell.kind, cell.limits) {
        (CellKind::Text(len), _) => Value::Text("x".repeat(len.min(4))),
        (CellKind::Bit, _) => Value::Bool(share > 0.4),
        (CellKind::Number(_), Some([least, most])) => {
            let value = least + (most - least) * share;
            Value::Float(match cell.scale {
                // Round to a whole count.
                Some([scale, offset]) => ((value - offset) / scale).round() * scale + offset,
                None => value.round(),
            })
        }
        (CellKind::Number(number), None) => {
            let bits = u64::from(number.bytes).min(2) * 7;
            let [scale, offset] = cell.scale.unwrap_or([1.0, 0.0]);
            #[expect(clippy::cast_precision_loss, reason = "14 bits")]
            let most = (1_u64 << bits) as f64;
            Value::Float((most * share).round() * scale + offset)
        }
    }
}

/// Frames that a correct driver never sends, each before a request. Without the option for writes
/// they are left out if a device could take a part of them, with the request behind it, for a
/// request with an effect.
fn damaged(of: &Description, probes: &mut Vec<Probe>) {
    let is_plain = |probe: &&Probe| probe.listen.is_none() && !probe.changes;
    let plain = || probes.iter().filter(is_plain);
    let is_harmless = |request: &[u8]| {
        let damages = damages(of, request);
        damages
            .iter()
            .all(|(_, bytes)| of.is_harmless_before(bytes, request))
    };
    // Not every request has bytes that are harmless in part.
    let harmless = plain().find(|probe| is_harmless(&probe.bytes));
    let Some(sound) = harmless.or_else(|| plain().next()).cloned() else {
        return;
    };
    for (place, bytes) in damages(of, &sound.bytes) {
        let changes = !of.is_harmless_before(&bytes, &sound.bytes);
        probes.push(Probe {
            place: place.to_owned(),
            bytes,
            changes,
            ..Probe::unasked()
        });
    }
    // The device must still answer afterwards.
    probes.push(Probe {
        place: "a request after a damaged frame".to_owned(),
        ..sound.strange()
    });
}

/// A request with a wrong checksum, and a part of it.
fn damages(of: &Description, request: &[u8]) -> Vec<(&'static str, Vec<u8>)> {
    let mut spoiled = request.to_vec();
    of.frames.spoil(0, &mut spoiled);
    let mut all = Vec::new();
    if spoiled != request {
        all.push(("a frame with a wrong checksum", spoiled));
    }
    if request.len() > 2 {
        all.push(("half a frame", request[..request.len() / 2].to_vec()));
    }
    all
}
