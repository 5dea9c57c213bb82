#include "apps/program/summary.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include <fmt/format.h>

#include "apps/results/lost_records.hpp"
#include "apps/results/posterior_results.hpp"
#include "apps/results/summary_table.hpp"
#include "apps/results/trust_verdict.hpp"
#include "apps/stored_run/prediction_results.hpp"

namespace orbid::apps {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// The value was given, not estimated.
bool is_held(const estimator::Estimated& x) {
    return x.interval_method == estimator::IntervalMethod::fixed;
}

/// The data tell not even its order of magnitude: "Not determined by the data" says what they do tell.
bool is_untold(const estimator::Estimated& x) {
    return x.interval_method == estimator::IntervalMethod::none && std::isfinite(x.sd) && !std::isfinite(x.lower95);
}

/// Digits of an end of an interval: where it is a bound or a limit, without a sd of the value, three of its length.
double end_sd(const estimator::Estimated& x) {
    return std::isfinite(x.sd) ? x.sd : 0.1 * (x.upper95 - x.lower95);
}

std::string interval(const estimator::Estimated& x) {
    if (is_held(x)) return "";
    if (!std::isfinite(x.lower95) || !std::isfinite(x.upper95)) return "undefined";
    const std::string mark = x.limit == estimator::BoundSide::none ? "" : fmt::format(" {} limit", name(x.limit));
    return fmt::format("[{}, {}]{}", with_digits_of(x.lower95, end_sd(x)), with_digits_of(x.upper95, end_sd(x)), mark);
}

std::string estimated_table(const std::vector<estimator::Estimated>& list) {
    SummaryTable table({left_aligned("name"), left_aligned("unit"), "start", "value", "± sd",
                        left_aligned("95 % interval"), left_aligned("method"), left_aligned("bound")});
    for (const auto& x : list)
        table.add({x.name, x.unit, significant(x.start, 4), with_digits_of(x.value, x.sd),
                   is_untold(x)          ? "not told"
                   : std::isfinite(x.sd) ? significant(x.sd, 2)
                   : is_held(x)          ? "held"
                                         : "undefined",
                   interval(x), std::string(name(x.interval_method)),
                   x.at_bound == estimator::BoundSide::none ? "" : fmt::format("at {}", name(x.at_bound))});
    return table.text();
}

/// How far start and value are from known values, in percent as the literature gives it, and in standard deviations.
std::string reference_table(const estimator::Estimate& estimate, const ResultContext& context) {
    SummaryTable table({left_aligned("name"), "reference", "value", "start deviates", "value deviates", "in sds"});
    for (const auto* list : {&estimate.parameters, &estimate.derived}) {
        for (const auto& x : *list) {
            const auto known = context.reference.find(x.name);
            if (known == context.reference.end()) continue;
            const double reference = known->second;
            const double in_sds = x.sd > 0.0 ? (x.value - reference) / x.sd : nan;
            table.add({x.name, significant(reference, 8), with_digits_of(x.value, x.sd),
                       percent(relative_deviation(x.start, reference)), percent(relative_deviation(x.value, reference)),
                       std::isfinite(in_sds) ? fmt::format("{:+.2f}", in_sds) : ""});
        }
    }
    return table.text();
}

/// "student_t, dof 3.1 ± 0.4"; nothing for the usual normal errors.
std::string errors_text(const estimator::EstimatedScale& scale) {
    if (scale.distribution == "normal" && scale.shape.empty()) return {};
    std::string out = scale.distribution;
    for (const estimator::Estimated& parameter : scale.shape) {
        out += fmt::format(", {} {}", parameter.name, with_digits_of(parameter.value, parameter.sd));
        if (parameter.sd > 0.0) out += fmt::format(" ± {}", significant(parameter.sd, 2));
    }
    return out;
}

std::string scale_table(const std::vector<estimator::EstimatedScale>& scales) {
    SummaryTable table({left_aligned("group"), "records", "rms", left_aligned("unit"), left_aligned("errors"), "sd",
                        "factor", "±", "lag-1", "worth about"});
    for (const auto& scale : scales) {
        const bool ordered = std::isfinite(scale.lag1);
        table.add({scale.group, fmt::format("{}", scale.count), significant(scale.rms, 4), scale.unit,
                   errors_text(scale), scale.factor ? "" : significant(scale.value, 4),
                   scale.factor ? significant(scale.value, 4) : "",
                   scale.estimated ? significant(scale.uncertainty, 2) : "fixed",
                   ordered ? fmt::format("{:.3f}", scale.lag1) : "",
                   ordered ? fmt::format("{:.0f} values", scale.effective_count) : ""});
    }
    return table.text();
}

std::string covariance_table(const std::vector<estimator::EstimatedCovariance>& covariances) {
    SummaryTable table({left_aligned("groups"), "covariance", "±", "correlation"});
    for (const auto& covariance : covariances) {
        const Eigen::MatrixXd& v = covariance.value;
        for (Eigen::Index j = 0; j < v.cols(); ++j) {
            for (Eigen::Index i = j; i < v.rows(); ++i) {
                const auto& row = covariance.groups[static_cast<std::size_t>(i)];
                const auto& column = covariance.groups[static_cast<std::size_t>(j)];
                table.add({i == j ? row : fmt::format("{}, {}", column, row), significant(v(i, j), 5),
                           significant(covariance.uncertainty(i, j), 2),
                           i == j ? "" : fmt::format("{:+.3f}", v(i, j) / std::sqrt(v(i, i) * v(j, j)))});
            }
        }
    }
    return table.text();
}

/// What a reader must know before trusting a number above.
std::string remarks(const estimator::Estimate& estimate, const ResultContext& context) {
    std::string out;
    if (const std::string lost = lost_records(estimate.counts, context.steady_states); !lost.empty())
        out += fmt::format("  {}.\n{}", lost,
                           too_few_used(estimate.counts)
                               ? "  Too few are left: the estimate does not stand for the data. Start the parameters "
                                 "nearer, or give\n  these records starts of their own.\n"
                               : "");
    for (const auto& x : estimate.parameters) {
        if (x.at_bound != estimator::BoundSide::none)
            out += fmt::format("  {} lies at its {} bound; the other uncertainties hold for {} held there.\n", x.name,
                               name(x.at_bound), x.name);
    }
    for (const auto& x : estimate.parameters) {
        // Half: below it the prior says more than the data. One thousandth: what shows in no digit of the value.
        if (x.data_share < 1e-3) {
            // Where no prior decides either, the section on what the data do not determine says it.
            if (std::isfinite(x.sd)) out += fmt::format("  {} is decided by the prior alone.\n", x.name);
        } else if (x.data_share < 0.5) {
            out += fmt::format("  {}: the data bring {:.2g} % of its information, the prior the rest.\n", x.name,
                               100.0 * x.data_share);
        }
    }
    std::vector<std::string> biases;
    for (const auto& x : estimate.parameters)
        if (x.bias != 0.0) biases.push_back(fmt::format("{} {:+.2f}", x.name, x.bias / x.sd));
    if (!biases.empty())
        out += fmt::format("  Taken off, the bias that errors of readings give by the course, in sds: {}.\n",
                           fmt::join(biases, ", "));
    for (const auto& scale : estimate.scales) {
        if (std::isfinite(scale.lag1) && scale.effective_count < 0.5 * static_cast<double>(scale.count))
            out += fmt::format("  {}: {} autocorrelated records are worth about {:.0f} independent values.\n",
                               scale.group, scale.count, scale.effective_count);
    }
    const auto sandwich = [](const auto& x) { return x.interval_method == estimator::IntervalMethod::sandwich; };
    if (std::any_of(estimate.parameters.begin(), estimate.parameters.end(), sandwich))
        out += "  Intervals are from a sandwich: the long-run variance of the scores, or the scatter over blocks.\n";
    const auto widened = [](const auto& x) {
        return x.interval_method == estimator::IntervalMethod::too_few_independent;
    };
    if (std::any_of(estimate.parameters.begin(), estimate.parameters.end(), widened))
        out +=
            "  The residuals repeat each other over most of the record: too few independent values are left for an\n"
            "  interval where none is given. The model misses something, or the record is too short for it.\n";
    if (!estimate.trust_normal)
        out += fmt::format(
            "  The normal approximation of the posterior is doubtful{}{}:\n"
            "  take sds and intervals as orders of size; \"profile\", \"marginals\" or \"posterior\" say more.\n",
            estimate.distrust.empty() ? "" : ": ", estimate.distrust);
    return out;
}

std::string null_directions(const estimator::Estimate& estimate) {
    std::string out;
    for (const auto& direction : estimate.null_directions) {
        const auto components = named_components(direction, estimate.parameters);
        if (components.empty()) continue;
        std::string names;
        std::string sizes;
        for (const auto& [name, component] : components) {
            names += (names.empty() ? "" : ", ") + name;
            sizes += fmt::format("{}{:+.3g}", sizes.empty() ? "" : " : ", component);
        }
        out += components.size() == 1 ? fmt::format("  {} has no effect on the data.\n", names)
                                      : fmt::format(
                                            "  {} cannot be told apart: changing them together by {} (relative)\n"
                                            "  leaves every residual as it is. Hold one of them, or give it a prior.\n",
                                            names, sizes);
        if (!direction.told.empty()) out += fmt::format("  Told: {}.\n", direction.told);
    }
    for (const auto& direction : estimate.sloppy_directions) {
        std::string names;
        for (std::size_t i = 0; i < estimate.parameters.size(); ++i)
            if (direction.components[static_cast<Eigen::Index>(i)] != 0.0)
                names += (names.empty() ? "" : ", ") + estimate.parameters[i].name;
        out += direction.told.empty()
                   ? fmt::format("  {} is known only within a factor e^{:.3g} (sd of its logarithm).\n", names,
                                 direction.sd)
                   : fmt::format(
                         "  {} are hardly told apart (sd of the logarithm along their direction {:.3g}).\n"
                         "  Told: {}.\n",
                         names, direction.sd, direction.told);
    }
    return out;
}

std::string counts_table(const std::vector<estimator::ResidualCount>& counts) {
    SummaryTable table({left_aligned("residuals"), "used", "lost", "rejected", "added"});
    for (const auto& count : counts)
        table.add({count.type, std::to_string(count.used), std::to_string(count.lost), std::to_string(count.rejected),
                   std::to_string(count.added)});
    return table.text();
}

std::string orbits_line(const ResultContext& context) {
    if (context.orbits_found.empty() && context.orbits_missing.empty()) return "";
    std::string out;
    for (const auto& [period, count] : context.orbits_found)
        out += fmt::format("{}period {}: {}", out.empty() ? "  " : ", ", period, count);
    for (const int period : context.orbits_missing)
        out += fmt::format("{}period {}: none found", out.empty() ? "  " : ", ", period);
    return out + '\n';
}

/// Whether the rms over the fitted segments together is another than that of the errors in the estimate.
bool differs_from_errors(const std::vector<Prediction>& predictions,
                         const std::vector<estimator::EstimatedScale>& scales) {
    std::map<std::pair<std::string, std::string>, std::pair<double, double>> sums;  // squares and readings
    for (const Prediction& one : predictions) {
        for (std::size_t c = 0; one.fitted && c < one.rms.size(); ++c) {
            const auto& [coordinate, rms] = one.rms[c];
            if (!std::isfinite(rms)) continue;
            auto& [squares, count] = sums[{one.experiment, coordinate}];
            const double readings = c < one.readings.size() ? static_cast<double>(one.readings[c]) : 1.0;
            squares += readings * rms * rms;
            count += readings;
        }
    }
    for (const auto& [which, sum] : sums) {
        if (!(sum.second > 0.0)) continue;
        const double rms = std::sqrt(sum.first / sum.second);
        for (const estimator::EstimatedScale& scale : scales)
            if ((scale.group == "series." + which.second ||
                 scale.group == fmt::format("series.{}.{}", which.first, which.second)) &&
                !(std::abs(rms - scale.rms) <= 1e-3 * scale.rms))
                return true;
    }
    return false;
}

std::string prediction_table(const std::vector<Prediction>& predictions,
                             const std::vector<estimator::EstimatedScale>& scales) {
    SummaryTable table(
        {left_aligned("experiment"), left_aligned("segment"), left_aligned(""), left_aligned("rms"), "rms / error sd"});
    for (const auto& prediction : predictions) {
        std::string rms;
        // Coordinates without a reading in this segment have no rms.
        for (const auto& [coordinate, value] : prediction.rms)
            if (std::isfinite(value)) rms += fmt::format("{}{} {:.4g}", rms.empty() ? "" : ", ", coordinate, value);
        if (rms.empty()) rms = "the model cannot be simulated over all of it";
        table.add({prediction.experiment, prediction.segment, prediction.fitted ? "fitted" : "predicted", rms,
                   significant(prediction.normalised_rms, 3)});
    }
    std::string out = table.text();
    if (differs_from_errors(predictions, scales))
        out +=
            "  fitted: over each whole segment from one initial state, which is fitted to these readings alone; "
            "\"Errors\"\n  has the rms of the estimate itself, with its intervals and priors\n";
    for (const auto& prediction : predictions) {
        if (prediction.fitted) continue;
        const std::string said = judgement(prediction.normalised_rms);
        if (!said.empty())
            out += fmt::format("  {}, segment {}: {}\n", prediction.experiment, prediction.segment, said);
    }
    return out;
}

}  // namespace

