//! Rigs in an empty world, for tests between two ends.

use emulators::world::{BodyConfig, Pose, Scene, Shape, World};
use protocols::{LineConfig, Port};

use super::Rig;
use super::line::End;

/// A rig without devices.
///
/// # Panics
/// Never: an empty world can be made.
pub fn rig() -> Rig {
    let scene = Scene::new(Vec::<Shape>::new(), Vec::new()).expect("empty");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), 1);
    Rig::new(world.expect("free"))
}

/// A link at this bit rate for each name, with its ends outside: the device's and the master's.
pub fn linked<const N: usize>(names: [&str; N], baud: u32) -> (Rig, [[End; 2]; N]) {
    let mut rig = rig();
    let ends = names.map(|name| {
        let ends = [0, 1].map(|_| End {
            node: rig.add_outside(name, LineConfig::new_8n1(baud)),
            port: Port(0),
        });
        rig.connect(name, ends[0], ends[1], 1);
        ends
    });
    (rig, ends)
}
