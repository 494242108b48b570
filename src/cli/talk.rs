mod prompt;

use std::io::{self, BufRead as _, IsTerminal as _};
use std::path::{Path, PathBuf};

use clap::Args;
use description::Description;
use description::peer::{Peer, Speaker};
use description::speak::Request;

use super::answer::{Exchanged, RepliedWith, Talked, ValueTold};
use super::port::PortPeer;
use super::{CliError, Verdict, described, out};
use crate::scenario::Span;
use prompt::Prompt;

/// Send requests to a device, and print its replies by the names of its description.
///
/// A request is a message with its fields, or for Modbus `read NAME` and `write NAME=VALUE`. The
/// command prints the reply in words with its latency. Without a request the command reads requests
/// from standard input, one per line; `help` lists them.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig talk /dev/ttyUSB0 --description meter.toml read voltage\n  \
    hilrig talk /dev/ttyUSB0 --description meter.toml write alarm_voltage=251\n  \
    hilrig talk --rig /tmp/rig meter --description modbus-meter   # interactive\n  \
    echo 'heat percent=40' | hilrig talk /dev/ttyUSB0 --description cobs-sensor\n\n\
    Exit codes: 0 every request was answered, 1 one was not or was refused, 2 usage or set-up.")]
pub(super) struct TalkArgs {
    /// Serial port of the device; with --rig the name of a link
    #[arg(value_name = "PORT|LINK")]
    port: String,
    /// Directory in which `hilrig up` offers the ports
    #[arg(long, value_name = "DIR")]
    rig: Option<PathBuf>,
    /// Description: one that comes with the tool, by its name, or a file that ends with .toml
    #[arg(long, value_name = "NAME|FILE")]
    description: String,
    /// Address of the device, if it is not the described one
    #[arg(long, value_name = "N")]
    address: Option<u32>,
    /// Time within which a reply must begin
    #[arg(long, value_name = "TIME", default_value = "1s")]
    timeout: Span,
    /// The request: a message and FIELD=VALUE for its fields
    #[arg(value_name = "REQUEST")]
    request: Vec<String>,
}

pub(super) fn run(args: &TalkArgs) -> Result<Verdict, CliError> {
    let description = described::load_at(&args.description, args.address)?;
    let path = match &args.rig {
        Some(dir) => dir.join(&args.port),
        None => Path::new(&args.port).to_owned(),
    };
    let words: Vec<&str> = args.request.iter().map(String::as_str).collect();
    // A wrong request is reported before the port is opened.
    let requests = match words.is_empty() {
        true => Vec::new(),
        false => read_request(&description, &words)?,
    };
    let peer = PortPeer::open(&path, description.line())?;
    let mut talk = Talk {
        speaker: Speaker::new(&description),
        description: &description,
        peer,
        timeout: args.timeout,
        told: Talked::default(),
        has_failed: false,
    };
    match words.is_empty() {
        true => talk.listen_to_lines()?,
        false => talk.ask_all(&requests)?,
    }
    out::answer(&talk.told);
    Ok(if talk.has_failed {
        Verdict::Fail
    } else {
        Verdict::Pass
    })
}

fn read_request(description: &Description, words: &[&str]) -> Result<Vec<Request>, CliError> {
    description.requests(words).map_err(CliError::Usage)
}

struct Talk<'a> {
    description: &'a Description,
    speaker: Speaker<'a>,
    peer: PortPeer,
    timeout: Span,
    told: Talked,
    has_failed: bool,
}

/// The result of a line.
enum Line {
    Done,
    /// The session ends.
    End,
    Wrong(CliError),
}

