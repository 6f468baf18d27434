//! What of a job's files is damaged. All of them are written whole or not at all, so that a program that is killed damages none: a disk did,
//! or somebody. Nothing is trained over such a run until its user decides.

use erfgs_run::{RunError, RunFolder};

use super::{
    manifest::{Job, Manifest},
    work::Record,
};

/// Which file is damaged, if one is, and what to do.
pub(super) fn of(manifest: &Manifest, job: &Job) -> Option<String> {
    let record = Record::of(manifest, job).err().map(|error| error.to_string());
    record.or_else(|| of_run(&manifest.run(job)))
}

fn of_run(run: &RunFolder) -> Option<String> {
    let decide = |what: String| {
        let folder = run.root().display();
        Some(format!("{what}; or put the file back, or remove {folder} to train this run again"))
    };
    let info = match run.read_info() {
        Err(RunError::Missing { .. }) => None,
        Err(error) => return decide(error.to_string()),
        Ok(info) => Some(info),
    };
    let is_finished = info.is_some_and(|info| info.finished);
    match run.read_curve() {
        Err(RunError::Missing { .. }) if !is_finished => None,
        Err(error) => decide(error.to_string()),
        // A line that a killed training left half is dropped when the run goes on.
        Ok(curve) => curve.cut.filter(|_| is_finished).and_then(|cut| {
            let file = run.curve_file();
            decide(format!("'{}' is damaged: {cut}, though the training is finished", file.display()))
        }),
    }
}
