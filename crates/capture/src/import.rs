//! Import of files of other tools as captures.
//!
//! `FORMATS` has one row per format: the mark that identifies it, and the function that reads it.
//! [`open`] unpacks a file and finds its row. It refuses files of other known kinds and names the
//! command that converts them. A reader is strict: unexpected content is an error with its line and
//! byte, because a partly understood dump would test events that never happened. A few damaged
//! lines cost themselves alone; they are counted.

mod cells;
mod controls;
mod damaged;
mod decoded;
mod foreign;
mod hexdump;
mod hextext;
mod imported;
mod interceptty;
mod journal;
mod jpnevulator;
mod levels;
mod limited;
mod owncsv;
mod packet;
mod packets;
mod rate;
mod raw;
mod roles;
mod saleae;
mod saleaebin;
mod samples;
mod sigrok;
mod socat;
mod spy;
mod srzip;
mod strace;
mod table;
mod text;
mod textlog;
mod threshold;
mod tlog;
mod trace;
mod uart;
mod unpack;
mod usb;
mod vcd;
mod zipfile;

use std::borrow::Cow;
use std::path::Path;

pub use imported::{ImportError, Imported, Options};

/// Import formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Format {
    /// Standard error of `socat -x`, with or without -v
    Socat,
    /// `jpnevulator --read --timing-print`, with or without its options
    Jpnevulator,
    /// interceptty, with or without -T
    Interceptty,
    /// Output of pySerial's `spy://` port
    Spy,
    /// Hex text: pairs, digits, 0x.., \x.., with or without times and directions
    Hex,
    /// Logs that show bytes in hex among words: libmodbus, pymodbus, ESPHome, Portmon and others
    Log,
    /// Dumps with offsets: xxd, hexdump, od, tshark -x
    #[cfg_attr(feature = "clap", value(aliases = ["xxd", "od"]))]
    Hexdump,
    /// pcap or pcapng: serial, USER0 to USER15, USB serial adapters
    #[cfg_attr(feature = "clap", value(alias = "pcapng"))]
    Pcap,
    /// `sigrok-cli -P uart:.. -A uart=rx-data`, best with --protocol-decoder-samplenum
    Sigrok,
    /// `sigrok-cli -P uart:.. --protocol-decoder-jsontrace`
    Trace,
    /// sigrok session (.sr): channels decoded as UART
    Sr,
    /// VCD waveform: wires decoded as UART
    Vcd,
    /// Samples of a logic analyzer as CSV (sigrok, DSView, Saleae digital): decoded as UART
    Samples,
    /// Saleae Logic, export of the serial analyzer or of Logic 2's table
    Saleae,
    /// Binary export of Saleae's Logic 2 of one channel
    SaleaeBinary,
    /// Tables with columns of time, direction and bytes: CSV or JSON
    Table,
    /// Reads and writes of a port, as strace shows them
    Strace,
    /// Telemetry log of a MAVLink ground station
    Tlog,
    /// Text with a time before each line (Arduino IDE, tio -t, TeraTerm), PuTTY's log, script
    Text,
    /// `hilrig export` to CSV
    Csv,
    /// The bytes alone: `tio --log-file` without -t, `socat -r`, a dump of a port
    Raw,
}

/// Certainty of the detection of a format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Look {
    /// The bytes could also come from a device.
    Perhaps,
    /// Only that tool writes such a file.
    Surely,
}

/// One format.
struct Row {
    format: Format,
    /// Name, as on the command line.
    name: &'static str,
    /// The mark that identifies it, for the user.
    mark: &'static str,
    look: fn(&[u8]) -> Option<Look>,
    read: fn(&[u8], &Options, &mut Imported) -> Result<(), ImportError>,
}

