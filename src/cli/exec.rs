//! `--exec`: a foreign program instead of the robot's own.

use core::time::Duration;
use std::path::Path;

use clap::Args;

use super::CliError;
use crate::realtime::exec::{Companion, Cpu, Foreign, ProgramEnd, Schedule, Supervision};
use crate::realtime::guest::HAS_LINES;
use crate::robots;
use crate::scenario::{Scenario, ScenarioError, Source, Span};
use crate::show::shell::quoted;

/// The foreign program.
#[derive(Debug, Args)]
#[command(next_help_heading = "Your program")]
pub(super) struct ExecArgs {
    /// Start this shell command on the rig's ports and judge it, in real time or virtual time. Its
    /// environment has HILRIG_DIR (directory of the ports), HILRIG_PORT_<NAME> (each port),
    /// HILRIG_TTY_<NAME> (the same in /dev), HILRIG_SEED and HILRIG_SCENARIO (the scenario as a
    /// file)
    #[arg(long, value_name = "CMD")]
    pub(super) exec: Option<String>,
    #[command(flatten)]
    how: ExecHow,
}

/// Several programs, run one after the other.
#[derive(Debug, Args)]
#[command(next_help_heading = "Your program")]
pub(super) struct ManyExecArgs {
    /// Shell command of a program; given several times, the programs are tried in this order
    #[arg(long, value_name = "CMD", required = true)]
    pub(super) exec: Vec<String>,
    #[command(flatten)]
    how: ExecHow,
}

/// Start of a program and its permissions.
#[derive(Debug, Args)]
struct ExecHow {
    /// Wall time within which the program must open its ports; the simulation clock starts then
    #[arg(long, value_name = "TIME", default_value = "10s", requires = "exec")]
    exec_wait: Span,
    /// The program may end with exit code 0 before the run is over; the run ends 2 s later
    #[arg(long, requires = "exec")]
    exec_may_end: bool,
    /// The program may stop sending and reading before the run is over, e.g. when its work is done
    #[arg(long, requires = "exec")]
    exec_may_idle: bool,
    /// Ports that the program must open [default: all but the optional ones]
    #[arg(long, value_name = "NAME,..", value_delimiter = ',', requires = "exec")]
    exec_needs: Vec<String>,
    /// Provide no modem lines in real time: for a program that traces other programs (gdb, strace,
    /// LeakSanitizer) or needs more rights (sudo)
    #[arg(long, requires = "exec", conflicts_with = "is_virtual")]
    exec_no_lines: bool,
    /// Run in virtual time: as fast as possible, with the same bytes each time; Linux on x86-64
    #[arg(long = "virtual", requires = "exec")]
    is_virtual: bool,
    /// Virtual time of each call that reads clocks, waits or uses ports; computing takes none. A
    /// larger value makes a program with many such calls faster
    #[arg(
        long,
        value_name = "TIME",
        default_value = "1us",
        requires = "is_virtual"
    )]
    call_cost: Span,
    /// Maximum processor time of computing without a call; after it the program is reported as
    /// spinning
    #[arg(
        long,
        value_name = "TIME",
        default_value = "10s",
        requires = "is_virtual"
    )]
    spin_max: Span,
    /// Another order of threads, the same for one seed: a number, or "seed" for the scenario's seed.
    /// Shows races
    #[arg(long, value_name = "SEED", requires = "is_virtual")]
    schedule: Option<Schedule>,
    /// Charge computing: processor time takes this many times as long in virtual time, e.g. 20 for
    /// a robot whose processor is 20 times slower than this one. "case": as a saved case records it
    #[arg(long, value_name = "SCALE", requires = "is_virtual")]
    cpu: Option<Cpu>,
}

