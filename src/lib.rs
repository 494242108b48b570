//! hilrig: a hardware-in-the-loop rig for small serial robots.
//!
//! Follow a byte: a device makes it ([`emulators`]), a [`line`](mod@line) carries it, damages it by
//! its [`fault`]s and shows it to the [`trace`], the [`rig`] hands it to the robot's program
//! ([`firmware_core`]) and carries the answer back.
//!
//! | module | is |
//! |---|---|
//! | [`scenario`], [`plan`] | a run as data; floor plans |
//! | [`robots`] | which devices, links and program a robot consists of |
//! | [`rig`], [`line`](mod@line), [`fault`], [`resample`], [`cpu`] | nodes and lines under one clock |
//! | [`trace`], [`capture`] | who sees the bytes; the file of all of them |
//! | [`decode`] | bytes in words |
//! | [`replay`], [`divergence`] | a capture fed back; where two streams part |
//! | [`wireshark`] | the same in Wireshark |
//! | [`case`] | a capture as a regression test |
//! | [`import`], [`export`] | dumps of other tools as captures; captures in their forms |
//! | [`record`] | a capture of what passes between two ports |
//! | [`pc_program`] | what somebody at the page wants, as what the PC says |
//! | [`run`], [`mission`], [`check`], [`score`] | a run watched and judged |
//! | [`museum`] | the defects of the fielded programs, each with its reproduction |
//! | [`fuzz`], [`generate`], [`shrink`] | cases that nobody thought of, made small |
//! | [`campaign`] | many runs, grouped by cause |
//! | [`folder`], [`render`], [`report`] | what a run leaves behind |
//! | [`history`] | a run over its time, sampled, for the report |
//! | [`view`] | what the page and the report show, and the script that draws it |
//! | [`map`] | maps as others keep them, and how two differ |
//! | [`slam`] | the mapper over anybody's log |
//! | [`realtime`], [`standalone`] | the rig, or the program alone, at the pace of the wall clock |
//! | [`transport`], [`clock`], [`control`] | the outside world |
//! | `ui` | the page: feature `ui`, on unless switched off |
//! | [`cli`] | the commands |

pub mod campaign;
pub mod capture;
pub mod case;
pub mod check;
pub mod cli;
pub mod clock;
pub mod control;
pub mod cpu;
pub mod decode;
pub mod divergence;
pub mod export;
pub mod fault;
pub mod folder;
pub mod fuzz;
pub mod generate;
pub mod history;
pub mod import;
pub mod line;
pub mod map;
pub mod mission;
pub mod museum;
pub mod pc_program;
pub mod plan;
pub mod realtime;
pub mod record;
pub mod render;
pub mod replay;
pub mod report;
pub mod resample;
pub mod rig;
pub mod robots;
pub mod run;
pub mod scenario;
pub mod score;
pub mod shrink;
pub mod slam;
pub mod standalone;
pub mod trace;
pub mod transport;
#[cfg(feature = "ui")]
pub mod ui;
pub mod view;
pub mod wireshark;
