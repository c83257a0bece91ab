//! What a rig must know before its photographs mean light: where lamps stand, how bright they are, what is white.
