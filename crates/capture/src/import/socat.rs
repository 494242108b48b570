//! socat's dump of both directions.
//!
//! ```text
//! > 2026/11/21 07:58:48.000761120  length=11 from=0 to=10
//!  fa a0 0a                                         ...
//!  41 42                                            AB
//! --
//! ```
//!
//! With `-v`, hex fills a field of 16 times 3 columns, text follows it, a line ends early after
//! 0x0A, and "--" ends the block. Without `-v`, all bytes of a block are on one line without text.
//! The fraction of version 1.7 is microseconds, padded to nine digits: .000761120 is 0.761120 s
//! (found by known gaps). A file with a larger fraction has nanoseconds.

use super::LOCAL;
use super::imported::{ImportError, Imported, Options};
use super::text::{Line, lines, moment, number, utf8};
use crate::Kind;
use engine::hex;

struct Head {
    is_left_to_right: bool,
    seconds: u64,
    fraction: u64,
    length: usize,
}

/// Whether a line begins a block.
pub(super) fn is_head(text: &[u8]) -> bool {
    head(text).is_some()
}

fn head(text: &[u8]) -> Option<Head> {
    let mut words = utf8(text).split_ascii_whitespace();
    let is_left_to_right = match words.next()? {
        ">" => true,
        "<" => false,
        _ => return None,
    };
    let (date, time) = (words.next()?, words.next()?);
    let (time, fraction) = time.split_once('.')?;
    let length = number(words.next()?.strip_prefix("length=")?)?;
    Some(Head {
        is_left_to_right,
        seconds: moment(date, time, '/')?,
        fraction: number(fraction).filter(|&fraction| fraction < 1_000_000_000)?,
        length: usize::try_from(length).ok()?,
    })
}

struct Block {
    head: Head,
    bytes: Vec<u8>,
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let heads = lines(bytes).filter_map(|line| head(line.text));
    let has_nanoseconds = heads.map(|head| head.fraction).max() >= Some(1_000_000);
    let unit = if has_nanoseconds { 1 } else { 1_000 };
    let link = out.link(&options.link, options);
    out.note(LOCAL);
    let has_text = lines(bytes).any(|line| line.text == b"--");
    let mut block: Option<Block> = None;
    let mut last = None;
    for line in lines(bytes) {
        last = Some(line);
        match &mut block {
            Some(open) if open.bytes.len() < open.head.length => {
                let most = open.head.length - open.bytes.len();
                open.bytes.extend(dumped(line, most, has_text)?);
                if !has_text && open.bytes.len() == open.head.length {
                    flush(link, unit, block.take(), options, out);
                }
            }
            Some(_) if line.text == b"--" => flush(link, unit, block.take(), options, out),
            Some(_) => return Err(line.wrong("expected \"--\" behind the block")),
            // socat's own diagnostics may occur between blocks.
            None => {
                if let Some(head) = head(line.text) {
                    let bytes = Vec::new();
                    out.line = line.number;
                    block = Some(Block { head, bytes });
                } else if [b"> ", b"< "]
                    .iter()
                    .any(|mark| line.text.starts_with(*mark))
                {
                    return Err(line.wrong(
                        "expected \"> YYYY/MM/DD hh:mm:ss.fraction length=N from=N to=N\"",
                    ));
                }
            }
        }
    }
    match (block, last) {
        (Some(Block { head, bytes }), Some(line)) => {
            let (found, length) = (bytes.len(), head.length);
            Err(line.wrong(format!(
                "the last block ends after {found} of {length} bytes"
            )))
        }
        _ => Ok(()),
    }
}

fn flush(link: usize, unit: u64, block: Option<Block>, options: &Options, out: &mut Imported) {
    if let Some(Block { head, bytes }) = block {
        let direction = options.way(head.is_left_to_right);
        let nanos = head.seconds * 1_000_000_000 + head.fraction * unit;
        out.push(link, nanos, direction, Kind::Data, &bytes);
    }
}

/// The bytes of one line, at most `most`.
fn dumped(line: Line<'_>, most: usize, has_text: bool) -> Result<Vec<u8>, ImportError> {
    // Text after the hex exists only with -v.
    let width = if has_text { 48 } else { line.text.len() };
    let field = &line.text[..line.text.len().min(width)];
    let cells = field.chunks(3);
    let cells = cells.take_while(|cell| cell.iter().any(|&byte| byte != b' '));
    let byte = |cell: &[u8]| cell.strip_prefix(b" ").and_then(hex::byte);
    let bytes: Option<Vec<u8>> = cells.map(byte).collect();
    let bytes = bytes.filter(|bytes| !bytes.is_empty() && bytes.len() <= most);
    bytes.ok_or_else(|| {
        line.wrong(format!(
            "expected 1 to {most} bytes of two hex digits behind spaces, as socat -x writes \
             (socat -v alone does not show all bytes)"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_head_of_a_block_has_all_its_parts() {
        let is = |text: &str| is_head(text.as_bytes());
        let head = "> 2026/11/21 07:58:48.000761120  length=3 from=0 to=2";
        assert!(is(head) && is(&head.replace('>', "<")));
        for (part, wrong) in [
            (">", "="),
            ("2026/11/21", "2026-11-21"),
            (".000761120", ""),
            (".000761120", ".1000000000"),
            ("length=3", "length=x"),
            ("length=3", "len=3"),
        ] {
            assert!(!is(&head.replace(part, wrong)), "{wrong}");
        }
        let found = super::head(head.as_bytes()).expect("it is one");
        let nanos = (found.seconds, found.fraction, found.length);
        assert_eq!(nanos, (1_795_247_928, 761_120, 3));
        assert!(found.is_left_to_right && is(&head.replace("000761120", "999999999")));
    }

    #[test]
    fn a_line_has_bytes_behind_spaces() {
        let of = |text: &str, most, has_text| {
            let line = lines(text.as_bytes()).next().expect("a line");
            dumped(line, most, has_text).ok()
        };
        assert_eq!(of(" 0a 41", 2, false), Some(vec![10, 0x41]));
        assert_eq!(of(" 0a 41", 1, false), None);
        assert_eq!(
            of(" 0a                                             .", 1, true),
            Some(vec![10])
        );
        assert_eq!(
            (
                of("0a 41", 2, false),
                of(" zz", 2, false),
                of("   ", 2, false)
            ),
            (None, None, None)
        );
    }

    /// Without text a block ends with its last byte; it has to be whole.
    #[test]
    fn blocks_without_text_end_with_their_bytes() {
        let imported = |text: &str| {
            let mut out = Imported::new();
            read(text.as_bytes(), &Options::default(), &mut out).map_err(|error| error.message)?;
            let records = out.records().iter();
            Ok::<_, String>(records.map(|one| one.bytes.to_vec()).collect::<Vec<_>>())
        };
        let head =
            |length: usize| format!("> 2026/11/21 07:58:48.000001  length={length} from=0 to=1\n");
        let two = format!("{} 41 42\n 43\n{} 44\n", head(3), head(1));
        assert_eq!(imported(&two), Ok(vec![b"ABC".to_vec(), b"D".to_vec()]));
        let cut = imported(&format!("{} 41\n", head(3))).expect_err("cut");
        assert!(cut.ends_with("after 1 of 3 bytes"), "{cut}");
        assert!(imported("> nonsense\n").is_err() && imported("a word\n").is_ok());
        let open = format!("{} 41\nwords\n--\n", head(1));
        assert!(
            imported(&open)
                .expect_err("no end")
                .starts_with("expected \"--\"")
        );
    }
}
