use protocols::avr::ChecksumOrder;
use protocols::pcui::{self, message::Mode};

use super::{Config, Display, Turning};
use crate::navigation::Sought;
use crate::pc_link::Diagnose;
use crate::robots::board_settings::{
    Report, check_basis, number, set_start, tell_basis, tell_start,
};
use crate::{radio_setup, slam};

/// Name of the radio on the air.
const RADIO_NAME: &str = "rescue";
/// Its PIN.
const RADIO_PIN: [u8; 4] = *b"1234";

impl Config {
    /// Radio settings for a module that may still be at `found_baud`.
    pub const fn radio_setup(found_baud: u32) -> radio_setup::Settings {
        radio_setup::Settings {
            found_baud,
            baud: pcui::BAUD,
            name: RADIO_NAME,
            pin: RADIO_PIN,
        }
    }

    /// Reports the settings that [`set`](Self::set) derives from the default, except enabled
    /// defects. Other settings have no `KEY=VALUE` form: compare the result.
    pub fn tell(&self, report: &mut Report<'_>) {
        tell_basis(&Self::DEFAULT, report);
        if self.mapping.mode == slam::Mode::Document {
            report("mapper", &"document");
        }
        tell_start(self.mapping.start, report);
        report("seed", &self.mapping.seed);
        if self.checksum_order == ChecksumOrder::HighFirst {
            report("checksum", &"high-first");
        }
        if self.initial_mode != Mode::Stop {
            report("mode", &(self.initial_mode as u8));
        }
        if self.display == Display::None {
            report("display", &"none");
        }
        if self.sought == Sought::FloorAndHeat {
            report("heat", &"sought");
        }
        if self.turning == Turning::Gyroscope {
            report("turning", &"gyroscope");
        }
        if let Some(setup) = &self.radio_setup {
            report("radio_baud", &setup.found_baud);
        }
        if self.pc_link.diagnosis == Diagnose::EachSecond {
            report("diagnosis", &"each-second");
        }
    }

    /// Changes one setting; the error contains the expected value.
    ///
    /// # Errors
    /// If the key is unknown or has another kind of value.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), &'static str> {
        if let Some(is_set) = set_start(&mut self.mapping.start, key, value) {
            return is_set;
        }
        if let Some(is_same) = check_basis(&Self::DEFAULT, key, value) {
            return is_same;
        }
        match (key, value) {
            ("mapper", "document") => {
                self.mapping = slam::Settings {
                    start: self.mapping.start,
                    seed: self.mapping.seed,
                    ..slam::Settings::document()
                };
            }
            ("seed", seed) => self.mapping.seed = number(seed)?,
            ("checksum", "high-first") => self.checksum_order = ChecksumOrder::HighFirst,
            ("mode", mode) => {
                let mode = Mode::from_wire(number(mode)?);
                self.initial_mode = mode.ok_or("expected the number of a mode, 0 to 4")?;
            }
            ("display", "none") => self.display = Display::None,
            ("heat", "sought") => self.sought = Sought::FloorAndHeat,
            ("turning", "gyroscope") => self.turning = Turning::Gyroscope,
            ("radio_baud", baud) => self.radio_setup = Some(Self::radio_setup(number(baud)?)),
            ("diagnosis", "each-second") => self.pc_link.diagnosis = Diagnose::EachSecond,
            ("defect", id) => {
                *self = self
                    .with_defect(id)
                    .ok_or("expected the number of a defect")?;
            }
            _ => return Err("no such setting of the robot rescue"),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::{String, ToString as _};
    use std::vec::Vec;

    use super::*;
    use crate::pose::Pose;

    /// The default with the words of `config` applied.
    fn told(config: &Config) -> Config {
        let mut words: Vec<(&str, String)> = Vec::new();
        config.tell(&mut |key, value| words.push((key, value.to_string())));
        let mut heard = Config::DEFAULT;
        for (key, value) in words {
            heard.set(key, &value).expect("own words are understood");
        }
        heard
    }

    /// Each setting by itself and all of them at once; the pose has no short decimal form.
    #[test]
    fn a_board_hears_what_the_rig_tells() {
        let changes: [fn(&mut Config); 10] = [
            |_| {},
            |c| c.mapping = slam::Settings::document(),
            |c| c.mapping.start = Pose::new(375.000_03, -1.0 / 3.0, 1.570_796_4),
            |c| c.mapping.seed = u64::MAX,
            |c| c.checksum_order = ChecksumOrder::HighFirst,
            |c| c.initial_mode = Mode::Explore,
            |c| c.display = Display::None,
            |c| c.turning = Turning::Gyroscope,
            |c| c.radio_setup = Some(Config::radio_setup(9_600)),
            |c| {
                c.sought = Sought::FloorAndHeat;
                c.pc_link.diagnosis = Diagnose::EachSecond;
            },
        ];
        let mut all = Config::DEFAULT;
        for change in changes {
            let mut one = Config::DEFAULT;
            change(&mut one);
            assert_eq!(told(&one), one);
            change(&mut all);
        }
        assert_eq!(told(&all), all);
        // A setting without a word is not lost in silence: the result differs.
        let mut other = Config::DEFAULT;
        other.navigation.body.radius_mm += 1.0;
        assert_ne!(told(&other), other);
    }

    #[test]
    fn a_board_refuses_other_words() {
        let mut config = Config::DEFAULT;
        for (key, value) in [
            ("colour", "red"),
            ("seed", "-1"),
            ("mode", "5"),
            ("defect", "XX-1"),
            ("turning", "wheels"),
        ] {
            assert!(config.set(key, value).is_err(), "{key}={value}");
        }
        assert_eq!(config, Config::DEFAULT);
        config.set("defect", "SL-01").expect("known");
        assert!(config.mapping.defects.spread_reaches_zero);
    }
}
