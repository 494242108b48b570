//! No scenario file, however damaged, makes the tool panic: it runs or is refused with a message.

use std::path::Path;

use hilrig::run::Run;
use hilrig::scenario::Scenario;
use proptest::prelude::*;

use super::shipped;

const FILES: [&str; 4] = ["rescue-flat", "legs", "moving-obstacle", "two-rooms"];

/// Changes that people and editors make to a file.
#[derive(Clone, Debug)]
enum Mutation {
    /// A line is lost.
    Drop(usize),
    /// A line occurs twice.
    Double(usize),
    /// A number in a line is replaced by another.
    Number(usize, f64),
    /// A line's value is replaced by one of another type.
    Value(usize, &'static str),
    /// A character is changed.
    Character(usize, char),
    /// The file ends early.
    Cut(usize),
}

/// Values of every type, most of them wrong at any key.
const VALUES: [&str; 8] = [
    "true",
    "\"\"",
    "[]",
    "{}",
    "-9223372036854775808",
    "\"9e99s\"",
    "[[[]]]",
    "nan",
];

fn mutation() -> impl Strategy<Value = Mutation> {
    let line = 0_usize..80;
    let number = prop_oneof![
        Just(0.0),
        Just(-1.0),
        Just(1e300),
        Just(f64::NAN),
        Just(f64::INFINITY),
        -5.0..5.0_f64
    ];
    prop_oneof![
        line.clone().prop_map(Mutation::Drop),
        line.clone().prop_map(Mutation::Double),
        (line.clone(), number).prop_map(|(line, number)| Mutation::Number(line, number)),
        (line, prop::sample::select(&VALUES[..])).prop_map(|(line, v)| Mutation::Value(line, v)),
        (0_usize..2000, any::<char>()).prop_map(|(at, c)| Mutation::Character(at, c)),
        (0_usize..2000).prop_map(Mutation::Cut),
    ]
}

fn mutate(text: &str, mutation: &Mutation) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let index = |line: usize| line % lines.len().max(1);
    match mutation {
        _ if lines.is_empty() => {}
        Mutation::Drop(line) => {
            lines.remove(index(*line));
        }
        Mutation::Double(line) => {
            let at = index(*line);
            lines.insert(at, lines[at].clone());
        }
        Mutation::Number(line, number) => {
            let at = index(*line);
            let split = lines[at].find(|c: char| c.is_ascii_digit());
            if let Some(split) = split {
                let (head, tail) = lines[at].split_at(split);
                let tail = tail.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.');
                lines[at] = format!("{head}{number:?}{tail}");
            }
        }
        Mutation::Value(line, value) => {
            let at = index(*line);
            if let Some((key, _)) = lines[at].split_once('=') {
                lines[at] = format!("{key}= {value}");
            }
        }
        Mutation::Character(at, character) => {
            let mut text: Vec<char> = text.chars().collect();
            let at = at % text.len();
            text[at] = *character;
            return text.into_iter().collect();
        }
        Mutation::Cut(at) => return text.chars().take(*at).collect(),
    }
    lines.join("\n")
}

proptest! {
    #![proptest_config(crate::thorough::cases(2000))]

    #[test]
    fn a_damaged_scenario_runs_or_is_refused_in_words(
        file in prop::sample::select(&FILES[..]),
        mutations in prop::collection::vec(mutation(), 1..4),
    ) {
        let text = mutations.iter().fold(shipped(file), |text, change| mutate(&text, change));
        let refusal = match Scenario::parse(Path::new("s.toml"), text) {
            Err(error) => error.to_string(),
            Ok((scenario, source)) => match Run::new(scenario, &source, None) {
                Err(error) => error.to_string(),
                Ok(mut run) => {
                    for _ in 0..5 {
                        run.step();
                    }
                    let case = run.judge().case.to_toml();
                    let again = Scenario::parse(Path::new("case.toml"), case);
                    prop_assert!(again.is_ok(), "{again:?}");
                    return Ok(());
                }
            },
        };
        prop_assert!(refusal.contains("s.toml"), "{refusal}");
    }
}
