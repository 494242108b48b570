//! A figure of a real device beside that of the emulated one, with the allowed difference.

/// Allowed difference of a figure from its reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// Within this share of the real figure, up or down; 0 demands the same figure.
    Share(f64),
    /// At most this difference, in the figure's unit.
    Plus(f64),
    /// Not judged: the figure depends on the surroundings or on the start of the recording.
    Free,
}

/// A figure of two streams.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Name of the figure.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Figure of the reference stream; `None` if that stream does not show it.
    pub real: Option<f64>,
    /// Value in the second stream.
    pub ours: Option<f64>,
    /// Allowed difference.
    pub limit: Limit,
}

impl Comparison {
    /// Whether the figures agree; `None` if the limit is free or the reference does not show the
    /// figure.
    pub fn holds(&self) -> Option<bool> {
        let real = self.real?;
        let allowed = match self.limit {
            Limit::Free => return None,
            Limit::Share(share) => share * real.abs(),
            Limit::Plus(plus) => plus,
        };
        let ours = self.ours.filter(|ours| ours.is_finite());
        Some(ours.is_some_and(|ours| (ours - real).abs() <= allowed + 1e-9))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn comparison(real: f64, ours: f64, limit: Limit) -> Comparison {
        Comparison {
            name: String::new(),
            unit: "",
            real: Some(real),
            ours: Some(ours),
            limit,
        }
    }

    #[test]
    fn a_figure_agrees_within_its_limit_and_not_beyond() {
        assert_eq!(comparison(2.0, 2.5, Limit::Share(0.25)).holds(), Some(true));
        assert_eq!(
            comparison(2.0, 2.51, Limit::Share(0.25)).holds(),
            Some(false)
        );
        assert_eq!(comparison(3.0, 2.0, Limit::Plus(1.0)).holds(), Some(true));
        assert_eq!(comparison(3.0, 4.1, Limit::Plus(1.0)).holds(), Some(false));
        assert_eq!(comparison(3.0, 9.0, Limit::Free).holds(), None);
        assert_eq!(
            comparison(3.0, f64::NAN, Limit::Plus(1.0)).holds(),
            Some(false)
        );
    }

    /// A figure that only one of the streams has counts as a difference.
    #[test]
    fn a_missing_figure_disagrees() {
        let missing = Comparison {
            ours: None,
            ..comparison(3.0, 3.0, Limit::Plus(1.0))
        };
        assert_eq!(missing.holds(), Some(false));
    }
}
