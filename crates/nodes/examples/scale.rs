//! The device of `nodes/examples/scale.py` in Rust: a balance with the protocol MT-SICS. Its weight
//! drifts, and zeroing takes a second.

use nodes::message::{Greeting, Hello, Note, Reply};
use nodes::program::{Node, serve};
use nodes::{Input, Item, Output};
use protocols::Instant;

const SECOND: u64 = 1_000_000_000;
/// Time from a request to its answer.
const LATENCY: u64 = 30_000_000;

/// Maximum length of a line with its end.
const LINE_MAX: usize = 63;

struct Scale {
    load_g: f64,
    zero_g: f64,
    busy_until: u64,
    zero_at: Option<u64>,
    state: char,
    line: Vec<u8>,
}

impl Scale {
    fn net_g(&self, now: u64) -> f64 {
        let steps = u32::try_from(now / (SECOND / 2)).unwrap_or(u32::MAX);
        self.load_g + 0.01 * f64::from(steps) - self.zero_g
    }

    fn hear(&mut self, now: u64, line: &str, out: &mut Vec<Item<Output>>) {
        let at = |nanos| Instant::from_nanos(nanos);
        let mut put = |time, what| {
            out.push(Item {
                port: 0,
                at: at(time),
                what,
            });
        };
        if now < self.busy_until {
            let note = Note {
                is_violation: true,
                rule: "too-fast".to_owned(),
                detail: format!("{line} came while the scale is busy"),
                bytes: Vec::new(),
            };
            put(now, Output::Note(note));
            return;
        }
        match line {
            "SI" => {
                let net = self.net_g(now);
                put(now, Output::Quantity(net));
                let text = format!("S {} {net:10.2} g\r\n", self.state);
                put(now + LATENCY, Output::Bytes(text.into_bytes()));
            }
            "ZI" => {
                self.busy_until = now + SECOND;
                self.zero_at = Some(now + SECOND);
            }
            _ => put(now + LATENCY, Output::Bytes(b"ES\r\n".to_vec())),
        }
    }
}

impl Node for Scale {
    fn greeting(&self) -> Greeting {
        Greeting {
            faults: vec!["draught".to_owned()],
            outputs: vec!["net_g".to_owned()],
            ..Greeting::default()
        }
    }

    fn exchange(&mut self, now: Instant, items: Vec<Item<Input>>) -> Reply {
        let mut out = Vec::new();
        for item in items {
            match item.what {
                Input::Bytes(bytes) => {
                    for byte in bytes {
                        // Of a line that is too long, the last bytes are kept.
                        if self.line.len() == LINE_MAX {
                            self.line.remove(0);
                        }
                        self.line.push(byte);
                        if let Some(line) = self.line.strip_suffix(b"\r\n") {
                            let line = String::from_utf8_lossy(line).into_owned();
                            self.line.clear();
                            self.hear(item.at.as_nanos(), &line, &mut out);
                        }
                    }
                }
                Input::Fault { begins, .. } => self.state = if begins { 'D' } else { 'S' },
                _ => {}
            }
        }
        if let Some(at) = self.zero_at.take_if(|at| *at <= now.as_nanos()) {
            self.zero_g += self.net_g(at);
            out.push(Item {
                port: 0,
                at: now,
                what: Output::Bytes(b"ZI S\r\n".to_vec()),
            });
        }
        Reply {
            next: self.zero_at.map(Instant::from_nanos),
            items: out,
        }
    }
}

pub(crate) fn scale(hello: &Hello) -> impl Node + use<> {
    Scale {
        load_g: hello.settings["load_g"].as_f64().unwrap_or_default(),
        zero_g: 0.0,
        busy_until: 0,
        zero_at: None,
        state: 'S',
        line: Vec::new(),
    }
}

fn main() -> std::io::Result<()> {
    serve(scale)
}
