//! Rules about single files.

use crate::files::{File, all};

/// Violations, as `path:line: text`.
type Findings = Vec<String>;

const COLUMNS_MAX: usize = 100;
const LINES_MAX: usize = 500;

/// Fails with all findings of `rule` over `files` at once.
fn judge(files: &[File], rule: fn(&File) -> Findings) {
    let findings: Findings = files.iter().flat_map(rule).collect();
    assert!(findings.is_empty(), "\n{}", findings.join("\n"));
}

fn found_in(rule: fn(&File) -> Findings, path: &str, text: &str) -> usize {
    rule(&File::sample(path, text)).len()
}

fn numbered(file: &File) -> impl Iterator<Item = (usize, &str)> {
    (1..).zip(file.text.lines())
}

fn lines_that<'a>(
    file: &File,
    lines: impl Iterator<Item = (usize, &'a str)>,
    is_wrong: impl Fn(&str) -> bool,
    what: &str,
) -> Findings {
    lines
        .filter(|(_, line)| is_wrong(line))
        .map(|(number, _)| format!("{}:{number}: {what}", file.path))
        .collect()
}

fn long_lines(file: &File) -> Findings {
    // A row of a table in the docs cannot be wrapped, and the formatter does not change a line with
    // a long string literal.
    let is_row = |line: &str| {
        ["//! |", "/// |"]
            .iter()
            .any(|row| line.trim().starts_with(row))
    };
    let holds_text = |line: &str| {
        line.contains('"') || line.ends_with('\\') || line.trim_start().starts_with("error: ")
    };
    let is_wrong =
        |line: &str| line.chars().count() > COLUMNS_MAX && !is_row(line) && !holds_text(line);
    lines_that(file, numbered(file), is_wrong, "longer than 100 columns")
}

#[test]
fn lines_fit_in_100_columns() {
    assert_eq!(found_in(long_lines, "a.rs", &"ä".repeat(100)), 0);
    assert_eq!(found_in(long_lines, "a.rs", &"a".repeat(101)), 1);
    judge(&all(&[".rs", ".sh"]), long_lines);
}

fn long_files(file: &File) -> Findings {
    let lines = file.product_lines().count();
    let is_wrong = !file.is_test() && lines > LINES_MAX;
    let finding = format!(
        "{}: {lines} lines without its tests, at most 500",
        file.path
    );
    Vec::from_iter(is_wrong.then_some(finding))
}

#[test]
fn files_of_the_product_have_at_most_500_lines() {
    let lines = "\n".repeat(501);
    assert_eq!(found_in(long_files, "src/a.rs", &lines), 1);
    assert_eq!(found_in(long_files, "tests/rig/a.rs", &lines), 0);
    let tests = format!("#[cfg(test)]\n{lines}");
    assert_eq!(found_in(long_files, "src/a.rs", &tests), 0);
    judge(&all(&[".rs"]), long_files);
}

fn os_clocks(file: &File) -> Findings {
    let may =
        file.path == "crates/demo/src/main.rs" || file.path.starts_with("crates/realtime/src/");
    let calls = ["Instant", "SystemTime"].map(|clock| [clock, "::now("].concat());
    let is_wrong = |line: &str| !may && calls.iter().any(|call| line.contains(call));
    lines_that(
        file,
        numbered(file),
        is_wrong,
        "reads the clock of the operating system",
    )
}

/// The lint with the same purpose can be disabled with `expect`; this rule cannot.
#[test]
fn only_the_clock_and_the_real_time_runner_read_an_os_clock() {
    let call = ["let start = Instant", "::now();"].concat();
    assert_eq!(found_in(os_clocks, "src/rig.rs", &call), 1);
    assert_eq!(
        found_in(os_clocks, "crates/realtime/src/clock.rs", &call),
        0
    );
    // Tests and benches that measure durations may read a clock.
    let files = all(&[".rs"]).into_iter().filter(|file| !file.is_test());
    judge(&files.collect::<Vec<_>>(), os_clocks);
}

fn writers(file: &File) -> Findings {
    // The second one opens pipes of the program under test, on its behalf.
    // The third one is inside of an emulator and opens its standard output.
    let others = [
        "crates/safefs/",
        "crates/realtime/src/guest/supervisor/fifos.rs",
        "nodes/cortex-m4/src/wire.rs",
    ];
    let may = others.iter().any(|other| file.path.starts_with(other)) || file.is_test();
    let is_product = file.path.starts_with("src/") || file.path.contains("/src/");
    let calls = [
        "fs::write(",
        "fs::copy(",
        "fs::rename(",
        "fs::remove_",
        "fs::create_dir",
        "fs::set_permissions(",
        "fs::hard_link(",
        "File::create",
        "File::options",
        "OpenOptions",
        "symlink(",
        "UnixListener::bind",
    ];
    let is_wrong = |line: &str| {
        let line = line.replace("safefs::", "").replace("CaptureFile::", "");
        is_product && !may && calls.iter().any(|call| line.contains(call))
    };
    let what = "writes files; use crates/safefs, which does not follow links";
    lines_that(file, file.product_lines(), is_wrong, what)
}

