//! pcap and pcapng: packets of serial lines, of private link types, and of USB adapters.
//!
//! | link type | what a packet is |
//! |---|---|
//! | 147 to 162, USER0 to USER15 | the bytes of the line |
//! | 250, RTAC serial | twelve bytes of head, then the bytes of the line |
//! | 189, 220 usbmon; 249 USBPcap | a transfer of a USB adapter |
//!
//! Network packets carry no serial bytes directly. They are refused with the command that extracts
//! the bytes.

use std::collections::BTreeMap;

use protocols::LineEvent;

use super::Look;
use super::imported::{ImportError, Imported, Options};
use super::packet::Packet;
use super::usb;
use crate::Kind;
use crate::pcapng::{self, Block, Blocks, Order};
use engine::rig::line::Direction;

/// Name and rate of one interface.
#[derive(Clone, Debug, Default)]
struct Port {
    name: String,
    baud: u32,
}

/// Content of a file.
#[derive(Clone, Debug, Default)]
struct File {
    ports: Vec<Port>,
    packets: Vec<Packet>,
    /// Number of packets in invalid blocks.
    senseless: u64,
    notes: Vec<String>,
}

const RTAC: u16 = 250;
const USER: core::ops::RangeInclusive<u16> = 147..=162;
const USB: [u16; 3] = [usb::LINUX, usb::LINUX_MMAPPED, usb::USBPCAP];

pub(super) fn look(bytes: &[u8]) -> Option<Look> {
    let is_own = bytes.starts_with(&pcapng::SECTION.to_le_bytes()) || classic(bytes).is_some();
    is_own.then_some(Look::Surely)
}

pub(super) fn read(bytes: &[u8], options: &Options, out: &mut Imported) -> Result<(), ImportError> {
    let file = match classic(bytes) {
        Some(head) => read_classic(bytes, head),
        None => read_blocks(bytes)?,
    };
    out.notes.extend(file.notes.iter().cloned());
    let mut counts: BTreeMap<u16, usize> = BTreeMap::new();
    for packet in &file.packets {
        *counts.entry(packet.link_type).or_default() += 1;
    }
    let is_known =
        |link_type: &u16| *link_type == RTAC || USER.contains(link_type) || USB.contains(link_type);
    let (known, other): (Vec<u16>, Vec<u16>) = counts.keys().partition(|own| is_known(own));
    if known.is_empty() {
        return Err(ImportError::of_file(refusal(&other)));
    }
    for link_type in other {
        let (count, name) = (counts[&link_type], name_of(link_type));
        out.note(format!(
            "{count} packets of {name} are skipped: they contain no serial bytes"
        ));
    }
    if file.senseless > 0 {
        out.note(format!(
            "{} blocks of the file are invalid and are skipped",
            file.senseless
        ));
    }
    if let Some(cut) = file.packets.iter().find(|packet| packet.cut > 0) {
        return Err(ImportError::of_file(format!(
            "the recording cut {} bytes off a packet: record whole packets (tcpdump -s 0)",
            cut.cut
        )));
    }
    serial(&file, options, out);
    let transfers = file
        .packets
        .iter()
        .filter(|packet| USB.contains(&packet.link_type));
    usb::read(transfers, options, out)?;
    out.sort();
    Ok(())
}

/// Adds packets that contain the bytes of the line.
fn serial(file: &File, options: &Options, out: &mut Imported) {
    let own = || {
        let packets = file.packets.iter();
        packets.filter(|packet| packet.link_type == RTAC || USER.contains(&packet.link_type))
    };
    let first = own().next().map(|packet| packet.interface);
    let is_one = own().all(|packet| Some(packet.interface) == first);
    let mut is_untold = false;
    for packet in own() {
        let port = file
            .ports
            .get(packet.interface)
            .cloned()
            .unwrap_or_default();
        let is_named = options.link != Options::default().link;
        let name = match (is_one, port.name.is_empty()) {
            (true, false) if is_named => options.link.clone(),
            (_, false) => port.name,
            (true, true) => options.link.clone(),
            (false, true) => format!("{}-{}", options.link, packet.interface),
        };
        let link = out.link_at(&name, options.baud.unwrap_or(port.baud));
        let (kind, told, bytes) = match packet.link_type {
            RTAC => match packet.bytes.split_at_checked(12) {
                Some((head, bytes)) => (kind(head[8], head[9]), sent_by(head[8]), bytes),
                None => continue,
            },
            _ => (Kind::Data, None, &packet.bytes[..]),
        };
        let is_sent = packet.is_outbound.or(told);
        is_untold |= is_sent.is_none();
        let direction = match is_sent {
            // This format contains the directions.
            Some(is_sent) if packet.link_type == RTAC => match is_sent {
                true => Direction::ToDevice,
                false => Direction::ToMaster,
            },
            is_sent => options.way(!is_sent.unwrap_or(false)),
        };
        if kind != Kind::Data || !bytes.is_empty() {
            out.push(link, packet.nanos, direction, kind, bytes);
        }
    }
    if is_untold {
        out.note(
            "the packets have no direction: all are taken as from the device; --from program if the \
             host sent them",
        );
    }
}

