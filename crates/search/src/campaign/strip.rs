//! All runs of a campaign in order, as small squares that are coloured by cause.

use core::fmt::{self, Write as _};

use show::html::Escaped;

/// Maximum number of squares: in a larger campaign a square stands for several runs.
const SQUARES_MAX: usize = 1200;
/// Number of squares in a row.
const COLUMNS: usize = 120;
/// Number of causes with their own colour: the most frequent ones.
pub(super) const COLOURS: usize = 6;

/// All runs in order, with the cause of each failure.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Strip {
    /// The cause of each run by rank and name; 0 is the most frequent cause.
    runs: Vec<Option<usize>>,
}

impl Strip {
    /// The strip of runs with these causes; `causes` lists all causes, the most frequent first.
    pub(super) fn of<'a>(
        runs: impl Iterator<Item = Option<&'a str>>,
        causes: impl Fn(&str) -> Option<usize>,
    ) -> Self {
        let number = |cause: Option<&str>| cause.and_then(&causes);
        Self {
            runs: runs.map(number).collect(),
        }
    }

    /// Number of runs per square.
    fn each(&self) -> usize {
        self.runs.len().div_ceil(SQUARES_MAX).max(1)
    }

    /// The most frequent cause of each square, if any of its runs failed: one failure among many
    /// passes stays visible.
    fn squares(&self) -> impl Iterator<Item = Option<usize>> {
        self.runs.chunks(self.each()).map(|square| {
            let mut causes: Vec<usize> = square.iter().copied().flatten().collect();
            causes.sort_unstable();
            let groups = causes.chunk_by(|a, b| a == b);
            let most = groups.max_by(|a, b| a.len().cmp(&b.len()).then(b[0].cmp(&a[0])));
            most.map(|group| group[0])
        })
    }

    /// Writes the strip as SVG; `names` are the names of the causes.
    pub(super) fn write(&self, names: &[&str], out: &mut String) -> fmt::Result {
        let squares: Vec<Option<usize>> = self.squares().collect();
        let failed = self.runs.iter().flatten().count();
        let each = match self.each() {
            1 => String::new(),
            each => format!("; {each} runs in a square, which shows the most frequent failure"),
        };
        let (columns, rows) = (squares.len().min(COLUMNS), squares.len().div_ceil(COLUMNS));
        write!(
            out,
            "<figure class=\"strip\"><svg viewBox=\"0 0 {} {}\" style=\"max-width:{}px\" \
             role=\"img\" aria-label=\"{} runs in order, {failed} of them failed\">",
            columns * 10,
            rows * 10,
            columns * 14,
            self.runs.len()
        )?;
        for (index, cause) in squares.iter().enumerate() {
            let (x, y) = (index % COLUMNS * 10, index / COLUMNS * 10);
            let run = index * self.each();
            write!(
                out,
                "<rect x=\"{x}\" y=\"{y}\" width=\"9\" height=\"9\" class=\"{}\"",
                class(*cause)
            )?;
            match cause.and_then(|cause| names.get(cause)) {
                Some(name) => write!(out, "><title>run {run}: {}</title></rect>", Escaped(name))?,
                None => out.write_str("/>")?,
            }
        }
        write!(
            out,
            "</svg><figcaption>All runs in order, coloured as the causes below{each}\
             </figcaption></figure>"
        )
    }
}

/// The CSS class of a cause.
pub(super) fn class(cause: Option<usize>) -> String {
    match cause {
        None => "ran".to_owned(),
        Some(cause) => format!("c{}", cause.min(COLOURS)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strip(runs: impl Iterator<Item = Option<usize>>) -> Strip {
        Strip {
            runs: runs.collect(),
        }
    }

    /// 2,400 runs, two per square: one failure among 2,400 is visible. A square with two causes
    /// shows the one that is more frequent overall.
    #[test]
    fn no_failure_is_lost_in_a_long_strip() {
        let mut runs = vec![None; 2400];
        runs[1001] = Some(3);
        (runs[6], runs[7]) = (Some(2), Some(1));
        let strip = strip(runs.into_iter());
        let squares: Vec<_> = strip.squares().collect();
        assert_eq!(squares.len(), 1200);
        let failed = squares.iter().enumerate().filter(|(_, one)| one.is_some());
        let failed: Vec<_> = failed.map(|(index, one)| (index, *one)).collect();
        assert_eq!(failed, [(3, Some(1)), (500, Some(3))]);
    }

    #[test]
    fn a_square_names_its_cause_as_text() {
        let mut out = String::new();
        let strip = strip([None, Some(0)].into_iter());
        strip.write(&["<b>"], &mut out).expect("a string");
        assert!(
            out.contains("class=\"c0\"><title>run 1: &lt;b&gt;</title>"),
            "{out}"
        );
        assert!(out.contains("2 runs in order, 1 of them failed"), "{out}");
        assert_eq!(class(Some(9)), "c6");
    }
}
