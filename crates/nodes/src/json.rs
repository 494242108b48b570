//! Messages in readable form: one JSON object per line, bytes as hexadecimal text.

use protocols::{Instant, LineEvent};
use serde_json::{Map, Value, json};

use crate::message::{Answer, Input, Item, LINE_EVENTS, Note, Output, Reply, Request};
use crate::spec::{format_of, line_of};

/// Writes a request as one line.
pub fn write_request(to: &mut Vec<u8>, request: &Request) {
    let value = match request {
        Request::Hello(hello) => json!({ "hello": hello }),
        Request::Exchange { now, items } => {
            let items: Vec<Value> = items.iter().map(input).collect();
            json!({ "exchange": { "now": now.as_nanos(), "items": items } })
        }
        Request::Save => json!({ "save": true }),
        Request::Load(state) => json!({ "load": hex(state) }),
        Request::End => json!({ "end": true }),
    };
    line(to, &value);
}

/// Writes an answer as one line.
pub fn write_answer(to: &mut Vec<u8>, answer: &Answer) {
    let value = match answer {
        Answer::Hello(hello) => json!({ "hello": hello }),
        Answer::Exchange(reply) => {
            let items: Vec<Value> = reply.items.iter().map(output).collect();
            let next = reply.next.map(Instant::as_nanos);
            json!({ "exchange": { "next": next, "items": items } })
        }
        Answer::Saved(state) => json!({ "saved": hex(state) }),
        Answer::Loaded => json!({ "loaded": true }),
    };
    line(to, &value);
}

fn line(to: &mut Vec<u8>, value: &Value) {
    to.extend_from_slice(value.to_string().as_bytes());
    to.push(b'\n');
}

fn input(item: &Item<Input>) -> Value {
    let (port, time) = (item.port, item.at.as_nanos());
    match &item.what {
        Input::Bytes(bytes) => json!({ "bytes": hex(bytes), "port": port, "time": time }),
        Input::Line(event) => json!({ "line": name_of(*event), "port": port, "time": time }),
        Input::Fault {
            name,
            begins,
            figure,
        } => json!({ "fault": name, "begins": begins, "figure": figure, "time": time }),
        Input::Quantity(value) => json!({ "quantity": port, "value": value, "time": time }),
        Input::Message(message) => json!({ "message": message, "port": port, "time": time }),
    }
}

fn output(item: &Item<Output>) -> Value {
    let (port, time) = (item.port, item.at.as_nanos());
    match &item.what {
        Output::Bytes(bytes) => json!({ "bytes": hex(bytes), "port": port, "time": time }),
        Output::Line(event) => json!({ "line": name_of(*event), "port": port, "time": time }),
        Output::Coding(line) => json!({
            "rate": line.baud, "format": format_of(*line), "port": port, "time": time,
        }),
        Output::Note(note) => {
            let kind = match note.is_violation {
                true => "violation",
                false => "note",
            };
            json!({ kind: note.rule, "detail": note.detail, "bytes": hex(&note.bytes), "time": time })
        }
        Output::Quantity(value) => json!({ "quantity": port, "value": value, "time": time }),
        Output::Message(message) => json!({ "message": message, "port": port, "time": time }),
    }
}

/// The line at the beginning of `bytes`, and its length with the line end; `None` if it is
/// incomplete.
///
/// # Errors
/// If the line is too long.
pub fn split(bytes: &[u8]) -> Result<Option<(&[u8], usize)>, String> {
    match bytes.iter().position(|byte| *byte == b'\n') {
        Some(end) => Ok(Some((&bytes[..end], end + 1))),
        None if bytes.len() > crate::binary::MESSAGE_MAX => {
            Err("it has no line end, expected one JSON object a line".to_owned())
        }
        None => Ok(None),
    }
}

fn object(text: &[u8]) -> Result<(String, Value), String> {
    let shown = || String::from_utf8_lossy(&text[..text.len().min(40)]).into_owned();
    let map: Map<String, Value> = serde_json::from_slice(text)
        .map_err(|error| format!("{:?} is not a JSON object: {error}", shown()))?;
    let mut entries = map.into_iter();
    match (entries.next(), entries.next()) {
        (Some(only), None) => Ok(only),
        _ => Err(format!("{:?} has not exactly one key", shown())),
    }
}

/// Parses an answer.
///
/// # Errors
/// A description of the error.
pub fn read_answer(text: &[u8]) -> Result<Answer, String> {
    let (key, value) = object(text)?;
    match key.as_str() {
        "hello" => Ok(Answer::Hello(value)),
        "exchange" => {
            only(&value, &["next", "items"])?;
            let next = &value["next"];
            let next = match next.as_u64() {
                None if next.is_null() => None,
                None => return Err("\"next\" is no time, expected nanoseconds or null".to_owned()),
                next => next.filter(|next| *next != u64::MAX),
            };
            Ok(Answer::Exchange(Reply {
                next: next.map(Instant::from_nanos),
                items: items(&value, read_output)?,
            }))
        }
        "saved" => Ok(Answer::Saved(bytes(&value)?)),
        "loaded" => Ok(Answer::Loaded),
        other => Err(format!(
            "its key is \"{other}\", expected hello, exchange, saved or loaded"
        )),
    }
}

