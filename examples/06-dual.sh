#!/usr/bin/env bash
# Dual light transport: the scene as a projector saw it, lit by what the camera throws.
#
#   bash examples/06-dual.sh [OUT]
#
# A virtual projector lights 24 x 24 squares one by one from two positions, left and right of the camera; the camera
# photographs each. Turned round, these photographs are pictures from the projector, of 24 x 24 pixels, under light that no
# lamp ever gave: white from the camera, or a picture that it throws. Each is held against the same scene rendered from there.
# The captured field has the camera's noise in it, and the virtual rig keeps light over other surfaces by blocks of squares, which
# shows as a haze in blocks; the traced field of the same squares has neither.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-target/examples/06}
rm -rf "$out" && mkdir -p "$out"
relume() { cargo run --quiet --release -p relume -- "$@"; }
truth() { cargo run --quiet --release -p relume-core --example dual-truth -- "$@"; }

relume capture examples/06-gantry.toml --session "$out/session"
relume pack "$out/session" -o "$out/captured.rfield"
# A photograph of the other example is as large as this camera's pictures.
slide=examples/ball-24/light07.png
truth trace "$out/captured.rfield" "$out/traced.rfield"
for field in captured traced; do
    for position in 1 2; do
        for lit in white $slide; do
            name=$out/$field-from-$position-$(basename "$lit" .png)
            relume dual "$out/$field.rfield" --lit "$lit" --position $position --radiance -o "$name.exr"
            truth "$out/$field.rfield" $position "$lit" "$name.exr" "$name.png"
        done
    done
done
echo "$out/*-from-*.png show the dual pictures, and beside them what a camera at the projector sees"
