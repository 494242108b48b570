//! Constants of the program under test: numbers with which it compares, and its words. A value that
//! the program looks for is a better input than a random one.
//!
//! They come from the files that its processes execute: from the machine code and the read-only
//! data of ELF files for x86-64, and from the text of scripts. The code is not disassembled: bytes
//! that look like a comparison with a constant count as one.

use std::collections::BTreeSet;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use emulators::rng::Rng;

use super::case::index;

/// Maximum numbers of constants.
const NUMBERS_MAX: usize = 1024;
const WORDS_MAX: usize = 512;
/// Lengths of words.
const WORD: core::ops::RangeInclusive<usize> = 2..=24;
/// Maximum number of bytes that are read of a program and of a script.
const PROGRAM_MAX: u64 = 16 << 20;
const SCRIPT_MAX: u64 = 1 << 20;
/// Programs that only start the program under test, and libraries that know no protocol.
const SHELLS: [&str; 4] = ["sh", "dash", "bash", "busybox"];
const LIBRARIES: [&str; 10] = [
    "ld-linux",
    "ld-musl",
    "libc.",
    "libc-",
    "libm.",
    "libdl.",
    "librt.",
    "libgcc_s",
    "libpthread",
    "libstdc++",
];

/// Numbers and words of a program.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Constants {
    numbers: Vec<i64>,
    words: Vec<Vec<u8>>,
}

impl Constants {
    /// The constants of the files that the processes `pids` execute.
    pub(super) fn of_processes(pids: impl Iterator<Item = u32>) -> Self {
        let (mut scripts, mut programs) = (BTreeSet::new(), BTreeSet::new());
        for pid in pids {
            let of = PathBuf::from(format!("/proc/{pid}"));
            let own = scripts_of(&of);
            // The constants of an interpreter are not those of its script.
            if own.is_empty() {
                programs.extend(programs_of(&of));
            }
            scripts.extend(own);
        }
        let mut found = Self::default();
        for path in scripts {
            found.add_script(&read(&path, SCRIPT_MAX));
        }
        for path in programs {
            found.add_program(&read(&path, PROGRAM_MAX));
        }
        found
    }

    /// One of the numbers, or a number next to it.
    pub(super) fn number(&self, rng: &mut Rng) -> Option<i64> {
        let last = (self.numbers.len() as u64).checked_sub(1)?;
        let number = self.numbers[index(rng, last + 1)];
        Some(match rng.below(4) {
            0 => number.saturating_add(1),
            1 => number.saturating_sub(1),
            _ => number,
        })
    }

    /// One of the words.
    pub(super) fn word(&self, rng: &mut Rng) -> Option<&[u8]> {
        let last = (self.words.len() as u64).checked_sub(1)?;
        Some(&self.words[index(rng, last + 1)])
    }

    fn add_number(&mut self, number: i64) {
        // Zero and one are limits anyway.
        let is_new = !(0..=1).contains(&number) && !self.numbers.contains(&number);
        if is_new && self.numbers.len() < NUMBERS_MAX {
            self.numbers.push(number);
        }
    }

    fn add_word(&mut self, word: &[u8]) {
        let is_printable = word.iter().all(|byte| matches!(byte, b' '..=b'~'));
        let is_word = WORD.contains(&word.len()) && is_printable;
        let is_new = is_word && !self.words.iter().any(|known| known == word);
        if is_new && self.words.len() < WORDS_MAX {
            self.words.push(word.to_vec());
        }
    }

    fn add_program(&mut self, file: &[u8]) {
        for (is_code, section) in sections(file) {
            match is_code {
                true => self.add_code(section),
                false => section
                    .split(|byte| *byte == 0)
                    .for_each(|word| self.add_word(word)),
            }
        }
    }

    fn add_code(&mut self, code: &[u8]) {
        for at in 0..code.len() {
            if let Some((number, bytes)) = compared(&code[at..]) {
                self.add_number(number);
                // A comparison with a short constant text is often compiled as a comparison of
                // numbers.
                if bytes >= 2 {
                    self.add_word(&number.to_le_bytes()[..bytes]);
                }
            }
        }
    }

