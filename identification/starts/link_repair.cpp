#include "identification/starts/link_repair.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include "estimator/exploration/replication.hpp"
#include "estimator/exploration/tilt.hpp"
#include "estimator/interface/random_stream.hpp"
#include "identification/problem/estimated_values.hpp"
#include "identification/starts/link_gaps.hpp"
#include "identification/starts/piece_estimate.hpp"
#include "identification/starts/series_nodes.hpp"
#include "orbits/records/data_error.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t most_candidates = 3;
/// States drawn from the error ball of a node, and of few nodes where these lead nowhere.
constexpr std::size_t few_states = 8, many_states = 64;
/// Nodes on either side of the places, likewise.
constexpr Index short_margin = 4, long_margin = 8;
/// Gaps of one round: the larger of a number and a share of the links.
constexpr std::size_t most_gaps = 160, most_hard_gaps = 32;
constexpr double most_of_links = 0.05;

/// Where a minimisation has come to, be it a minimum or not.
bool has_ended(const estimator::Estimate& estimate) {
    return estimate.status == estimator::EstimateStatus::converged ||
           estimate.status == estimator::EstimateStatus::iteration_limit ||
           estimate.status == estimator::EstimateStatus::no_progress;
}

estimator::Estimate interrupted(estimator::Estimate estimate) {
    estimate.status = estimator::EstimateStatus::interrupted;
    estimate.message = "interrupted while places where the course misses were looked at";
    return estimate;
}

/// The search within the pieces of one estimate.
class Search {
public:
    Search(const IdentificationProblem& problem, const EstimateSetup& setup,
           const std::vector<estimator::FreeParameter>& parameters, const ProblemResiduals& residuals,
           const estimator::EstimateOptions& options, const estimator::Estimate& estimate, std::size_t drawn)
        : problem_(problem),
          setup_(setup),
          residuals_(residuals),
          options_(options),
          estimate_(estimate),
          drawn_(drawn),
          near_(nearly_held(parameters, estimate)),
          start_(nodes_at(residuals, estimate)) {
        for (const auto& residual : residuals.shooting) {
            std::vector<double>& sds = start_.reading_sds.emplace_back();
            for (std::size_t g = 0; g < residual->reading_groups(); ++g) {
                const auto* scale = scale_of(estimate, residual->groups()[g].name);
                sds.push_back(scale != nullptr && !scale->factor ? scale->value : 0.0);
            }
        }
    }

    /// Nodes of the piece that explain it better than those of the estimate.
    void mend(LinkGap& gap) const {
        const MatrixXd now = nodes_of(gap).middleCols(gap.first, gap.count);
        std::vector<MatrixXd> trials{now, now};
        for (Index k = 0; k < gap.count; ++k)
            for (const auto& reading : readings_at(gap, gap.first + k))
                trials[1](reading.coordinate, k) = reading.value;
        MatrixXd all = now;
        for (const Index node : gap.missed) {
            const std::vector<MatrixXd> states = candidates(gap, node);
            const Index k = node - gap.first;
            for (const MatrixXd& pair : states) {
                trials.push_back(now);
                trials.back().middleCols(k, 2) = pair;
            }
            if (!states.empty()) all.middleCols(k, 2) = states.front();
        }
        if (gap.missed.size() > 1) trials.push_back(all);
        const orbits::Continuity tight = normal(residuals_.shooting[gap.place]->matching_sd(active(gap)));
        // What does not explain the piece is no better, whatever else there is.
        gap.left = gap.missed.size();
        double best = std::numeric_limits<double>::infinity();
        for (const MatrixXd& nodes : trials) {
            const PieceEstimate one = estimated({gap.place, gap.segment, gap.first}, nodes, tight);
            if (one.nodes.size() == 0 || one.missed > gap.left) continue;
            if (one.missed == gap.left && !(one.objective < best)) continue;
            best = one.objective;
            gap.left = one.missed;
            gap.nodes = one.nodes;
        }
    }

private:
    struct Reading {
        Index coordinate;
        double value, sd;
    };

    [[nodiscard]] const MatrixXd& nodes_of(const LinkGap& gap) const { return start_.nodes[gap.place][gap.segment]; }
    [[nodiscard]] const estimator::ActiveSet& active(const LinkGap& gap) const {
        return estimate_.active[residuals_.first_shooting() + gap.place];
    }

