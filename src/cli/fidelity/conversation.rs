//! A device of any kind beside a capture of the real one.

use std::path::Path;

use description::peer::Emulated;
use emulators::figure::Comparison;

use super::{Fidelity, compared, ledger, print_rows};
use crate::capture::likeness;
use crate::capture::replay::{Passage, Recorded};
use crate::cli::answer::Figures;
use crate::cli::decode::source::Source;
use crate::cli::{CliError, Verdict, described, out};
use crate::scenario::{Scenario, device};

/// Allowed difference of a latency: a driver of an adapter may hold bytes back for 16 ms.
const SLACK: core::time::Duration = core::time::Duration::from_millis(20);

pub(super) fn compare(args: &Fidelity, name: &str, capture: &Path) -> Result<Verdict, CliError> {
    let (peer, kind) = emulated(args, name)?;
    let source = Source::read(capture, None)?;
    if source.start.is_none() {
        let what = "the file has no times: figures of a conversation need them";
        return Err(CliError::content(capture, what.to_owned()));
    }
    let recorded = Recorded::of(&source.capture, None);
    let passage = passage(&recorded, args.link.as_deref(), capture)?;
    let mut peer = peer.paced().bytewise();
    let slack = args.slack.map_or(SLACK, |slack| slack.0);
    let found = likeness::compare(passage, &mut peer, slack).map_err(CliError::Usage)?;
    out::answer(&Figures {
        figures: found.figures.iter().map(compared).collect(),
        constants: found.constants.clone(),
        ledger: ledger::rows(Some(&kind)),
        ..Figures::default()
    });
    print_rows(&found.figures, ["capture", "emulated"]);
    for constant in &found.constants {
        println!("{constant}");
    }
    let judged = found.figures.iter().filter_map(Comparison::holds);
    let (count, differ) = judged.fold((0, 0), |(count, differ), holds| {
        (count + 1, differ + usize::from(!holds))
    });
    match count {
        0 => println!("nothing was compared: the device sends no byte in the capture"),
        _ => println!("{count} figures judged, {differ} differ"),
    }
    Ok(if found.holds() {
        Verdict::Pass
    } else {
        Verdict::Fail
    })
}

/// The emulated device, and its kind in the ledger.
fn emulated(args: &Fidelity, name: &str) -> Result<(Emulated, String), CliError> {
    let seed = args.seed();
    if name.ends_with(".toml") && is_scenario(Path::new(name))? {
        let (scenario, source) = Scenario::read(Path::new(name))?;
        let device = described::device_name(&scenario, args.link.as_deref())?;
        let peer = described::emulated((&scenario, &source), &device, seed)?;
        let spec = scenario.device.get(&device);
        let kind = spec.map_or(String::new(), |spec| spec.kind().to_owned());
        return Ok((peer, kind));
    }
    if device::kind(name).is_some() {
        let text = format!(
            "schema = 1\nname = \"bench\"\nrobot = \"none\"\nduration = \"1s\"\n\
             [device.{name}.{name}]\n"
        );
        let (scenario, source) = Scenario::parse(Path::new(name), text)?;
        return Ok((
            described::emulated((&scenario, &source), name, seed)?,
            name.to_owned(),
        ));
    }
    let description = described::load("DEVICE", name)?;
    let peer = description::conform::emulated(&description, seed);
    Ok((peer, "description".to_owned()))
}

/// Whether the file is a scenario: it has a robot.
fn is_scenario(path: &Path) -> Result<bool, CliError> {
    let text = crate::cli::read(path)?;
    let table = String::from_utf8_lossy(&text).parse::<toml::Table>();
    Ok(table.is_ok_and(|table| table.contains_key("robot")))
}

/// The link of the capture: `name`, or the only one with bytes.
fn passage<'a>(
    recorded: &'a Recorded,
    name: Option<&str>,
    path: &Path,
) -> Result<&'a Passage, CliError> {
    let links = recorded.links.iter();
    let speaking: Vec<&Passage> = links.filter(|link| !link.arrivals.is_empty()).collect();
    match (&speaking[..], name) {
        ([only], _) => Ok(*only),
        ([], _) => {
            let what = "no byte from a device; captures have directions, see hilrig import --help";
            Err(CliError::content(path, what.to_owned()))
        }
        (many, name) => {
            let named = many.iter().find(|link| Some(&*link.link) == name);
            let names: Vec<&str> = many.iter().map(|link| &*link.link).collect();
            named.copied().ok_or_else(|| {
                let known = names.join(", ");
                CliError::Usage(format!(
                    "--link: expected a link of {}: {known}",
                    path.display()
                ))
            })
        }
    }
}
