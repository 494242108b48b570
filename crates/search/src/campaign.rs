//! Campaigns: many runs of some scenarios, one for each seed, on all processors and on many
//! machines. Results are grouped by cause and compared with an earlier campaign.
//!
//! A shard is stateless: it executes every n-th run of the list, appends each result to a file of
//! lines, and continues where it stopped. Merging sorts the shards, so the result depends neither
//! on the number of shards nor on the order in which runs ended.

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
pub use judge::{Record, run, run_foreign, run_from};
pub use judge::{without_figures, words_of_panic};
pub use merge::{Demand, Merged, merge, summarise};
pub use page::{live_page, page};
pub use plan::{CampaignPlan, Shard, ShardChoice};
pub(crate) use runs::Run;
pub use store::{Failures, Store};
