//! Layout of the screen: the same table draws the buttons and finds the touched one.

use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::primitives::Rectangle;
use protocols::pcui::message::Mode;

use super::{Page, Switches};
use crate::display::{HEIGHT, RIGHT, WIDTH};

/// Pixels along an edge of the map: 300 cells at a scale of 1.5, as on the fielded robot.
pub(super) const MAP_SIDE: i32 = 200;
/// Cells per two pixels.
pub(super) const CELLS_PER_2_PIXELS: i32 = 3;

pub(super) const STATUS: Rectangle = area(0, 0, WIDTH, 24);
pub(super) const MAP: Rectangle = area(6, 32, 200, 200);
/// The right half between status bar and tabs.
pub(super) const PANE: Rectangle = area(RIGHT, 24, WIDTH - RIGHT, 216);
pub(super) const TABS: Rectangle = area(0, 240, WIDTH, HEIGHT - 240);

const fn area(x: u16, y: u16, width: u16, height: u16) -> Rectangle {
    Rectangle::new(
        Point::new(x as i32, y as i32),
        Size::new(width as u32, height as u32),
    )
}

/// Action of a button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in super::super) enum Action {
    Show(Page),
    Messages,
    Order(Mode),
    Mapping,
    Scan,
    SetWaypoints,
    ClearMap,
    ClearWaypoints,
    Lidar,
    PcLink,
    Reset,
}

/// Touched element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) enum Hit {
    Button(Action),
    /// A position on the map, in cells from its lower left corner, and whether it was a double tap.
    Map([f32; 2], bool),
}

/// A field to touch.
pub(super) struct Button {
    pub(super) area: Rectangle,
    pub(super) label: &'static str,
    pub(super) action: Action,
}

const fn button(x: u16, y: u16, label: &'static str, action: Action) -> Button {
    Button {
        area: area(x, y, 128, 36),
        label,
        action,
    }
}

const TAB_BUTTONS: [Button; 3] = [
    tab(0, "Map", Page::Map),
    tab(1, "Info", Page::Info),
    tab(2, "Settings", Page::Settings),
];

const fn tab(number: u16, label: &'static str, page: Page) -> Button {
    Button {
        area: area(160 * number, 240, 160, HEIGHT - 240),
        label,
        action: Action::Show(page),
    }
}

const MAP_BUTTONS: [Button; 8] = [
    button(218, 32, "Stop", Action::Order(Mode::Stop)),
    button(348, 32, "Explore", Action::Order(Mode::Exploration)),
    button(218, 72, "Waypoints", Action::Order(Mode::Waypoint)),
    button(348, 72, "Mapping", Action::Mapping),
    button(218, 112, "Show scan", Action::Scan),
    button(348, 112, "Set waypoints", Action::SetWaypoints),
    button(218, 152, "Clear map", Action::ClearMap),
    button(348, 152, "Clear waypoints", Action::ClearWaypoints),
];

const SETTINGS_BUTTONS: [Button; 3] = [
    button(218, 32, "Lidar", Action::Lidar),
    button(348, 32, "PC link", Action::PcLink),
    button(218, 112, "RESET: tap twice", Action::Reset),
];

/// The touchable fields besides map and status bar.
pub(super) fn buttons(page: Page, messages: bool) -> impl Iterator<Item = &'static Button> {
    let own: &[Button] = match page {
        _ if messages => &[],
        Page::Map => &MAP_BUTTONS,
        Page::Info => &[],
        Page::Settings => &SETTINGS_BUTTONS,
    };
    TAB_BUTTONS.iter().chain(own)
}

/// Whether a button is an active switch or the current choice.
pub(super) fn is_lit(action: Action, page: Page, mode: Mode, switches: Switches) -> bool {
    match action {
        Action::Show(shown) => shown == page,
        Action::Order(ordered) => ordered == mode,
        Action::Mapping => switches.mapping,
        Action::Scan => switches.scan,
        Action::SetWaypoints => switches.waypoints,
        Action::Lidar => switches.lidar,
        Action::PcLink => switches.pc_link,
        Action::Messages | Action::ClearMap | Action::ClearWaypoints | Action::Reset => false,
    }
}

/// The element at `place`.
pub(super) fn hit(place: [u16; 2], page: Page, messages: bool) -> Option<Hit> {
    let at = Point::new(place[0].into(), place[1].into());
    if STATUS.contains(at) {
        return Some(Hit::Button(Action::Messages));
    }
    if MAP.contains(at) && page == Page::Map {
        let right = at.x - MAP.top_left.x;
        let up = MAP_SIDE - 1 - (at.y - MAP.top_left.y);
        let cell = |pixel: i32| (pixel as f32 + 0.5) * CELLS_PER_2_PIXELS as f32 / 2.0;
        return Some(Hit::Map([cell(right), cell(up)], false));
    }
    let touched = buttons(page, messages).find(|button| button.area.contains(at));
    touched.map(|button| Hit::Button(button.action))
}
