#include "identification/starts/piece_estimate.hpp"

#include <algorithm>
#include <cmath>

#include "identification/starts/link_gaps.hpp"

namespace orbid::identification {

using Eigen::Index;

PieceEstimate piece_estimate(const std::vector<estimator::FreeParameter>& near,
                             const orbits::ShootingResidual& residual, const estimator::EstimateOptions& options,
                             std::uint64_t most_work) {
    estimator::EstimateOptions rough;
    rough.variance = estimator::Variance::ml;
    rough.verdict = false;
    rough.error_uncertainties = false;
    rough.maximum_iterations = 40;
    rough.step_tolerance = 1e-2;
    const std::uint64_t before = residual.work();  // copies with other matching share it
    rough.interrupted = [&] {
        return residual.work() - before > most_work || (options.interrupted && options.interrupted());
    };
    const auto found = estimator::estimate(near, {&residual}, {}, rough);
    PieceEstimate result;
    result.work = residual.work() - before;
    if (found.status != estimator::EstimateStatus::converged || found.active.size() != 1 ||
        found.active[0].is_intermediate_stage)
        return result;
    result.objective = found.objective;
    const std::vector<Eigen::VectorXd>& latents = found.latents[0];
    result.nodes.resize(latents.front().size(), std::ssize(latents));
    for (Index k = 0; k < result.nodes.cols(); ++k)
        result.nodes.col(k) = latents[static_cast<std::size_t>(k)];
    result.missed = missed_places(residual, found, 0).size();
    return result;
}

std::vector<estimator::FreeParameter> nearly_held(std::vector<estimator::FreeParameter> parameters,
                                                  const estimator::Estimate& estimate) {
    const double unknown = estimate.status == estimator::EstimateStatus::converged ? 1e-3 : 1e-2;
    constexpr double width = 3.0;
    for (std::size_t i = 0; i < parameters.size(); ++i) {
        estimator::FreeParameter& one = parameters[i];
        one.start = estimate.parameters[i].value;
        if (!one.tied_to.empty()) continue;
        const double most = unknown * std::max(std::abs(one.start), 1e-3 * one.typical_size);
        const double told = width * estimate.parameters[i].laplace_sd;
        one.prior = estimator::NormalPrior{one.start, told > 0.0 && told < most ? told : most};
    }
    return parameters;
}

}  // namespace orbid::identification
