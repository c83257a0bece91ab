//! Software of all habits puts files into a folder.

use std::thread::JoinHandle;

use relume_core::image::{EncodeOptions, Image, write};

use super::*;
use crate::devices::operator::Willing;

const EXPOSURE: Exposure = Exposure { time_s: 0.01, iso: Some(100.0), f_number: Some(8.0) };

struct Set {
    folder: tempfile::TempDir,
    operator: Arc<Willing>,
}

impl Set {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in ["inbox", "session", "elsewhere"] {
            fs::create_dir(folder.path().join(name)).unwrap();
        }
        Self { folder, operator: Arc::new(Willing::default()) }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn options(&self) -> Options {
        Options { path: self.path("inbox"), trigger: Vec::new(), counts: Counts::Picture, within_s: 2.0, poll_s: 0.0 }
    }

    fn open(&self, options: Options) -> FolderCamera {
        let mut camera = FolderCamera::open(options, &self.path("session"), self.operator.clone()).unwrap();
        camera.pairs = Some(false);
        camera
    }

    /// After a while, in another thread.
    fn later(&self, ms: u64, body: impl FnOnce(&Path) + Send + 'static) -> JoinHandle<()> {
        let folder = self.folder.path().to_path_buf();
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(ms));
            body(&folder);
        })
    }

    fn photograph(&self, camera: &mut FolderCamera) -> Result<(Vec<String>, Vec<u8>), Trouble> {
        camera.set(&EXPOSURE).unwrap();
        camera.expose()?;
        let delivered = camera.download(&self.path("session"), "000001-1")?;
        let bytes = fs::read(&delivered.files[0]).unwrap();
        let name = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        Ok((delivered.files.iter().map(name).collect(), bytes))
    }
}

/// A JPEG of a grey; the same bytes for the same grey.
fn jpeg(grey: f32) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.jpg");
    write(&path, &Image::from_fn(64, 48, |_, _| [grey; 3]), EncodeOptions::default()).unwrap();
    fs::read(path).unwrap()
}

/// With EXIF data that say when it was taken.
fn dated_jpeg(grey: f32, at: &str) -> Vec<u8> {
    let entry = |tag: u16, kind: u16, count: u32, value: u32| {
        [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &count.to_le_bytes(), &value.to_le_bytes()].concat()
    };
    let mut exif = b"Exif\0\0II*\0\x08\0\0\0\x01\0".to_vec();
    exif.extend(entry(0x8769, 4, 1, 26));
    exif.extend([0; 4]);
    exif.extend(1u16.to_le_bytes());
    exif.extend(entry(0x9003, 2, 20, 44));
    exif.extend([0; 4]);
    exif.extend(at.as_bytes());
    exif.push(0);
    let plain = jpeg(grey);
    let mut bytes = plain[..2].to_vec();
    bytes.extend([0xff, 0xe1]);
    bytes.extend((exif.len() as u16 + 2).to_be_bytes());
    bytes.extend(exif);
    bytes.extend(&plain[2..]);
    bytes
}

#[test]
fn slow_writers_are_waited_for() {
    for poll_s in [0.0, 0.15] {
        let set = Set::new();
        let mut camera = set.open(Options { poll_s, ..set.options() });
        // What was there before does not count, whatever happens to it.
        fs::write(set.path("inbox/before.jpg"), jpeg(0.1)).unwrap();
        let whole = jpeg(0.5);
        let pieces = whole.clone();
        let writer = set.later(50, move |folder| {
            fs::write(folder.join("inbox/before.jpg"), jpeg(0.9)).unwrap();
            fs::write(folder.join("inbox/notes.txt"), "no photograph").unwrap();
            let mut file = fs::File::create(folder.join("inbox/new.JPG")).unwrap();
            for piece in pieces.chunks(pieces.len() / 6 + 1) {
                file.write_all(piece).unwrap();
                std::thread::sleep(Duration::from_millis(60));
            }
        });
        let (names, bytes) = set.photograph(&mut camera).unwrap();
        assert_eq!((names, bytes), (vec!["000001-1.JPG".to_owned()], whole), "poll {poll_s}");
        assert!(set.path("inbox/new.JPG").exists(), "files stay where they are");
        writer.join().unwrap();
        assert!(set.operator.asked.lock().unwrap()[0].starts_with("set the camera to 1/100 s, ISO 100, f/8 and take"));
        assert!(!set.path("session/exposing").exists());
    }
}

#[test]
fn files_that_are_renamed_in_count_at_once() {
    let set = Set::new();
    let mut camera = set.open(set.options());
    let whole = jpeg(0.4);
    let moved = whole.clone();
    let mover = set.later(30, move |folder| {
        fs::write(folder.join("elsewhere/a.jpg"), moved).unwrap();
        fs::rename(folder.join("elsewhere/a.jpg"), folder.join("inbox/a.jpg")).unwrap();
    });
    assert_eq!(set.photograph(&mut camera).unwrap().1, whole);
    mover.join().unwrap();
}