/// A folder that another user prepared must not lead anywhere else (S1, S2).
#[test]
fn files_are_written_by_one_crate() {
    let sample = "std::fs::write(path, text)?;";
    assert_eq!(found_in(writers, "src/cli/a.rs", sample), 1);
    assert_eq!(found_in(writers, "crates/show/src/a.rs", sample), 1);
    assert_eq!(found_in(writers, "crates/safefs/src/a.rs", sample), 0);
    assert_eq!(
        found_in(writers, "src/cli/a.rs", "safefs::write(path, text)?;"),
        0
    );
    judge(&all(&[".rs"]), writers);
}

fn ignored_tests(file: &File) -> Findings {
    let attribute = ["#[", "ignore"].concat();
    let is_wrong = |line: &str| line.trim_start().starts_with(&attribute);
    lines_that(file, numbered(file), is_wrong, "an ignored test")
}

#[test]
fn no_test_is_ignored() {
    let sample = ["    #[", "ignore = \"slow\"]"].concat();
    assert_eq!(found_in(ignored_tests, "tests/a.rs", &sample), 1);
    judge(&all(&[".rs"]), ignored_tests);
}

fn leftovers(file: &File) -> Findings {
    let words = [
        ["TO", "DO"],
        ["FIX", "ME"],
        ["dbg", "!("],
        ["todo", "!("],
        ["unimplemented", "!("],
    ]
    .map(|halves| halves.concat());
    let is_wrong = |line: &str| words.iter().any(|word| line.contains(word));
    lines_that(file, numbered(file), is_wrong, "a leftover marker")
}

#[test]
fn nothing_is_left_for_later() {
    let sample = ["// TO", "DO: later"].concat();
    assert_eq!(found_in(leftovers, "src/a.rs", &sample), 1);
    judge(&all(&[".rs", ".sh", ".toml", ".md", ".lua"]), leftovers);
}

fn lints_without_reason(file: &File) -> Findings {
    let allow = ["#[", "allow("].concat();
    let expect = ["#[", "expect("].concat();
    let attribute = |text: &str, at: usize| {
        let end = text[at..].find(")]").map_or(text.len(), |end| at + end);
        text[at..end].to_owned()
    };
    [allow, expect]
        .iter()
        .flat_map(|start| file.text.match_indices(start.as_str()))
        .filter(|&(at, _)| !attribute(&file.text, at).contains("reason ="))
        .map(|(at, _)| {
            let line = file.text[..at].lines().count().max(1);
            format!(
                "{}:{line}: a lint is switched off without a reason",
                file.path
            )
        })
        .collect()
}

#[test]
fn no_lint_is_switched_off_without_a_reason() {
    let bare = ["#[", "allow(dead_code)]"].concat();
    let told = ["#[", "expect(\n    dead_code,\n    reason = \"told\"\n)]"].concat();
    assert_eq!(found_in(lints_without_reason, "src/a.rs", &bare), 1);
    assert_eq!(found_in(lints_without_reason, "src/a.rs", &told), 0);
    judge(&all(&[".rs"]), lints_without_reason);
}

fn unwraps(file: &File) -> Findings {
    let call = [".unwrap", "()"].concat();
    let is_wrong = |line: &str| {
        line.contains(&call) && !line.trim_start().starts_with("//") && !file.is_test()
    };
    lines_that(
        file,
        file.product_lines(),
        is_wrong,
        "unwrap: say why it holds",
    )
}

#[test]
fn the_product_does_not_unwrap() {
    let sample = ["    let a = b.unwrap", "();"].concat();
    assert_eq!(found_in(unwraps, "src/a.rs", &sample), 1);
    assert_eq!(
        found_in(unwraps, "emulators/src/world/tests.rs", &sample),
        0
    );
    let files = all(&[".rs"]);
    judge(&files, unwraps);
}

fn machine_paths(file: &File) -> Findings {
    let folders = ["root", "home", "work", "Users"].map(|folder| format!("/{folder}/"));
    let begins = |line: &str, at: usize| {
        !line[..at].ends_with(|c: char| c.is_alphanumeric() || "._-~$}".contains(c))
    };
    let is_wrong = |line: &str| {
        let mut places = folders
            .iter()
            .flat_map(|folder| line.match_indices(folder.as_str()));
        places.any(|(at, _)| begins(line, at))
    };
    lines_that(
        file,
        numbered(file),
        is_wrong,
        "a path of one developer's machine",
    )
}

