#include "periodic/search/symbolic_henon.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace orbid::periodic {

std::optional<Eigen::MatrixXd> henon_start(double a, double b, const std::string& word) {
    using Eigen::Index;
    using Eigen::VectorXd;
    if (word.empty() || word.find_first_not_of("+-") != std::string::npos)
        throw std::invalid_argument("Henon's cycle: the word needs symbols + and -, got \"" + word + "\"");
    const auto p = static_cast<Index>(word.size());
    // The rates are below 2 |a| |x| + 1 + |b|: explicit steps of half the limit of stability at the largest |x|.
    const double largest =
        (1.0 + std::abs(b) + std::sqrt((1.0 + std::abs(b)) * (1.0 + std::abs(b)) + 4.0 * std::abs(a))) /
        (2.0 * std::max(std::abs(a), 1e-3));  // all cycles lie within (Henon 1976)
    const double step = 1.0 / (2.0 * std::abs(a) * largest + 1.0 + std::abs(b));
    constexpr int most = 100000;  // a cycle at its fold is approached as 1 / s
    constexpr double at_rest = 1e-11;
    VectorXd signs(p);
    for (Index n = 0; n < p; ++n)
        signs(n) = word[static_cast<std::size_t>(n)] == '+' ? 1.0 : -1.0;
    VectorXd x = VectorXd::Zero(p);
    for (int k = 0; k < most; ++k) {
        VectorXd rate(p);
        for (Index n = 0; n < p; ++n)
            rate(n) = signs(n) * (1.0 - a * x(n) * x(n) + b * x((n + p - 1) % p) - x((n + 1) % p));
        x += step * rate;
        if (!(x.cwiseAbs().maxCoeff() < 2.0 * largest)) return std::nullopt;
        if (rate.cwiseAbs().maxCoeff() > at_rest) continue;
        Eigen::MatrixXd states(2, p);
        for (Index n = 0; n < p; ++n)
            states.col(n) << x(n), b * x((n + p - 1) % p);
        return states;
    }
    return std::nullopt;
}

}  // namespace orbid::periodic
