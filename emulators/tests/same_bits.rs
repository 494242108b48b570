//! The round body with two wheels moves exactly, to the bit, as before there were other bodies.

#![expect(clippy::cast_possible_truncation, reason = "whole powers are wanted")]

use core::time::Duration;

use emulators::rng::Rng;
use emulators::world::{
    BodyConfig, Drive, Obstacle, Path, Point, Pose, Repeat, Scene, Shape, Waypoint, Wheel, World,
};
use protocols::Instant;

/// A small room with a leg, a wall to lean on and a person who walks back and forth.
fn room(seed: u64) -> World {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    let corners = corners.map(|(x, y)| Point::new(x, y)).to_vec();
    let leg = Shape::Circle {
        center: Point::new(0.4, 0.4),
        radius_m: 0.02,
    };
    let wall = Shape::Wall {
        from: Point::new(0.0, -1.0),
        to: Point::new(0.0, -0.6),
    };
    let person = Shape::Circle {
        center: Point::default(),
        radius_m: 0.2,
    };
    let waypoint = |secs, x, y| Waypoint {
        at: Instant::from_secs(secs),
        position: Point::new(x, y),
    };
    let person = Obstacle {
        fixture: person.into(),
        path: Path {
            waypoints: vec![waypoint(0, -0.7, 0.7), waypoint(3, 0.7, -0.7)],
            repeat: Repeat::PingPong,
        },
    };
    let scene = Scene::new([Shape::Polygon { corners }, leg, wall], vec![person]).unwrap();
    let start = Pose::new(-0.5, -0.5, 0.0);
    World::new(scene, BodyConfig::default(), start, seed).unwrap()
}

/// FNV-1a over the bits of all values of the world's interface.
fn fingerprint(seed: u64) -> u64 {
    let mut world = room(seed);
    let mut acts = Rng::stream(seed, "acts");
    let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
    let mut eat = |word: u64| {
        for byte in word.to_le_bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    };
    for index in 1..=400_u64 {
        let power = |acts: &mut Rng| acts.range(-255.0, 255.0) as i16;
        match acts.below(8) {
            0..=3 => {
                let (left, right) = (power(&mut acts), power(&mut acts));
                world.set_drive(Wheel::Left, Drive::Power(left));
                world.set_drive(Wheel::Right, Drive::Power(right));
            }
            4 => world.set_drive(Wheel::Left, Drive::Brake),
            5 => world.set_drive(Wheel::Right, Drive::Coast),
            6 => {
                let by = [0, 1, 2].map(|_| acts.range(-0.3, 0.3));
                world.push(by[0], by[1], by[2], Duration::from_millis(acts.below(300)));
            }
            _ => {
                let to = [0, 1].map(|_| acts.range(-0.5, 0.5));
                world.teleport(Pose::new(to[0], to[1], acts.range(-3.0, 3.0)));
            }
        }
        world.advance(Instant::from_nanos(index * 53_777_131));
        let pose = world.pose();
        for figure in [pose.x, pose.y, pose.theta, world.speed(), world.turn_rate()] {
            eat(figure.to_bits());
        }
        for wheel in [Wheel::Left, Wheel::Right] {
            eat(world.encoder_ticks(wheel).cast_unsigned());
            eat(world.wheel_speed(wheel).to_bits());
        }
        eat(world.clearance().to_bits());
        eat(world.contact_count());
        for contact in world.take_contacts() {
            eat(contact.at.as_nanos());
            eat(contact.speed_m_s.to_bits());
            eat(contact.place.x.to_bits());
            eat(contact.place.y.to_bits());
        }
    }
    hash
}

/// Drives, pushes, walls and people, 21 s each. The figures are those of the release before the
/// drive train became a trait; another figure means that every recorded case runs differently.
#[test]
fn a_differential_disc_moves_as_ever() {
    let found = [1, 2, 3].map(fingerprint);
    let expected = [
        0x57c3_0a08_a297_e8f2,
        0x2a3a_a0a9_f93e_1acd,
        0x2238_e6ed_958a_f4bd,
    ];
    assert_eq!(found, expected);
}
