//! `hilrig link` between pairs of pseudo-terminals: the output differs only by the fault.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Command;

use hilrig::capture::Capture;
use hilrig::scenario::{FaultKind, FaultPlace};
use rustix::process::Signal;
use serialport::TTYPort;

use crate::processes::{Running, client_at};
use crate::support::*;

/// A pair of ports with one fault in the direction of the second.
struct Row {
    fault: &'static str,
    sent: Vec<u8>,
    /// Bytes that arrive at the second port, then those that return to the first port.
    arrives: [Vec<u8>; 2],
    /// Number of characters at the second port that give no byte.
    damaged: u64,
}

fn all() -> Vec<u8> {
    (0..=255).collect()
}

/// All byte values are sent; `change` gives the bytes that arrive.
fn row(fault: &'static str, change: impl Fn(&mut Vec<u8>)) -> Row {
    let mut changed = all();
    change(&mut changed);
    let (sent, arrives) = (all(), [changed, Vec::new()]);
    Row {
        fault,
        sent,
        arrives,
        damaged: 0,
    }
}

/// A fault that changes only the times of bytes.
fn late(fault: &'static str) -> Row {
    row(fault, |_| {})
}

/// One row for each kind. Bytes that a fault names are counted from 0, and byte 10 is 0x0A.
fn rows() -> Vec<Row> {
    vec![
        row("none", |_| {}),
        row("flip,byte=10,bit=3", |bytes| bytes[10] = 0x02),
        row("drop,byte=10", |bytes| {
            bytes.remove(10);
        }),
        row("insert,byte=10,value=85", |bytes| bytes.insert(10, 0x55)),
        row("duplicate,byte=10", |bytes| bytes.insert(10, 10)),
        row("burst,byte=10,len=3,value=240", |bytes| {
            bytes[10..13].copy_from_slice(&[0xFA, 0xFB, 0xFC]);
        }),
        row("truncate,byte=10,len=5", |bytes| drop(bytes.drain(10..15))),
        row("swap,byte=10", |bytes| bytes.swap(10, 11)),
        // A port without a parity check reads the byte unchanged.
        Row {
            damaged: 1,
            ..late("parity-error,byte=10")
        },
        late("idle,byte=10,by=5ms"),
        row("strip-nul", |bytes| {
            bytes.remove(0);
        }),
        row("cr-to-lf", |bytes| bytes[0x0D] = 0x0A),
        row("eat-xon-xoff", |bytes| {
            bytes.retain(|byte| ![0x11, 0x13].contains(byte));
        }),
        row("clear-bit7", |bytes| bytes.copy_within(..128, 128)),
        Row {
            arrives: [all(), all()],
            ..late("echo")
        },
        late("stall,at_byte=10,lasting=50ms"),
        late("clog,every=10ms,lasting=5ms"),
        // The buffer holds two bytes while the client does not read.
        row("overrun,at_byte=10,lasting=300ms,fifo=2", |bytes| {
            bytes.truncate(12);
        }),
        late("short-read,len=3"),
        late("latency,by=20ms"),
        late("jitter,by=5ms"),
        row("cut,at_byte=10", |bytes| bytes.truncate(10)),
        // The port is missing until then, and its clients open it later.
        late("unplugged,until=1ms"),
        // A terminal that neither ignores a break nor takes it for a signal reads it as 0. It comes
        // late: one that comes as the client opens its port is lost.
        Row {
            damaged: 1,
            ..row("break,from=3s", |bytes| bytes.push(0))
        },
        // At half the rate each bit is two: the start bit and bit 0 of FE are four low bits, a
        // start bit and three zeros: F8.
        Row {
            fault: "wrong-baud,baud=57600",
            sent: vec![0xFE; 32],
            arrives: [vec![0xF8; 32], Vec::new()],
            damaged: 0,
        },
        Row {
            fault: "swizzle,with=a26",
            sent: vec![b's'; 20],
            arrives: [vec![b't'; 30], Vec::new()],
            damaged: 0,
        },
        Row {
            fault: "none",
            sent: vec![b't'; 30],
            arrives: [vec![b's'; 20], Vec::new()],
            damaged: 0,
        },
    ]
}

/// A client of a port, with the bytes that it has read.
struct Client {
    port: TTYPort,
    read: Vec<u8>,
}

impl Client {
    fn at(dir: &Path, name: &str) -> Self {
        let (port, read) = (client_at(&dir.join(name), 115_200), Vec::new());
        Self { port, read }
    }

