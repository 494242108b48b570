//! The text format of primitives, `.mprim`, as sbpl reads it.
//!
//! ```text
//! resolution_m: 0.05
//! numberofangles: 16
//! totalnumberofprimitives: 80
//! primID: 0
//! startangle_c: 0
//! endpose_c: 1 0 0
//! additionalactioncostmult: 1
//! intermediateposes: 10
//! 0.0000 0.0000 0.0000
//! ..
//! ```
//!
//! Words are separated by white space, in this order. The heading of `endpose_c` is absolute and
//! may be below 0 or beyond the last: it is taken modulo the number of headings.

use core::fmt::{self, Write as _};
use core::str::FromStr;

use alloc::string::{String, ToString as _};
use alloc::vec::Vec;

use super::primitives::{Primitive, PrimitiveError, PrimitiveSet};

/// Maximum number of poses of a primitive: more mean a damaged file.
const POSES_MAX: usize = 1_000;
/// Maximum number of primitives of a file.
const PRIMITIVES_MAX: usize = 100_000;

/// Reason why a text is not a set of primitives.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MprimError {
    /// Another word was expected.
    Word {
        /// Line of the word, from 1.
        line: usize,
        /// The expected word.
        expected: &'static str,
        /// The actual word; empty at the end.
        found: String,
    },
    /// The primitives do not fit together.
    Set(PrimitiveError),
}

impl fmt::Display for MprimError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Word {
                line,
                expected,
                found,
            } if found.is_empty() => write!(f, "line {line}: ends, expected {expected}"),
            Self::Word {
                line,
                expected,
                found,
            } => write!(f, "line {line}: \"{found}\", expected {expected}"),
            Self::Set(error) => write!(f, "{error}"),
        }
    }
}

impl core::error::Error for MprimError {}

impl From<PrimitiveError> for MprimError {
    fn from(error: PrimitiveError) -> Self {
        Self::Set(error)
    }
}

/// Reads a file of primitives.
///
/// # Errors
/// With line, word and the expected content; or the primitive that does not fit.
pub fn parse(text: &str) -> Result<PrimitiveSet, MprimError> {
    let mut words = Words::new(text);
    let resolution_m = words.labelled("resolution_m:", "a number")?;
    let angles: u32 = words.labelled("numberofangles:", "a whole number")?;
    let count: usize = words.labelled("totalnumberofprimitives:", "a whole number")?;
    if count > PRIMITIVES_MAX || !(4..=256).contains(&angles) {
        return Err(PrimitiveError::Grid.into());
    }
    let mut primitives = Vec::new();
    for _ in 0..count {
        primitives.push(words.primitive(angles)?);
    }
    Ok(PrimitiveSet::new(resolution_m, angles, primitives)?)
}

/// The text of a set.
pub fn write(set: &PrimitiveSet) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = write_to(set, &mut text);
    text
}

fn write_to(set: &PrimitiveSet, text: &mut String) -> fmt::Result {
    writeln!(text, "resolution_m: {:.6}", set.resolution_m())?;
    writeln!(text, "numberofangles: {}", set.angles())?;
    writeln!(text, "totalnumberofprimitives: {}", set.all().len())?;
    for primitive in set.all() {
        let ([x, y], angle) = primitive.end;
        writeln!(text, "primID: {}", primitive.id)?;
        writeln!(text, "startangle_c: {}", primitive.start)?;
        writeln!(text, "endpose_c: {x} {y} {angle}")?;
        writeln!(text, "additionalactioncostmult: {}", primitive.multiplier)?;
        writeln!(text, "intermediateposes: {}", primitive.poses.len())?;
        for [x, y, heading] in &primitive.poses {
            writeln!(text, "{x:.6} {y:.6} {heading:.6}")?;
        }
    }
    Ok(())
}

/// Words with their lines.
struct Words<'a> {
    words: alloc::boxed::Box<dyn Iterator<Item = (usize, &'a str)> + 'a>,
    line: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        let lines = (1..).zip(text.lines());
        let words =
            lines.flat_map(|(line, text)| text.split_whitespace().map(move |word| (line, word)));
        Self {
            words: alloc::boxed::Box::new(words),
            line: 1,
        }
    }

    fn next(&mut self) -> &'a str {
        let (line, word) = self.words.next().unwrap_or((self.line, ""));
        self.line = line;
        word
    }

    fn wrong(&self, expected: &'static str, found: &str) -> MprimError {
        MprimError::Word {
            line: self.line,
            expected,
            found: found.to_string(),
        }
    }

    fn value<T: FromStr>(&mut self, expected: &'static str) -> Result<T, MprimError> {
        let word = self.next();
        word.parse().map_err(|_| self.wrong(expected, word))
    }

    fn labelled<T: FromStr>(
        &mut self,
        label: &'static str,
        expected: &'static str,
    ) -> Result<T, MprimError> {
        let word = self.next();
        if word != label {
            return Err(self.wrong(label, word));
        }
        self.value(expected)
    }

    fn primitive(&mut self, angles: u32) -> Result<Primitive, MprimError> {
        let id = self.labelled("primID:", "a whole number")?;
        let start = self.labelled("startangle_c:", "a whole number")?;
        let x = self.labelled("endpose_c:", "a whole number")?;
        let y = self.value("a whole number")?;
        let angle: i32 = self.value("a whole number")?;
        let multiplier = self.labelled("additionalactioncostmult:", "a whole number")?;
        let count: usize = self.labelled("intermediateposes:", "a whole number")?;
        if count > POSES_MAX {
            return Err(self.wrong("at most 1000 poses", &count.to_string()));
        }
        let mut poses = Vec::with_capacity(count);
        for _ in 0..count {
            let mut pose = [0.0; 3];
            for value in &mut pose {
                *value = self.value("a number")?;
            }
            poses.push(pose);
        }
        let angle = angle.rem_euclid(i32::try_from(angles).unwrap_or(i32::MAX));
        Ok(Primitive {
            id,
            start,
            end: ([x, y], u32::try_from(angle).unwrap_or(0)),
            multiplier,
            poses,
        })
    }
}
