#include "estimator/estimate/estimate_report.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "estimator/estimate/reported_direction.hpp"
#include "estimator/estimate/reported_interval.hpp"
#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

namespace {

void fill_parameters(const Problem& problem, const State& state, const Minimum& minimum, const Posterior& posterior,
                     Estimate& estimate) {
    const Eigen::Index q = state.theta.size();
    Eigen::VectorXd slope(q);
    std::vector<bool> known(static_cast<std::size_t>(q), false);
    const bool without_priors =
        std::all_of(problem.parameters.begin(), problem.parameters.end(),
                    [](const FreeParameter& parameter) { return std::holds_alternative<FlatPrior>(parameter.prior); });
    for (Eigen::Index i = 0; i < q; ++i) {
        const auto index = static_cast<std::size_t>(i);
        const Coordinate& coordinate = problem.coordinates[index];
        slope[i] = coordinate.slope(state.theta[i]);
        Estimated result = bare_estimate(problem.parameters[index], state.theta[i]);
        const int side = minimum.step.active[index];
        if (side != 0) result.at_bound = side < 0 ? BoundSide::lower : BoundSide::upper;
        const Uncertainty uncertainty = posterior.along(Eigen::VectorXd::Unit(q, i));
        result.interval_degrees_of_freedom = uncertainty.degrees_of_freedom;
        result.sd = uncertainty.sd * slope[i];
        result.laplace_sd = uncertainty.laplace_sd * slope[i];
        fill_interval(problem, state, minimum, posterior, i, result);
        known[index] = std::isfinite(result.sd);
        if (side == 0) {
            const double data = posterior.identifiable().data_variance[i];
            // Without priors the two variances are the same up to the rounding of two factorisations.
            const double share = without_priors ? 1.0 : std::clamp(posterior.laplace()(i, i) / data, 0.0, 1.0);
            result.data_share = std::isfinite(data) ? share : 0.0;
        }
        estimate.parameters.push_back(std::move(result));
    }
    estimate.covariance = slope.asDiagonal() * posterior.covariance() * slope.asDiagonal();
    estimate.laplace_covariance = slope.asDiagonal() * posterior.laplace() * slope.asDiagonal();
    estimate.correlation.resize(q, q);
    for (Eigen::Index i = 0; i < q; ++i)
        for (Eigen::Index j = 0; j < q; ++j) {
            const bool both = known[static_cast<std::size_t>(i)] && known[static_cast<std::size_t>(j)];
            if (!both) estimate.covariance(i, j) = estimate.laplace_covariance(i, j) = nan_value;
            const Eigen::MatrixXd& c = posterior.covariance();
            estimate.correlation(i, j) = !both ? nan_value : i == j ? 1.0 : c(i, j) / std::sqrt(c(i, i) * c(j, j));
        }
}

void fill_derived(const Problem& problem, const State& state, const Posterior& posterior,
                  const std::vector<DerivedQuantity>& derived, Estimate& estimate) {
    Eigen::VectorXd start(state.theta.size());
    const Eigen::VectorXd slope = slopes(problem, state.theta);
    for (std::size_t i = 0; i < problem.parameters.size(); ++i)
        start[static_cast<Eigen::Index>(i)] = problem.parameters[i].start;
    for (const DerivedQuantity& quantity : derived) {
        Estimated result;
        result.name = quantity.name;
        result.value = quantity.value(state.theta);
        result.start = quantity.value(start);
        const Eigen::VectorXd gradient = quantity.gradient(state.theta).cwiseProduct(slope);
        const Uncertainty uncertainty = posterior.along(gradient);
        result.sd = uncertainty.sd;
        result.laplace_sd = uncertainty.laplace_sd;
        result.interval_degrees_of_freedom = uncertainty.degrees_of_freedom;
        fill_interval(problem, state, posterior, quantity, gradient, result);
        estimate.derived.push_back(std::move(result));
    }
}

/// Distribution, uncertainty and further error parameters of a channel.
void fill_law(const Problem& problem, const State& state, const Posterior& posterior, int channel,
              EstimatedScale& scale) {
    constexpr std::array names{"normal", "student_t", "laplace", "lognormal", "relative", "ar1"};
    for (const NoiseModel& law : problem.laws) {
        const auto place = std::find(law.channels.begin(), law.channels.end(), channel);
        if (place == law.channels.end()) continue;
        scale.distribution = law.joint() ? "joint normal" : names[law.distribution.index()];
        if (law.joint()) {
            const Eigen::MatrixXd slopes = covariance_slopes(law, state.psi);
            const auto m = static_cast<Eigen::Index>(law.channels.size());
            const auto own = static_cast<Eigen::Index>(place - law.channels.begin());
            const Eigen::RowVectorXd slope = slopes.row(own * m + own);
            const double variance = slope.dot(
                posterior.error_covariance().block(law.first, law.first, law.size(), law.size()) * slope.transpose());
            scale.uncertainty = std::sqrt(variance) / (2.0 * scale.value);
            fill_interval(scale);
            return;
        }
        const double sd = std::sqrt(posterior.error_covariance()(law.first, law.first));
        scale.uncertainty = scale.value * sd;
        // The scale of heavy tails, of a part of the variance or of a correlated series is not a sum of squares.
        if (law.compressible()) {
            fill_interval(scale);
        } else if (sd > 0.0) {
            scale.lower95 = scale.value * std::exp(-normal_975 * sd);
            scale.upper95 = scale.value * std::exp(normal_975 * sd);
            scale.interval_method = IntervalMethod::normal;
        }
        for (std::size_t j = 1; j < law.coordinates.size(); ++j) {
            const ErrorCoordinate& coordinate = law.coordinates[j];
            const Eigen::Index k = law.first + static_cast<Eigen::Index>(j);
            const double own_sd = std::sqrt(posterior.error_covariance()(k, k));
            Estimated shape;
            shape.name = coordinate.name;
            shape.value = coordinate.natural(state.psi[k]);
            shape.start = coordinate.start;
            shape.sd = shape.laplace_sd = own_sd * coordinate.slope(state.psi[k]);
            shape.interval_method = !coordinate.estimate ? IntervalMethod::fixed
                                    : own_sd > 0.0       ? IntervalMethod::normal
                                                         : IntervalMethod::none;
            shape.lower95 = coordinate.natural(state.psi[k] - normal_975 * own_sd);
            shape.upper95 = coordinate.natural(state.psi[k] + normal_975 * own_sd);
            if (coordinate.kind == ErrorCoordinate::Kind::fisher && shape.interval_method == IntervalMethod::normal) {
                const auto [lower, upper] = posterior.error_interval(k);
                if (std::isfinite(lower) && std::isfinite(upper)) {
                    shape.interval_method = IntervalMethod::likelihood;
                    shape.lower95 = coordinate.natural(lower);
                    shape.upper95 = coordinate.natural(upper);
                }
            }
            if (problem.options.error_uncertainties && coordinate.estimate && !(own_sd > 0.0))
                shape.at_bound =
                    state.psi[k] <= 0.5 * (coordinate.lower + coordinate.upper) ? BoundSide::lower : BoundSide::upper;
            scale.shape.push_back(std::move(shape));
        }
        return;
    }
}

void fill_covariances(const Problem& problem, const State& state, const Posterior& posterior, Estimate& estimate) {
    for (const NoiseModel& law : problem.laws) {
        if (!law.joint()) continue;
        const auto m = static_cast<Eigen::Index>(law.channels.size());
        EstimatedCovariance covariance;
        for (const int c : law.channels)
            covariance.groups.push_back(group_of(problem, c).name);
        const Eigen::MatrixXd lower = covariance_root(law, state.psi);
        covariance.value = lower * lower.transpose();
        const Eigen::MatrixXd slopes = covariance_slopes(law, state.psi);
        const Eigen::VectorXd variance =
            (slopes * posterior.error_covariance().block(law.first, law.first, law.size(), law.size()))
                .cwiseProduct(slopes)
                .rowwise()
                .sum();
        covariance.uncertainty = variance.cwiseSqrt().reshaped(m, m);
        estimate.covariances.push_back(std::move(covariance));
    }
}

void fill_scales(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
                 const Posterior& posterior, Estimate& estimate) {
    const Eigen::VectorXd scales = scales_of(problem.laws, state.psi);
    for (std::size_t c = 0; c < problem.channels.size(); ++c) {
        const Group& group = group_of(problem, static_cast<int>(c));
        EstimatedScale scale;
        scale.group = group.name;
        scale.unit = group.unit;
        scale.factor = group.factor;
        scale.estimated = group.scale.estimate;
        scale.value = scales[static_cast<Eigen::Index>(c)];
        fill_law(problem, state, posterior, static_cast<int>(c), scale);
        double square = 0.0;
        for (std::size_t b = 0; b < set.blocks.size(); ++b)
            for (std::size_t i = 0; i < set.blocks[b].channel().size(); ++i)
                if (set.blocks[b].channel()[i] == static_cast<int>(c)) {
                    const double e = minimum.errors.e(b)[static_cast<Eigen::Index>(i)];
                    square += e * e;
                    ++scale.count;
                }
        square = set.spread.sum(square);
        scale.count = static_cast<decltype(scale.count)>(set.spread.sum(static_cast<double>(scale.count)));
        if (scale.count == 0) scale.estimated = false;
        scale.rms = scale.count > 0 ? std::sqrt(square / static_cast<double>(scale.count)) : 0.0;
        const Autocorrelation& correlation = posterior.autocorrelations()[c];
        scale.lag1 = group.ordered && set.spread.alone() ? correlation.lag1 : nan_value;
        scale.correlation_records = correlation.records;
        scale.effective_count = static_cast<double>(scale.count) / correlation.records;
        estimate.effective_count += scale.effective_count;
        estimate.scales.push_back(std::move(scale));
    }
}

/// Latent states, and places for what blocks that take no part do not have.
void fill_latents(const Problem& problem, const State& state, Estimate& estimate) {
    estimate.latents = state.latents;
    for (std::size_t r = 0; r < problem.residuals.size(); ++r) {
        BlockValue none;
        none.status = BlockStatus::failed;
        estimate.residuals.emplace_back(state.latents[r].size(), none);
        estimate.latent_sds.emplace_back();
        for (const Eigen::VectorXd& z : state.latents[r])
            estimate.latent_sds.back().push_back(Eigen::VectorXd::Constant(z.size(), nan_value));
    }
}

void fill_blocks(const BlockSet& set, const Minimum& minimum, const Posterior& posterior, Estimate& estimate) {
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        const ActiveBlock& block = set.blocks[b];
        estimate.residuals[block.residual][block.block] = {};
        estimate.residuals[block.residual][block.block].e = minimum.errors.e(b);
        estimate.latent_sds[block.residual][block.block] = posterior.latent_sds()[b];
        ++estimate.counts[block.residual].used;
    }
}

