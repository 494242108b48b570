//! Requests of clients, read from lines.

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, json_schema};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::answer::Refusal;
use engine::rig::fault::FaultId;
use engine::scenario::{Action, Condition, FaultSpec, Span};

/// A request of a client. The schema is closed: an unknown key is an error. A fault by itself, an
/// object with `kind` and without `do`, is an `add`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// Describes the rig: version of the interface, tool, scenario, links and ports.
    Hello {},
    /// Returns the state of the run: time, poses, axes, registers, counters, contacts, links.
    State {},
    /// Answers when a condition has become true, or a time has passed.
    Wait {
        /// The condition.
        #[serde(rename = "for")]
        condition: Condition,
        /// Maximum time of the rig; then the answer is no.
        timeout: Span,
    },
    /// Lets rig time, which must be paused, continue for this long; then answers.
    Step {
        /// Duration of the step, at most 10 minutes.
        by: Span,
    },
    /// Pauses rig time.
    Pause {},
    /// Rig time continues.
    Resume {},
    /// Sets the speed of rig time.
    Speed {
        /// Seconds of the rig per second, 0.01 to 4.
        #[schemars(range(min = 0.01, max = 4.0))]
        x: f64,
    },
    /// Touches the robot's display, or a button.
    Press {
        /// Column and row on the display, pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        display: Option<[u16; 2]>,
        /// Name of a button.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        button: Option<String>,
    },
    /// Orders an action of the scenario's PC, as a step of a mission.
    Mission {
        /// The action.
        action: Action,
    },
    /// Returns the checks as if the run ended now.
    Verdict {},
    /// Ends the run, and judges it if a verdict was requested.
    Quit {},
    /// Adds a fault, which begins now or at its own time.
    Add {
        /// The fault, as in a scenario; times count from the start of the run.
        fault: Box<FaultSpec>,
    },
    /// Sets lines of a port that a pseudo-terminal does not have. From the first such request until
    /// the client disconnects, opening a port raises its DTR and RTS, and closing it lowers them.
    Modem {
        /// The port; if not given, nothing changes.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        port: Option<String>,
        /// Whether DTR is on.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        dtr: Option<bool>,
        /// Whether RTS is on.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        rts: Option<bool>,
        /// Level of CTS for the port's client, independent of the device; the same for the next
        /// three keys.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        cts: Option<bool>,
        /// DSR.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        dsr: Option<bool>,
        /// RI.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        ri: Option<bool>,
        /// DCD.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        dcd: Option<bool>,
        /// Whether to send a break.
        #[serde(default, rename = "break")]
        sends_break: bool,
        /// Input and control modes of the client's terminal, as in termios(3).
        #[serde(default, skip_serializing_if = "Option::is_none")]
        modes: Option<[u32; 2]>,
        /// Whether to discard bytes that the client has written and the line has not taken.
        #[serde(default)]
        discard: bool,
    },
    /// Lists all faults.
    List {},
    /// Ends a fault now.
    End {
        /// Number of the fault.
        #[schemars(with = "usize")]
        id: FaultId,
    },
}

/// All requests.
pub const VERBS: [&str; 15] = [
    "hello", "state", "wait", "step", "pause", "resume", "speed", "press", "mission", "verdict",
    "quit", "add", "modem", "list", "end",
];

/// The JSON Schema (draft 2020-12) of a request.
pub fn json_schema() -> Value {
    let mut generator = SchemaSettings::draft2020_12().into_generator();
    let fault = generator.subschema_for::<FaultSpec>();
    let request = generator.subschema_for::<Request>();
    let definitions = generator.take_definitions(true);
    let mut schema = json_schema!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A request to the control socket of hilrig, one a line",
        "anyOf": [request, fault],
    });
    schema.insert("$defs".to_owned(), Value::Object(definitions));
    schema.to_value()
}

