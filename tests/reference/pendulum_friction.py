#!/usr/bin/python3
"""Makes pendulum_friction.json: flow of the crank-driven pendulum with dry friction, to 30 digits and more.

    python3 pendulum_friction.py > pendulum_friction.json        (python 3.11, mpmath 1.2; some minutes)

    phi' = v / w,   v' = -[s k1 + k2 v + s k3 v^2] / (m l^2 w) - P(tau) sin(phi) / w,   s = sgn v,   ' = d/d(tau = w t)

with P of (M2), between velocity zeros by Taylor series of high order in fixed-point arithmetic of 73 digits. Velocity
zeros are roots of the series. Where both one-sided accelerations point at v = 0 the pendulum sticks until
|P sin phi| > k1 / (m l^2).

Derivatives with respect to phi, v at the start and m, l, k1, k2, k3, g, A, omega, epsilon, at fixed phases: variational
equations, written out below and solved by the same series, with the jump conditions (M5). They are compared here with
fourth-order central differences of the flow alone, which know nothing of them.

Everything is computed twice, with another order, tolerance and so other steps; the program ends with an error when the
two differ by more than 1e-32, or derivatives from differences by more than 1e-30, relative to 1 + |value|. At k1 = 0
orbits of pendulum_orbits_g9.81.json (another program, another integrator) must close to 1e-10.

Inputs are doubles: a printed 0.0858 means the double nearest to it.
"""

import json
import os
import sys
from operator import mul

import mpmath
from mpmath import mp, mpf

BITS = 244  # 73 digits behind the point
mp.prec = 300
ONE = 1 << BITS
NAMES = ("m", "l", "k1", "k2", "k3", "g", "A", "omega", "epsilon")
DIRECTIONS = ("phi", "phi_dot") + NAMES
DEFAULTS = dict(m=0.0858, l=0.317, k1=1e-3, k2=4.85e-4, k3=1.90e-4, g=9.81, A=0.131, omega=9.09, epsilon=0.173)


def fixed(x):
    return int(mpmath.nint(mpmath.ldexp(mpf(x), BITS)))


def real(i):
    return mpmath.ldexp(mpf(i), -BITS)


def times(a, b):
    return (a * b) >> BITS


def product(a, b, k):
    """Coefficient k of the product of two series."""
    return sum(map(mul, a[: k + 1], b[k::-1])) >> BITS


def all_product(a, b):
    return [product(a, b, k) for k in range(len(a))]


