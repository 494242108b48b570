//! Every command works with every robot: one table with a scenario for each. Other tests check the
//! commands' results in detail; this one checks that no command works with a single robot only.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

use super::{Session, text};

/// A robot, the orders that move it within seconds, and the link that carries these orders.
struct Row {
    robot: &'static str,
    mission: &'static str,
    orders: &'static str,
    /// The direction of orders on that link.
    towards: &'static str,
    /// A link that a device sends on, for `export`.
    lidar: &'static str,
    /// A text of the robot's panel in the report.
    panel: &'static str,
}

const ROWS: [Row; 3] = [
    Row {
        robot: "rescue",
        mission: "[mission]\nwaypoints_m = [[1.5, 1.0]]\n",
        orders: "pc",
        towards: "to-device",
        lidar: "lidar",
        panel: "base registers",
    },
    Row {
        robot: "yellow",
        mission: "[mission]\nwaypoints_m = [[1.5, 1.0]]\n\
            [[mission.step]]\nat = \"500ms\"\ndo = { mode = \"stop\" }\n\
            [[mission.step]]\nat = \"2s\"\ndo = { drive = [0.1, 0.1] }\n\
            [[mission.step]]\nat = \"7s\"\ndo = { drive = [0, 0] }\n",
        orders: "telemetry",
        towards: "to-master",
        lidar: "lidar",
        panel: "infrared",
    },
    Row {
        robot: "apollo13",
        mission: "[mission]\nwaypoints_m = [[1.5, 1.0]]\n\
            [[mission.step]]\nat = \"1s\"\ndo = { drive = [2, 8] }\n\
            [[mission.step]]\nat = \"3500ms\"\ndo = { drive = [0, 8] }\n",
        orders: "remote",
        towards: "to-master",
        lidar: "odometer",
        panel: "planner",
    },
];

impl Row {
    /// The scenario, with further tables if given.
    fn scenario(&self, more: &str) -> String {
        format!(
            "schema = 1\nname = \"verbs\"\nrobot = \"{}\"\nduration = \"20s\"\n{}\
             [expect]\nvisit_within_mm = 200\n\
             [world]\nstart = {{ x_m = 1.0, y_m = 1.0, heading_deg = 0 }}\n\
             [[world.wall]]\n\
             path_m = [[0.3, 0.3], [2.7, 0.3], [2.7, 2.7], [0.3, 2.7], [0.3, 0.3]]\n\
             {more}",
            self.robot, self.mission
        )
    }

    fn session(&self, verb: &str) -> Session {
        let session = Session::new(&format!("robots-{}-{verb}", self.robot));
        session.write("run.toml", &self.scenario(""));
        session
    }

    /// Runs a command, which must succeed; returns its output.
    fn succeeds(&self, session: &Session, arguments: &[&str]) -> String {
        let output = session.hilrig(arguments);
        let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
        assert_eq!(
            output.status.code(),
            Some(0),
            "{}: {arguments:?}: {said}",
            self.robot
        );
        said
    }
}

/// A run leaves its folder; its capture is replayed with the same bytes, decoded, exported and made
/// into a case that passes.
#[test]
fn a_run_is_replayed_decoded_exported_and_kept_with_every_robot() {
    for row in ROWS {
        let session = row.session("run");
        let run = |arguments: &[&str]| row.succeeds(&session, arguments);
        let said = run(&["run", "run.toml", "--out", "out"]);
        assert!(said.contains("PASS verbs"), "{said}");
        let report = session.read("out/report.html");
        assert!(
            report.contains(row.lidar) && report.contains(row.panel),
            "{}",
            row.robot
        );
        run(&["replay", "--expect", "out/capture.pcapng"]);
        let decoded = run(&["decode", "out/capture.pcapng"]);
        assert!(decoded.lines().count() > 100, "{}: {decoded}", row.robot);
        assert!(decoded.contains(row.orders), "{}", row.robot);
        let healthy = run(&["decode", "out/capture.pcapng", "--diagnose"]);
        assert!(healthy.contains(row.lidar), "{}: {healthy}", row.robot);
        run(&["export", "out", "-o", "way.tum"]);
        assert!(
            session.read("way.tum").lines().count() > 10,
            "{}",
            row.robot
        );
        run(&[
            "export",
            "out/capture.pcapng",
            "-o",
            "bytes.csv",
            "--until",
            "3s",
        ]);
        assert!(
            session.read("bytes.csv").contains(row.lidar),
            "{}",
            row.robot
        );
        run(&[
            "case",
            "from",
            "out/capture.pcapng",
            "-o",
            "case.toml",
            "--until",
            "5s",
        ]);
        run(&["run", "case.toml"]);
    }
}

