//! `hilrig fuzz --exec .. --jobs N`: N searches in parallel, each a process with its own folder.
//! Their findings are merged, each cause once.

use core::num::NonZeroUsize;
use core::time::Duration;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use protocols::Instant;
use rustix::process::{Pid, Signal, kill_process};

use super::super::FuzzArgs;
use crate::cli::answer::FuzzEnded;
use crate::cli::stop::Stop;
use crate::cli::{CliError, Verdict, out, progress};
use crate::realtime::clock::{Clock, WallClock};
use crate::search::fuzz::dut::{Kept, State};
use safefs::Dir;

/// Time between two checks of the searches.
const LOOK: Duration = Duration::from_millis(100);
/// Time between two lines of progress.
const PROGRESS: Duration = Duration::from_secs(2);
/// Maximum time for a search to end after SIGTERM.
const PATIENCE: Duration = Duration::from_secs(10);

/// Runs `jobs` searches.
pub(super) fn search(args: &FuzzArgs, jobs: NonZeroUsize) -> Result<Verdict, CliError> {
    if args.exec.dir.is_some() {
        let text = "--jobs needs a directory for each, expected no --dir with it";
        return Err(CliError::Usage(text.to_owned()));
    }
    let stop = Stop::new(None)?;
    let clock = WallClock::start();
    let mut all = Vec::new();
    for number in 1..=jobs.get() {
        all.push(Job::start(args, number, jobs.get())?);
    }
    let (mut said, mut asked) = (Instant::ZERO, None);
    while all.iter_mut().any(Job::is_running) {
        let now = clock.now();
        match asked {
            None if stop.is_due(now) => {
                all.iter().for_each(Job::ask_to_end);
                asked = Some(now);
            }
            Some(asked) if now - asked > PATIENCE => all.iter_mut().for_each(Job::kill),
            _ => {}
        }
        if now - said >= PROGRESS {
            said = now;
            if progress::is_watched() {
                eprintln!("  {}", in_words(&all, now - Instant::ZERO));
            }
        }
        clock.sleep_until(now + LOOK);
    }
    println!("{}", in_words(&all, clock.now() - Instant::ZERO));
    if let Some(job) = all.iter_mut().find(|job| job.has_failed()) {
        let text = safefs::read_text(&job.log()).unwrap_or_default();
        let last = text.lines().last().unwrap_or("it said nothing").to_owned();
        return Err(CliError::content(&job.log(), last));
    }
    let findings = put_together(args, &all)?;
    for kept in &findings {
        let folder = args.out.join("findings").join(&kept.folder);
        println!("{}: {}; {} times", folder.display(), kept.words, kept.count);
    }
    out::answer(&FuzzEnded {
        folder: args.out.display().to_string(),
        findings: findings.len() as u64,
        targets: Vec::new(),
    });
    Ok(match findings.is_empty() {
        true => Verdict::Pass,
        false => Verdict::Fail,
    })
}

/// One of the searches.
struct Job {
    out: PathBuf,
    child: Child,
    ended: Option<i32>,
}

impl Job {
    fn start(args: &FuzzArgs, number: usize, jobs: usize) -> Result<Self, CliError> {
        let folder = args.out.join(format!("job-{number}"));
        let failed = |error| CliError::write(folder.display(), error);
        let made = Dir::create(&args.out).and_then(|out| out.below(format!("job-{number}")));
        let log = made
            .map_err(failed)?
            .create_file("log.txt")
            .map_err(failed)?;
        let mut command = Command::new(std::env::current_exe().map_err(failed)?);
        command.arg("fuzz").args(words(args, number, jobs));
        command.arg("--out").arg(&folder);
        let errors = log.try_clone().map_err(failed)?;
        let command = command.stdin(Stdio::null()).stdout(log).stderr(errors);
        let child = command.spawn().map_err(failed)?;
        Ok(Self {
            out: folder,
            child,
            ended: None,
        })
    }

    fn is_running(&mut self) -> bool {
        if self.ended.is_none()
            && let Ok(Some(status)) = self.child.try_wait()
        {
            self.ended = Some(status.code().unwrap_or(2));
        }
        self.ended.is_none()
    }

    fn ask_to_end(&self) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        if let Some(pid) = pid.filter(|_| self.ended.is_none()) {
            let _ = kill_process(pid, Signal::INT);
        }
    }

    fn kill(&mut self) {
        let _ = self.child.kill();
    }

    /// Whether the search failed: 0 and 1 are verdicts, 130 is Ctrl-C's.
    fn has_failed(&self) -> bool {
        !matches!(self.ended, Some(0 | 1 | 130) | None)
    }

    fn log(&self) -> PathBuf {
        self.out.join("log.txt")
    }

    fn state(&self) -> Option<State> {
        State::found(&self.out)
    }
}

