//! Drawings of a robot in addition to maps, paths and scans, shown over the world by page and
//! report.

use serde::Serialize;

/// Maximum number of coordinates in an overlay, to limit its size.
const NUMBERS_MAX: usize = 4_000;

/// Lines and points with one meaning, in the frame of the world, metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overlay {
    /// Name, e.g. `roadmap`: users show and hide the overlay by this name.
    pub name: &'static str,
    /// Meaning, which determines the colour.
    pub role: OverlayRole,
    /// Polylines: x and y of each corner alternately.
    lines: Vec<Vec<f64>>,
    /// Points: x and y alternately.
    points: Vec<f64>,
    /// Number of lines and points beyond the limit.
    left_out: usize,
    /// Number of coordinates so far.
    #[serde(skip)]
    numbers: usize,
}

/// The meaning of an overlay.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum OverlayRole {
    /// Measurements: walls of a scan, ranges.
    Sensed,
    /// Possible paths: roadmaps, primitives.
    Possible,
    /// Planned paths: plans, via points.
    Planned,
    /// Hypotheses: particles, second best poses.
    Guess,
    /// Landmarks: markers, gates, goals.
    Mark,
}

impl Overlay {
    /// An empty overlay.
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

    /// Adds a line through positions. A line beyond the limit, or with a position that is not
    /// finite, is only counted.
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

    /// Adds a point, with the same rules.
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

    /// Polylines: x and y of each corner alternately.
    pub fn lines(&self) -> &[Vec<f64>] {
        &self.lines
    }

    /// Points: x and y alternately.
    pub fn points(&self) -> &[f64] {
        &self.points
    }

    /// Whether the overlay is empty.
    pub const fn is_empty(&self) -> bool {
        self.lines.is_empty() && self.points.is_empty()
    }

    /// Number of lines and points that were left out.
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

/// Rounds metres to whole millimetres.
pub fn millimetres(metres: f64) -> f64 {
    // Avoids -0, which a page would print differently from 0.
    (metres * 1000.0).round() / 1000.0 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1000 lines of four numbers fill the overlay; NaN is not a position.
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
