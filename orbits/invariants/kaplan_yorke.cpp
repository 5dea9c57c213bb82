#include "orbits/invariants/kaplan_yorke.hpp"

#include <cmath>

namespace orbid::orbits {

double kaplan_yorke_dimension(const Eigen::VectorXd& exponents) {
    double sum = 0.0;
    for (Eigen::Index j = 0; j < exponents.size(); ++j) {
        const double next = sum + exponents[j];
        if (std::isnan(next)) return next;
        if (next < 0.0) return static_cast<double>(j) + sum / -exponents[j];
        sum = next;
    }
    return static_cast<double>(exponents.size());
}

}  // namespace orbid::orbits
