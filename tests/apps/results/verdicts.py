#!/usr/bin/env python3
"""Twenty-one records, and what the verdict must say of each.

verdicts.py ORBID CONFIGS [NAME ...]

Fifteen are made here, each with one fault; six are real ones, by their jobs in CONFIGS. A verdict
must have its level and name the reason. Jobs are made quick: no draws, no marginals, no comparison of models.
"""

import concurrent.futures
import json
import math
import os
import random
import re
import subprocess
import sys
import tempfile

OSCILLATOR = {"equations": {"x": "v", "v": "-w2 * x - c * v"}, "parameters": {"w2": 4.0, "c": 0.2}}
DECAY = {"equations": {"x": "-k * x"}, "parameters": {"k": 0.5}}


def swing(t, w2=4.0, c=0.2, chirp=0.0):
    """x(0) = 1, x'(0) = -c / 2 of x'' = -w2 x - c x'; with a chirp the phase runs ahead."""
    return math.exp(-0.5 * c * t) * math.cos(math.sqrt(w2 - 0.25 * c * c) * t + chirp * t * t)


def readings(function, count, step, sd, seed=1):
    noise = random.Random(seed)
    return [(0, step * i, function(step * i) + noise.gauss(0.0, sd)) for i in range(count)]


def job(model, parameters, rows, errors=None, **more):
    data = {"name": "run", "file": "record.csv", "kind": "samples",
            "columns": {"segment": "segment", "time": "t", "x": "x"}}
    residual = {"type": "series"}
    if errors:
        residual["errors"] = {"x": errors}
    data.update(more.pop("data", {}))
    residual.update(more.pop("residual", {}))
    return {"model": model, "data": data, "estimate": {"parameters": parameters, "residuals": [residual]},
            "output": {"series": "none"}}, rows


def outlier():
    rows = readings(swing, 200, 0.1, 0.02)
    rows[77] = (0, rows[77][1], rows[77][2] + 0.5)
    return job(OSCILLATOR, {"w2": {}, "c": {}}, rows)


def prediction():
    rows = readings(swing, 200, 0.1, 0.02)
    rows += [(1, t, x) for _, t, x in readings(lambda t: swing(t, w2=5.0), 200, 0.1, 0.02, seed=2)]
    return job(OSCILLATOR, {"w2": {}, "c": {}}, rows, data={"segments": {"fit": ["0"], "predict": ["1"]}})


def chaos():
    """Lorenz's x over twenty turns, fitted as one course from one initial state: the minimum nearby is a false one."""
    def slope(s):
        return (10.0 * (s[1] - s[0]), s[0] * (28.0 - s[2]) - s[1], s[0] * s[1] - 8.0 / 3.0 * s[2])

    def moved(s, k, h):
        return tuple(a + h * b for a, b in zip(s, k))

    noise, state, rows, h = random.Random(1), (1.0, 3.0, 20.0), [], 0.005
    for i in range(1600):
        if i % 4 == 0:
            rows.append((0, h * i, state[0] + noise.gauss(0.0, 0.1)))
        k1 = slope(state)
        k2 = slope(moved(state, k1, h / 2))
        k3 = slope(moved(state, k2, h / 2))
        k4 = slope(moved(state, k3, h))
        state = tuple(s + h / 6 * (a + 2 * b + 2 * c + d) for s, a, b, c, d in zip(state, k1, k2, k3, k4))
    return job({"name": "lorenz"}, {"rho": {"start": 33.0}}, rows, residual={"interval": "segment"},
               data={"initial_state": {"y": {"start": 3.0}, "z": {"start": 20.0}}})


PRODUCT = {"equations": {"x": "-a * b * x"},
           "parameters": {"a": {"value": 1.0, "domain": "positive"}, "b": {"value": 0.5, "domain": "positive"}}}