    /// Adds the numbers and the quoted words of a script.
    pub(super) fn add_script(&mut self, text: &[u8]) {
        let text = String::from_utf8_lossy(text);
        let is_other = |byte: char| !(byte.is_ascii_alphanumeric() || byte == '_');
        for token in text.split(is_other) {
            let number = match token.strip_prefix("0x") {
                Some(hex) => i64::from_str_radix(hex, 16),
                None => token.parse(),
            };
            number
                .into_iter()
                .for_each(|number| self.add_number(number));
        }
        for line in text.lines() {
            for quote in ['"', '\''] {
                let quoted = line.split(quote).skip(1).step_by(2);
                quoted.for_each(|word| self.add_word(word.as_bytes()));
            }
        }
    }
}

/// The first bytes of a file; none if it cannot be read.
fn read(path: &Path, most: u64) -> Vec<u8> {
    let mut bytes = Vec::new();
    if let Ok(file) = fs::File::open(path) {
        let _ = file.take(most).read_to_end(&mut bytes);
    }
    bytes
}

/// The scripts that the process in the folder `of` was started with.
fn scripts_of(of: &Path) -> Vec<PathBuf> {
    let words = fs::read(of.join("cmdline")).unwrap_or_default();
    let dir = fs::read_link(of.join("cwd")).unwrap_or_default();
    let words = words.split(|byte| *byte == 0).skip(1);
    let paths = words.filter_map(|word| Some(dir.join(core::str::from_utf8(word).ok()?)));
    let is_script = |path: &PathBuf| {
        let is_file =
            fs::metadata(path).is_ok_and(|data| data.is_file() && data.len() <= SCRIPT_MAX);
        is_file && is_text(&read(path, 512))
    };
    paths.filter(is_script).collect()
}

fn is_text(bytes: &[u8]) -> bool {
    !bytes.is_empty() && !bytes.contains(&0)
}

/// The program and the libraries that the process in the folder `of` executes, without those of
/// the system.
fn programs_of(of: &Path) -> Vec<PathBuf> {
    let name_of = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    let program = fs::read_link(of.join("exe")).unwrap_or_default();
    if SHELLS.contains(&name_of(&program).as_str()) {
        return Vec::new();
    }
    let maps = fs::read_to_string(of.join("maps")).unwrap_or_default();
    let code = maps.lines().filter(|line| {
        let rights = line.split(' ').nth(1);
        rights.is_some_and(|rights| rights.contains('x'))
    });
    let paths = code.filter_map(|line| Some(PathBuf::from(&line[line.find('/')?..])));
    let is_own = |path: &PathBuf| {
        let name = name_of(path);
        !LIBRARIES.iter().any(|library| name.starts_with(library))
    };
    paths.filter(is_own).collect()
}

/// The machine code and the read-only data of an ELF file for x86-64; each part has a flag, true
/// for machine code.
fn sections(file: &[u8]) -> Vec<(bool, &[u8])> {
    let number = |at: usize, bytes: usize| {
        let mut value = [0; 8];
        value[..bytes].copy_from_slice(file.get(at..at.checked_add(bytes)?)?);
        usize::try_from(u64::from_le_bytes(value)).ok()
    };
    // System V ABI, chapter 4: 64 bits, low byte first; machine 62 is x86-64.
    let is_elf = file.starts_with(b"\x7FELF\x02\x01") && number(0x12, 2) == Some(62);
    let [table, size, count] =
        [(0x28, 8), (0x3A, 2), (0x3C, 2)].map(|(at, bytes)| number(at, bytes));
    let (Some(table), Some(size), Some(count), true) = (table, size, count, is_elf) else {
        return Vec::new();
    };
    let section = |index: usize| {
        let head = table.checked_add(index.checked_mul(size)?)?;
        let field = |at: usize, bytes: usize| number(head.checked_add(at)?, bytes);
        let (kind, flags) = (field(0x04, 4)?, field(0x08, 8)?);
        let [from, len] = [field(0x18, 8)?, field(0x20, 8)?];
        let bytes = file.get(from..from.checked_add(len)?)?;
        // Content of the program (1) that is loaded (flag 2), not written (1); code has flag 4.
        (kind == 1 && flags & 3 == 2).then_some((flags & 4 != 0, bytes))
    };
    (0..count).filter_map(section).collect()
}

