//! Lines as levels over time: idle is 1, a start bit 0, eight bits, the lowest first, a stop bit.
//!
//! A character without its stop bit has no known bits and is not drawn. Bytes that the receiver got
//! faster than the line could carry them are drawn one after the other.

use core::fmt::Write as _;

use protocols::LineConfig;

use super::Export;
use crate::replay::Arrival;

/// A change of one line's level.
type Edge = (u64, usize, u8);

pub(super) fn write(export: &Export<'_>) -> (Vec<u8>, String) {
    let mut out = String::from("$version hilrig $end\n$timescale 1 ns $end\n");
    out.push_str("$scope module robot $end\n");
    let (mut edges, mut bytes) = (Vec::new(), 0);
    let ways = export.recorded.links.iter().flat_map(|passage| {
        let (name, line) = (&passage.link, passage.line());
        [
            (format!("{name}.to-master"), &passage.arrivals, line),
            (format!("{name}.to-device"), &passage.heard, line),
        ]
    });
    let mut wires = 0;
    for (wire, (name, arrivals, line)) in ways.enumerate() {
        let (id, name) = (id(wire), name.replace(char::is_whitespace, "_"));
        writeln!(out, "$var wire 1 {id} {name} $end").expect("a string takes everything");
        bytes += draw(wire, arrivals, line, &mut edges);
        wires += 1;
    }
    out.push_str("$upscope $end\n$enddefinitions $end\n#0\n$dumpvars\n");
    for wire in 0..wires {
        writeln!(out, "1{}", id(wire)).expect("a string takes everything");
    }
    out.push_str("$end\n");
    edges.sort_unstable();
    let mut last = 0;
    for (at, wire, level) in edges {
        if at != last {
            writeln!(out, "#{at}").expect("a string takes everything");
            last = at;
        }
        writeln!(out, "{level}{}", id(wire)).expect("a string takes everything");
    }
    // A viewer draws up to the last time: some idle line after the last stop bit.
    let end = export.recorded.end.as_nanos().max(last) + 1_000_000;
    writeln!(out, "#{end}").expect("a string takes everything");
    (out.into_bytes(), format!("{bytes} bytes on {wires} wires"))
}

/// Short identifiers of printable characters, as the format requires.
fn id(wire: usize) -> String {
    const FIRST: usize = 33;
    const COUNT: usize = 94;
    let mut rest = wire;
    let mut name = String::new();
    loop {
        let digit = u8::try_from(FIRST + rest % COUNT).expect("at most 126");
        name.push(char::from(digit));
        if rest < COUNT {
            return name;
        }
        rest = rest / COUNT - 1;
    }
}

fn draw(wire: usize, arrivals: &[Arrival], line: LineConfig, edges: &mut Vec<Edge>) -> usize {
    let nanos = |bytes: usize| {
        let took = line.bytes_time(bytes as u64).as_nanos();
        u64::try_from(took).unwrap_or(u64::MAX)
    };
    let byte_nanos = nanos(1);
    // Without an idle line before it, a start bit has no visible edge.
    let (mut free, mut count) = (byte_nanos, 0);
    for arrival in arrivals {
        for (index, &byte) in arrival.bytes.iter().enumerate() {
            let left = nanos(arrival.bytes.len() - index);
            let start = arrival.at.as_nanos().saturating_sub(left).max(free);
            free = start + byte_nanos;
            count += 1;
            let mut level = 1;
            let bits = (0..8).map(|bit| byte >> bit & 1);
            for (place, bit) in (0..).zip(core::iter::once(0).chain(bits).chain([1])) {
                if bit != level {
                    edges.push((start + byte_nanos * place / 10, wire, bit));
                    level = bit;
                }
            }
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::super::Laser;
    use super::*;
    use crate::Capture;
    use crate::divergence::Track;
    use crate::replay::{Passage, Recorded};

    /// 0x41 at 1,000,000 baud, complete at 20 us, begins at 10 us. The levels are 0 for the start
    /// bit, 1 0 0 0 0 0 1 0 for the data, and 1 for the stop bit. Edges lie at the changes; a bit
    /// takes 1 us.
    #[test]
    fn a_byte_is_drawn_bit_by_bit() {
        let arrival = Arrival {
            at: Instant::from_micros(20),
            bytes: vec![0x41],
        };
        let mut edges = Vec::new();
        assert_eq!(
            draw(0, &[arrival], LineConfig::new_8n1(1_000_000), &mut edges),
            1
        );
        let edges: Vec<(u64, u8)> = edges.iter().map(|&(at, _, level)| (at, level)).collect();
        let us = [(10, 0), (11, 1), (12, 0), (17, 1), (18, 0), (19, 1)];
        assert_eq!(edges, us.map(|(at, level)| (at * 1000, level)));
    }

    #[test]
    fn names_of_wires_differ() {
        let names: std::collections::BTreeSet<String> = (0..10_000).map(id).collect();
        assert_eq!(names.len(), 10_000);
        assert_eq!(
            (id(0), id(93), id(94)),
            ("!".into(), "~".into(), "!!".into())
        );
    }

    /// 0xFF at 1 Mbaud towards the program, complete at 20 us, and from the program at 25 us: a
    /// start bit is 1 us low. The file ends a millisecond after the capture.
    #[test]
    fn each_direction_of_a_link_is_a_wire() {
        let arrival = |micros| Arrival {
            at: Instant::from_micros(micros),
            bytes: vec![0xFF],
        };
        let passage = Passage {
            link: "a b".to_owned(),
            baud: 1_000_000,
            arrivals: vec![arrival(20)],
            heard: vec![arrival(25)],
            sent: Track::default(),
            opened: Vec::new(),
        };
        let recorded = Recorded {
            links: vec![passage],
            end: Instant::from_micros(100),
            zero: Instant::ZERO,
        };
        let export = Export {
            capture: &Capture::of(&[]),
            recorded: &recorded,
            belief: None,
            laser: Laser::default(),
        };
        let (file, said) = write(&export);
        assert_eq!(said, "2 bytes on 2 wires");
        let expected = [
            "$version hilrig $end",
            "$timescale 1 ns $end",
            "$scope module robot $end",
            "$var wire 1 ! a_b.to-master $end",
            "$var wire 1 \" a_b.to-device $end",
            "$upscope $end",
            "$enddefinitions $end",
            "#0",
            "$dumpvars",
            "1!",
            "1\"",
            "$end",
            "#10000",
            "0!",
            "#11000",
            "1!",
            "#15000",
            "0\"",
            "#16000",
            "1\"",
            "#1100000",
            "",
        ];
        assert_eq!(String::from_utf8_lossy(&file), expected.join("\n"));
    }
}
