//! A robot's program as it would run on a board: static memory, a panic handler, no operating
//! system, no allocator.
//!
//! The proof is that this crate builds. `std` has its own panic handler, and two of them are an
//! error; a heap without an allocator is another error. The features `mutant_std` and `mutant_heap`
//! each add one of these mistakes, and `prove.sh` verifies that both builds fail. Nothing here ever
//! runs: the peripherals do not exist.
#![no_std]

use core::cell::UnsafeCell;
use core::panic::PanicInfo;
use core::ptr::{read_volatile, write_volatile};

use firmware_core::Master;
#[cfg(feature = "rescue")]
use firmware_core::robots::rescue::{Config, Rescue as Program};
#[cfg(feature = "yellow")]
use firmware_core::robots::yellow::{Config, Yellow as Program};
use protocols::avr::{self, ChecksumOrder};
use protocols::{Decode, Instant, Port, hc06, pcui, rle, rplidar, telemetry, xv11};

/// The robot's only memory except for the stack.
struct Robot(UnsafeCell<Program>);

// SAFETY: one core, no interrupts: only `reset` ever looks at it.
unsafe impl Sync for Robot {}

#[unsafe(no_mangle)]
static ROBOT: Robot = Robot(UnsafeCell::new(Program::new(Config::DEFAULT)));

/// Registers of an invented board: received bytes and bytes to send of each port, and the time.
const RECEIVED: *const u16 = 0x4000_0000_usize as *const u16;
const TO_SEND: *mut u8 = 0x4000_1000_usize as *mut u8;
const NANOSECONDS: *const u64 = 0x4000_2000_usize as *const u64;

/// Entry point of the board.
#[unsafe(no_mangle)]
extern "C" fn reset() -> ! {
    // SAFETY: `reset` runs once, and no other code uses the robot's memory.
    let robot = unsafe { &mut *ROBOT.0.get() };
    loop {
        // SAFETY: the timer of the made-up board.
        let now = Instant::from_nanos(unsafe { read_volatile(NANOSECONDS) });
        for number in 0..4 {
            let port = Port(number);
            if let Some(byte) = received(port) {
                robot.receive(port, now, &[byte]);
            }
            let mut bytes = [0; 16];
            let len = robot.transmit(port, &mut bytes);
            bytes[..len].iter().for_each(|&byte| send(port, byte));
        }
        robot.poll(now);
    }
}

/// A byte that arrived; the upper half of the register is zero if there is none.
fn received(port: Port) -> Option<u8> {
    // SAFETY: a receive register of the made-up board.
    let [low, high] = unsafe { read_volatile(RECEIVED.add(port.0.into())) }.to_le_bytes();
    (high != 0).then_some(low)
}

fn send(port: Port, byte: u8) {
    // SAFETY: a transmit register of the made-up board.
    unsafe { write_volatile(TO_SEND.add(port.0.into()), byte) }
}

/// Every decoder and codec, also the unused ones, with input from outside.
#[unsafe(no_mangle)]
extern "C" fn decode_everything() {
    let mut packets = xv11::Decoder::default();
    let mut turns = xv11::turn::Decoder::default();
    let mut document = avr::Decoder::new(ChecksumOrder::LowFirst);
    let mut fielded = avr::Decoder::new(ChecksumOrder::HighFirst);
    let mut frames = pcui::Decoder::default();
    let mut scans = rplidar::Decoder::default();
    let mut requests = rplidar::RequestDecoder::default();
    let mut messages = telemetry::Decoder::default();
    while let Some(byte) = received(Port(0)) {
        drain(&mut packets, byte);
        drain(&mut turns, byte);
        drain(&mut document, byte);
        drain(&mut fielded, byte);
        drain(&mut scans, byte);
        drain(&mut requests, byte);
        drain(&mut messages, byte);
        for frame in frames.push(&[byte]).flatten() {
            send(Port(1), u8::from(frame.message().is_ok()));
        }
        send(
            Port(2),
            u8::from(hc06::Command::parse(&[byte; 4]).is_some()),
        );
        let mut row = [0; 300];
        let _ = rle::decode(&[byte; 2], &mut row);
        let mut code = [0; 600];
        let _ = rle::encode(&row, rle::Dialect::Fielded, &mut code);
        code.iter().for_each(|&byte| send(Port(3), byte));
    }
}

fn drain(decoder: &mut impl Decode, byte: u8) {
    let frames = decoder.push(&[byte]).filter(Result::is_ok).count();
    send(Port(1), u8::from(frames > 0));
    decoder.idle();
}

#[cfg(feature = "mutant_std")]
extern crate std;

#[cfg(feature = "mutant_heap")]
#[unsafe(no_mangle)]
extern "C" fn allocate() {
    extern crate alloc;
    send(
        Port(0),
        alloc::boxed::Box::new(received(Port(0))).unwrap_or(0),
    );
}

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    loop {}
}