/// The arguments of search `number`, without its folder.
fn words(args: &FuzzArgs, number: usize, jobs: usize) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let mut add = |name: &str, value: Option<String>| {
        if let Some(value) = value {
            words.extend([name.to_owned(), value]);
        }
    };
    let path = |path: &Option<PathBuf>| path.as_ref().map(|path| path.display().to_string());
    let (exec, number, jobs) = (&args.exec, number as u64, jobs as u64);
    add("--exec", exec.exec.clone());
    add("--scenario", path(&args.scenario));
    add("--corpus", path(&args.corpus));
    add("--link", args.link.clone());
    add("--for", args.time.map(|time| time.to_string()));
    let share = |cases: u64| (cases / jobs + u64::from(number <= cases % jobs)).to_string();
    add("--cases", args.cases.map(share));
    let seed = args.seed.wrapping_mul(jobs).wrapping_add(number - 1);
    add("--seed", Some(seed.to_string()));
    add("--case", Some(exec.case.to_string()));
    add("--alive", Some(exec.alive.to_string()));
    add("--start", Some(exec.start.to_string()));
    add("--shrink", Some(exec.shrink.to_string()));
    add("--errors", Some(exec.errors.to_string()));
    if args.scenario.is_none() {
        add("--baud", exec.baud.map(|baud| baud.to_string()));
    }
    words.extend(exec.is_virtual.then(|| "--virtual".to_owned()));
    words.extend(exec.strict.then(|| "--strict".to_owned()));
    words
}

fn in_words(all: &[Job], time: Duration) -> String {
    let states: Vec<State> = all.iter().filter_map(Job::state).collect();
    let cases: u64 = states.iter().map(|state| state.next).sum();
    let inputs: u64 = states.iter().map(|state| state.inputs).sum();
    let findings: usize = merged(states.iter()).len();
    let seconds = time.as_secs_f64();
    let (jobs, rate) = (all.len(), inputs as f64 / seconds.max(1e-3));
    format!(
        "{seconds:.1} s: {jobs} jobs, {cases} cases with {inputs} inputs, {rate:.1} inputs/s, \
         {findings} findings"
    )
}

/// The findings of several searches, each cause once, keyed and ordered by first occurrence.
fn merged<'a>(states: impl Iterator<Item = &'a State>) -> Vec<Kept> {
    let mut all: Vec<Kept> = Vec::new();
    for kept in states.flat_map(|state| &state.findings) {
        match all.iter_mut().find(|known| known.key == kept.key) {
            Some(known) => known.count += kept.count,
            None => all.push(kept.clone()),
        }
    }
    all
}

/// Copies each finding to the common folder; a file with the name of its folder gets the new name.
fn put_together(args: &FuzzArgs, all: &[Job]) -> Result<Vec<Kept>, CliError> {
    let states: Vec<(&Path, State)> = all
        .iter()
        .filter_map(|job| Some((job.out.as_path(), job.state()?)))
        .collect();
    let mut findings = merged(states.iter().map(|(_, state)| state));
    for (number, kept) in findings.iter_mut().enumerate() {
        let holds = |(out, state): &(&Path, State)| {
            let found = state.findings.iter().find(|found| found.key == kept.key)?;
            Some(out.join("findings").join(&found.folder))
        };
        let Some(from) = states.iter().find_map(holds) else {
            continue;
        };
        let name = kept
            .folder
            .split_once('-')
            .map_or(&*kept.folder, |(_, name)| name);
        kept.folder = format!("{:02}-{name}", number + 1);
        let to = Path::new("findings").join(&kept.folder);
        let copied = Dir::create(&args.out).and_then(|out| copy(&from, &out.below(&to)?));
        copied.map_err(|error| CliError::write(args.out.join(to).display(), error))?;
    }
    Ok(findings)
}

fn copy(from: &Path, to: &Dir) -> std::io::Result<()> {
    let folder = Dir::open(from)?;
    for name in folder.names()? {
        let bytes = folder.read(&name, u64::MAX)?;
        if name == "repeat.txt" {
            let text = String::from_utf8_lossy(&bytes);
            let [old, new] = [from, to.path()].map(|path| path.display().to_string());
            to.write(&name, text.replace(&old, &new))?;
        } else {
            to.write(&name, bytes)?;
        }
    }
    Ok(())
}
