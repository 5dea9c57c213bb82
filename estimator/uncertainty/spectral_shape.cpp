#include "estimator/uncertainty/spectral_shape.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace orbid::estimator {

namespace {

constexpr Eigen::Index least_values = 8;
constexpr Eigen::Index largest_order = 4;

/// phi of x_t = sum_k phi_k x_{t-k} + e_t.
Eigen::VectorXd autoregression(const Eigen::VectorXd& values) {
    const Eigen::Index n = values.size();
    const Eigen::Index most = std::clamp<Eigen::Index>(n / 8, 1, largest_order);
    Eigen::VectorXd product(most + 1);
    for (Eigen::Index lag = 0; lag <= most; ++lag)
        product[lag] = values.head(n - lag).dot(values.tail(n - lag));
    Eigen::VectorXd phi(0);
    Eigen::VectorXd best(0);
    double rest = product[0];
    double least = 0.0;
    const auto count = static_cast<double>(n);
    for (Eigen::Index order = 1; order <= most && rest > 0.0; ++order) {
        double reflected = product[order];
        for (Eigen::Index k = 0; k < phi.size(); ++k)
            reflected -= phi[k] * product[order - 1 - k];
        reflected /= rest;
        Eigen::VectorXd next(order);
        next.head(order - 1) = phi - reflected * phi.reverse();
        next[order - 1] = reflected;
        phi = next;
        rest *= 1.0 - reflected * reflected;
        const double criterion = count * std::log(rest / product[0]) + static_cast<double>(order) * std::log(count);
        if (best.size() == 0 || criterion < least) {
            least = criterion;
            best = phi;
        }
    }
    return best;
}

}  // namespace

std::vector<double> spectral_shape(const Eigen::VectorXd& values, Eigen::Index most) {
    std::vector<double> shape(static_cast<std::size_t>(most), 1.0);
    if (values.size() < least_values || !(values.squaredNorm() > 0.0)) return shape;
    const Eigen::VectorXd phi = autoregression(values);
    const double at_zero = std::pow(1.0 - phi.sum(), 2);
    double sum = 0.0;
    for (Eigen::Index j = 1; j <= most; ++j) {
        const double w = std::numbers::pi * static_cast<double>(j) / static_cast<double>(values.size());
        std::complex<double> transfer = 1.0;
        for (Eigen::Index k = 0; k < phi.size(); ++k)
            transfer -= phi[k] * std::polar(1.0, -w * static_cast<double>(k + 1));
        sum += at_zero / std::norm(transfer);
        shape[static_cast<std::size_t>(j - 1)] = sum / static_cast<double>(j);
    }
    return shape;
}

Eigen::Index flat_frequencies(const std::vector<double>& shape, double tolerance) {
    const auto off = std::find_if(shape.begin(), shape.end(),
                                  [tolerance](double value) { return !(std::abs(value - 1.0) <= tolerance); });
    return std::max<Eigen::Index>(1, off - shape.begin());
}

}  // namespace orbid::estimator
