//! Channels of a logic analyzer as links: each channel is decoded as a UART.

use protocols::{LineConfig, Parity};

use super::imported::{ImportError, Imported, Options};
use super::rate::{derived, is_usual};
use super::roles::roles;
use super::uart::{Levels, Read, characters, doubt};
use crate::Kind;

/// One channel of a recording.
#[derive(Clone, Debug)]
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) levels: Levels,
}

/// Decodes all channels that change, or those that the options name.
pub(super) fn read(
    channels: Vec<Channel>,
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    out.clock = "virtual";
    let channels = chosen(channels, options)?;
    let names: Vec<String> = channels
        .iter()
        .map(|channel| channel.name.clone())
        .collect();
    let roles = roles(&names, options, out);
    for (Channel { name, levels }, role) in channels.into_iter().zip(roles) {
        let levels = upright(levels, &name, out);
        let (line, levels) = line(levels, &name, options, out)?;
        let read = characters(&levels, line);
        if let Some(doubt) = doubt(&levels, line, &read) {
            let baud = line.baud;
            return Err(ImportError::of_file(format!(
                "channel \"{name}\" is no UART at {baud} baud: {doubt}; --baud N sets the rate, \
                 --channel NAME chooses the channels"
            )));
        }
        if read.last().is_some_and(|&(at, _)| at > levels.end) && levels.is_open {
            out.note(
                "the file ends with its last change: the line is taken as idle behind it, and the \
                 last character as complete",
            );
        }
        let link = out.link_at(&role.link, line.baud);
        for (at, read) in read {
            let (kind, byte) = match read {
                Read::Byte(byte) => (Kind::Data, Some(byte)),
                Read::Event(event) => (Kind::Line(event), None),
            };
            out.push(link, at, role.direction, kind, byte.as_slice());
        }
    }
    out.sort();
    Ok(())
}

fn chosen(channels: Vec<Channel>, options: &Options) -> Result<Vec<Channel>, ImportError> {
    let names: Vec<String> = channels
        .iter()
        .map(|channel| channel.name.clone())
        .collect();
    let all = names.join(", ");
    let missing = options.channels.iter().find(|name| !names.contains(name));
    if let Some(missing) = missing {
        return Err(ImportError::of_file(format!(
            "--channel {missing}: there is no such channel, expected one of: {all}"
        )));
    }
    let is_chosen = |channel: &Channel| match options.channels.is_empty() {
        true => channel.levels.changes.len() > 1,
        false => options.channels.contains(&channel.name),
    };
    let chosen: Vec<Channel> = channels.into_iter().filter(is_chosen).collect();
    match chosen.is_empty() {
        true => Err(ImportError::of_file(format!(
            "no channel changes its level: {all}; expected a serial line on one of them"
        ))),
        false => Ok(chosen),
    }
}

/// Returns the levels with idle high. A line whose longest low exceeds its longest high is
/// inverted, as RS-232 levels are.
fn upright(levels: Levels, name: &str, out: &mut Imported) -> Levels {
    let mut longest = [0_u64; 2];
    let (mut level, mut since) = (levels.first, 0);
    for &change in levels.changes.iter().chain([&levels.end]) {
        let lasted = change.saturating_sub(since);
        let own = &mut longest[usize::from(level)];
        *own = lasted.max(*own);
        (level, since) = (!level, change);
    }
    // Idle is longer than any character; twelve bits of the other level are a break.
    if longest[0] <= longest[1].saturating_mul(2) {
        return levels;
    }
    out.note(format!(
        "channel \"{name}\" is low when idle: it is read inverted, as RS-232 levels are"
    ));
    levels.inverted()
}

/// Derives the line, and its levels with idle high. A line that fits no rate may still be inverted.
fn line(
    mut levels: Levels,
    name: &str,
    options: &Options,
    out: &mut Imported,
) -> Result<(LineConfig, Levels), ImportError> {
    let of = |levels: &Levels| derived(levels, options.baud, options.coding);
    let mut found = of(&levels);
    if found.is_none() {
        let inverted = levels.clone().inverted();
        found = of(&inverted);
        if found.is_some() {
            out.note(format!(
                "channel \"{name}\" is read inverted: only then its pulses fit a rate"
            ));
            levels = inverted;
        }
    }
    let given = || {
        let coding = options.coding.unwrap_or(LineConfig::new_8n1(1));
        options.baud.map(|baud| LineConfig { baud, ..coding })
    };
    let line = found.or_else(given).ok_or_else(|| {
        ImportError::of_file(format!(
            "the pulses of channel \"{name}\" fit no rate: expected a UART line; --baud N sets \
             the rate, --coding the bits of a character, --channel NAME chooses the channels"
        ))
    })?;
    say(line, name, options, out);
    Ok((line, levels))
}

