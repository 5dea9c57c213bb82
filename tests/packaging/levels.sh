#!/usr/bin/env bash
# The libraries of a build for several levels of instructions: each holds those of its level and none beyond, and the
# loader takes the one of the level that it is allowed. Exit code 77: this is no such build.
#   levels.sh BUILD BASE LEVEL...      LEVEL as in ORBID_LEVELS
set -euo pipefail
build=$(cd "$1" && pwd) base=$2
shift 2
fail() {
    echo "levels: $*" >&2
    exit 1
}
[[ $base == x86-64* && $(uname -m) == x86_64 ]] || { echo "levels: skipped: a build for this machine alone"; exit 77; }
command -v objdump >/dev/null || { echo "levels: skipped: there is no objdump"; exit 77; }

# Registers tell the instructions: ymm and the VEX encodings of xmm begin with AVX, zmm and masks with AVX-512.
uses() { # library, pattern
    objdump -d --no-show-raw-insn "$1" | grep -E "$2" >/dev/null
}
avx=$'\tv[a-z0-9]+ .*%[xyz]mm|%ymm' avx512='%zmm|%k[1-7]\b|%[xy]mm(1[6-9]|2[0-9]|3[01])'
# That the patterns see what they are for, and only that.
seen() { printf '  4f0:\t%s\n' "$2" | grep -E "$1" >/dev/null; }
seen "$avx" 'vaddsd %xmm1,%xmm0,%xmm0' && seen "$avx512" 'vaddpd %ymm1,%ymm17,%ymm0' || fail "a pattern misses its instructions"
! seen "$avx" 'addsd  %xmm1,%xmm0' && ! seen "$avx512" 'vaddpd %ymm1,%ymm2,%ymm0' || fail "a pattern takes others' instructions"
name=$(basename "$(readlink -f "$build/lib/liborbid.so")")
uses "$build/lib/$name" "$avx" && fail "the library of $base holds AVX instructions"
for level in "$@"; do
    library=$build/lib/glibc-hwcaps/$level/$name
    [[ -f $library ]] || fail "there is no library for $level"
    uses "$library" "$avx" || fail "the library of $level holds no AVX instructions"
    if [[ $level == x86-64-v4 ]]; then
        uses "$library" "$avx512" || fail "the library of $level holds no AVX-512 instructions"
    else
        uses "$library" "$avx512" && fail "the library of $level holds AVX-512 instructions"
    fi
done

# The loader: its own list says which levels this processor has.
loader=/lib64/ld-linux-x86-64.so.2
have=$("$loader" --help | sed -nE 's/^  (x86-64-v[0-9]) \(supported.*/\1/p')
taken() { "$loader" --glibc-hwcaps-mask "$1" "$build/bin/orbid" --version | sed -nE 's/.*\((.*)\)$/\1/p'; }
[[ $(taken none) == "$base" ]] || fail "without levels the loader takes $(taken none), not $base"
tried=$base
for level in "$@"; do
    grep -qx "$level" <<<"$have" || continue
    [[ $(taken "$level") == "$level" ]] || fail "of level $level the loader takes $(taken "$level")"
    tried+=" $level"
done
echo "levels: $base $*, each of its instructions alone; tried on this processor: $tried"
