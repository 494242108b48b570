//! Words of the commands that are printed for the user to copy.

use std::path::Path;

/// `text` as one word for a shell, in quotes.
pub fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// `path` as one word for a shell: in quotes if it contains a blank or a special character.
pub fn word(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./,:@%+=".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text,
        false => quoted(&text),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A shell splits the printed words into the original ones.
    #[test]
    fn a_shell_reads_the_words_back() {
        for text in [
            "a/b.toml",
            "mein Gerät.toml",
            "it's $HOME",
            "a;b",
            "*",
            "\"",
            "\\",
            "~x",
            "#",
        ] {
            let line = format!("printf '%s|' {} {}", word(Path::new(text)), quoted(text));
            let shell = std::process::Command::new("sh")
                .args(["-c", &line])
                .output();
            let said = shell.expect("a shell").stdout;
            assert_eq!(String::from_utf8_lossy(&said), format!("{text}|{text}|"));
        }
    }
}
