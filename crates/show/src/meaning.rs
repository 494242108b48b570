//! What each check means, in a sentence.

/// What checks mean, by their names or how these begin.
const MEANINGS: [(&str, &str); 22] = [
    (
        "set-points-in-range",
        "No axis is told more than it can do.",
    ),
    (
        "motors-stop-after-silence",
        "The base stops its motors when nothing reaches it any more.",
    ),
    (
        "no-collision-at-speed",
        "The robot touches nothing faster than it may.",
    ),
    (
        "bytes-conserved",
        "Each byte that was sent arrived, or a fault or a full buffer took it.",
    ),
    (
        "memory-intact",
        "The program writes into none but its own buffers.",
    ),
    ("program-alive", "The program lives to the end."),
    (
        "program-connected",
        "The program opens the ports that it needs.",
    ),
    ("program-reads", "The program reads what waits for it."),
    ("no-children-left", "The program leaves no process behind."),
    (
        "set-points-as-accepted",
        "The axes do what the last sound frame said.",
    ),
    (
        "waypoints-visited",
        "The robot truly comes near each waypoint, in order.",
    ),
    ("returned", "In the end the robot is where it started."),
    (
        "pose-rms",
        "Where the robot believes to be is near where it is.",
    ),
    (
        "heading-rms",
        "Where it believes to look is near where it looks.",
    ),
    (
        "wall-overlap",
        "The walls of its map are the walls of the world.",
    ),
    ("map-received", "The PC got the whole map."),
    ("violations", "The program keeps the rules of its devices."),
    ("rig-on-time", "The rig itself kept up with the wall clock."),
    ("ran-to-its-end", "Nobody ended the run before its time."),
    (
        "mission-step",
        "A condition of the mission came true in time.",
    ),
    (
        "at-work-again",
        "After a fault the program goes back to work.",
    ),
    (
        "same-outputs",
        "The program sends the same bytes as before.",
    ),
];

/// What the check called `name` means, if it is a known one.
pub fn meaning(name: &str) -> Option<&'static str> {
    let is_it = |(begin, _): &&(&str, &str)| name.starts_with(begin);
    Some(MEANINGS.iter().find(is_it)?.1)
}
