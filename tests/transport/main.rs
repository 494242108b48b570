//! The real interface: bytes through the operating system's terminals.
//!
//! The tests check only content and order, never latency. Every wait ends as soon as the awaited
//! event happens, and no assertion depends on its duration.

mod client;
mod control;
mod control_api;
mod directory;
mod fuzz_dut;
mod fuzz_learned;
mod link;
mod pc_port;
mod processes;
mod pty;
mod realtime;
mod serial;
mod support;
