//! A client of a sonar, once on the crate `serialport` with a thread that reads, once on
//! tokio with
//! tasks: to be run by `hilrig run .. --exec 'rust_client serialport'`, also with `--virtual`.
#![expect(
    clippy::disallowed_methods,
    reason = "a client is a program like any other, and sleeps by itself"
)]

use core::time::Duration;
use std::io::{self, BufRead as _, BufReader, Write as _};
use std::sync::mpsc::channel;
use std::thread;

use tokio::time::{interval, sleep, timeout};

const ASK_EVERY: Duration = Duration::from_millis(130);

fn on_serialport(path: &str) -> Result<(), Box<dyn core::error::Error>> {
    let mut port = serialport::new(path, 9600)
        .timeout(Duration::from_secs(60))
        .open()?;
    let reader = BufReader::new(port.try_clone()?);
    let (sender, lines) = channel();
    thread::spawn(move || reader.lines().try_for_each(|line| sender.send(line)));
    loop {
        match lines.recv_timeout(ASK_EVERY / 2) {
            Ok(line) => println!("{}", line?),
            Err(_) => port.write_all(b"ping\r\n")?,
        }
    }
}

async fn on_tokio(path: &str) -> io::Result<()> {
    // Not only pipes: any file for which one can wait.
    let mut open = tokio::net::unix::pipe::OpenOptions::new();
    let (reader, writer) = (
        open.unchecked(true).open_receiver(path)?,
        open.unchecked(true).open_sender(path)?,
    );
    let asking = async {
        let mut ticks = interval(ASK_EVERY);
        loop {
            ticks.tick().await;
            writer.writable().await?;
            writer.try_write(b"ping\r\n")?;
            // A thread of the runtime wakes this one through its event.
            tokio::task::spawn_blocking(|| thread::sleep(Duration::from_millis(7))).await?;
        }
    };
    let reading = async {
        let mut bytes = [0; 64];
        loop {
            let Ok(ready) = timeout(Duration::from_millis(30), reader.readable()).await else {
                sleep(Duration::from_micros(1500)).await;
                continue;
            };
            ready?;
            match reader.try_read(&mut bytes) {
                Ok(len) => println!("{}", bytes[..len].escape_ascii()),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => return Err(error),
            }
        }
    };
    let ended: io::Result<()> =
        tokio::select! { ended = asking => ended, ended = reading => ended };
    ended
}

fn main() -> Result<(), Box<dyn core::error::Error>> {
    let path = std::env::var("HILRIG_PORT_SONAR")?;
    match std::env::args().nth(1).as_deref() {
        Some("tokio") => {
            let mut runtime = tokio::runtime::Builder::new_current_thread();
            Ok(runtime.enable_all().build()?.block_on(on_tokio(&path))?)
        }
        _ => on_serialport(&path),
    }
}
