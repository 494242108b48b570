//! A floor plan: blocks between corridors, and a route along the corridors.

use emulators::rng::Rng;

use super::Wall;

/// Walls and a route between them.
pub(super) struct Plan {
    pub(super) walls: Vec<Wall>,
    pub(super) route: Vec<[f64; 2]>,
    style: Style,
}

/// The look of corridors.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Style {
    /// Whether most walls have no features.
    pub(super) is_plain: bool,
    /// Seed of the walls of every corridor, if all are alike.
    pub(super) alike: Option<u64>,
}

/// Shares of buildings with these looks.
const PLAIN: f64 = 0.25;
const ALIKE: f64 = 0.2;
/// Length of a wall without features, metres.
const PLAIN_M: [f64; 2] = [12.0, 50.0];

impl Style {
    /// Draws a look.
    pub(super) fn drawn(seed: u64, rng: &mut Rng) -> Self {
        let is_plain = rng.chance(PLAIN);
        let are_alike = rng.chance(ALIKE);
        Self {
            is_plain,
            alike: are_alike.then_some(seed),
        }
    }
}

/// Minimum and maximum length of a building's longer side, metres.
const SIZE_M: [f64; 2] = [30.0, 300.0];

impl Plan {
    /// Generates a plan with a route of at least `least_m` metres.
    pub(super) fn drawn(rng: &mut Rng, least_m: f64, style: Style) -> Self {
        // Small buildings are as frequent as large ones.
        let size = SIZE_M[0] * libm::pow(SIZE_M[1] / SIZE_M[0], rng.uniform());
        let columns = 1 + rng.below(if size > 80.0 { 4 } else { 2 });
        let rows = 1 + rng.below(if size > 80.0 { 3 } else { 2 });
        let wide = rng.range(1.7, 3.5);
        let are_alike = style.alike.is_some();
        let xs = axis(columns, size, wide, are_alike, rng);
        let side = size * rng.range(0.4, 1.0);
        let ys = axis(rows, side, wide, are_alike, rng);
        let mut plan = Self {
            walls: Vec::new(),
            route: route(&xs, &ys, least_m, rng),
            style,
        };
        plan.outer(&xs, &ys, wide, rng);
        for x in xs.windows(2) {
            for y in ys.windows(2) {
                let corners = [x[0] + wide / 2.0, x[1] - wide / 2.0];
                let heights = [y[0] + wide / 2.0, y[1] - wide / 2.0];
                plan.block(corners, heights, rng);
            }
        }
        plan
    }

    fn wall(&mut self, from: [f64; 2], to: [f64; 2], is_glass: bool) {
        self.walls.push(Wall { from, to, is_glass });
    }

    /// Adds the outer wall.
    fn outer(&mut self, xs: &[f64], ys: &[f64], wide: f64, rng: &mut Rng) {
        let half = wide / 2.0;
        let (x0, x1) = (xs[0] - half, xs[xs.len() - 1] + half);
        let (y0, y1) = (ys[0] - half, ys[ys.len() - 1] + half);
        self.side([x0, y0], [x1, y0], [0.0, -1.0], rng);
        self.side([x1, y0], [x1, y1], [1.0, 0.0], rng);
        self.side([x1, y1], [x0, y1], [0.0, 1.0], rng);
        self.side([x0, y1], [x0, y0], [-1.0, 0.0], rng);
    }

    /// Adds rooms between corridors, or an open hall.
    fn block(&mut self, x: [f64; 2], y: [f64; 2], rng: &mut Rng) {
        if x[1] - x[0] < 3.0 || y[1] - y[0] < 3.0 {
            return;
        }
        if rng.chance(0.2) {
            self.hall(x, y, rng);
            return;
        }
        self.side([x[0], y[0]], [x[1], y[0]], [0.0, 1.0], rng);
        self.side([x[1], y[0]], [x[1], y[1]], [-1.0, 0.0], rng);
        self.side([x[1], y[1]], [x[0], y[1]], [0.0, -1.0], rng);
        self.side([x[0], y[1]], [x[0], y[0]], [1.0, 0.0], rng);
    }