/// The constant of the comparison at the beginning of `code`, and its number of bytes.
fn compared(code: &[u8]) -> Option<(i64, usize)> {
    let (is_short, code) = match code.strip_prefix(&[0x66]) {
        Some(rest) => (true, rest),
        None => (false, code),
    };
    let code = match code {
        [0x40..=0x4F, rest @ ..] => rest,
        code => code,
    };
    let wide = if is_short { 2 } else { 4 };
    // Intel's manual, volume 2: CMP and its forms with an immediate operand; 7 in bits 3 to 5 of
    // the byte behind 80, 81 and 83 means CMP, 6 means XOR, by which compilers compare texts.
    let (operand, bytes) = match code {
        [0x3C, rest @ ..] => (rest, 1),
        [0x3D | 0x35, rest @ ..] => (rest, wide),
        [code @ (0x80 | 0x81 | 0x83), how, rest @ ..] => {
            let is_compared = how >> 3 & 7 == 7 || (*code == 0x81 && how >> 3 & 7 == 6);
            let bytes = if *code == 0x81 { wide } else { 1 };
            let more = address_bytes(*how, rest.first().copied());
            (is_compared.then(|| rest.get(more..))??, bytes)
        }
        _ => return None,
    };
    let mut value = [0; 8];
    value[..bytes].copy_from_slice(operand.get(..bytes)?);
    let value = i64::from_le_bytes(value);
    let top = 64 - 8 * bytes;
    // Without a sign, as data have it, if the highest bit is set.
    let is_extended = matches!(code, [0x83, ..]);
    let value = match is_extended {
        true => value << top >> top,
        false => value,
    };
    Some((value, bytes))
}

/// Number of bytes between the byte that says how an operand is addressed and the constant; `next`
/// is the byte behind it.
const fn address_bytes(how: u8, next: Option<u8>) -> usize {
    let (mode, base) = (how >> 6, how & 7);
    let has_index = mode != 3 && base == 4;
    let distance = match (mode, base) {
        (0, 5) | (2, _) => 4,
        (0, 4) => match next {
            Some(next) if next & 7 == 5 => 4,
            _ => 0,
        },
        (1, _) => 1,
        _ => 0,
    };
    distance + has_index as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Encodings as GNU as 2.40 gives them: `cmp $12,%eax`, `cmpl $99,4(%rdi)`,
    /// `cmpw $0x8000,%cx`, `cmpb $0x41,(%rax,%rbx)`, `cmp $0x4c4f,%r9d`, `cmp $-2,%edi`,
    /// `cmpl $1000,0x10(%rip)`. `add $12,%eax` is no comparison.
    #[test]
    fn constants_of_comparisons_are_found_in_machine_code() {
        let code: [(&[u8], Option<i64>); 8] = [
            (&[0x83, 0xF8, 0x0C], Some(12)),
            (&[0x83, 0x7F, 0x04, 0x63], Some(99)),
            (&[0x66, 0x81, 0xF9, 0x00, 0x80], Some(0x8000)),
            (&[0x80, 0x3C, 0x18, 0x41], Some(0x41)),
            (&[0x41, 0x81, 0xF9, 0x4F, 0x4C, 0, 0], Some(0x4C4F)),
            (&[0x83, 0xFF, 0xFE], Some(-2)),
            (&[0x81, 0x3D, 0x10, 0, 0, 0, 0xE8, 0x03, 0, 0], Some(1000)),
            (&[0x83, 0xC0, 0x0C], None),
        ];
        for (bytes, expected) in code {
            assert_eq!(compared(bytes).map(|it| it.0), expected, "{bytes:02X?}");
            // Code may end anywhere.
            for end in 0..bytes.len() {
                let _ = compared(&bytes[..end]);
            }
        }
    }

    #[test]
    fn constants_of_scripts_are_their_numbers_and_quoted_words() {
        let mut found = Constants::default();
        found.add_script(b"if mode == 0x2A or word == 'reset' and n > 99: send(\"OK\")\n");
        assert_eq!(found.numbers, [0x2A, 99]);
        assert_eq!(found.words, [b"OK".to_vec(), b"reset".to_vec()]);
    }

    /// This test is an ELF file with code and data. Cut or damaged anywhere in its header, it gives
    /// other sections or none.
    #[test]
    fn constants_of_this_program_are_found() {
        let mut file = read(Path::new("/proc/self/exe"), u64::MAX);
        if !cfg!(target_arch = "x86_64") {
            return;
        }
        assert!(sections(&file).iter().any(|(is_code, _)| *is_code));
        assert!(sections(&file).iter().any(|(is_code, _)| !is_code));
        for at in 0..64 {
            for value in [0, 0x7F, 0xFF] {
                let kept = core::mem::replace(&mut file[at], value);
                let _ = sections(&file);
                file[at] = kept;
            }
        }
        for len in [0, 5, 17, 63, 64, 1000] {
            let _ = sections(&file[..len]);
        }
    }
}
