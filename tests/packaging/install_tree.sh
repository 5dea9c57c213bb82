#!/usr/bin/env bash
# Installs into a prefix, moves it elsewhere, hides source and build, and uses it as strangers would: runs an example job,
# compiles equations of a job, builds examples/ by CMake and by pkg-config and compares what they print with its README.
#   install_tree.sh SOURCE BUILD COMPILER
set -euo pipefail
test_name=install_tree
source=$(cd "$1" && pwd) build=$(cd "$2" && pwd) compiler=$3 hidden=$source
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
. "$source/tests/packaging/hidden_source.sh"

# A link in the place of the prefix would be followed out of it; a tree that moves must not notice.
cmake --install "$build" --prefix "$scratch/first" >/dev/null
while read -r file; do
    [[ $file == "$scratch"/first/* ]] || fail "installed outside the prefix: $file"
done <"$build/install_manifest.txt"
prefix=$scratch/moved
mv "$scratch/first" "$prefix"
# Pages are copies of the source's, which may name any folder.
grep -rIl --exclude='*.md' -e "$source" -e "$scratch/first" "$prefix" >"$scratch/named" || true
[[ ! -s $scratch/named ]] || fail "these name the folder that they were built in: $(cat "$scratch/named")"

orbid=$prefix/bin/orbid
for file in bin/orbid share/doc/orbid/copyright share/doc/orbid/README.md share/doc/orbid/third_party_licences.txt \
    share/doc/orbid/configs/README.md share/doc/orbid/examples/data/hare_lynx/README.md share/orbid/orbid-job.schema.json share/orbid/orbid-campaign.schema.json \
    share/bash-completion/completions/orbid share/zsh/vendor-completions/_orbid; do
    [[ -s $prefix/$file ]] || fail "$file is not installed"
done
bash -n "$prefix/share/bash-completion/completions/orbid" || fail "the completion of bash has an error"
compgen -G "$prefix/share/man/man1/orbid.1*" >/dev/null || fail "the manual page is not installed"
without_source "$orbid" --version | grep '^orbid [0-9]' >/dev/null || fail "orbid --version says nothing"
run_example "$orbid" "$prefix/share/doc/orbid/examples"

# Equations are compiled against the installed headers; without them the reason names the package.
cat >"$scratch/equations.json" <<'JOB'
{ "model": { "equations": { "x": "1 - a * x^2 + y", "y": "b * x" }, "parameters": { "a": 1.4, "b": 0.3 },
             "kind": "map", "compile": true },
  "data": { "simulate": { "sections": 2000, "initial": [[0.1, 0.1]] } },
  "orbits": { "periods": [1, 2] },
  "estimate": { "parameters": { "a": { "start": 1.39 } }, "residuals": [ { "type": "cycles" } ] } }
JOB
export XDG_CACHE_HOME=$scratch/cache
(cd "$scratch" && without_source "$orbid" run equations.json --quiet >/dev/null) || fail "equations.json failed"
grep -q '"evaluated": "compiled"' "$scratch/equations/result.json" ||
    fail "equations were not compiled: $(cat "$scratch/equations/log.txt")"
if can_hide; then
    mv "$prefix/include" "$prefix/away"
    without_source "$orbid" check "$scratch/equations.json" >"$scratch/check" 2>&1 || true
    mv "$prefix/away" "$prefix/include"
    grep -q 'liborbid-dev' "$scratch/check" || fail "what is missing is not named: $(cat "$scratch/check")"
fi

# The examples, from a copy of the installed folder.
cp -r "$prefix/share/doc/liborbid-dev/examples" "$scratch/examples"
start=$SECONDS
(cd "$scratch/examples" && without_source cmake -S . -B build -DCMAKE_PREFIX_PATH="$prefix" \
    -DCMAKE_CXX_COMPILER="$compiler" -DCMAKE_CXX_FLAGS=-Wall >"$scratch/log" 2>&1 &&
    without_source cmake --build build --parallel 2 >>"$scratch/log" 2>&1) || fail "examples: $(cat "$scratch/log")"
echo "examples: $((SECONDS - start)) s from cmake -S to the programs"
for name in estimate identify own_model own_residual; do
    (cd "$scratch/examples" && without_source "build/$name") >"$scratch/$name.txt" || fail "$name failed: $(cat "$scratch/$name.txt")"
    [[ -s $scratch/$name.txt ]] || fail "$name prints nothing"
    while read -r line; do
        grep -qFx -- "$line" "$scratch/examples/README.md" || fail "$name prints what its README does not: $line"
    done <"$scratch/$name.txt"
done

# All of a project for this machine, and under the address sanitizer: its copies of Eigen allocate as the library does.
(cd "$scratch/examples" && without_source cmake -S . -B native -DCMAKE_PREFIX_PATH="$prefix" \
    -DCMAKE_CXX_COMPILER="$compiler" -DCMAKE_CXX_FLAGS="-march=native -fsanitize=address" >"$scratch/log" 2>&1 &&
    without_source cmake --build native --target own_residual >>"$scratch/log" 2>&1) || fail "native: $(cat "$scratch/log")"
without_source "$scratch/examples/native/own_residual" | cmp - "$scratch/own_residual.txt" || fail "native: another result"

# By hand, and for this machine.
if command -v pkg-config >/dev/null; then
    export PKG_CONFIG_PATH
    PKG_CONFIG_PATH=$(dirname "$(find "$prefix" -name orbid.pc)")
    read -ra flags <<<"$(pkg-config --cflags --libs orbid)"
    without_source "$compiler" -std=c++20 -O1 -march=native "$scratch/examples/estimate.cpp" "${flags[@]}" \
        -Wl,-rpath,"$(pkg-config --variable=libdir orbid)" -o "$scratch/by_hand" || fail "pkg-config: estimate.cpp does not compile"
    without_source "$scratch/by_hand" >"$scratch/by_hand.txt" || fail "the program made by hand failed"
    cmp "$scratch/by_hand.txt" "$scratch/estimate.txt" || fail "made by hand the example prints something else"
    # Where Eigen would allocate in another way the compiler says so, and what to do.
    if "$compiler" -std=c++20 -fsyntax-only "$scratch/examples/own_residual.cpp" -I"$prefix/include/orbid" \
        $(pkg-config --cflags eigen3) 2>"$scratch/log"; then
        fail "a program that allocates in another way is compiled"
    fi
    grep 'compile with -DEIGEN_MAX_ALIGN_BYTES=16' "$scratch/log" >/dev/null || fail "the cure is not named: $(cat "$scratch/log")"
fi
echo "$test_name: moved, without source: job, compiled equations and examples work$(can_hide || echo ' (source not hidden)')"
