//! `--schedule`: programs with a race work in the order of their calls, and fail in some other
//! order that its seed repeats.

use crate::guest::compiled;
use crate::support::{Ended, folder, run_in};

/// "mm=700" each 100 ms at 9600 baud for three seconds.
const SONAR: &str = include_str!("programs/sonar.toml");
const ACCOUNT: &str = include_str!("programs/races/account.py");
/// Each ends with code 7 if its race is lost, as with this seed.
const RACES: [(&str, &str, u64); 4] = [
    ("counter", include_str!("programs/races/counter.c"), 1),
    ("lazy", include_str!("programs/races/lazy.c"), 1),
    ("order", include_str!("programs/races/order.c"), 0),
    ("pair", include_str!("programs/races/pair.c"), 7),
];
/// The same of the program in Python.
const ACCOUNT_SEED: u64 = 2;
/// Seeds that are tried if chance has changed.
const SEEDS: u64 = 20;

fn run(name: &str, command: &str, more: &[&str]) -> Ended {
    let folder = folder(&format!("race-{name}"));
    let files = [("sonar.toml", SONAR), ("account.py", ACCOUNT)];
    run_in(&folder, &files, command, &[&["--virtual"], more].concat())
}

#[test]
fn races_are_lost_in_some_orders_of_threads_and_never_in_the_order_of_calls() {
    let compile = |(name, source, seed)| {
        let flags = ["-O1", "-pthread"];
        let program = compiled(&format!("race-{name}"), "cc", source, &flags);
        program.map(|program| {
            (
                name,
                program.to_str().expect("a plain path").to_owned(),
                seed,
            )
        })
    };
    let mut programs: Vec<(&str, String, u64)> = RACES.into_iter().filter_map(compile).collect();
    programs.push(("account", "python3 account.py".to_owned(), ACCOUNT_SEED));
    for (name, command, known) in &programs {
        let plain = run(name, command, &[]);
        assert_eq!(plain.failed(), Vec::<&str>::new(), "{name}: {}", plain.said);
        let lost = core::iter::once(*known).chain(0..SEEDS).find(|seed| {
            let seed = seed.to_string();
            run(name, command, &["--schedule", &seed]).code == Some(1)
        });
        let seed = lost.unwrap_or_else(|| panic!("{name}: in none of {SEEDS} orders"));
        // The same again, and under the second run that --check makes.
        let seed = seed.to_string();
        let again = run(name, command, &["--schedule", &seed, "--check"]);
        assert_eq!(again.code, Some(1), "{name}, seed {seed}: {}", again.said);
        assert_eq!(
            again.check("deterministic").0,
            "pass",
            "{name}, seed {seed}: {}",
            again.said
        );
    }
}
