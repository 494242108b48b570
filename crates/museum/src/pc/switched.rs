//! The PC link while it is switched off on the robot's display.

use core::time::Duration;
use std::path::Path;

use firmware_core::Inspect;
use firmware_core::robots::rescue::Rescue;
use protocols::Instant;

use crate::frames::{chain, list_frame};
use crate::{Observation, Variant};
use engine::codec::PCUI;
use engine::run::Run;
use engine::scenario::Scenario;

/// Taps on the settings button, then on the link's button. The link is off before the PC sends 30
/// waypoints, and on again before the PC repeats them.
const TAPS: &str = "{ at = \"2s\", place = [400, 256] }, { at = \"3s\", place = [410, 50] }, \
    { at = \"5s\", place = [410, 50] }";

/// Runs in the rig, because the switch is on the display.
pub(super) fn pu_15(variant: Variant) -> Observation {
    let defects = match variant {
        Variant::Defective => "\"PU-15\"",
        Variant::Sound => "",
    };
    let places = ["[1.5, 2.2]"; 30].join(", ");
    let text = format!(
        "schema = 1\nname = \"pu-15\"\nrobot = \"rescue\"\nduration = \"20s\"\n\
         [program]\ndefects = [{defects}]\n[device.display.touch-panel]\ntap = [{TAPS}]\n\
         [[mission.step]]\nat = \"4s\"\ndo = {{ waypoints-m = [{places}] }}\n\
         [world]\nstart = {{ x_m = 1.5, y_m = 1.2, heading_deg = 90 }}\n[[world.wall]]\n\
         path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n"
    );
    let (scenario, source) = Scenario::parse(Path::new("museum"), text).expect("sound");
    let mut run = Run::new(scenario, &source, None).expect("can be wired");
    run.go_on_until(Instant::ZERO + Duration::from_secs(9));
    let program: &Rescue = run.rig.program_as().expect("the rescue robot");
    let mut torn = 0;
    program.counters(&mut |name, value| {
        if name == "radio bad frames" {
            torn = value;
        }
    });
    let mut seen = Observation::default();
    let mut list = chain(30);
    for one in &mut list {
        one.position_mm = [1500, 2200];
    }
    seen.bytes("PC", &PCUI, &list_frame(&list));
    seen.figure("torn frames after it is switched on", torn);
    seen.judged(torn > 0)
}
