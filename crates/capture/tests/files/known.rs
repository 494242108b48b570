//! Files of tools that are not installed here, in the tools' formats.

use super::*;

/// One file, and its correct content.
struct Row {
    tool: &'static str,
    file: Vec<u8>,
    told: Told,
    /// Nanoseconds between the first two records, if the file contains times.
    gap: Option<u64>,
}

fn row(tool: &'static str, file: impl AsRef<[u8]>, told: Told, gap: Option<u64>) -> Row {
    Row {
        tool,
        file: file.as_ref().to_vec(),
        told,
        gap,
    }
}

const MS: u64 = 1_000_000;

fn rows() -> Vec<Row> {
    let both = conversation;
    let asked = || received(&ASK);
    vec![
        row(
            "Docklight",
            "Docklight Log File (HEX) - Started 27.11.2026 12:11:23.000\r\n\r\n\
             27.11.2026 12:11:23.100 [TX] - 01 03 00 00 00 02 C4 0B \r\n\
             27.11.2026 12:11:23.120 [RX] - 01 03 04 00 06 00 05 DA 31 \r\n",
            both(),
            Some(20 * MS),
        ),
        row(
            "Free Serial Port Monitor, Eltima",
            "[27/11/2026 12:11:23] Open port COM3 (a.exe)\n\
             [27/11/2026 12:11:23] Written data (COM3) \n    01 03 00 00 00 02 c4 0b                          \
             \u{20}......\u{c4}.        \n[27/11/2026 12:11:24] Read data (COM3) \n    \
             01 03 04 00 06 00 05 da 31                        ......\u{fa}1       \n",
            both(),
            Some(1_000 * MS),
        ),
        row(
            "Portmon",
            "58\t0.00000335\ta.exe\tIOCTL_SERIAL_SET_BAUD_RATE\tSerial0\tSUCCESS\tRate: 9600\n\
             59\t0.00000335\ta.exe\tIRP_MJ_WRITE\tSerial0\tSUCCESS\tLength 8: 01 03 00 00 00 02 C4 0B\n\
             60\t0.01551789\ta.exe\tIRP_MJ_READ\tSerial0\tSUCCESS\tLength 9: 01 03 04 00 06 00 05 DA 31\n",
            both(),
            None,
        ),
        row(
            "Modbus Poll",
            "Tx:000123-01 03 00 00 00 02 C4 0B\r\nRx:000124-01 03 04 00 06 00 05 DA 31\r\n",
            both(),
            None,
        ),
        row(
            "QModMaster",
            "[RTU]>Tx > 12:11:23:456 - 01 03 00 00 00 02 C4 0B  \n\
             [RTU]>Rx > 12:11:23:476 - 01 03 04 00 06 00 05 DA 31  \n",
            both(),
            Some(20 * MS),
        ),
        row(
            "libmodbus, mbpoll",
            "Opening /dev/ttyUSB0 at 9600 bauds (N, 8, 1)\n[01][03][00][00][00][02][C4][0B]\n\
             Waiting for a confirmation...\n<01><03><04><00><06><00><05><DA><31>\n",
            both(),
            None,
        ),
        row(
            "pymodbus",
            "2026-11-27 12:11:23,123 DEBUG logging:103 send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\n\
             2026-11-27 12:11:23,143 DEBUG logging:103 recv: 0x1 0x3 0x4 0x0 0x6 0x0 0x5 0xda 0x31 \
             old_data:  addr=None\n",
            both(),
            Some(20 * MS),
        ),
        row(
            "ESPHome",
            "[12:11:23.100][D][uart_debug:114]: >>> 01:03:00:00:00:02:C4:0B\n\
             [12:11:23.120][D][uart_debug:114]: <<< 01:03:04:00:06:00:05:DA:31\n",
            both(),
            Some(20 * MS),
        ),
        row(
            "ESP-IDF, with colours",
            "\x1B[0;32mI (357) tx: 01 03 00 00 00 02 c4 0b \x1B[0m\n\
             \x1B[0;32mI (377) rx: 01 03 04 00 06 00 05 da 31 \x1B[0m\n",
            both(),
            Some(20 * MS),
        ),
        row(
            "esptool --trace",
            "TRACE +0.000 Write 8 bytes: 010300000002c40b\n\
             TRACE +0.020 Read 9 bytes: \n    01030400060005da 31               | ........1\n",
            both(),
            None,
        ),
        row(
            "Arduino IDE, monitor of hex",
            "12:11:23.456 -> 1 3 0 0 0 2 C4 B\r\n12:11:23.476 -> AB CD\r\n",
            received(&[&ASK[..], &[0xAB, 0xCD]].concat()),
            Some(20 * MS),
        ),
        row(
            "Arduino IDE, monitor of text",
            "12:11:23.456 -> $GPGGA,1\r\n12:11:23.476 -> OK\r\n",
            received(b"$GPGGA,1\r\nOK\r\n"),
            Some(20 * MS),
        ),
        row(
            "TeraTerm, with times",
            "[2026-11-27 12:11:23.456] $GPGGA,1\r\n[2026-11-27 12:11:23.476] OK\r\n",
            received(b"$GPGGA,1\r\nOK\r\n"),
            Some(20 * MS),
        ),
        row(
            "PuTTY, all session output",
            "=~=~=~=~=~=~=~=~=~=~=~= PuTTY log 2026.11.27 12:11:23 =~=~=~=~=~=~=~=~=~=~=~=\r\n\
             $GPGGA,1\r\nOK\r\n",
            received(b"$GPGGA,1\r\nOK\r\n"),
            None,
        ),
        row(
            "PuTTY, raw data",
            "Outgoing raw data at 2026-11-27 12:11:23\n  00000000  01 03 00 00 00 02 c4 0b                          \
             ........\nIncoming raw data at 2026-11-27 12:11:24\n  \
             00000000  01 03 04 00 06 00 05 da 31                       ........1\n",
            both(),
            Some(1_000 * MS),
        ),
        row(
            "Wireshark, Follow as hex dump",
            "00000000  01 03 00 00 00 02 c4 0b                           ........ \n    \
             00000000  01 03 04 00 06 00 05 da  31                       ........ 1\n",
            both(),
            None,
        ),
        row(
            "Wireshark, Copy as hex dump",
            "0000   01 03 00 00 00 02 c4 0b                           ........\n",
            asked(),
            None,
        ),
        row("Wireshark, Copy as hex stream", "010300000002c40b", asked(), None),
        row(
            "Wireshark, Copy as C array",
            "/* Frame (8 bytes) */\nstatic const unsigned char pkt1[8] = {\n\
             0x01, 0x03, 0x00, 0x00, 0x00, 0x02, 0xc4, 0x0b  /* ........ */\n};\n",
            asked(),
            None,
        ),
        row(
            "PowerShell, Format-Hex > file (UTF-16)",
            utf16(
                "\r\n           Path: C:\\a.bin\r\n\r\n           \
                 00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F\r\n\r\n\
                 00000000   01 03 00 00 00 02 C4 0B                          ......\u{c4}.\r\n\r\n",
            ),
            asked(),
            None,
        ),
        row(
            "certutil -encodehex",
            "0000\t01 03 00 00 00 02 c4 0b                            ........\r\n",
            asked(),
            None,
        ),
        row(
            "HxD, copy of the view",
            "Offset(h) 00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F\r\n\r\n\
             00000000  01 03 00 00 00 02 C4 0B                          ......\u{c4}.\r\n",
            asked(),
            None,
        ),
        row(
            "U-Boot, md.b",
            "=> md.b 40000000 8\n40000000: 01 03 00 00 00 02 c4 0b                            ........\n"
                .replace("=> md.b 40000000 8\n", ""),
            asked(),
            None,
        ),
        row(
            "Python, print(data)",
            "b'\\x01\\x03\\x00\\x00\\x00\\x02\\xc4\\x0b'\n",
            asked(),
            None,
        ),
        row(
            "Python, bytearray with a log's prefix",
            "0.1 TX bytearray(b'\\x01\\x03\\x00\\x00\\x00\\x02\\xc4\\x0b')\n\
             0.12 RX bytearray(b'\\x01\\x03\\x04\\x00\\x06\\x00\\x05\\xda1')\n",
            both(),
            Some(20 * MS),
        ),
        row("Rust, {:?} of a Vec", "[1, 3, 0, 0, 0, 2, 196, 11]\n", asked(), None),
        row("Java, Arrays.toString", "[1, 3, 0, 0, 0, 2, -60, 11]\n", asked(), None),
        row("C#, BitConverter", "01-03-00-00-00-02-C4-0B\r\n", asked(), None),
        row("node, console.log", "<Buffer 01 03 00 00 00 02 c4 0b>\n", asked(), None),
        row(
            "a table with semicolons and a mark of UTF-8",
            "\u{feff}Time;Direction;Data\r\n0.1;TX;01 03 00 00 00 02 C4 0B\r\n\
             0.12;RX;01 03 04 00 06 00 05 DA 31\r\n",
            both(),
            Some(20 * MS),
        ),
        row(
            "lines of JSON",
            "{\"ts\": 0.1, \"dir\": \"tx\", \"data\": \"010300000002c40b\"}\n\
             {\"ts\": 0.12, \"dir\": \"rx\", \"data\": \"01030400060005da31\"}\n",
            both(),
            Some(20 * MS),
        ),
        row(
            "strace -y -tt -xx",
            "12:11:23.100000 write(3</dev/ttyUSB0>, \"\\x01\\x03\\x00\\x00\\x00\\x02\\xc4\\x0b\", 8) = 8\n\
             12:11:23.110000 write(1</dev/pts/0>, \"\\x68\\x69\", 2) = 2\n\
             12:11:23.120000 read(3</dev/ttyUSB0>, \"\\x01\\x03\\x04\\x00\\x06\\x00\\x05\\xda\\x31\", 256) = 9\n"
                .replace("1</dev/pts/0>", "1</tmp/out>"),
            both(),
            Some(20 * MS),
        ),
        row(
            "Saleae Logic 1, serial analyzer",
            "Time [s],Analyzer Name,Decoded Protocol Result\r\n0.1000,Async Serial,0x01\r\n\
             0.1001,Async Serial,0x03\r\n",
            received(&[1, 3]),
            Some(MS / 10),
        ),
        row(
            "Saleae Logic 2, table of two analyzers",
            "name,type,start_time,duration,data,error\n\"TX\",\"data\",0.1,8.6e-05,0x01,\n\
             \"RX\",\"data\",0.12,8.6e-05,0x02,\n",
            vec![(true, vec![1]), (false, vec![2])],
            Some(20 * MS),
        ),
        row(
            "interceptty",
            "< 0x01 (.)\n< 0x03 (.)\n> \t0x31 (1)\n",
            vec![(true, vec![1, 3]), (false, vec![0x31])],
            None,
        ),
        row(
            "pySerial, spy://",
            "000000.100 TX   0000  01 03 00 00 00 02 C4 0B                           ........\n\
             000000.120 RX   0000  01 03 04 00 06 00 05 DA  31                       ........1\n",
            both(),
            Some(20 * MS),
        ),
    ]
}

