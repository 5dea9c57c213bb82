#include "estimator/sampling/improper_posterior.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "estimator/problem/linearisation.hpp"
#include "estimator/uncertainty/identifiability.hpp"
#include "models/arithmetic/orthogonal_factor.hpp"
#include "models/definition/wrong_data.hpp"

namespace orbid::estimator {

namespace {

[[noreturn]] void refuse_improper(const std::string& what) {
    throw models::DataError("the posterior is improper: " + what);
}

/// Whether the marginal prior of a parameter is proper in its coordinate.
bool closed(const Problem& problem, Eigen::Index i) {
    if (std::isfinite(problem.lower[i]) && std::isfinite(problem.upper[i])) return true;
    if (is_proper(problem.parameters[static_cast<std::size_t>(i)].prior)) return true;
    return std::any_of(problem.joint_priors.begin(), problem.joint_priors.end(), [i](const Problem::Joint& joint) {
        return std::find(joint.place.begin(), joint.place.end(), i) != joint.place.end();
    });
}

void check_parameters(const Problem& problem, const Estimate& estimate) {
    const auto q = static_cast<Eigen::Index>(problem.parameters.size());
    const auto count = static_cast<Eigen::Index>(estimate.null_directions.size());
    if (count == 0) return;
    // A direction is closed when it cannot be followed without moving a closed parameter. The null directions
    // restricted to the closed parameters must still be independent.
    Eigen::MatrixXd seen = Eigen::MatrixXd::Zero(q, count);
    for (Eigen::Index k = 0; k < count; ++k)
        for (Eigen::Index i = 0; i < q; ++i)
            if (closed(problem, i)) seen(i, k) = estimate.null_directions[static_cast<std::size_t>(k)].components[i];
    if (q > 0 && models::PivotedFactor(seen).rank() == count) return;
    std::string words;
    for (const NullDirection& direction : estimate.null_directions) {
        bool open = true;
        for (Eigen::Index i = 0; i < q; ++i)
            open = open && (direction.components[i] == 0.0 || !closed(problem, i));
        if (open) words += (words.empty() ? "" : "; ") + in_words(direction, problem.parameters);
    }
    if (words.empty())
        for (const NullDirection& direction : estimate.null_directions)
            words += (words.empty() ? "" : "; ") + in_words(direction, problem.parameters);
    refuse_improper(words + "; give one of them a proper prior or two bounds");
}

/// Rows of one channel with respect to latent states and parameters, all blocks under each other.
Eigen::MatrixXd rows_of(const std::vector<BlockRows>& rows, const Problem& problem, const BlockSet& set, int channel) {
    const auto q = static_cast<Eigen::Index>(problem.parameters.size());
    Eigen::MatrixXd all(static_cast<Eigen::Index>(set.count[channel]), set.latents + q);
    all.setZero();
    std::vector<Eigen::Index> latent;
    Eigen::Index latents = 0;
    for (const BlockRows& block : rows) {
        latent.push_back(latents);
        latents += block.latents;
    }
    Eigen::Index row = 0;
    for (std::size_t b = 0; b < rows.size(); ++b) {
        const BlockRows& block = rows[b];
        const auto take = [&](const Eigen::MatrixXd& from, Eigen::Index i) {
            all.row(row).segment(latent[b], block.latents) = from.row(i).head(block.latents);
            const Eigen::Index before = from.cols() - 1 - q;
            if (before > block.latents)
                all.row(row).segment(latent[static_cast<std::size_t>(block.next)], block.next_latents) =
                    from.row(i).segment(block.latents, block.next_latents);
            all.row(row).tail(q) = from.row(i).segment(before, q);
            ++row;
        };
        for (Eigen::Index i = 0; i < block.rows.rows(); ++i)
            if (block.channel[static_cast<std::size_t>(i)] == channel) take(block.rows, i);
        for (const std::vector<PartRows>* parts : {&block.parts, &block.linked_parts})
            for (const PartRows& part : *parts) {
                const NoiseModel& law = problem.laws[part.law];
                if (law.joint() || law.channels.front() != channel) continue;
                for (Eigen::Index i = 0; i < part.records.rows.rows(); ++i)
                    take(part.records.rows, i);
            }
    }
    // Columns at unit length, for a rank that does not depend on units.
    for (Eigen::Index k = 0; k < all.cols(); ++k)
        if (const double length = all.col(k).norm(); length > 0.0) all.col(k) /= length;
    return all;
}

void check_scale(const Problem& problem, const BlockSet& set, const std::vector<BlockRows>& rows, const NoiseModel& law,
                 const EstimatedScale& estimated) {
    const ErrorCoordinate& scale = law.coordinates.front();
    const int channel = law.channels.front();
    if (!scale.estimate || is_proper(scale.prior) || std::isfinite(scale.lower)) return;
    const std::string who = "the scale of group \"" + estimated.group + "\" has neither a prior nor a floor, and ";
    if (set.count[channel] == 0.0) refuse_improper(who + "there is no record of it");
    if (std::holds_alternative<RelativeErrors>(law.distribution))
        refuse_improper(who + "its relative part can carry all of the error");
    const auto q = static_cast<Eigen::Index>(problem.parameters.size());
    const auto count = static_cast<Eigen::Index>(set.count[channel]);
    // Fitted to rounding: the scale of any other fit is near the rms of its residuals.
    constexpr double exact = 1e-3;
    const bool fitted = !(estimated.rms > exact * estimated.value) && count > q + set.latents &&
                        !std::holds_alternative<LogNormalErrors>(law.distribution);
    const auto rank = [&] { return models::PivotedFactor(rows_of(rows, problem, set, channel)).rank(); };
    if (fitted || (count <= q + set.latents && rank() == count))
        refuse_improper(who + "its records can be fitted exactly: as the scale goes to zero the likelihood does not");
}

[[noreturn]] void refuse_estimate(const std::string& what) {
    throw models::DataError("posterior sample: " + what);
}

}  // namespace

void refuse_unfit(const Problem& problem, const Estimate& start) {
    // A singular estimate may still have a proper posterior: see refuse_improper().
    if (start.status != EstimateStatus::converged && start.status != EstimateStatus::singular)
        refuse_estimate(
            fmt::format("the estimate must have converged, its status is {}: {}", name(start.status), start.message));
    bool fits = start.parameters.size() == problem.parameters.size() &&
                start.scales.size() == problem.channels.size() && start.latents.size() == problem.residuals.size();
    for (std::size_t i = 0; fits && i < problem.parameters.size(); ++i)
        fits = start.parameters[i].name == problem.parameters[i].name;
    for (std::size_t r = 0; fits && r < problem.residuals.size(); ++r) {
        const auto& layout = start.active[r].layout;
        fits = start.latents[r].size() == layout.size();
        for (std::size_t b = 0; fits && b < layout.size(); ++b)
            fits = !layout[b].active || start.latents[r][b].size() == layout[b].latents;
    }
    if (!fits)
        throw std::invalid_argument("posterior sample: the estimate does not belong to these parameters and residuals");
    for (const ActiveSet& active : start.active)
        for (const BlockLayout& block : active.layout)
            if (block.active && block.constraints > 0)
                refuse_estimate(
                    fmt::format("block \"{}\" has equality constraints, on which no density can be walked; give its "
                                "matching errors a small sd instead",
                                block.label));
}

void refuse_improper(const Problem& problem, const BlockSet& set, const Estimate& estimate) {
    check_parameters(problem, estimate);
    Eigen::VectorXd theta(static_cast<Eigen::Index>(problem.parameters.size()));
    for (Eigen::Index i = 0; i < theta.size(); ++i)
        theta[i] = estimate.parameters[static_cast<std::size_t>(i)].value;
    const Evaluation evaluation = evaluate(problem.residuals, set, problem.laws, theta, estimate.latents, true);
    if (!evaluation.failed.empty()) return;  // nothing can be said, and nothing sampled
    const auto rows = linearise(set, problem.laws, evaluation.values, problem.coordinates, theta, false);
    for (std::size_t b = 0; b < set.blocks.size(); ++b) {
        const ActiveBlock& block = set.blocks[b];
        if (block.latents == 0) continue;
        Eigen::MatrixXd z = evaluation.values[b].e_z;
        if (z.rows() > 0)
            for (Eigen::Index k = 0; k < z.cols(); ++k)
                if (const double length = z.col(k).norm(); length > 0.0) z.col(k) /= length;
        if (z.rows() == 0 || models::PivotedFactor(z).rank() < block.latents)
            refuse_improper("the records of block \"" + label_of(set, block) + "\" do not determine its latent states");
    }
    for (const NoiseModel& law : problem.laws) {
        const EstimatedScale& scale = estimate.scales[static_cast<std::size_t>(law.channels.front())];
        if (!law.joint()) {
            check_scale(problem, set, rows, law, scale);
        } else if (law.inverse_wishart_dof == 0.0 && !std::isfinite(law.coordinates.front().lower) &&
                   set.count[law.channels.front()] <
                       static_cast<double>(law.channels.size()) +
                           static_cast<double>(theta.size()) / static_cast<double>(law.channels.size())) {
            refuse_improper("the full covariance of group \"" + scale.group +
                            "\" and others has no prior and too few records");
        }
    }
}

}  // namespace orbid::estimator