def power(r, exponent_times_two):
    """Series of r^(exponent_times_two / 2), from r y' = exponent r' y."""
    y = [fixed(mpmath.power(real(r[0]), mpf(exponent_times_two) / 2))]
    for k in range(1, len(r)):
        total = sum((exponent_times_two * j - 2 * (k - j)) * r[j] * y[k - j] for j in range(1, k + 1))
        y.append(total // (2 * k * r[0]))
    return y


def value(series, h):
    total = 0
    for c in reversed(series):
        total = ((total * h) >> BITS) + c
    return total


def crank(tau, e, order):
    """Series about tau of Q = cos + e (cos 2 tau + e^2 sin^4) / (1 - e^2 sin^2)^(3/2) and of dQ/de."""
    c, s = mpmath.cos(tau), mpmath.sin(tau)
    cycle, factorial = (c, -s, -c, s), mpf(1)
    cosine, sine = [], []
    for k in range(order + 1):
        cosine.append(fixed(cycle[k % 4] / factorial))
        sine.append(fixed(cycle[(k + 3) % 4] / factorial))
        factorial *= k + 1
    square = all_product(sine, sine)
    fourth = all_product(square, square)
    e = fixed(e)
    e2 = times(e, e)
    double = [-2 * q for q in square]
    double[0] += ONE
    root = [-times(e2, q) for q in square]
    root[0] += ONE
    by_three, by_five = power(root, -3), power(root, -5)
    top = [d + times(e2, q) for d, q in zip(double, fourth)]
    top_slope = [d + 3 * times(e2, q) for d, q in zip(double, fourth)]
    q = [a + times(e, b) for a, b in zip(cosine, all_product(top, by_three))]
    slope = [
        a + 3 * times(e2, b)
        for a, b in zip(all_product(top_slope, by_three), all_product(all_product(top, square), by_five))
    ]
    return q, slope


class Pendulum:
    def __init__(self, p, order, digits):
        self.p = {name: mpf(p[name]) for name in NAMES}
        self.order, self.tolerance = order, mpf(10) ** -digits
        m, l = self.p["m"], self.p["l"]
        self.inertia = m * l * l
        self.c = [self.p[k] / self.inertia for k in ("k1", "k2", "k3")]

    def stiffness(self, tau):
        """P(tau), by the formula itself."""
        p, s = self.p, mpmath.sin(tau)
        e = p["epsilon"]
        q = mpmath.cos(tau) + e * (mpmath.cos(2 * tau) + e**2 * s**4) / mpmath.power(1 - (e * s) ** 2, mpf(3) / 2)
        return p["g"] / p["l"] - p["A"] * p["omega"] ** 2 / p["l"] * q

    def acceleration(self, phi, tau, side):
        """v' at v = 0 on a side of the surface."""
        return -(side * self.c[0] + self.stiffness(tau) * mpmath.sin(phi)) / self.p["omega"]

    def series(self, phi, v, columns, tau, side):
        """Taylor series of phi and v about tau, and of the columns (dphi, dv) when there are any."""
        p, order = self.p, self.order
        per_omega = fixed(1 / p["omega"])
        c1, c2, c3 = (fixed(c) for c in self.c)
        q, q_slope = crank(tau, p["epsilon"], order)
        amplitude = fixed(p["A"] * p["omega"] ** 2 / p["l"])
        stiff = [-times(amplitude, x) for x in q]
        stiff[0] += fixed(p["g"] / p["l"])
        phi, v = [phi], [v]
        u, w = [fixed(mpmath.sin(real(phi[0])))], [fixed(mpmath.cos(real(phi[0])))]
        square, force, numerator, weighted = [], [], [], []  # v^2, P sin phi, right side before 1/omega, j phi_j
        for k in range(order):
            square.append(product(v, v, k))
            force.append(product(stiff, u, k))
            friction = times(c2, v[k]) + side * times(c3, square[k]) + (side * c1 if k == 0 else 0)
            numerator.append(-friction - force[k])
            phi.append(times(v[k], per_omega) // (k + 1))
            v.append(times(numerator[k], per_omega) // (k + 1))
            weighted.append((k + 1) * phi[k + 1])
            u.append(product(weighted, w, k) // (k + 1))
            w.append(-product(weighted, u, k) // (k + 1))
        if not columns:
            return phi, v, []
        # Partial derivatives of the right side with respect to the parameters, along the solution.
        by_m, by_l = fixed(1 / p["m"]), fixed(1 / p["l"])
        by_inertia = fixed(1 / self.inertia)
        crank_force, slope_force = all_product(q[:order], u[:order]), all_product(q_slope[:order], u[:order])
        of_A, of_omega = fixed(p["omega"] ** 2 / p["l"]), fixed(2 * p["A"] * p["omega"] / p["l"])
        direct = {name: [] for name in NAMES}
        for k in range(order):
            friction = times(c2, v[k]) + side * times(c3, square[k]) + (side * c1 if k == 0 else 0)
            direct["m"].append(times(friction, by_m))
            direct["l"].append(2 * times(friction, by_l) + times(force[k], by_l))
            direct["k1"].append(-side * by_inertia if k == 0 else 0)
            direct["k2"].append(-times(v[k], by_inertia))
            direct["k3"].append(-side * times(square[k], by_inertia))
            direct["g"].append(-times(u[k], by_l))
            direct["A"].append(times(of_A, crank_force[k]))
            direct["omega"].append(times(of_omega, crank_force[k]) - times(numerator[k], per_omega))
            direct["epsilon"].append(times(amplitude, slope_force[k]))
        damping = [2 * side * times(c3, x) for x in v[:order]]
        damping[0] += c2
        restoring = all_product(stiff[:order], w[:order])
        variations = []
        for direction, (dphi, dv) in zip(DIRECTIONS, columns):
            dphi, dv = [dphi], [dv]
            for k in range(order):
                slope, slope_of_v = dv[k], -product(damping, dv, k) - product(restoring, dphi, k)
                if direction in direct:
                    slope_of_v += direct[direction][k]
                if direction == "omega":
                    slope -= times(v[k], per_omega)
                dphi.append(times(slope, per_omega) // (k + 1))
                dv.append(times(slope_of_v, per_omega) // (k + 1))
            variations.append((dphi, dv))
        return phi, v, variations

    def step_length(self, phi, v, variations):
        """Length at which the last two terms of every series are below the tolerance."""
        length = mpf(1)
        for series in (phi, v, *(s for pair in variations for s in pair)):
            for k in (self.order - 1, self.order):
                size = abs(real(series[k]))
                if size > 0:
                    length = min(length, mpmath.root(self.tolerance / size, k))
        return length * mpf("0.8")

    def first_zero(self, v, length, side):
        """First h in (0, length] where v leaves the side, or None; a zero at h = 0 is divided out."""
        if v[0] == 0:
            v = v[1:]
        samples = 64  # steps are short: v is close to a parabola in one
        before = 0
        for i in range(1, samples + 1):
            h = length * i // samples
            if side * value(v, h) > 0:
                before = h
                continue
            low, high = before, h
            slope = [k * c for k, c in enumerate(v)][1:]
            h = (low + high) // 2
            for _ in range(300):
                at = value(v, h)
                low, high = (h, high) if side * at > 0 else (low, h)
                following = h - (at << BITS) // value(slope, h)
                following = following if low < following < high else (low + high) // 2
                if abs(following - h) <= 4:
                    return following
                h = following
            raise ArithmeticError("a velocity zero was not found")
        return None

    def release(self, phi, tau, until):
        """First phase > tau at which |P sin phi| exceeds c1, or None, and the side."""
        force = lambda t: abs(self.stiffness(t) * mpmath.sin(phi)) - self.c[0]
        samples, low = 2000, tau
        for i in range(1, samples + 1):
            high = tau + 2 * mpmath.pi * i / samples
            if low >= until:
                return None
            if force(high) > 0:
                for _ in range(60):
                    middle = (low + high) / 2
                    low, high = (low, middle) if force(middle) > 0 else (middle, high)
                at = mpmath.findroot(force, (low, high), solver="secant", tol=mpf(10) ** -130)
                if at >= until:
                    return None
                return at, (-1 if self.stiffness(at) * mpmath.sin(phi) > 0 else 1)
            low = high
        return None

    def flow(self, start, phase, durations, derivatives):
        """States (phi, v) after the durations, derivatives (2 x 11), and the list of events."""
        phi, v = fixed(start[0]), fixed(start[1])
        columns = []
        if derivatives:
            columns = [[ONE if d == "phi" else 0, ONE if d == "phi_dot" else 0] for d in DIRECTIONS]
        begin = mpf(phase)
        tau = begin
        states, sensitivities, events = [], [], []
        stuck, side = False, (1 if v > 0 else -1)

        def leave_or_hold():
            positive, negative = self.acceleration(real(phi), tau, 1), self.acceleration(real(phi), tau, -1)
            return positive <= 0 <= negative and positive < negative, positive, negative

        if v == 0:
            stuck, _, negative = leave_or_hold()
            side = -1 if negative < 0 else 1
            if stuck:
                events.append("stick")
                for column in columns:
                    column[1] = 0
        for duration in durations:
            target = begin + mpf(duration)
            while tau < target:
                if stuck:
                    found = self.release(real(phi), tau, target)
                    if found is None:
                        tau = target
                        break
                    tau, side = found
                    stuck = False
                    events.append("release")
                series = self.series(phi, v, columns, tau, side)
                remaining = target - tau
                length = self.step_length(*series)
                landing = length >= remaining
                length = fixed(remaining if landing else length)
                zero = self.first_zero(series[1], length, side)
                h = length if zero is None else zero
                phi, v = value(series[0], h), value(series[1], h)
                columns = [[value(a, h), value(b, h)] for a, b in series[2]]
                tau = target if landing and zero is None else tau + real(h)
                if zero is None:
                    continue
                v = 0
                hold, positive, negative = leave_or_hold()
                arriving, leaving = (positive, negative) if side > 0 else (negative, positive)
                if not side * arriving < -mpf("1e-3"):
                    raise ArithmeticError("close to grazing: a bad case for a reference")
                if hold:
                    stuck = True
                    events.append("stick")
                else:
                    side = -side
                    events.append("cross")
                for column in columns:
                    # (M5): X+ = X- + (f- - f+) dt*, dt* = -dv / a-; the first components of f are both 0.
                    column[1] = 0 if hold else times(column[1], fixed(leaving / arriving))
            states.append((real(phi), real(v)))
            sensitivities.append([[real(c[i]) for c in columns] for i in range(2)])
        return states, sensitivities, events


COARSE, FINE = (44, 46), (60, 54)  # order, digits of a step


def moved(case, direction, by):
    start, p = [mpf(x) for x in case["start"]], {k: mpf(x) for k, x in case["parameters"].items()}
    if direction in p:
        p[direction] += by
    else:
        start[DIRECTIONS.index(direction)] += by
    return start, p


def typical(case, direction):
    return case["parameters"].get(direction) or mpf(1)


def differences(case, direction, function, events):
    """d function / d direction to fourth order; forward where only one side of a start leads to the same events."""
    h = mpf(10) ** -11 * typical(case, direction)
    one_sided = direction == "phi_dot" and case["start"][1] == 0.0 and not events[:1] == ["stick"]

    def at(multiple):
        start, p = moved(case, direction, multiple * h)
        result, seen = function(start, p)
        if seen != events:
            raise ArithmeticError("a difference quotient across other events")
        return result

    if one_sided:
        side = mpf(case["leaves_to"])
        weights = [-mpf(25) / 12, mpf(4), -mpf(3), mpf(4) / 3, -mpf(1) / 4]
        values = [at(side * i) for i in range(5)]
        return [side * mpmath.fdot(weights, column) / h for column in zip(*values)]
    values = [at(i) for i in (-2, -1, 1, 2)]
    weights = [mpf(1) / 12, -mpf(2) / 3, mpf(2) / 3, -mpf(1) / 12]
    return [mpmath.fdot(weights, column) / h for column in zip(*values)]


def worst(a, b):
    return max(abs(x - y) / (1 + abs(x)) for x, y in zip(a, b))


def flat(states, sensitivities):
    return [x for s in states for x in s] + [x for s in sensitivities for row in s for x in row]


def text(x):
    return mpmath.nstr(x, 36, min_fixed=-5, max_fixed=5)


def compute(case):
    def run(settings, derivatives=True, start=None, p=None):
        pendulum = Pendulum(p or case["parameters"], *settings)
        return pendulum.flow(start or case["start"], case["phase"], case["durations"], derivatives)

    states, sensitivities, events = run(FINE)
    again = run(COARSE)
    agreement = worst(flat(states, sensitivities), flat(*again[:2]))
    if events != again[2] or not agreement < mpf("1e-32"):
        sys.exit(f"{case['name']}: two integrations differ by {mpmath.nstr(agreement, 3)}")

    by_differences = mpf(0)
    for j, direction in enumerate(DIRECTIONS):
        if direction == "phi_dot" and events[:1] == ["stick"] and case["start"][1] == 0.0:
            continue  # moves by the square of the velocity and is held again: other events, derivative 0

        def values(start, p):
            s, _, seen = run(COARSE, False, start, p)
            return [x for state in s for x in state], seen

        quotient = differences(case, direction, values, events)
        exact = [s[i][j] for s in sensitivities for i in range(2)]
        by_differences = max(by_differences, worst(exact, quotient))
    if not by_differences < mpf("1e-30"):
        sys.exit(f"{case['name']}: derivatives differ from differences by {mpmath.nstr(by_differences, 3)}")
    print(
        case["name"], " ".join(events), "| two integrations differ by", mpmath.nstr(agreement, 3),
        "differences by", mpmath.nstr(by_differences, 3),
        "| end", [mpmath.nstr(x, 8) for x in states[-1]], file=sys.stderr,
    )
    result = dict(case)
    result.pop("second", None)
    result.update(
        events=events,
        two_integrations_differ_by=mpmath.nstr(agreement, 3),
        differences_differ_by=mpmath.nstr(by_differences, 3),
        states=[[text(x) for x in s] for s in states],
        sensitivities=[[[text(x) for x in row] for row in s] for s in sensitivities],
    )
    if "second" in case:
        # d^2 (phi, v at the end) / d i d j: differences of the first derivatives; both orders of i, j must agree.
        names = case["second"]
        table = {}
        for i in names:

            def firsts(start, p):
                _, s, seen = run(FINE, True, start, p)
                return [x for row in s[-1] for x in row], seen

            table[i] = differences(case, i, firsts, events)
        count = len(DIRECTIONS)
        second = [
            [[table[i][row * count + DIRECTIONS.index(j)] for j in names] for i in names] for row in range(2)
        ]
        asymmetry = max(
            abs(m[i][j] - m[j][i]) / (1 + abs(m[i][j])) for m in second for i in range(len(names)) for j in range(i)
        )
        if not asymmetry < mpf("1e-28"):
            sys.exit(f"{case['name']}: second derivatives are unsymmetric by {mpmath.nstr(asymmetry, 3)}")
        print(case["name"], "second derivatives, asymmetry", mpmath.nstr(asymmetry, 3), file=sys.stderr)
        result["second_directions"] = names
        result["second_asymmetry"] = mpmath.nstr(asymmetry, 3)
        result["second"] = [[[mpmath.nstr(x, 28) for x in row] for row in m] for m in second]
    return result


TURN = 6.283185307179586


def case(name, start, phase, durations, second=None, **parameters):
    c = dict(name=name, parameters={**DEFAULTS, **parameters}, start=start, phase=phase, durations=durations)
    if start[1] == 0.0:
        pendulum = Pendulum(c["parameters"], *COARSE)
        force = -pendulum.stiffness(mpf(phase)) * mpmath.sin(mpf(start[0]))
        if abs(force) > pendulum.c[0]:
            c["leaves_to"] = int(mpmath.sign(force))
    if second:
        c["second"] = second
    return c


SECOND = ("phi", "phi_dot", "l", "k1", "k2")
CASES = [
    case("one crossing", [0.3, 2.0], 0.7, [2.0, TURN], SECOND),
    case("two periods", [0.5, 3.0], 0.0, [TURN, 2 * TURN]),
    case("over the top", [2.5, -8.0], 0.7, [TURN, 3 * TURN]),
    case("slow crank, several crossings in a period", [0.5, 2.0], 0.3, [3.0, TURN], SECOND, omega=3.0),
    case("held and let go three times, weak friction", [0.01, 0.02], 0.0, [TURN, 8.0, 2 * TURN, 14.0, 3 * TURN]),
    case("starts held, is let go, swings", [0.02, 0.0], 0.0, [0.1, TURN, 15.0, 3 * TURN]),
    case("held, passes the top, held", [2.0, 1.0], 0.0, [1.0, TURN, 10.0, 2 * TURN, 3 * TURN], k1=0.1),
    case("held and let go, strong friction", [0.4, 1.0], 0.0, [2.0, 4.0, TURN, 8.0, 2 * TURN, 3 * TURN], k1=0.05),
    case("starts on the surface, leaves upwards", [-0.5, 0.0], 0.7, [0.5, TURN, 2 * TURN]),
    case("starts on the surface, leaves downwards", [1.2, 0.0], 3.0, [0.5, TURN, 2 * TURN]),
    case("starts on the surface above, leaves downwards", [-2.0, 0.0], 0.1, [0.5, TURN], k1=0.02),
    case("held until the end", [0.2, -1.0], 0.0, [0.5, TURN, 2 * TURN], k1=0.05),
]


def check_against_orbits():
    """Prime cycles without dry friction, from another program: they close."""
    path = os.path.join(os.path.dirname(os.path.abspath(__file__)), "pendulum_orbits_g9.81.json")
    with open(path) as file:
        table = json.load(file)
    worst_closure = mpf(0)
    moving = [c for c in table["cycles"] if c["points"][0][1] != 0.0]
    for points in (c["points"] for c in moving[:6]):
        for now, then in zip(points, points[1:] + points[:1]):
            state = Pendulum(table["parameters"], *COARSE).flow(now, 0.0, [2 * mpmath.pi], False)[0][0]
            turns = (state[0] - then[0]) / (2 * mpmath.pi)
            worst_closure = max(worst_closure, abs(turns - mpmath.nint(turns)), abs(state[1] - then[1]))
    print("orbits close to", mpmath.nstr(worst_closure, 3), file=sys.stderr)
    return worst_closure


def main():
    worst_closure = check_against_orbits()
    # Their points are given to 1e-12 and stretched by the map, by a factor of some ten.
    if not worst_closure < mpf("1e-10"):
        sys.exit("reference orbits do not close")
    results = [compute(c) for c in CASES]
    json.dump(
        {
            "model": "parametric_pendulum",
            "variant": "crank",
            "note": "made by pendulum_friction.py; inputs are doubles; clock and derivatives at fixed phase",
            "directions": DIRECTIONS,
            "orbits_close_to": mpmath.nstr(worst_closure, 3),
            "cases": results,
        },
        sys.stdout,
        indent=1,
    )
    print()


if __name__ == "__main__":
    main()
