//! YE13, lost requests, and the fielded methods of sending.

use firmware_core::Master;
use firmware_core::pose::Pose;
use firmware_core::robots::yellow::pc::{
    Failure, PcCommand, PcConfig, PcProgram, Refused, Sending, Task, TaskState,
};
use protocols::Instant;
use protocols::telemetry::message::State;

use crate::bench::Bench;
use crate::mapping::labyrinth;
use crate::robot::{At, Errors};
use crate::world::World;

fn bench(config: PcConfig) -> Bench {
    let world = World::labyrinth("###\n# #\n###", 40, [-2.1, -2.1]);
    Bench::new(world, At::default(), Errors::default(), config)
}

const AHEAD: PcCommand = PcCommand::Manual {
    linear_m_s: 0.1,
    angular_rad_s: 0.0,
};
const HOME: PcCommand = PcCommand::SetPose {
    x_m: 0.0,
    y_m: 0.0,
    heading_rad: 0.0,
};

/// A frame each 200 ms is no silence. Without frames, the PC detects silence within 1 s, and also
/// the next frame.
#[test]
fn ye13_a_silent_link_is_noticed_within_a_second() {
    let mut bench = bench(PcConfig::default());
    bench.run_for(5);
    assert!(!bench.pc.is_silent());
    bench.is_cut = true;
    // The last frame arrived at 5 s.
    while !bench.pc.is_silent() {
        bench.step();
        assert!(bench.now_ms <= 6_000, "not noticed");
    }
    assert_eq!(bench.counter("silences"), 1);
    bench.is_cut = false;
    bench.run_for(1);
    assert!(!bench.pc.is_silent());
}

#[test]
fn a_task_ends_when_the_robot_stays_silent() {
    let mut bench = bench(PcConfig::default());
    bench.run_for(1);
    bench.command(PcCommand::MapStart);
    bench.is_cut = true;
    bench.run_for(2);
    assert_eq!(bench.pc.status(), "in progress: robot is silent");
    let seconds = bench.run_task(60);
    assert_eq!(bench.pc.task_state(), TaskState::Failed(Failure::Silent));
    assert!((7.9..9.0).contains(&seconds), "{seconds}");
}

#[test]
fn speeds_by_hand_are_repeated_until_stop() {
    let mut bench = bench(PcConfig::default());
    bench.run_for(1);
    bench.command(AHEAD);
    bench.run_for(4);
    assert_eq!(bench.robot.state(), State::Manual);
    // At 1.0, 1.5, .. 4.5 s, because the robot's watchdog expires after 2 s.
    assert!(
        (7..=9).contains(&bench.commands.len()),
        "{}",
        bench.commands.len()
    );
    assert_eq!(bench.pc.task(), Some(Task::Manual));
    bench.command(PcCommand::Stop);
    bench.run_task(5);
    bench.run_for(1);
    assert_eq!(
        (bench.robot.state(), bench.pc.status()),
        (State::Off, "done")
    );
    // 3.5 s at 0.1 m/s after the drivers were switched on.
    assert!(
        (bench.robot.truth.x - 0.35).abs() < 0.05,
        "{}",
        bench.robot.truth.x
    );
}

#[test]
fn the_reactive_drive_is_begun_with_its_speed() {
    let mut bench = bench(PcConfig::default());
    bench.run_for(1);
    bench.command(PcCommand::Reactive { speed_m_s: 0.3 });
    bench.run_for(2);
    assert_eq!(bench.robot.state(), State::AutoReactive);
    let (_, command) = bench.commands[0];
    assert_eq!(
        command.reactive.and_then(|reactive| reactive.speed_m_s),
        Some(0.3)
    );
    assert_eq!(bench.pc.status(), "in progress");
    bench.command(PcCommand::Stop);
    bench.run_task(5);
    assert_eq!(bench.robot.state(), State::Off);
}

#[test]
fn commands_that_cannot_be_are_refused() {
    let mut pc = PcProgram::new(PcConfig::default());
    let goal = PcCommand::Navigate {
        x_m: f32::NAN,
        y_m: 0.0,
        heading_rad: None,
    };
    let now = Instant::ZERO;
    assert_eq!(pc.command(now, goal), Err(Refused::NoNumber));
    assert_eq!(pc.command(now, PcCommand::Localise), Err(Refused::NoMap));
    assert_eq!(pc.status(), "standby");
    assert_eq!(pc.command(now, PcCommand::MapStart), Ok(()));
    assert_eq!(pc.command(now, HOME), Err(Refused::Busy(Task::Mapping)));
    assert_eq!(
        pc.command(now, PcCommand::MapReset),
        Err(Refused::Busy(Task::Mapping))
    );
    assert_eq!(pc.command(now, PcCommand::Stop), Ok(()));
}

