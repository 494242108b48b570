//! Drawing of everything that touches a tile.

use core::fmt::{self, Write};

use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::mono_font::ascii::{FONT_6X10, FONT_6X13_BOLD};
use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::{Rgb565, RgbColor, WebColors};
use embedded_graphics::prelude::*;
use embedded_graphics::primitives::{Circle, Line, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Baseline, Text};

use super::layout::{self, Button, MAP, MAP_SIDE};
use super::notice::{Entry, Notices};
use super::{Page, View};
use crate::display::Tile;
use crate::pose::{self, sin_cos};

const PAPER: Rgb565 = Rgb565::WHITE;
const INK: Rgb565 = Rgb565::BLACK;
const FIELD: Rgb565 = Rgb565::CSS_GAINSBORO;
const LIT: Rgb565 = Rgb565::CSS_STEEL_BLUE;
const BAR: Rgb565 = Rgb565::CSS_DARK_SLATE_GRAY;
const WARNING: Rgb565 = Rgb565::CSS_ORANGE_RED;
const SCAN: Rgb565 = Rgb565::CSS_DODGER_BLUE;
const ROBOT: Rgb565 = Rgb565::CSS_CRIMSON;
const WAYPOINT: Rgb565 = Rgb565::CSS_PURPLE;
const REACHED: Rgb565 = Rgb565::CSS_PLUM;

/// Length of the robot's legs, and half the angle between them, as in the fielded program.
const LEG_PIXELS: f32 = 10.0;
const LEG_ANGLE: f32 = 20.0 * core::f32::consts::PI / 180.0;
/// Battery charge below which it is shown in red.
const BATTERY_LOW_PERCENT: i8 = 20;
/// Number of messages in the list.
const MESSAGES_SHOWN: usize = 16;

/// Content of the screen besides the robot's own state.
pub(super) struct Shown<'a> {
    pub(super) page: Page,
    /// The list of messages, if it is open.
    pub(super) messages: Option<&'a Notices>,
    pub(super) last: Entry,
}

/// Text of bounded length; longer text is cut off.
struct Words {
    bytes: [u8; 48],
    len: usize,
}

impl Words {
    fn new(args: fmt::Arguments<'_>) -> Self {
        let mut words = Self {
            bytes: [0; 48],
            len: 0,
        };
        // An error only means that the text was cut off.
        let _ = words.write_fmt(args);
        words
    }

    fn as_str(&self) -> &str {
        core::str::from_utf8(&self.bytes[..self.len]).unwrap_or_default()
    }
}

impl Write for Words {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            let slot = self.bytes.get_mut(self.len).ok_or(fmt::Error)?;
            *slot = if byte.is_ascii() { byte } else { b'?' };
            self.len += 1;
        }
        Ok(())
    }
}

pub(super) fn everything(tile: &mut Tile, view: &View<'_>, shown: &Shown<'_>) {
    fill(tile, &tile.bounding_box(), PAPER);
    let frame = MAP.offset(1);
    if tile.touches(&frame) {
        outline(tile, &frame, INK);
        map(tile, view);
        if view.switches.scan {
            scan(tile, view);
        }
        waypoints(tile, view);
        robot(tile, view);
    }
    if tile.touches(&layout::STATUS) {
        status(tile, view, shown);
    }
    for button in layout::buttons(shown.page, shown.messages.is_some()) {
        if tile.touches(&button.area) {
            field(tile, button, view, shown.page);
        }
    }
    if tile.touches(&layout::PANE) {
        match (shown.messages, shown.page) {
            (Some(notices), _) => messages(tile, notices),
            (None, Page::Map) => target(tile, view),
            (None, Page::Info) => figures(tile, view),
            (None, Page::Settings) => {}
        }
    }
}

fn fill(tile: &mut Tile, area: &Rectangle, colour: Rgb565) {
    let Ok(()) = tile.fill_solid(area, colour);
}

fn outline(tile: &mut Tile, area: &Rectangle, colour: Rgb565) {
    let style = PrimitiveStyle::with_stroke(colour, 1);
    let Ok(()) = area.into_styled(style).draw(tile);
}

fn line(tile: &mut Tile, from: Point, to: Point, colour: Rgb565) {
    if tile.touches(&Rectangle::with_corners(from, to)) {
        let style = PrimitiveStyle::with_stroke(colour, 1);
        let Ok(()) = Line::new(from, to).into_styled(style).draw(tile);
    }
}

