//! Actions on the base by hand.

use protocols::Instant;

use super::profile::Button;
use super::{AvrBase, BUTTON_COUNTS, BatteryConfig, ButtonState, DIVIDER};

impl AvrBase {
    /// Presses the stop button.
    pub fn press_stop(&mut self, now: Instant) {
        self.button = match (self.quirks.button, self.button) {
            (Button::Toggle, ButtonState::Toggled) => ButtonState::Released,
            (Button::Toggle, _) => ButtonState::Toggled,
            (Button::HoldAndDelay, _) => ButtonState::Pressed,
        };
        self.now = self.now.max(now);
        self.announce(now);
    }

    /// Releases the stop button.
    pub fn release_stop(&mut self, now: Instant) {
        if self.button == ButtonState::Pressed {
            let until = self.ticks.after(now, DIVIDER, BUTTON_COUNTS);
            self.button = ButtonState::Lingering(until);
        }
        self.now = self.now.max(now);
    }

    /// Replaces or charges the battery.
    pub const fn replace_battery(&mut self, now: Instant, battery: BatteryConfig) {
        self.battery.replace(now, battery);
    }
}
