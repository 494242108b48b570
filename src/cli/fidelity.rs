mod conversation;
pub(super) mod ledger;

use std::path::{Path, PathBuf};

use clap::Args;
use emulators::figure::{Comparison, Limit};
use emulators::xv11::Profile;
use emulators::xv11::fidelity::{Column, Told, blind, compare, hand_in_box};

use super::answer::{FigureCompared, Figures, GroupTold};
use super::decode::source::{Lane, Source, lanes};
use super::{CliError, Verdict, out};
use crate::codec::{XV11, XV11_TURN};
use crate::scenario::Span;

/// Compare an emulated device with the real one, figure by figure.
///
/// Without --capture, the command prints the ledger: the document, capture, client or chip that
/// judges each device, what agrees and how closely, and what cannot be checked.
///
/// With --capture, the emulated device gets the requests of the capture at their times. Replies,
/// lengths, latencies, periods and rates of both are compared. Bytes that never change in the
/// capture are shown if the emulated ones differ: a serial number may, a constant may not.
///
/// `xv11` has figures of its own: error codes, encoder, strength, noise, coast-down, restart. The
/// emulated sensor is in a box 1 m wide, a hand moves in it for 24 s, then the motor is cut, the
/// head coasts down and stalls, the firmware restarts. The only public capture shows the same
/// sequence (firmware 2.4.13386, 252,146 bytes). Other captures are accepted too, with packets or
/// with firmware 2.1's whole turns; they agree only as far as their sequence is similar. A blind
/// test follows: the emulated sensor is put into the room of the capture, and a plain classifier
/// tries to distinguish windows of two turns of both streams. 50 % is chance. Packets, distances
/// and strengths are judged: an accuracy above 60 %, or above 50 % and three standard errors, is a
/// difference. A group that cannot be compared, or has fewer than 40 windows to compare, fails too.
/// Tooth speeds and codes depend on the ring of a unit and are only shown.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig fidelity                                      # the ledger of all devices\n  \
    hilrig fidelity hc06                                 # the rows of one device\n  \
    hilrig fidelity meter.toml --capture field.pcapng    # your described device\n  \
    hilrig fidelity bench.toml --link scale --capture scale.log   # a device of a scenario\n  \
    hilrig fidelity rplidar --capture lidar.pcapng       # a built-in device\n  \
    hilrig fidelity xv11                                 # against the published figures\n  \
    hilrig fidelity xv11 --capture hand_in_box.bin       # against a capture's own figures\n  \
    hilrig fidelity xv11 --capture mine.bin --against none\n\n\
    Exit codes: 0 all judged figures agree, 1 one differs or none was compared, 2 usage or set-up.")]
pub(super) struct Fidelity {
    /// Device: a kind of the ledger, a described device by its name or file, or a scenario
    #[arg(value_name = "DEVICE|FILE")]
    device: Option<String>,
    /// Bytes recorded from a real device: a capture, or a file that `hilrig import` reads
    #[arg(long, value_name = "FILE", requires = "device")]
    capture: Option<PathBuf>,
    /// Device of the scenario, and link of the capture [default: the only one]
    #[arg(long, value_name = "NAME", requires = "capture")]
    link: Option<String>,
    /// Allowed difference of a latency, if it is more than a fifth [default: 20ms]
    #[arg(long, value_name = "TIME", requires = "capture")]
    slack: Option<Span>,
    /// xv11: second column: `emulated`, another capture, or `none` [default: emulated]
    #[arg(long, value_name = "FILE|emulated|none", requires = "device")]
    against: Option<PathBuf>,
    /// xv11: firmware of the emulated sensor [default: fw2.1 for a capture of whole turns, else
    /// fw2.4.13386]
    #[arg(long, value_name = "NAME", requires = "device",
          value_parser = Profile::ALL.map(Profile::name))]
    profile: Option<String>,
    /// Seed of the emulated device's noise [default: 1]
    #[arg(long, value_name = "N", requires = "device")]
    seed: Option<u64>,
    /// Print the ledger as Markdown, for docs/fidelity.md
    #[arg(long, conflicts_with_all = ["capture", "against", "profile", "seed"])]
    markdown: bool,
}

