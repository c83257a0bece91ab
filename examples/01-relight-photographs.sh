#!/usr/bin/env bash
# Photographs and their .lp file -> an asset -> pictures under the six-pole chart, at four headings.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-target/examples/01}
mkdir -p "$out"
relume() { cargo run --quiet --release -p relume -- "$@"; }

relume import lp examples/ball-24/dirs.lp -o "$out/ball.rfield"
relume info "$out/ball.rfield"
for heading in 0 90 180 270; do
    relume relight "$out/ball.rfield" --env presets/charts/six-poles.png --rotate "$heading" --exposure 1 -o "$out/ball-$heading.png"
done
# Lamp 7 alone is photograph 7 again.
relume relight "$out/ball.rfield" --lamp 7 -o "$out/lamp-7.exr"
relume compare "$out/lamp-7.exr" examples/ball-24/light07.png
echo "pictures in $out"