/// All formats. Detection takes the first certain row, otherwise the first possible one.
const FORMATS: &[Row] = &[
    row(
        Format::Pcap,
        "pcap",
        "the magic number of pcap or pcapng",
        packets::look,
        packets::read,
    ),
    row(
        Format::Sr,
        "sr",
        "a zip archive with sigrok's \"metadata\"",
        srzip::look,
        srzip::read,
    ),
    row(
        Format::Socat,
        "socat",
        "\"> YYYY/MM/DD hh:mm:ss.fraction length=N from=N to=N\"",
        |bytes| any_line(bytes, socat::is_head),
        socat::read,
    ),
    row(
        Format::Jpnevulator,
        "jpnevulator",
        "\"YYYY-MM-DD hh:mm:ss.uuuuuu: \" above hex pairs",
        |bytes| any_line(bytes, jpnevulator::is_head),
        jpnevulator::read,
    ),
    row(
        Format::Spy,
        "spy",
        "\"000000.000 TX   0000  AB 24 ..\"",
        |bytes| any_line(bytes, spy::is_data),
        spy::read,
    ),
    row(
        Format::Interceptty,
        "interceptty",
        "lines of \"> <tab>0xAB (.)\" and \"< 0xAB (.)\"",
        interceptty::look,
        interceptty::read,
    ),
    row(
        Format::Sigrok,
        "sigrok",
        "\"FROM-TO uart-1: AB\" or \"uart-1: AB\"",
        |bytes| any_line(bytes, sigrok::is_data),
        sigrok::read,
    ),
    row(
        Format::Trace,
        "trace",
        "JSON with \"traceEvents\"",
        trace::look,
        trace::read,
    ),
    row(
        Format::Vcd,
        "vcd",
        "\"$timescale\" and \"$var\"",
        vcd::look,
        vcd::read,
    ),
    row(
        Format::Csv,
        "csv",
        "the head \"time_s,link,direction,event,bytes,comment\"",
        owncsv::look,
        owncsv::read,
    ),
    row(
        Format::Saleae,
        "saleae",
        "the head \"Time [s],Value,..\" or \"name,type,start_time,duration,data,..\"",
        saleae::look,
        saleae::read,
    ),
    row(
        Format::Samples,
        "samples",
        "columns of 0 and 1 below \"Time..\" or \"; Samplerate: N\"",
        samples::look,
        samples::read,
    ),
    row(
        Format::SaleaeBinary,
        "saleae-binary",
        "\"<SALEAE>\" at the beginning",
        saleaebin::look,
        saleaebin::read,
    ),
    row(
        Format::Tlog,
        "tlog",
        "microseconds since 1970 before each MAVLink packet",
        tlog::look,
        tlog::read,
    ),
    row(
        Format::Strace,
        "strace",
        "\"read(3, \"..\", N) = N\" and \"write(3, ..\"",
        strace::look,
        strace::read,
    ),
    row(
        Format::Table,
        "table",
        "columns called data or bytes, and time or direction; or JSON with such keys",
        table::look,
        table::read,
    ),
    row(
        Format::Hexdump,
        "hexdump",
        "rows of an offset and bytes, as xxd, hexdump and od write",
        hexdump::look,
        hexdump::read,
    ),
    row(
        Format::Hex,
        "hex",
        "nothing but hex digits, separators, times and directions",
        hextext::look,
        hextext::read,
    ),
    row(
        Format::Log,
        "log",
        "lines with TX, RX, send, read, arrows or times before bytes in hex",
        hextext::log::look,
        hextext::log::read,
    ),
    row(
        Format::Text,
        "text",
        "a time before each line of text, or PuTTY's head",
        textlog::look,
        textlog::read,
    ),
    row(Format::Raw, "raw", "--format raw", |_| None, raw::read),
];

const fn row(
    format: Format,
    name: &'static str,
    mark: &'static str,
    look: fn(&[u8]) -> Option<Look>,
    read: fn(&[u8], &Options, &mut Imported) -> Result<(), ImportError>,
) -> Row {
    Row {
        format,
        name,
        mark,
        look,
        read,
    }
}

/// Number of lines that are examined: a tool's diagnostics may precede its first line of data.
const LINES_LOOKED_AT: usize = 50;

fn any_line(bytes: &[u8], is: fn(&[u8]) -> bool) -> Option<Look> {
    let mut head = text::lines(bytes).take(LINES_LOOKED_AT);
    head.any(|line| is(line.text)).then_some(Look::Surely)
}

impl Format {
    /// Name as on the command line.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Format of a file, if its beginning shows one; raw bytes show none.
    pub fn detect(bytes: &[u8]) -> Option<Self> {
        let found = FORMATS
            .iter()
            .filter_map(|row| Some(((row.look)(bytes)?, row.format)));
        let mut best: Option<(Look, Self)> = None;
        for (look, format) in found {
            if best.is_none_or(|(known, _)| look > known) {
                best = Some((look, format));
            }
        }
        best.map(|(_, format)| format)
    }

