//! The node program: an existing one, or built from the shipped sources.

use core::fmt;
use core::sync::atomic::{AtomicU64, Ordering};
use std::env;
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use safefs::Dir;

/// Name of the program.
const NAME: &str = "hilrig-simavr";
/// Environment variable with the path of a program that was built by hand.
const VARIABLE: &str = "HILRIG_SIMAVR_NODE";

/// Declares the files of `nodes/simavr`.
macro_rules! sources {
    ($($name:literal,)+) => {
        const SOURCES: &[(&str, &str)] = &[
            $(($name, include_str!(concat!("../simavr/", $name))),)+
        ];
    };
}

sources! {
    "bus.c",
    "elf.c",
    "elf.h",
    "idle.c",
    "json.c",
    "json.h",
    "main.c",
    "node.h",
    "pins.c",
    "power.c",
    "run.c",
    "setup.c",
    "uart.c",
    "wire.c",
}

/// The reason why the node program is not available.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BuildError(String);

impl fmt::Display for BuildError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl core::error::Error for BuildError {}

/// The path of the node program. A missing program is built in the user's cache folder, once for
/// each version of its sources. The variable `HILRIG_SIMAVR_NODE` overrides the path.
///
/// # Errors
/// If the build fails; the message names a missing package.
pub fn program() -> Result<PathBuf, BuildError> {
    if let Some(path) = env::var_os(VARIABLE).map(PathBuf::from) {
        return match path.is_file() {
            true => Ok(path),
            false => Err(BuildError(format!(
                "{VARIABLE} names {}, which is not a file",
                path.display()
            ))),
        };
    }
    let folder = cache().join(format!("simavr-{:016x}", fingerprint()));
    let path = folder.join(NAME);
    if path.is_file() {
        return Ok(path);
    }
    build(&folder).map(|()| path)
}

/// The user's cache folder.
fn cache() -> PathBuf {
    let named = |name| env::var_os(name).filter(|value: &OsString| !value.is_empty());
    let base = match (named("XDG_CACHE_HOME"), named("HOME")) {
        (Some(cache), _) => PathBuf::from(cache),
        (None, Some(home)) => Path::new(&home).join(".cache"),
        (None, None) => env::temp_dir(),
    };
    base.join("hilrig")
}

/// FNV-1a of the sources.
fn fingerprint() -> u64 {
    let bytes = SOURCES
        .iter()
        .flat_map(|(name, text)| name.bytes().chain(text.bytes()));
    bytes.fold(0xCBF2_9CE4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)
    })
}

fn build(folder: &Path) -> Result<(), BuildError> {
    let failed = |what: &dyn fmt::Display| {
        BuildError(format!(
            "the simulator of AVR boards cannot be built in {}: {what}",
            folder.display()
        ))
    };
    let dir = Dir::create(folder).map_err(|error| failed(&error))?;
    // Another run or thread may build at the same time, so each build has its own folder.
    static BUILDS: AtomicU64 = AtomicU64::new(0);
    let number = BUILDS.fetch_add(1, Ordering::Relaxed);
    let own = format!("build-{}-{number}", std::process::id());
    let built = build_in(&dir, &own);
    let _ = dir.remove_tree(&own);
    built.map_err(|error| failed(&error))
}

/// Builds the program in the folder `own` below `dir` and moves it to `dir`.
fn build_in(dir: &Dir, own: &str) -> Result<(), String> {
    let said = |error: io::Error| error.to_string();
    let folder = dir.below(own).map_err(said)?;
    for (name, text) in SOURCES {
        folder.write(name, text).map_err(said)?;
    }
    let compiler = env::var_os("CC").unwrap_or_else(|| "cc".into());
    let sources = SOURCES.iter().filter(|(name, _)| name.ends_with(".c"));
    let built = Command::new(&compiler)
        .current_dir(folder.path())
        .args(["-isystem", "/usr/include/simavr", "-O2", "-std=gnu11"])
        .args(["-Wall", "-Wextra", "-Werror"])
        .args(sources.map(|(name, _)| name))
        .args(["-o", NAME, "-lsimavr", "-lelf", "-lm"])
        .output();
    let built = built.map_err(|error| {
        format!(
            "{}: {error}; install a C compiler: apt install gcc libc6-dev libsimavr-dev libelf-dev",
            compiler.display()
        )
    })?;
    if !built.status.success() {
        return Err(reason(&String::from_utf8_lossy(&built.stderr)));
    }
    dir.rename(format!("{own}/{NAME}"), NAME).map_err(said)
}

/// The cause of the compiler's messages.
fn reason(words: &str) -> String {
    let is_missing = ["sim_avr.h", "avr_", "-lsimavr", "-lelf"]
        .iter()
        .any(|name| {
            words.contains(&format!("{name}: No such file"))
                || words.contains(&format!("cannot find {name}"))
        })
        || (words.contains("No such file") && words.contains(".h"));
    if is_missing {
        return "simavr is missing: apt install libsimavr-dev libelf-dev (Debian, Ubuntu); elsewhere \
                install simavr 1.6 or later with its headers in /usr/include/simavr"
            .to_owned();
    }
    let first = words.lines().find(|line| line.contains("error"));
    first.unwrap_or("the compiler failed").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages of gcc 12 without the package, and without the library only.
    #[test]
    fn a_missing_simulator_names_the_package() {
        for words in [
            "node.h:12:10: fatal error: avr_adc.h: No such file or directory\n",
            "/usr/bin/ld: cannot find -lsimavr: No such file or directory\n",
        ] {
            assert!(
                reason(words).contains("apt install libsimavr-dev"),
                "{words}"
            );
        }
        assert_eq!(reason("a.c:1: error: x\n"), "a.c:1: error: x");
    }
}
