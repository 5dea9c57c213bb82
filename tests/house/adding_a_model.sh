#!/usr/bin/env bash
# Does what docs/adding_a_model.md says, literally: writes its header, its test and its line in the registry into a copy,
# compiles these three as the build folder would, links them with what is built already, and runs the test and the
# commands of the text.
#   adding_a_model.sh BUILD_FOLDER      configured with Ninja, models_test and orbid built
set -euo pipefail
build=$(cd "$1" && pwd)
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
text=$source/docs/adding_a_model.md
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
fail() {
    echo "adding a model: $*" >&2
    exit 1
}

# The path in the heading that begins with $1, and the first block of code below it.
path_below() { sed -nE "s|^## $1.*\`([^\`]+)\`.*|\1|p" "$text"; }
block_below() { awk -v heading="## $1" 'index($0, heading) == 1 {inside = 1} /^```/ {if (code) exit; if (inside) {code = 1; next}} code' "$text"; }
indented_below() { awk -v heading="## $1" '/^## / {inside = index($0, heading) == 1} inside && /^    /' "$text"; }

header=$(path_below '1\. The header') test=$(path_below '2\. The test') registry=$(path_below '3\. The line')
line=$(indented_below '3. The line')
[[ -f $source/$registry && ! -e $source/$header && ! -e $source/$test ]] || fail "the files of the text must be new: $header, $test"
[[ $(wc -l <<<"$line") == 1 ]] || fail "section 3 holds one line"
mkdir -p "$copy/$(dirname "$header")" "$copy/$(dirname "$test")"
block_below '1. The header' >"$copy/$header"
block_below '2. The test' >"$copy/$test"
sed "/^static constexpr .*listed_models/a\\$line" "$source/$registry" >"$copy/$registry"
[[ $(diff "$source/$registry" "$copy/$registry" | grep -c '^[<>]') == 1 ]] || fail "the line did not get into $registry"

# As models/CMakeLists.txt derives the file from the struct; its generated file is that of another model, renamed.
struct=$(sed -nE 's/^ *&instance_of<struct ([A-Za-z0-9]+)>,$/\1/p' <<<"$line")
file=$(sed -E 's/([a-z0-9])([A-Z])/\1_\2/g' <<<"$struct" | tr '[:upper:]' '[:lower:]')
[[ models/catalogue/$file.hpp == "$header" ]] || fail "struct $struct belongs in models/catalogue/$file.hpp, not $header"
[[ tests/models/catalogue/${file}_test.cpp == "$test" ]] || fail "struct $struct is tested by tests/models/catalogue/${file}_test.cpp, not $test"
sed "s/Duffing/$struct/g; s/duffing/$file/g" "$build/models/duffing.cpp" >"$copy/$file.cpp"

# The command by which the build compiles an object, applied to another source; headers are looked for in the copy too.
compile() { # object of the build, source, new object, further flags
    local command
    command=$(ninja -C "$build" -t commands -s "$1" | tail -1)
    [[ $command == *" -c "* ]] || fail "the build does not make $1"
    command=${command%% -MD *}
    (cd "$build" && eval "$command ${4:-} -I$copy -o '$3' -c '$2'") || fail "$2 does not compile"
}
# The command by which the build links a program, with our objects in the place of some of its own. Of libraries only what
# is asked for is taken, so that our registry replaces that of the room.
link() { # program of the build, pattern of objects to leave out, our objects, new program
    local command
    command=$(ninja -C "$build" -t commands -s "$1" | tail -1)
    command=$(sed -E "s|-Wl,--whole-archive,[^ ]*||g; s|$2||g; s| -o (bin/[a-z_]+\|lib/liborbid[.a-z0-9]+) | -o '$4' $3 |" <<<"$command")
    (cd "$build" && eval "$command") || fail "$4 does not link"
}
objects=models/CMakeFiles/orbid_models.dir
include_first() { sed -i "1i #line 1 \"$1\"" "$2"; }
include_first "$header" "$copy/$header"
include_first "$test" "$copy/$test"
# The test of another model, or a batch of them.
# All of the list is read: a reader that leaves early ends Ninja by a signal.
test_object=$(ninja -C "$build" -t targets all |
    awk '/models_test\.dir\/catalogue/ && !found {sub(/: .*/, ""); print; found = 1}')
# With the flags of what is compiled for the machine, but optimising the model would gain nothing here.
compile $objects/system/processor_level.cpp.o "$copy/$file.cpp" "$copy/model.o" -O0 &
model=$!
compile $objects/catalogue/registry.cpp.o "$copy/$registry" "$copy/registry.o" &
list=$!
compile "$test_object" "$copy/$test" "$copy/test.o"
wait $model && wait $list || exit 1

link bin/models_test '[^ ]*models_test\.dir/[^ ]*\.o' "$copy/test.o $copy/registry.o $copy/model.o" "$copy/model_test"
result=$("$copy/model_test") || fail "the test fails: $result"
[[ $result == *"All tests passed"* ]] || fail "the test tests nothing: $result"

# The program takes whatever library it finds first.
library=$(readlink -f "$build/lib/liborbid.so")
link "lib/$(basename "$library")" '[^ ]*orbid_models\.dir/catalogue/registry\.cpp\.o' "$copy/registry.o $copy/model.o" "$copy/$(basename "$library")"
ln -s "$(basename "$library")" "$copy/$(sed -nE 's/.*-soname,([^ ]+) .*/\1/p' <<<"$(ninja -C "$build" -t commands -s "lib/$(basename "$library")" | tail -1)")"
export LD_LIBRARY_PATH="$copy"
ran=0
while read -r command; do
    [[ $command == ./dev* ]] && continue
    (cd "$copy" && eval "${command/build\/release\/bin\/orbid/$build\/bin\/orbid}" >"$copy/out" 2>&1) || fail "$command: $(cat "$copy/out")"
    ran=$((ran + 1))
done < <(indented_below '4. Using it')
((ran > 0)) || fail "section 4 runs nothing"
echo "adding a model: $file from the text compiles, is registered, passes its test; $ran commands ran"
