//! Guarantees of the traits of each style, in virtual time.

use core::time::Duration;
use std::io::{ErrorKind, Read as _, Write as _};
use std::sync::mpsc::{RecvTimeoutError, channel};

use embedded_hal::delay::DelayNs as _;
use embedded_hal::digital::{InputPin as _, OutputPin as _};
use embedded_hal::i2c::{Error as _, ErrorKind as I2cErrorKind, I2c as _};
use hilrig_ports::Bench;
use serialport::ClearBuffer;

const MS: Duration = Duration::from_millis(1);

/// A bench with these devices, and a world around them if they have a wall.
fn bench(devices: &str) -> Bench {
    let robot = if devices.contains("wall") {
        "custom"
    } else {
        "none"
    };
    let world = "world.start = { x_m = 0, y_m = 0, heading_deg = 0 }";
    let head = "schema = 1\nname = \"bench\"\nduration = \"20s\"\n";
    let text = format!("{head}robot = \"{robot}\"\n{world}\n{devices}");
    Bench::from_text(&text).expect("sound")
}

const SONAR: &str = r#"
[device.sonar.text]
baud = 9600
terminator = "\n"
latency = "0s"
command = [{ request = "ping", reply = "pong" }]
periodic = { line = "mm=700", period = "1s" }
"#;
/// Two devices that send a line every 100 ms, at different baud rates.
const TWO: &str = r#"
[device.a.text]
baud = 9600
terminator = "\n"
latency = "0s"
command = []
periodic = { line = "a", period = "100ms" }
[device.b.text]
baud = 19200
terminator = "\n"
latency = "0s"
command = []
periodic = { line = "b", period = "100ms" }
"#;

/// A port is opened with the call for its kind; the error names port, kind and call.
#[test]
fn a_port_of_another_kind_is_an_error() {
    let bench = bench(
        "device.eye.srf08 = {}\ndevice.lidar.rplidar = { motor = \"dtr\" }\n\
         device.sonar.text = { baud = 9600, command = [] }\n",
    );
    let errors = [
        bench.port("eye").map(drop),
        bench.i2c("sonar").map(drop),
        bench.pin("sonar").map(drop),
        bench.serial("lidar-dtr", 9600).map(drop),
        bench.port("ear").map(drop),
    ];
    let said = errors.map(|opened| opened.expect_err("another kind").to_string());
    let expected = [
        "the port eye is of kind i2c: open it with Bench::i2c (feature `embedded`)",
        "the port sonar is of kind uart: open it with Bench::port",
        "the port sonar is of kind uart: open it with Bench::port",
        "the port lidar-dtr is of kind pin: open it with Bench::pin (feature `embedded`)",
        "no port ear, expected one of eye, lidar, lidar-dtr, sonar",
    ];
    assert_eq!(said, expected);
}

/// Every 100 ms the order is: b after 0.521 ms, a and the end of b's line after 1.042 ms, the end
/// of a's line after 2.083 ms.
#[test]
fn threads_take_turns_in_the_order_of_virtual_time() {
    let told = || {
        let bench = bench(TWO);
        let (sender, receiver) = channel();
        let mut threads = Vec::new();
        for name in ["a", "b"] {
            let mut port = bench.port(name).expect("a port");
            let sender = sender.clone();
            threads.push(bench.spawn(name, move || {
                let mut byte = [0];
                while port.read(&mut byte).is_ok_and(|len| len == 1) {
                    sender.send(byte[0]).expect("the test listens");
                }
            }));
        }
        let first: Vec<u8> = (0..8)
            .map_while(|_| bench.wait_until(1000 * MS, || receiver.try_recv().ok()))
            .collect();
        let now = bench.now();
        let trace = bench.judge().trace_hash;
        threads.into_iter().for_each(|thread| thread.join());
        (String::from_utf8(first).expect("letters"), now, trace)
    };
    let (letters, now, trace) = told();
    assert_eq!(letters, "ba\n\nba\n\n");
    assert_eq!(now.as_micros(), 202_083);
    assert!((0..19).all(|_| told() == (letters.clone(), now, trace.clone())));
}

/// A thread that a driver starts is announced; time waits for that thread.
#[test]
fn an_expected_thread_of_a_driver_takes_part() {
    let bench = bench(SONAR);
    let mut port = bench.port("sonar").expect("a port");
    port.set_timeout(2000 * MS);
    bench.expect_thread("reader");
    let thread = std::thread::spawn(move || {
        let mut line = [0; 7];
        port.read_exact(&mut line).map(|()| line)
    });
    bench.sleep(1500 * MS);
    assert_eq!(&thread.join().expect("sound").expect("a line"), b"mm=700\n");

    let mut port = bench.port("sonar").expect("a port");
    let stranger =
        std::thread::spawn(move || port.read(&mut [0]).map_err(|error| error.to_string()));
    let error = stranger.join().expect("sound").expect_err("unknown");
    assert!(error.contains("start it with `Bench::spawn`"), "{error}");
}

