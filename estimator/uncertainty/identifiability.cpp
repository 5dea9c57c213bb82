#include "estimator/uncertainty/identifiability.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include "estimator/algebra/r_factor.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/arithmetic/singular_values.hpp"
#include "models/arithmetic/triangular_solve.hpp"

namespace orbid::estimator {

namespace {

/// A component below this fraction of the largest is noise of the derivatives, not part of the direction.
constexpr double tiny_component = 1e-6;

/// Largest component 1; of components equal to rounding the first sets the sign.
Eigen::VectorXd scaled_to_largest(const Eigen::VectorXd& components) {
    const double largest = components.lpNorm<Eigen::Infinity>();
    Eigen::Index first = 0;
    while (std::abs(components[first]) < (1.0 - tiny_component) * largest)
        ++first;
    return components / components[first];
}

/// Reduced echelon form of the directions (rows), so that each has as few components as possible; largest component 1.
std::vector<NullDirection> sparse_basis(Eigen::MatrixXd rows) {
    const Eigen::Index count = rows.rows();
    for (Eigen::Index k = 0; k < count; ++k) {
        Eigen::Index row = 0;
        Eigen::Index column = 0;
        rows.bottomRows(count - k).cwiseAbs().maxCoeff(&row, &column);
        rows.row(k).swap(rows.row(k + row));
        rows.row(k) /= rows(k, column);
        for (Eigen::Index i = 0; i < count; ++i)
            if (i != k) rows.row(i) -= rows(i, column) * rows.row(k);
    }
    std::vector<NullDirection> directions;
    for (Eigen::Index k = 0; k < count; ++k) {
        Eigen::VectorXd components = scaled_to_largest(rows.row(k).transpose());
        for (double& component : components)
            if (std::abs(component) < tiny_component) component = 0.0;
        directions.push_back({components});
    }
    return directions;
}

/// sd of a relative change from which on a direction is sloppy: the parameters are known within a factor e at best.
constexpr double sloppy_sd = 1.0;
/// Only where some direction is better determined by this factor: otherwise the sds show that all are poor.
constexpr double sloppy_gap = 10.0;
/// A simpler direction may stand for the exact one when the data notice it this much more at most.
constexpr double simplification = 1.1;
/// Denominators of simple exponents: powers in laws of physics.
constexpr std::array<int, 5> denominators{1, 2, 3, 4, 6};

/// The simplest fraction next to a number in [-1, 1], in the order of its denominator, that lies within `tolerance`;
/// the number itself if none does.
double simple_fraction(double value, double tolerance) {
    for (const int denominator : denominators) {
        const double fraction = std::round(value * denominator) / denominator;
        if (std::abs(fraction - value) <= tolerance) return fraction;
    }
    return value;
}

/// What the data determine about relative changes of the free parameters, without the null directions.
class RelativeData {
public:
    RelativeData(const Eigen::MatrixXd& relative, const Eigen::MatrixXd& null) : sensitivities_(relative) {
        const Eigen::Index free = relative.cols();
        Eigen::MatrixXd seen = Eigen::MatrixXd::Identity(free, free);
        if (null.cols() > 0) {
            const Eigen::MatrixXd q = models::HouseholderFactor(null.colwise().normalized()).q();
            seen = q.rightCols(free - null.cols());
        }
        if (seen.cols() == 0) return;
        const models::SingularValues svd =
            models::singular_value_decomposition(relative * seen, models::SingularVectors::thin);
        values_ = svd.values;
        directions_ = seen * svd.v;
    }

    [[nodiscard]] const Eigen::VectorXd& values() const { return values_; }

    /// Direction k with its largest component 1, exponents rounded to simple fractions where the data allow it.
    [[nodiscard]] Eigen::VectorXd direction(Eigen::Index k) const {
        Eigen::VectorXd exact = scaled_to_largest(directions_.col(k));
        const double noticed = std::max(values_[k], values_[0] * tiny_component * tiny_component);
        const auto good = [&](const Eigen::VectorXd& candidate) {
            return (sensitivities_ * candidate).norm() <= simplification * noticed * candidate.norm();
        };
        // All at once, the more rounding the better; else one by one, the smallest first: those are most likely noise.
        for (const double tolerance : {0.1, 0.03, 0.01, 0.003, 0.001}) {
            Eigen::VectorXd candidate = exact;
            for (double& component : candidate)
                component = simple_fraction(component, tolerance);
            if (good(candidate)) return candidate;
        }
        std::vector<Eigen::Index> order(static_cast<std::size_t>(exact.size()));
        std::iota(order.begin(), order.end(), Eigen::Index{0});
        std::stable_sort(order.begin(), order.end(),
                         [&](Eigen::Index a, Eigen::Index b) { return std::abs(exact[a]) < std::abs(exact[b]); });
        for (const Eigen::Index i : order) {
            Eigen::VectorXd candidate = exact;
            candidate[i] = simple_fraction(exact[i], 0.1);
            if (good(candidate)) exact = candidate;
        }
        return exact;
    }

