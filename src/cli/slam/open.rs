//! Recognises the format of a log, and reads it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::ModeArg;
use crate::capture::replay::Recorded;
use crate::cli::{CliError, read, replay};
use crate::robots;
use crate::scenario::{Scenario, Source};
use crate::slam::bag::unpack::{self, BYTES_MAX};
use crate::slam::bag::{Contents, db3, folder};
use crate::slam::finding::Kind;
use crate::slam::{Log, carmen, wire};

/// First bytes of every pcapng file.
const PCAPNG: &[u8] = &[0x0A, 0x0D, 0x0D, 0x0A];
/// First bytes of every MCAP file.
const MCAP: &[u8] = b"\x89MCAP";

/// Reads a log of any known format, and returns the usual mapper for it.
pub(super) fn open(path: &Path, scenario: Option<&Path>) -> Result<(Log, ModeArg), CliError> {
    if path.is_dir() {
        if path.join(CAPTURE).exists() {
            let inside = crate::cli::file_of(path, CAPTURE)?;
            return Ok((capture(&inside, scenario)?, ModeArg::Core));
        }
        let files = folder::files(path).map_err(|what| CliError::content(path, what))?;
        return match &files[..] {
            [one] => open(one, scenario),
            several => Ok((bag(path, several, scenario)?, ModeArg::Graph)),
        };
    }
    let bytes = read(path)?;
    if bytes.starts_with(PCAPNG) {
        return Ok((capture(path, scenario)?, ModeArg::Core));
    }
    let bytes = unpacked(&bytes, path).map_err(|what| CliError::content(path, what))?;
    let mut contents = Contents::default();
    if add(&mut contents, &bytes, path).map_err(|what| CliError::content(path, what))? {
        return Ok((log_of(contents, path, scenario)?, ModeArg::Graph));
    }
    if let Some((_, error)) = FOREIGN.iter().find(|(magic, _)| bytes.starts_with(magic)) {
        return Err(CliError::content(path, error));
    }
    let log = carmen::read(&bytes).map_err(|error| CliError::content(path, error))?;
    Ok((log, ModeArg::Graph))
}

/// First bytes of log formats that are not supported, with the next step for the user.
const FOREIGN: [(&[u8], &str); 3] = [
    (
        b"#ROSBAG V",
        "is a bag of ROS 1, expected one of ROS 2: convert it with `mcap convert IN.bag OUT.mcap`",
    ),
    (
        b"BZh",
        "is compressed by bzip2, expected plain text, gzip, zstd or lz4: unpack it with bunzip2",
    ),
    (
        b"\xFD7zXZ\0",
        "is compressed by xz, expected plain text, gzip, zstd or lz4: unpack it with unxz",
    ),
];

/// The capture of a result folder.
const CAPTURE: &str = "capture.pcapng";

/// Reads the files of one recording; unreadable parts are skipped and counted.
fn bag(dir: &Path, files: &[PathBuf], scenario: Option<&Path>) -> Result<Log, CliError> {
    let mut contents = Contents::default();
    for file in files {
        let read = safefs::read(file).map_err(|error| format!("cannot be read: {error}"));
        let added = read.and_then(|bytes| {
            let bytes = unpacked(&bytes, file)?;
            let is_known = add(&mut contents, &bytes, file)?;
            let known = is_known.then_some(());
            known.ok_or_else(|| "is no recording, expected MCAP or SQLite".to_owned())
        });
        if let Err(what) = added {
            let place = format_args!("{}", file.display());
            contents
                .findings
                .add(Kind::Part, place, format_args!("{what}"));
        }
    }
    log_of(contents, dir, scenario)
}

/// Adds the content of a recording's file, if the file is one.
fn add(contents: &mut Contents, bytes: &[u8], path: &Path) -> Result<bool, String> {
    if bytes.starts_with(MCAP) {
        return mcap(contents, bytes).map(|()| true);
    }
    if !bytes.starts_with(db3::MAGIC) {
        return Ok(false);
    }
    db3::read_into(contents, bytes).map_err(|error| error.to_string())?;
    let mut beside = path.as_os_str().to_owned();
    beside.push("-wal");
    if std::fs::metadata(&beside).is_ok_and(|beside| beside.len() > 0) {
        eprintln!(
            "{}: the content of {} is not read: merge it with `sqlite3 {} 'PRAGMA \
             wal_checkpoint(TRUNCATE)'`",
            path.display(),
            Path::new(&beside).display(),
            path.display()
        );
    }
    Ok(true)
}

#[cfg(not(feature = "mcap"))]
fn mcap(_contents: &mut Contents, _bytes: &[u8]) -> Result<(), String> {
    Err("is an MCAP file, which this build of hilrig does not read (feature mcap)".to_owned())
}

#[cfg(feature = "mcap")]
fn mcap(contents: &mut Contents, bytes: &[u8]) -> Result<(), String> {
    slam::bag::mcap::read_into(contents, bytes);
    Ok(())
}

/// Files of hilrig contain the bytes of the links, which hold more than the messages.
fn log_of(mut contents: Contents, path: &Path, scenario: Option<&Path>) -> Result<Log, CliError> {
    contents.sort();
    let robot = match (scenario, &contents.scenario) {
        (Some(scenario), _) => Some(Scenario::read(scenario)?),
        (None, Some(text)) => Some(Scenario::parse(path, text.clone())?),
        (None, None) => None,
    };
    if let Some((scenario, source)) = robot
        && contents.has_bytes()
    {
        let mut log = wire::read(&contents.recorded, &senses(&scenario, &source)?)
            .map_err(|error| CliError::content(path, error))?;
        log.findings.extend(contents.findings);
        return Ok(log);
    }
    contents
        .log()
        .map_err(|error| CliError::content(path, error))
}

fn capture(path: &Path, scenario: Option<&Path>) -> Result<Log, CliError> {
    let capture = replay::read(path)?;
    let (scenario, source) = replay::robot(&capture, path, scenario)?;
    let recorded = Recorded::of(&capture, None);
    wire::read(&recorded, &senses(&scenario, &source)?)
        .map_err(|error| CliError::content(path, error))
}

/// The mapper's settings from the scenario's robot.
fn senses(scenario: &Scenario, source: &Source) -> Result<robots::Senses, CliError> {
    let senses = robots::of(scenario, source)?.senses(scenario, source)?;
    senses.ok_or_else(|| {
        let message =
            "has no lidar and wheels that the mapper can read, expected a robot with both";
        let error = source.invalid(source.find("robot"), "robot", message);
        error.into()
    })
}

/// The content of a packed file, or the file itself; of a damaged file, the part before the damage.
fn unpacked<'a>(bytes: &'a [u8], path: &Path) -> Result<Cow<'a, [u8]>, String> {
    let Some(out) = unpack::any(bytes, BYTES_MAX) else {
        return Ok(Cow::Borrowed(bytes));
    };
    let bytes = out.bytes;
    if let Some(error) = out.error {
        if bytes.is_empty() {
            return Err(format!("cannot be unpacked: {error}"));
        }
        let (path, count) = (path.display(), bytes.len());
        eprintln!("{path}: {error}; {count} bytes before that follow");
    }
    Ok(Cow::Owned(bytes))
}