/// Parses a request.
///
/// # Errors
/// A description of the error.
pub fn read_request(text: &[u8]) -> Result<Request, String> {
    let (key, value) = object(text)?;
    match key.as_str() {
        "hello" => serde_json::from_value(value)
            .map(Request::Hello)
            .map_err(|error| format!("the greeting cannot be read: {error}")),
        "exchange" => {
            only(&value, &["now", "items"])?;
            let now = value["now"].as_u64().ok_or("\"now\" is no time")?;
            Ok(Request::Exchange {
                now: Instant::from_nanos(now),
                items: items(&value, read_input)?,
            })
        }
        "save" => Ok(Request::Save),
        "load" => Ok(Request::Load(bytes(&value)?)),
        "end" => Ok(Request::End),
        other => Err(format!(
            "its key is \"{other}\", expected hello, exchange, save, load or end"
        )),
    }
}

/// Allowed keys of an item in addition to `time`, by the key that defines its kind.
type Kind = (&'static str, &'static [&'static str]);

const INPUTS: &[Kind] = &[
    ("fault", &["begins", "figure"]),
    ("quantity", &["value"]),
    ("line", &["port"]),
    ("message", &["port"]),
    ("bytes", &["port"]),
];

const OUTPUTS: &[Kind] = &[
    ("note", &["detail", "bytes"]),
    ("violation", &["detail", "bytes"]),
    ("quantity", &["value"]),
    ("line", &["port"]),
    ("rate", &["format", "port"]),
    ("message", &["port"]),
    ("bytes", &["port"]),
];

/// The kind of an item; rejects keys of other kinds.
fn kind_of(item: &Value, kinds: &[Kind]) -> Result<&'static str, String> {
    let kind = kinds.iter().find(|(kind, _)| item.get(kind).is_some());
    let Some((kind, more)) = kind else {
        let names: Vec<_> = kinds.iter().map(|(kind, _)| *kind).collect();
        let names = names.join(", ");
        return Err(format!("is of no kind, expected one of the keys {names}"));
    };
    only(item, &[&["time", kind], *more].concat())?;
    Ok(kind)
}

/// Checks that an object has no other keys.
fn only(object: &Value, keys: &[&str]) -> Result<(), String> {
    let Value::Object(map) = object else {
        return Err("is not a JSON object".to_owned());
    };
    match map.keys().find(|key| !keys.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(format!(
            "has the unknown key \"{key}\", expected {}",
            keys.join(", ")
        )),
    }
}

fn text<'a>(item: &'a Value, key: &str) -> Result<&'a str, String> {
    let text = item[key].as_str();
    text.ok_or_else(|| format!("has a \"{key}\" that is not a text"))
}

fn number(item: &Value, key: &str) -> Result<f64, String> {
    let number = item[key].as_f64();
    number.ok_or_else(|| format!("has no number \"{key}\""))
}

fn items<T>(value: &Value, read: fn(&Value) -> Result<T, String>) -> Result<Vec<Item<T>>, String> {
    let all = match &value["items"] {
        Value::Array(all) => all.as_slice(),
        Value::Null => &[],
        _ => return Err("\"items\" is no list".to_owned()),
    };
    let item = |(number, item): (usize, &Value)| {
        let wrong = |what: String| format!("item {number} {what}");
        let at = item["time"]
            .as_u64()
            .ok_or_else(|| wrong("has no time, expected \"time\" in nanoseconds".to_owned()))?;
        let port = item.get("port").or_else(|| item.get("quantity"));
        let port = port.map_or(Some(0), Value::as_u64);
        let port = port.and_then(|port| u8::try_from(port).ok());
        Ok(Item {
            port: port.ok_or_else(|| wrong("has no such port".to_owned()))?,
            at: Instant::from_nanos(at),
            what: read(item).map_err(wrong)?,
        })
    };
    all.iter().enumerate().map(item).collect()
}

fn read_input(item: &Value) -> Result<Input, String> {
    Ok(match kind_of(item, INPUTS)? {
        "fault" => Input::Fault {
            name: text(item, "fault")?.to_owned(),
            begins: item["begins"].as_bool().ok_or("has no \"begins\"")?,
            figure: match &item["figure"] {
                Value::Null => None,
                _ => Some(number(item, "figure")?),
            },
        },
        "quantity" => Input::Quantity(number(item, "value")?),
        "line" => Input::Line(event_of(text(item, "line")?)?),
        "message" => Input::Message(item["message"].clone()),
        _ => Input::Bytes(bytes(&item["bytes"])?),
    })
}

