// Process noise: what a diffusion adds over an interval, and where it enters.

#include <cmath>
#include <vector>

#include <Eigen/LU>

#include "models/catalogue/registry.hpp"
#include "orbits/records/data_error.hpp"
#include "orbits/series_residuals/process_noise.hpp"
#include "orbits/series_residuals/shooting_residual.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/series_residuals/shooting_case.hpp"

namespace process_noise_test {

using namespace orbid;
using namespace orbid::orbits;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using tests::bound;
using tests::WithinAbs;
using tests::WithinRel;

TEST_CASE("links of a diffusion have the covariance of integrated white noise", "[orbits][noise]") {
    // Coordinates 3 -> 0 -> 2 integrate each other, 1 is alone.
    const std::vector<NoiseChain> chains{{{1}}, {{3, 0, 2}}};
    const double t = 0.3;
    // cov(d_i, d_j) = integral of u^i / i! u^j / j! over [0, t], by Simpson's rule: exact up to u^3, halved here.
    const std::vector<Index> order{3, 0, 2};
    MatrixXd covariance = MatrixXd::Zero(4, 4);
    covariance(1, 1) = t;
    constexpr int parts = 400;
    for (int k = 0; k <= parts; ++k) {
        const double u = t * k / parts;
        const double weight = t / parts / 3.0 * (k == 0 || k == parts ? 1.0 : k % 2 == 1 ? 4.0 : 2.0);
        const double shape[] = {1.0, u, 0.5 * u * u};
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                covariance(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(j)]) +=
                    weight * shape[i] * shape[j];
    }
    const LinkErrors errors = link_errors(chains, t);
    const MatrixXd white = errors.unmix * covariance * errors.unmix.transpose();
    for (Index i = 0; i < 4; ++i)
        for (Index j = 0; j < 4; ++j) {
            const double expected = i == j ? errors.deviation[i] * errors.deviation[i] : 0.0;
            CHECK_THAT(white(i, j), WithinAbs(expected, 1e-9 * errors.deviation[i] * errors.deviation[j]));
        }
    CHECK_THAT(errors.unmix.determinant(), WithinRel(1.0, 1e-14));
    CHECK_THAT(errors.deviation[0], WithinRel(std::sqrt(t * t * t / 12.0), 1e-14));
}

TEST_CASE("noise enters where an equation is not that of a velocity", "[orbits][noise]") {
    const auto chains_of = [](const std::string& name) {
        const auto system = models::make_system(name);
        const MatrixXd states = MatrixXd{{0.31, -0.7, 1.3}, {0.52, 0.11, -0.4}, {0.9, 2.0, -1.7}, {1.9, 0.3, 0.7}};
        const std::vector<double> phases{0.1, 0.2, 0.3};
        VectorXd theta(std::ssize(system->parameters()));
        for (Index i = 0; i < theta.size(); ++i)
            theta[i] = system->parameters()[static_cast<std::size_t>(i)].default_value;
        std::vector<std::vector<Index>> found;
        for (const NoiseChain& chain : noise_chains(*system, states.topRows(system->dimension()), phases, theta))
            found.push_back(chain.coordinates);
        return found;
    };
    using Chains = std::vector<std::vector<Index>>;
    CHECK(chains_of("duffing") == Chains{{1, 0}});
    CHECK(chains_of("free_pendulum") == Chains{{1, 0}});
    CHECK(chains_of("lorenz") == Chains{{0}, {1}, {2}});
    CHECK(chains_of("double_pendulum") == Chains{{2, 0}, {3, 1}});
}

TEST_CASE("process noise of a record that has no samples in time is refused", "[orbits][noise]") {
    const tests::PendulumCase c(30, {});
    ShootingOptions options;
    options.matching.kind = Continuity::Kind::diffusion;
    options.matching.estimate = true;
    CHECK_THROWS_WITH(ShootingResidual(c.system, bound(*c.system, c.base, {"l"}), c.series, options),
                      tests::ContainsSubstring("process noise needs samples in time"));
}

}  // namespace process_noise_test
