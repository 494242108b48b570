//! A column of figures over time, from a CSV file.

/// Times in seconds and values, in rising order of time.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Recording(Vec<(f64, f64)>);

/// Error in a CSV file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum RecordingError {
    /// The column does not exist; with those that do.
    Column(String),
    /// The contents are wrong; with the line.
    Contents(String),
}

impl From<String> for RecordingError {
    fn from(message: String) -> Self {
        Self::Contents(message)
    }
}

impl Recording {
    /// Reads the column `column` of `text`. The first line names the columns; the first column is
    /// the time in seconds.
    ///
    /// # Errors
    /// If the column is missing, or a cell is not a number.
    pub(crate) fn parse(text: &str, column: &str) -> Result<Self, RecordingError> {
        let mut lines = (1..)
            .zip(text.lines())
            .filter(|(_, line)| !line.trim().is_empty());
        let (_, head) = lines
            .next()
            .ok_or_else(|| "the file is empty, expected a line with names".to_owned())?;
        let names: Vec<_> = head.split(',').map(str::trim).collect();
        let at = names.iter().skip(1).position(|name| *name == column);
        let at = 1 + at.ok_or_else(|| {
            let names = names.get(1..).unwrap_or_default().join(", ");
            let message = format!("there is no column \"{column}\", expected one of: {names}");
            RecordingError::Column(message)
        })?;
        let mut points: Vec<(f64, f64)> = Vec::new();
        for (number, line) in lines {
            let cells: Vec<_> = line.split(',').map(str::trim).collect();
            let cell = |at: usize| {
                let text = cells.get(at).copied().unwrap_or_default();
                let figure = text.parse::<f64>().ok().filter(|figure| figure.is_finite());
                figure.ok_or_else(|| format!("line {number}: \"{text}\" is no number"))
            };
            let point = (cell(0)?, cell(at)?);
            if points.last().is_some_and(|(before, _)| *before >= point.0) {
                let message = format!("line {number}: time {} is not later than before", point.0);
                return Err(message.into());
            }
            points.push(point);
        }
        match points.is_empty() {
            true => Err("expected at least one line of numbers".to_owned().into()),
            false => Ok(Self(points)),
        }
    }

    /// The value at a time: the last one recorded before it.
    pub(crate) fn at(&self, seconds: f64, repeats: bool) -> f64 {
        let (first, last) = (self.0[0], self.0[self.0.len() - 1]);
        let seconds = match repeats && last.0 > first.0 {
            true => first.0 + (seconds - first.0).rem_euclid(last.0 - first.0),
            false => seconds,
        };
        let behind = self.0.partition_point(|(at, _)| *at <= seconds);
        self.0[behind.saturating_sub(1)].1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_is_read_and_held_until_the_next_line() {
        let text = "time,u,i\n0,1.5,2\n1.0,2.5,3\n\n2,3.5,4\n";
        let recording = Recording::parse(text, "i").expect("sound");
        let read = |seconds, repeats| recording.at(seconds, repeats);
        assert_eq!(
            [read(0.5, false), read(1.0, false), read(9.0, false)],
            [2.0, 3.0, 4.0]
        );
        // The recording repeats with a period of two seconds.
        assert_eq!([read(2.5, true), read(3.5, true)], [2.0, 3.0]);
        let error = |text, column| match Recording::parse(text, column).expect_err("wrong") {
            RecordingError::Column(message) | RecordingError::Contents(message) => message,
        };
        assert_eq!(
            error("time,u\n0,1", "x"),
            "there is no column \"x\", expected one of: u"
        );
        assert_eq!(error("time,u\n0,a", "u"), "line 2: \"a\" is no number");
        assert_eq!(
            error("time,u\n0,1\n0,2", "u"),
            "line 3: time 0 is not later than before"
        );
        assert_eq!(
            error("time,u\n", "u"),
            "expected at least one line of numbers"
        );
    }
}
