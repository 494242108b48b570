//! Files in a zip archive: stored or deflated, as all tools here write them.
//!
//! ```text
//! | local header 50 4B 03 04 | name | data | ..        the files
//! | central header 50 4B 01 02 | name | ..             the directory
//! | end 50 4B 05 06 |                                  where the directory is
//! ```

use flate2::Crc;
use flate2::read::DeflateDecoder;

use super::limited::limited;
use crate::pcapng::Order;

/// Whether a file is a zip archive.
pub(super) fn is_zip(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

/// A file of the archive.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    pub(super) name: String,
    method: u16,
    flags: u16,
    crc: u32,
    packed: usize,
    header: usize,
}

const LITTLE: Order = Order::Little;

/// The directory of an archive.
pub(super) fn entries(bytes: &[u8]) -> Result<Vec<Entry>, String> {
    const DAMAGED: &str = "is damaged: it has no valid directory at its end; copy it again";
    const END: usize = 22;
    // A comment may follow the end record.
    let last = bytes.len().checked_sub(END).ok_or(DAMAGED)?;
    let first = last.saturating_sub(usize::from(u16::MAX));
    let end = (first..=last)
        .rev()
        .find(|&at| bytes[at..].starts_with(b"PK\x05\x06"));
    let end = end.ok_or(DAMAGED)?;
    let count = LITTLE.u16_at(bytes, end + 10).ok_or(DAMAGED)?;
    let mut at = number(bytes, end + 16).ok_or(DAMAGED)?;
    let mut entries = Vec::new();
    for _ in 0..count {
        let (entry, next) = entry(bytes, at).ok_or(DAMAGED)?;
        entries.push(entry);
        at = next;
    }
    Ok(entries)
}

fn number(bytes: &[u8], at: usize) -> Option<usize> {
    usize::try_from(LITTLE.u32_at(bytes, at)?).ok()
}

/// The directory entry at `at`, and the offset of the next one.
fn entry(bytes: &[u8], at: usize) -> Option<(Entry, usize)> {
    let half = |place: usize| LITTLE.u16_at(bytes, at + place);
    if !bytes.get(at..)?.starts_with(b"PK\x01\x02") {
        return None;
    }
    let lens = [half(28)?, half(30)?, half(32)?].map(usize::from);
    let name = bytes.get(at + 46..at + 46 + lens[0])?;
    let entry = Entry {
        name: String::from_utf8_lossy(name).into_owned(),
        flags: half(8)?,
        method: half(10)?,
        crc: LITTLE.u32_at(bytes, at + 16)?,
        packed: number(bytes, at + 20)?,
        header: number(bytes, at + 42)?,
    };
    Some((entry, at + 46 + lens.iter().sum::<usize>()))
}

impl Entry {
    /// Unpacks the content.
    pub(super) fn content(&self, bytes: &[u8]) -> Result<Vec<u8>, String> {
        if self.flags & 1 == 1 {
            return Err("is encrypted; unpack it first: unzip FILE".to_owned());
        }
        let damaged = || "is damaged; copy the archive again".to_owned();
        let packed = self.packed_bytes(bytes).ok_or_else(damaged)?;
        let content = match self.method {
            0 => packed.to_vec(),
            8 => limited(DeflateDecoder::new(packed))?,
            _ => {
                let text = "has an unsupported compression; unpack it first: unzip FILE";
                return Err(text.to_owned());
            }
        };
        let mut crc = Crc::new();
        crc.update(&content);
        (crc.sum() == self.crc)
            .then_some(content)
            .ok_or_else(damaged)
    }

    fn packed_bytes<'a>(&self, bytes: &'a [u8]) -> Option<&'a [u8]> {
        let local = bytes.get(self.header..).filter(|local| is_zip(local))?;
        let lens = [LITTLE.u16_at(local, 26)?, LITTLE.u16_at(local, 28)?].map(usize::from);
        let start = 30 + lens[0] + lens[1];
        local.get(start..start.checked_add(self.packed)?)
    }
}

