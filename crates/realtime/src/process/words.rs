//! Output of a program: the last part in memory, the whole output in a file up to a size.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{Read, Write};
use std::sync::{Arc, Mutex};

/// Maximum number of bytes in memory, from the end of the output.
const KEPT_MAX: usize = 64 << 10;
/// Maximum number of bytes in the file, from the beginning; of the rest only the end is written.
pub(crate) const LOG_MAX: u64 = 8 << 20;

/// Output so far.
#[derive(Debug, Default)]
pub(crate) struct Words {
    kept: VecDeque<u8>,
    log: Option<File>,
    said: u64,
}

impl Words {
    pub(crate) fn new(log: Option<File>) -> Arc<Mutex<Self>> {
        Arc::new(Mutex::new(Self {
            log,
            ..Self::default()
        }))
    }

    /// The last part of the output.
    pub(crate) fn text(&self) -> String {
        let bytes: Vec<u8> = self.kept.iter().copied().collect();
        String::from_utf8_lossy(&bytes).into_owned()
    }

    fn receive(&mut self, bytes: &[u8]) {
        self.kept.extend(bytes);
        let excess = self.kept.len().saturating_sub(KEPT_MAX);
        self.kept.drain(..excess);
        let room = usize::try_from(LOG_MAX.saturating_sub(self.said)).unwrap_or(usize::MAX);
        if let Some(log) = &mut self.log {
            // A full disk must not stop the program; the verdict does not depend on its output.
            let _ = log.write_all(&bytes[..bytes.len().min(room)]);
        }
        self.said += bytes.len() as u64;
    }

    /// Completes the file. If the output was too long for the file, its end is appended.
    pub(crate) fn close(&mut self) {
        let Some(mut log) = self.log.take() else {
            return;
        };
        let beyond = self.said.saturating_sub(LOG_MAX);
        if beyond == 0 {
            return;
        }
        let end = usize::try_from(beyond).map_or(KEPT_MAX, |len| len.min(KEPT_MAX));
        let cut = beyond - end as u64;
        let end: Vec<u8> = self.kept.range(self.kept.len() - end..).copied().collect();
        let note = format!("\n[hilrig: {cut} bytes omitted here, the limit is {LOG_MAX}]\n");
        let _ = log.write_all(note.as_bytes());
        let _ = log.write_all(&end);
    }
}

/// Collects the output until the last writer closes the pipe.
pub(crate) fn listen(mut from: impl Read, words: &Mutex<Words>) {
    let mut buf = [0; 4096];
    loop {
        match from.read(&mut buf) {
            Ok(len @ 1..) => {
                let Ok(mut words) = words.lock() else { return };
                words.receive(&buf[..len]);
            }
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            _ => return,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program with too much output: the file has its beginning and its end, and the number of
    /// missing bytes between them.
    #[test]
    fn a_log_that_grows_too_long_keeps_its_beginning_and_its_end() {
        let path = std::env::temp_dir().join(format!("hilrig-words-{}", std::process::id()));
        let words = Words::new(Some(File::create(&path).expect("a free name")));
        {
            let mut words = words.lock().expect("sound");
            words.receive(b"first words\n");
            for _ in 0..LOG_MAX / 4096 + 64 {
                words.receive(&[b'x'; 4096]);
            }
            words.receive(b"last words\n");
            words.close();
        }
        let text = std::fs::read_to_string(&path).expect("written");
        std::fs::remove_file(&path).expect("ours");
        assert!(text.starts_with("first words\n"));
        assert!(text.ends_with("last words\n"));
        assert!(text.contains("bytes omitted here"));
        assert!(text.len() as u64 <= LOG_MAX + KEPT_MAX as u64 + 100);
    }
}
