//! Settings of the PC's program: ours by default; variants of the course or of the fielded program
//! as switches.

use protocols::telemetry::Defects;

use crate::localise::Votes;
use crate::pose::Pose;

/// Settings of the PC's program; the default is ours, except where it follows the course's report.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PcConfig {
    /// Seed of its random numbers.
    pub seed: u64,
    /// Initial pose of the robot in the map's frame, which is sent to the robot. `None`: the
    /// robot's odometry is the map's frame.
    pub start: Option<Pose>,
    /// Sending of commands.
    pub sending: Sending,
    /// Defects of reading frames.
    pub framing: Defects,
    /// Method of mapping.
    pub mapping: Mapping,
    /// Choice of the next view.
    pub view: NextView,
    /// Method of planning.
    pub planning: Planning,
    /// Method of following goals.
    pub following: Following,
    /// Method of localisation on the map.
    pub votes: Votes,
}

/// The fielded program's methods of sending commands; all off by default. Source: published client
/// code of the robot.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sending {
    /// At most one queued command goes out per telemetry frame, so about five a second.
    pub one_per_frame: bool,
    /// Bytes are sent one a millisecond.
    pub byte_per_ms: bool,
    /// Requests of state and lines discard the queue in which drive commands wait.
    pub requests_clear_queue: bool,
    /// Requests are sent once, and manual speeds are not repeated.
    pub ask_once: bool,
}

/// The fielded program's methods of mapping; all off by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mapping {
    /// Coordinates are whole cells in 8 bits, so they saturate at 12.7 m.
    pub eight_bits: bool,
    /// The map grows by five extra cells each time, and keeps them.
    pub wide_margin: bool,
    /// Scans are entered at the odometry's pose, without a correction by known walls.
    pub odometry_alone: bool,
}

/// Choice of the next view, and the test for a complete map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NextView {
    /// The most unknown cells behind open edges, less the path's cost; complete without such edges.
    #[default]
    Frontier,
    /// The course's: among a twentieth of the free cells, drawn at random, the cell with rays (36)
    /// through the most unknown cells; complete when no ray meets any.
    Random,
}

/// Method of planning paths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Planning {
    /// A roadmap of 100 vertices, doubled up to 800, then a search from cell to cell; corners are
    /// cut where the path stays free.
    #[default]
    Retried,
    /// The course's: 100 vertices, once.
    Once,
}

/// Method of following goals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Following {
    /// A robot that rests away from its goal gets the goal again, five times at most.
    #[default]
    Rested,
    /// The course's: a robot that moved less than 1 cm gets the goal again, forever; one that
    /// stopped halfway never gets it again.
    Moved,
}
