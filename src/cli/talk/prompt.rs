//! A prompt with history and completion.

use std::env;
use std::path::{Path, PathBuf};

use description::Description;
use rustyline::completion::Completer;
use rustyline::config::Config;
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::history::FileHistory;
use rustyline::validate::Validator;
use rustyline::{Behavior, CompletionType, Context, Editor, Helper};

use crate::cli::CliError;

/// Words of the prompt besides requests.
const WORDS: [&str; 3] = ["help", "listen", "quit"];

/// The words that a device's prompt completes.
struct Words<'a>(&'a Description);

impl Completer for Words<'_> {
    type Candidate = String;

    fn complete(
        &self,
        line: &str,
        at: usize,
        _: &Context<'_>,
    ) -> rustyline::Result<(usize, Vec<String>)> {
        let line = &line[..at];
        let start = line.rfind(char::is_whitespace).map_or(0, |at| at + 1);
        let before: Vec<&str> = line[..start].split_whitespace().collect();
        let word = &line[start..];
        let mut words = self.0.completions(&before, word);
        if before.is_empty() {
            let own = WORDS.iter().filter(|own| own.starts_with(word));
            words.extend(own.map(|&own| own.to_owned()));
        }
        // A space follows each whole word.
        for word in words.iter_mut().filter(|word| !word.ends_with('=')) {
            word.push(' ');
        }
        Ok((start, words))
    }
}

impl Hinter for Words<'_> {
    type Hint = String;
}

impl Highlighter for Words<'_> {}
impl Validator for Words<'_> {}
impl Helper for Words<'_> {}

/// The prompt of a device.
pub(super) struct Prompt<'a> {
    editor: Editor<Words<'a>, FileHistory>,
    /// The file of earlier lines, one for each description.
    history: Option<PathBuf>,
    text: String,
}

impl<'a> Prompt<'a> {
    /// A prompt on the terminal, with the lines of earlier sessions.
    pub(super) fn open(description: &'a Description) -> Result<Self, CliError> {
        let config = Config::builder()
            // Standard output is for replies.
            .behavior(Behavior::PreferTerm)
            .completion_type(CompletionType::List)
            .auto_add_history(true)
            .build();
        let history = FileHistory::with_config(&config);
        let mut editor = Editor::with_history(config, history)
            .map_err(|error| CliError::Usage(format!("the terminal: {error}")))?;
        editor.set_helper(Some(Words(description)));
        let history = history_file(description.name());
        if let Some(path) = &history {
            // Without a readable file, the history begins with this session.
            let _ = editor.load_history(path);
        }
        let text = format!("{}> ", description.name());
        Ok(Self {
            editor,
            history,
            text,
        })
    }

    /// The next line; `None` at Ctrl-D or Ctrl-C.
    pub(super) fn line(&mut self) -> Result<Option<String>, CliError> {
        match self.editor.readline(&self.text) {
            Ok(line) => Ok(Some(line)),
            Err(ReadlineError::Eof | ReadlineError::Interrupted) => Ok(None),
            Err(error) => Err(CliError::Usage(format!("the terminal: {error}"))),
        }
    }

    /// Writes the lines of this session to the history.
    pub(super) fn keep(&mut self) {
        let Some(path) = &self.history else {
            return;
        };
        let kept = safefs::create_parent(path).map_err(ReadlineError::Io);
        let kept = kept.and_then(|()| self.editor.append_history(path));
        if let Err(error) = kept {
            eprintln!("the history was not kept: {}: {error}", path.display());
        }
    }
}

/// The file of earlier lines, in the user's folder of states.
fn history_file(name: &str) -> Option<PathBuf> {
    let named = |variable: &str| {
        let path = env::var_os(variable).map(PathBuf::from);
        path.filter(|path| path.is_absolute())
    };
    let base = named("XDG_STATE_HOME").or_else(|| Some(named("HOME")?.join(".local/state")))?;
    Some(
        base.join(Path::new("hilrig/talk"))
            .join(format!("{name}.history")),
    )
}
