//! Conclusion of a recorded run: its verdict, in a block at the end of the capture.
//!
//! A pcapng custom block, which other tools skip:
//!
//! ```text
//! | enterprise 4 | "hcon" | facts as key=value, one a line | 0 | scenario as it was run, TOML |
//! ```

use std::io::{self, Write as _};
use std::path::Path;

use protocols::Instant;

use crate::pcapng::{self, Block};
use crate::record::ENTERPRISE;
use engine::run::Outcome;
use engine::run::check::{Check, Status};

/// Mark of the conclusion in a custom block.
const MARK: &[u8; 4] = b"hcon";

/// The end of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Conclusion {
    /// Facts as `key=value`, one a line: `verdict`, `end_ns`, `program`, `failed`.
    pub facts: String,
    /// The scenario with the exact hits of its faults, so that a second run gives the same bytes.
    pub case: String,
}

impl Conclusion {
    /// Conclusion of `outcome`; `command` is the command of the foreign program, if there was one.
    pub fn of(outcome: &Outcome, command: Option<&str>) -> Self {
        let verdict = if outcome.passed() { "pass" } else { "fail" };
        let failed = |check: &&Check| check.status == Status::Fail;
        let failed = outcome.checks.iter().filter(failed);
        let failed = failed.chain(outcome.unobserved_rules());
        let failed: Vec<&str> = failed.map(|check| &*check.name).collect();
        let program = match command {
            Some(command) => format!("exec\ncommand={}", command.replace('\n', " ")),
            None => "own".to_owned(),
        };
        let (end, failed) = (outcome.ran.as_nanos(), failed.join(","));
        let facts = format!("verdict={verdict}\nend_ns={end}\nprogram={program}\nfailed={failed}");
        let case = outcome.case.to_toml();
        Self { facts, case }
    }

    /// Returns the value of the fact `key`.
    pub fn fact(&self, key: &str) -> Option<&str> {
        let mut facts = self.facts.lines().filter_map(|line| line.split_once('='));
        facts.find(|(name, _)| *name == key).map(|(_, value)| value)
    }

    /// Whether the client was a foreign program.
    pub fn is_foreign(&self) -> bool {
        self.fact("program") == Some("exec")
    }

    /// The failed checks; `None` if the run passed.
    pub fn failed(&self) -> Option<Vec<&str>> {
        let failed = self.fact("failed").unwrap_or_default().split(',');
        (self.fact("verdict") == Some("fail"))
            .then(|| failed.filter(|name| !name.is_empty()).collect())
    }

    /// Time of the end of the run, since its beginning.
    pub fn end(&self) -> Option<Instant> {
        let end = self.fact("end_ns")?.parse().ok()?;
        Some(Instant::from_nanos(end))
    }

    /// Appends this block to the capture at `path`.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn append(&self, path: &Path) -> io::Result<()> {
        let mut block = Vec::new();
        self.write(&mut block);
        safefs::append(path)?.write_all(&block)
    }

    /// Appends this block to `out`.
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        pcapng::write_block(out, pcapng::CUSTOM_BLOCK, |out| {
            out.extend_from_slice(&ENTERPRISE.to_le_bytes());
            out.extend_from_slice(MARK);
            out.extend_from_slice(self.facts.as_bytes());
            out.push(0);
            out.extend_from_slice(self.case.as_bytes());
        });
    }

    /// Reads a conclusion; `None` if `block` is another kind of block.
    pub(super) fn read(block: &Block) -> Option<Self> {
        let body = &block.body;
        let is_ours = block.order.u32_at(body, 0)? == ENTERPRISE && body.get(4..8)? == MARK;
        let text = String::from_utf8_lossy(body.get(8..).filter(|_| is_ours)?).into_owned();
        let (facts, case) = text.split_once('\0')?;
        Some(Self {
            facts: facts.to_owned(),
            case: case.trim_end_matches('\0').to_owned(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Capture, Section};

    fn conclusion() -> Conclusion {
        Conclusion {
            facts: "verdict=fail\nend_ns=20000000000\nprogram=exec\ncommand=a=b\nfailed=x,y"
                .to_owned(),
            case: "schema = 1\n".to_owned(),
        }
    }

    #[test]
    fn a_capture_knows_how_its_run_ended() {
        let mut bytes = Vec::new();
        Section::default().write(&mut bytes);
        conclusion().write(&mut bytes);
        let capture = Capture::of(&bytes);
        assert_eq!((capture.skipped, capture.cut, capture.broken), (0, 0, None));
        let read = capture.conclusion.expect("it was written");
        assert_eq!(read, conclusion());
        assert!(read.is_foreign() && read.end() == Some(Instant::from_secs(20)));
        assert_eq!(
            (read.fact("command"), read.failed()),
            (Some("a=b"), Some(vec!["x", "y"]))
        );
    }

    /// The reader skips and counts the custom block of another tool.
    #[test]
    fn a_custom_block_of_another_tool_is_none() {
        let mut bytes = Vec::new();
        Section::default().write(&mut bytes);
        pcapng::write_block(&mut bytes, pcapng::CUSTOM_BLOCK, |out| out.extend([1; 16]));
        let capture = Capture::of(&bytes);
        assert_eq!((capture.conclusion, capture.skipped), (None, 1));
    }
}