impl Request {
    /// Reads a line.
    ///
    /// # Errors
    /// A refusal that names the key and the expected value.
    pub(super) fn parse(line: &[u8]) -> Result<Self, Refusal> {
        let value: Value = serde_json::from_slice(line)
            .map_err(|error| Refusal::new("request", error.to_string()))?;
        let Value::Object(mut keys) = value else {
            let message = "expected an object such as {\"do\":\"state\"}";
            return Err(Refusal::new("request", message));
        };
        if !keys.contains_key("do") && keys.contains_key("kind") {
            keys = Map::from_iter([
                ("do".to_owned(), json!("add")),
                ("fault".to_owned(), Value::Object(keys)),
            ]);
        }
        let is_verb = |verb: &Value| verb.as_str().is_some_and(|verb| VERBS.contains(&verb));
        match keys.get("do") {
            Some(verb) if is_verb(verb) => {}
            verb => {
                let is = verb.map_or("is missing".to_owned(), |verb| format!("is {verb}"));
                let message = format!("{is}, expected one of {}", VERBS.join(", "));
                return Err(Refusal::new("do", message));
            }
        }
        // A fault has the errors of a scenario file.
        if let (Some("add"), Some(Value::Object(fault))) = (keys["do"].as_str(), keys.get("fault"))
            && let Err(flaws) = FaultSpec::of_json(fault)
            && let Some((key, message)) = flaws.into_iter().next()
        {
            return Err(Refusal::new(key, message));
        }
        read(&keys).map_err(|message| Refusal::new(blamed(&keys, &message), message))
    }
}

fn read(keys: &Map<String, Value>) -> Result<Request, String> {
    let request = Request::deserialize(keys);
    request.map_err(|error| error.to_string())
}

/// The key of the error `message`: the key that it names, or the key without which the message
/// would be another one.
fn blamed(keys: &Map<String, Value>, message: &str) -> String {
    let named = ["unknown field `", "missing field `"]
        .iter()
        .find_map(|what| {
            let rest = message.strip_prefix(what)?;
            Some(rest.split('`').next().unwrap_or_default().to_owned())
        });
    let guilty = || {
        let mut others = keys.keys().filter(|key| *key != "do");
        let found = others.find(|key| {
            let mut without = keys.clone();
            without.remove(key.as_str());
            read(&without).err().as_deref() != Some(message)
        });
        found.cloned()
    };
    named
        .or_else(guilty)
        .unwrap_or_else(|| "request".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_verb_is_one_and_there_is_no_other() {
        for verb in VERBS {
            let line = format!("{{\"do\":\"{verb}\",\"x y\":1}}");
            let said = Request::parse(line.as_bytes()).expect_err("a key too many");
            assert_ne!(said.key, "do", "{verb}: {}", said.message);
        }
        let message = serde_json::from_str::<Request>("{\"do\":\"x\"}").expect_err("no verb");
        let listed = message.to_string().matches('`').count() / 2 - 1;
        assert_eq!(listed, VERBS.len());
    }

    #[test]
    fn a_refusal_names_the_key() {
        let cases = [
            ("", "request"),
            ("[1]", "request"),
            ("{}", "do"),
            ("{\"do\":7}", "do"),
            ("{\"do\":\"state\",\"of\":1}", "of"),
            ("{\"do\":\"wait\",\"timeout\":\"1s\"}", "for"),
            (
                "{\"do\":\"wait\",\"for\":{\"visited\":1},\"timeout\":5}",
                "timeout",
            ),
            (
                "{\"do\":\"wait\",\"for\":{\"visited\":-1},\"timeout\":\"1s\"}",
                "for",
            ),
            ("{\"do\":\"speed\",\"x\":\"fast\"}", "x"),
            ("{\"do\":\"mission\",\"action\":\"fly\"}", "action"),
            (
                "{\"do\":\"add\",\"fault\":{\"kind\":\"cut\",\"rat\":1}}",
                "rat",
            ),
            ("{\"kind\":\"cut\",\"rate\":\"much\"}", "rate"),
        ];
        for (line, key) in cases {
            let said = Request::parse(line.as_bytes()).expect_err(line);
            assert_eq!(said.key, key, "{line}: {}", said.message);
        }
    }

    #[test]
    fn a_bare_fault_is_added() {
        let bare = br#"{"link":"base","direction":"to-device","kind":"cut"}"#;
        assert!(matches!(Request::parse(bare), Ok(Request::Add { .. })));
    }

    #[test]
    fn the_schema_knows_every_verb() {
        let text = json_schema().to_string();
        for verb in VERBS {
            assert!(text.contains(&format!("\"const\":\"{verb}\"")), "{verb}");
        }
    }
}
