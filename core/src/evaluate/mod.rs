//! Errors and figures.
