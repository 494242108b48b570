//! Faults changed by hand while a rig runs in real time: a unix socket, one JSON object a line in,
//! one JSON object a line out.
//!
//! ```text
//! {"do":"add","fault":{"link":"base","direction":"to-device","kind":"cut"}}
//! {"ok":true,"id":0,"asked":"12345678901ns","applied":"12345600001ns"}
//! {"do":"list"}
//! {"ok":true,"faults":[{"id":0,"state":"active","fault":{..}}]}
//! {"do":"end","id":0}
//! {"ok":true,"id":0,"asked":"13000ms","applied":"12999999999ns"}
//! {"do":"begin"}
//! {"ok":false,"key":"request","message":"unknown variant `begin`, expected .. at column 13"}
//! ```

mod server;

use protocols::Instant;
use serde::{Deserialize, Serialize};

use crate::rig::fault::FaultId;
use crate::run::{FaultReport, Run};
use crate::scenario::{FaultSpec, Flaw, Span};

pub use server::{Control, NAME};

/// Longest request that is read, its line end included.
pub const LINE_MAX: usize = 16 << 10;

/// What a client wants. A closed schema: a key that nobody reads is refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Request {
    /// A fault is to begin, now or when it says.
    Add {
        /// The fault, as in a scenario; times count from the start of the run.
        fault: Box<FaultSpec>,
    },
    /// All faults are to be told.
    List {},
    /// A fault is to end now.
    End {
        /// Its number.
        id: FaultId,
    },
}

/// What it came to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Answer {
    /// Whether the request was granted.
    pub ok: bool,
    /// The fault that was added or ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub id: Option<FaultId>,
    /// When the rig's clock saw the request.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub asked: Option<Span>,
    /// The virtual time of the change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub applied: Option<Span>,
    /// All faults.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub faults: Option<Vec<FaultReport>>,
    /// What was wrong with the request.
    #[serde(flatten)]
    pub flaw: Option<Flaw>,
}

impl From<Flaw> for Answer {
    fn from(flaw: Flaw) -> Self {
        Self {
            flaw: Some(flaw),
            ..Self::default()
        }
    }
}

impl Answer {
    /// The answer as a line.
    pub fn line(&self) -> String {
        let mut text = serde_json::to_string(self).expect("plain data with string keys");
        text.push('\n');
        text
    }
}

/// Does what the line `request`, seen at `asked`, wants of `run`.
pub fn obey(run: &mut Run, request: &[u8], asked: Instant) -> Answer {
    let request: Request = match serde_json::from_slice(request) {
        Ok(request) => request,
        Err(error) => return Flaw::new("request", error.to_string()).into(),
    };
    let changed = match request {
        Request::List {} => {
            return Answer {
                ok: true,
                faults: Some(run.faults().collect()),
                ..Answer::default()
            };
        }
        Request::Add { fault } => run.inject(*fault),
        Request::End { id } => run.withdraw(id).map(|()| id),
    };
    match changed {
        Err(flaw) => flaw.into(),
        Ok(id) => Answer {
            ok: true,
            id: Some(id),
            asked: Some(Span(asked - Instant::ZERO)),
            applied: Some(Span(run.rig.now() - Instant::ZERO)),
            ..Answer::default()
        },
    }
}
