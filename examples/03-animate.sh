#!/usr/bin/env bash
# An asset and a script -> 24 frames, in two halves as a farm would split them.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-target/examples/03}
mkdir -p "$out"
relume() { cargo run --quiet --release -p relume -- "$@"; }

relume import lp examples/ball-24/dirs.lp -o "$out/ball.rfield"
relume animate "$out/ball.rfield" examples/03-turn.toml --frames 1-12 -o "$out/ball.####.png"
# Frames that are there are left, so the whole range renders the other half.
relume animate "$out/ball.rfield" examples/03-turn.toml --frames 1-24 -o "$out/ball.####.png"
# Every lighting that ships.
for name in $(relume lightings | awk '/^  / {print $1}'); do
    relume relight "$out/ball.rfield" --lighting "$name" -o "$out/$name.png"
done
echo "pictures in $out"
