#pragma once

#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "apps/results/checkpoint_archive.hpp"
#include "apps/results/posterior_results.hpp"
#include "apps/results/strategy_results.hpp"
#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/bootstrap.hpp"
#include "estimator/exploration/multi_start.hpp"
#include "identification/stages/stage_value.hpp"
#include "orbits/cycles/cycle.hpp"

/// What checkpoints hold. The archive fields of every struct are all members. Structured bindings name them, so that a
/// new member does not compile until it is added here. Then increase `format` in checkpoint.cpp.

namespace orbid::estimator {

inline void fields(apps::Archive& archive, BlockValue& value) {
    auto& [status, e, e_theta, e_z, e_next, c, c_theta, c_z, c_next] = value;
    archive(status, e, e_theta, e_z, e_next, c, c_theta, c_z, c_next);
}

/// Stores the name of an enumerator. @param last  the last one of its enumeration.
template <class Enumerator>
void transfer_name(apps::Archive& archive, Enumerator& value, Enumerator last) {
    std::string text(name(value));
    archive(text);
    if (!archive.reading()) return;
    for (int i = 0; i <= static_cast<int>(last); ++i) {
        value = static_cast<Enumerator>(i);
        if (name(value) == text) return;
    }
    throw apps::DamagedCheckpoint("a checkpoint holds an unknown word");
}

inline void fields(apps::Archive& archive, Estimated& value) {
    auto& [name, unit, at, start, sd, lower95, upper95, method, bound, laplace_sd, share, degrees_of_freedom, limit,
           bias] = value;
    archive(name, unit, at, start, sd, lower95, upper95);
    transfer_name(archive, method, IntervalMethod::likelihood);
    transfer_name(archive, bound, BoundSide::upper);
    archive(laplace_sd, share, degrees_of_freedom);
    transfer_name(archive, limit, BoundSide::upper);
    archive(bias);
}

inline void fields(apps::Archive& archive, JointNormalPrior& value) {
    auto& [names, mean, covariance] = value;
    archive(names, mean, covariance);
}

inline void fields(apps::Archive& archive, EstimatedScale& value) {
    auto& [group, unit, factor, estimated, at, uncertainty, lower95, upper95, method, count, rms, lag1, records,
           effective, distribution, shape] = value;
    archive(group, unit, factor, estimated, at, uncertainty, lower95, upper95);
    transfer_name(archive, method, IntervalMethod::likelihood);
    archive(count, rms, lag1, records, effective, distribution, shape);
}

inline void fields(apps::Archive& archive, EstimatedCovariance& value) {
    auto& [groups, at, uncertainty] = value;
    archive(groups, at, uncertainty);
}

inline void fields(apps::Archive& archive, ResidualCount& value) {
    auto& [type, used, lost, rejected, added, unused] = value;
    archive(type, used, lost, rejected, added, unused);
}

inline void fields(apps::Archive& archive, StepRecord& value) {
    auto& [round, block, accepted, before, after, damping, reason, provisional] = value;
    archive(round, accepted, before, after, damping, provisional);
    transfer_name(archive, block, StepBlock::scales);
    transfer_name(archive, reason, StepRejection::block_failed);
}

inline void fields(apps::Archive& archive, NullDirection& value) {
    auto& [components, told] = value;
    archive(components, told);
}

inline void fields(apps::Archive& archive, SloppyDirection& value) {
    auto& [components, sd, told] = value;
    archive(components, sd, told);
}

/// One of the densities that a Prior may be: one to three numbers, or none.
template <class Density>
requires std::is_constructible_v<Prior, Density&> &&
    (!std::is_same_v<Density, Prior>)void fields(apps::Archive& archive, Density& value) {
    if constexpr (std::is_empty_v<Density>) {
        return;
    } else if constexpr (sizeof(Density) == sizeof(double)) {
        auto& [a] = value;
        archive(a);
    } else if constexpr (sizeof(Density) == 2 * sizeof(double)) {
        auto& [a, b] = value;
        archive(a, b);
    } else {
        auto& [a, b, c] = value;
        archive(a, b, c);
    }
}

/// The scale or another parameter of an error distribution.
template <class Told>
requires std::is_same_v<Told, ErrorScale> || std::is_same_v<Told, ErrorParameter>
void fields(apps::Archive& archive, Told& value) {
    auto& [estimate, at, prior] = value;
    archive(estimate, at, prior);
}

/// One of the distributions that errors may have, with the one parameter that some have.
template <class Distribution>
requires std::is_constructible_v<ErrorDistribution, Distribution&> &&
    (!std::is_same_v<Distribution, ErrorDistribution>)void fields(apps::Archive& archive, Distribution& value) {
    if constexpr (!std::is_empty_v<Distribution>) {
        auto& [parameter] = value;
        archive(parameter);
    }
}

inline void fields(apps::Archive& archive, Group& value) {
    auto& [name, unit, scale, distribution, floor, factor, slack, ordered, interval, interval_unit] = value;
    archive(name, unit, scale, distribution, floor, factor, slack, ordered, interval, interval_unit);
}

inline void fields(apps::Archive& archive, BlockLayout& value) {
    auto& [label, group, shape, deviation, observed, latents, constraints, linked_from, next, size, active] = value;
    archive(label, group, shape, deviation, observed, latents, constraints, linked_from, next, size, active);
}

inline void fields(apps::Archive& archive, BlockLayouts& value) {
    std::vector<BlockLayout> blocks = value;
    archive(blocks);
    if (archive.reading()) value = std::move(blocks);
}

inline void fields(apps::Archive& archive, ActiveSet& value) {
    auto& [groups, layout, latents, is_intermediate_stage, memory] = value;
    archive(groups, layout, latents, is_intermediate_stage, memory);
}

inline void fields(apps::Archive& archive, Estimate& value) {
    auto& [status, message, parameters, derived, scales, covariances, latents, latent_sds, residuals, covariance,
           laplace_covariance, correlation, singular_values, null_directions, sloppy_directions, trust_normal, distrust,
           hessian_ratio, effective_count, counts, objective, log_likelihood, log_integral, degrees_of_freedom,
           iterations, evaluations, rounds, remaining, history, active, tilt, bias_left] = value;
    archive(status, message, parameters, derived, scales, covariances, latents, latent_sds, residuals, covariance,
            laplace_covariance, correlation, singular_values, null_directions, sloppy_directions, trust_normal,
            distrust, hessian_ratio, effective_count, counts, objective, log_likelihood, log_integral,
            degrees_of_freedom, iterations, evaluations, rounds, remaining, history, active, tilt, bias_left);
}

inline void fields(apps::Archive& archive, StartedRun& value) {
    auto& [start, from, theta, status, message, objective, records, evaluations, optimum, screened] = value;
    archive(start, from, theta, status, message, objective, records, evaluations, optimum, screened);
}

inline void fields(apps::Archive& archive, Optimum& value) {
    auto& [objective, theta, starts] = value;
    archive(objective, theta, starts);
}

inline void fields(apps::Archive& archive, ProfilePoint& value) {
    auto& [u, at, objective, signed_root, theta] = value;
    archive(u, at, objective, signed_root, theta);
}

inline void fields(apps::Archive& archive, Profile& value) {
    auto& [name, unit, known, message, at, lower, upper, lower_end, upper_end, threshold, method, points, failed,
           improvement, evaluations] = value;
    archive(name, unit, known, message, at, lower, upper, lower_end, upper_end, threshold, method, points, failed,
            improvement, evaluations);
}

inline void fields(apps::Archive& archive, MarginalPoint& value) {
    auto& [u, at, log_density, theta] = value;
    archive(u, at, log_density, theta);
}

inline void fields(apps::Archive& archive, Marginal& value) {
    auto& [name, unit, known, message, mean, sd, median, lower95, upper95, lower_end, upper_end, full_hessian, points,
           failed, evaluations] = value;
    archive(name, unit, known, message, mean, sd, median, lower95, upper95, lower_end, upper_end, full_hessian, points,
            failed, evaluations);
}

inline void fields(apps::Archive& archive, BootstrapReplicate& value) {
    auto& [number, status, message, values, sds, evaluations] = value;
    archive(number, status, message, values, sds, evaluations);
}

inline void fields(apps::Archive& archive, SampledQuantity& value) {
    auto& [name, unit, mean, sd, quantiles, mean_error, sd_error, quantile_errors, rhat, bulk, tail] = value;
    archive(name, unit, mean, sd, quantiles, mean_error, sd_error, quantile_errors, rhat, bulk, tail);
}

inline void fields(apps::Archive& archive, SampledChain& value) {
    auto& [step, acceptance, divergences, saturated, energy_mixing, warm_up, evaluations] = value;
    archive(step, acceptance, divergences, saturated, energy_mixing, warm_up, evaluations);
}

inline void fields(apps::Archive& archive, PosteriorSample& value) {
    auto& [status, message, trusted, distrust, parameters, derived, errors, names, draws, potential, latents,
           latent_sds, chains, worst_rhat, least_size] = value;
    archive(status, message, trusted, distrust, parameters, derived, errors, names, draws, potential, latents,
            latent_sds, chains, worst_rhat, least_size);
}

}  // namespace orbid::estimator

