//! The page and its scenes as one file, which needs no server and no network.

use std::collections::BTreeMap;

use erfgs_page::picture::{base64, data_uri};
use serde::Serialize;

use crate::{server::About, texts};

/// A scene to be put into a page.
#[derive(Clone, Copy, Debug)]
pub struct Packed<'a> {
    /// What it is called.
    pub name: &'a str,
    /// The scene.
    pub scene: &'a crate::SceneFile,
    /// Which window of a take it is of, where all scenes of the page are such.
    pub window: Option<&'a crate::Window>,
}

#[derive(Serialize)]
struct Own {
    texts: BTreeMap<String, &'static str>,
    models: Vec<About>,
    /// Of how many pieces each scene is.
    pieces: Vec<usize>,
}

/// Bytes of a piece of a scene; each is used before the next has come.
const PIECE: usize = 96 << 10;

/// A page that shows `scenes` (one, two side by side, or the windows of a take one after another) from a disk.
///
/// # Errors
/// If the scenes cannot be named, which has no cause in them.
pub fn page(scenes: &[Packed<'_>]) -> serde_json::Result<String> {
    let models =
        scenes.iter().map(|packed| About::of(packed.name, packed.scene, packed.window, false, false)).collect();
    let compressed: Vec<Vec<u8>> = scenes.iter().map(|packed| packed.scene.compressed()).collect();
    let pieces = compressed.iter().map(|bytes| bytes.chunks(PIECE).len()).collect();
    let own = serde_json::to_string(&Own { texts: texts::kernels().collect(), models, pieces })?;
    // Modules of a page of one file have no addresses: they are called by names, which a map leads to their texts.
    let named = |text: &str| text.replace("from './", "from 'erfgs/");
    let modules: BTreeMap<String, String> = texts::scripts()
        .map(|(name, text)| (format!("erfgs/{name}"), data_uri("text/javascript", named(text).as_bytes())))
        .collect();
    let map = serde_json::to_string(&BTreeMap::from([("imports", modules)]))?;
    let style = texts::file("style.css").map_or("", |(_, text)| text);
    let mut scripts = String::new();
    scripts.push_str(OLD_BROWSER);
    scripts.push_str(&format!("<script>globalThis.ERFGS = {};</script>\n", within_script(&own)));
    scripts.push_str(&format!("<script type=\"importmap\">{}</script>\n", within_script(&map)));
    // Run before the rest of the page is there.
    scripts.push_str("<script type=\"module\" async>import 'erfgs/main.js';</script>\n");
    for (index, bytes) in compressed.iter().enumerate() {
        for (piece, bytes) in bytes.chunks(PIECE).enumerate() {
            let text = base64(bytes);
            scripts.push_str(&format!("<script type=\"text/plain\" id=\"scene{index}.{piece}\">{text}</script>\n"));
        }
    }
    Ok(texts::INDEX
        .replace("<link rel=\"stylesheet\" href=\"file/style.css\">", &format!("<style>\n{style}</style>"))
        .replace("<script type=\"module\" src=\"file/js/main.js\"></script>", &scripts))
}

/// What is said by browsers that do not know how such a page is called: they have no WebGPU either.
const OLD_BROWSER: &str = "<script>if (!(HTMLScriptElement.supports && HTMLScriptElement.supports('importmap'))) { \
    var trouble = document.getElementById('trouble'); trouble.hidden = false; \
    trouble.textContent = 'This browser is too old for this page: take a current Chrome, Edge, Safari or Firefox.'; }</script>\n";

/// JSON that neither ends the script that it stands in nor begins another, whatever names it holds: `<` is in strings alone.
fn within_script(json: &str) -> String {
    json.replace('<', "\\u003c")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_of_one_file_asks_for_nothing_and_no_name_ends_its_scripts() {
        let scene = crate::SceneFile::for_tests();
        let page =
            page(&[Packed { name: "</script><script>alert(1)</script><!--", scene: &scene, window: None }]).unwrap();
        assert!(!page.contains("src=\"") && !page.contains("href=\"file"), "something is asked for");
        assert!(!page.contains("<script>alert"));
        assert_eq!(page.matches("<script").count(), page.matches("</script>").count());
        assert!(page.contains("from 'erfgs/") || page.contains("erfgs/main.js"));
        // Each module that is imported is there.
        for (_, text) in texts::scripts() {
            for import in text.split("from './").skip(1) {
                let name = import.split('\'').next().unwrap();
                assert!(texts::scripts().any(|(own, _)| own == name), "{name}");
            }
        }
    }
}
