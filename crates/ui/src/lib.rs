//! The page: a run to be seen and steered in a browser.
//!
//! ```text
//!  run (one plain thread) --> Desk --> Hub: newest snapshot, timeline --> a task per page -->
//! browser
//!                               ^                                        |
//!                               +------- bounded queue of commands <-----+
//! ```
//!
//! The run never waits for a page. It leaves immutable snapshots and each page
//! takes the newest when it can: a page that does not read misses some. What a page wants comes
//! through a queue that refuses what does not fit, is done between two steps of virtual time, and
//! becomes part of the scenario, so that the session can be repeated byte by byte.

mod checkpoints;
mod command;
mod connections;
mod deed;
mod delta;
mod desk;
mod figures;
mod guard;
mod hub;
mod map_layers;
mod mapper_desk;
mod pace;
mod remote;
mod server;
mod session;
mod snapshot;
mod timeline;
mod token;
mod told;
mod wire;
mod wire_log;

pub use desk::Desk;
pub use hub::Hub;
pub use mapper_desk::{Known, MapperDesk};
pub use pace::SPEED_MAX;
pub use remote::Remote;
pub use server::Server;
pub use session::Session;
