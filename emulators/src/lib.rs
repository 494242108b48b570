//! Virtual serial hardware and the world around it.
//!
//! Devices use their real protocols byte for byte, including the defects; the world computes
//! encoder ticks and lidar readings from motor commands. No code here does I/O, reads a clock or
//! uses randomness without a named stream: equal state and equal input give equal output, on every
//! host.
//!
//! | module | content |
//! |---|---|
//! | [`avr_base`] | register slave with motors, encoders and infrared sensors |
//! | [`camera`] | depth camera with a detector of markers |
//! | [`car_board`] | board of a model car: motor, servo, ultrasonic ranges, hall, line, battery |
//! | [`device`] | the contract of every device |
//! | [`figure`] | a figure of a real device beside the emulated one's |
//! | [`hc06`] | Bluetooth radio: command and data mode, finite FIFO, slow air |
//! | [`i2c`] | chips with registers on an I2C bus |
//! | [`lidar`] | common parts of turning lidars |
//! | [`mpu6050`] | gyroscope and accelerometer |
//! | [`odometer`] | microcontroller that prints distance and heading |
//! | [`pc`] | scripted PC at the other end of the radio: sends waypoints, collects the map |
//! | [`registers`], [`text`] | slaves described by data: a register table, a text protocol |
//! | [`quantity`] | values of such slaves |
//! | [`rplidar`] | RPLIDAR A1 lidar |
//! | [`srf08`] | ultrasonic ranger |
//! | [`touch_panel`] | display of 480 x 272 pixels, drawn and touched over the wire |
//! | [`wheel_board`] | motor board of timers, PWM and ADC |
//! | [`world`] | ground truth: scene, robot body, physics, ray casts |
//! | [`xv11`] | Neato XV-11 lidar |
//! | [`rng`] | named random streams from one seed |

pub mod avr_base;
pub mod board;
pub mod camera;
pub mod car_board;
pub mod device;
pub mod event_log;
pub mod figure;
pub mod hc06;
pub mod i2c;
pub mod lidar;
pub mod mpu6050;
pub mod odometer;
pub mod pc;
pub mod quantity;
pub mod registers;
pub mod rng;
pub mod rplidar;
pub mod srf08;
pub mod text;
pub mod touch_panel;
pub mod wheel_board;
pub mod world;
pub mod xv11;

pub use device::{BrokenRules, Device, Event, EventKind};