    static orbits::Continuity normal(const VectorXd& sd) {
        orbits::Continuity matching;
        matching.kind = orbits::Continuity::Kind::normal;
        matching.sd = sd;
        return matching;
    }

    /// At the node itself.
    [[nodiscard]] std::vector<Reading> readings_at(const LinkGap& gap, Index node) const {
        const orbits::ShootingResidual& residual = *residuals_.shooting[gap.place];
        std::vector<Reading> found;
        for (const orbits::PlannedReading& one : residual.plan().of(gap.begin + static_cast<std::size_t>(node))) {
            const auto* scale = scale_of(estimate_, residual.groups()[static_cast<std::size_t>(one.group)].name);
            if (one.instant == -1 && scale != nullptr)
                found.push_back({one.coordinate, one.value, scale->value * one.deviation});
        }
        return found;
    }

    [[nodiscard]] PieceEstimate estimated(const SeriesPiece& piece, const MatrixXd& nodes,
                                          const orbits::Continuity& matching) const {
        try {
            const auto exact = shooting_piece(problem_, setup_, start_, piece, nodes);
            return piece_estimate(near_, exact->with(matching, exact->initial_set(), {}), options_);
        } catch (const orbits::DataError&) {  // a piece without readings
            return {};
        }
    }

    /// States of a node and the next one that explain the readings of both, shape (n, 2), the best first.
    [[nodiscard]] std::vector<MatrixXd> candidates(const LinkGap& gap, Index node) const {
        constexpr double apart = 0.3, wider = 1.5;
        const std::vector<Reading> here = readings_at(gap, node), next = readings_at(gap, node + 1);
        const orbits::ShootingResidual& residual = *residuals_.shooting[gap.place];
        // Also of coordinates that a section makes exact.
        const VectorXd sd = residual.noise(active(gap)) * residual.range();
        MatrixXd middle = nodes_of(gap).middleCols(node, 2);
        for (const Reading& one : here)
            middle(one.coordinate, 0) = one.value;
        for (const Reading& one : next)
            middle(one.coordinate, 1) = one.value;
        const std::uint64_t number = gap.begin + static_cast<std::size_t>(node);
        estimator::RandomStream random(gap.place, estimator::RandomPurpose::multi_start, number);
        std::vector<PieceEstimate> found;
        for (std::size_t i = 0; i < drawn_; ++i) {
            MatrixXd nodes = middle;
            for (const Reading& one : here)
                nodes(one.coordinate, 0) += (i == 0 ? 0.0 : wider * one.sd * random.normal());
            PieceEstimate one = estimated({gap.place, gap.segment, node}, nodes, normal(sd));
            if (one.nodes.size() == 0) continue;
            const bool known = std::any_of(found.begin(), found.end(), [&](const PieceEstimate& other) {
                return ((one.nodes - other.nodes).col(0).cwiseQuotient(sd)).cwiseAbs().maxCoeff() < apart;
            });
            if (!known) found.push_back(std::move(one));
        }
        std::stable_sort(found.begin(), found.end(),
                         [](const PieceEstimate& a, const PieceEstimate& b) { return a.objective < b.objective; });
        if (found.size() > most_candidates) found.resize(most_candidates);
        std::vector<MatrixXd> states;
        for (PieceEstimate& one : found)
            states.push_back(std::move(one.nodes));
        return states;
    }

    const IdentificationProblem& problem_;
    const EstimateSetup& setup_;
    const ProblemResiduals& residuals_;
    const estimator::EstimateOptions& options_;
    const estimator::Estimate& estimate_;
    std::size_t drawn_;
    std::vector<estimator::FreeParameter> near_;
    SeriesStart start_;
};

