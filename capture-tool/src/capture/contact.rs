//! The live contact sheet: small pictures with their numbers, a page a hundred photographs.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use relume_core::files::write_whole;
use relume_core::image::{Encoding, Image, encode_png8, read, srgb};
use relume_core::{Error, Result};

use crate::drawing::{Canvas, LINE};

/// Pictures in a row, and rows of a page.
const GRID: (usize, usize) = (10, 10);
/// Size of a cell's picture; small where the loop is tested by the thousand, and drawing would be most of the work.
const CELL: (usize, usize) = if cfg!(test) { (28, 12) } else { (112, 84) };
/// Height of a row: pictures, and a line of text.
const ROW: usize = CELL.1 + LINE;
/// Mean code of a picture that shows much.
const SHOWS_MOST: f32 = 0.25;
/// A page is written at most this often.
const PAUSE: Duration = Duration::from_secs(2);

/// The page that is being filled. Memory: one page, 1.4 million pixels.
pub struct ContactSheet {
    folder: PathBuf,
    page: u64,
    canvas: Canvas,
    /// Rows of the page with a picture in them: the file is no taller.
    rows: usize,
    changed: bool,
    written: Option<Instant>,
}

impl ContactSheet {
    /// In `contact-sheets/` of a session.
    ///
    /// # Errors
    /// The disk's.
    pub fn new(root: &Path) -> Result<Self> {
        let folder = root.join("contact-sheets");
        fs::create_dir_all(&folder).map_err(|source| Error::io("create", &folder, source))?;
        Ok(Self { folder, page: 0, canvas: blank(), rows: 0, changed: false, written: None })
    }

    /// Adds photograph `number` as codes (0 to 1), with a word on what it shows.
    ///
    /// # Errors
    /// The disk's, where a page is full.
    pub fn add(&mut self, number: u64, codes: &Image, label: &str) -> Result<()> {
        let per_page = (GRID.0 * GRID.1) as u64;
        let page = (number - 1) / per_page + 1;
        if page != self.page {
            self.flush()?;
            self.page = page;
            (self.canvas, self.rows) = self.begun(page);
        }
        let at = ((number - 1) % per_page) as usize;
        self.rows = self.rows.max(at / GRID.0 + 1);
        let corner = ((at % GRID.0) * CELL.0, (at / GRID.0) * ROW);
        let (w, h) = codes.size();
        // Fits the cell, keeps its shape.
        let scale = (w as f64 / (CELL.0 - 4) as f64).max(h as f64 / CELL.1 as f64);
        let size = ((w as f64 / scale) as usize, (h as f64 / scale) as usize);
        self.canvas.fill(corner, size, |x, y| {
            let pixel = codes.pixel(((x as f64 * scale) as usize).min(w - 1), ((y as f64 * scale) as usize).min(h - 1));
            // Codes go to the sheet as they are.
            Some([0, 1, 2].map(|c| srgb::decode(pixel[c.min(codes.channels() - 1)])))
        });
        let room = CELL.0 / Canvas::width_of("0") - 1;
        let text: String = format!("{number} {label}").chars().take(room).collect();
        self.canvas.text((corner.0, corner.1 + CELL.1 + 2), &text);
        self.changed = true;
        if self.written.is_none_or(|at| at.elapsed() >= PAUSE) { self.flush() } else { Ok(()) }
    }

    /// A page as an earlier run left it, or an empty one, with its rows.
    fn begun(&self, page: u64) -> (Canvas, usize) {
        let mut canvas = blank();
        let there = read(&self.path(page), Encoding::Srgb).ok().map(Image::into_rgb);
        let Some(there) = there.filter(|picture| {
            picture.width() == GRID.0 * CELL.0
                && picture.height().is_multiple_of(ROW)
                && picture.height() <= GRID.1 * ROW
        }) else {
            return (canvas, 0);
        };
        canvas.fill((0, 0), there.size(), |x, y| {
            let pixel = there.pixel(x, y);
            Some([pixel[0], pixel[1], pixel[2]])
        });
        (canvas, there.height() / ROW)
    }

    fn path(&self, page: u64) -> PathBuf {
        self.folder.join(format!("{page:04}.png"))
    }

    /// Writes the page, if it has changed.
    ///
    /// # Errors
    /// The disk's.
    pub fn flush(&mut self) -> Result<()> {
        if self.changed {
            let path = self.path(self.page);
            let page = self.canvas.picture();
            let used = Image::from_fn(page.width(), self.rows.max(1) * ROW, |x, y| {
                let pixel = page.pixel(x, y);
                [pixel[0], pixel[1], pixel[2]]
            });
            let bytes = encode_png8(&used)?;
            write_whole(&path, |out| out.write_all(&bytes).map_err(|source| Error::io("write", &path, source)))?;
            (self.changed, self.written) = (false, Some(Instant::now()));
        }
        Ok(())
    }
}

/// The frame that shows most: its mean code nearest to a quarter of white.
pub fn best(frames: &[Arc<Image>]) -> Option<&Image> {
    let mean = |frame: &Image| frame.data().iter().sum::<f32>() / frame.data().len().max(1) as f32;
    let off = |frame: &Arc<Image>| (mean(frame) - SHOWS_MOST).abs();
    frames.iter().min_by(|a, b| off(a).total_cmp(&off(b))).map(Arc::as_ref)
}

fn blank() -> Canvas {
    Canvas::new(GRID.0 * CELL.0, GRID.1 * ROW, [0.02; 3])
}
