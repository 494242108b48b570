//! Split-and-merge search for lines in a scan, with the robot's parameters.

type Xy = [f64; 2];

const GAP: f64 = 0.3;
const TOLERANCE: f64 = 0.06;
const POINTS_MIN: usize = 3;
const LINES_MAX: usize = 20;

/// The lines of points in the order of their angles, as pairs of ends.
pub(crate) fn lines(points: &[Xy]) -> Vec<(Xy, Xy)> {
    let mut found = Vec::new();
    let mut region: Vec<Xy> = Vec::new();
    for point in points {
        if region
            .last()
            .is_some_and(|last| distance(*last, *point) > GAP)
        {
            split(&region, &mut found);
            region.clear();
        }
        region.push(*point);
    }
    split(&region, &mut found);
    found.sort_by(|one, other| distance(other.0, other.1).total_cmp(&distance(one.0, one.1)));
    found.truncate(LINES_MAX);
    found
}

fn split(points: &[Xy], found: &mut Vec<(Xy, Xy)>) {
    if points.len() < POINTS_MIN {
        return;
    }
    let (first, last) = (points[0], points[points.len() - 1]);
    let far = (0..points.len()).map(|at| (off(points[at], first, last), at));
    let (far, at) = far.fold(
        (0.0, 0),
        |best, one| if one.0 > best.0 { one } else { best },
    );
    if far > TOLERANCE && at > 0 && at + 1 < points.len() {
        split(&points[..=at], found);
        split(&points[at..], found);
        return;
    }
    found.push(fitted(points));
}

/// Fits a line by total least squares; the ends are the projected outer points.
fn fitted(points: &[Xy]) -> (Xy, Xy) {
    let count = points.len() as f64;
    let sum = points
        .iter()
        .fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]);
    let middle = sum.map(|sum| sum / count);
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let (x, y) = (p[0] - middle[0], p[1] - middle[1]);
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    let angle = 0.5 * libm::atan2(2.0 * xy, xx - yy);
    let (sin, cos) = libm::sincos(angle);
    let on = |p: Xy| {
        let along = (p[0] - middle[0]) * cos + (p[1] - middle[1]) * sin;
        [middle[0] + along * cos, middle[1] + along * sin]
    };
    (on(points[0]), on(points[points.len() - 1]))
}

fn distance(one: Xy, other: Xy) -> f64 {
    libm::hypot(one[0] - other[0], one[1] - other[1])
}

fn off(p: Xy, a: Xy, b: Xy) -> f64 {
    let length = distance(a, b);
    if length < 1e-9 {
        return distance(p, a);
    }
    ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])).abs() / length
}
