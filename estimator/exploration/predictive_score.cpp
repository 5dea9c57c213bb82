#include "estimator/exploration/predictive_score.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <stdexcept>

#include <tbb/parallel_for.h>
#include <tbb/partitioner.h>

#include "estimator/interface/mapped_residual.hpp"
#include "estimator/interface/not_finite.hpp"
#include "models/definition/wrong_data.hpp"

namespace orbid::estimator {

namespace {

struct Place {
    std::size_t residual;
    std::size_t block;
};

/// Active blocks, those that constraints link in one set.
std::vector<std::vector<Place>> linked_blocks(const std::vector<ActiveSet>& active) {
    std::vector<std::vector<Place>> sets;
    for (std::size_t r = 0; r < active.size(); ++r) {
        const std::vector<BlockLayout>& layout = active[r].layout;
        std::vector<std::size_t> root(layout.size());
        std::iota(root.begin(), root.end(), std::size_t{0});
        const auto find = [&](std::size_t b) {
            while (root[b] != b)
                b = root[b];
            return b;
        };
        for (std::size_t b = 0; b < layout.size(); ++b) {
            if (!layout[b].active || layout[b].next < 0) continue;
            const std::size_t one = find(b);
            const std::size_t other = find(static_cast<std::size_t>(layout[b].next));
            root[std::max(one, other)] = std::min(one, other);
        }
        std::map<std::size_t, std::vector<Place>> here;
        for (std::size_t b = 0; b < layout.size(); ++b)
            if (layout[b].active) here[find(b)].push_back({r, b});
        for (auto& [first, places] : here)
            sets.push_back(std::move(places));
    }
    return sets;
}

/// What an estimate without some blocks needs.
struct Folds {
    std::vector<FreeParameter> parameters;
    const std::vector<const Residual*>& residuals;
    EstimateOptions options;
    const Estimate& estimate;

    /// The estimate without some blocks.
    [[nodiscard]] Estimate without(const std::vector<Place>& left_out) const;
};

Folds folds_of(const std::vector<FreeParameter>& parameters, const std::vector<const Residual*>& residuals,
               const EstimateOptions& options, const Estimate& estimate) {
    Folds result{parameters, residuals, options, estimate};
    result.options.verdict = false;
    result.options.maximum_rounds = 1;
    result.options.progress = nullptr;
    result.options.watched = nullptr;
    for (FreeParameter& parameter : result.parameters)
        for (const Estimated& found : estimate.parameters)
            if (found.name == parameter.name && parameter.tied_to.empty()) parameter.start = found.value;
    return result;
}

Estimate Folds::without(const std::vector<Place>& left_out) const {
    const auto count = static_cast<Eigen::Index>(parameters.size());
    std::vector<std::unique_ptr<MappedResidual>> adapters;
    std::vector<const Residual*> adapted;
    std::size_t channel = 0;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
        MappedResidualOptions change{{}, estimate.latents[r], estimate.active[r]};
        for (const Place& place : left_out)
            if (place.residual == r) change.active->layout.edit()[place.block].active = false;
        const std::vector<Group>& groups = change.active->groups;
        std::vector<bool> shared(groups.size(), false);
        for (const JointCovariance& covariance : residuals[r]->covariances())
            for (const int group : covariance.groups)
                shared[static_cast<std::size_t>(group)] = true;
        for (std::size_t g = 0; g < groups.size(); ++g, ++channel) {
            const EstimatedScale& scale = estimate.scales[channel];
            // Error parameters start where they were found.
            if (!shared[g] && scale.estimated) change.errors.push_back({groups[g].name, "scale", scale.value, true});
        }
        adapters.push_back(
            std::make_unique<MappedResidual>(*residuals[r], ParameterMap::identity(count), std::move(change)));
        adapted.push_back(adapters.back().get());
    }
    return estimator::estimate(parameters, adapted, {}, options);
}

/// Why an estimate of a part cannot be compared with the one of all; empty when it can.
std::string obstacle(const Estimate& all, const Estimate& part) {
    if (part.status != EstimateStatus::converged && part.status != EstimateStatus::singular)
        return "the rest alone: " + std::string(name(part.status)) + ", " + part.message;
    for (std::size_t i = 0; i < all.parameters.size(); ++i) {
        const bool determined = std::isfinite(all.parameters[i].laplace_sd);
        if (determined != std::isfinite(part.parameters[i].laplace_sd))
            return "without it " + part.parameters[i].name + " is " +
                   (part.parameters[i].at_bound == BoundSide::none ? "not determined" : "at its bound");
    }
    for (std::size_t c = 0; c < all.scales.size(); ++c)
        if (all.scales[c].estimated && all.scales[c].count > 0 && part.scales[c].count == 0)
            return "without it " + all.scales[c].group + " has no data for its error scale";
    return "";
}

}  // namespace

