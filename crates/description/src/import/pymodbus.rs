//! The JSON of pymodbus' simulator: one memory in four blocks, with types and values.
//!
//! ```text
//! | coils | discrete | input | holding |    "shared blocks": false
//! | all of them                        |    "shared blocks": true
//! ```

use serde_json::{Map as Object, Value};

use super::{Map, Row, TABLES};

/// The sections with values: name, type, registers of one value.
const SECTIONS: [(&str, &str, u32); 6] = [
    ("bits", "bits", 1),
    ("uint16", "u16", 1),
    ("uint32", "u32", 2),
    ("float32", "f32", 2),
    ("float64", "f64", 4),
    ("string", "str", 0),
];
/// Maximum number of registers of a block.
const BLOCK_MAX: u64 = 65_536;

/// The layout of the blocks.
struct Layout {
    is_shared: bool,
    /// The ends of the blocks in order of [`TABLES`].
    ends: [u32; 4],
}

/// Reads the simulator's JSON, or one device of it.
pub(super) fn read(text: &str) -> Result<Map, String> {
    let whole: Value = serde_json::from_str(text).map_err(|error| {
        let line = error.line();
        let message = error.to_string();
        let message = message.split(" at line").next().unwrap_or_default();
        format!("line {line}: {message}, expected JSON")
    })?;
    let mut map = Map::default();
    let device = match whole.get("device_list").and_then(Value::as_object) {
        None => &whole,
        Some(devices) => {
            let mut devices = devices.iter();
            let (name, first) = devices
                .next()
                .ok_or_else(|| "device_list: is empty, expected a device".to_owned())?;
            for (other, _) in devices {
                map.left_out
                    .push(format!("the device \"{other}\"; this is \"{name}\""));
            }
            first
        }
    };
    let layout = layout(device)?;
    if layout.is_shared {
        map.left_out.push(
            "the blocks of the simulator are shared; all registers are holding registers here"
                .to_owned(),
        );
    }
    map.line = line_of(&whole);
    let writable = ranges(device, "write")?;
    for (section, kind, size) in SECTIONS {
        let Some(entries) = device.get(section) else {
            continue;
        };
        let entries = entries
            .as_array()
            .ok_or_else(|| format!("{section}: is no list, expected one of registers"))?;
        for (index, entry) in entries.iter().enumerate() {
            let at = format!("{section}[{index}]");
            let [first, last] = range(entry.get("addr").unwrap_or(entry))
                .ok_or_else(|| format!("{at}.addr: expected a number, or [FIRST, LAST]"))?;
            let value = entry
                .get("value")
                .or_else(|| default(device, "value", section));
            let value = value.ok_or_else(|| {
                format!(
                    "{at}.value: is missing, expected it here or in setup.defaults.value.{section}"
                )
            })?;
            let action = entry
                .get("action")
                .or_else(|| default(device, "action", section));
            if let Some(action) = action.and_then(Value::as_str) {
                map.left_out.push(format!(
                    "the action \"{action}\" of {at}: a source of the register"
                ));
            }
            let step = if size == 0 { last - first + 1 } else { size };
            if !(last - first + 1).is_multiple_of(step) {
                return Err(format!(
                    "{at}.addr: has {} registers, expected {step} for each value",
                    last - first + 1
                ));
            }
            let mut place = first;
            while place <= last {
                let one = Entry {
                    place,
                    step,
                    kind,
                    value,
                };
                one.rows(&layout, &writable, &mut map.rows)
                    .map_err(|error| format!("{at}.addr: {error}"))?;
                place += step;
            }
        }
    }
    if device
        .get("repeat")
        .and_then(Value::as_array)
        .is_some_and(|list| !list.is_empty())
    {
        map.left_out.push("the section \"repeat\"".to_owned());
    }
    Ok(map)
}

/// The value or action of entries without one.
fn default<'a>(device: &'a Value, key: &str, section: &str) -> Option<&'a Value> {
    let defaults = device.get("setup")?.get("defaults")?;
    defaults
        .get(key)?
        .get(section)
        .filter(|value| !value.is_null())
}

struct Entry<'a> {
    place: u32,
    step: u32,
    kind: &'static str,
    value: &'a Value,
}