impl Talk<'_> {
    /// Reads requests from a terminal or a script. A wrong line is reported; a script ends with it.
    fn listen_to_lines(&mut self) -> Result<(), CliError> {
        if io::stdin().is_terminal() {
            let name = self.description.name();
            eprintln!("{name}: type a request, \"help\" or \"quit\"; Tab completes words");
            let mut prompt = Prompt::open(self.description)?;
            while let Some(line) = prompt.line()? {
                match self.obey(&line)? {
                    Line::Done => {}
                    Line::End => break,
                    Line::Wrong(error) => eprintln!("{error}"),
                }
            }
            prompt.keep();
            return Ok(());
        }
        for line in io::stdin().lock().lines() {
            let line = line.map_err(|error| CliError::read(Path::new("standard input"), error))?;
            match self.obey(&line)? {
                Line::Done => {}
                Line::End => break,
                Line::Wrong(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Executes a line. An error means that the port is gone.
    fn obey(&mut self, line: &str) -> Result<Line, CliError> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match &words[..] {
            [] => {}
            [word, ..] if word.starts_with('#') => {}
            ["quit" | "exit"] => return Ok(Line::End),
            ["help"] => {
                for phrase in self.description.phrases() {
                    eprintln!("  {phrase}");
                }
                eprintln!("  listen TIME");
            }
            ["listen", time] => match time.parse() {
                Ok(time) => self.listen(time)?,
                Err(error) => return Ok(Line::Wrong(CliError::Usage(error))),
            },
            words => match read_request(self.description, words) {
                Ok(requests) => self.ask_all(&requests)?,
                Err(error) => return Ok(Line::Wrong(error)),
            },
        }
        Ok(Line::Done)
    }

    fn ask_all(&mut self, requests: &[Request]) -> Result<(), CliError> {
        requests.iter().try_for_each(|request| self.ask(request))
    }

    fn ask(&mut self, request: &Request) -> Result<(), CliError> {
        let description = self.description;
        let mut is_last = |frame: &_| description.reply(request, frame).is_asked;
        let time = match request.is_answered() {
            true => self.timeout.0,
            // Received messages are printed without waiting.
            false => self.timeout.0.min(description.idle()),
        };
        let peer: &mut dyn Peer = &mut self.peer;
        let heard = self
            .speaker
            .exchange(peer, &request.bytes, time, &mut is_last);
        let heard = heard.map_err(CliError::Usage)?;
        let mut exchanged = Exchanged {
            request: request.words.clone(),
            replies: Vec::new(),
            unasked: Vec::new(),
        };
        for (latency, frame) in &heard.frames {
            let reply = description.reply(request, frame);
            if !reply.is_asked {
                println!("(by itself) {}", reply.words);
                exchanged.unasked.push(reply.words);
                continue;
            }
            let latency_ms = latency.as_secs_f64() * 1e3;
            println!("{}   ({latency_ms:.1} ms)", reply.words);
            self.has_failed |= reply.is_refusal;
            let values = reply.values.into_iter();
            let values = values.map(|(name, value, words)| ValueTold {
                name,
                number: value.as_f64().filter(|number| number.is_finite()),
                words,
            });
            exchanged.replies.push(RepliedWith {
                words: reply.words,
                refused: reply.is_refusal,
                latency_ms,
                values: values.collect(),
            });
        }
        if exchanged.replies.is_empty() && request.is_answered() {
            self.has_failed = true;
            let stray = match heard.stray {
                0 => String::new(),
                bytes => format!("; {bytes} bytes arrived that are no frame"),
            };
            println!("{}: no reply within {}{stray}", request.words, self.timeout);
        }
        self.told.exchanges.push(exchanged);
        Ok(())
    }

    /// Prints unsolicited messages of the device.
    fn listen(&mut self, time: Span) -> Result<(), CliError> {
        let peer: &mut dyn Peer = &mut self.peer;
        let heard = self.speaker.exchange(peer, &[], time.0, &mut |_| false);
        for (at, frame) in heard.map_err(CliError::Usage)?.frames {
            let words = self.description.words(&frame);
            println!("{:.3} s {words}", at.as_secs_f64());
        }
        Ok(())
    }
}
