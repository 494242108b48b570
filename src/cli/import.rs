use std::path::{Path, PathBuf};

use clap::Args;
use protocols::{LineConfig, Parity};

use super::answer::Imported;
use super::{CliError, Verdict, out};
use crate::capture::import::{self, Format, Options};
use crate::realtime::playback::Side as PlayedSide;
use crate::show::shell::word;

/// Turn a file of another tool into a capture.
///
/// Reads hex text, dumps of xxd, hexdump and od, logs of socat, strace, Modbus tools and port
/// monitors, tables, pcap and pcapng, sigrok and Saleae exports, VCD, text with times, the CSV of
/// `hilrig export`, and bytes alone; docs/import.md lists all. The format is recognised
/// automatically; --format forces one. gzip and zip archives and UTF-16 are unpacked first. An
/// invalid line is an error with its line number.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    socat -x -v /dev/ttyUSB0,raw PTY,link=/tmp/robot 2> dump.txt   # then\n  \
    hilrig import dump.txt -o field.pcapng --link lidar --baud 115200\n  \
    hilrig import two-channels.sr -o field.pcapng    # decoded as UART, the rate by its pulses\n  \
    hilrig import logic.vcd -o field.pcapng --channel RX --channel TX --baud 115200\n  \
    hilrig import uart.txt -o field.pcapng --samplerate 4000000 --baud 115200\n  \
    hilrig import dump.bin --format raw --baud 115200 -o field.pcapng")]
pub(super) struct ImportArgs {
    /// File to read
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Capture to write
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Format of the file [default: recognised]
    #[arg(long)]
    format: Option<Format>,
    /// Name of the link
    #[arg(long, value_name = "NAME", default_value = "line")]
    link: String,
    /// Baud rate of the line
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(50..=12_000_000))]
    baud: Option<u32>,
    /// Samples per second of the logic analyzer
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    samplerate: Option<u64>,
    /// Channel or analyzer to read; may be repeated [default: all with serial bytes]
    #[arg(long, value_name = "NAME")]
    channel: Vec<String>,
    /// Data bits, parity and stop bits of a line read from its levels, e.g. 8E1 [default: derived
    /// from its characters]
    #[arg(long, value_name = "CODING", value_parser = coding)]
    coding: Option<LineConfig>,
    /// The sender of the bytes that the tool received, or that socat marks with >
    #[arg(long, value_name = "SIDE", default_value = "device")]
    from: PlayedSide,
}

/// `8N1`, `7E1`, `8E2`.
fn coding(text: &str) -> Result<LineConfig, String> {
    let expected = || "expected data bits, parity and stop bits, e.g. 8N1, 7E1 or 8E2".to_owned();
    let &[data, parity, stop] = text.as_bytes() else {
        return Err(expected());
    };
    let parity = match parity.to_ascii_uppercase() {
        b'N' => Parity::None,
        b'E' => Parity::Even,
        b'O' => Parity::Odd,
        _ => return Err(expected()),
    };
    if !(b'5'..=b'8').contains(&data) || !matches!(stop, b'1' | b'2') {
        return Err(expected());
    }
    Ok(LineConfig {
        data_bits: data - b'0',
        parity,
        stop_bits: stop - b'0',
        ..LineConfig::new_8n1(1)
    })
}

/// The next step for a file that is no capture of hilrig: the command that imports it, or the
/// reason why it cannot be imported.
pub(super) fn next_step(path: &Path) -> String {
    let out = path.with_extension("imported.pcapng");
    let [file, out] = [path, &out].map(word);
    // A pipe was read before and has no more.
    let bytes = safefs::read(path).unwrap_or_default();
    let format = match import::open(&bytes, path) {
        Ok(opened) => opened.format,
        Err(error) => return error.to_string(),
    };
    match format {
        Some(format) => format!(
            "expected a capture of hilrig, found {}; import it first: hilrig import {file} -o {out}",
            format.name()
        ),
        None => format!(
            "expected a capture of hilrig; if these are the bytes of a port, import them first: \
             hilrig import {file} --format raw --baud N -o {out}"
        ),
    }
}

pub(super) fn run(args: ImportArgs) -> Result<Verdict, CliError> {
    let bytes = super::read(&args.file)?;
    let content = |error: import::ImportError| CliError::content(&args.file, error);
    let (bytes, format, mut notes) = match args.format {
        Some(Format::Raw) => (bytes.into(), Format::Raw, Vec::new()),
        Some(format) => {
            let opened = import::unpacked(&bytes).map_err(content)?;
            (opened.bytes, format, opened.notes)
        }
        None => {
            let opened = import::open(&bytes, &args.file).map_err(content)?;
            let Some(format) = opened.format else {
                let what = format!(
                    "{}\nfor plain bytes of a port use --format raw --baud N",
                    import::looked_for(&opened.bytes)
                );
                return Err(CliError::content(&args.file, what));
            };
            (opened.bytes, format, opened.notes)
        }
    };
    let options = Options {
        link: args.link,
        baud: args.baud,
        sample_rate: args.samplerate,
        direction: args.from.speaks(),
        channels: args.channel,
        coding: args.coding,
    };
    let imported = import::read(&bytes, format, &options)
        .map_err(|error| CliError::content(&args.file, error))?;
    notes.extend(imported.notes.iter().cloned());
    notes.iter().for_each(|note| eprintln!("{note}"));
    let out = args.out.display();
    safefs::write(&args.out, imported.to_pcapng(format))
        .map_err(|error| CliError::write(&out, error))?;
    let bytes: usize = imported
        .records()
        .iter()
        .map(|record| record.bytes.len())
        .sum();
    let (name, records) = (format.name(), imported.records().len());
    println!("{bytes} bytes in {records} records of {name}, written to {out}");
    out::answer(&Imported {
        file: out.to_string(),
        format: name.to_owned(),
        bytes: bytes as u64,
        records: records as u64,
        notes,
    });
    Ok(Verdict::Pass)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coding_is_three_characters() {
        let read = |text| coding(text).map(|line| (line.data_bits, line.parity, line.stop_bits));
        assert_eq!(read("8N1"), Ok((8, Parity::None, 1)));
        assert_eq!(read("7e2"), Ok((7, Parity::Even, 2)));
        assert_eq!(read("8O1"), Ok((8, Parity::Odd, 1)));
        for text in ["", "8N", "9N1", "8X1", "8N3", "8N1.5"] {
            assert!(read(text).expect_err("none").contains("8N1"), "{text}");
        }
    }
}
