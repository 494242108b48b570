//! A transport whose other end is in this process, for tests.

use core::cell::RefCell;
use std::collections::VecDeque;
use std::os::fd::BorrowedFd;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::{Counters, PortEvent, Transport, TransportError};

/// Bytes that one direction holds for a reader, as a Linux terminal.
const CAPACITY: usize = 4096;

/// One of two connected ends.
#[derive(Debug)]
pub struct Memory {
    path: PathBuf,
    incoming: Rc<RefCell<VecDeque<u8>>>,
    outgoing: Rc<RefCell<VecDeque<u8>>>,
    counters: Counters,
    events: VecDeque<PortEvent>,
    far_end_open: bool,
}

impl Memory {
    /// Two connected ends, both open.
    pub fn pair(name: &str) -> (Self, Self) {
        let there = Rc::default();
        let back = Rc::default();
        let end = |incoming: &Rc<_>, outgoing: &Rc<_>| Self {
            path: PathBuf::from(name),
            incoming: Rc::clone(incoming),
            outgoing: Rc::clone(outgoing),
            counters: Counters::default(),
            events: VecDeque::from([PortEvent::Opened]),
            far_end_open: true,
        };
        (end(&back, &there), end(&there, &back))
    }
}

impl Transport for Memory {
    fn read(&mut self, buf: &mut [u8]) -> Result<usize, TransportError> {
        let mut incoming = self.incoming.borrow_mut();
        let len = buf.len().min(incoming.len());
        for (to, from) in buf.iter_mut().zip(incoming.drain(..len)) {
            *to = from;
        }
        // The other end holds the second reference to each queue.
        if len == 0 && self.far_end_open && Rc::strong_count(&self.incoming) == 1 {
            self.far_end_open = false;
            self.events.push_back(PortEvent::Closed);
        }
        Ok(len)
    }

    fn write(&mut self, bytes: &[u8]) -> usize {
        if Rc::strong_count(&self.outgoing) == 1 {
            self.counters.unheard += bytes.len() as u64;
            return 0;
        }
        let mut outgoing = self.outgoing.borrow_mut();
        let room = bytes.len().min(CAPACITY - outgoing.len());
        outgoing.extend(&bytes[..room]);
        self.counters.overrun += (bytes.len() - room) as u64;
        room
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

    fn readiness<'a>(&'a self, _fds: &mut Vec<BorrowedFd<'a>>) {}
}
