#include <cmath>

#include "models/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models {

using tests::WithinAbs;

TEST_CASE("prey and predators conserve their integral", "[models][fast]") {
    const auto system = make_system("lotka_volterra");
    const Eigen::VectorXd p = system->default_parameters();
    const auto conserved = [&](const Eigen::Vector2d& x) {
        return p[3] * x[0] - p[2] * std::log(x[0]) + p[1] * x[1] - p[0] * std::log(x[1]);
    };
    const Eigen::Vector2d x0(30.0, 4.0);
    std::vector<double> durations;
    for (int i = 1; i <= 20; ++i)
        durations.push_back(5.0 * i);
    const auto flow = system->flow(x0, 0.0, durations, p, Clock::time);
    for (Eigen::Index k = 0; k < flow.states.cols(); ++k)
        CHECK_THAT(conserved(flow.states.col(k)), WithinAbs(conserved(x0), 1e-10));
    CHECK((flow.states.rowwise().maxCoeff() - flow.states.rowwise().minCoeff()).minCoeff() > 10.0);
    CHECK(system->at_rest(Eigen::Vector2d(p[2] / p[3], p[0] / p[1]), p));
    CHECK_FALSE(system->at_rest(x0, p));
}

}  // namespace orbid::models
