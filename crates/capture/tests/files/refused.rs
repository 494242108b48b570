//! Files that are something else, or broken: each is refused with the next step.

use super::*;

#[test]
fn foreign_and_broken_files_name_the_next_step() {
    let pcap = |link_type: u8| {
        let mut file = b"\xD4\xC3\xB2\xA1\x02\0\x04\0\0\0\0\0\0\0\0\0\xFF\xFF\0\0".to_vec();
        file.extend([
            link_type, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0, 1, 2,
        ]);
        file
    };
    let (ethernet, can) = (pcap(1), pcap(227));
    let rows: Vec<(&str, &[u8], &str)> = vec![
        ("candump -L", b"(1436509052.249713) can0 123#DEADBEEF\n", "hilrig has no CAN"),
        ("candump", b"  can0  123   [4]  DE AD BE EF\n", "hilrig has no CAN"),
        ("a pcap of a network", &ethernet, "tshark -r FILE"),
        ("a pcap of a CAN bus", &can, "hilrig has no CAN"),
        ("Saleae Logic 2's session", b"PK\x05\x06", "Export Table"),
        ("a firmware image", b":0100000000FF\n:00000001FF\n", "objcopy"),
        ("usbmon's text", b"ffff88003a2c3c00 1234567890 C Bi:1:005:1 0 64 = ab240a00\n", "tcpdump -i usbmon1"),
        ("sigrok-cli -O hex", b"libsigrok 0.5.2\nAcquisition with 1/1 channels at 1 MHz\n0:ff ff\n", "-O csv"),
        ("base64", b"qyQKANkrJAoA2asqqyQKANkrJAoA\n", "base64 -d"),
        ("words", b"motor started at last\n", "looked for"),
        ("socat -v", b"ATI> 2026/11/27 13:47:27.000193  length=5 from=0 to=4\n", "socat -x -v"),
        ("a log that cuts", b"1 0.1 a.exe IRP_MJ_WRITE Serial0 SUCCESS Length 40: 01 03 AB\n", "log all bytes"),
        ("strace that cuts", b"write(3, \"\\xab\"..., 40) = 40\n", "-s 99999"),
        ("numbers of two bases", b"1 3 0 10 20 30 5 7 9\n", "decimal or hex"),
        ("tcpdump -X", b"12:11:23.000501 IP a.1 > b.2: Flags [P.], length 4\n\t0x0000:  4500 002c 1234 4000 4006 0000 7f00 0001  E..,.4@.@.......\n", "with their headers"),
        ("a dump with a lost row", b"00000000  01 02 03 04 05 06 07 08  09 0a 0b 0c 0d 0e 0f 10  |................|\n00000020  01 02                                             |..|\n", "bytes up to the next offset"),
        ("a row of I2C", b"name,type,start_time,duration,data,error,ack,address,read\n\"I2C\",\"data\",0.0002,8e-05,0xA0,,true,,\n", "--channel NAME"),
        ("an office document", b"{\\rtf1 AB 24}", "plain text"),
        ("words of od without offsets", b" 022253 000012 125731 020044 061141 000400\n", "od -t x1"),
        ("Wireshark's YAML", b"peers:\n  - peer: 0\npackets:\n  - packet: 1\n", "Show as Hex Dump"),
    ];
    let mut wrong = Vec::new();
    for (what, file, step) in rows {
        let name = if what.contains("session") {
            "a.sal"
        } else {
            "a.txt"
        };
        match imported(file, name, &Options::default()) {
            Ok(import) => wrong.push(format!("{what}: read as {:?}", import.format)),
            Err(error) if !error.contains(step) => wrong.push(format!("{what}: {error}")),
            Err(_) => {}
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
