#include "apps/results/trust_verdict.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include <fmt/format.h>

#include "apps/results/lost_records.hpp"
#include "apps/results/summary_table.hpp"

namespace orbid::apps {
namespace {

using estimator::BoundSide;
using estimator::EstimateStatus;
using estimator::IntervalMethod;

/// With less than this left, in sds, values are good although a minimisation has not come to its end.
constexpr double values_left = 1.0;
constexpr double converged_left = 0.1;
/// Residuals over the error that was given, where that is wrong by as much as intervals may be, and where the model is.
constexpr double misfit_of_intervals = 1.2, misfit_of_model = 2.0;
/// Correlated residuals that keep this share of a coordinate's spread are no errors of reading.
constexpr double unexplained_share = 0.5;
/// Share of intervals between nodes that may not match.
constexpr double unmatched_share = 0.1;
/// Errors of predictions over what was expected.
constexpr double poor_prediction = 2.0, failed_prediction = 3.0;
/// "Very strong" evidence of Kass and Raftery.
constexpr double strong_evidence = 5.0;
/// An outlier this far off, and so rare among as many readings, is no error of the others' kind.
constexpr double outlier_sds = 5.0, outlier_chance = 1e-3;
/// Fewer leave scales open by half or more, and tests of residuals blind.
constexpr double least_freedom = 5.0;

/// Reasons of both levels, in the order in which they were found.
struct Reasons {
    std::vector<std::string> none, values;
};

std::string joined(const std::vector<std::string>& names) {
    std::string out;
    for (std::size_t i = 0; i < names.size(); ++i)
        out += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
    return out;
}

bool is_matching(const estimator::EstimatedScale& scale) {
    return scale.group.find(".matching.") != std::string::npos || scale.group.find(".noise.") != std::string::npos;
}

bool follows_itself(const estimator::EstimatedScale& scale) {
    return std::isfinite(scale.lag1) && scale.effective_count < 0.5 * static_cast<double>(scale.count);
}

void judge_end(const estimator::Estimate& estimate, Reasons& reasons) {
    const std::string left =
        std::isfinite(estimate.remaining) ? fmt::format(" with {:.2g} sds left", estimate.remaining) : "";
    const std::string cure = "; start nearer, or allow more steps";
    switch (estimate.status) {
        case EstimateStatus::converged:
        case EstimateStatus::singular:
            break;
        case EstimateStatus::interrupted:
            reasons.none.push_back("the run was interrupted" + left + "; the same command goes on");
            break;
        case EstimateStatus::failed:
            reasons.none.push_back("there is no estimate: " + estimate.message);
            break;
        case EstimateStatus::no_progress:
        case EstimateStatus::iteration_limit: {
            const std::string what =
                fmt::format("not converged (status {}){}{}", estimator::name(estimate.status), left, cure);
            (estimate.remaining < values_left ? reasons.values : reasons.none).push_back(what);
            break;
        }
    }
    if (estimate.status == EstimateStatus::converged && estimate.remaining >= converged_left)
        reasons.values.push_back(fmt::format("the minimum lies at a jump or at rounding{}", left));
}

void judge_records(const estimator::Estimate& estimate, const ResultContext& context, Reasons& reasons) {
    const std::string lost = lost_records(estimate.counts, context.steady_states);
    if (lost.empty()) return;
    (too_few_used(estimate.counts) ? reasons.none : reasons.values)
        .push_back(lost + "; start nearer, or give these records starts of their own");
}

void judge_directions(const estimator::Estimate& estimate, const ResultContext& context, Reasons& reasons) {
    const auto named = [&](const Eigen::VectorXd& components) {
        std::vector<std::string> names;
        for (Eigen::Index i = 0; i < components.size(); ++i)
            if (std::abs(components[i]) > 0.01)
                names.push_back(estimate.parameters.at(static_cast<std::size_t>(i)).name);
        return names;
    };
    const auto words = [&](const Eigen::VectorXd& components, const std::string& told) {
        const std::vector<std::string> names = named(components);
        return names.size() < 2 ? fmt::format("the data do not tell {}", joined(names))
                                : fmt::format("the data do not tell {} apart{}", joined(names),
                                              told.empty() ? "" : ", only " + told);
    };
    const std::string cure = "; hold one or give it a prior";
    for (const auto& direction : estimate.null_directions) {
        const bool open = estimate.status == EstimateStatus::singular;
        (open ? reasons.none : reasons.values)
            .push_back(words(direction.components, direction.told) + (open ? cure : "; the prior decides"));
    }
    for (const auto& direction : estimate.sloppy_directions) {
        const auto untold = [&](const std::string& name) {
            return std::any_of(estimate.parameters.begin(), estimate.parameters.end(), [&](const auto& x) {
                return x.name == name && x.interval_method == IntervalMethod::none && std::isfinite(x.sd);
            });
        };
        const std::vector<std::string> names = named(direction.components);
        if (std::any_of(names.begin(), names.end(), untold))
            reasons.none.push_back(words(direction.components, direction.told) + cure);
    }
    for (const auto& direction : context.structure.directions)
        reasons.values.push_back(
            fmt::format("no record can tell: {}; {} was held at its start", direction.text, direction.held));
}

void judge_parameters(const estimator::Estimate& estimate, Reasons& reasons) {
    for (const auto& x : estimate.parameters) {
        if (x.interval_method == IntervalMethod::fixed) continue;
        if (x.at_bound != BoundSide::none)
            reasons.values.push_back(
                fmt::format("{0} lies at its {1} bound, the others hold for it there; widen the "
                            "bound if it is not physical",
                            x.name, name(x.at_bound)));
        // Undetermined parameters are named with their direction.
        const bool open = !std::isfinite(x.sd) || estimate.status == EstimateStatus::failed;
        if (x.at_bound == BoundSide::none && !open && x.interval_method == IntervalMethod::none)
            reasons.values.push_back(fmt::format("{} has no interval", x.name));
        if (x.data_share < 1e-3 && std::isfinite(x.sd) && estimate.null_directions.empty())
            reasons.values.push_back(fmt::format("{} is known by its prior alone", x.name));
    }
    if (!estimate.bias_left.empty())
        reasons.values.push_back("readings err by more than the course's folds, and their bias is not taken off: " +
                                 estimate.bias_left);
    if (!estimate.trust_normal)
        reasons.values.push_back(fmt::format("the posterior is not normal{}{}; ask for \"profile\" or \"posterior\"",
                                             estimate.distrust.empty() ? "" : ": ", estimate.distrust));
}

void judge_scales(const estimator::Estimate& estimate, const ResultContext& context, Reasons& reasons) {
    double records = 0.0;
    for (const auto& scale : estimate.scales) {
        if (is_matching(scale) || scale.count == 0) continue;
        const auto count = static_cast<double>(scale.count);
        records += count;
        // Factors of errors that cycles share are 1 at least: there they say that the analysis' covariance holds.
        const bool as_analysed = scale.factor && scale.value == 1.0;
        // Of the coordinate that makes a section all readings are the same, and no residual is other than 0.
        const bool without_errors = scale.rms == 0.0;
        if (scale.estimated && !std::isfinite(scale.lower95) && scale.distribution == "normal" && !as_analysed &&
            !without_errors)
            reasons.values.push_back(fmt::format(
                "the error scale of {} is held at its limit; give an \"sd\" that the instrument has", scale.group));
        if (!scale.estimated && !scale.factor && scale.distribution == "normal" && scale.value > 0.0) {
            const double misfit = scale.rms / scale.value;
            // Three sds of an rms of so many readings.
            const double chance = 3.0 / std::sqrt(2.0 * count);
            const std::string what = fmt::format(
                "residuals of {} are {:.2g} times the error that was given; mend the "
                "model, or let the error be estimated",
                scale.group, misfit);
            if (misfit > std::max(misfit_of_model, 1.0 + chance))
                reasons.none.push_back(what);
            else if (misfit > std::max(misfit_of_intervals, 1.0 + chance) ||
                     misfit < std::min(1.0 / misfit_of_intervals, 1.0 - chance))
                reasons.values.push_back(what);
        }
        if (follows_itself(scale))
            reasons.values.push_back(
                fmt::format("residuals of {} follow each other: {:.0f} are worth {:.0f}; the model misses something",
                            scale.group, count, scale.effective_count));
    }
    if (records > 0.0 && estimate.status != EstimateStatus::failed && estimate.degrees_of_freedom < least_freedom)
        reasons.values.push_back(fmt::format("{:.0f} readings leave {:.3g} degrees of freedom; measure more", records,
                                             estimate.degrees_of_freedom));
    const bool correlated = std::any_of(estimate.scales.begin(), estimate.scales.end(), follows_itself);
    std::vector<std::string> unexplained;
    for (const auto& [coordinate, share] : context.unexplained)
        if (correlated && share > unexplained_share)
            unexplained.push_back(fmt::format("{:.0f} % of the spread of {}", 100.0 * share, coordinate));
    if (!unexplained.empty())
        reasons.none.push_back(fmt::format(
            "the model leaves {} unexplained; a false minimum or a wrong model: start elsewhere{}",
            fmt::join(unexplained, ", "),
            context.whole_segments ? ", or follow the series in short pieces (\"interval\": \"auto\")" : ""));
    for (const auto& group : context.posterior.diagnostics) {
        const auto scale = std::find_if(estimate.scales.begin(), estimate.scales.end(),
                                        [&](const auto& one) { return one.group == group.group; });
        if (scale == estimate.scales.end() || scale->distribution != "normal" || is_matching(*scale)) continue;
        if (group.outliers.empty()) continue;
        const auto& worst = group.outliers.front();
        if (std::abs(worst.studentised) > outlier_sds && worst.p < outlier_chance)
            reasons.values.push_back(
                fmt::format("{} of {} lies {:.2g} sds off ({}, reading {}); look at it, or use \"student_t\" errors",
                            group.outliers.size() > 1 ? "a reading, not alone," : "a reading", group.group,
                            std::abs(worst.studentised), worst.block, worst.record));
    }
}

void judge_model(const ResultContext& context, Reasons& reasons) {
    if (context.cycles_share_errors)
        reasons.values.push_back(
            "points and times of the cycles share errors that are not known; add a stage of type series");
    if (!context.blurred_jumps.empty())
        reasons.none.push_back(
            fmt::format("the cycles are those of one smooth map, which blurs what {} does; add a stage of type series",
                        context.blurred_jumps));
    for (const auto& matching : context.strategy.matching) {
        // Those that the errors of matching explain are no fault.
        const double share =
            matching.intervals > 0
                ? static_cast<double>(matching.large) / static_cast<double>(matching.intervals) - matching.expected
                : 0.0;
        const std::string what = fmt::format("{} of {} intervals of {} do not match; the model misses something there",
                                             matching.large, matching.intervals, matching.experiment);
        if (share > unmatched_share)
            reasons.none.push_back(what);
        else if (share > 0.01)
            reasons.values.push_back(what);
        else if (!matching.warnings.empty())
            reasons.values.push_back(fmt::format("{}: {}", matching.experiment, matching.warnings.front()));
    }
    double worst = 0.0;
    for (const Prediction& prediction : context.predictions)
        if (!prediction.fitted && std::isfinite(prediction.normalised_rms))
            worst = std::max(worst, prediction.normalised_rms);
    const std::string missed = fmt::format("data outside the fit are missed by {:.2g} times their error", worst);
    if (worst > failed_prediction)
        reasons.none.push_back(missed);
    else if (worst > poor_prediction)
        reasons.values.push_back(missed);
    if (context.strategy.criticism)
        for (const auto& other : context.strategy.criticism->alternatives)
            if (other.ln_bayes_factor.value && *other.ln_bayes_factor.value < -strong_evidence)
                reasons.none.push_back(fmt::format("the data speak for another model: {}", other.name));
    const auto& sample = context.posterior.sample;
    if (sample && !sample->trusted)
        reasons.values.push_back(fmt::format("the draws from the posterior cannot be trusted: {}", sample->distrust));
}

}  // namespace

std::string_view name(Trust trust) {
    constexpr std::array names{"all", "values", "none"};
    return names[static_cast<std::size_t>(trust)];
}

std::string TrustVerdict::line() const {
    if (trust == Trust::all || because.empty()) return "trust";
    const std::size_t more = because.size() - 1;
    return fmt::format("{}: {}{}", trust == Trust::none ? "do not trust" : "trust the values, not the intervals",
                       because.front(), more == 0 ? "" : fmt::format(" (and {} more)", more));
}

TrustVerdict trust_verdict(const estimator::Estimate& estimate, const ResultContext& context) {
    Reasons reasons;
    judge_end(estimate, reasons);
    judge_records(estimate, context, reasons);
    judge_directions(estimate, context, reasons);
    judge_model(context, reasons);
    judge_scales(estimate, context, reasons);
    judge_parameters(estimate, reasons);
    TrustVerdict verdict;
    verdict.trust = !reasons.none.empty() ? Trust::none : !reasons.values.empty() ? Trust::values : Trust::all;
    verdict.because = std::move(reasons.none);
    verdict.because.insert(verdict.because.end(), reasons.values.begin(), reasons.values.end());
    return verdict;
}

std::vector<std::pair<std::string, double>> unexplained_spread(const std::vector<ResidualRow>& rows) {
    struct Sums {
        double count = 0.0, mean = 0.0, spread = 0.0, left = 0.0;
    };
    constexpr double least_count = 5.0;
    std::map<std::string, Sums> sums;
    for (const ResidualRow& row : rows) {
        if (!std::isfinite(row.observed) || !std::isfinite(row.predicted)) continue;
        Sums& own = sums[row.coordinate];
        own.count += 1.0;
        const double off = row.observed - own.mean;
        own.mean += off / own.count;
        own.spread += off * (row.observed - own.mean);  // Welford's sum
        own.left += (row.observed - row.predicted) * (row.observed - row.predicted);
    }
    std::vector<std::pair<std::string, double>> out;
    for (const auto& [coordinate, own] : sums)
        if (own.count >= least_count && own.spread > 0.0)
            out.emplace_back(coordinate, std::sqrt(own.left / own.spread));
    return out;
}

}  // namespace orbid::apps
