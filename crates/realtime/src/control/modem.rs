//! Modem lines of ports. A pseudo-terminal has none, so a client's supervisor sets them here.
//!
//! DTR and RTS reach a device by its links `NAME-dtr` and `NAME-rts`, one byte per level. Levels
//! that a device sets arrive by links such as `NAME-cts`. Lines towards the client can also be set
//! by hand.

use std::path::PathBuf;

use protocols::LineEvent;
use serde_json::{Value, json};

use super::answer::Refusal;
use crate::inputs::{INPUTS, Inputs};
use engine::run::Run;

/// Suffixes of the links for the lines that a client sets.
const PINS: [&str; 2] = ["dtr", "rts"];

/// Changes of a port's lines that a client requests.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wish {
    /// New levels of DTR and RTS; `None` for no change.
    pub(super) outputs: [Option<bool>; 2],
    /// New levels of CTS, DSR, RI and DCD by hand; `None` for no change.
    pub(super) inputs: [Option<bool>; 4],
    /// Whether to send a break.
    pub(super) sends_break: bool,
    /// Input and control modes of the client's terminal.
    pub(super) modes: Option<[u32; 2]>,
    /// Whether to discard bytes that the client has written and the line has not taken.
    pub(super) discards: bool,
}

/// A port of the rig.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Port {
    /// Name of its link.
    pub(super) name: String,
    pub(super) path: PathBuf,
    /// Its rate, bit/s.
    pub(super) baud: u32,
    /// Its node in the rig.
    pub(super) node: usize,
    /// DTR and RTS.
    pub(super) outputs: [bool; 2],
    /// Lines that its client sees.
    pub(super) inputs: Inputs,
    /// Number of the current opening by a client with modem lines, if any.
    pub(super) opening: Option<u64>,
}

/// Changes lines of the port `name`; returns their levels.
pub(super) fn change(
    ports: &mut [Port],
    run: &mut Run,
    name: &str,
    wish: Wish,
) -> Result<Value, Refusal> {
    let index = ports.iter().position(|port| port.name == name);
    let Some(index) = index else {
        let known: Vec<&str> = ports.iter().map(|port| &*port.name).collect();
        let message = format!("is {name:?}, expected one of {}", known.join(", "));
        return Err(Refusal::new("port", message));
    };
    let [dtr, rts] = ports[index].outputs;
    let outputs = [
        wish.outputs[0].unwrap_or(dtr),
        wish.outputs[1].unwrap_or(rts),
    ];
    set(ports, index, outputs, run);
    let node = ports[index].node;
    run.rig.force_lines(node, wish.inputs);
    if wish.modes.is_some() {
        run.rig.set_terminal_modes(node, wish.modes);
    }
    if wish.discards {
        run.rig.discard_input(node);
    }
    if wish.sends_break {
        run.rig.change_line(node, LineEvent::Break);
        // The rig stores one change of the line at a time.
        run.go_on_until(run.rig.now());
    }
    let [dtr, rts] = outputs;
    let waiting = run.rig.backlog(node);
    let mut lines = json!({"dtr": dtr, "rts": rts, "waiting": waiting});
    let seen = ports[index].inputs.bits(&run.rig);
    for input in INPUTS {
        lines[input.name] = (seen & input.bit != 0).into();
    }
    Ok(lines)
}

/// Records that a client has opened the port `name`, or closed it. Opening a serial port raises its
/// lines, closing it lowers them.
pub(super) fn see(ports: &mut [Port], name: &str, opening: Option<u64>, run: &mut Run) {
    let Some(index) = ports.iter().position(|port| port.name == name) else {
        return;
    };
    let before = core::mem::replace(&mut ports[index].opening, opening);
    if before == opening {
        return;
    }
    if before.is_some() {
        set(ports, index, [false; 2], run);
    }
    if opening.is_some() {
        set(ports, index, [true; 2], run);
    }
}

fn set(ports: &mut [Port], index: usize, outputs: [bool; 2], run: &mut Run) {
    let before = core::mem::replace(&mut ports[index].outputs, outputs);
    for (pin, (was, is)) in PINS.into_iter().zip(before.into_iter().zip(outputs)) {
        let name = format!("{}-{pin}", ports[index].name);
        let pin = ports.iter().find(|port| port.name == name);
        if let Some(pin) = pin.filter(|_| was != is) {
            run.rig.inject(pin.node, &[u8::from(is)]);
        }
    }
    run.go_on_until(run.rig.now());
}
