// Problems 1 to 19 of More, Garbow and Hillstrom, ACM TOMS 7:17-41 (1981), from 1, 10 and 100 times their starts, and
// ten of them within bounds. The error scale is known (1): sums of squares may vanish at the minimum.

#include <algorithm>
#include <cmath>
#include <memory>

#include "estimator/estimate/estimate.hpp"
#include "estimator/exploration/multi_start.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/minimisation/mgh_problems.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests::mgh_test {

namespace {

std::vector<MghProblem> read() {
    return read_mgh_problems(orbid::tests::source_folder() + "/tests/reference/mgh/mgh.json");
}

std::vector<estimator::FreeParameter> parameters_of(const MghProblem& problem, double factor, bool within_bounds) {
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
    return parameters;
}

std::vector<double> values_of(const estimator::Estimate& estimate) {
    std::vector<double> x;
    for (const estimator::Estimated& parameter : estimate.parameters)
        x.push_back(parameter.value);
    return x;
}

/// Sum of squares where one estimate from the start ends.
double reached(const MghProblem& problem, double factor, bool within_bounds) {
    FunctionResidual residual = residual_of(within_bounds ? problem.bounded_sum : problem.sum, group("y", 1.0, false));
    estimator::EstimateOptions options;
    options.maximum_iterations = 5000;
    options.verdict = false;
    const std::vector<double> x =
        values_of(estimator::estimate(parameters_of(problem, factor, within_bounds), {&residual}, {}, options));
    return within_bounds ? problem.bounded_value(x) : problem.value(x);
}

/// Sum of squares at the best of 100 starts. The error scale is known, and what is asked for is the highest density
/// (ml), not the largest mass around it.
double searched(const MghProblem& problem, double factor) {
    estimator::MultiStartOptions options;
    options.starts = 100;
    options.estimate.maximum_iterations = 1000;
    options.estimate.verdict = false;
    options.estimate.variance = estimator::Variance::ml;
    const auto residuals = [&problem] {
        std::vector<std::unique_ptr<estimator::Residual>> result;
        result.push_back(std::make_unique<FunctionResidual>(residual_of(problem.sum, group("y", 1.0, false))));
        return result;
    };
    return problem.value(
        values_of(estimator::multi_start(parameters_of(problem, factor, false), residuals, {}, options).best));
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
        problem.sum.row_by_row(x.data(), e.data(), jacobian.data());
        for (std::size_t k = 0; k < q; ++k) {
            const double h = 1e-5 * std::max(std::abs(x[k]), 0.1);
            std::vector<double> above = x;
            std::vector<double> below = x;
            above[k] += h;
            below[k] -= h;
            std::vector<double> e_above(n);
            std::vector<double> e_below(n);
            problem.sum.values(above.data(), e_above.data());
            problem.sum.values(below.data(), e_below.data());
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
    CHECK(successes == 10);
}

TEST_CASE("More-Garbow-Hillstrom problems from near and far", "[estimator][reference]") {
    int successes = 0;
    int found = 0;
    int runs = 0;
    for (const MghProblem& problem : read())
        for (const double factor : {1.0, 10.0, 100.0}) {
            ++runs;
            const bool alone = reaches(reached(problem, factor, false), problem.minimum);
            if (alone) ++successes;
            if (alone || reaches(searched(problem, factor), problem.minimum)) ++found;
        }
    CHECK(runs == 57);
    // Measured 46. The others end in other minima (2), where parameters run to infinity (5, 19) or where nothing has
    // an effect any more (6 overflows at its start, 11).
    CHECK(successes >= 45);
    // Not found: Osborne's second function from 10 and 100 times its start, eleven parameters all that far away.
    CHECK(found >= 55);
}

}  // namespace orbid::tests::mgh_test
