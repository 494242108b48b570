//! Master side of a register bus: one transaction at a time, repeated until the slave answers or
//! the last try times out.
//!
//! ```text
//! submit -> waiting (8) -> current: request out, answer in or time-out, three tries -> done (8)
//! ```
//!
//! The bus has no sequence numbers, so an answer must repeat the request: register, direction and
//! count must match, and the request must have been sent. All other frames are counted and dropped.
//! (The fielded program compared only the register and accepted acknowledgements and short replies
//! as data.) After a repeated request a late answer to an earlier try may still arrive. The line
//! therefore stays idle for one timeout, so that the late answer cannot match the next request.

mod listener;
mod request;

use core::time::Duration;

use protocols::avr::{self, ChecksumOrder, Frame, registers};
use protocols::{Decode, Instant};

use crate::fifo::Fifo;
use crate::memory::StrayWrites;
pub use listener::Defects;
use listener::Listener;
pub use request::Request;

/// Maximum number of registers that a request reads.
pub const READ_MAX: usize = 16;
/// Maximum number of registers that a request writes.
pub const WRITE_MAX: usize = 8;

/// Number of times that a request is sent before it fails (seed report: repeated until answered;
/// field program: three times in all).
const TRIES: u8 = 3;
/// Given-up transactions in a row after which the slave counts as silent.
const SILENT_AFTER: u8 = 2;
const QUEUE: usize = 8;
const REQUEST_MAX: usize = WRITE_MAX + avr::OVERHEAD;

/// Outcome of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The registers' bytes; beyond the request's count they are 0.
    Data([u8; READ_MAX]),
    /// The slave acknowledged a write.
    Written,
    /// No answer to any of the tries.
    Failed,
}

/// A request that has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Completion {
    /// The request that this result answers.
    pub request: Request,
    /// Time at which the answer was complete, or the last try failed.
    pub at: Instant,
    /// Outcome of the request.
    pub outcome: Outcome,
}

/// Counters of the bus since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Requests answered.
    pub answered: u32,
    /// Requests sent again.
    pub retries: u32,
    /// Number of aborted requests.
    pub failures: u32,
    /// Valid frames that did not answer the request: late, unsolicited, or of another kind.
    pub unsolicited: u32,
    /// Error frames: the slave did not understand.
    pub errors: u32,
    /// Frame candidates that were cut off or have a checksum mismatch.
    pub bad_frames: u32,
    /// Requests or completions lost because a queue was full.
    pub overflows: u32,
}

#[derive(Clone, Copy, Debug)]
struct Transaction {
    request: Request,
    tries: u8,
    deadline: Instant,
}

/// Master end of the bus.
#[derive(Clone, Debug)]
pub struct BaseLink {
    order: ChecksumOrder,
    timeout: Duration,
    decoder: avr::Decoder,
    tx: Fifo<REQUEST_MAX>,
    current: Option<Transaction>,
    waiting: Queue<Request>,
    done: Queue<Completion>,
    quiet_until: Instant,
    failures_in_a_row: u8,
    counters: Counters,
    /// The last unsolicited status that the program has not read yet.
    status: Option<u8>,
    defects: Defects,
    listener: Listener,
    /// Stale bytes of the readers' buffer.
    stale: [u8; READ_MAX],
    /// The request that the current one has pushed aside (MA-08).
    aside: Option<Transaction>,
}

impl BaseLink {
    /// A link to a slave with checksum `order`; each request waits `timeout` for its answer.
    pub const fn new(order: ChecksumOrder, timeout: Duration) -> Self {
        Self::with_defects(order, timeout, Defects::NONE)
    }

    /// A link with the given defects of the fielded program.
    pub const fn with_defects(order: ChecksumOrder, timeout: Duration, defects: Defects) -> Self {
        Self {
            defects,
            listener: Listener::new(),
            stale: [0; READ_MAX],
            aside: None,
            order,
            timeout,
            decoder: avr::Decoder::new(order),
            tx: Fifo::new(),
            current: None,
            waiting: Queue::new(),
            done: Queue::new(),
            quiet_until: Instant::ZERO,
            failures_in_a_row: 0,
            counters: Counters {
                answered: 0,
                retries: 0,
                failures: 0,
                unsolicited: 0,
                errors: 0,
                bad_frames: 0,
                overflows: 0,
            },
            status: None,
        }
    }

