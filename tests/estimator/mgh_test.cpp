// Problems 1 to 19 of More, Garbow and Hillstrom, ACM TOMS 7:17-41 (1981), from 1, 10 and 100 times their starts, and
// ten of them within bounds. The error scale is known (1): sums of squares may vanish at the minimum.

#include <algorithm>
#include <cmath>

#include "estimator/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/mgh_problems.hpp"

namespace orbid::tests {

namespace {

std::vector<MghProblem> read() {
    return read_mgh_problems(std::string(ORBID_SOURCE_DIR) + "/tests/reference/mgh/mgh.json");
}

/// Sum of squares where one estimate from the start ends.
double reached(const MghProblem& problem, double factor, bool within_bounds) {
    FunctionResidual residual = residual_of(problem.sum, group("y", 1.0, false));
    std::vector<estimator::FreeParameter> parameters;
    for (std::size_t i = 0; i < problem.start.size(); ++i) {
        double start = factor * problem.start[i];
        if (within_bounds) start = std::clamp(start, problem.lower[i], problem.upper[i]);
        parameters.push_back(free_parameter("x" + std::to_string(i + 1), start));
        if (start != 0.0) parameters.back().typical_size = std::abs(start);
        if (!within_bounds) continue;
        parameters.back().lower = problem.lower[i];
        parameters.back().upper = problem.upper[i];
    }
    estimator::EstimateOptions options;
    options.maximum_iterations = 5000;
    options.verdict = false;
    const estimator::Estimate result = estimator::estimate(parameters, {&residual}, {}, options);
    std::vector<double> x;
    for (const estimator::Estimated& parameter : result.parameters)
        x.push_back(parameter.value);
    return problem.value(x);
}

}  // namespace

// The derivatives are those of the functions, at points that are nobody's start.
TEST_CASE("More-Garbow-Hillstrom problems: derivatives", "[estimator]") {
    for (const MghProblem& problem : read()) {
        CAPTURE(problem.name);
        const auto n = static_cast<std::size_t>(problem.sum.residuals);
        const auto q = problem.start.size();
        std::vector<double> x = problem.start;
        for (std::size_t i = 0; i < q; ++i)
            x[i] = 0.9 * x[i] + 0.1;
        std::vector<double> e(n);
        std::vector<double> jacobian(n * q);
        problem.sum.function(x.data(), e.data(), jacobian.data());
        for (std::size_t k = 0; k < q; ++k) {
            const double h = 1e-5 * std::max(std::abs(x[k]), 0.1);
            std::vector<double> above = x;
            std::vector<double> below = x;
            above[k] += h;
            below[k] -= h;
            std::vector<double> e_above(n);
            std::vector<double> e_below(n);
            problem.sum.function(above.data(), e_above.data(), nullptr);
            problem.sum.function(below.data(), e_below.data(), nullptr);
            for (std::size_t i = 0; i < n; ++i) {
                const double difference = (e_above[i] - e_below[i]) / (above[k] - below[k]);
                const double rounding = 1e-15 * std::abs(e[i]) / h;
                CHECK_THAT(jacobian[i * q + k],
                           WithinRel(difference, 1e-6) || WithinAbs(difference, 1e-8 + 10.0 * rounding));
            }
        }
    }
}

TEST_CASE("More-Garbow-Hillstrom problems within bounds", "[estimator][reference]") {
    int successes = 0;
    int runs = 0;
    for (const MghProblem& problem : read()) {
        if (!problem.bounded) continue;
        ++runs;
        if (reaches(reached(problem, 1.0, true), problem.bounded_minimum)) ++successes;
    }
    CHECK(runs == 10);
    CHECK(successes >= 9);
}

TEST_CASE("More-Garbow-Hillstrom problems from near and far", "[estimator][reference]") {
    int successes = 0;
    int runs = 0;
    for (const MghProblem& problem : read())
        for (const double factor : {1.0, 10.0, 100.0}) {
            ++runs;
            if (reaches(reached(problem, factor, false), problem.minimum)) ++successes;
        }
    CHECK(runs == 57);
    CHECK(successes >= 39);
}

}  // namespace orbid::tests
