//! Values of devices described by data, against results worked out by hand.

use super::*;
use crate::world::{
    Ackermann, AckermannConfig, BodyConfig, Command, Drive, Fixture, Point, Pose, Scene, Shape,
};

/// A robot at (1, 0.5) that looks along x at a wall 2 m ahead.
pub(crate) fn world() -> World {
    let wall = Fixture {
        shape: Shape::Wall {
            from: Point::new(3.0, -1.0),
            to: Point::new(3.0, 2.0),
        },
        reflectivity: 1.0,
        height_m: f64::INFINITY,
        is_glass: false,
    };
    let scene = Scene::new([wall], vec![]).expect("a wall");
    let pose = Pose::new(1.0, 0.5, 0.0);
    World::new(scene, BodyConfig::default(), pose, 1).expect("free")
}

pub(crate) fn variable(name: &str, source: ValueSource) -> Variable {
    Variable {
        name: name.to_owned(),
        initial: 0,
        limits: [-100, 100],
        safe: None,
        source,
        drives: None,
    }
}

pub(crate) fn sink(actuator: &str, scale: f64, kind: SinkKind) -> Sink {
    Sink {
        actuator: actuator.to_owned(),
        scale,
        kind,
    }
}

/// A car on an empty floor.
pub(crate) fn car() -> World {
    let scene = Scene::new::<Shape>([], vec![]).expect("nothing");
    let chassis = Ackermann::new(AckermannConfig::default().ideal(), 1).expect("sound");
    World::with_chassis(scene, Box::new(chassis), Pose::default()).expect("free")
}

#[test]
fn each_source_shows_what_can_be_worked_out_by_hand() {
    let ms = Duration::from_millis;
    let range = |angle, max_mm| ValueSource::RangeMm { angle, max_mm };
    let ramp = ValueSource::Ramp {
        from: 10,
        to: -10,
        period: ms(100),
    };
    let sources = [
        ValueSource::Counter { period: ms(20) },
        ramp,
        ValueSource::XMm,
        ValueSource::YMm,
        ValueSource::HeadingMrad,
        ValueSource::Encoder(Wheel::Left),
        range(0.0, 2500),
        range(core::f64::consts::PI, 2500),
        range(0.0, 1500),
    ];
    let names = ["a", "b", "c", "d", "e", "f", "g", "h", "i"];
    let known = names.iter().zip(sources).map(|(name, s)| variable(name, s));
    let variables = Variables::new(known.collect()).expect("sound");
    let read = |index| variables.read(index, Instant::from_millis(125), &world());
    // 125 ms are 6 counts of 20 ms, and a quarter of the second ramp.
    assert_eq!([0, 1, 2, 3, 4, 5].map(read), [6, 5, 1000, 500, 0, 0]);
    // The wall at 2 m is beyond the range of the last.
    assert_eq!([6, 7, 8].map(read), [2000, 2500, 1500]);
}

#[test]
fn variables_that_cannot_be_are_refused() {
    let fault = |change: fn(&mut Variable)| {
        let mut second = variable("b", ValueSource::Stored);
        change(&mut second);
        let error = Variables::new(vec![variable("a", ValueSource::Stored), second]);
        let error = error.expect_err("unsound");
        assert_eq!(error.index, 1);
        error.message
    };
    assert!(fault(|v| v.name = "a".into()).contains("is used twice"));
    assert!(fault(|v| v.name = "a b".into()).contains("expected letters"));
    assert!(fault(|v| v.initial = 101).contains("initial is 101"));
    assert!(fault(|v| v.safe = Some(-101)).contains("safe is -101"));
    assert!(fault(|v| v.limits = [1, 0]).contains("the lower one first"));
    let period = Duration::ZERO;
    assert!(Variables::new(vec![variable("a", ValueSource::Counter { period })]).is_err());
}

/// Wheels that turn at 350 mm/s in opposite directions, 260 mm apart, turn the robot at 2692
/// mrad/s. A push of 0.6 m in 2 s gives its speed over the floor. In the second part the wall ahead
/// is 2 m away, so a robot at 350 mm/s meets it within 7 s.
#[test]
fn motion_and_contact_are_shown() {
    let sources = [
        ValueSource::SpeedMmS,
        ValueSource::TurnRateMradS,
        ValueSource::Touching,
        ValueSource::Contacts,
        ValueSource::EncoderNamed("right".to_owned()),
        ValueSource::EncoderNamed("third".to_owned()),
    ];
    let known = ["a", "b", "c", "d", "e", "f"].iter().zip(sources);
    let known = known.map(|(name, source)| variable(name, source)).collect();
    let variables = Variables::new(known).expect("sound");
    let read = |world: &World| [0, 1, 2, 3].map(|index| variables.read(index, world.now(), world));
    let mut world = ideal_world();
    assert_eq!(read(&world), [0, 0, 0, 0]);
    world.set_drive(Wheel::Left, Drive::Power(-255));
    world.set_drive(Wheel::Right, Drive::Power(255));
    world.push(0.6, 0.0, 0.0, Duration::from_secs(2));
    world.advance(Instant::from_secs(1));
    assert_eq!(read(&world), [300, 2692, 0, 0]);
    let ticks = world.encoder_ticks(Wheel::Right);
    assert_eq!(variables.read(4, world.now(), &world), ticks);
    assert_eq!(variables.read(5, world.now(), &world), 0, "no such encoder");
    let mut world = ideal_world();
    world.set_drive(Wheel::Left, Drive::Power(255));
    world.set_drive(Wheel::Right, Drive::Power(255));
    world.advance(Instant::from_secs(7));
    assert_eq!(read(&world), [0, 0, 1, 1]);
    world.set_drive(Wheel::Left, Drive::Power(-255));
    world.set_drive(Wheel::Right, Drive::Power(-255));
    world.advance(Instant::from_secs(8));
    assert_eq!(read(&world), [350, 0, 0, 1]);
}