    /// Adds pillars and furniture in an open hall.
    fn hall(&mut self, x: [f64; 2], y: [f64; 2], rng: &mut Rng) {
        let pitch = rng.range(4.0, 9.0);
        let mut px = x[0] + 1.0;
        while px < x[1] - 0.5 {
            let mut py = y[0] + 1.0;
            while py < y[1] - 0.5 {
                if rng.chance(0.8) {
                    let size = rng.range(0.3, 0.8);
                    self.chest([px, py], [size, size], 0.0);
                }
                if rng.chance(0.3) {
                    let at = [px + rng.range(1.0, 3.0), py + rng.range(1.0, 3.0)];
                    let is_inside = at[0] < x[1] - 1.0 && at[1] < y[1] - 1.0;
                    let size = [rng.range(0.4, 2.0), rng.range(0.4, 1.2)];
                    let turn = rng.range(0.0, 3.0);
                    if is_inside {
                        self.chest(at, size, turn);
                    }
                }
                py += pitch;
            }
            px += pitch;
        }
    }

    /// Adds a rectangular object around a point.
    fn chest(&mut self, at: [f64; 2], size: [f64; 2], turn: f64) {
        let (sin, cos) = (libm::sin(turn), libm::cos(turn));
        let corner = |sx: f64, sy: f64| {
            let (x, y) = (sx * size[0] / 2.0, sy * size[1] / 2.0);
            [at[0] + cos * x - sin * y, at[1] + sin * x + cos * y]
        };
        let corners = [
            corner(-1.0, -1.0),
            corner(1.0, -1.0),
            corner(1.0, 1.0),
            corner(-1.0, 1.0),
        ];
        for (number, from) in corners.iter().enumerate() {
            self.wall(*from, corners[(number + 1) % 4], false);
        }
    }

    /// Adds one side of a corridor; `away` points away from the corridor.
    fn side(&mut self, from: [f64; 2], to: [f64; 2], away: [f64; 2], rng: &mut Rng) {
        let length = libm::hypot(to[0] - from[0], to[1] - from[1]);
        let along = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
        let mut alike = self
            .style
            .alike
            .map(|seed| Rng::stream(seed, "building.alike"));
        let rng = alike.as_mut().unwrap_or(rng);
        let mut at = 0.0;
        while at < length {
            let lengths = if self.style.is_plain {
                PLAIN_M
            } else {
                [1.5, 6.0]
            };
            let end = (at + rng.range(lengths[0], lengths[1])).min(length);
            let mut kind = rng.below(10);
            if self.style.is_plain {
                // A plain wall has a door frame or a cupboard now and then.
                let to = (end - 2.0).max(at);
                self.wall(piece_of(from, along, at), piece_of(from, along, to), false);
                at = to;
                kind = if kind < 3 { kind } else { 9 };
            }
            let piece = Piece {
                from,
                along,
                away,
                at,
                end,
            };
            let is_long = end - at > 1.4;
            match kind {
                0..=2 if is_long => self.recess(&piece, rng.range(0.08, 0.3)),
                3 if is_long => self.recess(&piece, rng.range(0.4, 1.5)),
                4 | 5 if is_long => self.room(&piece, rng),
                6 => self.wall(piece.place(at, 0.0), piece.place(end, 0.0), true),
                7 if is_long => self.cupboard(&piece, rng),
                _ => self.wall(piece.place(at, 0.0), piece.place(end, 0.0), false),
            }
            at = end;
        }
    }

    /// Adds a closed door in its frame, or a niche.
    fn recess(&mut self, piece: &Piece, deep: f64) {
        let (a, b) = (piece.at + 0.25, piece.end - 0.25);
        self.wall(piece.place(piece.at, 0.0), piece.place(a, 0.0), false);
        self.wall(piece.place(a, 0.0), piece.place(a, deep), false);
        self.wall(piece.place(a, deep), piece.place(b, deep), false);
        self.wall(piece.place(b, deep), piece.place(b, 0.0), false);
        self.wall(piece.place(b, 0.0), piece.place(piece.end, 0.0), false);
    }

    /// Adds an open door and the visible part of the room.
    fn room(&mut self, piece: &Piece, rng: &mut Rng) {
        let door = rng.range(0.8, 1.1).min(piece.end - piece.at - 0.2);
        let a = piece.at + rng.range(0.1, (piece.end - piece.at - door).max(0.11));
        let b = (a + door).min(piece.end);
        let (deep, left, right) = (
            rng.range(2.0, 6.0),
            rng.range(0.2, 1.5),
            rng.range(0.2, 1.5),
        );
        self.wall(piece.place(piece.at, 0.0), piece.place(a, 0.0), false);
        self.wall(piece.place(b, 0.0), piece.place(piece.end, 0.0), false);
        self.wall(
            piece.place(a - left, 0.15),
            piece.place(a - left, deep),
            false,
        );
        self.wall(
            piece.place(a - left, deep),
            piece.place(b + right, deep),
            false,
        );
        self.wall(
            piece.place(b + right, deep),
            piece.place(b + right, 0.15),
            false,
        );
        if rng.chance(0.5) {
            let at = piece.place(a + rng.range(0.0, 1.0), deep * rng.range(0.4, 0.8));
            let size = [rng.range(0.4, 1.2), rng.range(0.4, 0.8)];
            self.chest(at, size, rng.range(0.0, 1.5));
        }
    }

