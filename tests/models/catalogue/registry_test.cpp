#include <cmath>
#include <numbers>

#include "models/catalogue/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models::registry_test {

using tests::ContainsSubstring;
using tests::WithinAbs;

namespace {
constexpr double pi = std::numbers::pi;
}

TEST_CASE("symmetries map solutions to solutions", "[models][fast]") {
    std::size_t seen = 0;
    for (const ModelEntry& entry : registered_models()) {
        CAPTURE(entry.name);
        const auto system = make_system(entry.name);
        const auto symmetry = system->symmetry();
        if (!symmetry) continue;
        ++seen;
        Eigen::VectorXd signs(system->dimension()), x0(system->dimension());
        REQUIRE(symmetry->signs.size() == static_cast<std::size_t>(signs.size()));
        for (Eigen::Index i = 0; i < signs.size(); ++i) {
            signs[i] = symmetry->signs[static_cast<std::size_t>(i)];
            x0[i] = 0.7 - 1.8 * static_cast<double>(i % 2) + 0.1 * static_cast<double>(i);
        }
        const std::vector<double> durations{2.0};
        const Eigen::VectorXd theta = system->default_parameters();
        const auto one = system->flow(x0, 0.2, durations, theta, Clock::time);
        const auto other =
            system->flow(signs.cwiseProduct(x0), 0.2 + symmetry->phase_shift, durations, theta, Clock::time);
        CHECK((signs.cwiseProduct(one.states.col(0)) - other.states.col(0)).norm() < 1e-10);
    }
    // parametric_pendulum, free_pendulum, driven_pendulum, duffing, double_pendulum, lorenz, van_der_pol at least.
    CHECK(seen >= 7);
    CHECK_FALSE(make_system("lotka_volterra")->symmetry());
}

TEST_CASE("the registry knows its models", "[models][fast]") {
    std::string_view before;
    for (const ModelEntry& entry : registered_models()) {
        CHECK(before < entry.name);
        before = entry.name;
        CHECK_FALSE(entry.summary.empty());
        CHECK_FALSE(entry.equations.empty());
        const auto system = make_system(entry.name);
        CHECK(system->name() == entry.name);
        CHECK(system->variant() == (entry.variants.empty() ? "" : entry.variants.front()));
        for (const auto variant : entry.variants)
            CHECK(make_system(entry.name, variant)->variant() == variant);
        const Eigen::VectorXd theta = system->default_parameters();
        for (std::size_t i = 0; i < system->parameters().size(); ++i) {
            const Parameter& p = system->parameters()[i];
            CHECK(contains(p.domain, theta[static_cast<Eigen::Index>(i)]));
            CHECK(p.typical_size > 0.0);
            CHECK(system->parameter_index(p.name) == static_cast<Eigen::Index>(i));
        }
        CHECK(system->parameter_index("no such") == -1);
        CHECK(system->coordinate_index(system->coordinates().back().name) == system->dimension() - 1);
        CHECK(system->coordinate_index("no such") == -1);
    }
    CHECK(registered_models().size() >= 4);
    CHECK_THROWS_WITH(make_system("pendulum"), ContainsSubstring("parametric_pendulum"));
    CHECK_THROWS_WITH(make_system("parametric_pendulum", "krank"), ContainsSubstring("crank_as_printed"));
    CHECK_THROWS_WITH(make_system("duffing", "crank"), ContainsSubstring("no variants"));
}

TEST_CASE("parameters, angles and bindings", "[models][fast]") {
    CHECK(contains(positive, 1.0));
    CHECK_FALSE(contains(positive, 0.0));
    CHECK(contains(nonnegative, 0.0));
    CHECK_FALSE(contains(nonnegative, -1e-300));
    CHECK(contains(any_real, -1.0));
    for (const Domain domain : {any_real, positive, nonnegative}) {
        CHECK_FALSE(contains(domain, std::nan("")));
        CHECK_FALSE(contains(domain, INFINITY));
        CHECK_FALSE(rule(domain).empty());
    }
    CHECK(wrapped(pi) == pi);
    CHECK(wrapped(-pi) == pi);
    CHECK(wrapped(0.5) == 0.5);
    CHECK_THAT(wrapped(0.5 + 200.0 * pi), WithinAbs(0.5, 1e-13));
    CHECK_THAT(wrapped(-4.0), WithinAbs(-4.0 + 2.0 * pi, 1e-15));

    const ParameterBinding binding{Eigen::Vector3d(1, 2, 3), {2, 0}, {1, 1}, 2};
    CHECK(binding.values(Eigen::Vector2d(7, 8)) == Eigen::Vector3d(8, 2, 8));
    Eigen::MatrixXd columns(1, 2), spread(1, 2);
    columns << 5, 6;
    spread << 0, 11;
    CHECK(binding.spread(columns) == spread);
    CHECK_THROWS_AS(binding.values(Eigen::Vector3d(1, 2, 3)), std::invalid_argument);
    CHECK_THROWS_AS(binding.spread(Eigen::MatrixXd::Zero(1, 3)), std::invalid_argument);
}

}  // namespace orbid::models::registry_test