impl Fidelity {
    fn seed(&self) -> u64 {
        self.seed.unwrap_or(1)
    }

    /// The first of the given options that the device does not have.
    fn refuse(&self, device: &str, options: &[(&str, bool)]) -> Result<(), CliError> {
        let given = options.iter().find(|(_, is_given)| *is_given);
        match given {
            None => Ok(()),
            Some((option, _)) => Err(CliError::Usage(format!(
                "{option} has no effect on {device:?}; see hilrig fidelity --help"
            ))),
        }
    }
}

pub(super) fn run(args: &Fidelity) -> Result<Verdict, CliError> {
    let of_lidar = [
        ("--against", args.against.is_some()),
        ("--profile", args.profile.is_some()),
    ];
    match (args.device.as_deref(), &args.capture) {
        (Some("xv11"), _) if !args.markdown => {
            let of_others = [
                ("--link", args.link.is_some()),
                ("--slack", args.slack.is_some()),
            ];
            args.refuse("xv11", &of_others)?;
            compare_lidars(args)
        }
        (Some(device), Some(capture)) => {
            args.refuse(device, &of_lidar)?;
            conversation::compare(args, device, capture)
        }
        (device, None) => {
            args.refuse(device.unwrap_or_default(), &of_lidar)?;
            args.refuse(
                device.unwrap_or_default(),
                &[("--seed", args.seed.is_some())],
            )?;
            print_ledger(device, args.markdown)
        }
        (None, Some(_)) => Err(CliError::Usage("--capture needs a DEVICE".to_owned())),
    }
}

/// Prints the ledger, limited to `device` if given.
fn print_ledger(device: Option<&str>, is_markdown: bool) -> Result<Verdict, CliError> {
    let rows = ledger::rows(device);
    if rows.is_empty() {
        let (device, known) = (device.unwrap_or_default(), ledger::devices().join(", "));
        return Err(CliError::Usage(format!(
            "unknown device {device:?}; expected one of {known}; a described device or a scenario \
             needs --capture"
        )));
    }
    let page = match is_markdown {
        true => ledger::markdown(&rows),
        false => ledger::text(&rows),
    };
    out::answer(&Figures {
        ledger: rows,
        ..Figures::default()
    });
    print!("{page}");
    Ok(Verdict::Pass)
}

/// The figure of a stream of firmware 2.1.
const TURNS: &str = "turns of 1446 bytes";
/// Windows of the capture below which chance decides.
const WINDOWS_MIN: usize = 40;

