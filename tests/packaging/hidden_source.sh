# Sourced by the tests of packages: what is installed has to work where there is no source and no build folder.

fail() {
    echo "$test_name: $*" >&2
    exit 1
}

# Runs a command where the folder $hidden is empty: in a mount namespace of its own, which root can make; elsewhere
# (a container without that right) as it is.
can_hide() { ((EUID == 0)) && unshare -m true 2>/dev/null; }
without_source() {
    if can_hide; then
        unshare -m bash -c 'mount -t tmpfs none "$0" && exec "$@"' "$hidden" "$@"
    else
        "$@"
    fi
}

# The example that every tree must run, from an empty folder: cycles of the Henon map, a = 1.4 exactly.
run_example() { # program, folder of examples
    local here
    here=$(mktemp -d -p "$scratch")
    (cd "$here" && without_source "$1" run "$2/henon.json" --out out --quiet >summary) || fail "orbid run henon.json failed"
    grep -q '"status": "converged"' "$here/out/result.json" || fail "henon.json did not converge"
    grep -Eq '^ *a +1\.(4|39999)' "$here/summary" || fail "a of henon.json is not 1.4: $(cat "$here/summary")"
}
