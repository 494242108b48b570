use super::Config;
use crate::robots::board_settings::{Report, check_basis, set_start, tell_basis, tell_start};

impl Config {
    /// Reports the settings that [`set`](Self::set) derives from the default, except enabled
    /// defects.
    pub fn tell(&self, report: &mut Report<'_>) {
        tell_basis(&Self::DEFAULT, report);
        tell_start(self.start, report);
    }

    /// Changes one setting; the error contains the expected value.
    ///
    /// # Errors
    /// If the key is unknown or has another kind of value.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), &'static str> {
        if let Some(is_set) = set_start(&mut self.start, key, value) {
            return is_set;
        }
        if let Some(is_same) = check_basis(&Self::DEFAULT, key, value) {
            return is_same;
        }
        match key {
            "defect" => {
                *self = self
                    .with_defect(value)
                    .ok_or("expected the number of a defect")?;
                Ok(())
            }
            _ => Err("no such setting of the robot yellow"),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString as _;

    use super::*;
    use crate::pose::Pose;

    #[test]
    fn a_board_of_yellow_hears_what_the_rig_tells() {
        let config = Config {
            start: Pose::new(0.1 + 0.2, -7.0e-5, -3.0),
            ..Config::DEFAULT
        };
        let mut heard = Config::DEFAULT;
        config.tell(&mut |key, value| {
            heard
                .set(key, &value.to_string())
                .expect("own words are understood");
        });
        assert_eq!(heard, config);
        assert!(heard.set("seed", "1").is_err() && heard.set("defect", "YF").is_err());
        heard.set("defect", "YM-01").expect("known");
        assert!(heard.defects.wheels.replaces_jumps);
    }
}
