#!/usr/bin/env python3
"""What the models say about records of real pendulums that they were not fitted to.

    real_data.py print BIN_DIR [PART]       runs the jobs and prints the tables; PART: double_pendulum or swing
    real_data.py write BIN_DIR REAL_DATA.md writes them between the marks of that file

Only the standard library. Every figure comes from `orbid` run on jobs written here. Everywhere: parameters from the
segments that are fitted, the state in which a segment begins from that segment, root mean square of the angle's errors.
"""
import math
import sys
import tempfile
from pathlib import Path

import results
from results import CONFIGS

BEGIN, END = "<!-- tables of real_data.py -->", "<!-- end of tables -->"


def read_job(name):
    """The job as a dictionary, its data file absolute."""
    job = results.read_job(name)
    job["data"]["file"] = str(CONFIGS / job["data"]["file"])
    return job


def run(binary, job, folder):
    results.run(binary.parent, job, folder, "--force", expect=(0, 1))
    return results.result(folder)


def squares(answer, segments):
    """Sum over coordinates and segments of mean squares, and their number: equally many readings in each."""
    total, count = 0.0, 0
    for entry in answer["prediction"]:
        if entry["segment"] in segments:
            values = list(entry["rms"].values())
            if any(value is None for value in values):
                return math.inf, 1
            total += sum(value * value for value in values)
            count += len(values)
    return total, count


def rms(answer, segments):
    total, count = squares(answer, segments)
    return math.sqrt(total / count)


# ---------------------------------------------------------------------------------------------------------------------

ENERGETIC = ("0", "1", "2", "4", "5", "7", "8", "9")
QUIET = tuple(str(i) for i in range(10, 26))
SHAPE = ("a1", "a2", "L1", "I2")
ARMS = [
    ("published, nothing fitted", "viscous", ()),
    ("rigid arms, viscous joints", "viscous", SHAPE + ("k1", "k2")),
    ("+ offsets", "viscous", SHAPE + ("k1", "k2", "offset1", "offset2")),
    ("+ offsets, dry joints", "friction_and_drag", SHAPE + ("k1", "k2", "offset1", "offset2", "c1", "c2")),
    ("+ air", "friction_and_drag", SHAPE + ("k1", "k2", "drag")),
    ("+ air, offsets", "friction_and_drag", SHAPE + ("k1", "k2", "drag", "offset1", "offset2")),
    ("+ air, offsets, dry joints", "friction_and_drag",
     SHAPE + ("k1", "k2", "drag", "offset1", "offset2", "c1", "c2")),
    ("+ air, offsets, dry joints, bend", "friction_and_drag",
     SHAPE + ("k1", "k2", "drag", "offset1", "offset2", "c1", "c2", "bend")),
    ("+ air, offsets, dry joints, eccentric encoders", "friction_and_drag",
     SHAPE + ("k1", "k2", "drag", "offset1", "offset2", "c1", "c2", "e1_cos", "e1_sin", "e2_cos", "e2_sin")),
]
CALM = (ARMS[0][0], ARMS[1][0], ARMS[-1][0])  # which are tried on the quieter segments too


def windows(segments):
    return [segment + half for segment in segments for half in "ab"]


def arms_job(variant, free, fit, predict):
    job = read_job("double_pendulum.json")
    known = job["estimate"]["parameters"] | {"bend": {"start": 0.0, "bounds": [-0.05, 0.05]}}
    job["model"]["variant"] = variant
    job["data"]["segments"] = {"fit": fit, "predict": predict}
    job["estimate"]["parameters"] = {name: known[name] for name in free}
    # Both angles count the same in every row: with estimated sds a model would be judged by other weights than another.
    job["estimate"]["residuals"][0]["errors"] = {phi: {"distribution": "normal", "sd": 3e-4} for phi in ("phi1", "phi2")}
    job["reference"] = {}
    return job