namespace orbid::orbits {

inline void fields(apps::Archive& archive, Cycle& value) {
    auto& [period, rotation, points, covariance, multipliers, ln_multiplier, ln_multiplier_covariance, common, time,
           time_sd, code, recurrences, mirror, quality, time_covariance] = value;
    archive(period, rotation, points, covariance, multipliers, ln_multiplier, ln_multiplier_covariance, common, time,
            time_sd, code, recurrences, mirror, quality, time_covariance);
}

inline void fields(apps::Archive& archive, CycleSearch& value) {
    auto& [cycles, missing, candidates, rejected, spline_map, reading_covariance, remarks] = value;
    archive(cycles, missing, candidates, rejected, spline_map, reading_covariance, remarks);
}

}  // namespace orbid::orbits

namespace orbid::identification {

using apps::Archive;

inline void fields(Archive& archive, CycleStart& value) {
    auto& [theta, nodes, iterations, evaluations] = value;
    archive(theta, nodes, iterations, evaluations);
}

inline void fields(Archive& archive, MatchingResult::Coordinate& value) {
    auto& [name, unit, sd, rms, typical] = value;
    archive(name, unit, sd, rms, typical);
}

inline void fields(Archive& archive, MatchingResult::Diffusion& value) {
    auto& [name, unit, at, sd, lower, upper, least] = value;
    archive(name, unit, at, sd, lower, upper, least);
}

inline void fields(Archive& archive, MatchingResult& value) {
    auto& [experiment, interval, intervals, large, expected, coordinates, diffusion, shift, warnings] = value;
    archive(experiment, interval, intervals, large, expected, coordinates, diffusion, shift, warnings);
}

inline void fields(Archive& archive, LogEvidence& value) {
    auto& [at, reason] = value;
    archive(at, reason);
}

inline void fields(Archive& archive, AlternativeResult& value) {
    auto& [name, status, message, parameters, factor, uncertainty, difference, score, score_error, large_defects,
           used] = value;
    archive(name, status, message, parameters, factor, uncertainty, difference, score, score_error, large_defects,
            used);
}

inline void fields(Archive& archive, ComparisonResult& value) {
    auto& [model, stage, large_defects, intervals, score, score_error, alternatives] = value;
    archive(model, stage, large_defects, intervals, score, score_error, alternatives);
}

inline void fields(Archive& archive, SeriesStart& value) {
    auto& [theta, intervals, nodes, reading_sds, follows, doubtful, several_ends, affordable, attempts, iterations,
           evaluations] = value;
    archive(theta, intervals, nodes, reading_sds, follows, doubtful, several_ends, affordable, attempts, iterations,
            evaluations);
}

inline void fields(Archive& archive, StageValue& value) {
    auto& [skipped, search, prediction, cycles, series, best_start, optima, runs, estimate] = value;
    archive(skipped, search, prediction, cycles, series, best_start, optima, runs, estimate);
}

}  // namespace orbid::identification