    /// Whether the port has read as many bytes as `wanted`, after taking the available bytes.
    fn has(&mut self, wanted: &[u8]) -> bool {
        let mut buf = [0; 512];
        if serialport::SerialPort::bytes_to_read(&self.port).expect("stays") > 0 {
            let len = self.port.read(&mut buf).expect("there is something");
            self.read.extend(&buf[..len]);
        }
        self.read.len() >= wanted.len()
    }
}

fn all_have(clients: &mut BTreeMap<usize, [Client; 2]>, rows: &[Row]) -> bool {
    let have = clients.iter_mut().map(|(n, [first, second])| {
        let row = &rows[*n];
        [second.has(&row.arrives[0]), first.has(&row.arrives[1])] == [true; 2]
    });
    // `has` is called for each client, because it also reads.
    have.filter(|one| !one).count() == 0
}

/// One pair of ports for each kind of line fault, all in one command. Each client reads the written
/// bytes, changed by its fault. The summary counts the damage, and tshark reads the capture.
#[test]
fn what_comes_out_of_a_link_differs_by_its_fault_alone() {
    let rows = rows();
    let missing = FaultKind::ALL.iter().filter(|kind| {
        let name = |row: &Row| row.fault.split(',').next() == Some(kind.name());
        kind.place() == FaultPlace::Line && !rows.iter().any(name)
    });
    assert_eq!(missing.count(), 0, "a kind of line fault without a row");

    let dir = fresh_path("link");
    let file = dir.with_extension("pcapng");
    let _ = std::fs::remove_file(&file);
    let places = (0..rows.len())
        .flat_map(|n| ["a", "b"].map(|end| format!("{end}{n}=pty:{}/{end}{n}", dir.display())));
    let faults = rows
        .iter()
        .enumerate()
        .filter(|(_, row)| row.fault != "none");
    let faults = faults.map(|(n, row)| format!("--fault={},to=b{n}", row.fault));
    let words: Vec<String> = places.chain(faults).collect();
    let out = ["-o", file.to_str().expect("plain"), "--json"];
    let words = words.iter().map(String::as_str).chain(out);
    let mut link = Running::start(&["link"].into_iter().chain(words).collect::<Vec<_>>());
    link.wait_for("until Ctrl-C");

    // An unplugged port is back after bytes have passed through the others.
    let mut clients = BTreeMap::new();
    for is_late in [false, true] {
        let those = rows.iter().enumerate();
        for (n, row) in those.filter(|(_, row)| row.fault.starts_with("unplugged") == is_late) {
            let mut pair = ["a", "b"].map(|end| Client::at(&dir, &format!("{end}{n}")));
            pair[0].port.write_all(&row.sent).expect("there is room");
            clients.insert(n, pair);
        }
        wait_until(|| all_have(&mut clients, &rows));
    }
    link.signal(Signal::INT);
    let (status, said) = link.end();
    assert!(status.success(), "{said}");
    for ([first, second], row) in clients.values().zip(&rows) {
        assert_eq!(second.read, row.arrives[0], "{}", row.fault);
        assert_eq!(first.read, row.arrives[1], "{}", row.fault);
    }

    // The number of arrived bytes equals the number of read bytes.
    let arrived = arrived(&said);
    let count = |n: usize| arrived[&format!("b{n}")];
    let undamaged = |row: &Row| row.arrives[0].len() as u64 - row.damaged;
    let expected: Vec<u64> = rows.iter().map(undamaged).collect();
    // The line also counts bytes that the reader does not take.
    let lines = 0..rows.len() - 2;
    let counted: Vec<u64> = lines.clone().map(count).collect();
    assert_eq!(counted, expected[lines]);
    let capture = Capture::read(&file).expect("readable");
    assert_eq!((capture.broken, capture.skipped), (None, 0));
    assert_eq!(capture.sections[0].fact("seed"), Some("1"));
    match Command::new("tshark").arg("-nr").arg(&file).output() {
        Ok(output) => {
            let lines = String::from_utf8_lossy(&output.stdout).lines().count();
            assert_eq!(lines, capture.records.len());
        }
        Err(error) if std::env::var_os("CI").is_none() => eprintln!("SKIPPED: {error}"),
        Err(error) => panic!("tshark: {error}"),
    }
}

/// Bytes that arrived, by the port at the end of the line.
fn arrived(said: &str) -> BTreeMap<String, u64> {
    let [begin, end] = [said.find("\n{\n"), said.rfind("\n}")].map(|at| at.expect("an object"));
    let answer: serde_json::Value = serde_json::from_str(&said[begin..end + 2]).expect("JSON");
    let lines = answer["result"]["lines"].as_array().expect("a list");
    let lines = lines.iter().map(|line| {
        let to = line["to"].as_str().expect("a name").to_owned();
        (to, line["bytes_arrived"].as_u64().expect("a count"))
    });
    lines.collect()
}
