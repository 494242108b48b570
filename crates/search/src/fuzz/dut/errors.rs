//! Classification of a program's end by its output: a failure or a reported error, and the
//! location.
//!
//! A program that receives a damaged or senseless frame may end with an error that it raises on
//! purpose. A program must not fail at an unforeseen location, whatever its input is. Therefore an
//! exit with an error is a finding if
//!
//! - none of its input since the start was altered, or
//! - the error was not raised on purpose: an exception of the interpreter, a panic, a failed
//!   assertion, a sanitizer report.
//!
//! A signal is a finding in any case.

use core::fmt;
use core::str::FromStr;

use crate::campaign::without_figures;

/// The exits with an error that count as findings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ErrorRule {
    /// Failures, and errors that the program reported although its input was intact.
    #[default]
    Unaltered,
    /// All errors.
    Always,
    /// Failures only, never an error that the program reported on purpose.
    Never,
}

impl FromStr for ErrorRule {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let all = [Self::Unaltered, Self::Always, Self::Never];
        let found = all.into_iter().find(|rule| rule.to_string() == text);
        found.ok_or_else(|| format!("\"{text}\": expected unaltered, always or never"))
    }
}

impl fmt::Display for ErrorRule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unaltered => "unaltered",
            Self::Always => "always",
            Self::Never => "never",
        })
    }
}

impl ErrorRule {
    /// Whether an error that the program reported on purpose counts as a finding.
    pub(super) const fn counts(self, is_altered: bool) -> bool {
        match self {
            Self::Unaltered => !is_altered,
            Self::Always => true,
            Self::Never => false,
        }
    }
}

/// The end of a program according to its output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LastWords {
    /// The key that ends with the same cause share.
    pub(super) key: String,
    /// The most informative line.
    pub(super) line: String,
    /// Whether the output shows a failure at an unforeseen location.
    pub(super) is_failure: bool,
}

/// Maximum length of the common part of a line for ends with the same cause.
const STEM_MAX: usize = 60;
/// Words that announce a failure; the source location follows them.
const TELLING: [&str; 12] = [
    "panicked at",
    "SUMMARY: ",
    "Sanitizer: ",
    "runtime error: ",
    "ssertion",
    "terminate called",
    "detected ***",
    "free(): ",
    "malloc(): ",
    "realloc(): ",
    "munmap_chunk(): ",
    "goroutine ",
];
/// Messages of a shell about a killed child process.
const SHELL: [&str; 3] = ["Aborted", "Segmentation fault", "Killed"];
/// Python's built-in exceptions, for tracebacks without source lines.
const INTERPRETED: [&str; 16] = [
    "ArithmeticError",
    "AssertionError",
    "AttributeError",
    "BufferError",
    "IndexError",
    "KeyError",
    "LookupError",
    "MemoryError",
    "NameError",
    "OverflowError",
    "RecursionError",
    "TypeError",
    "UnboundLocalError",
    "UnicodeDecodeError",
    "ZeroDivisionError",
    "struct.error",
];

impl LastWords {
    /// Classifies the output `said`.
    pub(super) fn of(said: &str) -> Self {
        if let Some(words) = traceback(said) {
            return words;
        }
        let is_own = |line: &&str| {
            let words = line.trim_end_matches("(core dumped)").trim_end();
            !line.is_empty() && !SHELL.contains(&words)
        };
        let lines = || said.lines().map(str::trim).filter(is_own);
        let telling = TELLING.iter().find_map(|words| {
            let line = lines().find(|line| line.contains(words))?;
            Some((*words, line))
        });
        match telling {
            // The source location is the cause; the message may differ.
            Some(("panicked at", line)) => {
                let at = line.split("panicked at").nth(1).unwrap_or(line);
                Self {
                    key: format!("panicked at {}", at.trim().trim_end_matches(':')),
                    line: line.to_owned(),
                    is_failure: true,
                }
            }
            Some(("SUMMARY: " | "ssertion" | "runtime error: " | "terminate called", line)) => {
                Self {
                    key: without_numbers_of_processes(line),
                    line: line.to_owned(),
                    is_failure: true,
                }
            }
            Some((_, line)) => Self {
                key: stem(line),
                line: line.to_owned(),
                is_failure: true,
            },
            None => {
                let line = lines().next_back().unwrap_or_default();
                Self {
                    key: stem(line),
                    line: line.to_owned(),
                    is_failure: false,
                }
            }
        }
    }
}