BESIDE = {"equations": {"x": "-k * x", "z": "-q * z"}, "parameters": {"k": 0.5, "q": 1.0}}
SATURATION = {"equations": {"x": "-V * x / (K + x)"},
              "parameters": {"V": {"value": 5.0, "domain": "positive"}, "K": {"value": 10.0, "domain": "positive"}}}
OSC = {"w2": {}, "c": {}}


def decay(t):
    return math.exp(-0.5 * t)


# Dry friction makes kinks in the map of a section, of which a smooth map of noisy points knows nothing.
DRY_CYCLES = {
    "model": {"name": "parametric_pendulum", "parameters": {"k1": 1e-3}},
    "data": {"name": "run", "simulate": {"sections": 4000, "trajectories": 1, "transient": 20,
                                         "noise": {"phi": 0.0126, "phi_dot": 0.0586}}},
    "orbits": {"periods": [1, 2], "method": "patch_map"},
    "estimate": {"parameters": {"l": {}, "k2": {}}, "residuals": [{"type": "cycles"}]},
    "output": {"series": "none"},
}

# name: (level, what the reasons must hold, job)
MADE = {
    "a good fit": ("all", "", job(OSCILLATOR, OSC, readings(swing, 200, 0.1, 0.02))),
    "another good fit": ("all", "", job(DECAY, {"k": {"start": 1.0}}, readings(decay, 60, 0.1, 0.01))),
    "a wrong model": ("values", "follow each other",
                      job(OSCILLATOR, OSC, readings(lambda t: swing(t, chirp=0.005), 200, 0.1, 0.02))),
    "a false minimum": ("none", 'spread of x unexplained.*"interval": "auto"', chaos()),
    "an outlier": ("values", r"a reading of series\.x lies", outlier()),
    "too few readings": ("values", "degrees of freedom", job(DECAY, {"k": {}}, readings(decay, 6, 0.5, 0.01))),
    "a bound": ("values", "c lies at its lower bound",
                job(OSCILLATOR, {"w2": {}, "c": {"start": 0.1, "bounds": [0.0, 1.0], "scale": "linear"}},
                    readings(lambda t: swing(t, c=-0.01), 200, 0.1, 0.05))),
    "a product": ("values", "no record can tell", job(PRODUCT, {"a": {}, "b": {}}, readings(decay, 60, 0.1, 0.01))),
    "a parameter without effect": ("values", "no record can tell",
                                   job(BESIDE, {"k": {}, "q": {}}, readings(decay, 60, 0.1, 0.01),
                                       data={"observe": ["x"], "initial_state": {"z": {"value": 1.0}}})),
    "an error given too small": ("none", "times the error that was given",
                                 job(OSCILLATOR, OSC, readings(swing, 200, 0.1, 0.06), errors={"sd": 0.02})),
    "an error given too large": ("values", "times the error that was given",
                                 job(OSCILLATOR, OSC, readings(swing, 200, 0.1, 0.02), errors={"sd": 0.06})),
    "a hardly determined quotient": ("none", "do not tell .* apart, only",
                                     job(SATURATION, {"V": {"start": 50.0}, "K": {"start": 100.0}},
                                         readings(lambda t: 0.001 * decay(t), 60, 0.1, 0.0001))),
    "a failed prediction": ("none", "outside the fit", prediction()),
    "cycles of a smooth map, dry friction": ("none", "blurs what k1 does; add a stage", (DRY_CYCLES, None)),
    "readings without errors": ("values", "held at its limit", job(DECAY, {"k": {"start": 1.0}},
                                                                   readings(decay, 60, 0.1, 0.0))),
}

# name: (level, what the reasons must hold, file, changes of its data)
REAL = {
    "hare and lynx": ("all", "", "hare_lynx.json"),
    "a swinging pendulum": ("values", "follow each other", "pendulum_swing.json"),
    "Silverbox": ("values", "follow each other", "silverbox.json"),
    "one swing alone": ("values", "follow each other", "pendulum_swing.json", {"segments": {"fit": ["1"]}}),
    "pendulum with a motor": ("values", "follow each other", "pendulum_motor.json"),
    "double pendulum": ("values", "follow each other", "double_pendulum.json"),
}