impl ExecHow {
    /// The program that `command` starts.
    fn foreign(&self, command: String) -> Foreign {
        Foreign {
            command,
            name: String::new(),
            robot: 0,
            others: Vec::new(),
            wait: self.exec_wait.0,
            may_end: self.exec_may_end,
            may_idle: self.exec_may_idle,
            needs: self.exec_needs.clone(),
            prints: true,
            has_lines: HAS_LINES && !self.exec_no_lines && !self.is_virtual,
            supervision: self.is_virtual.then_some(Supervision {
                call_cost: self.call_cost.0,
                spin_max: self.spin_max.0,
                schedule: self.schedule,
                cpu: self.cpu,
            }),
        }
    }

    /// The same options as text, each after a blank; computing is charged as the case records it.
    fn repeat(&self) -> String {
        let mut words = String::new();
        if self.exec_wait.0 != Duration::from_secs(10) {
            words += &format!(" --exec-wait {}", self.exec_wait);
        }
        if self.exec_may_end {
            words += " --exec-may-end";
        }
        if self.exec_may_idle {
            words += " --exec-may-idle";
        }
        if !self.exec_needs.is_empty() {
            words += &format!(" --exec-needs {}", self.exec_needs.join(","));
        }
        if self.exec_no_lines {
            words += " --exec-no-lines";
        }
        if self.is_virtual {
            words += " --virtual";
            if self.call_cost.0 != Duration::from_micros(1) {
                words += &format!(" --call-cost {}", self.call_cost);
            }
            if self.spin_max.0 != Duration::from_secs(10) {
                words += &format!(" --spin-max {}", self.spin_max);
            }
            if let Some(schedule) = self.schedule {
                words += &format!(" --schedule {schedule}");
            }
            if self.cpu.is_some() {
                words += " --cpu case";
            }
        }
        words
    }
}

impl ExecHow {
    fn refuse_cpu(&self, command: &str) -> Result<(), CliError> {
        let Some(cpu) = self.cpu else {
            return Ok(());
        };
        Err(CliError::Usage(format!(
            "--cpu {cpu}: {command} saves no case that records the measured times, so its result \
             could not be repeated; expected run, debug or campaign with a scenario, or no --cpu"
        )))
    }
}

impl ExecArgs {
    /// The program, if there is one.
    pub(super) fn foreign(&self) -> Option<Foreign> {
        Some(self.how.foreign(self.exec.clone()?))
    }

    /// Whether the program may end before the run is over.
    pub(super) const fn may_end(&self) -> bool {
        self.how.exec_may_end
    }

    /// The programs that the scenario names, in virtual time.
    ///
    /// # Errors
    /// If the folder of one is missing.
    pub(super) fn of_file(
        &self,
        scenario: &Scenario,
        source: &Source,
    ) -> Result<Option<Foreign>, CliError> {
        for (_, name, spec) in scenario.programs() {
            let folder = spec.folder.as_deref().filter(|folder| !folder.is_dir());
            if let Some(folder) = folder {
                let key = format!("{}.folder", table_of(&name));
                let folder = folder.display();
                let message = format!("{folder} is no folder, expected that of the program");
                return Err(source.invalid(source.find("folder"), key, message).into());
            }
        }
        Ok(self.programs_of(scenario))
    }

    fn programs_of(&self, scenario: &Scenario) -> Option<Foreign> {
        let programs = scenario.programs();
        let mut programs = programs.map(|(robot, name, spec)| Companion {
            name,
            command: spec.shell(),
            robot,
            may_end: spec.may_end,
        });
        let first = programs.next()?;
        let may_idle = scenario.programs().all(|(_, _, spec)| spec.may_idle);
        Some(Foreign {
            name: first.name,
            robot: first.robot,
            may_end: first.may_end,
            may_idle,
            others: programs.collect(),
            has_lines: false,
            supervision: Some(Supervision::default()),
            ..self.how.foreign(first.command)
        })
    }

    /// The same program, started by another command.
    pub(super) fn foreign_of(&self, command: &str) -> Foreign {
        self.how.foreign(command.to_owned())
    }