    /// Adds an object at the wall.
    fn cupboard(&mut self, piece: &Piece, rng: &mut Rng) {
        self.wall(
            piece.place(piece.at, 0.0),
            piece.place(piece.end, 0.0),
            false,
        );
        let a = piece.at + rng.range(0.1, 0.4);
        let b = (a + rng.range(0.5, 1.5)).min(piece.end);
        let deep = -rng.range(0.15, 0.4);
        self.wall(piece.place(a, 0.0), piece.place(a, deep), false);
        self.wall(piece.place(a, deep), piece.place(b, deep), false);
        self.wall(piece.place(b, deep), piece.place(b, 0.0), false);
    }
}

/// A point on one side of a corridor.
fn piece_of(from: [f64; 2], along: [f64; 2], on: f64) -> [f64; 2] {
    [from[0] + on * along[0], from[1] + on * along[1]]
}

/// A part of one side of a corridor.
struct Piece {
    from: [f64; 2],
    along: [f64; 2],
    away: [f64; 2],
    at: f64,
    end: f64,
}

impl Piece {
    fn place(&self, on: f64, deep: f64) -> [f64; 2] {
        [
            self.from[0] + on * self.along[0] + deep * self.away[0],
            self.from[1] + on * self.along[1] + deep * self.away[1],
        ]
    }
}

/// The centre lines of corridors.
fn axis(blocks: u64, size: f64, wide: f64, are_alike: bool, rng: &mut Rng) -> Vec<f64> {
    let parts: Vec<f64> = (0..blocks)
        .map(|_| rng.range(0.6, 1.6))
        .map(|part| if are_alike { 1.0 } else { part })
        .collect();
    let sum: f64 = parts.iter().sum();
    let mut at = 0.0;
    let mut all = vec![0.0];
    for part in parts {
        at += (size * part / sum).max(wide + 4.0);
        all.push(at);
    }
    all
}

/// Maximum number of crossings per metre of a route, and minimum and maximum length of a route,
/// metres.
const CROSSINGS_PER_M: f64 = 0.3;
const ROUTE_M: [f64; 2] = [150.0, 700.0];

/// A route from crossing to crossing that rarely turns back; it first goes around a block.
fn route(xs: &[f64], ys: &[f64], least_m: f64, rng: &mut Rng) -> Vec<[f64; 2]> {
    let mut at = [0_usize, 0_usize];
    let place = |at: [usize; 2]| [xs[at[0]], ys[at[1]]];
    let mut route = vec![place(at)];
    let mut last = [usize::MAX; 2];
    let mut length = 0.0;
    let wanted = rng.range(ROUTE_M[0], ROUTE_M[1]).max(least_m);
    let loops = [[1, 0], [1, 1], [0, 1], [0, 0]];
    let around = (1 + rng.below(2)) * 4;
    let mut leg = 0;
    while (leg as f64) < 60.0 + CROSSINGS_PER_M * least_m {
        let next = if (leg as u64) < around {
            loops[leg % 4]
        } else {
            neighbour(at, last, [xs.len(), ys.len()], rng)
        };
        let [from, to] = [place(at), place(next)];
        length += libm::hypot(to[0] - from[0], to[1] - from[1]);
        route.push([to[0] + rng.range(-0.3, 0.3), to[1] + rng.range(-0.3, 0.3)]);
        (last, at) = (at, next);
        leg += 1;
        if length > wanted && leg > 4 {
            break;
        }
    }
    route
}

/// A neighbouring crossing; the previous one only if there is no other.
fn neighbour(at: [usize; 2], last: [usize; 2], size: [usize; 2], rng: &mut Rng) -> [usize; 2] {
    let [x, y] = at;
    let mut all = Vec::new();
    if x > 0 {
        all.push([x - 1, y]);
    }
    if x + 1 < size[0] {
        all.push([x + 1, y]);
    }
    if y > 0 {
        all.push([x, y - 1]);
    }
    if y + 1 < size[1] {
        all.push([x, y + 1]);
    }
    all.retain(|next| *next != last);
    let number = usize::try_from(rng.below(all.len().max(1) as u64)).unwrap_or(0);
    all.get(number).copied().unwrap_or(last)
}
