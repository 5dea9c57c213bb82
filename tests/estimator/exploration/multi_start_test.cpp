#include "estimator/exploration/multi_start.hpp"

#include <atomic>
#include <cmath>
#include <limits>

#include <tbb/global_control.h>

#include "estimator/exploration/random_start.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::multi_start_test {

namespace {

/// One block with a known error scale of 1.
estimator::ResidualFactory factory(Eigen::Index records, const FunctionResidual::Function& function) {
    return [records, function] {
        auto residual = std::make_unique<FunctionResidual>();
        residual->add_group(group("e", 1.0, false));
        residual->add_block(layout("only", records), function);
        std::vector<std::unique_ptr<estimator::Residual>> list;
        list.push_back(std::move(residual));
        return list;
    };
}

/// e = (theta^2 - 1, (theta - 1) / 10): minima at 1, where it vanishes, and at (-1 - sqrt(0.98)) / 2.
estimator::BlockValue two_wells(const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
    estimator::BlockValue value;
    value.e = Eigen::Vector2d(theta[0] * theta[0] - 1.0, 0.1 * (theta[0] - 1.0));
    value.e_theta = Eigen::Vector2d(2.0 * theta[0], 0.1);
    value.e_z.resize(2, 0);
    return value;
}

/// Himmelblau's function: four points where it vanishes.
estimator::BlockValue himmelblau(const Eigen::VectorXd& theta, const Eigen::VectorXd&, bool) {
    const double x = theta[0];
    const double y = theta[1];
    estimator::BlockValue value;
    value.e = Eigen::Vector2d(x * x + y - 11.0, x + y * y - 7.0);
    value.e_theta.resize(2, 2);
    value.e_theta << 2.0 * x, 1.0, 1.0, 2.0 * y;
    value.e_z.resize(2, 0);
    return value;
}

estimator::FreeParameter bounded(std::string name, double start, double lower, double upper) {
    estimator::FreeParameter parameter = free_parameter(std::move(name), start);
    parameter.lower = lower;
    parameter.upper = upper;
    return parameter;
}

}  // namespace

TEST_CASE("multi-start finds both wells of one parameter", "[estimator]") {
    estimator::MultiStartOptions options;
    options.starts = 12;
    const auto result = multi_start({bounded("theta", -0.9, -3.0, 3.0)}, factory(2, two_wells), {}, options);
    CHECK(result.best.status == estimator::EstimateStatus::converged);
    CHECK_FALSE(result.interrupted);
    REQUIRE(result.optima.size() == 2);
    REQUIRE(result.runs.size() == 12);
    // Converged = the step that is left is below 1e-6 posterior sds, and the sd is 0.5.
    CHECK_THAT(result.best.parameters[0].value, WithinAbs(1.0, 5e-7));
    CHECK_THAT(result.optima[1].theta[0], WithinAbs(-0.5 - 0.5 * std::sqrt(0.98), 5e-7));
    // The given start is run 0 and ends in the worse well, from which the search got away.
    CHECK(result.runs[0].from[0] == -0.9);
    CHECK(result.runs[0].optimum == 1);
    CHECK(result.best_start > 0);
    CHECK(result.best.parameters[0].start == result.runs[static_cast<std::size_t>(result.best_start)].from[0]);
    std::size_t counted = 0;
    for (const estimator::Optimum& optimum : result.optima)
        counted += optimum.starts.size();
    CHECK(counted == 12);
}

TEST_CASE("multi-start finds the four zeros of Himmelblau's function, with any number of threads",
          "[estimator][threads]") {
    const std::vector<estimator::FreeParameter> parameters{bounded("x", 0.5, -6.0, 6.0), bounded("y", 0.5, -6.0, 6.0)};
    estimator::MultiStartOptions options;
    options.starts = 40;
    options.seed = 3;
    std::vector<estimator::MultiStart> results;
    for (const std::size_t threads : {1, 2, 4}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        results.push_back(multi_start(parameters, factory(2, himmelblau), {}, options));
    }
    REQUIRE(results[0].optima.size() == 4);
    // Printed in every collection of test functions; the first one is exact.
    const Eigen::Matrix<double, 4, 2> zeros{
        {3.0, 2.0}, {-2.805118, 3.131312}, {-3.779310, -3.283186}, {3.584428, -1.848126}};
    for (Eigen::Index k = 0; k < 4; ++k) {
        bool found = false;
        for (const estimator::Optimum& optimum : results[0].optima) {
            // Six printed decimals, and the posterior sds are below 0.2.
            if (!((optimum.theta.transpose() - zeros.row(k)).cwiseAbs().maxCoeff() < 1e-6)) continue;
            found = true;
            // Phi = 0 there up to the constant of two normal densities, and |H| = det(J)^2.
            const double determinant = std::abs(4.0 * optimum.theta[0] * optimum.theta[1] - 1.0);
            CHECK_THAT(
                optimum.objective - results[0].optima[0].objective,
                WithinAbs(std::log(determinant / std::abs(4.0 * results[0].optima[0].theta.prod() - 1.0)), 1e-5));
        }
        CHECK(found);
    }
    for (std::size_t k = 1; k < results.size(); ++k) {
        CHECK(results[k].best_start == results[0].best_start);
        REQUIRE(results[k].optima.size() == results[0].optima.size());
        for (std::size_t i = 0; i < results[k].runs.size(); ++i) {
            const estimator::StartedRun& one = results[0].runs[i];
            const estimator::StartedRun& other = results[k].runs[i];
            CHECK(one.from == other.from);
            CHECK(one.theta == other.theta);
            CHECK(one.objective == other.objective);
            CHECK(one.optimum == other.optimum);
        }
    }
    options.seed = 4;
    const auto other = multi_start(parameters, factory(2, himmelblau), {}, options);
    CHECK(other.runs[1].from != results[0].runs[1].from);
    CHECK(other.runs[0].from == results[0].runs[0].from);
}

