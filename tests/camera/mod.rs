//! A camera for tests: the virtual PTP camera of libgphoto2's own source package (`libgphoto2_port/vusb`, a Nikon D750 in software),
//! which the library of this machine drives as if it hung on its USB.
//!
//! It is built when a test first asks for it, where there are a C compiler, the library, and a Debian whose source packages can be
//! fetched; else the test says that it is skipped, and why. Nothing of its code (LGPL-2.1) is in this repository: `EDITS` are the
//! few words of it that are changed on the way. The machine's own configuration of apt is only read.
//!
//! | variable of the tool's environment | what the camera does |
//! |---|---|
//! | `IOLIBS` | the folder of the plug-in: the library finds this camera and no other |
//! | `VCAMERADIR` | its card; a photograph is what `DCIM/100/*.JPG` holds when it is downloaded. All have one length |
//! | `VCAMERABYTIME` | a folder: at a shutter speed of n/10000 s the photograph is `n.JPG` in it, where there is one |
//! | `VCAMERALIMIT` | photographs until its card is full |
//! | `VCAMERALOG` | a file that gets a line for each photograph, setting and deletion |

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use crate::{skipped, target_dir};

/// Changes with [`EDITS`]: another plug-in.
const EDITION: u32 = 1;
/// What is put before the camera's code.
const HELPERS: &str = r#"
static void tell (const char *what, const char *name, unsigned int number) {
	FILE *log = getenv ("VCAMERALOG") ? fopen (getenv ("VCAMERALOG"), "a") : NULL;
	if (log) { fprintf (log, "%s %s %u\n", what, name, number); fclose (log); }
}
static char *card (void) { char *path = getenv ("VCAMERADIR"); return path ? path : "/nonexistent"; }
static int limit (void) { char *n = getenv ("VCAMERALIMIT"); return n ? 98 + 2 * atoi (n) : 9990; }
static char *exposed (unsigned int time, const char *otherwise) {
	char path[4096];
	if (getenv ("VCAMERABYTIME")) {
		snprintf (path, sizeof (path), "%s/%u.JPG", getenv ("VCAMERABYTIME"), time);
		if (!access (path, R_OK)) return strdup (path);
	}
	return strdup (otherwise);
}
"#;
/// The file, what stands in it, and what comes in its place the first time it does; [`SELF`] is what stood there, [`CODE`] the helpers.
const EDITS: [(&str, &str, &str); 11] = [
    // Answer as the D750 and not as what a file says.
    ("vcamera.h", "#undef FUZZ_PTP", "#define FUZZ_PTP 1"),
    ("vcamera.c", "static int ptp_inject_interrupt(", "\0static int ptp_inject_interrupt("),
    // Its port is no file here.
    ("vcamera.c", "perror(s+1)", "(void) s"),
    ("vcamera.c", "read_tree(VCAMERADIR)", "read_tree(card ())"),
    // About 26 photographs are few.
    ("vcamera.c", "capcnt > 150", "capcnt > limit ()"),
    ("vcamera.c", "capcnt++ == 150", "capcnt++ == limit ()"),
    (
        "vcamera.c",
        "newcur->fsname\t= strdup(cur->fsname)",
        "newcur->fsname\t= exposed (cam->shutterspeed, cur->fsname)",
    ),
    (
        "vcamera.c",
        "sprintf(newcur->name,\"GPH_%04d.JPG\", capcnt++);",
        "@tell (\"took\", newcur->name, cam->shutterspeed);",
    ),
    (
        "vcamera.c",
        "if (cur == first_dirent) {\n\t\tfirst_dirent = cur->next;",
        "tell (\"deleted\", cur->name, 0);\n\t@",
    ),
    ("vcamera.c", "cam->shutterspeed = val->u32;", "@tell (\"set\", \"time\", val->u32);"),
    ("vcamera.c", "cam->fnumber = val->u16;", "@tell (\"set\", \"f\", val->u16);"),
];
const SELF: char = '@';
const CODE: char = '\0';
/// What `configure` would find out.
const CONFIG: &str = "
#define GETTEXT_PACKAGE_LIBGPHOTO2_PORT \"libgphoto2_port\"
#define _GPHOTO2_INTERNAL_CODE 1
#define HAVE_SYS_PARAM_H 1
#include <time.h>
#include <unistd.h>
#include <dirent.h>
#include <sys/stat.h>
";

