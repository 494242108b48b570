//! Rows and cells of comma-separated values, RFC 4180: a quoted cell may contain commas, line ends,
//! and doubled quotes.

use super::text::{Line, lines, utf8};

/// A row and its position in the file.
#[derive(Clone, Debug)]
pub(super) struct CellRow<'a> {
    pub(super) line: Line<'a>,
    pub(super) cells: Vec<String>,
}

impl CellRow<'_> {
    /// The cell of a column; empty if the row is shorter.
    pub(super) fn cell(&self, column: usize) -> &str {
        self.cells.get(column).map_or("", String::as_str)
    }
}

/// All rows that are not empty, with cells trimmed of spaces.
pub(super) fn rows(bytes: &[u8]) -> impl Iterator<Item = CellRow<'_>> {
    rows_of(bytes, divider(bytes))
}

/// The mark between cells. Where the comma is the decimal mark, tools write semicolons.
pub(super) fn divider(bytes: &[u8]) -> char {
    let is_head = |line: &Line<'_>| !line.text.is_empty() && !b";#".contains(&line.text[0]);
    let head = lines(bytes).find(is_head);
    let has = |mark: u8| head.is_some_and(|line| line.text.contains(&mark));
    if has(b';') && !has(b',') { ';' } else { ',' }
}

/// As `rows`, with another separator.
pub(super) fn rows_of(bytes: &[u8], divider: char) -> impl Iterator<Item = CellRow<'_>> {
    let mut lines = lines(bytes).filter(|line| !line.text.is_empty());
    core::iter::from_fn(move || {
        let first = lines.next()?;
        let mut text = utf8(first.text).to_owned();
        // An odd number of quotes: a cell continues in the next line.
        while text.matches('"').count() % 2 == 1 {
            let Some(more) = lines.next() else { break };
            text.push('\n');
            text.push_str(utf8(more.text));
        }
        let cells = cells_of(&text, divider);
        Some(CellRow { line: first, cells })
    })
}

/// The cells of a row.
#[cfg(test)]
pub(super) fn cells(row: &str) -> Vec<String> {
    cells_of(row, ',')
}

/// As `cells`, with another divider.
pub(super) fn cells_of(row: &str, divider: char) -> Vec<String> {
    let (mut cells, mut cell, mut quoted) = (Vec::new(), String::new(), false);
    let mut chars = row.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if quoted && chars.next_if_eq(&'"').is_some() => cell.push('"'),
            '"' => quoted = !quoted,
            c if c == divider && !quoted => cells.push(core::mem::take(&mut cell)),
            c => cell.push(c),
        }
    }
    cells.push(cell);
    cells.iter().map(|cell| cell.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// RFC 4180: a quoted cell may contain commas and doubled quotes.
    #[test]
    fn a_row_is_cut_at_its_commas() {
        assert_eq!(cells("a, b ,,c"), ["a", "b", "", "c"]);
        assert_eq!(
            cells("\"a,b\",\"say \"\"no\"\"\",c"),
            ["a,b", "say \"no\"", "c"]
        );
        assert_eq!(cells("\"\",\"\"\"\""), ["", "\""]);
        assert_eq!(cells(""), [""]);
    }

    #[test]
    fn semicolons_divide_cells_beside_decimal_commas() {
        let cut = |bytes| rows(bytes).map(|row| row.cells).collect::<Vec<_>>();
        let found = cut(b"Time [s];Value\n0,5;0x41\n");
        assert_eq!(found, [["Time [s]", "Value"], ["0,5", "0x41"]]);
        assert_eq!(cut(b"; Rate: 1\na,b;c\n")[1], ["a", "b;c"]);
    }

    /// RFC 4180, rule 6: a line end inside quotes is part of the cell.
    #[test]
    fn a_quoted_cell_may_go_on_in_the_next_line() {
        let rows: Vec<_> = rows(b"a,\"b\r\nc\"\r\n\r\nd,e\r\n").collect();
        let cells: Vec<_> = rows.iter().map(|row| row.cells.clone()).collect();
        assert_eq!(cells, [["a", "b\nc"], ["d", "e"]]);
        assert_eq!(rows[1].line.number, 4);
        assert_eq!((rows[0].cell(0), rows[0].cell(7)), ("a", ""));
    }
}