TEST_CASE("multi-start looks at all starts first and takes the best on", "[estimator]") {
    const std::vector<estimator::FreeParameter> parameters{bounded("x", 0.5, -6.0, 6.0), bounded("y", 0.5, -6.0, 6.0)};
    estimator::MultiStartOptions options;
    options.starts = 30;
    options.screening_iterations = 2;
    options.kept = 5;
    const auto result = multi_start(parameters, factory(2, himmelblau), {}, options);
    CHECK(result.best.status == estimator::EstimateStatus::converged);
    std::size_t finished = 0;
    double worst_kept = -std::numeric_limits<double>::infinity();
    for (const estimator::StartedRun& run : result.runs) {
        finished += run.screened ? 0 : 1;
        if (run.screened) CHECK(run.optimum == -1);
        if (!run.screened) worst_kept = std::max(worst_kept, run.objective);
    }
    CHECK(finished == 5);
    CHECK_FALSE(result.runs[0].screened);
    CHECK(result.best.objective <= worst_kept);
}

TEST_CASE("an interrupted multi-start keeps the best so far", "[estimator]") {
    std::atomic<int> asked{0};
    estimator::MultiStartOptions options;
    options.starts = 50;
    options.estimate.interrupted = [&asked] { return ++asked > 60; };
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    const auto result = multi_start({bounded("theta", -0.9, -3.0, 3.0)}, factory(2, two_wells), {}, options);
    CHECK(result.interrupted);
    CHECK(result.best.status == estimator::EstimateStatus::converged);
    CHECK_THAT(result.best.message, ContainsSubstring("interrupted"));
    CHECK(result.runs.back().status == estimator::EstimateStatus::interrupted);
    options.estimate.interrupted = [] { return true; };
    const auto nothing = multi_start({bounded("theta", -0.9, -3.0, 3.0)}, factory(2, two_wells), {}, options);
    CHECK(nothing.interrupted);
    CHECK(nothing.best.status == estimator::EstimateStatus::interrupted);
    REQUIRE(nothing.best.parameters.size() == 1);
    CHECK(nothing.best.parameters[0].value == -0.9);
}

TEST_CASE("starts that cannot be evaluated fail one by one, all of them with a message", "[estimator]") {
    // Only theta > 0 can be evaluated, and the given start is not there.
    const auto half = [](const Eigen::VectorXd& theta, const Eigen::VectorXd& z, bool derivatives) {
        estimator::BlockValue value = two_wells(theta, z, derivatives);
        if (!(theta[0] > 0.0)) value.status = estimator::BlockStatus::failed;
        return value;
    };
    estimator::MultiStartOptions options;
    options.starts = 10;
    const auto result = multi_start({bounded("theta", -0.9, -3.0, 3.0)}, factory(2, half), {}, options);
    CHECK(result.runs[0].status == estimator::EstimateStatus::failed);
    CHECK(std::isnan(result.runs[0].objective));
    CHECK(result.best.status == estimator::EstimateStatus::converged);
    CHECK_THAT(result.best.parameters[0].value, WithinAbs(1.0, 5e-7));
    const auto never = [](const Eigen::VectorXd&, const Eigen::VectorXd&, bool) {
        estimator::BlockValue value;
        value.status = estimator::BlockStatus::failed;
        return value;
    };
    const auto failed = multi_start({bounded("theta", -0.9, -3.0, 3.0)}, factory(2, never), {}, options);
    CHECK(failed.best.status == estimator::EstimateStatus::failed);
    CHECK_THAT(failed.best.message, ContainsSubstring("none of 10 starts"));
    CHECK_THAT(failed.best.message, ContainsSubstring("only"));
    CHECK(failed.best_start == -1);
    CHECK(failed.optima.empty());
}

