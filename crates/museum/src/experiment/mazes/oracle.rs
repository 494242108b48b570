//! A short path through all tiles of a known maze and back.

use std::collections::VecDeque;

/// Number of steps of a closed tour from the first tile over all tiles. The tour goes to the
/// nearest tile each time; then pieces are reversed as long as this shortens the tour.
pub(super) fn tour(passages: &[Vec<usize>]) -> usize {
    let steps: Vec<Vec<usize>> = (0..passages.len())
        .map(|from| flood(passages, from))
        .collect();
    let mut order = vec![0];
    while order.len() < passages.len() {
        let here = order[order.len() - 1];
        let left = (0..passages.len()).filter(|tile| !order.contains(tile));
        let Some(next) = left.min_by_key(|tile| steps[here][*tile]) else {
            break;
        };
        order.push(next);
    }
    while turn_a_piece(&mut order, &steps) {}
    length(&order, &steps)
}

fn length(order: &[usize], steps: &[Vec<usize>]) -> usize {
    let next = order.iter().cycle().skip(1);
    order
        .iter()
        .zip(next)
        .map(|(from, to)| steps[*from][*to])
        .sum()
}

/// Reverses a piece that shortens the tour; returns whether there was one.
fn turn_a_piece(order: &mut [usize], steps: &[Vec<usize>]) -> bool {
    let before = length(order, steps);
    for from in 1..order.len() {
        for to in from + 1..order.len() {
            order[from..=to].reverse();
            if length(order, steps) < before {
                return true;
            }
            order[from..=to].reverse();
        }
    }
    false
}

/// Steps from one tile to each tile.
fn flood(passages: &[Vec<usize>], from: usize) -> Vec<usize> {
    let mut steps = vec![usize::MAX / 1024; passages.len()];
    steps[from] = 0;
    let mut open = VecDeque::from([from]);
    while let Some(tile) = open.pop_front() {
        for &next in &passages[tile] {
            if steps[next] > steps[tile] + 1 {
                steps[next] = steps[tile] + 1;
                open.push_back(next);
            }
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    fn passages(count: usize, pairs: &[[usize; 2]]) -> Vec<Vec<usize>> {
        let mut passages = vec![Vec::new(); count];
        for [one, other] in pairs {
            passages[*one].push(*other);
            passages[*other].push(*one);
        }
        passages
    }

    /// Four tiles in a row are passed twice, in a ring once. A star of three arms is passed twice
    /// along each arm.
    #[test]
    fn a_tour_is_as_short_as_the_maze_allows() {
        let row = [[0, 1], [1, 2], [2, 3]];
        let ring = [[0, 1], [1, 2], [2, 3], [3, 0]];
        let star = [[0, 1], [1, 2], [1, 3]];
        let tours = [&row[..], &ring, &star].map(|pairs| tour(&passages(4, pairs)));
        assert_eq!(tours, [6, 4, 6]);
    }
}
