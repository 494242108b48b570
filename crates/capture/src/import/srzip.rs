//! sigrok sessions (.sr): a zip archive with the samples of a logic analyzer.
//!
//! ```text
//! version                 "2"
//! metadata                [device 1] capturefile=logic-1 samplerate=1 MHz probe1=RX unitsize=1
//! logic-1-1, logic-1-2    samples of `unitsize` bytes, a bit a probe, the first in bit 0
//! ```

use super::Look;
use super::imported::{ImportError, Imported, Options};
use super::levels::{self, Channel, sample_nanos, sample_rate};
use super::uart::Levels;
use super::zipfile::{Entry, entries, is_zip};

/// Whether a zip archive is a sigrok session.
pub(super) fn is_session(bytes: &[u8]) -> bool {
    entries(bytes).is_ok_and(|entries| {
        let has = |name| entries.iter().any(|entry| entry.name == name);
        has("metadata") && has("version")
    })
}

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    (is_zip(bytes) && is_session(bytes)).then_some(Look::Surely)
}

/// Description of the samples in the session.
struct Metadata {
    file: String,
    rate: u64,
    unit: usize,
    /// Bit and name of each probe.
    probes: Vec<(usize, String)>,
}

fn metadata(text: &str, options: &Options) -> Result<Metadata, ImportError> {
    let values = || text.lines().filter_map(|line| line.split_once('='));
    let value = |key: &str| {
        values()
            .find(|(name, _)| name.trim() == key)
            .map(|(_, value)| value)
    };
    let file = value("capturefile").ok_or_else(|| {
        ImportError::of_file(
            "this sigrok session has no logic channels: expected digital samples; record with a \
             logic analyzer, or threshold the analog channel in PulseView",
        )
    })?;
    let rate = options
        .sample_rate
        .or_else(|| sample_rate(value("samplerate")?));
    let rate = rate.ok_or_else(|| {
        ImportError::of_file("this sigrok session has no sample rate: expected --samplerate")
    })?;
    let unit = value("unitsize").and_then(|unit| unit.trim().parse().ok());
    let unit = unit.filter(|unit| (1..=64).contains(unit));
    let unit: usize = unit.ok_or_else(|| {
        ImportError::of_file("the metadata of this sigrok session has no valid unitsize")
    })?;
    let probe = |(key, name): (&str, &str)| {
        let number: usize = key.trim().strip_prefix("probe")?.parse().ok()?;
        let bit = number.checked_sub(1).filter(|&bit| bit < unit * 8)?;
        Some((bit, name.trim().to_owned()))
    };
    Ok(Metadata {
        file: file.trim().to_owned(),
        rate,
        unit,
        probes: values().filter_map(probe).collect(),
    })
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let damaged = |what: String| ImportError::of_file(format!("this sigrok session {what}"));
    let all = entries(bytes).map_err(damaged)?;
    let content = |name: &str| -> Result<Vec<u8>, ImportError> {
        let entry = all.iter().find(|entry| entry.name == name);
        let entry = entry.ok_or_else(|| damaged(format!("has no {name}")))?;
        entry.content(bytes).map_err(damaged)
    };
    let text = String::from_utf8_lossy(&content("metadata")?).into_owned();
    let metadata = metadata(&text, options)?;
    let names = pieces(&all, &metadata.file);
    let mut channels: Vec<Channel> = Vec::new();
    let mut sample = 0_u64;
    for name in names {
        for unit in content(&name)?.chunks_exact(metadata.unit) {
            let nanos = sample_nanos(sample, metadata.rate);
            for (index, (bit, name)) in metadata.probes.iter().enumerate() {
                let level = unit[bit / 8] >> (bit % 8) & 1 == 1;
                if sample == 0 {
                    let levels = Levels {
                        first: level,
                        ..Levels::default()
                    };
                    let name = name.clone();
                    channels.push(Channel { name, levels });
                }
                channels[index].levels.set(nanos, level);
            }
            sample += 1;
        }
    }
    if channels.is_empty() {
        return Err(damaged("holds no samples".to_owned()));
    }
    levels::read(channels, options, out)
}

