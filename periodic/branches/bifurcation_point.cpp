#include "periodic/branches/bifurcation_point.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <optional>
#include <utility>

namespace orbid::periodic {
namespace {

using Complex = std::complex<double>;

/// Newton's last step but one on located orbits, in the norm: the last one squares it, down to the error of the flow.
constexpr double location_tolerance = 1e-12;
constexpr int most_newton_steps = 12;

/// Location stops at a bracket or step of this fraction of the way between the points. Test functions are known to
/// 1e-12 or so of their change over it.
constexpr double smallest_share = 1e-12;
constexpr int most_location_steps = 60;

/// A parameter that moves by less than this fraction of its range per arclength stands still: the sign of its slope is
/// rounding. (All orbits of a linear oscillator, for example, exist at one value of the parameter.)
constexpr double smallest_slope = 1e-9;

/// What equations that were kept regular at a branch point may miss: their rounding errors.
constexpr double largest_unfolding = 1e-10;

/// How near to -1 or 1 a multiplier is at a doubling or branch point, where its rounding is far smaller. Multipliers
/// near a homoclinic orbit are as large as the exponential of the period, and their sign may change through infinity.
constexpr double critical_distance = 1e-2;

/// Whether the multiplier is there that a sign of the determinants promised.
bool has_critical_multiplier(const CurvePoint& point, Bifurcation bifurcation) {
    if (bifurcation != Bifurcation::branch_point && bifurcation != Bifurcation::period_doubling) return true;
    const double wanted = bifurcation == Bifurcation::branch_point ? 1.0 : -1.0;
    return std::any_of(point.multipliers.begin(), point.multipliers.end(),
                       [&](const Complex& mu) { return std::abs(mu - wanted) < critical_distance; });
}

/// Product of (1 + sign mu), relative to the same product of the sizes.
double determinant(const std::vector<Complex>& multipliers, double sign) {
    Complex product = 1.0;
    for (const Complex& mu : multipliers)
        product *= 1.0 + sign * mu;
    return product.real();
}

double size_of(const std::vector<Complex>& multipliers) {
    double product = 1.0;
    for (const Complex& mu : multipliers)
        product *= std::max(1.0, std::abs(mu));
    return product;
}

int count_beyond(const std::vector<Complex>& multipliers, double sign) {
    return static_cast<int>(std::count_if(multipliers.begin(), multipliers.end(), [&](const Complex& mu) {
        return mu.imag() == 0.0 && sign * mu.real() > 1.0;
    }));
}

/// ln |mu| of the complex pair nearest to the unit circle.
std::optional<double> nearest_pair(const std::vector<Complex>& multipliers) {
    std::optional<double> nearest;
    for (const Complex& mu : multipliers)
        if (mu.imag() != 0.0) {
            const double distance = std::log(std::abs(mu));
            if (!nearest || std::abs(distance) < std::abs(*nearest)) nearest = distance;
        }
    return nearest;
}

bool opposite(double a, double b) {
    return (a > 0.0) != (b > 0.0);
}

/// The value of a test function; size: of the determinants, so that large multipliers do not overflow it.
std::optional<double> test_function(const CurvePoint& point, Bifurcation bifurcation, double size) {
    switch (bifurcation) {
        case Bifurcation::fold:
            return point.parameter_slope();
        case Bifurcation::branch_point:
            return determinant(point.multipliers, -1.0) / size;
        case Bifurcation::period_doubling:
            return determinant(point.multipliers, 1.0) / size;
        case Bifurcation::neimark_sacker:
            return nearest_pair(point.multipliers);
        case Bifurcation::none:
            break;
    }
    return std::nullopt;
}

struct BrentPoint {
    double s = 0.0;
    double value = 0.0;
    CurvePoint point;
};

/// From `best` to where the values interpolate to zero; none where that is no better than halving.
std::optional<double> interpolated_step(const BrentPoint& before, const BrentPoint& best, const BrentPoint& other,
                                        double half, double smallest, double step_before) {
    if (!(std::abs(step_before) >= smallest && std::abs(before.value) > std::abs(best.value))) return std::nullopt;
    const double ratio = best.value / before.value;
    double numerator = 2.0 * half * ratio;
    double denominator = 1.0 - ratio;
    if (before.s != other.s) {
        const double q = before.value / other.value;
        const double r = best.value / other.value;
        numerator = ratio * (2.0 * half * q * (q - r) - (best.s - before.s) * (r - 1.0));
        denominator = (q - 1.0) * (r - 1.0) * (ratio - 1.0);
    }
    if (numerator > 0.0) denominator = -denominator;
    numerator = std::abs(numerator);
    if (!(2.0 * numerator <
          std::min(3.0 * half * denominator - std::abs(smallest * denominator), std::abs(step_before * denominator))))
        return std::nullopt;
    return numerator / denominator;
}

/// The zero of a test function, see located().
LocatedPoint zero_between(const CurvePoint& a, const CurvePoint& b, Bifurcation bifurcation, const VectorXd* locked) {
    LocatedPoint result;
    result.bifurcation = bifurcation;
    const CurveCubic cubic(a, b);
    const double size = std::max(size_of(a.multipliers), size_of(b.multipliers));
    const auto value_a = test_function(a, bifurcation, size);
    const auto value_b = test_function(b, bifurcation, size);
    if (!value_a || !value_b || !opposite(*value_a, *value_b)) return result;

    // Brent's method. The zero lies between `best` and `other`; `before` is the best one of the step before.
    BrentPoint before{0.0, *value_a, a};
    BrentPoint best{cubic.length(), *value_b, b};
    BrentPoint other = before;
    const double smallest = smallest_share * cubic.length();
    double step = best.s - before.s;
    double step_before = step;
    double change = std::abs(b.parameter() - a.parameter());
    for (int k = 0; k < most_location_steps; ++k) {
        if (!opposite(best.value, other.value)) {
            other = before;
            step = step_before = best.s - before.s;
        }
        if (std::abs(other.value) < std::abs(best.value)) {
            before = best;
            best = other;
            other = before;
        }
        const double half = 0.5 * (other.s - best.s);
        if (std::abs(half) <= smallest || best.value == 0.0) break;
        const std::optional<double> interpolated = interpolated_step(before, best, other, half, smallest, step_before);
        const double next = interpolated.value_or(half);
        step_before = interpolated ? step : half;
        step = std::abs(next) > smallest ? next : std::copysign(smallest, half);
        before = best;
        const double s = best.s + step;
        Correction correction =
            a.curve->corrected(cubic.value(s), cubic.slope(s), location_tolerance, most_newton_steps, locked);
        if (correction.status != OrbitStatus::converged) return result;
        const auto value = test_function(correction.point, bifurcation, size);
        if (!value) return result;
        result.unfolding = std::abs(correction.unfolding);
        change = std::abs(correction.point.parameter() - best.point.parameter());
        best = {s, *value, std::move(correction.point)};
    }
    result.point = std::move(best.point);
    result.position = best.s;
    // The test function belongs to the orbit before Newton's last step.
    result.parameter_error = change + std::abs(result.point.parameter_slope()) * result.point.last_step;
    result.found = has_critical_multiplier(result.point, bifurcation);
    return result;
}

}  // namespace

CurveCubic::CurveCubic(const CurvePoint& a, const CurvePoint& b)
    : a_(a.y), b_(b.y), slope_a_(a.tangent), slope_b_(b.tangent), length_(a.curve->norm(b.y - a.y)) {}

VectorXd CurveCubic::value(double s) const {
    const double x = s / length_;
    const double y = 1.0 - x;
    return y * y * ((1.0 + 2.0 * x) * a_ + (x * length_) * slope_a_) +
           x * x * ((1.0 + 2.0 * y) * b_ - (y * length_) * slope_b_);
}

VectorXd CurveCubic::slope(double s) const {
    const double x = s / length_;
    const double y = 1.0 - x;
    return (6.0 * x * y / length_) * (b_ - a_) + (y * (1.0 - 3.0 * x)) * slope_a_ + (x * (3.0 * x - 2.0)) * slope_b_;
}

double CurveCubic::where_parameter(double value, double lower, double upper) const {
    const auto last = a_.size() - 1;
    const bool rising = this->value(upper)(last) > value;
    for (int k = 0; k < 60; ++k) {
        const double middle = 0.5 * (lower + upper);
        ((this->value(middle)(last) > value) == rising ? upper : lower) = middle;
    }
    return upper;
}

Events events_between(const CurvePoint& a, const CurvePoint& b) {
    Events events;
    const double slope = std::max(std::abs(a.parameter_slope()), std::abs(b.parameter_slope()));
    const bool vertical = !(slope > smallest_slope * a.curve->setting().range);
    events.fold = !vertical && opposite(a.parameter_slope(), b.parameter_slope());
    const bool plus = opposite(determinant(a.multipliers, -1.0), determinant(b.multipliers, -1.0));
    events.branch_point = !vertical && plus != events.fold;
    const int minus = count_beyond(b.multipliers, -1.0) - count_beyond(a.multipliers, -1.0);
    const int positive = count_beyond(b.multipliers, 1.0) - count_beyond(a.multipliers, 1.0);
    events.period_doubling = minus % 2 != 0;
    // Crossings at +-1 account for one unstable multiplier each, a pair for two.
    int rest = b.unstable() - a.unstable();
    if (events.period_doubling) rest -= minus > 0 ? 1 : -1;
    if (positive % 2 != 0) rest -= positive > 0 ? 1 : -1;
    const auto pair_a = nearest_pair(a.multipliers);
    const auto pair_b = nearest_pair(b.multipliers);
    const bool pair = pair_a && pair_b && opposite(*pair_a, *pair_b);
    events.neimark_sacker = rest != 0 && pair;
    events.several = std::abs(minus) > 1 || std::abs(positive) > 1 || (rest != 0 && !pair) || std::abs(rest) > 2;
    return events;
}

double largest_multiplier_move(const CurvePoint& a, const CurvePoint& b) {
    double largest = 0.0;
    for (const auto& mu : b.multipliers) {
        double nearest = std::numeric_limits<double>::infinity();
        for (const auto& old : a.multipliers)
            nearest = std::min(nearest, std::abs(mu - old) / std::max({1.0, std::abs(old), std::abs(mu)}));
        largest = std::max(largest, nearest);
    }
    return largest;
}

LocatedPoint located(const CurvePoint& a, const CurvePoint& b, Bifurcation bifurcation) {
    if (bifurcation == Bifurcation::branch_point) {
        // There the orbit is a double zero of the equations, and it is locked in one direction: rounding alone moves it
        // along the other branch by as much as the distance from the branch point. That is allowed where the equations
        // still hold, as those of symmetric orbits do.
        const bool nearer = std::abs(determinant(a.multipliers, -1.0)) < std::abs(determinant(b.multipliers, -1.0));
        const VectorXd other_branch = a.curve->crossing_direction(nearer ? a : b);
        if (other_branch.allFinite()) {
            const LocatedPoint point = zero_between(a, b, bifurcation, &other_branch);
            if (point.found && point.unfolding <= largest_unfolding) return point;
        }
    }
    return zero_between(a, b, bifurcation, nullptr);
}

Correction orbit_between(const CurvePoint& a, const CurvePoint& b, double parameter) {
    const CurveCubic cubic(a, b);
    const double s = cubic.where_parameter(parameter, 0.0, cubic.length());
    VectorXd guess = cubic.value(s);
    guess(guess.size() - 1) = parameter;
    return a.curve->corrected(guess, a.curve->parameter_direction(), location_tolerance, most_newton_steps);
}

}  // namespace orbid::periodic
