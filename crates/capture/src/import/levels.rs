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
}