/// The sample files in their order: a single one, or numbered ones.
fn pieces(all: &[Entry], file: &str) -> Vec<String> {
    let number = |name: &str| -> Option<u32> {
        match name.strip_prefix(file)? {
            "" => Some(0),
            rest => rest.strip_prefix('-')?.parse().ok(),
        }
    };
    let files = all
        .iter()
        .filter_map(|one| Some((number(&one.name)?, one.name.clone())));
    let mut files: Vec<(u32, String)> = files.collect();
    files.sort();
    files.into_iter().map(|(_, name)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::super::zipfile::stored;
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    /// Samples of 1 us: the bits of a byte at 100,000 baud are ten samples long.
    fn samples(byte: u8) -> Vec<bool> {
        let bits = (0..8).map(|bit| byte >> bit & 1 == 1);
        let bits = core::iter::once(false).chain(bits).chain([true]);
        let sent = bits.flat_map(|bit| [bit; 10]);
        let idle = core::iter::repeat_n(true, 50);
        idle.clone().chain(sent).chain(idle).collect()
    }

    fn session(metadata: &str, files: &[(&str, Vec<u8>)]) -> Vec<u8> {
        let mut all = vec![("version", &b"2"[..]), ("metadata", metadata.as_bytes())];
        all.extend(files.iter().map(|(name, content)| (*name, &content[..])));
        stored(&all)
    }

    const METADATA: &str = "[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile=logic-1\n\
                            total probes=2\nsamplerate=1 MHz\nprobe1=RX\nprobe2=TX\nunitsize=1\n";

    fn told(file: &[u8]) -> Result<Vec<(u64, Direction, Vec<u8>)>, String> {
        let options = Options {
            baud: Some(100_000),
            ..Options::default()
        };
        let found = read_format(file, Format::Sr, &options).map_err(|error| error.to_string())?;
        let tuple =
            |one: &crate::Record| (one.at.as_nanos() / 1000, one.direction, one.bytes.to_vec());
        Ok(found.records().iter().map(tuple).collect())
    }

    /// The byte on RX begins at 50 us and ends at 150 us; the byte on TX follows 200 us later. The
    /// samples are in two files, numbered 2 and 10; by its name, the tenth would sort before the
    /// second.
    #[test]
    fn probes_are_read_as_uarts() {
        let (rx, tx) = (samples(0xA5), samples(0x3C));
        let idle = vec![true; rx.len()];
        let rx = [&rx[..], &idle[..]].concat();
        let tx = [&idle[..], &tx[..]].concat();
        let bits = rx.iter().zip(&tx);
        let bytes: Vec<u8> = bits
            .map(|(&rx, &tx)| u8::from(rx) | u8::from(tx) << 1)
            .collect();
        let (first, second) = bytes.split_at(170);
        let files = [
            ("logic-1-10", second.to_vec()),
            ("logic-1-2", first.to_vec()),
        ];
        let file = session(METADATA, &files);
        assert_eq!(Format::detect(&file), Some(Format::Sr));
        let expected = vec![
            (150, Direction::ToMaster, vec![0xA5]),
            (350, Direction::ToDevice, vec![0x3C]),
        ];
        assert_eq!(told(&file), Ok(expected));
    }

    #[test]
    fn a_session_without_samples_or_facts_is_refused() {
        let error = |metadata: &str, files: &[(&str, Vec<u8>)]| {
            told(&session(metadata, files)).expect_err("unsound")
        };
        assert!(error("[device 1]\ntotal analog=1\n", &[]).contains("no logic channels"));
        let no_rate = METADATA.replace("samplerate=1 MHz\n", "");
        assert!(error(&no_rate, &[]).contains("--samplerate"));
        assert!(error(&METADATA.replace("unitsize=1", "unitsize=0"), &[]).contains("unitsize"));
        assert!(error(METADATA, &[]).contains("holds no samples"));
        let still = [("logic-1", vec![3; 100])];
        assert!(error(METADATA, &still).contains("no channel changes its level: RX, TX"));
    }

    /// A session has its version and its metadata.
    #[test]
    fn a_session_has_two_files_beside_its_samples() {
        let is = |names: &[&str]| {
            let files: Vec<(&str, &[u8])> = names.iter().map(|name| (*name, &b"2"[..])).collect();
            is_session(&stored(&files))
        };
        assert!(is(&["version", "metadata"]) && !is(&["version"]) && !is(&["metadata"]));
        assert!(!is_session(b"no archive"));
    }

    /// A sample of `unitsize` bytes has eight probes for each byte, from 1 on. Its size is 1 to 64.
    #[test]
    fn a_unit_has_eight_probes_a_byte() {
        let bits = |unit: usize| {
            let text = format!(
                "capturefile=logic-1\nsamplerate=1 MHz\nunitsize={unit}\nprobe0=a\nprobe1=b\n\
                 probe8=c\nprobe9=d\nprobe16=e\nprobe17=f\nprobeX=g\n"
            );
            let found = metadata(&text, &Options::default()).map_err(|error| error.message);
            found.map(|found| {
                found
                    .probes
                    .into_iter()
                    .map(|(bit, _)| bit)
                    .collect::<Vec<_>>()
            })
        };
        assert_eq!((bits(1), bits(2)), (Ok(vec![0, 7]), Ok(vec![0, 7, 8, 15])));
        assert_eq!(bits(64), Ok(vec![0, 7, 8, 15, 16]));
        assert!(bits(0).is_err() && bits(65).is_err());
    }
}
