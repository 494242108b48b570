//! The control interface of a run in real time, for programs in any language: a unix socket, one
//! JSON object per line in each direction. `docs/control.md` is the contract.
//!
//! ```text
//! {"do":"hello"}
//! {"ok":true,"protocol":1,"tool":"hilrig","scenario":"rescue-flat","seed":1, ..}
//! {"do":"wait","for":{"pose":{"near_m":[1.2,3],"within_m":0.2}},"timeout":"20s"}
//! {"ok":true,"held":true,"at":"12345ms","at_ns":12345000000}
//! {"link":"base","direction":"to-device","kind":"cut"}
//! {"ok":true,"id":0,"asked":"12345678901ns","applied":"12345600001ns"}
//! {"do":"begin"}
//! {"ok":false,"key":"do","message":"is \"begin\", expected one of hello, state, .."}
//! ```
//!
//! A client gets its answers in the order of its requests. A waiting client blocks neither the
//! other clients nor the rig. Lines, requests, clients and unread answers are limited.

mod answer;
mod client;
mod modem;
mod perform;
mod request;
mod server;
mod state;

use core::time::Duration;

use protocols::Instant;

use engine::run::Run;

pub use answer::{Answer, Refusal};
use perform::{Office, Reply};
pub use request::{Request, VERBS, json_schema};
pub use server::{CLIENTS_MAX, Control, NAME};

/// Version of the interface. It increases when a client of the previous version could fail.
pub const PROTOCOL: u32 = 1;
/// Maximum length of a request, bytes, with its line end.
pub const LINE_MAX: usize = 16 << 10;

/// Virtual time between two checks of a wait condition, if no other caller advances the clock.
const LOOK_EVERY: Duration = Duration::from_millis(5);

/// Executes `request`, a line seen at `asked`, on `run`. No other caller advances the clock of
/// `run`: `wait` and `step` do.
pub fn obey(run: &mut Run, request: &[u8], asked: Instant) -> Answer {
    let (mut session, mut tally) = Default::default();
    let mut office = Office {
        run,
        tempo: None,
        ports: &mut [],
        clients: 0,
        tally: &mut tally,
    };
    let mut reply = office.perform(&mut session, request, asked);
    loop {
        match reply {
            Reply::Now(answer) => return answer,
            Reply::Later(pending) => {
                let next = office.run.rig.now() + LOOK_EVERY;
                office.run.go_on_until(next.min(pending.until()));
                reply = office.look_again(pending);
            }
        }
    }
}