def double_pendulum(binary, work, lines):
    folds = [(windows(ENERGETIC[0::2]), windows(ENERGETIC[1::2])), (windows(ENERGETIC[1::2]), windows(ENERGETIC[0::2]))]
    quiet = windows(QUIET)
    lines += ["## The double pendulum", "",
              "Windows of 1.33 s. Fitted: every other one of the eight energetic segments (A: 0, 2, 5, 8; B: 1, 4, 7, 9); "
              "predicted: the others, in turn, and the sixteen quieter segments 10 to 25. Angles in mrad; ratio = over "
              "the published parameters on the same windows.", "",
              "| model | free | A fitted | A predicts B | ratio | B fitted | B predicts A | ratio | both | quieter ones "
              "(A, B) | ratio |", "|---|---|---|---|---|---|---|---|---|---|---|"]
    base, pairs = None, None
    for label, variant, free in ARMS:
        far = quiet if label in CALM else []
        answers = [run(binary, arms_job(variant, free, fit, predict + far), work / "arms") for fit, predict in folds]
        fitted = [rms(a, f) for a, (f, _) in zip(answers, folds)]
        unseen = [rms(a, p) for a, (_, p) in zip(answers, folds)]
        calm = math.sqrt(sum(rms(a, quiet) ** 2 for a in answers) / 2) if far else None
        if base is None:
            base = unseen + [calm]
        both = math.sqrt(sum(x * x for x in unseen) / sum(x * x for x in base[:2]))
        lines.append(f"| {label} | {len(free)} | {1e3 * fitted[0]:.2f} | {1e3 * unseen[0]:.2f} | "
                     f"{unseen[0] / base[0]:.3f} | {1e3 * fitted[1]:.2f} | {1e3 * unseen[1]:.2f} | "
                     f"{unseen[1] / base[1]:.3f} | {both:.3f} | " + (f"{1e3 * calm:.2f} | {calm / base[2]:.3f} |" if far else " | |"))
        print(lines[-1], file=sys.stderr, flush=True)
        pairs = answers
    turns(lines, "The last model's parameters from A and from B: disjoint records, so z should be as of one normal "
          "number each.", pairs)
    nothing_told(binary, work, lines, folds[0][0])


def turns(lines, title, answers):
    """Estimates of the same parameters from disjoint data."""
    first, second = (answer["parameters"] for answer in answers)
    lines += ["", title, "", "| parameter | A | sd | B | sd | z of the difference | interval |", "|---|---|---|---|---|---|---|"]
    for name, a in first.items():
        b = second[name]
        if a["at_bound"] or b["at_bound"]:
            z = "at a bound"
        elif a["sd"] is None or b["sd"] is None:
            z = "no sd"
        else:
            z = f"{(a['value'] - b['value']) / math.hypot(a['sd'], b['sd']):+.1f}"
        sd = [f"{x['sd']:.2g}" if x["sd"] is not None else "-" for x in (a, b)]
        lines.append(f"| {name} [{a['unit']}] | {a['value']:.6g} | {sd[0]} | {b['value']:.6g} | {sd[1]} | {z} | "
                     f"{a['interval_method']}, {b['interval_method']} |")
    lines.append("")


def nothing_told(binary, work, lines, fit):
    """All masses, lengths and inertias free at once."""
    job = arms_job("viscous", (), fit, [])
    names = ("m1", "m2", "a1", "a2", "L1", "I1", "I2", "k1", "k2", "g")
    job["estimate"]["parameters"] = {name: {} for name in names}
    answer = run(binary, job, work / "arms_null")
    lines += [f"All of {', '.join(names)} free at once: status {answer['status']}. What no record of the angles tells, and "
              "what is held for it:", ""]
    for direction in answer["identifiability"]["structural"]["directions"]:
        lines.append(f"* {direction['held']}: {direction['text']}")
    lines.append("")


# ---------------------------------------------------------------------------------------------------------------------

PUBLISHED = {"w0sq": 64.2188522, "c2": 0.0672268}
COMMON = ("w0sq", "offset", "c1")
STARTS = {"c1": 0.1, "c2": 0.02, "c3": 0.004, "c5": 1e-4, "cp": 0.002, "c_load": 0.01, "c_angle": 0.01, "c_slow": 0.01,
          "w0sq": 64.2, "offset": 0.0, "e_cos": 0.0, "e_sin": 0.0}
