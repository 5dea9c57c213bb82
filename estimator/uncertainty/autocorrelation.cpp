#include "estimator/uncertainty/autocorrelation.hpp"

#include <algorithm>
#include <cmath>

#include <boost/math/distributions/chi_squared.hpp>

namespace orbid::estimator {

namespace {

/// Products of residuals at a distance, summed over all pairs there are.
struct LagProducts {
    double sum = 0.0;
    Eigen::Index pairs = 0;
};

LagProducts lag_products(const std::vector<Eigen::VectorXd>& sequences, Eigen::Index lag) {
    LagProducts result;
    for (const Eigen::VectorXd& e : sequences) {
        if (e.size() <= lag) continue;
        result.sum += e.head(e.size() - lag).dot(e.tail(e.size() - lag));
        result.pairs += e.size() - lag;
    }
    return result;
}

}  // namespace

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
        const auto [product, pairs] = lag_products(sequences, lag);
        return pairs > 0 ? product / static_cast<double>(pairs) / (square / static_cast<double>(count)) : 0.0;
    };
    result.lag1 = std::clamp(correlation(1), -1.0, 1.0);
    result.significant = std::abs(result.lag1) * std::sqrt(static_cast<double>(count)) > 3.0;
    if (!result.significant) return result;
    // A correlation of one (a constant) leaves one record's worth per sequence.
    const double most = static_cast<double>(longest);
    const double autoregressive = std::clamp((1.0 + result.lag1) / std::max(1.0 - result.lag1, 1e-300), 0.0, most);
    double tau = 1.0;
    // A correlation that does not decay would take the square of the length; a thousand lags of a long one suffice.
    const Eigen::Index most_lags = std::max<Eigen::Index>(1000, 200'000'000 / std::max<Eigen::Index>(count, 1));
    for (Eigen::Index lag = 1; lag < std::min(longest / 2, most_lags); ++lag) {
        tau += 2.0 * correlation(lag);
        if (static_cast<double>(lag) >= 5.0 * tau) break;
    }
    result.records = std::max({1.0, std::clamp(tau, 0.0, most), autoregressive});
    return result;
}

TestResult ljung_box(const std::vector<Eigen::VectorXd>& sequences, int lags) {
    double count = 0.0;
    double square = 0.0;
    for (const Eigen::VectorXd& e : sequences) {
        count += static_cast<double>(e.size());
        square += e.squaredNorm();
    }
    if (lags < 1 || count < lags + 2.0 || !(square > 0.0) || !std::isfinite(square)) return undefined_test;
    double sum = 0.0;
    int terms = 0;
    for (int lag = 1; lag <= lags; ++lag) {
        const auto [product, pairs] = lag_products(sequences, lag);
        if (pairs == 0) continue;
        sum += product / square * (product / square) / static_cast<double>(pairs);
        ++terms;
    }
    if (terms == 0) return undefined_test;
    const double statistic = count * (count + 2.0) * sum;
    const boost::math::chi_squared_distribution<double> reference(terms);
    return {statistic, boost::math::cdf(boost::math::complement(reference, statistic))};
}

TestResult runs_test(const std::vector<Eigen::VectorXd>& sequences) {
    double runs = 0.0;
    double mean = 0.0;
    double variance = 0.0;
    for (const Eigen::VectorXd& e : sequences) {
        double positive = 0.0;
        double negative = 0.0;
        int last = 0;
        double here = 0.0;
        for (const double value : e) {
            const int sign = value > 0.0 ? 1 : value < 0.0 ? -1 : 0;
            if (sign == 0) continue;
            (sign > 0 ? positive : negative) += 1.0;
            if (sign != last) here += 1.0;
            last = sign;
        }
        if (!(positive > 0.0) || !(negative > 0.0)) continue;
        const double n = positive + negative;
        const double twice = 2.0 * positive * negative;
        runs += here;
        mean += twice / n + 1.0;
        variance += twice * (twice - n) / (n * n * (n - 1.0));
    }
    if (!(variance > 0.0)) return undefined_test;
    const double z = (runs - mean) / std::sqrt(variance);
    return {z, two_sided(z)};
}

}  // namespace orbid::estimator
