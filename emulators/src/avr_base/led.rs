//! State of the light on top of the robot.

use protocols::avr::registers;

use super::memory::Memory;

/// The light. Hues are the firmware's: 0 to 255 once round the circle of colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Led {
    /// No fault: the brightness goes up and down. Green, and towards red below 20 percent.
    Heartbeat {
        /// Follows the battery.
        hue: u8,
    },
    /// A fault: the light blinks.
    Blink {
        /// Hue of the light: see [`FAULT_HUE`], [`STOPPED_HUE`], [`SILENT_HUE`].
        hue: u8,
    },
    /// The master has set it.
    Master {
        /// Register 50.
        hue: u8,
        /// Register 51.
        saturation: u8,
        /// Register 52.
        value: u8,
    },
}

/// Red: restarted by the watchdog.
pub const FAULT_HUE: u8 = 1;
/// Orange: motors off.
pub const STOPPED_HUE: u8 = 30;
/// Green: no frame for three seconds.
pub const SILENT_HUE: u8 = 85;

/// Reason for blinking, most serious first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Trouble {
    Restarted,
    Stopped,
    Silent,
}

/// The light that follows from the registers and `trouble`.
pub(super) fn led(memory: &Memory, trouble: Option<Trouble>) -> Led {
    let [mode, hue, saturation, value] = [0, 1, 2, 3].map(|i| memory.get(registers::LED_MODE + i));
    if mode != 0 {
        return Led::Master {
            hue,
            saturation,
            value,
        };
    }
    match trouble {
        Some(Trouble::Restarted) => Led::Blink { hue: FAULT_HUE },
        Some(Trouble::Stopped) => Led::Blink { hue: STOPPED_HUE },
        Some(Trouble::Silent) => Led::Blink { hue: SILENT_HUE },
        None => Led::Heartbeat {
            hue: battery_hue(memory.get(registers::BATTERY_PERCENT).cast_signed()),
        },
    }
}

/// Green down to 20 percent, then towards red. The slope is a guess: 85 is green, 0 red. Percent
/// that have wrapped below zero wrap the hue as well.
fn battery_hue(percent: i8) -> u8 {
    if percent >= 20 {
        return SILENT_HUE;
    }
    let hue = i16::from(percent) * i16::from(SILENT_HUE) / 20;
    hue.to_le_bytes()[0]
}

#[cfg(test)]
mod tests {
    use super::super::memory::MAP_2015;
    use super::*;

    fn memory(registers: &[(u8, u8)]) -> Memory {
        let mut memory = Memory::new(MAP_2015);
        for &(address, value) in registers {
            memory.set(address, value);
        }
        memory
    }

    #[test]
    fn the_master_rules_the_light_while_the_mode_says_so() {
        let ruled = memory(&[(49, 1), (50, 10), (51, 20), (52, 30)]);
        let light = Led::Master {
            hue: 10,
            saturation: 20,
            value: 30,
        };
        assert_eq!(led(&ruled, Some(Trouble::Silent)), light);
        let free = memory(&[(50, 10)]);
        assert_eq!(
            led(&free, Some(Trouble::Silent)),
            Led::Blink { hue: SILENT_HUE }
        );
    }

    #[test]
    fn an_emptying_battery_turns_the_light_red() {
        let hue = |percent: i8| led(&memory(&[(35, percent.cast_unsigned())]), None);
        assert_eq!(hue(80), Led::Heartbeat { hue: 85 });
        assert_eq!(hue(10), Led::Heartbeat { hue: 42 });
        assert_eq!(hue(0), Led::Heartbeat { hue: 0 });
    }
}