fn text(tile: &mut Tile, at: Point, words: &str, font: &MonoFont<'_>, colour: Rgb565) {
    let letters = u32::try_from(words.len()).unwrap_or(0);
    let size = font.character_size;
    if tile.touches(&Rectangle::new(
        at,
        Size::new(letters * size.width, size.height),
    )) {
        let style = MonoTextStyle::new(font, colour);
        let Ok(_) = Text::with_baseline(words, at, style, Baseline::Top).draw(tile);
    }
}

/// Shades from black to white.
const SHADES: [u16; 8] = {
    let mut shades = [0; 8];
    let mut shade: u16 = 0;
    while shade < 8 {
        let bright = shade << 2 | shade >> 1;
        shades[shade as usize] = bright << 11 | (bright << 1 | bright >> 4) << 5 | bright;
        shade += 1;
    }
    shades
};

/// Draws the cells in inverted gray: free cells are white.
fn map(tile: &mut Tile, view: &View<'_>) {
    let (columns, rows) = tile.part_of(&MAP);
    for y in rows {
        let up = MAP_SIDE - 1 - (y - MAP.top_left.y);
        let Some(cells) = view.map.row(cell_of(up)) else {
            continue;
        };
        let pixels = tile.pixels_mut(y, columns.clone());
        for (pixel, x) in pixels.iter_mut().zip(columns.clone()) {
            let cell = cells.get(cell_of(x - MAP.top_left.x)).copied();
            // Use eight shades, so that small changes of a cell are not sent again.
            let shade = (255 - cell.unwrap_or(crate::grid::UNKNOWN)) >> 5;
            *pixel = SHADES[usize::from(shade)];
        }
    }
}

/// The cell under the middle of a pixel, counted from the lower left corner.
fn cell_of(pixel: i32) -> usize {
    usize::try_from((2 * pixel + 1) * layout::CELLS_PER_2_PIXELS / 4).unwrap_or(usize::MAX)
}

/// Pixel of a position on the map.
#[expect(
    clippy::cast_possible_truncation,
    reason = "saturates far outside the display"
)]
fn pixel_of(view: &View<'_>, x_mm: f32, y_mm: f32) -> Point {
    let pixel_mm = view.map.resolution_mm() * layout::CELLS_PER_2_PIXELS as f32 / 2.0;
    let limited = |mm: f32| libm::floorf((mm / pixel_mm).clamp(-500.0, 1000.0)) as i32;
    Point::new(
        MAP.top_left.x + limited(x_mm),
        MAP.top_left.y + MAP_SIDE - 1 - limited(y_mm),
    )
}

/// Tip and ends of the legs.
#[expect(clippy::cast_possible_truncation, reason = "ten pixels")]
fn legs(view: &View<'_>) -> [Point; 3] {
    let tip = pixel_of(view, view.pose.x_mm, view.pose.y_mm);
    let leg = |turn: f32| {
        let (sin, cos) = sin_cos(view.pose.heading + core::f32::consts::PI + turn);
        let reach = |part: f32| libm::roundf(LEG_PIXELS * part) as i32;
        tip + Point::new(reach(cos), -reach(sin))
    };
    [tip, leg(LEG_ANGLE), leg(-LEG_ANGLE)]
}

/// The pixels that the robot covers.
pub(super) fn robot_area(view: &View<'_>) -> Rectangle {
    let [tip, left, right] = legs(view);
    Rectangle::with_corners(
        tip.component_min(left).component_min(right),
        tip.component_max(left).component_max(right),
    )
}

fn robot(tile: &mut Tile, view: &View<'_>) {
    let [tip, left, right] = legs(view);
    line(tile, tip, left, ROBOT);
    line(tile, tip, right, ROBOT);
}

fn scan(tile: &mut Tile, view: &View<'_>) {
    for point in view.scan {
        let place: pose::Point = view.pose.to_world(*point);
        let at = pixel_of(view, place.x_mm, place.y_mm);
        if MAP.contains(at) {
            tile.put(at.x, at.y, SCAN);
        }
    }
}

fn waypoints(tile: &mut Tile, view: &View<'_>) {
    let places = view.waypoints.all().iter();
    let pixels = places.map(|one| {
        let [x, y] = one.position_mm.map(f32::from);
        pixel_of(view, x, y)
    });
    let mut before = None;
    for (number, at) in pixels.enumerate() {
        let is_reached = number < view.waypoints.reached();
        let colour = if is_reached { REACHED } else { WAYPOINT };
        if !MAP.contains(at) {
            before = None;
            continue;
        }
        if let Some(before) = before.replace(at) {
            line(tile, before, at, colour);
        }
        let dot = Circle::with_center(at, 5);
        if tile.touches(&dot.bounding_box()) {
            let Ok(()) = dot
                .into_styled(PrimitiveStyle::with_fill(colour))
                .draw(tile);
        }
        let label = at + Point::new(4, -10);
        if tile.touches(&Rectangle::new(label, Size::new(18, 10))) {
            let words = Words::new(format_args!("{}", number + 1));
            text(tile, label, words.as_str(), &FONT_6X10, colour);
        }
    }
}

