//! VCD waveforms: wires of one bit, read as UARTs.
//!
//! ```text
//! $timescale 1 us $end  $var wire 1 ! RX $end  $enddefinitions $end
//! #0 1!  #500 0!
//! ```

use super::Look;
use super::imported::{ImportError, Imported, Options};
use super::levels::{self, Channel};
use super::text::{Line, lines, number, utf8};
use super::uart::Levels;

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let mut head = lines(bytes).take(super::LINES_LOOKED_AT);
    let mut words = head
        .by_ref()
        .flat_map(|line| utf8(line.text).split_ascii_whitespace());
    words
        .any(|word| word == "$timescale" || word == "$var")
        .then_some(Look::Surely)
}

/// A wire that the header declares.
struct Wire {
    id: String,
    name: String,
    is_known: bool,
    levels: Levels,
}

/// Nanoseconds of a time unit, as a fraction.
#[derive(Clone, Copy)]
struct Scale {
    numerator: u128,
    denominator: u128,
}

impl Scale {
    fn nanos(self, time: u64) -> u64 {
        let nanos = u128::from(time) * self.numerator / self.denominator;
        u64::try_from(nanos).unwrap_or(u64::MAX)
    }
}

/// Parses `1us`, `10 ns`, `1 s`.
fn scale(words: &[&str]) -> Option<Scale> {
    let text: String = words.concat();
    let end = text.find(|c: char| !c.is_ascii_digit())?;
    let number: u128 = text[..end].parse().ok()?;
    let (numerator, denominator) = match &text[end..] {
        "s" => (1_000_000_000, 1),
        "ms" => (1_000_000, 1),
        "us" => (1_000, 1),
        "ns" => (1, 1),
        "ps" => (1, 1_000),
        "fs" => (1, 1_000_000),
        _ => return None,
    };
    (number > 0).then_some(Scale {
        numerator: numerator * number,
        denominator,
    })
}

/// The words up to `$end`.
fn declared<'a>(words: &mut impl Iterator<Item = (Line<'a>, &'a str)>) -> Vec<&'a str> {
    let own = words.map(|(_, word)| word);
    own.take_while(|word| *word != "$end").collect()
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let mut words = lines(bytes).flat_map(|line| {
        let words = utf8(line.text).split_ascii_whitespace();
        words.map(move |word| (line, word))
    });
    let (mut unit, mut wires, mut wide) = (None, Vec::<Wire>::new(), 0);
    while let Some((line, word)) = words.next() {
        match word {
            "$enddefinitions" => break,
            "$timescale" => {
                let own = scale(&declared(&mut words));
                unit = Some(own.ok_or_else(|| line.wrong("expected a $timescale as 1 ns"))?);
            }
            "$var" => match declared(&mut words)[..] {
                [_, "1", id, name, ..] => wires.push(Wire::new(id, name)),
                [_, _, _, _, ..] => wide += 1,
                _ => return Err(line.wrong("expected \"$var wire 1 ID NAME $end\"")),
            },
            "$comment" | "$date" | "$version" => drop(declared(&mut words)),
            _ => {}
        }
    }
    if wires.is_empty() {
        return Err(ImportError::of_file(format!(
            "expected wires of one bit in the VCD file, found none ({wide} of several bits)"
        )));
    }
    if wide > 0 {
        out.note(format!(
            "{wide} signals of several bits are skipped: only a single wire can be a UART"
        ));
    }
    let unit = unit.ok_or_else(|| ImportError::of_file("expected $timescale in the VCD file"))?;
    changes(words, unit, &mut wires)?;
    let channels = wires.into_iter().map(|wire| Channel {
        name: wire.name,
        levels: wire.levels,
    });
    levels::read(channels.collect(), options, out)
}

