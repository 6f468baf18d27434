//! The view of the runs, in a frame of the page.

use super::{
    html::{self, Escaped},
    load::Scene,
};

/// A frame that holds the page `view`; it loads when it is opened.
pub(super) fn section(scene: &Scene, view: Option<&str>) -> String {
    let Some(view) = view else { return String::new() };
    let body = format!(
        "<details><summary>Open the view (the browser draws it by WebGPU)</summary>\n\
         <iframe class=\"view\" title=\"The reconstruction, at any time from any place\" loading=\"lazy\" srcdoc=\"{}\"></iframe>\n\
         </details>\n",
        Escaped(view)
    );
    html::section(&scene.prefix, "walk", "Walk around in it", &body)
}