/// The main thread waits for a channel outside the bench, so that the reader never gets its turn.
#[test]
fn a_thread_that_blocks_outside_is_named() {
    let bench = bench(SONAR);
    bench.set_patience(20 * MS);
    let mut port = bench.port("sonar").expect("a port");
    let (sender, receiver) = channel();
    let reader = bench.spawn("reader", move || {
        let _open = sender;
        port.read(&mut [0]).expect_err("no turn")
    });
    let received: Result<(), _> = receiver.recv_timeout(Duration::from_secs(60));
    assert_eq!(received, Err(RecvTimeoutError::Disconnected));
    let error = std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| reader.join()));
    let panic = error.expect_err("stuck");
    let said = panic.downcast_ref::<String>().expect("a message");
    assert!(
        said.contains("the thread a_thread_that_blocks_outside_is_named has the turn"),
        "{said}"
    );
}

/// With another baud rate the bytes are garbage; with the device's rate they are the line.
#[test]
fn settings_of_a_serial_port_act() {
    let bench = bench(SONAR);
    let mut port = bench.serial("sonar", 4800).expect("a port");
    port.set_timeout(1500 * MS).expect("taken");
    let mut line = [0; 3];
    port.read_exact(&mut line).expect("something");
    assert_ne!(&line, b"mm=");
    port.set_baud_rate(9600).expect("taken");
    bench.sleep(20 * MS);
    port.clear(ClearBuffer::All).expect("cleared");
    let mut line = [0; 7];
    port.read_exact(&mut line).expect("a line");
    assert_eq!(&line, b"mm=700\n");
    assert_eq!(port.set_baud_rate(0).map_err(|error| error.kind), {
        let kind = serialport::ErrorKind::Io(ErrorKind::InvalidInput);
        Err(kind)
    });

    // Five bytes come back from 2.007291 s on, one every 1.042 ms; the loop polls continuously.
    port.write_all(b"ping\n").expect("taken");
    assert_eq!(port.bytes_to_write().expect("known"), 4);
    let mut other = port.try_clone().expect("the same port");
    while other.bytes_to_read().expect("known") < 5 {}
    assert_eq!(port.bytes_to_write().expect("known"), 0);
    let mut reply = [0; 5];
    other.read_exact(&mut reply).expect("a reply");
    assert_eq!(
        (&reply, port.bytes_to_read().expect("known")),
        (b"pong\n", 0)
    );
    let error = port.read(&mut [0]).map(drop);
    assert_eq!(error.map_err(|error| error.kind()), Ok(()));
}

/// DTR of the port is the pin that restarts the text device.
#[test]
fn modem_lines_reach_the_device() {
    let devices = r#"
        [device.board.text]
        baud = 9600
        terminator = "\n"
        boot = "50ms"
        command = []
        resets_on = "dtr"
        greeting = "hello"
    "#;
    let bench = bench(devices);
    let mut port = bench.serial("board", 9600).expect("a port");
    let mut hello = [0; 6];
    port.read_exact(&mut hello).expect("greets at the start");
    port.write_data_terminal_ready(false).expect("a line");
    bench.sleep(100 * MS);
    port.write_data_terminal_ready(true).expect("a line");
    port.read_exact(&mut hello).expect("greets anew");
    assert_eq!(&hello, b"hello\n");
    let lines = [port.read_clear_to_send(), port.read_ring_indicator()];
    assert_eq!(lines.map(|level| level.ok()), [Some(true), Some(false)]);
}

/// tokio's timers follow the rig: a byte at 1001.042 ms comes between the timers of 1001 ms and
/// 1002 ms, and 500 ms later the same holds.
#[test]
fn timers_of_tokio_follow_the_rig() {
    use tokio::io::AsyncReadExt;
    let bench = bench(SONAR);
    bench.tokio(async {
        let mut port = bench.port("sonar").expect("a port");
        let begin = tokio::time::Instant::now();
        let mut byte = [0];
        let early = tokio::time::timeout(1001 * MS, port.read_u8());
        assert!(early.await.is_err());
        assert_eq!(bench.now().as_micros(), 1_001_000);
        let timely = tokio::time::timeout(MS, AsyncReadExt::read(&mut port, &mut byte));
        assert_eq!(timely.await.expect("in time").expect("a byte"), 1);
        assert_eq!(bench.now().as_micros(), 1_001_041);
        let ticks = tokio::spawn(async move {
            tokio::time::sleep(500 * MS).await;
            begin.elapsed().as_millis()
        });
        // 1501.042 ms, rounded up to the next tick of a timer.
        assert_eq!(ticks.await.expect("sound"), 1502);
        assert_eq!(bench.now().as_micros(), 1_502_000);
    });
}

