//! `--ui`: a page for a run in real time.

use clap::Args;
use protocols::Instant;

use super::CliError;
use crate::run::Run;
#[cfg(feature = "ui")]
use {
    super::ui::ListenArgs,
    ::ui::{Desk, Hub, Server},
    std::sync::Arc,
};

/// The option for the page.
#[derive(Debug, Args)]
pub(super) struct ShowArgs {
    /// Show the run on a page in the browser, at this TCP port of this machine or any free one
    #[cfg(feature = "ui")]
    #[arg(long = "ui", value_name = "PORT", num_args = 0..=1, require_equals = true,
          default_missing_value = "0")]
    port: Option<u16>,
}

impl ShowArgs {
    /// Whether a page is wanted.
    pub(super) const fn is_wanted(&self) -> bool {
        #[cfg(feature = "ui")]
        return self.port.is_some();
        #[cfg(not(feature = "ui"))]
        false
    }

    /// Starts the page, if one is wanted, and prints its address.
    pub(super) fn start(&self) -> Result<Show, CliError> {
        #[cfg(feature = "ui")]
        if let Some(port) = self.port {
            let hub = Hub::new();
            let server = ListenArgs::local(port).serve("--ui", Arc::clone(&hub))?;
            return Ok(Show(Some(Page {
                hub,
                _server: server,
                desk: None,
                runs: 0,
            })));
        }
        Ok(Show::default())
    }
}

/// The page, if there is one.
#[derive(Default)]
pub(super) struct Show(#[cfg(feature = "ui")] Option<Page>);

#[cfg(feature = "ui")]
struct Page {
    hub: Arc<Hub>,
    _server: Server,
    desk: Option<Desk>,
    runs: u64,
}

#[cfg(feature = "ui")]
impl Show {
    /// Shows another run on the page.
    pub(super) fn begin(&mut self, run: &mut Run) {
        if let Some(page) = &mut self.0 {
            page.runs += 1;
            page.desk = Some(Desk::new(run, Arc::clone(&page.hub), page.runs));
        }
    }

    /// Applies the page's requests to the run, and shows it at the wall clock's `now`.
    pub(super) fn turn(&mut self, run: &mut Run, now: Instant) {
        if let Some(desk) = self.0.as_mut().and_then(|page| page.desk.as_mut()) {
            desk.turn(run, now);
        }
    }

    /// Whether a user changed the run.
    pub(super) fn has_changed_it(&self) -> bool {
        let desk = self.0.as_ref().and_then(|page| page.desk.as_ref());
        desk.is_some_and(|desk| desk.changes() > 0)
    }
}

#[cfg(not(feature = "ui"))]
impl Show {
    /// Always `None`: this build has no page.
    pub(super) fn begin(&mut self, _run: &mut Run) {}

    /// Does nothing: this build has no page.
    pub(super) fn turn(&mut self, _run: &mut Run, _now: Instant) {}

    /// Does nothing: this build has no page.
    pub(super) fn has_changed_it(&self) -> bool {
        false
    }
}
