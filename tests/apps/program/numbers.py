#!/usr/bin/env python3
"""Models and records with odd numbers: every run ends in time, by a named outcome, and units change nothing but units.

    numbers.py PROGRAM [--show]

States that become NaN, infinite or denormal, flows that blow up, equations that jump at a node, problems that are
singular or fitted exactly: exit code and words of the outcome. The same systems with states of 2^-300 to 2^300 units,
and with all times so scaled: the same estimates and sds, to 2e-6 sds. The same periodic orbits by three methods and by
a search: points, times and multipliers to 1e-9 of themselves.
"""

import json
import math
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

LONGEST = 30  # seconds of the processor


def job(equations, estimated=None, initial=(1.0, 0.5), noise=0.01, step=0.1, count=40, parameters=None, **model):
    """A simulated series of x and v, and an estimate that starts a fifth off."""
    simulated = {"samples": {"step": step, "count": count}, "initial": [list(initial)]}
    if noise:
        simulated["noise"] = {"x": noise}
    parameters = parameters or {"k": 1.0}
    estimated = estimated or {"k": 1.2 * parameters["k"]}
    return {"model": {"equations": equations, "parameters": parameters, **model}, "seed": 1,
            "data": {"simulate": simulated}, "output": {"series": "none"},
            "estimate": {"parameters": {name: {"start": start} for name, start in estimated.items()},
                         "residuals": [{"type": "series"}]}}


OSCILLATOR = {"x": "v", "v": "-k * x"}
STILL = {"x": "-k * x", "v": "-v"}
LEFT = "left the range of finite numbers"
# Name: job, exit codes that are right, words that the outcome holds.
OUTCOMES = {
    "logarithm of nothing": (job({"x": "v", "v": "-k * log(x)"}), (0, 1), "k"),
    "root of less than nothing": (job({"x": "-sqrt(x) * k", "v": "0 * v"}), (3,), "stopped at 2 s: the state " + LEFT),
    "beyond its domain at once": (job({"x": "v", "v": "-k * asin(1.05 * x)"}), (3,), LEFT),
    "blows up": (job({"x": "k * x^2", "v": "-v"}), (3,), LEFT),
    "blows up at the start of the fit": (job({"x": "k * x^2", "v": "-v"}, {"k": 3.0}, parameters={"k": 0.2}), (0, 1), "k"),
    "overflows at once": (job({"x": "exp(100 * k * x)", "v": "-v"}), (3,), LEFT),
    "divides by nothing": (job({"x": "-k * x / (x - 0.5)", "v": "-v"}), (3,), LEFT),
    "falls to denormals": (job({"x": "-200 * k * x", "v": "-v"}, noise=1e-310), (0, 1), "k"),
    "jumps at the start": (job({"x": "-k * sign(x - 1)", "v": "-v"}), (0, 1), "k"),
    "jumps at a reading": (job({"x": "-k * sign(x - 0.5)", "v": "-v"}), (0, 1), "k"),
    "no error at all": (job(STILL, noise=None), (0,), "converged"),
    "nothing moves": (job(STILL, initial=(0.0, 0.0), noise=None), (3,), "nothing moves"),
    "noise alone": (job(STILL, initial=(0.0, 0.0)), (0, 1), "k"),
    "a parameter without effect": (job({"x": "-k * x + 0 * q", "v": "-v"}, {"k": 1.2, "q": 1.2},
                                       parameters={"k": 1.0, "q": 1.0}), (0, 1), "q"),
    "a product of two": (job({"x": "-k * q * x", "v": "-v"}, {"k": 1.2, "q": 1.2}, parameters={"k": 1.0, "q": 1.0}),
                         (0, 1), "q"),
    "a parameter without anything": (job({"x": "0 * k * x", "v": "-v"}), (0, 1, 3), "k"),
    "beyond the squares": (job(OSCILLATOR, initial=(1e300, 0.5e300), noise=1e298), (3,), "between 1e-100 and 1e100"),
    "below the squares": (job(OSCILLATOR, initial=(1e-300, 0.5e-300), noise=1e-302), (3,), "between 1e-100 and 1e100"),
    "denormals, and a coordinate that stays 0": (job(STILL, initial=(1e-310, 0.0), noise=None), (3,),
                                                 "between 1e-100 and 1e100"),
    "a rate of 1e12": (job({"x": "-1e12 * k * (x - cos(v))", "v": "1"}), (3,), "stiff"),
    "the same, stiff": (job({"x": "-1e12 * k * (x - cos(v))", "v": "1"}, stiff=True), (0, 1), "k"),
}


SCALE = 1.0 / 32.0


def lorenz(u, t):
    """Lorenz's equations with states of u and times of t units; all parameters keep their values."""
    return {"equations": {"x": "sigma * (y - x) / t", "y": f"(rho * x - x * z / u / {SCALE} - y) / t",
                          "z": f"(x * y / u / {SCALE} - beta * z) / t"},
            "parameters": {"sigma": 10.0, "rho": 28.0, "beta": 8.0 / 3.0, "u": u, "t": t}}


