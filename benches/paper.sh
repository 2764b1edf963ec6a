#!/usr/bin/env bash
# Makes docs/paper.md and its pictures: the paper, section by section, beside what `--preset paper` finds on the CSAIL log.
#
#   benches/paper.sh DATA [IPSLAM]    folder of logs as docs/formats.md has it (Benchmark); program, by default a release build
#
# Needs Python 3.11 with Pillow. Takes SEEDS from the environment, by default "1 2 3". About five minutes on two cores.
set -euo pipefail
data=$(realpath "$1")
program=${2:-}
cd "$(dirname "$0")/.."
if [ -z "$program" ]; then
    cargo build --release --no-default-features
    program=${CARGO_TARGET_DIR:-target}/release/ipslam
fi
program=$(realpath "$program")
seeds=${SEEDS:-1 2 3}
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
log=$data/csail/mit-csail.clf.gz

# From 130 to 230 s the robot drives one small loop and comes back.
zcat "$log" | awk '$1 == "FLASER" { stamp = $($2 + 9); if (!start) start = stamp; if (stamp >= start + 130 && stamp <= start + 230) print }' \
    >"$out/part.clf"

# Rows of the table of readings: a name, and what is set in place of the preset's.
readings=(
    "the preset|"
    "a scan is merged before it is weighed|ablation.weigh_merged_map=true"
    "points that the map explains count for a new cluster too|merging.new_density=inf"
    "a new cluster needs 20 points|merging.min_points=20.0"
    "no point is less likely than 1e-8|likelihood.outlier_density=1e-8"
    "clusters up to 1 m apart match|matching.max_distance=1.0"
    "motion noise as by default|motion.heading_per_distance=0.2 motion.heading_per_turn=0.3"
    "a scan each 0.3 m|tracking.step_distance=0.3"
    "a scan each 0.5 m|tracking.step_distance=0.5"
    "a scan each 2 m|tracking.step_distance=2.0"
)
# The preset's configuration, and the figures of one run.
first=${seeds%% *}
run() {
    "$program" run "$2" --preset paper --seed "$first" --threads 1 --cell-size 0.5 --out "$out/$1" \
        --reference "$data/csail/csail.graph.xyt.gz" --relations "$data/csail/mit-csail.relations.gz" >/dev/null
}
run part "$out/part.clf"

# measure NAME SETTINGS LOG LABEL: one line of a table, over all seeds.
measure() {
    mkdir "$out/$1-log"
    cp "$3" "$out/$1-log/"
    cp "$data/csail/mit-csail.relations.gz" "$out/$1-log/$(basename "$3" .gz | sed 's/[.]clf$//').relations.gz"
    python3 - "$out/part/config.toml" "$2" >"$out/$1.toml" <<'PY'
import sys, tomllib
config = tomllib.load(open(sys.argv[1], "rb"))
for setting in sys.argv[2].split():
    key, value = setting.split("=")
    section, name = key.split(".")
    config[section][name] = tomllib.loads(f"value = {value}")["value"]
def text(value):
    return str(value).lower() if isinstance(value, bool) else f'"{value}"' if isinstance(value, str) else repr(value)
values = {name: value for name, value in config.items() if not isinstance(value, dict)}
print("\n".join(f"{name} = {text(value)}" for name, value in values.items()))
for name, section in config.items():
    if isinstance(section, dict):
        print(f"[{name}]", *(f"{key} = {text(value)}" for key, value in section.items()), sep="\n")
PY
    "$program" benchmark "$out/$1-log" --config "$out/$1.toml" --seeds "${seeds// /,}" --out "$out/$1-benchmark" >/dev/null
    python3 - "$out/$1-benchmark/benchmark.json" "$4" <<'PY'
import json, sys
rows = json.load(open(sys.argv[1]))["runs"]
print("|", sys.argv[2], "|", ", ".join(f"{r['loops_m']:.2f}" for r in rows), "|", ", ".join(str(r["clusters"]) for r in rows), "|")
PY
}
picture() {
    python3 - "$out/$1" "docs/paper-$2.png" <<'PY'
import sys
from PIL import Image
picture = Image.open(sys.argv[1]).convert("RGB")
picture.thumbnail((640, 640), Image.LANCZOS)
picture.quantize(24).save(sys.argv[2], optimize=True)
PY
}
picture "part/figure3_odometry_map.png" odometry
picture "part/figure4a_trajectory.png" trajectory
picture "part/figure4b_clusters.png" clusters
picture "part/figure4d_reprojected.png" reprojected

{
    cat benches/paper.md
    printf '\n## The readings, one changed at a time\n'
    printf 'The part of the log that is described above; seeds %s.\n\n' "${seeds// /, }"
    header='| reading | loops [m] | clusters |'
    printf '%s\n|---|---|---|\n' "$header"
    for reading in "${!readings[@]}"; do
        measure "reading$reading" "${readings[$reading]#*|}" "$out/part.clf" "${readings[$reading]%%|*}"
    done
    run whole "$log"
    python3 - "$out/part/summary.json" "$out/whole/summary.json" <<'PY'
import json, sys
print()
for path, name in zip(sys.argv[1:], ("part", "whole log")):
    summary = json.load(open(path))
    steps, clusters = summary["filter"]["steps"], summary["map"]["clusters"]
    points = summary["beams"]["points"] * steps / summary["beams"]["scans"]
    loops = summary["metrics"]["relations"]["loop"]["translation_m"]["mean"]
    print(f"The {name}, seed {summary['seed']}: {steps} scans with {points:.0f} points; {clusters} clusters, {100 * 5 * clusters / (2 * points):.2f} % of "
          f"their numbers; effective sample size {summary['filter']['effective_sample_size']['mean']:.1f} of 201; loops {loops:.2f} m.\n")
PY
    echo 'Loops: mean error over the relations that are more than 10 s apart, a number a seed.'
} >"$out/paper.md"
picture "whole/figure4b_clusters.png" whole
mv "$out/paper.md" docs/paper.md
