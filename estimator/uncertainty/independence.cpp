#include "estimator/uncertainty/independence.hpp"

#include <cmath>
#include <numbers>

#include <boost/math/distributions/chi_squared.hpp>

#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

TestResult ljung_box(const std::vector<Eigen::VectorXd>& sequences, int lags) {
    double count = 0.0;
    double square = 0.0;
    for (const Eigen::VectorXd& e : sequences) {
        count += static_cast<double>(e.size());
        square += e.squaredNorm();
    }
    if (lags < 1 || count < lags + 2.0 || !(square > 0.0) || !std::isfinite(square)) return {nan_value, nan_value};
    double sum = 0.0;
    int terms = 0;
    for (int lag = 1; lag <= lags; ++lag) {
        double product = 0.0;
        double pairs = 0.0;
        for (const Eigen::VectorXd& e : sequences) {
            if (e.size() <= lag) continue;
            product += e.head(e.size() - lag).dot(e.tail(e.size() - lag));
            pairs += static_cast<double>(e.size() - lag);
        }
        if (!(pairs > 0.0)) continue;
        sum += product / square * (product / square) / pairs;
        ++terms;
    }
    if (terms == 0) return {nan_value, nan_value};
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
    if (!(variance > 0.0)) return {nan_value, nan_value};
    const double z = (runs - mean) / std::sqrt(variance);
    return {z, std::erfc(std::abs(z) / std::numbers::sqrt2)};
}

}  // namespace orbid::estimator
