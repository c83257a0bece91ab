#!/usr/bin/env bash
# A real glass of water, photographed before a screen that showed codes, put before another picture.
#
#   bash examples/05-glass-before-a-picture.sh [FOLDER [PLATE [OUT]]]
#
# FOLDER holds patterns/ and photos/ (graycode_N.png and N_Color.png), one of the sets of
# https://github.com/Simon-Fuhaoyuan/RealRefractiveFlowAnnotator (Apache-2.0). The stripes fill a part of
# the screen, without inverses and without a black picture; the finest are lost.
set -euo pipefail
cd "$(dirname "$0")/.."
data=${1:-../shared/data/glass-graycode}
plate=${2:-examples/demo.jpg}
out=${3:-target/examples/05}
if [[ ! -d $data/patterns ]]; then
    echo "no $data/patterns: get the photographs first (see the head of this script)"
    exit 1
fi
mkdir -p "$out"
relume() { cargo run --quiet --release -p relume -- "$@"; }

codes=(--patterns "$data/patterns" --photos "$data/photos")
# Where each pixel looks: through the glass as well, in the map.
relume calibrate screen "${codes[@]}" -o "$out/screen.json" --map "$out/places.png"
# One place of the screen a pixel, and what is left of its light.
relume import graycode "${codes[@]}" -o "$out/glass.rfield"
relume matte "$out/glass.rfield" --plate "$plate" -o "$out/composite.png"
relume matte "$out/glass.rfield" --plate "$plate" --output alpha -o "$out/alpha.exr"
echo "$out/composite.png shows the glass"
