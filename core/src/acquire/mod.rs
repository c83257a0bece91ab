//! From photographs to a field.
