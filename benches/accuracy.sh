#!/usr/bin/env bash
# Makes benches/accuracy.md, all logs whose truth is known and hard drives, and benches/particles.md, what maps and particles buy on these.
#
#   benches/accuracy.sh DATA [IPSLAM]    folder of logs as docs/formats.md has it (Benchmark); program, by default a release build
#
# Takes SEEDS from the environment, by default 1,2: about half an hour on two cores. Maps are drawn in target/accuracy/*/benchmark.png, figures are in benchmark.json beside them.
set -euo pipefail
data=$(realpath "$1")
program=${2:-}
cd "$(dirname "$0")/.."
if [ -z "$program" ]; then
    cargo build --release --no-default-features
    program=${CARGO_TARGET_DIR:-target}/release/ipslam
fi
program=$(realpath "$program")
here=$PWD
out=${CARGO_TARGET_DIR:-$here/target}/accuracy
mkdir -p "$out"
out=$(realpath "$out")
# Named from the folder of the data, so that the page has no path of one machine.
cd "$data/.."
data=$(basename "$data")

hard="noise 4; noise 8; skip 8; noise 4 skip 4; sparse 1,0.5; slip 6; backwards 6; spike 6; reset 2; blank 2; late 0.2"
hard+="; scale 1.05,0.9; no-odometry; fov 90; range-noise 0.1; random 0.05; crowd 3"
some="noise 8; skip 8; noise 4 skip 4; blank 2; fov 90"
# A run that fails is a row of the page.
benchmark() { "$program" benchmark "$@" --force || [ $? = 1 ]; }
benchmark "$data" --seeds "${SEEDS:-1,2}" --out "$out/logs"
benchmark "$data/csail" --seeds "${SEEDS:-1,2}" --hard "$hard" --out "$out/hard"
{
    cat <<'HEAD'
# Accuracy
Made by `benches/accuracy.sh DATA`; logs are named from the folder above the data. Closed maps are right in their topology; verdicts are
those of `summary.json`, which knows of no truth.

## Logs as recorded
HEAD
    cat "$out/logs/benchmark.md"
    printf '\n## Hard drives\nMIT CSAIL made harder by `ipslam degrade`; the seed is that of the damage and of the run.\n\n'
    cat "$out/hard/benchmark.md"
} >"$here/benches/accuracy.md"

benchmark "$data/csail" --seeds "${SEEDS:-1,2}" --hard "$some" --maps 1,8,32,32x1024,128 --out "$out/maps"
{
    printf '# What maps and particles buy\nMade by `benches/accuracy.sh DATA`.\n\n'
    cat "$out/maps/benchmark.md"
} >"$here/benches/particles.md"
