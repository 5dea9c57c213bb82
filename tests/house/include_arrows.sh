#!/usr/bin/env bash
# Includes between rooms go one way only. All rooms share one include root, so the linker cannot hold this: this script does.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

declare -A may=(
    [models]='^models/'
    [estimator]='^estimator/'
    [periodic]='^(periodic|models)/|^estimator/(residual|prior)\.hpp'
    [orbits]='^(orbits|periodic|models)/|^estimator/(residual|prior|random_stream)\.hpp'
    [apps]='^(apps|orbits|periodic|models|estimator)/'
)
# What a library must not do: read or write JSON, print, end the program. Comments are cut off before the search, and
# snprintf, which formats in memory, is not printf.
forbidden='nlohmann|<iostream>|\b(cout|cerr|clog|stdout|stderr)\b|\bfmt::print|\b(v?printf|puts|putchar|perror)\b *\('
forbidden+='|\b(exit|quick_exit|_Exit|abort|terminate) *\('
for trial in 'std::printf("x");' 'std::fprintf(stderr, "x");' 'fmt::print("x");' 'cout << 1;' 'std::exit (1);'; do
    grep -qE "$forbidden" <<<"$trial" || { echo "include arrows: does not see $trial" >&2; exit 1; }
done
for trial in 'std::snprintf(text, 9, "x");' 'early_exit(1);' 'at_exit = 1;' 'inputs(1);'; do
    ! grep -qE "$forbidden" <<<"$trial" || { echo "include arrows: objects to $trial" >&2; exit 1; }
done

seen=0
bad=0
for room in models estimator periodic orbits apps; do
    while IFS= read -r found; do
        seen=$((seen + 1))
        [[ $found =~ ^([^:]+:[0-9]+):.*[\"\<]([^\"\>]+) ]]
        place=${BASH_REMATCH[1]} path=${BASH_REMATCH[2]}
        if ! [[ $path =~ ${may[$room]} ]]; then
            echo "$place: $room/ may not include $path" >&2
            bad=1
        fi
    done < <(grep -rnHE '^ *# *include +("|<(models|estimator|periodic|orbits|apps|tests)/)' "$room" \
        --include='*.hpp' --include='*.cpp' || true)
    [[ $room == apps ]] && continue
    while IFS= read -r file; do
        if sed 's|//.*||' "$file" | grep -nE "$forbidden" | sed "s|^|$file:|" >&2; then
            echo "$file: JSON, printing and exiting belong to apps/ alone" >&2
            bad=1
        fi
    done < <(find "$room" -name '*.hpp' -o -name '*.cpp')
done
((seen > 0)) || { echo "include arrows: no include found, the search is broken" >&2; exit 1; }
((bad == 0)) || exit 1
echo "include arrows: $seen includes, all allowed"
