//! Sessions are opened after every accident that a disk and a `kill` can make.

use std::fs;
use std::path::Path;

use super::journal::Journal;
use super::*;
use crate::rigs::Condition;

fn imported() -> Description {
    Description::new(Source::Import(ImportDescription {
        kind: "lp".to_owned(),
        width: 3,
        height: 2,
        encoding: "auto".to_owned(),
        colour_space: "lin_rec709".to_owned(),
        settings: toml::Table::new(),
    }))
}

fn photograph(step: u64) -> Photograph {
    Photograph {
        number: 0,
        step,
        condition: Condition::Lamp(step as usize),
        role: Role::Sample,
        redo_of: None,
        frames: Vec::new(),
        beside: Vec::new(),
        time: String::new(),
        seconds: 0.25,
        remarks: Vec::new(),
    }
}

const EXPOSURE: Exposure = Exposure { time_s: 0.1, iso: Some(100.0), f_number: None };

fn shoot(session: &mut Session, step: u64) {
    let folder = session.begin().unwrap();
    let file = folder.path().join("a.png");
    fs::write(&file, format!("photograph of step {step}")).unwrap();
    session.finish(folder, &[(file, EXPOSURE)], &[], photograph(step)).unwrap();
}

fn session(root: &Path, steps: u64) -> Session {
    let mut session = Session::create(root, imported()).unwrap();
    (0..steps).for_each(|step| shoot(&mut session, step));
    session
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn what_is_finished_is_there_again() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    let written: Vec<Photograph> = session(&root, 3).photographs().cloned().collect();
    let session = Session::open(&root).unwrap();
    assert_eq!(session.photographs().cloned().collect::<Vec<_>>(), written);
    assert_eq!(written[2].frames[0].file, "photos/000003/a.png");
    assert_eq!(written[2].frames[0].blake3, blake3::hash(b"photograph of step 2").to_hex().to_string());
    assert_eq!(session.answer(1).unwrap().number, 2);
    assert!(session.answer(3).is_none() && session.damaged().is_empty());
}

#[test]
fn a_journal_cut_at_any_byte_keeps_its_whole_lines() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    drop(session(&root, 3));
    let path = root.join("journal.jsonl");
    let whole = fs::read(&path).unwrap();
    for cut in 0..whole.len() {
        fs::write(&path, &whole[..cut]).unwrap();
        let lines = whole[..cut].iter().filter(|b| **b == b'\n').count();
        let (journal, torn) = Journal::open(&root).unwrap();
        assert_eq!(journal.lines().len(), lines, "cut at {cut}");
        assert_eq!(torn, !(cut == 0 || whole[cut - 1] == b'\n'), "cut at {cut}");
        assert!(fs::read(&path).unwrap().ends_with(b"\n") || lines == 0);
    }
    // A disk that had promised the length but not the bytes.
    let mut zeros = whole.clone();
    zeros.extend([0; 100]);
    fs::write(&path, &zeros).unwrap();
    assert_eq!(Journal::open(&root).unwrap().0.lines().len(), 3);
    assert_eq!(fs::read(&path).unwrap(), whole);
}

#[test]
fn photographs_without_their_line_are_cleared_away_and_others_are_not() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    drop(session(&root, 2));
    let photos = root.join("photos");
    for name in [".000003.part", "000003", "000009", "notes"] {
        fs::create_dir(photos.join(name)).unwrap();
        fs::write(photos.join(name).join("a.png"), "half").unwrap();
    }
    let mut session = Session::open(&root).unwrap();
    assert_eq!(names(&photos), ["000001", "000002", "000009", "notes"]);
    shoot(&mut session, 2);
    assert_eq!(fs::read(photos.join("000003/a.png")).unwrap(), b"photograph of step 2");
}

