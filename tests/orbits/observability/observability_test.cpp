// Derivatives of readings along a course against closed forms, and the rank of matrices whose null space is known.
#include <algorithm>
#include <cmath>
#include <vector>

#include "models/equations/equation_text.hpp"
#include "orbits/observability/course_derivatives.hpp"
#include "orbits/observability/rank_test.hpp"
#include "tests/catch.hpp"

namespace observability_test {

using namespace orbid;
using namespace orbid::tests;
using orbits::RankTest;

namespace {

std::shared_ptr<const models::System> system_of(const models::EquationText& text) {
    std::vector<models::EquationProblem> problems;
    auto system = models::system_from_text(text, problems);
    REQUIRE(problems.empty());
    return system;
}

Eigen::MatrixXd sizes(const Eigen::MatrixXd& matrix) {
    return matrix.cwiseAbs();
}

/// 12 rows without any relation between the columns but those that a test makes.
Eigen::MatrixXd columns(Eigen::Index count) {
    Eigen::MatrixXd matrix(12, count);
    for (Eigen::Index i = 0; i < 12; ++i)
        for (Eigen::Index j = 0; j < count; ++j)
            matrix(i, j) = std::sin(1.0 + 1.7 * static_cast<double>(i) + 0.9 * static_cast<double>((j + 1) * (i + 2)));
    return matrix;
}

}  // namespace

TEST_CASE("readings of a linear oscillator have the derivatives of its solution", "[orbits][observability]") {
    models::EquationText text;
    text.coordinates = {{"x", "y"}, {"y", "-w^2 * x"}};
    text.parameters = {{"w", "1", models::positive, 1.3}};
    const auto system = system_of(text);
    const models::Sensor sensor;
    const std::vector<Eigen::Index> observed{0}, free{0};
    const double w = 1.3, x0 = 0.7, y0 = -0.4;
    // Less than half a turn: the angle is known from its cosine.
    const auto derivatives = orbits::course_derivatives({*system, sensor, observed, Eigen::Vector2d(x0, y0), 0.0, 2.0},
                                                        Eigen::VectorXd::Constant(1, w), free);
    REQUIRE(derivatives.by_state.rows() > 20);
    CHECK(derivatives.duration == 2.0);
    for (Eigen::Index k = 0; k < derivatives.by_state.rows(); ++k) {
        // x = x0 cos wt + y0 sin(wt) / w. Rows are known up to a factor.
        const double angle = std::atan2(w * derivatives.by_state(k, 1), derivatives.by_state(k, 0));
        const double t = angle / w;
        const double factor = std::hypot(derivatives.by_state(k, 0), w * derivatives.by_state(k, 1));
        const double by_w = -x0 * t * std::sin(angle) + y0 * (t * std::cos(angle) / w - std::sin(angle) / (w * w));
        CHECK_THAT(derivatives.by_parameters(k, 0) / factor, WithinAbs(by_w, 1e-10));
    }
}

TEST_CASE("a course ends where errors of its start have grown too far", "[orbits][observability]") {
    models::EquationText text;
    text.coordinates = {{"x", "a * x"}};
    text.parameters = {{"a", "1", models::positive, 1.0}};
    const auto system = system_of(text);
    const std::vector<Eigen::Index> observed{0}, free{0};
    const auto derivatives =
        orbits::course_derivatives({*system, {}, observed, Eigen::VectorXd::Constant(1, 1.0), 0.0, 100.0},
                                   Eigen::VectorXd::Constant(1, 1.0), free);
    // exp(t) < 1000
    CHECK(derivatives.duration > 2.0);
    CHECK(derivatives.duration < std::log(1000.0));
}

TEST_CASE("a rank test finds the directions without effect and no others", "[orbits][observability]") {
    Eigen::MatrixXd shared = columns(4);
    shared.col(3) = 2.0 * shared.col(0) - 0.5 * shared.col(1);
    // A weak direction is an effect.
    shared.col(2) = shared.col(1) + 1e-7 * shared.col(2);
    RankTest test(4);
    const Eigen::MatrixXd own(12, 0);
    CHECK(test.add(own, shared, own, sizes(shared)) == 0);
    const Eigen::MatrixXd null = test.null_directions();
    REQUIRE(null.cols() == 1);
    const Eigen::VectorXd direction = null.col(0) / null(3, 0);
    CHECK_THAT(direction[0], WithinAbs(-2.0, 1e-7));
    CHECK_THAT(direction[1], WithinAbs(0.5, 1e-7));
    CHECK_THAT(direction[2], WithinAbs(0.0, 1e-7));
    // A prior of one of them decides.
    test.know(0);
    CHECK(test.null_directions().cols() == 0);
}

TEST_CASE("what own unknowns of each course can undo is no information on shared ones", "[orbits][observability]") {
    const Eigen::MatrixXd all = columns(5);
    Eigen::MatrixXd shared = all.leftCols(2);
    const Eigen::MatrixXd own = all.rightCols(2);
    // The second acts as the own unknowns do; the other courses say the same.
    shared.col(1) = own.col(0) + 3.0 * own.col(1);
    RankTest test(2);
    CHECK(test.add(own, shared, sizes(own), sizes(shared)) == 0);
    CHECK(test.add(own.colwise().reverse(), shared.colwise().reverse(), sizes(own.colwise().reverse()),
                   sizes(shared.colwise().reverse())) == 0);
    const Eigen::MatrixXd null = test.null_directions();
    REQUIRE(null.cols() == 1);
    CHECK(std::abs(null(0, 0)) < 1e-10 * std::abs(null(1, 0)));
    const Eigen::VectorXd undone = orbits::compensation(own, shared, sizes(own), null.col(0) / null(1, 0));
    CHECK_THAT(undone[0], WithinAbs(-1.0, 1e-10));
    CHECK_THAT(undone[1], WithinAbs(-3.0, 1e-10));
    // A course without it tells.
    const Eigen::MatrixXd other = all.middleCols(1, 2);
    (void)test.add(own, other, sizes(own), sizes(other));
    CHECK(test.null_directions().cols() == 0);
}

TEST_CASE("columns of nothing, or of nothing but rounding, have no effect", "[orbits][observability]") {
    Eigen::MatrixXd matrix = columns(3);
    matrix.col(1).setZero();
    Eigen::MatrixXd terms = sizes(matrix);
    const Eigen::MatrixXd null = orbits::null_space(matrix, terms);
    REQUIRE(null.cols() == 1);
    CHECK(std::abs(null(1, 0)) > 0.99 * null.col(0).norm());
    // 1e-16 left of terms of size 1 is nothing; 1e-16 of terms of that size is an effect.
    matrix.col(1) = 1e-16 * columns(3).col(1);
    terms.col(1).setOnes();
    CHECK(orbits::null_space(matrix, terms).cols() == 1);
    terms.col(1) = matrix.col(1).cwiseAbs();
    CHECK(orbits::null_space(matrix, terms).cols() == 0);
}

}  // namespace observability_test