/// Evaluates the last Python traceback in `said`.
fn traceback(said: &str) -> Option<LastWords> {
    const HEAD: &str = "Traceback (most recent call last):";
    let at = said.rfind(HEAD)?;
    let mut lines = said[at..].lines().skip(1).peekable();
    let (mut frames, mut source) = (Vec::new(), None);
    let end = loop {
        let line = lines.next()?;
        if let Some(frame) = Frame::read(line) {
            // The line below a frame is its source; marks may follow.
            source = lines.next_if(|line| line.starts_with("    "));
            frames.push(frame);
        } else if !line.starts_with(' ') && !line.is_empty() {
            break line;
        }
    };
    let kind = end.split(':').next().unwrap_or(end).trim();
    let source = source.map(str::trim);
    let is_raised = match source {
        // Finds a statement behind a condition on the same line too.
        Some(source) => {
            let mut statements = source.split([':', ';']).map(str::trim_start);
            statements.any(|one| raises(one, kind))
        }
        None => !INTERPRETED.contains(&kind),
    };
    let own = frames.iter().rev().find(|frame| frame.is_own());
    let own = own.or(frames.last());
    let key = match own {
        Some(frame) if !is_raised => format!("{kind} at {}:{}", frame.file(), frame.line),
        _ => kind.to_owned(),
    };
    Some(LastWords {
        key,
        line: end.to_owned(),
        is_failure: !is_raised,
    })
}

/// Whether the statement can have raised an exception of `kind`. A condition on the same line can
/// fail before it.
fn raises(statement: &str, kind: &str) -> bool {
    let Some(what) = statement.strip_prefix("raise") else {
        return false;
    };
    let last = |name: &str| name.rsplit('.').next().unwrap_or(name).to_owned();
    let name = what.trim().split(['(', ' ']).next().unwrap_or_default();
    let is_class = last(name).starts_with(char::is_uppercase);
    let is_other = is_class && last(name) != last(kind) && INTERPRETED.contains(&kind);
    (what.is_empty() || what.starts_with(' ')) && !is_other
}

/// One frame of a traceback.
struct Frame<'a> {
    path: &'a str,
    line: &'a str,
}

impl<'a> Frame<'a> {
    fn read(line: &'a str) -> Option<Self> {
        let rest = line.strip_prefix("  File \"")?;
        let (path, rest) = rest.split_once("\", line ")?;
        let line = rest.split([',', ' ']).next()?;
        Some(Self { path, line })
    }

    /// Whether the frame is in the program, not in a library.
    fn is_own(&self) -> bool {
        const LIBRARIES: [&str; 4] = ["site-packages", "dist-packages", "/lib/python", "<frozen "];
        !LIBRARIES.iter().any(|library| self.path.contains(library))
    }

    fn file(&self) -> &'a str {
        self.path.rsplit('/').next().unwrap_or(self.path)
    }
}

/// `line` without process ids and addresses, which differ from run to run.
fn without_numbers_of_processes(line: &str) -> String {
    let words = line.split_whitespace().filter(|word| {
        let is_process = word.starts_with("==") || word.starts_with("pid");
        !(is_process || word.starts_with("0x") || word.starts_with("(0x"))
    });
    let words: Vec<&str> = words.collect();
    words.join(" ")
}

