use std::path::{Path, PathBuf};

use clap::Args;
use description::Description;
use description::import::import;

use super::answer::Files;
use super::{CliError, Verdict, out};
use crate::scenario::Scenario;
use crate::show::shell::{quoted, word};

/// A mission of a built-in robot.
const MISSION: &str = include_str!("new/mission.toml");
/// A robot described by data, for the user's own program.
const ROBOT: &str = include_str!("new/robot.toml");
/// Devices only, without robot and world.
const DEVICES: &str = include_str!("new/devices.toml");
/// A described device, its test scenario and its driver.
const DEVICE: [&str; 3] = [
    include_str!("new/device.toml"),
    include_str!("new/bench.toml"),
    include_str!("new/driver.py"),
];

/// Create a scenario or a device as a start: it runs unchanged, and its comments explain possible
/// changes.
#[derive(Debug, Args)]
#[command(after_long_help = "Examples:\n  \
    hilrig new kitchen                # kitchen.toml: a room, a mission, a fault\n  \
    hilrig new tests/mine --robot     # a robot of your own, described by data\n  \
    hilrig new gripper --devices      # devices on their wires, no robot\n  \
    hilrig new thermostat --device    # a device described in a file, its bench, a driver in Python\n  \
    hilrig new meter --device --from map.csv   # a Modbus device, from its register map\n  \
    hilrig new probe --device --from probe.ksy # a message, from its structure for Kaitai Struct")]
pub(super) struct NewArgs {
    /// Name of the scenario, or the file to write
    #[arg(value_name = "NAME|PATH")]
    path: PathBuf,
    /// A robot of your own: chassis, devices and registers as data; you write the program
    #[arg(long, conflicts_with_all = ["devices", "device"])]
    robot: bool,
    /// Devices only, without robot and world
    #[arg(long, conflicts_with = "device")]
    devices: bool,
    /// A device described in a file, with a scenario for it and a driver in Python
    #[arg(long)]
    device: bool,
    /// Make the device of a register map or a structure: a CSV file whose first line names the
    /// columns, e.g. address,name,type,scale,unit,access; the JSON of pymodbus' simulator; or a
    /// .ksy file of Kaitai Struct
    #[arg(long, value_name = "FILE", requires = "device")]
    from: Option<PathBuf>,
}

pub(super) fn run(args: &NewArgs) -> Result<Verdict, CliError> {
    let path = match args.path.extension() {
        Some(_) => args.path.clone(),
        None => args.path.with_extension("toml"),
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    if path.exists() {
        let error = format!("{}: already exists; choose another name", path.display());
        return Err(CliError::Usage(error));
    }
    if let Some(map) = &args.from {
        return imported(&path, &name, map);
    }
    if args.device {
        return device(&path, &name);
    }
    let text = match (args.robot, args.devices) {
        (true, _) => ROBOT,
        (_, true) => DEVICES,
        _ => MISSION,
    };
    let text = text
        .replace("NAME", &name)
        .replace("FILE", &path.display().to_string());
    // An invalid scenario name is reported before the file is created.
    Scenario::parse(&path, text.clone())?;
    make(&path, &text)?;
    let shown = path.display();
    println!("{shown}");
    eprintln!("try it: hilrig {} {}", verb(args), word(&path));
    let files = vec![shown.to_string()];
    out::answer(&Files { files });
    Ok(Verdict::Pass)
}

/// Writes the description `path` of the device `name`, with scenario and driver in the same folder.
fn device(path: &Path, name: &str) -> Result<Verdict, CliError> {
    let file = |path: &Path| {
        path.file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    let beside = |ending: &str| path.with_file_name(format!("{name}{ending}"));
    let paths = [path.to_owned(), beside("-bench.toml"), beside("_driver.py")];
    for path in &paths {
        if path.exists() {
            let error = format!("{} exists already; choose another name", path.display());
            return Err(CliError::Usage(error));
        }
    }
    let [own, bench, driver] = [0, 1, 2].map(|at: usize| file(&paths[at]));
    let texts = DEVICE.map(|text| {
        let text = text.replace("BENCH", &bench).replace("DRIVER", &driver);
        text.replace("FILE", &own).replace("NAME", name)
    });
    let shown = path.display().to_string();
    Description::parse(&shown, &texts[0], &|_| Err(String::new()))
        .map_err(|error| CliError::Usage(error.to_string()))?;
    Scenario::parse(&paths[1], texts[1].clone())?;
    for (path, text) in paths.iter().zip(&texts) {
        make(path, text)?;
        println!("{}", path.display());
    }
    let [_, bench, driver] = paths.each_ref().map(|path| word(path));
    let exec = quoted(&format!("python3 {driver}"));
    eprintln!("try it: hilrig run {bench} --exec {exec}");
    let files = paths
        .iter()
        .map(|path| path.display().to_string())
        .collect();
    out::answer(&Files { files });
    Ok(Verdict::Pass)
}

/// Writes the description `path` of the device `name` with the content of `map`, and a scenario.
fn imported(path: &Path, name: &str, map: &Path) -> Result<Verdict, CliError> {
    let bytes = super::read(map)?;
    let file = map.file_name().unwrap_or_default().to_string_lossy();
    let text = core::str::from_utf8(&bytes).map_err(|error| {
        let before = &bytes[..error.valid_up_to()];
        let line = 1 + before.iter().filter(|byte| **byte == b'\n').count();
        CliError::Usage(format!(
            "{file}: line {line}: a character is not UTF-8; save the file as UTF-8 (\"CSV UTF-8\")"
        ))
    })?;
    let draft = import(name, &file, text).map_err(CliError::Usage)?;
    let bench = path.with_file_name(format!("{name}-bench.toml"));
    if bench.exists() {
        let error = format!("{} exists already; choose another name", bench.display());
        return Err(CliError::Usage(error));
    }
    let own = path.file_name().unwrap_or_default().to_string_lossy();
    let text = format!(
        "# A bench for the driver of {name}: hilrig up {} --dir /tmp/rig\nschema = 1\nname = \
         \"{name}-bench\"\nrobot = \"none\"\nduration = \"60s\"\ndevice.{name} = {{ description = \
         \"{own}\" }}\n",
        bench.display()
    );
    Scenario::parse(&bench, text.clone())?;
    for (path, text) in [(path, &draft.text), (&bench, &text)] {
        make(path, text)?;
        println!("{}", path.display());
    }
    for part in &draft.left_out {
        eprintln!("left out: {part}");
    }
    for note in &draft.notes {
        eprintln!("note: {note}");
    }
    let shown = path.display();
    let count = match draft.fields {
        0 => format!("{} registers", draft.registers),
        fields => format!("{fields} fields"),
    };
    eprintln!(
        "{count}; try it: hilrig describe {}, hilrig up {}",
        word(path),
        word(&bench)
    );
    let files = vec![shown.to_string(), bench.display().to_string()];
    out::answer(&Files { files });
    Ok(Verdict::Pass)
}

/// The command for the created file: `run` if it contains a program that can be judged.
const fn verb(args: &NewArgs) -> &'static str {
    match args.robot || args.devices {
        true => "up",
        false => "run",
    }
}

fn make(path: &Path, text: &str) -> Result<(), CliError> {
    safefs::create_parent(path)
        .and_then(|()| safefs::write(path, text))
        .map_err(|error| CliError::write(path.display(), error))
}
