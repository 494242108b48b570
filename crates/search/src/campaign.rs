//! Many runs of some scenarios, one for each seed, on all processors and on many machines: what
//! they came to, grouped by cause, and what has changed since an earlier campaign.
//!
//! A shard is stateless: it takes every n-th run of the list, keeps what each came to in a file of
//! lines, and continues where it stopped. Shards are merged by sorting, so that it makes no
//! difference how a campaign was cut, or in which order the runs ended.

pub mod array;
mod compare;
pub(crate) mod judge;
mod lines;
mod lock;
mod manner;
mod merge;
mod page;
mod plan;
mod runs;
mod store;
mod strip;

pub use compare::{Change, Comparison, compare};
pub use judge::{Record, run, run_foreign};
pub use judge::{without_figures, words_of_panic};
pub use merge::{Merged, merge, summarise};
pub use page::{live_page, page};
pub use plan::{CampaignPlan, Shard, ShardChoice};
pub(crate) use runs::Run;
pub use store::{Failures, Store};