impl Entry<'_> {
    /// The registers of one value: 16 coils for each register of a block of bits.
    fn rows(
        &self,
        layout: &Layout,
        writable: &[[u32; 2]],
        rows: &mut Vec<Row>,
    ) -> Result<(), String> {
        let (table, at) = layout.find(self.place, self.step)?;
        let is_writable = writable
            .iter()
            .any(|[first, last]| (*first..=*last).contains(&self.place));
        let name = |at: u32| format!("{}_{at}", TABLES[table]);
        if table < 2 {
            let value = match self.value {
                Value::Bool(value) => u64::from(*value),
                value => value.as_u64().ok_or_else(|| {
                    format!("is {value} for bits, expected a value from 0 to 65535")
                })?,
            };
            rows.extend((0..16).map(|bit| Row {
                table,
                at: 16 * at + bit,
                name: name(16 * at + bit),
                kind: "u16".to_owned(),
                is_writable: Some(is_writable),
                initial: (value >> bit & 1 == 1).then(|| "true".to_owned()),
                ..Row::default()
            }));
            return Ok(());
        }
        let is_text = self.kind == "str";
        let initial = match self.value {
            // The simulator fills a text with spaces.
            Value::String(text) if is_text => {
                let size = usize::try_from(2 * self.step).unwrap_or(usize::MAX);
                toml::Value::String(format!("{text:size$}")).to_string()
            }
            Value::String(text) => toml::Value::String(text.clone()).to_string(),
            Value::Bool(value) => u8::from(*value).to_string(),
            other => other.to_string(),
        };
        rows.push(Row {
            table,
            at,
            name: name(at),
            kind: match self.kind {
                "bits" => "u16".to_owned(),
                kind => kind.to_owned(),
            },
            size: match is_text {
                true => u16::try_from(2 * self.step).ok(),
                false => None,
            },
            is_writable: Some(is_writable),
            initial: Some(initial).filter(|value| value != "0" && value != "0.0"),
            ..Row::default()
        });
        Ok(())
    }
}

impl Layout {
    /// The table and the address of `count` registers of the memory.
    fn find(&self, place: u32, count: u32) -> Result<(usize, u32), String> {
        if self.is_shared {
            return Ok((3, place));
        }
        let mut from = 0;
        for (table, end) in self.ends.iter().enumerate() {
            if place < *end {
                return match place + count <= *end {
                    true => Ok((table, place - from)),
                    false => Err(format!("ends behind the block of {}", TABLES[table])),
                };
            }
            from = *end;
        }
        Err(format!(
            "is {place}, expected less than {from}, the sum of the sizes in \"setup\""
        ))
    }
}

fn layout(device: &Value) -> Result<Layout, String> {
    let setup = device.get("setup").and_then(Value::as_object);
    let setup = setup.ok_or_else(|| {
        "has no \"setup\", expected the JSON of pymodbus' simulator or a CSV file".to_owned()
    })?;
    let size = |key: &str| {
        let size = setup.get(key).and_then(Value::as_u64);
        let size = size
            .filter(|size| *size <= BLOCK_MAX)
            .and_then(|size| u32::try_from(size).ok());
        size.ok_or_else(|| format!("setup.{key}: expected a number of registers up to 65536"))
    };
    let is_shared = setup
        .get("shared blocks")
        .and_then(Value::as_bool)
        .unwrap_or(false);
    let mut ends = [0; 4];
    let mut end = 0;
    for (slot, key) in ends
        .iter_mut()
        .zip(["co size", "di size", "ir size", "hr size"])
    {
        end += size(key)?;
        *slot = end;
    }
    Ok(Layout { is_shared, ends })
}

/// One address, or the first and the last.
fn range(addr: &Value) -> Option<[u32; 2]> {
    let number = |value: &Value| value.as_u64().and_then(|at| u32::try_from(at).ok());
    let all = match addr {
        Value::Array(pair) => match &pair[..] {
            [first, last] => [number(first)?, number(last)?],
            _ => return None,
        },
        one => [number(one)?; 2],
    };
    (all[0] <= all[1] && all[1] < 4 * 65_536).then_some(all)
}

fn ranges(device: &Value, key: &str) -> Result<Vec<[u32; 2]>, String> {
    let all = device.get(key).and_then(Value::as_array);
    let ranges = all.into_iter().flatten().enumerate();
    let ranges = ranges.map(|(index, one)| {
        range(one).ok_or_else(|| format!("{key}[{index}]: expected a number, or [FIRST, LAST]"))
    });
    ranges.collect()
}

/// Baud rate and format of the first serial server.
fn line_of(whole: &Value) -> Vec<(&'static str, String)> {
    let servers = whole.get("server_list").and_then(Value::as_object);
    let is_serial = |server: &&Object<String, Value>| server.contains_key("baudrate");
    let server = servers.and_then(|all| all.values().filter_map(Value::as_object).find(is_serial));
    let Some(server) = server else {
        return Vec::new();
    };
    let number = |key: &str| server.get(key).and_then(Value::as_u64);
    let mut line = Vec::new();
    if let Some(baud) = number("baudrate").filter(|baud| (300..=4_000_000).contains(baud)) {
        line.push(("baud", baud.to_string()));
    }
    let parity = server.get("parity").and_then(Value::as_str).unwrap_or("N");
    let bits = number("bytesize").unwrap_or(8);
    let stop = number("stopbits").unwrap_or(1);
    line.push(("format", format!("{bits}{parity}{stop}")));
    line
}
