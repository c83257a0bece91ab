//! Data flows one way through the core: a module imports only modules above it in `lib.rs`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Modules in the order that `lib.rs` declares them.
fn order(lib: &str) -> Vec<String> {
    let name = |line: &str| Some(line.strip_prefix("pub mod ")?.strip_suffix(';')?.to_owned());
    lib.lines().filter_map(name).collect()
}

/// Modules of this crate that a source text names by `crate::`, in or out of a `use`, with braces and line breaks.
fn imports(source: &str) -> BTreeSet<String> {
    let code: String = source.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join(" ");
    let mut found = BTreeSet::new();
    for (at, prefix) in code.match_indices("crate::") {
        if code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            continue;
        }
        let rest = code[at + prefix.len()..].trim_start();
        let identifier =
            |text: &str| text.trim().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
        match rest.strip_prefix('{') {
            // `use crate::{error::Result, image::{self, Image}};`: the names at depth one.
            Some(list) => {
                let (mut depth, mut item) = (1, String::new());
                for c in list.chars() {
                    match c {
                        '{' => depth += 1,
                        '}' => depth -= 1,
                        _ => {}
                    }
                    if depth == 0 || (depth == 1 && c == ',') {
                        found.insert(identifier(&std::mem::take(&mut item)));
                    } else {
                        item.push(c);
                    }
                    if depth == 0 {
                        break;
                    }
                }
            }
            None => {
                found.insert(identifier(rest));
            }
        }
    }
    // After a trailing comma there is no name.
    found.remove("");
    found
}

fn sources(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, into);
        } else if path.extension().is_some_and(|e| e == "rs") {
            into.push(path);
        }
    }
}

/// Back edges `(file, module it belongs to, module it should not know)`.
fn back_edges(source_folder: &Path) -> Vec<String> {
    let order = order(&std::fs::read_to_string(source_folder.join("lib.rs")).unwrap());
    assert!(order.len() > 10, "lib.rs declares the modules one a line: {order:?}");
    let place = |name: &str| order.iter().position(|module| module == name);
    let mut files = Vec::new();
    sources(source_folder, &mut files);
    let mut edges = Vec::new();
    for file in files {
        let relative = file.strip_prefix(source_folder).unwrap();
        // Tests may use what lies below: they check a module against its users.
        if relative.file_stem().is_some_and(|stem| stem == "tests") || relative == Path::new("lib.rs") {
            continue;
        }
        let own = relative.iter().next().unwrap().to_string_lossy().trim_end_matches(".rs").to_owned();
        let own_place = place(&own).unwrap_or_else(|| panic!("{} belongs to no module of lib.rs", relative.display()));
        let text = std::fs::read_to_string(&file).unwrap();
        let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
        for module in imports(code) {
            if place(&module).is_some_and(|at| at > own_place) {
                edges.push(format!("{}: `{own}` uses `{module}`, which lies below it", relative.display()));
            }
        }
    }
    edges
}

#[test]
fn no_module_uses_one_below_it() {
    let edges = back_edges(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"));
    assert!(edges.is_empty(), "back edges:\n{}", edges.join("\n"));
}

#[test]
fn the_test_sees_every_way_to_import() {
    let source = "use crate::error::{Error, Result};\n use crate::{\n image::{Image, read},\n math,\n};\n\
                  // use crate::comment::X;\n fn f() -> crate::field::Asset { mycrate::other::x() }";
    let expected = ["error", "field", "image", "math"].map(str::to_owned);
    assert_eq!(imports(source), BTreeSet::from(expected));
}

#[test]
fn a_back_edge_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let real = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    std::fs::write(folder.path().join("lib.rs"), real).unwrap();
    std::fs::create_dir(folder.path().join("image")).unwrap();
    std::fs::write(folder.path().join("image/read.rs"), "use crate::{error::Result, relight::apply};").unwrap();
    assert_eq!(back_edges(folder.path()), ["image/read.rs: `image` uses `relight`, which lies below it"]);
}
