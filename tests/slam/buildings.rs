//! The whole mapper in a building that was never built.

use emulators::world::Pose;
use hilrig::slam::mapping::building::Building;
use hilrig::slam::mapping::motion::distance;
use hilrig::slam::mapping::{Kind, Mapper, Settings, Shot};

/// The mapper after all scans of a building, and where each was taken in truth.
fn mapped(seed: u64, closes_loops: bool) -> (Mapper, Vec<Pose>) {
    let building = Building::generate(seed);
    let mut mapper = Mapper::new(Settings {
        closes_loops,
        start: building.sights[0].truth,
        noise: 1.0,
    });
    for sight in &building.sights {
        mapper.take(&Shot {
            moved: sight.moved,
            is_measured: true,
            ends: &sight.ends,
        });
    }
    mapper.finish();
    let truth = building.sights.iter().map(|sight| sight.truth);
    (mapper, truth.collect())
}

/// At stake: a robot that comes back after 100 m knows where it is. The same twice to the bit; and
/// without loops it is farther off than with them.
#[test]
fn a_way_around_a_building_ends_where_it_began() {
    let (mapper, truth) = mapped(SEED, true);
    let off = |mapper: &Mapper| {
        let way = mapper.way();
        let all = way.iter().zip(&truth).map(|(a, b)| distance(*a, *b));
        all.fold(0.0, f64::max)
    };
    let far = off(&mapper);
    assert!(far < 0.25, "{far} m off");
    let loops = mapper
        .graph()
        .edges
        .iter()
        .filter(|edge| edge.kind == Kind::Loop);
    assert!(loops.count() > 10);
    let (again, _) = mapped(SEED, true);
    assert_eq!(mapper.way(), again.way());
    let (without, _) = mapped(SEED, false);
    assert!(off(&without) > 2.0 * far, "{} {far}", off(&without));
}

/// A building whose way leads around a block more than once.
const SEED: u64 = 16;
