//! jpnevulator's dump of the bytes that it read.
//!
//! ```text
//! 2026-11-21 07:58:50.596918: A
//! 00000000<tab>FA A0 0A 41<tab>...A
//! ```
//!
//! An alias of the port follows the colon, if one was given. The counter and the text are options
//! of the tool. The last line has no line end.

use super::LOCAL;
use super::imported::{ImportError, Imported, Options};
use super::text::{Line, decimal_nanos, lines, moment, utf8};
use crate::Kind;
use engine::hex;

/// Whether a line begins a block.
pub(super) fn is_head(text: &[u8]) -> bool {
    head(text).is_some()
}

/// Time in nanoseconds since 1970, and the alias.
fn head(text: &[u8]) -> Option<(u64, &str)> {
    let text = utf8(text);
    let (date, rest) = text.split_once(' ')?;
    let (time, fraction) = rest.split_once('.')?;
    let (fraction, alias) = fraction.split_once(':')?;
    if fraction.len() != 6 {
        return None;
    }
    let fraction = decimal_nanos(&format!("0.{fraction}"))?;
    let nanos = moment(date, time, '-')?.checked_mul(1_000_000_000)?;
    Some((nanos + fraction, alias.trim()))
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    out.note(LOCAL);
    let mut block: Option<(u64, usize, Vec<u8>)> = None;
    for line in lines(bytes).filter(|line| !line.text.trim_ascii().is_empty()) {
        if let Some((nanos, alias)) = head(line.text) {
            end(block.take(), options, out);
            let name = if alias.is_empty() {
                &options.link
            } else {
                alias
            };
            let link = out.link(name, options);
            out.line = line.number;
            block = Some((nanos, link, Vec::new()));
            continue;
        }
        let Some((_, _, bytes)) = &mut block else {
            let expected = "expected \"YYYY-MM-DD hh:mm:ss.uuuuuu: \", as --timing-print writes";
            return Err(line.wrong(expected));
        };
        bytes.extend(dumped(line)?);
    }
    end(block, options, out);
    Ok(())
}

fn end(block: Option<(u64, usize, Vec<u8>)>, options: &Options, out: &mut Imported) {
    if let Some((nanos, link, bytes)) = block
        && !bytes.is_empty()
    {
        out.push(link, nanos, options.direction, Kind::Data, &bytes);
    }
}

fn dumped(line: Line<'_>) -> Result<Vec<u8>, ImportError> {
    let mut columns = line.text.split(|&byte| byte == b'\t').peekable();
    let is_counter = |column: &&[u8]| column.len() == 8 && !column.contains(&b' ');
    columns.next_if(is_counter);
    let field = columns.next().unwrap_or_default().trim_ascii_end();
    let bytes: Option<Vec<u8>> = field.split(|&byte| byte == b' ').map(hex::byte).collect();
    bytes
        .filter(|bytes| bytes.len() <= 16)
        .ok_or_else(|| line.wrong("expected up to 16 bytes of two hex digits with a space between"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(text: &[u8]) -> Option<Vec<u8>> {
        let line = lines(text).next().expect("one line");
        dumped(line).ok()
    }

    /// A counter of eight characters may precede the bytes, and their text follow them.
    #[test]
    fn a_row_has_up_to_sixteen_bytes() {
        assert_eq!(bytes(b"FA A0"), Some(vec![0xFA, 0xA0]));
        assert_eq!(bytes(b"00000000\tFA A0\t.."), Some(vec![0xFA, 0xA0]));
        assert_eq!(bytes(b"FA A0   \t.."), Some(vec![0xFA, 0xA0]));
        let row = |count: usize| vec!["FA"; count].join(" ");
        assert_eq!(bytes(row(16).as_bytes()).map(|bytes| bytes.len()), Some(16));
        assert_eq!(bytes(row(17).as_bytes()), None);
        for text in [&b"0000000\tFA"[..], b"FA A", b"FA  A0", b"00000000"] {
            assert_eq!(bytes(text), None, "{text:?}");
        }
        // Three bytes have eight characters, too, and blanks.
        assert_eq!(bytes(b"FA A0 0A\tx"), Some(vec![0xFA, 0xA0, 0x0A]));
    }

    /// 2026-11-21 07:58:50 is 1,795,247,930 s after 1970, by `date -u`.
    #[test]
    fn a_head_has_six_digits_of_a_second() {
        const AT: u64 = 1_795_247_930_000_000_000;
        assert_eq!(
            head(b"2026-11-21 07:58:50.596918: A"),
            Some((AT + 596_918_000, "A"))
        );
        assert_eq!(head(b"2026-11-21 07:58:50.000001:"), Some((AT + 1_000, "")));
        for text in [
            "2026-11-21 07:58:50.59691: A",
            "2026-11-21 07:58:50.5969180: A",
            "2026-11-21 07:58:50: A",
            "2026-11-21 07:58:50.596918",
        ] {
            assert!(!is_head(text.as_bytes()), "{text}");
        }
    }
}
