#pragma once

#include <cassert>
#include <cmath>
#include <numbers>

#include <Eigen/Core>
#include <boost/math/special_functions/digamma.hpp>
#include <boost/math/special_functions/gamma.hpp>

#include "models/arithmetic/dual.hpp"

/// @cond
// Matrices of dual numbers.
template <>
struct Eigen::NumTraits<orbid::models::Dual<1>> : Eigen::NumTraits<double> {
    using Real = orbid::models::Dual<1>;
    using NonInteger = Real;
    using Nested = Real;
    enum { ReadCost = 2, AddCost = 2, MulCost = 4 };
};
/// @endcond

namespace orbid::estimator::detail {

/// A number with its derivative with respect to one error parameter.
using Slope = models::Dual<1>;

/// Whether a slope depends on x; a value always does.
inline bool varies(double /*x*/) {
    return true;
}
inline bool varies(const Slope& x) {
    return x.partial[0] != 0.0;
}

/// f(x) for a real function f with derivative df that the library knows for plain numbers only.
template <class F, class D>
double lift(double x, const F& f, const D& /*df*/) {
    return f(x);
}
template <class F, class D>
Slope lift(const Slope& x, const F& f, const D& df) {
    return varies(x) ? x.chained(f(x.value), df(x.value)) : Slope(f(x.value));
}

/// ln cosh x = |x| + ln(1 + exp(-2|x|)) - ln 2, without overflow.
template <class T>
T ln_cosh(const T& x) {
    return lift(
        x, [](double u) { return std::fabs(u) + std::log1p(std::exp(-2.0 * std::fabs(u))) - std::numbers::ln2; },
        [](double u) { return std::tanh(u); });
}

/// ln of sqrt(nu pi) Gamma(nu / 2) / Gamma((nu + 1) / 2), the normalisation of Student's density.
inline double student_normalisation(double nu) {
    // The ratio directly: the difference of two ln Gamma has lost five digits at nu = 1e4. In double, not extended
    // precision, which takes far longer.
    using plain = boost::math::policies::policy<boost::math::policies::promote_double<false>>;
    return 0.5 * std::log(nu * std::numbers::pi) + std::log(boost::math::tgamma_delta_ratio(0.5 * nu, 0.5, plain()));
}

inline Slope student_normalisation(const Slope& nu) {
    return lift(
        nu, [](double x) { return student_normalisation(x); },
        [](double x) { return 0.5 / x + 0.5 * (boost::math::digamma(0.5 * x) - boost::math::digamma(0.5 * x + 0.5)); });
}

/// Laplace errors: d / s in exp(-sqrt(e^2 + d^2) / s) / (2 d K_1(d / s)).
constexpr double laplace_rounding = 0.01;
/// ln(2 d K_1(d / s)) - ln s at that d; Laplace's own is ln 2 = 0.6931.
constexpr double laplace_normalisation = 0.69288608766112311335;
/// Fisher information of e times s^2: E[e^2 / (e^2 + d^2)] = 1 - Ki_1(0.01) / K_1(0.01), Ki_1 = Bickley's function
/// int_0^inf exp(-z cosh t) / cosh t dt. By double-exponential quadrature in extended precision; Laplace's own is 1.
constexpr double laplace_information = 0.98486019956920763249;

/// L of V = L L^T from its log-Cholesky coordinates: the lower triangle column by column, ln of the diagonal entries.
template <class T>
Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> covariance_triangle(const Eigen::Matrix<T, Eigen::Dynamic, 1>& psi,
                                                                     Eigen::Index m) {
    using std::exp;
    Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> result =
        Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>::Zero(m, m);
    Eigen::Index k = 0;
    for (Eigen::Index j = 0; j < m; ++j)
        for (Eigen::Index i = j; i < m; ++i, ++k)
            result(i, j) = i == j ? T(exp(psi[k])) : psi[k];
    return result;
}

/// e_0 / s, then (e_t - rho e_{t-1}) / (s sqrt(1 - rho^2)), column by column; 1 / sqrt(1 - tanh^2) = cosh.
template <class T>
Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> decorrelated(const Eigen::MatrixXd& rows,
                                                              const Eigen::Matrix<T, Eigen::Dynamic, 1>& psi) {
    using std::cosh;
    using std::exp;
    using std::tanh;
    Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> result(rows.rows(), rows.cols());
    if (rows.rows() == 0) return result;
    const T first = exp(-psi[0]);
    const T rho = tanh(psi[1]);
    const T other = first * cosh(psi[1]);
    result.row(0) = rows.row(0).template cast<T>() * first;
    const Eigen::Index n = rows.rows() - 1;
    result.bottomRows(n) = (rows.bottomRows(n).template cast<T>() - rows.topRows(n).template cast<T>() * rho) * other;
    return result;
}

/// L^-1 times the m responses of each record, by forward substitution over the responses' blocks of rows.
template <class T>
Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> uncoupled(
    const Eigen::MatrixXd& rows, const Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>& triangle) {
    const Eigen::Index m = triangle.rows();
    assert(rows.rows() % m == 0);
    const Eigen::Index n = rows.rows() / m;
    Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic> result(rows.rows(), rows.cols());
    for (Eigen::Index i = 0; i < m; ++i) {
        auto response = result.middleRows(i * n, n);
        response = rows.middleRows(i * n, n).template cast<T>();
        for (Eigen::Index j = 0; j < i; ++j)
            response -= result.middleRows(j * n, n) * triangle(i, j);
        response *= T(1.0) / triangle(i, i);
    }
    return result;
}

}  // namespace orbid::estimator::detail
