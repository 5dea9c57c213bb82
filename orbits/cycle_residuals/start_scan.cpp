#include "orbits/cycle_residuals/start_scan.hpp"

#include <cmath>
#include <stdexcept>
#include <vector>

namespace orbid::orbits {
namespace {

constexpr int sweeps = 2;  // the second sees the others near their place

std::vector<double> ladder(double start, double size) {
    std::vector<double> values;
    if (start != 0.0) {
        for (int k = -12; k <= 12; ++k)
            values.push_back(start * std::pow(2.0, k / 6.0));
    } else {
        for (const double sign : {1.0, -1.0})
            for (int k = -6; k <= 6; ++k)
                values.push_back(sign * size * std::pow(2.0, k / 2.0));
    }
    return values;
}

}  // namespace

Eigen::VectorXd scanned_start(const OnePeriodResidual& residual, const Eigen::VectorXd& start,
                              const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, const Eigen::VectorXd& size) {
    return scanned_start([&](const Eigen::VectorXd& theta) { return residual.misfit(theta); }, start, lower, upper,
                         size);
}

Eigen::VectorXd scanned_start(const std::function<double(const Eigen::VectorXd&)>& misfit_at,
                              const Eigen::VectorXd& start, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper,
                              const Eigen::VectorXd& size) {
    if (lower.size() != start.size() || upper.size() != start.size() || size.size() != start.size())
        throw std::invalid_argument("scanned_start: start, lower, upper and size must have one value per parameter");
    Eigen::VectorXd best = start;
    double best_misfit = misfit_at(best);
    for (int sweep = 0; sweep < sweeps; ++sweep)
        for (Eigen::Index i = 0; i < start.size(); ++i) {
            // Both sweeps climb the ladder about the start, so that nothing runs away.
            for (const double value : ladder(start(i), size(i))) {
                if (!(value >= lower(i) && value <= upper(i))) continue;
                Eigen::VectorXd trial = best;
                trial(i) = value;
                const double misfit = misfit_at(trial);
                if (!(misfit < best_misfit)) continue;
                best_misfit = misfit;
                best = trial;
            }
        }
    return best;
}

}  // namespace orbid::orbits
