//! A check that the lengths in a record are within it. The parser allocates memory for a text
//! before it reads the text: a damaged length would request 4 GiB.

/// The layout of a record up to its last text, by opcode, from the specification of the format. A
/// digit skips this number of bytes, `s` is a text, `t` a table of texts, `n` a list of numbers.
/// Texts, tables and lists begin with their length in bytes, as four bytes.
const fn layout(opcode: u8) -> &'static [u8] {
    match opcode {
        // Header: profile, library.
        0x01 => b"ss",
        // Schema: id, name, encoding, data.
        0x03 => b"2sss",
        // Channel: id, schema, topic, encoding, metadata.
        0x04 => b"4sst",
        // Chunk index: two times, offset, length, offsets by channel, length, compression.
        0x08 => b"8888n8s",
        // Attachment: two times, name, media type.
        0x09 => b"88ss",
        // Attachment index: offset, length, two times, size, name, media type.
        0x0A => b"88888ss",
        // Metadata: name, table.
        0x0C => b"st",
        // Metadata index: offset, length, name.
        0x0D => b"88s",
        _ => b"",
    }
}

/// Whether all lengths in `body`, a record with this opcode, are within it.
pub(super) fn fit(opcode: u8, body: &[u8]) -> bool {
    let mut rest = body;
    layout(opcode).iter().all(|part| match part {
        b's' | b'n' => counted(&mut rest).is_some(),
        b't' => counted(&mut rest).is_some_and(|mut table| {
            while !table.is_empty() {
                if counted(&mut table).is_none() {
                    return false;
                }
            }
            true
        }),
        digit => skip(&mut rest, usize::from(digit - b'0')).is_some(),
    })
}

/// The bytes behind a length.
fn counted<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = skip(rest, 4)?.first_chunk().copied()?;
    skip(rest, usize::try_from(u32::from_le_bytes(length)).ok()?)
}

fn skip<'a>(rest: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    let (head, behind) = rest.split_at_checked(length)?;
    *rest = behind;
    Some(head)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A valid record of each kind, and the offsets of its lengths.
    fn record(opcode: u8) -> (Vec<u8>, Vec<usize>) {
        let (mut body, mut lengths) = (Vec::new(), Vec::new());
        for part in layout(opcode) {
            match part {
                b's' | b'n' | b't' => {
                    lengths.push(body.len());
                    let content: &[u8] = match part {
                        b't' => &[1, 0, 0, 0, b'k', 2, 0, 0, 0, b'v', b'w'],
                        _ => b"abc",
                    };
                    body.push(u8::try_from(content.len()).expect("short"));
                    body.extend([0; 3]);
                    if *part == b't' {
                        lengths.extend([body.len(), body.len() + 5]);
                    }
                    body.extend(content);
                }
                digit => body.extend(vec![0; usize::from(digit - b'0')]),
            }
        }
        (body, lengths)
    }

    #[test]
    fn each_length_beyond_the_end_is_found() {
        for opcode in 0..=u8::MAX {
            let (body, lengths) = record(opcode);
            assert!(fit(opcode, &body), "{opcode:#04x}");
            for at in lengths {
                for wrong in [u32::MAX, 1 << 31, 1000] {
                    let mut damaged = body.clone();
                    damaged[at..at + 4].copy_from_slice(&wrong.to_le_bytes());
                    assert!(!fit(opcode, &damaged), "{opcode:#04x} at {at}: {wrong}");
                }
            }
            for cut in 0..body.len() {
                assert!(!fit(opcode, &body[..cut]), "{opcode:#04x} cut at {cut}");
            }
        }
    }
}
