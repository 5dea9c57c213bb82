// Courses on the wrong side of a symmetry, against the course that made the record.
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "identification/problem/estimated_values.hpp"
#include "identification/problem/problem_residuals.hpp"
#include "identification/starts/course_repair.hpp"
#include "identification/starts/series_attempt.hpp"
#include "identification/strategy/identify.hpp"
#include "models/equations/equation_text.hpp"
#include "orbits/simulation/virtual_experiment.hpp"
#include "tests/catch.hpp"

namespace course_repair_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::MatrixXd;

namespace {

constexpr Index interval = 6;
constexpr double gain = 0.6, offset = 12.0, noise = 0.5;

/// Lorenz's equations, of which gain x^2 + offset is read: nothing tells (x, y, z) from (-x, -y, z).
struct Laser {
    std::shared_ptr<const models::System> system;
    MatrixXd course;  ///< states at the samples
    identification::IdentificationProblem problem;
};

Laser laser() {
    models::EquationText text;
    text.coordinates = {{"x", "s * (y - x)"}, {"y", "x * (r - z) - y"}, {"z", "x * y - b * z"}};
    text.parameters = {{"s", "1", models::positive, 10.0},
                       {"r", "1", models::positive, 28.0},
                       {"b", "1", models::positive, 8.0 / 3.0}};
    std::vector<models::EquationProblem> problems;
    Laser result;
    result.system = models::system_from_text(text, problems);
    REQUIRE(problems.empty());
    orbits::VirtualExperimentOptions options;
    options.plan = orbits::SamplePlan{0.02, 600, 1000};
    options.initial = Eigen::Vector3d(1.0, 1.3, 20.0);
    const Eigen::VectorXd values = result.system->default_parameters();
    result.course = orbits::simulate(*result.system, values, options).series.segments[0].values;
    models::Sensor sensor;
    sensor.type = models::Sensor::Type::function;
    const auto names = models::reading_names(result.system->coordinates(), result.system->parameters(), {});
    sensor.functions.push_back({0, models::Expression::parse("0.6 * x^2 + 12", names)});
    options.sensor = sensor;
    options.noise = Eigen::Vector3d(noise, 0.0, 0.0);
    options.seed = 7;
    orbits::Series series = orbits::simulate(*result.system, values, options).series;
    series.coordinates.resize(1);
    series.segments[0].values = series.segments[0].values.row(0).eval();
    identification::IdentificationProblem problem;
    problem.system = result.system;
    problem.experiments.emplace_back();
    problem.experiments[0].series = std::make_shared<const orbits::Series>(std::move(series));
    problem.experiments[0].sensor = sensor;
    for (const auto& [name, start] : {std::pair{"s", 10.1}, std::pair{"r", 27.9}, std::pair{"b", 2.65}})
        problem.parameters.push_back(identification::free_parameter(*result.system, name, start));
    problem.series.emplace();
    problem.series->data = {0};
    problem.series->interval = interval;
    result.problem = identification::completed(problem);
    return result;
}

identification::SeriesStart start_on(const MatrixXd& course) {
    identification::SeriesStart start;
    start.theta = Eigen::Vector3d(10.0, 28.0, 8.0 / 3.0);
    start.intervals = {static_cast<std::size_t>(interval)};
    start.nodes = {{course(Eigen::all, Eigen::seq(0, course.cols() - 1, interval))}};
    start.reading_sds = {{noise}};
    start.follows = true;
    return start;
}

/// The same with x and y turned after the nodes that come nearest to x = y = 0.
identification::SeriesStart on_wrong_sides(const MatrixXd& course, int places) {
    identification::SeriesStart start = start_on(course);
    MatrixXd& nodes = start.nodes[0][0];
    Eigen::VectorXd near = nodes.topRows(2).colwise().norm();
    near.head(10).setConstant(1e9);
    near.tail(10).setConstant(1e9);
    for (int k = 0; k < places; ++k) {
        Index at = 0;
        near.minCoeff(&at);
        nodes.topRightCorner(2, nodes.cols() - at - 1) *= -1.0;
        near.segment(at - 5, 11).setConstant(1e9);
    }
    return start;
}

/// Nodes from which on the signs of x and y are not those of the course, or no longer.
int wrong_places(const MatrixXd& course, const MatrixXd& nodes) {
    int count = 0;
    double before = 0.0;
    for (Index k = 0; k < nodes.cols(); ++k) {
        const Eigen::VectorXd truth = course.col(k * interval);
        const double same = (nodes.col(k) - truth).head(2).norm(), other = (nodes.col(k) + truth).head(2).norm();
        const double side = same < other ? 1.0 : -1.0;
        if (k > 0 && side != before) ++count;
        before = side;
    }
    return count;
}

/// Attempts with the record of the laser, which has two sides.
struct Search {
    Laser data = laser();
    identification::EstimateSetup setup =
        identification::estimate_setup(data.problem, identification::fitted_labels(data.problem));
    identification::SeriesSearch options = two_sides();
    identification::SeriesAttempts attempts{data.problem, setup, setup.parameters, options};

