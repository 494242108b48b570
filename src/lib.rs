//! hilrig: a hardware-in-the-loop rig for small serial robots.
