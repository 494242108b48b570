//! The HTTP server: four files, past moments, frames, the case, and a WebSocket per page.
//!
//! Every request contains the token of the page's address (`token`); the number and duration of
//! connections are limited (`connections`).

use core::future::{Future, poll_fn};
use core::net::SocketAddr;
use core::pin::pin;
use core::task::Poll;
use core::time::Duration;
use std::io;
use std::net::TcpListener as StdListener;
use std::sync::{Arc, PoisonError};

use axum::Router;
use axum::extract::ws::{Message as Frame, WebSocket, WebSocketUpgrade};
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use protocols::Instant;
use tokio::net::TcpListener;
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{mpsc, watch};
use tokio::time::timeout;

use super::command::{Answer, COMMAND_MAX, Command};
use super::connections;
use super::delta::{Message, SentSoFar};
use super::guard;
use super::hub::Hub;
use super::snapshot::Snapshot;
use super::token::Token;
use engine::run::wire_log;
use show::view;

/// Maximum number of simultaneous pages.
pub(crate) const CLIENTS_MAX: usize = 50;
/// Timeout for sending a message to a page; after it the page is disconnected.
const SEND_MAX: Duration = Duration::from_secs(20);
/// Timeout for an answer of the run.
const ANSWER_MAX: Duration = Duration::from_secs(5);
/// Maximum number of queued answers for a page; further ones are lost.
const ANSWERS_MAX: usize = 16;

/// The page's script: its parts in order of dependency, in one scope.
const SCRIPT: &str = concat!(
    include_str!("assets/page.js"),
    include_str!("assets/stage.js"),
    include_str!("assets/timeline.js"),
    include_str!("assets/robot.js"),
    include_str!("assets/checks.js"),
    include_str!("assets/faults.js"),
    include_str!("assets/frames.js"),
    include_str!("assets/exchanges.js"),
    include_str!("assets/controls.js"),
);

/// Scripts, styles and pictures only from this server, none inline; no other page may embed this
/// page in a frame.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
                      connect-src 'self'; img-src 'self' data: blob:; base-uri 'none'; \
                      form-action 'none'; frame-ancestors 'none'";

/// A running server; it ends when it is dropped.
#[derive(Debug)]
pub struct Server {
    runtime: Option<Runtime>,
    address: SocketAddr,
    token: Token,
}

impl Server {
    /// Starts a server at `listen`; port 0 selects a free one.
    ///
    /// # Errors
    /// If the address is not available, or the system has no random numbers.
    pub fn start(listen: SocketAddr, hub: Arc<Hub>) -> io::Result<Self> {
        let runtime = Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("page")
            .enable_all()
            .build()?;
        let listener = StdListener::bind(listen)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let token = Token::new()?;
        let app = router(hub, address, &token);
        let listener = {
            let _context = runtime.enter();
            TcpListener::from_std(listener)?
        };
        runtime.spawn(connections::serve(listener, app));
        Ok(Self {
            runtime: Some(runtime),
            address,
            token,
        })
    }

