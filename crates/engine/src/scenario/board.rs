//! The board of a slave as data: its reset source, and the modem lines that it sets.

use emulators::board::{BoardConfig, HostLine, PIN_LINE, RESET_PIN, ResetOn};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::Spanned;

use super::device::PortInfo;
use super::{ScenarioError, Source, Span};
use crate::rig::LinkKind;

/// Event that resets a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ResetSpec {
    /// The host's DTR turns on, as with an Arduino: the link `NAME-dtr`, one byte per level. Every
    /// opening of the port turns it on.
    Dtr,
    /// The same with RTS, as behind some adapter cables: the link `NAME-rts`.
    Rts,
    /// A break on the line.
    Break,
}

/// Modem lines that a board sets. Each line follows a value of the device, given by its name: the
/// line is on while the value is not 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RaisesSpec {
    /// CTS, the link `NAME-cts`; while it is off, a client with RTS/CTS flow control sends nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub cts: Option<Spanned<String>>,
    /// DSR, the link `NAME-dsr`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub dsr: Option<Spanned<String>>,
    /// DCD, the link `NAME-dcd`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub dcd: Option<Spanned<String>>,
    /// RI, the link `NAME-ri`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub ri: Option<Spanned<String>>,
}

/// The board settings of a description.
#[derive(Clone, Copy, Debug)]
pub(super) struct BoardKeys<'a> {
    pub(super) resets_on: Option<ResetSpec>,
    pub(super) boot: Option<Span>,
    pub(super) raises: Option<&'a RaisesSpec>,
}

impl RaisesSpec {
    fn rows(&self) -> impl Iterator<Item = (HostLine, &'static str, &Spanned<String>)> {
        let rows = [
            (HostLine::Cts, "cts", &self.cts),
            (HostLine::Dsr, "dsr", &self.dsr),
            (HostLine::Dcd, "dcd", &self.dcd),
            (HostLine::Ri, "ri", &self.ri),
        ];
        let rows = rows.into_iter();
        rows.filter_map(|(line, key, name)| Some((line, key, name.as_ref()?)))
    }
}

impl BoardKeys<'_> {
    /// The board of a device at `key` whose values are called `names`.
    pub(super) fn config(
        self,
        names: &[&str],
        key: &str,
        source: &Source,
    ) -> Result<BoardConfig, ScenarioError> {
        let mut raises = Vec::new();
        for (line, pin, name) in self.raises.iter().flat_map(|raises| raises.rows()) {
            if !names.contains(&name.get_ref().as_str()) {
                return Err(source.unknown(&format!("{key}.raises.{pin}"), name, names));
            }
            raises.push((line, name.get_ref().clone()));
        }
        Ok(BoardConfig {
            resets_on: self.resets_on.map(|on| match on {
                ResetSpec::Dtr => ResetOn::Dtr,
                ResetSpec::Rts => ResetOn::Rts,
                ResetSpec::Break => ResetOn::Break,
            }),
            boot: self.boot.map(|boot| boot.0),
            raises,
        })
    }

    /// The pins of the board, without the serial port.
    pub(super) fn ports(self) -> Vec<PortInfo> {
        let pin = |name, port, connect| {
            let info = PortInfo::uart(name, port, PIN_LINE, connect);
            info.optional().on(LinkKind::Pin).at_any_rate(PIN_LINE)
        };
        let reset = match self.resets_on {
            Some(ResetSpec::Dtr) => Some("dtr"),
            Some(ResetSpec::Rts) => Some("rts"),
            Some(ResetSpec::Break) | None => None,
        };
        let said = "the host's line that resets the board, a level a byte, optional";
        let reset = reset.map(|name| pin(name, RESET_PIN, said));
        let rows = self.raises.iter().flat_map(|raises| raises.rows());
        let said = "a modem line that the board sets, a level a byte, optional";
        let raised = rows.map(|(line, name, _)| pin(name, line.port(), said));
        reset.into_iter().chain(raised).collect()
    }
}
