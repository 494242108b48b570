//! Archives around a file: gzip, and zip with one file that can be imported.

use std::borrow::Cow;

use flate2::read::MultiGzDecoder;

use super::decoded::decoded;
use super::imported::ImportError;
use super::limited::limited;
use super::zipfile::{Entry, entries, is_zip};
use super::{Format, srzip};

/// Maximum depth of nested archives.
const DEPTH_MAX: usize = 3;
/// Maximum number of files of an archive that a message names.
const NAMED_MAX: usize = 8;

/// The content of a file, text as UTF-8.
pub(super) fn unpack<'a>(
    bytes: &'a [u8],
    notes: &mut Vec<String>,
) -> Result<Cow<'a, [u8]>, ImportError> {
    let mut bytes = Cow::Borrowed(bytes);
    for _ in 0..DEPTH_MAX {
        if bytes.starts_with(&[0x1F, 0x8B, 8]) {
            bytes = Cow::Owned(gzip(&bytes)?);
            notes.push("unpacked with gzip".to_owned());
        } else if is_zip(&bytes) && !srzip::is_session(&bytes) {
            let (name, content) = only_file(&bytes)?;
            notes.push(format!("read {name} of the archive"));
            bytes = Cow::Owned(content);
        } else {
            break;
        }
    }
    Ok(decoded(bytes))
}

fn gzip(bytes: &[u8]) -> Result<Vec<u8>, ImportError> {
    limited(MultiGzDecoder::new(bytes))
        .map_err(|what| ImportError::of_file(format!("this gzip file {what}")))
}

/// The only file of a zip archive that can be imported.
fn only_file(bytes: &[u8]) -> Result<(String, Vec<u8>), ImportError> {
    let all =
        entries(bytes).map_err(|what| ImportError::of_file(format!("this zip archive {what}")))?;
    let names: Vec<&str> = all.iter().map(|entry| &*entry.name).collect();
    if names.contains(&"meta.json") && names.iter().any(|name| name.starts_with("digital-")) {
        return Err(ImportError::of_file(SAL));
    }
    if names.contains(&"header") && names.contains(&"decoders") {
        return Err(ImportError::of_file(DSL));
    }
    let is_file = |entry: &&Entry| !entry.name.ends_with('/');
    let mut found = Vec::new();
    for entry in all.iter().filter(is_file) {
        let name = &entry.name;
        let content = entry
            .content(bytes)
            .map_err(|what| ImportError::of_file(format!("{name} of this archive {what}")))?;
        let is_archive = is_zip(&content) || content.starts_with(&[0x1F, 0x8B]);
        if is_archive || Format::detect(&decoded(Cow::Borrowed(&content))).is_some() {
            found.push((name.clone(), content));
        }
    }
    match found.len() {
        1 => Ok(found.remove(0)),
        0 => {
            let shown = names[..names.len().min(NAMED_MAX)].join(", ");
            Err(ImportError::of_file(format!(
                "no file of this zip archive can be imported; it holds: {shown}"
            )))
        }
        _ => {
            let names: Vec<&str> = found.iter().map(|(name, _)| &**name).collect();
            let (all, first) = (names.join(", "), names[0]);
            Err(ImportError::of_file(format!(
                "this zip archive holds several files that can be imported: {all}; unpack one: \
                 unzip -p FILE {first} > {first}"
            )))
        }
    }
}

const SAL: &str = "this is a capture of Saleae Logic 2 (.sal), whose samples are not documented; in \
    Logic 2 export the Async Serial analyzers (Data > Export Table, hexadecimal) or the channels \
    (File > Export Raw Data, CSV), then import that file";
const DSL: &str = "this is a session of DSView (.dsl); in DSView use File > Export and choose sigrok \
    (.sr), CSV or VCD, then import that file";

#[cfg(test)]
mod tests {
    use super::super::zipfile::stored as zipped;
    use super::*;

    fn of(bytes: &[u8]) -> Result<Vec<u8>, String> {
        let unpacked = unpack(bytes, &mut Vec::new());
        unpacked.map(Cow::into_owned).map_err(|error| error.message)
    }