void describe(const Problem& problem, const State& state, const Minimum& minimum, const Posterior& posterior,
              Estimate& estimate) {
    const Identifiability& identifiable = posterior.identifiable();
    estimate.singular_values = identifiable.singular_values;
    estimate.null_directions = identifiable.null_directions;
    estimate.sloppy_directions = identifiable.sloppy_directions;
    const Eigen::VectorXd size = sizes(problem, state.theta).cwiseProduct(slopes(problem, state.theta));
    for (NullDirection& direction : estimate.null_directions)
        direction.told = told_of(problem, state, size, direction.components);
    for (SloppyDirection& direction : estimate.sloppy_directions)
        direction.told = told_of(problem, state, size, direction.components);
    std::string words;
    for (const NullDirection& direction : identifiable.null_directions)
        words += (words.empty() ? "" : "; ") + in_words(direction, problem.parameters);
    if (!identifiable.undecided.empty()) {
        if (estimate.status == EstimateStatus::converged) estimate.status = EstimateStatus::singular;
        estimate.message = words + "; " + estimate.message;
    } else if (!words.empty()) {
        estimate.message += "; " + words + ": there the prior alone decides";
    }
    for (const SloppyDirection& direction : identifiable.sloppy_directions)
        estimate.message += "; " + in_words(direction, problem.parameters);
    for (std::size_t i = 0; i < minimum.step.active.size(); ++i)
        if (minimum.step.active[i] != 0)
            estimate.message += "; " + problem.parameters[i].name + " is at its " +
                                (minimum.step.active[i] < 0 ? "lower" : "upper") + " bound";
    for (const NoiseModel& law : problem.laws)
        for (std::size_t j = 0; j < law.coordinates.size(); ++j) {
            const std::size_t k = static_cast<std::size_t>(law.first) + j;
            const std::string& group = estimate.scales[static_cast<std::size_t>(law.channels.front())].group;
            if (minimum.error_at_floor[k] && j == 0)
                estimate.message += "; the residuals of " + group +
                                    " are at rounding level or below their floor, their scale is held at its floor";
            else if (minimum.error_at_floor[k])
                estimate.message += "; the " + law.coordinates[j].name + " of " + group + " is at its lower limit";
            if (minimum.error_at_ceiling[k])
                estimate.message += "; the " + law.coordinates[j].name + " of " + group + " is at its upper limit";
        }
    for (const Eigen::Index k : posterior.negligible_errors()) {
        const auto law = std::find_if(problem.laws.begin(), problem.laws.end(),
                                      [k](const NoiseModel& candidate) { return candidate.has(k); });
        const std::string& what = law->coordinates[static_cast<std::size_t>(k - law->first)].name;
        estimate.message += "; the " + what + " of " +
                            estimate.scales[static_cast<std::size_t>(law->channels.front())].group +
                            " cannot be told from " + (what == "dof" ? "infinity" : "zero");
    }
    for (std::size_t c = 0; c < problem.channels.size(); ++c) {
        const Group& group = group_of(problem, static_cast<int>(c));
        if (group.scale.estimate && estimate.scales[c].count == 0)
            estimate.message += "; " + group.name + " has no records: its errors are not estimated";
    }
    if (!posterior.sandwich_note().empty()) estimate.message += "; " + posterior.sandwich_note();
}

}  // namespace

