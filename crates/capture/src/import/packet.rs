//! One packet of a pcap or pcapng file.

use crate::pcapng::Order;

/// One packet of a file.
#[derive(Clone, Debug)]
pub(super) struct Packet {
    pub(super) link_type: u16,
    /// Byte order of the machine that recorded the packet.
    pub(super) order: Order,
    /// Index of the interface in the file.
    pub(super) interface: usize,
    pub(super) nanos: u64,
    /// Whether the host sent the packet, if the file contains this.
    pub(super) is_outbound: Option<bool>,
    pub(super) bytes: Vec<u8>,
    /// Number of bytes that the recording cut off.
    pub(super) cut: u32,
}