QUADRATIC, THREE = "c1, c3 v abs(v)", "c1, c2 v, c3 v abs(v)"
LAWS = [
    ("c1 (dry) alone", COMMON, {}),
    ("c1, c2 v", COMMON + ("c2",), {}),
    (QUADRATIC, COMMON + ("c3",), {}),
    ("c1, c5 v^3", COMMON + ("c5",), {}),
    ("c1, cp abs(v)^2.2", COMMON + ("cp",), {"p": 2.2}),
    ("c1, cp abs(v)^2.4", COMMON + ("cp",), {"p": 2.4}),
    (THREE, COMMON + ("c2", "c3"), {}),
    ("c1, c2 v, c5 v^3", COMMON + ("c2", "c5"), {}),
    ("c1, c3 v abs(v), c5 v^3", COMMON + ("c3", "c5"), {}),
    ("c1, c3 v abs(v), dry by load", COMMON + ("c3", "c_load"), {}),
    ("c1, c3 v abs(v), dry by angle", COMMON + ("c3", "c_angle"), {}),
    ("c1, c3 v abs(v), Stribeck at 1 rad/s", COMMON + ("c3", "c_slow"), {"v_slow": 1.0}),
    ("c1, c3 v abs(v), e_cos", COMMON + ("c3", "e_cos"), {}),
    ("c1, c3 v abs(v), e_cos, e_sin", COMMON + ("c3", "e_cos", "e_sin"), {}),
    ("c1, cp abs(v)^2.4, e_cos", COMMON + ("cp", "e_cos"), {"p": 2.4}),
]
SEGMENTS = ("0", "1", "2", "3")
ONE_OUT = [(segment,) for segment in SEGMENTS]
TWO_OUT = [("0", "1"), ("2", "3"), ("0", "2"), ("1", "3")]
WINDOW, WINDOWS, STRIDE = 1.53, 6, 5


def write_swing(path):
    """Every fifth row, each segment as a whole (0 ... 3) and cut into windows (0w0, 0w1, ...)."""
    source = (CONFIGS / "data/pendulum_swing/swing.csv").read_text().splitlines()
    rows = [line.split(",", 2) for line in source[1:]]
    kept = [row for row in rows if round(1000 * float(row[1])) % STRIDE == 0]
    lines = [source[0]] + [",".join(row) for row in kept]
    for segment, t, rest in kept:
        window = int(float(t) / WINDOW)
        if window < WINDOWS:
            lines.append(f"{segment}w{window},{t},{rest}")
    path.write_text("\n".join(lines) + "\n")


def cut(segments):
    return [f"{segment}w{i}" for segment in segments for i in range(WINDOWS)]


def swing_job(path, free, values, fit, predict):
    job = read_job("pendulum_swing.json")
    job["data"]["file"] = str(path)
    job["data"]["segments"] = {"fit": list(fit), "predict": list(predict)}
    job["reference"] = {}
    job["model"] = {"name": "free_pendulum", "variant": "extended", "parameters": {"c2": 0.0} | values}
    job["estimate"]["parameters"] = {
        name: {"start": STARTS[name]} | ({"bounds": [0.0, None]} if name.startswith("c") else {}) for name in free}
    return job