/// Notes the derived rate and coding.
fn say(line: LineConfig, name: &str, options: &Options, out: &mut Imported) {
    let baud = line.baud;
    if options.baud.is_none() {
        let usual = match is_usual(baud) {
            true => "",
            false => ", which is no usual rate; --baud N sets another",
        };
        out.note(format!(
            "channel \"{name}\": {baud} baud, by the length of its pulses{usual}"
        ));
    }
    let is_plain = (line.data_bits, line.parity) == (8, Parity::None);
    if options.coding.is_none() && !is_plain {
        let parity = match line.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        let (bits, stop) = (line.data_bits, line.stop_bits);
        out.note(format!(
            "channel \"{name}\": {bits}{parity}{stop}, by its characters; --coding sets another"
        ));
    }
}

/// Parses samples per second as tools write them: `1 MHz`, `24MHz`, `115200`, `200 kHz`.
pub(super) fn sample_rate(text: &str) -> Option<u64> {
    let text = text.trim();
    let end = text
        .find(|c: char| !(c.is_ascii_digit() || c == '.'))
        .unwrap_or(text.len());
    let (number, unit) = text.split_at(end);
    let factor: u64 = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "hz" => 1,
        "khz" => 1_000,
        "mhz" => 1_000_000,
        "ghz" => 1_000_000_000,
        _ => return None,
    };
    let (whole, fraction) = number.split_once('.').unwrap_or((number, ""));
    let digits: String = fraction
        .chars()
        .chain("000000000".chars())
        .take(9)
        .collect();
    let parts: u64 = digits.parse().ok()?;
    let whole: u64 = whole.parse().ok()?;
    let rate = whole
        .checked_mul(factor)?
        .checked_add(parts.checked_mul(factor)? / 1_000_000_000)?;
    (rate > 0).then_some(rate)
}