    /// Format of a file, if only that tool writes such a file.
    fn certain(bytes: &[u8]) -> Option<Self> {
        let is = |row: &&Row| (row.look)(bytes) == Some(Look::Surely);
        FORMATS.iter().find(is).map(|row| row.format)
    }

    /// Whether each line of the text stands for itself: a damaged one can be left out.
    const fn is_of_lines(self) -> bool {
        matches!(
            self,
            Self::Socat
                | Self::Jpnevulator
                | Self::Interceptty
                | Self::Spy
                | Self::Hex
                | Self::Log
                | Self::Hexdump
                | Self::Sigrok
                | Self::Table
                | Self::Strace
                | Self::Csv
        )
    }

    fn row(self) -> &'static Row {
        let is_own = |row: &&Row| row.format == self;
        FORMATS.iter().find(is_own).expect("every form has a row")
    }
}

/// A file with its format.
#[derive(Clone, Debug)]
pub struct Opened<'a> {
    /// The file's content: unpacked, and as UTF-8 without a byte-order mark if it is text.
    pub bytes: Cow<'a, [u8]>,
    /// The format, if the content shows one.
    pub format: Option<Format>,
    /// Whether only that tool writes such a file.
    pub is_certain: bool,
    /// Names of the layers that were unpacked.
    pub notes: Vec<String>,
}

/// Unpacks a file whose format is already known.
///
/// # Errors
/// If the file cannot be unpacked.
pub fn unpacked(bytes: &[u8]) -> Result<Opened<'_>, ImportError> {
    let mut notes = Vec::new();
    let bytes = unpack::unpack(bytes, &mut notes)?;
    Ok(Opened {
        bytes,
        format: None,
        is_certain: false,
        notes,
    })
}

/// Unpacks a file and detects its format.
///
/// # Errors
/// If the file is of another known kind, with the next step; or if it cannot be unpacked.
pub fn open<'a>(bytes: &'a [u8], path: &Path) -> Result<Opened<'a>, ImportError> {
    let mut notes = Vec::new();
    let bytes = unpack::unpack(bytes, &mut notes)?;
    if bytes.trim_ascii().is_empty() {
        let message = "the file is empty: its tool has written nothing yet, or to another file; \
                       record again";
        return Err(ImportError::of_file(message));
    }
    let (whole, cuts) = damaged::without_cut_bytes(&bytes);
    let certain = match (Format::certain(&whole), cuts.is_empty()) {
        (Some(format), false) if format.is_of_lines() => Some(format),
        _ => Format::certain(&bytes),
    };
    let possible = match (Format::detect(&whole), cuts.is_empty()) {
        (Some(format), false) if format.is_of_lines() => Some(format),
        _ => Format::detect(&bytes),
    };
    drop(whole);
    // Firmware images and logs of other buses are hex text as well.
    if certain.is_none_or(|format| matches!(format, Format::Hex | Format::Log))
        && let Some(message) = foreign::refusal(&bytes, path)
    {
        return Err(ImportError::of_file(message));
    }
    let format = certain.or(possible);
    Ok(Opened {
        bytes,
        format,
        is_certain: certain.is_some(),
        notes,
    })
}

/// The marks of all formats, for the error that a file has none of them.
pub fn looked_for(bytes: &[u8]) -> String {
    let rows = FORMATS
        .iter()
        .map(|row| format!("\n  {:<12} {}", row.name, row.mark));
    let rows: String = rows.collect();
    let doubt = hexdump::doubt(bytes).or_else(|| hextext::doubt(bytes));
    let doubt = doubt.map_or_else(String::new, |doubt| format!("\n{doubt}"));
    format!("this file has none of the forms that can be imported; looked for:{rows}{doubt}")
}

/// Reads a file of `format`.
///
/// # Errors
/// At the first unexpected line, or if the file has no data.
pub fn read(bytes: &[u8], format: Format, options: &Options) -> Result<Imported, ImportError> {
    let row = format.row();
    let mut imported = match format.is_of_lines() {
        true => damaged::read(bytes, options, row.read)?,
        false => {
            let mut imported = Imported::new();
            (row.read)(bytes, options, &mut imported)?;
            imported
        }
    };
    imported.note_backwards();
    if imported.records().is_empty() {
        return Err(ImportError {
            line: 1,
            offset: 0,
            message: format!("expected bytes in the form of {}, found none", row.name),
        });
    }
    Ok(imported)
}

const LOCAL: &str = "the tool wrote local times; they are taken as UTC";

#[cfg(test)]
mod tests;
