//! The two directions of a link.

/// Direction of bytes on a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// From the device to the robot's program; on the air from the radio to the PC, which is that
    /// link's master.
    ToMaster,
    /// From the robot's program to the device; on the air from the PC to the radio.
    ToDevice,
}

impl Direction {
    /// Both, in the order in which a rig handles them.
    pub(super) const BOTH: [Self; 2] = [Self::ToMaster, Self::ToDevice];

    /// Name as in scenarios and reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::ToMaster => "to-master",
            Self::ToDevice => "to-device",
        }
    }
}