/// Event types of RTAC serial.
const fn kind(event: u8, control_lines: u8) -> Kind {
    match event {
        1..=4 => Kind::Data,
        0 if control_lines & 0x10 == 0 => Kind::Line(LineEvent::Closed),
        0 => Kind::Line(LineEvent::Opened),
        7 => Kind::Line(LineEvent::FramingError),
        8 => Kind::Line(LineEvent::ParityError),
        9 => Kind::Line(LineEvent::Break),
        10 => Kind::Line(LineEvent::Overrun),
        other => Kind::Other(other),
    }
}

const fn sent_by(event: u8) -> Option<bool> {
    match event {
        1 | 3 => Some(true),
        2 | 4 => Some(false),
        _ => None,
    }
}

/// Variant of a classic pcap header.
#[derive(Clone, Copy)]
struct Classic {
    order: Order,
    is_nanos: bool,
}

fn classic(bytes: &[u8]) -> Option<Classic> {
    for order in [Order::Little, Order::Big] {
        let is_nanos = match order.u32_at(bytes, 0)? {
            0xA1B2_C3D4 => false,
            0xA1B2_3C4D => true,
            _ => continue,
        };
        return Some(Classic { order, is_nanos });
    }
    None
}

/// Maximum accepted length of a packet.
const PACKET_MAX: usize = 16 << 20;

fn read_classic(bytes: &[u8], Classic { order, is_nanos }: Classic) -> File {
    let mut file = File {
        ports: vec![Port::default()],
        ..File::default()
    };
    let Some(link_type) = order.u32_at(bytes, 20).map(|word| word & 0xFFFF) else {
        return file;
    };
    let link_type = u16::try_from(link_type).unwrap_or(u16::MAX);
    let mut at = 24;
    loop {
        let number = |place: usize| order.u32_at(bytes, at + place);
        let (Some(seconds), Some(part), Some(len), Some(full)) =
            (number(0), number(4), number(8), number(12))
        else {
            break;
        };
        let len = usize::try_from(len).unwrap_or(usize::MAX);
        let Some(packet) = bytes.get(at + 16..).and_then(|rest| rest.get(..len)) else {
            break;
        };
        if len > PACKET_MAX {
            break;
        }
        let part = u64::from(part) * if is_nanos { 1 } else { 1_000 };
        file.packets.push(Packet {
            link_type,
            order,
            interface: 0,
            nanos: u64::from(seconds) * 1_000_000_000 + part,
            is_outbound: None,
            bytes: packet.to_vec(),
            cut: full.saturating_sub(u32::try_from(len).unwrap_or(u32::MAX)),
        });
        at += 16 + len;
    }
    if at < bytes.len() {
        file.notes.push(format!(
            "the file was cut: {} bytes at its end are not a complete packet",
            bytes.len() - at
        ));
    }
    file
}

/// Properties of an interface.
struct Described {
    link_type: u16,
    resolution: u8,
    port: Port,
}

fn read_blocks(bytes: &[u8]) -> Result<File, ImportError> {
    const SIMPLE: u32 = 3;
    const OLD: u32 = 2;
    let (mut file, mut blocks) = (File::default(), Blocks::default());
    let (mut own, mut first): (Vec<Described>, usize) = (Vec::new(), 0);
    blocks.push(bytes);
    while let Some(block) = blocks.next_block() {
        let block = block.map_err(|error| {
            let at = usize::try_from(error.offset).unwrap_or(usize::MAX);
            ImportError::at_byte(at, format!("the pcapng file is damaged: {}", error.why))
        })?;
        match block.kind {
            pcapng::SECTION => {
                first = file.ports.len();
                own.clear();
            }
            pcapng::INTERFACE => match described(&block) {
                Some(described) => {
                    file.ports.push(described.port.clone());
                    own.push(described);
                }
                None => file.senseless += 1,
            },
            pcapng::PACKET | OLD | SIMPLE => match packet(&block, &own, first) {
                Some(packet) => file.packets.push(packet),
                None => file.senseless += 1,
            },
            _ => {}
        }
    }
    if blocks.pending() > 0 {
        let cut = blocks.pending();
        file.notes.push(format!(
            "the file was cut: {cut} bytes at its end are not a complete block"
        ));
    }
    Ok(file)
}