    /// sd of components . ln x from the data.
    [[nodiscard]] double sd(const Eigen::VectorXd& components) const {
        return (directions_.transpose() * components).cwiseQuotient(values_).norm();
    }

private:
    const Eigen::MatrixXd& sensitivities_;
    Eigen::VectorXd values_;
    Eigen::MatrixXd directions_;
};

std::vector<SloppyDirection> sloppy_directions(const RelativeData& data, const std::vector<Eigen::Index>& free,
                                               Eigen::Index count) {
    std::vector<SloppyDirection> result;
    const Eigen::VectorXd& values = data.values();
    for (Eigen::Index k = values.size() - 1; k >= 0; --k) {
        // Values are descending: the first is the best determined direction. A value of zero is a null direction.
        if (!(values[k] > 0.0) || !(values[k] * sloppy_sd < 1.0) || !(values[0] > sloppy_gap * values[k])) continue;
        const Eigen::VectorXd components = data.direction(k);
        SloppyDirection sloppy;
        sloppy.sd = data.sd(components);
        sloppy.components = Eigen::VectorXd::Zero(count);
        for (std::size_t i = 0; i < free.size(); ++i)
            sloppy.components[free[i]] = components[static_cast<Eigen::Index>(i)];
        result.push_back(std::move(sloppy));
    }
    return result;
}

std::string exponent(double value) {
    for (const int denominator : denominators) {
        const double numerator = std::round(value * denominator);
        if (!(std::abs(numerator / denominator - value) <= tiny_component) || numerator == 0.0) continue;
        const std::string whole = std::to_string(static_cast<long long>(numerator));
        return denominator == 1 ? whole : "(" + whole + "/" + std::to_string(denominator) + ")";
    }
    char text[32];
    std::snprintf(text, sizeof text, "%.3g", value);
    return text;
}

}  // namespace

Identifiability identifiability(const Eigen::MatrixXd& r, const BoundedStep& step, const Eigen::VectorXd& size,
                                const Eigen::VectorXd& column_size) {
    const Eigen::Index q = r.cols();
    const auto free = static_cast<Eigen::Index>(step.free.size());
    const Subspace& space = step.space;
    Identifiability result;
    result.undetermined.assign(static_cast<std::size_t>(q), false);
    result.data_variance = Eigen::VectorXd::Constant(q, std::numeric_limits<double>::infinity());

    const Eigen::MatrixXd own = r(Eigen::all, step.free);
    const Eigen::VectorXd own_size = column_size(step.free);
    if (free > 0) result.singular_values = models::singular_values(own * own_size.asDiagonal());

    // Relative changes of the parameters along a direction of the free ones.
    const Eigen::VectorXd free_size = size(step.free);
    const Eigen::ArrayXd unit = space.unit.cwiseProduct(free_size).array();
    const auto relative = [&](const Eigen::MatrixXd& directions) {
        Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(directions.cols(), q);
        rows(Eigen::all, step.free) = (directions.array().colwise() / unit).matrix().transpose();
        return rows;
    };
    Eigen::MatrixXd null(free, space.prior.cols() + space.flat.cols());
    null << space.prior, space.flat;
    result.null_directions = sparse_basis(relative(null));
    result.undecided = sparse_basis(relative(space.flat));
    for (const NullDirection& direction : result.undecided)
        for (Eigen::Index i = 0; i < q; ++i)
            if (direction.components[i] != 0.0) result.undetermined[static_cast<std::size_t>(i)] = true;

    const Eigen::Index rank = space.data.cols();
    Eigen::MatrixXd spread = space.data.transpose();
    if (rank > 0) models::solve_transposed_upper_in_place(upper_triangle(space.rows).topRows(rank), spread);
    for (Eigen::Index k = 0; k < free; ++k) {
        const Eigen::Index i = step.free[static_cast<std::size_t>(k)];
        bool in_null = false;
        for (const NullDirection& direction : result.null_directions)
            in_null = in_null || direction.components[i] != 0.0;
        if (in_null) continue;
        result.data_variance[i] = spread.col(k).squaredNorm() / (space.unit[k] * space.unit[k]);
    }

    // The sum of the variances of all directions: below the square of sloppy_sd none of them is sloppy.
    const Eigen::VectorXd own_variance = result.data_variance(step.free);
    if (null.cols() == 0 && own_variance.cwiseQuotient(free_size.cwiseAbs2()).sum() < sloppy_sd * sloppy_sd)
        return result;
    const Eigen::MatrixXd sensitivities = own * free_size.asDiagonal();
    const Eigen::MatrixXd unseen = null.array().colwise() / unit;
    result.sloppy_directions = sloppy_directions(RelativeData(sensitivities, unseen), step.free, q);
    return result;
}

std::string as_product(const Eigen::VectorXd& components, const std::vector<FreeParameter>& parameters) {
    std::string product;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const double component = components[static_cast<Eigen::Index>(i)];
        if (component == 0.0) continue;
        product += (product.empty() ? "" : " ") + parameters[i].name + "^" + exponent(component);
    }
    return product;
}

