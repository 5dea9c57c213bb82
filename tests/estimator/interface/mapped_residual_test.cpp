#include "estimator/interface/mapped_residual.hpp"

#include <cmath>
#include <stdexcept>

#include "estimator/problem/tie.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::mapped_residual_test {

namespace {

using namespace estimator;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

/// e = (a b - z, b c^2, a + c z), c(theta, z) = a z + b: nonlinear in everything, with a constraint.
FunctionResidual::Function curved() {
    return [](const VectorXd& p, const VectorXd& z, bool derivatives) {
        BlockValue value;
        value.e = Vector3d(p[0] * p[1] - z[0], p[1] * p[2] * p[2], p[0] + p[2] * z[0]);
        value.c = VectorXd::Constant(1, p[0] * z[0] + p[1]);
        if (!derivatives) return value;
        value.e_theta.resize(3, 3);
        value.e_theta << p[1], p[0], 0.0, 0.0, p[2] * p[2], 2.0 * p[1] * p[2], 1.0, 0.0, z[0];
        value.e_z = Vector3d(-1.0, 0.0, p[2]);
        value.c_theta = Vector3d(z[0], 1.0, 0.0).transpose();
        value.c_z = MatrixXd::Constant(1, 1, p[0]);
        return value;
    };
}

BlockLayout curved_layout(const std::string& label) {
    BlockLayout block = layout(label, 3);
    block.latents = 1;
    block.constraints = 1;
    return block;
}

FunctionResidual two_blocks() {
    FunctionResidual residual;
    residual.add_group(group("y", 0.3));
    residual.add_block(curved_layout("first"), curved(), VectorXd::Constant(1, 0.5));
    residual.add_block(curved_layout("second"), curved(), VectorXd::Constant(1, -0.25));
    return residual;
}

/// a = 2 r1, b = r0, c = -r1.
ParameterMap tied() {
    return ParameterMap({{1, 2.0}, {0, 1.0}, {1, -1.0}}, 2);
}

}  // namespace

TEST_CASE("a map expands and sums columns", "[estimator][mapped]") {
    const ParameterMap map = tied();
    CHECK(map.expand(Vector2d(3.0, 5.0)) == Vector3d(10.0, 3.0, -5.0));
    MatrixXd columns(2, 3);
    columns << 1.0, 2.0, 3.0, 4.0, 5.0, 6.0;
    MatrixXd expected(2, 2);
    expected << 2.0, 2.0 - 3.0, 5.0, 8.0 - 6.0;
    CHECK(map.reduce_columns(columns) == expected);
    CHECK(map.reduce_columns(columns) == columns * map.jacobian());

    const ParameterMap pins = ParameterMap::pinned(4, {{2, 7.0}, {0, -1.0}});
    CHECK(pins.reduced_size() == 2);
    CHECK(pins.expand(Vector2d(3.0, 5.0)) == Eigen::Vector4d(-1.0, 3.0, 7.0, 5.0));
    CHECK(ParameterMap::identity(3).expand(Vector3d(1.0, 2.0, 3.0)) == Vector3d(1.0, 2.0, 3.0));
    CHECK(ParameterMap::pinned(1, {{0, 2.0}}).expand(VectorXd()) == VectorXd::Constant(1, 2.0));

    CHECK_THROWS_AS(ParameterMap({{2, 1.0}}, 2), std::invalid_argument);
    CHECK_THROWS_AS(ParameterMap({{-2, 1.0}}, 2), std::invalid_argument);
    CHECK_THROWS_WITH(ParameterMap({{0, 0.0}}, 1), ContainsSubstring("factor = 0"));
    CHECK_THROWS_AS(ParameterMap({{0, nan_value}}, 1), std::invalid_argument);
    CHECK_THROWS_AS(ParameterMap({{-1, nan_value}}, 1), std::invalid_argument);
    CHECK_THROWS_AS(ParameterMap::pinned(2, {{2, 1.0}}), std::invalid_argument);
    CHECK_THROWS_WITH(ParameterMap::pinned(2, {{1, 1.0}, {1, 2.0}}), ContainsSubstring("given twice"));
}

