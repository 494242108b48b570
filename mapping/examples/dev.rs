use emulators::rng::Rng;
use emulators::world::Pose;
use mapping::{Mapper, Settings, Shot};
use std::time::Instant;

struct Rec { t: f64, d: Pose, r: Vec<f64> }
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let base = &a[1];
    let from: u64 = a[2].parse().unwrap();
    let runs: u64 = a[3].parse().unwrap();
    let loops = a.get(4).map_or(true, |s| s != "noloops");
    let recs: Vec<Rec> = std::fs::read_to_string(format!("{base}.scans")).unwrap().lines().map(|l| {
        let v: Vec<f64> = l.split_whitespace().map(|x| x.parse().unwrap()).collect();
        Rec { t: v[0], d: Pose::new(v[1], v[2], v[3]), r: v[5..].to_vec() }
    }).collect();
    let rf: Vec<Pose> = std::fs::read_to_string(format!("{base}.ref")).unwrap().lines().map(|l| {
        let v: Vec<f64> = l.split_whitespace().map(|x| x.parse().unwrap()).collect();
        Pose::new(v[1], v[2], v[3])
    }).collect();
    let mut errs = vec![];
    for seed in from..from + runs {
        let mut rng = Rng::stream(seed, "dither");
        let t0 = cpu();
        let mut m = Mapper::new(Settings { closes_loops: loops, ..Settings::default() });
        let mut pts: Vec<Vec<[f32; 2]>> = vec![];
        for rec in &recs {
            let n = rec.r.len();
            let spread = if n % 2 == 1 { n - 1 } else { n } as f64;
            let mut p = vec![];
            for (i, r) in rec.r.iter().enumerate() {
                let r = if seed > 0 { r + rng.range(-0.005, 0.005) } else { *r };
                if r < 0.05 || r >= 50.0 { continue; }
                let b = (-90.0 + i as f64 * 180.0 / spread).to_radians();
                p.push([(r * b.cos()) as f32, (r * b.sin()) as f32]);
            }
            if p.len() > 360 { let all = p.len(); p = (0..360).map(|i| p[i * all / 360]).collect(); }
            pts.push(p);
        }
        let mut low = 0; let mut doubt = 0; let mut worst = 0.0f64; let mut lastp = Pose::default();
        for (i, (rec, p)) in recs.iter().zip(&pts).enumerate() {
            let d = if i == 0 { Pose::default() } else { rec.d };
            let b = Instant::now();
            let o = m.take(&Shot { moved: d, is_measured: true, ends: p });
            worst = worst.max(b.elapsed().as_secs_f64());
            if o.quality < 0.5 { low += 1; }
            if o.is_doubtful { doubt += 1; }
            if std::env::var("TRACE").is_ok() {
                println!("{i} q {:.2} pose {:.2} {:.2} {:.1} odo {:.2} {:.1}", o.quality, o.pose.x, o.pose.y, o.pose.theta.to_degrees(), d.x.hypot(d.y), d.theta.to_degrees());
            }
            lastp = o.pose;
        }
        let _ = lastp;
        m.finish();
        let cpu = cpu() - t0;
        let way = m.way();
        let e = absolute(&rf, &way);
        errs.push(e);
        println!("  seed {seed}: {e:.3} m  cpu {cpu:.2} worst {:.1} ms low {low} doubtful {doubt} {}", worst * 1e3, m.describe());
        let mut out = String::new();
        for (rec, p) in recs.iter().zip(&way) { out += &format!("{:.6} {} {} {}\n", rec.t, p.x, p.y, p.theta); }
        std::fs::write(format!("{base}.{seed}.traj"), out).unwrap();
    }
    errs.sort_by(|a, b| a.total_cmp(b));
    println!("{base}: median {:.3} worst {:.3}", errs[errs.len() / 2], errs[errs.len() - 1]);
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

fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    s.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-9
}
