use std::path::Path;

use super::engine::caught;
use super::subject::{Behaviour, Kept, Subject, Violation};
use crate::shrink::{Effort, fewest};
use engine::codec;
use engine::codec::wire::{Holds, Piece, Stream, Target};
use show::shell::word;

/// A wire format as a subject: streams into its decoder, judged by the laws of
/// [`wire`](codec::wire).
#[derive(Clone, Copy, Debug)]
pub struct Wires(pub &'static Target);

/// File name of a finding's stream.
const STREAM: &str = "stream.txt";

impl Wires {
    /// All wire formats.
    pub fn all() -> impl Iterator<Item = Self> {
        codec::targets().into_iter().map(Self)
    }

    fn judged(&self, stream: &Stream) -> Result<(), Violation> {
        caught(|| (self.0.check)(stream).map_err(Violation::from))
    }

    /// Minimises a stream with the same violation: fewer bytes, chunks and pauses, then zeros.
    fn smallest(&self, stream: &Stream, cause: &str, effort: &mut Effort<'_>) -> Stream {
        let fails = |atoms: &[Atom]| {
            self.judged(&of_atoms(atoms))
                .is_err_and(|fault| fault.cause == cause)
        };
        let mut atoms = fewest(&atoms_of(stream), effort, fails);
        for at in 0..atoms.len() {
            let Atom::Byte(byte @ 1..) = atoms[at] else {
                continue;
            };
            atoms[at] = Atom::Byte(0);
            if !effort.spend() || !fails(&atoms) {
                atoms[at] = Atom::Byte(byte);
            }
        }
        of_atoms(&atoms)
    }
}

/// The parts of a stream that can be removed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Atom {
    Byte(u8),
    /// A boundary of a chunk.
    Cut,
    Idle,
}

fn atoms_of(stream: &Stream) -> Vec<Atom> {
    let mut atoms = Vec::new();
    for piece in stream.pieces() {
        match piece {
            Piece::Idle => atoms.push(Atom::Idle),
            Piece::Bytes(bytes) => {
                atoms.extend(bytes.iter().copied().map(Atom::Byte));
                atoms.push(Atom::Cut);
            }
        }
    }
    atoms
}

fn of_atoms(atoms: &[Atom]) -> Stream {
    let bytes: Vec<u8> = atoms
        .iter()
        .filter_map(|atom| match atom {
            Atom::Byte(byte) => Some(*byte),
            _ => None,
        })
        .collect();
    let mut pieces = Vec::new();
    let (mut start, mut end) = (0, 0);
    for atom in atoms {
        if matches!(atom, Atom::Byte(_)) {
            end += 1;
            continue;
        }
        if end > start {
            pieces.push(Piece::Bytes(&bytes[start..end]));
            start = end;
        }
        if *atom == Atom::Idle {
            pieces.push(Piece::Idle);
        }
    }
    pieces.push(Piece::Bytes(&bytes[start..end]));
    Stream::of(pieces)
}

impl Subject for Wires {
    fn name(&self) -> &str {
        self.0.name
    }

    fn round(&self) -> u64 {
        self.0.round
    }

    fn tries(&self) -> u32 {
        20_000
    }

    fn run(&self, choices: &[u8], behaviour: &mut Behaviour) -> Result<(), Violation> {
        let stream = (self.0.stream)(choices);
        (self.0.marks)(&stream, &mut |mark| behaviour.note(mark));
        (self.0.check)(&stream).map_err(Violation::from)
    }

    /// A frame of zeros, and three other frames; the search finds the rest.
    fn seeds(&self) -> Vec<Vec<u8>> {
        if self.0.holds == Holds::Bytes {
            return vec![
                Vec::new(),
                b"AT+NAMEhilrig".to_vec(),
                vec![200, 127, 100, 0],
            ];
        }
        let frames: Vec<u8> = (0..60).map(|n| if n % 20 == 1 { 0 } else { n }).collect();
        vec![vec![0, 0], frames]
    }

    fn in_words(&self, choices: &[u8]) -> String {
        (self.0.stream)(choices).to_text()
    }

    fn keep(&self, choices: &[u8], fault: &Violation, effort: &mut Effort<'_>) -> Kept {
        let small = self.smallest(&(self.0.stream)(choices), &fault.cause, effort);
        let fault = self.judged(&small).err().unwrap_or_else(|| fault.clone());
        Kept {
            fault,
            files: vec![(STREAM, small.to_text().into_bytes())],
        }
    }

    fn case_file(&self) -> &'static str {
        STREAM
    }

    fn repeat(&self, dir: &Path) -> String {
        let (name, file) = (self.0.name, dir.join(STREAM));
        format!("hilrig fuzz {name} --repeat {}", word(&file))
    }

    fn choices_of(&self, text: &str) -> Result<Option<Vec<u8>>, String> {
        let stream = Stream::parse(text).map_err(|error| error.to_string())?;
        Ok(Some(self.0.data_of(&stream)))
    }

    fn repeated(&self, text: &str) -> Result<Result<(), Violation>, String> {
        let stream = Stream::parse(text).map_err(|error| error.to_string())?;
        Ok(self.judged(&stream))
    }
}

#[cfg(test)]
mod tests {
    use super::super::engine::Fuzzer;
    use super::*;
    use engine::codec::wire::Broken;
    use std::collections::BTreeMap;

    #[test]
    fn a_stream_put_together_of_its_atoms_is_the_same() {
        let text = "AB 24\nFF\nidle\n00 01\nidle\n";
        let stream = Stream::parse(text).expect("a stream");
        assert_eq!(of_atoms(&atoms_of(&stream)).to_text(), text);
    }

    /// A decoder that stops forever at a read of 64 registers or more. Only the first three bytes
    /// of such a frame, and its validity, matter.
    static BROKEN: Target = Target {
        check: |stream| {
            let is_long = |bytes: &[u8]| matches!(bytes, [0xAB, _, 64..=127, _, sum] if *sum > 0);
            match stream.bytes().windows(5).any(is_long) {
                true => Err(Broken::new("answers-come-back", "64 and more are too many")),
                false => Ok(()),
            }
        },
        ..*codec::BUS.target()
    };

    #[test]
    fn a_finding_is_made_as_small_as_it_gets() {
        let subject = Wires(&BROKEN);
        let mut fuzzer = Fuzzer::new(&subject, 1, 0, BTreeMap::new());
        let found = (0..50).find_map(|_| fuzzer.round(512, 1).found.pop());
        let found = found.expect("a long read is no rarity");
        let mut effort = Effort::tries(2000);
        let kept = subject.keep(&found.choices, &found.fault, &mut effort);
        let text = String::from_utf8(kept.files[0].1.clone()).expect("hexadecimal");
        let words: Vec<&str> = text.split_whitespace().collect();
        assert_eq!((words.len(), words[0], words[1]), (5, "AB", "00"), "{text}");
        let again = subject.repeated(&text).expect("a stream");
        assert_eq!(again, Err(kept.fault));
    }
}
