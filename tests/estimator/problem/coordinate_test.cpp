#include "estimator/problem/coordinate.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Eigenvalues>
#include <boost/math/quadrature/gauss_kronrod.hpp>

#include "tests/catch.hpp"

namespace orbid::tests::coordinate_test {

namespace {

using namespace estimator;

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Priors of positive numbers: they have a density in every coordinate.
const std::vector<Prior>& positive_priors() {
    static const std::vector<Prior> priors{LogNormalPrior{2.0, 0.7},    UniformPrior{0.5, 4.0}, HalfNormalPrior{1.4},
                                           HalfCauchyPrior{2.5},        GammaPrior{3.0, 2.0},   GammaPrior{0.6, 1.0},
                                           StudentPrior{4.0, 3.0, 0.2}, NormalPrior{3.0, 0.5}};
    return priors;
}

const std::vector<Coordinate>& coordinates() {
    static const std::vector<Coordinate> all{Coordinate{}, Coordinate{Scale::log}, Coordinate{Scale::log10},
                                             Coordinate{Scale::logit, 0.0, 5.0}};
    return all;
}

template <class F>
double difference(F&& f, double x, double h) {
    return (8.0 * (f(x + h) - f(x - h)) - (f(x + 2.0 * h) - f(x - 2.0 * h))) / (12.0 * h);
}

double mass(const Coordinate& coordinate, const Prior& prior, double from, double to) {
    return boost::math::quadrature::gauss_kronrod<double, 31>::integrate(
        [&](double u) { return std::exp(-coordinate.term(prior, u).value); }, from, to, 10, 1e-10);
}

/// Where the gradient of the term vanishes, by bisection between u values of opposite sign.
double mode(const Coordinate& coordinate, const Prior& prior, double from, double to) {
    for (int i = 0; i < 200; ++i) {
        const double middle = 0.5 * (from + to);
        (coordinate.term(prior, middle).gradient < 0.0 ? from : to) = middle;
    }
    return 0.5 * (from + to);
}

}  // namespace

TEST_CASE("round trips, also at the ends of what a double holds", "[estimator][coordinate]") {
    for (const double x : {1e-300, 1e-30, 0.3, 1.0, 7.5, 1e30, 1e300}) {
        CAPTURE(x);
        CHECK(Coordinate{}.natural(Coordinate{}.at(x)) == x);
        // ln x of size 690 is rounded to 1e-13.
        CHECK_THAT(Coordinate{Scale::log}.natural(Coordinate{Scale::log}.at(x)), WithinRel(x, 2e-13));
        CHECK_THAT(Coordinate{Scale::log10}.natural(Coordinate{Scale::log10}.at(x)), WithinRel(x, 2e-13));
    }
    CHECK(Coordinate{Scale::log}.at(0.0) == -infinity);
    CHECK(Coordinate{Scale::log10}.at(0.0) == -infinity);
    CHECK(Coordinate{Scale::log10}.at(1000.0) == 3.0);
    CHECK(std::isnan(Coordinate{Scale::log}.at(-1.0)));

    const Coordinate unit{Scale::logit, 0.0, 1.0};
    for (const double x : {1e-300, 1e-17, 1e-3, 0.5, 0.9, 1.0 - 1e-9})
        // Near the upper bound 1 - x has 1e-16 / 1e-9 digits, which is what u can know of it.
        CHECK_THAT(unit.natural(unit.at(x)), WithinRel(x, 2e-13));
    CHECK(unit.at(0.0) == -infinity);
    CHECK(unit.at(1.0) == infinity);
    CHECK(unit.natural(-infinity) == 0.0);
    CHECK(unit.natural(infinity) == 1.0);
    const Coordinate wide{Scale::logit, -3.0, 7.0};
    CHECK_THAT(wide.natural(0.0), WithinRel(2.0, 1e-15));
    CHECK_THAT(wide.at(4.5), WithinRel(std::log(7.5 / 2.5), 1e-15));
    for (const double u : {-800.0, -40.0, 40.0, 800.0}) {
        CHECK(wide.natural(u) >= -3.0);
        CHECK(wide.natural(u) <= 7.0);
    }
    CHECK(std::isnan(wide.at(7.1)));
    // exp(-1000) is 0 in double precision, which is no value of the scale.
    for (const Scale scale : {Scale::log, Scale::log10}) {
        const Coordinate small{scale, 0.0, infinity};
        CHECK(small.natural(-1000.0) > 0.0);
        CHECK(std::isfinite(small.at(small.natural(-1000.0))));
        CHECK(small.natural(-infinity) == 0.0);
    }
}

TEST_CASE("slopes are dx/du", "[estimator][coordinate]") {
    for (std::size_t c = 0; c < coordinates().size(); ++c)
        for (const double x : {0.02, 1.0, 4.9}) {
            const Coordinate& coordinate = coordinates()[c];
            const double u = coordinate.at(x);
            CAPTURE(c, x);
            CHECK_THAT(coordinate.slope(x),
                       WithinRel(difference([&](double at) { return coordinate.natural(at); }, u, 1e-3), 1e-9));
        }
    CHECK(coordinates()[3].slope(0.0) == 0.0);
    CHECK(coordinates()[3].slope(5.0) == 0.0);
}

TEST_CASE("in every coordinate the density integrates to one", "[estimator][coordinate]") {
    const std::vector<double> p{1e-9, 1e-8, 1e-7,  1e-6,     1e-5,     1e-4,     1e-3,     1e-2,     0.1,     0.5,
                                0.9,  0.99, 0.999, 1 - 1e-4, 1 - 1e-5, 1 - 1e-6, 1 - 1e-7, 1 - 1e-8, 1 - 1e-9};
    for (std::size_t c = 0; c < coordinates().size(); ++c)
        for (std::size_t k = 0; k < positive_priors().size(); ++k) {
            const Coordinate& coordinate = coordinates()[c];
            const Prior& prior = positive_priors()[k];
            CAPTURE(c, k);
            for (std::size_t i = 0; i + 1 < p.size(); ++i) {
                const double lower = quantile(prior, p[i]);
                const double upper = quantile(prior, p[i + 1]);
                // Student's and the normal density have a little mass below zero, where log coordinates end, and
                // others some above 5, where this logit does.
                const bool inside = coordinate.scale == Scale::linear ||
                                    (lower > 0.0 && (coordinate.scale != Scale::logit || upper < 4.999));
                if (!inside) continue;
                CAPTURE(p[i]);
                // Rounding of 1 - p in the upper tail: 1e-16 / (p step).
                CHECK_THAT(mass(coordinate, prior, coordinate.at(lower), coordinate.at(upper)),
                           WithinRel(p[i + 1] - p[i], 1e-6) || WithinAbs(p[i + 1] - p[i], 1e-14));
            }
        }
}

TEST_CASE("derivatives in u agree with differences", "[estimator][coordinate]") {
    for (std::size_t c = 0; c < coordinates().size(); ++c)
        for (std::size_t k = 0; k < positive_priors().size(); ++k)
            for (const double p : {0.05, 0.3, 0.5, 0.7, 0.95}) {
                const Coordinate& coordinate = coordinates()[c];
                const Prior& prior = positive_priors()[k];
                const double x = quantile(prior, p);
                if (x <= 0.0 || x >= 4.99) continue;
                const double u = coordinate.at(x);
                // A thousandth of the length over which -ln p and the coordinate change.
                const double width = quantile(prior, 0.75) - quantile(prior, 0.25);
                const double h = 1e-3 * std::min(1.0, std::min(x, width) / coordinate.slope(x));
                const PriorTerm term = coordinate.term(prior, u);
                CAPTURE(c, k, p);
                // Truncation (1e-3)^4, rounding 1e-16 / 1e-3, of terms of size 1 / h.
                const double tolerance = 1e-9 / (1e3 * h);
                CHECK_THAT(term.gradient,
                           WithinAbs(difference([&](double at) { return coordinate.term(prior, at).value; }, u, h),
                                     tolerance));
                CHECK_THAT(term.second,
                           WithinAbs(difference([&](double at) { return coordinate.term(prior, at).gradient; }, u, h),
                                     tolerance / (1e3 * h)));
                CHECK(term.curvature >= 0.0);
                if (term.second > 0.0) CHECK(term.curvature == term.second);
            }
}

TEST_CASE("a flat prior has no term in any coordinate", "[estimator][coordinate]") {
    for (const Coordinate& coordinate : coordinates()) {
        const PriorTerm term = coordinate.term(FlatPrior{}, 0.3);
        CHECK(term.value == 0.0);
        CHECK(term.gradient == 0.0);
        CHECK(term.curvature == 0.0);
        CHECK(term.second == 0.0);
        CHECK(coordinate.prior_sd(FlatPrior{}, 0.3) == infinity);
    }
}

TEST_CASE("modes move with the coordinate as their Jacobian says", "[estimator][coordinate]") {
    const LogNormalPrior prior{2.0, 0.7};
    // Mode of the density of x: median exp(-sd^2); of ln x: the median.
    CHECK_THAT(mode(Coordinate{}, prior, 1e-3, 10.0), WithinRel(2.0 * std::exp(-0.49), 1e-13));
    CHECK_THAT(mode(Coordinate{Scale::log}, prior, -5.0, 5.0), WithinRel(std::log(2.0), 1e-13));
    CHECK_THAT(mode(Coordinate{Scale::log10}, prior, -5.0, 5.0), WithinRel(std::log10(2.0), 1e-13));
    // Gamma: (shape - 1) / rate and shape / rate; half-Cauchy: 0 and scale; half-normal: 0 and scale.
    CHECK_THAT(mode(Coordinate{}, GammaPrior{3.0, 2.0}, 1e-3, 10.0), WithinRel(1.0, 1e-13));
    CHECK_THAT(mode(Coordinate{Scale::log}, GammaPrior{3.0, 2.0}, -5.0, 5.0), WithinRel(std::log(1.5), 1e-13));
    CHECK_THAT(mode(Coordinate{Scale::log}, HalfCauchyPrior{2.5}, -5.0, 5.0), WithinRel(std::log(2.5), 1e-13));
    CHECK_THAT(mode(Coordinate{Scale::log}, HalfNormalPrior{2.5}, -5.0, 5.0), WithinRel(std::log(2.5), 1e-13));
    // Uniform within the bounds of the logit: logistic, mode in the middle.
    CHECK_THAT(mode(Coordinate{Scale::logit, 0.0, 5.0}, UniformPrior{0.0, 5.0}, -3.0, 5.0), WithinAbs(0.0, 1e-13));
}

TEST_CASE("terms stay finite where x itself underflows", "[estimator][coordinate]") {
    const Coordinate log{Scale::log};
    const PriorTerm gamma = log.term(GammaPrior{2.0, 3.0}, -900.0);
    CHECK_THAT(gamma.value, WithinRel(1800.0 - 2.0 * std::log(3.0), 1e-14));
    CHECK(gamma.gradient == -2.0);
    const PriorTerm log_normal = log.term(LogNormalPrior{1.0, 10.0}, -900.0);
    CHECK_THAT(log_normal.gradient, WithinRel(-9.0, 1e-15));
    CHECK(log.term(HalfNormalPrior{1.0}, -900.0).gradient == -1.0);
    CHECK(log.term(GammaPrior{2.0, 3.0}, 900.0).value == infinity);
    CHECK(Coordinate{}.term(HalfNormalPrior{1.0}, -0.1).value == infinity);
    CHECK(Coordinate{}.term(HalfNormalPrior{1.0}, -0.1).curvature == 0.0);
    const Coordinate logit{Scale::logit, 0.0, 1.0};
    for (const double u : {-800.0, 800.0}) {
        const PriorTerm term = logit.term(NormalPrior{0.5, 1.0}, u);
        CHECK(std::isfinite(term.value));
        CHECK_THAT(term.gradient, WithinRel(u > 0.0 ? 1.0 : -1.0, 1e-15));
    }
}

TEST_CASE("where -ln p is concave a parabola with the given curvature lies above it", "[estimator][coordinate]") {
    // Heavy tails on the linear scale: the parabola at x majorises -ln p everywhere (Student's density is a mixture of
    // normals), so that its minimum cannot be uphill.
    for (const Prior& prior : {Prior{StudentPrior{3.0, 1.0, 0.5}}, Prior{HalfCauchyPrior{0.5}}}) {
        const double x = 8.0;
        const PriorTerm at = Coordinate{}.term(prior, x);
        CHECK(at.second < 0.0);
        CHECK(at.curvature > 0.0);
        for (double y = 0.0; y < 30.0; y += 0.25) {
            const double parabola = at.value + at.gradient * (y - x) + 0.5 * at.curvature * (y - x) * (y - x);
            CHECK(Coordinate{}.term(prior, y).value <= parabola + 1e-12);
        }
    }
    // A normal density far below its mean on the log scale.
    const PriorTerm low = Coordinate{Scale::log}.term(NormalPrior{3.0, 0.5}, std::log(0.3));
    CHECK(low.second < 0.0);
    CHECK_THAT(low.curvature, WithinRel(0.36, 1e-13));
    CHECK(Coordinate{}.term(GammaPrior{0.5, 1.0}, 0.2).curvature == 0.0);
    CHECK(Coordinate{}.term(GammaPrior{0.5, 1.0}, 0.2).second < 0.0);
}

TEST_CASE("prior widths in u are finite for every proper prior and exact where known", "[estimator][coordinate]") {
    for (const Coordinate& coordinate : coordinates())
        for (const Prior& prior : positive_priors()) {
            const double sd = coordinate.prior_sd(prior, 1.5);
            CHECK(std::isfinite(sd));
            CHECK(sd > 0.0);
        }
    const Coordinate log{Scale::log};
    CHECK(log.prior_sd(LogNormalPrior{2.0, 0.7}, 123.0) == 0.7);
    CHECK_THAT(Coordinate{Scale::log10}.prior_sd(LogNormalPrior{2.0, 0.7}, 123.0),
               WithinRel(0.7 / std::log(10.0), 1e-15));
    // The variances of ln x by quadrature.
    for (const Prior& prior : {Prior{GammaPrior{3.0, 2.0}}, Prior{HalfNormalPrior{1.4}}, Prior{HalfCauchyPrior{2.5}}}) {
        const auto moment = [&](int order) {
            // 40 covers every tail to 1e-17.
            return boost::math::quadrature::gauss_kronrod<double, 61>::integrate(
                [&](double u) { return std::pow(u, order) * std::exp(-log.term(prior, u).value); }, -40.0, 40.0, 15,
                1e-13);
        };
        CHECK_THAT(log.prior_sd(prior, 9.0), WithinRel(std::sqrt(moment(2) - moment(1) * moment(1)), 1e-8));
    }
    CHECK_THAT(Coordinate{}.prior_sd(NormalPrior{3.0, 0.5}, 2.0), WithinRel(0.5, 1e-15));
    CHECK_THAT(log.prior_sd(NormalPrior{3.0, 0.5}, 2.0), WithinRel(0.25, 1e-15));
    // Quartiles of half-Cauchy: tan(pi / 8), tan(3 pi / 8), which differ by 2.
    CHECK_THAT(Coordinate{}.prior_sd(HalfCauchyPrior{2.5}, 2.0), WithinRel(2.5 * 2.0 / 1.3489795003921634, 1e-14));
}

TEST_CASE("sizes and bounds", "[estimator][coordinate]") {
    CHECK(Coordinate{Scale::log}.size(1e-5, 1.0) == 1.0);
    CHECK_THAT(Coordinate{Scale::log10}.size(1e-5, 1.0), WithinRel(1.0 / std::log(10.0), 1e-15));
    CHECK(Coordinate{}.size(-3.0, 1.0) == 3.0);
    CHECK(Coordinate{}.size(0.0, 0.1) == 0.1);
    CHECK_THAT((Coordinate{Scale::logit, 0.0, 4.0}.size(1.0, 0.1)), WithinRel(4.0 / 3.0, 1e-15));
    CHECK((Coordinate{Scale::logit, 0.0, 4.0}.natural(-50.0)) >= 0.0);
    CHECK((Coordinate{Scale::logit, 0.0, 4.0}.natural(50.0)) <= 4.0);

    FreeParameter parameter;
    parameter.lower = 1.0;
    parameter.upper = 2.0;
    parameter.scale = Scale::logit;
    CHECK(coordinate_of(parameter).lower == 1.0);
    CHECK(coordinate_of(parameter).upper == 2.0);
    parameter.scale = Scale::log;
    CHECK(coordinate_of(parameter).scale == Scale::log);
}

TEST_CASE("joint normal prior in coordinates", "[estimator][coordinate]") {
    JointNormalPrior prior{{"a", "b", "c", "d"}, Eigen::Vector4d(1.0, 2.0, 0.5, 3.0), Eigen::Matrix4d()};
    prior.covariance << 0.2, 0.05, 0.01, -0.02,  //
        0.05, 0.5, 0.0, 0.1,                     //
        0.01, 0.0, 0.1, 0.0,                     //
        -0.02, 0.1, 0.0, 0.4;
    validate(prior);
    const std::vector<Coordinate>& all = coordinates();
    for (const Eigen::Vector4d& x : {Eigen::Vector4d(1.3, 1.5, 0.7, 3.5), Eigen::Vector4d(-2.0, 0.05, 0.01, 0.1)}) {
        Eigen::VectorXd u(4);
        for (Eigen::Index i = 0; i < 4; ++i)
            u[i] = all[static_cast<std::size_t>(i)].at(x[i]);
        const JointPriorTerm term = joint_term(prior, all, u);
        // d x = |dx/du| d u.
        double value = negative_log_density(prior, x);
        for (Eigen::Index i = 0; i < 4; ++i)
            value -= std::log(all[static_cast<std::size_t>(i)].slope(x[i]));
        CHECK_THAT(term.value, WithinRel(value, 1e-12));
        for (Eigen::Index i = 0; i < 4; ++i) {
            const auto moved = [&](double at) {
                Eigen::VectorXd point = u;
                point[i] = at;
                return joint_term(prior, all, point);
            };
            // Truncation (1e-3)^4, rounding 1e-16 / 1e-3, of terms of size 10.
            CHECK_THAT(term.gradient[i],
                       WithinAbs(difference([&](double at) { return moved(at).value; }, u[i], 1e-3), 1e-9));
            for (Eigen::Index j = 0; j < 4; ++j)
                CHECK_THAT(term.second(i, j),
                           WithinAbs(difference([&](double at) { return moved(at).gradient[j]; }, u[i], 1e-3), 1e-9));
        }
        const double least = Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(term.curvature).eigenvalues().minCoeff();
        CHECK(least >= -1e-12);
    }
    // One parameter alone is the single prior, also far from its mode.
    const JointNormalPrior one{{"a"}, Eigen::VectorXd::Constant(1, 3.0), Eigen::MatrixXd::Constant(1, 1, 0.25)};
    for (const Coordinate& coordinate : coordinates())
        for (const double x : {0.2, 2.9, 4.0}) {
            const double u = coordinate.at(x);
            const PriorTerm single = coordinate.term(NormalPrior{3.0, 0.5}, u);
            const JointPriorTerm joint = joint_term(one, {coordinate}, Eigen::VectorXd::Constant(1, u));
            CHECK_THAT(joint.value, WithinRel(single.value, 1e-13));
            CHECK_THAT(joint.gradient[0], WithinAbs(single.gradient, 1e-12));
            CHECK_THAT(joint.second(0, 0), WithinAbs(single.second, 1e-12));
            CHECK(joint.curvature(0, 0) >= 0.0);
        }
}

}  // namespace orbid::tests::coordinate_test
