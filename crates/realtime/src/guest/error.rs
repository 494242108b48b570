//! Reasons why a program cannot be run in virtual time.

use core::time::Duration;
use std::io;
use std::path::PathBuf;

use crate::exec::ExecError;
use crate::transport::TransportError;

/// The reason why a program cannot be run in virtual time.
#[derive(Debug, thiserror::Error)]
pub enum GuestError {
    /// The system does not allow tracing the program.
    #[error(
        "--virtual: the system does not let a program be traced: in a container allow ptrace \
         (--cap-add=SYS_PTRACE), and look at /proc/sys/kernel/yama/ptrace_scope, expected at most 1"
    )]
    NotTraced,
    /// The filter cannot be installed, or the shell is missing.
    #[error("--virtual: the program cannot be started under supervision: {0}")]
    NotLaunched(String),
    /// The program is a setuid program.
    #[error(
        "--virtual: {} is a setuid or setgid program: under supervision it would run without its \
         rights; expected one that needs none, or a run without --virtual",
        .0.display()
    )]
    Setuid(PathBuf),
    /// The program was built for another processor.
    #[error("--virtual: {} is a 32-bit program: expected one for x86-64", .0.display())]
    OtherArchitecture(PathBuf),
    /// This build has no supervisor.
    #[error("--virtual: expected Linux on x86-64; here run it without --virtual, in real time")]
    NotHere,
    /// The case has no measured computing.
    #[error(
        "--cpu case: the scenario has no table [computing]: expected the case.toml of a run with \
         --cpu SCALE"
    )]
    NoComputing,
    /// No rig answers.
    #[error("--dir {}: no rig answers here, expected a directory of `hilrig up`: {source}", .dir.display())]
    NoRig {
        /// The directory.
        dir: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A thread computes without making a call.
    #[error(
        "{0} computes without a call for {secs:.0} s of processor time",
        secs = .1.as_secs_f64()
    )]
    Spins(String, Duration),
    /// Virtual time does not advance.
    #[error(
        "virtual time stood for {secs} s of wall time: {0}; a --call-cost above 0 lets it go on \
         with each call",
        secs = .1.as_secs()
    )]
    Stands(String, Duration),
    /// The program ran, and could not be started again for the debugger.
    #[error(
        "--exec: the program could not be started again; expected a command that can be repeated"
    )]
    Restart,
    /// No debugger can connect.
    #[error(
        "--port {port}: {source}; expected a free port of this machine, 0 lets the system choose one"
    )]
    DebugPort {
        /// The TCP port.
        port: u16,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The program has overwritten the page with our clock functions.
    #[error(
        "the program has overwritten the page from which hilrig answers clocks and ports; expected \
         writes to the program's own memory only"
    )]
    Overwritten,
    /// The program has read other bytes than the rig delivered.
    #[error(
        "{0} at {secs:.6} s: the program has read bytes that the rig did not bring; this is a fault \
         of hilrig, expected no difference; with --trace-calls FILE each read asks the rig",
        secs = .1.as_secs_f64()
    )]
    Unsent(String, Duration),
    /// The trace cannot be written.
    #[error("--trace-calls {}: {source}", .path.display())]
    Trace {
        /// The file.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A real port disappeared.
    #[error(transparent)]
    Transport(#[from] TransportError),
    /// The program cannot be run.
    #[error(transparent)]
    Exec(#[from] ExecError),
}
