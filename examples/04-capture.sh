#!/usr/bin/env bash
# A day on set with virtual devices: a plan, a camera that is unplugged, a field in the end, and how far it is from the truth.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-target/examples/04}
rm -rf "$out" && mkdir -p "$out"
relume() { cargo run --quiet --release -p relume -- "$@"; }

rig=presets/rigs/virtual-stage.toml
relume capture $rig --session "$out/vase" --plan
# At exposure 200 somebody trips over the cable ...
relume capture $rig --session "$out/vase" --truth "$out/truth.rfield" --rehearse unplug@200 || true
# ... and nothing is lost.
relume capture --session "$out/vase" --resume
relume pack "$out/vase" -o "$out/vase.rfield"
for asset in vase truth; do
    relume relight "$out/$asset.rfield" --lighting three-point -o "$out/$asset.exr"
done
relume compare "$out/vase.exr" "$out/truth.exr"
echo "$out/vase/contact-sheets shows every photograph"
