#!/usr/bin/env python3
"""Right jobs that nobody has tried: options that go with each other by the schema, drawn at random, on short records.

    combinations.py PROGRAM [--count N] [--seed N] [--jobs N] [--keep FOLDER]

Whatever a job asks for, it ends by name: with an estimate, or with the reason why there is none. Findings are internal
errors, signals, results without a status, and runs that take longer than --seconds. A finding's job is kept.
"""

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

SLOWNESS = float(os.environ.get("ORBID_TEST_SLOWNESS", "1"))  # of a program with sanitizers
LORENZ = {"name": "lorenz", "parameters": {"sigma": 10.0, "rho": 28.0, "beta": 8.0 / 3.0}}
SWING = {"name": "free_pendulum", "parameters": {"w0sq": 19.62, "c1": 0.2}}
HENON = {"name": "henon", "parameters": {"a": 1.4, "b": 0.3}}
SHAKEN = {"name": "shaken", "equations": {"x": "v", "v": "-delta * v - alpha * x - beta * x^3 + gamma * cos(tau)"},
          "parameters": {"delta": {"value": 0.3, "domain": "positive"}, "alpha": -1.0,
                         "beta": {"value": 1.0, "domain": "positive"}, "gamma": 0.5,
                         "omega": {"value": 1.2, "domain": "positive"}},
          "forcing_phase": {"name": "tau", "frequency": "omega"},
          "symmetry": {"signs": {"x": -1, "v": -1}, "phase_shift": 3.141592653589793}}
STEADY = {**SHAKEN, "name": "steady", "parameters": {**SHAKEN["parameters"], "alpha": 1.0}}
RUBBING = {"name": "rubbing", "equations": {"x": "v", "v": "-k * x - d * v - f * sign(v)"},
           "parameters": {"k": {"value": 4.0, "domain": "positive"}, "d": 0.1,
                          "f": {"value": 0.05, "domain": "nonnegative"}}}
CYCLE = {"name": "cycle", "equations": {"x": "y", "y": "mu * (1 - x^2) * y - x"}, "parameters": {"mu": {"value": 1.0}}}

# model, what is simulated, sds of readings, estimated parameters with starts, what may be observed, types of residuals
RECORDS = {
    "swing": (SWING, {"samples": {"step": 0.05, "count": 80}, "initial": [[1.2, 0.0], [0.6, 0.5]], "trajectories": 2},
              {"phi": 5e-3, "phi_dot": 2e-2}, {"w0sq": 17.0, "c1": 0.3}, [["phi"], ["phi", "phi_dot"]], ["series"]),
    "henon": (HENON, {"sections": 300, "initial": [[0.1, 0.1]], "transient": 50}, {"x": 1e-3, "y": 1e-3},
              {"a": 1.45, "b": 0.28}, [["x", "y"], ["x"]], ["series", "cycles"]),
    "lorenz": (LORENZ, {"samples": {"step": 0.02, "count": 150}, "initial": [[-8.0, -9.0, 26.0]]},
               {"x": 0.2, "y": 0.2, "z": 0.2}, {"sigma": 9.0, "rho": 27.0, "beta": 2.5},
               [["x", "y", "z"], ["x"], ["x", "z"]], ["series"]),
    "lorenz_section": (LORENZ, {"sections": 600, "trajectories": 1}, {"x": 1e-3, "y": 1e-3, "z": 0.0},
                       {"sigma": 9.8, "rho": 27.5, "beta": 2.6}, [["x", "y"]], ["cycles"]),
    "shaken": (SHAKEN, {"samples": {"step": 0.1, "count": 100}, "initial": [[0.5, 0.0]]}, {"x": 5e-3, "v": 1e-2},
               {"delta": 0.25, "alpha": -0.9, "gamma": 0.45}, [["x"], ["x", "v"]], ["series"]),
    "shaken_section": (SHAKEN, {"sections": 400, "trajectories": 1, "transient": 50}, {"x": 1e-3, "v": 1e-3},
                       {"delta": 0.28, "gamma": 0.52}, [["x", "v"]], ["cycles", "series"]),
    "steady": (STEADY, {"samples": {"step": 0.1, "count": 60}, "initial": [[0.4, 0.0]], "transient": 2000},
               {"x": 2e-3, "v": 2e-3}, {"delta": 0.28, "alpha": 0.95}, [["x"], ["x", "v"]], ["waveform", "series"]),
    "cycle": (CYCLE, {"samples": {"step": 0.1, "count": 140}, "initial": [[2.0, 0.0]], "transient": 500},
              {"x": 1e-2, "y": 1e-2}, {"mu": 0.9}, [["x"], ["x", "y"]], ["waveform", "series"]),
    "rubbing": (RUBBING, {"samples": {"step": 0.05, "count": 100}, "initial": [[1.0, 0.0]]}, {"x": 2e-3, "v": 5e-3},
                {"k": 3.8, "d": 0.08, "f": 0.04}, [["x"], ["x", "v"]], ["series"]),
}
PRIORS = [lambda v: {"normal": {"mean": v, "sd": abs(v)}}, lambda v: {"lognormal": {"median": abs(v), "log_sd": 1.0}},
          lambda v: {"uniform": {"lower": v - 2.0 * abs(v), "upper": v + 2.0 * abs(v)}},
          lambda v: {"half_normal": {"scale": 2.0 * abs(v)}}, lambda v: {"half_cauchy": {"scale": abs(v)}},
          lambda v: {"gamma": {"shape": 2.0, "rate": 2.0 / abs(v)}},
          lambda v: {"student_t": {"dof": 3.0, "location": v, "scale": abs(v)}}]