/// A range measurement by a public sequence: 51 to register 0, 65 ms, two bytes from register 2.
/// Another address is not acknowledged.
#[test]
fn an_i2c_bus_has_its_chip() {
    let bench = bench(
        "world.wall = [{ path_m = [[2, -1], [2, 1]] }]\ndevice.eye.srf08 = { noise_m = 0 }\n",
    );
    let (mut bus, mut delay) = (bench.i2c("eye").expect("a bus"), bench.delay());
    bus.write(0x70, &[0, 0x51]).expect("acknowledged");
    delay.delay_ms(70);
    let mut range = [0; 2];
    bus.write_read(0x70, &[2], &mut range)
        .expect("acknowledged");
    let centimetres = u16::from_be_bytes(range);
    assert!((198..=202).contains(&centimetres), "{centimetres} cm");
    let error = bus.read(0x33, &mut range).expect_err("no such chip");
    assert!(
        matches!(error.kind(), I2cErrorKind::NoAcknowledge(_)),
        "{error}"
    );
    let read = bench.block_on(async {
        embedded_hal_async::i2c::I2c::write_read(&mut bus, 0x70, &[2], &mut range).await
    });
    assert!(read.is_ok() && u16::from_be_bytes(range) == centimetres);
}

/// The head of the lidar turns while DTR is low.
#[test]
fn a_pin_drives_the_device() {
    let bench = bench("device.lidar.rplidar = { motor = \"dtr\" }");
    let mut pin = bench.pin("lidar-dtr").expect("a pin");
    pin.set_low().expect("driven");
    assert!(pin.is_low().expect("known"));
    bench.sleep(100 * MS);
    let run = bench.run();
    let link = run.rig.link("lidar-dtr").expect("a pin");
    let levels = link.lines.iter().map(|line| line.traffic().delivered);
    assert_eq!(levels.sum::<u64>(), 1);
}

/// A future that does not wait for the bench, and a future on a foreign executor.
#[test]
fn a_future_that_nothing_wakes_is_an_error() {
    let bench = bench(SONAR);
    let mut port = bench.port("sonar").expect("a port");
    let mut buf = [0];
    let mut context = core::task::Context::from_waker(core::task::Waker::noop());
    let read = core::pin::pin!(embedded_io_async::Read::read(&mut port, &mut buf));
    let polled = Future::poll(read, &mut context);
    let core::task::Poll::Ready(Err(error)) = polled else {
        panic!("{polled:?}");
    };
    assert!(error.to_string().contains("`Bench::block_on`"), "{error}");
    let waits = std::panic::catch_unwind(|| bench.block_on(core::future::pending::<()>()));
    let panic = waits.expect_err("never comes");
    let said = panic.downcast_ref::<String>().expect("a message");
    assert!(said.contains("never comes"), "{said}");
}

/// While the run is borrowed, a port of the same thread would wait for itself.
#[test]
#[should_panic(expected = "drop its returned value first")]
fn a_port_is_not_used_while_the_run_is_borrowed() {
    let bench = bench(SONAR);
    let mut port = bench.port("sonar").expect("a port");
    let _run = bench.run();
    let _ = port.read(&mut [0]);
}

/// Two threads that communicate only over channels: an answer takes no virtual time.
#[test]
fn threads_that_wait_for_each_other_lose_no_time() {
    let bench = bench(SONAR);
    let (ask, asked) = channel();
    let (tell, told) = channel();
    let worker = bench.clone();
    let worker = bench.spawn("worker", move || {
        while let Some(number) = worker.wait_until(5000 * MS, || asked.try_recv().ok()) {
            tell.send(number + 1).expect("the test listens");
        }
    });
    for number in 0..3 {
        ask.send(number).expect("the worker listens");
        let reply = bench.wait_until(1000 * MS, || told.try_recv().ok());
        assert_eq!((reply, bench.now().as_micros()), (Some(number + 1), 0));
    }
    worker.join();

    // Actions of a thread in its first turn, before it waits for a byte.
    let mut port = bench.port("sonar").expect("a port");
    let (tell, told) = channel();
    let begin = bench.now();
    let first = bench.spawn("first", move || {
        tell.send(()).expect("the test listens");
        port.read(&mut [0])
    });
    assert!(
        bench
            .wait_until(1000 * MS, || told.try_recv().ok())
            .is_some()
    );
    assert_eq!(bench.now(), begin);
    assert!(first.join().is_ok());
}