/// An archive of uncompressed files, for tests.
#[cfg(test)]
pub(super) fn stored(files: &[(&str, &[u8])]) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    let word = |number: usize| u32::try_from(number).expect("short").to_le_bytes();
    let half = |number: usize| u16::try_from(number).expect("short").to_le_bytes();
    for (name, content) in files {
        let mut crc = Crc::new();
        crc.update(content);
        // Version, flags, method, time and date, checksum, sizes, lengths of name and extra.
        let head = [
            &[20, 0, 0, 0, 0, 0, 0, 0, 0, 0][..],
            &crc.sum().to_le_bytes(),
            &word(content.len()),
            &word(content.len()),
            &half(name.len()),
            &[0, 0],
        ]
        .concat();
        directory.extend_from_slice(b"PK\x01\x02\x14\x00");
        directory.extend_from_slice(&head);
        directory.extend_from_slice(&[0; 10]);
        directory.extend(word(out.len()));
        directory.extend_from_slice(name.as_bytes());
        out.extend_from_slice(b"PK\x03\x04");
        out.extend(head);
        out.extend_from_slice(name.as_bytes());
        out.extend_from_slice(content);
    }
    let start = out.len();
    out.extend_from_slice(&directory);
    out.extend_from_slice(b"PK\x05\x06\0\0\0\0");
    out.extend(half(files.len()));
    out.extend(half(files.len()));
    out.extend(word(directory.len()));
    out.extend(word(start));
    out.extend_from_slice(&[0, 0]);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_files_are_read_by_their_names() {
        let file = stored(&[("a", b"one"), ("b/c", b"two")]);
        let entries = entries(&file).expect("sound");
        let names: Vec<_> = entries.iter().map(|entry| &*entry.name).collect();
        assert_eq!(names, ["a", "b/c"]);
        assert_eq!(entries[1].content(&file), Ok(b"two".to_vec()));
    }

    /// Eight times "AB" in a line, deflated by `zip -X` of Info-ZIP 3.0.
    #[test]
    fn a_deflated_file_is_read() {
        let file = engine::hex::bytes(DEFLATED).expect("digits");
        let entries = entries(&file).expect("sound");
        let content = entries[0].content(&file);
        assert_eq!(content, Ok(b"AB AB AB AB AB AB AB AB\n".to_vec()));
        let mut damaged = file.clone();
        damaged[37] ^= 1;
        assert!(entries[0].content(&damaged).is_err());
    }

    const DEFLATED: &str = "504B0304140000000800AF717B5D231ED56F080000001800000006000000612E6865787873745270\
        C482B800504B01021E03140000000800AF717B5D231ED56F08000000180000000600000000000000\
        01000000A48100000000612E68657878504B05060000000001000100340000002C0000000000";

    #[test]
    fn damage_and_encryption_are_told() {
        let file = stored(&[("a", b"one")]);
        assert!(
            entries(&file[..file.len() - 4])
                .expect_err("cut")
                .contains("damaged")
        );
        assert!(entries(b"PK\x03\x04").is_err());
        let mut secret = entries(&file).expect("sound").remove(0);
        secret.flags = 1;
        assert!(
            secret
                .content(&file)
                .expect_err("secret")
                .contains("encrypted")
        );
        let mut far = entries(&file).expect("sound").remove(0);
        far.packed = usize::MAX;
        assert!(far.content(&file).is_err());
    }

    /// A comment of up to 65,535 bytes may follow the directory's end.
    #[test]
    fn an_archive_may_have_a_comment() {
        let file = stored(&[("a", b"one")]);
        let with = |len: usize| {
            let found = entries(&[&file[..], &vec![b'x'; len]].concat());
            found.map(|entries| entries.len()).ok()
        };
        assert_eq!(
            (with(0), with(65_535), with(65_536)),
            (Some(1), Some(1), None)
        );
    }

    /// Names, extra fields and comments of the directory have lengths of their own.
    #[test]
    fn an_entry_has_three_lengths() {
        // A header of 46 bytes with a name of 2, an extra field of 3 and a comment of 4 bytes.
        let mut header = vec![0; 46];
        header[..4].copy_from_slice(b"PK\x01\x02");
        (header[8], header[10], header[16], header[20]) = (1, 8, 7, 9);
        (header[28], header[30], header[32], header[42]) = (2, 3, 4, 5);
        let bytes = [&b"zz"[..], &header, b"ab", &[0; 7]].concat();
        let (entry, next) = entry(&bytes, 2).expect("whole");
        assert_eq!((&*entry.name, next), ("ab", 2 + 46 + 9));
        assert_eq!((entry.flags, entry.method, entry.crc), (1, 8, 7));
        assert_eq!((entry.packed, entry.header), (9, 5));
        assert!(super::entry(&bytes, 1).is_none() && super::entry(&bytes[..49], 2).is_none());
        let other = Entry {
            flags: 2,
            method: 9,
            header: 0,
            packed: 3,
            ..entry
        };
        let file = stored(&[("a", b"one")]);
        let error = other.content(&file).expect_err("unknown");
        assert!(error.contains("unsupported compression"), "{error}");
    }
}