    /// The program in virtual time, as the debugger has it.
    pub(super) fn foreign_in_virtual_time(&self) -> Option<Foreign> {
        let how = &self.how;
        let supervision = Supervision {
            call_cost: how.call_cost.0,
            spin_max: how.spin_max.0,
            schedule: how.schedule,
            cpu: how.cpu,
        };
        Some(Foreign {
            has_lines: false,
            supervision: Some(supervision),
            ..how.foreign(self.exec.clone()?)
        })
    }

    /// From now on the order of threads is that of each scenario's seed.
    pub(super) const fn vary_schedule(&mut self) {
        self.how.schedule = Some(Schedule::OfScenario);
    }

    /// Whether an order of threads was chosen.
    pub(super) const fn has_schedule(&self) -> bool {
        self.how.schedule.is_some()
    }

    /// The scale of `--cpu`.
    pub(super) const fn cpu(&self) -> Option<Cpu> {
        self.how.cpu
    }

    /// Rejects `--cpu` for a command that saves no case to repeat the measured times.
    pub(super) fn refuse_cpu(&self, command: &str) -> Result<(), CliError> {
        self.how.refuse_cpu(command)
    }

    /// Whether the program runs in virtual time.
    pub(super) const fn is_virtual(&self) -> bool {
        self.how.is_virtual
    }

    /// The given options as text, each after a blank.
    pub(super) fn repeat(&self) -> String {
        let Some(command) = &self.exec else {
            return String::new();
        };
        format!(" --exec {}{}", quoted(command), self.how.repeat())
    }
}

impl ManyExecArgs {
    /// Rejects `--cpu` for these programs, as for one program.
    pub(super) fn refuse_cpu(&self, command: &str) -> Result<(), CliError> {
        self.how.refuse_cpu(command)
    }

    /// The programs.
    pub(super) fn foreign(&self) -> impl Iterator<Item = Foreign> {
        self.exec
            .iter()
            .map(|command| self.how.foreign(command.clone()))
    }
}

/// Rejects a scenario that names its programs: `command` judges a run without starting them, and a
/// run without its programs may be green.
pub(super) fn refuse_programs(
    command: &str,
    path: &Path,
    scenario: &Scenario,
) -> Result<(), CliError> {
    let Some((_, name, _)) = scenario.programs().next() else {
        return Ok(());
    };
    let table = table_of(&name);
    let path = path.display();
    Err(CliError::Usage(format!(
        "{command}: {path} names a program in [{table}], which {command} does not start; use \
         \"hilrig run\" with the scenario, or leave its exec tables out"
    )))
}

/// The table of a program with that of its robot before it.
fn table_of(name: &str) -> String {
    match name.split_once('/') {
        Some((robot, program)) => format!("team.{robot}.exec.{program}"),
        None => format!("exec.{name}"),
    }
}

/// The scenario in `path` for `command`, which starts no programs of a file.
pub(super) fn read_without_programs(
    command: &str,
    path: &Path,
) -> Result<(Scenario, Source), CliError> {
    let (scenario, source) = Scenario::read(path)?;
    refuse_programs(command, path, &scenario)?;
    Ok((scenario, source))
}

/// Whether the robot has no built-in program.
pub(super) fn is_bare(scenario: &Scenario, source: &Source) -> Result<bool, ScenarioError> {
    let program = robots::of(scenario, source)?.program(scenario, source)?;
    Ok(program.is_none())
}

/// Maximum number of printed lines of a program's output.
const LINES: usize = 20;

/// Prints the last lines of a program's output.
pub(super) fn print(seen: &ProgramEnd, passed: bool, is_doubtful: bool, log: &Path) {
    if is_doubtful {
        eprintln!("  the rig itself was late, which may be the cause of the failure");
    }
    if !passed {
        show_words("the program", &seen.said, log);
    }
}

/// Prints the end of the output of `whose` program; `log` has all of it.
pub(super) fn show_words(whose: &str, said: &str, log: &Path) {
    let lines: Vec<&str> = said.lines().collect();
    if lines.is_empty() {
        return;
    }
    println!("  {whose}'s last words, all in {}:", log.display());
    for line in &lines[lines.len().saturating_sub(LINES)..] {
        println!("  | {line}");
    }
}
