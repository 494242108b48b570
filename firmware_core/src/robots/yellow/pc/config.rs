//! How the PC's program is to behave: ours by default, the course's or the fielded program's ways
//! as switches.

use protocols::telemetry::Defects;

use crate::localise::Votes;
use crate::pose::Pose;

/// Settings of the PC's program; the default is ours in everything but where the course's report is
/// followed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PcConfig {
    /// Where its random numbers begin.
    pub seed: u64,
    /// Initial pose of the robot in the map's frame, which is sent to the robot. `None`: the
    /// robot's odometry is the map's frame.
    pub start: Option<Pose>,
    /// How commands go out.
    pub sending: Sending,
    /// Defects of reading frames.
    pub framing: Defects,
    /// How the map is kept.
    pub mapping: Mapping,
    /// Where to look next.
    pub view: NextView,
    /// How ways are found.
    pub planning: Planning,
    /// How goals are followed.
    pub following: Following,
    /// How the robot finds itself on the map.
    pub votes: Votes,
}

/// Ways of the fielded program to send commands; all off by default. Source: published client code
/// of the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sending {
    /// At most one queued command goes out per telemetry frame, so about five a second.
    pub one_per_frame: bool,
    /// Bytes go out one a millisecond.
    pub byte_per_ms: bool,
    /// Requests of state and lines empty the queue that drive commands wait in.
    pub requests_clear_queue: bool,
    /// Requests are sent once, and speeds by hand are not repeated.
    pub ask_once: bool,
}

/// Ways of the fielded program to keep the map; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mapping {
    /// Coordinates are whole cells of 8 bits, so they stop at 12.7 m.
    pub eight_bits: bool,
    /// The map grows by five cells more each time, and keeps them.
    pub wide_margin: bool,
    /// Scans are put where the odometry says, without a look at the walls that are known.
    pub odometry_alone: bool,
}

/// Where to look next, and when the map is complete.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NextView {
    /// The most unknown behind open edges of the known, less the way; complete without such edges.
    #[default]
    Frontier,
    /// The course's: among a twentieth of the free cells, drawn at random, the cell with rays (36)
    /// through the most unknown cells; complete when no ray meets any.
    Random,
}

/// How ways are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Planning {
    /// A roadmap of 100 vertices, doubled up to 800, then a search from cell to cell; corners are
    /// cut where the way is free.
    #[default]
    Retried,
    /// The course's: 100 vertices, once.
    Once,
}

/// How goals are followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Following {
    /// A robot that rests away from its goal gets the goal again, five times at most.
    #[default]
    Rested,
    /// The course's: a robot that moved less than 1 cm gets the goal again, forever; one that
    /// stopped halfway never gets it again.
    Moved,
}
