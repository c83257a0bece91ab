#!/usr/bin/env bash
# Real drivers without hardware: a turntable on GRBL and three lamps on DMX, both simulated, before a virtual camera. Linux and macOS.
set -euo pipefail
cd "$(dirname "$0")/.."
out=${1:-target/examples/07}
rm -rf "$out" && mkdir -p "$out/ports"
out=$(cd "$out" && pwd)
cargo build --quiet --release -p relume
relume="${CARGO_TARGET_DIR:-target}/release/relume"

sed "s#PORTS#$out/ports#" examples/07-stage.toml > "$out/stage.toml"
$relume rig simulate "$out/stage.toml" --at "$out/ports" > "$out/ports.log" &
boards=$!
trap 'kill $boards' EXIT
until grep -q ready "$out/ports.log"; do sleep 0.1; done

$relume rig check "$out/stage.toml" --yes
$relume jog "$out/stage.toml" turntable --to 90
# The capture is killed; its watchdog puts the lamps out, and nothing that was finished is lost.
$relume capture "$out/stage.toml" --session "$out/vase" &
sleep 3 && kill -9 $! || true
sleep 1 && cat "$out/ports/state.json"
$relume capture --session "$out/vase" --resume
$relume pack "$out/vase" -o "$out/vase.rfield"
$relume relight "$out/vase.rfield" --lighting three-point -o "$out/vase.exr"
