// Cycles that share the errors of one map: their joint density, block by block, against the dense normal density.
#include <cmath>
#include <numbers>
#include <random>

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "models/catalogue/registry.hpp"
#include "orbits/cycle_residuals/common_error_filter.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/cycles/common_errors.hpp"
#include "tests/catch.hpp"

namespace common_errors_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

MatrixXd normal_matrix(Index rows, Index columns, unsigned seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    return MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
}

/// -ln of the normal density without its constant.
double minus_log_density(const VectorXd& e, const MatrixXd& covariance) {
    const Eigen::LLT<MatrixXd> factor(covariance);
    REQUIRE(factor.info() == Eigen::Success);
    return 0.5 * factor.matrixL().solve(e).squaredNorm() + MatrixXd(factor.matrixL()).diagonal().array().log().sum();
}

/// Cycles of the Henon map of periods 1, 2, 4 and 6, measured with errors that they share and errors of their
/// own, with a covariance that says so.
std::vector<orbits::Cycle> henon_cycles(double error, unsigned seed) {
    constexpr double a = 1.4, b = 0.3;
    const std::vector<std::vector<double>> starts{
        {0.63}, {-0.477, 0.977}, {-0.707, 0.637, 0.217, 1.124}, {0.58, 0.309, 1.037, -0.416, 1.07, -0.728}};
    std::vector<orbits::Cycle> cycles;
    const VectorXd shared = error * normal_matrix(3, 1, seed);
    for (const auto& start : starts) {
        const auto p = static_cast<Index>(start.size());
        VectorXd x = Eigen::Map<const VectorXd>(start.data(), p);
        for (int step = 0; step < 200; ++step) {  // x_{j+1} = 1 - a x_j^2 + b x_{j-1}
            MatrixXd slope = MatrixXd::Zero(p, p);
            VectorXd defect(p);
            for (Index j = 0; j < p; ++j) {
                const Index next = (j + 1) % p, before = (j + p - 1) % p;
                defect[j] = 1.0 - a * x[j] * x[j] + b * x[before] - x[next];
                slope(j, j) -= 2.0 * a * x[j];
                slope(j, before) += b;
                slope(j, next) -= 1.0;
            }
            VectorXd move = slope.fullPivLu().solve(defect);
            const double size = move.cwiseAbs().maxCoeff();
            x -= move * std::min(1.0, 0.05 / std::max(size, 1e-300));
        }
        orbits::Cycle cycle;
        cycle.period = static_cast<int>(p);
        cycle.points.resize(2, p);
        for (Index j = 0; j < p; ++j)
            cycle.points.col(j) << x[j], b * x[(j + p - 1) % p];
        const auto k = static_cast<unsigned>(cycles.size());
        cycle.common = error * normal_matrix(2 * p + 2, 3, 100 + k);
        cycle.common.bottomRows(2).setZero();
        cycle.ln_multiplier = VectorXd::Zero(2);
        cycle.ln_multiplier_covariance = MatrixXd::Identity(2, 2);
        const MatrixXd root = 0.2 * error * normal_matrix(2 * p, 2 * p, 200 + k);
        cycle.covariance = cycle.common.topRows(2 * p) * cycle.common.topRows(2 * p).transpose() +
                           root * root.transpose() + 0.01 * error * error * MatrixXd::Identity(2 * p, 2 * p);
        const VectorXd own = root * normal_matrix(2 * p, 1, 300 + k + seed);
        cycle.points += (cycle.common.topRows(2 * p) * shared / error + own).reshaped(2, p);
        cycles.push_back(std::move(cycle));
    }
    return cycles;
}

struct HenonCase {
    std::shared_ptr<const models::System> system = models::make_system("henon", {});
    models::ParameterBinding binding;
    VectorXd truth = Eigen::Vector2d(1.4, 0.3);
    HenonCase() {
        binding.base = truth;
        binding.parameter = {0, 1};
        binding.estimated = {0, 1};
        binding.estimated_count = 2;
    }
};

/// Sum over the active blocks, as the estimator takes them: independent.
double by_blocks(const orbits::CycleResidual& residual, const estimator::ActiveSet& active, const VectorXd& theta) {
    const auto values = residual.evaluate(active, theta, {}, false);
    double sum = 0.0;
    for (std::size_t b = 0; b < values.size(); ++b)
        if (active.layout[b].active) sum += minus_log_density(values[b].e, active.layout[b].shape);
    return sum;
}