TEST_CASE("values and derivatives of the mapped residual are those of the chain rule", "[estimator][mapped]") {
    FunctionResidual inner = two_blocks();
    const MappedResidual mapped(inner, tied());
    const Vector2d reduced(1.5, 0.7);
    const auto latents = mapped.initial_latents();
    const auto values = mapped.evaluate(mapped.initial_set(), reduced, latents, true);
    const auto direct = inner.evaluate(inner.initial_set(), Vector3d(1.4, 1.5, -0.7), latents, true);
    REQUIRE(values.size() == 2);
    for (std::size_t b = 0; b < 2; ++b) {
        CHECK(values[b].e == direct[b].e);
        CHECK(values[b].c == direct[b].c);
        CHECK(values[b].e_z == direct[b].e_z);
        CHECK(values[b].c_z == direct[b].c_z);
        REQUIRE(values[b].e_theta.cols() == 2);
        REQUIRE(values[b].c_theta.cols() == 2);
        for (Eigen::Index k = 0; k < 2; ++k) {
            // Polynomials of degree three: central differences are wrong by h^2, rounding 1e-16 / h.
            const double h = 1e-5;
            Vector2d up = reduced;
            Vector2d down = reduced;
            up[k] += h;
            down[k] -= h;
            const auto above = mapped.evaluate(mapped.initial_set(), up, latents, false)[b];
            const auto below = mapped.evaluate(mapped.initial_set(), down, latents, false)[b];
            CHECK(above.e_theta.size() == 0);
            CHECK((values[b].e_theta.col(k) - (above.e - below.e) / (2.0 * h)).norm() < 1e-9);
            CHECK((values[b].c_theta.col(k) - (above.c - below.c) / (2.0 * h)).norm() < 1e-9);
        }
    }
    // Everything pinned: no columns, but rows.
    const MappedResidual fixed(inner, ParameterMap::pinned(3, {{0, 1.0}, {1, 2.0}, {2, 3.0}}));
    const auto alone = fixed.evaluate(fixed.initial_set(), VectorXd(), latents, true);
    CHECK(alone[0].e_theta.rows() == 3);
    CHECK(alone[0].e_theta.cols() == 0);
    CHECK(alone[0].e == inner.evaluate(inner.initial_set(), Vector3d(1.0, 2.0, 3.0), latents, true)[0].e);
}

TEST_CASE("a block that cannot be evaluated stays failed", "[estimator][mapped]") {
    FunctionResidual inner;
    inner.add_group(group("y"));
    inner.add_block(layout("data", 2), [](const VectorXd&, const VectorXd&, bool) {
        BlockValue value;
        value.status = BlockStatus::failed;
        return value;
    });
    const MappedResidual mapped(inner, ParameterMap::identity(1));
    CHECK(mapped.evaluate(mapped.initial_set(), VectorXd::Ones(1), {VectorXd()}, true)[0].status ==
          BlockStatus::failed);
}

TEST_CASE("error parameters are fixed or started elsewhere", "[estimator][mapped]") {
    FunctionResidual inner;
    Group heavy = group("heavy", 1.0);
    heavy.scale.prior = HalfCauchyPrior{2.0};
    heavy.distribution = StudentErrors{{true, 5.0, FlatPrior{}}};
    inner.add_group(heavy);
    inner.add_group(group("plain", 1.0));
    MappedResidualOptions options;
    options.errors = {{"heavy", "scale", 0.5, false}, {"heavy", "dof", 3.0, false}, {"plain", "scale", 0.0, true}};
    const MappedResidual mapped(inner, ParameterMap::identity(1), options);
    CHECK(mapped.groups()[0].scale.value == 0.5);
    CHECK_FALSE(mapped.groups()[0].scale.estimate);
    CHECK(std::holds_alternative<HalfCauchyPrior>(mapped.groups()[0].scale.prior));
    CHECK(std::get<StudentErrors>(mapped.groups()[0].distribution).dof.value == 3.0);
    CHECK_FALSE(std::get<StudentErrors>(mapped.groups()[0].distribution).dof.estimate);
    CHECK(mapped.groups()[1].scale.estimate);
    CHECK(mapped.groups()[1].scale.value == 0.0);
    CHECK(inner.groups()[0].scale.value == 1.0);

    const auto refused = [&](const ErrorOverride& change, const std::string& what) {
        MappedResidualOptions wrong;
        wrong.errors = {change};
        CHECK_THROWS_AS(MappedResidual(inner, ParameterMap::identity(1), wrong), std::invalid_argument);
        CHECK_THROWS_WITH(MappedResidual(inner, ParameterMap::identity(1), wrong), ContainsSubstring(what));
    };
    refused({"light", "scale", 1.0, false}, "\"light\": the residual has no group of that name");
    refused({"plain", "dof", 3.0, false}, "no parameter \"dof\"");
    refused({"heavy", "dof", 0.5, false}, "dof = 0.5");
    refused({"heavy", "scale", 0.0, false}, "scale = 0");
    refused({"heavy", "scale", nan_value, true}, "scale = nan");
}

