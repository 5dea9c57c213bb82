#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <boost/math/quadrature/sinh_sinh.hpp>

#include "estimator/errors/noise_model.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/group_residual.hpp"

namespace orbid::tests::noise_model_setup_test {

namespace {

using namespace estimator;
using Kind = ErrorCoordinate::Kind;
constexpr double infinity = std::numeric_limits<double>::infinity();

/// The covariance of the named groups.
JointCovariance covariance_of(std::vector<int> groups, double dof = 0.0, const Eigen::MatrixXd& psi = {}) {
    JointCovariance result;
    result.groups = std::move(groups);
    result.dof = dof;
    result.psi = psi;
    return result;
}

std::string refusal(std::vector<Group> groups, std::vector<JointCovariance> covariances = {}) {
    try {
        (void)laws_of(std::move(groups), std::move(covariances));
    } catch (const std::invalid_argument& error) {
        return error.what();
    }
    return "";
}

Group changed(ErrorDistribution distribution, const std::function<void(Group&)>& change) {
    Group group = group_of("cycles.phi", std::move(distribution));
    change(group);
    return group;
}

}  // namespace

TEST_CASE("error laws: channels count through residuals, parameters through laws", "[estimator]") {
    GroupResidual first({group_of("a", NormalErrors{}, 0.5), group_of("b", NormalErrors{}, 2.0),
                         group_of("c", StudentErrors{}, 3.0), group_of("d", NormalErrors{}, -1.0)},
                        {covariance_of({3, 1}, 4.0, Eigen::Matrix2d::Identity())});
    GroupResidual second({group_of("e", AutoregressiveErrors{})});
    const std::vector<NoiseModel> laws = error_laws({&first, &second}, {first.initial_set(), second.initial_set()});
    REQUIRE(laws.size() == 4);
    CHECK(laws[0].channels == std::vector<int>{0});
    CHECK(laws[1].channels == std::vector<int>{3, 1});
    CHECK(laws[2].channels == std::vector<int>{2});
    CHECK(laws[3].channels == std::vector<int>{4});
    CHECK(laws[0].first == 0);
    CHECK(laws[1].first == 1);
    CHECK(laws[2].first == 4);
    CHECK(laws[3].first == 6);
    CHECK(laws[1].joint());
    CHECK_FALSE(laws[1].compressible());
    CHECK(laws[1].inverse_wishart_dof == 4.0);
    // V = diag(scale^2): ln L_11, L_21, ln L_22; the first starts from the residuals.
    REQUIRE(laws[1].coordinates.size() == 3);
    CHECK(laws[1].coordinates[0].start == -1.0);
    CHECK(laws[1].coordinates[1].kind == Kind::linear);
    CHECK(laws[1].coordinates[1].start == 0.0);
    CHECK(laws[1].coordinates[1].name == "covariance");
    CHECK(laws[1].coordinates[2].start == 2.0);
    CHECK(laws[2].coordinates[1].name == "dof");
    CHECK_FALSE(laws[2].coordinates[1].estimate);
    CHECK(laws[2].coordinates[1].start == 4.0);
    CHECK(laws[3].coordinates[1].name == "correlation");
    CHECK(laws[3].coordinates[1].kind == Kind::fisher);
    CHECK(error_laws({}, {}).empty());
}

TEST_CASE("error laws: limits of the coordinates", "[estimator]") {
    const NoiseModel plain = law_of(NormalErrors{});
    CHECK(plain.coordinates[0].lower == -infinity);
    CHECK(plain.coordinates[0].upper == infinity);
    const NoiseModel student = laws_of({changed(StudentErrors{{true, 4.0, UniformPrior{2.0, 30.0}}}, [](Group& g) {
                                   g.floor = 0.1;
                                   g.scale.value = 0.01;
                               })}).front();
    CHECK(student.coordinates[0].lower == std::log(0.1));
    CHECK_THAT(student.coordinates[0].start, WithinRel(0.1, 1e-15));
    CHECK(student.coordinates[1].lower == std::log(2.0));
    CHECK(student.coordinates[1].upper == std::log(30.0));
    const NoiseModel free = law_of(StudentErrors{{true, 4.0, GammaPrior{2.0, 0.1}}});
    CHECK(free.coordinates[1].lower == 0.0);
    CHECK(free.coordinates[1].upper == std::log(1e4));
    CHECK(law_of(RelativeErrors{}).coordinates[1].lower == std::log(1e-9));
    const NoiseModel series = law_of(AutoregressiveErrors{});
    CHECK_THAT(std::tanh(series.coordinates[1].upper), WithinAbs(1.0 - 1e-9, 1e-15));
    CHECK(series.coordinates[1].lower == -series.coordinates[1].upper);
    CHECK(joint_law(2).coordinates[1].lower == -infinity);
    CHECK(law_of(LogNormalErrors{}).needs_observed());
    CHECK(law_of(RelativeErrors{}).needs_observed());
    CHECK_FALSE(law_of(LaplaceErrors{}).needs_observed());
}

TEST_CASE("error laws: coordinates and their slopes", "[estimator]") {
    for (const Kind kind : {Kind::log, Kind::fisher, Kind::linear}) {
        const ErrorCoordinate coordinate{"x", kind, true, 1.0, FlatPrior{}, -infinity, infinity};
        for (const double psi : {-2.0, -0.3, 0.0, 0.7, 3.0}) {
            CAPTURE(static_cast<int>(kind), psi);
            CHECK_THAT(coordinate.at(coordinate.natural(psi)), WithinAbs(psi, 1e-13));
            const double h = 1e-5;
            const double slope = (coordinate.natural(psi + h) - coordinate.natural(psi - h)) / (2.0 * h);
            // h^2 / 6 of the third derivative, at most twenty; rounding 1e-16 / h of numbers up to twenty.
            CHECK_THAT(coordinate.slope(psi), WithinAbs(slope, 1e-9));
        }
    }
    const ErrorCoordinate fisher{"x", Kind::fisher, true, 0.0, FlatPrior{}, -infinity, infinity};
    // 1 - tanh^2 = 4 exp(-2 psi) to exp(-4 psi).
    CHECK_THAT(fisher.slope(18.0), WithinRel(4.0 * std::exp(-36.0), 1e-14));
}

TEST_CASE("error laws: priors are densities of the natural parameters", "[estimator]") {
    // exp(-term) integrates to one over psi.
    boost::math::quadrature::sinh_sinh<double> line;
    const auto mass = [&line](const NoiseModel& law, Eigen::Index k, double other) {
        return line.integrate([&](double x) {
            if (!(std::fabs(x) < 700.0)) return 0.0;
            Eigen::VectorXd psi = Eigen::VectorXd::Constant(static_cast<Eigen::Index>(law.coordinates.size()), other);
            psi[k] = x;
            const double p = std::exp(-prior_term(law, psi));
            return std::isfinite(p) ? p : 0.0;
        });
    };
    Group group = group_of("y", NormalErrors{});
    group.scale.prior = HalfCauchyPrior{2.0};
    CHECK_THAT(mass(laws_of({group}).front(), 0, 0.0), WithinAbs(1.0, 1e-9));
    CHECK_THAT(mass(law_of(StudentErrors{{true, 4.0, GammaPrior{2.0, 0.1}}}), 1, 0.3), WithinAbs(1.0, 1e-9));
    CHECK_THAT(mass(law_of(RelativeErrors{{true, 0.1, HalfNormalPrior{0.2}}}), 1, 0.3), WithinAbs(1.0, 1e-9));
    // A normal prior within 12 sd of +-1.
    CHECK_THAT(mass(law_of(AutoregressiveErrors{{true, 0.1, NormalPrior{0.1, 0.07}}}), 1, 0.3), WithinAbs(1.0, 1e-9));
    CHECK(prior_term(law_of(StudentErrors{{false, 4.0, GammaPrior{2.0, 0.1}}}), Eigen::Vector2d(0.1, 0.2)) == 0.0);
    CHECK(prior_term(law_of(StudentErrors{{true, 4.0, FlatPrior{}}}), Eigen::Vector2d(0.1, 0.2)) == 0.0);
}

TEST_CASE("error laws: inverse-Wishart density, its mode and its normalisation", "[estimator]") {
    // Definition, written out for m = 3.
    const Eigen::Matrix3d psi = (Eigen::Matrix3d() << 2.0, 0.3, -0.4, 0.3, 1.5, 0.2, -0.4, 0.2, 0.8).finished();
    const double nu = 5.5;
    const NoiseModel law = joint_law(3, nu, psi);
    Eigen::VectorXd point(6);
    point << -0.2, 0.4, -0.7, 0.3, 0.5, -0.4;
    Eigen::Matrix3d triangle = Eigen::Matrix3d::Zero();
    triangle << std::exp(-0.2), 0, 0, 0.4, std::exp(0.3), 0, -0.7, 0.5, std::exp(-0.4);
    const Eigen::Matrix3d v = triangle * triangle.transpose();
    const double ln_gamma =
        1.5 * std::log(std::numbers::pi) + std::lgamma(nu / 2) + std::lgamma((nu - 1) / 2) + std::lgamma((nu - 2) / 2);
    const double exact = 0.5 * (nu + 4.0) * std::log(v.determinant()) + 0.5 * (psi * v.inverse()).trace() -
                         0.5 * nu * std::log(psi.determinant()) + 1.5 * nu * std::log(2.0) + ln_gamma;
    CHECK_THAT(prior_term(law, point), WithinRel(exact, 1e-12));

    // Mode in V: psi / (nu + m + 1), where the derivative with respect to every coordinate of L is zero.
    const Eigen::Matrix3d mode = Eigen::LLT<Eigen::Matrix3d>(psi / (nu + 4.0)).matrixL();
    Eigen::VectorXd at_mode(6);
    at_mode << std::log(mode(0, 0)), mode(1, 0), mode(2, 0), std::log(mode(1, 1)), mode(2, 1), std::log(mode(2, 2));
    for (Eigen::Index k = 0; k < 6; ++k)
        CHECK_THAT(prior_slope(law, at_mode, k), WithinAbs(0.0, 1e-12));

    // The mass over V = L L^T for m = 2, by the trapezoidal rule in psi_0, psi_2 and
    // t = (L_21 / L_11 - psi_12 / psi_11) / L_22: dV = 4 L_11^2 L_22 dL, dL = L_11^2 L_22^2 dpsi_0 dpsi_2 dt.
    // The error of the rule is |Gamma(nu/2 + i pi/h)| / Gamma(nu/2) twice, 1e-8; beyond the limits lies less than
    // 1e-11.
    const NoiseModel two = joint_law(2, 4.5, psi.topLeftCorner<2, 2>());
    const double h = 0.2;
    double mass = 0.0;
    for (double a = -4.0; a < 8.0; a += h)
        for (double c = -4.0; c < 8.0; c += h)
            for (double t = -6.0; t < 6.0; t += h) {
                const double off = std::exp(a) * (psi(0, 1) / psi(0, 0) + t * std::exp(c));
                const double term = prior_term(two, Eigen::Vector3d(a, off, c));
                mass += h * h * h * std::exp(-term + std::log(4.0) + 4.0 * a + 3.0 * c);
            }
    CHECK_THAT(mass, WithinAbs(1.0, 1e-7));
}

TEST_CASE("error laws: slopes of the priors", "[estimator]") {
    Group group = group_of("y", StudentErrors{{true, 4.0, GammaPrior{2.0, 0.1}}});
    group.scale.prior = LogNormalPrior{1.0, 0.5};
    Group series = group_of("z", AutoregressiveErrors{{true, 0.3, NormalPrior{0.2, 0.3}}});
    std::vector<NoiseModel> laws = laws_of({group, series});
    laws.push_back(joint_law(2, 4.0, Eigen::Matrix2d::Identity()));
    const double h = 1e-4;
    for (const NoiseModel& law : laws) {
        const auto size = static_cast<Eigen::Index>(law.coordinates.size());
        const Eigen::VectorXd psi = Eigen::VectorXd::LinSpaced(size, 0.2, 1.1);
        for (Eigen::Index k = 0; k < size; ++k) {
            const Eigen::VectorXd step = h * Eigen::VectorXd::Unit(size, k);
            // h^2 / 6 = 2e-9 of third derivatives below 100.
            CHECK_THAT(prior_slope(law, psi, k),
                       WithinAbs((prior_term(law, psi + step) - prior_term(law, psi - step)) / (2.0 * h), 2e-7));
        }
    }
}

TEST_CASE("error laws: refusals name the group and the rule", "[estimator]") {
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const auto nothing = [](Group&) {};
    struct Row {
        Group group;
        std::string part;
    };
    const std::vector<Row> rows{
        {changed(StudentErrors{{false, 0.5, FlatPrior{}}}, nothing), "dof = 0.5"},
        {changed(StudentErrors{{true, 2e4, FlatPrior{}}}, nothing), "dof = 20000"},
        {changed(StudentErrors{{true, nan, FlatPrior{}}}, nothing), "dof = nan"},
        {changed(StudentErrors{{true, 4.0, UniformPrior{5.0, 9.0}}}, nothing), "prior is zero"},
        {changed(StudentErrors{{true, 4.0, UniformPrior{0.1, 0.9}}}, nothing), "excludes every admissible value"},
        {changed(StudentErrors{{true, 4.0, NormalPrior{5.0, -1.0}}}, nothing), "dof: "},
        {changed(RelativeErrors{{true, 0.0, FlatPrior{}}}, nothing), "relative = 0"},
        {changed(RelativeErrors{{true, -0.1, FlatPrior{}}}, nothing), "relative = -0.1"},
        {changed(AutoregressiveErrors{{true, 1.0, FlatPrior{}}}, nothing), "correlation = 1"},
        {changed(AutoregressiveErrors{{false, -1.5, FlatPrior{}}}, nothing), "correlation = -1.5"},
        {changed(NormalErrors{}, [](Group& g) { g.floor = -1.0; }), "floor = -1"},
        {changed(NormalErrors{}, [nan](Group& g) { g.floor = nan; }), "floor = nan"},
        {changed(NormalErrors{}, [nan](Group& g) { g.scale.value = nan; }), "scale = nan"},
        {changed(NormalErrors{},
                 [](Group& g) {
                     g.scale = {false, 0.0, FlatPrior{}};
                 }),
         "fixed scale must be positive"},
        {changed(NormalErrors{}, [](Group& g) { g.scale.prior = HalfNormalPrior{0.0}; }), "scale: "},
    };
    for (const Row& row : rows) {
        const std::string message = refusal({row.group});
        CHECK_THAT(message, ContainsSubstring("'cycles.phi'"));
        CHECK_THAT(message, ContainsSubstring(row.part));
    }
    CHECK(refusal({changed(NormalErrors{}, nothing)}).empty());
    // exp(ln 1e4) and what it may be off by: an estimate at its bound is the start of the next one.
    CHECK(refusal({changed(StudentErrors{{true, std::exp(std::log(1e4)) * (1.0 + 1e-15), FlatPrior{}}}, nothing)})
              .empty());
    CHECK(refusal({changed(AutoregressiveErrors{{true, -(1.0 - 1e-9) - 1e-15, FlatPrior{}}}, nothing)}).empty());
}

TEST_CASE("error laws: refusals of full covariances", "[estimator]") {
    const std::vector<Group> normal{group_of("a", NormalErrors{}), group_of("b", NormalErrors{}),
                                    group_of("c", NormalErrors{})};
    CHECK(refusal(normal, {covariance_of({0, 1})}).empty());
    CHECK_THAT(refusal(normal, {covariance_of({0})}), ContainsSubstring("two or more"));
    CHECK_THAT(refusal(normal, {covariance_of({0, 3})}), ContainsSubstring("names group 3"));
    CHECK_THAT(refusal(normal, {covariance_of({-1, 1})}), ContainsSubstring("names group -1"));
    CHECK_THAT(refusal(normal, {covariance_of({0, 1}), covariance_of({1, 2})}),
               ContainsSubstring("'b': appears twice"));
    CHECK_THAT(refusal(normal, {covariance_of({0, 0})}), ContainsSubstring("'a': appears twice"));
    std::vector<Group> groups = normal;
    groups[1].distribution = LaplaceErrors{};
    CHECK_THAT(refusal(groups, {covariance_of({0, 1})}), ContainsSubstring("'b': a full covariance needs normal"));
    groups = normal;
    groups[1].scale.estimate = false;
    CHECK_THAT(refusal(groups, {covariance_of({0, 1})}), ContainsSubstring("'b'"));
    groups = normal;
    groups[0].scale.prior = HalfNormalPrior{1.0};
    CHECK_THAT(refusal(groups, {covariance_of({0, 1})}), ContainsSubstring("'a'"));
    const Eigen::Matrix2d unit = Eigen::Matrix2d::Identity();
    CHECK_THAT(refusal(normal, {covariance_of({0, 1}, 1.0, unit)}), ContainsSubstring("dof = 1"));
    CHECK_THAT(refusal(normal, {covariance_of({0, 1}, -2.0, unit)}), ContainsSubstring("dof = -2"));
    CHECK_THAT(refusal(normal, {covariance_of({0, 1}, 3.0)}), ContainsSubstring("0 x 0"));
    CHECK_THAT(refusal(normal, {covariance_of({0, 1}, 3.0, -unit)}), ContainsSubstring("positive definite"));
    const Eigen::Matrix2d skew = (Eigen::Matrix2d() << 1.0, 0.5, 0.2, 1.0).finished();
    CHECK_THAT(refusal(normal, {covariance_of({0, 1}, 3.0, skew)}), ContainsSubstring("symmetric"));
    CHECK(refusal(normal, {covariance_of({0, 1}, 1.5, unit)}).empty());
}

}  // namespace orbid::tests::noise_model_setup_test
