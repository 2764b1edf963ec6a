#!/usr/bin/env bash
# Measures evaluators on a machine with a GPU, in one call.
#
#   benches/measure.sh pack            builds, and packs all that is needed into target/measure/
#   target/measure/measure.sh [FILE]   on the machine with the GPU: tests the device against the CPU, then times both
#
# The packed folder needs no Rust, and neither a Vulkan loader nor the description of NVIDIA's driver on the machine that
# it is taken to: it brings both along and uses them where they are missing. The driver itself has to be there.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"

if [ "${1:-}" = pack ]; then
    cd "$here/.."
    cargo build --release --no-default-features --features gpu
    tests=$(cargo test --release --no-default-features --features gpu --test gpu --no-run --message-format short 2>&1 |
        sed -n 's/.*Executable.*(\(.*\)).*/\1/p')
    folder=target/measure
    mkdir -p "$folder"
    cp target/release/ipslam "$folder/ipslam"
    cp "$tests" "$folder/consistency"
    cp "$here/measure.sh" "$folder/measure.sh"
    loader=$(ldconfig -p | sed -n 's/.*libvulkan\.so\.1 .*=> //p' | head -n 1)
    [ -n "$loader" ] || { echo "no Vulkan loader to take along: install libvulkan1" >&2; exit 1; }
    cp -L "$loader" "$folder/libvulkan.so.1"
    cat >"$folder/nvidia_icd.json" <<'ICD'
{"file_format_version": "1.0.0", "ICD": {"library_path": "libGLX_nvidia.so.0", "api_version": "1.3.0"}}
ICD
    echo "packed: $folder"
    exit
fi

out="${1:-/dev/null}"
cd "$here"
ldconfig -p | grep -q 'libvulkan\.so\.1' || export LD_LIBRARY_PATH="$here${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
compgen -G '/usr/share/vulkan/icd.d/nvidia*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/nvidia*.json' >/dev/null ||
    export VK_DRIVER_FILES="$here/nvidia_icd.json"
{
    lscpu | sed -n 's/^Model name: */processor: /p'
    command -v nvidia-smi >/dev/null && nvidia-smi --query-gpu=name,driver_version,clocks.max.sm --format=csv,noheader
    ./ipslam devices
    IPSLAM_REQUIRE=gpu ./consistency
    ./ipslam bench
} 2>&1 | tee "$out"
