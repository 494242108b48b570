//! Content of the robot's display: the map on the left; on the right a page of buttons, figures or
//! settings; a status bar that opens into a list of messages; tabs below.
//!
//! ```text
//!   +---------------------------------------------+
//!   | mode, last message                 battery  |   touch: messages
//!   +----------+----------------------------------+
//!   |  map     |  buttons, figures, settings      |   touch the map: a waypoint, or the pose
//!   |  200x200 |                                  |
//!   +----------+----+--------------+--------------+
//!   |  Map          |  Info        |  Settings    |
//!   +---------------+--------------+--------------+
//! ```
//!
//! Map size, scale, gray and the robot's two legs are the fielded program's. Its page of figures
//! was empty, its switch for the scan drew nothing; here both work.

mod draw;
mod layout;
mod notice;

use core::time::Duration;

use embedded_graphics::primitives::Rectangle;
use protocols::Instant;
use protocols::pcui::message::Mode;

use super::drive::Battery;
use crate::display::Display;
use crate::grid::Grid;
use crate::pose::{Point, Pose};
use crate::waypoints::Waypoints;
pub(super) use layout::{Action, Hit};
pub(super) use notice::{Notice, Notices};

/// Interval of the checks for changes.
const LOOK_PERIOD: Duration = Duration::from_millis(500);
/// Interval of the checks of the whole map. The fielded program redrew it every 200 ms, over a
/// parallel bus. Here that would fill the line, because the cells of walls change a little with
/// every scan.
const SWEEP_PERIOD: Duration = Duration::from_secs(4);
/// Maximum time between the two taps of a double tap.
const DOUBLE_TAP: Duration = Duration::from_millis(600);
/// Maximum distance between the two taps, pixels.
const DOUBLE_TAP_REACH: u16 = 12;

/// Pages of the right half.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Page {
    Map,
    Info,
    Settings,
}

/// Switches on the display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Switches {
    /// Scans are drawn into the map, not only matched.
    pub(super) mapping: bool,
    pub(super) lidar: bool,
    pub(super) pc_link: bool,
    /// The newest scan is shown on the map.
    pub(super) scan: bool,
    /// Touching the map sets waypoints.
    pub(super) waypoints: bool,
}

impl Switches {
    /// Switches at the robot's start: mapping and the PC link are on.
    pub(super) const AT_START: Self = Self {
        mapping: true,
        lidar: true,
        pc_link: true,
        scan: false,
        waypoints: false,
    };
}

/// Figures of the page of figures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Figures {
    pub(super) pose: [i16; 3],
    pub(super) scans: u32,
    pub(super) lost_packets: u32,
    pub(super) base_retries: u32,
    pub(super) rows_sent: u32,
    pub(super) arrivals: u32,
}

/// Content of the screen.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    pub(super) map: &'a Grid,
    pub(super) pose: Pose,
    /// End points of the newest scan's beams, in the robot's frame.
    pub(super) scan: &'a [Point],
    pub(super) waypoints: &'a Waypoints,
    pub(super) mode: Mode,
    pub(super) mode_name: &'static str,
    /// State of base and lidar for the status bar.
    pub(super) health: Notice,
    pub(super) battery: Option<Battery>,
    pub(super) switches: Switches,
    pub(super) figures: Figures,
}

/// Values that determine everything in the picture except the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Facts {
    page: Page,
    messages: bool,
    notices: u32,
    mode: Mode,
    mode_name: &'static str,
    battery: Option<i8>,
    switches: Switches,
    waypoints: [usize; 2],
    figures: Figures,
}

/// State of the screen.
#[derive(Clone, Debug)]
pub(super) struct Screen {
    display: Display,
    page: Page,
    messages: bool,
    pub(super) notices: Notices,
    facts: Option<Facts>,
    waypoints: u32,
    robot: Rectangle,
    look_at: Instant,
    sweep_at: Instant,
    tapped: Option<(Instant, [u16; 2])>,
}

impl Screen {
    pub(super) const fn new() -> Self {
        Self {
            display: Display::new(),
            page: Page::Map,
            messages: false,
            notices: Notices::NONE,
            facts: None,
            waypoints: 0,
            robot: Rectangle::zero(),
            look_at: Instant::ZERO,
            sweep_at: Instant::ZERO,
            tapped: None,
        }
    }

