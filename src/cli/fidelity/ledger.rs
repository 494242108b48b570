//! The ledger of fidelity: for every kind of device the source that judges it, the properties that
//! agree with the source and their accuracy, the tests, and the properties that cannot be checked.

use schemars::JsonSchema;
use serde::Serialize;

/// The kind of source that judges a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(in crate::cli) enum Oracle {
    /// A data sheet, a protocol's document, the report of a robot.
    Document,
    /// Bytes from a real device.
    Capture,
    /// A public program that works with the real device.
    Client,
    /// The chip itself, or a simulator of it that runs the published firmware.
    Chip,
    /// No source was found: the values are guesses.
    Guess,
}

impl Oracle {
    const fn name(self) -> &'static str {
        match self {
            Self::Document => "document",
            Self::Capture => "capture",
            Self::Client => "client",
            Self::Chip => "chip",
            Self::Guess => "guess",
        }
    }
}

/// One row of the ledger.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub(in crate::cli) struct Row {
    /// Kind of device, as scenarios name it; `line` and `pc` are parts of every rig.
    pub(in crate::cli) device: &'static str,
    /// The kind of source.
    pub(in crate::cli) oracle: Oracle,
    /// Name of the source.
    pub(in crate::cli) source: &'static str,
    /// The properties that agree with the source, and their accuracy.
    pub(in crate::cli) agrees: &'static str,
    /// The properties that this source cannot judge.
    pub(in crate::cli) unknown: &'static str,
    /// The tests of this row, or the script that runs them.
    pub(in crate::cli) tests: &'static [&'static str],
}

use Oracle::{Capture, Chip, Client, Document, Guess};

