#!/usr/bin/env bash
# Includes between rooms go one way only. All rooms share one include root, so the linker cannot hold this: this script does.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

declare -A may=(
    [models]='^models/'
    [estimator]='^estimator/'
    [periodic]='^(periodic|models)/|^estimator/(residual|prior)\.hpp'
    [orbits]='^(orbits|periodic|models)/|^estimator/(residual|prior)\.hpp'
    [apps]='^(apps|orbits|periodic|models|estimator)/'
)
seen=0
bad=0
for room in models estimator periodic orbits apps; do
    while IFS=: read -r file line include; do
        seen=$((seen + 1))
        path=$(sed -E 's/.*"([^"]+)".*/\1/' <<<"$include")
        if ! [[ $path =~ ${may[$room]} ]]; then
            echo "$file:$line: $room/ may not include $path" >&2
            bad=1
        fi
    done < <(grep -nHE '^ *# *include +"' -r "$room" --include='*.hpp' --include='*.cpp' || true)
    if [[ $room != apps ]] && grep -rlE 'nlohmann|std::(cout|cerr|clog)|fmt::print|printf *\(|[^_a-z]exit *\(' "$room" \
        --include='*.hpp' --include='*.cpp'; then
        echo "$room/: JSON, printing and exiting belong to apps/ alone (files above)" >&2
        bad=1
    fi
done
((seen > 0)) || { echo "include arrows: no include found, the search is broken" >&2; exit 1; }
((bad == 0)) || exit 1
echo "include arrows: $seen includes, all allowed"