class Draw(random.Random):
    def chance(self, share):
        return self.random() < share

    def parameter(self, start):
        one = {"start": start}
        if self.chance(0.3):
            size = abs(start)
            one["bounds"] = self.choice([[start - 3.0 * size, start + 3.0 * size], [None, start + 2.0 * size],
                                         [start - 0.02 * size, start + 0.02 * size]])
        if self.chance(0.3) and not (start < 0.0):
            one["scale"] = self.choice(["linear", "log", "log10"])
        if self.chance(0.3):
            one["prior"] = self.choice(PRIORS)(start)
        return one

    def error(self, sd):
        distribution = self.choice(["normal", "normal", "student_t", "laplace", "lognormal", "relative", "ar1"])
        error = {"distribution": distribution}
        if distribution == "student_t":
            error["dof"] = self.choice([4, 1, "estimate"])
        if distribution in ("relative", "ar1") and self.chance(0.5):
            error["relative" if distribution == "relative" else "correlation"] = 0.1
        told = {"start": 3.0 * sd, "prior": {"half_cauchy": {"scale": sd}}}
        error["sd"] = self.choice(["estimate", "estimate", sd, {"estimate": told}])
        if self.chance(0.2):
            error["floor"] = self.choice([0.1 * sd, 3.0 * sd])
        return error

    def residual(self, kind, sds, observed):
        one = {"type": kind}
        if kind == "series":
            if self.chance(0.6):
                one["interval"] = self.choice(["auto", "segment", 1, 5, 1000])
            if self.chance(0.3):
                one["matching"] = self.choice(["exact", "auto", {"sd": 1e-3}, {"sd": "estimate"}])
            if self.chance(0.2):
                one["dynamics"] = {"noise": self.choice(["estimate", "none"])}
        if kind == "cycles":
            if self.chance(0.3):
                one["weights"] = "equal"
            if self.chance(0.4):
                one["multipliers"] = True
            if self.chance(0.2):
                one["positions"] = False
            if self.chance(0.3):
                one["periods"] = self.choice([[1], [1, 2], [2, 4]])
        if kind == "waveform":
            if self.chance(0.3):
                one["offset"] = "estimate"
            if self.chance(0.3):
                one["phase"] = self.choice(["estimate", 0.3])
        if kind != "cycles" and len(observed) > 1 and self.chance(0.15):
            one["covariance"] = observed
        if self.chance(0.4):
            one["errors"] = {name: self.error(sds[name]) for name in observed if self.chance(0.7)}
        return one

    def estimate(self, starts, sds, observed, kinds):
        chosen = [kind for kind in kinds if self.chance(0.7)] or kinds[:1]
        free = {name: self.parameter(start) for name, start in starts.items() if self.chance(0.8)}
        estimate = {"parameters": free, "residuals": [self.residual(kind, sds, observed) for kind in chosen]}
        names = list(free)
        if self.chance(0.4):
            estimate["strategy"] = self.choice(["auto", chosen, [chosen], ["prediction", chosen[0]],
                                                [*chosen, {"if_needed": chosen}], ["cycles", "harvest"]])
        if self.chance(0.3):
            estimate["multi_start"] = {"starts": self.choice([2, 5])}
        if self.chance(0.2):
            estimate["scan"] = True
        if self.chance(0.4):
            estimate["variance"] = self.choice(["ml", "restricted", "integrated"])
        if len(names) > 1 and self.chance(0.2):
            a, b = (starts[name] for name in names[:2])
            both = 0.3 * abs(a * b)
            estimate["joint_priors"] = [{"normal": {"names": names[:2], "mean": [a, b],
                                                    "covariance": [[a * a, both], [both, b * b]]}}]
            for name in names[:2]:
                free[name].pop("prior", None)
        if len(names) > 1 and self.chance(0.15):
            ratio = starts[names[-1]] / starts[names[0]]
            free[names[-1]] = {"tied": self.choice([names[0], {"to": names[0], "factor": ratio}])}
        if names and self.chance(0.3):
            estimate["derived"] = {"made": f"{names[0]}^2 + 1", "unmade": f"log({names[0]} - 1e6)"}
            if self.chance(0.7):
                del estimate["derived"]["unmade"]
        for key in ("profile", "marginals"):
            if self.chance(0.15):
                estimate[key] = self.choice([True, names[:1]])
        if self.chance(0.1):
            estimate["posterior"] = {"sample": {"draws": 20, "chains": 2, "warm_up": 20}}
        if self.chance(0.1):
            estimate["intervals"] = {"bootstrap": 40, "kind": self.choice(["auto", "parametric", "blocks"])}
        if names and self.chance(0.15):
            estimate["criticism"] = {"without": names[-1:], "held_out": self.choice([0.0, 0.25])}
        return estimate

    def job(self):
        name = self.choice(list(RECORDS))
        model, simulated, sds, starts, observations, kinds = RECORDS[name]
        observed = self.choice(observations)
        data = {"name": "run1", "simulate": {**simulated, "noise": dict(sds)}, "observe": observed}
        job = {"title": name, "model": model, "seed": self.randrange(1, 1000), "data": data,
               "estimate": self.estimate(starts, sds, observed, kinds),
               "output": {"series": self.choice(["h5", "csv", "none"])}}
        if name == "lorenz_section":
            job["section"] = {"coordinate": "z", "value": 27.0, "direction": 1}
        if "samples" in simulated and self.chance(0.3):
            data["initial_state"] = {observed[0]: self.choice(["estimate", {"start": simulated["initial"][0][0]},
                                                               {"value": simulated["initial"][0][0]}])}
        if self.chance(0.1):
            data["simulate"]["noise"] = {coordinate: 0.0 for coordinate in sds}
        if name == "swing" and self.chance(0.4):
            data["segments"] = {"fit": ["0"], "predict": ["1"]}
        if self.chance(0.2) and "samples" in simulated:
            other = {**data, "name": "run2", "parameters": {}, "free": list(job["estimate"]["parameters"])[-1:]}
            job["data"] = [data, other]
        if "cycles" in kinds:
            job["orbits"] = {"periods": [1, 2]}
            if self.chance(0.3):
                job["orbits"]["method"] = self.choice(["auto", "local_maps", "patch_map", "closest_return"])
            if self.chance(0.2):
                job["orbits"]["invariants"] = {"complete_to": 2}
            if self.chance(0.2):
                job["orbits"]["always"] = True
        return job


