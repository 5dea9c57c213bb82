// Records linked to the next block: matching with an error of its own. Exact likelihoods of linear models, the same
// problem with all states in one dense block, and the limit of equality constraints.

#include <cmath>
#include <random>

#include <Eigen/QR>

#include "estimator/exploration/marginal.hpp"
#include "estimator/exploration/profile.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/exact_walk.hpp"
#include "tests/estimator/interface/function_residual.hpp"
#include "tests/estimator/interface/map_chain_residual.hpp"
#include "tests/estimator/problem/stacked_problem.hpp"

namespace orbid::tests::linked_chain_test {

namespace {

using estimator::EstimateStatus;
using estimator::Variance;

/// The random walk of exact_walk.hpp with one block per point, and before it one without latent states whose only
/// record says z_1 - mu = w_1.
FunctionChain linked_walk(const Eigen::VectorXd& y, const estimator::Group& matching,
                          const estimator::Group& reading_group = group("reading", 1.0)) {
    FunctionChain chain;
    chain.add_group(reading_group);
    chain.add_group(matching);
    for (Eigen::Index i = -1; i < y.size(); ++i) {
        estimator::BlockLayout block;
        block.label = "point " + std::to_string(i);
        block.latents = i < 0 ? 0 : 1;
        if (i >= 0) block.group = {0};
        if (i + 1 < y.size()) {
            block.linked_from = std::ssize(block.group);
            block.group.push_back(1);
            block.next = i + 2;
        }
        const double reading = i < 0 ? 0.0 : y[i];
        chain.add_block(
            block,
            [i, reading, joined = block.next >= 0](const Eigen::VectorXd& theta, const Eigen::VectorXd& z,
                                                   const Eigen::VectorXd& next) {
                const Eigen::Index own = i < 0 ? 0 : 1;
                const Eigen::Index records = own + (joined ? 1 : 0);
                estimator::BlockValue value;
                value.e.resize(records);
                value.e_theta.setZero(records, 1);
                value.e_z.setZero(records, own);
                value.e_next.setZero(records, 1);
                if (own > 0) {
                    value.e[0] = reading - z[0];
                    value.e_z(0, 0) = -1.0;
                }
                if (!joined) return value;
                value.e[own] = next[0] - (own > 0 ? z[0] : theta[0]);
                value.e_next(own, 0) = 1.0;
                (own > 0 ? value.e_z : value.e_theta)(own, 0) = -1.0;
                return value;
            },
            i < 0 ? Eigen::VectorXd() : Eigen::VectorXd::Constant(1, reading));
    }
    return chain;
}

estimator::Estimate walk_of(estimator::Residual& residual, Variance variance = Variance::ml) {
    estimator::EstimateOptions options;
    options.variance = variance;
    options.step_tolerance = 1e-9;
    return estimator::estimate({free_parameter("mu", 0.0)}, {&residual}, {}, options);
}

estimator::Group with(std::string name, double scale, bool estimate, estimator::ErrorDistribution distribution) {
    estimator::Group result = group(std::move(name), scale, estimate);
    result.distribution = std::move(distribution);
    return result;
}

/// A walk with steps of Student's t (4 degrees of freedom, scale 0.3) and readings of sd 0.15: of steps as small as
/// their readings' errors heavy-tailed laws cannot tell the scale from zero.
Eigen::VectorXd heavy_walk(Eigen::Index count) {
    std::mt19937_64 generator(5);
    std::normal_distribution<double> normal;
    std::student_t_distribution<double> step(4.0);
    Eigen::VectorXd y(count);
    double z = 2.0;
    for (double& reading : y) {
        z += 0.3 * step(generator);
        reading = z + 0.15 * normal(generator);
    }
    return y;
}

}  // namespace

TEST_CASE("a walk whose steps are linked records has its exact likelihood", "[estimator][linked]") {
    const Eigen::VectorXd y = made_walk();
    const ExactWalk exact(y);
    SECTION("matching sd estimated") {
        FunctionChain chain = linked_walk(y, group("matching", 1.0));
        const auto result = walk_of(chain);
        check_against(exact, result);
        // 400 records and 200 states: their integral leaves n/2 ln 2 pi, which Phi_psi does not hold.
        CHECK_THAT(result.objective + 0.5 * static_cast<double>(y.size()) * std::log(2.0 * std::numbers::pi),
                   WithinRel(exact.at(exact.maximum()).value, 1e-10));
        CHECK_THAT(result.degrees_of_freedom, WithinAbs(199.0, 1e-9));
    }
    SECTION("matching sd fixed") {
        for (const double matching : {0.1, 0.03, 1e-3, 1e-6}) {
            CAPTURE(matching);
            FunctionChain chain = linked_walk(y, group("matching", matching, false));
            const auto result = walk_of(chain);
            CAPTURE(result.message);
            REQUIRE(result.status == EstimateStatus::converged);
            Eigen::Vector2d psi(std::log(0.3), std::log(matching));
            for (int i = 0; i < 50; ++i)
                psi[0] -= exact.at(psi).gradient[0] / exact.hessian(psi)(0, 0);
            const ExactWalk::Point best = exact.at(psi);
            CHECK_THAT(result.parameters[0].value, WithinRel(best.mu, 1e-8));
            CHECK_THAT(result.parameters[0].sd, WithinRel(best.mu_sd, 1e-7));
            CHECK_THAT(result.scales[0].value, WithinRel(std::exp(psi[0]), 1e-7));
            CHECK_THAT(result.scales[0].uncertainty,
                       WithinRel(std::exp(psi[0]) / std::sqrt(exact.hessian(psi)(0, 0)), 1e-5));
            CHECK_THAT(result.scales[1].value, WithinRel(matching, 1e-14));
        }
    }
}

/// With weights by the covariance V = s^2 I + q^2 K, mu = 1^T V^-1 y / 1^T V^-1 1. Where the walk stands still, y has
/// the covariance s^2 I alone.
TEST_CASE("slack of links does not count as an error of the parameters", "[estimator][linked]") {
    const ExactWalk exact(made_walk());
    constexpr double reading = 0.3;
    std::mt19937_64 generator(3);
    std::normal_distribution<double> normal(2.0, reading);
    Eigen::VectorXd y(points);
    for (double& one : y)
        one = normal(generator);
    for (const double slack : {0.1, 0.03, 1e-4}) {
        CAPTURE(slack);
        estimator::Group link = group("matching", slack, false);
        link.slack = true;
        FunctionChain chain = linked_walk(y, link, group("reading", reading, false));
        const auto result = walk_of(chain);
        REQUIRE(result.status == EstimateStatus::converged);
        const Eigen::ArrayXd variance = reading * reading + slack * slack * exact.lambda;
        const double information = (exact.one.square() / variance).sum();
        const double true_sd = reading * std::sqrt((exact.one / variance).square().sum()) / information;
        CHECK_THAT(result.parameters[0].laplace_sd, WithinRel(1.0 / std::sqrt(information), 1e-9));
        CHECK_THAT(result.parameters[0].sd, WithinRel(true_sd, 1e-9));
        CHECK_THAT(result.covariance(0, 0), WithinRel(true_sd * true_sd, 1e-8));
        if (slack > 0.05) CHECK(true_sd < 0.8 / std::sqrt(information));
        // Profiles and marginals agree with the table.
        estimator::EstimateOptions options;
        options.variance = Variance::ml;
        const auto walked = estimator::profiles({free_parameter("mu", 0.0)}, {&chain}, options, result, {});
        CHECK_THAT(walked.front().upper - walked.front().lower, WithinRel(2.0 * 1.9599639845400545 * true_sd, 1e-3));
        const auto density = estimator::marginals({free_parameter("mu", 0.0)}, {&chain}, options, result, {});
        CHECK_THAT(density.front().sd, WithinRel(true_sd, 1e-3));
        // Links that are an error of their own keep it.
        link.slack = false;
        FunctionChain kicked = linked_walk(y, link, group("reading", reading, false));
        CHECK_THAT(walk_of(kicked).parameters[0].sd, WithinRel(1.0 / std::sqrt(information), 1e-9));
    }
}

TEST_CASE("linked records of every distribution agree with one dense block", "[estimator][linked]") {
    const Eigen::VectorXd y = heavy_walk(60);
    const std::vector<std::pair<const char*, estimator::Group>> matchings{
        {"normal, fixed", with("matching", 0.3, false, estimator::NormalErrors{})},
        {"student_t, fixed", with("matching", 0.3, false, estimator::StudentErrors{})},
        {"student_t, scale estimated", with("matching", 0.3, true, estimator::StudentErrors{})},
        {"student_t, dof 2, fixed", with("matching", 0.3, false, estimator::StudentErrors{{false, 2.0, {}}})},
        {"student_t, dof estimated",
         with("matching", 0.3, true, estimator::StudentErrors{{true, 4.0, estimator::GammaPrior{2.0, 0.1}}})},
        {"laplace", with("matching", 0.3, true, estimator::LaplaceErrors{})}};
    for (const auto& [name, matching] : matchings) {
        for (const Variance variance : {Variance::ml, Variance::restricted}) {
            CAPTURE(name, static_cast<int>(variance));
            // With heavy-tailed steps the reading scale could as well be zero: it is known.
            const estimator::Group reading = group("reading", 0.15, false);
            FunctionResidual one_block = dense_walk(y, matching, reading);
            const auto dense = walk_of(one_block, variance);
            FunctionChain linked = linked_walk(y, matching, reading);
            const auto chain = walk_of(linked, variance);
            CAPTURE(dense.message, chain.message);
            REQUIRE(dense.status == EstimateStatus::converged);
            REQUIRE(chain.status == EstimateStatus::converged);
            CHECK_THAT(chain.objective, WithinRel(dense.objective, 1e-9));
            CHECK_THAT(chain.log_likelihood, WithinRel(dense.log_likelihood, 1e-7));
            CHECK_THAT(chain.log_integral, WithinRel(dense.log_integral, 1e-6));
            const double sd = dense.parameters[0].sd;
            CHECK_THAT(chain.parameters[0].value, WithinAbs(dense.parameters[0].value, 1e-6 * sd));
            CHECK_THAT(chain.parameters[0].sd, WithinRel(sd, 1e-6));
            CHECK_THAT(chain.parameters[0].upper95, WithinAbs(dense.parameters[0].upper95, 1e-5 * sd));
            CHECK_THAT(chain.hessian_ratio[0], WithinRel(dense.hessian_ratio[0], 1e-5));
            CHECK(chain.trust_normal == dense.trust_normal);
            for (std::size_t g = 0; g < 2; ++g) {
                CHECK_THAT(chain.scales[g].value, WithinRel(dense.scales[g].value, 1e-6));
                CHECK_THAT(chain.scales[g].uncertainty, WithinRel(dense.scales[g].uncertainty, 1e-5));
                CHECK(chain.scales[g].count == dense.scales[g].count);
                for (std::size_t k = 0; k < dense.scales[g].shape.size(); ++k)
                    CHECK_THAT(chain.scales[g].shape[k].value, WithinRel(dense.scales[g].shape[k].value, 1e-5));
            }
            for (std::size_t i = 0; i < 60; ++i) {
                const auto k = static_cast<Eigen::Index>(i);
                CHECK_THAT(chain.latents[0][i + 1][0], WithinAbs(dense.latents[0][0][k], 1e-6));
                CHECK_THAT(chain.latent_sds[0][i + 1][0], WithinRel(dense.latent_sds[0][0][k], 1e-6));
            }
        }
    }
}

TEST_CASE("linked records approach equality constraints", "[estimator][linked]") {
    const Eigen::MatrixXd readings = henon_readings(80, 1e-3, 3);
    estimator::EstimateOptions options;
    options.step_tolerance = 1e-8;
    const std::vector<estimator::FreeParameter> parameters{free_parameter("a", 1.39), free_parameter("b", 0.31)};
    MapChainResidual constrained(henon, readings, group("reading", 1e-3), {true, {}, {}});
    const auto exact = estimator::estimate(parameters, {&constrained}, {}, options);
    CAPTURE(exact.message);
    REQUIRE(exact.status == EstimateStatus::converged);
    double former = 0.0;
    for (const double matching : {1e-4, 1e-5, 1e-6, 1e-7}) {
        MapChainResidual linked(henon, readings, group("reading", 1e-3),
                                {false, group("matching", matching, false), {}});
        const auto found = estimator::estimate(parameters, {&linked}, {}, options);
        CAPTURE(matching, found.message);
        REQUIRE(found.status == EstimateStatus::converged);
        double distance = 0.0;
        for (std::size_t i = 0; i < 2; ++i)
            distance = std::max(
                distance, std::abs(found.parameters[i].value - exact.parameters[i].value) / exact.parameters[i].sd);
        CAPTURE(distance);
        // The error of the nodes grows with the square of the matching sd over that of what the readings say.
        if (former > 0.0) CHECK(distance < std::max(0.05 * former, 1e-6));
        former = distance;
        if (matching > 2e-7) continue;
        CHECK(distance < 1e-4);
        for (std::size_t i = 0; i < 2; ++i)
            CHECK_THAT(found.parameters[i].sd, WithinRel(exact.parameters[i].sd, 1e-4));
        CHECK_THAT(found.scales[0].value, WithinRel(exact.scales[0].value, 1e-4));
    }
}

TEST_CASE("the step of the parameters keeps its digits at tight matching", "[estimator][linked]") {
    // Links that grow by e^0.8 and contract by e^-2, readings of weight 1, matching 1 / q; quadruple precision.
    constexpr Eigen::Index q = 3;
    constexpr int nodes = 60;
    estimator::test::Numbers random(17);
    for (const double ratio : {1e-2, 1e-4, 1e-6, 1e-8, 1e-10}) {
        estimator::test::StackedProblem problem;
        problem.parameters = q;
        for (int b = 0; b < nodes; ++b) {
            estimator::test::StackedBlock block;
            block.latents = 2;
            block.own = random(2, 2 + q + 1);
            if (b + 1 < nodes) {
                block.next = b + 1;
                const Eigen::Matrix2d turn = Eigen::Matrix2d(random(2, 2)).householderQr().householderQ();
                block.link.resize(2, 4 + q + 1);
                block.link << turn * Eigen::Vector2d(std::exp(0.8), std::exp(-2.0)).asDiagonal() * turn.transpose(),
                    -Eigen::Matrix2d::Identity(), random(2, q + 1);
                block.link /= ratio;
            }
            problem.block.push_back(block);
        }
        const estimator::BlockArrow arrow = estimator::factorise(problem.blocks(), q);
        const estimator::ReducedProblem reduced_problem = estimator::condense(arrow, 0.0);
        const Eigen::VectorXd d = -reduced_problem.r.triangularView<Eigen::Upper>().solve(reduced_problem.rhs);
        const auto exact = estimator::test::dense_solution(problem, arrow, 0.0);
        const Eigen::MatrixXd covariance = exact.joint({{2 * nodes, q}});
        double worst = 0.0;
        for (Eigen::Index i = 0; i < q; ++i)
            worst = std::max(worst, std::abs(d[i] - exact.unknowns[2 * nodes + i]) / std::sqrt(covariance(i, i)));
        CAPTURE(ratio, worst);
        CHECK(worst < 1e-6);
    }
}

TEST_CASE("autocorrelation of readings is looked for along a chain", "[estimator][linked]") {
    // A straight line, z_{i+1} = z_i + b, one reading per block, errors of a first-order autoregression, 0.8: an
    // integrated time of (1 + 0.8) / (1 - 0.8) = 9 records.
    constexpr Eigen::Index count = 2000;
    std::mt19937_64 generator(9);
    std::normal_distribution<double> normal;
    Eigen::MatrixXd readings(1, count);
    double error = 0.0;
    for (Eigen::Index i = 0; i < count; ++i) {
        error = 0.8 * error + 0.6 * normal(generator);
        readings(0, i) = 1.0 + 0.1 * static_cast<double>(i) + error;
    }
    const ChainMap line = [](const Eigen::VectorXd& z, const Eigen::VectorXd& theta) {
        return MapValue{z + theta, Eigen::MatrixXd::Identity(1, 1), Eigen::MatrixXd::Identity(1, 1)};
    };
    for (const bool constraint : {false, true}) {
        CAPTURE(constraint);
        estimator::Group reading = group("reading");
        reading.ordered = true;
        MapChainResidual residual(line, readings, reading, {constraint, group("matching", 1e-7, false), {}});
        const auto found = estimator::estimate({free_parameter("b", 0.0)}, {&residual});
        CAPTURE(found.message);
        REQUIRE(found.status == EstimateStatus::converged);
        // sd of a lag-1 correlation of 2000 records: 0.6 / sqrt(2000) = 0.013; of the integrated time about a third.
        CHECK_THAT(found.scales[0].lag1, WithinAbs(0.8, 0.06));
        CHECK(found.parameters[0].interval_method == estimator::IntervalMethod::sandwich);
        CHECK(found.parameters[0].sd / found.parameters[0].laplace_sd > 2.0);
        CHECK(found.parameters[0].sd / found.parameters[0].laplace_sd < 5.0);
        CHECK_THAT(found.parameters[0].value, WithinAbs(0.1, 4.0 * found.parameters[0].sd));
    }
}

TEST_CASE("linked records that cannot be are refused", "[estimator][linked]") {
    const auto refusal = [](const std::function<void(FunctionChain&, estimator::BlockLayout&)>& change,
                            estimator::LatentStructure structure = estimator::LatentStructure::chain) {
        FunctionChain chain;
        chain.structure_asked = structure;
        chain.add_group(group("reading", 1.0));
        chain.add_group(group("matching", 1.0));
        estimator::BlockLayout block;
        block.label = "here";
        block.latents = 1;
        block.group = {0, 1};
        block.linked_from = 1;
        block.next = 1;
        change(chain, block);
        const FunctionChain::Function none = [](const Eigen::VectorXd&, const Eigen::VectorXd&,
                                                const Eigen::VectorXd&) { return estimator::BlockValue{}; };
        chain.add_block(block, none, Eigen::VectorXd::Zero(1));
        estimator::BlockLayout last;
        last.label = "last";
        last.latents = 1;
        last.group = {0};
        chain.add_block(last, none, Eigen::VectorXd::Zero(1));
        try {
            (void)walk_of(chain);
        } catch (const std::invalid_argument& error) {
            return std::string(error.what());
        }
        return std::string();
    };
    const auto keep = [](FunctionChain&, estimator::BlockLayout&) {};
    CHECK_THAT(refusal(keep, estimator::LatentStructure::independent_blocks),
               ContainsSubstring("\"here\"") && ContainsSubstring("no chain"));
    CHECK_THAT(refusal([](FunctionChain&, estimator::BlockLayout& block) { block.next = -1; }),
               ContainsSubstring("\"here\"") && ContainsSubstring("next"));
    CHECK_THAT(refusal([](FunctionChain&, estimator::BlockLayout& block) { block.next = 7; }),
               ContainsSubstring("\"here\"") && ContainsSubstring("7 does not exist"));
    CHECK_THAT(refusal([](FunctionChain&, estimator::BlockLayout& block) { block.linked_from = 3; }),
               ContainsSubstring("\"here\"") && ContainsSubstring("linked_from = 3"));
    CHECK_THAT(
        refusal([](FunctionChain&, estimator::BlockLayout& block) { block.shape = Eigen::MatrixXd::Identity(2, 2); }),
        ContainsSubstring("\"here\"") && ContainsSubstring("shape"));
    CHECK_THAT(refusal([](FunctionChain&, estimator::BlockLayout& block) {
                   block.group = {0, 0};
               }),
               ContainsSubstring("share a group"));
}

TEST_CASE("linked records whose next block takes no part are left out", "[estimator][linked]") {
    const Eigen::VectorXd y = made_walk();
    FunctionChain chain = linked_walk(y, group("matching", 0.1, false));
    chain.deactivate(101);
    const auto result = walk_of(chain);
    CAPTURE(result.message);
    REQUIRE(result.status == EstimateStatus::converged);
    CHECK(result.scales[0].count == 199);
    CHECK(result.scales[1].count == 198);  // of 200 those to and from the missing point are gone
    CHECK(result.latents[0][101].size() == 1);
    // Its neighbours know of each other through mu alone: the same as two walks, the second one free to start anywhere.
    CHECK(result.latent_sds[0][102][0] > 1.05 * result.latent_sds[0][103][0]);
}

}  // namespace orbid::tests::linked_chain_test
