use std::env;
use std::path::PathBuf;
use std::process::Command;

use clap::Args;

use super::answer::Files;
use super::{CliError, Verdict, described, out};
use crate::capture::wireshark::{FILE_NAME, dissector_of};
use safefs::Dir;

/// Install a decoder for the robots' protocols in Wireshark.
///
/// Wireshark opens a capture as it is and shows links, directions, times and faults. With this
/// file in its personal plugin folder it also shows the meaning of the bytes: lidar packets, bus
/// registers, messages of the PC. With --description it also decodes devices that files describe:
/// each field of a message can be filtered for as hilrig.DEVICE.FIELD. Without an option the
/// command prints the folder for the file.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig wireshark --install\n  \
    hilrig wireshark --print > hilrig.lua\n  \
    hilrig wireshark --description meter.toml gps --install\n  \
    tshark -X lua_script:hilrig.lua -r capture.pcapng -T fields -e hilrig.xv11.distance")]
pub(super) struct Wireshark {
    /// Write the file into the personal plugin folder
    #[arg(long, conflicts_with = "print")]
    install: bool,
    /// Print the file
    #[arg(long)]
    print: bool,
    /// Also decode these devices: descriptions that come with the tool, by name, or files that end
    /// with .toml
    #[arg(long, value_name = "NAME|FILE", num_args = 1..)]
    description: Vec<String>,
    /// Plugin folder instead of the personal one
    #[arg(long, value_name = "DIR")]
    dir: Option<PathBuf>,
}

pub(super) fn run(args: Wireshark) -> Result<Verdict, CliError> {
    let described = args.description.iter();
    let described = described.map(|name| described::load("--description", name));
    let text = dissector_of(&described.collect::<Result<Vec<_>, _>>()?);
    if args.print {
        return out::write_text("the file", text.as_bytes());
    }
    let dir = args.dir.or_else(plugin_dir).ok_or_else(|| {
        let expected = "expected --dir DIR, or tshark or HOME to find it by";
        CliError::Usage(format!(
            "where Wireshark's plugins are is not known: {expected}"
        ))
    })?;
    let path = dir.join(FILE_NAME);
    if args.install {
        let written = Dir::create(&dir).and_then(|dir| dir.write(FILE_NAME, &text));
        written.map_err(|error| CliError::write(format!("--install {}", path.display()), error))?;
        eprintln!("installed; Wireshark and tshark read it when they next start");
    } else {
        eprintln!("write the output of --print to this folder, or use --install:");
    }
    println!("{}", path.display());
    let files = vec![path.display().to_string()];
    out::answer(&Files { files });
    Ok(Verdict::Pass)
}

/// The folder reported by tshark, or Wireshark's default on Linux.
fn plugin_dir() -> Option<PathBuf> {
    let folders = Command::new("tshark").args(["-G", "folders"]).output();
    let told = folders.ok().and_then(|output| {
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let line = text
            .lines()
            .find(|line| line.starts_with("Personal Lua Plugins:"))?;
        let dir = line.split_once(':')?.1.trim();
        (!dir.is_empty()).then(|| PathBuf::from(dir))
    });
    told.or_else(|| {
        let home = env::var_os("HOME").map(PathBuf::from)?;
        Some(home.join(".local/lib/wireshark/plugins"))
    })
}
