//! The connection to a debugger.

use core::net::{Ipv4Addr, SocketAddr};
use core::time::Duration;
use std::io::{self, Read as _};
use std::net::{TcpListener, TcpStream};

use gdbstub::conn::Connection;
use rustix::event::{PollFd, PollFlags, Timespec, poll};

use crate::guest::GuestError;

/// Maximum wait before the caller is asked again whether the session may continue.
const WAIT: Duration = Duration::from_millis(50);
/// Maximum wait for a debugger that takes no bytes; then it counts as gone.
const WRITE_WAIT: Duration = Duration::from_secs(10);
/// The byte by which a debugger interrupts the program.
const INTERRUPT: u8 = 0x03;
/// Maximum number of bytes in one read.
const READ_MAX: usize = 4096;

/// The socket for debuggers; it accepts connections from this machine only.
pub(super) struct Door {
    listener: TcpListener,
    pub(super) address: SocketAddr,
}

impl Door {
    pub(super) fn open(port: u16) -> Result<Self, GuestError> {
        let opened = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).and_then(|listener| {
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok(Self { listener, address })
        });
        opened.map_err(|source| GuestError::DebugPort { port, source })
    }

    /// The next debugger; `None` if the caller stops the session.
    pub(super) fn accept(&self, goes_on: &dyn Fn() -> bool) -> io::Result<Option<Wire>> {
        while goes_on() {
            wait(&[&self.listener])?;
            match self.listener.accept() {
                Ok((stream, _)) => return Wire::new(stream).map(Some),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => return Err(error),
            }
        }
        Ok(None)
    }

    /// Refuses other debuggers while one is connected.
    pub(super) fn turn_away(&self) {
        while let Ok((stream, _)) = self.listener.accept() {
            drop(stream);
        }
    }
}

