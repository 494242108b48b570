//! The price of computing: virtual time that a thread's computing takes, charged at its next call.
//!
//! Processor time is measured, and differs from run to run. So each charge is recorded with its
//! thread and the number of its call, and a run with the same record is the same run.

use core::time::Duration;
use std::collections::BTreeSet;

use engine::run::check::Check;
use engine::scenario::{CHARGE_UNIT, Charges, ComputingSpec, Scenario};

use super::GuestError;
use crate::exec::Cpu;

/// Processor time between two stops that is free: a stop itself takes about that much.
const FREE: Duration = Duration::from_micros(10);
/// Longest charge at once, units: one hour.
const UNITS_MAX: u128 = 36_000_000;
/// Start and factor of the fingerprint (FNV-1a, 64 bits).
const BASIS: u64 = 0xCBF2_9CE4_8422_2325;
const PRIME: u64 = 0x100_0000_01B3;

/// All charges of a run.
#[derive(Clone, Debug)]
pub(super) struct Computing {
    /// Factor in thousandths; `None`: nothing is measured.
    scale: Option<u32>,
    tapes: Vec<Tape>,
    calls: u64,
    fingerprint: u64,
    /// Measured processor time, and charged virtual time.
    pub(super) used: Duration,
    pub(super) charged: Duration,
    /// The files that ran: name and fingerprint of each.
    programs: BTreeSet<String>,
    /// The computing that the case recorded.
    recorded: Option<ComputingSpec>,
}

/// Charges of one thread.
#[derive(Clone, Debug, Default)]
struct Tape {
    /// Number of calls so far.
    calls: u64,
    charges: Vec<(u64, u32)>,
    /// Index of the next recorded charge.
    next: usize,
    /// Number of the call up to which the charges are known.
    known: u64,
    /// Processor time since the last charge, and the uncharged rest in virtual nanoseconds, less
    /// than a unit.
    computed: Duration,
    rest: u128,
    /// The last part of this processor time.
    last: Duration,
}

impl Computing {
    /// Computing of a run whose case has recorded `spec`. `None` if `cpu` requires a record and
    /// there is none.
    pub(super) fn new(cpu: Cpu, spec: Option<&ComputingSpec>) -> Option<Self> {
        let (scale, recorded) = match cpu {
            Cpu::Scale(thousandths) => (Some(thousandths), None),
            Cpu::OfCase => (None, Some(spec?)),
        };
        let tapes = recorded.into_iter().flat_map(|spec| &spec.charges);
        let tapes = tapes.map(|charges| Tape {
            charges: charges.0.clone(),
            ..Tape::default()
        });
        Some(Self {
            scale,
            tapes: tapes.collect(),
            calls: 0,
            fingerprint: BASIS,
            used: Duration::ZERO,
            charged: Duration::ZERO,
            programs: BTreeSet::new(),
            recorded: recorded.cloned(),
        })
    }

    /// Computing of a run of `scenario`; `None` if computing takes no virtual time.
    pub(super) fn of(cpu: Option<Cpu>, scenario: &Scenario) -> Result<Option<Self>, GuestError> {
        let recorded = scenario.computing.as_ref();
        let new = |cpu| Self::new(cpu, recorded).ok_or(GuestError::NoComputing);
        cpu.map(new).transpose()
    }

    /// Whether processor time must be measured.
    pub(super) const fn measures(&self) -> bool {
        self.scale.is_some()
    }

    fn tape(&mut self, thread: u32) -> &mut Tape {
        let index = usize::try_from(thread).unwrap_or(usize::MAX);
        if index >= self.tapes.len() {
            self.tapes.resize_with(index + 1, Tape::default);
        }
        &mut self.tapes[index]
    }

    /// Adds the processor time of a thread between two stops.
    pub(super) fn used(&mut self, thread: u32, time: Duration) {
        let time = time.saturating_sub(FREE);
        self.used += time;
        let tape = self.tape(thread);
        tape.computed += time;
        tape.last = time;
    }

    /// Makes the last processor time of a thread free of charge, because the thread only waited for
    /// another one.
    pub(super) fn forgive(&mut self, thread: u32) {
        let tape = self.tape(thread);
        let last = core::mem::take(&mut tape.last);
        tape.computed = tape.computed.saturating_sub(last);
        self.used = self.used.saturating_sub(last);
    }

    /// Adds files that the program runs: name and fingerprint of each.
    pub(super) fn runs(&mut self, files: Vec<String>) {
        self.programs.extend(files);
    }