/// The same from the covariance of all records of these cycles at once.
double dense(const std::vector<orbits::Cycle>& cycles, const orbits::CycleResidual& plain, const VectorXd& theta) {
    const auto values = plain.evaluate(plain.initial_set(), theta, {}, false);
    Index records = 0;
    for (const auto& cycle : cycles)
        records += cycle.points.size();
    VectorXd e(records);
    MatrixXd common(records, 3), covariance = MatrixXd::Zero(records, records);
    Index first = 0;
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        const Index own = cycles[c].points.size();
        REQUIRE(values.at(c).e.size() == own);
        e.segment(first, own) = values[c].e;
        const MatrixXd g = cycles[c].common.topRows(own);
        common.middleRows(first, own) = g;
        covariance.block(first, first, own, own) = cycles[c].covariance - g * g.transpose();
        first += own;
    }
    covariance += common * common.transpose();
    return minus_log_density(e, covariance);
}

std::vector<orbits::Cycle> alone(std::vector<orbits::Cycle> cycles) {
    for (orbits::Cycle& cycle : cycles)
        cycle.common.resize(0, 0);
    return cycles;
}

}  // namespace

TEST_CASE("innovations of blocks with common errors multiply to the joint density", "[orbits][cycles]") {
    const std::vector<Index> sizes{2, 5, 1, 4, 7};
    constexpr Index columns = 4, records = 19;
    const MatrixXd common = normal_matrix(records, columns, 1), error = normal_matrix(records, 3, 2);
    MatrixXd covariance = common * common.transpose();
    orbits::CommonErrorFilter filter(columns);
    orbits::CommonErrorMean mean(columns, 3);
    VectorXd sum = VectorXd::Zero(3);
    Index first = 0;
    for (const Index size : sizes) {
        const MatrixXd root = normal_matrix(size, size, 10 + static_cast<unsigned>(first));
        const MatrixXd own = root * root.transpose() + MatrixXd::Identity(size, size);
        covariance.block(first, first, size, size) += own;
        const MatrixXd g = common.middleRows(first, size);
        const orbits::CommonErrorStep step = filter.next(g, own, true);
        MatrixXd e = error.middleRows(first, size);
        mean.take_from(g, e);
        mean.learn(step.gain, e);
        for (Index k = 0; k < 3; ++k)
            sum[k] += minus_log_density(e.col(k), step.shape);
        first += size;
    }
    // Rounding of matrices of condition 1e3, times ten.
    for (Index k = 0; k < 3; ++k)
        CHECK(std::abs(sum[k] - minus_log_density(error.col(k), covariance)) < 1e-11);
}

TEST_CASE("common errors need as many columns as there are directions", "[orbits][cycles]") {
    // 6 directions in 500 coefficients, and a remainder of 1e-4 of their variance in all others.
    const MatrixXd directions = normal_matrix(6, 500, 3);
    std::vector<orbits::Cycle> cycles(5);
    MatrixXd before(0, 500);
    for (std::size_t c = 0; c < cycles.size(); ++c) {
        if (c == 2) continue;  // one that shares nothing
        cycles[c].common = normal_matrix(8, 6, 20 + static_cast<unsigned>(c)) * directions +
                           1e-2 * normal_matrix(8, 500, 40 + static_cast<unsigned>(c));
        before.conservativeResize(before.rows() + 8, 500);
        before.bottomRows(8) = cycles[c].common;
    }
    orbits::shorten_common_errors(cycles);
    CHECK(cycles[2].common.size() == 0);
    MatrixXd after(0, 6);
    for (const orbits::Cycle& cycle : cycles) {
        if (cycle.common.size() == 0) continue;
        REQUIRE(cycle.common.rows() == 8);
        REQUIRE(cycle.common.cols() == 6);
        after.conservativeResize(after.rows() + 8, 6);
        after.bottomRows(8) = cycle.common;
    }
    const MatrixXd exact = before * before.transpose(), short_form = after * after.transpose();
    const VectorXd sd = exact.diagonal().cwiseSqrt();
    const MatrixXd left = sd.cwiseInverse().asDiagonal() * (exact - short_form) * sd.cwiseInverse().asDiagonal();
    CHECK(left.cwiseAbs().maxCoeff() <= orbits::shared_remainder);
    CHECK(left.diagonal().minCoeff() > -1e-12);  // never more than there is
}