fn read_output(item: &Value) -> Result<Output, String> {
    Ok(match kind_of(item, OUTPUTS)? {
        kind @ ("note" | "violation") => {
            let rule = text(item, kind)?.to_owned();
            if rule.is_empty() {
                return Err("is a note without the name of a rule".to_owned());
            }
            Output::Note(Note {
                is_violation: kind == "violation",
                rule,
                detail: match item.get("detail") {
                    None => String::new(),
                    Some(_) => text(item, "detail")?.to_owned(),
                },
                bytes: item.get("bytes").map_or(Ok(Vec::new()), bytes)?,
            })
        }
        "quantity" => Output::Quantity(number(item, "value")?),
        "line" => Output::Line(event_of(text(item, "line")?)?),
        "rate" => {
            let rate = item["rate"].as_u64().and_then(|rate| rate.try_into().ok());
            let format = match item.get("format") {
                None => "8N1",
                Some(_) => text(item, "format")?,
            };
            let line = rate.and_then(|rate| line_of(rate, format));
            Output::Coding(line.ok_or("is a line coding that cannot be, expected e.g. 9600, 8N1")?)
        }
        "message" => Output::Message(item["message"].clone()),
        _ => Output::Bytes(bytes(&item["bytes"])?),
    })
}

fn name_of(event: LineEvent) -> &'static str {
    let known = LINE_EVENTS.iter().find(|(_, known, _)| *known == event);
    known.map_or("opened", |(.., name)| name)
}

fn event_of(name: &str) -> Result<LineEvent, String> {
    let known = LINE_EVENTS.iter().find(|(.., known)| *known == name);
    known
        .map(|(_, event, _)| *event)
        .ok_or_else(|| format!("is the line event \"{name}\", expected opened, closed or break"))
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

pub(crate) fn bytes(value: &Value) -> Result<Vec<u8>, String> {
    let wrong = || "has bytes that are no hexadecimal text".to_owned();
    let digits = value.as_str().ok_or_else(wrong)?.as_bytes();
    let digit = |digit: u8| char::from(digit).to_digit(16);
    let pairs = digits.chunks(2).map(|pair| match *pair {
        [high, low] => Some(digit(high)? << 4 | digit(low)?),
        _ => None,
    });
    let bytes = pairs.map(|pair| pair.and_then(|pair| u8::try_from(pair).ok()));
    bytes.collect::<Option<Vec<u8>>>().ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(item: &str) -> Result<Answer, String> {
        read_answer(format!("{{\"exchange\":{{\"next\":null,\"items\":[{item}]}}}}").as_bytes())
    }

    fn request(item: &str) -> Result<Request, String> {
        read_request(format!("{{\"exchange\":{{\"now\":1,\"items\":[{item}]}}}}").as_bytes())
    }

    /// One item of each kind, with all its keys.
    const ANSWERS: [&str; 7] = [
        r#""bytes":"00ff","port":0"#,
        r#""line":"opened","port":0"#,
        r#""rate":9600,"format":"7E1","port":0"#,
        r#""note":"busy","detail":"it is","bytes":"00""#,
        r#""violation":"busy","detail":"it is""#,
        r#""quantity":0,"value":1.5"#,
        r#""message":{"name":"go"},"port":0"#,
    ];
    const REQUESTS: [&str; 5] = [
        r#""bytes":"00ff","port":0"#,
        r#""line":"break","port":0"#,
        r#""fault":"stuck","begins":true,"figure":null"#,
        r#""quantity":0,"value":1.5"#,
        r#""message":{"name":"go"},"port":0"#,
    ];

    /// A misspelt key, or a key of another kind, is an error and not silently ignored.
    #[test]
    fn an_item_has_the_keys_of_its_kind_and_no_other() {
        let known = [
            "bytes", "line", "rate", "note", "fault", "value", "begins", "typo",
        ];
        for item in ANSWERS {
            assert!(answer(&format!("{{{item},\"time\":5}}")).is_ok(), "{item}");
            for key in known
                .iter()
                .filter(|key| !item.contains(&format!("\"{key}\"")))
            {
                let may_carry = *key == "bytes" && item.contains("violation");
                let said = answer(&format!("{{{item},\"time\":5,\"{key}\":\"00\"}}"));
                assert_eq!(said.is_ok(), may_carry, "{item} {key}");
            }
        }
        for item in REQUESTS {
            assert!(request(&format!("{{{item},\"time\":1}}")).is_ok(), "{item}");
            for key in known
                .iter()
                .filter(|key| !item.contains(&format!("\"{key}\"")))
            {
                let said = request(&format!("{{{item},\"time\":1,\"{key}\":\"00\"}}"));
                assert!(said.is_err(), "{item} {key}");
            }
        }
        let said = answer(r#"{"bytes":"00","prot":1,"time":5}"#).expect_err("misspelt");
        assert_eq!(
            said,
            "item 0 has the unknown key \"prot\", expected time, bytes, port"
        );
        assert!(read_answer(b"{\"exchange\":{\"nxt\":5}}").is_err());
        for wrong in [
            r#""value":1"#,
            r#""note":"""#,
            r#""line":1"#,
            r#""quantity":0"#,
        ] {
            assert!(
                answer(&format!("{{{wrong},\"time\":5}}")).is_err(),
                "{wrong}"
            );
        }
    }
}
