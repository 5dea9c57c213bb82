#!/usr/bin/env bash
# Builds the Debian packages of a build folder and installs them where nothing of orbid is, without its source; runs an
# example job from an empty folder; removes them and looks for what is left behind. Exit code 77: not possible here.
#   debian_package.sh SOURCE BUILD
# The machine is not touched: packages go into an overlay of its root, or, where root may not mount, below a folder.
set -euo pipefail
test_name=debian_package
source=$(cd "$1" && pwd) build=$(cd "$2" && pwd) hidden=$source
for program in cpack dpkg dpkg-deb dpkg-shlibdeps; do
    command -v $program >/dev/null || { echo "$test_name: skipped: there is no $program"; exit 77; }
done
((EUID == 0)) || { echo "$test_name: skipped: only root installs packages"; exit 77; }
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
. "$source/tests/packaging/hidden_source.sh"

(cd "$scratch" && cpack --config "$build/CPackConfig.cmake" -B "$scratch/cpack" >"$scratch/log" 2>&1) ||
    fail "cpack: $(tail -20 "$scratch/log")"
packages=("$scratch"/cpack/*.deb)
program=$(compgen -G "$scratch/cpack/orbid_*.deb") || fail "there is no package orbid"
development=$(compgen -G "$scratch/cpack/liborbid-dev_*.deb") || fail "there is no package liborbid-dev"
module=$(compgen -G "$scratch/cpack/python3-orbid_*.deb") || module=
mpi=$(compgen -G "$scratch/cpack/orbid-mpi_*.deb") || mpi=
depends=$(dpkg-deb -f "$program" Depends)
for library in libc6 libtbb libhdf5; do
    [[ $depends == *$library* ]] || fail "orbid does not depend on $library: $depends"
done
[[ -z $module || $(dpkg-deb -f "$module" Depends) == *"python3 (<< 3."* ]] || fail "python3-orbid may meet another Python"
# MPI stays out of the program: only its plug-in has it.
[[ $depends != *mpi* ]] || fail "orbid depends on MPI: $depends"
if [[ -f $build/lib/orbid/orbid-mpi.so ]]; then
    [[ -n $mpi ]] || fail "there is no package orbid-mpi"
    depends=$(dpkg-deb -f "$mpi" Depends)
    [[ $depends == *"orbid (= "* && $depends == *mpi* ]] || fail "orbid-mpi depends on $depends"
    dpkg-deb -c "$mpi" | grep -E '/lib/([^ /]*/)?orbid/orbid-mpi\.so$' >/dev/null || fail "orbid-mpi holds no plug-in"
fi
[[ $(dpkg-deb -f "$development" Depends) == *"orbid (= "* ]] || fail "liborbid-dev may meet another version of orbid"
for package in "${packages[@]}"; do
    dpkg-deb -c "$package" | awk '$2 != "root/root" {exit 1}' || fail "$package holds files that are not root's"
    dpkg-deb -c "$package" | awk '$1 ~ /^.....w|^........w/ && $1 !~ /^l/ {exit 1}' || fail "$package: files that others may write"
    dpkg-deb --ctrl-tarfile "$package" | tar -t | grep md5sums >/dev/null || fail "$package has no md5sums"
done
dpkg-deb --ctrl-tarfile "$program" | tar -xO ./triggers 2>/dev/null | grep ldconfig >/dev/null || fail "ldconfig is not triggered"