/// The estimate after as many rounds as gain something: first with few states and short pieces, then with many and
/// long.
estimator::Estimate mended_in_rounds(const IdentificationProblem& problem, const EstimateSetup& setup,
                                     const std::vector<estimator::FreeParameter>& parameters,
                                     const ProblemResiduals& residuals, const estimator::EstimateOptions& options,
                                     estimator::Estimate estimate,
                                     const std::function<void(const std::string& line)>& told) {
    constexpr int most_rounds = 16;
    constexpr double least_gain = 0.1;   // of the objective
    constexpr double most_missed = 0.5;  // of the links of a record
    const std::size_t first = residuals.first_shooting();
    std::size_t states = few_states;
    for (int round = 0; round < most_rounds; ++round) {
        if (!has_ended(estimate)) return estimate;
        std::vector<LinkGap> gaps;
        std::size_t all = 0, links = 0;
        for (std::size_t i = 0; i < residuals.shooting.size(); ++i) {
            const orbits::ShootingResidual& residual = *residuals.shooting[i];
            if (!residual.matching().is_exact_with_slack() || estimate.active[first + i].is_intermediate_stage)
                continue;
            const auto missed = missed_places(residual, estimate, first + i);
            if (static_cast<double>(missed.size()) > most_missed * static_cast<double>(residual.layout().size()))
                continue;
            all += missed.size();
            links += residual.layout().size();
            add_gaps(residual, missed, i, states == few_states ? short_margin : long_margin, gaps);
        }
        if (gaps.empty()) return estimate;
        const std::size_t most =
            std::max(most_gaps, static_cast<std::size_t>(most_of_links * static_cast<double>(links)));
        gaps.resize(std::min(gaps.size(), states == few_states ? most : most_hard_gaps));
        const Search search(problem, setup, parameters, residuals, options, estimate, states);
        tbb::parallel_for(std::size_t{0}, gaps.size(), [&](std::size_t g) { search.mend(gaps[g]); });
        if (options.interrupted && options.interrupted()) return interrupted(std::move(estimate));
        estimator::Estimate begun = estimate;
        std::size_t mended = 0;
        for (const LinkGap& gap : gaps) {
            for (Index k = 0; k < gap.nodes.cols(); ++k)
                begun.latents[first + gap.place][gap.begin + static_cast<std::size_t>(gap.first + k)] =
                    gap.nodes.col(k);
            mended += gap.missed.size() - gap.left;
        }
        if (mended == 0) {
            if (states == many_states) return estimate;
            states = many_states;
            continue;
        }
        estimator::Estimate found =
            estimator::estimate_again(parameters, residuals.all(), setup.derived, options, begun);
        if (found.status == estimator::EstimateStatus::interrupted) return interrupted(std::move(estimate));
        const bool better = has_ended(found) && found.objective < estimate.objective - least_gain;
        if (told)
            told(fmt::format(
                "{} of {} places where the course missed have a better one: {}", mended, all,
                better ? fmt::format("the objective decreases by {:.3g}", estimate.objective - found.objective)
                       : fmt::format("no better, {}", found.message)));
        if (better)
            estimate = std::move(found);
        else if (states == many_states)
            return estimate;
        else
            states = many_states;
    }
    return estimate;
}

/// The estimate with links as tight as the errors of readings ask for that are left, where wrong branches had made
/// these look larger; nothing where they had not, or where that leads nowhere.
std::optional<estimator::Estimate> tightened(const EstimateSetup& setup,
                                             const std::vector<estimator::FreeParameter>& parameters,
                                             const ProblemResiduals& residuals,
                                             const estimator::EstimateOptions& options,
                                             const estimator::Estimate& estimate) {
    if (estimate.status != estimator::EstimateStatus::converged) return std::nullopt;
    estimator::Estimate begun = estimate;
    begun.active = estimator::ended_sets(estimate);
    bool any = false;
    for (std::size_t i = 0; i < residuals.shooting.size(); ++i)
        any = residuals.shooting[i]->tighten(begun.active[residuals.first_shooting() + i]) || any;
    if (!any) return std::nullopt;
    estimator::Estimate found = estimator::estimate_again(parameters, residuals.all(), setup.derived, options, begun);
    if (found.status == estimator::EstimateStatus::interrupted) return interrupted(estimate);
    return found.status == estimator::EstimateStatus::converged ? std::optional(std::move(found)) : std::nullopt;
}

}  // namespace

estimator::Estimate with_mended_links(const IdentificationProblem& problem, const EstimateSetup& setup,
                                      const std::vector<estimator::FreeParameter>& parameters,
                                      const ProblemResiduals& residuals, const estimator::EstimateOptions& options,
                                      estimator::Estimate estimate,
                                      const std::function<void(const std::string& line)>& told) {
    constexpr int most_times = 3;
    estimate = mended_in_rounds(problem, setup, parameters, residuals, options, std::move(estimate), told);
    for (int i = 0; i < most_times; ++i) {
        std::optional<estimator::Estimate> tight = tightened(setup, parameters, residuals, options, estimate);
        if (!tight) return estimate;
        estimate = mended_in_rounds(problem, setup, parameters, residuals, options, std::move(*tight), told);
    }
    return estimate;
}

}  // namespace orbid::identification