TEST_CASE("an element of a full covariance cannot be set alone", "[estimator][mapped]") {
    class Two : public FunctionResidual {
    public:
        [[nodiscard]] std::vector<JointCovariance> covariances() const override { return {{{0, 1}, 0.0, {}}}; }
    };
    Two inner;
    inner.add_group(group("a"));
    inner.add_group(group("b"));
    CHECK(MappedResidual(inner, ParameterMap::identity(1)).covariances().size() == 1);
    MappedResidualOptions options;
    options.errors = {{"b", "scale", 1.0, false}};
    CHECK_THROWS_WITH(MappedResidual(inner, ParameterMap::identity(1), options), ContainsSubstring("full covariance"));
}

TEST_CASE("latent states start elsewhere", "[estimator][mapped]") {
    FunctionResidual inner = two_blocks();
    MappedResidualOptions options;
    options.initial_latents = std::vector<VectorXd>{VectorXd::Constant(1, 9.0), VectorXd::Constant(1, 8.0)};
    const MappedResidual mapped(inner, tied(), options);
    CHECK(mapped.initial_latents()[0][0] == 9.0);
    CHECK(mapped.initial_latents()[1][0] == 8.0);
    CHECK(inner.initial_latents()[0][0] != 9.0);

    inner.add_block(curved_layout("third"), curved(), VectorXd::Constant(1, 0.125));
    CHECK_THROWS_WITH(MappedResidual(inner, tied(), options), ContainsSubstring("of 2 blocks, the residual has 3"));
    options.initial_latents->push_back(VectorXd::Zero(2));
    CHECK_THROWS_WITH(MappedResidual(inner, tied(), options), ContainsSubstring("\"third\": 2 initial latent states"));
}

TEST_CASE("updates go through, or stop at an adapter with a given set", "[estimator][mapped]") {
    FunctionResidual inner = two_blocks();
    int updates = 0;
    inner.on_update = [&updates](estimator::ActiveSet& active) {
        ++updates;
        active.layout.edit()[0].active = false;
        return RefreshReport{true, 1, 0, 2};
    };
    const auto latents = inner.initial_latents();
    const MappedResidual open(inner, tied());
    estimator::ActiveSet active = open.initial_set();
    CHECK(open.update_active_set(active, Vector2d(1.0, 1.0), latents, VectorXd::Ones(1)).added == 2);
    CHECK(updates == 1);
    CHECK_FALSE(active.layout[0].active);
    CHECK(open.evaluate(active, Vector2d(1.0, 1.0), latents, true)[0].e.size() == 0);
    CHECK(inner.layout()[0].active);
    CHECK(open.layout()[0].active);

    MappedResidualOptions options;
    options.active = inner.initial_set();
    const MappedResidual other(inner, tied(), options);
    options.active->layout.edit()[1].active = false;
    options.active->is_intermediate_stage = true;
    const MappedResidual given(inner, tied(), options);
    active = given.initial_set();
    CHECK_FALSE(active.is_intermediate_stage);
    CHECK_FALSE(given.update_active_set(active, Vector2d(1.0, 1.0), latents, VectorXd::Ones(1)).changed);
    CHECK(updates == 1);
    CHECK(active.layout[0].active);
    CHECK_FALSE(active.layout[1].active);
    const auto values = given.evaluate(active, Vector2d(1.0, 1.0), latents, true);
    CHECK(values[0].e.size() == 3);
    CHECK(values[1].e.size() == 0);
    CHECK(other.evaluate(other.initial_set(), Vector2d(1.0, 1.0), latents, true)[1].e.size() == 3);
}

}  // namespace orbid::tests::mapped_residual_test