/// [`world`] on a perfect floor.
fn ideal_world() -> World {
    let body = BodyConfig::default().ideal();
    let start = Pose::new(1.0, 0.5, 0.0);
    World::new(world().scene().clone(), body, start, 1).expect("free")
}

#[test]
fn what_a_device_wants_is_listed_and_checked_against_the_chassis() {
    let mut speed = variable("speed", ValueSource::Stored);
    speed.drives = Some(sink("drive", 2.0, SinkKind::Power));
    let mut angle = variable("angle", ValueSource::Stored);
    angle.drives = Some(sink("steering", 0.01, SinkKind::Power));
    let count = variable("count", ValueSource::Encoder(Wheel::Left));
    let missing = |variable: Variable| {
        let variables = Variables::new(vec![variable]).expect("sound");
        assert_eq!(variables.wanted().count(), 1);
        variables
            .check_chassis(car().chassis())
            .err()
            .map(|error| error.message)
    };
    assert_eq!(missing(speed), None);
    assert_eq!(
        missing(angle).as_deref(),
        Some("steering is a steering and cannot follow a power, expected angle_deg")
    );
    assert_eq!(
        missing(count).as_deref(),
        Some("there is no encoder \"left\", expected one of: drive")
    );
}

/// A servo that begins at 10 counts of 10 mrad goes there at the first poll.
#[test]
fn an_initial_value_other_than_0_is_passed_on() {
    let mut angle = variable("angle", ValueSource::Stored);
    angle.initial = 10;
    angle.drives = Some(sink("steering", 0.01, SinkKind::Angle));
    let mut variables = Variables::new(vec![angle]).expect("sound");
    assert_eq!(variables.changed_at(), Some(Instant::ZERO));
    let mut world = car();
    variables.drive(Instant::ZERO, &mut world, &mut EventLog::default());
    assert_eq!(world.chassis().command(1), Command::Angle(0.1));
    assert_eq!(variables.changed_at(), None);
}

/// 100 counts of 2.6 are 260, and 255 is the maximum; the same in the negative direction.
#[test]
fn a_power_beyond_its_range_is_the_greatest() {
    let sink = sink("left", 2.6, SinkKind::Power);
    let powers = [100, -100, 1].map(|value| sink.command(value));
    assert_eq!(
        powers,
        [Command::Power(255), Command::Power(-255), Command::Power(3)]
    );
}

#[test]
fn sinks_that_cannot_be_are_refused() {
    let fault = |source, actuator, scale| {
        let mut variable = variable("a", source);
        variable.drives = Some(sink(actuator, scale, SinkKind::Speed));
        Variables::new(vec![variable]).expect_err("unsound").message
    };
    assert!(fault(ValueSource::XMm, "left", 1.0).contains("and has a source"));
    assert!(fault(ValueSource::Stored, "", 1.0).contains("without a name"));
    assert!(fault(ValueSource::Stored, "left", f64::NAN).contains("scale is NaN"));
    assert!(fault(ValueSource::Stored, "left", 0.0).contains("other than 0"));
}

/// A wall 2 m ahead of a robot at (1, 0.5): 45 degrees to the left it would be 2.828 m away, but
/// the wall ends at y = 2. At half of that angle, 0.3927 rad, it is 2.165 m away.
#[test]
fn ranges_and_headings_are_those_of_the_world() {
    let half = core::f64::consts::FRAC_PI_8;
    let range = |angle| ValueSource::RangeMm {
        angle,
        max_mm: 5_000,
    };
    let sources = [range(half), range(2.0 * half), ValueSource::HeadingMrad];
    let known = ["a", "b", "c"].iter().zip(sources);
    let known = known.map(|(name, source)| variable(name, source)).collect();
    let variables = Variables::new(known).expect("sound");
    let scene = world().scene().clone();
    let read = |theta| {
        let pose = Pose::new(1.0, 0.5, theta);
        let world = World::new(scene.clone(), BodyConfig::default(), pose, 1).expect("free");
        [0, 1, 2].map(|index| variables.read(index, Instant::ZERO, &world))
    };
    assert_eq!(read(0.0), [2_165, 5_000, 0]);
    assert_eq!(read(-half), [2_000, 2_165, -393]);
}

/// Ramps from -4 to 96 in 40 ms, counted from the last restart; a counter begins at its
/// initial value.
#[test]
fn ramps_and_counters_begin_anew_at_a_restart() {
    let ms = Duration::from_millis;
    let ramp = ValueSource::Ramp {
        from: -4,
        to: 96,
        period: ms(40),
    };
    let mut counter = variable("counter", ValueSource::Counter { period: ms(7) });
    counter.initial = 50;
    let known = vec![variable("ramp", ramp), counter];
    let mut variables = Variables::new(known).expect("sound");
    let world = world();
    let read = |variables: &Variables, millis| {
        [0, 1].map(|index| variables.read(index, Instant::from_millis(millis), &world))
    };
    assert_eq!(read(&variables, 0), [-4, 50]);
    assert_eq!(read(&variables, 39), [93, 55]);
    assert_eq!(read(&variables, 50), [21, 57]);
    variables.restart(Instant::from_millis(45));
    assert_eq!(read(&variables, 50), [8, 50]);
    assert_eq!(read(&variables, 52), [13, 51]);
}
