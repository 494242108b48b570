//! Bulk transfers of USB serial adapters, as usbmon of Linux and USBPcap of Windows record them.
//!
//! A transfer to the adapter counts when it is submitted, one from the adapter when it completes.
//! CDC-ACM, CP210x, CH340 and PL2303 send only the bytes; FTDI puts two status bytes before each
//! packet. The baud rate is in the control transfers, if the recording contains them.

use std::collections::BTreeMap;

use super::imported::{ImportError, Imported, Options};
use super::packet::Packet;
use crate::Kind;
use crate::pcapng::Order;

/// Link types: usbmon with 48 and with 64 bytes of head, USBPcap.
pub(super) const LINUX: u16 = 189;
pub(super) const LINUX_MMAPPED: u16 = 220;
pub(super) const USBPCAP: u16 = 249;

/// Bus and address of a device.
type Address = (u16, u16);

/// Kind of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transfer {
    Control,
    Bulk,
    Other,
}

/// One transfer of a recording.
#[derive(Clone, Debug)]
struct Urb<'a> {
    nanos: u64,
    address: Address,
    endpoint: u8,
    transfer: Transfer,
    is_in: bool,
    is_complete: bool,
    setup: Option<[u8; 8]>,
    data: &'a [u8],
}

/// Properties of a device.
#[derive(Clone, Copy, Debug, Default)]
struct Device {
    vendor: Option<u16>,
    /// Packet size in bytes, from the release number of an FTDI chip.
    packet: Option<usize>,
    baud: Option<u32>,
}

pub(super) fn read<'a>(
    packets: impl Iterator<Item = &'a Packet>,
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    let urbs: Vec<Urb<'_>> = packets.filter_map(urb).collect();
    let mut devices: BTreeMap<Address, Device> = BTreeMap::new();
    // The last setup packet of each device, which its completion does not repeat.
    let mut asked: BTreeMap<Address, [u8; 8]> = BTreeMap::new();
    for urb in urbs.iter().filter(|urb| urb.transfer == Transfer::Control) {
        let device = devices.entry(urb.address).or_default();
        if let Some(setup) = urb.setup {
            asked.insert(urb.address, setup);
        }
        if let Some(setup) = asked.get(&urb.address) {
            device.learn(*setup, urb.data);
        }
    }
    let is_data = |urb: &&Urb<'_>| {
        urb.transfer == Transfer::Bulk && urb.is_in == urb.is_complete && !urb.data.is_empty()
    };
    let mut lines: BTreeMap<Address, Vec<&Urb<'_>>> = BTreeMap::new();
    for urb in urbs.iter().filter(is_data) {
        lines.entry(urb.address).or_default().push(urb);
    }
    if lines.is_empty() && !urbs.is_empty() {
        return Err(ImportError::of_file(
            "the USB transfers hold no bulk data: record while the serial port is in use",
        ));
    }
    let chosen = chosen(&lines, options)?;
    let is_one = chosen.len() == 1;
    for address in chosen {
        let urbs = &lines[&address];
        let device = devices.get(&address).copied().unwrap_or_default();
        let name = if is_one {
            options.link.clone()
        } else {
            name_of(address)
        };
        line(&name, urbs, device, options, out)?;
    }
    Ok(())
}

fn name_of((bus, address): Address) -> String {
    format!("usb-{bus}.{address}")
}

/// The devices that the options name, or all that transfer bulk data.
fn chosen(
    lines: &BTreeMap<Address, Vec<&Urb<'_>>>,
    options: &Options,
) -> Result<Vec<Address>, ImportError> {
    if options.channels.is_empty() {
        return Ok(lines.keys().copied().collect());
    }
    let find = |wanted: &String| {
        let known = lines
            .keys()
            .copied()
            .find(|address| name_of(*address) == *wanted);
        known.ok_or_else(|| {
            let all: Vec<String> = lines.keys().copied().map(name_of).collect();
            ImportError::of_file(format!(
                "--channel {wanted}: there is no such device, expected one of: {}",
                all.join(", ")
            ))
        })
    };
    options.channels.iter().map(find).collect()
}

