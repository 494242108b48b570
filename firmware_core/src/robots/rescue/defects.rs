//! The defects of the fielded programs, each behind its number in the project's list.

use protocols::rle::Dialect;

use super::Config;
use crate::scan::WeakReadings;
use crate::slam::Mode;
use crate::{base_link, odometry, packets, scan, waypoints};

/// Enabled defects of the fielded program; none by default. Defects of the map, of navigation and
/// of the PC link are in their own settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Defects {
    /// Defects of the register bus.
    pub base: base_link::Defects,
    /// Defects of the lidar's stream.
    pub packets: packets::Defects,
    /// Defects of the assembly of turns.
    pub scan: scan::Defects,
    /// Defects of the list of waypoints.
    pub waypoints: waypoints::Defects,
    /// Defects of the odometry.
    pub odometry: odometry::Defects,
    /// Defects of the robot as a whole.
    pub own: Own,
}

/// Defects of the robot as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Own {
    /// Before the first answer the battery counts as empty (MA-09).
    pub assumes_empty_battery: bool,
    /// Speeds are sent in tenths of a metre per second (MA-10).
    pub speaks_tenths: bool,
    /// Without packets the whole program waits for them (XV-08).
    pub waits_for_lidar: bool,
    /// The lidar's motor gets its start duty whenever the stream is lost (XV-09).
    pub kicks_motor: bool,
    /// An empty list begins an exploration (PU-11).
    pub explores_without_goal: bool,
    /// A manual drive order holds only until the next scan (PU-20).
    pub forgets_manual: bool,
    /// A manual drive order never ends (PU-21).
    pub manual_never_ends: bool,
    /// A robot that stops sends no stop command to its base (NV-04).
    pub stops_without_a_word: bool,
}

impl Defects {
    /// No defects.
    pub const NONE: Self = Self {
        base: base_link::Defects::NONE,
        packets: packets::Defects::NONE,
        scan: scan::Defects::NONE,
        waypoints: waypoints::Defects::NONE,
        odometry: odometry::Defects::NONE,
        own: Own {
            assumes_empty_battery: false,
            speaks_tenths: false,
            waits_for_lidar: false,
            kicks_motor: false,
            explores_without_goal: false,
            forgets_manual: false,
            manual_never_ends: false,
            stops_without_a_word: false,
        },
    };
}

/// Function that enables a defect.
type Switch = fn(&mut Config);

