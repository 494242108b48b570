//! A check of the joins of parts on the finished map: a place that resembles another one may have
//! joined them wrongly.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use super::{RIVAL, Tour, are_apart};
use crate::mapping::graph::Kind;
use crate::mapping::track::Mapper;

/// Maximum number of places searched after the last scan to check the joins.
const CHECKED_MOST: usize = 600;

/// A place at which a view is recognised after the last scan.
#[derive(Clone, Copy, Debug)]
struct Recognised {
    place: usize,
    /// Whether the view's pose is another one than that of its keyframe.
    is_elsewhere: bool,
    score: f64,
}

/// Whether a view from behind the unknown motion fits a pose elsewhere nearly as well as it fits
/// its own pose at the places before the motion, which joined it.
fn has_double(sights: &[Recognised], motion: usize) -> bool {
    let best = |is: &dyn Fn(&&Recognised) -> bool| {
        let scores = sights.iter().filter(is).map(|sight| sight.score);
        scores.fold(0.0, f64::max)
    };
    let joined = best(&|sight| !sight.is_elsewhere && sight.place < motion);
    best(&|sight| sight.is_elsewhere) > RIVAL * joined
}

impl Mapper {
    /// Searches the finished map for other places like those that joined parts. When the parts were
    /// joined, such a place may have been unknown: two corridors look alike from their ends.
    pub(crate) fn check_joins(&mut self) {
        // The search takes long, and the map is doubted already.
        if self.parts() != Some(1) || self.unsure_joins() > 0 {
            return;
        }
        let mut left = CHECKED_MOST;
        let mut seen: BTreeMap<usize, Vec<Recognised>> = BTreeMap::new();
        for motion in self.unknown_motions() {
            let Some(number) = self.joined_by(motion) else {
                continue;
            };
            let sights = match seen.entry(number) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(free) => {
                    let tour = self.tour(number, usize::MAX);
                    // A join that is not checked is not confirmed.
                    let Some(rest) = left.checked_sub(tour.places.len()) else {
                        self.lost.alike.insert(motion);
                        continue;
                    };
                    left = rest;
                    free.insert(self.sights(&tour))
                }
            };
            if has_double(sights, motion) {
                self.lost.alike.insert(motion);
            }
        }
    }

    /// The first keyframes behind the unknown motions.
    fn unknown_motions(&self) -> Vec<usize> {
        let edges = self.graph.edges.iter();
        let motions = edges.filter(|edge| edge.kind == Kind::Unknown);
        motions.map(|edge| edge.to).collect()
    }

    /// The keyframe that was first recognised on the other side of an unknown motion.
    fn joined_by(&self, motion: usize) -> Option<usize> {
        let edges = self.graph.edges.iter();
        let loops = edges.filter(|edge| edge.kind == Kind::Loop);
        let ends = loops.map(|edge| [edge.from.min(edge.to), edge.from.max(edge.to)]);
        let across = ends.filter(|[old, new]| *old < motion && *new >= motion);
        across.map(|[_, new]| new).min()
    }

    /// All places at which the view of a tour is recognised.
    fn sights(&mut self, tour: &Tour) -> Vec<Recognised> {
        let here = self.graph.poses[tour.number];
        let mut sights = Vec::new();
        for place in &tour.places {
            let (found, _) = self.recognised(*place, tour.number, &tour.spots);
            sights.extend(found.map(|(_, pose, score)| Recognised {
                place: *place,
                is_elsewhere: are_apart(pose, here),
                score,
            }));
        }
        sights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view joined two parts across the motion before keyframe 50: it fits its pose at place 10
    /// with a score of 0.6. Elsewhere 0.52 is more than 85 % of that, and 0.5 is less. A better fit
    /// at places after the motion, which the robot saw itself, confirms nothing.
    #[test]
    fn a_view_that_fits_elsewhere_makes_a_join_unsure() {
        let sight = |place, is_elsewhere, score| Recognised {
            place,
            is_elsewhere,
            score,
        };
        let joined = [sight(10, false, 0.6), sight(60, false, 0.95)];
        for (other, expected) in [
            (None, false),
            (Some(sight(80, true, 0.5)), false),
            (Some(sight(80, true, 0.52)), true),
            (Some(sight(20, true, 0.52)), true),
        ] {
            let sights: Vec<Recognised> = joined.into_iter().chain(other).collect();
            assert_eq!(has_double(&sights, 50), expected, "{other:?}");
        }
    }
}
