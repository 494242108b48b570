//! Limits on the number and duration of connections. A connection with a partial header is closed.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::collections::VecDeque;
use std::sync::Arc;

use axum::Router;
use hyper::server::conn::http1;
use hyper::service::{Service as _, service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::AbortHandle;
use tokio::time::{sleep, timeout};

/// Maximum number of simultaneous connections other than pages: together with the pages they stay
/// below the limit of 256 descriptors of some systems.
const CONNECTIONS_MAX: usize = 64;
/// Timeout for the header of a request.
const HEADER_MAX: Duration = Duration::from_secs(5);
/// Timeout for a request and its answer, which is at most some megabytes on loopback.
const EXCHANGE_MAX: Duration = Duration::from_secs(30);
/// Pause after the system had no free descriptor.
const PAUSE: Duration = Duration::from_millis(50);
/// Maximum size of a header.
const HEADER_BYTES_MAX: usize = 16 << 10;

/// An open connection.
struct Open {
    task: AbortHandle,
    has_asked: Arc<AtomicBool>,
}

/// Serves `app` to all clients, forever.
pub(super) async fn serve(listener: TcpListener, app: Router) {
    let mut open = VecDeque::new();
    loop {
        match listener.accept().await {
            Ok((stream, _)) => {
                if make_room(&mut open) {
                    open.push_back(start(stream, app.clone()));
                }
            }
            Err(_) => {
                // Probably no free descriptor: the oldest connection without a request is closed.
                close_silent(&mut open);
                sleep(PAUSE).await;
            }
        }
    }
}

/// Makes room for one more connection, if necessary by closing one without a request; returns
/// whether there is room.
fn make_room(open: &mut VecDeque<Open>) -> bool {
    open.retain(|one| !one.task.is_finished());
    open.len() < CONNECTIONS_MAX || close_silent(open)
}

/// Closes the oldest connection without a request; returns whether there was one.
fn close_silent(open: &mut VecDeque<Open>) -> bool {
    let is_silent = |one: &Open| !one.has_asked.load(Ordering::Relaxed);
    let silent = open.iter().position(is_silent);
    let closed = silent.and_then(|index| open.remove(index));
    closed.inspect(|one| one.task.abort()).is_some()
}

fn start(stream: TcpStream, app: Router) -> Open {
    let has_asked = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&has_asked);
    let app = TowerToHyperService::new(app);
    let service = service_fn(move |request| {
        asked.store(true, Ordering::Relaxed);
        app.call(request)
    });
    let task = tokio::spawn(async move {
        // One request per connection, so that no connection is idle. A page continues as a
        // WebSocket in its own task.
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(HEADER_MAX)
            .max_buf_size(HEADER_BYTES_MAX)
            .keep_alive(false)
            .serve_connection(TokioIo::new(stream), service)
            .with_upgrades();
        let _ = timeout(EXCHANGE_MAX, connection).await;
    });
    Open {
        task: task.abort_handle(),
        has_asked,
    }
}
