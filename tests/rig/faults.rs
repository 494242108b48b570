//! What goes wrong, and how it is seen on the wire.

mod control;
mod live;
