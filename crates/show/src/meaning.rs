//! One sentence for each check: the property that the check requires. It does not say whether the
//! check passed.

/// Required properties, by the name of the check or its prefix.
const MEANINGS: [(&str, &str); 25] = [
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
    (
        "program-goes-on",
        "The program goes on sending and reading until it ends.",
    ),
    (
        "port-settings",
        "Line settings of the program that changed bytes on their way.",
    ),
    (
        "watchdog",
        "Nothing: it says which devices stopped by themselves for want of commands.",
    ),
    ("no-children-left", "The program leaves no process behind."),
    (
        "set-points-as-accepted",
        "The axes do what the last sound frame said.",
    ),
    (
        "waypoints-visited",
        "The robot truly comes near each waypoint, in order.",
    ),
    (
        "returned",
        "In the end the robot is near its last waypoint.",
    ),
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
    ("ran-to-its-end", "The run was not ended early."),
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

/// Property that the check `name` requires, if the check is known. The sentence is also correct for
/// a run that failed.
pub fn meaning(name: &str) -> Option<String> {
    let is_it = |(begin, _): &&(&str, &str)| name.starts_with(begin);
    let (_, required) = MEANINGS.iter().find(is_it)?;
    Some(format!("Required: {required}"))
}
