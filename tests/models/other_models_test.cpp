#include <cmath>
#include <numbers>

#include "models/registry.hpp"
#include "tests/catch.hpp"

namespace orbid::models {

using tests::ContainsSubstring;
using tests::WithinAbs;
using tests::WithinRel;

namespace {
constexpr double pi = std::numbers::pi;
}

TEST_CASE("a free pendulum is back after its exact period", "[models][reference]") {
    // T w0 / (2 pi) = 1 / agm(1, cos(amplitude / 2)); 60 decimal digits, rounded to 17.
    struct Row {
        double amplitude_deg, period_ratio;
    };
    const std::vector<Row> rows{{10.0, 1.0019071881432167},
                                {45.0, 1.0399733431968038},
                                {90.0, 1.1803405990160962},
                                {135.0, 1.5279475882343913},
                                {170.0, 2.4393627196738841}};
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta(5);
    theta << 19.62, 0.0, 0.0, 0.0, 0.0;
    for (const Row& row : rows) {
        CAPTURE(row.amplitude_deg);
        const double start = row.amplitude_deg * pi / 180.0;
        const std::vector<double> period{row.period_ratio * 2.0 * pi / std::sqrt(19.62)};
        const auto flow = system->flow(Eigen::Vector2d(start, 0.0), 0.0, period, theta, Clock::time);
        CHECK(flow.crossings >= 1);
        // Tolerance 1e-12 per step; worst measured 3e-12 and 3e-11 (170 deg), times ten.
        CHECK_THAT(flow.states(0, 0), WithinAbs(start, 3e-11));
        CHECK_THAT(flow.states(1, 0), WithinAbs(0.0, 3e-10));
    }
}

TEST_CASE("a free pendulum with dry friction comes to rest and stays", "[models][fast]") {
    const auto system = make_system("free_pendulum");
    Eigen::VectorXd theta = system->default_parameters();
    theta[1] = 0.3;
    const auto flow = system->flow(Eigen::Vector2d(1.0, 0.0), 0.0, std::vector{1e4}, theta, Clock::time);
    CHECK(flow.status == FlowStatus::ok);
    CHECK(flow.stickings == 1);
    CHECK(flow.states(1, 0) == 0.0);
    CHECK(std::abs(std::sin(flow.states(0, 0))) < 0.3 / 30.0);
    CHECK(system->at_rest(flow.states.col(0), theta));
    CHECK_FALSE(system->smooth(theta));
    CHECK(system->smooth(system->default_parameters()));
}

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

TEST_CASE("a linear oscillator under harmonic force follows its closed form with derivatives", "[models][reference]") {
    const auto system = make_system("duffing");
    const double delta = 0.4, alpha = 4.0, gamma = 1.5, omega = 1.7, phase = 0.6;
    Eigen::VectorXd theta(5);
    theta << delta, alpha, 0.0, gamma, omega;
    // x = e^(-delta t / 2) (a cos wt + b sin wt) + gamma Re[e^(i tau) / (alpha - omega^2 + i delta omega)]
    const auto solution = [&](double t, double x, double v) {
        const double w = std::sqrt(alpha - delta * delta / 4.0);
        const double re = alpha - omega * omega, im = delta * omega, size = re * re + im * im;
        const auto forced = [&](double tau) {
            return Eigen::Vector2d(gamma * (re * std::cos(tau) + im * std::sin(tau)) / size,
                                   gamma * omega * (im * std::cos(tau) - re * std::sin(tau)) / size);
        };
        const Eigen::Vector2d free = Eigen::Vector2d(x, v) - forced(phase);
        const double a = free[0], b = (free[1] + delta / 2.0 * a) / w;
        const double e = std::exp(-delta * t / 2.0), c = std::cos(w * t), s = std::sin(w * t);
        Eigen::Vector2d y(e * (a * c + b * s), e * ((b * w - delta / 2.0 * a) * c - (a * w + delta / 2.0 * b) * s));
        return Eigen::Vector2d(y + forced(phase + omega * t));
    };
    const std::vector<double> durations{1.0, 7.0};
    const auto flow = system->flow_with_sensitivities(Eigen::Vector2d(0.8, -0.3), phase, durations, theta,
                                                      std::vector<Eigen::Index>{3}, Clock::time);
    for (Eigen::Index k = 0; k < 2; ++k) {
        const double t = durations[static_cast<std::size_t>(k)];
        const Eigen::Vector2d x = solution(t, 0.8, -0.3);
        CHECK((flow.states.col(k) - x).norm() < 1e-11);
        // Linear in the start and in gamma: differences are exact.
        CHECK((flow.sensitivity(k, 3).col(0) - (solution(t, 1.8, -0.3) - x)).norm() < 1e-10);
        CHECK((flow.sensitivity(k, 3).col(1) - (solution(t, 0.8, 0.7) - x)).norm() < 1e-10);
        const Eigen::Vector2d from_rest = solution(t, 0.0, 0.0);
        CHECK((flow.sensitivity(k, 3).col(2) - from_rest / gamma).norm() < 1e-10);
    }
}

TEST_CASE("symmetries map solutions to solutions", "[models][fast]") {
    for (const char* name : {"parametric_pendulum", "free_pendulum", "duffing"}) {
        CAPTURE(name);
        const auto system = make_system(name);
        const auto symmetry = system->symmetry();
        REQUIRE(symmetry);
        const Eigen::Vector2d signs(symmetry->signs[0], symmetry->signs[1]);
        const Eigen::Vector2d x0(0.7, -1.1);
        const std::vector<double> durations{2.0};
        const Eigen::VectorXd theta = system->default_parameters();
        const auto one = system->flow(x0, 0.2, durations, theta, Clock::time);
        const auto other =
            system->flow(signs.cwiseProduct(x0), 0.2 + symmetry->phase_shift, durations, theta, Clock::time);
        CHECK((signs.cwiseProduct(one.states.col(0)) - other.states.col(0)).norm() < 1e-10);
    }
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
        CHECK(system->coordinate_index(system->coordinates()[1].name) == 1);
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

}  // namespace orbid::models
