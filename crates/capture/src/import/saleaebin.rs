//! Binary exports of Saleae's Logic 2: one channel a file, digital or analog, versions 0 and 1.
//!
//! Layout according to Saleae's support pages: little-endian, times in seconds as doubles.

use super::Look;
use super::imported::{ImportError, Imported, Options};
use super::levels::{self, Channel};
use super::threshold::digital;
use super::uart::Levels;

const MAGIC: &[u8] = b"<SALEAE>";

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    bytes.starts_with(MAGIC).then_some(Look::Surely)
}

/// Reader of consecutive numbers.
struct Numbers<'a>(&'a [u8], usize);

impl Numbers<'_> {
    fn next<const N: usize>(&mut self) -> Result<[u8; N], ImportError> {
        let found = self
            .0
            .get(self.1..)
            .and_then(|rest| rest.first_chunk::<N>());
        let cut = || {
            ImportError::at_byte(
                self.1.min(self.0.len()),
                "the export ends here: copy it again",
            )
        };
        let found = *found.ok_or_else(cut)?;
        self.1 += N;
        Ok(found)
    }

    fn word(&mut self) -> Result<u32, ImportError> {
        self.next().map(u32::from_le_bytes)
    }

    fn count(&mut self) -> Result<u64, ImportError> {
        self.next().map(u64::from_le_bytes)
    }

    fn seconds(&mut self) -> Result<f64, ImportError> {
        self.next().map(f64::from_le_bytes)
    }
}

/// Nanoseconds from the beginning of the recording.
fn nanos(seconds: f64, begin: f64) -> u64 {
    let nanos = ((seconds - begin) * 1e9).round();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "within the range, rounded"
    )]
    if (0.0..1e18).contains(&nanos) {
        nanos as u64
    } else {
        0
    }
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let mut numbers = Numbers(bytes, MAGIC.len());
    let (version, kind) = (numbers.word()?, numbers.word()?);
    let levels = match (version, kind) {
        (0, 0) => {
            let mut levels = Levels::default();
            chunk(&mut numbers, false, None, &mut levels)?;
            levels
        }
        (1, 0) => chunks(&mut numbers)?,
        (0, 1) => analog(&mut numbers)?,
        _ => {
            return Err(ImportError::of_file(format!(
                "this binary export of Saleae has version {version} and type {kind}: expected \
                 version 0 or 1, digital; in Logic 2 use File > Export Raw Data, CSV"
            )));
        }
    };
    out.note("the export is one channel: import the other direction from its own file");
    let name = "channel".to_owned();
    let options = Options {
        channels: Vec::new(),
        ..options.clone()
    };
    levels::read(vec![Channel { name, levels }], &options, out)
}

fn chunks(numbers: &mut Numbers<'_>) -> Result<Levels, ImportError> {
    let mut levels = Levels::default();
    let mut begin = None;
    for _ in 0..numbers.count()? {
        let first = chunk(numbers, true, begin, &mut levels)?;
        begin = begin.or(Some(first));
    }
    Ok(levels)
}

/// Reads one block of changes and returns its start.
fn chunk(
    numbers: &mut Numbers<'_>,
    has_rate: bool,
    begin: Option<f64>,
    levels: &mut Levels,
) -> Result<f64, ImportError> {
    let mut level = numbers.word()? != 0;
    if has_rate {
        numbers.seconds()?;
    }
    let (own, end, count) = (numbers.seconds()?, numbers.seconds()?, numbers.count()?);
    let begin = begin.unwrap_or(own);
    if levels.changes.is_empty() {
        levels.first = level;
    }
    levels.set(nanos(own, begin), level);
    for _ in 0..count {
        let at = numbers.seconds()?;
        level = !level;
        levels.set(nanos(at, begin), level);
    }
    levels.end = levels.end.max(nanos(end, begin));
    Ok(begin)
}

