//! A virtual stage: a path tracer that returns rows of `T`.
