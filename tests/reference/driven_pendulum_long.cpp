// Cycles of the torque-driven pendulum of periods 9 to 12 in extended precision; writes driven_pendulum_long.json.
//
//   g++ -std=gnu++20 -O2 driven_pendulum_long.cpp -lquadmath -o driven_pendulum_long
//   ./driven_pendulum_long > driven_pendulum_long.json
//
//   theta'' = -gamma theta' - sin(theta) + A cos(omega t),   gamma = 0.2, A = 1.2, omega = 2/3, section t = 0 mod 3 pi
//
// Nothing of the library is used. The flow and its variational equations by Gragg's extrapolation of the midpoint rule
// to order 18; starts from recurrences of a trajectory of 12000 periods, Newton's method on all points at once, first
// in double with 64 steps per period, then in 113 bits with 160 steps. The unstable multiplier is the dominant
// eigenvalue of the product of the Jacobians, the stable one follows from the product exp(-gamma p T) of both, which is
// exact. 128 steps give the same 17 digits.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include <quadmath.h>

namespace {

using Quad = __float128;

double sine(double x) {
    return std::sin(x);
}
double cosine(double x) {
    return std::cos(x);
}
double root(double x) {
    return std::sqrt(x);
}
double exponential(double x) {
    return std::exp(x);
}
double rest_of(double x, double y) {
    return std::remainder(x, y);
}
double size_of(double x) {
    return std::abs(x);
}
Quad sine(Quad x) {
    return sinq(x);
}
Quad cosine(Quad x) {
    return cosq(x);
}
Quad root(Quad x) {
    return sqrtq(x);
}
Quad exponential(Quad x) {
    return expq(x);
}
Quad rest_of(Quad x, Quad y) {
    return remainderq(x, y);
}
Quad size_of(Quad x) {
    return fabsq(x);
}

template <class Real>
using Point = std::array<Real, 2>;
/// theta, theta', then the derivatives of both by theta_0 and by theta'_0.
template <class Real>
using Jet = std::array<Real, 6>;

template <class Real>
struct Equations {
    static constexpr bool quad = sizeof(Real) > 8;
    static constexpr int steps = quad ? 160 : 64;
    static constexpr double settled = quad ? 1e-24 : 1e-9;
    Real pi = quad ? static_cast<Real>(M_PIq) : static_cast<Real>(3.14159265358979323846);
    Real gamma = Real(1) / Real(5), amplitude = Real(6) / Real(5), omega = Real(2) / Real(3);

    Jet<Real> slope(const Jet<Real>& x, Real t) const {
        const Real stiffness = -cosine(x[0]);
        return {x[1], -gamma * x[1] - sine(x[0]) + amplitude * cosine(omega * t),
                x[3], stiffness * x[2] - gamma * x[3],
                x[5], stiffness * x[4] - gamma * x[5]};
    }

    Jet<Real> step(const Jet<Real>& x, Real t, Real length) const {
        constexpr int columns = 9;
        std::array<Jet<Real>, columns> table;
        for (int j = 0; j < columns; ++j) {
            const int substeps = 2 * (j + 1);
            const Real h = length / Real(substeps);
            Jet<Real> before = x, now = x, f = slope(x, t);
            for (std::size_t c = 0; c < 6; ++c)
                now[c] += h * f[c];
            for (int i = 1; i < substeps; ++i) {
                f = slope(now, t + Real(i) * h);
                for (std::size_t c = 0; c < 6; ++c) {
                    const Real next = before[c] + Real(2) * h * f[c];
                    before[c] = now[c];
                    now[c] = next;
                }
            }
            f = slope(now, t + length);
            for (std::size_t c = 0; c < 6; ++c)
                table[static_cast<std::size_t>(j)][c] = (before[c] + now[c] + h * f[c]) / Real(2);
            for (int i = j - 1; i >= 0; --i) {
                const Real ratio = Real(j + 1) / Real(i + 1);
                Jet<Real>& coarse = table[static_cast<std::size_t>(i)];
                const Jet<Real>& fine = table[static_cast<std::size_t>(i) + 1];
                for (std::size_t c = 0; c < 6; ++c)
                    coarse[c] = fine[c] + (fine[c] - coarse[c]) / (ratio * ratio - Real(1));
            }
        }
        return table[0];
    }

    /// State and Jacobian one period later.
    Jet<Real> over_period(const Point<Real>& start) const {
        Jet<Real> x{start[0], start[1], 1, 0, 0, 1};
        for (int k = 0; k < steps; ++k)
            x = step(x, period() * Real(k) / Real(steps), period() / Real(steps));
        return x;
    }

