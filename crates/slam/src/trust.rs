//! Warnings about a map: reasons why it may be wrong.

use super::survey::Survey;
use crate::mapping::motion::distance;

/// A reason why a map may be wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warning {
    /// The map has this number of separate parts.
    Parts(usize),
    /// This number of joins of two parts rests on one place, or on a place that resembles another.
    Joins(usize),
    /// The 95 % bound of the error, metres, is a large part of the path.
    Error(f64),
    /// The odometry alone may be more accurate than the map.
    Odometry,
}

/// Error of a map that is worth a warning, as a part of the path.
const ERROR_MOST: f64 = 0.005;

impl Warning {
    /// The name in `timing.json`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Parts(_) => "parts",
            Self::Joins(_) => "joins",
            Self::Error(_) => "error",
            Self::Odometry => "odometry",
        }
    }

    /// The warning as a sentence.
    pub fn words(self) -> String {
        match self {
            Self::Parts(parts) => format!(
                "the map has {parts} separate parts: the robot moved without usable scans, and no \
                 place of one part was recognised in another. The pose of one part relative to \
                 another is unknown. The column part of scans.csv names the part of each scan"
            ),
            Self::Joins(joins) => format!(
                "{joins} times the robot moved unseen and was recognised at one place only, or at a \
                 place that resembles another. A similar place may have been taken for it, so the \
                 pose of what follows may be wrong"
            ),
            Self::Error(bound_m) => format!(
                "the map may be off by {bound_m:.2} m on average, more than {} % of the path: few \
                 loop closures correct it",
                100.0 * ERROR_MOST
            ),
            Self::Odometry => "the odometry alone may be more accurate than the map: the two \
                               differ by less than the possible error of the map"
                .to_owned(),
        }
    }
}

impl Survey {
    /// All reasons why the map may be wrong.
    pub fn warnings(&self) -> Vec<Warning> {
        let parts = self.parts.filter(|parts| *parts > 1).map(Warning::Parts);
        let joins = (self.unsure_joins > 0).then_some(Warning::Joins(self.unsure_joins));
        let steps = self.way.windows(2);
        let way_m: f64 = steps.map(|two| distance(two[0].1, two[1].1)).sum();
        let known = self.accuracy.as_ref();
        let bound = known.map(|known| known.bound_m);
        let error = bound.filter(|bound_m| *bound_m > ERROR_MOST * way_m);
        let is_near = known.is_some_and(|known| known.may_be_worse_than_wheels());
        let odometry = is_near.then_some(Warning::Odometry);
        let all = [parts, joins, error.map(Warning::Error), odometry];
        all.into_iter().flatten().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mapping::Accuracy;
    use emulators::world::Pose;

    /// A path of 100 m with an error of 0.4 m or 0.6 m, 5 m or 0.5 m from the odometry; then an
    /// unsure join, and two parts.
    #[test]
    fn each_reason_is_named() {
        let names = |accuracy: Option<[f64; 2]>, joins: usize, parts: usize| {
            let mut survey = Survey::empty(2);
            survey.way = vec![(0.0, Pose::default()), (1.0, Pose::new(100.0, 0.0, 0.0))];
            survey.parts = Some(parts);
            survey.unsure_joins = joins;
            survey.accuracy = accuracy.map(|[bound_m, far_m]| Accuracy {
                bound_m,
                from_wheels_m: Some(far_m),
                covariances: Vec::new(),
            });
            let warnings = survey.warnings();
            assert!(warnings.iter().all(|warning| warning.words().len() > 40));
            warnings.into_iter().map(Warning::name).collect::<Vec<_>>()
        };
        assert!(names(Some([0.4, 5.0]), 0, 1).is_empty());
        assert_eq!(names(Some([0.6, 5.0]), 0, 1), ["error"]);
        assert_eq!(names(Some([0.4, 0.5]), 0, 1), ["odometry"]);
        assert_eq!(names(None, 1, 1), ["joins"]);
        assert_eq!(names(None, 0, 2), ["parts"]);
    }
}
