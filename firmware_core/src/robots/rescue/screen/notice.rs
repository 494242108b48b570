//! Messages of the status bar.

use protocols::Instant;
use protocols::pcui::diagnosis::Text;

use super::View;

/// Messages kept, as on the fielded robot.
const KEPT: usize = 25;
/// Time that base and lidar need to start.
const GRACE: Instant = Instant::from_secs(3);
/// Battery charge below which a message is shown.
const BATTERY_LOW_PERCENT: i8 = 20;

/// A message for an operator beside the robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Notice {
    Started,
    BatteryLow,
    GoesHome,
    StopButton,
    OffMap,
    VictimFound,
    Explored,
    BaseSilent,
    LidarSilent,
    RadioSilent,
    AllWell,
    WaypointReached,
    WaypointRefused,
    PoseSet,
    StopFirst,
    MapCleared,
    WaypointsCleared,
    Reset,
}

impl Notice {
    pub(super) const fn text(self) -> &'static str {
        match self {
            Self::Started => "started",
            Self::BatteryLow => "Battery warning!",
            Self::GoesHome => "battery low, slows down",
            Self::StopButton => "stop button pressed",
            Self::OffMap => "at the end of the map",
            Self::VictimFound => "victim found",
            Self::Explored => "nothing left, goes home",
            Self::BaseSilent => "base does not answer",
            Self::LidarSilent => "lidar sends nothing",
            Self::RadioSilent => "radio does not answer",
            Self::AllWell => "base and lidar work",
            Self::WaypointReached => "waypoint reached",
            Self::WaypointRefused => "no room for a waypoint",
            Self::PoseSet => "pose set by touch",
            Self::StopFirst => "stop the robot first",
            Self::MapCleared => "map cleared",
            Self::WaypointsCleared => "waypoints cleared",
            Self::Reset => "reset",
        }
    }

    pub(super) const fn is_warning(self) -> bool {
        matches!(
            self,
            Self::BatteryLow
                | Self::GoesHome
                | Self::StopButton
                | Self::OffMap
                | Self::BaseSilent
                | Self::LidarSilent
                | Self::RadioSilent
        )
    }
}

/// A message and its time, in seconds since the start.
#[derive(Clone, Copy, Debug)]
pub(super) struct Entry {
    pub(super) at_s: u32,
    pub(super) notice: Notice,
}

/// The newest messages, and the state that they reported.
#[derive(Clone, Debug)]
pub(in super::super) struct Notices {
    entries: [Entry; KEPT],
    count: u32,
    /// Last known state of base and lidar.
    health: Notice,
    is_battery_low: bool,
    arrivals: u32,
}

impl Notices {
    pub(super) const NONE: Self = Self {
        entries: [Entry {
            at_s: 0,
            notice: Notice::Started,
        }; KEPT],
        count: 1,
        health: Notice::Started,
        is_battery_low: false,
        arrivals: 0,
    };

    /// Number of messages so far, including discarded ones.
    pub(super) const fn count(&self) -> u32 {
        self.count
    }

    /// The newest message.
    pub(super) fn last(&self) -> Entry {
        self.newest().next().expect("there was one at the start")
    }

    /// The newest message, as text for the PC.
    pub(in super::super) fn told(&self) -> Text<'static> {
        Text {
            #[expect(clippy::cast_possible_truncation, reason = "it tells neighbours apart")]
            number: self.count as u16,
            text: self.last().notice.text().as_bytes(),
        }
    }

    /// All messages, newest first.
    pub(super) fn newest(&self) -> impl Iterator<Item = Entry> + '_ {
        let count = self.count as usize;
        (0..count.min(KEPT)).map(move |back| self.entries[(count - 1 - back) % KEPT])
    }

    pub(in super::super) fn push(&mut self, now: Instant, notice: Notice) {
        let at_s = u32::try_from(now.as_nanos() / 1_000_000_000).unwrap_or(u32::MAX);
        self.entries[self.count as usize % KEPT] = Entry { at_s, notice };
        self.count = self.count.saturating_add(1);
    }

    /// Adds messages for changes since the last call.
    pub(super) fn observe(&mut self, now: Instant, view: &View<'_>) {
        if view.health != self.health && now >= GRACE {
            self.health = view.health;
            self.push(now, view.health);
        }
        let percent = view.battery.map(|battery| battery.percent);
        let is_low = percent.is_some_and(|percent| percent <= BATTERY_LOW_PERCENT);
        if is_low && !self.is_battery_low {
            self.push(now, Notice::BatteryLow);
        }
        self.is_battery_low = is_low;
        if view.figures.arrivals != self.arrivals {
            self.arrivals = view.figures.arrivals;
            self.push(now, Notice::WaypointReached);
        }
    }
}
