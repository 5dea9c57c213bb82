#!/usr/bin/env bash
# Looks at reports in headless Chromium: tests/report/run.sh PROGRAM FOLDER [long_tasks]
# PROGRAM is orbid; FOLDER takes packages and reports. With long_tasks the times of a report with a million points are
# printed (Chromium's own trace) instead of testing. Exit code 77, which CTest calls skipped, without Chromium or npm.
set -euo pipefail
program=$(realpath "$1")
mkdir -p "$2"
folder=$(realpath "$2")
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
root=$(cd "$here/../.." && pwd)

ORBID_CHROMIUM=${ORBID_CHROMIUM:-$(command -v chromium || command -v chromium-browser || command -v google-chrome || true)}
for tool in "${ORBID_CHROMIUM:-chromium}" npm node; do
    command -v "$tool" >/dev/null || { echo "skipped: $tool is not installed"; exit 77; }
done
export ORBID_CHROMIUM

# Packages once per lock file; sources are copied, so that nothing is written beside them.
cp "$here"/*.js "$here"/package.json "$here"/package-lock.json "$folder"
if ! cmp -s "$here/package-lock.json" "$folder/node_modules/.fetched"; then
    (cd "$folder" && npm ci --ignore-scripts --no-audit --no-fund --loglevel=error)
    cp "$here/package-lock.json" "$folder/node_modules/.fetched"
fi

export ORBID_REPORTS=$folder/reports
mkdir -p "$ORBID_REPORTS"
for job in pendulum_table3 hare_lynx pendulum_cascade henon; do
    # A run that is there already is taken again; its report is made anew by the program under test.
    "$program" run "$root/configs/$job.json" --out "$ORBID_REPORTS/$job" --quiet --force >/dev/null
done
"$program" run "$here/hostile_names.json" --out "$ORBID_REPORTS/hostile" --quiet --force >/dev/null
cd "$folder"
if [[ ${3:-} == long_tasks ]]; then exec node long_tasks.js; fi
exec node --test --test-concurrency=1 ./*_test.js
