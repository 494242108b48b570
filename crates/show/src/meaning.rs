//! One sentence for each check: the property that the check requires. It does not say whether the
//! check passed.

/// Required properties, by the name of the check or its prefix.
const MEANINGS: [(&str, &str); 26] = [
    (
        "set-points-in-range",
        "No set-point exceeds the limits of its axis.",
    ),
    (
        "motors-stop-after-silence",
        "The base stops its motors when it receives nothing any more.",
    ),
    (
        "no-collision-at-speed",
        "The robot touches no obstacle faster than allowed.",
    ),
    (
        "bytes-conserved",
        "Each sent byte arrived, or was lost by a fault or in a full buffer.",
    ),
    (
        "memory-intact",
        "The program writes only inside its own buffers.",
    ),
    ("program-alive", "The program runs to the end."),
    ("program-connected", "The program opens its required ports."),
    (
        "program-reads",
        "The program reads the bytes that wait at its ports.",
    ),
    (
        "program-goes-on",
        "The program continues to send and read until it ends.",
    ),
    (
        "port-settings",
        "nothing. The check lists line settings of the program that changed bytes.",
    ),
    (
        "watchdog",
        "nothing. The check lists devices that stopped by themselves, because they received no commands.",
    ),
    (
        "no-children-left",
        "The program leaves no running child process.",
    ),
    (
        "set-points-as-accepted",
        "The axes obey the last valid frame.",
    ),
    (
        "waypoints-visited",
        "The robot's true position reaches each waypoint, in order.",
    ),
    (
        "returned",
        "At the end the robot rests near its last waypoint.",
    ),
    ("pose-rms", "The believed position is near the true one."),
    ("heading-rms", "The believed heading is near the true one."),
    (
        "wall-overlap",
        "The walls of the map match the walls of the world.",
    ),
    ("map-received", "The PC received the complete map."),
    ("violations", "The program obeys the rules of its devices."),
    (
        "rig-on-time",
        "The rig was not too late against the wall clock.",
    ),
    ("ran-to-its-end", "The run was not ended early."),
    (
        "mission-step",
        "A condition of the mission became true in time.",
    ),
    ("at-work-again", "After a fault the program works again."),
    (
        "requests-answered",
        "Each master gets a reply to at least one of its requests.",
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