def swing(binary, work, lines):
    work.mkdir(parents=True, exist_ok=True)
    path = work / "swing.csv"
    write_swing(path)
    job = swing_job(path, (), PUBLISHED, ["0"], ["1", "2", "3"] + cut(SEGMENTS))
    answer = run(binary, job, work / "swing")
    base = [[rms(answer, out) for out in choice] for choice in (ONE_OUT, TWO_OUT)]
    lines += ["## The swing", "",
              "Four segments of 9.167 s of one decay, amplitudes 1.62-1.22, 1.22-0.94, 0.94-0.73 and 0.73-0.55 rad, every "
              "fifth sample. Each whole segment is predicted from the other three, then two from the other two; mrad. "
              "Ratio: over the published parameters on the same segments, root mean square of all that is predicted. "
              "Coefficients of friction >= 0. Last column: the windows of 1.53 s of each segment from the other three.", ""]
    kept, windows_base = {}, rms(answer, cut(SEGMENTS))
    for title, pieces in (("Fitted on whole segments, one free state in each:", list),
                          (f"Fitted on windows of {WINDOW} s, one free state in each; whole segments predicted as above:",
                           cut)):
        lines += [title, "", "| law | free | fitted, all | 0 | 1 | 2 | 3 | ratio | 01 | 23 | 02 | 13 | ratio | windows, ratio |",
                  "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
                  "| published, nothing fitted | 0 | " +
                  f"{1e3 * rms(answer, pieces(SEGMENTS)):.2f} | " + " | ".join(f"{1e3 * x:.2f}" for x in base[0]) +
                  " | 1 | " + " | ".join(f"{1e3 * x:.2f}" for x in base[1]) + f" | 1 | {1e3 * windows_base:.2f}, 1 |"]
        for label, free, values in LAWS:
            together = run(binary, swing_job(path, free, values, pieces(SEGMENTS), []), work / "swing")
            cells, answers = [], []
            for choice, published in zip((ONE_OUT, TWO_OUT), base):
                ours = []
                for out in choice:
                    fit = [segment for segment in SEGMENTS if segment not in out]
                    answers.append(run(binary, swing_job(path, free, values, pieces(fit), list(out) + cut(out)), work / "swing"))
                    ours.append(rms(answers[-1], out))
                ratio = math.sqrt(sum(x * x for x in ours) / sum(x * x for x in published))
                cells += [f"{1e3 * x:.2f}" for x in ours] + [f"{ratio:.3f}"]
            kept[label] = answers[len(ONE_OUT):][:2]
            short = math.sqrt(sum(rms(a, cut(out)) ** 2 for a, out in zip(answers, ONE_OUT)) / len(ONE_OUT))
            cells.append(f"{1e3 * short:.2f}, {short / windows_base:.3f}")
            lines.append(f"| {label} | {len(free)} | {1e3 * rms(together, pieces(SEGMENTS)):.2f} | " + " | ".join(cells) + " |")
            print(lines[-1], file=sys.stderr, flush=True)
        for label in (THREE, QUADRATIC):
            turns(lines, f"{label}, from the segments 2 and 3 (A) and from 0 and 1 (B), {'windows' if pieces is cut else 'whole'}:",
                  kept[label])
    wander(binary, path, work, lines)


def wander(binary, path, work, lines):
    """Dry friction of its own in every window, all else shared."""
    names = cut(SEGMENTS)
    job = swing_job(path, COMMON + ("e_cos",), {"c3": 0.0044}, [], [])
    shared = job["data"]
    job["data"] = [shared | {"name": "w" + name, "free": ["c1"], "segments": {"fit": [name], "predict": []}}
                   for name in names]
    job["estimate"]["residuals"][0]["data"] = ["w" + name for name in names]
    job["estimate"]["residuals"][0].pop("errors", None)
    answer = run(binary, job, work / "wander")
    c1 = [answer["parameters"][f"c1@w{name}"]["value"] for name in names]
    mean = sum(c1) / len(c1)
    sd = math.sqrt(sum((x - mean) ** 2 for x in c1) / (len(c1) - 1))
    lag = sum((x - mean) * (y - mean) for x, y in zip(c1, c1[1:])) / sum((x - mean) ** 2 for x in c1)
    lines += [f"c1 of its own in each of the {len(names)} windows, w0sq, offset and e_cos shared, c3 = 0.0044: "
              f"{mean:.4f} rad/s^2 on average, sd between windows {sd:.4f} ({100 * sd / mean:.1f} %), correlation of "
              f"neighbours {lag:.2f}, residual {1e3 * rms(answer, names):.2f} mrad. In order of time:", "",
              " ".join(f"{x:.3f}" for x in c1), ""]


def tables(binary, parts=(double_pendulum, swing)):
    lines = []
    with tempfile.TemporaryDirectory() as temporary:
        for part in parts:
            part(binary, Path(temporary), lines)
    return lines


def main(arguments):
    if len(arguments) in (3, 4) and arguments[1] == "print":
        parts = [part for part in (double_pendulum, swing) if part.__name__ in arguments[3:] or len(arguments) == 3]
        print("\n".join(tables(Path(arguments[2]).resolve() / "orbid", parts)))
    elif len(arguments) == 4 and arguments[1] == "write":
        target = Path(arguments[3])
        before, rest = target.read_text().split(BEGIN)
        after = rest.split(END)[1]
        made = "\n".join(tables(Path(arguments[2]).resolve() / "orbid"))
        target.write_text(f"{before}{BEGIN}\n\n{made}\n{END}{after}")
        print(f"wrote {target}")
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv)
