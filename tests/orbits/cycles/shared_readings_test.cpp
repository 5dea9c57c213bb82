// Errors of cycles of a noisy sheet, as the errors of the section's points and times make them.
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include <Eigen/Cholesky>

#include "orbits/cycles/cycle_candidate.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/sections/section_points.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/measured_cycles.hpp"
#include "tests/orbits/sections/map_series.hpp"

namespace shared_readings_test {

using namespace orbid;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using orbits::Cycle;

namespace {

constexpr double point_sd = 0.002, time_sd = 0.002;
const Eigen::Vector2d rates(1.0, -0.5);

// x -> 1 - 2 x^2 with return times 1 + x / 4, and a second coordinate on a straight sheet. A late crossing has moved
// on.
orbits::Series crossings(Index count, std::uint64_t seed) {
    orbits::Series series = tests::section_series({{"x", "", false}, {"y", "", false}}, {MatrixXd(2, count)});
    tests::NormalNumbers normal(seed);
    orbits::Segment& segment = series.segments[0];
    segment.times.resize(count);
    double x = 0.2 + 0.1 * normal.uniform(), time = 0.0;
    for (Index i = 0; i < count; ++i) {
        const double late = time_sd * normal();
        segment.values.col(i) << x + point_sd * normal() + rates[0] * late,
            0.5 * x + point_sd * normal() + rates[1] * late;
        segment.times[i] = time + late;
        time += 1.0 + 0.25 * x;
        x = 1.0 - 2.0 * x * x;
    }
    segment.rates = rates.replicate(1, count);
    segment.time_deviations = VectorXd::Constant(count, time_sd);
    segment.deviations = (point_sd * point_sd + (time_sd * rates).array().square()).sqrt().matrix().replicate(1, count);
    return series;
}

orbits::CycleSearchOptions sheet_options() {
    orbits::CycleSearchOptions options;
    options.periods = {1, 2};
    options.box = 0.1;
    options.minimum_recurrences = 1;
    options.reading_covariance =
        MatrixXd(point_sd * point_sd * MatrixXd::Identity(2, 2) + time_sd * time_sd * rates * rates.transpose());
    return options;
}

// The true cycle: x = 1/2, or (1 +- sqrt 5) / 4.
struct Truth {
    VectorXd x;
    [[nodiscard]] VectorXd records(const Cycle& cycle) const {
        VectorXd e(cycle.points.size() + 1);
        const Index first = cycle.points(0, 0) < 0.0 && x.size() > 1 ? 1 : 0;
        for (Index j = 0; j < x.size(); ++j) {
            const double own = x[(j + first) % x.size()];
            e.segment(2 * j, 2) = cycle.points.col(j) - Eigen::Vector2d(own, 0.5 * own);
        }
        e[e.size() - 1] = cycle.time - static_cast<double>(x.size()) - 0.25 * x.sum();
        return e;
    }
};

std::optional<Cycle> near(const std::vector<Cycle>& cycles, const Truth& truth) {
    for (const Cycle& cycle : cycles)
        if (cycle.points.cols() == truth.x.size() && std::abs(cycle.points.row(0).sum() - truth.x.sum()) < 0.1)
            return cycle;
    return std::nullopt;
}

MatrixXd with_time(const Cycle& cycle) {
    const Index points = cycle.points.size();
    MatrixXd all(points + 1, points + 1);
    all << cycle.covariance, cycle.time_covariance, cycle.time_covariance.transpose(), cycle.time_sd * cycle.time_sd;
    return all;
}

// Rows of the points and of the time: multipliers have none.
MatrixXd shared(const Cycle& cycle) {
    const Index points = cycle.points.size();
    REQUIRE(cycle.common.rows() == points + cycle.ln_multiplier.size() + 1);
    CHECK(cycle.common.middleRows(points, cycle.ln_multiplier.size()).isZero(0.0));
    MatrixXd rows(points + 1, cycle.common.cols());
    rows << cycle.common.topRows(points), cycle.common.bottomRows(1);
    return rows;
}

}  // namespace

TEST_CASE("cycles of a noisy sheet have the errors that their joint covariance says", "[orbits][cycles][sheet]") {
    const Truth fixed{VectorXd::Constant(1, 0.5)};
    const Truth pair{Eigen::Vector2d(0.25 * (1.0 + std::sqrt(5.0)), 0.25 * (1.0 - std::sqrt(5.0)))};
    constexpr int records = 24;
    std::vector<VectorXd> errors;
    std::vector<MatrixXd> covariances;
    for (int seed = 1; seed <= records; ++seed) {
        CAPTURE(seed);
        const auto found = find_cycles(crossings(3000, static_cast<std::uint64_t>(seed)), sheet_options());
        const auto one = near(found.cycles, fixed), two = near(found.cycles, pair);
        if (!one || !two) continue;
        VectorXd e(8);
        e << fixed.records(*one), pair.records(*two);
        MatrixXd covariance = MatrixXd::Zero(8, 8);
        covariance.topLeftCorner(3, 3) = with_time(*one);
        covariance.bottomRightCorner(5, 5) = with_time(*two);
        covariance.topRightCorner(3, 5) = shared(*one) * shared(*two).transpose();
        covariance.bottomLeftCorner(5, 3) = covariance.topRightCorner(3, 5).transpose();
        errors.push_back(e);
        covariances.push_back(covariance);
    }
    REQUIRE(errors.size() >= records - 2);
    const auto count = static_cast<double>(errors.size());
    VectorXd mean = VectorXd::Zero(8), sd = mean;
    for (std::size_t i = 0; i < errors.size(); ++i) {
        mean += errors[i] / count;
        sd += covariances[i].diagonal().cwiseSqrt() / count;
    }
    // What the curvature of the map makes of the errors of places stays below the sds; two more by chance are 0.4 sds.
    CAPTURE(mean.cwiseQuotient(sd).transpose());
    CHECK(mean.cwiseQuotient(sd).cwiseAbs().maxCoeff() < 1.0);
    double joint = 0.0, of_times = 0.0;
    for (std::size_t i = 0; i < errors.size(); ++i) {
        const VectorXd e = errors[i] - mean;
        const Eigen::LLT<MatrixXd> factor(covariances[i]);
        REQUIRE(factor.info() == Eigen::Success);
        joint += e.dot(factor.solve(e)) / (8.0 * (count - 1.0));
        of_times += (e[2] * e[2] / covariances[i](2, 2) + e[7] * e[7] / covariances[i](7, 7)) / (2.0 * (count - 1.0));
    }
    CAPTURE(joint, of_times);
    // Four sds of the mean square of 184 and 46 normal numbers; what the choice of the fits adds makes them smaller.
    CHECK(std::abs(joint - 1.0) < 0.42);
    CHECK(std::abs(of_times - 1.0) < 0.84);
}

TEST_CASE("without errors of times cycles of a sheet share none that are known", "[orbits][cycles][sheet]") {
    orbits::Series series = crossings(3000, 1);
    series.segments[0].time_deviations.resize(0);
    const auto found = find_cycles(series, sheet_options());
    REQUIRE(!found.cycles.empty());
    for (const Cycle& cycle : found.cycles) {
        CHECK(cycle.common.size() == 0);
        CHECK(cycle.time_covariance.size() == cycle.points.size());
        CHECK(Eigen::LLT<MatrixXd>(with_time(cycle)).info() == Eigen::Success);
    }
}

TEST_CASE("mirrored halves of a cycle have the same errors", "[orbits][cycles]") {
    orbits::Series series = tests::section_series({{"x", "", false}}, {MatrixXd(1, 4)});
    series.segments[0].values << -1.0, 1.0, -1.1, 1.1;
    const orbits::SectionPoints section(series, std::vector<double>{-1.0}, VectorXd::Ones(1));
    orbits::CycleCandidate draft;
    draft.points = Eigen::RowVector2d(-1.0, 1.0);
    draft.covariance = Eigen::Matrix2d{{3.0, 1.0}, {1.0, 3.0}};
    draft.time = 2.0;
    draft.time_sd = 0.5;
    draft.time_covariance = Eigen::Vector2d(0.25, -0.25);
    std::vector<Cycle> cycles;
    publish(section, draft, 0.1, cycles);
    REQUIRE(cycles.size() == 1);
    // Fits of both halves are taken as independent, but are one: the errors of their sums have twice the variance.
    CHECK(cycles[0].covariance == Eigen::Matrix2d{{6.0, 2.0}, {2.0, 6.0}});
    CHECK(cycles[0].time_covariance == Eigen::Vector2d(0.5, -0.5));
    CHECK(std::abs(cycles[0].time_sd - 0.5 * std::sqrt(2.0)) < 1e-15);
    // Errors by readings know it: x_1 = -x_0 always. Only that sum, which no symmetric model changes, becomes
    // uncertain.
    draft.readings.points = {0};
    draft.covariance = Eigen::Matrix2d{{3.0, -3.0}, {-3.0, 3.0}};
    cycles.clear();
    publish(section, draft, 0.1, cycles);
    REQUIRE(cycles.size() == 1);
    const Eigen::Vector2d moving(1.0, -1.0), still(1.0, 1.0);
    CHECK(moving.dot(cycles[0].covariance * moving) == 12.0);
    CHECK(still.dot(cycles[0].covariance * still) > 1.0);
    CHECK(cycles[0].time_covariance == draft.time_covariance);
    CHECK(cycles[0].time_sd == 0.5);
}

}  // namespace shared_readings_test
