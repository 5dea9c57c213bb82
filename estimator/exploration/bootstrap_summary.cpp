#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "estimator/exploration/bootstrap.hpp"
#include "estimator/interface/not_finite.hpp"
#include "estimator/problem/coordinate.hpp"

namespace orbid::estimator {

namespace {

/// Of sorted values, between two of them; the ends below 1 / (n + 1).
double sample_quantile(const std::vector<double>& sorted, double p) {
    const double place = p * static_cast<double>(sorted.size() + 1) - 1.0;
    if (place <= 0.0) return sorted.front();
    const auto below = static_cast<std::size_t>(place);
    if (below + 1 >= sorted.size()) return sorted.back();
    const double share = place - static_cast<double>(below);
    return sorted[below] + share * (sorted[below + 1] - sorted[below]);
}

/// Values of one quantity over the replicates that count.
struct Scatter {
    std::vector<double> values;
    std::vector<double> sds;
};

void add_moments(const Scatter& scatter, BootstrapQuantity& quantity) {
    const auto count = static_cast<double>(scatter.values.size());
    if (count < 2.0) return;
    double mean = 0.0;
    for (const double value : scatter.values)
        mean += (value - quantity.value) / count;
    double squares = 0.0;
    for (const double value : scatter.values)
        squares += (value - quantity.value - mean) * (value - quantity.value - mean);
    quantity.bias = mean;
    quantity.bootstrap_sd = std::sqrt(squares / (count - 1.0));
    quantity.bias_error = quantity.bootstrap_sd / std::sqrt(count);
}

void add_studentised(const Scatter& scatter, const Coordinate& coordinate, BootstrapQuantity& quantity) {
    const double u = coordinate.at(quantity.value);
    const double sd = quantity.sd / coordinate.slope(quantity.value);
    std::vector<double> t;
    for (std::size_t i = 0; i < scatter.values.size(); ++i) {
        const double own_sd = scatter.sds[i] / coordinate.slope(scatter.values[i]);
        const double one = (coordinate.at(scatter.values[i]) - u) / own_sd;
        if (own_sd > 0.0 && std::isfinite(one)) t.push_back(one);
    }
    const double missing = 1.0 - static_cast<double>(t.size()) / static_cast<double>(scatter.values.size());
    if (missing > most_failed_replicates) {
        quantity.remark = fmt::format("{:.0f} % of the replicates have no sd of it", 100.0 * missing);
        return;
    }
    std::sort(t.begin(), t.end());
    quantity.studentised_lower = coordinate.natural(u - sample_quantile(t, 0.975) * sd);
    quantity.studentised_upper = coordinate.natural(u - sample_quantile(t, 0.025) * sd);
}

void add_intervals(const Scatter& scatter, const Coordinate& coordinate, bool at_bound, BootstrapQuantity& quantity) {
    if (at_bound) {
        quantity.remark = "at its bound, where replicates do not scatter as estimates do";
        return;
    }
    if (!std::isfinite(quantity.sd)) {
        quantity.remark = "not determined by the data";
        return;
    }
    std::vector<double> sorted = scatter.values;
    std::sort(sorted.begin(), sorted.end());
    quantity.percentile_lower = sample_quantile(sorted, 0.025);
    quantity.percentile_upper = sample_quantile(sorted, 0.975);
    if (quantity.sd > 0.0) add_studentised(scatter, coordinate, quantity);
}

/// Quantities in the order of the replicates' values.
class Quantities {
public:
    Quantities(const std::vector<const BootstrapReplicate*>& good, bool refused) : good_(good), refused_(refused) {}

    /// @param value, sd  of the estimate.
    [[nodiscard]] BootstrapQuantity next(const std::string& name, const std::string& unit, double value, double sd,
                                         const Coordinate& coordinate, bool at_bound) {
        const Eigen::Index place = place_++;
        BootstrapQuantity quantity;
        quantity.name = name;
        quantity.unit = unit;
        quantity.value = value;
        quantity.sd = sd;
        Scatter scatter;
        for (const BootstrapReplicate* one : good_) {
            scatter.values.push_back(one->values[place]);
            scatter.sds.push_back(one->sds[place]);
        }
        add_moments(scatter, quantity);
        if (!refused_) add_intervals(scatter, coordinate, at_bound, quantity);
        return quantity;
    }

private:
    const std::vector<const BootstrapReplicate*>& good_;
    bool refused_;
    Eigen::Index place_ = 0;
};

void count_failure(const BootstrapReplicate& replicate, Bootstrap& result) {
    ++result.failed;
    const auto found = std::find_if(result.failures.begin(), result.failures.end(),
                                    [&](const BootstrapFailure& one) { return one.status == replicate.status; });
    if (found == result.failures.end())
        result.failures.push_back({replicate.status, 1, replicate.message});
    else
        ++found->count;
}

std::string refusal(const Bootstrap& result, std::size_t good) {
    const std::size_t run = result.replicates.size();
    if (run < result.asked) return fmt::format("stopped after {} of {} replicates", run, result.asked);
    const double share = static_cast<double>(result.failed) / static_cast<double>(run);
    if (share > most_failed_replicates)
        return fmt::format("{} of {} replicates failed, more than {:.0f} %: those missing may be a whole tail",
                           result.failed, run, 100.0 * most_failed_replicates);
    if (good < least_replicates)
        return fmt::format("{} replicates did not fail, fewer than {}: ask for more", good, least_replicates);
    return {};
}

}  // namespace

Bootstrap bootstrap_summary(const std::vector<FreeParameter>& parameters, const Estimate& estimate,
                            std::vector<BootstrapReplicate> replicates, std::size_t asked) {
    Bootstrap result;
    result.asked = asked;
    result.replicates = std::move(replicates);
    std::sort(result.replicates.begin(), result.replicates.end(),
              [](const auto& a, const auto& b) { return a.number < b.number; });
    std::vector<const BootstrapReplicate*> good;
    for (const BootstrapReplicate& replicate : result.replicates) {
        result.evaluations += replicate.evaluations / static_cast<double>(result.replicates.size());
        const bool counts = replicate.status == EstimateStatus::converged ||
                            (replicate.status == EstimateStatus::singular && estimate.status == replicate.status);
        if (counts && replicate.values.allFinite())
            good.push_back(&replicate);
        else
            count_failure(replicate, result);
    }
    result.refused = refusal(result, good.size());
    Quantities quantities(good, !result.refused.empty());
    for (std::size_t i = 0; i < estimate.parameters.size(); ++i) {
        const Estimated& one = estimate.parameters[i];
        // A tied parameter has the scale of the one that it follows, up to the sign.
        const Coordinate coordinate = parameters[i].tied_to.empty() ? coordinate_of(parameters[i]) : Coordinate{};
        result.parameters.push_back(
            quantities.next(one.name, one.unit, one.value, one.sd, coordinate, one.at_bound != BoundSide::none));
    }
    for (const Estimated& one : estimate.derived)
        result.derived.push_back(quantities.next(one.name, one.unit, one.value, one.sd, {}, false));
    Coordinate logarithmic;
    logarithmic.scale = Scale::log;
    for (const EstimatedScale& scale : estimate.scales) {
        if (!scale.estimated) continue;
        const bool held = scale.interval_method == IntervalMethod::none;
        result.errors.push_back(
            quantities.next(scale.group + ".scale", scale.unit, scale.value, scale.uncertainty, logarithmic, held));
    }
    return result;
}

}  // namespace orbid::estimator
