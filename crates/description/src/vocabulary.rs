//! The words with which messages and their values are printed. A condition can compare them.

use std::collections::BTreeSet;

use crate::description::Description;
use crate::field::{Field, Kind};
use crate::message::{Layout, Message};
use crate::pattern::{Form, Piece};
use crate::schema::message::From;
use crate::state::Source;

/// Words of values without names, and of frames that are no message.
const PLAIN: [&str; 5] = ["false", "inf", "nan", "true", "unknown message"];

impl Description {
    /// The names of the values that `field` has in all messages; `None` if it can have other
    /// values, or if there is no such field.
    pub fn names_of_field(&self, field: &str) -> Option<Vec<&str>> {
        if self.protocol.is_some() {
            return self.names_of_variable(field);
        }
        let mut names = BTreeSet::new();
        for message in &self.messages {
            let mut found = 0;
            let mut is_named = true;
            each(message.fields(), &mut |one| {
                if *one.name == *field {
                    found += 1;
                    is_named &= one.names.is_some();
                    let all = one.names.iter().flat_map(|names| names.values());
                    names.extend(all.map(String::as_str));
                }
            });
            // The field of a text may have no settings.
            if !is_named || found == 0 && message.names().contains(&field) {
                return None;
            }
        }
        (!names.is_empty()).then(|| names.into_iter().collect())
    }

    /// The names of the variables whose source is the simulated world.
    pub fn variables_of_world(&self) -> Vec<&str> {
        let variables = self.variables.iter();
        let measured = variables.filter(|one| matches!(one.source, Source::World(_)));
        measured.map(|one| &*one.name).collect()
    }

    /// The names of the values of a variable; `None` if it can have other values, or if there is no
    /// such variable.
    pub fn names_of_variable(&self, variable: &str) -> Option<Vec<&str>> {
        let mut all = self.variables.iter();
        let names = all.find(|one| *one.name == *variable)?.names.as_ref()?;
        Some(names.values().map(String::as_str).collect())
    }

    /// The messages that `from` sends, or that a device repeats to its host.
    fn printed(&self, from: From) -> impl Iterator<Item = &Message> {
        let messages = self.messages.iter();
        messages.filter(move |message| message.is_from(from) || self.echoes)
    }

    /// All words in which frames that `from` sends are printed, without numbers. `None` if a frame
    /// can contain any text, unless its words `beside_texts` are asked for, or if the description
    /// has no messages of its own.
    pub fn vocabulary(&self, from: From, beside_texts: bool) -> Option<Vec<&str>> {
        if self.protocol.is_some() {
            return self.modbus_vocabulary(beside_texts);
        }
        if self.messages.is_empty() || !beside_texts && self.printed(from).any(Message::is_free) {
            return None;
        }
        let mut words = BTreeSet::from(PLAIN);
        for message in self.printed(from) {
            words.insert(message.name());
            words.extend(message.names());
            each(message.fields(), &mut |field| {
                words.extend([&*field.name, &field.unit]);
                words.extend(field.flags.iter().map(String::as_str));
                let names = field.names.iter().flat_map(|names| names.values());
                words.extend(names.map(String::as_str));
            });
        }
        words.remove("");
        Some(words.into_iter().collect())
    }
}

impl Message {
    /// Whether a field can contain any text.
    fn is_free(&self) -> bool {
        match &self.layout {
            Layout::Fields(fields) => {
                let mut is_free = false;
                each(fields, &mut |field| {
                    is_free |= matches!(
                        field.kind,
                        Kind::Str(_) | Kind::StrZ | Kind::Prefixed { is_text: true, .. }
                    );
                });
                is_free
            }
            // The fields of a text have no types.
            Layout::Text { pieces, .. } => pieces.iter().any(|piece| match piece {
                Piece::Hole(hole) => hole.form == Form::Text,
                Piece::Words(_) => false,
            }),
        }
    }
}

/// Calls `act` for each field, also for those in groups and in the cases of a switch.
fn each<'a>(fields: &'a [Field], act: &mut dyn FnMut(&'a Field)) {
    for field in fields {
        act(field);
        match &field.kind {
            Kind::Group(inner) => each(inner, act),
            Kind::Switch { cases, other, .. } => {
                let cases = cases.iter().map(|(_, fields)| fields).chain(other);
                cases.into_iter().for_each(|inner| each(inner, act));
            }
            _ => {}
        }
    }
}
