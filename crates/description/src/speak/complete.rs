//! Completion of requests at a prompt.

use std::collections::BTreeSet;

use super::modbus;
use crate::description::Description;
use crate::field;
use crate::message::Message;
use crate::schema::message::From;

impl Description {
    /// The words that may stand behind `before` in a request and that begin with `start`. A word
    /// that ends with `=` needs a value behind it.
    pub fn completions(&self, before: &[&str], start: &str) -> Vec<String> {
        let mut words = match self.protocol {
            Some(_) => modbus::words_behind(self, before),
            None => self.words_behind(before, start),
        };
        words.retain(|word| word.starts_with(start));
        words
    }

    fn words_behind(&self, before: &[&str], start: &str) -> Vec<String> {
        let mut asked = self
            .messages
            .iter()
            .filter(|message| message.from != From::Device);
        let Some((name, given)) = before.split_first() else {
            return asked.map(|message| message.name().to_owned()).collect();
        };
        let Some(message) = asked.find(|message| message.name() == *name) else {
            return Vec::new();
        };
        match start.split_once('=') {
            Some((key, _)) => values(message, key),
            None => keys(message, given),
        }
    }
}

/// The fields that are not yet given, each with `=`.
fn keys(message: &Message, given: &[&str]) -> Vec<String> {
    let given: BTreeSet<&str> = given
        .iter()
        .map(|pair| pair.split_once('=').map_or(*pair, |(key, _)| key))
        .collect();
    let free = super::free_fields(message);
    let free = free.into_iter().filter(|name| !given.contains(name));
    free.map(|name| format!("{name}=")).collect()
}

/// The field with each of its named values.
fn values(message: &Message, key: &str) -> Vec<String> {
    let Some(field) = field::find(message.fields(), key) else {
        return Vec::new();
    };
    let names = field.names.iter().flat_map(|names| names.values());
    let flags = field.flags.iter().filter(|flag| !flag.is_empty());
    let all = names.chain(flags);
    all.map(|name| format!("{key}={name}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The words that follow a beginning of a line, worked out by hand from the descriptions.
    #[test]
    fn a_prompt_completes_names_fields_and_values() {
        let nothing = |_: &str| Err("no file".to_owned());
        let of = |name: &str| {
            let text = crate::shipped::text(name).expect("shipped");
            Description::parse(name, text, &nothing).expect("a description")
        };
        let own = r#"
            name = "pump"
            about = "A pump"
            line = { baud = 9600 }
            frame = { terminator = "\n", max = 40 }
            enums.mode = { 0 = "off", 1 = "slow", 2 = "fast" }
            [[message]]
            name = "stop"
            from = "host"
            text = "STOP"
            [[message]]
            name = "set"
            from = "host"
            text = "SET {mode:d} {time:d}"
            fields = [{ name = "mode", enum = "mode" }]
            [[message]]
            name = "done"
            from = "device"
            text = "OK"
            [[on]]
            message = "*"
            reply = "done"
        "#;
        let pump = Description::parse("pump", own, &nothing).unwrap_or_else(|e| panic!("{e}"));
        let meter = of("modbus-meter");
        let first = &meter.registers.as_ref().expect("a table").holding.cells[0];
        let name = meter.variables[first.variable].name.to_string();
        let cases: [(&Description, &[&str], &str, &[&str]); 8] = [
            (&pump, &[], "", &["stop", "set"]),
            (&pump, &[], "se", &["set"]),
            (&pump, &["set"], "", &["mode=", "time="]),
            (&pump, &["set", "mode=off"], "", &["time="]),
            (
                &pump,
                &["set"],
                "mode=",
                &["mode=off", "mode=slow", "mode=fast"],
            ),
            (&pump, &["done"], "", &[]),
            (&meter, &[], "", &["read", "write"]),
            (&meter, &["write"], &name, &[&format!("{name}=")]),
        ];
        for (description, before, start, wanted) in cases {
            let found = description.completions(before, start);
            assert_eq!(found, wanted, "{before:?} {start}");
        }
        assert!(meter.completions(&["read"], "").contains(&name));
    }
}
