//! Motion of a body on a floor with little grip.

use super::body::{STEP_S, Velocity};

/// Standard acceleration of free fall, m/s².
const G_M_S2: f64 = 9.806_65;

/// Velocity of the body in a step, after the velocity `before`: the wheels want `wanted`, the floor
/// has `grip`, and the body reaches `reach_m` about its reference point.
///
/// The grip limits the change of speed. If the body rolls only a part of the wheels' distance, it
/// turns by the same part. The grip also limits the change of the turn rate, as for a body with all
/// of its mass at its rim. Nothing slides sideways.
pub(super) fn glide(before: Velocity, wanted: Velocity, grip: f64, reach_m: f64) -> Velocity {
    let most = grip * G_M_S2 * STEP_S;
    let gained = wanted.speed_m_s - before.speed_m_s;
    let speed_m_s = before.speed_m_s + gained.clamp(-most, most);
    let rolled = match wanted.speed_m_s {
        0.0 => 1.0,
        wanted => (speed_m_s / wanted).clamp(0.0, 1.0),
    };
    let most = most / reach_m;
    let gained = wanted.turn_rad_s * rolled - before.turn_rad_s;
    Velocity {
        speed_m_s,
        turn_rad_s: before.turn_rad_s + gained.clamp(-most, most),
    }
}

#[cfg(test)]
mod tests {
    use core::time::Duration;

    use protocols::Instant;

    use super::super::{
        Ackermann, AckermannConfig, Bounds, Command, Fixture, Point, Pose, Scene, SlickFloor, World,
    };

    /// A car at the origin; the floor has a grip of 0.02, 0.196 m/s², as far as `x_m`.
    fn car(x_m: f64) -> World {
        let config = AckermannConfig {
            lag_s: 0.0,
            steering_lag_s: 0.0,
            ..AckermannConfig::default().ideal()
        };
        let bounds = Bounds {
            min: Point::new(-9.0, -9.0),
            max: Point::new(x_m, 9.0),
        };
        let slick = SlickFloor::new(bounds, 0.02).unwrap();
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let body = Box::new(Ackermann::new(config, 1).unwrap());
        World::with_chassis(scene.with_slick_floors(vec![slick]), body, Pose::default()).unwrap()
    }

    /// The wheels turn at 0.5 m/s at once. After a second the car drives at 0.19613 m/s and has
    /// gone 98 mm, while its encoder has counted half a metre. It has the wheels' speed 2.5493 s
    /// after the start, so after 3 s as well.
    #[test]
    fn wheels_spin_where_the_floor_does_not_hold() {
        let mut world = car(9.0);
        world.actuate("drive", Command::Speed(0.5)).unwrap();
        world.advance(Instant::from_secs(1));
        assert!((world.speed() - 0.196_13).abs() < 3e-4, "{}", world.speed());
        let pose = world.pose();
        assert!((pose.x - 0.0981).abs() < 2e-4 && pose.y == 0.0, "{pose:?}");
        // 0.5 m divided by 3.351 mm a count.
        assert_eq!(world.encoder("drive"), Some(149));
        let felt = world.acceleration(Duration::from_millis(10));
        assert!((felt.x - 0.196_133).abs() < 1e-5, "{felt:?}");
        world.advance(Instant::from_secs(3));
        assert_eq!(world.speed(), 0.5);
    }

    /// When the wheels of a car at 0.5 m/s stop, it slides for 2.5493 s and 0.637 m.
    #[test]
    fn wheels_that_brake_slide() {
        let mut world = car(99.0);
        world.actuate("drive", Command::Speed(0.5)).unwrap();
        world.advance(Instant::from_secs(4));
        let from = world.pose().x;
        world.actuate("drive", Command::Speed(0.0)).unwrap();
        world.advance(Instant::from_secs(7));
        let slid = world.pose().x - from;
        assert!((slid - 0.637).abs() < 1e-3, "{slid}");
        assert!(!world.is_moving());
    }

    /// As soon as the floor has grip again, the car follows its wheels.
    #[test]
    fn wheels_hold_beyond_the_slick_place() {
        let mut world = car(0.05);
        world.actuate("drive", Command::Speed(0.5)).unwrap();
        world.advance(Instant::from_millis(500));
        assert!(world.speed() < 0.1);
        // With 0.196 m/s² the first 5 cm take 0.714 s.
        world.advance(Instant::from_millis(800));
        assert_eq!(world.speed(), 0.5);
    }

    /// Wheels steered by 0.3 rad turn a car by the distance that the car rolls, not by the wheels'
    /// own: after a second's 98.16 mm on a circle of 0.834 m by 0.1177 rad. Wheels that hold would
    /// turn it by 0.6.
    #[test]
    fn a_car_that_hardly_rolls_hardly_turns() {
        let mut world = car(9.0);
        world.actuate("steering", Command::Angle(0.3)).unwrap();
        world.actuate("drive", Command::Speed(0.5)).unwrap();
        world.advance(Instant::from_secs(1));
        let turned = world.pose().theta;
        assert!((turned - 0.1177).abs() < 1e-3, "{turned}");
    }
}