/// All defects of the program, in the order of the list.
#[rustfmt::skip]
const SWITCHES: [(&str, Switch); 61] = [
    ("MA-01", |c| c.defects.base.stores_checksum = true),
    ("MA-02", |c| c.defects.base.unbounded_store = true),
    ("MA-03", |c| c.defects.base.signed_counter = true),
    ("MA-04", |c| c.defects.base.takes_short_replies = true),
    ("MA-05", |c| c.defects.base.takes_acknowledgements = true),
    ("MA-06", |c| c.defects.base.writes_when_nobody_waits = true),
    ("MA-07", |c| c.defects.base.ignores_failures = true),
    ("MA-08", |c| c.defects.base.preempts_itself = true),
    ("MA-09", |c| c.defects.own.assumes_empty_battery = true),
    ("MA-10", |c| c.defects.own.speaks_tenths = true),
    ("XV-01", |c| c.defects.packets.sum_is_never_cleared = true),
    ("XV-02", |c| c.defects.packets.unchecked = true),
    ("XV-03", |c| {
        c.defects.packets.unchecked = true;
        c.defects.packets.any_index = true;
    }),
    ("XV-04", |c| c.defects.packets = packets::Defects::FIELDED),
    ("XV-05", |c| c.defects.packets = packets::Defects::FIELDED),
    ("XV-06", |c| c.defects.scan.synchronised_by_packet_0 = true),
    ("XV-07", |c| c.defects.scan.stale_distances = true),
    ("XV-08", |c| c.defects.own.waits_for_lidar = true),
    ("XV-09", |c| c.defects.own.kicks_motor = true),
    ("XV-10", |c| c.mounting.weak = WeakReadings::Discard),
    ("XV-11", |c| c.navigation.defects.drives_blind = true),
    ("XV-12", |c| c.pc_link.defects.raw_lidar = true),
    ("SL-01", |c| document(c).spread_reaches_zero = true),
    ("SL-02", |c| document(c).heading_spread_reaches_zero = true),
    ("SL-03", |c| document(c).unbounded_budget = true),
    ("SL-04", |c| document(c).unbounded_budget = true),
    ("SL-05", |c| {
        document(c).truncating_rounding = true;
        document(c).weight_down_to_one = true;
    }),
    ("SL-06", |c| document(c).truncating_rounding = true),
    ("SL-07", |c| c.defects.odometry.loses_the_sign = true),
    ("SL-08", |c| c.defects.odometry.garbles_the_heading = true),
    ("SL-09", |c| c.defects.odometry.turns_the_wrong_way = true),
    ("SL-10", |c| document(c).outside_is_free = true),
    ("SL-11", |c| document(c).score_wraps = true),
    ("SL-12", |c| {
        document(c).loses_short_holes = true;
        c.mapping.hole_mm = c.mapping.resolution_mm;
    }),
    ("SL-13", |c| c.pc_link.defects.counts_psi = true),
    ("SL-14", |c| document(c).saves_up_motion = true),
    ("H-SL-1", |c| document(c).never_narrows = true),
    ("PU-01", |c| c.pc_link.defects.forgets_to_restart = true),
    ("PU-02", |c| c.pc_link.defects.signed_checksum = true),
    ("PU-03", |c| c.pc_link.defects.signed_length = true),
    ("PU-04", |c| c.pc_link.defects.wants_a_byte = true),
    ("PU-05", |c| c.pc_link.defects.believes_the_count = true),
    ("PU-06", |c| c.pc_link.defects.unlocked = true),
    ("PU-07", |c| c.defects.waypoints.follows_unknown_links = true),
    ("PU-09", |c| c.defects.waypoints.follows_shared_links = true),
    ("PU-10", |c| c.defects.waypoints.keeps_the_target = true),
    ("PU-11", |c| c.defects.own.explores_without_goal = true),
    ("PU-12", |c| c.pc_link.defects.short_queue = true),
    ("PU-14", |c| c.pc_link.defects.byte_per_row = true),
    ("PU-15", |c| c.pc_link.defects.keeps_while_off = true),
    ("PU-16", |c| c.pc_link.defects.not_ready_at_first = true),
    ("PU-17", |c| c.pc_link.defects.sends_twice = true),
    ("PU-18", |c| c.pc_link.defects.prints_text = true),
    ("PU-19", |c| c.pc_link.dialect = Dialect::Fielded),
    ("PU-20", |c| c.defects.own.forgets_manual = true),
    ("PU-21", |c| c.defects.own.manual_never_ends = true),
    ("NV-01", |c| c.navigation.defects.wraps_one_side = true),
    ("NV-02", |c| c.navigation.defects.counts_turns = true),
    ("NV-03", |c| c.defects.waypoints.loses_its_ends = true),
    ("NV-04", |c| c.defects.own.stops_without_a_word = true),
    ("NV-05", |c| c.defects.waypoints.drops_silently = true),
];

/// The mapper's own defects belong to the seed report's mapping mode, so switch to it.
fn document(config: &mut Config) -> &mut crate::slam::Defects {
    if config.mapping.mode != Mode::Document {
        config.mapping = crate::slam::Settings {
            start: config.mapping.start,
            seed: config.mapping.seed,
            ..crate::slam::Settings::document()
        };
    }
    &mut config.mapping.defects
}

impl Config {
    /// Numbers of the defects that [`with_defect`](Self::with_defect) knows.
    pub fn defects() -> impl Iterator<Item = &'static str> {
        SWITCHES.iter().map(|(id, _)| *id)
    }

    /// The robot with the defect `id` of the fielded program; `None` if the id is unknown.
    pub fn with_defect(mut self, id: &str) -> Option<Self> {
        let (_, switch) = SWITCHES.iter().find(|(known, _)| *known == id)?;
        switch(&mut self);
        Some(self)
    }
}
