#include "estimator/exploration/marginal.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/partitioner.h>

#include "estimator/exploration/conditional_estimate.hpp"
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
    Eigen::MatrixXd covariance;
    double degrees_of_freedom = 0.0;
};

/// The grid of one unknown on one side of the estimate.
struct MarginalSide {
    std::vector<MarginalNode> nodes;
    MarginalEnd end = MarginalEnd::reach;
    int failed = 0;
    int evaluations = 0;
};

class Grid {
public:
    Grid(const Conditional& conditional, const Unknown& unknown, const EstimateOptions& estimate,
         const MarginalOptions& options, bool full_hessian)
        : conditional_(conditional),
          unknown_(unknown),
          estimate_(estimate),
          options_(options),
          full_hessian_(full_hessian) {}

    [[nodiscard]] std::optional<MarginalNode> at(double u, const ConditionalStart& from, int& evaluations) const;
    [[nodiscard]] MarginalSide walk(const MarginalNode& centre, int direction) const;

private:
    const Conditional& conditional_;
    const Unknown& unknown_;
    const EstimateOptions& estimate_;
    const MarginalOptions& options_;
    bool full_hessian_;
};

std::optional<MarginalNode> Grid::at(double u, const ConditionalStart& from, int& evaluations) const {
    const double prior = conditional_.log_prior(unknown_, u);
    if (!std::isfinite(prior)) return std::nullopt;
    const auto attempt = [&](const ConditionalStart& start) -> std::optional<MarginalNode> {
        const ConditionalEstimate found = conditional_.at(unknown_, u, start, estimate_.variance, full_hessian_);
        evaluations += found.evaluations;
        if (!found.good()) return std::nullopt;
        return MarginalNode{u, found.log_integral + prior, found.at, found.covariance, found.degrees_of_freedom};
    };
    if (auto node = attempt(conditional_.moved(from, unknown_, u))) return node;
    return attempt(conditional_.moved(conditional_.start(), unknown_, u));
}

MarginalSide Grid::walk(const MarginalNode& centre, int direction) const {
    MarginalSide side;
    const double sd = unknown_.sd > 0.0 ? unknown_.sd : 0.1 * unknown_.size;
    const double limit = direction < 0 ? unknown_.lower : unknown_.upper;
    double step = options_.step * sd;
    double highest = centre.log_density;
    const MarginalNode* last = &centre;
    int halved = 0;
    side.nodes.reserve(static_cast<std::size_t>(options_.maximum_points));
    while (side.nodes.size() < static_cast<std::size_t>(options_.maximum_points)) {
        if (estimate_.interrupted && estimate_.interrupted()) {
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
        if (drop > 0.6 * options_.fall && halved < step_halvings) {
            ++halved;
            step *= 0.5;
            continue;
        }
        halved = 0;
        side.nodes.push_back(*node);
        last = &side.nodes.back();
        highest = std::max(highest, last->log_density);
        if (highest - last->log_density > options_.fall) {
            side.end = MarginalEnd::fallen;
            return side;
        }
        if (at_limit) {
            side.end = MarginalEnd::bound;
            return side;
        }
        const double distance = std::abs(last->u - unknown_.u);
        if (distance > options_.reach * sd) return side;
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
    switch (end) {
        case MarginalEnd::fallen:
        case MarginalEnd::bound:
            return "";
        case MarginalEnd::reach:
            return "the density has not fallen far enough on the " + side +
                   " side: probability is left out there, mean and sd may not exist; ";
        case MarginalEnd::failed:
            return "points further out on the " + side + " side cannot be evaluated; ";
        case MarginalEnd::interrupted:
            return "interrupted on the " + side + " side; ";
    }
    return "";
}

Marginal marginal_of(const Conditional& conditional, const Unknown& unknown, const EstimateOptions& estimate,
                     const MarginalOptions& options, bool full_hessian) {
    Marginal result;
    result.name = unknown.name;
    result.unit = unknown.unit;
    result.full_hessian = full_hessian;
    result.mean = result.sd = result.median = result.lower95 = result.upper95 = nan_value;
    const Grid grid(conditional, unknown, estimate, options, full_hessian);
    if (!std::isfinite(unknown.u)) {
        result.message = "the estimate is at an end that its scale never reaches";
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
        result.points.push_back({node.u, conditional.natural(unknown, node.u), node.log_density,
                                 conditional.expand(node.at.theta), conditional.expand_covariance(node.covariance),
                                 node.degrees_of_freedom});
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
    switch (end) {
        case MarginalEnd::fallen:
            return "fallen";
        case MarginalEnd::bound:
            return "bound";
        case MarginalEnd::reach:
            return "reach";
        case MarginalEnd::failed:
            return "failed";
        case MarginalEnd::interrupted:
            return "interrupted";
    }
    return "failed";
}

std::vector<Marginal> marginals(const std::vector<FreeParameter>& parameters, const std::vector<Residual*>& residuals,
                                const EstimateOptions& options, const Estimate& estimate,
                                const MarginalOptions& marginal) {
    check_marginal(marginal);
    const Conditional conditional(parameters, residuals, options, estimate);
    std::vector<std::size_t> which;
    for (const std::string& wanted : marginal.names)
        which.push_back(conditional.index(wanted));
    if (marginal.names.empty())
        for (std::size_t k = 0; k < conditional.unknowns().size(); ++k)
            which.push_back(k);
    const bool full_hessian = marginal.full_hessian.value_or(conditional.parameters().size() <= affordable);
    std::vector<Marginal> result(which.size());
    tbb::parallel_for(
        std::size_t{0}, which.size(),
        [&](std::size_t k) {
            result[k] = marginal_of(conditional, conditional.unknowns()[which[k]], options, marginal, full_hessian);
        },
        tbb::simple_partitioner{});
    return result;
}

}  // namespace orbid::estimator