Estimated bare_estimate(const FreeParameter& parameter, double value) {
    Estimated result;
    result.name = parameter.name;
    result.unit = parameter.unit;
    result.value = value;
    result.start = parameter.start;
    result.sd = result.lower95 = result.upper95 = result.laplace_sd = nan_value;
    return result;
}

void report(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
            const Posterior& posterior, const std::vector<DerivedQuantity>& derived, Estimate& estimate) {
    fill_parameters(problem, state, minimum, posterior, estimate);
    fill_derived(problem, state, posterior, derived, estimate);
    fill_scales(problem, set, state, minimum, posterior, estimate);
    fill_covariances(problem, state, posterior, estimate);
    describe(problem, state, minimum, posterior, estimate);
}

void report_blocks(const Problem& problem, const BlockSet& set, const State& state, const Minimum& minimum,
                   const Posterior& posterior, Estimate& estimate) {
    fill_latents(problem, state, estimate);
    fill_blocks(set, minimum, posterior, estimate);
}

void report_failure(const Problem& problem, const State& state, Estimate& estimate) {
    for (std::size_t i = 0; i < problem.parameters.size(); ++i)
        estimate.parameters.push_back(bare_estimate(problem.parameters[i], state.theta[static_cast<Eigen::Index>(i)]));
    fill_latents(problem, state, estimate);
}

}  // namespace orbid::estimator