fn compare_lidars(args: &Fidelity) -> Result<Verdict, CliError> {
    let against = args.against.as_deref().unwrap_or(Path::new("emulated"));
    let bytes = args.capture.as_deref().map(read).transpose()?;
    let (real_name, real) = match &bytes {
        Some(bytes) => ("capture", Column::of(bytes)),
        None => ("published", Column::published()),
    };
    // Only firmware 2.1 sends whole turns.
    let sends_turns = real.value("packets").is_none_or(|count| count < 1.0)
        && real.value(TURNS).is_some_and(|count| count >= 1.0);
    let usual = if sends_turns { "fw2.1" } else { "fw2.4.13386" };
    let name = args.profile.as_deref().unwrap_or(usual);
    let profile =
        Profile::from_name(name).ok_or_else(|| CliError::Usage(format!("--profile {name}")))?;
    let (ours_name, ours) = match against.to_str() {
        Some("none") => ("", None),
        Some("emulated") => {
            let bytes = hand_in_box(profile, args.seed());
            ("emulated", Some(Column::of(&bytes)))
        }
        _ => ("against", Some(Column::of(&read(against)?))),
    };
    let told = match &bytes {
        Some(bytes) if ours_name == "emulated" => blind(bytes, profile, args.seed()),
        _ => None,
    };
    let rows = compare(&real, ours.as_ref().unwrap_or(&Column::default()));
    out::answer(&Figures {
        figures: rows.iter().map(compared).collect(),
        blind: told.iter().flatten().map(group_told).collect(),
        constants: Vec::new(),
        ledger: ledger::rows(Some("xv11")),
    });
    if ours.is_none() {
        for row in &rows {
            println!("{:<40}  {:>10}  {}", row.name, figure(row.real), row.unit);
        }
        return Ok(Verdict::Pass);
    }
    print_rows(&rows, [real_name, ours_name]);
    let judged = rows.iter().filter(|row| row.holds().is_some()).count();
    let differ = rows.iter().filter(|row| row.holds() == Some(false)).count();
    println!("{judged} figures judged, {differ} differ");
    let is_blind = bytes.is_some() && ours_name == "emulated";
    let fails = match &told {
        Some(told) => {
            print_blind(told);
            told.iter().any(|told| verdict_of(told).fails())
        }
        None if is_blind => {
            println!("blind test: not compared, fewer than 8 steady turns");
            true
        }
        None => false,
    };
    Ok(match differ == 0 && !fails {
        true => Verdict::Pass,
        false => Verdict::Fail,
    })
}

fn print_rows(rows: &[Comparison], [real_name, ours_name]: [&str; 2]) {
    let head = ["figure", real_name, ours_name, "unit", "allowed", "verdict"];
    print_line(head.map(str::to_owned));
    for row in rows {
        print_line([
            row.name.clone(),
            figure(row.real),
            figure(row.ours),
            row.unit.to_owned(),
            allowed(row.limit),
            verdict(row).to_owned(),
        ]);
    }
}

/// Verdict on a group of the blind test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Blind {
    Hidden,
    Told,
    /// The figures depend on the ring of teeth of a unit.
    NotJudged,
    NotCompared,
    TooFewWindows,
}

impl Blind {
    fn fails(self) -> bool {
        matches!(self, Self::Told | Self::NotCompared | Self::TooFewWindows)
    }

    const fn words(self) -> &'static str {
        match self {
            Self::Hidden => "ok",
            Self::Told => "TOLD",
            Self::NotJudged => "not judged: differs between units",
            Self::NotCompared => "NOT COMPARED: too little is seen",
            Self::TooFewWindows => "NOT COMPARED: too few windows",
        }
    }
}

fn verdict_of(told: &Told) -> Blind {
    match told.accuracy {
        _ if told.is_of_the_unit => Blind::NotJudged,
        None => Blind::NotCompared,
        _ if told.windows[0] < WINDOWS_MIN => Blind::TooFewWindows,
        Some(accuracy) if accuracy <= told.limit() => Blind::Hidden,
        Some(_) => Blind::Told,
    }
}

fn group_told(told: &Told) -> GroupTold {
    let verdict = verdict_of(told);
    GroupTold {
        group: told.group.to_owned(),
        accuracy: told.accuracy,
        windows: told.windows[0],
        holds: match verdict {
            Blind::Hidden => Some(true),
            Blind::Told => Some(false),
            _ => None,
        },
        verdict: verdict.words().to_owned(),
    }
}

fn print_blind(told: &[Told]) {
    println!("\nblind test: windows of two turns whose origin a classifier finds; 50 % is chance");
    for group in told {
        let verdict = verdict_of(group).words();
        let accuracy = group.accuracy.map(|found| format!("{found:.1}"));
        let accuracy = accuracy.unwrap_or_else(|| "-".to_owned());
        let (name, [windows, _]) = (group.group, group.windows);
        println!("{name:<14}  {accuracy:>5} % of {windows:>3} windows  {verdict}");
        for figure in &group.figures {
            let (real, ours) = (figure.real, figure.emulated);
            println!("    {:<20}  {real:>10.3}  {ours:>10.3}", figure.name);
        }
    }
}

