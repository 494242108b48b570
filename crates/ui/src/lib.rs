//! The page: displays and controls a run in a browser.
//!
//! ```text
//!  run (one thread) --> Desk --> Hub: newest snapshot, timeline --> a task per page --> browser
//!                                 ^                                        |
//!                                 +------- bounded queue of commands <-----+
//! ```
//!
//! The run never waits for a page. It publishes immutable snapshots, and each page fetches the
//! newest one when it can: a slow page misses some. Commands of a page pass through a queue with
//! limited size, are executed between two steps of virtual time, and become part of the scenario,
//! so that the session can be repeated byte by byte.

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

pub use desk::Desk;
pub use hub::Hub;
pub use mapper_desk::{Known, MapperDesk};
pub use pace::SPEED_MAX;
pub use remote::Remote;
pub use server::Server;
pub use session::Session;
