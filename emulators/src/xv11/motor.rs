//! Figures of the motor and its head.
//!
//! Dry and viscous friction follow from the coast-down at the end of the "hand in box" capture:
//! about 380 rpm/s around 238 rpm and 333 rpm/s around 117 rpm, stop 0.9 s after the cut. Push and
//! back EMF follow from the reported 297 rpm at 3.3 V and a time constant of 0.5 s under drive (a
//! guess; reports name spin-ups of 0.3 to 1 s).

use crate::lidar::rotor::Motor;

/// The motor of an XV-11.
pub(crate) const MOTOR: Motor = Motor {
    push_rpm_s_v: 267.3,
    back_emf_per_s: 1.615,
    dry_rpm_s: 288.0,
    viscous_per_s: 0.385,
    // Gives the 0.63 rpm at 297 rpm of the capture once the motor's inertia has smoothed it, with
    // a correlation of 0.74 after 30 teeth.
    wander: 0.5 / 297.0,
    wander_kept: 0.99,
};
