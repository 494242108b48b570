//! The socket and its clients.

use core::time::Duration;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::FileTypeExt as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use protocols::Instant;

use super::{Answer, LINE_MAX, obey};
use crate::realtime::Lateness;
use crate::realtime::transport::{PortDir, TransportError};
use crate::run::Run;
use crate::scenario::Flaw;

/// Name of the socket in the directory of the ports.
pub const NAME: &str = "control";
/// Most clients at once; further ones wait until one leaves.
const CLIENTS_MAX: usize = 16;
/// Most requests of one client in one look: nobody may keep the rig from its work.
const REQUESTS_MAX: usize = 8;
/// Answers that may wait for a client that does not read; beyond, it is hung up on.
const UNREAD_MAX: usize = 4 << 20;

/// Takes requests of any number of clients.
#[derive(Debug)]
pub struct Control {
    path: PathBuf,
    listener: UnixListener,
    clients: Vec<Client>,
    looked_at: Instant,
    delays: Lateness,
}

impl Control {
    /// Opens the socket in `dir`. One that a killed rig left there is replaced.
    ///
    /// # Errors
    /// If it cannot be made, or something else stands there.
    pub fn open(dir: &PortDir) -> Result<Self, TransportError> {
        let path = dir.path().join(NAME);
        let fail = |source| TransportError::Directory {
            path: dir.path().to_owned(),
            source,
        };
        if is_left_behind(&path) {
            fs::remove_file(&path).map_err(fail)?;
        }
        let listener = match UnixListener::bind(&path) {
            Ok(listener) => listener,
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                return Err(TransportError::Occupied { path });
            }
            Err(source) => return Err(fail(source)),
        };
        listener.set_nonblocking(true).map_err(fail)?;
        Ok(Self {
            path,
            listener,
            clients: Vec::new(),
            looked_at: Instant::ZERO,
            delays: Lateness::default(),
        })
    }

    /// Does what clients have asked for; `now` is the time of the rig's clock. Never waits.
    pub fn serve(&mut self, run: &mut Run, now: Instant) {
        while self.clients.len() < CLIENTS_MAX
            && let Ok((stream, _)) = self.listener.accept()
        {
            if stream.set_nonblocking(true).is_ok() {
                self.clients.push(Client::new(stream));
            }
        }
        let since_last = now - self.looked_at;
        self.looked_at = now;
        for client in &mut self.clients {
            for answer in client.serve(run, now) {
                if let Some(applied) = answer.applied {
                    self.delays
                        .record(since_last + apart(now, applied.instant()));
                }
            }
        }
        self.clients.retain(|client| !client.is_gone);
    }

    /// How long after its request each change was in force, at most: the time since the rig had
    /// last looked, and what lay between the clock and the virtual time of the change.
    pub const fn delays(&self) -> &Lateness {
        &self.delays
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

fn apart(a: Instant, b: Instant) -> Duration {
    a.max(b) - a.min(b)
}

/// Whether a socket stands at `path` that nobody listens on.
fn is_left_behind(path: &Path) -> bool {
    let is_socket = fs::symlink_metadata(path).is_ok_and(|found| found.file_type().is_socket());
    let refused = |error: io::Error| error.kind() == io::ErrorKind::ConnectionRefused;
    is_socket && UnixStream::connect(path).is_err_and(refused)
}

#[derive(Debug)]
struct Client {
    stream: UnixStream,
    request: Vec<u8>,
    /// A request that was too long is being skipped up to its line end.
    skips: bool,
    unread: Vec<u8>,
    is_gone: bool,
}

impl Client {
    const fn new(stream: UnixStream) -> Self {
        Self {
            stream,
            request: Vec::new(),
            skips: false,
            unread: Vec::new(),
            is_gone: false,
        }
    }

    fn serve(&mut self, run: &mut Run, now: Instant) -> Vec<Answer> {
        let mut answers = Vec::new();
        while answers.len() < REQUESTS_MAX {
            match self.next_line() {
                None => break,
                Some(Err(flaw)) => answers.push(flaw.into()),
                Some(Ok(line)) => answers.push(obey(run, &line, now)),
            }
        }
        let lines = answers.iter().map(Answer::line);
        lines.for_each(|line| self.unread.extend_from_slice(line.as_bytes()));
        self.write();
        answers
    }

    /// The next whole line, or that it is too long.
    fn next_line(&mut self) -> Option<Result<Vec<u8>, Flaw>> {
        loop {
            if let Some(end) = self.request.iter().position(|&byte| byte == b'\n') {
                let line: Vec<u8> = self.request.drain(..=end).collect();
                if !core::mem::take(&mut self.skips) {
                    return Some(Ok(line));
                }
                continue;
            }
            if self.request.len() >= LINE_MAX {
                self.request.clear();
                if !core::mem::replace(&mut self.skips, true) {
                    let message = format!("is too long, expected at most {LINE_MAX} bytes a line");
                    return Some(Err(Flaw::new("request", message)));
                }
            }
            let mut buf = [0; 4096];
            let room = (LINE_MAX - self.request.len()).min(buf.len());
            match self.stream.read(&mut buf[..room]) {
                Ok(0) => {
                    self.is_gone = true;
                    return None;
                }
                Ok(len) => self.request.extend_from_slice(&buf[..len]),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    self.is_gone |= error.kind() != io::ErrorKind::WouldBlock;
                    return None;
                }
            }
        }
    }

    fn write(&mut self) {
        while !self.unread.is_empty() {
            match self.stream.write(&self.unread) {
                Ok(len) => drop(self.unread.drain(..len)),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => {
                    self.is_gone |=
                        error.kind() != io::ErrorKind::WouldBlock || self.unread.len() > UNREAD_MAX;
                    return;
                }
            }
        }
    }
}
