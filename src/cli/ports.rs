//! Ports as the command line names them: a path, or `pty:PATH` for a new pseudo-terminal.

use std::collections::BTreeMap;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use protocols::{LineConfig, Parity};
use rustix::fs::{Mode, OFlags};
use rustix::termios::{ControlModes, tcgetattr};

use super::CliError;
use super::place::NamedPort;
use crate::realtime::transport::{PortDir, Pty, Serial, Transport};

/// Opens ports, and owns the directories of new ones.
#[derive(Debug, Default)]
pub(super) struct Ports {
    dirs: BTreeMap<PathBuf, PortDir>,
}

impl Ports {
    /// Opens the port given to `option`.
    pub(super) fn open(
        &mut self,
        option: &str,
        path: &Path,
        line: LineConfig,
    ) -> Result<Box<dyn Transport>, CliError> {
        let Some(place) = path.to_str().and_then(|path| path.strip_prefix("pty:")) else {
            return Ok(Box::new(Serial::open(path, line)?));
        };
        let place = Path::new(place);
        let Some(name) = place.file_name().and_then(|name| name.to_str()) else {
            let shown = path.display();
            let error = format!("{option} {shown}: expected a file name, e.g. pty:/tmp/tap/lidar");
            return Err(CliError::Usage(error));
        };
        // The record of a directory of ports has one port a line.
        let mut marks = name
            .chars()
            .filter(|c| *c != ' ' && (c.is_whitespace() || c.is_control()));
        let wrong = match marks.next() {
            _ if name.starts_with('.') => Some("a dot at its beginning".to_owned()),
            Some(mark) => Some(format!("{mark:?}")),
            None if name.trim() != name => Some("a space at its beginning or end".to_owned()),
            None if place.to_str().is_some_and(|place| place.starts_with(' ')) => {
                Some("a space behind pty:".to_owned())
            }
            None => None,
        };
        if let Some(wrong) = wrong {
            let error = format!(
                "{option} {}: the name \"{}\" has {wrong}; expected a name without control \
                 characters, and without a dot or a space at its ends, e.g. pty:/tmp/tap/lidar",
                path.display(),
                name.escape_debug()
            );
            return Err(CliError::Usage(error));
        }
        let parent = place.parent().filter(|dir| !dir.as_os_str().is_empty());
        let parent = parent.unwrap_or(Path::new(".")).to_owned();
        let dir = match self.dirs.remove(&parent) {
            Some(dir) => dir,
            None => PortDir::open(&parent)?,
        };
        let port = Pty::open(&dir, name, line);
        self.dirs.insert(parent, dir);
        Ok(Box::new(port?))
    }
}

/// Rate of most serial devices, for ports that do not exist yet.
const BAUD: u32 = 115_200;

/// The line between two ports, the device's first: the given rate, else that of the device's port
/// as it is, else that of the program's port, with the character format of the same port.
pub(super) struct LineOfPair {
    pub(super) line: LineConfig,
    /// The origin of the rate, in words.
    pub(super) origin: String,
    /// The ports, kept open: closing the last one would reset a board.
    _held: Vec<OwnedFd>,
}

impl LineOfPair {
    /// Reads the settings of the ports; prints a note if a port is set to another rate.
    pub(super) fn of(pair: &[NamedPort], given: Option<u32>) -> Self {
        let name = pair.first().map_or("", |place| &*place.name);
        let mut found = Vec::new();
        let mut held = Vec::new();
        for place in pair {
            if let Some((line, port)) = settings(&place.path) {
                found.push((&place.path, line));
                held.push(port);
            }
        }
        let usual = LineConfig::new_8n1(BAUD);
        let (line, origin) = match (given, found.first()) {
            (Some(baud), found) => {
                let coding = found.map_or(usual, |(_, line)| *line);
                (LineConfig { baud, ..coding }, "from --baud".to_owned())
            }
            (None, Some((path, line))) => (*line, format!("as {} is set", path.display())),
            (None, None) => (usual, "the default, because no port exists yet".to_owned()),
        };
        for (path, other) in found.iter().filter(|(_, other)| *other != line) {
            let path = path.display();
            let [was, is] = [*other, line].map(in_words);
            eprintln!(
                "{name}: {path} was set to {was} and is set to {is} now; --baud sets another rate"
            );
        }
        Self {
            line,
            origin,
            _held: held,
        }
    }
}

