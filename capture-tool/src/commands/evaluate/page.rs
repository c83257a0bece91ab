//! One self-contained page: pictures as data URIs, charts as inline SVG, nothing from the network.

use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use relume_core::Error;
use relume_core::image::Image;

use super::pictures;

const STYLE: &str = "\
:root { color-scheme: light dark; }
body { font: 15px/1.45 system-ui, sans-serif; max-width: 1200px; margin: 2em auto; padding: 0 1em; }
table { border-collapse: collapse; margin: 1em 0; }
th, td { padding: 0.2em 0.8em; text-align: right; border-bottom: 1px solid #8885; font-variant-numeric: tabular-nums; }
th:first-child, td:first-child { text-align: left; }
td.best { font-weight: bold; }
.row { display: flex; flex-wrap: wrap; gap: 12px; }
figure { margin: 0; width: 270px; }
figure img { width: 100%; display: block; background: #000; }
figcaption { font-size: 13px; }
.wide { width: 372px; }
.chart { background: #fff; overflow-x: auto; }
.chart svg { max-width: 100%; height: auto; }
p.note { opacity: 0.8; max-width: 70em; }";

/// A picture as a file, and as the page shows it.
pub struct Figure {
    name: String,
    png: Vec<u8>,
    shown: String,
}

impl Figure {
    /// A picture times a gain, under the name of a file.
    ///
    /// # Errors
    /// A picture that is not finite.
    pub fn new(name: String, picture: &Image, gain: f32) -> anyhow::Result<Self> {
        let (png, small) = (pictures::png(picture, gain)?, pictures::small(picture));
        let shown = if small.size() == picture.size() {
            STANDARD.encode(&png)
        } else {
            STANDARD.encode(pictures::png(&small, gain)?)
        };
        Ok(Self { name, png, shown })
    }

    /// Name and contents of the file.
    pub fn file(&self) -> (&str, &[u8]) {
        (&self.name, &self.png)
    }

    /// The picture with a caption.
    pub fn show(&self, class: &str, caption: Markup) -> Markup {
        html! {
            figure class=(class) {
                img src=(format!("data:image/png;base64,{}", self.shown)) alt=(self.name);
                figcaption { (caption) }
            }
        }
    }
}

/// Names of methods and wavelets such as 5/3 become names of files.
pub fn file_name(id: &str) -> String {
    id.replace('/', "-")
}

/// A chart as it stands on the page.
pub fn chart(svg: &str) -> Markup {
    html! { div.chart { (PreEscaped(svg)) } }
}

/// The whole page under a title.
pub fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                (body)
            }
        }
    };
    page.into_string()
}

/// Puts files into a folder.
///
/// # Errors
/// A full disk.
pub fn put<'a>(folder: &Path, files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> relume_core::Result<()> {
    for (name, bytes) in files {
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(|source| Error::io("write", &path, source))?;
    }
    Ok(())
}