    /// Records that a thread begins a call with this number. Returns the virtual time that its
    /// computing before the call takes.
    pub(super) fn charge(&mut self, thread: u32, number: i64) -> Duration {
        self.calls += 1;
        for word in [u64::from(thread), number.cast_unsigned()] {
            self.fingerprint = (self.fingerprint ^ word).wrapping_mul(PRIME);
        }
        let scale = self.scale;
        let units = self.tape(thread).charge(scale);
        let charge = CHARGE_UNIT * units;
        self.charged += charge;
        charge
    }

    /// The charges so far, for a case.
    pub(super) fn spec(&self) -> ComputingSpec {
        let charges = self.tapes.iter().map(|tape| {
            let made = tape
                .charges
                .iter()
                .take_while(|(call, _)| *call <= tape.calls);
            Charges(made.copied().collect())
        });
        ComputingSpec {
            scale: match (&self.recorded, self.scale) {
                (Some(recorded), _) => recorded.scale,
                (None, thousandths) => f64::from(thousandths.unwrap_or(1_000)) / 1e3,
            },
            calls: self.calls,
            fingerprint: format!("{:016x}", self.fingerprint),
            programs: self.programs.iter().cloned().collect(),
            charges: charges.collect(),
        }
    }

    /// The computing for another run of the same program from its start: measured charges stay.
    pub(super) fn again(mut self) -> Self {
        for tape in &mut self.tapes {
            *tape = Tape {
                charges: core::mem::take(&mut tape.charges),
                known: tape.known.max(tape.calls),
                ..Tape::default()
            };
        }
        Self {
            calls: 0,
            fingerprint: BASIS,
            used: Duration::ZERO,
            charged: Duration::ZERO,
            programs: BTreeSet::new(),
            ..self
        }
    }

    /// The check that the run is the recorded one, if one was recorded.
    pub(super) fn check(&self) -> Option<Check> {
        let (passed, detail) = match self.difference()? {
            Ok(detail) => (true, detail),
            Err(detail) => (false, detail),
        };
        Some(Check::new("computes-as-recorded", passed, detail))
    }

    /// Comparison of this run with the recorded one: the equality or the first difference as a
    /// message; `None` if none was recorded.
    pub(super) fn difference(&self) -> Option<Result<String, String>> {
        let recorded = self.recorded.as_ref()?;
        let again = "measure again with --cpu SCALE";
        if let Some(name) = self.changed_program(recorded) {
            return Some(Err(format!(
                "{name} is another file than in the recorded run, so its computing is not known: \
                 {again}"
            )));
        }
        let own = self.spec();
        let ComputingSpec { calls, .. } = recorded;
        Some(
            match own.calls == *calls && own.fingerprint == recorded.fingerprint {
                true => Ok(format!("{calls} calls as in the case")),
                false => Err(format!(
                    "{} calls, the case has {calls}, perhaps other ones: the program or its \
                     options differ from the recorded run; {again}",
                    own.calls
                )),
            },
        )
    }

    /// A file that ran with other bytes than in the recorded run.
    fn changed_program(&self, recorded: &ComputingSpec) -> Option<&str> {
        let own = self.programs.iter();
        let mut others = own
            .filter(|line| !recorded.programs.contains(line))
            .map(|line| name_of(line));
        others.find(|name| recorded.programs.iter().any(|line| name_of(line) == *name))
    }
}

/// The name in a line with name and fingerprint.
fn name_of(line: &str) -> &str {
    line.rsplit_once(' ').map_or(line, |(name, _)| name)
}

impl Tape {
    fn charge(&mut self, scale: Option<u32>) -> u32 {
        self.calls += 1;
        let computed = core::mem::take(&mut self.computed);
        self.last = Duration::ZERO;
        let is_known = scale.is_none() || self.calls <= self.known;
        match self.charges.get(self.next) {
            Some(&(call, units)) if is_known && call == self.calls => {
                self.next += 1;
                return units;
            }
            _ if is_known => return 0,
            _ => {}
        }
        let thousandths = u128::from(scale.unwrap_or_default());
        self.rest += computed.as_nanos() * thousandths / 1_000;
        let units = (self.rest / CHARGE_UNIT.as_nanos()).min(UNITS_MAX);
        self.rest %= CHARGE_UNIT.as_nanos();
        let units = u32::try_from(units).unwrap_or(u32::MAX);
        if units > 0 {
            self.charges.push((self.calls, units));
            self.next = self.charges.len();
        }
        units
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);
    const NONE: Duration = Duration::ZERO;

