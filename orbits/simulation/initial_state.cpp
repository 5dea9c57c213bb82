#include "orbits/simulation/initial_state.hpp"

#include <array>
#include <cmath>
#include <optional>

#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/definition/parameter.hpp"

namespace orbid::orbits {
namespace {

constexpr int cubic = 4;  // coefficients

struct Fit {
    double value = 0.0;
    double slope = 0.0;
    double rms = 0.0;
};

/// Least squares polynomial through (t, y), t counted from the first sample, value and slope at 0.
Fit polynomial(const std::vector<double>& t, const std::vector<double>& y, std::size_t count) {
    const auto coefficients = static_cast<Eigen::Index>(std::min<std::size_t>(cubic, count));
    const auto rows = static_cast<Eigen::Index>(count);
    const double length = t[count - 1] > 0.0 ? t[count - 1] : 1.0;
    Eigen::MatrixXd design(rows, coefficients);
    Eigen::VectorXd right(rows);
    for (Eigen::Index k = 0; k < rows; ++k) {
        double power = 1.0;
        for (Eigen::Index j = 0; j < coefficients; ++j, power *= t[static_cast<std::size_t>(k)] / length)
            design(k, j) = power;
        right[k] = y[static_cast<std::size_t>(k)];
    }
    const Eigen::VectorXd c = models::PivotedFactor(design).solve(right);
    const double freedom = static_cast<double>(std::max<Eigen::Index>(rows - coefficients, 1));
    return {c[0], coefficients > 1 ? c[1] / length : 0.0, std::sqrt((design * c - right).squaredNorm() / freedom)};
}

/// The sensor whose readings are inverted. A difference of readings says of the state what the rate itself says, to
/// first order in the delay.
models::Sensor inverted_sensor(const SegmentReading& reading) {
    return reading.sensor.type == models::Sensor::Type::function ? reading.sensor : models::Sensor();
}

/// What the readings miss, and its slope with respect to the coordinates that are read; empty where there is none.
struct Miss {
    Eigen::VectorXd defect;
    Eigen::MatrixXd slope;
};
std::optional<Miss> miss(const models::System& system, const Eigen::VectorXd& theta, const SegmentReading& reading,
                         const std::vector<Eigen::Index>& read, const Eigen::VectorXd& wanted,
                         const Eigen::VectorXd& x) {
    const std::array<double, 1> phase{reading.phase};
    const models::Sensor sensor = inverted_sensor(reading);
    const auto now = system.readings(sensor, x, phase, theta, std::span<const Eigen::Index>{});
    if (now.status != models::FlowStatus::ok) return std::nullopt;
    const auto m = static_cast<Eigen::Index>(read.size());
    Miss result{Eigen::VectorXd(m), now.derivatives(read, read)};
    for (Eigen::Index i = 0; i < m; ++i) {
        const Eigen::Index row = read[static_cast<std::size_t>(i)];
        result.defect[i] = wanted[row] - now.readings(row, 0);
        if (models::reads_angle(sensor, system.coordinates(), static_cast<std::size_t>(row)))
            result.defect[i] = models::wrapped(result.defect[i]);
    }
    return result;
}

/// State whose reading is `wanted` in the coordinates that are read; the others are kept. The instruments of models are
/// shifts, for which one step is exact; more steps serve formulas, which bend: there a step that leads away is halved.
Eigen::VectorXd state_with_reading(const models::System& system, const Eigen::VectorXd& theta,
                                   const SegmentReading& reading, const std::vector<Eigen::Index>& read,
                                   const Eigen::VectorXd& wanted, Eigen::VectorXd x) {
    const bool bends = reading.sensor.type == models::Sensor::Type::function;
    const int steps = bends ? 50 : 5;
    constexpr int halvings = 30;
    auto now = miss(system, theta, reading, read, wanted, x);
    if (!now && bends) {  // a logarithm, say: 1 is a number that most formulas take
        x(read).setOnes();
        now = miss(system, theta, reading, read, wanted, x);
    }
    for (int step = 0; step < steps && now; ++step) {
        Eigen::VectorXd change = models::CompleteFactor(now->slope).solve(now->defect);
        if (!change.allFinite()) return x;
        Eigen::VectorXd next = x;
        std::optional<Miss> trial;
        for (int halving = 0; halving < (bends ? halvings : 1); ++halving, change /= 2.0) {
            next = x;
            for (std::size_t j = 0; j < read.size(); ++j)
                next[read[j]] += change[static_cast<Eigen::Index>(j)];
            trial = miss(system, theta, reading, read, wanted, next);
            if (!bends || (trial && trial->defect.norm() <= now->defect.norm())) break;
            trial.reset();
        }
        if (bends && !trial) return x;
        x = next;
        now = std::move(trial);
        if (change.norm() <= 1e-14 * (1.0 + x.norm())) break;
    }
    return x;
}

/// Unread coordinates such that the read ones change as fast as their slopes say.
void solve_slopes(const models::System& system, const Eigen::VectorXd& theta, const SegmentReading& reading,
                  const std::vector<Eigen::Index>& read, const std::vector<Eigen::Index>& unread,
                  const Eigen::VectorXd& slopes, Eigen::VectorXd& x) {
    constexpr int steps = 20;
    const std::array<double, 1> phases{reading.phase};
    const auto rows = static_cast<Eigen::Index>(read.size());
    const auto columns = static_cast<Eigen::Index>(unread.size());
    const auto defect = [&](const Eigen::VectorXd& state) {
        Eigen::MatrixXd f = system.rhs(state, phases, theta);
        if (reading.sensor.type == models::Sensor::Type::function) {
            const auto now = system.readings(reading.sensor, state, phases, theta, std::span<const Eigen::Index>{});
            f = Eigen::MatrixXd(now.derivatives * f);
        }
        Eigen::VectorXd d(rows);
        for (Eigen::Index i = 0; i < rows; ++i)
            d[i] = slopes[i] - f(read[static_cast<std::size_t>(i)], 0);
        return d;
    };
    for (int step = 0; step < steps; ++step) {
        const Eigen::VectorXd now = defect(x);
        Eigen::MatrixXd jacobian(rows, columns);
        for (Eigen::Index j = 0; j < columns; ++j) {
            const Eigen::Index column = unread[static_cast<std::size_t>(j)];
            const double h = 1e-6 * (1.0 + std::abs(x[column]));  // near cbrt(epsilon): best for central differences
            Eigen::VectorXd above = x, below = x;
            above[column] += h;
            below[column] -= h;
            jacobian.col(j) = (defect(below) - defect(above)) / (2.0 * h);
        }
        // The rank decides: directions that no slope depends on are left where they are.
        models::CompleteFactor decomposition;
        decomposition.compute(jacobian, 1e-8);
        const Eigen::VectorXd change = decomposition.solve(now);
        if (!change.allFinite()) return;
        Eigen::VectorXd next = x;
        for (Eigen::Index j = 0; j < columns; ++j)
            next[unread[static_cast<std::size_t>(j)]] += change[j];
        if (!(defect(next).norm() <= now.norm())) return;
        x = next;
        if (change.norm() <= 1e-10 * (1.0 + x.norm())) return;
    }
}

}  // namespace

LocalSlope slope_at_start(const Eigen::VectorXd& times, const Eigen::VectorXd& values, bool angle) {
    constexpr std::array<std::size_t, 5> widths{5, 9, 17, 33, 65};
    constexpr double growth = 1.5;  // of the residual, that still counts as describing equally well
    std::vector<double> t, y;
    for (Eigen::Index k = 0; k < values.size() && t.size() < widths.back(); ++k) {
        if (!std::isfinite(values[k])) continue;
        const double near = y.empty() ? 0.0 : y.back();
        t.push_back(times[k] - times[0]);
        y.push_back(angle && !y.empty() ? near + models::wrapped(values[k] - near) : values[k]);
    }
    if (t.empty()) return {};
    std::size_t used = std::min(widths.front(), t.size());
    Fit best = polynomial(t, y, used);
    for (const std::size_t width : widths) {
        if (width <= used || width > t.size()) continue;
        const Fit wider = polynomial(t, y, width);
        if (!(wider.rms <= growth * best.rms)) break;
        best = wider;
        used = width;
    }
    return {best.value, best.slope, static_cast<int>(used)};
}

Eigen::VectorXd initial_state(const models::System& system, const Eigen::VectorXd& theta,
                              const SegmentReading& reading) {
    const Eigen::Index n = system.dimension();
    Eigen::VectorXd wanted = Eigen::VectorXd::Zero(n);
    std::vector<Eigen::Index> read, unread;
    std::vector<double> slopes;
    std::vector<bool> known(static_cast<std::size_t>(n), false);
    for (std::size_t i = 0; i < reading.coordinate.size(); ++i) {
        const Eigen::Index coordinate = reading.coordinate[i];
        const Eigen::VectorXd values = reading.segment.values.row(static_cast<Eigen::Index>(i));
        const bool angle =
            models::reads_angle(reading.sensor, system.coordinates(), static_cast<std::size_t>(coordinate));
        const auto local = slope_at_start(reading.segment.times, values, angle);
        if (local.samples == 0) continue;
        wanted[coordinate] = std::isfinite(values[0]) ? values[0] : local.value;
        known[static_cast<std::size_t>(coordinate)] = true;
        read.push_back(coordinate);
        slopes.push_back(local.slope);
    }
    for (Eigen::Index i = 0; i < n; ++i)
        if (!known[static_cast<std::size_t>(i)]) unread.push_back(i);
    if (read.empty()) return wanted;
    // Formulas may read what is unread: both steps settle after a few rounds, or the fit has to do the rest.
    const int rounds = reading.sensor.type == models::Sensor::Type::function && !unread.empty() ? 4 : 1;
    Eigen::VectorXd x = wanted;
    for (int round = 0; round < rounds; ++round) {
        x = state_with_reading(system, theta, reading, read, wanted, x);
        if (unread.empty()) break;
        const Eigen::VectorXd rates = Eigen::Map<const Eigen::VectorXd>(slopes.data(), std::ssize(slopes));
        solve_slopes(system, theta, reading, read, unread, rates, x);
    }
    return x;
}

}  // namespace orbid::orbits
