//! Fingerprints of the files that run: each executable, and the script that an interpreter runs. A
//! case with recorded computing, and the plan of a campaign, show by them that a program has
//! changed since.

use std::collections::BTreeMap;
use std::env;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Maximum number of bytes of a file in its fingerprint.
const BYTES_MAX: u64 = 256 << 20;
/// Number of bytes in one read.
const PIECE: usize = 1 << 16;
/// Factor of fingerprints: 2^64 divided by the golden ratio, as an odd number.
const FACTOR: u64 = 0x9E37_79B9_7F4A_7C15;
/// Endings of files that an interpreter runs.
const SCRIPTS: [&str; 16] = [
    "bash", "exe", "jar", "jl", "js", "lua", "mjs", "php", "pl", "py", "pyc", "r", "rb", "scm",
    "sh", "tcl",
];

/// The files that the process `pid` runs, which has just executed a program: `NAME FINGERPRINT`.
#[cfg_attr(
    not(all(target_os = "linux", target_arch = "x86_64")),
    expect(dead_code, reason = "only virtual time follows processes")
)]
pub(super) fn files_of(pid: i32) -> Vec<String> {
    let exe = PathBuf::from(format!("/proc/{pid}/exe"));
    let name = fs::read_link(&exe).unwrap_or_default();
    let script = script_of(pid).map(|path| (path.clone(), path));
    let files = core::iter::once((name, exe)).chain(script);
    let files = files.filter_map(|(name, path)| {
        let print = fingerprint(&path).ok()?;
        let name = name.file_name()?.to_string_lossy().into_owned();
        Some(format!("{name} {print:016x}"))
    });
    files.collect()
}

/// The files that a shell command names: each word that is a file, except the target of a
/// redirection, and each program that the shell finds in `PATH`; with their fingerprints.
pub fn files_named(command: &str) -> BTreeMap<String, String> {
    let spaced = command.replace(['\'', '"', '(', ')', '`', '$'], " ");
    let spaced = [";", "|", "&", ">", "<"].iter().fold(spaced, |text, mark| {
        text.replace(mark, &format!(" {mark} "))
    });
    let (mut files, mut is_program, mut is_target) = (BTreeMap::new(), true, false);
    for word in spaced.split_whitespace() {
        match word {
            ";" | "|" | "&" => is_program = true,
            ">" => is_target = true,
            "<" => {}
            _ if core::mem::take(&mut is_target) => {}
            // An assignment before the program, or a word that starts another program.
            _ if is_program && (word.contains('=') || ["exec", "env"].contains(&word)) => {}
            _ => {
                let path = match is_program && !word.contains('/') {
                    true => in_path(word),
                    false => Some(PathBuf::from(word)).filter(|path| path.is_file()),
                };
                is_program = false;
                if let Some(print) = path.and_then(|path| fingerprint(&path).ok()) {
                    files.insert(word.to_owned(), format!("{print:016x}"));
                }
            }
        }
    }
    files
}

/// The first file of this name in `PATH`.
fn in_path(name: &str) -> Option<PathBuf> {
    let folders = env::var_os("PATH")?;
    let mut paths = env::split_paths(&folders).map(|folder| folder.join(name));
    paths.find(|path| path.is_file())
}

/// The script of an interpreter: the first argument that is a file and looks like one.
fn script_of(pid: i32) -> Option<PathBuf> {
    let words = fs::read(format!("/proc/{pid}/cmdline")).ok()?;
    let folder = PathBuf::from(format!("/proc/{pid}/cwd"));
    let words = words.split(|&byte| byte == 0).skip(1);
    let words = words.filter(|word| !word.is_empty() && !word.starts_with(b"-"));
    let mut files = words
        .map(|word| folder.join(String::from_utf8_lossy(word).as_ref()))
        .filter(|path| path.is_file());
    files.next().filter(|path| is_script(path))
}

fn is_script(path: &Path) -> bool {
    let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
    SCRIPTS.iter().any(|known| ending == *known) || head_of(path).is_ok_and(|head| &head == b"#!")
}

fn head_of(path: &Path) -> io::Result<[u8; 2]> {
    let mut head = [0; 2];
    File::open(path)?.read_exact(&mut head)?;
    Ok(head)
}

