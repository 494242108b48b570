//! Curves over a common axis, as a scalable picture (SVG).

use core::fmt::Write as _;

use super::table::rounded;
use show::html::escape;

/// Size of the picture, and its margins: left, right, top, bottom.
const SIZE: [f64; 2] = [720.0, 420.0];
const MARGINS: [f64; 4] = [70.0, 170.0, 40.0, 50.0];
/// Colours that are distinct for every type of colour vision (Okabe and Ito, 2008).
const COLOURS: [&str; 7] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000",
];
/// Approximate number of marks along an axis.
const TICKS: f64 = 6.0;

/// Scale of an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Scale {
    /// Linear.
    #[default]
    Even,
    /// By factors.
    Logarithmic,
}

/// A curve, or single points.
#[derive(Clone, Debug, PartialEq)]
struct Curve {
    name: String,
    places: Vec<[f64; 2]>,
    is_line: bool,
}

/// A picture of curves.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    title: String,
    axes: [String; 2],
    scale: Scale,
    curves: Vec<Curve>,
}

impl Plot {
    /// An empty plot with the names of both axes and their units.
    pub fn new(title: impl Into<String>, axes: [&str; 2]) -> Self {
        Self {
            title: title.into(),
            axes: axes.map(str::to_owned),
            scale: Scale::Even,
            curves: Vec::new(),
        }
    }

    /// Makes the horizontal axis logarithmic.
    #[must_use]
    pub fn by_factors(mut self) -> Self {
        self.scale = Scale::Logarithmic;
        self
    }

    /// Adds a curve; points that are not finite are left out.
    #[must_use]
    pub fn line(self, name: impl Into<String>, places: impl IntoIterator<Item = [f64; 2]>) -> Self {
        self.with(name.into(), places, true)
    }

    /// Adds single points.
    #[must_use]
    pub fn points(
        self,
        name: impl Into<String>,
        places: impl IntoIterator<Item = [f64; 2]>,
    ) -> Self {
        self.with(name.into(), places, false)
    }

    fn with(
        mut self,
        name: String,
        places: impl IntoIterator<Item = [f64; 2]>,
        is_line: bool,
    ) -> Self {
        let is_sound = |place: &[f64; 2]| place.iter().all(|value| value.is_finite());
        self.curves.push(Curve {
            name,
            places: places.into_iter().filter(is_sound).collect(),
            is_line,
        });
        self
    }

    /// Minimum and maximum along an axis; the range is never empty.
    fn range(&self, axis: usize) -> [f64; 2] {
        let places = self.curves.iter().flat_map(|curve| &curve.places);
        let values = places.map(|place| place[axis]);
        let [least, most] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
            [low.min(v), high.max(v)]
        });
        let least = match (axis, self.scale) {
            (0, Scale::Logarithmic) => least.max(f64::MIN_POSITIVE),
            _ => least.min(0.0),
        };
        match least < most {
            true => [least, most],
            false => [0.0, 1.0],
        }
    }

    /// The picture.
    pub fn svg(&self) -> String {
        let frame = Frame {
            x: self.range(0),
            y: self.range(1),
            scale: self.scale,
        };
        let [width, height] = SIZE;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
        );
        let text = |svg: &mut String, [x, y]: [f64; 2], how: &str, text: &str| {
            let text = escape(text);
            writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" {how}>{text}</text>")
                .expect("a string takes everything");
        };
        text(
            &mut svg,
            [MARGINS[0], 24.0],
            "font-size=\"15\"",
            &self.title,
        );
        let middle = (MARGINS[0] + width - MARGINS[1]) / 2.0;
        let below = [middle, height - 10.0];
        text(&mut svg, below, "text-anchor=\"middle\"", &self.axes[0]);
        let turned = format!(
            "text-anchor=\"middle\" transform=\"rotate(-90 16 {:.1})\"",
            height / 2.0
        );
        text(&mut svg, [16.0, height / 2.0], &turned, &self.axes[1]);
        frame.draw(&mut svg);
        for (index, curve) in self.curves.iter().enumerate() {
            let colour = COLOURS[index % COLOURS.len()];
            frame.curve(&mut svg, curve, colour);
            let place = [
                width - MARGINS[1] + 12.0,
                MARGINS[2] + 16.0 * (index as f64 + 1.0),
            ];
            text(&mut svg, place, &format!("fill=\"{colour}\""), &curve.name);
        }
        svg + "</svg>\n"
    }
}