    pub(super) const fn display(&self) -> &Display {
        &self.display
    }

    /// Whether bytes wait for the line.
    pub(super) const fn has_output(&self) -> bool {
        self.display.has_output()
    }

    pub(super) fn transmit(&mut self, buf: &mut [u8]) -> usize {
        self.display.transmit(buf)
    }

    /// Whether [`refresh`](Self::refresh) has work.
    pub(super) fn has_work(&self, now: Instant) -> bool {
        now >= self.look_at || self.display.has_work(now)
    }

    /// Checks for changes when due, and draws a little.
    pub(super) fn refresh(&mut self, now: Instant, view: &View<'_>) {
        if now >= self.look_at {
            self.look_at = now + LOOK_PERIOD;
            self.look(now, view);
        }
        let Self {
            display,
            page,
            messages,
            notices,
            ..
        } = self;
        let shown = draw::Shown {
            page: *page,
            messages: messages.then_some(&*notices),
            last: notices.last(),
        };
        display.paint(now, |tile| draw::everything(tile, view, &shown));
    }

    /// Marks the areas that may have changed.
    fn look(&mut self, now: Instant, view: &View<'_>) {
        self.notices.observe(now, view);
        let facts = self.facts_of(view);
        if self.facts != Some(facts) {
            self.facts = Some(facts);
            self.display.mark(&layout::STATUS);
            self.display.mark(&layout::PANE);
            self.display.mark(&layout::TABS);
        }
        let waypoints = sum_of(view.waypoints);
        if now >= self.sweep_at || view.switches.scan || self.waypoints != waypoints {
            self.sweep_at = now + SWEEP_PERIOD;
            self.waypoints = waypoints;
            self.display.mark(&layout::MAP);
        }
        let robot = draw::robot_area(view);
        if self.robot != robot {
            self.display.mark(&self.robot);
            self.display.mark(&robot);
            self.robot = robot;
        }
    }

    fn facts_of(&self, view: &View<'_>) -> Facts {
        let is_info = self.page == Page::Info && !self.messages;
        Facts {
            page: self.page,
            messages: self.messages,
            notices: self.notices.count(),
            mode: view.mode,
            mode_name: view.mode_name,
            battery: view.battery.map(|battery| battery.percent),
            switches: view.switches,
            waypoints: [view.waypoints.all().len(), view.waypoints.reached()],
            figures: if is_info {
                view.figures
            } else {
                Figures::default()
            },
        }
    }

    /// Takes bytes of the touch panel; returns the touched element, if any.
    pub(super) fn receive(&mut self, now: Instant, bytes: &[u8]) -> Option<Hit> {
        let place = self.display.receive(now, bytes)?;
        let hit = layout::hit(place, self.page, self.messages)?;
        let before = self.tapped.replace((now, place));
        let is_double = before.is_some_and(|(at, before)| {
            let near = |a: u16, b: u16| a.abs_diff(b) <= DOUBLE_TAP_REACH;
            now - at <= DOUBLE_TAP && near(place[0], before[0]) && near(place[1], before[1])
        });
        if is_double {
            self.tapped = None;
        }
        self.look_at = Instant::ZERO;
        match hit {
            Hit::Button(Action::Show(page)) => {
                self.page = page;
                self.messages = false;
                None
            }
            Hit::Button(Action::Messages) => {
                self.messages = !self.messages;
                None
            }
            Hit::Map(place, _) => Some(Hit::Map(place, is_double)),
            // A double tap is required, because a touch by mistake would delete the map.
            Hit::Button(Action::Reset) if !is_double => None,
            hit @ Hit::Button(_) => Some(hit),
        }
    }
}

/// A sum that distinguishes lists of waypoints.
fn sum_of(waypoints: &Waypoints) -> u32 {
    let reached = u32::try_from(waypoints.reached()).unwrap_or(0);
    let start = 0x811C_9DC5_u32 ^ reached;
    let places = waypoints.all().iter().flat_map(|one| one.position_mm);
    places.fold(start, |sum, value| {
        (sum ^ u32::from(value.cast_unsigned())).wrapping_mul(0x0100_0193)
    })
}

#[cfg(test)]
mod tests;
