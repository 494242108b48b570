//! The points that objects of a world reach.

use core::ops::Range;

use emulators::world::Shape;
use toml::Spanned;

use super::WorldSpec;
use crate::scenario::{Source, plan};

/// An object: its key in the file, its position there, and its points, metres.
pub(crate) type Outline = (String, Range<usize>, Vec<[f64; 2]>);

/// Corners of the square around a disk.
fn disk([x, y]: [f64; 2], radius: f64) -> [[f64; 2]; 2] {
    [[x - radius, y - radius], [x + radius, y + radius]]
}

/// The outlines of the objects called `list`, with the key of their points.
fn each<T>(
    list: &str,
    key: &str,
    objects: &[Spanned<T>],
    points: impl Fn(&T) -> Vec<[f64; 2]>,
) -> Vec<Outline> {
    let objects = objects.iter().enumerate();
    let outline = |(index, object): (usize, &Spanned<T>)| {
        let key = format!("world.{list}[{index}].{key}");
        (key, object.span(), points(object.get_ref()))
    };
    objects.map(outline).collect()
}

impl WorldSpec {
    /// The outlines of all objects: walls, polygons, pillars, moving obstacles, tiles of a maze,
    /// and the picture of a floor plan.
    pub(crate) fn outlines(&self, source: &Source) -> Vec<Outline> {
        let mut all = each("wall", "path_m", &self.wall, |wall| wall.path_m.clone());
        let polygons = each("polygon", "corners_m", &self.polygon, |polygon| {
            polygon.corners_m.clone()
        });
        let pillars = each("pillar", "at_m", &self.pillar, |pillar| {
            let places = pillar.at_m.iter();
            places.flat_map(|&at| disk(at, pillar.radius_m)).collect()
        });
        let moving = each("moving", "path_m", &self.moving, |moving| {
            let places = moving.path_m.iter();
            places.flat_map(|&at| disk(at, moving.radius_m)).collect()
        });
        all.extend(polygons.into_iter().chain(pillars).chain(moving));
        if let Some(maze) = &self.maze {
            let spec = maze.get_ref();
            let [x, y] = spec.corner_m;
            #[expect(clippy::cast_precision_loss, reason = "at most 100 tiles")]
            let sides = [spec.columns, spec.rows].map(|tiles| tiles as f64 * spec.tile_m);
            let points = vec![[x, y], [x + sides[0], y + sides[1]]];
            all.push(("world.maze".to_owned(), maze.span(), points));
        }
        if let Some(spec) = &self.plan
            && let Ok(image) = plan::read(&spec.get_ref().yaml, source)
        {
            let ends = image.walls().into_iter().filter_map(|wall| match wall {
                Shape::Wall { from, to } => Some([from, to]),
                _ => None,
            });
            let points = ends.flatten().map(|end| [end.x, end.y]).collect();
            all.push(("world.plan".to_owned(), spec.span(), points));
        }
        all
    }
}