#[test]
fn late_files_of_exposures_that_were_given_up_never_count() {
    let set = Set::new();
    let mut camera = set.open(Options { within_s: 0.3, ..set.options() });
    let said = set.photograph(&mut camera).unwrap_err().to_string();
    assert!(said.contains("no photograph came into") && said.contains("within 0.3 s"), "{said}");
    assert!(set.path("session/exposing").exists());
    fs::write(set.path("session/exposing"), "0 99999999999999").unwrap();
    // Resumed at once: the file of the exposure before comes now, and only then the next one is made.
    let late = set.later(150, |folder| fs::write(folder.join("inbox/late.jpg"), jpeg(0.1)).unwrap());
    let mut camera = set.open(Options { within_s: 2.0, ..set.options() });
    let begun = Instant::now();
    let good = jpeg(0.8);
    let own = good.clone();
    let next = set.later(500, move |folder| fs::write(folder.join("inbox/own.jpg"), own).unwrap());
    let (_, bytes) = set.photograph(&mut camera).unwrap();
    assert!(bytes == good && begun.elapsed() >= Duration::from_millis(400));
    late.join().unwrap();
    next.join().unwrap();
    // One that came while nobody looked is not waited for.
    fs::write(set.path("session/exposing"), "1 99999999999999").unwrap();
    let again = set.later(50, |folder| fs::write(folder.join("inbox/third.jpg"), jpeg(0.3)).unwrap());
    assert_eq!(set.photograph(&mut set.open(set.options())).unwrap().1, jpeg(0.3));
    again.join().unwrap();
}

#[test]
fn files_of_another_time_are_left_alone() {
    let set = Set::new();
    let mut camera = set.open(Options { within_s: 1.0, ..set.options() });
    let first = set.later(30, |folder| {
        fs::write(folder.join("inbox/1.jpg"), dated_jpeg(0.5, "2026:01:01 12:00:00")).unwrap();
    });
    set.photograph(&mut camera).unwrap();
    first.join().unwrap();
    // 40 s before the one that was just taken.
    let second = set.later(30, |folder| {
        fs::write(folder.join("inbox/0.jpg"), dated_jpeg(0.1, "2026:01:01 11:59:20")).unwrap();
        std::thread::sleep(Duration::from_millis(150));
        fs::write(folder.join("inbox/2.jpg"), dated_jpeg(0.7, "2026:01:01 12:00:01")).unwrap();
    });
    assert_eq!(set.photograph(&mut camera).unwrap().1, dated_jpeg(0.7, "2026:01:01 12:00:01"));
    second.join().unwrap();
    let third = set.later(30, |folder| {
        fs::write(folder.join("inbox/3.jpg"), dated_jpeg(0.1, "2026:01:01 11:30:00")).unwrap();
    });
    let said = set.photograph(&mut camera).unwrap_err().to_string();
    assert!(said.contains("3.jpg, which is of another exposure by its EXIF time"), "{said}");
    third.join().unwrap();
}

#[test]
fn pairs_belong_together_and_strangers_end_the_run() {
    let set = Set::new();
    let raw = Options { counts: Counts::Raw, ..set.options() };
    let mut camera = set.open(raw);
    camera.pairs = None;
    let pair = set.later(30, |folder| {
        fs::write(folder.join("inbox/a.jpg"), jpeg(0.2)).unwrap();
        std::thread::sleep(Duration::from_millis(100));
        fs::write(folder.join("inbox/a.NEF"), "raw").unwrap();
    });
    let (names, bytes) = set.photograph(&mut camera).unwrap();
    assert_eq!((names, &bytes[..]), (vec!["000001-1.NEF".to_owned(), "000001-1.jpg".to_owned()], &b"raw"[..]));
    assert_eq!(camera.pairs, Some(true));
    pair.join().unwrap();
    // Two photographs for one exposure: nobody knows which is right.
    fs::create_dir(set.path("other")).unwrap();
    let mut camera = set.open(Options { path: set.path("other"), ..set.options() });
    camera.pairs = None;
    let two = set.later(30, |folder| {
        fs::write(folder.join("other/a.jpg"), jpeg(0.2)).unwrap();
        fs::write(folder.join("other/b.jpg"), jpeg(0.3)).unwrap();
    });
    let said = set.photograph(&mut camera).unwrap_err().to_string();
    assert!(said.contains("two photographs came for one exposure: a and b"), "{said}");
    two.join().unwrap();
}

#[cfg(unix)]
#[test]
fn triggers_take_photographs_with_the_numbers_put_in() {
    let set = Set::new();
    fs::write(set.path("elsewhere/a.jpg"), jpeg(0.6)).unwrap();
    let script = "cp \"$1/elsewhere/a.jpg\" \"$1/inbox/$2-$3-$4.jpg\"";
    let root = set.folder.path().display().to_string();
    let words = ["sh", "-c", script, "sh", &root, "{time_s}", "{iso}", "{f_number}"];
    let trigger: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
    let mut camera = set.open(Options { trigger, ..set.options() });
    assert!(camera.preflight().iter().all(|finding| finding.fine));
    assert_eq!(set.photograph(&mut camera).unwrap().1, jpeg(0.6));
    assert!(set.path("inbox/0.01-100-8.jpg").exists());
    assert!(set.operator.asked.lock().unwrap().is_empty());
    let missing = Options { path: set.path("nowhere"), ..set.options() };
    let said = FolderCamera::open(missing, &set.path("session"), set.operator.clone()).err().unwrap().to_string();
    assert!(said.contains("nowhere is not there"), "{said}");
}
