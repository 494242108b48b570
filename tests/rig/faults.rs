//! What goes wrong, and how it is seen on the wire.

mod any;
mod boards;
mod chips;
mod control;
mod devices;
mod kinds;
mod live;
mod schedule;
mod wire;