    /// The address of the server.
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address of the page with the token, which each of its requests must contain.
    pub fn url(&self) -> String {
        format!("http://{}/?{}", self.address, self.token.query())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

fn router(hub: Arc<Hub>, address: SocketAddr, token: &Token) -> Router {
    let file = |kind: &'static str, text: &'static str| {
        get(move || async move { ([(header::CONTENT_TYPE, kind)], text) })
    };
    let (script, style) = ("text/javascript; charset=utf-8", "text/css; charset=utf-8");
    // Files that the page loads need the token too.
    let index = include_str!("assets/index.html").replace("?token", &format!("?{}", token.query()));
    let html = (header::CONTENT_TYPE, "text/html; charset=utf-8");
    let index = get(move || async move { ([html], index) });
    Router::new()
        .route("/", index)
        .route("/style.css", file(style, include_str!("assets/style.css")))
        .route("/view.js", file(script, view::SCRIPT))
        .route("/lanes.js", file(script, view::LANES))
        .route("/page.js", file(script, SCRIPT))
        .route("/moment", get(moment))
        .route("/frames", get(frames))
        .route("/exchanges", get(exchanges))
        .route("/case.toml", get(case))
        .route("/ws", get(page))
        .with_state(hub)
        .layer(from_fn_with_state((address, token.clone()), guarded))
}

/// Rejects foreign requests, and adds security headers to answers.
async fn guarded(
    State((listen, token)): State<(SocketAddr, Token)>,
    request: Request,
    next: Next,
) -> Response {
    if !is_admitted(listen, request.headers()) {
        let expected = format!("expected a request for http://{listen}/ from its own page\n");
        return (StatusCode::FORBIDDEN, expected).into_response();
    }
    if !token.is_in(request.uri().query()) {
        let expected = "expected the address that hilrig printed, with its ?token=..\n";
        return (StatusCode::FORBIDDEN, expected).into_response();
    }
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// An unreadable origin counts as foreign. Browsers never send a header twice; a proxy could use
/// the second one.
fn is_admitted(listen: SocketAddr, headers: &HeaderMap) -> bool {
    let is_doubled = |name: HeaderName| headers.get_all(name).iter().nth(1).is_some();
    if is_doubled(header::HOST) || is_doubled(header::ORIGIN) {
        return false;
    }
    let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    guard::admits(listen, text(header::HOST), text(header::ORIGIN))
}

/// The number for `key` in a query.
fn number(uri: &Uri, key: &str) -> Option<u64> {
    let mut pairs = uri
        .query()?
        .split('&')
        .filter_map(|pair| pair.split_once('='));
    let (_, number) = pairs.find(|(name, _)| *name == key)?;
    number.parse().ok()
}

fn expected(what: &'static str) -> Response {
    (StatusCode::BAD_REQUEST, what).into_response()
}

/// The complete state of the page for `/moment?at_ns=..`.
async fn moment(State(hub): State<Arc<Hub>>, uri: Uri) -> Response {
    let Some(at) = number(&uri, "at_ns").map(Instant::from_nanos) else {
        return expected("expected /moment?at_ns=NUMBER\n");
    };
    let timeline = hub.timeline.read().unwrap_or_else(PoisonError::into_inner);
    match timeline.moment_at(at) {
        Some(snapshot) => snapshot.whole().into_response(),
        None => (StatusCode::NOT_FOUND, "nothing was recorded yet\n").into_response(),
    }
}

/// The newest frames up to `/frames?at_ns=..`; `&lane=..` selects one direction of a link.
async fn frames(State(hub): State<Arc<Hub>>, uri: Uri) -> Response {
    let Some(at) = number(&uri, "at_ns").map(Instant::from_nanos) else {
        return expected("expected /frames?at_ns=NUMBER or /frames?at_ns=NUMBER&lane=NUMBER\n");
    };
    let lane = number(&uri, "lane").and_then(|lane| usize::try_from(lane).ok());
    let log = hub.log.lock().unwrap_or_else(PoisonError::into_inner);
    let tails = log.tails(at, lane);
    // The run must not wait for the decoders.
    drop(log);
    let kind = (header::CONTENT_TYPE, "application/json");
    let text = serde_json::json!({"frames": wire_log::frames(&tails)});
    ([kind], text.to_string()).into_response()
}

/// Maximum number of listed requests and replies.
const EXCHANGES_MAX: usize = 200;

/// The newest requests and replies up to `/exchanges?at_ns=..`, and figures of each link.
async fn exchanges(State(hub): State<Arc<Hub>>, uri: Uri) -> Response {
    let Some(at) = number(&uri, "at_ns").map(Instant::from_nanos) else {
        return expected("expected /exchanges?at_ns=NUMBER\n");
    };
    let log = hub.log.lock().unwrap_or_else(PoisonError::into_inner);
    let heard = log.heard(at);
    // The run must not wait for the decoders.
    drop(log);
    let value = serde_json::json!(heard.dialogue(EXCHANGES_MAX));
    let kind = (header::CONTENT_TYPE, "application/json");
    ([kind], value.to_string()).into_response()
}

/// The run so far, as a scenario.
async fn case(State(hub): State<Arc<Hub>>) -> Response {
    let (reply, mut answers) = mpsc::channel(1);
    hub.ask(Command::Save, &reply);
    drop(reply);
    match timeout(ANSWER_MAX, answers.recv()).await {
        Ok(Some(Answer::Case(text))) => {
            let name = "attachment; filename=\"case.toml\"";
            let kind = (header::CONTENT_TYPE, "application/toml");
            ([kind, (header::CONTENT_DISPOSITION, name)], text).into_response()
        }
        Ok(Some(Answer::Refused(why))) => (StatusCode::CONFLICT, why + "\n").into_response(),
        Ok(None) | Err(_) => (StatusCode::SERVICE_UNAVAILABLE, "the run is gone\n").into_response(),
    }
}

/// Connects a page.
async fn page(State(hub): State<Arc<Hub>>, upgrade: WebSocketUpgrade) -> Response {
    if !hub.enter(CLIENTS_MAX) {
        let full = format!("{CLIENTS_MAX} pages are connected already\n");
        return (StatusCode::SERVICE_UNAVAILABLE, full).into_response();
    }
    let place = Visitor(hub);
    upgrade
        .max_message_size(COMMAND_MAX)
        .max_frame_size(COMMAND_MAX)
        .on_upgrade(move |socket| async move { serve(socket, place).await })
}

/// A connected page, removed from the hub when it is dropped.
struct Visitor(Arc<Hub>);

impl Drop for Visitor {
    fn drop(&mut self) {
        self.0.leave();
    }
}

/// The event that wakes the task of a page.
enum Wake {
    Heard(Option<Result<Frame, axum::Error>>),
    Snapshot(Result<(), watch::error::RecvError>),
    Answer(Option<Answer>),
}

async fn serve(mut socket: WebSocket, place: Visitor) {
    let hub = &place.0;
    let (reply, mut answers) = mpsc::channel(ANSWERS_MAX);
    let mut snapshots = hub.snapshots();
    snapshots.mark_changed();
    let mut seen = SentSoFar::default();
    loop {
        let frames = match wake(&mut socket, &mut snapshots, &mut answers).await {
            Wake::Heard(Some(Ok(Frame::Text(text)))) => {
                match Command::parse(&text) {
                    Ok(command) => hub.ask(command, &reply),
                    Err(why) => drop(reply.try_send(Answer::Refused(why))),
                }
                continue;
            }
            Wake::Heard(Some(Ok(Frame::Ping(_) | Frame::Pong(_)))) => continue,
            Wake::Heard(_) | Wake::Snapshot(Err(_)) | Wake::Answer(None) => return,
            Wake::Snapshot(Ok(())) => {
                let snapshot = snapshots.borrow_and_update().clone();
                snapshot.map_or_else(Vec::new, |snapshot| news(hub, &mut seen, &snapshot))
            }
            Wake::Answer(Some(Answer::Refused(why))) => {
                let text = serde_json::json!({"type": "refused", "why": why}).to_string();
                vec![Frame::Text(text.into())]
            }
            Wake::Answer(Some(Answer::Case(_))) => continue,
        };
        for frame in frames {
            // A page that does not read delays only itself, and only up to a timeout.
            if !matches!(timeout(SEND_MAX, socket.send(frame)).await, Ok(Ok(()))) {
                return;
            }
        }
    }
}

fn news(hub: &Hub, seen: &mut SentSoFar, snapshot: &Snapshot) -> Vec<Frame> {
    let timeline = hub.timeline.read().unwrap_or_else(PoisonError::into_inner);
    let frame = |message| match message {
        Message::Text(text) => Frame::Text(text),
        Message::Rows(rows) => Frame::Binary(rows),
    };
    seen.news(snapshot, &timeline)
        .into_iter()
        .map(frame)
        .collect()
}

/// Waits for the first of three events. All three are cancel-safe.
async fn wake(
    socket: &mut WebSocket,
    snapshots: &mut watch::Receiver<Option<Arc<Snapshot>>>,
    answers: &mut mpsc::Receiver<Answer>,
) -> Wake {
    let mut heard = pin!(socket.recv());
    let mut snapshot = pin!(snapshots.changed());
    let mut answer = pin!(answers.recv());
    poll_fn(|context| {
        if let Poll::Ready(heard) = heard.as_mut().poll(context) {
            return Poll::Ready(Wake::Heard(heard));
        }
        if let Poll::Ready(answer) = answer.as_mut().poll(context) {
            return Poll::Ready(Wake::Answer(answer));
        }
        snapshot.as_mut().poll(context).map(Wake::Snapshot)
    })
    .await
}