fn line(
    name: &str,
    urbs: &[&Urb<'_>],
    device: Device,
    options: &Options,
    out: &mut Imported,
) -> Result<(), ImportError> {
    let is_storage = |urb: &&&Urb<'_>| urb.data.starts_with(b"USBC") && urb.data.len() == 31;
    if urbs.iter().any(|urb| is_storage(&urb)) {
        return Err(ImportError::of_file(format!(
            "{name} is a USB disk, not a serial adapter; --channel usb-BUS.DEVICE chooses one"
        )));
    }
    let mut endpoints: Vec<(bool, u8)> = urbs.iter().map(|urb| (urb.is_in, urb.endpoint)).collect();
    endpoints.sort_unstable();
    endpoints.dedup();
    let pairs = endpoints.iter().filter(|(is_in, _)| *is_in).count();
    let baud = options.baud.or(device.baud);
    let status = status_packet(urbs, device);
    if let Some(packet) = status {
        out.note(format!(
            "{name}: an FTDI adapter, two bytes of status in {packet} are skipped"
        ));
    }
    let mut inputs = Vec::new();
    for urb in urbs {
        // A device with several lines has a pair of endpoints for each.
        let link = match pairs > 1 {
            true => format!("{name}-{}", line_of(&endpoints, urb)),
            false => name.to_owned(),
        };
        let link = out.link_at(&link, baud.unwrap_or(0));
        let direction = options.way(urb.is_in);
        inputs.clear();
        match status {
            Some(packet) if urb.is_in => {
                let packets = urb.data.chunks(packet);
                packets.for_each(|packet| inputs.extend(packet.get(2..).unwrap_or_default()));
            }
            _ => inputs.extend_from_slice(urb.data),
        }
        if !inputs.is_empty() {
            out.push(link, urb.nanos, direction, Kind::Data, &inputs);
        }
    }
    Ok(())
}

/// Number of the line among the endpoints of its direction.
fn line_of(endpoints: &[(bool, u8)], urb: &Urb<'_>) -> usize {
    let own = endpoints.iter().filter(|(is_in, _)| *is_in == urb.is_in);
    own.take_while(|(_, endpoint)| *endpoint != urb.endpoint)
        .count()
}

/// Packet size of an FTDI device, whose packets begin with two status bytes. The device is detected
/// by its vendor, or because all its packets have this form, in particular the empty replies.
fn status_packet(urbs: &[&Urb<'_>], device: Device) -> Option<usize> {
    const FTDI: u16 = 0x0403;
    let is_status = |data: &[u8]| match data {
        [first, second, ..] => first & 0x0F <= 2 && second & 0x1E == 0,
        _ => false,
    };
    let inputs = || urbs.iter().filter(|urb| urb.is_in);
    let is_ftdi = match device.vendor {
        Some(vendor) => vendor == FTDI,
        None => {
            let empty = inputs().filter(|urb| urb.data.len() == 2).count();
            empty >= 3 && inputs().all(|urb| is_status(urb.data))
        }
    };
    if !is_ftdi {
        return None;
    }
    let looks = |size: usize| inputs().all(|urb| urb.data.chunks(size).all(is_status));
    let known = device.packet.unwrap_or(64);
    Some(if looks(known) || !looks(512) {
        known
    } else {
        512
    })
}

impl Device {
    /// Stores the information of a control transfer.
    fn learn(&mut self, setup: [u8; 8], data: &[u8]) {
        let word = |at: usize| u16::from_le_bytes([setup[at], setup[at + 1]]);
        let number = |data: &[u8]| Some(u32::from_le_bytes(*data.first_chunk::<4>()?));
        match (setup[0], setup[1]) {
            // Device descriptor: vendor, product, release.
            (0x80, 6) if word(2) == 0x0100 && data.len() >= 14 => {
                self.vendor = Some(u16::from_le_bytes([data[8], data[9]]));
                let release = u16::from_le_bytes([data[12], data[13]]);
                let is_fast = matches!(release, 0x0700 | 0x0800 | 0x0900);
                self.packet = Some(if is_fast { 512 } else { 64 });
            }
            // Line coding of CDC-ACM and PL2303; rate of a CP210x.
            (0x21, 0x20) if data.len() == 7 => self.baud = number(data).or(self.baud),
            (0x41, 0x1E) if data.len() == 4 => self.baud = number(data).or(self.baud),
            // Divisor of an FTDI chip: 3 MHz by whole numbers and eighths.
            (0x40, 3) => self.baud = ftdi_baud(word(2), word(4)).or(self.baud),
            _ => {}
        }
    }
}

fn ftdi_baud(value: u16, index: u16) -> Option<u32> {
    // Eighths of the divisor by their code.
    const EIGHTHS: [u32; 8] = [0, 4, 2, 1, 3, 5, 6, 7];
    let code = usize::from(value >> 14 | (index & 1) << 2);
    let whole = u32::from(value & 0x3FFF);
    match (whole, EIGHTHS[code]) {
        (0, 0) => Some(3_000_000),
        (1, 0) => Some(2_000_000),
        (0, _) => None,
        (whole, eighths) => Some(24_000_000 / (whole * 8 + eighths)),
    }
}

/// The transfer of a packet; `None` if its header is damaged.
fn urb(packet: &Packet) -> Option<Urb<'_>> {
    match packet.link_type {
        LINUX => usbmon(packet, 48),
        LINUX_MMAPPED => usbmon(packet, 64),
        USBPCAP => usbpcap(packet),
        _ => None,
    }
}

/// Parses the header of the kernel's usbmon documentation, in the byte order of the recording
/// machine.
fn usbmon(packet: &Packet, head_len: usize) -> Option<Urb<'_>> {
    let (head, data) = packet.bytes.split_at_checked(head_len)?;
    let order = packet.order;
    let is_submitted = match head[8] {
        b'S' => true,
        b'C' => false,
        _ => return None,
    };
    let transfer = match head[9] {
        2 => Transfer::Control,
        3 => Transfer::Bulk,
        _ => Transfer::Other,
    };
    let len = usize::try_from(order.u32_at(head, 36)?).ok()?;
    Some(Urb {
        nanos: packet.nanos,
        address: (order.u16_at(head, 12)?, u16::from(head[11])),
        endpoint: head[10] & 0x7F,
        transfer,
        is_in: head[10] & 0x80 != 0,
        is_complete: !is_submitted,
        setup: if is_submitted && head[14] == 0 {
            head[40..].first_chunk().copied()
        } else {
            None
        },
        data: &data[..len.min(data.len())],
    })
}

