//! `hilrig ui` as a process, and a minimal client: bytes on a TCP socket.

use std::io::{BufRead, BufReader, Lines, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

use core::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;

/// Maximum silence of a socket before a test fails.
const PATIENCE: Duration = Duration::from_secs(120);

/// A running command that ends with the test.
pub(crate) struct Process {
    child: Child,
    out: Lines<BufReader<ChildStdout>>,
}

impl Process {
    /// Starts `hilrig` with readable stdout.
    pub(crate) fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        // A page reconnects only to a server with the same token.
        command.env("HILRIG_TOKEN", "the-token-of-all-tests");
        command.args(arguments).stdout(Stdio::piped());
        command.stderr(Stdio::null()).stdin(Stdio::null());
        let mut child = command.spawn().expect("the command starts");
        let out = BufReader::new(child.stdout.take().expect("piped")).lines();
        Self { child, out }
    }

    /// Process id.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// Rest of the first stdout line that begins with `head`.
    pub(crate) fn line(&mut self, head: &str) -> String {
        let out = self.out.by_ref();
        let found = out.find_map(|line| Some(line.ok()?.strip_prefix(head)?.to_owned()));
        found.expect("the command says where it is")
    }

    /// Sends the end signal and waits for the end; returns whether the exit was successful.
    pub(crate) fn end(&mut self) -> bool {
        let pid = i32::try_from(self.id()).ok().and_then(Pid::from_raw);
        let told = kill_process(pid.expect("a child"), Signal::TERM);
        told.expect("it is our own process");
        self.ended()
    }

    /// Waits until the process ends by itself; returns whether the exit was successful.
    pub(crate) fn ended(&mut self) -> bool {
        // A process blocks once its output pipe is full, so its output is read.
        self.out.by_ref().for_each(drop);
        self.child.wait().expect("a child").success()
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A separate folder below the target folder.
pub(crate) fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("page-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("the target folder can be written");
    folder
}

/// The path of a shipped scenario.
pub(crate) fn scenario(name: &str) -> String {
    format!("{}/scenarios/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

/// Path of a copy of a shipped scenario that runs for an hour, whatever the result of its mission;
/// `test` names the test that owns it.
pub(crate) fn endless(name: &str, test: &str) -> String {
    let text = std::fs::read_to_string(scenario(name)).expect("shipped");
    let lines = text.lines().map(|line| match line {
        "[mission]" => "[mission]\nto_the_end = true\n".to_owned(),
        line if line.starts_with("duration = ") => "duration = \"1h\"\n".to_owned(),
        line => format!("{line}\n"),
    });
    let path = folder(&format!("endless-{test}")).join(format!("{name}.toml"));
    std::fs::write(&path, lines.collect::<String>()).expect("can be written");
    path.to_str().expect("plain letters").to_owned()
}

/// A server with its page.
pub(crate) struct Server {
    process: Process,
    /// Host and port.
    pub(crate) host: String,
    /// Token that each request must contain.
    pub(crate) token: String,
}

impl Server {
    /// Starts `hilrig ui` with these arguments.
    pub(crate) fn start(arguments: &[&str]) -> Self {
        Self::of_process(Process::start(&[&["ui"], arguments].concat()))
    }

    /// The page of a command that has a page besides other functions.
    pub(crate) fn of_process(mut process: Process) -> Self {
        let url = process.line("page at http://");
        let (host, token) = url.split_once("/?").expect("its token");
        Self {
            process,
            host: host.to_owned(),
            token: token.to_owned(),
        }
    }

    /// The process that serves it.
    pub(crate) const fn process(&mut self) -> &mut Process {
        &mut self.process
    }

    /// Serves a shipped scenario at `speed`.
    pub(crate) fn of(name: &str, speed: &str) -> Self {
        Self::start(&[&scenario(name), "--speed", speed])
    }

    /// Serves a shipped scenario that is paused at its beginning until a browser plays it at
    /// `speed`. On a busy machine, the run would otherwise be over before the browser is connected.
    pub(crate) fn held(name: &str, speed: &str) -> Self {
        Self::start(&[&scenario(name), "--speed", speed, "--paused"])
    }

    /// As [`held`](Self::held), but the run lasts an hour, so that it is not over before `test`
    /// ends, however slow the browser is.
    pub(crate) fn held_on(name: &str, speed: &str, test: &str) -> Self {
        Self::start(&[&endless(name, test), "--speed", speed, "--paused"])
    }

    /// The address of the page.
    pub(crate) fn url(&self) -> String {
        format!("http://{}/?{}", self.host, self.token)
    }

    pub(crate) fn connect(&self) -> TcpStream {
        let socket = TcpStream::connect(&self.host).expect("the server listens");
        let timeout = socket.set_read_timeout(Some(PATIENCE));
        timeout.expect("two minutes are a timeout");
        socket
    }

    /// Response to a GET with `headers` and the token: status and body.
    pub(crate) fn ask(&self, path: &str, headers: &[&str]) -> (u16, String) {
        let joint = if path.contains('?') { '&' } else { '?' };
        self.ask_as_it_is(&format!("{path}{joint}{}", self.token), headers)
    }

    /// Response to a GET with `headers`: status and body.
    pub(crate) fn ask_as_it_is(&self, path: &str, headers: &[&str]) -> (u16, String) {
        let mut socket = self.connect();
        let headers: String = headers.iter().map(|line| format!("{line}\r\n")).collect();
        let request = format!("GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n");
        socket.write_all(request.as_bytes()).expect("is read");
        let mut answer = Vec::new();
        let _ = socket.read_to_end(&mut answer);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let status = answer.get(9..12).and_then(|status| status.parse().ok());
        let body = answer
            .split_once("\r\n\r\n")
            .map(|(_, body)| body.to_owned());
        (status.expect("an answer"), body.unwrap_or_default())
    }

    /// Response to a GET of its own page.
    pub(crate) fn get(&self, path: &str) -> (u16, String) {
        self.ask(path, &[&format!("Host: {}", self.host)])
    }

    /// The session so far, as a scenario.
    pub(crate) fn case(&self) -> String {
        let (status, case) = self.get("/case.toml");
        assert_eq!(status, 200, "{case}");
        case
    }

    /// Opens a page without a browser; returns the status of the response if it is refused.
    pub(crate) fn page(&self) -> Result<Page, u16> {
        let mut socket = self.connect();
        let request = format!(
            "GET /ws?{} HTTP/1.1\r\nHost: {}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n",
            self.token, self.host
        );
        socket.write_all(request.as_bytes()).expect("is read");
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            socket.read_exact(&mut byte).expect("an answer");
            head.push(byte[0]);
        }
        let status = String::from_utf8_lossy(&head[9..12]).parse::<u16>();
        match status.expect("three digits") {
            101 => Ok(Page(socket)),
            status => Err(status),
        }
    }
}

/// A WebSocket, RFC 6455 chapter 5.
pub(crate) struct Page(TcpStream);

impl Page {
    /// Sends a text; a mask of zeros leaves it unchanged. `false` if the server has closed the
    /// connection.
    pub(crate) fn send(&mut self, text: &str) -> bool {
        let mut frame = vec![0x81];
        match text.len() {
            len @ 0..126 => frame.push(0x80 | u8::try_from(len).expect("short")),
            len => {
                frame.push(0x80 | 127);
                frame.extend((len as u64).to_be_bytes());
            }
        }
        frame.extend([0; 4]);
        frame.extend(text.as_bytes());
        self.0.write_all(&frame).is_ok()
    }

    /// The next message: its kind (1 text, 2 bytes) and its content; `None` at the end.
    fn frame(&mut self) -> Option<(u8, Vec<u8>)> {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).ok()?;
        let len = match head[1] {
            126 => {
                let mut len = [0; 2];
                self.0.read_exact(&mut len).ok()?;
                u64::from(u16::from_be_bytes(len))
            }
            127 => {
                let mut len = [0; 8];
                self.0.read_exact(&mut len).ok()?;
                u64::from_be_bytes(len)
            }
            len => u64::from(len),
        };
        let mut payload = vec![0; usize::try_from(len).expect("fits")];
        self.0.read_exact(&mut payload).ok()?;
        (head[0] & 0x0F != 8).then_some((head[0] & 0x0F, payload))
    }

    /// The next message of `kind` for which `condition` holds; `None` if the server closes the
    /// connection.
    pub(crate) fn hear(&mut self, kind: &str, condition: impl Fn(&Value) -> bool) -> Option<Value> {
        for _ in 0..100_000 {
            let (opcode, payload) = self.frame()?;
            if opcode != 1 {
                continue;
            }
            let message: Value = serde_json::from_slice(&payload).expect("texts are JSON");
            if message["type"] == kind && condition(&message) {
                return Some(message);
            }
        }
        panic!("{kind} was not heard in 100,000 messages");
    }
}
