//! Safety of a robot during the whole run, whatever fails.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Span;

/// Expected safety of the robot during the whole run, also while links and devices fail. Keys that
/// are not given are not checked.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SafetySpec {
    /// Silence of a link in `rests_without` after which the robot must stop, and stay at rest until
    /// the link carries bytes again. A lidar without any distance counts as silent. The robot may
    /// take 0.8 s to brake.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rests_within: Option<Span>,
    /// Links from which the robot must receive bytes in order to drive, e.g. `["lidar"]`. Built-in
    /// robots have their own list; for a custom robot it is the link of its lidar if not given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rests_without: Vec<String>,
    /// Whether the robot must rest until a frame with a valid checksum has arrived on
    /// `orders_link`. Driven by hand, it must not speed up or reverse by damaged frames.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub sound_orders: bool,
    /// Link that carries the orders to the robot; built-in robots have their own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub orders_link: Option<String>,
    /// The pose, speeds and charge that the robot reports to its station must be its own, and the
    /// reported lines those of its scan.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub true_telemetry: bool,
    /// Whether the program must count each valid frame that arrives on its lines as accepted, and
    /// no other; built-in robots only.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub true_counts: bool,
    /// Whether the program must send only whole, valid frames.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub sound_frames: bool,
    /// Maximum error of the believed position, millimetres; the heading may be wrong by 20 degrees.
    /// A larger error must not last 3 s before the first fault, push or contact that may mislead
    /// the robot's sensors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub pose_within_mm: Option<f64>,
    /// Time from the arrival of an order to rest until the robot obeys; it may take 0.3 s to brake.
    /// Its set-points must also follow an order to drive by hand.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub obeys_within: Option<Span>,
    /// Maximum time between two commands to a drive whose set-points are not zero, and no watchdog
    /// of the drive may expire; while no fault acts on the links of the drive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub commands_within: Option<Span>,
    /// Maximum silence of the program on a line that it uses steadily, while no fault acts on this
    /// line: a failed device must not block the others.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sends_within: Option<Span>,
    /// Whether the program must send its cyclic frames in time, while no fault acts on their link;
    /// built-in robots only.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub sends_cyclically: bool,
    /// Whether the program must repeat a request that was not answered, and count only fitting
    /// frames as answers; built-in robots with a bus of requests only.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub asks_again: bool,
    /// Whether the program must not count failures of a link on which no fault acts; built-in
    /// robots only.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub true_complaints: bool,
    /// Maximum error of the path and the turns that the robot's dead reckoning measures, per cent,
    /// while no fault acts on its sensors and no contact or push makes its wheels slip.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0))]
    pub motion_within_percent: Option<f64>,
    /// Whether the robot must turn to its goal before it drives, and by the shorter way: by less
    /// than 230 degrees on the spot.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub short_turns: bool,
    /// Maximum silence of a device until the program notices: its counter of such failures must
    /// grow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub says_within: Option<Span>,
    /// Maximum number of times that a queue of a device or a port overflowed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overruns_max: Option<u64>,
    /// Length of the last part of the run, in which each line of a device that was busy before must
    /// carry bytes, and the program must find its pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alive_for: Option<Span>,
    /// Links that stay broken to the end: `alive_for` ignores them, and does not require a pose.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub alive_without: Vec<String>,
    /// Whether a person steers by hand: then a contact is not a failure of the robot.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub by_hand: bool,
    /// Time from which contacts are not judged: a sensor then deceives the robot, and no program
    /// can know where the obstacles are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contacts_until: Option<Span>,
    /// Whether a step of the mission may wait to the end: then a false condition is no failure.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub steps_may_wait: bool,
}

impl SafetySpec {
    /// The links that its keys name, each with its key.
    pub(crate) fn links(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let needed = self.rests_without.iter();
        let needed = needed.map(|link| ("rests_without", link.as_str()));
        let orders = self.orders_link.iter();
        let orders = orders.map(|link| ("orders_link", link.as_str()));
        let without = self.alive_without.iter();
        let without = without.map(|link| ("alive_without", link.as_str()));
        needed.chain(orders).chain(without)
    }
}
