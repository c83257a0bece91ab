//! Lamp drivers against simulated boards on ptys, and what the studio photographs.

use std::time::Duration;

use super::dmx_widget::DmxWidget;
use super::text_board::{Templates, TextBoard};
use super::world::CHANNELS;
use super::*;
use crate::devices::lights;
use crate::rigs::{LampsDevice, Wiring};

fn wiring() -> Wiring {
    Wiring { channel_of: vec![30, 2, 7], level: 255, settle_s: 0.0 }
}

/// Who loses nothing waits for nothing, however slow the machine.
fn patience(strikes: &[(u32, Strike)]) -> f64 {
    if strikes.is_empty() { 5.0 } else { 0.25 }
}

fn dmx_of(world: &World, strikes: Vec<(u32, Strike)>) -> (Served, LampsDevice) {
    let reply_s = patience(&strikes);
    let board = serve(DmxWidget::new(world.clone()), Mischief::new(strikes, 3)).unwrap();
    let port = board.path().display().to_string();
    (board, LampsDevice::DmxUsbPro { port, reply_s, wiring: wiring() })
}

fn templates(off: bool, reply: Option<&str>) -> Templates {
    Templates {
        on: "<{lamp},{level}>".to_owned(),
        off: off.then(|| "<{lamp},0>".to_owned()),
        all_off: "<off>".to_owned(),
        reply: reply.map(str::to_owned),
        ends: "\r".to_owned(),
    }
}

fn text_of(world: &World, templates: Templates, strikes: Vec<(u32, Strike)>) -> (Served, LampsDevice) {
    let reply_s = patience(&strikes);
    let board = serve(TextBoard::new(templates.clone(), world.clone()), Mischief::new(strikes, 3)).unwrap();
    let Templates { on, off, all_off, reply, ends } = templates;
    let port = board.path().display().to_string();
    let device =
        LampsDevice::Text { port, baud: 9600, on, off, all_off, reply, ends, reply_s, first: 0, wiring: wiring() };
    (board, device)
}

/// Levels of the three lamps, and whether all else is dark. Channels of DMX count from 1, lamps of text boards from 0.
fn lit(world: &World, first: usize) -> ([u8; 3], bool) {
    let levels = world.seen().levels;
    let lamps = [30 - first, 2 - first, 7 - first];
    let others = levels.iter().enumerate().all(|(n, level)| *level == 0 || lamps.contains(&n));
    (lamps.map(|n| levels[n]), others)
}

const SHOWN: [[u8; 3]; 5] = [[255, 0, 0], [0, 128, 0], [0, 0, 0], [1, 2, 3], [0, 2, 255]];

#[test]
fn a_dmx_widget_has_its_levels_when_the_call_returns() {
    let world = World::default();
    let (_board, device) = dmx_of(&world, Vec::new());
    let mut lights = lights::open(&device, 3).unwrap();
    let findings = lights.preflight();
    assert!(findings[0].fine && findings[0].text.ends_with("firmware 1.44, serial 02170815"), "{findings:?}");
    for levels in SHOWN {
        lights.show(&levels).unwrap();
        assert_eq!(lit(&world, 1), (levels, true));
    }
    world.light(&[9; CHANNELS]);
    lights.dark().unwrap();
    assert_eq!(world.seen().levels, [0; CHANNELS], "channels of no lamp too");
    assert!(lights.show(&[0; 4]).is_err());
}

#[test]
fn a_text_board_has_its_levels_when_the_call_returns() {
    for (off, reply) in [(true, Some("ok {lamp}")), (false, Some("ok {lamp}")), (false, Some("OK")), (true, None)] {
        let world = World::default();
        let (_board, device) = text_of(&world, templates(off, reply), Vec::new());
        let mut lights = lights::open(&device, 3).unwrap();
        assert!(lights.preflight()[0].fine, "{:?}", lights.preflight());
        for levels in SHOWN {
            lights.show(&levels).unwrap();
            let late = || reply.is_none() && lit(&world, 0) != (levels, true);
            (0..500).take_while(|_| late()).for_each(|_| std::thread::sleep(Duration::from_millis(10)));
            assert_eq!(lit(&world, 0), (levels, true), "off {off}, reply {reply:?}");
        }
        lights.dark().unwrap();
    }
}