/// Parses USBPcap's header, which is little-endian and contains its own length.
fn usbpcap(packet: &Packet) -> Option<Urb<'_>> {
    let bytes = &packet.bytes;
    let little = Order::Little;
    let head_len = usize::from(little.u16_at(bytes, 0)?);
    let (head, data) = bytes
        .split_at_checked(head_len)
        .filter(|(head, _)| head.len() >= 27)?;
    let transfer = match head[22] {
        2 => Transfer::Control,
        3 => Transfer::Bulk,
        _ => Transfer::Other,
    };
    let is_setup = transfer == Transfer::Control && head.get(27) == Some(&0);
    let setup = if is_setup {
        data.first_chunk::<8>().copied()
    } else {
        None
    };
    Some(Urb {
        nanos: packet.nanos,
        address: (little.u16_at(head, 17)?, little.u16_at(head, 19)?),
        endpoint: head[21] & 0x7F,
        transfer,
        is_in: head[21] & 0x80 != 0,
        is_complete: head[16] & 1 == 1,
        setup,
        data: if is_setup {
            data.get(8..).unwrap_or_default()
        } else {
            data
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import::{Format, read as read_format};
    use engine::rig::line::Direction;

    /// A packet of usbmon, with 64 bytes of header as in the kernel's documentation.
    fn packet(
        event: u8,
        transfer: u8,
        endpoint: u8,
        setup: Option<[u8; 8]>,
        data: &[u8],
    ) -> Vec<u8> {
        let mut head = [0; 64];
        head[8..12].copy_from_slice(&[event, transfer, endpoint, 7]);
        head[12] = 1;
        head[14] = if setup.is_some() { 0 } else { b'-' };
        let len = u32::try_from(data.len()).expect("short").to_le_bytes();
        head[32..36].copy_from_slice(&len);
        head[36..40].copy_from_slice(&len);
        head[40..48].copy_from_slice(&setup.unwrap_or_default());
        [&head[..], data].concat()
    }

    fn file(link_type: u32, packets: &[Vec<u8>]) -> Vec<u8> {
        let words = [0xA1B2_C3D4, 0x0004_0002, 0, 0, 65_535, link_type];
        let mut out: Vec<u8> = words
            .iter()
            .flat_map(|word: &u32| word.to_le_bytes())
            .collect();
        for (second, packet) in (1_u32..).zip(packets) {
            let len = u32::try_from(packet.len()).expect("short");
            out.extend(
                [second, 0, len, len]
                    .iter()
                    .flat_map(|word| word.to_le_bytes()),
            );
            out.extend(packet);
        }
        out
    }

    fn told(file: &[u8]) -> (Vec<(u64, Direction, Vec<u8>)>, u32) {
        let found = read_format(file, Format::Pcap, &Options::default()).expect("sound");
        let tuple = |one: &crate::Record| (one.at.as_millis(), one.direction, one.bytes.to_vec());
        (
            found.records().iter().map(tuple).collect(),
            found.links()[0].baud,
        )
    }

    const SUBMIT: u8 = b'S';
    const COMPLETE: u8 = b'C';

    /// CDC-ACM: line coding of 115,200 baud (0x0001C200), a request out, its reply in. The
    /// submission of a read and the completion of a write contain no bytes of the line.
    #[test]
    fn a_cdc_adapter_has_plain_bytes_and_tells_its_rate() {
        let coding = [0x21, 0x20, 0, 0, 0, 0, 7, 0];
        let rate = [0x00, 0xC2, 0x01, 0x00, 0, 0, 8];
        let packets = [
            packet(SUBMIT, 2, 0, Some(coding), &rate),
            packet(SUBMIT, 3, 0x02, None, b"AT\r"),
            packet(COMPLETE, 3, 0x02, None, b""),
            packet(SUBMIT, 3, 0x81, None, b""),
            packet(COMPLETE, 3, 0x81, None, b"OK\r\n"),
        ];
        let expected = vec![
            (2_000, Direction::ToDevice, b"AT\r".to_vec()),
            (5_000, Direction::ToMaster, b"OK\r\n".to_vec()),
        ];
        assert_eq!(
            told(&file(LINUX_MMAPPED.into(), &packets)),
            (expected.clone(), 115_200)
        );
        let short: Vec<Vec<u8>> = packets
            .iter()
            .map(|one| [&one[..48], &one[64..]].concat())
            .collect();
        assert_eq!(told(&file(LINUX.into(), &short)), (expected, 115_200));
    }

    /// FTDI: vendor 0x0403 of an FT232R, release 0x0600, so packets of 64 bytes. Divisor 26 is
    /// 115,384 baud, the chip's nearest rate to 115,200. Two status bytes precede 62 bytes of data.
    #[test]
    fn an_ftdi_adapter_has_status_before_each_packet() {
        let mut descriptor = [0; 18];
        descriptor[8..14].copy_from_slice(&[0x03, 0x04, 0x01, 0x60, 0x00, 0x06]);
        let ask = [0x80, 6, 0, 1, 0, 0, 18, 0];
        let long: Vec<u8> = [&[1, 0x60][..], &[7; 62], &[1, 0x60], &[8; 3]].concat();
        let packets = [
            packet(SUBMIT, 2, 0x80, Some(ask), b""),
            packet(COMPLETE, 2, 0x80, None, &descriptor),
            packet(SUBMIT, 2, 0, Some([0x40, 3, 26, 0, 0, 0, 0, 0]), b""),
            packet(COMPLETE, 3, 0x81, None, &[1, 0x60]),
            packet(COMPLETE, 3, 0x81, None, &long),
        ];
        let bytes = [&[7; 62][..], &[8; 3]].concat();
        let expected = (vec![(5_000, Direction::ToMaster, bytes)], 115_384);
        assert_eq!(told(&file(LINUX_MMAPPED.into(), &packets)), expected);
    }

    /// Without the descriptor, the empty replies identify the chip.
    #[test]
    fn an_ftdi_adapter_is_known_by_its_empty_answers() {
        let mut packets = vec![packet(COMPLETE, 3, 0x81, None, &[1, 0x60]); 3];
        packets.push(packet(COMPLETE, 3, 0x81, None, &[1, 0x60, 0xAB]));
        let expected = vec![(4_000, Direction::ToMaster, vec![0xAB])];
        assert_eq!(told(&file(LINUX_MMAPPED.into(), &packets)).0, expected);
        // Three replies with data are not status.
        let data = [packet(COMPLETE, 3, 0x81, None, b"AB")];
        assert_eq!(told(&file(LINUX_MMAPPED.into(), &data)).0[0].2, b"AB");
    }

    /// USBPcap: 27 bytes of header, little-endian; bit 0 of byte 16 marks the completion.
    #[test]
    fn usbpcap_is_read() {
        let of = |is_complete: u8, endpoint: u8, data: &[u8]| {
            let mut head = [0; 27];
            head[0] = 27;
            head[16] = is_complete;
            head[17] = 1;
            head[19] = 5;
            head[21] = endpoint;
            head[22] = 3;
            [&head[..], data].concat()
        };
        let packets = [
            of(0, 0x02, b"AT"),
            of(1, 0x02, b""),
            of(0, 0x81, b""),
            of(1, 0x81, b"OK"),
        ];
        let expected = vec![
            (1_000, Direction::ToDevice, b"AT".to_vec()),
            (4_000, Direction::ToMaster, b"OK".to_vec()),
        ];
        assert_eq!(told(&file(USBPCAP.into(), &packets)).0, expected);
    }

    #[test]
    fn a_disk_is_no_serial_adapter() {
        let command = [&b"USBC"[..], &[0; 27]].concat();
        let disk = file(
            LINUX_MMAPPED.into(),
            &[packet(SUBMIT, 3, 2, None, &command)],
        );
        let error = read_format(&disk, Format::Pcap, &Options::default()).expect_err("a disk");
        assert!(error.to_string().contains("USB disk"), "{error}");
        let nothing = file(LINUX_MMAPPED.into(), &[packet(SUBMIT, 1, 0x83, None, b"")]);
        let error = read_format(&nothing, Format::Pcap, &Options::default()).expect_err("nothing");
        assert!(error.to_string().contains("no bulk data"), "{error}");
    }
    /// Endpoints 1 and 3 bring bytes, 2 and 4 take them: each pair is a line.
    #[test]
    fn each_pair_of_endpoints_is_a_line() {
        let endpoints = [(false, 2), (false, 4), (true, 1), (true, 3)];
        let line = |is_in, endpoint| {
            let urb = Urb {
                nanos: 0,
                address: (1, 7),
                endpoint,
                transfer: Transfer::Bulk,
                is_in,
                is_complete: is_in,
                setup: None,
                data: &[],
            };
            line_of(&endpoints, &urb)
        };
        let lines = [line(false, 2), line(false, 4), line(true, 1), line(true, 3)];
        assert_eq!(lines, [0, 1, 0, 1]);
    }

    /// The rate is 3 MHz divided by the divisor: 26 gives 115,384 baud, 312 and a half give 9,600.
    /// The divisors 0 and 1 mean 3 and 2 MHz. The eighths of a divisor are coded 0, 4, 2, 1, 3, 5,
    /// 6, 7, with the third bit in the index.
    #[test]
    fn a_divisor_of_ftdi_has_eighths() {
        assert_eq!(
            (ftdi_baud(26, 0), ftdi_baud(312 | 1 << 14, 0)),
            (Some(115_384), Some(9_600))
        );
        assert_eq!(
            (ftdi_baud(0, 0), ftdi_baud(1, 0), ftdi_baud(1 << 14, 0)),
            (Some(3_000_000), Some(2_000_000), None)
        );
        let tenths: Vec<_> = (0..8)
            .map(|code: u16| ftdi_baud(10 | (code & 3) << 14, code >> 2))
            .collect();
        let by_hand = [80, 84, 82, 81, 83, 85, 86, 87].map(|eighths| Some(24_000_000 / eighths));
        assert_eq!(tenths, by_hand);
    }

    /// The line coding of CDC-ACM has seven bytes, the rate of a CP210x four. The device descriptor
    /// has the vendor and the release, of which fast FTDI chips have 0x0700 to 0x0900.
    #[test]
    fn a_device_is_learnt_from_control_transfers() {
        let of = |setup: [u8; 8], data: &[u8]| {
            let mut device = Device::default();
            device.learn(setup, data);
            (device.baud, device.vendor, device.packet)
        };
        let rate = 9_600_u32.to_le_bytes();
        let coding = [&rate[..], &[0, 0, 8]].concat();
        let cdc = [0x21, 0x20, 0, 0, 0, 0, 7, 0];
        let cp210x = [0x41, 0x1E, 0, 0, 0, 0, 4, 0];
        assert_eq!(of(cdc, &coding).0, Some(9_600));
        assert_eq!(of(cdc, &rate).0, None);
        assert_eq!(of(cp210x, &rate).0, Some(9_600));
        assert_eq!(of(cp210x, &coding).0, None);
        let mut descriptor = [0; 18];
        descriptor[8..14].copy_from_slice(&[0x03, 0x04, 0, 0, 0x00, 0x07]);
        let ask = [0x80, 6, 0, 1, 0, 0, 18, 0];
        assert_eq!(of(ask, &descriptor), (None, Some(0x0403), Some(512)));
        assert_eq!(of(ask, &descriptor[..14]), (None, Some(0x0403), Some(512)));
        assert_eq!(of(ask, &descriptor[..13]), (None, None, None));
        descriptor[13] = 0x06;
        assert_eq!(of(ask, &descriptor).2, Some(64));
        assert_eq!(
            of([0x80, 6, 0, 2, 0, 0, 18, 0], &descriptor),
            (None, None, None)
        );
    }

    /// Two devices: each is a link of its own, and one can be chosen by its name.
    #[test]
    fn several_devices_are_several_links() {
        let mut second = packet(COMPLETE, 3, 0x81, None, b"other");
        second[11] = 9;
        let packets = [packet(COMPLETE, 3, 0x81, None, b"first"), second];
        let file = file(LINUX_MMAPPED.into(), &packets);
        let of = |channel: Option<&str>| {
            let options = Options {
                channels: channel.into_iter().map(str::to_owned).collect(),
                ..Options::default()
            };
            let found = read_format(&file, Format::Pcap, &options);
            let found = found.map_err(|error| error.to_string())?;
            let names = found.links().iter().map(|link| link.name.clone());
            Ok::<_, String>(names.collect::<Vec<_>>())
        };
        assert_eq!(
            of(None),
            Ok(vec!["usb-1.7".to_owned(), "usb-1.9".to_owned()])
        );
        assert_eq!(of(Some("usb-1.9")), Ok(vec!["line".to_owned()]));
        let error = of(Some("usb-1.8")).expect_err("no such device");
        assert!(
            error.contains("expected one of: usb-1.7, usb-1.9"),
            "{error}"
        );
    }

    /// A control transfer of USBPcap has its stage in byte 27; the setup packet is its data.
    #[test]
    fn usbpcap_has_setup_packets() {
        let of = |transfer: u8, stage: u8| {
            let mut bytes = vec![0; 28];
            bytes[0] = 28;
            bytes[22] = transfer;
            bytes[27] = stage;
            bytes.extend([1, 2, 3, 4, 5, 6, 7, 8, 9]);
            let packet = Packet {
                link_type: USBPCAP,
                order: Order::Little,
                interface: 0,
                nanos: 0,
                is_outbound: None,
                bytes,
                cut: 0,
            };
            let urb = usbpcap(&packet).expect("whole");
            (urb.transfer, urb.setup.is_some(), urb.data.len())
        };
        assert_eq!(of(2, 0), (Transfer::Control, true, 1));
        assert_eq!(of(2, 1), (Transfer::Control, false, 9));
        assert_eq!(of(3, 0), (Transfer::Bulk, false, 9));
        assert_eq!(of(1, 0), (Transfer::Other, false, 9));
    }

    /// A device with two endpoints that bring bytes has two lines.
    #[test]
    fn a_device_may_have_two_lines() {
        let names = |second: u8| {
            let packets = [
                packet(COMPLETE, 3, 0x81, None, b"one"),
                packet(COMPLETE, 3, second, None, b"two"),
            ];
            let file = file(LINUX_MMAPPED.into(), &packets);
            let found = read_format(&file, Format::Pcap, &Options::default()).expect("sound");
            let names = found.links().iter().map(|link| link.name.clone());
            names.collect::<Vec<_>>()
        };
        assert_eq!(names(0x81), ["line"]);
        assert_eq!(names(0x83), ["line-0", "line-1"]);
    }

    /// Three empty replies are no proof if another reply has no status.
    #[test]
    fn all_replies_of_an_ftdi_adapter_have_a_status() {
        let of = |last: &[u8]| {
            let mut packets = vec![packet(COMPLETE, 3, 0x81, None, &[1, 0x60]); 3];
            packets.push(packet(COMPLETE, 3, 0x81, None, last));
            let found = told(&file(LINUX_MMAPPED.into(), &packets)).0;
            found.into_iter().map(|one| one.2.len()).sum::<usize>()
        };
        assert_eq!(of(&[1, 0x60, 7]), 1);
        assert_eq!(of(&[0xFF, 0xFF, 7]), 9);
        assert_eq!(of(&[0x02, 0x60, 7]), 1);
        assert_eq!(of(&[0x03, 0x60, 7]), 9);
        assert_eq!(of(&[0x01, 0x62, 7]), 9);
    }

    /// A command of a disk has 31 bytes that begin with USBC.
    #[test]
    fn other_bytes_than_a_disk_command_are_bytes_of_a_line() {
        for data in [
            [&b"USBC"[..], &[0; 26]].concat(),
            [&b"USBC"[..], &[0; 28]].concat(),
            [&b"USBX"[..], &[0; 27]].concat(),
        ] {
            let file = file(LINUX_MMAPPED.into(), &[packet(SUBMIT, 3, 2, None, &data)]);
            assert_eq!(told(&file).0[0].2, data);
        }
    }

    /// Two empty replies prove no FTDI chip, three do.
    #[test]
    fn few_empty_replies_are_bytes() {
        let bytes = |empty: usize| {
            let mut packets = vec![packet(COMPLETE, 3, 0x81, None, &[1, 0x60]); empty];
            packets.push(packet(COMPLETE, 3, 0x81, None, &[1, 0x60, 7]));
            let found = told(&file(LINUX_MMAPPED.into(), &packets)).0;
            found.into_iter().map(|one| one.2.len()).sum::<usize>()
        };
        assert_eq!([2, 3].map(bytes), [7, 1]);
    }

    /// The packets of an FTDI chip have 64 bytes, or 512 if only then each of them begins with a
    /// status. The first two bytes of each are left out.
    #[test]
    fn the_packets_of_an_unknown_ftdi_chip_have_the_size_that_fits() {
        let urb = |data: &'static [u8], is_in| Urb {
            nanos: 0,
            address: (1, 7),
            endpoint: 1,
            transfer: Transfer::Bulk,
            is_in,
            is_complete: is_in,
            setup: None,
            data,
        };
        let ftdi = Device {
            vendor: Some(0x0403),
            ..Device::default()
        };
        const FITS_512: &[u8] = &{
            let mut data = [0xFF; 100];
            (data[0], data[1]) = (1, 0x60);
            data
        };
        const FITS_64: &[u8] = &{
            let mut data = [0xFF; 100];
            (data[0], data[1], data[64], data[65]) = (1, 0x60, 1, 0x60);
            data
        };
        let size = |data, device| status_packet(&[&urb(data, true)], device);
        assert_eq!(size(FITS_64, ftdi), Some(64));
        assert_eq!(size(FITS_512, ftdi), Some(512));
        assert_eq!(size(&[0xFF; 100], ftdi), Some(64));
        let fast = Device {
            packet: Some(512),
            ..ftdi
        };
        assert_eq!(
            (size(FITS_64, fast), size(&[0xFF; 9], fast)),
            (Some(512), Some(512))
        );
        let other = Device {
            vendor: Some(0x10C4),
            ..Device::default()
        };
        assert_eq!(
            (size(FITS_64, other), size(FITS_64, Device::default())),
            (None, None)
        );
        // Bytes to the chip have no status.
        let sent = urb(&[0xFF; 9], false);
        let both = [&urb(FITS_64, true), &sent];
        assert_eq!(status_packet(&both, ftdi), Some(64));
    }

    /// The header of USBPcap has 27 bytes or more; bit 0 of byte 16 tells the completion, bit 7 of
    /// the endpoint its direction.
    #[test]
    fn each_field_of_usbpcap_has_its_place() {
        let of = |len: usize, info: u8, endpoint: u8| {
            let mut bytes = vec![0; len];
            bytes[0] = u8::try_from(len).expect("short");
            (bytes[16], bytes[17], bytes[19], bytes[20], bytes[21]) = (info, 2, 5, 1, endpoint);
            bytes[22..].iter_mut().take(1).for_each(|byte| *byte = 3);
            let packet = Packet {
                link_type: USBPCAP,
                order: Order::Little,
                interface: 0,
                nanos: 9,
                is_outbound: None,
                bytes,
                cut: 0,
            };
            let urb = usbpcap(&packet)?;
            Some((urb.address, urb.endpoint, urb.is_in, urb.is_complete))
        };
        assert_eq!(of(26, 1, 0x81), None);
        assert_eq!(of(27, 1, 0x81), Some(((2, 0x0105), 1, true, true)));
        assert_eq!(of(27, 2, 0x02), Some(((2, 0x0105), 2, false, false)));
        assert_eq!(of(27, 3, 0x7F), Some(((2, 0x0105), 0x7F, false, true)));
    }

    /// usbmon's header: the type of the event, the setup packet behind a submission with flag 0.
    #[test]
    fn each_field_of_usbmon_has_its_place() {
        let of = |event: u8, transfer: u8, endpoint: u8, flag: u8| {
            let mut bytes = packet(event, transfer, endpoint, None, b"abc");
            bytes[14] = flag;
            bytes[36] = 2;
            let packet = Packet {
                link_type: LINUX_MMAPPED,
                order: Order::Little,
                interface: 0,
                nanos: 9,
                is_outbound: None,
                bytes,
                cut: 0,
            };
            let urb = urb(&packet)?;
            let kind = (urb.transfer, urb.is_in, urb.endpoint);
            Some((kind, urb.is_complete, urb.setup.is_some(), urb.data.len()))
        };
        let (control, bulk, other) = (Transfer::Control, Transfer::Bulk, Transfer::Other);
        assert_eq!(
            of(b'S', 2, 0x80, 0),
            Some(((control, true, 0), false, true, 2))
        );
        assert_eq!(
            of(b'S', 3, 0x7F, b'-'),
            Some(((bulk, false, 0x7F), false, false, 2))
        );
        assert_eq!(
            of(b'C', 1, 0x83, 0),
            Some(((other, true, 3), true, false, 2))
        );
        assert_eq!(of(b'E', 3, 0x81, 0), None);
    }
}
