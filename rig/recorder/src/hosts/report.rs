//! The report of another host's live page, and what the leading host's page shows of it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::{
    Status,
    live::{Guidance, Look},
};

/// The numbers of a live page.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct HostReport {
    pub status: Status,
    #[serde(default)]
    pub looks: Vec<Look>,
    #[serde(default)]
    pub guidance: Vec<Guidance>,
    /// Where its recordings go.
    pub folder: PathBuf,
}

/// A host on the page of the one that leads.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct HostView {
    /// Its name and port.
    pub name: String,
    /// Its own page, without the token.
    pub page: String,
    /// Why it is not heard of now, if it is not.
    pub lost: Option<String>,
    /// Its last report.
    #[serde(flatten)]
    pub(super) report: Option<HostReport>,
}

impl HostView {
    /// The state of its rig when it was heard of last.
    #[must_use]
    pub fn status(&self) -> Option<&Status> {
        self.report.as_ref().map(|report| &report.status)
    }
}