    /// A zip file with one dump is read, also if it has another file that is no dump, and also
    /// inside another archive.
    #[test]
    fn one_dump_in_an_archive_is_read() {
        let dump = b"AB 24 0A 00 D9\n";
        let one = zipped(&[("note.txt", b"hello"), ("dump.hex", dump)]);
        assert_eq!(of(&one), Ok(dump.to_vec()));
        assert_eq!(of(&zipped(&[("in.zip", &one)])), Ok(dump.to_vec()));
    }

    #[test]
    fn an_archive_of_none_or_several_dumps_is_refused_with_their_names() {
        let none = of(&zipped(&[("note.txt", b"hello")])).expect_err("no dump");
        assert!(none.ends_with("it holds: note.txt"), "{none}");
        let dump = b"AB 24 0A 00 D9\n";
        let two = of(&zipped(&[("a.hex", dump), ("b.hex", dump)])).expect_err("two");
        assert!(
            two.contains("a.hex, b.hex; unpack one: unzip -p FILE"),
            "{two}"
        );
        let sal = zipped(&[("meta.json", b"{}"), ("digital-0.bin", b"<SALEAE>")]);
        assert!(of(&sal).expect_err("foreign").contains("Logic 2"));
    }

    #[test]
    fn a_cut_archive_is_an_error() {
        let whole = zipped(&[("a.hex", b"AB 24 0A 00 D9\n")]);
        assert!(
            of(&whole[..whole.len() - 10])
                .expect_err("cut")
                .contains("damaged")
        );
        let gzip = of(&[0x1F, 0x8B, 8, 0, 0, 0, 0, 0, 0, 3, 1]).expect_err("cut");
        assert!(gzip.contains("damaged"), "{gzip}");
    }

    /// A capture of Logic 2 has its description and its samples, a session of DSView its header and
    /// its decoders; one of the two files alone is any file.
    #[test]
    fn archives_of_other_tools_are_known_by_two_files() {
        let dump = &b"AB 24 0A 00 D9\n"[..];
        let with = |names: &[&'static str]| {
            let mut files: Vec<(&str, &[u8])> =
                names.iter().map(|name| (*name, &b"x"[..])).collect();
            files.push(("dump.hex", dump));
            of(&zipped(&files))
        };
        for names in [
            &["meta.json"][..],
            &["digital-0.bin"],
            &["header"],
            &["decoders"],
            &["header", "meta.json"],
            &["folder/"],
        ] {
            assert_eq!(with(names), Ok(dump.to_vec()), "{names:?}");
        }
        let error = |names: &[&'static str]| with(names).expect_err("another tool");
        assert!(error(&["meta.json", "digital-0.bin"]).contains("Logic 2"));
        assert!(error(&["header", "decoders"]).contains("DSView"));
    }

    /// Three archives inside each other are unpacked, and of many files eight are named.
    #[test]
    fn archives_have_limits() {
        let dump = b"AB 24 0A 00 D9\n".to_vec();
        let in_archives =
            |depth: usize| (0..depth).fold(dump.clone(), |inner, _| zipped(&[("in", &inner)]));
        assert_eq!(of(&in_archives(3)), Ok(dump.clone()));
        assert_eq!(of(&in_archives(4)), Ok(in_archives(1)));
        let names: Vec<String> = (0..9).map(|n| format!("{n}.txt")).collect();
        let files: Vec<(&str, &[u8])> = names.iter().map(|name| (&**name, &b"hello"[..])).collect();
        let error = of(&zipped(&files)).expect_err("no dump");
        let eight = "it holds: 0.txt, 1.txt, 2.txt, 3.txt, 4.txt, 5.txt, 6.txt, 7.txt";
        assert!(error.ends_with(eight), "{error}");
        let mut notes = Vec::new();
        drop(unpack(&in_archives(2), &mut notes).expect("a dump"));
        assert_eq!(notes, ["read in of the archive"; 2]);
    }
}