/// A lamp that does not answer is named, after everything was tried.
#[test]
fn a_lamp_that_does_not_answer_is_named() {
    let world = World::default();
    let strange = Templates { on: "[{lamp}]".to_owned(), ..templates(false, Some("OK")) };
    let (_board, device) = text_of(&world, strange, Vec::new());
    let LampsDevice::Text { port, baud, off, all_off, reply, ends, reply_s, first, wiring, .. } = device else {
        unreachable!("a board of text")
    };
    let on = "<{lamp}>".to_owned();
    let device = LampsDevice::Text { port, baud, on, off, all_off, reply, ends, reply_s, first, wiring };
    let mut lights = lights::open(&device, 3).unwrap();
    let message = lights.show(&[0, 255, 0]).unwrap_err().to_string();
    assert!(message.contains("lamp 2: the board at") && message.contains("answers \"?\""), "{message}");
}

#[test]
fn lamps_are_lit_through_noise() {
    let kinds = [
        Strike::Garbage,
        Strike::HalfLine,
        Strike::LostReply,
        Strike::LostCommand,
        Strike::Late(Duration::from_millis(300)),
    ];
    let one = |kind: Strike, after: u32| {
        let strikes = vec![(after, kind), (after + 1, kind)];
        let (dmx_world, text_world) = (World::default(), World::default());
        let (widget, dmx) = dmx_of(&dmx_world, strikes.clone());
        let (board, text) = text_of(&text_world, templates(false, Some("+{lamp}")), strikes);
        let mut of_dmx = lights::open(&dmx, 3).unwrap();
        let mut of_text = lights::open(&text, 3).unwrap();
        for levels in SHOWN {
            of_dmx.show(&levels).unwrap();
            assert_eq!(lit(&dmx_world, 1), (levels, true), "{kind:?} after {after}");
            of_text.show(&levels).unwrap();
            assert_eq!(lit(&text_world, 0), (levels, true), "{kind:?} after {after}");
        }
        assert_eq!((widget.struck(), board.struck()), (vec![kind; 2], vec![kind; 2]));
    };
    std::thread::scope(|scope| {
        for kind in kinds {
            for after in 0..4 {
                scope.spawn(move || one(kind, after));
            }
        }
    });
}

#[test]
fn a_pulled_cable_is_said_and_darkness_finds_the_board_again() {
    let world = World::default();
    let (board, device) = dmx_of(&world, vec![(2, Strike::HangUp)]);
    let mut lights = lights::open(&device, 3).unwrap();
    let message = (0..5).find_map(|_| lights.show(&[255, 0, 0]).err()).unwrap().to_string();
    assert!(message.contains("was lost") && message.contains("check its cable"), "{message}");
    let message = lights.dark().unwrap_err().to_string();
    assert!(message.contains("no serial port"), "{message}");
    drop(board);

    // The same port, with a board at it again.
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("lamps");
    let (first, _) = dmx_of(&world, vec![(2, Strike::HangUp)]);
    std::os::unix::fs::symlink(first.path(), &port).unwrap();
    let device = LampsDevice::DmxUsbPro { port: port.display().to_string(), reply_s: 0.25, wiring: wiring() };
    let mut lights = lights::open(&device, 3).unwrap();
    assert!((0..5).any(|_| lights.show(&[255, 0, 0]).is_err()));
    let (second, _) = dmx_of(&world, Vec::new());
    std::fs::remove_file(&port).unwrap();
    std::os::unix::fs::symlink(second.path(), &port).unwrap();
    assert_eq!(lit(&world, 1), ([255, 0, 0], true));
    lights.dark().unwrap();
    assert_eq!(world.seen().levels, [0; CHANNELS]);
}