/// All rows, by device.
pub(in crate::cli) const LEDGER: [Row; 27] = [
    Row {
        device: "xv11",
        oracle: Capture,
        source: "252,146 bytes of firmware 2.4.13386, a hand in a box",
        agrees: "28 figures, each within its own limit: packets, speeds, codes, strength, noise, \
                 coast-down, boot text to the byte; `hilrig fidelity xv11` prints both columns",
        unknown: "firmware 2.6; drift of the speed over minutes",
        tests: &["three_emulated_units_agree_with_the_published_figures"],
    },
    Row {
        device: "xv11",
        oracle: Capture,
        source: "the same capture, in a blind test: windows of two turns, the emulated sensor in \
                 the captured room",
        agrees: "a logistic classifier is right for 50 to 56 % of unseen windows of packets, tooth speeds, \
                 distances, strengths and codes; 50 % is chance",
        unknown: "the room: edges, corners and moving objects are removed from both streams; \
                  another capture, because the emulation was fitted to this one",
        tests: &[
            "f8_a_classifier_hardly_tells_real_windows_from_emulated_ones",
            "each_fault_is_found_in_its_group",
        ],
    },
    Row {
        device: "xv11",
        oracle: Capture,
        source: "two captures of firmware 2.1",
        agrees: "turns of 1,446 bytes; noise of facing walls at four distances",
        unknown: "the serial number and the calibration lines of the start text; the ring of that \
                  unit, which skips 4.7 slots a turn; its rotation by half a degree during the \
                  recording",
        tests: &["f9_the_noise_of_2_1_is_its_own"],
    },
    Row {
        device: "rplidar",
        oracle: Document,
        source: "LR001 2.x and LD108 of the vendor",
        agrees: "requests, descriptors, nodes and capsules to the byte; distances within 1 %",
        unknown: "the motor's time constant; when the rotation counts as steady",
        tests: &[
            "a_square_room_is_measured_as_it_is",
            "a_sample_is_due_at_its_number",
        ],
    },
    Row {
        device: "rplidar",
        oracle: Client,
        source: "the vendor's SDK, ROS node and Arduino library, and three drivers of other \
                 authors",
        agrees: "no error; no wrong point of 432,938 in all modes of firmware 1.29 by SDK and ROS \
                 node; the Arduino library on a simulated board",
        unknown: "statistics of real turns: no public raw capture of an A1 was found",
        tests: &[
            "tests/lidar_clients/run.sh",
            "tests/lidar_clients/vendor.sh",
        ],
    },
    Row {
        device: "rplidar",
        oracle: Document,
        source: "printouts of A1M8 owners in public threads",
        agrees: "five modes with their sample times, start texts, 267 or 268 nodes a turn",
        unknown: "the cause of each invalid sample; rooms have 16 to 17 % of them, an empty square \
                  room here 3 to 14 %",
        tests: &[
            "f11_firmware_1_29_tells_its_five_modes_and_streams_each",
            "the_adapter_gives_267_or_268_nodes_in_a_turn",
            "f12_a_reset_and_power_up_print_the_start_text",
        ],
    },
    Row {
        device: "avr-base",
        oracle: Chip,
        source: "both builds of its firmware in simavr",
        agrees: "median latency of 33 us for a read and 37 us for a write, the chip's four \
                 quantiles; memory behind the register map byte for byte; 21 of 4,000 frames lost \
                 near a count of the divider (10 to 32 here); the same answers to 97.1 to 100 % of \
                 100,125 random sequences, at most 0.5 % fewer than the chip gives in two runs \
                 (`tests/avr_base/run.sh`)",
        unknown: "the transmitter of a real chip, which simavr simplifies",
        tests: &[
            "point_12_latencies_are_distributed_as_observed",
            "point_10_21_of_4000_sound_frames_vanish_close_to_a_count",
            "f1_the_memory_behind_the_map_is_that_of_the_chip",
        ],
    },
    Row {
        device: "avr-base",
        oracle: Document,
        source: "the report of the rescue robot",
        agrees: "registers, checksums, watchdog and infrared curves of the documented build",
        unknown: "the idle time that ends a frame, the length of its queue",
        tests: &["the_documented_bank_is_the_reference"],
    },
    Row {
        device: "hc06",
        oracle: Client,
        source: "six public tools that set real modules up",
        agrees: "each receives its reply after its own wait of 0.55 to 1.2 s",
        unknown: "whether firmware 3.0 discards bytes that arrived at a wrong rate",
        tests: &["f6_the_waits_of_six_public_tools_are_long_enough"],
    },
    Row {
        device: "hc06",
        oracle: Document,
        source: "data sheets of linvor 1.5 to 1.8 and of firmware 3.0",
        agrees: "commands, replies, rates and the memory of each",
        unknown: "distance, interference, channel hopping",
        tests: &["the_module_is_the_reference"],
    },
    Row {
        device: "odometer",
        oracle: Chip,
        source: "both published sketches in simavr, faults included",
        agrees: "first line after 265 ms, 94.4 lines a second in the calibration (470 to 475 in 5 s) \
                 and 99.7 after it, lines alike to the character",
        unknown: "jitter of the loop on the board",
        tests: &[
            "a_simulated_chip_prints_what_our_emulated_board_prints",
            "lines_come_as_often_as_from_the_simulated_chip",
            "f14_the_later_sketch_prints_as_on_the_chip",
        ],
    },
    Row {
        device: "odometer",
        oracle: Document,
        source: "the report of the model car",
        agrees: "share of counted edges within 0.05: 1.00 at 0.22 m/s, 0.98 at 0.33 m/s, \
                 0.47 at 0.45 m/s",
        unknown: "bounce of the contacts",
        tests: &["ap4_the_board_counts_all_edges_up_to_22_cm_a_second"],
    },
    Row {
        device: "srf08",
        oracle: Document,
        source: "manual of the sensor",
        agrees: "registers, addresses and times; ranges within 1 cm from 0.2 to 5.9 m",
        unknown: "gain, further echoes, the real beam's side lobes",
        tests: &[
            "ap10_ranges_are_right_to_a_centimetre",
            "f17_an_odd_address_is_none",
        ],
    },
    Row {
        device: "srf08",
        oracle: Client,
        source: "an Arduino sketch on a simulated ATmega2560",
        agrees: "its ranges, over Debian's Wire library",
        unknown: "clock stretching of real chips",
        tests: &["a_simulated_chip_ranges_with_our_ranger"],
    },
    Row {
        device: "mpu6050",
        oracle: Document,
        source: "register map of the chip",
        agrees: "each writable register reads back; ready bit, FIFO and sample rate",
        unknown: "bias and its walk; the digital filter's shape",
        tests: &[
            "f17_registers_keep_what_is_written",
            "f17_the_fifo_holds_samples_until_they_are_read",
        ],
    },
    Row {
        device: "car-board",
        oracle: Document,
        source: "the report of the model car",
        agrees: "39.8 pulses a metre within 1; speeds of levels 2, 3, -3 and -4 as measured",
        unknown: "speeds of other levels, sag of the battery, behaviour out of range",
        tests: &[
            "the_hall_sensor_gives_39_8_pulses_a_metre_of_the_left_wheel",
            "levels_are_the_measured_ones_and_straight_beyond",
        ],
    },
    Row {
        device: "wheel-board",
        oracle: Document,
        source: "data sheet of the range sensor, report of the robot yellow",
        agrees: "the sensor's curve to 0.1 mV at seven distances",
        unknown: "motor lag, friction, places of the range sensors",
        tests: &["the_range_sensor_has_the_curve_of_the_data_sheet"],
    },
    Row {
        device: "camera",
        oracle: Document,
        source: "the report of the model car",
        agrees: "noise of 1.43 mm at 1 m that grows with the square, within 10 %",
        unknown: "columns without a depth, errors of marker poses",
        tests: &["noise_grows_with_the_square_of_the_depth"],
    },
    Row {
        device: "touch-panel",
        oracle: Guess,
        source: "no source names the display's controller",
        agrees: "nothing is compared",
        unknown: "frames, bus, calibration",
        tests: &["pixels_land_in_their_window"],
    },
    Row {
        device: "pc",
        oracle: Document,
        source: "source of the fielded PC program",
        agrees: "frames, waypoint lists and confirmations; its defects in the museum",
        unknown: "pixels of its window",
        tests: &["every_defect_of_the_pc_program_shows_and_only_in_the_fielded_one"],
    },
    Row {
        device: "registers",
        oracle: Document,
        source: "the scenario that describes it",
        agrees: "framing and sums of the scenario's keys",
        unknown: "busy times of a real slave",
        tests: &["a_value_of_the_world_is_read_low_byte_first"],
    },
    Row {
        device: "text",
        oracle: Document,
        source: "the scenario that describes it",
        agrees: "requests and replies of the scenario's keys",
        unknown: "busy times of a real slave",
        tests: &["a_text_slave_of_ones_own_answers_from_the_world"],
    },
    Row {
        device: "description",
        oracle: Client,
        source: "for each shipped description a public driver, docs/devices.md",
        agrees: "the driver reads every value, and detects damage as far as the protocol allows it",
        unknown: "parts of each manual that no driver uses",
        tests: &["tests/devices/run.sh"],
    },
    Row {
        device: "master",
        oracle: Document,
        source: "the requests and replies of the description that it polls",
        agrees: "each request is one that the described device answers, and each reply is judged",
        unknown: "how the real host of a device spaces its requests",
        tests: &["tests/rig/own_device.rs"],
    },
    Row {
        device: "program",
        oracle: Document,
        source: "the node contract, docs/nodes.md",
        agrees: "`hilrig node check` runs the contract against the program",
        unknown: "the device that the program emulates",
        tests: &["crates/nodes/tests/faults.rs"],
    },
    Row {
        device: "firmware",
        oracle: Chip,
        source: "simavr 1.6 runs the unmodified ELF file; data sheets of the microcontrollers",
        agrees: "bytes at the line's own times, pins, converter, I2C, watchdog",
        unknown: "fuses, brown-out, boot loader, outputs later by one slice of 200 us",
        tests: &["tests/firmware/run.sh"],
    },
    Row {
        device: "line",
        oracle: Document,
        source: "arithmetic of asynchronous characters, FTDI's application notes",
        agrees: "byte times to the nanosecond, wrong rates bit by bit, 62 bytes or 16 ms a packet",
        unknown: "edges and jitter of real transceivers; timers of other adapters",
        tests: &[
            "a_zero_byte_read_at_half_the_rate_is_f8",
            "ftdi_hands_over_full_packets_and_the_rest_when_its_timer_expires",
        ],
    },
];