fn analog(numbers: &mut Numbers<'_>) -> Result<Levels, ImportError> {
    numbers.seconds()?;
    let (rate, downsample, count) = (numbers.count()?, numbers.count()?, numbers.count()?);
    let rate = (rate / downsample.max(1)).max(1);
    let mut samples = Vec::new();
    for index in 0..count {
        let volts = f64::from(numbers.next().map(f32::from_le_bytes)?);
        samples.push((levels::sample_nanos(index, rate), volts));
    }
    digital(&samples).ok_or_else(|| {
        ImportError::of_file("the voltage of this export hardly changes: expected a serial line")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};

    /// 0x41 at 1 Mbaud: start bit at 10 us, changes worked out by hand. The stop bit ends at 20 us.
    #[test]
    fn a_digital_export_is_read_in_both_versions() {
        let changes = [10.0, 11.0, 12.0, 17.0, 18.0, 19.0].map(|micros: f64| micros * 1e-6);
        let file = |version: u32| {
            let mut out = MAGIC.to_vec();
            out.extend(version.to_le_bytes());
            out.extend(0_u32.to_le_bytes());
            if version == 1 {
                out.extend(1_u64.to_le_bytes());
            }
            out.extend(1_u32.to_le_bytes());
            if version == 1 {
                out.extend(25e6_f64.to_le_bytes());
            }
            out.extend(0_f64.to_le_bytes());
            out.extend(1e-3_f64.to_le_bytes());
            out.extend(6_u64.to_le_bytes());
            changes.iter().for_each(|at| out.extend(at.to_le_bytes()));
            out
        };
        let options = Options {
            baud: Some(1_000_000),
            ..Options::default()
        };
        for version in [0, 1] {
            let file = file(version);
            assert_eq!(Format::detect(&file), Some(Format::SaleaeBinary));
            let found = read_format(&file, Format::SaleaeBinary, &options).expect("sound");
            let first = &found.records()[0];
            assert_eq!(
                (&first.bytes[..], first.at.as_nanos()),
                (&[0x41][..], 20_000)
            );
            let cut = read_format(&file[..60], Format::SaleaeBinary, &options);
            assert!(cut.expect_err("cut").to_string().contains("copy it again"));
        }
        let error = read_format(&file(7), Format::SaleaeBinary, &options).expect_err("version");
        assert!(error.to_string().contains("version 7"), "{error}");
    }

    /// Analog export: begin, rate, downsampling, count, and voltages. A rate of 200 kHz, of which
    /// every second sample was kept, has 10 us between two: a start bit, and the bits of 0xFF.
    #[test]
    fn voltages_of_a_channel_are_read() {
        let volts = |count: usize, volts: f32| vec![volts; count];
        let all = [volts(20, 3.3), volts(1, 0.0), volts(40, 3.3)].concat();
        let file = |kind: u32| {
            let mut file = MAGIC.to_vec();
            file.extend([0_u32, kind].iter().flat_map(|word| word.to_le_bytes()));
            file.extend(0.0_f64.to_le_bytes());
            let counts = [200_000_u64, 2, all.len() as u64];
            file.extend(counts.iter().flat_map(|count| count.to_le_bytes()));
            file.extend(all.iter().flat_map(|volts| volts.to_le_bytes()));
            file
        };
        let options = Options {
            baud: Some(100_000),
            ..Options::default()
        };
        let mut out = Imported::new();
        read(&file(1), &options, &mut out).expect("sound");
        let records = out.records().iter();
        let found: Vec<_> = records
            .map(|one| (one.at.as_micros(), one.bytes.to_vec()))
            .collect();
        // The start bit begins at 200 us; the byte ends ten bits later.
        assert_eq!(found, [(300, vec![0xFF])]);
        // The file has one channel without a name, so none is chosen.
        let named = Options {
            channels: vec!["RX".to_owned()],
            ..options.clone()
        };
        let mut out = Imported::new();
        read(&file(1), &named, &mut out).expect("sound");
        assert_eq!(out.records().len(), 1);
        let error = read(&file(2), &options, &mut Imported::new()).expect_err("unknown");
        assert!(
            error.message.contains("has version 0 and type 2"),
            "{error}"
        );
        assert_eq!((nanos(1.5, 1.0), nanos(1.0, 1.5)), (500_000_000, 0));
    }
}