def scaled(exponent, clock):
    """A series, with states of 2^exponent and times of 2^clock units."""
    u, t = math.ldexp(1.0, exponent), math.ldexp(1.0, clock)
    simulated = {"samples": {"step": 0.02 * t, "count": 250}, "initial": [[0.03 * u, 0.05 * u, 0.6 * u]],
                 "transient": 500, "noise": {name: 0.002 * u for name in "xyz"}}
    return {"model": lorenz(u, t), "seed": 1, "data": {"simulate": simulated}, "output": {"series": "none"},
            "estimate": {"parameters": {"sigma": {"start": 8.0}, "rho": {"start": 25.0}, "beta": {"start": 3.0}},
                         "residuals": [{"type": "series"}]}}


METHODS = {"multiple_shooting": {"search": {"periods": [1, 2, 3], "points": 2048}},
           "finite_difference": {"stability": False}, "collocation": {"stability": False}}


def scaled_orbits(exponent, clock, method):
    """The orbit once around each wing, in such units, and with shooting a search for others."""
    u, t = math.ldexp(SCALE, exponent), math.ldexp(1.0, clock)
    points = [[-13.7 * u, -19.5 * u, 27.0 * u], [13.7 * u, 19.5 * u, 27.0 * u]]
    return {"model": lorenz(u / SCALE, t), "seed": 1, "section": {"coordinate": "z", "value": 27.0 * u, "direction": 1},
            "periodic": {"method": method, "orbits": [{"period": 2, "points": points}], **METHODS[method]}}


def run(program, folder, name, document):
    file = folder / f"{name}.json"
    file.write_text(json.dumps(document))
    command = ["bash", "-c", f"ulimit -t {LONGEST}; exec \"$@\"", "run", program, "run", str(file), "--out",
               str(folder / name), "--threads", "1", "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True)
    result = folder / name / ("orbits.json" if "periodic" in document else "result.json")
    return done.returncode, done.stdout + done.stderr, json.loads(result.read_text()) if result.exists() else None


def estimates(result):
    return {name: (one["value"], one["sd"]) for name, one in result["parameters"].items()}


def orbits(result, exponent, clock):
    """Period, time, first point and multipliers of all orbits, in units of one."""
    return [[one["period"], math.ldexp(one["time"], -clock), *(math.ldexp(x, -exponent) for x in one["points"][0]),
             *(part for number in one["multipliers"] or [] for part in number)] for one in result["cycles"]
            if one["status"] == "converged"]


def farthest(found, base):
    """The largest difference of two lists of orbits; multipliers below 1e-6 are rounding."""
    if [len(one) for one in found] != [len(one) for one in base]:
        return math.inf
    return max((abs(a - b) / max(abs(b), 1e-6) for one, other in zip(found, base) for a, b in zip(one, other)),
               default=math.inf)


def main():
    program, show = str(Path(sys.argv[1]).resolve()), "--show" in sys.argv
    failures = 0

    def check(good, name, what):
        nonlocal failures
        if show or not good:
            print(f"{'' if good else 'WRONG '}{name}: {what}")
        failures += not good

    with tempfile.TemporaryDirectory() as temporary, ThreadPoolExecutor(2) as pool:
        folder = Path(temporary)
        units = [(0, 0), (-20, 0), (-100, 0), (-300, 0), (0, -60), (-100, 60), (100, 0), (300, 0)]
        answers = {name: pool.submit(run, program, folder, name.replace(" ", "_"), case[0])
                   for name, case in OUTCOMES.items()}
        same = {key: pool.submit(run, program, folder, f"units_{key[0]}_{key[1]}", scaled(*key)) for key in units}
        moving = {(key, method): pool.submit(run, program, folder, f"orbits_{key[0]}_{key[1]}_{method}",
                                             scaled_orbits(*key, method))
                  for key in units + [(0, 60)] for method in METHODS}
        for name, (_, codes, words) in OUTCOMES.items():
            code, said, result = answers[name].result()
            ending = f"{code}, {result['status'] if result else said.strip()[:300]}"
            check(code in codes and words in said and "internal error" not in said, name, ending)
        base = estimates(same[0, 0].result()[2])
        for key in units:
            code, said, result = same[key].result()
            if code != 0 or result is None:
                check(False, f"units of 2^{key[0]}, times of 2^{key[1]}", f"{code}: {said.strip()[:300]}")
                continue
            found = estimates(result)
            off = max(max(abs(found[p][0] - base[p][0]), abs(found[p][1] - base[p][1])) / base[p][1] for p in base)
            check(off <= 2e-6, f"units of 2^{key[0]}, times of 2^{key[1]}", f"{off:.3g} sds off")
        for (key, method), answer in moving.items():
            code, said, result = answer.result()
            name = f"orbits by {method}, units of 2^{key[0]}, times of 2^{key[1]}"
            if code != 0 or result is None:
                check(False, name, f"{code}: {said.strip()[:300]}")
                continue
            base = orbits(moving[(0, 0), method].result()[2], 0, 0)
            off = farthest(orbits(result, *key), base)
            check(off <= 1e-9, name, f"{len(base)} orbits, {off:.3g} off")
    print(f"{len(OUTCOMES)} outcomes, {len(units)} systems of units, {len(moving)} lists of orbits: {failures} failures")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
