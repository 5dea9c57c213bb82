// Cycles of autonomous flows as data: crossings of a plane, their multipliers, and the time in which they close.
#include <cmath>
#include <fstream>
#include <string>

#include <Eigen/Cholesky>
#include <nlohmann/json.hpp>

#include "estimator/estimate/estimate.hpp"
#include "models/catalogue/registry.hpp"
#include "orbits/cycle_residuals/cycle_residual.hpp"
#include "orbits/cycle_residuals/lifted_cycle_residual.hpp"
#include "orbits/cycle_residuals/one_period_residual.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/cycles/measured_cycles.hpp"
#include "tests/source_folder.hpp"

namespace crossing_cycles_test {

using namespace orbid;
using Eigen::Index;
using Eigen::VectorXd;

namespace {

const std::vector<VectorXd> no_latents;

struct LorenzCase {
    std::shared_ptr<const models::System> system = models::make_system("lorenz");
    models::ParameterBinding binding{system->default_parameters(), {0, 1, 2}, {0, 1, 2}, 3};
    orbits::SectionPlace plane{models::Section{Eigen::Vector3d(0.0, 0.0, 1.0), 27.0, 1}};

    [[nodiscard]] VectorXd truth() const { return binding.base; }
};

/// The table's cycles (25 digits) in all their crossings, with normal errors of `error` in x, y, ln|multiplier| and T.
std::vector<orbits::Cycle> table_cycles(const LorenzCase& c, double error, std::uint64_t seed) {
    std::ifstream file(orbid::tests::source_folder() + "/tests/reference/lorenz_orbits.json");
    const auto table = nlohmann::json::parse(file);
    tests::NormalNumbers normal(seed);
    const orbits::SectionMap map(*c.system, c.plane, {1e-13, 1e-13, 100000});
    const auto number = [](const nlohmann::json& text) { return std::stod(text.get<std::string>()); };
    std::vector<orbits::Cycle> cycles;
    for (const auto& entry : table.at("cycles")) {
        orbits::Cycle cycle;
        cycle.period = static_cast<int>(entry.at("code").get<std::string>().size());
        if (cycle.period > 4) continue;
        cycle.points.resize(2, cycle.period);
        cycle.points.col(0) << number(entry.at("x")), number(entry.at("y"));
        for (int j = 1; j < cycle.period; ++j)
            cycle.points.col(j) = map(cycle.points.col(j - 1), c.truth(), {}, false)->state;
        cycle.multipliers = {number(entry.at("unstable_multiplier"))};
        cycle.ln_multiplier = VectorXd::Constant(1, std::log(std::abs(cycle.multipliers[0])) + error * normal());
        cycle.ln_multiplier_covariance = Eigen::MatrixXd::Constant(1, 1, error * error);
        cycle.time = number(entry.at("period")) + error * normal();
        cycle.time_sd = error;
        for (double& value : cycle.points.reshaped())
            value += error * normal();
        cycle.covariance = error * error * Eigen::MatrixXd::Identity(2 * cycle.period, 2 * cycle.period);
        cycles.push_back(std::move(cycle));
    }
    return cycles;
}

orbits::CycleResidualOptions everything() {
    orbits::CycleResidualOptions options;
    options.targets.multipliers = true;
    options.targets.times = true;
    return options;
}

}  // namespace

TEST_CASE("crossing cycles: the table's at the truth, exact derivatives", "[orbits][cycles][autonomous]") {
    const LorenzCase c;
    auto cycles = table_cycles(c, 1e-300, 1);
    REQUIRE(cycles.size() == 6);  // 1 of two crossings, 2 of three, 3 of four
    for (orbits::Cycle& cycle : cycles) {
        cycle.covariance.setIdentity();
        cycle.ln_multiplier_covariance.setConstant(1e-6);
        cycle.time_sd = 1e-3;
    }
    const orbits::CycleResidual residual(c.system, c.binding, cycles, c.plane, c.truth(), {}, everything());
    REQUIRE(residual.groups().size() == 4);
    CHECK(residual.groups()[1].name == "cycles.y");
    CHECK(residual.groups()[2].name == "cycles.ln_multiplier");
    CHECK(residual.groups()[3].name == "cycles.time");
    CHECK(residual.layout()[0].group == std::vector<int>{0, 1, 0, 1, 2, 3});
    const auto at = residual.evaluate(residual.initial_set(), c.truth(), no_latents, true);
    for (Index k = 0; k < 3; ++k) {
        VectorXd up = c.truth(), down = c.truth();
        const double h = 1e-5 * up(k);
        up(k) += h;
        down(k) -= h;
        const auto above = residual.evaluate(residual.initial_set(), up, no_latents, false),
                   below = residual.evaluate(residual.initial_set(), down, no_latents, false);
        for (std::size_t b = 0; b < at.size(); ++b) {
            CAPTURE(k, b, at[b].e.transpose());
            REQUIRE(at[b].status == estimator::BlockStatus::ok);
            // Flow tolerance 1e-12 over some hundred steps, amplified by multipliers up to 20, in coordinates up to 20.
            CHECK(at[b].e.cwiseAbs().maxCoeff() < 1e-8);
            const VectorXd difference = (above[b].e - below[b].e) / (2.0 * h);
            // Truncation 1e-10 x third derivative, rounding 1e-10 / 1e-5, relative to derivatives of order 1.
            CHECK((difference - at[b].e_theta.col(k)).cwiseAbs().maxCoeff() <
                  1e-4 * at[b].e_theta.col(k).cwiseAbs().maxCoeff());
        }
    }
}

TEST_CASE("crossing cycles: points and times with errors that they share", "[orbits][cycles][autonomous]") {
    const LorenzCase c;
    constexpr double error = 1e-3;
    auto cycles = table_cycles(c, error, 3);
    tests::NormalNumbers normal(4);
    const auto random = [&](Index rows, Index columns) {
        return Eigen::MatrixXd(Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return error * normal(); }));
    };
    Index records = 0;
    for (orbits::Cycle& cycle : cycles) {
        const Index points = cycle.points.size();
        records += points + 2;
        cycle.common = random(points + 2, 3);  // points, one multiplier, time
        Eigen::MatrixXd linked(points + 1, 3);
        linked << cycle.common.topRows(points), cycle.common.bottomRows(1);
        const Eigen::MatrixXd own = random(points + 1, points + 1);
        const Eigen::MatrixXd all = linked * linked.transpose() + own * own.transpose() +
                                    error * error * Eigen::MatrixXd::Identity(points + 1, points + 1);
        cycle.covariance = all.topLeftCorner(points, points);
        cycle.time_covariance = all.topRightCorner(points, 1);
        cycle.time_sd = std::sqrt(all(points, points));
        cycle.ln_multiplier_covariance(0, 0) = cycle.common.row(points).squaredNorm() + error * error;
    }
    auto options = everything();
    const orbits::CycleResidual residual(c.system, c.binding, cycles, c.plane, c.truth(), {}, options);
    auto alone = cycles;
    for (orbits::Cycle& cycle : alone)
        cycle.common.resize(0, 0);
    const orbits::CycleResidual plain(c.system, c.binding, alone, c.plane, c.truth(), {}, options);
    // By blocks, which the estimator takes as independent, and all at once.
    const auto minus_log_density = [](const VectorXd& e, const Eigen::MatrixXd& covariance) {
        const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
        REQUIRE(factor.info() == Eigen::Success);
        return 0.5 * factor.matrixL().solve(e).squaredNorm() +
               Eigen::MatrixXd(factor.matrixL()).diagonal().array().log().sum();
    };
    const VectorXd theta = 1.0001 * c.truth();
    const auto blocks = residual.evaluate(residual.initial_set(), theta, no_latents, false);
    const auto values = plain.evaluate(plain.initial_set(), theta, no_latents, false);
    double by_blocks = 0.0;
    VectorXd e(records);
    Eigen::MatrixXd common(records, 3), covariance = Eigen::MatrixXd::Zero(records, records);
    Index first = 0;
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        by_blocks += minus_log_density(blocks[b].e, residual.initial_set().layout[b].shape);
        const orbits::Cycle& cycle = cycles[b];
        const Index points = cycle.points.size(), own = points + 2;
        REQUIRE(values[b].e.size() == own);
        e.segment(first, own) = values[b].e;
        common.middleRows(first, own) = cycle.common;
        auto shape = covariance.block(first, first, own, own);
        shape.topLeftCorner(points, points) = cycle.covariance;
        shape.col(points + 1).head(points) = cycle.time_covariance;
        shape.row(points + 1).head(points) = cycle.time_covariance.transpose();
        shape(points + 1, points + 1) = cycle.time_sd * cycle.time_sd;
        shape(points, points) = cycle.ln_multiplier_covariance(0, 0);
        Eigen::MatrixXd known = cycle.common * cycle.common.transpose();
        known.row(points).setZero();  // multipliers are linked by the common errors alone
        known.col(points).setZero();
        known(points, points) = cycle.common.row(points).squaredNorm();
        shape -= known;
        first += own;
    }
    covariance += common * common.transpose();
    // Errors of computed orbits, 1e-8 of these, and rounding of matrices of condition 1e4.
    CHECK(std::abs(by_blocks - minus_log_density(e, covariance)) < 1e-6 * std::abs(by_blocks));

    cycles[0].time_covariance *= 1e3;
    CHECK_THROWS_WITH(orbits::CycleResidual(c.system, c.binding, cycles, c.plane, c.truth(), {}, options),
                      tests::ContainsSubstring("time_sd is too small beside time_covariance"));
    cycles[0].time_covariance.resize(3);
    CHECK_THROWS_WITH(orbits::CycleResidual(c.system, c.binding, cycles, c.plane, c.truth(), {}, options),
                      tests::ContainsSubstring("has 3 numbers, the points 4 coordinates"));
}

