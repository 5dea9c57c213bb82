#!/usr/bin/env bash
# What a model misses is said in one sentence: each file of broken_models/ has one defect and names, behind "Says:", the
# sentence that must be the compiler's only error. With REPAIRED defined each must compile, so that it is this defect
# that the compiler sees.
#   broken_models.sh COMPILER
set -euo pipefail
compiler=$1
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../.." && pwd)
folder=$root/tests/models/definition/broken_models
compile=("$compiler" -std=c++20 -fsyntax-only -x c++)
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# What all have in common is read once.
parts=tests/models/definition/broken_models/parts.hpp
mkdir -p "$scratch/${parts%/*}"
if "$compiler" --version | grep -q clang; then
    "$compiler" -std=c++20 -w -I "$root" -x c++-header "$root/$parts" -o "$scratch/parts.pch"
    compile+=(-include-pch "$scratch/parts.pch" -I "$root")
else
    "$compiler" -std=c++20 -w -I "$root" -x c++-header "$root/$parts" -o "$scratch/$parts.gch"
    compile+=(-I "$scratch" -I "$root")
fi

# Compiles standard input, or files; prints what is wrong with the answer.
check() { # name, sentence, argument...
    local name=$1 says=$2 errors
    shift 2
    if "${compile[@]}" "$@" 2>"$scratch/$name"; then
        echo "$name: compiles" >&2
        return 1
    fi
    errors=$(grep -E '(^|[: ])error: ' "$scratch/$name" | sort -u)
    if [[ $(wc -l <<<"$errors") != 1 || $errors != *"$says"* ]]; then
        printf '%s: must say "%s", says\n%s\n' "$name" "$says" "$errors" >&2
        return 1
    fi
}

bad=0
count=0
for file in "$folder"/*.cpp; do
    read -r says <"$file"
    count=$((count + 1))
    check "$(basename "$file" .cpp)" "${says#// Says: }" "$file" || bad=$((bad + 1))
    echo "#include \"$file\"" >>"$scratch/repaired.cpp"
done
((count > 0)) || { echo "broken models: none found in $folder" >&2; exit 1; }

if ! "${compile[@]}" -DREPAIRED "$scratch/repaired.cpp" 2>"$scratch/errors"; then
    echo "the repaired models do not compile:" >&2
    grep -m 5 -E 'error' "$scratch/errors" >&2
    bad=$((bad + 1))
fi

# The way of a model into the library ends with the same sentence.
check instance "a model needs a table of its coordinates" - <<'EOT' || bad=$((bad + 1))
#include "models/kernels/model_kernel.hpp"
struct Broken {
    static constexpr std::string_view name = "broken", summary = "one defect", equations = "x' = -k x";
    static constexpr std::array parameters{
        orbid::models::Parameter{"k", "1/s", orbid::models::positive, 1.0, "rate"}};
};
template orbid::models::ModelInstance orbid::models::instance_of<Broken>();
EOT

# So does a model that computes with numbers as if they were one: it is instantiated for several widths.
check branching "equations that branch on their numbers cannot be computed in packs" - <<'EOT' || bad=$((bad + 1))
#include "models/kernels/model_kernel.hpp"
using namespace orbid::models;
struct Branching {
    static constexpr std::string_view name = "branching", summary = "one defect", equations = "x' = w";
    static constexpr std::array coordinates{real("x", "m")};
    static constexpr std::array parameters{Parameter{"w", "1/s", positive, 1.0, "frequency"}};
    static constexpr std::size_t forcing_frequency = 0;
    template <class T>
    static State<T, 1> rhs(const T& /*t*/, const State<T, 1>& x, const Values<T, 1>& p) {
        if (x[0] < 0.0) return {p[0]};
        return {-p[0]};
    }
};
template ModelInstance orbid::models::instance_of<Branching>();
EOT

((bad == 0)) || { echo "broken models: $bad of $count wrong" >&2; exit 1; }
echo "broken models: $count defects, each said in one sentence"
