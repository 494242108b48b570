//! Programs of a scenario, and serial cables between them.

use std::path::{Path, PathBuf};

use protocols::LineConfig;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Flaw;

/// Accepted baud rates.
const BAUD: core::ops::RangeInclusive<u32> = 300..=4_000_000;

/// A program under test: `hilrig run FILE` starts all of them, in virtual time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExecSpec {
    /// Shell command. Its environment has the ports of all devices and cables, as that of `--exec`.
    pub command: String,
    /// Folder in which it starts, relative to the scenario's file; the scenario's own if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
    /// Whether the program may end with exit code 0 before the run is over.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub may_end: bool,
    /// Whether the program may stop sending and reading, e.g. when its work is done. This has an
    /// effect only if all programs of the file may be idle.
    #[serde(default, skip_serializing_if = "core::ops::Not::not")]
    pub may_idle: bool,
}

/// A serial cable between two programs, each with a port of its own. It is a link: faults, rules
/// and `[link.NAME]` name it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CableSpec {
    /// Baud rate of both ports.
    pub baud: u32,
    /// Name of the port at the end from which `to-device` leads, e.g. that of a planner.
    pub master: String,
    /// Name of the port at the other end, e.g. that of a driver.
    pub device: String,
}

impl CableSpec {
    /// Coding of both ports.
    pub fn line(&self) -> LineConfig {
        LineConfig::new_8n1(self.baud)
    }

    /// Checks its figures and names.
    ///
    /// # Errors
    /// A flaw that names the key.
    pub fn check(&self) -> Result<(), Flaw> {
        if !BAUD.contains(&self.baud) {
            let (least, most) = (BAUD.start(), BAUD.end());
            let message = format!("is {}, expected {least} to {most}", self.baud);
            return Err(Flaw::new("baud", message));
        }
        for (key, name) in [("master", &self.master), ("device", &self.device)] {
            let fits = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
            if name.is_empty() || !name.chars().all(fits) {
                let message = format!("is {name:?}, expected letters, digits, '-' and '_'");
                return Err(Flaw::new(key, message));
            }
        }
        Ok(())
    }
}

impl ExecSpec {
    /// The command for the shell, started in its folder.
    pub fn shell(&self) -> String {
        let folder = self.folder.as_deref().unwrap_or_else(|| Path::new("."));
        let folder = folder.display().to_string().replace('\'', "'\\''");
        format!("cd '{folder}' || exit 2; {}", self.command)
    }

    /// Stores the whole folder, so that a saved case starts the program there; `base` is that of
    /// the scenario's file.
    pub(super) fn embed(&mut self, base: &Path) {
        let folder = match &self.folder {
            Some(folder) => base.join(folder),
            None => base.to_owned(),
        };
        let folder = match folder.as_os_str().is_empty() {
            true => Path::new(".").to_owned(),
            false => folder,
        };
        self.folder = Some(std::path::absolute(&folder).unwrap_or(folder));
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// Each part of a command starts in the folder, and none if the folder is not there.
    #[test]
    fn a_whole_command_starts_in_its_folder() {
        let run = |folder: &Path, command: &str| {
            let spec = ExecSpec {
                command: command.to_owned(),
                folder: Some(folder.to_owned()),
                may_end: false,
                may_idle: false,
            };
            let output = Command::new("sh").args(["-c", &spec.shell()]).output();
            let output = output.expect("a shell");
            let said = String::from_utf8_lossy(&output.stdout).into_owned();
            (output.status.code(), said)
        };
        let folder = Path::new("/usr/bin");
        for command in [
            "pwd",
            "true & pwd",
            "true; pwd",
            "false || pwd",
            "true && pwd",
        ] {
            let expected = (Some(0), "/usr/bin\n".to_owned());
            assert_eq!(run(folder, command), expected, "{command}");
            let gone = run(Path::new("/no such folder"), command);
            assert_eq!(gone, (Some(2), String::new()), "{command}");
        }
    }
}
