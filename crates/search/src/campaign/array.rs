//! The shard of a queue task, from the environment variables that the queue sets.
//!
//! The number of shards cannot be read reliably: for a task that is resubmitted alone, the queue
//! sets the size of its array to one.

use core::num::NonZeroUsize;

use super::Shard;

/// The variable in which a queue stores the task number, and the number of the first task.
struct Variable {
    name: &'static str,
    first: usize,
    /// The variable's value in a job without an array.
    without: &'static str,
}

const fn counted(name: &'static str, first: usize, without: &'static str) -> Variable {
    Variable {
        name,
        first,
        without,
    }
}

/// Set by the script that starts the shards; overrides all others.
const OWN: Variable = counted("HILRIG_SHARD", 0, "");

/// From the manuals: sbatch(1), PBS Professional and Torque, Grid Engine's qsub(1), LSF's bsub, AWS
/// Batch array jobs, indexed jobs of Kubernetes, `parallel` of GitLab CI. GitHub sets no variable.
const QUEUES: [Variable; 8] = [
    counted("SLURM_ARRAY_TASK_ID", 0, ""),
    counted("JOB_COMPLETION_INDEX", 0, ""),
    counted("PBS_ARRAY_INDEX", 0, ""),
    counted("PBS_ARRAYID", 0, ""),
    counted("SGE_TASK_ID", 1, "undefined"),
    counted("LSB_JOBINDEX", 1, "0"),
    counted("AWS_BATCH_JOB_ARRAY_INDEX", 0, ""),
    counted("CI_NODE_INDEX", 1, ""),
];

/// The shard of this task, out of `of`, from the variables that `read` reads.
///
/// # Errors
/// If no queue or more than one queue sets a task number, or if the number exceeds the number of
/// shards.
pub fn shard(of: NonZeroUsize, read: impl Fn(&str) -> Option<String>) -> Result<Shard, String> {
    let told = |variable: &'static Variable| {
        let value = read(variable.name)?;
        (!value.is_empty() && value != variable.without).then_some((variable, value))
    };
    let (variable, value) = match told(&OWN) {
        Some(own) => own,
        None => {
            let mut queues = QUEUES.iter().filter_map(told);
            let Some(first) = queues.next() else {
                return Err(no_queue());
            };
            if let Some((other, _)) = queues.next() {
                let (one, other) = (first.0.name, other.name);
                return Err(format!(
                    "{one} and {other} are both set, expected {}",
                    OWN.name
                ));
            }
            first
        }
    };
    let (first, of) = (variable.first, of.get());
    let last = first.saturating_add(of - 1);
    let number: Option<usize> = value.parse().ok();
    let index = number.and_then(|number| number.checked_sub(first));
    let index = index.filter(|&index| index < of).ok_or_else(|| {
        let name = variable.name;
        format!("{name} is {value:?}, expected {first} to {last} of {of} shards")
    })?;
    Ok(Shard { index, of })
}

fn no_queue() -> String {
    let names: Vec<&str> = QUEUES.iter().map(|variable| variable.name).collect();
    let names = names.join(", ");
    format!(
        "no queue has set the number of this task, expected {} or one of {names}",
        OWN.name
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shard, out of four, of a task with these variables only.
    fn of_four(set: &[(&str, &str)]) -> Result<usize, String> {
        let read = |name: &str| {
            let mut set = set.iter();
            let found = set.find(|(other, _)| *other == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        let of = NonZeroUsize::new(4).expect("not 0");
        shard(of, read).map(|shard| {
            assert_eq!(shard.of, 4);
            shard.index
        })
    }

    /// The last of four tasks: 3 for queues that count from 0, 4 for queues that count from 1.
    #[test]
    fn each_queue_tells_the_number_in_its_own_way() {
        for name in [
            "HILRIG_SHARD",
            "SLURM_ARRAY_TASK_ID",
            "JOB_COMPLETION_INDEX",
            "PBS_ARRAY_INDEX",
            "PBS_ARRAYID",
            "AWS_BATCH_JOB_ARRAY_INDEX",
        ] {
            assert_eq!(of_four(&[(name, "3")]), Ok(3), "{name}");
            assert_eq!(of_four(&[(name, "0")]), Ok(0), "{name}");
            assert!(of_four(&[(name, "4")]).is_err(), "{name}");
        }
        for name in ["SGE_TASK_ID", "LSB_JOBINDEX", "CI_NODE_INDEX"] {
            assert_eq!(of_four(&[(name, "4")]), Ok(3), "{name}");
            assert_eq!(of_four(&[(name, "1")]), Ok(0), "{name}");
            assert!(of_four(&[(name, "5")]).is_err(), "{name}");
            assert!(of_four(&[(name, "0")]).is_err(), "{name}");
        }
    }

    /// A task that is resubmitted alone keeps its number 3, although its array now has one task.
    #[test]
    fn a_task_submitted_again_alone_keeps_its_number() {
        let again = [
            ("SLURM_ARRAY_TASK_ID", "2"),
            ("SLURM_ARRAY_TASK_COUNT", "1"),
        ];
        assert_eq!(of_four(&again), Ok(2));
    }

    /// Grid Engine and LSF set their variable for jobs without an array as well.
    #[test]
    fn a_job_without_an_array_has_no_number() {
        let alone = [("SGE_TASK_ID", "undefined"), ("LSB_JOBINDEX", "0")];
        let error = of_four(&alone).expect_err("no variable is set");
        assert!(error.contains("HILRIG_SHARD"), "{error}");
    }

    /// A GitLab runner in a Kubernetes pod: the two variables disagree, and only `HILRIG_SHARD`
    /// decides.
    #[test]
    fn of_two_queues_neither_is_guessed() {
        let two = [("JOB_COMPLETION_INDEX", "1"), ("CI_NODE_INDEX", "3")];
        let error = of_four(&two).expect_err("two numbers");
        assert!(
            error.contains("JOB_COMPLETION_INDEX and CI_NODE_INDEX"),
            "{error}"
        );
        assert_eq!(of_four(&[two[0], two[1], ("HILRIG_SHARD", "0")]), Ok(0));
    }

    #[test]
    fn words_are_no_number() {
        let error = of_four(&[("PBS_ARRAYID", "two")]).expect_err("no number");
        assert_eq!(error, "PBS_ARRAYID is \"two\", expected 0 to 3 of 4 shards");
    }
}
