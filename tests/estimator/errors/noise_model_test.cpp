#include "estimator/errors/noise_model.hpp"

#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/QR>
#include <boost/math/distributions/lognormal.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/quadrature/exp_sinh.hpp>
#include <boost/math/special_functions/bessel.hpp>

#include "estimator/errors/error_density.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/group_residual.hpp"

namespace orbid::tests::noise_model_test {

namespace {

using namespace estimator;

/// A law at a point psi with records e(x) = e + A x, two columns in A.
struct Case {
    std::string name;
    NoiseModel law;
    Eigen::VectorXd psi;
    LawRecords records;

    LawRecords at(const Eigen::Vector2d& x) const {
        LawRecords moved = records;
        moved.rows.col(2) += records.rows.leftCols(2) * x;
        return moved;
    }
};

Case made(std::string name, NoiseModel law, std::vector<double> psi, Eigen::Index count = 12) {
    Case result{std::move(name),
                std::move(law),
                Eigen::Map<Eigen::VectorXd>(psi.data(), static_cast<Eigen::Index>(psi.size())),
                {}};
    std::mt19937_64 generator(11);
    std::normal_distribution<double> normal;
    result.records.count = count;
    result.records.rows = Eigen::MatrixXd::NullaryExpr(count, 3, [&] { return normal(generator); });
    if (result.law.needs_observed())
        result.records.observed =
            Eigen::VectorXd::NullaryExpr(count, [&] { return 3.0 + std::fabs(normal(generator)); });
    return result;
}

std::vector<Case> cases() {
    return {made("normal", law_of(NormalErrors{}), {std::log(0.7)}),
            made("student", law_of(StudentErrors{{true, 2.6, FlatPrior{}}}), {std::log(0.7), std::log(2.6)}),
            made("laplace", law_of(LaplaceErrors{}), {std::log(0.7)}),
            made("lognormal", law_of(LogNormalErrors{}), {std::log(0.7)}),
            made("relative", law_of(RelativeErrors{}), {std::log(0.4), std::log(0.3)}),
            made("autoregressive", law_of(AutoregressiveErrors{}), {std::log(0.7), 0.9}),
            made("joint", joint_law(3), {-0.2, 0.4, -0.7, 0.3, 0.5, -0.4})};
}

/// -ln p of a single record with error e; relative: at the prediction 2.
double value_of_one(const NoiseModel& law, const Eigen::VectorXd& psi, double e) {
    LawRecords record{Eigen::MatrixXd::Constant(1, 1, e), {}, 1};
    if (std::holds_alternative<RelativeErrors>(law.distribution))
        record.observed = Eigen::VectorXd::Constant(1, 2.0 + e);
    return whitened_rows(law, record, psi, Curvature::expected).value;
}

/// Gradient and curvature of a single record with respect to its error, or minus its prediction.
std::pair<double, double> slope_of_one(const NoiseModel& law, const Eigen::VectorXd& psi, double e,
                                       Curvature curvature) {
    LawRecords record{Eigen::RowVector2d(1.0, e), {}, 1};
    if (law.needs_observed()) record.observed = Eigen::VectorXd::Constant(1, 2.0 + e);
    const Eigen::MatrixXd rows = whitened_rows(law, record, psi, curvature).rows;
    return {rows.col(0).dot(rows.col(1)), rows.col(0).squaredNorm()};
}

/// Integral over the real line of a function with a possible cusp at zero.
double integral(const std::function<double(double)>& f) {
    boost::math::quadrature::exp_sinh<double> half;
    return half.integrate([&f](double e) { return f(e) + f(-e); });
}

Eigen::VectorXd gradient_of(const WhitenedRows& standard) {
    return standard.rows.leftCols(2).transpose() * standard.rows.col(2);
}

}  // namespace

TEST_CASE("error laws: values are those of the distributions", "[estimator]") {
    // Tolerances of 1e-13: both sides are a few roundings of numbers below 10.
    for (const double e : {-3.0, -0.2, 0.0, 1e-3, 0.9, 40.0}) {
        CAPTURE(e);
        Eigen::VectorXd one(1), two(2);
        one << std::log(0.7);
        CHECK_THAT(value_of_one(law_of(NormalErrors{}), one, e),
                   WithinRel(0.5 * std::log(2.0 * std::numbers::pi) + std::log(0.7) + e * e / 0.98, 1e-13));
        for (const double dof : {1.0, 2.6, 30.0, 1e4}) {
            CAPTURE(dof);
            two << std::log(0.7), std::log(dof);
            const double z = e / 0.7;
            const double exact =
                static_cast<double>(0.5L * std::log(static_cast<long double>(dof) * std::numbers::pi_v<long double>) +
                                    std::lgamma(0.5L * dof) - std::lgamma(0.5L * dof + 0.5L) + std::log(0.7L) +
                                    0.5L * (dof + 1.0L) * std::log1p(static_cast<long double>(z) * z / dof));
            CHECK_THAT(value_of_one(law_of(StudentErrors{{true, dof, FlatPrior{}}}), two, e), WithinRel(exact, 1e-13));
            CHECK_THAT(value_of_one(law_of(StudentErrors{{false, dof, FlatPrior{}}}), two, e), WithinRel(exact, 1e-13));
            // The library's density carries a power of (dof + 1) / 2 of a rounded number and underflows far out.
            const double density = boost::math::pdf(boost::math::students_t(dof), z) / 0.7;
            if (density > 0.0) CHECK_THAT(exact, WithinRel(-std::log(density), 1e-11));
        }
        const double d = 0.007;
        CHECK_THAT(value_of_one(law_of(LaplaceErrors{}), one, e),
                   WithinRel(std::hypot(e, d) / 0.7 + std::log(2.0 * d * boost::math::cyl_bessel_k(1, 0.01)), 1e-13));
        two << std::log(0.4), std::log(0.3);
        CHECK_THAT(value_of_one(law_of(RelativeErrors{}), two, e),
                   WithinRel(0.5 * std::log(2.0 * std::numbers::pi * 0.52) + e * e / 1.04, 1e-13));
    }
    // ln y - ln yhat = 0.3 with y = 5: the density of y itself.
    LawRecords record{Eigen::MatrixXd::Constant(1, 1, 0.3), Eigen::VectorXd::Constant(1, 5.0), 1};
    Eigen::VectorXd psi = Eigen::VectorXd::Constant(1, std::log(0.7));
    const boost::math::lognormal exact(std::log(5.0) - 0.3, 0.7);
    CHECK_THAT(whitened_rows(law_of(LogNormalErrors{}), record, psi, Curvature::step).value,
               WithinRel(-std::log(boost::math::pdf(exact, 5.0)), 1e-13));
}

TEST_CASE("error laws: densities integrate to one, their information is the mean square of the slope", "[estimator]") {
    // Quadrature to 1e-9 or better; the tail of Student's density with one degree of freedom is the hardest.
    for (const Case& c : cases()) {
        if (c.law.joint()) continue;
        CAPTURE(c.name);
        const auto density = [&](double e) { return std::exp(-value_of_one(c.law, c.psi, e)); };
        if (c.name != "lognormal") CHECK_THAT(integral(density), WithinAbs(1.0, 1e-9));
        const double information = integral([&](double e) {
            const double slope = slope_of_one(c.law, c.psi, e, Curvature::expected).first;
            const double p = std::exp(-value_of_one(c.law, c.psi, e));
            return p > 0.0 ? slope * slope * p : 0.0;
        });
        CHECK_THAT(slope_of_one(c.law, c.psi, 0.3, Curvature::expected).second, WithinRel(information, 1e-8));
        CHECK_THAT(slope_of_one(c.law, c.psi, 0.3, Curvature::step).first,
                   WithinRel(slope_of_one(c.law, c.psi, 0.3, Curvature::expected).first, 1e-13));
    }
}

TEST_CASE("error laws: constants of the hyperbolic density", "[estimator]") {
    const double k1 = boost::math::cyl_bessel_k(1, detail::laplace_rounding);
    CHECK_THAT(detail::laplace_normalisation, WithinRel(std::log(2.0 * detail::laplace_rounding * k1), 1e-14));
    boost::math::quadrature::exp_sinh<double> half;
    const double bickley = half.integrate(
        [](double t) { return t < 20.0 ? std::exp(-detail::laplace_rounding * std::cosh(t)) / std::cosh(t) : 0.0; });
    CHECK_THAT(detail::laplace_information, WithinRel(1.0 - bickley / k1, 1e-12));
}

TEST_CASE("error laws: gradient and second derivative of the value along the records", "[estimator]") {
    const double h = 1e-4;
    for (const Case& c : cases()) {
        CAPTURE(c.name);
        const auto gradient_at = [&c](const Eigen::Vector2d& x, Curvature curvature) {
            return gradient_of(whitened_rows(c.law, c.at(x), c.psi, curvature));
        };
        for (const Curvature curvature : {Curvature::step, Curvature::expected}) {
            const WhitenedRows standard = whitened_rows(c.law, c.records, c.psi, curvature);
            const Eigen::VectorXd gradient = gradient_of(standard);
            for (int k = 0; k < 2; ++k) {
                const Eigen::Vector2d step = h * Eigen::Vector2d::Unit(k);
                const double up = whitened_rows(c.law, c.at(step), c.psi, curvature).value;
                const double down = whitened_rows(c.law, c.at(-step), c.psi, curvature).value;
                // Truncation h^2 f'''/6 with third derivatives up to 1e3 in the cusp of the hyperbolic density.
                CHECK_THAT(gradient[k], WithinAbs((up - down) / (2.0 * h), c.name == "laplace" ? 2e-5 : 2e-6));
            }
        }
        if (c.law.compressible() || c.law.joint() || c.name == "autoregressive") {
            // Quadratic laws: both curvatures are the Hessian.
            const auto standard = whitened_rows(c.law, c.records, c.psi, Curvature::step);
            const Eigen::Matrix2d hessian = standard.rows.leftCols(2).transpose() * standard.rows.leftCols(2);
            for (int k = 0; k < 2; ++k) {
                const Eigen::Vector2d step = Eigen::Vector2d::Unit(k);
                const Eigen::VectorXd column =
                    0.5 * (gradient_at(step, Curvature::step) - gradient_at(-step, Curvature::step));
                CHECK((column - hessian.col(k)).norm() <= 1e-12 * hessian.norm());
            }
        }
    }
}

TEST_CASE("error laws: the curvature of a step is the second derivative, or the least share of it", "[estimator]") {
    const double h = 1e-5;
    for (const Case& c : cases()) {
        if (c.name != "student" && c.name != "laplace" && c.name != "relative") continue;
        int exact = 0;
        int raised = 0;
        for (const double e : {-4.0, -1.5, -0.5, -0.05, -0.003, 0.0, 0.004, 0.02, 0.3, 1.1, 2.5, 8.0}) {
            CAPTURE(c.name, e);
            const auto [slope, curvature] = slope_of_one(c.law, c.psi, e, Curvature::step);
            // y = 2 + e at the prediction 2: along the record's row y stays.
            const auto slope_beside = [&](double step) {
                LawRecords record{Eigen::RowVector2d(1.0, e + step), Eigen::VectorXd::Constant(1, 2.0 + e), 1};
                const Eigen::MatrixXd rows = whitened_rows(c.law, record, c.psi, Curvature::step).rows;
                return rows.col(0).dot(rows.col(1));
            };
            const double second = (slope_beside(h) - slope_beside(-h)) / (2.0 * h);
            const double weight = c.name == "relative" ? slope_of_one(c.law, c.psi, e, Curvature::expected).second
                                                       : (e == 0.0 ? second : slope / e);
            const double least = (c.name == "laplace" ? 1e-3 : 0.1) * weight;
            // Difference quotient: h^2 times fourth derivatives of up to 1e7 relative to the second, in the cusp.
            CHECK_THAT(curvature, WithinRel(std::max(second, least), 1e-5));
            (second > least ? exact : raised)++;
        }
        CHECK(exact >= 4);
        CHECK(raised >= 1);
    }
}

TEST_CASE("error laws: dual numbers give the derivatives with respect to the error parameters", "[estimator]") {
    const double h = 1e-4;
    for (const Case& c : cases()) {
        for (Eigen::Index k = 0; k < c.psi.size(); ++k) {
            for (const Curvature curvature : {Curvature::step, Curvature::expected}) {
                CAPTURE(c.name, k);
                const WhitenedRows slope = whitened_rows_slope(c.law, c.records, c.psi, k, curvature);
                const Eigen::VectorXd step = h * Eigen::VectorXd::Unit(c.psi.size(), k);
                const auto up = whitened_rows(c.law, c.records, c.psi + step, curvature);
                const auto down = whitened_rows(c.law, c.records, c.psi - step, curvature);
                const auto here = whitened_rows(c.law, c.records, c.psi, curvature);
                // Truncation h^2 / 6 times third derivatives of sums of 12 records (below 100); measured 1e-7.
                const Eigen::VectorXd mixed = slope.rows.leftCols(2).transpose() * here.rows.col(2) +
                                              here.rows.leftCols(2).transpose() * slope.rows.col(2);
                CHECK_THAT(slope.value, WithinAbs((up.value - down.value) / (2.0 * h), 1e-6));
                CHECK((mixed - (gradient_of(up) - gradient_of(down)) / (2.0 * h)).norm() <=
                      1e-6 * std::max(1.0, gradient_of(here).norm()));
            }
        }
    }
}

TEST_CASE("error laws: compressed records of normal errors lose nothing", "[estimator]") {
    for (const Case& c : cases()) {
        CHECK(c.law.compressible() == (c.name == "normal" || c.name == "lognormal"));
        if (!c.law.compressible()) continue;
        LawRecords triangle = c.records;
        const Eigen::HouseholderQR<Eigen::MatrixXd> factors(c.records.rows);
        triangle.rows = factors.matrixQR().topRows(3).triangularView<Eigen::Upper>();
        const auto full = whitened_rows(c.law, c.records, c.psi, Curvature::step);
        const auto small = whitened_rows(c.law, triangle, c.psi, Curvature::step);
        CHECK_THAT(small.value, WithinRel(full.value, 1e-13));
        CHECK((small.rows.transpose() * small.rows - full.rows.transpose() * full.rows).norm() <=
              1e-13 * full.rows.squaredNorm());
    }
}

TEST_CASE("error laws: autoregressive and joint errors against their dense covariance", "[estimator]") {
    for (const Case& c : cases()) {
        const bool series = c.name == "autoregressive";
        if (!series && !c.law.joint()) continue;
        CAPTURE(c.name);
        Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(12, 12);
        if (series) {
            for (int i = 0; i < 12; ++i)
                for (int j = 0; j < 12; ++j)
                    covariance(i, j) = 0.49 * std::pow(std::tanh(0.9), std::abs(i - j));
        } else {
            Eigen::Matrix3d triangle = Eigen::Matrix3d::Zero();
            triangle << std::exp(-0.2), 0, 0, 0.4, std::exp(0.3), 0, -0.7, 0.5, std::exp(-0.4);
            const Eigen::Matrix3d v = triangle * triangle.transpose();
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j)
                    for (int k = 0; k < 4; ++k)
                        covariance(4 * i + k, 4 * j + k) = v(i, j);
            for (std::size_t i = 0; i < 3; ++i)
                CHECK_THAT(c.law.scale(c.psi, i),
                           WithinRel(std::sqrt(v(static_cast<int>(i), static_cast<int>(i))), 1e-14));
        }
        const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
        const Eigen::MatrixXd exact = c.records.rows.transpose() * factor.solve(c.records.rows);
        const double value = 0.5 * exact(2, 2) + 6.0 * std::log(2.0 * std::numbers::pi) +
                             factor.matrixLLT().diagonal().array().log().sum();
        const auto standard = whitened_rows(c.law, c.records, c.psi, Curvature::expected);
        // Rounding times the condition of the covariance, below 100.
        CHECK_THAT(standard.value, WithinRel(value, 1e-12));
        CHECK((standard.rows.transpose() * standard.rows - exact).norm() <= 1e-12 * exact.norm());
        const Eigen::VectorXd scores = standard_errors(c.law, c.records.rows.col(2), {}, c.psi);
        CHECK((scores - standard.rows.col(2)).norm() <= 1e-14 * scores.norm());
    }
}

}  // namespace orbid::tests::noise_model_test
