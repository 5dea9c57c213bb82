#include "estimator/exploration/unit_error.hpp"

#include <cmath>
#include <variant>

#include <boost/math/distributions/students_t.hpp>

#include "estimator/errors/error_density.hpp"

namespace orbid::estimator {

double unit_error(const ErrorDistribution& distribution, double shape, const double* before, RandomStream& random) {
    if (std::holds_alternative<StudentErrors>(distribution))
        return boost::math::quantile(boost::math::students_t(shape), random.uniform());
    if (std::holds_alternative<LaplaceErrors>(distribution)) {
        // Laplace's own density, taken with the ratio of the rounded one to it: all but one in a hundred.
        while (true) {
            const double side = random.uniform(-1.0, 1.0);
            const double size = -std::log(1.0 - std::abs(side));
            const double rounded = std::hypot(size, detail::laplace_rounding);
            if (random.uniform() < std::exp(size - rounded)) return std::copysign(size, side);
        }
    }
    const double normal = random.normal();
    if (!std::holds_alternative<AutoregressiveErrors>(distribution) || before == nullptr) return normal;
    return shape * *before + std::sqrt(1.0 - shape * shape) * normal;
}

bool has_unit_square(const ErrorDistribution& distribution) {
    return !std::holds_alternative<StudentErrors>(distribution) && !std::holds_alternative<LaplaceErrors>(distribution);
}

}  // namespace orbid::estimator