    [[nodiscard]] identification::CourseRepair repaired(const identification::SeriesAttempt& one,
                                                        const identification::RepairLimits& limits = {}) const {
        return identification::repaired_course(data.problem, setup, setup.parameters, options.signs, one.start,
                                               one.estimate, options.estimate, limits);
    }

private:
    static identification::SeriesSearch two_sides() {
        identification::SeriesSearch search;
        search.signs = {{"x", "y"}};
        return search;
    }
};

}  // namespace

TEST_CASE("a course on the wrong side of a symmetry is repaired", "[identification][series]") {
    Search on;
    const identification::SeriesAttempt right = on.attempts.make("truth", start_on(on.data.course));
    REQUIRE(right.start.follows);
    for (const int places : {1, 2}) {
        CAPTURE(places);
        const identification::SeriesAttempt wrong = on.attempts.make("wrong", on_wrong_sides(on.data.course, places));
        // No minimisation gets to the other side.
        REQUIRE(wrong_places(on.data.course, wrong.start.nodes[0][0]) == places);
        CHECK(wrong.misfit > right.misfit + 0.1);
        const identification::SeriesAttempt mended = on.attempts.on_better_sides(wrong);
        CHECK(mended.start.follows);
        CHECK(wrong_places(on.data.course, mended.start.nodes[0][0]) == 0);
        const std::array<double, 3> truth{10.0, 28.0, 8.0 / 3.0};
        for (std::size_t i = 0; i < truth.size(); ++i) {
            const estimator::Estimated& one = mended.estimate.parameters[i];
            CAPTURE(one.name, one.value, one.laplace_sd);
            CHECK(std::abs(one.value - truth[i]) < 4.0 * one.laplace_sd);
            // The same minimum as from the truth, to a small part of the sd.
            CHECK(std::abs(one.value - right.estimate.parameters[i].value) < 0.05 * one.laplace_sd);
        }
    }
}

TEST_CASE("hidden states are followed anew from where an attempt has ended", "[identification][series]") {
    Laser data = laser();
    const std::array<double, 3> truth{10.0, 28.0, 8.0 / 3.0}, off{0.4, 0.5, 0.5};
    for (std::size_t i = 0; i < truth.size(); ++i)
        data.problem.parameters[i].value.start = off[i] * truth[i];
    /// Keeps what is told of attempts.
    struct Log final : identification::Observer {
        void detail(const std::string& line) override {
            if (line.starts_with("attempt")) lines.push_back(line);
        }
        std::vector<std::string> lines;
    } log;
    const auto result = identification::identify(data.problem, identification::Options{}, log);
    // From the job's start many places are on wrong sides; from the parameters that this gives none.
    REQUIRE(log.lines.size() == 2);
    CHECK_THAT(log.lines[0], ContainsSubstring("attempt 1 (start)") && !ContainsSubstring("explains"));
    CHECK_THAT(log.lines[1],
               ContainsSubstring("attempt 1 (states anew)") && ContainsSubstring("explains the readings"));
    CHECK(result.estimate.status == estimator::EstimateStatus::converged);
    for (std::size_t i = 0; i < truth.size(); ++i) {
        const estimator::Estimated& one = result.estimate.parameters[i];
        CHECK_THAT(one.value, WithinAbs(truth[i], 4.0 * one.sd));
    }
}

TEST_CASE("a right course is left as it is", "[identification][series]") {
    Search on;
    const identification::SeriesAttempt right = on.attempts.make("truth", start_on(on.data.course));
    const auto repair = on.repaired(right);
    CHECK(repair.changed == 0);
    CHECK((repair.start.nodes[0][0] - right.start.nodes[0][0]).norm() == 0.0);
}