PredictiveScore predictive_score(const std::vector<FreeParameter>& parameters,
                                 const std::vector<const Residual*>& residuals, const EstimateOptions& options,
                                 const Estimate& estimate, int folds) {
    if (folds < 2) throw std::invalid_argument("folds = " + std::to_string(folds) + " must be 2 or more");
    if (estimate.status == EstimateStatus::failed)
        throw models::DataError("a predictive score needs an estimate that did not fail: " + estimate.message);
    if (estimate.parameters.size() != parameters.size() || estimate.active.size() != residuals.size())
        throw std::invalid_argument("a predictive score needs the estimate of the same parameters and residuals");
    const std::vector<std::vector<Place>> sets = linked_blocks(estimate.active);
    if (sets.size() < 2)
        throw models::DataError("a predictive score needs two or more blocks that are not linked to each other, " +
                                std::to_string(sets.size()) + " found");
    const std::size_t count = std::min(sets.size(), static_cast<std::size_t>(folds));
    std::vector<std::vector<Place>> left_out(count);
    for (std::size_t s = 0; s < sets.size(); ++s)
        left_out[s % count].insert(left_out[s % count].end(), sets[s].begin(), sets[s].end());

    PredictiveScore score;
    const Folds work = folds_of(parameters, residuals, options, estimate);
    // All data from the same frozen sets and starts, so that both integrals are of the same kind.
    const Estimate all = work.without({});
    score.folds.resize(count);
    tbb::parallel_for(
        std::size_t{0}, count,
        [&](std::size_t k) {
            HeldOut& fold = score.folds[k];
            fold.log_density = nan_value;
            for (const Place& place : left_out[k]) {
                const BlockLayout& block = estimate.active[place.residual].layout[place.block];
                fold.labels.push_back(block.label);
                fold.records += block.group.size();
            }
            const Estimate part = work.without(left_out[k]);
            fold.message = obstacle(all, part);
            if (part.status == EstimateStatus::interrupted) return;
            fold.known = fold.message.empty() && std::isfinite(part.log_integral);
            if (fold.known) fold.log_density = all.log_integral - part.log_integral;
        },
        tbb::simple_partitioner{});

    score.interrupted = options.interrupted && options.interrupted();
    double square = 0.0;
    double known = 0.0;
    for (const HeldOut& fold : score.folds) {
        if (!fold.known) {
            if (score.message.empty()) score.message = fold.labels.front() + ": " + fold.message;
            continue;
        }
        score.log_density += fold.log_density;
        square += fold.log_density * fold.log_density;
        known += 1.0;
    }
    score.known = known == static_cast<double>(count);
    // Variance of a sum of `known` terms, from their scatter.
    const double scatter = square - score.log_density * score.log_density / known;
    score.standard_error = known > 1.0 ? std::sqrt(std::max(scatter, 0.0) * known / (known - 1.0)) : nan_value;
    return score;
}

}  // namespace orbid::estimator
