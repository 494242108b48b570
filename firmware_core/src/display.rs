//! A touch display that stores the picture. The program draws each tile into a small buffer and
//! sends only rows that changed.
//!
//! ```text
//!   draw --> tile of 8 rows --> rows whose sum changed --> queue --> line --> display
//!   taps <-- pen down after pen up  <------------------------------- line <-- touch
//! ```
//!
//! A picture of 480 x 272 pixels takes 255 kB, twice the memory of the board. The program stores a
//! sum of 16 bits for each row sent. A changed row with an equal sum (one change in 65536) is not
//! sent, and damage on the line is not noticed. Therefore one tile is resent three times a second
//! whether it changed or not, which repairs the whole picture within half a minute.

use core::convert::Infallible;
use core::ops::RangeInclusive;
use core::time::Duration;

use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{Dimensions, Point, Size};
use embedded_graphics::pixelcolor::{IntoStorage, Rgb565};
use embedded_graphics::primitives::Rectangle;
use protocols::panel::{self, Contact, FRAME_MAX, PEN_LEN, READING_MAX, Window, encode_pixels};
use protocols::{Decode, Instant};

use crate::fifo::Fifo;

/// Columns of the display.
pub const WIDTH: u16 = 480;
/// Rows of the display.
pub const HEIGHT: u16 = 272;
/// First column of the widest tiles; content that changes often is left of it.
pub const RIGHT: u16 = 212;

/// Rows of a tile.
const BAND: u16 = 8;
const BANDS: usize = (HEIGHT / BAND) as usize;
const ROWS: usize = HEIGHT as usize;
const TILES: usize = COLUMNS.len() * BANDS;
/// All bands of a column.
const ALL_BANDS: u64 = (1 << BANDS) - 1;
const TILE_PIXELS: usize = (WIDTH - RIGHT) as usize * BAND as usize;
/// Longest frame of one row of a tile.
const ROW_FRAME_MAX: usize = FRAME_MAX - 2 * RIGHT as usize;
/// Room for two such rows, or for a typical tile.
const TX_LEN: usize = 1536;
const TX_ENOUGH: usize = 1280;
const _: () = assert!(
    ROW_FRAME_MAX <= TX_ENOUGH,
    "a row must fit to be sent at all"
);

/// Period after which the next tile is sent again, changed or not.
const HEAL_PERIOD: Duration = Duration::from_millis(333);
/// Idle time after which a partial report is discarded.
const IDLE_GAP: Duration = Duration::from_millis(10);
/// Time without a message of the pen after which it counts as lifted.
const LIFTED_AFTER: Duration = Duration::from_millis(100);

/// Part of the picture that is being drawn: 8 rows of one column.
#[derive(Clone, Debug)]
pub struct Tile {
    left: u16,
    top: u16,
    width: u16,
    pixels: [u16; TILE_PIXELS],
}

impl Tile {
    fn new(column: usize, band: usize) -> Self {
        let (left, width) = COLUMNS[column];
        Self {
            left,
            top: *rows_of(band).start(),
            width,
            pixels: [0; TILE_PIXELS],
        }
    }

    /// Whether the tile contains any part of `area`; otherwise `area` need not be drawn.
    pub fn touches(&self, area: &Rectangle) -> bool {
        self.bounding_box().intersection(area).size != Size::zero()
    }

    /// The part of `area` in the tile: columns and rows.
    pub fn part_of(&self, area: &Rectangle) -> (core::ops::Range<i32>, core::ops::Range<i32>) {
        let part = self.bounding_box().intersection(area);
        (part.columns(), part.rows())
    }

    /// The pixels of `columns` in row `y`; empty if any of them is outside the tile.
    pub fn pixels_mut(&mut self, y: i32, columns: core::ops::Range<i32>) -> &mut [u16] {
        let inside = |at: i32, from: u16| usize::try_from(at - i32::from(from)).ok();
        let place = |x: i32| {
            let (x, y) = (inside(x, self.left)?, inside(y, self.top)?);
            (x <= self.width.into() && y < BAND.into()).then(|| y * usize::from(self.width) + x)
        };
        let pixels = place(columns.start).zip(place(columns.end));
        let pixels = pixels.and_then(|(from, to)| self.pixels.get_mut(from..to));
        pixels.unwrap_or_default()
    }