/// A line's settings, such as `9600 baud 8N1`.
pub(super) fn in_words(line: LineConfig) -> String {
    let parity = match line.parity {
        Parity::None => 'N',
        Parity::Even => 'E',
        Parity::Odd => 'O',
    };
    let (baud, data, stop) = (line.baud, line.data_bits, line.stop_bits);
    format!("{baud} baud {data}{parity}{stop}")
}

/// The settings of the serial port or terminal at `path`, and the open port; `None` if there is
/// none.
fn settings(path: &Path) -> Option<(LineConfig, OwnedFd)> {
    let flags = OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let port = rustix::fs::open(path, flags, Mode::empty()).ok()?;
    let set = tcgetattr(&port).ok()?;
    let modes = set.control_modes;
    let data_bits = match modes & ControlModes::CSIZE {
        ControlModes::CS5 => 5,
        ControlModes::CS6 => 6,
        ControlModes::CS7 => 7,
        _ => 8,
    };
    let has = |mode| modes.contains(mode);
    let parity = match (has(ControlModes::PARENB), has(ControlModes::PARODD)) {
        (false, _) => Parity::None,
        (true, false) => Parity::Even,
        (true, true) => Parity::Odd,
    };
    let stop_bits = if has(ControlModes::CSTOPB) { 2 } else { 1 };
    // A port that was hung up has the rate 0.
    let baud = Some(set.input_speed()).filter(|baud| *baud > 0)?;
    let line = LineConfig {
        baud,
        data_bits,
        parity,
        stop_bits,
    };
    Some((line, port))
}

#[cfg(test)]
mod tests {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    use rustix::termios::{OptionalActions, tcsetattr};

    use super::*;

    /// A terminal set to 19200 baud 8N2 by another program, beside a port that does not exist.
    #[test]
    fn a_pair_has_the_settings_of_its_ports_unless_a_rate_is_given() {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a terminal");
        grantpt(&master).expect("ours");
        unlockpt(&master).expect("ours");
        let name = ptsname(&master, Vec::new()).expect("its name");
        let path = PathBuf::from(name.into_string().expect("UTF-8"));
        let flags = OFlags::NOCTTY | OFlags::RDWR;
        let client = rustix::fs::open(&path, flags, Mode::empty()).expect("there");
        let mut set = tcgetattr(&client).expect("a terminal");
        set.set_speed(19_200).expect("a usual rate");
        // A terminal has no parity and always eight bits.
        set.control_modes |= ControlModes::CSTOPB;
        tcsetattr(&client, OptionalActions::Now, &set).expect("a terminal");

        let place = |name: &str, path: PathBuf| NamedPort {
            name: name.to_owned(),
            path,
        };
        let new = || place("pc", PathBuf::from("pty:/nowhere/pc"));
        for pair in [
            [place("meter", path.clone()), new()],
            [new(), place("meter", path.clone())],
        ] {
            let found = LineOfPair::of(&pair, None);
            assert_eq!(in_words(found.line), "19200 baud 8N2");
            assert!(found.origin.starts_with("as /dev/"), "{}", found.origin);
            let given = LineOfPair::of(&pair, Some(9_600));
            assert_eq!(in_words(given.line), "9600 baud 8N2");
        }
        let nothing = LineOfPair::of(&[new(), new()], None);
        assert_eq!(in_words(nothing.line), "115200 baud 8N1");
    }

    #[test]
    fn a_name_that_no_port_can_have_is_refused_with_its_character() {
        let mut ports = Ports::default();
        for (name, character) in [(" a", "a space at"), ("a\tb", "'\\t'"), (".a", "a dot")] {
            let path = PathBuf::from(format!("pty:/nowhere/{name}"));
            let refused = ports.open("--tap", &path, LineConfig::new_8n1(BAUD));
            let error = refused.err().map(|error| error.to_string());
            let error = error.unwrap_or_default();
            assert!(
                error.contains(&format!("has {character}")),
                "{name}: {error}"
            );
        }
    }
}