    /// By hand, at 20 times as slow: 1.01 ms less the free 10 us are 20 ms, 15 us are 0.1 ms; the
    /// rest below a unit is charged later. A second run charges the same, whatever it measures.
    #[test]
    fn a_charge_is_measured_once() {
        let mut first = Computing::new(Cpu::Scale(20_000), None).expect("measures");
        let free = FREE;
        let computed = [MS + free, free, Duration::from_nanos(2_500) + free];
        let mut seen = Vec::new();
        for round in 0..6 {
            first.used(1, computed[round % 3]);
            seen.push(first.charge(1, 7));
        }
        let unit = CHARGE_UNIT;
        assert_eq!(seen, [20 * MS, NONE, NONE, 20 * MS, NONE, unit]);
        let spec = first.spec();
        assert_eq!(spec.charges[1].to_string(), "1:200 3:200 2:1");
        let mut second = Computing::new(Cpu::OfCase, Some(&spec)).expect("recorded");
        assert!(!second.measures());
        let again: Vec<Duration> = (0..6).map(|_| second.charge(1, 7)).collect();
        assert_eq!(again, seen);
        assert!(second.difference().expect("recorded").is_ok());
        // One call more, or another call, makes a different program.
        second.charge(1, 7);
        assert!(second.difference().expect("recorded").is_err());
        let mut other = Computing::new(Cpu::OfCase, Some(&spec)).expect("recorded");
        for call in 0..6 {
            other.charge(1, 7 + i64::from(call == 3));
        }
        assert!(other.difference().expect("recorded").is_err());
    }

    /// A run that a debugger starts again measures only calls that it does not know yet.
    #[test]
    fn a_run_again_measures_what_is_new() {
        let mut run = Computing::new(Cpu::Scale(1_000), None).expect("measures");
        run.used(0, MS + FREE);
        assert_eq!(run.charge(0, 1), MS);
        assert_eq!(run.charge(0, 1), NONE);
        let mut run = run.again();
        for expected in [MS, NONE, 3 * MS] {
            run.used(0, 3 * MS + FREE);
            assert_eq!(run.charge(0, 1), expected);
        }
        assert_eq!(run.spec().charges[0].to_string(), "1:10 2:30");
        assert!(Computing::new(Cpu::OfCase, None).is_none());
        // The files that it runs are seen anew.
        let mut run = Computing::new(Cpu::Scale(1_000), None).expect("measures");
        run.runs(vec!["robot 0123".to_owned()]);
        assert_eq!(run.spec().programs, ["robot 0123"]);
        assert!(run.again().spec().programs.is_empty());
    }

    /// By hand: 3 ms before a check that found no loop, 1 s in a loop that waits, 2 ms after it.
    #[test]
    fn a_wait_is_free() {
        let mut run = Computing::new(Cpu::Scale(1_000), None).expect("measures");
        run.used(0, 3 * MS + FREE);
        run.used(0, 1000 * MS + FREE);
        run.forgive(0);
        run.forgive(0);
        run.used(0, 2 * MS + FREE);
        assert_eq!(run.charge(0, 1), 5 * MS);
        assert_eq!(run.used, 5 * MS);
        // A charge is never taken back.
        run.forgive(0);
        assert_eq!(run.used, 5 * MS);
    }

    /// The same calls of a different file are no repetition. A case without names of files is
    /// compared by its calls.
    #[test]
    fn a_changed_program_is_named() {
        let files = |print: &str| vec![format!("sh {:016x}", 5), format!("my planner {print}")];
        let mut first = Computing::new(Cpu::Scale(1_000), None).expect("measures");
        first.runs(files("1"));
        let mut spec = first.spec();
        assert_eq!(spec.programs, ["my planner 1", "sh 0000000000000005"]);
        let difference = |spec: &ComputingSpec, print: &str| {
            let mut second = Computing::new(Cpu::OfCase, Some(spec)).expect("recorded");
            second.runs(files(print));
            second.difference().expect("recorded")
        };
        assert!(difference(&spec, "1").is_ok());
        let error = difference(&spec, "2").expect_err("another file");
        assert!(error.starts_with("my planner is another file"), "{error}");
        spec.programs.clear();
        assert!(difference(&spec, "2").is_ok());
    }

    /// At 1 the first 10 us are free; a unit is 100 us, and 36,000,000 of them, an hour, are the
    /// most. By hand: 250 us less 10 us at half speed are 120 us, of which 20 us wait.
    #[test]
    fn a_charge_has_whole_units() {
        let mut run = Computing::new(Cpu::Scale(500), None).expect("measures");
        assert!(run.measures());
        let us = Duration::from_micros;
        run.used(0, us(250));
        assert_eq!((run.charge(0, 1), run.charged), (us(100), us(100)));
        run.used(0, us(170));
        assert_eq!((run.charge(0, 1), run.charged), (us(100), us(200)));
        assert_eq!(run.used, us(400));
        run.used(0, us(9));
        run.used(0, us(10));
        assert_eq!((run.used, run.charge(0, 1)), (us(400), NONE));
        run.used(0, Duration::from_secs(1 << 40));
        assert_eq!(run.charge(0, 1), Duration::from_secs(3_600));
        assert_eq!(run.spec().charges[0].to_string(), "1:1 1:1 2:36000000");
        assert_eq!(run.spec().scale, 0.5);
    }