    /// Draws one pixel; outside the tile nothing happens.
    pub fn put(&mut self, x: i32, y: i32, colour: Rgb565) {
        let (x, y) = (x - i32::from(self.left), y - i32::from(self.top));
        if (0..i32::from(self.width)).contains(&x) && (0..i32::from(BAND)).contains(&y) {
            let index = y * i32::from(self.width) + x;
            self.pixels[usize::try_from(index).expect("not negative")] = colour.into_storage();
        }
    }

    fn row(&self, row: u16) -> &[u16] {
        let width = usize::from(self.width);
        let from = usize::from(row) * width;
        &self.pixels[from..from + width]
    }
}

/// First column of each column of tiles, and its width.
const COLUMNS: [(u16, u16); 3] = [
    (0, RIGHT / 2),
    (RIGHT / 2, RIGHT / 2),
    (RIGHT, WIDTH - RIGHT),
];

impl Dimensions for Tile {
    fn bounding_box(&self) -> Rectangle {
        Rectangle::new(
            Point::new(self.left.into(), self.top.into()),
            Size::new(self.width.into(), BAND.into()),
        )
    }
}

impl DrawTarget for Tile {
    type Color = Rgb565;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb565>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Infallible> {
        for Pixel(at, colour) in pixels {
            self.put(at.x, at.y, colour);
        }
        Ok(())
    }

    fn fill_solid(&mut self, area: &Rectangle, colour: Rgb565) -> Result<(), Infallible> {
        let (columns, rows) = self.part_of(area);
        let inside = |at: i32, from: u16| usize::try_from(at - i32::from(from)).unwrap_or(0);
        for y in rows {
            let row = inside(y, self.top) * usize::from(self.width);
            let [from, to] = [columns.start, columns.end].map(|x| row + inside(x, self.left));
            self.pixels[from..to].fill(colour.into_storage());
        }
        Ok(())
    }
}

/// Counters of the link since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Rows sent.
    pub rows: u32,
    /// Taps.
    pub taps: u32,
    /// Reports that were damaged or invalid.
    pub bad_reports: u32,
}

/// The program's end of the link.
#[derive(Clone, Debug)]
pub struct Display {
    tx: Fifo<TX_LEN>,
    /// Sum of each row of each column as last sent.
    sums: [[u16; ROWS]; COLUMNS.len()],
    /// Tiles of each column that may have changed, one bit a band.
    dirty: [u64; COLUMNS.len()],
    /// Tile that is checked next.
    next: usize,
    heal: usize,
    heal_at: Instant,
    decoder: panel::PenDecoder,
    received_at: Instant,
    /// Time at which the pen was last down; `None` once it was lifted.
    down_at: Option<Instant>,
    counters: Counters,
}

impl Display {
    /// A display that has shown nothing yet.
    pub const fn new() -> Self {
        Self {
            tx: Fifo::new(),
            sums: [[0; ROWS]; COLUMNS.len()],
            dirty: [ALL_BANDS; COLUMNS.len()],
            next: 0,
            heal: 0,
            heal_at: Instant::ZERO,
            decoder: panel::PenDecoder::with_format(panel::Framing::<PEN_LEN>),
            received_at: Instant::ZERO,
            down_at: None,
            counters: Counters {
                rows: 0,
                taps: 0,
                bad_reports: 0,
            },
        }
    }

    /// The counters so far.
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Notes that the picture in `area` may have changed.
    pub fn mark(&mut self, area: &Rectangle) {
        let Some(last) = area.bottom_right() else {
            return;
        };
        let bottom = i32::from(HEIGHT) - 1;
        let band = |y: i32| y.clamp(0, bottom) / i32::from(BAND);
        for (dirty, (left, width)) in self.dirty.iter_mut().zip(COLUMNS) {
            if area.top_left.x < i32::from(left + width) && last.x >= i32::from(left) {
                for band in band(area.top_left.y)..=band(last.y) {
                    *dirty |= 1 << band;
                }
            }
        }
    }