TEST_CASE("pieces of a course end where they would cost too much", "[identification][series]") {
    Search on;
    const identification::SeriesAttempt wrong = on.attempts.make("wrong", on_wrong_sides(on.data.course, 1));
    const auto any = on.repaired(wrong);
    REQUIRE(any.changed == 1);
    CHECK(any.work > 1000);
    // Every piece ends at its first look: what that costs is still more than half of all.
    const auto scarce = on.repaired(wrong, {.work = 1});
    CHECK(scarce.changed == 0);
    CHECK(scarce.work < any.work);
    CHECK((scarce.start.nodes[0][0] - wrong.start.nodes[0][0]).norm() == 0.0);
    // A flow that may take one step alone comes nowhere.
    CHECK(on.repaired(wrong, {.flow = {1e-11, 1e-11, 1}}).changed == 0);
    // The limit of an attempt is that of pieces, too: an eighth of it.
    std::string said;
    on.options.log = [&](const std::string& line) { said += line; };
    on.attempts.limit(8, any.work);
    (void)on.attempts.on_better_sides(wrong);
    CHECK(said.empty());
    on.attempts.limit(1000 * any.work, 1000 * any.work);
    (void)on.attempts.on_better_sides(wrong);
    CHECK_THAT(said, ContainsSubstring("the other side suits 1 places better"));
}

TEST_CASE("attempts at the same parameters follow the record once", "[identification][series]") {
    const Laser data = laser();
    const auto setup = identification::estimate_setup(data.problem, identification::fitted_labels(data.problem));
    identification::FollowedRecords followed;
    const auto nodes_of = [&](std::size_t every, double s) {
        identification::SeriesStart start;
        start.theta = Eigen::Vector3d(s, 28.0, 8.0 / 3.0);
        start.intervals = {every};
        start.follows = true;
        identification::ProblemResiduals residuals;
        identification::add_shooting(data.problem, setup, start, residuals, std::nullopt, &followed);
        return residuals.shooting.front()->initial_latents();
    };
    const auto six = nodes_of(6, 10.0);
    const std::uint64_t once = followed.work;
    CHECK(once > 0);
    const auto three = nodes_of(3, 10.0);
    CHECK(followed.work == once);
    for (std::size_t k = 0; k < six.size(); ++k)
        CHECK((six[k] - three[2 * k]).norm() == 0.0);
    // Other parameters have states of their own.
    const auto other = nodes_of(6, 10.4);
    CHECK(followed.work > once);
    CHECK((other[10] - six[10]).norm() > 0.0);
}

TEST_CASE("a piece of a record has its own readings", "[identification][series]") {
    const Laser data = laser();
    const auto setup = identification::estimate_setup(data.problem, identification::fitted_labels(data.problem));
    const identification::SeriesStart start = start_on(data.course);
    const Index first = 20, count = 8;
    const MatrixXd nodes = start.nodes[0][0].middleCols(first, count);
    const auto piece = identification::shooting_piece(data.problem, setup, start, {0, 0, first}, nodes);
    REQUIRE(std::ssize(piece->layout()) == count);
    const auto set = piece->initial_set();
    CHECK(set.groups[0].scale.value == noise);
    CHECK_FALSE(set.groups[0].scale.estimate);
    const auto values = piece->evaluate(set, start.theta, piece->initial_latents(), true);
    const auto& read = data.problem.experiments[0].series->segments[0].values;
    for (Index k = 0; k < count; ++k) {
        const double x = nodes(0, k);
        const double expected = read(0, (first + k) * interval) - (gain * x * x + offset);
        CHECK_THAT(values[static_cast<std::size_t>(k)].e[0], WithinAbs(expected, 1e-12));
    }
    // Evaluations of the same cost the same.
    const std::uint64_t before = piece->work();
    (void)piece->evaluate(set, start.theta, piece->initial_latents(), true);
    const std::uint64_t once = piece->work() - before;
    (void)piece->evaluate(set, start.theta, piece->initial_latents(), true);
    CHECK(once > 0);
    CHECK(piece->work() - before == 2 * once);
}

TEST_CASE("an attempt ends where it would cost too much", "[identification][series]") {
    const Laser data = laser();
    const auto setup = identification::estimate_setup(data.problem, identification::fitted_labels(data.problem));
    const identification::SeriesSearch search;
    identification::SeriesAttempts attempts(data.problem, setup, setup.parameters, search);
    attempts.limit(1, 1000000);
    const identification::SeriesAttempt one = attempts.make("costly", start_on(data.course));
    CHECK(one.cut);
    CHECK(one.estimate.status == estimator::EstimateStatus::interrupted);
    CHECK_FALSE(one.start.follows);
    CHECK(attempts.work() > 1);
}

}  // namespace course_repair_test
