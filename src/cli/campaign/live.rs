//! Failures by cause while a campaign runs: a table on the terminal, and a page in the campaign's
//! folder that reloads itself.

use core::fmt::Write as _;
use core::time::Duration;
use std::io;

use protocols::Instant;
use rustix::termios::tcgetwinsize;

use crate::cli::{CliError, progress};
use crate::search::campaign::{self, Failures, Store};

/// Time between two updates.
const PERIOD: Duration = Duration::from_secs(5);
/// Maximum number of causes on a terminal.
const ROWS_MAX: usize = 12;
/// Columns of a terminal that does not report its width.
const COLUMNS: usize = 80;

/// The live view of a running campaign.
pub(super) struct Live {
    /// Runs to be done in this process.
    todo: usize,
    said: Instant,
    /// Rows of the table on the terminal.
    drawn: usize,
}

impl Live {
    /// Starts the view for `todo` runs at the time `now`.
    pub(super) const fn new(todo: usize, now: Instant) -> Self {
        Self {
            todo,
            said: now,
            drawn: 0,
        }
    }

    /// Shows the state of `store` if an update is due; `ended` runs have ended in this process
    /// since time zero.
    ///
    /// # Errors
    /// If the folder cannot be written.
    pub(super) fn look(
        &mut self,
        ended: usize,
        now: Instant,
        store: &Store,
    ) -> Result<(), CliError> {
        if now - self.said < PERIOD {
            return Ok(());
        }
        self.said = now;
        let share = ended as f64 / self.todo.max(1) as f64;
        let left = progress::left(now - Instant::ZERO, share);
        let failed = store.failed();
        let far = format!("{ended} of {} runs, {failed} failed{left}", self.todo);
        let failures = store.failures();
        store.show(&campaign::live_page(
            store.plan(),
            &far,
            &failures,
            Some(PERIOD),
        ))?;
        if progress::is_watched() {
            let size = tcgetwinsize(io::stderr());
            let columns = size.map_or(0, |size| usize::from(size.ws_col));
            let columns = if columns == 0 { COLUMNS } else { columns };
            let table = table(&far, &failures, columns);
            eprint!("{}{table}", above(self.drawn));
            self.drawn = table.lines().count();
        }
        Ok(())
    }
}

/// Moves the cursor to the first of `rows` rows, and clears them.
fn above(rows: usize) -> String {
    match rows {
        0 => String::new(),
        rows => format!("\x1b[{rows}A\r\x1b[J"),
    }
}

/// The progress, and a row for each cause. Rows are cut to the terminal's width, because wrapped
/// rows would not be cleared.
fn table(far: &str, failures: &[Failures<'_>], columns: usize) -> String {
    let mut rows = vec![format!("  {far}")];
    for failures in failures.iter().take(ROWS_MAX) {
        let (scenario, seed) = failures.first;
        let (runs, cause) = (failures.runs, failures.cause);
        rows.push(format!(
            "  {runs:>5}  {cause} (first {scenario} seed {seed})"
        ));
    }
    if failures.len() > ROWS_MAX {
        rows.push(format!(
            "         and {} causes more",
            failures.len() - ROWS_MAX
        ));
    }
    let mut out = String::new();
    for row in rows {
        let shown = row.chars().filter(|c| !c.is_control());
        let shown: String = shown.take(columns.saturating_sub(1)).collect();
        writeln!(out, "{shown}").expect("a string takes everything");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn failures(cause: &str, runs: usize) -> Failures<'_> {
        Failures {
            cause,
            runs,
            first: ("legs", 17),
        }
    }

    /// 30 columns hold 29 characters and the cursor; a panic message may contain any character.
    #[test]
    fn a_row_never_wraps() {
        let causes = [
            failures("settled: to and fro", 14),
            failures("panic: \n\x1b[2J#", 2),
        ];
        let table = table("40 of 90 runs, 16 failed", &causes, 30);
        let rows: Vec<&str> = table.split('\n').collect();
        assert_eq!(
            rows,
            [
                "  40 of 90 runs, 16 failed",
                "     14  settled: to and fro ",
                "      2  panic: [2J# (first l",
                "",
            ]
        );
    }

    /// Twelve rows and the number of omitted ones, because a terminal has few rows.
    #[test]
    fn many_causes_leave_the_first_on_the_screen() {
        let causes = [failures("settled", 1); 15];
        let table = table("", &causes, 80);
        assert_eq!(table.lines().count(), 14);
        assert!(table.ends_with("         and 3 causes more\n"), "{table}");
    }

    #[test]
    fn what_was_drawn_is_cleared() {
        assert_eq!(above(0), "");
        assert_eq!(above(3), "\x1b[3A\r\x1b[J");
    }
}