# In an overlay of this machine's root: dpkg knows which dependencies are there. The job runs in it too.
in_overlay() {
    local root=$scratch/root
    mkdir -p "$root" "$scratch/layer"
    mount -t tmpfs none "$scratch/layer" && mkdir "$scratch/layer/upper" "$scratch/layer/work" || return 77
    mount -t overlay overlay -o "lowerdir=/,upperdir=$scratch/layer/upper,workdir=$scratch/layer/work" "$root" || return 77
    [[ -x $root/usr/bin/dpkg ]] || return 77
    # Whatever is installed already is not ours to test.
    if chroot "$root" dpkg -s orbid >/dev/null 2>&1; then chroot "$root" dpkg -r orbid liborbid-dev python3-orbid orbid-mpi >/dev/null 2>&1; fi
    mount --bind /proc "$root/proc" && mount --bind /dev "$root/dev" && mount -t tmpfs none "$root/tmp" || return 77
    mkdir -p "$root$source" && mount -t tmpfs none "$root$source"
    cp "$program" "$development" ${module:+"$module"} ${mpi:+"$mpi"} "$root/tmp/"
    find "$scratch/layer/upper" ! -type d | sort >"$scratch/before"
    chroot "$root" dpkg -i "/tmp/$(basename "$program")" >"$scratch/log" 2>&1 || fail "dpkg -i: $(cat "$scratch/log")"
    chroot "$root" sh -c 'mkdir /tmp/empty && cd /tmp/empty && orbid run /usr/share/doc/orbid/examples/henon.json --out out --quiet' \
        >"$scratch/summary" || fail "the example job failed"
    grep -Eq '^ *a +1\.(4|39999)' "$scratch/summary" || fail "a of henon.json is not 1.4: $(cat "$scratch/summary")"
    chroot "$root" dpkg -i "/tmp/$(basename "$development")" >"$scratch/log" 2>&1 || fail "dpkg -i: $(cat "$scratch/log")"
    local installed=(liborbid-dev orbid)
    if [[ -n $module ]] && chroot "$root" dpkg -s python3-numpy 2>/dev/null | grep '^Status: install ok' >/dev/null; then
        chroot "$root" dpkg -i "/tmp/$(basename "$module")" >"$scratch/log" 2>&1 || fail "dpkg -i: $(cat "$scratch/log")"
        local version
        version=$(chroot "$root" sh -c 'cd /tmp/empty && /usr/bin/python3 -c "import orbid; print(orbid.__version__)"') ||
            fail "Python does not import orbid"
        [[ $(dpkg-deb -f "$module" Version) == "$version"-* ]] || fail "python3-orbid is of another version: $version"
        installed=(python3-orbid "${installed[@]}")
    fi
    if [[ -n $mpi ]]; then
        chroot "$root" dpkg -i "/tmp/$(basename "$mpi")" >"$scratch/log" 2>&1 || fail "dpkg -i: $(cat "$scratch/log")"
        installed=(orbid-mpi "${installed[@]}")
        # A campaign whose ranks MPI has started, by the installed plug-in.
        if chroot "$root" mpiexec --version 2>/dev/null | grep -E 'OpenRTE|Open MPI' >/dev/null; then
            chroot "$root" sh -c 'cd /tmp/empty && export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 &&
                sed -E "s/(\"replicates\": )[0-9]+/\13/" /usr/share/doc/orbid/examples/campaigns/henon_coverage.json >few.json &&
                mpiexec --oversubscribe -n 2 orbid campaign few.json --quiet' >"$scratch/log" 2>&1 &&
                grep '3 done, 0 failed, 0 waiting' "$scratch/log" >/dev/null || fail "a campaign under mpiexec: $(cat "$scratch/log")"
        fi
    fi
    chroot "$root" dpkg -r "${installed[@]}" >"$scratch/log" 2>&1 || fail "dpkg -r: $(cat "$scratch/log")"
    printf '%s\n' "${installed[@]}" >"$scratch/used"
    # Of the books that dpkg, ldconfig and man-db keep the content differs; of orbid nothing may be in them.
    find "$scratch/layer/upper" ! -type d | sort >"$scratch/after"
    comm -13 "$scratch/before" "$scratch/after" | sed "s|^$scratch/layer/upper||" |
        grep -Ev '^/(var/lib/dpkg/|var/log/|var/cache/(man|ldconfig|debconf)/|etc/ld\.so\.cache$)' >"$scratch/left" || true
    find "$root"/usr "$root"/etc "$root"/var/lib/dpkg/info -name '*orbid*' ! -name '*forbid*' -not -path "$root$source/*" >>"$scratch/left" 2>/dev/null
    [[ ! -s $scratch/left ]] || fail "left behind: $(cat "$scratch/left")"
    chroot "$root" dpkg -l orbid 2>/dev/null | grep '^[ir]' >/dev/null && fail "dpkg still knows orbid"
    return 0
}
# Below a folder: dpkg with a book of its own, in which no other package is, so no Python either.
below_folder() {
    local root=$scratch/root
    mkdir -p "$root/var/lib/dpkg"/{info,updates,triggers}
    : >"$root/var/lib/dpkg/status"
    local dpkg=(dpkg --root="$root" --force-depends --force-script-chrootless --no-triggers --log=/dev/null)
    "${dpkg[@]}" -i "$program" "$development" >"$scratch/log" 2>&1 || fail "dpkg -i: $(cat "$scratch/log")"
    local library
    library=$(dirname "$(find "$root/usr/lib" -name 'liborbid.so.*' -not -path '*/glibc-hwcaps/*' | head -1)")
    export LD_LIBRARY_PATH=$library
    run_example "$root/usr/bin/orbid" "$root/usr/share/doc/orbid/examples"
    "${dpkg[@]}" -r liborbid-dev orbid >"$scratch/log" 2>&1 || fail "dpkg -r: $(cat "$scratch/log")"
    [[ -z $(find "$root" ! -type d -not -path "$root/var/lib/dpkg/*") ]] || fail "left behind: $(find "$root" ! -type d)"
    printf '%s\n' orbid liborbid-dev >"$scratch/used"
    [[ ! -e $root/usr ]] || fail "folders are left behind: $(find "$root/usr")"
}
export -f in_overlay fail
export scratch source program development module mpi test_name
how="overlay of this machine's root"
code=77
if can_hide; then
    code=0
    unshare -m bash -euc 'in_overlay' || code=$?
fi
if ((code == 77)); then
    how="a folder as root"
    below_folder
elif ((code != 0)); then
    exit $code
fi
echo "$test_name: ${#packages[@]} packages packed, $(wc -l <"$scratch/used") of them installed into $how, used and removed without a trace"