/// Waits for a short time until one of `files` can be read.
fn wait(files: &[&dyn std::os::fd::AsFd]) -> io::Result<()> {
    let mut polled: Vec<PollFd<'_>> = files
        .iter()
        .map(|file| PollFd::from_borrowed_fd(file.as_fd(), PollFlags::IN))
        .collect();
    let length = Timespec {
        tv_sec: 0,
        tv_nsec: i64::from(WAIT.subsec_nanos()),
    };
    match poll(&mut polled, Some(&length)) {
        Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// The bytes from and to one debugger.
pub(super) struct Wire {
    stream: TcpStream,
    inbox: Vec<u8>,
    /// Number of buffered bytes that were handed out.
    taken: usize,
    outbox: Vec<u8>,
}

impl Wire {
    fn new(stream: TcpStream) -> io::Result<Self> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(WRITE_WAIT))?;
        Ok(Self {
            stream,
            inbox: Vec::new(),
            taken: 0,
            outbox: Vec::new(),
        })
    }

    /// The next byte, if there is one now.
    pub(super) fn try_next(&mut self) -> io::Result<Option<u8>> {
        if let Some(&byte) = self.inbox.get(self.taken) {
            self.taken += 1;
            return Ok(Some(byte));
        }
        self.flush()?;
        self.stream.set_nonblocking(true)?;
        self.inbox.resize(READ_MAX, 0);
        let read = self.stream.read(&mut self.inbox);
        self.stream.set_nonblocking(false)?;
        self.taken = 0;
        self.inbox.truncate(*read.as_ref().unwrap_or(&0));
        match read {
            Ok(0) => Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(_) => self.try_next(),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => Ok(None),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Waits for the next byte; `None` if the caller stops the session.
    pub(super) fn next(
        &mut self,
        door: &Door,
        goes_on: &dyn Fn() -> bool,
    ) -> io::Result<Option<u8>> {
        loop {
            if let Some(byte) = self.try_next()? {
                return Ok(Some(byte));
            }
            door.turn_away();
            if !goes_on() {
                return Ok(None);
            }
            wait(&[&self.stream, &door.listener])?;
        }
    }

    /// A second handle of the connection, which detects an interrupt while nothing else is read.
    pub(super) fn ear(&self) -> io::Result<Ear> {
        self.stream.try_clone().map(Ear)
    }

    /// Discards the input up to an interrupt.
    pub(super) fn take_interrupt(&mut self) -> io::Result<()> {
        while self.try_next()?.is_some_and(|byte| byte != INTERRUPT) {}
        Ok(())
    }

    /// Confirms that a request was executed.
    pub(super) fn confirm(&mut self) -> io::Result<()> {
        self.outbox.extend(b"$OK#9a");
        self.flush()
    }

    /// Prints a line on the debugger's console. Only valid while the debugger waits for the program
    /// to stop.
    pub(super) fn say(&mut self, text: &str) -> io::Result<()> {
        let mut packet = "O".to_owned();
        for byte in text.bytes().chain([b'\n']) {
            packet += &format!("{byte:02x}");
        }
        let sum = packet.bytes().fold(0_u8, u8::wrapping_add);
        self.outbox.extend(format!("${packet}#{sum:02x}").bytes());
        self.flush()
    }
}

/// A second handle of a connection, see [`Wire::ear`].
pub(super) struct Ear(TcpStream);

impl Ear {
    /// Whether the debugger has sent an interrupt, or is gone.
    pub(super) fn hears_interrupt(&self) -> bool {
        let mut polled = [PollFd::new(&self.0, PollFlags::IN)];
        let at_once = Timespec {
            tv_sec: 0,
            tv_nsec: 0,
        };
        if !poll(&mut polled, Some(&at_once)).is_ok_and(|count| count > 0) {
            return false;
        }
        let mut bytes = [0; 64];
        match self.0.peek(&mut bytes) {
            Ok(count) => count == 0 || bytes[..count].contains(&INTERRUPT),
            Err(_) => true,
        }
    }
}

impl Connection for Wire {
    type Error = io::Error;

    fn write(&mut self, byte: u8) -> io::Result<()> {
        self.outbox.push(byte);
        Ok(())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.outbox.extend(bytes);
        Ok(())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::Write::write_all(&mut self.stream, &self.outbox)?;
        self.outbox.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A door, a debugger that has connected, and the wire to it.
    fn connected() -> (Door, TcpStream, Wire) {
        let door = Door::open(0).expect("a free port");
        let client = TcpStream::connect(door.address).expect("it listens");
        let wire = door
            .accept(&|| true)
            .expect("it connects")
            .expect("it goes on");
        (door, client, wire)
    }

    fn heard(client: &mut TcpStream, len: usize) -> String {
        let mut bytes = vec![0; len];
        client.read_exact(&mut bytes).expect("it was sent");
        String::from_utf8(bytes).expect("text")
    }

    fn send(client: &mut TcpStream, bytes: &[u8]) {
        io::Write::write_all(client, bytes).expect("connected");
    }

    /// GDB's remote protocol: `$`, the packet, `#`, the sum of its bytes in two digits; `O` is text
    /// for the console, in hex.
    #[test]
    fn text_and_answers_are_packets() {
        let (_door, mut client, mut wire) = connected();
        wire.say("hi").expect("connected");
        // 'O' + "68" + "69" + "0a": 0x4F + 6 digits.
        let sum: u32 = "O68690a".bytes().map(u32::from).sum();
        assert_eq!(
            heard(&mut client, 11),
            format!("$O68690a#{:02x}", sum % 256)
        );
        wire.confirm().expect("connected");
        assert_eq!(heard(&mut client, 6), "$OK#9a");
        wire.write(b'a').expect("kept");
        Connection::write_all(&mut wire, b"bc").expect("kept");
        Connection::flush(&mut wire).expect("connected");
        assert_eq!(heard(&mut client, 3), "abc");
    }

    #[test]
    fn bytes_come_one_by_one() {
        let (door, mut client, mut wire) = connected();
        assert_eq!(wire.try_next().expect("connected"), None);
        send(&mut client, b"ab");
        assert_eq!(wire.next(&door, &|| true).expect("connected"), Some(b'a'));
        assert_eq!(wire.next(&door, &|| false).expect("connected"), Some(b'b'));
        assert_eq!(wire.next(&door, &|| false).expect("connected"), None);
        // What was written goes out before anything is waited for.
        wire.write(b'x').expect("kept");
        assert_eq!(wire.try_next().expect("connected"), None);
        assert_eq!(heard(&mut client, 1), "x");
        drop(client);
        let gone = wire.next(&door, &|| true).expect_err("it is gone");
        assert_eq!(gone.kind(), io::ErrorKind::UnexpectedEof);
    }

    /// Ctrl-C of a debugger is the byte 3.
    #[test]
    fn an_interrupt_is_heard_while_nothing_is_read() {
        let (_door, mut client, mut wire) = connected();
        let ear = wire.ear().expect("connected");
        assert!(!ear.hears_interrupt());
        send(&mut client, b"ab");
        wait(&[&wire.stream]).expect("connected");
        assert!(!ear.hears_interrupt());
        send(&mut client, b"\x03cd");
        while !ear.hears_interrupt() {
            wait(&[&wire.stream]).expect("connected");
        }
        wire.take_interrupt().expect("connected");
        assert_eq!(wire.try_next().expect("connected"), Some(b'c'));
        drop(client);
        wait(&[&wire.stream]).expect("connected");
        while !ear.hears_interrupt() {
            wait(&[&wire.stream]).expect("connected");
        }
    }

    #[test]
    fn a_second_debugger_is_turned_away() {
        let (door, _client, _wire) = connected();
        let mut second = TcpStream::connect(door.address).expect("it listens");
        door.turn_away();
        let mut byte = [0];
        assert_eq!(second.read(&mut byte).expect("closed"), 0);
        assert!(door.accept(&|| false).expect("it listens").is_none());
        let port = door.address.port();
        let taken = Door::open(port);
        assert!(matches!(taken, Err(GuestError::DebugPort { port: of, .. }) if of == port));
        assert!(door.address.ip().is_loopback());
    }
}
