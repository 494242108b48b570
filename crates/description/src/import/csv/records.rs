//! The cells of a CSV file.

/// The separator of the first line: the most frequent of comma, semicolon and tab.
pub(super) fn separator(text: &str) -> char {
    let first = text.lines().next().unwrap_or_default();
    let count = |separator: char| first.matches(separator).count();
    let all = ['\t', ';', ','];
    all.into_iter().max_by_key(|one| count(*one)).unwrap_or(',')
}

/// A line number, and the cells of the line.
pub(super) type Record = (usize, Vec<String>);

/// The lines of a file in cells, with their line numbers; quotes may enclose a cell.
pub(super) fn records(text: &str, separator: char) -> Result<Vec<Record>, String> {
    let mut records: Vec<Record> = Vec::new();
    let (mut cells, mut cell, mut quoted_at) = (Vec::new(), String::new(), None);
    let (mut line, mut first) = (1, 1);
    let mut chars = text.chars().peekable();
    while let Some(c) = chars.next() {
        match c {
            '"' if quoted_at.is_some() && chars.peek() == Some(&'"') => {
                chars.next();
                cell.push('"');
            }
            '"' if quoted_at.is_some() => quoted_at = None,
            '"' if cell.trim().is_empty() => {
                cell.clear();
                quoted_at = Some(line);
            }
            '\n' if quoted_at.is_none() => {
                cells.push(core::mem::take(&mut cell));
                records.push((first, core::mem::take(&mut cells)));
                first = line + 1;
            }
            c if c == separator && quoted_at.is_none() => cells.push(core::mem::take(&mut cell)),
            '\r' => {}
            c => cell.push(c),
        }
        line += usize::from(c == '\n');
    }
    if let Some(line) = quoted_at {
        return Err(format!("line {line}: a quotation mark is not closed"));
    }
    cells.push(cell);
    records.push((first, cells));
    // Behind the titles, a line with further cells is no comment.
    let mut has_titles = false;
    records.retain(|(_, cells)| {
        let mut used = cells
            .iter()
            .map(|cell| cell.trim())
            .filter(|cell| !cell.is_empty());
        let is_comment = used.next().is_none_or(|first| {
            let is_first = cells.first().is_some_and(|cell| cell.trim() == first);
            is_first && first.starts_with('#') && (!has_titles || used.next().is_none())
        });
        has_titles |= !is_comment;
        !is_comment
    });
    Ok(records)
}