std::string in_words(const SloppyDirection& direction, const std::vector<FreeParameter>& parameters) {
    char text[96];
    // A factor of more digits than a reader wants is given by its logarithm alone.
    if (direction.sd < 20.0)
        std::snprintf(text, sizeof text, "a factor %.3g (sd of its logarithm %.3g)", std::exp(direction.sd),
                      direction.sd);
    else
        std::snprintf(text, sizeof text, "a factor e^%.3g", direction.sd);
    return "the data know " + as_product(direction.components, parameters) + " only within " + text;
}

std::string in_words(const NullDirection& direction, const std::vector<FreeParameter>& parameters) {
    std::vector<std::string> names;
    std::string changes;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        const double component = direction.components[static_cast<Eigen::Index>(i)];
        if (component == 0.0) continue;
        char text[32];
        std::snprintf(text, sizeof text, " %+.3g", component);
        changes += (names.empty() ? "" : ", ") + parameters[i].name + text;
        names.push_back(parameters[i].name);
    }
    if (names.size() == 1) return names[0] + " has no effect on the data";
    std::string list = names[0];
    for (std::size_t i = 1; i < names.size(); ++i)
        list += (i + 1 == names.size() ? " and " : ", ") + names[i];
    return list + " enter only in a combination: " + changes + " leaves the data unchanged";
}

std::string what_is_told(const Eigen::VectorXd& components, const std::vector<FreeParameter>& parameters,
                         const Eigen::VectorXd& size) {
    // Smaller components change what is told by less than a reader could use.
    constexpr double least_component = 0.01;
    Eigen::Index first = 0;
    if (components.size() == 0 || !(components.cwiseAbs().maxCoeff(&first) > 0.0)) return {};
    const auto parameter = [&](Eigen::Index i) -> const FreeParameter& {
        return parameters[static_cast<std::size_t>(i)];
    };
    const auto takes_part = [&](Eigen::Index i) {
        return std::abs(components[i]) >= least_component * std::abs(components[first]);
    };
    const auto logarithmic = [&](Eigen::Index i) {
        return parameter(i).scale == Scale::log || parameter(i).scale == Scale::log10;
    };
    bool quotients = true;
    for (Eigen::Index i = 0; i < components.size(); ++i)
        if (takes_part(i)) quotients = quotients && logarithmic(i);
    std::vector<std::string> told;
    for (Eigen::Index i = 0; i < components.size(); ++i) {
        if (i == first || !takes_part(i)) continue;
        const double share = components[i] / components[first];
        const std::string power = exponent(quotients ? std::abs(share) : std::abs(share * size[i] / size[first]));
        const std::string& other = parameter(first).name;
        if (quotients)
            told.push_back(parameter(i).name + (share > 0.0 ? " / " : " ") + other + (power == "1" ? "" : "^" + power));
        else
            told.push_back(parameter(i).name + (share > 0.0 ? " - " : " + ") + (power == "1" ? "" : power + " ") +
                           other);
    }
    std::string list;
    for (std::size_t k = 0; k < told.size(); ++k)
        list += (k == 0 ? "" : k + 1 == told.size() ? " and " : ", ") + told[k];
    return list;
}

}  // namespace orbid::estimator
