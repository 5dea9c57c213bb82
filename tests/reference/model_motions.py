#!/usr/bin/env python3
"""Makes model_motions.json: motions of models without a closed form, to 20 digits and more.

    python3 model_motions.py > model_motions.json        (python 3.11, mpmath 1.2; some minutes)

Gragg's modified midpoint rule with Bulirsch and Stoer's extrapolation (order 28) in 40 decimal digits; independent of
the equations in models/: the double pendulum is integrated in Hamilton's form. Every number is computed with two
lengths of step, and only the digits in which both agree are written, 25 at most; fewer than 20 are an error.
"""

import json

from mpmath import cos, exp, log, matrix, mp, mpf, sin

mp.dps = 40
COLUMNS = 14


def step(f, x, h):
    """x(t + h) of x' = f(x): midpoint rule with 2, 4, ... steps, extrapolated to step 0 in even powers."""
    table = []
    for k in range(1, COLUMNS + 1):
        n = 2 * k
        d = h / n
        before, now = x, [a + d * b for a, b in zip(x, f(x))]
        for _ in range(n - 1):
            before, now = now, [a + 2 * d * b for a, b in zip(before, f(now))]
        row = [[(a + b + d * c) / 2 for a, b, c in zip(before, now, f(now))]]
        for j in range(1, k):
            ratio = mpf(k) / (k - j)
            row.append([a + (a - b) / (ratio**2 - 1) for a, b in zip(row[j - 1], table[j - 1])])
        table = row
    return table[-1]


def after(f, x, t, h):
    steps = int(t / h) + 1
    for _ in range(steps):
        x = step(f, x, t / steps)
    return x


def next_crossing(f, x, section, slope, h):
    """Time and state at the next zero of section(x) in the direction of growth."""
    t, value = mpf(0), None
    while True:
        end = step(f, x, h)
        new = section(end)
        if value is not None and value < 0 <= new:
            break
        t, x, value = t + h, end, new
    d = h * value / (value - new)
    for _ in range(7):
        end = step(f, x, d)
        d -= section(end) / slope(end)
    return t + d, step(f, x, d)


def agreed(compute, h):
    """The digits on which two lengths of step agree."""
    numbers = []
    for a, b in zip(compute(h), compute(h / mpf("1.5"))):
        digits = 25 if a == b else min(25, int(-log(abs(a - b) / abs(b), 10)) - 1)
        assert digits >= 20, (a, b)
        numbers.append(mp.nstr(b, digits))
    return numbers


def van_der_pol(mu):
    """Period, amplitude, multiplier exp(integral of mu (1 - x^2))."""
    f = lambda x: [x[1], mu * (1 - x[0] ** 2) * x[1] - x[0], mu * (1 - x[0] ** 2)]

    def compute(h):
        x = [mpf(2), mpf(0), mpf(0)]
        # Section: x' = 0 at the largest x, where x'' = -x.
        for _ in range(14):
            t, x = next_crossing(f, [x[0], mpf(0), mpf(0)], lambda x: -x[1], lambda x: -f(x)[1], h)
        return [t, x[0], exp(x[2])]

    return agreed(compute, mpf(1) / 8)


def fitzhugh_nagumo(a, b, epsilon, current):
    """Period, w where v = 0 grows, multiplier exp(integral of the divergence)."""
    f = lambda x: [
        x[0] - x[0] ** 3 / 3 - x[1] + current,
        epsilon * (x[0] + a - b * x[1]),
        1 - x[0] ** 2 - epsilon * b,
    ]

    def compute(h):
        x = [mpf(0), mpf("-0.2"), mpf(0)]
        for _ in range(8):
            t, x = next_crossing(f, [mpf(0), x[1], mpf(0)], lambda x: x[0], lambda x: f(x)[0], h)
        return [t, x[1]]

    return agreed(compute, mpf(1) / 4)


def lotka_volterra(alpha, beta, gamma, delta, u, v):
    """Period of the orbit through (u, v), where v grows."""
    f = lambda x: [x[0] * (alpha - beta * x[1]), x[1] * (delta * x[0] - gamma)]
    compute = lambda h: [next_crossing(f, [u, v], lambda x: x[1] - v, lambda x: f(x)[1], h)[0]]
    return agreed(compute, mpf(1) / 8)


def double_pendulum(p, x, t):
    """phi1, phi2, phi1', phi2' after t, in Hamilton's form: positions and momenta, friction as generalised force."""
    J1 = p["I1"] + p["m1"] * p["a1"] ** 2 + p["m2"] * p["L1"] ** 2
    J2 = p["I2"] + p["m2"] * p["a2"] ** 2
    h12 = p["m2"] * p["L1"] * p["a2"]

    def rates(x):
        mass = matrix([[J1, h12 * cos(x[0] - x[1])], [h12 * cos(x[0] - x[1]), J2]])
        determinant = mass[0, 0] * mass[1, 1] - mass[0, 1] ** 2
        return (
            (mass[1, 1] * x[2] - mass[0, 1] * x[3]) / determinant,
            (mass[0, 0] * x[3] - mass[0, 1] * x[2]) / determinant,
        )

    def f(x):
        v1, v2 = rates(x)
        pull = h12 * sin(x[0] - x[1]) * v1 * v2
        joint = p["k2"] * (v2 - v1)
        return [
            v1,
            v2,
            -pull - (p["m1"] * p["a1"] + p["m2"] * p["L1"]) * p["g"] * sin(x[0]) - p["k1"] * v1 + joint,
            pull - p["m2"] * p["a2"] * p["g"] * sin(x[1]) - joint,
        ]

    c = h12 * cos(x[0] - x[1])
    start = [x[0], x[1], J1 * x[2] + c * x[3], c * x[2] + J2 * x[3]]

    def compute(h):
        end = after(f, start, t, h)
        return [end[0], end[1], *rates(end)]

    return agreed(compute, mpf(1) / 160)


PUBLISHED_ARMS = {
    "m1": "0.0938439748",
    "m2": "0.137595970",
    "a1": "0.108565215",
    "a2": "0.116779018",
    "L1": "0.172719204",
    "I1": "4.37529430e-4",
    "I2": "1.26882939e-3",
    "k1": "2.37142783e-4",
    "k2": "1.00000019e-5",
    "g": "9.80858023",
}

motions = {
    "note": "made by model_motions.py: extrapolation of order 28 in 40 digits, all digits agreed on by two step lengths",
    "van_der_pol": dict(zip(["period", "amplitude", "multiplier"], van_der_pol(mpf(1))), mu=1),
    "fitzhugh_nagumo": dict(
        zip(["period", "w_at_v_0"], fitzhugh_nagumo(mpf("0.7"), mpf("0.8"), mpf("0.08"), mpf("0.5"))),
        parameters={"a": 0.7, "b": 0.8, "epsilon": 0.08, "I": 0.5},
    ),
    "lotka_volterra": {
        "parameters": {"alpha": 0.55, "beta": 0.028, "gamma": 0.8, "delta": 0.024},
        "start": [40, 10],
        "period": lotka_volterra(*map(mpf, ["0.55", "0.028", "0.8", "0.024", "40", "10"]))[0],
    },
    "double_pendulum": {
        "parameters": PUBLISHED_ARMS,
        "start": [2, -1, 1, -2],
        "duration": 2,
        "state": double_pendulum({k: mpf(v) for k, v in PUBLISHED_ARMS.items()}, list(map(mpf, [2, -1, 1, -2])), mpf(2)),
    },
}
print(json.dumps(motions, indent=1))
