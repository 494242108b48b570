//! The other end of the contract: a node program in Rust.
//!
//! ```no_run
//! use nodes::message::{Greeting, Input, Item, Output, Reply};
//! use nodes::program::{Node, serve};
//! use protocols::Instant;
//!
//! /// Sends back the received bytes.
//! struct Echo;
//!
//! impl Node for Echo {
//!     fn exchange(&mut self, now: Instant, items: Vec<Item<Input>>) -> Reply {
//!         let heard = items.into_iter().filter_map(|item| match item.what {
//!             Input::Bytes(bytes) => Some(Item {
//!                 port: item.port,
//!                 at: now,
//!                 what: Output::Bytes(bytes),
//!             }),
//!             _ => None,
//!         });
//!         Reply {
//!             next: None,
//!             items: heard.collect(),
//!         }
//!     }
//! }
//!
//! serve(|_| Echo)?;
//! # Ok::<(), std::io::Error>(())
//! ```

use std::io::{self, Read, Write};

use protocols::Instant;
use serde_json::json;

use crate::message::{Answer, Form, Greeting, Hello, Input, Item, Reply, Request};
use crate::{VERSION, binary, json};

/// A node that a program implements.
pub trait Node {
    /// The greeting of the node: faults, outputs, whether it can save. The version is filled in.
    fn greeting(&self) -> Greeting {
        Greeting::default()
    }

    /// Advances the node to `now`, with the inputs `items` since the last call.
    fn exchange(&mut self, now: Instant, items: Vec<Item<Input>>) -> Reply;

    /// The complete state as bytes.
    fn save(&self) -> Vec<u8> {
        Vec::new()
    }

    /// Loads a state that [`save`](Self::save) returned.
    fn load(&mut self, _state: &[u8]) {}
}

/// Runs the node that `make` creates from the rig's greeting, on standard input and output, until
/// the rig ends it.
///
/// # Errors
/// If a stream is closed, or the rig sends an invalid message.
pub fn serve<N: Node>(make: impl FnOnce(&Hello) -> N) -> io::Result<()> {
    serve_on(io::stdin().lock(), io::stdout().lock(), make)
}

/// Like [`serve`], on other streams.
///
/// # Errors
/// Those of [`serve`].
pub fn serve_on<N: Node>(
    mut from: impl Read,
    mut to: impl Write,
    make: impl FnOnce(&Hello) -> N,
) -> io::Result<()> {
    let mut stream = Stream::default();
    let (mut make, mut node) = (Some(make), None::<N>);
    let mut out = Vec::new();
    while let Some(request) = stream.next(&mut from)? {
        let answer = match (request, &mut node) {
            (Request::End, _) => return Ok(()),
            (Request::Hello(hello), _) => {
                if hello.hilrig_node != VERSION {
                    let answer = Answer::Hello(json!({ "hilrig_node": VERSION }));
                    write(stream.form, &mut out, &answer)?;
                    to.write_all(&out)?;
                    return wrong(format!("the rig speaks version {}", hello.hilrig_node));
                }
                let Some(make) = make.take() else {
                    return wrong("the rig greeted twice".to_owned());
                };
                let made = node.insert(make(&hello));
                let greeting = Greeting {
                    hilrig_node: VERSION,
                    ..made.greeting()
                };
                Answer::Hello(serde_json::to_value(greeting).map_err(io::Error::other)?)
            }
            (_, None) => return wrong("the rig did not greet".to_owned()),
            (Request::Exchange { now, items }, Some(node)) => {
                let mut reply = node.exchange(now, items);
                // Bytes ended shortly before the rig passed them on; no output may be in the past.
                let items = reply.items.iter_mut();
                items.for_each(|item| item.at = item.at.max(now));
                Answer::Exchange(reply)
            }
            (Request::Save, Some(node)) => Answer::Saved(node.save()),
            (Request::Load(state), Some(node)) => {
                node.load(&state);
                Answer::Loaded
            }
        };
        out.clear();
        write(stream.form, &mut out, &answer)?;
        to.write_all(&out)?;
        to.flush()?;
    }
    Ok(())
}

fn wrong<T>(what: String) -> io::Result<T> {
    Err(io::Error::new(io::ErrorKind::InvalidData, what))
}

fn write(form: Form, out: &mut Vec<u8>, answer: &Answer) -> io::Result<()> {
    match form {
        Form::Binary => binary::write_answer(out, answer).or_else(wrong),
        Form::Json => {
            json::write_answer(out, answer);
            Ok(())
        }
    }
}

/// The bytes from the rig.
#[derive(Default)]
struct Stream {
    form: Form,
    has_begun: bool,
    came: Vec<u8>,
}

impl Stream {
    fn next(&mut self, from: &mut impl Read) -> io::Result<Option<Request>> {
        let mut buf = [0; 4096];
        loop {
            if let Some(request) = self.take().map_err(io::Error::other)? {
                return Ok(Some(request));
            }
            match from.read(&mut buf)? {
                0 => return Ok(None),
                len => self.came.extend_from_slice(&buf[..len]),
            }
        }
    }

    fn take(&mut self) -> Result<Option<Request>, String> {
        if !self.has_begun {
            match self.came.first() {
                None => return Ok(None),
                Some(b'{') => self.form = Form::Json,
                Some(_) if self.came.len() < 4 => return Ok(None),
                Some(_) if self.came[..4] == binary::MAGIC => {
                    self.came.drain(..4);
                }
                Some(_) => return Err("the stream begins neither with HRN1 nor with {".to_owned()),
            }
            self.has_begun = true;
        }
        let found = match self.form {
            Form::Binary => match binary::split(&self.came)? {
                Some(binary::Framed { kind, body, len }) => {
                    Some((binary::read_request(kind, body)?, len))
                }
                None => None,
            },
            Form::Json => match json::split(&self.came)? {
                Some((text, len)) => Some((json::read_request(text)?, len)),
                None => None,
            },
        };
        Ok(found.map(|(request, len)| {
            self.came.drain(..len);
            request
        }))
    }
}
