#!/usr/bin/env python3
"""Robertson's reaction: states to 18 digits, derivatives with respect to the rates to 13.

    y1' = -k1 y1 + k3 y2 y3,   y2' = k1 y1 - k3 y2 y3 - k2 y2^2,   y3' = k2 y2^2,   y(0) = (1, 0, 0)

Gauss collocation with 12 stages (order 24) in 45 digits, steps that grow by a constant ratio, 1.4 and 1.25. Their
difference (3e-14 of y2, 4e-19 of the others) is the error of the first; that of the second is smaller by
(ln 1.25 / ln 1.4)^24 = 5e-5. Derivatives: central differences of relative step 1e-12, whose error is 1e-24, of runs
with the first ratio. Prints the rows of tests/models/trajectories/stiff_test.cpp.

    ./robertson.py        (Python 3, mpmath; some minutes)
"""
import sys
from mpmath import mp, mpf, matrix, lu_solve, polyroots, legendre, taylor, quad

mp.dps = 45
STAGES = 12


def gauss(stages):
    """Nodes on (0, 1) and the matrix of integrals of Lagrange's polynomials."""
    nodes = sorted((1 + root) / 2 for root in polyroots(taylor(lambda x: legendre(stages, x), 0, stages)[::-1],
                                                         maxsteps=500, extraprec=400))
    powers = matrix(stages, stages)
    for i in range(stages):
        for k in range(stages):
            powers[i, k] = nodes[i]**k
    inverse = powers**-1
    a = matrix(stages, stages)
    b = [sum(inverse[k, j] / (k + 1) for k in range(stages)) for j in range(stages)]
    for i in range(stages):
        for j in range(stages):
            a[i, j] = sum(inverse[k, j] * nodes[i]**(k + 1) / (k + 1) for k in range(stages))
    return nodes, a, b


NODES, A, B = gauss(STAGES)


def slope(y, k):
    y2, y3 = y
    y1 = 1 - y2 - y3
    return [k[0] * y1 - k[2] * y2 * y3 - k[1] * y2**2, k[1] * y2**2]


def jacobian(y, k):
    y2, y3 = y
    return [[-k[0] - k[2] * y3 - 2 * k[1] * y2, -k[0] - k[2] * y2], [2 * k[1] * y2, mpf(0)]]


def step(y, h, k):
    z = [mpf(0)] * (2 * STAGES)
    for _ in range(30):
        at = [[y[0] + z[2 * i], y[1] + z[2 * i + 1]] for i in range(STAGES)]
        f = [slope(p, k) for p in at]
        j = [jacobian(p, k) for p in at]
        m = matrix(2 * STAGES, 2 * STAGES)
        g = matrix(2 * STAGES, 1)
        for r in range(STAGES):
            for c in range(2):
                g[2 * r + c] = z[2 * r + c] - h * sum(A[r, s] * f[s][c] for s in range(STAGES))
                for s in range(STAGES):
                    for d in range(2):
                        m[2 * r + c, 2 * s + d] = (1 if (r, c) == (s, d) else 0) - h * A[r, s] * j[s][c][d]
        change = lu_solve(m, g)
        z = [z[i] - change[i] for i in range(2 * STAGES)]
        if max(abs(c) for c in change) < mpf(10)**-38:
            break
    else:
        raise RuntimeError("no convergence")
    at = [[y[0] + z[2 * i], y[1] + z[2 * i + 1]] for i in range(STAGES)]
    f = [slope(p, k) for p in at]
    return [y[c] + h * sum(B[s] * f[s][c] for s in range(STAGES)) for c in range(2)]


def solve(k, end, ratio):
    """Steps end at first * ratio^i, the last one at `end`."""
    y = [mpf(0), mpf(0)]
    t, until = mpf(0), mpf(10)**-4
    while t < end:
        until = min(until, end)
        y = step(y, until - t, k)
        t, until = until, until * ratio
    return [1 - y[0] - y[1], y[0], y[1]]


def main():
    rates = [mpf(4) / 100, mpf(3) * 10**7, mpf(10)**4]
    end = mpf(40)
    coarse = solve(rates, end, mpf("1.4"))
    value = solve(rates, end, mpf("1.25"))
    print("digits:", [mp.nstr(abs(a / b - 1), 3) for a, b in zip(coarse, value)], file=sys.stderr)
    print("y", *[mp.nstr(v, 25) for v in value])
    for i in range(3):
        h = mpf(10)**-12
        up, down = list(rates), list(rates)
        up[i] *= 1 + h
        down[i] *= 1 - h
        above, below = solve(up, end, mpf("1.4")), solve(down, end, mpf("1.4"))
        print(f"dy/dk{i + 1}", *[mp.nstr((a - b) / (2 * h * rates[i]), 20) for a, b in zip(above, below)])


main()
