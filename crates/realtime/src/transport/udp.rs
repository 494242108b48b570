//! A network port of this machine: one UDP packet per message, for links that carry messages.
//!
//! A network port has no open or close. The other end is the sender of the last packet. The port
//! counts as open from its first packet on. Packets sent to the other end before that are lost.

use core::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::net::UdpSocket;
use std::os::fd::{AsFd, BorrowedFd};
use std::path::{Path, PathBuf};

use super::{Counters, PortEvent, Transport, TransportError};

/// Prefix of the address of a network port.
const SCHEME: &str = "udp:";

/// A network port.
#[derive(Debug)]
pub struct Udp {
    path: PathBuf,
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    events: VecDeque<PortEvent>,
    counters: Counters,
}

impl Udp {
    /// The address that `place` names: `udp:9000` for this machine only, or with an address before
    /// the number, as in `udp:0.0.0.0:9000`. `None` if `place` is not a network port.
    pub fn address(place: &Path) -> Option<SocketAddr> {
        let place = place.to_str()?.strip_prefix(SCHEME)?;
        match place.parse::<u16>() {
            Ok(port) => Some(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port)),
            Err(_) => place.parse().ok(),
        }
    }

    /// Opens a socket at `address`.
    ///
    /// # Errors
    /// [`TransportError::Network`] if another process uses the address, or if it does not exist
    /// here.
    pub fn open(address: SocketAddr) -> Result<Self, TransportError> {
        let opened = || {
            let socket = UdpSocket::bind(address)?;
            socket.set_nonblocking(true)?;
            // Port 0 means any free port.
            let address = socket.local_addr()?;
            Ok((socket, address))
        };
        let (socket, address) =
            opened().map_err(|source| TransportError::Network { address, source })?;
        Ok(Self {
            path: PathBuf::from(format!("{SCHEME}{address}")),
            socket,
            peer: None,
            events: VecDeque::new(),
            counters: Counters::default(),
        })
    }
}

impl Transport for Udp {
    /// Reads one packet, truncated to `buf`; an empty packet is ignored.
    fn read(&mut self, buf: &mut [u8]) -> Result<usize, TransportError> {
        match self.socket.recv_from(buf) {
            Ok((len, from)) => {
                if self.peer.replace(from).is_none() {
                    self.events.push_back(PortEvent::Opened);
                }
                Ok(len)
            }
            // The receiver of an earlier packet has gone: no event of the port.
            Err(error) if is_passing(&error) => Ok(0),
            Err(source) => Err(TransportError::Lost {
                path: self.path.clone(),
                source,
            }),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> usize {
        let Some(peer) = self.peer else {
            self.counters.unheard += bytes.len() as u64;
            return 0;
        };
        let sent = self.socket.send_to(bytes, peer).unwrap_or(0);
        self.counters.overrun += (bytes.len() - sent) as u64;
        sent
    }

    fn next_event(&mut self) -> Option<PortEvent> {
        self.events.pop_front()
    }

    fn path(&self) -> &Path {
        &self.path
    }

    fn counters(&self) -> Counters {
        self.counters
    }

    fn readiness<'a>(&'a self, fds: &mut Vec<BorrowedFd<'a>>) {
        fds.push(self.socket.as_fd());
    }
}

fn is_passing(error: &io::Error) -> bool {
    let kinds = [
        ErrorKind::WouldBlock,
        ErrorKind::ConnectionRefused,
        ErrorKind::Interrupted,
    ];
    kinds.contains(&error.kind())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_is_a_port_of_this_machine_or_an_address() {
        let address = |place: &str| Udp::address(Path::new(place)).map(|it| it.to_string());
        assert_eq!(address("udp:9000").as_deref(), Some("127.0.0.1:9000"));
        let all = address("udp:0.0.0.0:9000");
        assert_eq!(all.as_deref(), Some("0.0.0.0:9000"));
        assert_eq!(address("udp:70000"), None);
        assert_eq!(address("/dev/ttyUSB0"), None);
    }

    /// Two packets are two messages; the answer is sent to their sender.
    #[test]
    fn packets_are_messages_and_the_sender_is_the_far_end() {
        let mut port = Udp::open("127.0.0.1:0".parse().expect("one")).expect("a free port");
        let there = port.path().to_str().expect("text").replace(SCHEME, "");
        assert_eq!(port.write(b"early"), 0);
        assert_eq!(port.counters().unheard, 5);
        let mut buf = [0; 64];
        assert!(matches!(port.read(&mut buf), Ok(0)));
        assert_eq!(port.next_event(), None);
        let client = UdpSocket::bind("127.0.0.1:0").expect("a free port");
        client.send_to(b"one", &there).expect("sent");
        client.send_to(b"other", &there).expect("sent");
        assert!(matches!(port.read(&mut buf), Ok(3)));
        assert_eq!(port.next_event(), Some(PortEvent::Opened));
        assert_eq!(&buf[..3], b"one");
        assert!(matches!(port.read(&mut buf), Ok(5)));
        assert_eq!(port.next_event(), None);
        assert_eq!(port.write(b"answer"), 6);
        assert_eq!(client.recv(&mut buf).expect("it came"), 6);
    }
}
