//! What a page wants, as JSON: `{"do": "add", "at": [1200, 800]}`.

use serde::Deserialize;
use tokio::sync::mpsc;

use engine::robots::Gesture;
use engine::scenario::{FaultSpec, SetPoint};

/// Longest command, bytes.
pub(super) const COMMAND_MAX: usize = 2048;

/// What a page wants.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub(super) enum Command {
    /// Virtual time stands still.
    Pause,
    /// It continues.
    Play,
    /// It continues this far and then stands still.
    Step { ms: u32 },
    /// Virtual seconds per second.
    Speed { x: f64 },
    /// The run begins again, with another seed if one is given.
    Restart { seed: Option<u64> },
    /// The run continues from an earlier time, nanoseconds, and stands still there.
    Branch { at_ns: u64 },
    /// A waypoint, millimetres of the map.
    Add { at: [i32; 2] },
    /// Moves a waypoint.
    Move {
        index: usize,
        from: [i32; 2],
        to: [i32; 2],
    },
    /// A waypoint goes away.
    Delete { index: usize, at: [i32; 2] },
    /// All waypoints go away.
    Clear,
    /// The robot's order.
    Mode { mode: String },
    /// Set-points of the axes by hand.
    Drive { axes: Vec<SetPoint> },
    /// A finger on the robot's display, column and row.
    Tap { place: [u16; 2] },
    /// The PC opens its port.
    Connect,
    /// The PC closes its port.
    Disconnect,
    /// Something goes wrong from now on, for so long if a time is given.
    Fault {
        fault: Box<FaultSpec>,
        for_ms: Option<u32>,
    },
    /// A fault ends.
    EndFault { id: usize },
    /// The run so far as a scenario. Only asked for by the server itself.
    #[serde(skip)]
    Save,
}

impl Command {
    /// Reads a command; an error says what was expected.
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        if text.len() > COMMAND_MAX {
            return Err(format!("a command has at most {COMMAND_MAX} bytes"));
        }
        serde_json::from_str(text).map_err(|error| format!("not a command: {error}"))
    }

    /// What it wants of the robot, if that is what it is about.
    pub(super) fn gesture(&self) -> Option<Gesture> {
        Some(match self {
            &Self::Add { at } => Gesture::Add { at },
            &Self::Move { index, from, to } => Gesture::Move { index, from, to },
            &Self::Delete { index, at } => Gesture::Delete { index, at },
            Self::Clear => Gesture::Clear,
            Self::Mode { mode } => Gesture::Mode(mode.clone()),
            Self::Connect => Gesture::Connect,
            Self::Disconnect => Gesture::Disconnect,
            _ => return None,
        })
    }
}

/// A command and the channel for its answer.
#[derive(Debug)]
pub(super) struct Envelope {
    pub(super) command: Command,
    pub(super) reply: mpsc::Sender<Answer>,
}

impl Envelope {
    /// Tells the page; one that does not listen misses it.
    pub(super) fn answer(&self, answer: Answer) {
        // A full or closed queue is the page's own loss.
        drop(self.reply.try_send(answer));
    }
}

/// Data sent to the page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// Nothing was done, and why.
    Refused(String),
    /// The scenario that was asked for.
    Case(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read() {
        let read = |text| Command::parse(text).expect("a command");
        assert_eq!(read(r#"{"do":"pause"}"#), Command::Pause);
        assert_eq!(
            read(r#"{"do":"move","index":1,"from":[1,2],"to":[3,4]}"#),
            Command::Move {
                index: 1,
                from: [1, 2],
                to: [3, 4]
            }
        );
        let text = r#"{"do":"fault","fault":{"link":"base","direction":"to-device",
                       "kind":"flip","rate":0.01},"for_ms":500}"#;
        assert!(matches!(
            read(text),
            Command::Fault {
                for_ms: Some(500),
                ..
            }
        ));
    }

    #[test]
    fn what_is_no_command_is_refused_with_a_reason() {
        let wrong = [
            "",
            "[]",
            "{}",
            r#"{"do":"fly"}"#,
            r#"{"do":"save"}"#,
            r#"{"do":"drive","wheels":[200,0]}"#,
            r#"{"do":"add","at":[1]}"#,
            r#"{"do":"add","at":[1,2],"more":3}"#,
            r#"{"do":"add","at":["<b>",2]}"#,
        ];
        for text in wrong {
            assert!(Command::parse(text).is_err(), "{text}");
        }
        let huge = format!(r#"{{"do":"pause","x":"{}"}}"#, "x".repeat(COMMAND_MAX));
        assert!(Command::parse(&huge).expect_err("huge").contains("2048"));
        let deep = "[".repeat(COMMAND_MAX);
        assert!(Command::parse(&deep).is_err());
    }
}