std::string estimate_summary(const estimator::Estimate& estimate, const ResultContext& context,
                             std::string_view title) {
    std::string out = title.empty() ? "" : fmt::format("{}\n", title);
    out +=
        fmt::format("{}{}{} ({} iterations, {} evaluations)\n", estimator::name(estimate.status),
                    estimate.message.empty() ? "" : ": ", estimate.message, estimate.iterations, estimate.evaluations);
    out += fmt::format("Verdict: {}\n", trust_verdict(estimate, context).line());
    out += stages_summary(context.strategy);
    out += titled("Parameters", estimated_table(estimate.parameters));
    out += titled("Derived", estimated_table(estimate.derived));
    out += titled("Against known values", reference_table(estimate, context));
    out += titled("Errors", scale_table(estimate.scales));
    out += titled("Covariances of errors", covariance_table(estimate.covariances));
    out += matching_summary(context.strategy);
    out += titled("Not determined by the data", null_directions(estimate));
    out += titled("Remarks", remarks(estimate, context));
    out += titled("Cycles in the data", orbits_line(context));
    out += titled("Used", counts_table(estimate.counts));
    out += titled("Prediction", prediction_table(context.predictions, estimate.scales));
    out += criticism_summary(context.strategy);
    return out + posterior_summary(context.posterior);
}

}  // namespace orbid::apps
