use emulators::world::{Pose, wrap_angle};
use mapping::building::Building;
use mapping::motion::{between, distance};
use mapping::{Kind, Mapper, Settings, Shot};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (from, n): (u64, u64) = (a[1].parse().unwrap(), a[2].parse().unwrap());
    let (mut bad, mut falses, mut silent) = (0, 0, 0);
    for seed in from..from + n {
        let b = Building::generate(seed);
        let c0 = cpu();
        let first = b.sights[0].truth;
        let mut m = Mapper::new(Settings { start: first, ..Settings::default() });
        let (mut doubt, mut low, mut jumps) = (0, 0, 0);
        let mut before: Option<(Pose, Pose)> = None;
        for (i, s) in b.sights.iter().enumerate() {
            let pred = mapping::motion::moved(m.way().last().copied().unwrap_or(first), s.moved);
            let o = m.take(&Shot { moved: s.moved, is_measured: true, ends: &s.ends });
            if let (Some((p, t)), true) = (before, std::env::var("TRACE").is_ok()) {
                let (a, b) = (between(p, o.pose), between(t, s.truth));
                eprintln!("{i} q {:.2} step err {:.2} {:.2} m {:.1} deg; wheels err {:.2} m {:.1} deg spots {}", o.quality, a.x - b.x, a.y - b.y, wrap_angle(a.theta - b.theta).to_degrees(), distance(s.moved, b), wrap_angle(s.moved.theta - b.theta).to_degrees(), s.ends.len());
            }
            before = Some((o.pose, s.truth));
            doubt += usize::from(o.is_doubtful); low += usize::from(o.quality < 0.5);
            jumps += usize::from(distance(o.pose, pred) > 0.5 || wrap_angle(o.pose.theta - pred.theta).abs() > 0.39);
        }
        m.finish();
        let c = cpu() - c0;
        let way = m.way();
        let tr: Vec<Pose> = b.sights.iter().map(|s| s.truth).collect();
        let e = absolute(&tr, &way);
        let sc = m.scans();
        let wrong: Vec<f64> = m.graph().edges.iter().filter(|e| e.kind == Kind::Loop).filter_map(|e| {
            let t = between(tr[sc[e.from]], tr[sc[e.to]]);
            let d = distance(t, e.way); let w = wrap_angle(t.theta - e.way.theta).abs();
            let v = mapping_strain(e, t);
            if std::env::var("DBG").is_ok() { eprintln!("edge {} {} err {d:.2} m {:.1} deg v {v:.0}", e.from, e.to, w.to_degrees()); }
            (v > 100.0 && (d > 0.5 || w > 0.09)).then_some(d)
        }).collect();
        let part = 100.0 * e / b.way_m;
        let is_bad = part > 0.5;
        bad += usize::from(is_bad); falses += usize::from(!wrong.is_empty());
        silent += usize::from(is_bad && doubt == 0 && jumps == 0);
        if is_bad || !wrong.is_empty() || a.len() > 3 {
            println!("{seed}: way {:.0} m scans {} err {e:.3} m = {part:.2} % cpu {c:.2} doubt {doubt} low {low} jumps {jumps} false {wrong:.1?} {}", b.way_m, b.sights.len(), m.describe());
        }
        if let Some(d) = a.get(4) {
            let mut o = String::new();
            for s in &b.sights { o += &format!("{} {} {}\n", s.truth.x, s.truth.y, s.truth.theta); }
            std::fs::write(format!("{d}/{seed}.truth"), o).unwrap();
            let mut o = String::new();
            for p in &way { o += &format!("{} {} {}\n", p.x, p.y, p.theta); }
            std::fs::write(format!("{d}/{seed}.est"), o).unwrap();
            let mut o = String::new();
            for w in &b.walls { o += &format!("{} {} {} {} {}\n", w.from[0], w.from[1], w.to[0], w.to[1], w.is_glass); }
            std::fs::write(format!("{d}/{seed}.walls"), o).unwrap();
        }
    }
    println!("{n} buildings: {bad} beyond 0.5 %, {falses} with false loops, {silent} silent");
}
fn mapping_strain(e: &mapping::Edge, t: Pose) -> f64 {
    let o = [t.x - e.way.x, t.y - e.way.y, wrap_angle(t.theta - e.way.theta)];
    (0..3).map(|a| (0..3).map(|b| o[a] * e.information[a][b] * o[b]).sum::<f64>()).sum()
}
fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    s.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-9
}
fn absolute(rf: &[Pose], est: &[Pose]) -> f64 {
    let n = rf.len() as f64;
    let (mut mx, mut my, mut qx, mut qy) = (0.0, 0.0, 0.0, 0.0);
    for (p, q) in rf.iter().zip(est) { mx += p.x / n; my += p.y / n; qx += q.x / n; qy += q.y / n; }
    let (mut sc, mut ss) = (0.0, 0.0);
    for (p, q) in rf.iter().zip(est) {
        let (ux, uy, vx, vy) = (q.x - qx, q.y - qy, p.x - mx, p.y - my);
        sc += ux * vx + uy * vy; ss += ux * vy - uy * vx;
    }
    let th = ss.atan2(sc); let (s, c) = th.sin_cos();
    rf.iter().zip(est).map(|(p, q)| {
        let x = c * (q.x - qx) - s * (q.y - qy) + mx; let y = s * (q.x - qx) + c * (q.y - qy) + my;
        (x - p.x).hypot(y - p.y)
    }).sum::<f64>() / n
}
