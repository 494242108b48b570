//! Drivers of each style on a bench, and what the traits promise.

use core::future::poll_fn;
use core::pin::Pin;
use core::time::Duration;
use std::io::{self, Read as _, Write as _};

use hilrig_ports::Bench;
use serialport::SerialPort;

/// A sonar that says `mm=700` and a newline each second from 1 s on, and answers `ping`.
const SONAR: &str = r#"
schema = 1
name = "sonar"
robot = "none"
duration = "10s"
[device.sonar.text]
baud = 9600
terminator = "\n"
latency = "0s"
command = [{ request = "ping", reply = "pong" }]
periodic = { line = "mm=700", period = "1s" }
"#;

const MS: Duration = Duration::from_millis(1);

fn sonar() -> Bench {
    Bench::from_text(SONAR).expect("sound")
}

fn line(mut read: impl FnMut(&mut [u8]) -> io::Result<usize>) -> io::Result<String> {
    let (mut line, mut byte) = (String::new(), [0]);
    while read(&mut byte)? == 1 && byte[0] != b'\n' {
        line.push(byte[0].into());
    }
    Ok(line)
}

async fn line_async<E>(
    mut read: impl AsyncFnMut(&mut [u8]) -> Result<usize, E>,
) -> Result<String, E> {
    let (mut line, mut byte) = (String::new(), [0]);
    while read(&mut byte).await? == 1 && byte[0] != b'\n' {
        line.push(byte[0].into());
    }
    Ok(line)
}

type Style = (&'static str, fn(&Bench) -> io::Result<String>);

/// Each asks and gives the answer.
const STYLES: [Style; 8] = [
    ("std", |bench| {
        let mut port = bench.port("sonar")?;
        port.write_all(b"ping\n")?;
        line(|buf| port.read(buf))
    }),
    ("serialport", |bench| {
        let mut port: Box<dyn SerialPort> = bench.serial("sonar", 9600)?;
        port.write_all(b"ping\n")?;
        line(|buf| port.read(buf))
    }),
    ("threads", |bench| {
        let mut port = bench.port("sonar")?;
        let mut reader = port.clone();
        let reader = bench.spawn("reader", move || line(|buf| reader.read(buf)));
        port.write_all(b"ping\n")?;
        reader.join()
    }),
    ("tokio", |bench| {
        use tokio::io::{AsyncReadExt, AsyncWriteExt};
        bench.tokio(async {
            let mut port = bench.port("sonar")?;
            AsyncWriteExt::write_all(&mut port, b"ping\n").await?;
            let read = async move |buf: &mut [u8]| AsyncReadExt::read(&mut port, buf).await;
            line_async(read).await
        })
    }),
    ("futures", |bench| {
        use futures_io::{AsyncRead, AsyncWrite};
        let mut port = bench.port("sonar")?;
        bench.block_on(async {
            let sent = poll_fn(|cx| AsyncWrite::poll_write(Pin::new(&mut port), cx, b"ping\n"));
            assert_eq!(sent.await?, 5);
            let read = async |buf: &mut [u8]| {
                poll_fn(|cx| AsyncRead::poll_read(Pin::new(&mut port), cx, buf)).await
            };
            line_async(read).await
        })
    }),
    ("embedded-io", |bench| {
        let mut port = bench.port("sonar")?;
        embedded_io::Write::write_all(&mut port, b"ping\n")?;
        line(|buf| embedded_io::Read::read(&mut port, buf))
    }),
    ("embedded-io 0.6", |bench| {
        let mut port = bench.port("sonar")?;
        embedded_io_06::Write::write_all(&mut port, b"ping\n")?;
        line(|buf| embedded_io_06::Read::read(&mut port, buf))
    }),
    ("embedded-io-async", |bench| {
        let mut port = bench.port("sonar")?;
        bench.block_on(async {
            embedded_io_async::Write::write_all(&mut port, b"ping\n").await?;
            line_async(async |buf| embedded_io_async::Read::read(&mut port, buf).await).await
        })
    }),
];

/// Five bytes there and five back are ten bytes of ten bits at 9600 baud: 10.417 ms. The wire does
/// not show how the driver is written.
#[test]
fn every_style_sees_the_same_wire() {
    let mut traces = Vec::new();
    for (name, style) in STYLES.into_iter().chain(STYLES) {
        let bench = sonar();
        assert_eq!(style(&bench).expect(name), "pong", "{name}");
        let micros = bench.now().as_micros();
        assert!((10_416..10_500).contains(&micros), "{name}: {micros} us");
        bench.sleep(2000 * MS);
        traces.push(bench.judge().trace_hash);
    }
    traces.dedup();
    assert_eq!(traces.len(), 1);
}
