//! The furnished flat of the demo.

use crate::measure::{Run, overlap, picture};
use crate::world::{FLAT_TOUR, World, flat};
use firmware_core::slam::Settings;

#[test]
fn tune() {
    for (name, settings) in [("document", Settings::document()), ("default", Settings::default())] {
        for seed in 1..=10 {
            let world = World::new(flat(), [1000.0, 1000.0, core::f64::consts::FRAC_PI_2], seed);
            let mut run = Run::new(world, Settings { seed, ..settings });
            let t = std::time::Instant::now();
            run.tour(&FLAT_TOUR);
            let e = run.errors;
            let (p, r) = overlap(run.mapper.grid(), &run.world.walls, &FLAT_TOUR);
            println!("{name} {seed}: rms {:.1} mm {:.2} deg, worst {:.0} mm {:.1} deg, precision {p:.2} recall {r:.2} scans {} tries {} {:?}",
                e.rms_mm(), e.rms_deg(), e.worst_mm, e.worst_deg, run.mapper.scans(), run.mapper.tries(), t.elapsed());
            if seed == 1 {
                println!("{}", picture(run.mapper.grid(), 5, run.mapper.pose()));
            }
        }
    }
}