    Real period() const { return Real(2) * pi / omega; }
    Real wrapped(Real angle) const { return rest_of(angle, Real(2) * pi); }
};

template <class Real>
struct Cycle {
    std::vector<Point<Real>> points;
    int rotation = 0;
    Real unstable = 0;
    Real stable = 0;
};

/// Solves a x = b by elimination with row exchanges.
template <class Real>
std::vector<Real> solved(std::vector<std::vector<Real>> a, std::vector<Real> b) {
    const std::size_t n = b.size();
    for (std::size_t c = 0; c < n; ++c) {
        std::size_t pivot = c;
        for (std::size_t r = c + 1; r < n; ++r)
            if (size_of(a[r][c]) > size_of(a[pivot][c])) pivot = r;
        std::swap(a[c], a[pivot]);
        std::swap(b[c], b[pivot]);
        for (std::size_t r = c + 1; r < n; ++r) {
            const Real factor = a[r][c] / a[c][c];
            for (std::size_t k = c; k < n; ++k)
                a[r][k] -= factor * a[c][k];
            b[r] -= factor * b[c];
        }
    }
    for (std::size_t c = n; c-- > 0;) {
        for (std::size_t k = c + 1; k < n; ++k)
            b[c] -= a[c][k] * b[k];
        b[c] /= a[c][c];
    }
    return b;
}

/// Newton's method on all points; empty when it leads far away or does not converge.
template <class Real>
Cycle<Real> closed(std::vector<Point<Real>> points, const Equations<Real>& pendulum = {}) {
    const std::size_t p = points.size();
    const std::vector<Point<Real>> guess = points;
    for (int iteration = 0; iteration < 12; ++iteration) {
        std::vector<std::vector<Real>> matrix(2 * p, std::vector<Real>(2 * p, Real(0)));
        std::vector<Real> right(2 * p);
        std::array<Real, 4> product{1, 0, 0, 1};
        double turns = 0.0;
        for (std::size_t j = 0; j < p; ++j) {
            const Jet<Real> image = pendulum.over_period(points[j]);
            const std::size_t next = (j + 1) % p;
            matrix[2 * j][2 * j] += image[2];
            matrix[2 * j][2 * j + 1] += image[4];
            matrix[2 * j + 1][2 * j] += image[3];
            matrix[2 * j + 1][2 * j + 1] += image[5];
            matrix[2 * j][2 * next] -= Real(1);
            matrix[2 * j + 1][2 * next + 1] -= Real(1);
            right[2 * j] = -pendulum.wrapped(image[0] - points[next][0]);
            right[2 * j + 1] = points[next][1] - image[1];
            turns += static_cast<double>((image[0] - points[next][0]) / (Real(2) * pendulum.pi));
            product = {image[2] * product[0] + image[4] * product[2], image[2] * product[1] + image[4] * product[3],
                       image[3] * product[0] + image[5] * product[2], image[3] * product[1] + image[5] * product[3]};
        }
        const std::vector<Real> move = solved(matrix, right);
        double size = 0.0;
        for (std::size_t j = 0; j < p; ++j)
            for (std::size_t i = 0; i < 2; ++i) {
                points[j][i] += move[2 * j + i];
                size = std::max(size, static_cast<double>(size_of(move[2 * j + i])));
            }
        if (!(size < 0.3)) return {};
        if (size > Equations<Real>::settled) continue;
        for (std::size_t j = 0; j < p; ++j) {
            if (!(size_of(points[j][0] - guess[j][0]) < Real(0.3))) return {};
            points[j][0] = pendulum.wrapped(points[j][0]);
        }
        // The root of larger size of mu^2 - trace mu + exp(-gamma p T).
        const Real half = (product[0] + product[3]) / Real(2);
        const Real both = exponential(-pendulum.gamma * Real(static_cast<int>(p)) * pendulum.period());
        const Real discriminant = root(half * half - both);
        const Real unstable = half > Real(0) ? half + discriminant : half - discriminant;
        return {points, static_cast<int>(std::lround(turns)), unstable, both / unstable};
    }
    return {};
}

bool prime(const Cycle<double>& cycle) {
    const std::size_t p = cycle.points.size();
    for (std::size_t d = 1; d < p; ++d)
        if (p % d == 0 && std::abs(Equations<double>().wrapped(cycle.points[d][0] - cycle.points[0][0])) < 1e-6 &&
            std::abs(cycle.points[d][1] - cycle.points[0][1]) < 1e-6)
            return false;
    return true;
}

/// d ln |unstable multiplier| / d parameter by central differences of solved cycles, of order four: truncation and
/// rounding leave 1e-12 or less.
Quad slope_of(const Cycle<Quad>& cycle, Quad Equations<Quad>::*parameter) {
    const Quad h = 1e-7Q;
    const auto ln_at = [&](int k) {
        Equations<Quad> moved;
        moved.*parameter += Quad(k) * h;
        return logq(fabsq(closed<Quad>(cycle.points, moved).unstable));
    };
    return (Quad(8) * (ln_at(1) - ln_at(-1)) - (ln_at(2) - ln_at(-2))) / (Quad(12) * h);
}

std::string text(Quad x) {
    char buffer[64];
    quadmath_snprintf(buffer, sizeof buffer, "%.18Qg", x);
    return buffer;
}

}  // namespace

