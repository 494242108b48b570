//! Bytes with their times as lines of text that a person can read, cut and change.

use core::fmt::Write as _;

use protocols::{Instant, LineConfig};

use crate::replay::Arrival;
use engine::hex;

/// Maximum number of chunks in a line.
const CHUNKS_MAX: usize = 16;
/// Maximum length of a chunk that shares its line with others.
const CHUNK_MAX: usize = 64;

/// Writes `arrivals`, in order of time, as lines.
pub(super) fn write(arrivals: &[Arrival], line: LineConfig) -> String {
    let mut out = String::new();
    let mut rest = arrivals;
    while let Some(first) = rest.first() {
        let mut count = 1;
        while let Some([before, next]) = rest.get(count - 1..=count)
            && count < CHUNKS_MAX
            && !before.bytes.is_empty()
            && !next.bytes.is_empty()
            && next.bytes.len() <= CHUNK_MAX
            && next.at - before.at == line.bytes_time(next.bytes.len() as u64)
        {
            count += 1;
        }
        let (together, behind) = rest.split_at(count);
        let at = together.last().map_or(first.at, |last| last.at);
        write!(out, "{}", at.as_nanos()).expect("a string takes everything");
        for arrival in together {
            out.push(' ');
            if arrival.bytes.is_empty() {
                out.push('!');
            }
            hex::push_digits(&mut out, &arrival.bytes);
        }
        out.push('\n');
        rest = behind;
    }
    out
}

/// Reads lines from [`write`] or from a person.
pub(super) fn read(text: &str, line: LineConfig) -> Result<Vec<Arrival>, String> {
    let mut arrivals: Vec<Arrival> = Vec::new();
    for (number, row) in (1..).zip(text.lines()) {
        let wrong = |what: &str| format!("line {number}: {what}");
        let mut words = row.split_ascii_whitespace();
        let Some(time) = words.next() else { continue };
        let nanos: u64 = time
            .parse()
            .map_err(|_| wrong("expected nanoseconds and hex, e.g. \"1070000 AB240A\""))?;
        let mut together = Vec::new();
        for word in words {
            let bytes = if word == "!" {
                Some(Vec::new())
            } else {
                hex::bytes(word)
            };
            let expected = "expected bytes of two hex digits, e.g. AB240A, or !";
            together.push(bytes.ok_or_else(|| wrong(expected))?);
        }
        if together.is_empty() {
            return Err(wrong("expected bytes behind the time"));
        }
        let mut at = Instant::from_nanos(nanos);
        let mut timed = Vec::new();
        for bytes in together.into_iter().rev() {
            let before = line.byte_end(at, bytes.len() as u64);
            timed.push(Arrival { at, bytes });
            at = before;
        }
        let last = arrivals.last().map(|arrival| arrival.at);
        if timed.last().map(|arrival| arrival.at) < last {
            return Err(wrong("begins before the line above ends"));
        }
        arrivals.extend(timed.into_iter().rev());
    }
    Ok(arrivals)
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUS: LineConfig = LineConfig::new_8n1(1_000_000);

    fn arrival(micros: u64, bytes: &[u8]) -> Arrival {
        Arrival {
            at: Instant::from_micros(micros),
            bytes: bytes.to_vec(),
        }
    }

    /// At 1 Mbaud a byte takes 10 us: three bytes and the two that follow are back to back.
    #[test]
    fn chunks_back_to_back_share_a_line() {
        let arrivals = [
            arrival(10, &[0xAB]),
            arrival(20, &[0x24]),
            arrival(40, &[0x0A, 0xFF]),
            arrival(41, &[]),
            arrival(61, &[1]),
        ];
        let text = write(&arrivals, BUS);
        assert_eq!(text, "40000 AB 24 0AFF\n41000 !\n61000 01\n");
        assert_eq!(read(&text, BUS).as_deref(), Ok(&arrivals[..]));
    }

    #[test]
    fn a_line_that_makes_no_sense_is_named() {
        let error = |text| read(text, BUS).expect_err("senseless");
        assert_eq!(
            error("10 AB\nsoon AB"),
            "line 2: expected nanoseconds and hex, e.g. \"1070000 AB240A\""
        );
        assert_eq!(
            error("10 ABC"),
            "line 1: expected bytes of two hex digits, e.g. AB240A, or !"
        );
        assert_eq!(error("10"), "line 1: expected bytes behind the time");
        assert_eq!(
            error("90000 AB\n95000 CD EF"),
            "line 2: begins before the line above ends"
        );
    }

    /// Number of chunks in each line, for back-to-back chunks of these lengths at 10 us a byte.
    fn chunks_of_each_line(lengths: &[usize]) -> Vec<usize> {
        let mut end = 0;
        let chunk = |len: &usize| {
            end += 10 * *len as u64;
            arrival(end, &vec![7; *len])
        };
        let arrivals: Vec<Arrival> = lengths.iter().map(chunk).collect();
        let text = write(&arrivals, BUS);
        let counts = text.lines().map(|line| line.split(' ').count() - 1);
        counts.collect()
    }

    /// At most 16 chunks share a line, and only chunks of 64 bytes or less join the one before.
    #[test]
    fn a_line_has_few_and_short_chunks() {
        assert_eq!(chunks_of_each_line(&[1; 16]), [16]);
        assert_eq!(chunks_of_each_line(&[1; 17]), [16, 1]);
        assert_eq!(chunks_of_each_line(&[1; 33]), [16, 16, 1]);
        assert_eq!(chunks_of_each_line(&[1, 64, 1]), [3]);
        assert_eq!(chunks_of_each_line(&[1, 65, 1]), [1, 2]);
        assert_eq!(chunks_of_each_line(&[]), [0; 0]);
    }

    /// An arrival without bytes has a line of its own, whatever its time.
    #[test]
    fn an_empty_arrival_shares_no_line() {
        let arrivals = [arrival(40, &[1]), arrival(40, &[]), arrival(50, &[2])];
        let text = write(&arrivals, BUS);
        assert_eq!(text, "40000 01\n40000 !\n50000 02\n");
        assert_eq!(read(&text, BUS).as_deref(), Ok(&arrivals[..]));
    }

    /// Two lines may have the same time. Blank lines are skipped, but they count.
    #[test]
    fn lines_may_have_the_same_time() {
        let both = [arrival(90, &[0xAB]), arrival(90, &[0xCD])];
        assert_eq!(
            read("90000 AB\n\n90000 CD\n", BUS).as_deref(),
            Ok(&both[..])
        );
        let late = read("90000 AB\n\n89999 CD\n", BUS);
        assert_eq!(
            late,
            Err("line 3: begins before the line above ends".to_owned())
        );
        // Of two chunks in a line, the first one is complete 20 us before the second one.
        let two = [arrival(70, &[1]), arrival(90, &[2, 3])];
        assert_eq!(read("90000 01 0203", BUS).as_deref(), Ok(&two[..]));
    }
}
