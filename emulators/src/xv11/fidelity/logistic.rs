//! A plain classifier: logistic regression on scaled figures.
//!
//! A crate for machine learning brings an algebra library; four figures and some hundred rows need
//! neither.

/// Steps of the descent, and their length.
const STEPS: usize = 400;
const LENGTH: f64 = 0.5;
/// Weight of the penalty on large weights, so that a few windows are not memorised.
const PENALTY: f64 = 0.01;

/// A trained classifier.
#[derive(Clone, Debug)]
pub(super) struct Logistic {
    mean: Vec<f64>,
    scale: Vec<f64>,
    weights: Vec<f64>,
    bias: f64,
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = values.clone().count().max(1);
    values.sum::<f64>() / n as f64
}

impl Logistic {
    /// Learns to distinguish `yes` and `no`; both count the same, whatever their numbers of rows.
    pub(super) fn trained(yes: &[Vec<f64>], no: &[Vec<f64>]) -> Self {
        let width = yes.first().or(no.first()).map_or(0, Vec::len);
        let rows: Vec<&Vec<f64>> = yes.iter().chain(no).collect();
        let column = |index: usize| rows.iter().map(move |row| row[index]);
        let means: Vec<f64> = (0..width).map(|index| mean(column(index))).collect();
        let scale = (0..width).map(|index| {
            let variance = mean(column(index).map(|value| (value - means[index]).powi(2)));
            variance.sqrt().max(1e-9)
        });
        let mut found = Self {
            scale: scale.collect(),
            mean: means,
            weights: vec![0.0; width],
            bias: 0.0,
        };
        let parts = [(yes, 1.0), (no, 0.0)];
        for _ in 0..STEPS {
            let mut slope = vec![0.0; width];
            let mut lift = 0.0;
            for (rows, truth) in parts {
                for row in rows {
                    let weight = 0.5 / rows.len().max(1) as f64;
                    let miss = weight * (truth - found.chance(row));
                    lift += miss;
                    for (sum, value) in slope.iter_mut().zip(found.scaled(row)) {
                        *sum += miss * value;
                    }
                }
            }
            found.bias += LENGTH * lift;
            for (weight, sum) in found.weights.iter_mut().zip(slope) {
                *weight += LENGTH * (sum - PENALTY * *weight);
            }
        }
        found
    }

    fn scaled(&self, row: &[f64]) -> Vec<f64> {
        let parts = row.iter().zip(self.mean.iter().zip(&self.scale));
        parts
            .map(|(value, (mean, scale))| (value - mean) / scale)
            .collect()
    }

    /// Chance that `row` is a `yes`.
    pub(super) fn chance(&self, row: &[f64]) -> f64 {
        let scaled = self.scaled(row);
        let sum: f64 = self.weights.iter().zip(scaled).map(|(a, b)| a * b).sum();
        1.0 / (1.0 + libm::exp(-(sum + self.bias)))
    }

    /// Indices of the figures, those with the largest weights first.
    pub(super) fn heaviest_first(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.weights.len()).collect();
        order.sort_by(|a, b| self.weights[*b].abs().total_cmp(&self.weights[*a].abs()));
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heap(from: f64) -> Vec<Vec<f64>> {
        (0..40)
            .map(|k| vec![f64::from(k % 3), from + f64::from(k * 7 % 20) * 0.1])
            .collect()
    }

    /// Two separate groups are always distinguished, by the figure in which they differ. A group is
    /// never distinguished from itself.
    #[test]
    fn what_differs_is_told_and_what_does_not_is_not() {
        let apart = Logistic::trained(&heap(5.0), &heap(0.0));
        assert!(heap(5.0).iter().all(|row| apart.chance(row) > 0.5));
        assert!(heap(0.0).iter().all(|row| apart.chance(row) < 0.5));
        assert_eq!(apart.heaviest_first(), [1, 0]);
        let alike = Logistic::trained(&heap(0.0), &heap(0.0));
        let chances = heap(0.0).into_iter().map(|row| alike.chance(&row));
        assert!(chances.clone().all(|chance| (chance - 0.5).abs() < 1e-6));
    }

    /// By hand, each figure less its mean, divided by its deviation: (7 - 1) / 2 and (-4 - 2) / 3.
    #[test]
    fn a_figure_is_scaled_by_mean_and_deviation() {
        let known = Logistic {
            mean: vec![1.0, 2.0],
            scale: vec![2.0, 3.0],
            weights: vec![0.5, 1.0],
            bias: 0.5,
        };
        assert_eq!(known.scaled(&[7.0, -4.0]), [3.0, -2.0]);
        // The sum is 1.5 - 2 plus the bias of 0.5, which is 0.
        assert_eq!(known.chance(&[7.0, -4.0]), 0.5);
    }

    /// Ten times as many rows of one kind do not make it likelier.
    #[test]
    fn both_kinds_count_the_same() {
        let many: Vec<Vec<f64>> = (0..10).flat_map(|_| heap(0.0)).collect();
        let alike = Logistic::trained(&many, &heap(0.0));
        let chances = heap(0.0).into_iter().map(|row| alike.chance(&row));
        assert!(chances.clone().all(|chance| (chance - 0.5).abs() < 1e-6));
    }

    /// Both rows lie a deviation from their mean of 3. Where the descent ends, the miss of either
    /// is a hundredth of the weight w: 1 / (1 + exp(w)) = 0.01 w. So w is 3.36, the chance 0.966.
    #[test]
    fn the_penalty_limits_the_weight_of_a_sure_figure() {
        let found = Logistic::trained(&[vec![5.0]], &[vec![1.0]]);
        assert_eq!((found.mean[0], found.scale[0]), (3.0, 2.0));
        assert!((found.weights[0] - 3.36).abs() < 0.01, "{found:?}");
        assert!(found.bias.abs() < 1e-9);
        assert!((found.chance(&[5.0]) - 0.966_4).abs() < 1e-3);
        assert!((found.chance(&[1.0]) - 0.033_6).abs() < 1e-3);
    }

    /// Where the descent ends, the mean miss of both kinds is the same, and half of the difference
    /// of the misses times the scaled figure is a hundredth of its weight.
    #[test]
    fn the_descent_ends_where_its_slope_is_zero() {
        let yes = [0.0, 1.0, 2.0, 4.0].map(|value| vec![value]);
        let no = [0.0, -1.0].map(|value| vec![value]);
        let found = Logistic::trained(&yes, &no);
        // Mean 1 of six values whose squares add up to 22: the variance is 22 / 6 - 1.
        assert!((found.mean[0] - 1.0).abs() < 1e-12);
        assert!((found.scale[0] - (16.0_f64 / 6.0).sqrt()).abs() < 1e-12);
        let miss = |rows: &[Vec<f64>], truth: f64, power: i32| {
            let each = rows.iter().map(|row| {
                let scaled = (row[0] - found.mean[0]) / found.scale[0];
                (truth - found.chance(row)) * scaled.powi(power)
            });
            each.sum::<f64>() / rows.len() as f64
        };
        let lift = miss(&yes, 1.0, 0) + miss(&no, 0.0, 0);
        assert!(lift.abs() < 1e-3, "{lift}");
        let slope = (miss(&yes, 1.0, 1) + miss(&no, 0.0, 1)) / 2.0;
        assert!((slope - 0.01 * found.weights[0]).abs() < 1e-3, "{slope}");
        assert!(found.weights[0] > 1.0);
    }
}