/// The beginning of a message, up to its bytes and numbers.
fn stem(line: &str) -> String {
    let quoted = line.find(['\'', '"', '[', '{', '<', '\\', '`']);
    let head = &line[..quoted.unwrap_or(line.len())];
    let head: String = head.chars().take(STEM_MAX).collect();
    let is_figure = |word: &&str| word.chars().any(|c| c.is_ascii_digit());
    let words = head.split_whitespace().filter(|word| !is_figure(word));
    let words: Vec<&str> = words.collect();
    let stem = words.join(" ");
    if stem.is_empty() {
        without_figures(&head)
    } else {
        stem
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn python(frames: &[(&str, u32, &str)], end: &str) -> String {
        let mut said = "21.5 ok\nTraceback (most recent call last):\n".to_owned();
        for (path, line, source) in frames {
            said += &format!("  File \"{path}\", line {line}, in f\n    {source}\n    ~~~^^^\n");
        }
        said + end + "\n"
    }

    /// An exception that a library raises on purpose is a reported error. An exception of the
    /// interpreter is a failure; its location is the line of the program that led to it.
    #[test]
    fn an_exception_raised_on_purpose_is_an_error_that_is_reported() {
        let library = (
            "/usr/lib/python3/dist-packages/bus.py",
            40,
            "raise BadFrame(x)",
        );
        let own = ("/srv/a/meter.py", 7, "value = bus.read(4)");
        let words = LastWords::of(&python(&[own, library], "bus.BadFrame: b'\\x01'"));
        assert_eq!((&*words.key, words.is_failure), ("bus.BadFrame", false));

        let own = ("/srv/a/meter.py", 8, "if x > 3: raise BadFrame(x)");
        let words = LastWords::of(&python(&[own], "BadFrame: x"));
        assert_eq!((&*words.key, words.is_failure), ("BadFrame", false));

        // The condition failed, not the statement behind it.
        let words = LastWords::of(&python(&[own], "IndexError: index out of range"));
        let expected = ("IndexError at meter.py:8", true);
        assert_eq!((&*words.key, words.is_failure), expected);
        let own = (
            "/srv/a/meter.py",
            8,
            "if not d: raise IndexError(\"empty\")",
        );
        assert!(!LastWords::of(&python(&[own], "IndexError: empty")).is_failure);

        let own = ("/srv/a/meter.py", 9, "value = fields[3]");
        let words = LastWords::of(&python(&[own], "IndexError: list index out of range"));
        let expected = ("IndexError at meter.py:9", true);
        assert_eq!((&*words.key, words.is_failure), expected);

        let inside = (
            "/usr/lib/python3.12/json/decoder.py",
            355,
            "obj = scan(s, idx)",
        );
        let words = LastWords::of(&python(&[own, inside], "TypeError: expected str"));
        assert_eq!(words.key, "TypeError at meter.py:9");
    }

    /// The same cause with different bytes gives the same key.
    #[test]
    fn what_was_in_a_frame_is_not_its_cause() {
        let key = |said: &str| LastWords::of(said).key;
        assert_eq!(key("bad frame 'AB 01', gave up"), key("bad frame 'FF'"));
        assert_eq!(
            key("short frame: 3 bytes of 11"),
            key("short frame: 9 bytes of 80")
        );
        assert_ne!(key("short frame: 3 bytes"), key("no answer"));
        let address = "==17==ERROR: AddressSanitizer: heap-buffer-overflow on 0x7f01\n\
                       SUMMARY: AddressSanitizer: heap-buffer-overflow nmea.c:12 in field";
        let other = address.replace("17", "18").replace("0x7f01", "0x7e08");
        assert_eq!(key(address), key(&other));
        let elsewhere = address.replace("nmea.c:12", "nmea.c:31");
        assert_ne!(key(address), key(&elsewhere));
        let panic = "thread 'main' (3) panicked at src/a.rs:7:5:\nindex 9";
        assert_eq!(key(panic), "panicked at src/a.rs:7:5");
    }

    #[test]
    fn the_rule_is_about_errors_that_a_program_reports() {
        let counted = |rule: ErrorRule| [false, true].map(|is_altered| rule.counts(is_altered));
        assert_eq!(counted(ErrorRule::Unaltered), [true, false]);
        assert_eq!(counted(ErrorRule::Always), [true, true]);
        assert_eq!(counted(ErrorRule::Never), [false, false]);
    }
}
