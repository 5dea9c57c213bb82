// Estimates over ranks against the same estimates in one process.

#include <cmath>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "estimator/estimate/estimate_over_ranks.hpp"
#include "estimator/interface/residual_part.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"
#include "tests/estimator/interface/map_chain_residual.hpp"
#include "tests/estimator/ranks/on_ranks.hpp"

namespace orbid::tests::over_ranks_test {

namespace {

using estimator::Estimate;
using estimator::EstimateOptions;
using estimator::EstimateStatus;
using estimator::FreeParameter;

EstimateOptions options_for_ranks(estimator::Variance variance = estimator::Variance::restricted) {
    EstimateOptions options;
    options.variance = variance;
    options.clusters = estimator::Clusters::none;
    options.verdict = false;
    options.step_tolerance = 1e-9;
    return options;
}

std::vector<FreeParameter> starts(double a = 1.38, double b = 0.29) {
    return {free_parameter("a", a), free_parameter("b", b)};
}

/// One estimate per rank, each with its part of the same blocks.
template <class Whole>
std::vector<Estimate> by_ranks(const Whole& whole, const std::vector<FreeParameter>& parameters, int count,
                               const EstimateOptions& options) {
    std::vector<Estimate> results(static_cast<std::size_t>(count));
    on_ranks(count, [&](estimator::Ranks& ranks) {
        const Whole own = whole;  // ranks share no memory
        const auto part = estimator::ResidualPart::of_rank(own, ranks.rank(), ranks.count());
        results[static_cast<std::size_t>(ranks.rank())] =
            estimator::estimate_over_ranks(parameters, {&part}, part.share(), ranks, {}, options);
    });
    return results;
}

/// How far values of two estimates may differ, in sds: each ends where this much is left, which rounding may hide.
double reach(const Estimate& a, const Estimate& b, double tolerance) {
    return tolerance + 2.0 * (a.remaining + b.remaining);
}

/// All that must be the same, with one relative tolerance for values in sds and for sds.
void check_same(const std::vector<Estimate>& parts, const Estimate& one, double tolerance) {
    for (const Estimate& part : parts) {
        CAPTURE(part.message, one.message);
        REQUIRE(part.status == one.status);
        REQUIRE(part.parameters.size() == one.parameters.size());
        for (std::size_t i = 0; i < one.parameters.size(); ++i) {
            const auto &found = part.parameters[i], &expected = one.parameters[i];
            CHECK(found.value == parts.front().parameters[i].value);
            CHECK_THAT(found.value, WithinAbs(expected.value, reach(part, one, tolerance) * expected.sd));
            CHECK_THAT(found.sd, WithinRel(expected.sd, tolerance));
            CHECK_THAT(found.upper95, WithinAbs(expected.upper95, 10.0 * reach(part, one, tolerance) * expected.sd));
            CHECK(found.interval_method == expected.interval_method);
        }
        for (std::size_t i = 0; i < one.scales.size(); ++i) {
            CHECK(part.scales[i].value == parts.front().scales[i].value);
            CHECK(part.scales[i].count == one.scales[i].count);
            CHECK_THAT(part.scales[i].value, WithinRel(one.scales[i].value, tolerance));
            CHECK_THAT(part.scales[i].uncertainty, WithinRel(one.scales[i].uncertainty, 1e3 * tolerance));
            CHECK_THAT(part.scales[i].rms, WithinRel(one.scales[i].rms, tolerance));
        }
        CHECK_THAT(part.objective, WithinRel(one.objective, tolerance));
        CHECK_THAT(part.log_likelihood, WithinRel(one.log_likelihood, tolerance));
        CHECK_THAT(part.log_integral, WithinRel(one.log_integral, 10.0 * tolerance));
        CHECK(part.degrees_of_freedom == one.degrees_of_freedom);
        CHECK(part.rounds == one.rounds);
    }
    // Latent states, and their sds, in order; a block that two ranks have is the same on both.
    std::size_t b = 0;
    for (std::size_t r = 0; r < parts.size(); ++r) {
        const auto &z = parts[r].latents[0], &sd = parts[r].latent_sds[0];
        if (r > 0 && b < one.latents[0].size() && parts[r - 1].latents[0].back() == z.front()) --b;
        for (std::size_t i = 0; i < z.size(); ++i, ++b) {
            REQUIRE((z[i] - one.latents[0][b]).cwiseQuotient(one.latent_sds[0][b]).norm() <
                    reach(parts[r], one, tolerance));
            REQUIRE((sd[i] - one.latent_sds[0][b]).norm() < 10.0 * tolerance * one.latent_sds[0][b].norm());
        }
    }
    CHECK(b == one.latents[0].size());
}

template <class Whole>
void compare(const Whole& whole, const std::vector<FreeParameter>& parameters, const EstimateOptions& options,
             double tolerance) {
    const Estimate one = estimator::estimate(parameters, {&whole}, {}, options);
    CAPTURE(one.message);
    REQUIRE(one.status == EstimateStatus::converged);
    for (const int count : {1, 2, 3, 4}) {
        CAPTURE(count);
        check_same(by_ranks(whole, parameters, count, options), one, tolerance);
    }
}

estimator::Group student(const std::string& name, double scale) {
    estimator::Group result = group(name, scale);
    result.distribution = estimator::StudentErrors{};
    return result;
}

}  // namespace

TEST_CASE("A chain with fixed matching: the same estimate over ranks", "[estimator][ranks]") {
    for (const Eigen::Index count : {61, 1500}) {  // short and long data are searched in different ways
        for (const auto variance :
             {estimator::Variance::ml, estimator::Variance::restricted, estimator::Variance::integrated}) {
            CAPTURE(count, static_cast<int>(variance));
            const MapChainResidual residual(henon, henon_readings(count, 1e-3, 3), group("reading", 0.0),
                                            {false, group("matching", 1e-3, false), {}});
            compare(residual, starts(), options_for_ranks(variance), 1e-8);
        }
    }
}

TEST_CASE("Two scales, heavy tails, bounds and priors over ranks", "[estimator][ranks]") {
    std::vector<FreeParameter> parameters = starts();
    parameters[0].scale = estimator::Scale::log;
    parameters[0].prior = estimator::NormalPrior{1.4, 1e-3};
    parameters[1].lower = 0.1;
    parameters[1].upper = 0.5;
    const MapChainResidual residual(henon, henon_readings(200, 1e-2, 5), student("reading", 1e-2),
                                    {false, group("matching", 1e-3, false), {}});
    // With heavy tails rounding hides the objective early: one process ends 2.7e-7 sds from the minimum.
    compare(residual, parameters, options_for_ranks(), 1e-6);
    parameters[1].upper = 0.295;
    parameters[1].start = 0.29;
    const Estimate one = estimator::estimate(parameters, {&residual}, {}, options_for_ranks());
    REQUIRE(one.parameters[1].at_bound == estimator::BoundSide::upper);
    for (const Estimate& part : by_ranks(residual, parameters, 3, options_for_ranks())) {
        CHECK(part.parameters[1].at_bound == estimator::BoundSide::upper);
        CHECK_THAT(part.parameters[0].value,
                   WithinAbs(one.parameters[0].value, reach(part, one, 1e-7) * one.parameters[0].sd));
    }
}

TEST_CASE("Exact matching by constraints over ranks", "[estimator][ranks]") {
    const MapChainResidual residual(henon, henon_readings(40, 1e-3, 9), group("reading", 0.0), {true, {}, {}});
    compare(residual, starts(1.4, 0.3), options_for_ranks(), 1e-6);
}

TEST_CASE("Stages of matching over ranks", "[estimator][ranks]") {
    const MapChainResidual residual(henon, henon_readings(300, 1e-2, 7), group("reading", 0.05),
                                    {false, group("matching", 1e-4, false), {0.3, 0.03, 3e-3, 1e-3}});
    compare(residual, starts(1.1, 0.1), options_for_ranks(), 1e-7);
}

TEST_CASE("Blocks without links need no shared ones", "[estimator][ranks]") {
    FunctionResidual residual;
    residual.add_group(group("reading", 0.0));
    for (int b = 0; b < 12; ++b) {
        const double at = 0.1 * b;
        residual.add_block(layout("block " + std::to_string(b), 3),
                           linear(Eigen::Vector3d(1.0 + at + 0.05 * std::sin(7.0 * b), 2.0 - 0.03 * std::cos(5.0 * b),
                                                  3.0 + 2.0 * at + 0.02 * std::sin(3.0 * b)),
                                  Eigen::MatrixXd{{1.0, at}, {2.0, 0.0}, {3.0, 2.0 * at}}));
    }
    const std::vector<FreeParameter> parameters = starts(0.0, 0.0);
    const Estimate one = estimator::estimate(parameters, {&residual}, {}, options_for_ranks());
    REQUIRE(one.status == EstimateStatus::converged);
    for (const Estimate& part : by_ranks(residual, parameters, 3, options_for_ranks()))
        for (std::size_t i = 0; i < 2; ++i) {
            CHECK_THAT(part.parameters[i].value, WithinAbs(one.parameters[i].value, 1e-9 * one.parameters[i].sd));
            CHECK_THAT(part.parameters[i].sd, WithinRel(one.parameters[i].sd, 1e-9));
        }
}

TEST_CASE("The same number of ranks gives the same bytes of an estimate", "[estimator][ranks]") {
    const MapChainResidual residual(henon, henon_readings(500, 1e-3, 3), group("reading", 0.0),
                                    {false, group("matching", 1e-3, false), {}});
    const auto once = by_ranks(residual, starts(), 4, options_for_ranks());
    const auto again = by_ranks(residual, starts(), 4, options_for_ranks());
    for (std::size_t r = 0; r < once.size(); ++r) {
        CHECK(once[r].parameters[0].value == again[r].parameters[0].value);
        CHECK(once[r].parameters[1].sd == again[r].parameters[1].sd);
        CHECK(once[r].objective == again[r].objective);
        CHECK(once[r].latents == again[r].latents);
        CHECK(once[r].iterations == again[r].iterations);
    }
}

TEST_CASE("An interruption of one rank interrupts all", "[estimator][ranks]") {
    const MapChainResidual residual(henon, henon_readings(100, 1e-3, 3), group("reading", 0.0),
                                    {false, group("matching", 1e-3, false), {}});
    std::vector<EstimateStatus> status(3);
    on_ranks(3, [&](estimator::Ranks& ranks) {
        const auto part = estimator::ResidualPart::of_rank(residual, ranks.rank(), ranks.count());
        EstimateOptions options = options_for_ranks();
        if (ranks.rank() == 1) options.interrupted = [steps = 0]() mutable { return ++steps > 1; };
        status[static_cast<std::size_t>(ranks.rank())] =
            estimator::estimate_over_ranks(starts(), {&part}, part.share(), ranks, {}, options).status;
    });
    for (const EstimateStatus one : status)
        CHECK(one == EstimateStatus::interrupted);
}

TEST_CASE("What cannot be done over ranks is refused", "[estimator][ranks]") {
    const MapChainResidual residual(henon, henon_readings(20, 1e-3, 3), group("reading", 0.0),
                                    {false, group("matching", 1e-3, false), {}});
    const auto messages = [&](const std::function<void(int, std::vector<FreeParameter>&, EstimateOptions&,
                                                       estimator::ChainShare&)>& change) {
        std::string all;
        std::mutex mutex;
        on_ranks(2, [&](estimator::Ranks& ranks) {
            const auto part = estimator::ResidualPart::of_rank(residual, ranks.rank(), ranks.count());
            std::vector<FreeParameter> parameters = starts();
            EstimateOptions options = options_for_ranks();
            estimator::ChainShare share = part.share();
            change(ranks.rank(), parameters, options, share);
            try {
                static_cast<void>(estimator::estimate_over_ranks(parameters, {&part}, share, ranks, {}, options));
            } catch (const std::exception& error) {
                const std::lock_guard lock(mutex);
                all += std::string(error.what()) + "\n";
            }
        });
        return all;
    };
    const auto has = [](const std::string& text, const std::string& what) {
        CAPTURE(text);
        CHECK(text.find(what) != std::string::npos);
    };
    has(messages([](int, auto&, EstimateOptions& options, auto&) { options.verdict = true; }), "verdict must be false");
    has(messages(
            [](int, auto&, EstimateOptions& options, auto&) { options.clusters = estimator::Clusters::automatic; }),
        "clusters must be none");
    has(messages([](int, auto&, EstimateOptions& options, auto&) { options.full_hessian = true; }), "full_hessian");
    has(messages([](int rank, auto& parameters, auto&, auto&) {
            if (rank == 1) parameters[1].start = 0.28;
        }),
        "rank 1 was given other parameters, groups or options than rank 0");
    has(messages([](int rank, auto&, auto&, estimator::ChainShare& share) {
            if (rank == 1) share.begins_earlier = false;
        }),
        "the block between them has 2 and 0 latent states");
    has(messages([](int rank, auto&, auto&, estimator::ChainShare& share) {
            if (rank == 1) share.goes_on = true;
        }),
        "must have no records or constraints here");
    CHECK_THROWS_WITH(estimator::ResidualPart::of_rank(residual, 0, 11), Catch::Contains("too few for 11 ranks"));
}

}  // namespace orbid::tests::over_ranks_test
