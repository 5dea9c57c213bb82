#include "estimator/exploration/marginal.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/partitioner.h>

#include "estimator/exploration/conditional_estimate.hpp"
#include "estimator/exploration/finished_count.hpp"
#include "estimator/exploration/log_density_spline.hpp"
#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

/// Up to this many parameters 2 q more evaluations per point are accepted.
constexpr std::size_t affordable = 12;
/// Halvings of a step before a point that cannot be evaluated, or a jump of the density, ends the grid.
constexpr int step_halvings = 5;

void check_marginal(const MarginalOptions& options) {
    const auto positive = [](const std::string& what, double value) {
        if (!(value > 0.0)) throw std::invalid_argument(what + " = " + std::to_string(value) + " must be positive");
    };
    positive("step", options.step);
    positive("fall", options.fall);
    positive("reach", options.reach);
    positive("maximum_points", options.maximum_points);
}

struct MarginalNode {
    double u = 0.0;
    double log_density = 0.0;
    ConditionalStart at;
};

/// The grid of one unknown on one side of the estimate.
struct MarginalSide {
    std::vector<MarginalNode> nodes;
    MarginalEnd end = MarginalEnd::reach;
    int failed = 0;
    int evaluations = 0;
};

struct Grid {
    const Conditional& conditional;
    const Unknown& unknown;
    const EstimateOptions& estimate;
    const MarginalOptions& options;
    bool full_hessian;

    [[nodiscard]] std::optional<MarginalNode> at(double u, const ConditionalStart& from, int& evaluations) const;
    [[nodiscard]] MarginalSide walk(const MarginalNode& centre, int direction) const;
};

std::optional<MarginalNode> Grid::at(double u, const ConditionalStart& from, int& evaluations) const {
    const double prior = conditional.log_prior(unknown, u);
    if (!std::isfinite(prior)) return std::nullopt;
    const auto attempt = [&](const ConditionalStart& start) -> std::optional<MarginalNode> {
        const ConditionalEstimate found = conditional.at(unknown, u, start, estimate.variance, full_hessian);
        evaluations += found.evaluations;
        if (!found.good()) return std::nullopt;
        return MarginalNode{u, (found.log_integral + prior) / (unknown.widening * unknown.widening), found.at};
    };
    if (auto node = attempt(conditional.moved(from, unknown, u))) return node;
    return attempt(conditional.moved(conditional.start(), unknown, u));
}

MarginalSide Grid::walk(const MarginalNode& centre, int direction) const {
    MarginalSide side;
    const double sd = unknown.widening * (unknown.sd > 0.0 ? unknown.sd : 0.1 * unknown.size);
    const double limit = direction < 0 ? unknown.lower : unknown.upper;
    double step = options.step * sd;
    double highest = centre.log_density;
    const MarginalNode* last = &centre;
    int halved = 0;
    side.nodes.reserve(static_cast<std::size_t>(options.maximum_points));
    while (side.nodes.size() < static_cast<std::size_t>(options.maximum_points)) {
        if (estimate.interrupted && estimate.interrupted()) {
            side.end = MarginalEnd::interrupted;
            return side;
        }
        double u = last->u + direction * step;
        // A bound that is hardly further than this step is the next point itself.
        const bool at_limit = std::isfinite(limit) && direction * (limit - u) <= 0.2 * step;
        if (at_limit) u = limit;
        if (!(direction * (u - last->u) > 1e-9 * sd)) {
            side.end = MarginalEnd::bound;
            return side;
        }
        const std::optional<MarginalNode> node = at(u, last->at, side.evaluations);
        if (!node) {
            ++side.failed;
            if (++halved > step_halvings) {
                side.end = MarginalEnd::failed;
                return side;
            }
            step *= 0.5;
            continue;
        }
        const double drop = last->log_density - node->log_density;
        // Too coarse for the spline: the density falls by 8 orders over a step, or is lost at once.
        if (drop > 0.6 * options.fall && halved < step_halvings) {
            ++halved;
            step *= 0.5;
            continue;
        }
        halved = 0;
        side.nodes.push_back(*node);
        last = &side.nodes.back();
        highest = std::max(highest, last->log_density);
        if (highest - last->log_density > options.fall) {
            side.end = MarginalEnd::fallen;
            return side;
        }
        if (at_limit) {
            side.end = MarginalEnd::bound;
            return side;
        }
        const double distance = std::abs(last->u - unknown.u);
        if (distance > options.reach * sd) return side;
        // A normal density falls by 0.1 ... 2 over half a sd; slower is a long tail, faster a steep flank.
        if (std::abs(drop) < 0.3 && distance > 1.2 * sd) step *= 1.5;
        if (std::abs(drop) > 2.5) step *= 0.5;
    }
    return side;
}