/// Every request is repeated: with a third of all frames lost, in both directions, the map is
/// completed.
#[test]
fn mapping_survives_the_loss_of_a_third_of_all_frames() {
    let (world, start, errors) = labyrinth(5);
    let start_pose = crate::bench::pose(start);
    let config = PcConfig {
        seed: 5,
        start: Some(start_pose),
        ..PcConfig::default()
    };
    let mut bench = Bench::new(world, start, errors, config);
    bench.lost_frames = 0.3;
    bench.command(PcCommand::MapStart);
    let seconds = bench.run_task(900);
    assert_eq!(bench.pc.status(), "done", "after {seconds} s");
    assert!(
        bench.counter("re-sends") > 10,
        "{}",
        bench.counter("re-sends")
    );
}

/// The fielded program requests lines once: a lost request never gets its reply.
#[test]
fn a_request_that_is_sent_once_can_be_lost_for_good() {
    let outcome = |ask_once| {
        let sending = Sending {
            ask_once,
            ..Sending::default()
        };
        let mut bench = bench(PcConfig {
            sending,
            ..PcConfig::default()
        });
        bench.run_for(1);
        bench.command(PcCommand::MapStart);
        bench.run_for(1);
        // The robot rests; the request for lines is sent at about 3.2 s.
        bench.lost_frames = 1.0;
        bench.run_for(3);
        bench.lost_frames = 0.0;
        bench.run_task(60);
        bench.pc.status()
    };
    assert_eq!(outcome(false), "done");
    assert_eq!(outcome(true), "in progress");
}

/// At most one command per frame: a waiting command is lost when a request empties the queue.
#[test]
fn requests_empty_the_queue_only_with_the_defect() {
    let lost = |requests_clear_queue| {
        let sending = Sending {
            one_per_frame: true,
            requests_clear_queue,
            ask_once: true,
            ..Sending::default()
        };
        let mut bench = bench(PcConfig {
            sending,
            ..PcConfig::default()
        });
        bench.run_for(1);
        bench.command(AHEAD);
        bench.step();
        bench.command(HOME);
        bench.run_for(1);
        let states: Vec<_> = bench
            .commands
            .iter()
            .map(|(_, command)| command.state)
            .collect();
        (bench.counter("lost in queue"), states)
    };
    assert_eq!(lost(false), (0, vec![Some(State::Manual), None]));
    assert_eq!(lost(true), (1, vec![None]));
}

/// Worked out by hand: commands of one moment are sent 200 ms apart, with the frames.
#[test]
fn one_command_a_frame_is_five_a_second() {
    let times = |one_per_frame| {
        let sending = Sending {
            one_per_frame,
            ask_once: true,
            ..Sending::default()
        };
        let mut bench = bench(PcConfig {
            sending,
            ..PcConfig::default()
        });
        bench.run_for(1);
        for _ in 0..3 {
            bench.command(AHEAD);
            bench.pc.poll(bench.now());
        }
        bench.run_for(1);
        let times: Vec<u64> = bench.commands.iter().map(|(at, _)| *at).collect();
        times
    };
    assert_eq!(times(false), [1_010; 3]);
    assert_eq!(times(true), [1_200, 1_400, 1_600]);
}

/// Worked out by hand: the frame of a request to rest is 7E, two bytes of length, time (2 to 4
/// bytes), state (4), checksum.
#[test]
fn bytes_go_out_one_a_millisecond_only_with_the_defect() {
    let sending = Sending {
        byte_per_ms: true,
        ..Sending::default()
    };
    let mut bench = bench(PcConfig {
        sending,
        ..PcConfig::default()
    });
    bench.run_for(1);
    bench.command(PcCommand::Stop);
    let (mut sent, mut buf) = (0, [0; 64]);
    for ms in 1_000..1_005 {
        bench.pc.poll(Instant::from_millis(ms));
        sent += bench.pc.transmit(PcProgram::TELEMETRY, &mut buf);
    }
    assert_eq!(sent, 5);
}

#[test]
fn damaged_frames_are_counted_and_change_nothing() {
    let mut bench = bench(PcConfig::default());
    bench.run_for(1);
    let before = bench.pc.believed_pose();
    bench
        .pc
        .receive(PcProgram::TELEMETRY, bench.now(), &[0x7E, 0, 2, 1, 2, 9]);
    assert_eq!(bench.counter("bad frames"), 1);
    // A valid frame that is no message.
    bench
        .pc
        .receive(PcProgram::TELEMETRY, bench.now(), &[0x7E, 0, 1, 0xFF, 0]);
    assert_eq!(bench.counter("bad messages"), 1);
    assert_eq!(
        (bench.pc.believed_pose(), before),
        (before, Some(Pose::default()))
    );
}