def called(command, seconds):
    return subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=seconds,
                          env={**os.environ, "ORBID_CXX": ""})


def without(job, path):
    """Takes away what a refusal points at. @return false where it is no option"""
    keys, place = path.strip("/").split("/"), job
    if re.fullmatch(r"/estimate/residuals/\d", path):
        residuals = job["estimate"]["residuals"]
        if residuals[int(keys[-1])].pop("covariance", None) is not None:
            return True
        if len(residuals) > 1:
            del residuals[int(keys[-1])]
            return True
        job["orbits"] = {"periods": [1, 2]}
        return residuals[0]["type"] == "cycles"
    while keys and (keys[-1].isdigit() or keys[-1] in ("residuals", "parameters", "estimate", "data", "prior")):
        keys.pop()
    try:
        for key in keys[:-1]:
            place = place[int(key)] if isinstance(place, list) else place[key]
        return bool(keys) and place.pop(keys[-1], None) is not None
    except (KeyError, IndexError, TypeError, ValueError, AttributeError):
        return False


def accepted(program, job, file):
    """The job without the options that do not go with the others, each of which is refused at its place."""
    for _ in range(12):
        file.write_text(json.dumps(job, indent=1))
        check = called([program, "check", str(file)], 60)
        places = re.findall(r"json:\d+:\d+: (/[^:]*):", check.stderr)
        if check.returncode != 2 or not any([without(job, place) for place in places]):
            return