/// The operating system determines which of two threads comes first, so threads are assigned by
/// name.
#[test]
fn expected_threads_are_told_apart_by_their_names() {
    let bench = bench(SONAR);
    bench.expect_thread("a");
    bench.expect_thread("b");
    let port = bench.port("sonar").expect("a port");
    let mut other = port.clone();
    let nameless = std::thread::spawn(move || other.read(&mut [0]).map_err(|e| e.to_string()));
    let error = nameless.join().expect("sound").expect_err("no place");
    assert!(error.contains("expected threads a, b"), "{error}");
}

/// The earlier of two timers in one future wakes it; a dropped timer wakes nothing.
#[test]
fn timers_of_one_future_are_apart() {
    use core::pin::Pin;
    use core::task::Poll;
    let bench = bench(SONAR);
    let mut timers = [10, 20].map(|ms| bench.timer(ms * MS));
    let mut dropped = Some(bench.timer(5 * MS));
    let mut polls = 0;
    let first = core::future::poll_fn(|cx| {
        polls += 1;
        if let Some(mut timer) = dropped.take() {
            assert!(Pin::new(&mut timer).poll(cx).is_pending());
        }
        let ready = timers
            .iter_mut()
            .position(|timer| Pin::new(timer).poll(cx).is_ready());
        ready.map_or(Poll::Pending, Poll::Ready)
    });
    assert_eq!(bench.block_on(first), 0);
    assert_eq!((bench.now().as_micros(), polls), (10_000, 2));
}

/// The answer to an abandoned transfer arrives during the next one, or never; afterwards the bus
/// works again. Register 0 is the revision, register 1 the light.
#[test]
fn a_late_answer_is_not_that_of_the_next_transfer() {
    for (kind, pause) in [("stall", 450), ("cut", 600)] {
        let bench = bench(&format!(
            "device.eye.srf08 = {{}}\n[[fault]]\nkind = \"{kind}\"\nlink = \"eye\"\n\
             direction = \"to-master\"\nfrom = \"1s\"\nuntil = \"2500ms\"\n"
        ));
        let mut bus = bench.i2c("eye").expect("a bus");
        let (mut revision, mut light, mut byte) = ([0], [0], [0]);
        bus.write_read(0x70, &[0], &mut revision).expect("answers");
        bus.write_read(0x70, &[1], &mut light).expect("answers");
        assert_ne!(revision, light);
        bus.write(0x70, &[1]).expect("answers");
        bench.sleep(1000 * MS);
        assert!(bus.read(0x70, &mut byte).is_err(), "{kind}");
        bench.sleep(pause * MS);
        bus.write_read(0x70, &[0], &mut byte).expect(kind);
        assert_eq!(byte, revision, "{kind}");
    }
    let bench = bench("device.eye.srf08 = {}\n");
    let mut bus = bench.i2c("eye").expect("a bus");
    // The address with the read bit, as some data sheets print it.
    let error = bus.read(0xE0, &mut [0]).expect_err("eight bits");
    assert!(error.to_string().contains("more than 7 bits"), "{error}");
    let mut raw = bench.raw("eye").expect("a bus");
    let written = raw.write(&[0; 1473]).map_err(|error| error.kind());
    assert_eq!(written, Err(ErrorKind::InvalidInput));
}

/// 11520 bytes per second for a second; the driver's buffer has 4096 bytes.
#[test]
fn unread_bytes_beyond_the_buffer_are_lost() {
    let bench = bench(
        "[device.sonar.text]\nbaud = 115200\ncommand = []\n\
         periodic = { line = \"0123456789\", period = \"1ms\" }\n",
    );
    let mut port = bench.port("sonar").expect("a port");
    bench.sleep(200 * MS);
    assert!((1..4096).contains(&port.available().expect("known")));
    bench.sleep(800 * MS);
    assert_eq!(port.available().expect("known"), 4096);
    let mut line = port.line().expect("known");
    line.data_bits = 9;
    let set = port.set_line(line).map_err(|error| error.kind());
    assert_eq!(set, Err(ErrorKind::InvalidInput));
}