TEST_CASE("crossing cycles: all three constants of Lorenz, in stages from far off", "[orbits][cycles][autonomous]") {
    const LorenzCase c;
    const auto cycles = table_cycles(c, 1e-4, 5);
    std::vector<estimator::FreeParameter> parameters(3);
    const double factors[] = {1.2, 0.85, 1.2};
    for (std::size_t i = 0; i < 3; ++i) {
        parameters[i].name = c.system->parameters()[i].name;
        parameters[i].start = factors[i] * c.truth()(static_cast<Index>(i));
        parameters[i].lower = 0.0;
        parameters[i].scale = estimator::Scale::log;
    }
    estimator::EstimateOptions rough;
    rough.variance = estimator::Variance::ml;
    rough.step_tolerance = 1e-2;
    const auto starts = [&] { return VectorXd{{parameters[0].start, parameters[1].start, parameters[2].start}}; };
    const auto move_to = [&](const estimator::Estimate& estimate) {
        for (std::size_t i = 0; i < 3; ++i)
            parameters[i].start = estimate.parameters[i].value;
    };
    orbits::OnePeriodResidual prediction(c.system, c.binding, cycles, c.plane, starts());
    move_to(estimator::estimate(parameters, {&prediction}, {}, rough));
    orbits::LiftedCycleResidual lifted(c.system, c.binding, cycles, c.plane, starts());
    const auto stages = estimator::estimate(parameters, {&lifted}, {}, rough);
    move_to(stages);
    orbits::CycleResidual residual(c.system, c.binding, cycles, c.plane, starts(),
                                   lifted.nodes(stages.active.front(), stages.latents.front()), everything());
    const auto estimate = estimator::estimate(parameters, {&residual});
    REQUIRE(estimate.status == estimator::EstimateStatus::converged);
    CHECK(estimate.counts[0].used == 6);
    for (std::size_t i = 0; i < 3; ++i) {
        const estimator::Estimated& parameter = estimate.parameters[i];
        CAPTURE(parameter.name, parameter.value, parameter.sd);
        CHECK(std::abs(parameter.value - c.truth()(static_cast<Index>(i))) < 4.0 * parameter.sd);
        CHECK(parameter.sd < 1e-3 * parameter.value);
    }
}

