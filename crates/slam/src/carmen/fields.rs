//! The fields of a line in order, each with a name for error messages.

use emulators::world::Pose;

use crate::BEAMS_MAX;
use crate::finding::Kind;

/// Maximum distance from the origin that is plausible, metres.
const FAR_M: f64 = 1e5;

/// The reason why a line is skipped.
pub(super) struct Refusal {
    pub(super) kind: Kind,
    pub(super) words: String,
}

pub(super) fn refusal(kind: Kind, words: String) -> Refusal {
    Refusal { kind, words }
}

/// The fields of a line in order.
pub(super) struct Fields<'a> {
    rest: core::str::SplitAsciiWhitespace<'a>,
    taken: usize,
}

impl<'a> Fields<'a> {
    pub(super) fn of(line: &'a str) -> Self {
        Self {
            rest: line.split_ascii_whitespace(),
            taken: 0,
        }
    }

    pub(super) fn next(&mut self) -> Option<&'a str> {
        self.taken += 1;
        self.rest.next()
    }

    pub(super) fn skip(&mut self, count: usize) {
        (0..count).for_each(|_| {
            self.next();
        });
    }

    pub(super) fn number(&mut self, name: &str) -> Result<f64, Refusal> {
        let value = self.parsed(name)?;
        if value.is_finite() && value.abs() < 1e12 {
            Ok(value)
        } else {
            Err(refusal(
                Kind::Absurd,
                format!("{name} is {value}, expected a number"),
            ))
        }
    }

    /// A number that may be infinite or NaN.
    pub(super) fn parsed(&mut self, name: &str) -> Result<f64, Refusal> {
        let Some(field) = self.next() else {
            let words = format!("ends before {name}, field {}", self.taken);
            return Err(refusal(Kind::Unreadable, words));
        };
        field.parse().map_err(|_| {
            let shown: String = field.chars().take(20).collect();
            let words = format!("{name} is \"{}\", expected a number", shown.escape_debug());
            refusal(Kind::Unreadable, words)
        })
    }

    pub(super) fn count(&mut self, name: &str) -> Result<usize, Refusal> {
        let value = self.parsed(name)?;
        if (0.0..=BEAMS_MAX as f64).contains(&value) && value.fract() == 0.0 {
            #[expect(clippy::cast_possible_truncation, reason = "a small whole number")]
            #[expect(clippy::cast_sign_loss, reason = "not negative")]
            let count = value as usize;
            Ok(count)
        } else {
            let words = format!("number of {name} is {value}, expected 0 to {BEAMS_MAX}");
            Err(refusal(Kind::Absurd, words))
        }
    }

    pub(super) fn ranges(&mut self) -> Result<Vec<f64>, Refusal> {
        let count = self.count("ranges")?;
        (0..count).map(|_| self.parsed("a range")).collect()
    }

    pub(super) fn pose(&mut self, name: &str) -> Result<Pose, Refusal> {
        let pose = Pose::new(self.number(name)?, self.number(name)?, self.number(name)?);
        if pose.x.abs() > FAR_M || pose.y.abs() > FAR_M || pose.theta.abs() > FAR_M {
            let words = format!(
                "{name} is {} {} {}, expected at most {FAR_M} m",
                pose.x, pose.y, pose.theta
            );
            return Err(refusal(Kind::Absurd, words));
        }
        Ok(pose)
    }
}
