//! Real drivers from outside, against simulated boards: how a capture ends, and that the lamps go out.

use std::process::{Child, Stdio};
use std::time::Duration;

use super::capture::refuse;
use super::cli::{run, succeed, text};
use super::simulated::{Simulated, photographs, signal};

/// Three lamps at four stops before a virtual camera, slow enough to be interrupted.
const RIG: &str = r#"
version = 1
name = "Small stage"
kind = "stage"
[stage.lamps]
layout = "arc"
latitudes = 3
longitudes = 4
[camera]
times_s = [0.05]
limits_s = [0.001, 0.5]
[devices]
camera = { driver = "virtual" }
watchdog_s = 1.5
[devices.axes]
driver = "grbl"
port = "{dir}/axes"
home = true
turntable = { letter = "X", backlash_deg = 2 }
settle_s = 0.01
[devices.lamps]
driver = "dmx-usb-pro"
port = "{dir}/lamps"
channel_of = [7, 8, 9]
settle_s = 0.15
[virtual]
width = 40
height = 30
samples = 4
irradiance = 800.0
[virtual.sensor]
full_well_e = 30000
read_e = 6
bits = 12
dark = 0.006
"#;
/// Black and three lamps at four stops.
const STEPS: usize = 16;

fn begin(world: &Simulated) -> Child {
    let mut command = world.capture("s", &[]);
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

fn complete(world: &Simulated) {
    let said = succeed(&mut world.capture("s", &["--resume"]));
    assert!(said.contains(&format!("{STEPS} of {STEPS} photographs")), "{said}");
    assert_eq!(world.lit(), 0, "{}", world.state());
}

#[test]
fn lamps_go_out_however_a_capture_ends() {
    // The second Ctrl-C gives up the photograph in flight, but not the switching off.
    for (names, code) in [
        (&["INT"][..], Some(130)),
        (&["INT", "INT"], Some(130)),
        (&["TERM"], Some(130)),
        (&["KILL"], None),
        (&["STOP"], None),
    ] {
        let name = names.join(" ");
        let world = Simulated::start(RIG);
        let child = begin(&world);
        world.wait_for_lamps(true);
        for name in names {
            signal(&child, name);
            std::thread::sleep(Duration::from_millis(30));
        }
        // A tool that hangs is ended by its watchdog, which then puts the lamps out; one that is killed cannot do it itself either.
        world.wait_for_lamps(false);
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), code, "{name}: {}", text(&output.stderr));
        if code.is_none() {
            assert!(text(&output.stderr).contains("watchdog"), "{name}: {}", text(&output.stderr));
        }
        std::thread::sleep(Duration::from_millis(100));
        assert_eq!(world.lit(), 0, "{name}: they stay out");
        let taken = photographs(&world.path("s"));
        assert!(taken < STEPS, "{name}: {taken}");
        complete(&world);
    }
}

#[test]
fn a_rig_is_checked_switched_off_and_jogged() {
    let world = Simulated::start(RIG);
    let said = succeed(&mut world.with_rig(&["rig", "check", "--yes", "--flash", "0.01"]));
    for words in ["turntable", "and back", "3 of 3", "all of it works"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    assert_eq!(world.lit(), 0);
    let mut jog = world.with_rig(&["jog"]);
    assert!(succeed(jog.args(["turntable", "--to", "90"])).contains("turntable at 90.000 degrees"));
    assert!((world.state()["turntable_deg"].as_f64().unwrap() - 90.0).abs() < 0.01, "{}", world.state());
    let mut jog = world.with_rig(&["jog"]);
    assert!(succeed(jog.args(["turntable", "--by", "-2.5"])).contains("turntable at 87.500"));
    assert!((world.state()["turntable_deg"].as_f64().unwrap() - 87.5).abs() < 0.01, "{}", world.state());
    refuse(world.with_rig(&["jog"]).args(["turntable", "--to", "400"]), &["400", "360"]);
    refuse(world.with_rig(&["jog"]).args(["arm", "--to", "10"]), &["arm"]);
    assert!(succeed(&mut world.with_rig(&["rig", "dark"])).contains("all lamps are off"));
}

#[test]
fn what_is_not_there_is_told_by_name() {
    let world = Simulated::start(RIG);
    let rig = std::fs::read_to_string(world.path("rig.toml")).unwrap();
    std::fs::write(world.path("rig.toml"), rig.replace("/lamps\"", "/nothing\"")).unwrap();
    refuse(&mut world.capture("s", &[]), &["nothing"]);
    let output = run(&mut world.with_rig(&["rig", "check", "--yes"]));
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("FAILED  lamps") && said.contains("ok      turntable"), "{said}");
    assert!(!world.path("s").join("session.toml").exists());
    assert!(!text(&run(&mut super::capture::tool("devices")).stdout).is_empty());
}
