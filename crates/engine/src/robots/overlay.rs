//! What a robot has to show besides maps, ways and scans: drawn over the world by page and report.

use serde::Serialize;

/// Maximum number of coordinates of an overlay, so that it stays small on its way to a page.
const NUMBERS_MAX: usize = 4_000;

/// Lines and points of one meaning, in the frame of the world, metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overlay {
    /// What it is, e.g. `roadmap`: people switch it on and off by this name.
    pub name: &'static str,
    /// What it means, by which it has its colour.
    pub role: OverlayRole,
    /// Polylines: x and y of each corner in turn.
    lines: Vec<Vec<f64>>,
    /// Single places: x and y in turn.
    points: Vec<f64>,
    /// Lines and points beyond the most that are shown.
    left_out: usize,
    /// Coordinates so far.
    #[serde(skip)]
    numbers: usize,
}

/// What an overlay means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OverlayRole {
    /// The robot has measured it: walls of a scan, ranges.
    Sensed,
    /// It could be driven: roadmaps, primitives.
    Possible,
    /// It is to be driven: plans, via points.
    Planned,
    /// Where something may be: particles, second best places.
    Guess,
    /// It stands out in the world: markers, gates, goals.
    Mark,
}

impl Overlay {
    /// Nothing yet.
    pub const fn new(name: &'static str, role: OverlayRole) -> Self {
        Self {
            name,
            role,
            lines: Vec::new(),
            points: Vec::new(),
            left_out: 0,
            numbers: 0,
        }
    }

    /// With a line from place to place. One with a place that is not finite, or beyond the most
    /// that are shown, is counted only.
    #[must_use]
    pub fn line(mut self, places: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let line: Vec<f64> = places.into_iter().flatten().map(millimetres).collect();
        if self.has_room(&line) {
            self.lines.push(line);
        } else {
            self.left_out += 1;
        }
        self
    }

    /// With a single place, likewise.
    #[must_use]
    pub fn point(mut self, place: [f64; 2]) -> Self {
        let place = place.map(millimetres);
        if self.has_room(&place) {
            self.points.extend(place);
        } else {
            self.left_out += 1;
        }
        self
    }

    /// Polylines: x and y of each corner in turn.
    pub fn lines(&self) -> &[Vec<f64>] {
        &self.lines
    }

    /// Single places: x and y in turn.
    pub fn points(&self) -> &[f64] {
        &self.points
    }

    /// Whether there is nothing to draw.
    pub const fn is_empty(&self) -> bool {
        self.lines.is_empty() && self.points.is_empty()
    }

    /// Lines and points that are not shown.
    pub const fn left_out(&self) -> usize {
        self.left_out
    }

    fn has_room(&mut self, numbers: &[f64]) -> bool {
        let is_finite = numbers.iter().all(|number| number.is_finite());
        let has_room = is_finite && self.numbers + numbers.len() <= NUMBERS_MAX;
        self.numbers += if has_room { numbers.len() } else { 0 };
        has_room
    }
}

/// Metres in whole millimetres: what can be seen, in few digits.
pub fn millimetres(metres: f64) -> f64 {
    // No -0: a page would not tell it from 0.
    (metres * 1000.0).round() / 1000.0 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1000 lines of four numbers fill it; a place that is none is no place.
    #[test]
    fn an_overlay_is_bounded_and_says_what_it_leaves_out() {
        let full = (0..1_001).fold(Overlay::new("many", OverlayRole::Possible), |all, _| {
            all.line([[0.0, 1.000_4], [2.0, -0.000_1]])
        });
        assert_eq!((full.lines().len(), full.left_out()), (1_000, 1));
        assert_eq!(full.lines()[0], [0.0, 1.0, 2.0, 0.0]);
        assert_eq!(full.point([1.0, 2.0]).left_out(), 2);
        let odd = Overlay::new("odd", OverlayRole::Guess).point([f64::NAN, 0.0]);
        assert_eq!((odd.points(), odd.left_out()), (&[][..], 1));
    }
}