/// The rows of `device`, or all.
pub(in crate::cli) fn rows(device: Option<&str>) -> Vec<Row> {
    let is_asked = |row: &&Row| device.is_none_or(|device| row.device == device);
    LEDGER.iter().filter(is_asked).copied().collect()
}

/// The names of all devices, in the order of the ledger.
pub(in crate::cli) fn devices() -> Vec<&'static str> {
    let mut names: Vec<_> = LEDGER.iter().map(|row| row.device).collect();
    names.dedup();
    names
}

/// The rows as text for a terminal.
pub(in crate::cli) fn text(rows: &[Row]) -> String {
    let paragraphs = rows.iter().map(|row| {
        let (oracle, tests) = (row.oracle.name(), row.tests.join(", "));
        format!(
            "{}: {oracle}: {}\n  agrees   {}\n  unknown  {}\n  test     {tests}\n",
            row.device, row.source, row.agrees, row.unknown
        )
    });
    paragraphs.collect::<Vec<_>>().join("\n")
}

/// The rows as a table of Markdown.
pub(in crate::cli) fn markdown(rows: &[Row]) -> String {
    let head = "| device | oracle | source | what agrees | what it cannot tell | test |\n\
                |---|---|---|---|---|---|\n";
    let lines = rows.iter().map(|row| {
        let tests: Vec<_> = row.tests.iter().map(|test| format!("`{test}`")).collect();
        format!(
            "| {} | {} | {} | {} | {} | {} |\n",
            row.device,
            row.oracle.name(),
            row.source,
            row.agrees,
            row.unknown,
            tests.join(", ")
        )
    });
    head.to_owned() + &lines.collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_device_has_its_rows() {
        let names = devices();
        for kind in engine::scenario::device::kinds() {
            assert!(names.contains(&kind.name()), "{} has no row", kind.name());
        }
        let mut sorted = names.clone();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), names.len(), "rows of a device stand together");
    }
}