    /// FNV-1a: each word changes the sum and is multiplied by 0x100000001B3.
    #[test]
    fn calls_have_a_fingerprint() {
        let mut run = Computing::new(Cpu::Scale(1_000), None).expect("measures");
        assert_eq!(run.spec().fingerprint, "cbf29ce484222325");
        run.charge(1, 2);
        let prime = 0x100_0000_01B3_u64;
        let first = (0xCBF2_9CE4_8422_2325_u64 ^ 1).wrapping_mul(prime);
        let expected = format!("{:016x}", (first ^ 2).wrapping_mul(prime));
        let spec = run.spec();
        assert_eq!(
            (spec.fingerprint, spec.calls, spec.scale),
            (expected, 1, 1.0)
        );
        let recorded = ComputingSpec {
            scale: 2.5,
            ..run.spec()
        };
        let again = Computing::new(Cpu::OfCase, Some(&recorded)).expect("recorded");
        assert_eq!(again.spec().scale, 2.5);
    }

    /// A run that has come less far has made only the charges up to there.
    #[test]
    fn the_charges_of_a_run_are_those_that_it_made() {
        let mut run = Computing::new(Cpu::Scale(1_000), None).expect("measures");
        for _ in 0..3 {
            run.used(2, MS + FREE);
            run.charge(2, 1);
        }
        let spec = run.spec();
        let texts: Vec<String> = spec.charges.iter().map(ToString::to_string).collect();
        assert_eq!(texts, ["", "", "1:10 1:10 1:10"]);
        let mut again = Computing::new(Cpu::OfCase, Some(&spec)).expect("recorded");
        again.charge(2, 1);
        again.charge(2, 1);
        assert_eq!(again.spec().charges[2].to_string(), "1:10 1:10");
        let mut again = run.again();
        assert_eq!(
            (again.used, again.charged, again.spec().calls),
            (NONE, NONE, 0)
        );
        assert_eq!(again.spec().fingerprint, "cbf29ce484222325");
        assert_eq!(
            (again.charge(2, 1), again.charge(2, 1), again.charge(2, 1)),
            (MS, MS, MS)
        );
        assert_eq!((again.charge(2, 1), again.charged), (NONE, 3 * MS));
        // Twice again: what is known stays known.
        let mut third = again.again().again();
        third.used(2, 9 * MS + FREE);
        assert_eq!(third.charge(2, 1), MS);
    }

    #[test]
    fn a_run_with_a_record_is_checked() {
        let mut first = Computing::new(Cpu::Scale(1_000), None).expect("measures");
        assert!(first.check().is_none() && first.difference().is_none());
        first.charge(0, 1);
        let spec = first.spec();
        let mut second = Computing::new(Cpu::OfCase, Some(&spec)).expect("recorded");
        let check = second.check().expect("recorded");
        assert_eq!(check.name, "computes-as-recorded");
        assert_eq!(check.status, engine::run::check::Status::Fail);
        assert!(
            check
                .detail
                .starts_with("0 calls, the case has 1, perhaps other ones"),
            "{}",
            check.detail
        );
        second.charge(0, 1);
        let check = second.check().expect("recorded");
        assert_eq!(check.status, engine::run::check::Status::Pass);
        assert_eq!(check.detail, "1 calls as in the case");
    }

    #[test]
    fn a_scenario_without_a_record_has_no_price_of_its_own() {
        let (scenario, _) = Scenario::from_text(
            "schema = 1\nname = \"x\"\nrobot = \"none\"\nduration = \"1s\"\n\
             device.x.text = { baud = 9600 }\n",
        )
        .expect("valid");
        assert!(Computing::of(None, &scenario).expect("no price").is_none());
        let measured = Computing::of(Some(Cpu::Scale(1_000)), &scenario).expect("measured");
        assert!(measured.expect("has one").measures());
        assert!(matches!(
            Computing::of(Some(Cpu::OfCase), &scenario),
            Err(GuestError::NoComputing)
        ));
        assert_eq!(
            (name_of("my planner 12ab"), name_of("sh")),
            ("my planner", "sh")
        );
    }
}
