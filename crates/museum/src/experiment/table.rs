//! Rows of figures, as a file that any spreadsheet reads.

/// Columns with units, and rows of figures with an optional name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    columns: Vec<String>,
    rows: Vec<(String, Vec<f64>)>,
}

impl Table {
    /// An empty table with these columns, each with its unit, besides the names of the rows.
    pub fn new<'a>(columns: impl IntoIterator<Item = &'a str>) -> Self {
        Self {
            columns: columns.into_iter().map(str::to_owned).collect(),
            rows: Vec::new(),
        }
    }

    /// Adds a row; missing figures stay empty.
    pub fn push(&mut self, name: impl Into<String>, figures: impl IntoIterator<Item = f64>) {
        self.rows.push((name.into(), figures.into_iter().collect()));
    }

    /// The rows: name and figures.
    pub fn rows(&self) -> &[(String, Vec<f64>)] {
        &self.rows
    }

    /// Names of the columns.
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// Comma-separated values with a header line; values that are not numbers are empty.
    pub fn csv(&self) -> String {
        let mut lines = vec![format!("name,{}", self.columns.join(","))];
        for (name, figures) in &self.rows {
            let figures = figures.iter().map(|figure| match figure.is_finite() {
                true => format!(",{}", rounded(*figure)),
                false => ",".to_owned(),
            });
            lines.push(format!("{name}{}", figures.collect::<String>()));
        }
        lines.join("\n") + "\n"
    }
}

/// Formats a figure with up to three decimals, without trailing zeros.
pub(super) fn rounded(figure: f64) -> String {
    let text = format!("{figure:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    match text {
        "-0" => "0".to_owned(),
        text => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_lines_of_values() {
        let mut table = Table::new(["time (s)", "error (mm)"]);
        table.push("one", [0.5, f64::NAN]);
        table.push("two", [-0.000_1, 12.345_67]);
        assert_eq!(
            table.csv(),
            "name,time (s),error (mm)\none,0.5,\ntwo,0,12.346\n"
        );
    }
}