fn described(block: &Block) -> Option<Described> {
    let (order, body) = (block.order, &block.body);
    let mut described = Described {
        link_type: order.u16_at(body, 0)?,
        resolution: 6,
        port: Port::default(),
    };
    for (code, value) in pcapng::options(order, body.get(8..)?) {
        match (code, value) {
            (2, name) => described.port.name = String::from_utf8_lossy(name).into_owned(),
            (8, &[a, b, c, d, e, f, g, h]) => {
                let speed = order.u64([a, b, c, d, e, f, g, h]);
                described.port.baud = u32::try_from(speed).unwrap_or(0);
            }
            (9, &[resolution]) => described.resolution = resolution,
            _ => {}
        }
    }
    Some(described)
}

fn packet(block: &Block, own: &[Described], first: usize) -> Option<Packet> {
    let (order, body) = (block.order, &block.body);
    let number = |at: usize| order.u32_at(body, at);
    // A simple packet block has no time and belongs to the first interface.
    let (index, units, len_at, data_at) = match block.kind {
        3 => (0, 0, 0, 4),
        2 => (
            usize::from(order.u16_at(body, 0)?),
            units(number(4)?, number(8)?),
            12,
            20,
        ),
        _ => (
            usize::try_from(number(0)?).ok()?,
            units(number(4)?, number(8)?),
            12,
            20,
        ),
    };
    let described = own.get(index)?;
    let captured = number(len_at)?;
    let full = if block.kind == 3 {
        captured
    } else {
        number(len_at + 4)?
    };
    let len = usize::try_from(captured).ok()?;
    let data = body.get(data_at..)?;
    let bytes = match block.kind {
        3 => &data[..len.min(data.len())],
        _ => data.get(..len)?,
    };
    let options = data.get(pcapng::padded(len)..).unwrap_or_default();
    let mut is_outbound = None;
    for (code, value) in pcapng::options(order, options) {
        if code == 2 {
            is_outbound = match order.u32_at(value, 0).map(|flags| flags & 3) {
                Some(1) => Some(false),
                Some(2) => Some(true),
                _ => is_outbound,
            };
        }
    }
    Some(Packet {
        link_type: described.link_type,
        order,
        interface: first + index,
        nanos: nanos(units, described.resolution),
        is_outbound,
        bytes: bytes.to_vec(),
        cut: full.saturating_sub(captured),
    })
}

fn units(high: u32, low: u32) -> u64 {
    u64::from(high) << 32 | u64::from(low)
}

fn nanos(units: u64, resolution: u8) -> u64 {
    let exponent = u32::from(resolution & 0x7F);
    let base: u128 = if resolution & 0x80 == 0 { 10 } else { 2 };
    let per_second = base.checked_pow(exponent).unwrap_or(u128::MAX);
    let nanos = u128::from(units).saturating_mul(1_000_000_000) / per_second;
    u64::try_from(nanos).unwrap_or(u64::MAX)
}

/// Name of a link type for the user.
fn name_of(link_type: u16) -> String {
    let name = match link_type {
        0 => "loopback",
        1 => "Ethernet",
        101 | 228 | 229 => "IP",
        105 | 127 => "WLAN",
        113 | 276 => "\"any\" of Linux",
        187 | 201 => "Bluetooth HCI",
        195 | 215 | 230 | 283 => "IEEE 802.15.4",
        227 => "CAN",
        251 | 256 => "Bluetooth Low Energy",
        288 | 293 | 294 | 295 => "raw USB packets",
        _ => return format!("link type {link_type}"),
    };
    format!("link type {link_type} ({name})")
}

/// Reason for refusing a file of these link types, and the next step.
fn refusal(link_types: &[u16]) -> String {
    let Some(&first) = link_types.first() else {
        return "the file has no packets".to_owned();
    };
    let name = name_of(first);
    let step = match first {
        0 | 1 | 101 | 113 | 276 | 228 | 229 => {
            "if a serial line went over TCP (ser2net, a terminal server), take its bytes out: \
             tshark -r FILE -Y tcp.payload -T fields -e frame.time_relative -e tcp.payload \
             > bytes.hex, one filter a direction, then import bytes.hex"
        }
        187 | 201 => {
            "take the bytes of the serial channel out: tshark -r FILE -Y btrfcomm.data -T fields \
             -e frame.time_relative -e btrfcomm.data > bytes.hex, then import bytes.hex"
        }
        288 | 293 | 294 | 295 => {
            "record the same adapter by usbmon: tcpdump -i usbmon1 -w FILE.pcapng, then import it"
        }
        227 => "a CAN bus has frames and no serial bytes; hilrig has no CAN",
        _ => {
            "expected USER0 to USER15 (147 to 162), RTAC serial (250) or usbmon (189, 220); take \
             the bytes out: tshark -r FILE -T fields -e frame.time_relative -e data.data \
             > bytes.hex, then import bytes.hex"
        }
    };
    format!("{name} carries no serial bytes; {step}")
}

#[cfg(test)]
mod tests;
