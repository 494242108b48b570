//! `[[on]]`, `[[every]]`, `[[after]]` and `[faults]`.

use core::time::Duration;
use std::collections::BTreeMap;

use super::{COMMON_FAULTS, Compiler, forever};
use crate::behaviour::{After, Deed, Every, Fault, On, Trigger};
use crate::expr::Expr;
use crate::message::Message;
use crate::schema::behaviour::{EventSpec, FaultSpec, OnSpec};
use crate::schema::message::{From, Names};
use crate::schema::short::Plain;

/// The fields of a trigger's message. For any message: the fields that all messages of the host
/// have.
fn fields_of(trigger: Trigger, messages: &[Message]) -> Vec<&str> {
    let mut requests = messages
        .iter()
        .filter(|message| message.is_from(From::Host));
    match trigger {
        Trigger::Message(index) => messages.get(index).map(Message::names).unwrap_or_default(),
        Trigger::AnyMessage => {
            let mut common = requests.next().map(Message::names).unwrap_or_default();
            for message in requests {
                let names = message.names();
                common.retain(|name| names.contains(name));
            }
            common
        }
        Trigger::Event(_) => Vec::new(),
    }
}

impl Compiler<'_> {
    /// Compiles `[[on]]`.
    pub(super) fn on(&mut self, messages: &[Message], latency: Duration) -> Vec<On> {
        let schema = self.schema;
        let specs = schema.on.iter().enumerate();
        specs
            .map(|(index, spec)| self.one(index, spec, messages, latency))
            .collect()
    }

    fn one(&mut self, index: usize, spec: &OnSpec, messages: &[Message], latency: Duration) -> On {
        let key = format!("on[{index}]");
        let trigger = match (&spec.message, spec.event) {
            (Some(_), Some(_)) | (None, None) => {
                self.wrong(&key, "expected either \"message\" or \"event\"");
                Trigger::AnyMessage
            }
            (message, event) => self.trigger(&key, message.as_deref(), event, messages),
        };
        let request = &fields_of(trigger, messages);
        let deed = self.deed(
            &key,
            "reply",
            Parts {
                when: spec.when.as_deref(),
                set: &spec.set,
                send: &spec.reply,
                with: &spec.with,
            },
            request,
            messages,
        );
        let write = spec.write.as_ref().map(|write| {
            let at = self.request_expr(&format!("{key}.write.at"), &write.at.expression(), request);
            let data = self.request_expr(&format!("{key}.write.data"), &write.data, request);
            (at, data)
        });
        let has_bytes = self
            .schema
            .registers
            .as_ref()
            .is_some_and(|all| !all.bytes.is_empty());
        if write.is_some() && !has_bytes {
            self.wrong(
                format!("{key}.write"),
                "there is no table, expected [registers] bytes",
            );
        }
        if let Some(rule) = &spec.violation {
            let is_sound = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            if rule.is_empty() || !rule.chars().all(is_sound) {
                let message = format!("\"{rule}\" is no rule, expected small letters and -");
                self.wrong(format!("{key}.violation"), message);
            }
        }
        let does = !spec.reply.0.is_empty()
            || !spec.set.is_empty()
            || write.is_some()
            || spec.violation.is_some()
            || spec.busy.is_some()
            || spec.restart;
        // An entry without any action is valid too: later entries do not see its message.
        if !does && spec.event.is_some() {
            self.wrong(
                &key,
                "does nothing, expected \"reply\", \"set\", \"write\" or \"violation\"",
            );
        }
        On {
            trigger,
            deed,
            write,
            latency: spec.latency.map_or(latency, |span| span.0),
            jitter: spec.jitter.or(self.schema.jitter).map(|span| span.0),
            busy: spec.busy.map(|span| span.0),
            violation: spec.violation.as_deref().map(forever),
            restarts: spec.restart,
        }
    }

    /// Compiles `[[every]]`.
    pub(super) fn every(&mut self, messages: &[Message]) -> Vec<Every> {
        let schema = self.schema;
        let mut all = Vec::new();
        for (index, spec) in schema.every.iter().enumerate() {
            let key = format!("every[{index}]");
            if spec.period.0.is_zero() {
                self.wrong(format!("{key}.period"), "is 0, expected a time");
            }
            let parts = Parts {
                when: spec.when.as_deref(),
                set: &spec.set,
                send: &spec.send,
                with: &spec.with,
            };
            let deed = self.deed(&key, "send", parts, &[], messages);
            if spec.send.0.is_empty() && spec.set.is_empty() {
                self.wrong(&key, "does nothing, expected \"send\" or \"set\"");
            }
            all.push(Every {
                period: spec.period.0.max(Duration::from_nanos(1)),
                first: spec.first.unwrap_or(spec.period).0,
                jitter: spec.jitter.map(|span| span.0),
                deed,
            });
        }
        all
    }

    /// Compiles `[[after]]`.
    pub(super) fn after(&mut self, messages: &[Message]) -> Vec<After> {
        let schema = self.schema;
        let mut all = Vec::new();
        for (index, spec) in schema.after.iter().enumerate() {
            let key = format!("after[{index}]");
            let trigger = match (&spec.message, spec.event) {
                (None, None) => Trigger::Event(EventSpec::Start),
                (Some(_), Some(_)) => {
                    self.wrong(&key, "expected either \"message\" or \"event\"");
                    Trigger::AnyMessage
                }
                (message, event) => self.trigger(&key, message.as_deref(), event, messages),
            };
            let parts = Parts {
                when: spec.when.as_deref(),
                set: &spec.set,
                send: &spec.send,
                with: &spec.with,
            };
            let request = &fields_of(trigger, messages);
            let deed = self.deed(&key, "send", parts, request, messages);
            if spec.send.0.is_empty() && spec.set.is_empty() {
                self.wrong(&key, "does nothing, expected \"send\" or \"set\"");
            }
            all.push(After {
                trigger,
                delay: spec.delay.0,
                deed,
            });
        }
        all
    }

    fn trigger(
        &mut self,
        key: &str,
        message: Option<&str>,
        event: Option<EventSpec>,
        messages: &[Message],
    ) -> Trigger {
        if let Some(event) = event {
            return Trigger::Event(event);
        }
        let name = message.unwrap_or_default();
        if name == "*" {
            return Trigger::AnyMessage;
        }
        let found = self.message_index(&format!("{key}.message"), name, From::Host, messages);
        found.map_or(Trigger::AnyMessage, Trigger::Message)
    }

    /// The index of the message `name`, which `from` must send.
    fn message_index(
        &mut self,
        key: &str,
        name: &str,
        from: From,
        messages: &[Message],
    ) -> Option<usize> {
        let found = messages.iter().position(|message| &*message.name == name);
        match found.map(|index| messages[index].is_from(from)) {
            Some(true) => found,
            Some(false) => {
                let end = if from == From::Host { "host" } else { "device" };
                self.wrong(key, format!("\"{name}\" does not come from the {end}"));
                None
            }
            None => {
                let known = messages.iter().filter(|message| message.is_from(from));
                let known: Vec<_> = known.map(|message| &*message.name).collect();
                let known = if known.is_empty() {
                    "none here".to_owned()
                } else {
                    known.join(", ")
                };
                self.wrong(
                    key,
                    format!("there is no message \"{name}\", expected one of: {known}"),
                );
                None
            }
        }
    }

    fn deed(
        &mut self,
        key: &str,
        send_key: &str,
        parts: Parts<'_>,
        fields: &[&str],
        messages: &[Message],
    ) -> Deed {
        let when = parts
            .when
            .map(|text| self.request_expr(&format!("{key}.when"), text, fields));
        let set = self.set(key, parts.set, fields);
        let mut send = Vec::new();
        let is_single = parts.send.0.len() == 1;
        for (index, name) in parts.send.0.iter().enumerate() {
            let key = match is_single {
                true => format!("{key}.{send_key}"),
                false => format!("{key}.{send_key}[{index}]"),
            };
            send.extend(self.message_index(&key, name, From::Device, messages));
        }
        let mut with = Vec::new();
        for (field, plain) in parts.with {
            let key = format!("{key}.with.{field}");
            let known = send.iter().flat_map(|&index| messages[index].names());
            let known: Vec<_> = known.collect();
            let outer = field.split('.').next().unwrap_or(field);
            if !known.contains(&outer) && parts.send.0.len() == send.len() {
                let known = if known.is_empty() {
                    "none".to_owned()
                } else {
                    known.join(", ")
                };
                self.wrong(
                    &key,
                    format!("there is no field \"{field}\", expected one of: {known}"),
                );
            }
            with.push((
                field.as_str().into(),
                self.request_expr(&key, &plain.expression(), fields),
            ));
        }
        Deed {
            when,
            set,
            send,
            with,
        }
    }

    fn set(
        &mut self,
        key: &str,
        set: &BTreeMap<String, Plain>,
        fields: &[&str],
    ) -> Vec<(usize, Expr)> {
        let mut all = Vec::new();
        for (name, plain) in set {
            let key = format!("{key}.set.{name}");
            let expr = self.request_expr(&key, &plain.expression(), fields);
            match self.variable(name) {
                Some(index) if self.variables[index].is_measured() => {
                    self.wrong(
                        &key,
                        format!(
                            "{name} has a source and cannot be set, expected a stored variable"
                        ),
                    );
                }
                Some(index) => all.push((index, expr)),
                None => {
                    let known = self.variable_names();
                    let known = if known.is_empty() {
                        "none here".to_owned()
                    } else {
                        known
                    };
                    let message =
                        format!("there is no variable \"{name}\", expected one of: {known}");
                    self.wrong(&key, message);
                }
            }
        }
        all
    }

    /// An expression over the fields of a request and the state.
    fn request_expr(&mut self, key: &str, text: &str, fields: &[&str]) -> Expr {
        let variables: Vec<_> = self
            .variables
            .iter()
            .map(|known| known.name.clone())
            .collect();
        let has_address = self.schema.line.address.is_some();
        let is_known = |name: &str| {
            let of_request = name.strip_prefix("request.");
            let of_state = name.strip_prefix("state.");
            let outer = |name: &str| name.split('.').next().unwrap_or(name).to_owned();
            let field = |name: &str| fields.contains(&&*outer(name));
            let variable = |name: &str| variables.iter().any(|known| **known == *name);
            match (of_request, of_state) {
                (Some(name), _) => field(name),
                (_, Some(name)) => variable(name),
                _ => field(name) || variable(name) || (name == "own_address" && has_address),
            }
        };
        let names = || {
            let names = fields.iter().map(|name| (*name).to_owned());
            let names = names.chain(variables.iter().map(ToString::to_string));
            let names = names.chain(has_address.then(|| "own_address".to_owned()));
            names.collect::<Vec<_>>().join(", ")
        };
        self.expr(key, text, &is_known, &names)
    }

    /// Compiles `[faults]`.
    pub(super) fn faults(&mut self, messages: &[Message]) -> Vec<Fault> {
        let schema = self.schema;
        let faults = schema.faults.iter();
        faults
            .map(|(name, spec)| self.fault(name, spec, messages))
            .collect()
    }

    fn fault(&mut self, name: &str, spec: &FaultSpec, messages: &[Message]) -> Fault {
        let key = format!("faults.{name}");
        self.check_name(&key, name);
        if COMMON_FAULTS.contains(&name) {
            let message = format!("every device has \"{name}\", expected another name");
            self.wrong(&key, message);
        }
        let variables: Vec<_> = self
            .variables
            .iter()
            .map(|known| known.name.clone())
            .collect();
        let index_of = |wanted: &str| variables.iter().position(|known| **known == *wanted);
        let mut set = Vec::new();
        for (variable, plain) in &spec.set {
            let key = format!("{key}.set.{variable}");
            let is_known = |name: &str| {
                let plain = name.strip_prefix("state.").unwrap_or(name);
                matches!(name, "factor" | "self") || index_of(plain).is_some()
            };
            let listed = self.variable_names();
            let names = || format!("self, factor, {listed}");
            let expr = self.expr(&key, &plain.expression(), &is_known, &names);
            match index_of(variable) {
                Some(index) => set.push((index, expr)),
                None => {
                    let known = self.variable_names();
                    let message =
                        format!("there is no variable \"{variable}\", expected one of: {known}");
                    self.wrong(&key, message);
                }
            }
        }
        let mut freeze = Vec::new();
        for (index, variable) in spec.freeze.iter().enumerate() {
            match index_of(variable) {
                Some(variable) => freeze.push(variable),
                None => {
                    let known = self.variable_names();
                    let message =
                        format!("there is no variable \"{variable}\", expected one of: {known}");
                    self.wrong(format!("{key}.freeze[{index}]"), message);
                }
            }
        }
        let mut replace = Vec::new();
        for (from, to) in &spec.replace {
            let key = format!("{key}.replace.{from}");
            let from = self.message_index(&key, from, From::Device, messages);
            let to = self.message_index(&key, to, From::Device, messages);
            replace.extend(from.zip(to));
        }
        let does = !spec.set.is_empty()
            || !spec.freeze.is_empty()
            || !spec.replace.is_empty()
            || spec.late.is_some()
            || spec.mute
            || spec.bad_checksum
            || spec.garbage.is_some()
            || spec.restart;
        if !does {
            let message = "does nothing, expected e.g. \"set\", \"freeze\", \"late\", \"mute\"";
            self.wrong(&key, message);
        }
        Fault {
            name: forever(name),
            about: spec.about.clone(),
            set,
            freeze,
            late: spec.late.map_or(Duration::ZERO, |span| span.0),
            is_mute: spec.mute,
            is_bad_checksum: spec.bad_checksum,
            replace,
            garbage: spec.garbage.unwrap_or(0).into(),
            restarts: spec.restart,
        }
    }
}

/// The keys that all kinds of behaviour share.
struct Parts<'a> {
    when: Option<&'a str>,
    set: &'a BTreeMap<String, Plain>,
    send: &'a Names,
    with: &'a BTreeMap<String, Plain>,
}
