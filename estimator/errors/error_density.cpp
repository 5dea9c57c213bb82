#include "estimator/errors/error_density.hpp"

#include <boost/math/special_functions/digamma.hpp>
#include <boost/math/special_functions/gamma.hpp>

namespace orbid::estimator::detail {

double student_normalisation(double nu) {
    // The ratio directly: the difference of two ln Gamma has lost five digits at nu = 1e4. In double, not extended
    // precision: it is computed once per block, and took an eighth of the time of a long chain.
    using plain = boost::math::policies::policy<boost::math::policies::promote_double<false>>;
    return 0.5 * std::log(nu * std::numbers::pi) + std::log(boost::math::tgamma_delta_ratio(0.5 * nu, 0.5, plain()));
}

std::complex<double> student_normalisation(const std::complex<double>& nu) {
    return lift(
        nu, [](double x) { return student_normalisation(x); },
        [](double x) { return 0.5 / x + 0.5 * (boost::math::digamma(0.5 * x) - boost::math::digamma(0.5 * x + 0.5)); });
}

}  // namespace orbid::estimator::detail
