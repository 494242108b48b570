//! Polling of a port, for asynchronous drivers.

use core::task::{Context, Poll, ready};
use std::io;

use super::VirtualPort;
use crate::state::hung_up;
use crate::turns::Until;

impl VirtualPort {
    pub(crate) fn poll_read(&self, cx: &Context<'_>, buf: &mut [u8]) -> Poll<io::Result<usize>> {
        if buf.is_empty() {
            return Poll::Ready(Ok(0));
        }
        let mut turn = self.bench.core.enter()?;
        let end = turn.end();
        ready!(turn.poll(cx, Until::Readable(self.index), end))?;
        Poll::Ready(Ok(turn.port(self.index)?.1.take(buf)))
    }

    pub(crate) fn poll_write(&self, cx: &Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        let mut turn = self.bench.core.enter()?;
        let end = turn.end();
        ready!(turn.poll(cx, Until::Room(self.index), end))?;
        if turn.now() >= end {
            return Poll::Ready(Err(hung_up()));
        }
        let (run, port) = turn.port(self.index)?;
        Poll::Ready(port.give(run, buf))
    }

    pub(crate) fn poll_flush(&self, cx: &Context<'_>) -> Poll<io::Result<()>> {
        let mut turn = self.bench.core.enter()?;
        let end = turn.end();
        ready!(turn.poll(cx, Until::Sent(self.index), end))?;
        let (run, port) = turn.port(self.index)?;
        Poll::Ready(port.is_sent(run).then_some(()).ok_or_else(hung_up))
    }
}
