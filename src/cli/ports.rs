//! Ports as the command line names them: a path, or `pty:PATH` for a new pseudo-terminal.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use protocols::LineConfig;

use super::CliError;
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
