//! The mapper on logs: the data that is read, the data that is ignored, and the accuracy of the
//! path.

mod bags;
mod buildings;
mod command;
mod damage;
mod diff;
mod foreign;
mod intel;
mod lab;
mod links;
#[cfg(feature = "mcap")]
mod messages;
mod relations;
mod room;
mod ros;

#[expect(dead_code, reason = "shared with the tests that read captures")]
#[path = "../support/captures.rs"]
mod captures;
