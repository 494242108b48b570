//! Answers to requests other than scans.

use protocols::Instant;
use protocols::rplidar::{Answer, Command, Conf, Descriptor, Health, Status, kind};

use super::{Fault, MotorControl, Phase, Rplidar};

/// Bytes before the length of a descriptor.
const LENGTH_AT: usize = 2;

impl Rplidar {
    pub(super) fn answer(&mut self, at: Instant, command: Command) {
        let answer = match command {
            Command::Info => self.profile.info().answer(),
            Command::Health => self.health().answer(),
            Command::SampleRate => self.profile.sample_rate().answer(),
            Command::Conf { key, mode } if self.profile.has_conf() => {
                let value = self.conf(key, mode);
                Conf { key, value: &value }.answer()
            }
            Command::AccBoard => {
                let drives_motor = u8::from(self.motor == MotorControl::Command);
                Answer::new(kind::ACC_BOARD, &[drives_motor, 0, 0, 0])
            }
            _ => {
                let name = self.profile.name();
                let detail = format!("{command:?} has no effect on an A1 with {name}");
                let request = command.request();
                let bytes = request.as_bytes();
                self.log
                    .violation(at, "request-not-supported", detail, bytes);
                return;
            }
        };
        let answer = match self.faults.has(Fault::EmptyAnswer) {
            true => Answer::new(answer.kind(), &[]),
            false => answer,
        };
        self.send_answer(answer.as_bytes());
    }

    /// The value of a configuration key as the sensor sends it.
    fn conf(&self, key: u32, mode: Option<u16>) -> Vec<u8> {
        let emptied = self.faults.figure(Fault::ConfEmpty);
        if emptied.is_some_and(|only| only == 0.0 || only == f64::from(key)) {
            return Vec::new();
        }
        let typical = self.faults.figure(Fault::TypicalMode).map(|mode| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a cast of a float saturates"
            )]
            let mode = mode as u16;
            mode
        });
        self.profile.conf(key, mode, typical)
    }

    /// Sends the descriptor of a stream.
    pub(super) fn announce(&mut self, descriptor: Descriptor) {
        self.send_answer(descriptor.as_bytes());
    }

    /// Sends bytes that begin with a descriptor. Faults may change the descriptor.
    fn send_answer(&mut self, bytes: &[u8]) {
        let mut bytes = bytes.to_vec();
        if self.faults.has(Fault::Foreign) {
            bytes[..LENGTH_AT].copy_from_slice(&[0xAA, 0x55]);
        }
        if self.faults.has(Fault::DescriptorLength) {
            bytes[LENGTH_AT] = bytes[LENGTH_AT].wrapping_add(1);
        }
        self.output.send(&bytes, &mut self.faults);
    }

    fn health(&self) -> Health {
        match self.phase {
            Phase::ProtectionStop { error } => Health {
                status: Status::Error,
                error,
            },
            _ if self.faults.has(Fault::HealthWarning) => Health {
                status: Status::Warning,
                error: 0,
            },
            _ => Health::default(),
        }
    }
}
