//! Serial ports.

/// What `relume devices` says of serial ports, a line each.
pub fn list() -> Vec<String> {
    Vec::new()
}