int main() {
    constexpr std::size_t length = 12000;
    constexpr double recurrent = 0.03;
    constexpr std::size_t per_period = 4;
    const Equations<double> pendulum;
    std::vector<Point<double>> series{{0.3, 0.2}};
    for (std::size_t t = 0; t < length + 100; ++t) {
        const Jet<double> x = pendulum.over_period(series.back());
        series.push_back({pendulum.wrapped(x[0]), x[1]});
    }
    series.erase(series.begin(), series.begin() + 100);
    std::printf(
        "{\n \"model\": \"driven pendulum: theta'' = -gamma theta' - sin(theta) + A cos(omega t)\",\n"
        " \"parameters\": {\"gamma\": 0.2, \"A\": 1.2, \"omega\": \"2/3\"},\n"
        " \"section\": \"t = 0 mod 2 pi / omega\",\n"
        " \"note\": \"made by driven_pendulum_long.cpp in 113 bits, 18 digits printed; the stable multiplier "
        "from the product, exactly exp(-gamma p T)\",\n \"cycles\": [");
    bool first = true;
    for (std::size_t p = 9; p <= 12; ++p) {
        std::vector<Cycle<double>> found;
        for (std::size_t t = 0; t + p < series.size() && found.size() < per_period; ++t) {
            if (!(std::abs(pendulum.wrapped(series[t + p][0] - series[t][0])) < recurrent &&
                  std::abs(series[t + p][1] - series[t][1]) < recurrent))
                continue;
            const auto begin = series.begin() + static_cast<std::ptrdiff_t>(t);
            const auto cycle = closed<double>({begin, begin + static_cast<std::ptrdiff_t>(p)});
            if (cycle.points.empty() || !prime(cycle)) continue;
            const bool known = std::any_of(found.begin(), found.end(), [&](const Cycle<double>& other) {
                return std::abs(other.unstable / cycle.unstable - 1.0) < 1e-6;
            });
            if (!known) found.push_back(cycle);
        }
        for (const Cycle<double>& rough : found) {
            std::vector<Point<Quad>> start;
            for (const Point<double>& point : rough.points)
                start.push_back({point[0], point[1]});
            const Cycle<Quad> cycle = closed<Quad>(start);
            if (cycle.points.empty()) return 1;
            std::string slopes;
            if (&rough == &found.front())
                slopes = "\n   \"ln_unstable_by_gamma_A_omega\": [\"" + text(slope_of(cycle, &Equations<Quad>::gamma)) +
                         "\", \"" + text(slope_of(cycle, &Equations<Quad>::amplitude)) + "\", \"" +
                         text(slope_of(cycle, &Equations<Quad>::omega)) + "\"],";
            std::printf(
                "%s\n  {\"period\": %zu, \"rotation\": %d,\n   \"unstable_multiplier\": \"%s\", "
                "\"stable_multiplier\": \"%s\",%s\n   \"points\": [",
                first ? "" : ",", p, cycle.rotation, text(cycle.unstable).c_str(), text(cycle.stable).c_str(),
                slopes.c_str());
            for (std::size_t j = 0; j < p; ++j)
                std::printf("%s[\"%s\", \"%s\"]", j == 0 ? "" : (j % 2 == 0 ? ",\n              " : ", "),
                            text(cycle.points[j][0]).c_str(), text(cycle.points[j][1]).c_str());
            std::printf("]}");
            first = false;
        }
    }
    std::printf("\n ]\n}\n");
    return 0;
}