fn status(tile: &mut Tile, view: &View<'_>, shown: &Shown<'_>) {
    fill(tile, &layout::STATUS, BAR);
    text(
        tile,
        Point::new(8, 6),
        view.mode_name,
        &FONT_6X13_BOLD,
        PAPER,
    );
    let Entry { at_s, notice } = shown.last;
    let words = Words::new(format_args!("{at_s} s  {}", notice.text()));
    let colour = if notice.is_warning() { WARNING } else { PAPER };
    text(tile, Point::new(112, 7), words.as_str(), &FONT_6X10, colour);
    let (words, is_low) = match view.battery {
        Some(battery) => {
            let percent = battery.percent;
            let words = Words::new(format_args!("battery {percent:3} %"));
            (words, percent <= BATTERY_LOW_PERCENT)
        }
        None => (Words::new(format_args!("battery  -- %")), false),
    };
    let colour = if is_low { WARNING } else { PAPER };
    text(
        tile,
        Point::new(388, 6),
        words.as_str(),
        &FONT_6X13_BOLD,
        colour,
    );
}

fn field(tile: &mut Tile, button: &Button, view: &View<'_>, page: Page) {
    let is_lit = layout::is_lit(button.action, page, view.mode, view.switches);
    let (ground, ink) = if is_lit { (LIT, PAPER) } else { (FIELD, INK) };
    fill(tile, &button.area, ground);
    outline(tile, &button.area, BAR);
    let letters = i32::try_from(button.label.len()).unwrap_or(0);
    let at = button.area.center() - Point::new(letters * 3, 6);
    text(tile, at, button.label, &FONT_6X13_BOLD, ink);
}

/// Draws the current target.
fn target(tile: &mut Tile, view: &View<'_>) {
    let list = view.waypoints;
    let words = match list.target() {
        Some(target) => {
            let [x, y] = target.position_mm;
            let (number, all) = (list.reached() + 1, list.all().len());
            Words::new(format_args!("waypoint {number} of {all}: {x}, {y} mm"))
        }
        None if list.is_empty() => Words::new(format_args!("no waypoints")),
        None => Words::new(format_args!("all {} waypoints reached", list.all().len())),
    };
    text(tile, Point::new(218, 200), words.as_str(), &FONT_6X10, INK);
    let hint = if view.switches.waypoints {
        "touch the map: next waypoint"
    } else {
        "touch the map: robot is here"
    };
    text(tile, Point::new(218, 216), hint, &FONT_6X10, INK);
}

fn figures(tile: &mut Tile, view: &View<'_>) {
    let [x, y, heading] = view.figures.pose;
    let millivolts = view.battery.map_or(0, |battery| battery.millivolts);
    let figures = view.figures;
    let lines = [
        Words::new(format_args!("x {x} mm  y {y} mm  heading {heading}")),
        Words::new(format_args!("battery voltage {millivolts:8} mV")),
        Words::new(format_args!("scans           {:8}", figures.scans)),
        Words::new(format_args!(
            "lidar lost      {:8} packets",
            figures.lost_packets
        )),
        Words::new(format_args!("base retries    {:8}", figures.base_retries)),
        Words::new(format_args!("map rows to PC  {:8}", figures.rows_sent)),
        Words::new(format_args!("waypoints done  {:8}", figures.arrivals)),
    ];
    for (number, words) in (0..).zip(&lines) {
        let at = Point::new(218, 36 + 16 * number);
        text(tile, at, words.as_str(), &FONT_6X10, INK);
    }
}

fn messages(tile: &mut Tile, notices: &Notices) {
    for (number, entry) in (0..).zip(notices.newest().take(MESSAGES_SHOWN)) {
        let Entry { at_s, notice } = entry;
        let words = Words::new(format_args!("{at_s:5} s  {}", notice.text()));
        let colour = if notice.is_warning() { WARNING } else { INK };
        let at = Point::new(218, 30 + 13 * number);
        text(tile, at, words.as_str(), &FONT_6X10, colour);
    }
}