TEST_CASE("crossing cycles refuse what makes no sense", "[orbits][cycles][autonomous]") {
    const LorenzCase c;
    const auto cycles = table_cycles(c, 1e-4, 1);
    const auto refused = [&](const orbits::SectionPlace& place, const orbits::CycleResidualOptions& options,
                             const std::string& rule) {
        CHECK_THROWS_WITH(orbits::CycleResidual(c.system, c.binding, cycles, place, c.truth(), {}, options),
                          tests::ContainsSubstring(rule));
    };
    refused(0.0, {}, "autonomous");
    refused(orbits::SectionPlace(models::Section{Eigen::Vector3d(0.0, 1.0, 1.0), 27.0, 1}), {}, "single coordinate");
    auto options = everything();
    options.targets.sensor.type = models::Sensor::Type::angle_difference;
    refused(c.plane, options, "read as states");
    auto untimed = cycles;
    for (orbits::Cycle& cycle : untimed)
        cycle.time = std::numeric_limits<double>::quiet_NaN();
    CHECK_THROWS_WITH(orbits::CycleResidual(c.system, c.binding, untimed, c.plane, c.truth(), {}, everything()),
                      tests::ContainsSubstring("times are to take part"));
    const auto henon = models::make_system("henon");
    CHECK_THROWS_WITH(orbits::SectionMap(*henon, c.plane, {}), tests::ContainsSubstring("not autonomous"));
}

}  // namespace crossing_cycles_test