    /// Whether [`paint`](Self::paint) would draw or resend a tile.
    pub fn has_work(&self, now: Instant) -> bool {
        let is_dirty = self.dirty.iter().any(|&bands| bands != 0);
        self.tx.room() >= TX_ENOUGH && (is_dirty || now >= self.heal_at)
    }

    /// Draws one tile that may have changed, if there is room to send it. `draw` must draw
    /// everything visible, or at least everything that touches the tile.
    pub fn paint(&mut self, now: Instant, draw: impl FnOnce(&mut Tile)) {
        // A tile that does not fit is drawn again, so drawing waits until there is room for most
        // tiles.
        if self.tx.room() < TX_ENOUGH {
            return;
        }
        if now >= self.heal_at {
            self.send_anew(now);
        }
        let Some((column, band)) = self.next_tile() else {
            return;
        };
        let mut tile = Tile::new(column, band);
        draw(&mut tile);
        if self.send(&tile, column) {
            self.dirty[column] &= !(1 << band);
            self.next += 1;
        }
    }

    /// Takes reports of the pen; returns the position at which a tap began.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) -> Option<[u16; 2]> {
        if now - self.received_at >= IDLE_GAP {
            self.decoder.idle();
        }
        self.received_at = now;
        let mut tap = None;
        let mut input = bytes;
        while let Some(frame) = self.decoder.step(&mut input) {
            let Some(pen) = frame.ok().and_then(|frame| frame.pen()) else {
                self.counters.bad_reports = self.counters.bad_reports.saturating_add(1);
                continue;
            };
            let was_up = self.down_at.is_none_or(|at| now - at >= LIFTED_AFTER);
            self.down_at = (pen.contact == Contact::Down).then_some(now);
            if was_up && pen.contact == Contact::Down {
                self.counters.taps = self.counters.taps.saturating_add(1);
                let [x, y] = pen.reading;
                tap = Some([scaled(x, WIDTH), scaled(y, HEIGHT)]);
            }
        }
        tap
    }

    /// Whether bytes wait for the line.
    pub const fn has_output(&self) -> bool {
        !self.tx.is_empty()
    }

    /// Moves bytes for the line into `buf`; returns how many.
    pub fn transmit(&mut self, buf: &mut [u8]) -> usize {
        self.tx.pop(buf)
    }

    /// The next tile that may have changed; the search starts at the position of the last one.
    fn next_tile(&mut self) -> Option<(usize, usize)> {
        let first = self.next % TILES;
        // Search one full round, including the part of the first column before the start.
        for step in 0..=COLUMNS.len() {
            let column = (first / BANDS + step) % COLUMNS.len();
            let from = if step == 0 { first % BANDS } else { 0 };
            let left = self.dirty[column] >> from << from;
            if left != 0 {
                let band = left.trailing_zeros() as usize;
                self.next = column * BANDS + band;
                return Some((column, band));
            }
        }
        None
    }

    /// Marks one tile as not sent, and switches the display on in case it was restarted.
    fn send_anew(&mut self, now: Instant) {
        self.heal_at = now + HEAL_PERIOD;
        self.tx.push(&panel::encode_switch(panel::ON));
        let (column, band) = (self.heal / BANDS, self.heal % BANDS);
        self.heal = (self.heal + 1) % (TILES);
        self.dirty[column] |= 1 << band;
        for row in rows_of(band) {
            self.sums[column][usize::from(row)] = 0;
        }
    }

    /// Queues the changed rows; returns whether there was room for all of them.
    fn send(&mut self, tile: &Tile, column: usize) -> bool {
        let mut frame = [0; ROW_FRAME_MAX];
        for row in 0..BAND {
            let y = tile.top + row;
            let pixels = tile.row(row);
            let sum = sum_of(pixels);
            let sent = &mut self.sums[column][usize::from(y)];
            if *sent == sum {
                continue;
            }
            let window = Window {
                columns: [tile.left, tile.left + tile.width - 1],
                rows: [y, y],
            };
            let len = encode_pixels(window, pixels, &mut frame).expect("a row fits its frame");
            if self.tx.room() < len {
                return false;
            }
            self.tx.push(&frame[..len]);
            *sent = sum;
            self.counters.rows = self.counters.rows.saturating_add(1);
        }
        true
    }
}

impl Default for Display {
    fn default() -> Self {
        Self::new()
    }
}

