#pragma once

#include <limits>

#include "apps/results/result_file.hpp"
#include "estimator/estimate/estimate.hpp"

namespace orbid::tests {

/// An estimate with one of everything: a fitted parameter, one at its bound, one the data do not determine, a derived
/// quantity, an ordered and an unordered error group, a null direction.
inline estimator::Estimate made_up_estimate() {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    estimator::Estimate estimate;
    estimate.status = estimator::EstimateStatus::singular;
    estimate.message = "one direction carries no information";
    estimator::Estimated l{"l", "m",    0.3170012, 0.377, 2.5e-6, 0.3169962, 0.3170062, estimator::IntervalMethod::t,
                           {},  2.5e-6, 1.0};
    estimator::Estimated c2{
        "c2", "1/s", 0.0, 0.1, nan, nan, nan, estimator::IntervalMethod::none, estimator::BoundSide::lower, nan, 1.0};
    estimator::Estimated m{"m", "kg", 0.0858, 0.09, 0.01, 0.066, 0.106, estimator::IntervalMethod::sandwich,
                           {},  1e-4, 2e-4};
    estimate.parameters = {l, c2, m};
    estimate.derived = {{"c2_over_m", "", 0.0, 1.1, nan, nan, nan, estimator::IntervalMethod::none, {}, nan, 1.0}};
    estimator::EstimatedScale phi;
    phi.group = "cycles.phi";
    phi.unit = "rad";
    phi.factor = true;
    phi.value = 1.02;
    phi.uncertainty = 0.06;
    phi.count = 155;
    phi.rms = 1.1e-6;
    phi.lag1 = nan;
    phi.effective_count = 155;
    estimator::EstimatedScale angle;
    angle.group = "series.phi";
    angle.unit = "rad";
    angle.value = 1.136e-3;
    angle.uncertainty = 1e-5;
    angle.count = 36668;
    angle.rms = 1.136e-3;
    angle.lag1 = 0.998;
    angle.correlation_records = 1222.0;
    angle.effective_count = 30.0;
    estimate.scales = {phi, angle};
    estimate.covariance = Eigen::Matrix3d::Identity();
    estimate.correlation = Eigen::Matrix3d::Identity();
    estimate.correlation(1, 1) = nan;
    estimate.singular_values = Eigen::Vector3d(12.0, 0.5, 1e-12);
    // The first component is what a singular value decomposition leaves of a zero.
    estimate.null_directions = {{Eigen::Vector3d(3e-11, 1.0, -0.5)}};
    estimate.effective_count = 310;
    estimate.counts = {{"cycles", 120, 2, 1, 0}};
    estimate.objective = -1234.5;
    estimate.log_likelihood = 1240.1;
    estimate.degrees_of_freedom = 307;
    estimate.iterations = 9;
    estimate.evaluations = 11;
    estimate.rounds = 2;
    estimate.history = {{1, estimator::StepBlock::theta, true, 10.0, 5.0, 0.1}};
    return estimate;
}

inline apps::ResultContext made_up_context() {
    constexpr double nan = std::numeric_limits<double>::quiet_NaN();
    apps::ResultContext context;
    context.reference = {{"l", 0.317}, {"c2", 0.0}};
    context.initial_states = {{"run1", "0", {{"phi", "rad", 1.5, 1e-3, true}, {"phi_dot", "rad/s", 0.0, nan, false}}}};
    context.predictions = {{"run1", "4", {{"phi", 2e-3}}, 1.1, false}};
    context.orbits_found = {{1, 6}, {2, 9}};
    context.orbits_missing = {3};
    context.data_points = 1048576;
    context.data_segments = 4;
    context.captured = {{"run1", 2, 5000, "at rest"}};
    context.fingerprint = apps::fingerprint({{"/seed", "1"}});
    return context;
}

}  // namespace orbid::tests
