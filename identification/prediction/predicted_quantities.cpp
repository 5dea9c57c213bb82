#include <algorithm>
#include <cmath>
#include <limits>

#include "identification/prediction/predicted_motion.hpp"

namespace orbid::identification {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double normal95 = 1.959963984540054;

/// Between the order statistics next to it, (k + 1/2) / n for the k-th of n.
double sample_quantile(const std::vector<double>& sorted, double probability) {
    const double place = probability * static_cast<double>(sorted.size()) - 0.5;
    const auto below =
        static_cast<std::size_t>(std::clamp(std::floor(place), 0.0, static_cast<double>(sorted.size() - 1)));
    const std::size_t above = std::min(below + 1, sorted.size() - 1);
    const double share = std::clamp(place - static_cast<double>(below), 0.0, 1.0);
    return (1.0 - share) * sorted[below] + share * sorted[above];
}

}  // namespace

PredictedQuantities summarised(const VectorXd& value, const Eigen::MatrixXd& drawn, const VectorXd& delta_sd) {
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    PredictedQuantities all{value, VectorXd::Constant(value.size(), unknown), {}, {}, delta_sd, 0, unknown};
    all.lower95 = all.upper95 = all.sd;
    all.found = static_cast<std::size_t>(drawn.cols());
    for (Index i = 0; i < value.size(); ++i) {
        std::vector<double> draws;
        for (Index k = 0; k < drawn.cols(); ++k)
            if (std::isfinite(drawn(i, k))) draws.push_back(drawn(i, k));
        if (draws.size() < 2) continue;
        double mean = 0.0, squares = 0.0;
        for (const double x : draws)
            mean += x / static_cast<double>(draws.size());
        for (const double x : draws)
            squares += (x - mean) * (x - mean);
        all.sd(i) = std::sqrt(squares / static_cast<double>(draws.size() - 1));
        if (draws.size() < fewest_draws) continue;
        std::sort(draws.begin(), draws.end());
        all.lower95(i) = sample_quantile(draws, 0.025);
        all.upper95(i) = sample_quantile(draws, 0.975);
    }
    return all;
}

PredictedQuantities by_delta_method(const VectorXd& value, const VectorXd& delta_sd) {
    PredictedQuantities all = summarised(value, Eigen::MatrixXd(value.size(), 0), delta_sd);
    all.sd = delta_sd;
    all.lower95 = value - normal95 * delta_sd;
    all.upper95 = value + normal95 * delta_sd;
    return all;
}

}  // namespace orbid::identification
