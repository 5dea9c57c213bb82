#!/usr/bin/env bash
# What adding a model costs a developer: processor time (user and system, median of 3) of the incremental build after a
# change in a model's header, compiling its file and linking the library again, over that of compiling a file that only
# includes Boost.Odeint and Eigen, by the same compiler with -O2.
#   bench/build_cost.sh [BUILD_FOLDER] [MODEL...]     default: build/release, duffing parametric_pendulum
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
root=$PWD
build=${1:-build/release}
models=("${@:2}")
((${#models[@]} > 0)) || models=(duffing parametric_pendulum)
[[ -f $build/build.ninja ]] || { echo "build cost: $build is no build folder of Ninja" >&2; exit 2; }
compiler=$(sed -n 's/^CMAKE_CXX_COMPILER:[A-Z]*=//p' "$build/CMakeCache.txt")
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# Seconds of processor time that a command takes, median of three.
seconds() {
    local TIMEFORMAT='%U %S' times=() i
    for i in 1 2 3; do
        times+=("$({ time "$@" >"$scratch/log" 2>&1; } 2>&1 | awk '{ print $1 + $2 }')")
        # What a failed build costs says nothing.
        if grep -qE '^FAILED|error:' "$scratch/log"; then
            cat "$scratch/log" >&2
            exit 1
        fi
    done
    printf '%s\n' "${times[@]}" | sort -g | sed -n 2p
}

cat >"$scratch/peer.cpp" <<'EOT'
#include <boost/numeric/odeint.hpp>
#include <Eigen/Dense>
EOT
eigen=$(sed -n '/-isystem [^ ]*eigen3/{s/.*-isystem \([^ ]*eigen3\).*/\1/p;q}' "$build/compile_commands.json")
peer() { "$compiler" -std=c++20 -O2 -I "${eigen:-/usr/include/eigen3}" -c "$scratch/peer.cpp" -o "$scratch/peer.o"; }
rebuild() { touch "$root/models/catalogue/$1.hpp" && ninja -C "$build" orbid_models; }

ninja -C "$build" orbid_models >/dev/null
peer_seconds=$(seconds peer)
printf '%-24s%8s s\n' "Odeint and Eigen alone" "$peer_seconds"
for model in "${models[@]}"; do
    model_seconds=$(seconds rebuild "$model")
    awk -v name="$model" -v own="$model_seconds" -v peer="$peer_seconds" \
        'BEGIN { printf "%-24s%8s s   ratio %.2f\n", name, own, own / peer }'
done