void fill(const Conditional& conditional, const Unknown& unknown, Marginal& marginal) {
    std::vector<double> u;
    std::vector<double> values;
    for (const MarginalPoint& point : marginal.points) {
        u.push_back(point.u);
        values.push_back(point.log_density);
    }
    const LogDensitySpline density(u, values);
    for (MarginalPoint& point : marginal.points)
        point.log_density -= density.log_normalisation();
    const auto natural = [&](double x) { return conditional.natural(unknown, x); };
    marginal.mean = density.expectation(natural);
    marginal.sd = std::sqrt(density.expectation([&](double x) {
        const double deviation = natural(x) - marginal.mean;
        return deviation * deviation;
    }));
    marginal.median = natural(density.quantile(0.5));
    marginal.lower95 = natural(density.quantile(0.025));
    marginal.upper95 = natural(density.quantile(0.975));
    marginal.known = true;
}

std::string words(const std::string& side, MarginalEnd end) {
    if (end == MarginalEnd::reach)
        return "the density has not fallen far enough on the " + side +
               " side: probability is left out there, mean and sd may not exist; ";
    if (end == MarginalEnd::failed) return "points further out on the " + side + " side cannot be evaluated; ";
    if (end == MarginalEnd::interrupted) return "interrupted on the " + side + " side; ";
    return "";
}

Marginal marginal_of(const Conditional& conditional, const Unknown& unknown, const EstimateOptions& estimate,
                     const MarginalOptions& options, bool full_hessian) {
    Marginal result;
    result.name = unknown.name;
    result.unit = unknown.unit;
    result.full_hessian = full_hessian;
    result.mean = result.sd = result.median = result.lower95 = result.upper95 = nan_value;
    const Grid grid{conditional, unknown, estimate, options, full_hessian};
    if (!std::isfinite(unknown.u)) {
        result.message = "the estimate is at an end that its scale never reaches";
        return result;
    }
    if (unknown.too_few_independent) {
        result.lower_end = result.upper_end = MarginalEnd::reach;
        result.message = "the residuals hold too few independent values for a density";
        return result;
    }
    if (estimate.interrupted && estimate.interrupted()) {
        result.lower_end = result.upper_end = MarginalEnd::interrupted;
        result.message = "interrupted";
        return result;
    }
    const std::optional<MarginalNode> centre = grid.at(unknown.u, conditional.start(), result.evaluations);
    if (!centre) {
        result.lower_end = result.upper_end = MarginalEnd::failed;
        result.message = "the others do not converge with it held at its estimate";
        return result;
    }
    MarginalSide lower;
    MarginalSide upper;
    tbb::parallel_invoke([&] { lower = grid.walk(*centre, -1); }, [&] { upper = grid.walk(*centre, 1); });
    result.lower_end = lower.end;
    result.upper_end = upper.end;
    result.failed_points = lower.failed + upper.failed;
    result.evaluations += lower.evaluations + upper.evaluations;
    std::vector<MarginalNode> nodes(lower.nodes.rbegin(), lower.nodes.rend());
    nodes.push_back(*centre);
    nodes.insert(nodes.end(), upper.nodes.begin(), upper.nodes.end());
    for (const MarginalNode& node : nodes)
        result.points.push_back(
            {node.u, conditional.natural(unknown, node.u), node.log_density, conditional.expand(node.at.theta)});
    result.message = words("lower", lower.end) + words("upper", upper.end);
    if (nodes.size() < 4) {
        result.message += "too few points can be evaluated";
        return result;
    }
    fill(conditional, unknown, result);
    if (result.message.size() > 2) result.message.resize(result.message.size() - 2);
    return result;
}

}  // namespace

std::string_view name(MarginalEnd end) {
    constexpr std::array names{"fallen", "bound", "reach", "failed", "interrupted"};
    return names[static_cast<std::size_t>(end)];
}

std::vector<Marginal> marginals(const std::vector<FreeParameter>& parameters,
                                const std::vector<const Residual*>& residuals, const EstimateOptions& options,
                                const Estimate& estimate, const MarginalOptions& marginal) {
    check_marginal(marginal);
    const Conditional conditional(parameters, residuals, options, estimate);
    const std::vector<Unknown> which = conditional.named(marginal.names);
    const bool full_hessian = marginal.full_hessian.value_or(conditional.parameters().size() <= affordable);
    std::vector<Marginal> result(which.size());
    FinishedCount finished(marginal.progress, which.size());
    tbb::parallel_for(
        std::size_t{0}, which.size(),
        [&](std::size_t k) {
            result[k] = marginal_of(conditional, which[k], options, marginal, full_hessian);
            finished.add();
        },
        tbb::simple_partitioner{});
    return result;
}

}  // namespace orbid::estimator
