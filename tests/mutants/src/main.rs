//! Which changes of behaviour do the tests of a package detect? cargo-mutants lists the changes.
//! All drawn changes are compiled into one copy of the tree, each behind a switch, so that a trial
//! needs a run of the tests and no build. A change that cannot be switched (of a constant) is named
//! and not judged.
//!
//! usage: mutants PACKAGE LIST.json OUT COUNT SEED EQUIVALENT.txt

mod build;
mod list;
mod switch;
mod trial;

use std::path::Path;
use std::process::ExitCode;

use list::Mutant;
use trial::Fate;

/// The environment variable that leaves out the trials: mutants that no test reaches are named.
const REACH: &str = "REACH";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [package, list, out, count, seed, equivalent] = arguments.as_slice() else {
        eprintln!("usage: mutants PACKAGE LIST.json OUT COUNT SEED EQUIVALENT.txt");
        return ExitCode::from(2);
    };
    let (Ok(count), Ok(seed)) = (count.parse(), seed.parse()) else {
        eprintln!("mutants: COUNT and SEED are numbers");
        return ExitCode::from(2);
    };
    match judge(
        package,
        Path::new(list),
        Path::new(out),
        (count, seed),
        Path::new(equivalent),
    ) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("mutants: {why}");
            ExitCode::from(2)
        }
    }
}

/// Draws, switches, builds and tries the mutants of `package`, and reports the score.
fn judge(
    package: &str,
    list: &Path,
    out: &Path,
    (count, seed): (usize, u64),
    equivalent: &Path,
) -> Result<(), String> {
    let (drawn, total) = list::draw(list, equivalent, count, seed)?;
    eprintln!("{} of {total} mutants of {package}", drawn.len());
    let built = build::all_at_once(package, out, &drawn)?;
    eprintln!(
        "{} compiled in, {} do not compile, {} are in constants or alike",
        built.switched.len(),
        built.unviable.len(),
        built.unswitched.len()
    );
    if std::env::var_os(REACH).is_some() {
        let unreached = trial::unreached(&built, out)?;
        for &mutant in &unreached {
            println!("not reached: {}", drawn[mutant].name);
        }
        let (count, all) = (unreached.len(), built.switched.len());
        println!("{package}: {count} of {all} viable mutants are not reached by a test");
        return Ok(());
    }
    let fates = trial::all(&built, &drawn, out)?;
    tell(package, out, &drawn, &built, &fates)
}

/// Writes the caught, missed, late and untried mutants into files beside the copy, and prints the
/// score.
fn tell(
    package: &str,
    out: &Path,
    drawn: &[Mutant],
    built: &build::Built,
    fates: &[(usize, Fate)],
) -> Result<(), String> {
    let names = |fate: Fate| -> Vec<&str> {
        let with_it = fates.iter().filter(|(_, found)| *found == fate);
        with_it
            .map(|&(mutant, _)| drawn[mutant].name.as_str())
            .collect()
    };
    let of = |mutants: &[usize]| -> Vec<&str> {
        mutants
            .iter()
            .map(|&mutant| drawn[mutant].name.as_str())
            .collect()
    };
    let (caught, late, missed) = (names(Fate::Caught), names(Fate::Late), names(Fate::Missed));
    for (file, names) in [
        ("caught.txt", &caught),
        ("timeout.txt", &late),
        ("missed.txt", &missed),
        ("unviable.txt", &of(&built.unviable)),
        ("unswitched.txt", &of(&built.unswitched)),
    ] {
        let lines: String = names.iter().map(|name| format!("{name}\n")).collect();
        std::fs::write(out.join(file), lines).map_err(|error| format!("{file}: {error}"))?;
    }
    for name in &missed {
        println!("missed: {name}");
    }
    let (seen, viable) = (caught.len() + late.len(), fates.len());
    if viable == 0 {
        return Err(format!("no mutant of {package} compiles: nothing was seen"));
    }
    println!(
        "{package}: {seen} of {viable} viable mutants caught, {} % ({} by time-out)",
        100 * seen / viable,
        late.len()
    );
    Ok(())
}
