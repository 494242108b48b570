//! The results of commands on described devices.

use schemars::JsonSchema;
use serde::Serialize;

use crate::run::check::Status;

/// Requests to a device and its replies.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub(in crate::cli) struct Talked {
    pub(in crate::cli) exchanges: Vec<Exchanged>,
}

/// A request and the frames received after it.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Exchanged {
    /// The request in words.
    pub(in crate::cli) request: String,
    /// Replies to it.
    pub(in crate::cli) replies: Vec<RepliedWith>,
    /// Unsolicited frames, in words.
    pub(in crate::cli) unasked: Vec<String>,
}

/// A reply.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct RepliedWith {
    pub(in crate::cli) words: String,
    /// Whether the device refused the request.
    pub(in crate::cli) refused: bool,
    /// From the end of the request to the first byte of the reply.
    pub(in crate::cli) latency_ms: f64,
    pub(in crate::cli) values: Vec<ValueTold>,
}

/// A value of a reply.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct ValueTold {
    pub(in crate::cli) name: String,
    /// The value as a number, if it is one.
    pub(in crate::cli) number: Option<f64>,
    /// The value with its unit or name.
    pub(in crate::cli) words: String,
}

/// A device compared with its description.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Conformed {
    pub(in crate::cli) requests: u64,
    pub(in crate::cli) replies: u64,
    /// Median and 99th percentile of the time from a request to its reply.
    pub(in crate::cli) latency_ms: Option<Vec<f64>>,
    /// Requests that were not sent because they change the device's state.
    pub(in crate::cli) left_out: u64,
    /// Requests with a reply in the description that its own emulation does not answer either, e.g.
    /// because another request has to come first.
    pub(in crate::cli) not_compared: Vec<String>,
    pub(in crate::cli) differences: Vec<DifferenceTold>,
}

/// A difference.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct DifferenceTold {
    /// Its kind, e.g. `latency`, `scale`, `byte-order`.
    pub(in crate::cli) kind: String,
    /// The request, message, field or register.
    pub(in crate::cli) place: String,
    /// The value or behaviour in the description.
    pub(in crate::cli) expected: String,
    /// The device's behaviour.
    pub(in crate::cli) found: String,
}

/// A node program compared with the contract.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct NodeChecked {
    pub(in crate::cli) verdict: Status,
    pub(in crate::cli) parts: Vec<NodePart>,
}

/// A part of the contract.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct NodePart {
    /// The name of the part.
    pub(in crate::cli) name: String,
    /// Whether the program keeps the part; not observed if the program does not offer the feature.
    pub(in crate::cli) status: Status,
    /// An explanation.
    pub(in crate::cli) detail: String,
}

/// The knowledge learned from captured bytes.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Learned {
    pub(in crate::cli) claims: Vec<ClaimTold>,
    /// Bytes of the link.
    pub(in crate::cli) bytes: u64,
    /// Bytes in frames of the draft.
    pub(in crate::cli) framed: u64,
    /// The draft of a description, if there is enough evidence.
    pub(in crate::cli) draft: Option<String>,
}

/// A claim.
#[derive(Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct ClaimTold {
    /// Topic: `framing`, `checksum`, `messages`, `replies`.
    pub(in crate::cli) topic: String,
    pub(in crate::cli) words: String,
    pub(in crate::cli) evidence: String,
    /// Whether the evidence excludes chance.
    pub(in crate::cli) sure: bool,
}
