//! Modem lines of ports: a pseudo-terminal has none, so a client's supervisor sets them here.
//!
//! DTR and RTS reach a device by its links `NAME-dtr` and `NAME-rts`, a byte a level; what a device
//! sets comes by `NAME-cts` and its like. Lines towards the client can be set by hand, too.

use std::path::PathBuf;

use protocols::LineEvent;
use serde_json::{Value, json};

use super::answer::Refusal;
use crate::inputs::{INPUTS, Inputs};
use engine::run::Run;

/// Names of a port's links for what a client sets, behind its own name.
const PINS: [&str; 2] = ["dtr", "rts"];

/// What a client wants of a port's lines.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wish {
    /// DTR and RTS, as far as they are to change.
    pub(super) outputs: [Option<bool>; 2],
    /// CTS, DSR, RI and DCD, as far as they are to be set by hand.
    pub(super) inputs: [Option<bool>; 4],
    /// A break is to be sent.
    pub(super) sends_break: bool,
    /// Input and control modes of the client's terminal.
    pub(super) modes: Option<[u32; 2]>,
    /// What the client has written and the line has not taken is thrown away.
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
    /// What its client sees.
    pub(super) inputs: Inputs,
    /// By its number, the opening that a client with modem lines has it by, if one has.
    pub(super) opening: Option<u64>,
}

/// Changes lines of the port `name`; how they are then.
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
        // The rig holds one change of the line at a time.
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

/// A client has come to the port `name` by that opening, or left it: a serial port raises its lines
/// when it is opened, and lowers them when it is closed.
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