fn utf16(text: &str) -> Vec<u8> {
    let units = text.encode_utf16().flat_map(u16::to_le_bytes);
    [0xFF, 0xFE].into_iter().chain(units).collect()
}

#[test]
fn files_of_known_tools_are_read() {
    let mut wrong = Vec::new();
    for row in rows() {
        let tool = row.tool;
        match imported(&row.file, "file.txt", &Options::default()) {
            Err(error) => wrong.push(format!("{tool}: {error}")),
            Ok(import) => {
                if import.told != row.told {
                    let (format, told) = (import.format, &import.told);
                    wrong.push(format!("{tool}: {format:?} {told:02X?}"));
                }
                let gap = || Some(import.times.get(1)?.abs_diff(*import.times.first()?));
                if row.gap.is_some() && gap() != row.gap {
                    wrong.push(format!("{tool}: gap {:?}, not {:?}", gap(), row.gap));
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The same files as on Windows: CR LF, a byte order mark, UTF-16; and with a cut last line.
#[test]
fn the_encoding_of_a_file_changes_nothing() {
    for row in rows() {
        let Ok(text) = String::from_utf8(row.file.clone()) else {
            continue;
        };
        let windows = text.replace("\r\n", "\n").replace('\n', "\r\n");
        let marked = format!("\u{feff}{}", windows.trim_start_matches('\u{feff}'));
        for file in [
            windows.clone().into_bytes(),
            marked.into_bytes(),
            utf16(&windows),
        ] {
            let found = imported(&file, "file.txt", &Options::default());
            assert_eq!(
                found.map(|found| found.told),
                Ok(row.told.clone()),
                "{}",
                row.tool
            );
        }
        let cut = text.trim_end_matches(['\r', '\n']);
        if row.tool.contains("text") || row.tool.contains("PuTTY") || row.tool.contains("times") {
            continue;
        }
        let found = imported(cut.as_bytes(), "file.txt", &Options::default());
        assert_eq!(found.map(|found| found.told), Ok(row.told), "{}", row.tool);
    }
}
