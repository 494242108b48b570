//! A page as Markdown and as HTML.

use core::fmt::Write as _;

use super::layout::Part;

/// A page.
pub(super) struct Page {
    name: String,
    about: String,
    blocks: Vec<Block>,
}

/// A part of a page.
pub(super) enum Block {
    /// A heading with its level.
    Heading(u8, String),
    Text(String),
    Code(String),
    Table {
        heads: Vec<String>,
        rows: Vec<Vec<String>>,
    },
    Diagram(Vec<Part>),
}

/// The style of the HTML page. It needs no other file and follows the system's colour scheme.
const STYLE: &str = "
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: 0.5rem 0 1rem; }
th, td { border: 1px solid #8888; padding: 0.25rem 0.6rem; text-align: left; vertical-align: top; }
.scroll { overflow-x: auto; }
.frame td { text-align: center; font-family: ui-monospace, monospace; }
pre, code { font-family: ui-monospace, monospace; }
pre { border: 1px solid #8888; padding: 0.5rem; overflow-x: auto; }
";

impl Block {
    /// A table without the columns that are empty in all rows.
    pub(super) fn table(heads: &[&str], rows: Vec<Vec<String>>) -> Self {
        let is_used = |column: usize| rows.iter().any(|row| !row[column].is_empty());
        let used: Vec<usize> = (0..heads.len()).filter(|column| is_used(*column)).collect();
        let heads = used
            .iter()
            .map(|column| heads[*column].to_owned())
            .collect();
        let kept = |row: &Vec<String>| used.iter().map(|column| row[*column].clone()).collect();
        let rows = rows.iter().map(kept).collect();
        Self::Table { heads, rows }
    }
}

impl Page {
    pub(super) fn new(name: &str, about: &str) -> Self {
        Self {
            name: name.to_owned(),
            about: about.to_owned(),
            blocks: Vec::new(),
        }
    }

    pub(super) fn add(&mut self, block: Block) {
        self.blocks.push(block);
    }

    pub(super) fn heading(&mut self, text: &str) {
        self.add(Block::Heading(2, text.to_owned()));
    }

    pub(super) fn heading_below(&mut self, text: &str) {
        self.add(Block::Heading(3, text.to_owned()));
    }

    pub(super) fn text(&mut self, text: impl Into<String>) {
        self.add(Block::Text(text.into()));
    }

    pub(super) fn markdown(&self) -> String {
        let mut out = format!("# {}\n\n{}\n", self.name, escaped(&self.about));
        for block in &self.blocks {
            out.push('\n');
            match block {
                Block::Heading(level, text) => {
                    let signs = "#".repeat(usize::from(*level));
                    line(&mut out, &format!("{signs} {}", escaped(text)));
                }
                Block::Text(text) => line(&mut out, &escaped(text)),
                Block::Code(text) => line(&mut out, &format!("```text\n{text}\n```")),
                Block::Table { heads, rows } => {
                    line(&mut out, &row(heads));
                    line(&mut out, &format!("|{}", "---|".repeat(heads.len())));
                    rows.iter().for_each(|cells| line(&mut out, &row(cells)));
                }
                Block::Diagram(parts) => {
                    line(&mut out, &format!("```text\n{}\n```", diagram(parts)));
                }
            }
        }
        out
    }

    pub(super) fn html(&self) -> String {
        let (name, about) = (html(&self.name), html(&self.about));
        let mut out = format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{name}: {about}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n\
             <h1>{name}</h1>\n<p>{about}</p>\n"
        );
        for block in &self.blocks {
            match block {
                Block::Heading(level, text) => {
                    line(&mut out, &format!("<h{level}>{}</h{level}>", html(text)));
                }
                Block::Text(text) => line(&mut out, &format!("<p>{}</p>", html(text))),
                Block::Code(text) => line(&mut out, &format!("<pre>{}</pre>", html(text))),
                Block::Table { heads, rows } => {
                    let cells = |cells: &[String], tag: &str| {
                        let cells = cells
                            .iter()
                            .map(|cell| format!("<{tag}>{}</{tag}>", html(cell)));
                        format!("<tr>{}</tr>\n", cells.collect::<String>())
                    };
                    let head = cells(heads, "th");
                    let body: String = rows.iter().map(|row| cells(row, "td")).collect();
                    let table =
                        format!("<table>\n<thead>{head}</thead>\n<tbody>{body}</tbody>\n</table>");
                    line(&mut out, &format!("<div class=\"scroll\">{table}</div>"));
                }
                Block::Diagram(parts) => {
                    let cells = |of: fn(&Part) -> &String, tag: &str| {
                        let cells = parts
                            .iter()
                            .map(|part| format!("<{tag}>{}</{tag}>", html(of(part))));
                        format!("<tr>{}</tr>", cells.collect::<String>())
                    };
                    let (names, sizes) = (cells(|part| &part.0, "td"), cells(|part| &part.1, "td"));
                    let table =
                        format!("<table class=\"frame\"><tbody>{names}{sizes}</tbody></table>");
                    line(&mut out, &format!("<div class=\"scroll\">{table}</div>"));
                }
            }
        }
        out + "</main>\n</body>\n</html>\n"
    }
}

fn line(out: &mut String, text: &str) {
    writeln!(out, "{text}").expect("a string takes everything");
}

fn row(cells: &[String]) -> String {
    let cells = cells.iter().map(|cell| format!(" {} |", escaped(cell)));
    format!("|{}", cells.collect::<String>())
}

/// The parts of a frame side by side, with their sizes below.
fn diagram(parts: &[Part]) -> String {
    let (mut names, mut sizes) = ("|".to_owned(), " ".to_owned());
    for (name, size) in parts {
        let width = name.chars().count().max(size.chars().count());
        names += &format!(" {name:^width$} |");
        sizes += &format!(" {size:^width$}  ");
    }
    format!("{names}\n{}", sizes.trim_end())
}

/// Escapes characters that have a meaning in Markdown.
fn escaped(text: &str) -> String {
    let mut out = String::new();
    for c in text.chars() {
        match c {
            '|' | '*' | '_' | '<' | '>' | '`' | '\\' => out.extend(['\\', c]),
            '\n' => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

fn html(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    text.replace('>', "&gt;").replace('"', "&quot;")
}
