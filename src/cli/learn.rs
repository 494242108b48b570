use std::path::PathBuf;

use clap::Args;

use super::answer::{ClaimTold, Learned};
use super::decode::source::Source;
use super::{CliError, Verdict, out};
use crate::capture::import::Format;
use crate::search::learn::{Confidence, Proposal};

/// Propose a description of an unknown device from captured bytes.
///
/// The command tries to split the bytes into frames by terminators, stuffing, sync bytes with a
/// length field or a fixed size, and silences. It tries each algorithm of the CRC catalogue and
/// the common sums over the likely ranges. It finds counters, constant bytes, formats of text
/// lines, and pairs of request and reply. Each claim is printed with its evidence and is sure or a
/// guess. The draft is a description that decodes the capture.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig learn field.pcapng -o learned.toml\n  \
    hilrig learn field.pcapng --link meter      # one link of several\n  \
    hilrig learn dump.hex                       # other tools' dumps, as hilrig import reads them\n  \
    hilrig decode field.pcapng --description learned.toml\n\n\
    Exit codes: 0 a draft was made, 1 nothing can be claimed, 2 usage or set-up.")]
pub(super) struct LearnArgs {
    /// A capture, or a dump of another tool
    #[arg(value_name = "CAPTURE")]
    file: PathBuf,
    /// The link to learn from [default: the only one]
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Format of a file that is not a capture [default: recognised]
    #[arg(long)]
    format: Option<Format>,
    /// Write the draft to this file [default: print it]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub(super) fn run(args: &LearnArgs) -> Result<Verdict, CliError> {
    let source = Source::read(&args.file, args.format)?;
    let proposal = Proposal::of(&source.capture, args.link.as_deref());
    let proposal = proposal.map_err(|error| CliError::content(&args.file, error))?;
    for claim in &proposal.claims {
        eprintln!("{claim}");
    }
    let [covered, all] = proposal.covered;
    let claims = proposal.claims.iter().map(|claim| ClaimTold {
        topic: claim.topic.to_owned(),
        words: claim.words.clone(),
        evidence: claim.evidence.clone(),
        sure: claim.confidence == Confidence::Sure,
    });
    out::answer(&Learned {
        claims: claims.collect(),
        bytes: all as u64,
        framed: covered as u64,
        draft: proposal.draft.clone(),
    });
    let Some(draft) = &proposal.draft else {
        eprintln!("nothing can be claimed of {all} bytes: no frame format fits them");
        return Ok(Verdict::Fail);
    };
    eprintln!("{covered} of {all} bytes are in frames of the draft");
    match &args.output {
        Some(path) => {
            let shown = path.display();
            safefs::write(path, draft)
                .map_err(|error| CliError::write(format!("--output {shown}"), error))?;
            println!("{shown}");
        }
        None => print!("{draft}"),
    }
    Ok(Verdict::Pass)
}
