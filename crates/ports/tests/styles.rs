//! Drivers of each style on a bench, and the guarantees of the traits.

use core::future::poll_fn;
use core::pin::Pin;
use core::time::Duration;
use std::io::{self, Read as _, Write as _};

use embedded_hal::delay::DelayNs as _;
use embedded_hal::digital::{InputPin as _, OutputPin as _};
use embedded_hal::i2c::I2c as _;
use embedded_io::{ReadReady as _, WriteReady as _};
use hilrig_ports::Bench;
use serialport::SerialPort;

/// A sonar that sends `mm=700` and a newline each second from 1 s on, and answers `ping`.
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

/// Each style sends a request and returns the answer.
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

/// Five bytes in each direction are ten bytes of ten bits at 9600 baud: 10.417 ms. The traffic does
/// not depend on the style of the driver.
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

type Poll = (&'static str, fn(&Bench));

/// Each style polls until the run is over; the devices are a silent sonar, a bus, a pin.
const POLLS: [Poll; 11] = [
    ("available", |bench| {
        let port = bench.port("sonar").expect("a port");
        while port.available().is_ok() {}
    }),
    ("serialport", |bench| {
        let port = bench.serial("sonar", 9600).expect("a port");
        while port.bytes_to_read().is_ok() {}
        assert!(port.bytes_to_write().is_err());
    }),
    ("modem lines", |bench| {
        let mut port = bench.serial("sonar", 9600).expect("a port");
        while port.read_clear_to_send().is_ok() {}
    }),
    ("read without timeout", |bench| {
        let mut port = bench.port("sonar").expect("a port");
        port.set_timeout(Duration::ZERO);
        while !matches!(port.read(&mut [0]), Ok(0)) {}
    }),
    ("embedded-io", |bench| {
        let mut port = bench.port("sonar").expect("a port");
        while port.read_ready().is_ok() {}
        assert!(port.write_ready().is_err());
    }),
    ("tokio", |bench| {
        use tokio::io::AsyncReadExt;
        bench.tokio(async {
            let mut port = bench.port("sonar").expect("a port");
            tokio::time::sleep(100 * MS).await;
            assert_eq!(AsyncReadExt::read(&mut port, &mut [0]).await.ok(), Some(0));
        });
    }),
    ("futures", |bench| {
        bench.block_on(async {
            let mut port = bench.port("sonar").expect("a port");
            bench.timer(3600 * 1000 * MS).await;
            let read = embedded_io_async::Read::read(&mut port, &mut [0]).await;
            assert_eq!(read.ok(), Some(0));
        });
    }),
    ("wait_until", |bench| {
        assert_eq!(bench.wait_until(3600 * 1000 * MS, || None::<u8>), None);
    }),
    ("pin", |bench| {
        let mut pin = bench.pin("lidar-dtr").expect("a pin");
        while pin.is_high().is_ok() {
            bench.delay().delay_ms(1);
        }
    }),
    ("driven pin", |bench| {
        let mut pin = bench.pin("lidar-dtr").expect("a pin");
        while pin.set_high().is_ok() {
            bench.delay().delay_ms(1);
        }
    }),
    ("bus", |bench| {
        let mut bus = bench.i2c("eye").expect("a bus");
        while bus.read(0x70, &mut [0]).is_ok() {}
    }),
];

/// A program that polls forever ends with the run, whatever it queries.
#[test]
fn every_style_of_polling_ends_with_the_run() {
    let devices = "duration = \"20ms\"\ndevice.eye.srf08 = {}\n\
                   device.lidar.rplidar = { motor = \"dtr\" }\n\
                   device.sonar.text = { baud = 9600, command = [] }\n";
    for (name, poll) in POLLS {
        let text = format!("schema = 1\nname = \"bench\"\nrobot = \"none\"\n{devices}");
        let bench = Bench::from_text(&text).expect("sound");
        poll(&bench);
        assert_eq!(bench.now().as_micros(), 20_000, "{name}");
        bench.judge();
    }
}