def tried(program, folder, seed, seconds):
    """@return the exit code or None, and what is wrong, if anything"""
    file, out = folder / f"{seed}.json", folder / str(seed)
    accepted(program, Draw(seed).job(), file)
    try:
        run = called([program, "run", str(file), "--out", str(out), "--quiet", "--threads", "1"], seconds)
    except subprocess.TimeoutExpired:
        return None, f"not ended in {seconds} s"
    finding = ""
    if run.returncode not in (0, 1, 2, 3) or "internal error" in run.stderr:
        finding = f"exit code {run.returncode}: {run.stderr.strip()[-600:]}"
    elif run.returncode in (2, 3) and not run.stderr.strip():
        finding = f"exit code {run.returncode} without a word"
    elif run.returncode in (0, 1):
        result = json.loads((out / "result.json").read_text())
        if not result.get("status"):
            finding = "a result without a status"
        else:
            report = called([program, "report", str(out)], seconds)
            if report.returncode != 0:
                finding = f"report: exit code {report.returncode}: {report.stderr.strip()[-600:]}"
    if not finding:
        shutil.rmtree(out, ignore_errors=True)
    (folder / f"{seed}.txt").write_text(run.stderr + run.stdout)
    return run.returncode, finding


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program")
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=100.0 * SLOWNESS)
    parser.add_argument("--keep", type=Path)
    given = parser.parse_args()
    folder = given.keep or Path(tempfile.mkdtemp(prefix="combinations"))
    folder.mkdir(parents=True, exist_ok=True)
    seeds = range(given.seed, given.seed + given.count)
    codes, findings = {}, 0
    with ThreadPoolExecutor(given.jobs) as pool:
        outcomes = pool.map(lambda seed: tried(given.program, folder, seed, given.seconds), seeds)
        for seed, (code, finding) in zip(seeds, outcomes):
            codes[code] = codes.get(code, 0) + 1
            if finding:
                findings += 1
                print(f"{folder / f'{seed}.json'}: {finding}", flush=True)
    told = ", ".join(f"{count} with exit code {code}" for code, count in sorted(codes.items(), key=str))
    print(f"{given.count} jobs: {told}; {findings} findings")
    if not findings and not given.keep:
        shutil.rmtree(folder)
    sys.exit(1 if findings else 0)


if __name__ == "__main__":
    main()
