//! RTI `.lp` files: a count, then `file x y z` a line.
