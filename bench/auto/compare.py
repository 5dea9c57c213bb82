#!/usr/bin/env python3
"""Cycles of the torque-driven pendulum of periods 1 to 6, with both multipliers: multiple shooting against AUTO-07p.

    bench/auto/compare.py [BUILD] [DISPLACEMENT] [DRAWS]     default: build/release 3e-3 5

Both solve for the same orbits from the same disturbed points, on one thread and in one run. AUTO (Debian package
auto-07p) gets the flow of the points as its start, made continuous, and reports its own time ("Total Time"), without
the start of the program; multiple shooting counts its processor time. Errors are those of the multipliers against
tests/reference/driven_pendulum_orbits.json, relative. Says so and ends with 0 where AUTO or gfortran is missing.
"""
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile

HERE = os.path.dirname(os.path.abspath(__file__))
AUTO = os.environ.get("AUTO_DIR", "/usr/lib/auto-07p")


def built(folder):
    """AUTO with our equations, as an executable."""
    shutil.copy(os.path.join(HERE, "driven_pendulum.f90"), folder)
    objects = [os.path.join(AUTO, "lib", f) for f in os.listdir(os.path.join(AUTO, "lib")) if f.endswith(".o")]
    subprocess.run(["gfortran", "-O2", "-fopenmp", "driven_pendulum.f90", *objects, "-o", "auto",
                    "-L" + os.path.join(AUTO, "lib"), "-lauto_c"], cwd=folder, check=True)
    return os.path.join(folder, "auto")


def run_auto(program, folder, intervals):
    """One orbit: (milliseconds, multipliers but the trivial one); None where AUTO gave up.

    Two points of the branch: the start, and the orbit.
    """
    with open(os.path.join(HERE, "c.driven_pendulum"), encoding="ascii") as constants:
        text = re.sub(r"NTST *= *\d+", f"NTST = {intervals}", constants.read())
    with open(os.path.join(folder, "fort.2"), "w", encoding="ascii") as out:
        out.write(text)
    best = None
    for _ in range(5):  # the best of five, the same for both sides
        for name in ("fort.7", "fort.8", "fort.9", "multipliers.dat"):
            if os.path.exists(os.path.join(folder, name)):
                os.remove(os.path.join(folder, name))
        done = subprocess.run([program], cwd=folder, capture_output=True, text=True,
                              env={**os.environ, "OMP_NUM_THREADS": "1"}, check=False)
        time = re.search(r"Total Time\s+([0-9.E+-]+)", done.stdout)
        if time is None:
            return None
        best = min(best or 1e9, 1e3 * float(time.group(1)))
    with open(os.path.join(folder, "multipliers.dat"), encoding="ascii") as lines:
        last = [float(x) for x in lines.read().split("\n")[-2].split()]
    values = sorted((complex(last[i], last[i + 1]) for i in (0, 2, 4)), key=lambda m: abs(m - 1.0))
    return best, sorted((m.real for m in values[1:]), key=abs, reverse=True)


def main():
    build = os.path.abspath(sys.argv[1] if len(sys.argv) > 1 else os.path.join(HERE, "../../build/release"))
    if not os.path.isdir(os.path.join(AUTO, "lib")) or shutil.which("gfortran") is None:
        print(f"AUTO-07p is missing ({AUTO}/lib, gfortran): apt-get install auto-07p. Nothing was compared.")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        program = built(folder)
        displacement, draws = (sys.argv[2:4] + ["3e-3", "5"][len(sys.argv[2:4]):])[:2]
        starts = os.path.join(build, "bin", "driven_pendulum_starts")
        for setting, intervals, tolerance in (("400", lambda p: 400, "1e-13"), ("50 per period", lambda p: 50 * p, "1e-11")):
            ours = subprocess.run([starts, folder, displacement, draws, tolerance], check=True, capture_output=True,
                                  text=True).stdout.split("\n")
            rows = [line.split() for line in ours if line]
            print(f"shooting with a flow to {tolerance}, AUTO-07p with NTST {setting}, NCOL 4; medians of the times, "
                  "worst errors")
            print("period  starts | shooting: found  ms  unstable  stable | AUTO: found  ms  unstable  stable | ratio")
            for cycle in sorted({(int(r[1]), r[2], r[9]) for r in rows}):
                mine, theirs = [], []
                for r in rows:
                    if (int(r[1]), r[2], r[9]) != cycle:
                        continue
                    unstable, stable = float(r[2]), float(r[3])
                    mine.append((float(r[4]), float(r[7]), float(r[8])) if r[5] == "converged" else None)
                    answer = run_auto(program, os.path.join(folder, r[0]), intervals(int(r[1])))
                    if answer is None:
                        theirs.append(None)
                        continue
                    time, multipliers = answer
                    errors = abs(multipliers[0] / unstable - 1.0), abs(multipliers[1] / stable - 1.0)
                    # Another orbit than the one asked for has other multipliers altogether.
                    theirs.append((time, *errors) if errors[0] < 0.05 else None)
                print(f"{cycle[0]:6d}  {len(mine):6d} |", summary(mine), "|", summary(theirs))
                print_ratio(f"a cycle of period {cycle[0]} at phi {float(cycle[2]):.2f}, multiplier {float(cycle[1]):.3g}",
                            f"AUTO-07p, NTST {setting}", mine, theirs)
    return 0


def summary(results):
    good = [r for r in results if r is not None]
    if not good:
        return "found 0"
    return (f"{len(good):3d} {statistics.median(r[0] for r in good):8.3f} ms  {max(r[1] for r in good):.1e}  "
            f"{max(r[2] for r in good):.1e}")


def print_ratio(task, peer, mine, theirs):
    """A row of docs/performance.md, see ../ratio.hpp: medians over the starts from which both found the orbit."""
    both = [(a[0], b[0]) for a, b in zip(mine, theirs) if a is not None and b is not None]
    if both:
        print(f"ratio | {task} | {peer} | {statistics.median(a for a, _ in both):.4g} ms | "
              f"{statistics.median(b for _, b in both):.4g} ms | {statistics.median(a / b for a, b in both):.3f}")


if __name__ == "__main__":
    sys.exit(main())
