#include "estimator/errors/noise_model.hpp"

#include <cassert>
#include <cmath>
#include <numbers>
#include <type_traits>
#include <utility>

#include <boost/math/special_functions/gamma.hpp>

#include "estimator/errors/error_density.hpp"
#include "models/arithmetic/cholesky_factor.hpp"

namespace orbid::estimator {

namespace {

using detail::Slope;
using models::value_of;

constexpr double ln_two_pi = 1.8378770664093454836;

/// A density that is not log-concave has its second derivative replaced by this fraction of the weight g / e where it
/// is smaller. (For relative errors: of the expected information.) Reweighting with the weight itself always descends,
/// but converges like a geometric series. With a tenth of it a far record may pull ten times as far; a line search or
/// trust region guards against that.
constexpr double least_share = 0.1;
/// The hyperbolic density is log-concave, but nearly flat away from its cusp. Steps of median regressions on three
/// regressors with backtracking, 50 samples each of 20, 50 and 200 records. With the weight itself 114-146 on average,
/// often more than 500. With a tenth of it 16-38. With a thousandth 9-11, never more than 23.
constexpr double least_share_laplace = 1e-3;
/// Curvature::guarded: below this fraction of the weight the step would be more than twice the error.
constexpr double mirror_share = 0.5;

template <class T>
T step_share(const T& share, double least, Curvature curvature) {
    if (curvature == Curvature::guarded) return value_of(share) > mirror_share ? share : T(1.0);
    return value_of(share) > least ? share : T(least);
}

template <class T>
using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;
template <class T>
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;

/// WhitenedRows of plain numbers; of dual ones the slopes of the rows, and the value.
template <class T>
struct Rows {
    Eigen::MatrixXd rows;
    T value{};
};

/// What Rows holds of these numbers.
double held(double x) {
    return x;
}
double held(const Slope& x) {
    return x.partial[0];
}
template <class T>
Eigen::MatrixXd held(const Matrix<T>& rows) {
    return rows.unaryExpr([](const T& x) { return held(x); });
}

/// Whitened rows sqrt(h_i) [a_i | g_i / h_i] from first row `from` on: their squares are h a a^T, their gradients
/// g a. The vectors hold sqrt(h_i) and g_i / sqrt(h_i). Column by column, as matrices lie in memory.
template <class T>
void set_rows(Rows<T>& result, const LawRecords& records, const Vector<T>& root, const Vector<T>& last,
              Eigen::Index from = 0) {
    const Eigen::Index columns = records.rows.cols() - 1;
    Eigen::VectorXd factor(root.size());
    for (Eigen::Index i = 0; i < root.size(); ++i) {
        factor[i] = held(root[i]);
        result.rows(from + i, columns) = held(last[i]);
    }
    for (Eigen::Index j = 0; j < columns; ++j)
        result.rows.col(j).segment(from, root.size()) = records.rows.col(j).cwiseProduct(factor);
}

/// Half the squares of the last column. Not by squaredNorm(), which conjugates.
template <class T>
T half_squares(const Matrix<T>& rows) {
    const Eigen::Index last = rows.cols() - 1;
    T sum(0.0);
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
        sum += 0.5 * rows(i, last) * rows(i, last);
    return sum;
}

template <class T>
Rows<T> normal_rows(const LawRecords& records, const T& ln_scale) {
    using std::exp;
    const Matrix<T> rows = records.rows.template cast<T>() * exp(-ln_scale);
    const auto n = static_cast<double>(records.count);
    return {held(rows), n * ln_scale + 0.5 * n * ln_two_pi + half_squares(rows)};
}

/// Rows of independent records: law(e, value) adds -ln p of one to the value and gives its weight g / e and its h.
template <class T, class Law>
Rows<T> weighted_rows(const LawRecords& records, const T& value, const Law& law) {
    using std::sqrt;
    const Eigen::Index n = records.rows.rows();
    Rows<T> result{Eigen::MatrixXd(n, records.rows.cols()), static_cast<double>(n) * value};
    Vector<T> root(n);
    Vector<T> last(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const double e = records.rows(i, records.rows.cols() - 1);
        const auto [weight, h] = law(e, result.value);
        root[i] = sqrt(h);
        last[i] = weight * e / root[i];
    }
    set_rows(result, records, root, last);
    return result;
}

template <class T>
Rows<T> student_rows(const NoiseModel& law, const LawRecords& records, const Vector<T>& psi, Curvature curvature) {
    using std::exp;
    const T s = exp(psi[0]);
    const T nu = exp(psi[1]);
    const T spread = nu * s * s;
    const T expected = (nu + 1.0) / ((nu + 3.0) * s * s);
    const T half = 0.5 * (nu + 1.0);
    // In a slope the logarithm itself counts only where nu varies.
    const bool counts = detail::varies(nu);
    const bool constant = std::is_same_v<T, double> || !counts;
    const T normalisation = law.normalisation && constant ? T(*law.normalisation) : detail::student_normalisation(nu);
    return weighted_rows<T>(records, psi[0] + normalisation, [&](double e, T& value) {
        const T sum = spread + e * e;
        const T weight = (nu + 1.0) / sum;
        value += half * detail::lift(
                            T(e * e) / spread, [counts](double u) { return counts ? std::log1p(u) : 0.0; },
                            [](double u) { return 1.0 / (1.0 + u); });
        if (curvature == Curvature::expected) return std::pair<T, T>(weight, expected);
        return std::pair<T, T>(weight, weight * step_share(T((spread - e * e) / sum), least_share, curvature));
    });
}

template <class T>
Rows<T> laplace_rows(const LawRecords& records, const T& ln_scale, Curvature curvature) {
    using std::exp;
    using std::sqrt;
    const T s = exp(ln_scale);
    const T d = detail::laplace_rounding * s;
    const T expected = detail::laplace_information / (s * s);
    return weighted_rows<T>(records, ln_scale + detail::laplace_normalisation, [&](double e, T& value) {
        const T r = sqrt(e * e + d * d);
        const T weight = 1.0 / (s * r);
        value += r / s;
        if (curvature == Curvature::expected) return std::pair<T, T>(weight, expected);
        return std::pair<T, T>(weight, weight * step_share(T(d * d / (r * r)), least_share_laplace, Curvature::step));
    });
}

/// With V = s^2 + (r yhat)^2, t = d ln V / d yhat, and dyhat = -de:
///     d(-ln p)/de     = e / V + t (e^2 / V - 1) / 2
///     d2(-ln p)/de2   = 1/V + 2 e t / V + (e t)^2 / (2 V) + t' (1 - e^2/V) / 2,  t' = dt/dyhat = 2 r^2/V - t^2
///     its expectation = 1/V + t^2 / 2
template <class T>
Rows<T> relative_rows(const LawRecords& records, const Vector<T>& psi, Curvature curvature) {
    using std::exp;
    using std::log;
    using std::sqrt;
    assert(records.observed.size() == records.rows.rows());
    const T variance = exp(2.0 * psi[0]);
    const T factor = exp(2.0 * psi[1]);
    const double half_root = 0.5 * std::numbers::sqrt2;
    const Eigen::Index n = records.rows.rows();
    Rows<T> result{Eigen::MatrixXd(2 * n, records.rows.cols()), T(0.5 * static_cast<double>(n) * ln_two_pi)};
    Vector<T> root(n);
    Vector<T> last(n);
    // The second rows stay zero for a step: shape and sums do not depend on the curvature requested.
    Vector<T> root_of_variance = Vector<T>::Zero(n);
    Vector<T> last_of_variance = Vector<T>::Zero(n);
    for (Eigen::Index i = 0; i < n; ++i) {
        const double e = records.rows(i, records.rows.cols() - 1);
        const double prediction = records.observed[i] - e;
        const T v = variance + factor * (prediction * prediction);
        const T t = 2.0 * factor * prediction / v;
        const T square = e * e / v;
        result.value += 0.5 * (log(v) + square);
        if (curvature == Curvature::expected) {
            root[i] = 1.0 / sqrt(v);
            last[i] = e * root[i];
            root_of_variance[i] = t * half_root;
            last_of_variance[i] = (square - 1.0) * half_root;
            continue;
        }
        const T least = least_share * (1.0 / v + 0.5 * t * t);
        const T t_slope = 2.0 * factor / v - t * t;
        const T second = 1.0 / v + 2.0 * e * t / v + 0.5 * square * t * t + 0.5 * t_slope * (1.0 - square);
        root[i] = sqrt(value_of(second) > value_of(least) ? second : least);
        last[i] = (e / v + 0.5 * t * (square - 1.0)) / root[i];
    }
    set_rows(result, records, root, last);
    set_rows(result, records, root_of_variance, last_of_variance, n);
    return result;
}

template <class T>
T ln_determinant(const Matrix<T>& triangle) {
    using std::log;
    T sum(0.0);
    for (Eigen::Index i = 0; i < triangle.rows(); ++i)
        sum += log(triangle(i, i));
    return sum;
}

template <class T>
Rows<T> autoregressive_rows(const LawRecords& records, const Vector<T>& psi) {
    const Matrix<T> rows = detail::decorrelated<T>(records.rows, psi);
    const auto n = static_cast<double>(records.rows.rows());
    Rows<T> result{held(rows), n * psi[0] + 0.5 * n * ln_two_pi + half_squares(rows)};
    // ln sqrt(1 - rho^2) = -ln cosh(psi), for every innovation.
    if (records.rows.rows() > 1) result.value -= (n - 1.0) * detail::ln_cosh(psi[1]);
    return result;
}

template <class T>
Rows<T> joint_rows(const NoiseModel& law, const LawRecords& records, const Vector<T>& psi) {
    const auto m = static_cast<Eigen::Index>(law.channels.size());
    const Matrix<T> triangle = detail::covariance_triangle<T>(psi, m);
    const Matrix<T> rows = detail::uncoupled<T>(records.rows, triangle);
    const auto n = static_cast<double>(records.rows.rows() / m);
    const T normalisation = n * (ln_determinant<T>(triangle) + 0.5 * static_cast<double>(m) * ln_two_pi);
    return {held(rows), normalisation + half_squares(rows)};
}

/// -ln density of the inverse-Wishart distribution at V = L L^T with nu degrees of freedom and matrix Psi:
///     (nu + m + 1)/2 ln|V| + tr(Psi V^-1)/2 - nu/2 ln|Psi| + nu m/2 ln 2 + ln Gamma_m(nu/2)
template <class T>
T inverse_wishart_term(const NoiseModel& law, const Vector<T>& psi) {
    const auto m = static_cast<Eigen::Index>(law.channels.size());
    const double nu = law.inverse_wishart_dof;
    const Matrix<T> triangle = detail::covariance_triangle<T>(psi, m);
    const Eigen::MatrixXd root = models::CholeskyFactor(law.inverse_wishart_psi).lower();
    const auto size = static_cast<double>(m);
    double constant = -nu * ln_determinant<double>(root) + 0.5 * nu * size * std::numbers::ln2 +
                      0.25 * size * (size - 1.0) * std::log(std::numbers::pi);
    for (Eigen::Index j = 0; j < m; ++j)
        constant += boost::math::lgamma(0.5 * (nu - static_cast<double>(j)));
    T result = constant + (nu + size + 1.0) * ln_determinant<T>(triangle);
    // tr(Psi V^-1) = |L^-1 C|^2 with Psi = C C^T; the columns of C are m "records" of one row per response.
    const Matrix<T> solved = detail::uncoupled<T>(root, triangle);
    for (Eigen::Index i = 0; i < solved.size(); ++i)
        result += 0.5 * solved.data()[i] * solved.data()[i];
    return result;
}

template <class T>
T coordinate_term(const ErrorCoordinate& coordinate, const T& psi) {
    // -ln |d natural / d psi|: exp(psi) and 1 / cosh^2(psi).
    using std::exp;
    using std::tanh;
    T natural = psi;
    T result(0.0);
    if (coordinate.kind == ErrorCoordinate::Kind::log) {
        natural = exp(psi);
        result = -psi;
    } else if (coordinate.kind == ErrorCoordinate::Kind::fisher) {
        natural = tanh(psi);
        result = 2.0 * detail::ln_cosh(psi);
    }
    return result + detail::lift(
                        natural, [&](double x) { return negative_log_density(coordinate.prior, x); },
                        [&](double x) { return derivatives(coordinate.prior, x).first; });
}

template <class T>
Rows<T> rows_of(const NoiseModel& law, const LawRecords& records, const Vector<T>& psi, Curvature curvature) {
    assert(psi.size() == static_cast<Eigen::Index>(law.coordinates.size()));
    assert(records.rows.cols() > 0);
    if (law.joint()) return joint_rows<T>(law, records, psi);
    if (law.slack && curvature == Curvature::expected) curvature = Curvature::guarded;
    if (std::holds_alternative<StudentErrors>(law.distribution)) return student_rows<T>(law, records, psi, curvature);
    if (std::holds_alternative<LaplaceErrors>(law.distribution)) return laplace_rows<T>(records, psi[0], curvature);
    if (std::holds_alternative<RelativeErrors>(law.distribution)) return relative_rows<T>(records, psi, curvature);
    if (std::holds_alternative<AutoregressiveErrors>(law.distribution)) return autoregressive_rows<T>(records, psi);
    Rows<T> result = normal_rows<T>(records, psi[0]);
    // The density of y itself: d ln y / dy = 1 / y.
    if (std::holds_alternative<LogNormalErrors>(law.distribution))
        for (Eigen::Index i = 0; i < records.observed.size(); ++i)
            result.value += std::log(records.observed[i]);
    return result;
}

template <class T>
T prior_of(const NoiseModel& law, const Vector<T>& psi) {
    assert(psi.size() == static_cast<Eigen::Index>(law.coordinates.size()));
    T result(0.0);
    for (std::size_t i = 0; i < law.coordinates.size(); ++i) {
        const ErrorCoordinate& coordinate = law.coordinates[i];
        if (!coordinate.estimate || std::holds_alternative<FlatPrior>(coordinate.prior)) continue;
        result += coordinate_term<T>(coordinate, psi[static_cast<Eigen::Index>(i)]);
    }
    if (law.inverse_wishart_dof > 0.0) result += inverse_wishart_term<T>(law, psi);
    return result;
}

/// psi with the derivative 1 of psi[j].
Vector<Slope> varied(const Eigen::VectorXd& psi, Eigen::Index j) {
    Vector<Slope> result = psi.cast<Slope>();
    result[j] = Slope::variable(psi[j], 0);
    return result;
}

}  // namespace

WhitenedRows whitened_rows(const NoiseModel& law, const LawRecords& records, const Eigen::VectorXd& psi,
                           Curvature curvature) {
    Rows<double> result = rows_of<double>(law, records, psi, curvature);
    return {std::move(result.rows), result.value};
}

WhitenedRows whitened_rows_slope(const NoiseModel& law, const LawRecords& records, const Eigen::VectorXd& psi,
                                 Eigen::Index j, Curvature curvature) {
    Rows<Slope> result = rows_of<Slope>(law, records, varied(psi, j), curvature);
    return {std::move(result.rows), result.value.partial[0]};
}

double prior_term(const NoiseModel& law, const Eigen::VectorXd& psi) {
    return prior_of<double>(law, psi);
}

double prior_slope(const NoiseModel& law, const Eigen::VectorXd& psi, Eigen::Index j) {
    return prior_of<Slope>(law, varied(psi, j)).partial[0];
}

}  // namespace orbid::estimator