/// Ranges of the values on the picture.
struct Frame {
    x: [f64; 2],
    y: [f64; 2],
    scale: Scale,
}

impl Frame {
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let share = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        let along = match self.scale {
            Scale::Even => share(x, self.x),
            Scale::Logarithmic => share(libm::log(x), self.x.map(libm::log)),
        };
        let [width, height] = SIZE;
        [
            MARGINS[0] + along * (width - MARGINS[0] - MARGINS[1]),
            height - MARGINS[3] - share(y, self.y) * (height - MARGINS[2] - MARGINS[3]),
        ]
    }

    fn draw(&self, svg: &mut String) {
        let mut line = |from: [f64; 2], to: [f64; 2], label: (f64, f64, &str, String)| {
            let ([x0, y0], [x1, y1]) = (self.place(from), self.place(to));
            let (x, y, anchor, text) = label;
            let (x, y) = (x0 + x, y0 + y);
            writeln!(
                svg,
                "<path d=\"M{x0:.1} {y0:.1}L{x1:.1} {y1:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>"
            )
            .expect("a string takes everything");
        };
        for x in self.marks_along() {
            let label = (0.0, 18.0, "middle", rounded(x));
            line([x, self.y[0]], [x, self.y[1]], label);
        }
        for y in marks(self.y) {
            let label = (-6.0, 4.0, "end", rounded(y));
            line([self.x[0], y], [self.x[1], y], label);
        }
    }

    fn marks_along(&self) -> Vec<f64> {
        match self.scale {
            Scale::Even => marks(self.x),
            Scale::Logarithmic => {
                let [low, high] = self.x;
                let factor = libm::pow(high / low, 1.0 / TICKS);
                let mark = |n: u8| (low * libm::pow(factor, n.into())).round();
                (0..=6).map(mark).collect()
            }
        }
    }

    fn curve(&self, svg: &mut String, curve: &Curve, colour: &str) {
        let places: Vec<[f64; 2]> = curve
            .places
            .iter()
            .map(|place| self.place(*place))
            .collect();
        if curve.is_line {
            let path = places.iter().enumerate().map(|(index, [x, y])| {
                let pen = if index == 0 { 'M' } else { 'L' };
                format!("{pen}{x:.1} {y:.1}")
            });
            let path: String = path.collect();
            writeln!(
                svg,
                "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>"
            )
            .expect("a string takes everything");
            return;
        }
        for [x, y] in places {
            writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"2.5\" fill=\"{colour}\"/>"
            )
            .expect("a string takes everything");
        }
    }
}

/// Round values within a range.
fn marks([low, high]: [f64; 2]) -> Vec<f64> {
    let rough = (high - low) / TICKS;
    let power = libm::pow(10.0, libm::log10(rough).floor());
    let factors = [1.0, 2.0, 5.0, 10.0];
    let step = factors.map(|factor| factor * power);
    let step = step.into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(rough);
    let first = (low / step).ceil();
    let mut marks = Vec::new();
    let mut n = 0.0;
    while (first + n) * step <= high + step / 1e6 {
        marks.push((first + n) * step);
        n += 1.0;
    }
    marks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The range from 0 to 23 has about six marks, at steps of a round length.
    #[test]
    fn marks_are_round() {
        assert_eq!(marks([0.0, 23.0]), [0.0, 5.0, 10.0, 15.0, 20.0]);
        assert_eq!(
            marks([0.0, 0.5]),
            [0.0, 0.1, 0.2, 0.300_000_000_000_000_04, 0.4, 0.5]
        );
    }

    /// The picture has 720 by 420 pixels: 0 lies at (70, 370) and the largest value at (550, 40).
    #[test]
    fn a_curve_goes_from_corner_to_corner() {
        let places = [[0.0, 0.0], [f64::NAN, 1.0], [10.0, 5.0]];
        let plot = Plot::new("a < b", ["x (s)", "y (mm)"]).line("one", places);
        let svg = plot.svg();
        assert!(
            svg.contains("<path d=\"M70.0 370.0L550.0 40.0\" fill"),
            "{svg}"
        );
        assert!(svg.contains("a &lt; b") && svg.ends_with("</svg>\n"));
    }
}