#[test]
fn no_file_knows_the_machine_it_was_written_on() {
    let sample = ["let path = \"/ho", "me/me/rig\";"].concat();
    assert_eq!(found_in(machine_paths, "src/a.rs", &sample), 1);
    assert_eq!(
        found_in(machine_paths, "README.md", "https://a.org/b/home/"),
        0
    );
    judge(&all(&[".rs", ".sh", ".toml", ".md", "/run"]), machine_paths);
}

fn neighbours(file: &File) -> Findings {
    let folder = ["../sha", "red"].concat();
    let is_guarded = file.text.contains("fn skipped(") || file.text.contains("skipped(&");
    let is_wrong = |line: &str| line.contains(&folder) && !is_guarded;
    lines_that(
        file,
        numbered(file),
        is_wrong,
        "needs a neighbour without the skip rule",
    )
}

/// Files outside the repository are not part of it: a test that needs such a file must pass without
/// it, and print a message.
#[test]
fn what_lies_beside_the_repository_is_not_needed() {
    let sample = ["include_str!(\"../../../sha", "red/spec.md\")"].concat();
    assert_eq!(found_in(neighbours, "tests/wire/a.rs", &sample), 1);
    judge(&all(&[".rs", ".sh", ".toml"]), neighbours);
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The last word of `text`; empty if the text ends with anything else.
fn last_word(text: &str) -> &str {
    &text[text.trim_end_matches(is_word).len()..]
}

/// The word of `text` that the byte at `at` belongs to.
fn word_at(text: &str, at: usize) -> &str {
    let start = text[..at].trim_end_matches(is_word).len();
    let behind = text[at..].trim_start_matches(is_word).len();
    &text[start..text.len() - behind]
}

/// Whether a pronoun stands for a person or a program.
fn has_pronoun(text: &str) -> bool {
    let pronouns = [
        ["some", "body"],
        ["no", "body"],
        ["any", "body"],
        ["some", "one"],
        ["who", "ever"],
        ["who", "m"],
    ]
    .map(|halves| halves.concat());
    let mut parts = ["body", "omeone", "hoever", "hom"]
        .into_iter()
        .flat_map(|part| text.match_indices(part));
    let question = ["W", "ho"].concat();
    let mut questions = text.match_indices(question.as_str());
    parts.any(|(at, _)| pronouns.contains(&word_at(text, at).to_lowercase()))
        || questions.any(|(at, _)| word_at(text, at) == question)
}

/// Whether a relative clause stands in place of a noun, or "so" in place of a verb.
fn has_open_clause(text: &str) -> bool {
    const BEFORE: [&str; 16] = [
        "for", "of", "to", "by", "from", "with", "as", "than", "and", "asks", "at", "on", "after",
        "when", "if", "where",
    ];
    const AMOUNTS: [&str; 7] = [
        " far", " many", " much", " little", " few", " often", " long",
    ];
    let is_clause = |at: usize| {
        let before = text[..at].strip_suffix(' ').unwrap_or_default();
        let is_open = before.ends_with([':', ';']) || BEFORE.contains(&last_word(before));
        word_at(text, at) == "who" && is_open
    };
    let is_verb = |at: usize| {
        let rest = &text[at + " so".len()..];
        let is_amount = AMOUNTS.iter().any(|amount| rest.starts_with(amount));
        match last_word(&text[..at]) {
            "does" | "do" | "did" => !rest.is_empty() && !rest.starts_with(is_word) && !is_amount,
            "is" | "are" => rest.starts_with(['.', ',', ';', ':']),
            _ => false,
        }
    };
    let inventory = ["what there", " is"].concat();
    text.contains(&inventory)
        || text.match_indices("who").any(|(at, _)| is_clause(at))
        || text.match_indices(" so").any(|(at, _)| is_verb(at))
}

/// Sentences whose reader has to guess which person or program is meant.
fn open_subjects(file: &File) -> Findings {
    let mut findings = Findings::new();
    // A sentence continues in the next line: the last words of a line belong to that line as well.
    let mut tail = String::new();
    for (number, line) in numbered(file) {
        let text = line.trim_start().trim_start_matches(['/', '!', '#', '*']);
        let joined = format!("{tail} {}", text.trim_start());
        // A name, such as that of a fault.
        let is_header = file.path.ends_with(".toml") && line.starts_with('[');
        if !is_header && (has_pronoun(text) || has_open_clause(&joined)) {
            let what = "name the subject: the client, the program, the person, the reader";
            findings.push(format!("{}:{number}: {what}", file.path));
        }
        let mut words: Vec<&str> = text.split_whitespace().rev().take(2).collect();
        words.reverse();
        tail = words.join(" ");
    }
    findings
}

#[test]
fn sentences_name_their_subject() {
    let wrong = [
        ["/// No", "body opens the port."],
        ["\"the file of some", "body's\""],
        ["# W", "ho asks is told."],
        ["/// Lines are up for w", "ho asks at once."],
        ["/// Lines are up for\n/// w", "ho asks at once."],
        ["/// Two are one; w", "ho comes later is late."],
        ["/// The client does", " so, too."],
        ["/// The client does\n/// so", " at once."],
        ["/// The line is", " so."],
        ["/// Lists what there\n///", " is."],
    ];
    for halves in wrong {
        let sample = halves.concat();
        assert_eq!(found_in(open_subjects, "a.rs", &sample), 1, "{sample}");
    }
    for sample in [
        "/// The client who asks at once, for whose sake lines are up.",
        "fn nobody_is_there() {",
        "/// Cases did so far, and it is so many times as late.",
        "/// The client does\n/// some work.",
    ] {
        assert_eq!(found_in(open_subjects, "a.rs", sample), 0, "{sample}");
    }
    let header = ["[faults.no", "body]"].concat();
    assert_eq!(found_in(open_subjects, "devices/a.toml", &header), 0);
    let files = all(&[
        ".rs", ".md", ".toml", ".py", ".sh", ".js", ".mjs", ".c", ".txt",
    ]);
    judge(&files, open_subjects);
}

/// Modules whose comments already use the words of the field, and are checked; others follow.
const PLAIN_ROOMS: [&str; 19] = [
    "benches/",
    "crates/boards/",
    "crates/capture/",
    "crates/demo/",
    "crates/description/",
    "crates/engine/src/",
    "crates/museum/",
    "crates/nodes/",
    "crates/ports/",
    "crates/recording/",
    "crates/safefs/",
    "crates/search/",
    "crates/show/",
    "crates/slam/",
    "crates/ui/",
    "emulators/",
    "firmware_core/",
    "protocols/",
    "src/",
];

/// Phrases in place of a noun or of a word of the glossary.
const HARD_PHRASES: [&str; 20] = [
    "are heard",
    "are told",
    "askew",
    "befallen",
    "came about",
    "came to",
    "come about",
    "comes about",
    "far end",
    "for ever",
    "goes on",
    "in the way",
    "is heard",
    "is told",
    "of one's own",
    "was heard",
    "was told",
    "what is",
    "what it is",
    "what it was",
];

/// Comments with phrases that a reader has to decode.
fn hard_phrases(file: &File) -> Findings {
    let is_plain = PLAIN_ROOMS.iter().any(|room| file.path.starts_with(room));
    let is_wrong = |line: &str| {
        let text = line.trim_start().to_lowercase();
        let has = |phrase: &str| {
            text.match_indices(phrase).any(|(at, _)| {
                let (before, behind) = (&text[..at], &text[at + phrase.len()..]);
                !before.ends_with(is_word) && !behind.starts_with(is_word)
            })
        };
        is_plain && text.starts_with("//") && HARD_PHRASES.iter().any(|phrase| has(phrase))
    };
    let what = "write the noun of the field, see docs/glossary.md";
    lines_that(file, numbered(file), is_wrong, what)
}

#[test]
fn comments_use_the_words_of_the_field() {
    for sample in [
        "    // What is in the way is told.",
        "/// How it comes about.",
        "//! The far end of the line.",
    ] {
        assert_eq!(found_in(hard_phrases, "src/a.rs", sample), 1, "{sample}");
        assert_eq!(found_in(hard_phrases, "tests/a.rs", sample), 0, "{sample}");
    }
    for sample in [
        "/// The obstacle is logged.",
        "/// Hardware, in the wayside.",
        "let what = \"what is in the way\";",
    ] {
        assert_eq!(found_in(hard_phrases, "src/a.rs", sample), 0, "{sample}");
    }
    judge(&all(&[".rs"]), hard_phrases);
}

fn robot_names(file: &File) -> Findings {
    let shared = (file.path.starts_with("firmware_core/src/")
        && !file.path.starts_with("firmware_core/src/robots")
        || file.path.starts_with("protocols/src/"))
        && !file.is_test();
    let is_wrong = |line: &str| {
        let code = line
            .split("//")
            .next()
            .expect("split yields at least one part");
        shared && code.to_lowercase().contains("rescue")
    };
    lines_that(
        file,
        file.product_lines(),
        is_wrong,
        "a shared module knows one robot",
    )
}

#[test]
fn shared_modules_know_no_robot_by_name() {
    let code = "use crate::robots::rescue::Rescue;";
    assert_eq!(found_in(robot_names, "firmware_core/src/slam.rs", code), 1);
    let comment = "/// The rescue robot's drive.";
    assert_eq!(
        found_in(robot_names, "firmware_core/src/slam.rs", comment),
        0
    );
    judge(&all(&[".rs"]), robot_names);
}
