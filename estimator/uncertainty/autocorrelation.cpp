#include "estimator/uncertainty/autocorrelation.hpp"

#include <algorithm>
#include <cmath>

namespace orbid::estimator {

Autocorrelation autocorrelation(const std::vector<Eigen::VectorXd>& sequences) {
    Autocorrelation result;
    Eigen::Index count = 0;
    Eigen::Index longest = 0;
    double square = 0.0;
    for (const Eigen::VectorXd& e : sequences) {
        count += e.size();
        longest = std::max(longest, e.size());
        square += e.squaredNorm();
    }
    if (longest < 3 || !(square > 0.0)) return result;
    // Correlation at a lag: mean product over the pairs there are, over the mean square.
    const auto correlation = [&](Eigen::Index lag) {
        double product = 0.0;
        Eigen::Index pairs = 0;
        for (const Eigen::VectorXd& e : sequences) {
            if (e.size() <= lag) continue;
            product += e.head(e.size() - lag).dot(e.tail(e.size() - lag));
            pairs += e.size() - lag;
        }
        return pairs > 0 ? product / static_cast<double>(pairs) / (square / static_cast<double>(count)) : 0.0;
    };
    result.lag1 = std::clamp(correlation(1), -1.0, 1.0);
    result.significant = std::abs(result.lag1) * std::sqrt(static_cast<double>(count)) > 3.0;
    // A correlation of one (a constant) leaves one record's worth per sequence.
    const double most = static_cast<double>(longest);
    result.autoregressive = std::clamp((1.0 + result.lag1) / std::max(1.0 - result.lag1, 1e-300), 0.0, most);
    double tau = 1.0;
    // A series whose correlation does not decay would take the square of its length; a thousand lags of a long one
    // suffice.
    const Eigen::Index most_lags = std::max<Eigen::Index>(1000, 200'000'000 / std::max<Eigen::Index>(count, 1));
    for (Eigen::Index lag = 1; lag < std::min(longest / 2, most_lags); ++lag) {
        tau += 2.0 * correlation(lag);
        if (static_cast<double>(lag) >= 5.0 * tau) break;
    }
    result.windowed = std::clamp(tau, 0.0, most);
    if (result.significant) result.records = std::max({1.0, result.windowed, result.autoregressive});
    return result;
}

}  // namespace orbid::estimator
