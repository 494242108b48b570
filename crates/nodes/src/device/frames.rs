//! Conversion between messages of a node program and frames on its line.

use emulators::device::{Event, EventKind};
use serde_json::Value;

use super::NodeDevice;
use crate::error::NodeError;
use crate::message::{Input, Item};
use crate::typed::{self, Heard};

impl NodeDevice {
    /// The frame of a message that the program sends.
    pub(super) fn frame_of(&self, message: &Value) -> Result<Vec<u8>, NodeError> {
        let frame = self.spec.description.as_deref().map_or_else(
            || Err("is a message, but the device has no description".to_owned()),
            |description| typed::frame_of(description, message),
        );
        frame.map_err(|what| NodeError::Unreadable {
            to: "an exchange",
            what: format!("an item {what}"),
        })
    }

    /// Decodes frames in the input, and replaces bytes by messages.
    pub(super) fn read_frames(&mut self) {
        let Some(listener) = &mut self.listener else {
            return;
        };
        let (inbox, events) = (&mut self.inbox, &mut self.events);
        let arrived = core::mem::take(inbox);
        let mut heard = |at, heard| {
            let what = match heard {
                Heard::Message(message) => Input::Message(message),
                Heard::Unknown(bytes) => Input::Bytes(bytes),
                Heard::Bad(rule, detail) => {
                    events.push(Event {
                        at,
                        kind: EventKind::Violation,
                        rule,
                        detail,
                        bytes: Vec::new(),
                    });
                    return;
                }
            };
            inbox.push(Item { port: 0, at, what });
        };
        let mut rest = Vec::new();
        for item in arrived {
            match item.what {
                Input::Bytes(bytes) if item.port == 0 => {
                    listener.hear(self.ports[0].line, item.at, &bytes, &mut heard);
                }
                _ => rest.push(item),
            }
        }
        listener.pass(self.now, &mut heard);
        self.inbox.append(&mut rest);
        self.inbox.sort_by_key(|item| item.at);
    }
}
