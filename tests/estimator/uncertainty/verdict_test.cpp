// The normal approximation is to be trusted where intervals from it are right: tests of heavy tails are with their
// reference posteriors (michaelis_menten_test.cpp), of well-behaved posteriors there and here.

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"
#include "tests/estimator/minimisation/nist_problems.hpp"
#include "tests/source_folder.hpp"

namespace orbid::tests::verdict_test {

TEST_CASE("NIST's Thurber is nonlinear but near enough to normal", "[estimator][reference]") {
    const NistProblem problem = read_nist_problem(orbid::tests::source_folder() + "/tests/reference/nist", "Thurber");
    FunctionResidual residual = residual_of(problem.sum, group("y"));
    std::vector<estimator::FreeParameter> parameters;
    for (std::size_t i = 0; i < problem.value.size(); ++i) {
        parameters.push_back(free_parameter("b" + std::to_string(i + 1), problem.starts[1][i]));
        parameters.back().typical_size = std::abs(problem.starts[1][i]);
    }
    const auto result = estimator::estimate(parameters, {&residual});
    CAPTURE(result.message, result.distrust);
    REQUIRE(result.status == estimator::EstimateStatus::converged);
    CHECK(result.trust_normal);
}

}  // namespace orbid::tests::verdict_test