/// A fingerprint of a file's bytes and their number.
fn fingerprint(path: &Path) -> io::Result<u64> {
    let mut file = File::open(path)?.take(BYTES_MAX);
    let mut buf = vec![0; PIECE];
    let (mut print, mut all) = (FACTOR, 0_u64);
    loop {
        let mut len = 0;
        while len < PIECE {
            match file.read(&mut buf[len..])? {
                0 => break,
                more => len += more,
            }
        }
        all += len as u64;
        buf[len..].fill(0);
        for word in buf[..len.next_multiple_of(8)].chunks_exact(8) {
            let word = u64::from_le_bytes(word.try_into().unwrap_or_default());
            print = (print ^ word).wrapping_mul(FACTOR).rotate_left(29);
        }
        if len < PIECE {
            return Ok((print ^ all).wrapping_mul(FACTOR));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fingerprint_is_of_all_bytes() {
        let folder = env::temp_dir().join(format!("hilrig-print-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a free name");
        let path = folder.join("program");
        let mut prints = Vec::new();
        let long = vec![7; 2 * PIECE];
        let mut changed = long.clone();
        changed[PIECE + 9] ^= 1;
        let all = [
            &b""[..],
            b"\0",
            b"\0\0",
            b"12345678",
            b"123456780",
            &long,
            &changed,
        ];
        for bytes in all {
            fs::write(&path, bytes).expect("ours");
            prints.push(fingerprint(&path).expect("it is there"));
            assert_eq!(
                Some(&fingerprint(&path).expect("it is there")),
                prints.last()
            );
        }
        let count = prints.len();
        prints.sort_unstable();
        prints.dedup();
        assert_eq!(prints.len(), count);
        fs::remove_dir_all(&folder).expect("ours");
    }

    #[test]
    fn a_command_names_its_programs_and_its_files() {
        let exe = env::current_exe().expect("it runs");
        let exe = exe.to_str().expect("text");
        for (command, expected) in [
            (exe.to_owned(), vec![exe]),
            (format!("A=1 exec '{exe}' --fast /nowhere"), vec![exe]),
            (format!("sh -c \"{exe} 2>&1\""), vec![exe, "sh"]),
            (format!("sh 2>{exe}"), vec!["sh"]),
            (format!("cat sh | sh {exe}"), vec![exe, "cat", "sh"]),
            ("cd /; no-such-program sh".to_owned(), vec![]),
        ] {
            let found: Vec<String> = files_named(&command).into_keys().collect();
            assert_eq!(found, expected, "{command}");
        }
    }

    /// The test itself: its own executable, and no script.
    #[test]
    fn a_process_runs_its_executable() {
        let own = std::process::id().cast_signed();
        let files = files_of(own);
        let exe = env::current_exe().expect("it runs");
        let name = exe
            .file_name()
            .expect("a file")
            .to_string_lossy()
            .into_owned();
        assert!(files.len() == 1 && files[0].starts_with(&name), "{files:?}");
    }

    #[test]
    fn a_script_is_known_by_its_ending_or_its_first_line() {
        let folder = env::temp_dir().join(format!("hilrig-script-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a free name");
        for (name, text, expected) in [
            ("a.py", "", true),
            ("a.JAR", "", true),
            ("a", "#!/bin/sh", true),
            ("a.log", "# words", false),
            ("b", "", false),
        ] {
            fs::write(folder.join(name), text).expect("ours");
            assert_eq!(is_script(&folder.join(name)), expected, "{name}");
        }
        fs::remove_dir_all(&folder).expect("ours");
    }

    /// A shell that runs a script shows it among its arguments.
    #[test]
    fn a_process_runs_its_script() {
        let folder = env::temp_dir().join(format!("hilrig-runs-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a free name");
        fs::write(folder.join("wait.sh"), "echo; read line").expect("ours");
        fs::write(folder.join("words"), "no script").expect("ours");
        let files = |words: &[&str]| {
            let mut child = std::process::Command::new("sh")
                .args(words)
                .current_dir(&folder)
                .stdin(std::process::Stdio::piped())
                .stdout(std::process::Stdio::piped())
                .spawn()
                .expect("each system has it");
            // By then it has its arguments.
            let mut word = [0; 1];
            let said = child.stdout.as_mut().map(|out| out.read_exact(&mut word));
            said.expect("a pipe").expect("a line");
            let files = files_of(child.id().cast_signed());
            drop(child.stdin.take());
            child.wait().expect("it ends");
            let names: Vec<String> = files
                .iter()
                .map(|line| line.rsplit_once(' ').expect("two").0.to_owned())
                .collect();
            assert!(
                files
                    .iter()
                    .all(|line| line.len() > 17 && line.as_bytes()[line.len() - 17] == b' ')
            );
            names
        };
        let shell = files(&["-c", "echo; read line"]);
        assert_eq!(shell.len(), 1);
        assert_eq!(files(&["wait.sh", "words"]), [&shell[0], "wait.sh"]);
        assert_eq!(files(&["-e", "wait.sh"]), [&shell[0], "wait.sh"]);
        assert_eq!(
            files(&["-c", "echo; read line", "words", "wait.sh"]),
            [&*shell[0]],
            "the first file is none"
        );
        fs::remove_dir_all(&folder).expect("ours");
    }

    /// By hand: the product by 0x9E3779B97F4A7C15, rotated by 29 bits, for each eight bytes; then
    /// the length.
    #[test]
    fn a_fingerprint_is_that_of_its_rule() {
        let path = env::temp_dir().join(format!("hilrig-rule-{}", std::process::id()));
        let expected = |words: &[u64], len: u64| {
            let all = words.iter().fold(FACTOR, |print, word| {
                (print ^ word).wrapping_mul(FACTOR).rotate_left(29)
            });
            (all ^ len).wrapping_mul(FACTOR)
        };
        for (bytes, words) in [
            (&b""[..], &[][..]),
            (b"\x01", &[1]),
            (b"\x01\0\0\0\0\0\0\0", &[1]),
            (b"\x01\0\0\0\0\0\0\0\x02\x03", &[1, 0x302]),
        ] {
            fs::write(&path, bytes).expect("ours");
            assert_eq!(
                fingerprint(&path).expect("there"),
                expected(words, bytes.len() as u64)
            );
        }
        let whole = vec![0; PIECE];
        fs::write(&path, &whole).expect("ours");
        let words = vec![0; PIECE / 8];
        assert_eq!(
            fingerprint(&path).expect("there"),
            expected(&words, PIECE as u64)
        );
        fs::remove_file(&path).expect("ours");
    }
}
