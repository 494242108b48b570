//! Rows of the map that the radio module loses: the wire fills its buffer faster than the radio
//! empties it, at most baud rates.

use core::time::Duration;

use emulators::hc06::{Hc06, Profile};
use emulators::world::{BodyConfig, Fixture, Pose, Scene, World};
use protocols::pcui::message::encode_row;
use protocols::pcui::{Decoder, FRAME_MAX};
use protocols::rle::Dialect;
use protocols::{Decode as _, Instant, LineConfig, LineEvent, Port};

use super::runs::{Spread, each};
use super::{Figure, Findings, Plan, Plot, Table};
use engine::rig::Rig;
use engine::rig::line::End;

/// Baud rates of the module.
const BAUDS: [u32; 11] = [
    9_600, 19_200, 38_400, 57_600, 115_200, 230_400, 460_800, 576_000, 691_200, 921_600, 1_382_400,
];
/// Number of rows sent: one map.
const ROWS: u16 = 300;
/// Rate at which the robot's program sends, bytes a second.
const PACE: u32 = 12_000;

/// Pace of the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pace {
    /// Rows are sent as fast as the wire accepts them.
    Flood,
    /// At the pace of the robot's program.
    Paced,
}

/// Result of sending a map.
struct Sent {
    lost: f64,
    time_s: f64,
}

pub(super) fn perform(plan: &Plan, tell: &(dyn Fn(usize, usize) + Sync)) -> Findings {
    let mut jobs = Vec::new();
    for pace in [Pace::Flood, Pace::Paced] {
        for baud in BAUDS {
            jobs.extend(plan.seeds().map(|seed| (pace, baud, seed)));
        }
    }
    let sent = each(plan, &jobs, tell, |(pace, baud, seed)| {
        send(*pace, *baud, *seed)
    });
    let count = plan.count();
    let spreads: Vec<[f64; 2]> = sent
        .chunks(count)
        .map(|same| {
            let lost = Spread::of(same.iter().map(|one| one.lost * 100.0));
            let time = Spread::of(same.iter().map(|one| one.time_s));
            [lost.median, time.median]
        })
        .collect();
    let (flood, paced) = spreads.split_at(BAUDS.len());
    let mut table = Table::new([
        "baud",
        "rows lost without pause (%)",
        "time of a map (s)",
        "rows lost at 12 kB/s (%)",
        "time of a map at 12 kB/s (s)",
    ]);
    for ((baud, flood), paced) in BAUDS.iter().zip(flood).zip(paced) {
        let figures = [f64::from(*baud), flood[0], flood[1], paced[0], paced[1]];
        table.push(format!("{baud}"), figures);
    }
    let places = |of: &[[f64; 2]]| -> Vec<[f64; 2]> {
        let places = BAUDS.iter().zip(of);
        places
            .map(|(baud, [lost, _])| [f64::from(*baud), *lost])
            .collect()
    };
    let plot = Plot::new("Rows of the map that are lost", ["baud", "rows lost (%)"])
        .by_factors()
        .line("without pause", places(flood))
        .line("at 12 kB/s", places(paced));
    let at = |baud: u32| BAUDS.iter().position(|one| *one == baud).unwrap_or(0);
    let figure = |baud: u32, report| {
        let ([all, _], [some, time_s]) = (flood[at(baud)], paced[at(baud)]);
        let ours = format!("{all:.1} % without pause, {some:.1} % paced, a map in {time_s:.1} s");
        Figure::new(format!("{baud} baud: rows lost"), ours, report)
    };
    let figures = vec![
        figure(115_200, ""),
        figure(460_800, "the best of speed and loss"),
        figure(1_382_400, "more loss"),
    ];
    Findings {
        table,
        plot,
        figures,
    }
}

/// A row that run-length encoding does not shorten.
fn row(y: u16) -> Vec<u8> {
    let pixels: [u8; 300] = core::array::from_fn(|x| if x % 2 == 0 { 0 } else { 255 });
    let mut frame = [0; FRAME_MAX];
    let len = encode_row(0, y, &pixels, Dialect::Lossless, &mut frame).unwrap_or(0);
    frame[..len].to_vec()
}

/// Sends a map through a module at `baud`.
fn send(pace: Pace, baud: u32, seed: u64) -> Sent {
    let line = LineConfig::new_8n1(baud);
    let scene = Scene::new(Vec::<Fixture>::new(), Vec::new()).expect("nothing is fine");
    let world = World::new(scene, BodyConfig::default(), Pose::default(), seed);
    let mut rig = Rig::new(world.expect("nothing is near"));
    let module = Hc06::new(Profile::default().at_baud(baud), seed);
    let module = rig.add_device("radio", module);
    let robot = rig.add_outside("robot", line);
    let host = rig.add_outside("pc", emulators::hc06::AIR_LINE);
    let end = |node, port| End { node, port };
    rig.connect("uart", end(module, Hc06::UART), end(robot, Port(0)), 64);
    rig.connect("air", end(module, Hc06::AIR), end(host, Port(0)), 64);
    rig.change_line(host, LineEvent::Opened);
    rig.run_for(Duration::from_secs(5));
    let begun = rig.now();
    let mut decoder = Decoder::default();
    let (mut arrived, mut last, mut next) = (0_u32, begun, begun);
    for y in 0..ROWS {
        let bytes = row(y);
        let wire = line.byte_time() * u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let rest = match pace {
            Pace::Flood => Duration::ZERO,
            Pace::Paced => Duration::from_secs(1) * u32::try_from(bytes.len()).unwrap_or(0) / PACE,
        };
        rig.inject(robot, &bytes);
        next += wire.max(rest);
        rig.run_until(next);
        collect(&mut rig, host, &mut decoder, (&mut arrived, &mut last));
    }
    for _ in 0..200 {
        rig.run_for(Duration::from_millis(10));
        collect(&mut rig, host, &mut decoder, (&mut arrived, &mut last));
    }
    Sent {
        lost: 1.0 - f64::from(arrived) / f64::from(ROWS),
        time_s: (last - begun).as_secs_f64(),
    }
}

/// Counts the received rows and records the time of the last one.
fn collect(rig: &mut Rig, host: usize, decoder: &mut Decoder, seen: (&mut u32, &mut Instant)) {
    let bytes = rig.take_output(host);
    let count = decoder.push(&bytes).filter(Result::is_ok).count();
    if count > 0 {
        *seen.0 += u32::try_from(count).unwrap_or(u32::MAX);
        *seen.1 = rig.now();
    }
}