/// The lidar's bytes: all bytes of a raw file, or the line of a capture with most lidar frames.
fn lidar_bytes(path: &Path) -> Result<Vec<u8>, CliError> {
    let source = Source::read(path, None)?;
    let lanes = lanes(&source.capture, |_| true);
    let framed = |lane: &Lane| [&XV11, &XV11_TURN].map(|row| row.framed(&lane.bytes));
    let best = lanes
        .into_iter()
        .max_by_key(|lane| framed(lane).into_iter().max());
    Ok(best.map(|lane| lane.bytes).unwrap_or_default())
}

/// The lidar's bytes of the capture in `path`. A file without any packet or turn is rejected.
fn read(path: &Path) -> Result<Vec<u8>, CliError> {
    let bytes = lidar_bytes(path)?;
    let column = Column::of(&bytes);
    let counts = ["packets", TURNS];
    let frames = column
        .rows
        .iter()
        .filter(|row| counts.contains(&&*row.name));
    if frames.filter_map(|row| row.value).sum::<f64>() < 1.0 {
        let len = bytes.len();
        let expected = "expected the bytes of an XV-11 as it sends them";
        let what = format!("no packet in {len} bytes, {expected}");
        return Err(CliError::content(path, what));
    }
    Ok(bytes)
}

fn compared(row: &Comparison) -> FigureCompared {
    let finite = |value: Option<f64>| value.filter(|value| value.is_finite());
    FigureCompared {
        name: row.name.clone(),
        unit: row.unit.to_owned(),
        real: finite(row.real),
        emulated: finite(row.ours),
        holds: row.holds(),
    }
}

fn print_line([name, real, ours, unit, allowed, verdict]: [String; 6]) {
    println!("{name:<40}  {real:>10}  {ours:>10}  {unit:<4}  {allowed:<8}  {verdict}");
}

fn figure(value: Option<f64>) -> String {
    match value {
        None => "-".to_owned(),
        Some(value) if value == value.round() => format!("{value:.0}"),
        Some(value) => format!("{value:.3}"),
    }
}

fn allowed(limit: Limit) -> String {
    match limit {
        Limit::Share(0.0) => "same".to_owned(),
        Limit::Share(share) => format!("+-{:.0} %", share * 100.0),
        Limit::Plus(plus) => format!("+-{}", (plus * 100.0).round() / 100.0),
        Limit::Free => "any".to_owned(),
    }
}

fn verdict(row: &Comparison) -> &'static str {
    match row.holds() {
        Some(true) => "ok",
        Some(false) => "DIFFERS",
        None => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only an accuracy near chance, over enough windows of both streams, is a success.
    #[test]
    fn a_group_that_is_not_compared_is_no_success() {
        let verdict = |accuracy, windows, is_of_the_unit| {
            verdict_of(&Told {
                group: "distances",
                accuracy,
                windows,
                is_of_the_unit,
                figures: Vec::new(),
            })
        };
        for (accuracy, windows, is_of_the_unit, expected, fails) in [
            (Some(52.0), [120, 240], false, Blind::Hidden, false),
            (Some(60.5), [120, 240], false, Blind::Told, true),
            // Three standard errors of 40 and 80 windows are 14.5 %.
            (Some(64.0), [40, 80], false, Blind::Hidden, false),
            (Some(65.0), [40, 80], false, Blind::Told, true),
            (Some(50.0), [39, 78], false, Blind::TooFewWindows, true),
            (None, [120, 0], false, Blind::NotCompared, true),
            (None, [0, 0], false, Blind::NotCompared, true),
            (Some(90.0), [120, 240], true, Blind::NotJudged, false),
        ] {
            let found = verdict(accuracy, windows, is_of_the_unit);
            assert_eq!((found, found.fails()), (expected, fails), "{accuracy:?}");
        }
    }
}