/// A card in the virtual camera.
pub struct Card {
    plugins: &'static Path,
    folder: PathBuf,
    length: usize,
}

impl Card {
    /// In a folder that is made; photographs have up to `length` bytes. None where the camera cannot be built: that is said.
    ///
    /// # Panics
    /// When the folder cannot be made.
    pub fn new(folder: &Path, length: usize) -> Option<Self> {
        let plugins = plugin()?;
        fs::create_dir_all(folder.join("camera/DCIM/100")).expect("a folder of a test");
        fs::create_dir_all(folder.join("by-time")).expect("a folder of a test");
        Some(Self { plugins, folder: folder.to_path_buf(), length })
    }

    /// What the next photograph is, at whatever shutter speed.
    ///
    /// # Panics
    /// When it is longer than photographs of this card are.
    pub fn offer(&self, jpeg: &[u8]) {
        self.put("camera/DCIM/100/0001.JPG", jpeg);
    }

    /// What photographs at a shutter speed are.
    ///
    /// # Panics
    /// As [`Card::offer`].
    pub fn offer_at(&self, time_s: f64, jpeg: &[u8]) {
        self.put(&format!("by-time/{}.JPG", (time_s * 1e4) as u32), jpeg);
    }

    /// As it arrives.
    pub fn padded(&self, jpeg: &[u8]) -> Vec<u8> {
        assert!(jpeg.len() <= self.length, "{} bytes", jpeg.len());
        let mut bytes = jpeg.to_vec();
        bytes.resize(self.length, 0);
        bytes
    }

    fn put(&self, name: &str, jpeg: &[u8]) {
        let draft = self.folder.join("draft");
        fs::write(&draft, self.padded(jpeg)).expect("a file of a test");
        fs::rename(draft, self.folder.join(name)).expect("a file of a test");
    }

    /// Plugs the camera in for a command.
    pub fn plug_in<'a>(&self, command: &'a mut Command) -> &'a mut Command {
        plug_in(command, self.plugins, &self.folder.join("camera"))
            .env("VCAMERABYTIME", self.folder.join("by-time"))
            .env("VCAMERALOG", self.folder.join("log"))
    }

    /// What the camera did so far, a line each: "took GPH_0099.JPG 100", "deleted GPH_0099.JPG 0", "set time 100".
    pub fn log(&self) -> Vec<String> {
        let text = fs::read_to_string(self.folder.join("log")).unwrap_or_default();
        text.lines().map(str::to_owned).collect()
    }
}

/// Plugs the camera in for a command, with a card whose photographs somebody else puts there.
pub fn plug_in<'a>(command: &'a mut Command, plugins: &Path, card: &Path) -> &'a mut Command {
    command.env("IOLIBS", plugins).env("VCAMERADIR", card)
}

/// The folder of the plug-in. None where it cannot be built: that is said.
pub fn plugin() -> Option<&'static Path> {
    static PLUGIN: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    match PLUGIN.get_or_init(build) {
        Ok(folder) => Some(folder),
        Err(why) => {
            skipped(&format!("the virtual PTP camera of libgphoto2 ({why})"));
            None
        }
    }
}

/// What a program says, or why it cannot be run.
fn run(command: &mut Command) -> Result<String, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let Output { status, stdout, stderr } = command.output().map_err(|error| format!("{name}: {error}"))?;
    let said = String::from_utf8_lossy(&stdout).into_owned();
    let complaint = String::from_utf8_lossy(&stderr).lines().last().unwrap_or_default().to_owned();
    if status.success() { Ok(said) } else { Err(format!("{name} failed: {complaint}")) }
}