TEST_CASE("random starts follow priors and bounds", "[estimator]") {
    std::vector<estimator::FreeParameter> parameters(7);
    for (std::size_t i = 0; i < parameters.size(); ++i)
        parameters[i] = free_parameter("p" + std::to_string(i), 1.0);
    parameters[0].prior = estimator::NormalPrior{5.0, 2.0};
    parameters[1].prior = estimator::HalfCauchyPrior{3.0};
    parameters[1].lower = 0.0;
    parameters[2].scale = estimator::Scale::log;
    parameters[2].lower = 1e-2;
    parameters[2].upper = 1e2;
    parameters[3].scale = estimator::Scale::log;
    parameters[3].lower = 0.0;
    parameters[4].lower = 0.5;
    parameters[4].typical_size = 4.0;
    const estimator::JointNormalPrior joint{
        {"p6", "p5"}, Eigen::Vector2d(10.0, -10.0), (Eigen::Matrix2d() << 4.0, 1.8, 1.8, 1.0).finished()};
    constexpr int draws = 4001;
    Eigen::MatrixXd theta(draws, 7);
    for (int k = 0; k < draws; ++k) {
        const estimator::RandomStream stream(7, estimator::RandomPurpose::multi_start, static_cast<std::uint64_t>(k));
        theta.row(k) = random_start(parameters, {joint}, 0.5, stream).transpose();
    }
    const auto median = [&](Eigen::Index column) {
        Eigen::VectorXd sorted = theta.col(column);
        std::sort(sorted.begin(), sorted.end());
        return sorted[draws / 2];
    };
    // Four standard errors of a median, 4 * 1.2533 sd / sqrt(draws) = 0.08 sds (for the half-Cauchy: pi / 2 sds).
    CHECK_THAT(median(0), WithinAbs(5.0, 0.16));
    CHECK_THAT(median(1), WithinAbs(3.0, 0.08 * 3.0 * 1.2533 * 2.0));
    CHECK_THAT(std::log(median(2)), WithinAbs(0.0, 4.0 * 0.5 * std::log(1e4) / std::sqrt(draws)));
    CHECK_THAT(std::log(median(3)), WithinAbs(0.0, 0.04));
    CHECK(theta.col(1).minCoeff() > 0.0);
    CHECK(theta.col(2).minCoeff() >= 1e-2);
    CHECK(theta.col(2).maxCoeff() <= 1e2);
    CHECK(theta.col(3).minCoeff() > 0.0);
    CHECK(theta.col(4).minCoeff() >= 0.5);
    CHECK_THAT(median(5), WithinAbs(-10.0, 0.08));
    CHECK_THAT(median(6), WithinAbs(10.0, 0.16));
    const Eigen::VectorXd a = theta.col(5).array() - theta.col(5).mean();
    const Eigen::VectorXd b = theta.col(6).array() - theta.col(6).mean();
    // Correlation 0.9 with standard error (1 - 0.81) / sqrt(draws).
    CHECK_THAT(a.dot(b) / (a.norm() * b.norm()), WithinAbs(0.9, 4.0 * 0.19 / std::sqrt(draws)));
    // Bounds far out in the tail of the prior leave the numbers between them.
    parameters[0].lower = 80.0;
    parameters[0].start = 81.0;
    const estimator::RandomStream stream(7, estimator::RandomPurpose::multi_start, 1);
    CHECK(random_start(parameters, {}, 0.5, stream)[0] >= 80.0);
}

TEST_CASE("tied parameters follow the starts that are drawn", "[estimator]") {
    std::vector<estimator::FreeParameter> parameters{bounded("x", 0.5, -6.0, 6.0), free_parameter("y", 0.0)};
    parameters[1].tied_to = "x";
    parameters[1].tie_factor = -1.0;
    estimator::MultiStartOptions options;
    options.starts = 6;
    const auto result = multi_start(parameters, factory(2, himmelblau), {}, options);
    REQUIRE(result.best_start >= 0);
    for (const estimator::StartedRun& run : result.runs) {
        if (run.start > 0) CHECK(run.from[1] == -run.from[0]);
        CHECK(run.theta[1] == -run.theta[0]);
    }
}

TEST_CASE("multi-start refuses what makes no sense", "[estimator]") {
    const std::vector<estimator::FreeParameter> parameters{bounded("theta", -0.9, -3.0, 3.0)};
    const auto residuals = factory(2, two_wells);
    const auto refuses = [&](auto change) {
        estimator::MultiStartOptions options;
        change(options);
        CHECK_THROWS_AS(multi_start(parameters, residuals, {}, options), std::invalid_argument);
    };
    refuses([](auto& options) { options.starts = 0; });
    refuses([](auto& options) { options.width = 0.0; });
    refuses([](auto& options) { options.kept = 0; });
    refuses([](auto& options) { options.distance = std::nan(""); });
    refuses([](auto& options) { options.objective_tolerance = -1.0; });
    refuses([](auto& options) { options.screening_iterations = -1; });
    refuses([](auto& options) { options.estimate.maximum_iterations = 0; });
    CHECK_THROWS_AS(multi_start(parameters, {}, {}, {}), std::invalid_argument);
    CHECK_THROWS_AS(multi_start({parameters[0], parameters[0]}, residuals), std::invalid_argument);
}

}  // namespace orbid::tests::multi_start_test
