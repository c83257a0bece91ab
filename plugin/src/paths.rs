//! Typed paths: quoted, relative, with `${VAR}` and a leading `~`.

use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// The file that a typed path means: surrounding blanks and one pair of quotes go (as pasted from a file browser),
/// `${VAR}` becomes the value of the environment variable, a leading `~/` the home folder, and what is then relative is
/// taken from the working folder of the host, which is where hosts without a notion of a project folder start.
///
/// # Errors
/// An unknown variable or an unclosed brace, named.
pub fn expand(typed: &str) -> Result<PathBuf> {
    expand_with(typed, |name| std::env::var(name).ok(), std::env::current_dir().ok().as_deref())
}

fn expand_with(typed: &str, variable: impl Fn(&str) -> Option<String>, folder: Option<&Path>) -> Result<PathBuf> {
    let bare = unquoted(typed.trim());
    let fail = |what: String| Error::Path { path: bare.to_owned(), what };
    let mut path = String::new();
    let mut rest = bare;
    while let Some((before, after)) = rest.split_once("${") {
        let (name, behind) = after.split_once('}').ok_or_else(|| fail("'${' without '}'; write ${NAME}".to_owned()))?;
        let value = variable(name).ok_or_else(|| {
            fail(format!("the environment variable {name} is not set; set it before the host starts, or type the path"))
        })?;
        path.push_str(before);
        path.push_str(&value);
        rest = behind;
    }
    path.push_str(rest);
    if let Some(inside) = path.strip_prefix("~/")
        && let Some(home) = variable("HOME").or_else(|| variable("USERPROFILE"))
    {
        path = format!("{home}/{inside}");
    }
    Ok(match folder {
        Some(folder) => folder.join(&path),
        None => PathBuf::from(path),
    })
}

fn unquoted(text: &str) -> &str {
    ['"', '\''].iter().find_map(|&q| text.strip_prefix(q)?.strip_suffix(q)).unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expanded(typed: &str) -> Result<PathBuf> {
        let variable = |name: &str| match name {
            "SHOW" => Some("/shows/dune".to_owned()),
            "SHOT" => Some("sh010".to_owned()),
            "HOME" => Some("/home/ana".to_owned()),
            _ => None,
        };
        expand_with(typed, variable, Some(Path::new("/shows/project")))
    }

    #[test]
    fn variables_quotes_home_and_relative_paths() {
        for (typed, path) in [
            ("/a/b.rfield", "/a/b.rfield"),
            ("b.rfield", "/shows/project/b.rfield"),
            ("${SHOW}/${SHOT}/b.rfield", "/shows/dune/sh010/b.rfield"),
            ("x${SHOT}y.hdr", "/shows/project/xsh010y.hdr"),
            ("  \"/with blanks/b c.rfield\" ", "/with blanks/b c.rfield"),
            ("~/b.rfield", "/home/ana/b.rfield"),
            ("/a/~/$SHOW {x}", "/a/~/$SHOW {x}"),
        ] {
            assert_eq!(expanded(typed).unwrap(), Path::new(path), "{typed}");
        }
    }

    #[test]
    fn an_unknown_variable_is_named() {
        let message = expanded("${NOWHERE}/b.rfield").unwrap_err().to_string();
        assert!(message.contains("NOWHERE") && message.contains("${NOWHERE}/b.rfield"), "{message}");
        assert!(expanded("${SHOW/b.rfield").unwrap_err().to_string().contains("'}'"));
    }
}
