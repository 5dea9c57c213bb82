// A recorded series by multiple shooting, its nodes spread over ranks, against one process.

#include <cmath>
#include <vector>

#include "estimator/estimate/estimate_over_ranks.hpp"
#include "estimator/interface/residual_part.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/ranks/on_ranks.hpp"
#include "tests/orbits/series_residuals/shooting_case.hpp"

namespace shooting_over_ranks_test {

using namespace orbid;
using namespace orbid::orbits;
using estimator::Estimate;
using tests::base_theta;
using tests::bound;
using tests::on_ranks;
using tests::WithinAbs;
using tests::WithinRel;

namespace {

/// Henon's map, both coordinates read with errors of 1e-3, in two segments.
Series henon_record(const models::System& system, const Eigen::VectorXd& base) {
    VirtualExperimentOptions options;
    options.plan = SectionPlan{130, 50, {}, 0.0};
    options.trajectories = 2;
    options.initial = Eigen::MatrixXd{{0.1, -0.2}, {0.1, 0.05}};
    options.noise = Eigen::Vector2d(1e-3, 1e-3);
    options.seed = 4;
    return simulate(system, base, options).series;
}

}  // namespace

TEST_CASE("A series by multiple shooting is estimated over ranks", "[orbits][shooting][ranks]") {
    const std::shared_ptr<const models::System> system = models::make_system("henon");
    const Eigen::VectorXd base = system->default_parameters();
    const Series series = henon_record(*system, base);
    const auto binding = bound(*system, base, {"a", "b"});
    std::vector<estimator::FreeParameter> parameters(2);
    for (Eigen::Index i = 0; i < 2; ++i) {
        auto& parameter = parameters[static_cast<std::size_t>(i)];
        parameter.name = i == 0 ? "a" : "b";
        parameter.start = 0.98 * base_theta(binding)[i];
    }
    estimator::EstimateOptions options;
    options.verdict = false;
    options.clusters = estimator::Clusters::none;
    options.step_tolerance = 1e-9;
    for (const bool constraints : {false, true}) {
        ShootingOptions shooting;
        shooting.interval = 1;
        shooting.matching.kind = constraints ? Continuity::Kind::exact : Continuity::Kind::normal;
        shooting.matching.constraints = constraints;
        if (!constraints) shooting.matching.sd = Eigen::Vector2d(1e-4, 1e-4);
        const ShootingResidual residual(system, binding, series, shooting);
        CHECK(residual.initial_set().is_intermediate_stage == !constraints);
        const Estimate one = estimator::estimate(parameters, {&residual}, {}, options);
        CAPTURE(constraints, one.message);
        REQUIRE(one.status == estimator::EstimateStatus::converged);
        for (const int count : {2, 3, 5}) {  // 5: a border between ranks at that of the segments
            CAPTURE(count);
            on_ranks(count, [&](estimator::Ranks& ranks) {
                const ShootingResidual own(system, binding, series, shooting);
                const auto part = estimator::ResidualPart::of_rank(own, ranks.rank(), ranks.count());
                const Estimate found =
                    estimator::estimate_over_ranks(parameters, {&part}, part.share(), ranks, {}, options);
                if (ranks.rank() != 0) return;
                REQUIRE(found.status == estimator::EstimateStatus::converged);
                CHECK(found.degrees_of_freedom == one.degrees_of_freedom);
                for (std::size_t i = 0; i < 2; ++i) {
                    const auto &a = found.parameters[i], &b = one.parameters[i];
                    CHECK_THAT(a.value, WithinAbs(b.value, 1e-6 * b.sd));
                    CHECK_THAT(a.sd, WithinRel(b.sd, 1e-6));
                    CHECK_THAT(found.scales[i].value, WithinRel(one.scales[i].value, 1e-6));
                }
            });
        }
    }
}

}  // namespace shooting_over_ranks_test
