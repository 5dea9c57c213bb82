// The average information of error scales against dense algebra, for a chain of six states and two parameters.

#include <limits>
#include <random>

#include <Eigen/Dense>

#include "estimator/minimisation/average_information.hpp"
#include "tests/catch.hpp"

namespace orbid::tests::average_information_test {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index points = 6, parameters = 2;

estimator::ErrorCoordinate logarithmic(const char* name, bool estimate, double start) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    return {name, estimator::ErrorCoordinate::Kind::log, estimate, start, estimator::FlatPrior{}, -infinity, infinity};
}

/// One reading of each state, and a link to the next one.
struct Chain {
    estimator::BlockSet set;
    std::vector<estimator::NoiseModel> laws{2};
    std::vector<estimator::BlockRows> rows;
    VectorXd psi;
    std::vector<bool> free;

    explicit Chain(const estimator::ErrorDistribution& of_links) {
        laws[0].channels = {0};
        laws[0].coordinates = {logarithmic("scale", true, 1.0)};
        laws[1].channels = {1};
        laws[1].distribution = of_links;
        laws[1].coordinates = {logarithmic("scale", true, 1.0)};
        laws[1].first = 1;
        if (const auto* student = std::get_if<estimator::StudentErrors>(&of_links))
            laws[1].coordinates.push_back(logarithmic("dof", false, student->dof.value));
        psi.resize(1 + laws[1].size());
        psi[0] = -0.3;
        psi[1] = 0.2;
        if (psi.size() > 2) psi[2] = std::log(laws[1].coordinates[1].start);
        free.assign(static_cast<std::size_t>(psi.size()), true);
        if (psi.size() > 2) free[2] = false;
        set.latents = points;
        set.records = 2 * points - 1;
        set.count = VectorXd(2);
        set.count << static_cast<double>(points), static_cast<double>(points - 1);
        std::mt19937_64 generator(5);
        std::normal_distribution<double> normal;
        const auto random = [&](Index columns) {
            return MatrixXd::NullaryExpr(1, columns, [&] { return normal(generator); });
        };
        for (Index i = 0; i < points; ++i) {
            estimator::BlockRows block;
            block.latents = 1;
            block.parts.push_back({0, {random(1 + parameters + 1), {}, 1}});
            if (i + 1 < points) {
                block.next = i + 1;
                block.next_latents = 1;
                block.linked_parts.push_back({1, {random(2 + parameters + 1), {}, 1}});
            }
            rows.push_back(std::move(block));
        }
    }

    [[nodiscard]] estimator::ErrorProblem problem() const {
        estimator::ErrorProblem result;
        result.set = &set;
        result.laws = &laws;
        result.rows = &rows;
        result.basis = MatrixXd::Identity(parameters, parameters);
        result.prior_rows = MatrixXd::Constant(1, parameters, 0.4);
        result.prior_gradient = VectorXd::Zero(parameters);
        result.free = free;
        result.follow = estimator::Follow::all;
        return result;
    }
};

/// The rows of all states and parameters as one matrix, whitened as the arrow has them, and the scale of each row.
struct Dense {
    MatrixXd s = MatrixXd::Zero(2 * points, points + parameters);
    VectorXd w = VectorXd::Zero(2 * points);
    std::vector<Index> scale;

    Dense(const estimator::ErrorProblem& problem, const estimator::WhitenedArrow& standard) {
        Index row = 0;
        for (Index i = 0; i < points; ++i) {
            const auto b = static_cast<std::size_t>(i);
            const auto put = [&](const Eigen::Ref<const MatrixXd>& from, Index states) {
                s.row(row).segment(i, states) = from.row(0).head(states);
                s.row(row).tail(parameters) = from.row(0).segment(states, parameters);
                w[row++] = from(0, states + parameters);
            };
            put(standard.own_rows(b), 1);
            scale.push_back(0);
            if (i + 1 == points) continue;
            put(standard.linked_rows(b), 2);
            scale.push_back(1);
        }
        s.row(row).tail(parameters) = problem.prior_rows;
        scale.push_back(-1);
    }

    /// Of the errors at the minimum those of each scale, shape (rows, 2).
    [[nodiscard]] MatrixXd of_scales() const {
        const VectorXd least = w - s * s.colPivHouseholderQr().solve(w);
        MatrixXd result = MatrixXd::Zero(least.size(), 2);
        for (Index i = 0; i < least.size(); ++i)
            if (scale[static_cast<std::size_t>(i)] >= 0) result(i, scale[static_cast<std::size_t>(i)]) = least[i];
        return result;
    }
    [[nodiscard]] MatrixXd information(const MatrixXd& v) const {
        return 2.0 * v.transpose() * (v - s * s.colPivHouseholderQr().solve(v));
    }
};

}  // namespace

TEST_CASE("average information of scales of normal errors", "[estimator]") {
    const Chain chain(estimator::NormalErrors{});
    const estimator::ErrorProblem problem = chain.problem();
    const estimator::ErrorPoint point = estimator::evaluate_errors(problem, chain.psi);
    REQUIRE(estimator::has_average_information(problem, chain.psi, {0, 1}));
    const MatrixXd found = estimator::average_information(problem, chain.psi, point.standard, point.step, {0, 1});
    const Dense dense(problem, point.standard);
    const MatrixXd expected = dense.information(dense.of_scales());
    CHECK((found - expected).cwiseAbs().maxCoeff() < 1e-12 * expected.cwiseAbs().maxCoeff());
    // Of one scale alone.
    const MatrixXd one = estimator::average_information(problem, chain.psi, point.standard, point.step, {1});
    CHECK(one(0, 0) == Approx(expected(1, 1)).epsilon(1e-12));
}

TEST_CASE("average information of Student's errors has the length of Fisher's", "[estimator]") {
    const Chain chain(estimator::StudentErrors{{false, 4.0, estimator::FlatPrior{}}});
    const estimator::ErrorProblem problem = chain.problem();
    const estimator::ErrorPoint point = estimator::evaluate_errors(problem, chain.psi);
    REQUIRE(estimator::has_average_information(problem, chain.psi, {0, 1}));
    CHECK_FALSE(estimator::has_average_information(problem, chain.psi, {0, 2}));
    const MatrixXd found = estimator::average_information(problem, chain.psi, point.standard, point.step, {0, 1});
    const Dense dense(problem, point.standard);
    MatrixXd v = dense.of_scales();
    // 2 nu / (nu + 3) a record.
    v.col(1) *= std::sqrt(0.5 * static_cast<double>(points - 1) * 8.0 / 7.0) / v.col(1).norm();
    const MatrixXd expected = dense.information(v);
    CHECK((found - expected).cwiseAbs().maxCoeff() < 1e-12 * expected.cwiseAbs().maxCoeff());
}

}  // namespace orbid::tests::average_information_test