    /// Queues a request. A waiting request for the same registers in the same direction is replaced
    /// at its position in the queue: of two set-points only the newer one matters.
    pub fn submit(&mut self, now: Instant, request: Request) {
        if let Some(same) = self
            .waiting
            .iter_mut()
            .find(|other| request.replaces(other))
        {
            *same = request;
        } else if !self.waiting.push(request) {
            self.counters.overflows = self.counters.overflows.saturating_add(1);
        }
        self.preempt(now);
        self.tick(now);
    }

    /// Whether an equal request waits or is in progress.
    pub fn is_pending(&mut self, request: &Request) -> bool {
        self.current
            .is_some_and(|current| request.replaces(&current.request))
            || self.waiting.iter_mut().any(|other| request.replaces(other))
    }

    /// Takes bytes from the bus.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) {
        if self.defects != Defects::NONE {
            self.listen(bytes);
        }
        let mut input = bytes;
        while let Some(frame) = self.decoder.step(&mut input) {
            match frame {
                Ok(frame) => self.judge(now, &frame),
                Err(_) => count(&mut self.counters.bad_frames),
            }
        }
        self.tick(now);
    }

    /// Whether bytes wait for the bus.
    pub const fn has_output(&self) -> bool {
        !self.tx.is_empty()
    }

    /// Moves bytes for the bus into `buf`; returns how many.
    pub fn transmit(&mut self, buf: &mut [u8]) -> usize {
        self.tx.pop(buf)
    }

    /// Handles timeouts and begins the next transaction if the line is free.
    pub fn tick(&mut self, now: Instant) {
        if let Some(current) = self.current
            && now >= current.deadline
        {
            self.give_up_try(now);
        }
        if self.current.is_none()
            && now >= self.quiet_until
            && let Some(request) = self.waiting.pop()
        {
            self.decoder.idle();
            self.settle(now);
            self.send(
                now,
                Transaction {
                    request,
                    tries: 0,
                    deadline: now,
                },
            );
        }
    }

    /// Time of the next call of [`tick`](Self::tick).
    pub fn next_at(&self) -> Option<Instant> {
        match self.current {
            Some(current) => Some(current.deadline),
            None => (!self.waiting.is_empty()).then_some(self.quiet_until),
        }
    }

    /// The oldest request that has ended.
    pub fn take_completion(&mut self) -> Option<Completion> {
        self.done.pop()
    }

    /// Whether the slave has stopped answering.
    pub const fn is_silent(&self) -> bool {
        self.failures_in_a_row >= SILENT_AFTER && !self.defects.ignores_failures
    }

    /// Writes that the fielded program's interrupt would have made outside its reader's buffer.
    pub const fn stray_writes(&self) -> StrayWrites {
        self.listener.stray
    }

    /// The counters so far.
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Handles a received frame.
    fn judge(&mut self, now: Instant, frame: &Frame) {
        let is_error =
            frame.register() == avr::ERROR_REGISTER && !frame.is_write() && frame.count() == 0;
        match self.current {
            Some(current) if self.is_answered_by(current, frame) => {
                self.take_answer(now, current, frame);
            }
            Some(_) if self.tx.is_empty() && is_error => {
                count(&mut self.counters.errors);
                self.give_up_try(now);
            }
            _ => self.take_unasked(frame),
        }
    }

    /// Stores an unsolicited status, which reports the stop button (seed report, chapter on the
    /// slave).
    fn take_unasked(&mut self, frame: &Frame) {
        match frame.data() {
            [status] if frame.is_write() && frame.register() == registers::SYSTEM_STATUS => {
                self.status = Some(*status);
            }
            _ => count(&mut self.counters.unsolicited),
        }
    }

    /// The unsolicited status of the base since the last call.
    pub const fn take_status(&mut self) -> Option<u8> {
        self.status.take()
    }

    fn is_answered_by(&self, current: Transaction, frame: &Frame) -> bool {
        self.tx.is_empty() && current.request.is_answered_by(frame, &self.defects)
    }

    fn take_answer(&mut self, now: Instant, current: Transaction, frame: &Frame) {
        count(&mut self.counters.answered);
        self.failures_in_a_row = 0;
        if current.tries > 1 {
            self.quiet_until = now + self.timeout;
        }
        let outcome = if current.request.is_write() {
            Outcome::Written
        } else {
            Outcome::Data(self.data_of(frame))
        };
        self.finish(now, current.request, outcome);
    }

    /// The data of a reply, in a fresh buffer; the fielded program reused a buffer that kept older
    /// data.
    fn data_of(&mut self, frame: &Frame) -> [u8; READ_MAX] {
        let mut data = [0; READ_MAX];
        if self.defects.takes_short_replies || self.defects.takes_acknowledgements {
            data = self.stale;
        }
        data[..frame.data().len()].copy_from_slice(frame.data());
        self.stale = data;
        data
    }

    /// Lets the fielded program's interrupt see the bytes.
    fn listen(&mut self, bytes: &[u8]) {
        let wanted = self.current.map(|current| match current.request.data {
            Some(_) => 0,
            None => current.request.count,
        });
        for &byte in bytes {
            self.listener.take(byte, wanted, &self.defects);
        }
    }

    /// Sends the waiting request in the middle of another read, as a task of higher priority did
    /// (MA-08).
    fn preempt(&mut self, now: Instant) {
        let reads = |current: &Transaction| !current.request.is_write();
        if !self.defects.preempts_itself
            || self.aside.is_some()
            || !self.current.as_ref().is_some_and(reads)
        {
            return;
        }
        if let Some(request) = self.waiting.pop() {
            self.aside = self.current.take();
            let (tries, deadline) = (0, now);
            self.send(
                now,
                Transaction {
                    request,
                    tries,
                    deadline,
                },
            );
        }
    }

    /// The current try got no answer.
    fn give_up_try(&mut self, now: Instant) {
        // A damaged byte count keeps the decoder waiting and can hide the real answer.
        self.decoder.idle();
        self.settle(now);
        let Some(current) = self.current else {
            return;
        };
        if current.tries < TRIES {
            count(&mut self.counters.retries);
            self.send(now, current);
        } else {
            count(&mut self.counters.failures);
            self.failures_in_a_row = self.failures_in_a_row.saturating_add(1);
            self.quiet_until = now + self.timeout;
            self.tx.clear();
            self.finish(now, current.request, Outcome::Failed);
        }
    }

    /// Checks the frames that the decoder releases after an idle line for an answer.
    fn settle(&mut self, now: Instant) {
        while let Some(frame) = self.decoder.step(&mut &[][..]) {
            match frame {
                Ok(frame) => match self.current {
                    Some(current) if self.is_answered_by(current, &frame) => {
                        self.take_answer(now, current, &frame);
                    }
                    _ => self.take_unasked(&frame),
                },
                Err(_) => count(&mut self.counters.bad_frames),
            }
        }
    }

    fn send(&mut self, now: Instant, transaction: Transaction) {
        self.tx.clear();
        self.listener.arm();
        let fits = self
            .tx
            .push(transaction.request.frame(self.order).as_bytes());
        debug_assert!(fits, "the queue holds the longest request");
        self.current = Some(Transaction {
            tries: transaction.tries + 1,
            deadline: now + self.timeout,
            ..transaction
        });
    }

    fn finish(&mut self, at: Instant, request: Request, outcome: Outcome) {
        self.current = self.aside.take();
        if !self.done.push(Completion {
            request,
            at,
            outcome,
        }) {
            count(&mut self.counters.overflows);
        }
    }
}

fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

/// A queue of few values, oldest first; occupied slots come first.
#[derive(Clone, Debug)]
struct Queue<T> {
    slots: [Option<T>; QUEUE],
}

impl<T: Copy> Queue<T> {
    const fn new() -> Self {
        Self {
            slots: [None; QUEUE],
        }
    }

    fn push(&mut self, value: T) -> bool {
        match self.slots.iter_mut().find(|slot| slot.is_none()) {
            Some(slot) => {
                *slot = Some(value);
                true
            }
            None => false,
        }
    }

    fn pop(&mut self) -> Option<T> {
        let first = self.slots[0].take()?;
        self.slots.rotate_left(1);
        Some(first)
    }

    const fn is_empty(&self) -> bool {
        self.slots[0].is_none()
    }

    fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.slots.iter_mut().flatten()
    }
}

#[cfg(test)]
mod tests;
