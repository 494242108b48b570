//! The shared state of the run's thread and the pages.

use core::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use tokio::sync::{mpsc, watch};

use super::command::{Answer, Command, Envelope};
use super::snapshot::Snapshot;
use super::timeline::Timeline;
use engine::run::wire_log::WireLog;

/// Maximum number of queued commands; further ones are refused.
const COMMANDS_MAX: usize = 256;

/// The newest snapshot, the timeline, and a queue of commands.
#[derive(Debug)]
pub struct Hub {
    snapshots: watch::Sender<Option<Arc<Snapshot>>>,
    commands: mpsc::Sender<Envelope>,
    waiting: Mutex<mpsc::Receiver<Envelope>>,
    pub(super) timeline: RwLock<Timeline>,
    pub(super) log: Arc<Mutex<WireLog>>,
    clients: AtomicUsize,
}

impl Default for Hub {
    fn default() -> Self {
        let (commands, waiting) = mpsc::channel(COMMANDS_MAX);
        Self {
            snapshots: watch::Sender::new(None),
            commands,
            waiting: Mutex::new(waiting),
            timeline: RwLock::default(),
            log: Arc::default(),
            clients: AtomicUsize::new(0),
        }
    }
}

impl Hub {
    /// A hub without connected pages.
    pub fn new() -> Arc<Self> {
        Arc::default()
    }

    /// Number of connected pages.
    pub(crate) fn clients(&self) -> usize {
        self.clients.load(Ordering::Relaxed)
    }

    /// Admits a page; returns `false` if there are already `most` pages.
    pub(super) fn enter(&self, most: usize) -> bool {
        let enter = |clients: usize| (clients < most).then_some(clients + 1);
        let order = Ordering::Relaxed;
        self.clients.fetch_update(order, order, enter).is_ok()
    }

    /// Removes a page.
    pub(super) fn leave(&self) {
        self.clients.fetch_sub(1, Ordering::Relaxed);
    }

    /// Shows a snapshot to all pages.
    pub(super) fn show(&self, snapshot: Snapshot) {
        self.snapshots.send_replace(Some(Arc::new(snapshot)));
    }

    /// A receiver of snapshots, for a page.
    pub(super) fn snapshots(&self) -> watch::Receiver<Option<Arc<Snapshot>>> {
        self.snapshots.subscribe()
    }

    /// Queues a command; if the queue is full, refuses it over `reply`.
    pub(super) fn ask(&self, command: Command, reply: &mpsc::Sender<Answer>) {
        let reply = reply.clone();
        if let Err(error) = self.commands.try_send(Envelope { command, reply }) {
            let busy = "too many commands at once".to_owned();
            error.into_inner().answer(Answer::Refused(busy));
        }
    }

    /// The next command for the run, if there is one.
    pub(super) fn next_command(&self) -> Option<Envelope> {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.try_recv().ok()
    }
}
