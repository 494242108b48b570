//! Sparse symmetric systems with blocks of three by three: block Cholesky (L D L^T) with minimum
//! degree ordering (George and Liu 1989).

use std::collections::BTreeSet;

use crate::mapping::matrix::{Matrix, ZERO, applied, inverse, product, transposed};

/// The elimination order of the nodes of a graph, and the resulting fill-in.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    /// Nodes in elimination order, and the position of each node in it.
    order: Vec<usize>,
    place: Vec<usize>,
    /// Positions of nonzero blocks below the diagonal, column by column, ascending.
    columns: Vec<Vec<usize>>,
}

impl Plan {
    /// The plan for `nodes` nodes and the pairs of nodes with an edge.
    pub(crate) fn new(nodes: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Self {
        let mut near = vec![BTreeSet::new(); nodes];
        for (a, b) in pairs.filter(|(a, b)| a != b) {
            near[a].insert(b);
            near[b].insert(a);
        }
        let mut queue: BTreeSet<(usize, usize)> =
            (0..nodes).map(|node| (near[node].len(), node)).collect();
        let mut order = Vec::with_capacity(nodes);
        let mut kept = Vec::with_capacity(nodes);
        while let Some((_, node)) = queue.pop_first() {
            let around: Vec<usize> = core::mem::take(&mut near[node]).into_iter().collect();
            for a in &around {
                queue.remove(&(near[*a].len(), *a));
                near[*a].remove(&node);
                near[*a].extend(around.iter().filter(|b| *b != a));
                queue.insert((near[*a].len(), *a));
            }
            order.push(node);
            kept.push(around);
        }
        let mut place = vec![0; nodes];
        for (at, node) in order.iter().enumerate() {
            place[*node] = at;
        }
        let columns = kept.into_iter().map(|around| {
            let mut rows: Vec<usize> = around.into_iter().map(|node| place[node]).collect();
            rows.sort_unstable();
            rows
        });
        let columns = columns.collect();
        Self {
            order,
            place,
            columns,
        }
    }
}

/// A system of equations: blocks of the matrix, and the right side.
#[derive(Clone, Debug)]
pub(crate) struct System<'a> {
    plan: &'a Plan,
    diagonal: Vec<Matrix>,
    below: Vec<Vec<Matrix>>,
    right: Vec<[f64; 3]>,
}

impl<'a> System<'a> {
    /// A system of zeros.
    pub(crate) fn new(plan: &'a Plan) -> Self {
        Self {
            diagonal: vec![ZERO; plan.order.len()],
            below: plan
                .columns
                .iter()
                .map(|rows| vec![ZERO; rows.len()])
                .collect(),
            right: vec![[0.0; 3]; plan.order.len()],
            plan,
        }
    }

    /// Adds to the block at `row` and `column`; an off-diagonal block must be planned. Add only one
    /// of the two blocks of an edge.
    pub(crate) fn add(&mut self, row: usize, column: usize, block: &Matrix) {
        let (row, column) = (self.plan.place[row], self.plan.place[column]);
        if row == column {
            add_to(&mut self.diagonal[row], block);
        } else if row > column {
            let at = self.plan.columns[column].partition_point(|place| *place < row);
            add_to(&mut self.below[column][at], block);
        } else {
            let at = self.plan.columns[row].partition_point(|place| *place < column);
            add_to(&mut self.below[row][at], &transposed(block));
        }
    }

    /// Adds to the right side.
    pub(crate) fn add_right(&mut self, row: usize, by: [f64; 3]) {
        let right = &mut self.right[self.plan.place[row]];
        (0..3).for_each(|axis| right[axis] += by[axis]);
    }

    /// The solution, node by node; `None` if the matrix is singular.
    pub(crate) fn solve(mut self) -> Option<Vec<[f64; 3]>> {
        let right = core::mem::take(&mut self.right);
        Some(self.factored()?.solve(right))
    }