def absolute(node, folder):
    """Files of a job by their whole path."""
    for key, value in node.items():
        if key in ("file", "inputs_file") and isinstance(value, str):
            node[key] = os.path.join(folder, value)
        elif isinstance(value, dict):
            absolute(value, folder)
        elif isinstance(value, list):
            for item in value:
                if isinstance(item, dict):
                    absolute(item, folder)


def real_job(configs, name, changes=None):
    with open(os.path.join(configs, name), encoding="utf-8") as file:
        text = re.sub(r"(?m)(^|\s)//.*$", "", file.read())
    content = json.loads(text)
    absolute(content["data"] if isinstance(content["data"], dict) else {"all": content["data"]}, configs)
    if changes:
        content["data"].update(changes)
    for key in ("marginals", "posterior", "profile", "criticism", "derived"):
        content["estimate"].pop(key, None)
    return content


def verdict_of(orbid, name, content, rows):
    """None if the verdict is right, else what is wrong; and what it says."""
    with tempfile.TemporaryDirectory() as folder:
        if rows:
            with open(os.path.join(folder, "record.csv"), "w", encoding="utf-8") as file:
                file.write("segment,t,x\n")
                file.writelines(f"{segment},{t!r},{x!r}\n" for segment, t, x in rows)
        path = os.path.join(folder, "job.json")
        with open(path, "w", encoding="utf-8") as file:
            json.dump(content, file)
        out = os.path.join(folder, "out")
        run = subprocess.run([orbid, "run", path, "--out", out, "--quiet", "--threads", "1"], capture_output=True,
                             text=True, check=False)
        try:
            with open(os.path.join(out, "result.json"), encoding="utf-8") as file:
                result = json.load(file)
            with open(os.path.join(out, "report.html"), encoding="utf-8") as file:
                report = file.read()
        except FileNotFoundError:
            return {"trust": "", "line": f"no result: {run.stderr}", "because": []}, "", ""
        return result["verdict"], run.stdout, report


def check(name, level, words, verdict, summary, report):
    """Everything that is wrong with a verdict."""
    if verdict["trust"] != level:
        yield f"trust is {verdict['trust']!r}, must be {level!r}"
    if not re.search(words, "; ".join(verdict["because"])):
        yield f"no reason says {words!r}"
    if f"Verdict: {verdict['line']}\n" not in summary:
        yield "the summary has not the line"
    first = {"all": "good", "values": "caution", "none": "bad"}.get(verdict["trust"])
    box = re.search(r'<li class="(\w+)"><strong>[^<]*</strong> <span>Verdict: ', report)
    if not box or box.group(1) != first:
        yield f"the report's verdict must look {first}"
    beginning = {"all": "trust", "values": "trust the values, not the intervals: ", "none": "do not trust: "}
    if not verdict["line"].startswith(beginning.get(verdict["trust"], "?")):
        yield "the line begins with another level"


def main():
    orbid, configs = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    wanted = sys.argv[3:]
    records = [(name, level, words, *made) for name, (level, words, made) in MADE.items()]
    records += [(name, level, words, real_job(configs, *source), None) for name, (level, words, *source) in REAL.items()]
    records = [record for record in records if not wanted or record[0] in wanted]
    right = 0
    with concurrent.futures.ThreadPoolExecutor(max_workers=2) as pool:
        results = pool.map(lambda record: verdict_of(orbid, record[0], record[3], record[4]), records)
        for (name, level, words, _, _), (verdict, summary, report) in zip(records, results):
            faults = list(check(name, level, words, verdict, summary, report))
            right += not faults
            print(f"{'ok   ' if not faults else 'WRONG'} {name}: {verdict['line']}")
            for fault in faults:
                print(f"      {fault}; reasons: {verdict['because']}")
    print(f"{right} of {len(records)} verdicts are right")
    return 0 if records and right == len(records) else 1


if __name__ == "__main__":
    sys.exit(main())
