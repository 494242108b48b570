//! The walls of an existing map: points with normals.

use std::path::Path;

use super::{CellState, MapError, RosMap, pcd};
use crate::mapping::WallPoint;

/// Reads the walls from a result folder of `hilrig slam`, a PCD file, or the yaml file of a ROS
/// map. In a folder the point cloud is used: its points are beam ends with an accuracy of a
/// millimetre, and they contain the visible side. With cells of 50 mm instead, the median error of
/// four public logs rises from 4 to 11 mm to 18 to 29 mm, and one log is lost.
///
/// # Errors
/// If the file cannot be read, or has no walls.
pub fn walls(path: &Path) -> Result<Vec<WallPoint>, MapError> {
    let inside = path.join("walls.pcd");
    let cloud = if path.is_dir() { &inside } else { path };
    let is_cloud = cloud.extension().is_some_and(|ending| ending == "pcd");
    let walls = if is_cloud && cloud.is_file() {
        pcd::read(cloud)?
    } else {
        seen(&RosMap::read(path)?)
    };
    if walls.is_empty() {
        return Err(MapError {
            path: path.to_owned(),
            what: "has no walls, expected a map".to_owned(),
        });
    }
    Ok(walls)
}

/// Number of cells to each side that determine the normal of a wall.
const REACH: isize = 3;

/// Wall cells next to free cells, once for each side.
fn seen(map: &RosMap) -> Vec<WallPoint> {
    let mut walls = Vec::new();
    for y in 0..map.height {
        for x in 0..map.width {
            if map.cell(x, y) != Some(CellState::Wall) {
                continue;
            }
            let mut normals: Vec<[f32; 2]> = Vec::new();
            for side in [[1, 0], [0, 1], [-1, 0], [0, -1]] {
                let Some(normal) = normal(map, [x, y], side) else {
                    continue;
                };
                let is_known = |known: &[f32; 2]| known[0] * normal[0] + known[1] * normal[1] > 0.7;
                if !normals.iter().any(is_known) {
                    normals.push(normal);
                }
            }
            let at = map.middle(x, y);
            walls.extend(normals.into_iter().map(|normal| WallPoint { at, normal }));
        }
    }
    walls
}

/// The normal of a wall towards a free side.
fn normal(map: &RosMap, [x, y]: [usize; 2], side: [isize; 2]) -> Option<[f32; 2]> {
    let is_free = |dx: isize, dy: isize| {
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        (map.cell(x, y)? == CellState::Free).then_some(())
    };
    is_free(side[0], side[1])?;
    let mut sum = [0.0_f32; 2];
    for dy in -REACH..=REACH {
        for dx in -REACH..=REACH {
            let is_there = dx * side[0] + dy * side[1] > 0;
            if is_there && is_free(dx, dy).is_some() {
                sum = [sum[0] + dx as f32, sum[1] + dy as f32];
            }
        }
    }
    let length = (sum[0] * sum[0] + sum[1] * sum[1]).sqrt();
    Some(sum.map(|part| part / length))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall one cell thick between two rooms, and one at the map's edge.
    #[test]
    fn a_wall_is_seen_from_each_free_side() {
        let rows = [
            "#........",
            "#........",
            "#.#######",
            "#........",
            "#........",
        ];
        let cell = |letter: char| match letter {
            '#' => CellState::Wall,
            _ => CellState::Free,
        };
        let cells = rows.iter().flat_map(|row| row.chars().map(cell));
        let map = RosMap::new(9, 0.5, [1.0, 2.0], cells.collect());
        let walls = seen(&map);
        let of = |at: [f32; 2]| -> Vec<[i32; 2]> {
            let here = walls.iter().filter(|wall| wall.at == at);
            #[expect(clippy::cast_possible_truncation, reason = "-10 to 10")]
            here.map(|wall| wall.normal.map(|part| (10.0 * part).round() as i32))
                .collect()
        };
        assert_eq!(of([1.25, 3.25]), [[10, 0]]);
        assert_eq!(of([3.75, 3.25]), [[0, 10], [0, -10]]);
    }
}