/// The time of a sample.
pub(super) fn sample_nanos(sample: u64, rate: u64) -> u64 {
    let nanos = u128::from(sample) * 1_000_000_000 / u128::from(rate.max(1));
    u64::try_from(nanos).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_rate_has_a_unit_or_none() {
        let rates = ["1 MHz", "24MHz", "115200", "200 kHz", "0.5 GHz", "12.5 MHz"];
        let expected = [
            1_000_000,
            24_000_000,
            115_200,
            200_000,
            500_000_000,
            12_500_000,
        ];
        assert_eq!(rates.map(sample_rate), expected.map(Some));
        assert_eq!(
            ["", "fast", "0", "1 parsec", "1e6"].map(sample_rate),
            [None; 5]
        );
        assert_eq!(sample_nanos(24, 24_000_000), 1_000);
    }

    fn levels(first: bool, changes: &[u64], end: u64) -> Levels {
        Levels {
            first,
            changes: changes.to_vec(),
            end,
            is_open: false,
        }
    }

    /// The longest low is at most twice as long as the longest high: in characters of a UART the
    /// idle line is the longest level.
    #[test]
    fn a_line_that_is_low_for_long_is_read_upside_down() {
        for (own, is_inverted) in [
            (levels(true, &[100, 300], 400), false),
            (levels(true, &[100, 301], 401), true),
            (levels(true, &[101, 303], 350), false),
            (levels(false, &[201], 301), true),
            (levels(false, &[200], 300), false),
            (levels(true, &[10, 20, 60], 400), true),
            (levels(true, &[], 400), false),
            (levels(false, &[], 400), true),
        ] {
            let mut out = Imported::new();
            let found = upright(own.clone(), "D0", &mut out);
            let note = "channel \"D0\" is low when idle: it is read inverted, as RS-232 levels \
                        are";
            let (expected, notes) = match is_inverted {
                true => (own.clone().inverted(), vec![note.to_owned()]),
                false => (own.clone(), Vec::new()),
            };
            assert_eq!((found, out.notes), (expected, notes), "{own:?}");
        }
    }

    /// Without names, each channel that changes twice or more is chosen.
    #[test]
    fn channels_are_chosen_by_name_or_by_their_changes() {
        let channels = || {
            let all = [("still", vec![]), ("once", vec![5]), ("busy", vec![5, 9])];
            let channel = |(name, changes): (&str, Vec<u64>)| Channel {
                name: name.to_owned(),
                levels: levels(true, &changes, 20),
            };
            all.into_iter().map(channel).collect::<Vec<_>>()
        };
        let chosen = |names: &[&str]| {
            let options = Options {
                channels: names.iter().map(|name| (*name).to_owned()).collect(),
                ..Options::default()
            };
            let found = chosen(channels(), &options).map_err(|error| error.to_string());
            found.map(|all| all.into_iter().map(|one| one.name).collect::<Vec<_>>())
        };
        assert_eq!(chosen(&[]), Ok(vec!["busy".to_owned()]));
        assert_eq!(chosen(&["once"]), Ok(vec!["once".to_owned()]));
        assert_eq!(
            chosen(&["busy", "D7"]),
            Err(
                "--channel D7: there is no such channel, expected one of: still, once, busy"
                    .to_owned()
            )
        );
        let none = super::chosen(channels()[..2].to_vec(), &Options::default());
        assert_eq!(
            none.expect_err("still").to_string(),
            "no channel changes its level: still, once; expected a serial line on one of them"
        );
    }

    /// The rate and the coding are noted if they were derived; eight bits without parity need no
    /// note.
    #[test]
    fn a_derived_line_is_noted() {
        let notes = |line: LineConfig, baud, coding| {
            let options = Options {
                baud,
                coding,
                ..Options::default()
            };
            let mut out = Imported::new();
            say(line, "D0", &options, &mut out);
            out.notes
        };
        let plain = LineConfig::new_8n1(9_600);
        let rate = "channel \"D0\": 9600 baud, by the length of its pulses";
        assert_eq!(notes(plain, None, None), [rate]);
        assert!(notes(plain, Some(9_600), None).is_empty());
        let unusual = "channel \"D0\": 10400 baud, by the length of its pulses, which is no usual \
                       rate; --baud N sets another";
        assert_eq!(notes(LineConfig::new_8n1(10_400), None, None), [unusual]);
        for (data_bits, parity, words) in [
            (8, Parity::Even, "8E1"),
            (8, Parity::Odd, "8O1"),
            (7, Parity::None, "7N1"),
        ] {
            let line = LineConfig {
                data_bits,
                parity,
                ..plain
            };
            let note = format!("channel \"D0\": {words}, by its characters; --coding sets another");
            assert_eq!(notes(line, Some(9_600), None), [note]);
            assert!(notes(line, Some(9_600), Some(line)).is_empty());
        }
    }

    /// Three characters of 0x35 at 100,000 baud, upright and upside down; a line without any
    /// character has the rate that is given.
    #[test]
    fn a_line_that_fits_no_rate_may_be_inverted() {
        let tenths = [0, 10, 20, 30, 40, 50, 70, 90];
        let changes: Vec<u64> = (1..=3)
            .flat_map(|start: u64| tenths.map(|tenth| start * 1_000_000 + tenth * 1_000))
            .collect();
        let of = |levels: Levels, baud| {
            let options = Options {
                baud,
                ..Options::default()
            };
            let mut out = Imported::new();
            let found = line(levels, "D0", &options, &mut out);
            found.map(|(line, levels)| (line.baud, levels.first, out.notes.len()))
        };
        let own = levels(true, &changes, 5_000_000);
        assert_eq!(of(own.clone(), None), Ok((100_000, true, 1)));
        assert_eq!(of(own.clone().inverted(), None), Ok((100_000, true, 2)));
        assert_eq!(of(own.clone(), Some(100_000)), Ok((100_000, true, 0)));
        assert_eq!(of(own, Some(300)), Ok((300, true, 0)));
        let error = of(levels(true, &[5, 9], 20), None).expect_err("no rate");
        assert!(error.message.contains("fit no rate"), "{error}");
    }

    /// 0x35 at 100,000 baud ends with its last change 90 us behind the start; a file of changes
    /// that ends there is noted.
    #[test]
    fn a_file_that_ends_with_a_change_is_noted() {
        let changes = [0, 10, 20, 30, 40, 50, 70, 90].map(|tenth| 100_000 + tenth * 1_000);
        let of = |end: u64, is_open| {
            let levels = Levels {
                is_open,
                ..levels(true, &changes, end)
            };
            let channel = Channel {
                name: "D0".to_owned(),
                levels,
            };
            let options = Options {
                baud: Some(100_000),
                ..Options::default()
            };
            let mut out = Imported::new();
            read(vec![channel], &options, &mut out).expect("sound");
            let is_noted = out.notes.iter().any(|note| note.contains("idle behind it"));
            (out.records().len(), is_noted)
        };
        assert_eq!(of(190_000, true), (1, true));
        assert_eq!(of(900_000, true), (1, false));
        assert_eq!(of(900_000, false), (1, false));
        assert_eq!(of(195_000, false), (1, false));
    }
}
