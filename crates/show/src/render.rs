//! Maps as pictures and as text.

use emulators::world::{Pose, Shape};
use firmware_core::map_view::MapView;

use engine::picture::Picture;
use engine::robots::Display;
use engine::run::score::{is_wall, outline};

/// Gray of an unknown cell in a ROS map, as map_server writes it.
const ROS_UNKNOWN: u8 = 205;

/// Minimum difference of a known cell from the value for unknown.
const UNKNOWN_BAND: u8 = 12;

/// Size from which a map is drawn without magnification.
const LARGE_CELLS: usize = 1500;

/// State of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cell {
    /// Never or rarely observed.
    Unknown,
    /// Observed as free.
    Free,
    /// A wall.
    Wall,
    /// The transition beside a wall: neither wall nor free.
    Between,
}

/// Classifies a cell.
pub fn cell(grid: MapView<'_>, x: usize, y: usize) -> Cell {
    let value = grid.get(x, y).unwrap_or(127);
    if is_wall(grid, x, y) {
        Cell::Wall
    } else if value.abs_diff(127) < UNKNOWN_BAND {
        Cell::Unknown
    } else if value < 127 {
        Cell::Free
    } else {
        Cell::Between
    }
}

/// The map as text, one character per `block` x `block` cells, top row first: `#` wall, `.` free,
/// space unknown, `+` neither, `@` the robot.
pub fn text(grid: MapView<'_>, block: usize, robot: Option<Pose>) -> String {
    let cell_m = f64::from(grid.cell_mm()) / 1000.0;
    let [x0, y0] = origin_m(grid);
    let robot = robot.map(|pose| {
        let index = |metres: f64| (metres / cell_m / block as f64).floor();
        (index(pose.x - x0), index(pose.y - y0))
    });
    let (columns, rows) = (grid.width().div_ceil(block), grid.height().div_ceil(block));
    let mut out = String::with_capacity((columns + 1) * rows);
    for row in (0..rows).rev() {
        let line: String = (0..columns)
            .map(|column| {
                if robot == Some((column as f64, row as f64)) {
                    return '@';
                }
                block_character(grid, column * block, row * block, block)
            })
            .collect();
        out.push_str(line.trim_end());
        out.push('\n');
    }
    out
}

fn block_character(grid: MapView<'_>, x: usize, y: usize, block: usize) -> char {
    let mut counts = [0_usize; 4];
    for y in y..(y + block).min(grid.height()) {
        for x in x..(x + block).min(grid.width()) {
            counts[cell(grid, x, y) as usize] += 1;
        }
    }
    let [unknown, free, wall, between] = counts;
    // A wall is a line: it fills the length of a block, not its area.
    if wall * 2 >= block {
        '#'
    } else if free >= unknown && free >= between && free > 0 {
        '.'
    } else if unknown >= between {
        ' '
    } else {
        '+'
    }
}

/// The map in ROS gray values: 254 free, 0 occupied, 205 unknown; first row on top. Trinary: the
/// slopes beside walls are unknown.
pub fn ros_image(grid: MapView<'_>) -> Picture<u8> {
    let height = grid.height();
    Picture::from_fn(grid.width(), height, |x, y| {
        match cell(grid, x, height - 1 - y) {
            Cell::Wall => 0,
            Cell::Free => 254,
            Cell::Unknown | Cell::Between => ROS_UNKNOWN,
        }
    })
}

/// Corner with minimum x and y, metres.
fn origin_m(map: MapView<'_>) -> [f64; 2] {
    map.origin_mm().map(|mm| f64::from(mm) / 1000.0)
}

/// Text of the yaml file for [`ros_image`]. `free_thresh` is 0.196: with the default 0.25 of nav2,
/// an unknown cell of gray 205 would count as free.
pub fn ros_yaml(grid: MapView<'_>, image: &str) -> String {
    ros_yaml_at(origin_m(grid), f64::from(grid.cell_mm()) / 1000.0, image)
}

/// Text of the yaml file for a map whose lower left corner lies at `origin`, metres.
pub fn ros_yaml_at([x, y]: [f64; 2], cell_m: f64, image: &str) -> String {
    format!(
        "image: {image}\nmode: trinary\nresolution: {cell_m}\norigin: [{x:?}, {y:?}, 0.0]\nnegate: 0\n\
         occupied_thresh: 0.65\nfree_thresh: 0.196\n",
    )
}

/// The program's map, dark at believed walls, with the true path (green) and the believed path
/// (red).
pub fn picture(grid: MapView<'_>, truth: &[Pose], estimate: &[Pose]) -> Picture {
    let (width, height) = (grid.width(), grid.height());
    let scale = if width.max(height) > LARGE_CELLS {
        1
    } else {
        3
    };
    let h = height * scale;
    let cells = Picture::from_fn(width, height, |x, y| {
        [255 - grid.get(x, height - 1 - y).unwrap_or(127); 3]
    });
    let mut image = cells.magnified(scale);
    let pixel_m = f64::from(grid.cell_mm()) / 1000.0 / scale as f64;
    for (way, colour) in [(truth, [0, 160, 60]), (estimate, [220, 40, 30])] {
        for pair in way.windows(2) {
            let shape = Shape::Wall {
                from: pair[0].point(),
                to: pair[1].point(),
            };
            outline(&shape, pixel_m, |place| {
                let [x0, y0] = origin_m(grid);
                let (x, y) = (
                    (place.x - x0) / pixel_m,
                    h as f64 - (place.y - y0) / pixel_m,
                );
                dot(&mut image, x, y, colour);
            });
        }
    }
    image
}

/// Picture of a display.
pub fn display(display: Display<'_>) -> Picture {
    display.picture()
}

/// Draws two by two pixels, as far as they lie inside the picture.
pub fn dot(image: &mut Picture, x: f64, y: f64, colour: [u8; 3]) {
    for (x, y) in [(x, y), (x + 1.0, y), (x, y + 1.0), (x + 1.0, y + 1.0)] {
        if x >= 0.0 && y >= 0.0 {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "beyond the picture none is put"
            )]
            #[expect(clippy::cast_sign_loss, reason = "not negative")]
            image.put(x as usize, y as usize, colour);
        }
    }
}