TEST_CASE("cycles of one map: the product over the blocks is their joint density", "[orbits][cycles]") {
    const HenonCase henon;
    const auto cycles = henon_cycles(1e-3, 1);
    const orbits::CycleResidual residual(henon.system, henon.binding, cycles, 0.0, henon.truth);
    const orbits::CycleResidual plain(henon.system, henon.binding, alone(cycles), 0.0, henon.truth);
    for (const auto& theta : {henon.truth, VectorXd(Eigen::Vector2d(1.4004, 0.2998))}) {
        const double joint = dense(cycles, plain, theta);
        // Orbits are solved to 1e-12, errors are 1e-4 of their sds at most of that; condition 1e3.
        CHECK(std::abs(by_blocks(residual, residual.initial_set(), theta) - joint) < 1e-6 * std::abs(joint));
        // As if they were independent it is another one.
        CHECK(std::abs(by_blocks(plain, plain.initial_set(), theta) - joint) > 1.0);
    }
}

TEST_CASE("cycles of one map: derivatives of what is left, and a cycle that is left out", "[orbits][cycles]") {
    const HenonCase henon;
    auto cycles = henon_cycles(1e-3, 2);
    const orbits::CycleResidual residual(henon.system, henon.binding, cycles, 0.0, henon.truth);
    const auto set = residual.initial_set();
    const auto at = residual.evaluate(set, henon.truth, {}, true);
    for (Index k = 0; k < 2; ++k) {
        constexpr double h = 1e-6;
        const VectorXd up = henon.truth + h * VectorXd::Unit(2, k), down = henon.truth - h * VectorXd::Unit(2, k);
        const auto above = residual.evaluate(set, up, {}, false), below = residual.evaluate(set, down, {}, false);
        for (std::size_t b = 0; b < at.size(); ++b)
            CHECK(((above[b].e - below[b].e) / (2.0 * h) - at[b].e_theta.col(k)).cwiseAbs().maxCoeff() < 1e-5);
    }
    // A gross error of cycle 1 is rejected; the others are then what they are without it.
    cycles[1].points.row(0).array() += 0.02;
    const orbits::CycleResidual moved(henon.system, henon.binding, cycles, 0.0, henon.truth);
    auto active = moved.initial_set();
    const auto report = moved.update_active_set(active, henon.truth, {}, VectorXd::Ones(2));
    CHECK(report.rejected == 1);
    CHECK_FALSE(active.layout[1].active);
    std::vector<orbits::Cycle> others = cycles;
    others.erase(others.begin() + 1);
    const orbits::CycleResidual plain(henon.system, henon.binding, alone(others), 0.0, henon.truth);
    const double joint = dense(others, plain, henon.truth);
    CHECK(std::abs(by_blocks(moved, active, henon.truth) - joint) < 1e-6 * std::abs(joint));
    // Held out for a validation it still tells about the next ones: their density given all cycles before them.
    auto fold = set;
    fold.layout.edit()[0].active = false;
    const auto held = residual.evaluate(fold, henon.truth, {}, false);
    CHECK(held[0].e.size() == 0);
    for (std::size_t b = 1; b < held.size(); ++b)
        CHECK(held[b].e == at[b].e);
}

TEST_CASE("cycles with common errors of different maps are refused", "[orbits][cycles]") {
    const HenonCase henon;
    auto cycles = henon_cycles(1e-3, 3);
    cycles[2].common = MatrixXd::Zero(10, 5);
    CHECK_THROWS_AS(orbits::CycleResidual(henon.system, henon.binding, cycles, 0.0, henon.truth),
                    std::invalid_argument);
    cycles[2].common = MatrixXd::Zero(7, 3);
    CHECK_THROWS_AS(orbits::CycleResidual(henon.system, henon.binding, cycles, 0.0, henon.truth),
                    std::invalid_argument);
}

}  // namespace common_errors_test
