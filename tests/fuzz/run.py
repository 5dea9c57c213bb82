#!/usr/bin/env python3
"""Lets libFuzzer try one target or all of them, and says how many executions ended without a finding.

    run.py FUZZER [TARGET] [SECONDS]

It begins with corpus/TARGET and what earlier calls found in BUILD/fuzz/found/TARGET. A finding is left in
BUILD/fuzz/found/TARGET-crash-*: after it is mended it belongs into corpus/TARGET.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

TARGETS = ("job", "formulas", "cycles", "orbits", "checkpoint", "csv", "hdf5", "stored")
CORPUS = Path(__file__).with_name("corpus")
LONGEST = {"hdf5": 20000, "stored": 20000}  # bytes; shorter inputs are tried faster


def tried(fuzzer, target, seconds):
    found = fuzzer.parent / "found" / target
    found.mkdir(parents=True, exist_ok=True)
    command = [str(fuzzer), str(found), str(CORPUS / target), f"-max_total_time={seconds}", "-timeout=20",
               "-rss_limit_mb=2500", f"-max_len={LONGEST.get(target, 5000)}",
               "-print_final_stats=1", f"-artifact_prefix={found.parent}/{target}-"]
    environment = {**os.environ, "ORBID_FUZZ_TARGET": target, "ORBID_CXX": "",
                   "ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1:detect_odr_violation=0"}
    run = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace")
    executions = re.search(r"stat::number_of_executed_units:\s*(\d+)", run.stderr)
    rate = re.search(r"stat::average_exec_per_sec:\s*(\d+)", run.stderr)
    print(f"{target:<11} {int(executions[1]) if executions else 0:>12} executions, {rate[1] if rate else '?'} per second, "
          f"{'no finding' if run.returncode == 0 else 'A FINDING'}", flush=True)
    if run.returncode != 0:
        print("\n".join(run.stderr.splitlines()[-60:]))
    return run.returncode == 0


def main():
    fuzzer = Path(sys.argv[1]).resolve()
    words = sys.argv[2:]
    targets = [words[0]] if words and not words[0].isdigit() else list(TARGETS)
    if targets[0] not in TARGETS:
        sys.exit(f"there is no target {targets[0]}; there are: {', '.join(TARGETS)}")
    seconds = int(words[-1]) if words and words[-1].isdigit() else 60
    sys.exit(0 if all([tried(fuzzer, target, seconds) for target in targets]) else 1)


if __name__ == "__main__":
    main()
