//! The cheapest path through a graph. For the part of a robot's program that runs on a PC; feature
//! `host`.
//!
//! The crate `pathfinding` needs `std`, which this crate never has.

use alloc::collections::BinaryHeap;
use alloc::vec::Vec;
use core::cmp::Reverse;

/// The cheapest path from `start` to `goal` through `count` nodes, both ends included; `None` if
/// there is none. `edges` calls its second argument with each neighbour of a node and the cost of
/// the step. `estimate` must never exceed the true remaining cost.
pub fn cheapest_way(
    count: usize,
    start: usize,
    goal: usize,
    mut edges: impl FnMut(usize, &mut dyn FnMut(usize, u32)),
    estimate: impl Fn(usize) -> u32,
) -> Option<Vec<usize>> {
    // Cost from the start, and the node before.
    let mut best: Vec<Option<(u32, usize)>> = alloc::vec![None; count];
    let mut open = BinaryHeap::new();
    *best.get_mut(start)? = Some((0, start));
    open.push(Reverse((estimate(start), 0, start)));
    while let Some(Reverse((_, cost, node))) = open.pop() {
        if node == goal {
            return Some(way_back(&best, start, goal));
        }
        if best[node].is_some_and(|(found, _)| found < cost) {
            continue;
        }
        edges(node, &mut |next, step| {
            let cost = cost.saturating_add(step);
            let Some(known) = best.get_mut(next) else {
                return;
            };
            if known.is_none_or(|(found, _)| cost < found) {
                *known = Some((cost, node));
                open.push(Reverse((cost.saturating_add(estimate(next)), cost, next)));
            }
        });
    }
    None
}

fn way_back(best: &[Option<(u32, usize)>], start: usize, goal: usize) -> Vec<usize> {
    let mut way = alloc::vec![goal];
    let mut node = goal;
    while node != start {
        let Some((_, before)) = best[node] else {
            break;
        };
        node = before;
        way.push(node);
    }
    way.reverse();
    way
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: the path 0-1-3 costs 1 + 5, the path 0-2-3 costs 2 + 3.
    #[test]
    fn the_cheapest_way_need_not_begin_with_the_cheapest_step() {
        let edges = [(0, 1, 1), (0, 2, 2), (1, 3, 5), (2, 3, 3)];
        let way = |goal| {
            let near = |node: usize, report: &mut dyn FnMut(usize, u32)| {
                let from = edges.iter().filter(|(from, ..)| *from == node);
                from.for_each(|(_, to, cost)| report(*to, *cost));
            };
            cheapest_way(5, 0, goal, near, |_| 0)
        };
        assert_eq!(way(3), Some(alloc::vec![0, 2, 3]));
        assert_eq!(way(0), Some(alloc::vec![0]));
        assert_eq!(way(4), None);
        assert_eq!(cheapest_way(0, 0, 0, |_, _| {}, |_| 0), None);
    }
}
