//! Accelerations of a body.

use core::time::Duration;

use super::body::{Motion, STEP_NANOS, STEP_S};
use super::{Point, TRAIL_STEPS, World};

impl World {
    /// Acceleration of the reference point over the floor, m/s², in body axes (x forward, y left):
    /// the mean over the last `over`, which is limited to 1 ms to 250 ms. In a curve it points to
    /// the middle. Physics changes speeds at once where a wheel slips or a wall is met, so a sensor
    /// must pass the time of its filter.
    pub fn acceleration(&self, over: Duration) -> Point {
        let steps = u64::try_from(over.as_nanos()).unwrap_or(u64::MAX) / STEP_NANOS;
        let steps = steps.clamp(1, TRAIL_STEPS as u64 - 6);
        let newest = self.next_step.saturating_sub(1);
        let now = self.motion(newest);
        let before = newest
            .checked_sub(steps)
            .map(|step| velocity(self.motion(step)));
        // Before the run began the body was at rest.
        let before = before.unwrap_or_default();
        #[expect(clippy::cast_precision_loss, reason = "at most 250")]
        let time = steps as f64 * STEP_S;
        let velocity = velocity(now);
        let (x, y) = (
            (velocity.x - before.x) / time,
            (velocity.y - before.y) / time,
        );
        let (sin, cos) = libm::sincos(now.start.theta);
        Point::new(x * cos + y * sin, y * cos - x * sin)
    }
}

/// Velocity in the world's axes, m/s.
fn velocity(motion: &Motion) -> Point {
    let (sin, cos) = libm::sincos(motion.start.theta);
    Point::new(
        motion.speed * cos + motion.drift.x,
        motion.speed * sin + motion.drift.y,
    )
}

#[cfg(test)]
mod tests {
    use protocols::Instant;

    use super::super::{Ackermann, AckermannConfig, Command, Fixture, Pose, Scene};
    use super::*;

    fn car() -> World {
        let config = AckermannConfig {
            lag_s: 0.3,
            steering_lag_s: 0.0,
            ..AckermannConfig::default().ideal()
        };
        let scene = Scene::new(Vec::<Fixture>::new(), vec![]).unwrap();
        let body = Box::new(Ackermann::new(config, 1).unwrap());
        World::with_chassis(scene, body, Pose::new(0.0, 0.0, 1.0)).unwrap()
    }

    const OVER: Duration = Duration::from_millis(10);

    /// A car that starts to 0.6 m/s with a lag of 0.3 s accelerates by 2 m/s² at first, and by 1/e
    /// of that, 0.73576 m/s², after 0.3 s.
    #[test]
    fn a_car_that_starts_is_pressed_into_its_seat() {
        let mut world = car();
        assert_eq!(world.acceleration(OVER), Point::default());
        world.actuate("drive", Command::Speed(0.6)).unwrap();
        world.advance(Instant::from_millis(11));
        let felt = world.acceleration(OVER);
        assert!(
            (felt.x - 2.0).abs() < 0.06 && felt.y.abs() < 1e-9,
            "{felt:?}"
        );
        world.advance(Instant::from_millis(305));
        let felt = world.acceleration(OVER);
        assert!((felt.x - 0.735_76).abs() < 0.02, "{felt:?}");
    }

    /// On a circle of 0.258 m / tan 0.3 = 0.834 m at 0.6 m/s the acceleration is 0.36 / 0.834 =
    /// 0.4316 m/s² to the left.
    #[test]
    fn a_curve_pulls_to_its_middle() {
        let mut world = car();
        world.actuate("drive", Command::Speed(0.6)).unwrap();
        world.actuate("steering", Command::Angle(0.3)).unwrap();
        world.advance(Instant::from_secs(5));
        let felt = world.acceleration(OVER);
        assert!(
            (felt.y - 0.4316).abs() < 0.002 && felt.x.abs() < 0.005,
            "{felt:?}"
        );
    }

    /// 2 m/s along the heading, and a push of (0.5, 0.25) m/s.
    #[test]
    fn a_push_adds_to_the_speed_along_the_heading() {
        let drawn = |theta: f64| {
            velocity(&Motion {
                start: Pose::new(7.0, 8.0, theta),
                speed: 2.0,
                turn: 9.0,
                drift: Point::new(0.5, 0.25),
            })
        };
        let is = |found: Point, x: f64, y: f64| found.distance(Point::new(x, y)) < 1e-12;
        let quarter = core::f64::consts::FRAC_PI_2;
        assert!(is(drawn(0.0), 2.5, 0.25) && is(drawn(quarter), 0.5, 2.25));
        assert!(is(drawn(-quarter), 0.5, -1.75));
    }

    /// 0.6 m/s with a lag of 0.3 s: from 55 to 305 ms the speed grows by 0.6 (0.83249 - 0.36180),
    /// a quarter of a second is the longest time that counts, and a millisecond the shortest.
    #[test]
    fn a_mean_is_of_a_millisecond_to_a_quarter_of_a_second() {
        let mut world = car();
        world.actuate("drive", Command::Speed(0.6)).unwrap();
        world.advance(Instant::from_millis(305));
        let over = |micros| world.acceleration(Duration::from_micros(micros)).x;
        assert!((over(250_000) - 1.129_66).abs() < 0.01, "{}", over(250_000));
        assert_eq!([over(251_000), over(9_000_000)], [over(250_000); 2]);
        assert!(over(249_000) != over(250_000));
        assert_eq!([over(0), over(500), over(1_999)], [over(1_000); 3]);
        assert!(over(2_000) != over(1_000));
    }
}