    /// The factors of the matrix, for several right sides; `None` if the matrix is singular.
    pub(crate) fn factored(mut self) -> Option<Factored<'a>> {
        let count = self.diagonal.len();
        let mut inverses = Vec::with_capacity(count);
        for k in 0..count {
            let inverted = inverse(&self.diagonal[k])?;
            let lower: Vec<Matrix> = self.below[k]
                .iter()
                .map(|a| product(a, &inverted))
                .collect();
            self.eliminate(k, &lower);
            self.below[k] = lower;
            inverses.push(inverted);
        }
        Some(Factored {
            plan: self.plan,
            inverses,
            below: self.below,
        })
    }

    /// Eliminates column `k` from the columns in which it has rows.
    fn eliminate(&mut self, k: usize, lower: &[Matrix]) {
        let rows = &self.plan.columns[k];
        for (j, column) in rows.iter().enumerate() {
            let across = transposed(&self.below[k][j]);
            subtract(&mut self.diagonal[*column], &product(&lower[j], &across));
            // Its remaining rows are among the rows of that column, in the same order.
            let planned = &self.plan.columns[*column];
            let mut at = 0;
            for (i, row) in rows.iter().enumerate().skip(j + 1) {
                while planned[at] != *row {
                    at += 1;
                }
                subtract(&mut self.below[*column][at], &product(&lower[i], &across));
            }
        }
    }
}

/// The factors of a matrix.
#[derive(Clone, Debug)]
pub(crate) struct Factored<'a> {
    plan: &'a Plan,
    /// Inverses of the diagonal blocks, and the blocks below the diagonal.
    inverses: Vec<Matrix>,
    below: Vec<Vec<Matrix>>,
}

impl Factored<'_> {
    /// A right side of zeros.
    pub(crate) fn right(&self) -> Vec<[f64; 3]> {
        vec![[0.0; 3]; self.inverses.len()]
    }

    /// Adds to a right side at a node.
    pub(crate) fn add_right(&self, right: &mut [[f64; 3]], row: usize, by: [f64; 3]) {
        let right = &mut right[self.plan.place[row]];
        (0..3).for_each(|axis| right[axis] += by[axis]);
    }

    /// The solution for a right side in elimination order, node by node.
    pub(crate) fn solve(&self, mut right: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
        let count = self.inverses.len();
        for k in 0..count {
            for (row, factor) in self.plan.columns[k].iter().zip(&self.below[k]) {
                let by = applied(factor, right[k]);
                (0..3).for_each(|axis| right[*row][axis] -= by[axis]);
            }
            right[k] = applied(&self.inverses[k], right[k]);
        }
        for k in (0..count).rev() {
            for (row, factor) in self.plan.columns[k].iter().zip(&self.below[k]) {
                let by = applied(&transposed(factor), right[*row]);
                (0..3).for_each(|axis| right[k][axis] -= by[axis]);
            }
        }
        let place = &self.plan.place;
        place.iter().map(|place| right[*place]).collect()
    }
}

fn add_to(to: &mut Matrix, by: &Matrix) {
    for (to, by) in to.iter_mut().flatten().zip(by.iter().flatten()) {
        *to += by;
    }
}

fn subtract(to: &mut Matrix, by: &Matrix) {
    for (to, by) in to.iter_mut().flatten().zip(by.iter().flatten()) {
        *to -= by;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::matrix::diagonal;
    use proptest::prelude::*;

    proptest! {
        /// Random graphs with a dominant diagonal: inserting the solution gives the right side.
        #[test]
        fn the_solution_gives_the_right_side(
            edges in proptest::collection::vec((0_usize..12, 0_usize..12, -1.0_f64..1.0), 0..40),
            right in proptest::collection::vec(-5.0_f64..5.0, 36),
        ) {
            let plan = Plan::new(12, edges.iter().map(|(a, b, _)| (*a, *b)));
            let mut system = System::new(&plan);
            let mut dense = vec![[0.0; 36]; 36];
            let mut put = |a: usize, b: usize, block: &Matrix| {
                for r in 0..3 {
                    for c in 0..3 {
                        dense[3 * a + r][3 * b + c] += block[r][c];
                        if a != b {
                            dense[3 * b + c][3 * a + r] += block[r][c];
                        }
                    }
                }
            };
            for node in 0..12 {
                let block = diagonal([90.0, 80.0, 70.0]);
                system.add(node, node, &block);
                put(node, node, &block);
                system.add_right(node, [0, 1, 2].map(|axis| right[3 * node + axis]));
            }
            for (a, b, value) in edges.iter().filter(|(a, b, _)| a != b) {
                let block = [[*value, 0.5, 0.0], [0.0, *value, 0.3], [0.1, 0.0, -*value]];
                system.add(*a, *b, &block);
                put(*a, *b, &block);
            }
            let found = system.solve().expect("a heavy diagonal");
            let flat: Vec<f64> = found.into_iter().flatten().collect();
            for (row, right) in dense.iter().zip(&right) {
                let sum: f64 = row.iter().zip(&flat).map(|(a, b)| a * b).sum();
                prop_assert!((sum - right).abs() < 1e-9, "{sum} {right}");
            }
        }
    }
}
