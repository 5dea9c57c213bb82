#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/quadrature/exp_sinh.hpp>
#include <boost/math/special_functions/bessel.hpp>

#include "estimator/errors/noise_model.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/group_residual.hpp"

namespace orbid::tests::noise_model_change_test {

namespace {

using namespace estimator;
using Long = long double;

struct Point {
    std::string name;
    NoiseModel law;
    Eigen::VectorXd psi;
};

std::vector<Point> points() {
    const Eigen::VectorXd scale = Eigen::VectorXd::Constant(1, std::log(0.7));
    return {{"normal", law_of(NormalErrors{}), scale},
            {"student", law_of(StudentErrors{}), Eigen::Vector2d(std::log(0.7), std::log(2.6))},
            {"laplace", law_of(LaplaceErrors{}), scale},
            {"lognormal", law_of(LogNormalErrors{}), scale},
            {"relative", law_of(RelativeErrors{}), Eigen::Vector2d(std::log(0.4), std::log(0.3))},
            {"autoregressive", law_of(AutoregressiveErrors{}), Eigen::Vector2d(std::log(0.7), 0.9)},
            {"joint", joint_law(2), Eigen::Vector3d(-0.2, 0.4, 0.3)}};
}

Eigen::VectorXd draws(Eigen::Index count, unsigned seed) {
    std::mt19937_64 generator(seed);
    std::normal_distribution<double> normal;
    return Eigen::VectorXd::NullaryExpr(count, [&] { return normal(generator); });
}

/// -ln p less its normalisation in psi, in extended precision, from the definitions.
Long long_value(const Point& p, const Eigen::VectorXd& e, const Eigen::VectorXd& observed) {
    const auto parameter = [&p](Eigen::Index k) { return static_cast<Long>(p.psi[k]); };
    const Long s = std::exp(parameter(0));
    Long sum = 0.0L;
    for (Eigen::Index i = 0; i < e.size(); ++i) {
        const Long error = e[i];
        if (p.name == "student") {
            const Long nu = std::exp(parameter(1));
            sum += 0.5L * (nu + 1.0L) * std::log1p(error * error / (nu * s * s));
        } else if (p.name == "laplace") {
            const Long d = 0.01 * s;
            sum += std::sqrt(error * error + d * d) / s;
        } else if (p.name == "relative") {
            const Long y = observed[i];
            const Long v = s * s + std::exp(2.0L * parameter(1)) * (y - error) * (y - error);
            sum += 0.5L * (std::log(v) + error * error / v);
        } else if (p.name == "autoregressive") {
            const Long rho = std::tanh(parameter(1));
            const Long w = i == 0 ? error / s : (error - rho * e[i - 1]) / (s * std::sqrt(1.0L - rho * rho));
            sum += 0.5L * w * w;
        } else if (p.name == "joint") {
            const Eigen::Index n = e.size() / 2;
            const Long first = e[i % n] / s;
            const Long w = i < n ? first : (error - parameter(1) * first) / std::exp(parameter(2));
            sum += 0.5L * w * w;
        } else {
            sum += 0.5L * error * error / (s * s);
        }
    }
    return sum;
}

}  // namespace

TEST_CASE("error laws: changes of the value keep their digits", "[estimator]") {
    const Eigen::VectorXd e = draws(40, 3);
    const Eigen::VectorXd observed = draws(40, 4).cwiseAbs().array() + 4.0;
    for (const Point& p : points()) {
        for (const double size : {1.0, 1e-3, 1e-6, 1e-9}) {
            CAPTURE(p.name, size);
            const Eigen::VectorXd next = e + size * draws(40, 5);
            const double change = value_change(p.law, e, next, observed, p.psi);
            const Long exact = long_value(p, next, observed) - long_value(p, e, observed);
            // The reference is a difference of sums near 40 in 64 bits, 7e-18, over a change of about five times `size`
            // (two sums in 53 bits would be off by 1e-15 / size). Measured 1.1e-15 at most, and 3.4e-18 / size.
            CHECK_THAT(change, WithinRel(static_cast<double>(exact), 1e-14 + 3.4e-17 / size));
            // Terms of psi alone drop out of the difference.
            LawRecords before{e, observed, 40};
            LawRecords after{next, observed, 40};
            const double difference = whitened_rows(p.law, after, p.psi, Curvature::step).value -
                                      whitened_rows(p.law, before, p.psi, Curvature::step).value;
            CHECK_THAT(change, WithinAbs(difference, 1e-12));
        }
        CHECK(value_change(p.law, e, e, observed, p.psi) == 0.0);
    }
}

TEST_CASE("error laws: normal scores have the probability of the errors", "[estimator]") {
    const Eigen::VectorXd none;
    const boost::math::normal normal;
    const NoiseModel student = law_of(StudentErrors{});
    const NoiseModel laplace = law_of(LaplaceErrors{});
    const Eigen::VectorXd s = Eigen::VectorXd::Constant(1, std::log(0.7));
    for (const double e : {0.0, 0.001, 0.02, 0.4, 1.5, 6.0, 60.0}) {
        CAPTURE(e);
        const Eigen::VectorXd both = Eigen::Vector2d(e, -e);
        for (const double dof : {1.0, 4.0, 200.0}) {
            const Eigen::VectorXd score = standard_errors(student, both, none, Eigen::Vector2d(s[0], std::log(dof)));
            const double tail = boost::math::cdf(boost::math::complement(boost::math::students_t(dof), e / 0.7));
            CHECK_THAT(boost::math::cdf(boost::math::complement(normal, score[0])), WithinRel(tail, 1e-11));
            CHECK(score[1] == -score[0]);
        }
        const Eigen::VectorXd score = standard_errors(laplace, both, none, s);
        boost::math::quadrature::exp_sinh<double> half;
        const double tail = half.integrate([e](double x) { return std::exp(-std::hypot(e + x, 0.007) / 0.7); }) /
                            (0.014 * boost::math::cyl_bessel_k(1, 0.01));
        // 1e-9 of a correction that is at most 2 % of the tail, and the reference's own quadrature, 1e-9.
        CHECK_THAT(boost::math::cdf(boost::math::complement(normal, score[0])), WithinRel(tail, 2e-9));
        CHECK(score[1] == -score[0]);
    }
    // Beyond the least double, and far beyond.
    for (const double e : {600.0, 1e9}) {
        const double score = standard_errors(laplace, Eigen::VectorXd::Constant(1, -e), none, s)[0];
        CHECK(score < -37.0);
        CHECK(score > -38.0);
    }
}

TEST_CASE("error laws: standard errors of draws are independent with mean 0 and sd 1", "[estimator]") {
    // Bounds are four standard errors of n independent standard normals.
    const Eigen::Index n = 20000;
    const double root = std::sqrt(static_cast<double>(n));
    std::mt19937_64 generator(8);
    std::student_t_distribution<double> student(2.6);
    std::exponential_distribution<double> exponential;
    std::bernoulli_distribution coin;
    const Eigen::VectorXd u = draws(n, 6);
    const Eigen::VectorXd predictions = 5.0 * draws(n, 7);
    for (const Point& p : points()) {
        CAPTURE(p.name);
        Eigen::VectorXd e = 0.7 * u;
        Eigen::VectorXd observed;
        for (Eigen::Index i = 0; i < n; ++i) {
            if (p.name == "student") e[i] = 0.7 * student(generator);
            // Laplace's own distribution: the rounded cusp moves probabilities by less than 1e-3 of them.
            if (p.name == "laplace") e[i] = (coin(generator) ? 0.7 : -0.7) * exponential(generator);
            if (p.name == "relative") e[i] = std::hypot(0.4, 0.3 * predictions[i]) * u[i];
            if (p.name == "autoregressive" && i > 0) e[i] = std::tanh(0.9) * e[i - 1] + 0.7 / std::cosh(0.9) * u[i];
            if (p.name == "joint") e[i] = i < n / 2 ? std::exp(-0.2) * u[i] : 0.4 * u[i - n / 2] + std::exp(0.3) * u[i];
        }
        observed = predictions + e;
        const Eigen::VectorXd score = standard_errors(p.law, e, observed, p.psi);
        CHECK(std::fabs(score.mean()) < 4.0 / root);
        CHECK(std::fabs(std::sqrt(score.squaredNorm() / static_cast<double>(n)) - 1.0) < 4.0 / (std::sqrt(2.0) * root));
        CHECK(std::fabs(score.head(n - 1).dot(score.tail(n - 1))) < 4.0 * root);
        CHECK(std::fabs(score.head(n / 2).dot(score.tail(n / 2))) < 4.0 * root / std::sqrt(2.0));
    }
}

TEST_CASE("error laws: their rows lead Gauss-Newton steps to the minimum", "[estimator]") {
    // Robust regressions with heavy tails by Gauss-Newton steps and halving. The gradient at the end is compared with
    // its largest possible size; the steps with twice the most that any of them took, 21 (laplace) and 19 (student).
    for (const auto& [distribution, psi, most] :
         {std::tuple{ErrorDistribution(LaplaceErrors{}), Eigen::VectorXd(Eigen::VectorXd::Zero(1)), 42},
          std::tuple{ErrorDistribution(StudentErrors{}), Eigen::VectorXd(Eigen::Vector2d(0.0, std::log(3.0))), 38}}) {
        const NoiseModel law = law_of(distribution);
        std::mt19937_64 generator(21);
        std::student_t_distribution<double> heavy(1.5);
        for (int sample = 0; sample < 20; ++sample) {
            const Eigen::Index n = sample % 2 == 0 ? 20 : 200;
            CAPTURE(most, sample);
            LawRecords records{Eigen::MatrixXd(n, 4), {}, n};
            for (Eigen::Index i = 0; i < n; ++i) {
                const double t = static_cast<double>(i) / static_cast<double>(n - 1);
                records.rows.row(i) << 1.0, t, t * t, heavy(generator);
            }
            const Eigen::MatrixXd design = records.rows.leftCols(3);
            records.rows.col(3) -= design * design.householderQr().solve(records.rows.col(3)).eval();
            int steps = 0;
            double gradient = 1.0;
            for (; steps < 100; ++steps) {
                const auto standard = whitened_rows(law, records, psi, Curvature::step);
                const Eigen::VectorXd g = standard.rows.leftCols(3).transpose() * standard.rows.col(3);
                gradient = g.norm() / static_cast<double>(n);
                if (gradient < 1e-10) break;
                const Eigen::VectorXd step =
                    design * standard.rows.leftCols(3).householderQr().solve(-standard.rows.col(3)).eval();
                double share = 1.0;
                const Eigen::VectorXd e = records.rows.col(3);
                while (share > 1e-9 && !(value_change(law, e, e + share * step, {}, psi) < 0.0))
                    share /= 2.0;
                records.rows.col(3) += share * step;
            }
            CHECK(gradient < 1e-10);
            CHECK(steps <= most);
        }
    }
}

}  // namespace orbid::tests::noise_model_change_test
