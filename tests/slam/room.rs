//! A generated CARMEN log of a small room: a robot drives a square, and its wheels slip.

use core::fmt::Write as _;
use emulators::world::Pose;
use hilrig::slam::motion::moved;

/// Walls as x0, y0, x1, y1: a room of 8 m x 6 m with a niche and a pillar.
const WALLS: [[f64; 4]; 9] = [
    [0.0, 0.0, 8.0, 0.0],
    [8.0, 0.0, 8.0, 6.0],
    [8.0, 6.0, 3.0, 6.0],
    [3.0, 6.0, 3.0, 5.0],
    [3.0, 5.0, 0.0, 5.0],
    [0.0, 5.0, 0.0, 0.0],
    [4.0, 3.0, 4.6, 3.0],
    [4.6, 3.0, 4.6, 3.4],
    [4.0, 3.0, 4.6, 3.4],
];

fn cast(from: Pose, angle: f64) -> f64 {
    let (dx, dy) = (libm::cos(angle), libm::sin(angle));
    let mut nearest = f64::INFINITY;
    for [x0, y0, x1, y1] in WALLS {
        let (ex, ey) = (x1 - x0, y1 - y0);
        let across = dx * ey - dy * ex;
        let (ox, oy) = (x0 - from.x, y0 - from.y);
        let along_ray = (ox * ey - oy * ex) / across;
        let along_wall = (ox * dy - oy * dx) / across;
        if across != 0.0 && along_ray > 0.0 && (0.0..=1.0).contains(&along_wall) {
            nearest = nearest.min(along_ray);
        }
    }
    nearest
}

/// The log, and the robot's true end pose relative to its start.
pub(crate) fn log() -> (String, Pose) {
    let mut text = String::from("# a room\nPARAM robot_front_laser_max 20.0 nohost 0\n");
    let mut truth = Pose::new(1.0, 1.0, 0.0);
    let mut wheels = Pose::default();
    let mut time = 0.0;
    for step in 0..160_u32 {
        // 18 straight steps of 100 mm, then a quarter turn in two steps; the odometry is too long.
        let is_turn = step % 20 >= 18;
        let motion = if is_turn {
            Pose::new(0.0, 0.0, core::f64::consts::FRAC_PI_4)
        } else {
            Pose::new(0.15, 0.0, 0.0)
        };
        if step > 0 {
            truth = moved(truth, motion);
            let said = Pose::new(motion.x * 1.05, 0.0, motion.theta * 1.04 + 0.002);
            wheels = moved(wheels, said);
        }
        time += 0.5;
        let ranges = (0..180).map(|degree| {
            let angle = truth.theta + f64::from(degree - 90).to_radians();
            cast(truth, angle)
        });
        let Pose { x, y, theta } = wheels;
        write!(text, "FLASER 180").expect("memory");
        for range in ranges {
            write!(text, " {range:.3}").expect("memory");
        }
        writeln!(
            text,
            " {x:.6} {y:.6} {theta:.6} {x:.6} {y:.6} {theta:.6} {time} host {time}"
        )
        .expect("memory");
        writeln!(
            text,
            "ODOM {x:.6} {y:.6} {theta:.6} 0 0 0 {time} host {time}"
        )
        .expect("memory");
    }
    let start = Pose::new(1.0, 1.0, 0.0);
    (text, slam::motion::between(start, truth))
}
