//! The socket and its clients.

use std::io;
use std::os::unix::net::{UnixListener, UnixStream};
use std::sync::Arc;

use protocols::Instant;

use super::answer::Refusal;
use super::client::Client;
use super::modem;
use super::modem::Port;
use super::perform::{Office, Tally, apart};
use crate::held::Held;
use crate::inputs::Inputs;
use crate::transport::{PortDir, TransportError};
use crate::{Lateness, Place, Sign};
use engine::run::Run;
use safefs::Dir;

/// Name of the socket in the directory of the ports.
pub const NAME: &str = "control";
/// Maximum number of clients at once. If one more connects, the idle client that was silent for
/// longest is disconnected.
pub const CLIENTS_MAX: usize = 64;

/// Receives requests of any number of clients.
#[derive(Debug)]
pub struct Control {
    dir: Arc<Dir>,
    listener: UnixListener,
    clients: Vec<Client>,
    ports: Vec<Port>,
    tally: Tally,
    looks: u64,
    looked_at: Instant,
    delays: Lateness,
}

impl Control {
    /// Opens the socket in `dir`, only for this user. A socket of a killed rig is replaced.
    ///
    /// # Errors
    /// If the socket cannot be created, or another file has its name.
    pub fn open(dir: &PortDir) -> Result<Self, TransportError> {
        let fail = |source| TransportError::Directory {
            path: dir.path().to_owned(),
            source,
        };
        let place = dir.handle();
        if is_left_behind(&place) {
            place.remove_file(NAME).map_err(fail)?;
        }
        let listener = match place.listen(NAME) {
            Ok(listener) => listener,
            Err(error) if error.kind() == io::ErrorKind::AddrInUse => {
                let path = dir.path().join(NAME);
                return Err(TransportError::Occupied { path });
            }
            Err(source) => return Err(fail(source)),
        };
        listener.set_nonblocking(true).map_err(fail)?;
        Ok(Self {
            dir: place,
            listener,
            clients: Vec::new(),
            ports: Vec::new(),
            tally: Tally::default(),
            looks: 0,
            looked_at: Instant::ZERO,
            delays: Lateness::default(),
        })
    }

    /// Makes the rig's ports known to clients.
    pub fn offer<'a>(&mut self, ports: impl Iterator<Item = Place<'a>> + Clone) {
        let all = ports.clone();
        let port = |place: Place<'_>| Port {
            name: place.name.to_owned(),
            path: place.path.to_owned(),
            baud: place.baud,
            node: place.node,
            outputs: [false; 2],
            inputs: Inputs::of(place.name, all.clone()),
            opening: None,
        };
        self.ports.extend(ports.map(port));
    }

    /// Whether a client sets modem lines, so that openings of ports matter.
    pub fn has_lines(&self) -> bool {
        self.clients.iter().any(Client::has_modem)
            || self.ports.iter().any(|port| port.opening.is_some())
    }

    /// Records whether a client has the port open. This raises its modem lines if a client of this
    /// socket sets them.
    pub fn see(&mut self, sign: &Sign<'_>, run: &mut Run) {
        let has_lines = self.clients.iter().any(Client::has_modem);
        let opening = (sign.is_open && has_lines).then_some(sign.openings);
        modem::see(&mut self.ports, sign.name, opening, run);
    }

    /// Reads requests of clients; returns whether there were any. Actions at the ports before these
    /// requests are visible now, and can be carried in before [`serve`](Self::serve). Never waits.
    pub fn hear(&mut self) -> bool {
        self.looks += 1;
        self.accept();
        let heard = self.clients.iter_mut().map(|one| one.hear(self.looks));
        // `fold` instead of `any`: each client must be read.
        heard.fold(false, |any, one| any | one)
    }

    /// Executes the requests that were read. `now` is the time of the rig's clock; `tempo` controls
    /// it, if clients may. Never waits.
    pub fn serve(&mut self, run: &mut Run, tempo: Option<&Held>, now: Instant) {
        let since_last = now - self.looked_at;
        self.looked_at = now;
        let mut office = Office {
            run,
            tempo,
            ports: &mut self.ports,
            clients: self.clients.len(),
            tally: &mut self.tally,
        };
        for client in &mut self.clients {
            for answer in client.serve(&mut office, now) {
                if let Some(applied) = answer.applied {
                    self.delays
                        .record(since_last + apart(now, applied.instant()));
                }
            }
        }
        self.clients.retain(|client| !client.is_gone());
    }

    fn accept(&mut self) {
        for _ in 0..CLIENTS_MAX {
            let Ok((stream, _)) = self.listener.accept() else {
                return;
            };
            if stream.set_nonblocking(true).is_err() {
                continue;
            }
            let mut newcomer = Client::new(stream, self.looks);
            if self.clients.len() >= CLIENTS_MAX && !self.make_room() {
                let message = format!("{CLIENTS_MAX} clients wait already, the maximum");
                newcomer.hang_up(Refusal::new("clients", message));
            } else {
                self.clients.push(newcomer);
            }
        }
    }

    /// Disconnects an idle client, if there is one; returns whether there was.
    fn make_room(&mut self) -> bool {
        let idle = self.clients.iter().enumerate();
        let idle = idle.filter_map(|(index, client)| Some((client.idle_since()?, index)));
        let Some((_, index)) = idle.min() else {
            return false;
        };
        let message = format!(
            "disconnected: silent for longest of {CLIENTS_MAX} clients when another one connected"
        );
        self.clients[index].hang_up(Refusal::new("clients", message));
        self.clients.remove(index);
        true
    }

    /// Whether a client waits for a condition or for the end of a step.
    pub fn is_awaited(&self) -> bool {
        self.clients.iter().any(|one| one.idle_since().is_none())
    }

    /// Whether clients were connected, and all of them have left or closed their side. A client
    /// that closed its side still receives the answer that it waits for.
    pub fn is_deserted(&self) -> bool {
        self.tally.requests > 0 && self.clients.iter().all(Client::has_ended)
    }

    /// Whether a client requested the end of the run.
    pub const fn has_quit(&self) -> bool {
        self.tally.quits
    }

    /// Number of changes of the run by clients.
    pub const fn changes(&self) -> u64 {
        self.tally.changes
    }

    /// Number of requests, and of refused ones.
    pub const fn requests(&self) -> [u64; 2] {
        [self.tally.requests, self.tally.refused]
    }

    /// Maximum delay between a request and its effect: the time since the previous poll, and the
    /// difference between the clock and the virtual time of the change.
    pub const fn delays(&self) -> &Lateness {
        &self.delays
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        self.clients.iter_mut().for_each(Client::end);
        let _ = self.dir.remove_file(NAME);
    }
}

/// Whether the directory has a socket without a listening process.
fn is_left_behind(dir: &Dir) -> bool {
    let is_socket = dir.is_socket(NAME);
    let refused = |error: io::Error| error.kind() == io::ErrorKind::ConnectionRefused;
    is_socket && UnixStream::connect(dir.path().join(NAME)).is_err_and(refused)
}