fn rows_of(band: usize) -> RangeInclusive<u16> {
    let top = u16::try_from(band).expect("a few dozen") * BAND;
    top..=top + BAND - 1
}

/// A sum of 16 bits over a row's pixels, never 0: 0 marks a row that was not sent.
fn sum_of(pixels: &[u16]) -> u16 {
    let mixed = pixels.iter().fold(0x811C_9DC5_u32, |sum, &pixel| {
        (sum ^ u32::from(pixel)).wrapping_mul(0x0100_0193)
    });
    let folded = (mixed >> 16) ^ (mixed & 0xFFFF);
    u16::try_from(folded).expect("sixteen bits").max(1)
}

/// The pixel of a touch reading: 0 to 4095 covers the whole panel.
fn scaled(reading: u16, pixels: u16) -> u16 {
    let place = u32::from(reading) * u32::from(pixels) / (u32::from(READING_MAX) + 1);
    u16::try_from(place).expect("less than the pixels")
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec;
    use std::vec::Vec;

    use embedded_graphics::prelude::*;
    use embedded_graphics::primitives::PrimitiveStyle;
    use protocols::panel::{Command, Pen, encode_pen};

    use super::*;

    const EVERYTHING: Rectangle =
        Rectangle::new(Point::zero(), Size::new(WIDTH as u32, HEIGHT as u32));

    /// The picture on the display, from commands of whole rows.
    struct Far {
        decoder: panel::Decoder,
        pixels: Vec<u16>,
        rows: usize,
    }

    impl Far {
        fn take(&mut self, display: &mut Display) {
            let mut buf = [0; 64];
            while let len @ 1.. = display.transmit(&mut buf) {
                let frames: Vec<_> = self.decoder.push(&buf[..len]).flatten().collect();
                frames.iter().for_each(|frame| self.draw(frame));
            }
        }

        fn draw(&mut self, frame: &panel::Frame) {
            let (window, pixels) = match frame.command() {
                Some(Command::Write(window, bytes)) => {
                    let pixels = bytes.chunks_exact(2);
                    let pixel = |pixel: &[u8]| u16::from_be_bytes([pixel[0], pixel[1]]);
                    (window, pixels.map(pixel).collect::<Vec<_>>())
                }
                Some(Command::Runs(window, bytes)) => {
                    let run =
                        |run: &[u8]| vec![u16::from_be_bytes([run[1], run[2]]); run[0].into()];
                    (window, bytes.chunks_exact(3).flat_map(run).collect())
                }
                _ => return,
            };
            let at = usize::from(window.rows[0]) * 480 + usize::from(window.columns[0]);
            self.pixels[at..at + pixels.len()].copy_from_slice(&pixels);
            self.rows += 1;
        }
    }

    fn far() -> Far {
        Far {
            decoder: panel::Decoder::default(),
            pixels: vec![0; 480 * 272],
            rows: 0,
        }
    }

    /// Paints until no work is left, all at `now`.
    fn paint(display: &mut Display, far: &mut Far, now: Instant, area: Rectangle) {
        display.mark(&EVERYTHING);
        for _ in 0..1000 {
            display.paint(now, |tile| {
                let style = PrimitiveStyle::with_fill(Rgb565::RED);
                let Ok(()) = area.into_styled(style).draw(tile);
            });
            far.take(display);
        }
    }

    /// A rectangle across all tiles' borders; then it moves by one column, and only its 100 rows,
    /// in two columns of tiles, are sent again.
    #[test]
    fn what_is_drawn_arrives_and_only_changed_rows_are_sent() {
        let (mut display, mut far) = (Display::new(), far());
        let area = |x| Rectangle::new(Point::new(x, 51), Size::new(100, 100));
        paint(&mut display, &mut far, Instant::ZERO, area(150));
        let red = Rgb565::RED.into_storage();
        for (index, &pixel) in far.pixels.iter().enumerate() {
            let (x, y) = (index % 480, index / 480);
            let inside = (150..250).contains(&x) && (51..151).contains(&y);
            assert_eq!(pixel, if inside { red } else { 0 }, "{x} {y}");
        }
        far.rows = 0;
        paint(&mut display, &mut far, Instant::ZERO, area(151));
        assert_eq!(far.rows, 200);
    }

    /// Everything is sent and the line is free: there is no work until the next tile is resent, a
    /// third of a second after the last, or until a change.
    #[test]
    fn a_display_that_shows_all_has_no_work() {
        let (mut display, mut far) = (Display::new(), far());
        let area = Rectangle::new(Point::new(10, 10), Size::new(400, 200));
        assert!(display.has_work(Instant::ZERO));
        paint(&mut display, &mut far, Instant::ZERO, area);
        assert!(!display.has_work(Instant::from_millis(332)));
        assert!(display.has_work(Instant::from_millis(333)));
        display.mark(&Rectangle::new(Point::new(479, 271), Size::new(1, 1)));
        assert!(display.has_work(Instant::from_millis(1)));
    }

    /// The display lost its picture; each of the 102 tiles is resent, three a second.
    #[test]
    fn a_damaged_picture_is_mended_within_half_a_minute() {
        let (mut display, mut far) = (Display::new(), far());
        let area = Rectangle::new(Point::new(10, 10), Size::new(400, 200));
        paint(&mut display, &mut far, Instant::ZERO, area);
        let whole = core::mem::replace(&mut far.pixels, vec![0x1234; 480 * 272]);
        for thirds in 0..=102 {
            let now = Instant::from_millis(thirds * 333);
            paint(&mut display, &mut far, now, area);
        }
        assert!(far.pixels == whole);
    }

    fn report(contact: Contact, reading: [u16; 2]) -> [u8; PEN_LEN] {
        encode_pen(Pen { contact, reading })
    }

    /// 2052 of 4096 is column 240 of 480; a lost "up" or a lost "down" makes no tap of its own.
    #[test]
    fn a_tap_is_a_pen_that_was_up_and_is_down() {
        let mut display = Display::new();
        let mut at = 0;
        let mut tap = |contact, wait| {
            at += wait;
            display.receive(Instant::from_millis(at), &report(contact, [2052, 7]))
        };
        assert_eq!(tap(Contact::Down, 20), Some([240, 0]));
        assert_eq!(tap(Contact::Down, 20), None);
        assert_eq!(tap(Contact::Up, 20), None);
        assert_eq!(tap(Contact::Down, 20), Some([240, 0]));
        assert_eq!(tap(Contact::Down, 200), Some([240, 0]));
    }

    /// Garbage, then a pause: the next report counts.
    #[test]
    fn garbage_costs_no_tap_behind_a_pause() {
        let mut display = Display::new();
        assert_eq!(
            display.receive(Instant::ZERO, &[0x7E, 0x54, 0, 5, 1, 0]),
            None
        );
        let down = report(Contact::Down, [0, 0]);
        assert_eq!(
            display.receive(Instant::from_millis(20), &down),
            Some([0, 0])
        );
        assert_eq!(display.counters().bad_reports, 1);
    }

    fn area(x: i32, y: i32, width: u32, height: u32) -> Rectangle {
        Rectangle::new(Point::new(x, y), Size::new(width, height))
    }

    /// Columns begin at 0, 106 and 212; bands have 8 rows each, the last band is 33. A change
    /// beyond the edge marks the band at the edge, an empty change marks none.
    #[test]
    fn what_changed_is_marked_by_columns_and_bands() {
        let marked = |changed: Rectangle| {
            let mut display = Display::new();
            display.dirty = [0; 3];
            display.mark(&changed);
            display.dirty
        };
        assert_eq!(marked(area(105, 7, 1, 1)), [1, 0, 0]);
        assert_eq!(marked(area(106, 8, 1, 1)), [0, 2, 0]);
        assert_eq!(marked(area(105, 15, 2, 2)), [0b110, 0b110, 0]);
        assert_eq!(marked(area(211, 40, 2, 1)), [0, 32, 32]);
        assert_eq!(marked(area(212, 40, 268, 9)), [0, 0, 96]);
        assert_eq!(marked(area(0, -20, 10, 21)), [1, 0, 0]);
        assert_eq!(marked(area(300, 270, 10, 30)), [0, 0, 1 << 33]);
        assert_eq!(marked(area(-10, 0, 10, 8)), [0; 3]);
        assert_eq!(marked(area(479, 0, 50, 272)), [0, 0, (1 << 34) - 1]);
        assert_eq!(marked(area(480, 0, 50, 272)), [0; 3]);
        assert_eq!(marked(area(5, 5, 0, 9)), [0; 3]);
    }

    /// The widest column's third band: columns 212 to 479, rows 16 to 23.
    #[test]
    fn a_tile_holds_what_lies_in_it() {
        let mut tile = Tile::new(2, 2);
        assert!(tile.touches(&area(0, 0, 213, 17)) && !tile.touches(&area(0, 0, 213, 16)));
        assert!(!tile.touches(&area(0, 0, 212, 300)) && tile.touches(&area(479, 23, 9, 9)));
        assert!(!tile.touches(&area(400, 24, 9, 9)) && !tile.touches(&area(480, 20, 9, 9)));
        assert_eq!(tile.part_of(&area(200, 20, 20, 20)), (212..220, 20..24));
        tile.put(212, 16, Rgb565::RED);
        tile.put(479, 23, Rgb565::GREEN);
        let inside = tile.pixels;
        for (x, y) in [(211, 16), (480, 16), (300, 15), (300, 24), (0, 0)] {
            tile.put(x, y, Rgb565::BLUE);
        }
        assert!(tile.pixels == inside);
        assert_eq!(tile.pixels[0], Rgb565::RED.into_storage());
        assert_eq!(tile.pixels[7 * 268 + 267], Rgb565::GREEN.into_storage());
        assert_eq!(tile.row(7)[267], Rgb565::GREEN.into_storage());
        let Ok(()) = tile.fill_solid(&area(210, 18, 4, 2), Rgb565::WHITE);
        let white = Rgb565::WHITE.into_storage();
        assert_eq!([tile.row(2)[1], tile.row(3)[0]], [white; 2]);
        assert_eq!(
            tile.pixels.iter().filter(|pixel| **pixel == white).count(),
            4
        );
    }

    /// Pixels of a row by their columns on the display; none if one of them belongs to another
    /// tile.
    #[test]
    fn pixels_of_a_tile_are_found_by_their_place() {
        let mut tile = Tile::new(1, 1);
        tile.pixels_mut(9, 110..113).fill(7);
        assert_eq!(tile.pixels[106 + 3..106 + 8], [0, 7, 7, 7, 0]);
        let mut len = |y, columns| tile.pixels_mut(y, columns).len();
        assert_eq!(
            [len(8, 106..212), len(15, 211..212), len(15, 106..106)],
            [106, 1, 0]
        );
        assert_eq!([len(8, 106..213), len(8, 105..212)], [0; 2]);
        assert_eq!([len(7, 106..212), len(16, 106..212)], [0; 2]);
    }

    /// From the third band of the second column on: the rest of that column, the next two columns,
    /// and at last the start of the second column.
    #[test]
    fn tiles_take_turns() {
        let mut display = Display::new();
        display.next = 34 + 2;
        display.dirty = [1 << 5, 0b11, 1 << 33];
        let mut turns = Vec::new();
        while let Some((column, band)) = display.next_tile() {
            display.dirty[column] &= !(1 << band);
            display.next += 1;
            turns.push((column, band));
        }
        assert_eq!(turns, [(2, 33), (0, 5), (1, 0), (1, 1)]);
        display.dirty[1] = 1 << 2;
        display.next = 102 + 36;
        assert_eq!((display.next_tile(), display.next), (Some((1, 2)), 36));
    }

    /// The FNV-1a hash (Fowler, Noll and Vo) of a zero is 0x050C5D1F, folded to 16 bits 0x5813.
    /// Each 8 rows are a band.
    #[test]
    fn a_row_is_remembered_by_sixteen_bits() {
        assert_eq!(sum_of(&[0]), 0x5813);
        assert_eq!(sum_of(&[]), 0x811C ^ 0x9DC5);
        assert_ne!(sum_of(&[1, 2]), sum_of(&[2, 1]));
        assert_eq!([rows_of(0), rows_of(33)], [0..=7, 264..=271]);
    }

    /// The panel has 4096 readings across for 480 pixels: 4095 is in the last pixel, 8 still in the
    /// first, 9 in the second.
    #[test]
    fn a_reading_lies_in_a_pixel() {
        let across = [0, 8, 9, 2047, 2048, 4095].map(|reading| scaled(reading, WIDTH));
        assert_eq!(across, [0, 0, 1, 239, 240, 479]);
        assert_eq!(scaled(4095, HEIGHT), 271);
    }

    /// A pen is down for up to a tenth of a second without a message; half a report is kept for
    /// less than 10 ms. Taps and sent rows are counted.
    #[test]
    fn a_pen_and_a_report_are_given_up_when_nothing_comes() {
        let down = report(Contact::Down, [0, 0]);
        let second_tap = |millis: u64| {
            let mut display = Display::new();
            display.receive(Instant::from_millis(50), &down);
            display.receive(Instant::from_millis(50 + millis), &down);
            display.counters().taps
        };
        assert_eq!([second_tap(99), second_tap(100)], [1, 2]);
        let halves = |millis: u64| {
            let mut display = Display::new();
            display.receive(Instant::from_millis(50), &down[..4]);
            display.receive(Instant::from_millis(50 + millis), &down[4..]);
            display.counters().taps
        };
        assert_eq!([halves(9), halves(10)], [1, 0]);
    }

    /// A tile is resent at once and each third of a second: the display is switched on again, the
    /// tile's sums are cleared, and after the last tile the first one follows.
    #[test]
    fn tiles_are_sent_anew_in_turn() {
        let mut display = Display::new();
        (display.dirty, display.sums) = ([0; 3], [[5; ROWS]; 3]);
        display.heal = 34 + 33;
        display.send_anew(Instant::from_millis(7));
        assert_eq!(display.heal_at, Instant::from_millis(340));
        assert_eq!((display.dirty, display.heal), ([0, 1 << 33, 0], 68));
        let forgotten = |sums: &[u16]| sums.iter().filter(|sum| **sum == 0).count();
        assert_eq!(display.sums.map(|sums| forgotten(&sums)), [0, 8, 0]);
        assert_eq!(display.sums[1][263..265], [5, 0]);
        let mut buf = [0; 64];
        let len = display.transmit(&mut buf);
        assert_eq!(buf[..len], panel::encode_switch(panel::ON));
        display.heal = 101;
        display.send_anew(Instant::from_millis(400));
        assert_eq!((display.heal, display.dirty[2]), (0, 1 << 33));
    }

    /// A tile of 8 rows of 268 pixels as noise takes 543 bytes a row: two rows fit at a time, and
    /// the remaining rows are sent with the next ones.
    #[test]
    fn a_tile_that_does_not_fit_goes_on_where_it_stopped() {
        let (mut display, mut far) = (Display::new(), far());
        display.dirty = [0, 0, 1];
        display.heal_at = Instant::from_millis(1_000);
        let mut noise = 1_u16;
        let mut tile = Tile::new(2, 0);
        for pixel in &mut tile.pixels {
            noise = noise.wrapping_mul(25_173).wrapping_add(13_849);
            *pixel = noise;
        }
        let mut rows = Vec::new();
        while display.has_work(Instant::ZERO) {
            display.paint(Instant::ZERO, |drawn| drawn.pixels = tile.pixels);
            assert!(display.has_output());
            rows.push(display.counters().rows);
            far.take(&mut display);
        }
        assert_eq!(rows, [2, 4, 6, 8]);
        assert_eq!(far.pixels[480 * 7 + 212..][..268], *tile.row(7));
        assert_eq!((display.dirty, display.has_output()), ([0; 3], false));
    }

    /// A tile is drawn if 1280 of the 1536 bytes of the queue are free, and not if fewer are.
    #[test]
    fn a_tile_waits_until_there_is_room_to_send_it() {
        let drawn = |queued: usize| {
            let mut display = Display::new();
            assert!(display.tx.push(&[0; 300][..queued]));
            let (has_work, mut is_drawn) = (display.has_work(Instant::ZERO), false);
            display.paint(Instant::ZERO, |_| is_drawn = true);
            [has_work, is_drawn]
        };
        assert_eq!([256, 257].map(drawn), [[true; 2], [false; 2]]);
    }
}