/// Reads the changes after the header.
fn changes<'a>(
    mut words: impl Iterator<Item = (Line<'a>, &'a str)>,
    unit: Scale,
    wires: &mut [Wire],
) -> Result<(), ImportError> {
    let (mut now, mut has_changed) = (0, false);
    while let Some((line, word)) = words.next() {
        let (first, rest) = word.split_at_checked(1).unwrap_or((word, ""));
        match first {
            "#" => {
                let time = number(rest).ok_or_else(|| line.wrong("expected #TIME"))?;
                let nanos = unit.nanos(time);
                if nanos < now {
                    return Err(line.wrong("the time goes back"));
                }
                (now, has_changed) = (nanos, false);
            }
            "0" | "1" | "x" | "X" | "z" | "Z" if !rest.is_empty() => {
                has_changed = true;
                for wire in wires.iter_mut().filter(|wire| wire.id == rest) {
                    wire.set(now, first);
                }
            }
            // The value of a multi-bit signal, and its name.
            "b" | "B" | "r" | "R" | "s" => drop(words.next()),
            "$" if word == "$comment" => drop(declared(&mut words)),
            "$" => {}
            _ => {
                return Err(line.wrong(format!(
                    "found \"{}\", expected a change",
                    word.escape_default()
                )));
            }
        }
    }
    for wire in wires {
        wire.levels.end = wire.levels.end.max(now);
        // A time without changes is the end of the recording.
        wire.levels.is_open = has_changed;
    }
    Ok(())
}

impl Wire {
    fn new(id: &str, name: &str) -> Self {
        Self {
            id: id.to_owned(),
            name: name.to_owned(),
            is_known: false,
            levels: Levels {
                first: true,
                ..Levels::default()
            },
        }
    }