#[test]
fn a_photograph_that_is_not_finished_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    let mut session = session(&root, 1);
    let begun = session.begin().unwrap();
    fs::write(begun.path().join("a.png"), "half").unwrap();
    drop(begun);
    assert_eq!(names(&root.join("photos")), ["000001"]);
    // A file that is gone before it is part of the session.
    let begun = session.begin().unwrap();
    let absent = begun.path().join("absent.png");
    assert!(session.finish(begun, &[(absent, EXPOSURE)], &[], photograph(1)).is_err());
    assert_eq!((names(&root.join("photos")).len(), session.photographs().count()), (1, 1));
}

#[test]
fn damaged_photographs_are_not_answers() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    drop(session(&root, 4));
    let photo = |n: u64| root.join(format!("photos/{n:06}/a.png"));
    fs::write(photo(1), "photograph of step X").unwrap();
    fs::write(photo(2), "short").unwrap();
    fs::remove_dir_all(root.join("photos/000003")).unwrap();
    let mut session = Session::open(&root).unwrap();
    let numbers = |session: &Session| session.damaged().iter().map(|p| p.number).collect::<Vec<_>>();
    assert_eq!(numbers(&session), [1, 2, 3]);
    assert!(session.answer(0).is_none() && session.answer(2).is_none() && session.answer(3).is_some());
    shoot(&mut session, 0);
    assert_eq!(session.answer(0).unwrap().number, 5);
    drop(session);
    assert_eq!(numbers(&Session::open(&root).unwrap()), [2, 3], "the first was replaced");
}

#[test]
fn the_second_process_is_refused_with_the_first_ones_id() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    let first = session(&root, 1);
    let message = Session::open(&root).unwrap_err().to_string();
    assert!(message.contains(&format!("process {} (started 20", std::process::id())), "{message}");
    assert_eq!(Journal::read(&root).unwrap().len(), 1, "reading needs no lock");
    drop(first);
    Session::open(&root).unwrap();
}

#[test]
fn newer_sessions_are_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    drop(session(&root, 1));
    let path = root.join("session.toml");
    let newer = "version = 3\ntool = \"relume 9.1.0\"\nsomething = \"else\"\n";
    fs::write(&path, newer).unwrap();
    fs::create_dir(root.join("photos/000002")).unwrap();
    let before = names(&root);
    let message = Session::open(&root).unwrap_err().to_string();
    assert!(message.contains("layout 3") && message.contains("relume 9.1.0"), "{message}");
    assert_eq!((names(&root), fs::read_to_string(&path).unwrap()), (before, newer.to_owned()));
    assert_eq!(names(&root.join("photos")), ["000001", "000002"], "nothing was swept");
}

#[test]
fn journals_changed_from_outside_are_refused_with_the_line() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("s");
    drop(session(&root, 3));
    let path = root.join("journal.jsonl");
    let whole = fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = whole.lines().collect();
    let with = |second: &str| format!("{}\n{second}\n{}\n", lines[0], lines[2]);
    for (second, words) in [
        ("{", "line 2"),
        ("", "line 2"),
        (lines[0], "number out of order"),
        (&lines[1].replace("photos/000002/a.png", "../../etc/passwd"), "inside the session"),
        (&lines[1].replace("photos/000002/a.png", "/etc/passwd"), "inside the session"),
        (&lines[1].replace("\"lamp\":1", "\"laser\":1"), "line 2"),
        (&lines[1].replace("\"lamp\":1", "\"lamp\":18446744073709551615"), "numbered 18446744073709551615"),
    ] {
        fs::write(&path, with(second)).unwrap();
        let message = Session::open(&root).unwrap_err().to_string();
        assert!(message.contains(words), "{second}: {message}");
        assert_eq!(fs::read_to_string(&path).unwrap(), with(second), "left as it was");
    }
}

#[test]
fn no_session_is_said() {
    let folder = tempfile::tempdir().unwrap();
    for root in [folder.path().to_owned(), folder.path().join("absent")] {
        let message = Session::open(&root).unwrap_err().to_string();
        assert!(message.contains("a session folder"), "{message}");
    }
    fs::write(folder.path().join("session.toml"), "version = 2\nrubbish = 1\n").unwrap();
    let message = Session::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains("session.toml") && message.contains("rubbish"), "{message}");
}