/// A campaign varies everything with a few seeds; each seed leaves a line, whatever its result.
#[test]
fn campaigns_vary_every_robot() {
    for row in ROWS {
        let session = row.session("campaign");
        let output = session.hilrig(&[
            "campaign", "run.toml", "--seeds", "1..5", "--vary", "all", "--out", "out",
        ]);
        let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
        assert!(
            matches!(output.status.code(), Some(0 | 1)),
            "{}: {said}",
            row.robot
        );
        assert_eq!(
            session.read("out/runs.jsonl").lines().count(),
            4,
            "{}: {said}",
            row.robot
        );
    }
}

/// The orders' link is cut permanently, and there is an irrelevant fault: only the cut remains.
#[test]
fn a_failure_of_every_robot_is_made_small() {
    for row in ROWS {
        let session = row.session("shrink");
        let faults = format!(
            "[[fault]]\nlink = \"{}\"\nkind = \"cut\"\ndirection = \"{}\"\n\
             [[fault]]\nlink = \"{}\"\nkind = \"flip\"\nrate = 0.0001\n\
             direction = \"to-master\"\nfrom = \"15s\"\nuntil = \"16s\"\n",
            row.orders, row.towards, row.lidar
        );
        session.write("fails.toml", &row.scenario(&faults));
        row.succeeds(&session, &["shrink", "fails.toml", "--out", "small"]);
        let small = session.read("small/case.toml");
        assert_eq!(
            small.matches("[[fault]]").count(),
            1,
            "{}: {small}",
            row.robot
        );
        assert!(small.contains("kind = \"cut\""), "{}: {small}", row.robot);
    }
}

/// A few missions made of bytes.
#[test]
fn missions_of_every_robot_are_fuzzed() {
    for row in ROWS {
        let session = row.session("fuzz");
        let arguments = [
            "fuzz",
            "--scenario",
            "run.toml",
            "--vary",
            "timing,faults",
            "--cases",
            "4",
            "--out",
            "out",
        ];
        let output = session.hilrig(&arguments);
        let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
        assert!(
            matches!(output.status.code(), Some(0 | 1)),
            "{}: {said}",
            row.robot
        );
    }
}

/// A served page; the process ends with the test.
struct Page(Child);

impl Drop for Page {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The page is served, and shows a session of this robot.
#[test]
fn every_robot_has_a_page() {
    for row in ROWS {
        let session = row.session("ui");
        let mut command = Command::new(env!("CARGO_BIN_EXE_hilrig"));
        command
            .args(["ui", "run.toml"])
            .current_dir(&session.folder);
        command.stdout(Stdio::piped()).stderr(Stdio::null());
        let mut page = Page(command.spawn().expect("the command starts"));
        let out = BufReader::new(page.0.stdout.take().expect("piped"));
        let urls = out.lines().map_while(Result::ok);
        let mut hosts = urls.filter_map(|line| Some(line.split_once("http://")?.1.to_owned()));
        let host = hosts.next().expect("it says where it is");
        let (host, query) = host.split_once("/?").expect("its token");
        for (path, words) in [("/", "hilrig"), ("/case.toml", row.robot)] {
            let mut socket = TcpStream::connect(host).expect("it listens");
            let request =
                format!("GET {path}?{query} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n");
            socket.write_all(request.as_bytes()).expect("is read");
            let mut answer = String::new();
            socket.read_to_string(&mut answer).expect("text");
            assert!(answer.contains("200 OK"), "{}: {answer}", row.robot);
            assert!(answer.contains(words), "{}: {answer}", row.robot);
        }
    }
}