fn build() -> Result<PathBuf, String> {
    if !cfg!(target_os = "linux") {
        return Err("it is built from Debian's sources".to_owned());
    }
    let version = run(Command::new("dpkg-query").args(["-W", "-f", "${source:Version}", "libgphoto2-port12"]))?;
    run(Command::new("cc").arg("--version"))?;
    let root = target_dir().join("tmp").join(format!("vusb-{version}-{EDITION}"));
    if root.join("vusb.so").is_file() {
        return Ok(root);
    }
    let draft = root.with_extension(format!("draft-{}", std::process::id()));
    let _ = fs::remove_dir_all(&draft);
    fs::create_dir_all(draft.join("plugins")).map_err(|error| error.to_string())?;
    let source = fetch(&draft, &version)?;
    // From here on a failure is a mistake of ours.
    compile(&source, &draft.join("plugins/vusb.so"));
    let _ = fs::remove_dir_all(&root);
    match fs::rename(draft.join("plugins"), &root) {
        Ok(()) => {}
        // Another process was faster.
        Err(_) if root.join("vusb.so").is_file() => {}
        Err(error) => return Err(error.to_string()),
    }
    let _ = fs::remove_dir_all(&draft);
    Ok(root)
}

/// The package's sources, of the version that is installed, from where this machine's packages come.
fn fetch(draft: &Path, version: &str) -> Result<PathBuf, String> {
    let origins = ["indextargets", "--format", "$(REPO_URI) $(RELEASE) $(COMPONENT)", "Created-By: Packages"];
    let origins = run(Command::new("apt-get").args(origins))?;
    if origins.trim().is_empty() {
        return Err("apt-get update was never run".to_owned());
    }
    let lines: String = origins.lines().map(|line| format!("deb-src {line}\n")).collect();
    let fail = |error: std::io::Error| error.to_string();
    fs::write(draft.join("sources.list"), lines).map_err(fail)?;
    for folder in ["lists/partial", "cache/archives/partial"] {
        fs::create_dir_all(draft.join(folder)).map_err(fail)?;
    }
    let apt = || {
        let mut command = Command::new("apt-get");
        let at = |name: &str| draft.join(name).display().to_string();
        for (key, value) in [
            ("Dir::Etc::SourceList", at("sources.list")),
            ("Dir::Etc::SourceParts", "/dev/null".to_owned()),
            ("Dir::State::lists", at("lists")),
            ("Dir::Cache", at("cache")),
            ("APT::Sandbox::User", "root".to_owned()),
        ] {
            command.arg("-o").arg(format!("{key}={value}"));
        }
        command.arg("-q").current_dir(draft);
        command
    };
    run(apt().arg("update"))?;
    run(apt().args(["source", "--download-only", &format!("libgphoto2={version}")]))?;
    let names = fs::read_dir(draft).map_err(fail)?.filter_map(|entry| Some(entry.ok()?.path()));
    let is_archive =
        |path: &PathBuf| path.to_string_lossy().contains(".orig.tar") && path.extension().is_some_and(|e| e != "asc");
    let archive = names.into_iter().find(is_archive).ok_or("the package has no source")?;
    run(Command::new("tar")
        .arg("-xf")
        .arg(archive)
        .args(["--strip-components=1", "--one-top-level=source"])
        .current_dir(draft))?;
    Ok(draft.join("source"))
}

/// # Panics
/// When the sources are not those that [`EDITS`] know, or do not compile.
fn compile(source: &Path, plugin: &Path) {
    let port = source.join("libgphoto2_port");
    let vusb = port.join("vusb");
    for name in ["vcamera.h", "vcamera.c"] {
        let path = vusb.join(name);
        let mut text = fs::read_to_string(&path).expect("a file of the package");
        for (_, from, to) in EDITS.iter().filter(|(file, ..)| *file == name) {
            assert!(text.contains(from), "{name} of libgphoto2 has no `{from}` any more: EDITS are of another version");
            text = text.replacen(from, &to.replace(SELF, from).replace(CODE, HELPERS), 1);
        }
        fs::write(&path, text).expect("a file of the package");
    }
    fs::write(vusb.join("config.h"), CONFIG).expect("a file of a test");
    let mut compiler = Command::new("cc");
    compiler.args(["-shared", "-fPIC", "-O1", "-w", "-DHAVE_CONFIG_H", "-I"]).arg(&vusb);
    compiler.arg("-I").arg(&port).arg("-I").arg(source).arg("-o").arg(plugin);
    compiler.arg(vusb.join("vusb.c")).arg(vusb.join("vcamera.c")).arg("-l:libgphoto2_port.so.12");
    let output = compiler.output().expect("a C compiler");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
