//! A table of what runs found of their training cameras.

use std::fmt::Write as _;

use super::{
    html::{self, Escaped},
    load::Run,
};

/// A row for each of `cameras` and a column for each run, which says below its name what it holds; a cell is what `cell` makes of them.
pub(super) fn table<'a>(
    runs: &[&Run],
    holds: &str,
    cameras: impl Iterator<Item = &'a String>,
    mut cell: impl FnMut(&Run, &str) -> Option<String>,
) -> String {
    let mut head = String::from("<tr><th>Camera</th>");
    for run in runs {
        let _ = write!(head, "<th>{} <small>{holds}</small></th>", Escaped(&run.label));
    }
    head += "</tr>";
    let mut rows = String::new();
    for camera in cameras {
        let _ = write!(rows, "<tr><th>{}</th>", Escaped(camera));
        for run in runs {
            let _ = write!(rows, "<td>{}</td>", cell(run, camera).as_deref().unwrap_or("–"));
        }
        rows += "</tr>\n";
    }
    html::table("dense", &head, &rows)
}