    /// Sets a value; an undriven line is idle, an unknown value keeps the level.
    fn set(&mut self, now: u64, value: &str) {
        let level = match value {
            "0" => false,
            "1" | "z" | "Z" => true,
            _ => return,
        };
        if !self.is_known {
            self.is_known = true;
            if self.levels.changes.is_empty() {
                self.levels.first = level;
            }
        }
        self.levels.set(now, level);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    /// 0x41 at 1 Mbaud from 10 us on, levels worked out by hand: start bit 0, data 1 0 0 0 0 0 1 0,
    /// stop bit 1.
    const BYTE: &str = "#10 0!\n#11 1!\n#12 0!\n#17 1!\n#18 0!\n#19 1!\n#100\n";

    fn file(head: &str, changes: &str) -> String {
        format!(
            "$date today $end $version sigrok $end\n$comment $var wire 1 ? no $end\n\
             $timescale 1 us $end\n$scope module top $end\n{head}$upscope $end\n\
             $enddefinitions $end\n{changes}"
        )
    }

    fn told(text: &str) -> Result<Vec<(u64, Direction, Vec<u8>)>, String> {
        let options = Options {
            baud: Some(1_000_000),
            ..Options::default()
        };
        let found = read_format(text.as_bytes(), Format::Vcd, &options);
        let found = found.map_err(|error| error.to_string())?;
        let tuple =
            |one: &crate::Record| (one.at.as_nanos() / 1000, one.direction, one.bytes.to_vec());
        Ok(found.records().iter().map(tuple).collect())
    }

    #[test]
    fn a_wire_is_read_as_a_uart() {
        let text = file(
            "$var wire 1 ! RX $end $var wire 8 \" bus [7:0] $end\n",
            &format!("#0 1! b01010101 \"\n{BYTE}"),
        );
        assert_eq!(Format::detect(text.as_bytes()), Some(Format::Vcd));
        assert_eq!(told(&text), Ok(vec![(20, Direction::ToMaster, vec![0x41])]));
        let unknown = text.replace("#0 1!", "#0 x!");
        assert_eq!(told(&unknown).map(|told| told.len()), Ok(1));
        let high = text.replace("1 us", "1us").replace("#0 1!", "#0 z!");
        assert_eq!(told(&high).map(|told| told.len()), Ok(1));
    }

    #[test]
    fn what_is_no_waveform_is_an_error() {
        let wide = file("$var wire 8 ! bus $end\n", "#0 b1 !\n");
        assert!(
            told(&wide)
                .expect_err("wide")
                .contains("found none (1 of several bits)")
        );
        let back = file("$var wire 1 ! RX $end\n", "#5 1!\n#4 0!\n");
        assert!(
            told(&back)
                .expect_err("time")
                .contains("the time goes back")
        );
        let word = file("$var wire 1 ! RX $end\n", "#5 1!\nhello\n");
        assert!(told(&word).expect_err("word").contains("found \"hello\""));
        let still = file("$var wire 1 ! RX $end\n", "#5 1!\n");
        assert!(
            told(&still)
                .expect_err("still")
                .contains("no channel changes")
        );
    }
    /// An undriven line is idle; an unknown value keeps the level. The first value is that before
    /// the first change.
    #[test]
    fn values_of_a_wire_are_levels() {
        let after = |values: &[(u64, &str)]| {
            let mut wire = Wire::new("!", "RX");
            values.iter().for_each(|&(at, value)| wire.set(at, value));
            (wire.levels.first, wire.levels.changes)
        };
        assert_eq!(after(&[(0, "0"), (5, "1")]), (false, vec![5]));
        assert_eq!(
            after(&[(0, "x"), (5, "0"), (7, "x"), (9, "1")]),
            (false, vec![9])
        );
        assert_eq!(after(&[(0, "z"), (5, "0"), (9, "Z")]), (true, vec![5, 9]));
    }

    /// Signals of several bits are counted in a note; a change needs a wire, and a time a number.
    #[test]
    fn other_signals_are_noted_and_other_words_are_errors() {
        let of = |head: &str, changes: &str| {
            let text = format!("$timescale 1 us $end {head} $enddefinitions $end\n{changes}\n");
            let mut out = Imported::new();
            let options = Options {
                baud: Some(100_000),
                ..Options::default()
            };
            let found = read(text.as_bytes(), &options, &mut out);
            (found.map_err(|error| error.message), out.notes)
        };
        let wire = "$var wire 1 ! RX $end";
        let frame = "#0 1! #100 0! #110 1! #500";
        let (found, notes) = of(wire, frame);
        assert_eq!(found, Ok(()));
        let is_wide = |note: &String| note.contains("signals of several bits");
        assert!(!notes.iter().any(is_wide), "{notes:?}");
        let wide = format!("{wire} $var wire 8 # BUS $end");
        let (found, notes) = of(&wide, "#0 1! b0101 # #100 0! $comment 0! $end #110 1! #500");
        assert_eq!(found, Ok(()));
        assert!(
            notes.contains(
                &"1 signals of several bits are skipped: only a single wire can be a UART"
                    .to_owned()
            ),
            "{notes:?}"
        );
        for (head, changes, words) in [
            (
                "$var wire 8 # BUS $end",
                "",
                "found none (1 of several bits)",
            ),
            ("$var wire 1 ! $end", "", "expected \"$var"),
            (wire, "#x", "expected #TIME"),
            (wire, "#5 #4", "the time goes back"),
            (wire, "1", "found \"1\", expected a change"),
            (wire, "word", "found \"word\""),
        ] {
            let error = of(head, changes).0.expect_err(words);
            assert!(error.contains(words), "{error}");
        }
    }

    /// Numbers with the units of the format; 10 ps are a hundredth of a nanosecond.
    #[test]
    fn a_scale_has_a_number_and_a_unit() {
        let nanos =
            |text: &str| Some(scale(&text.split(' ').collect::<Vec<_>>())?.nanos(1_000_000));
        for (text, expected) in [
            ("1 s", Some(1_000_000_000_000_000)),
            ("10ms", Some(10_000_000_000_000)),
            ("1us", Some(1_000_000_000)),
            ("100 ns", Some(100_000_000)),
            ("10 ps", Some(10_000)),
            ("100 fs", Some(100)),
            ("0 ns", None),
            ("1 h", None),
            ("ns", None),
            ("1", None),
        ] {
            assert_eq!(nanos(text), expected, "{text}");
        }
        assert_eq!(
            scale(&["1", "s"]).expect("a scale").nanos(u64::MAX),
            u64::MAX
        );
    }
}
