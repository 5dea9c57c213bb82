// A random walk read with errors, 200 points: reading and matching scale together. Latent states have to be integrated
// out; maximised jointly with the scales they make the objective unbounded.

#include <cmath>
#include <numbers>

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/exact_walk.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::latent_chain_test {

namespace {

/// One block per point with latent state (z_i, w_i), w_i a record of the matching group, and as constraints
/// z_1 = mu + w_1 and z_{i+1} = z_i + w_{i+1}.
class ConstrainedWalk : public estimator::Residual {
public:
    explicit ConstrainedWalk(Eigen::VectorXd y)
        : y_(std::move(y)), groups_{group("reading", 1.0), group("matching", 1.0)} {
        for (Eigen::Index i = 0; i < points; ++i) {
            auto block = orbid::tests::layout("point " + std::to_string(i), 2);
            block.group = {0, 1};
            block.latents = 2;
            block.constraints = (i == 0 ? 1 : 0) + (i + 1 < points ? 1 : 0);
            if (i + 1 < points) block.next = i + 1;
            layout_.push_back(std::move(block));
        }
    }
    [[nodiscard]] std::string_view type() const override { return "walk"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override {
        std::vector<Eigen::VectorXd> latents;
        for (const double y : y_)
            latents.emplace_back(Eigen::Vector2d(y, 0.0));
        return latents;
    }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet&, const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& z,
                                                              bool) const override {
        std::vector<estimator::BlockValue> values(layout_.size());
        for (std::size_t b = 0; b < layout_.size(); ++b) {
            estimator::BlockValue& value = values[b];
            value.e = Eigen::Vector2d(y_[static_cast<Eigen::Index>(b)] - z[b][0], -z[b][1]);
            value.e_theta.setZero(2, theta.size());
            value.e_z = -Eigen::Matrix2d::Identity();
            const Eigen::Index count = layout_[b].constraints;
            value.c.resize(count);
            value.c_theta.setZero(count, theta.size());
            value.c_z.setZero(count, 2);
            value.c_next.setZero(count, layout_[b].next >= 0 ? 2 : 0);
            Eigen::Index row = 0;
            if (b == 0) {
                value.c[row] = z[0][0] - z[0][1] - theta[0];
                value.c_theta(row, 0) = -1.0;
                value.c_z.row(row) << 1.0, -1.0;
                ++row;
            }
            if (layout_[b].next >= 0) {
                value.c[row] = z[b + 1][0] - z[b][0] - z[b + 1][1];
                value.c_z.row(row) << -1.0, 0.0;
                value.c_next.row(row) << 1.0, -1.0;
            }
        }
        return values;
    }

private:
    Eigen::VectorXd y_;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

estimator::Estimate walk_estimate(estimator::Residual& residual, estimator::Variance variance) {
    estimator::EstimateOptions options;
    options.variance = variance;
    options.step_tolerance = 1e-9;
    return estimator::estimate({free_parameter("mu", 0.0)}, {&residual}, {}, options);
}

}  // namespace

TEST_CASE("reading and matching scales of a walk are those of its exact likelihood", "[estimator]") {
    const Eigen::VectorXd y = made_walk();
    const ExactWalk exact(y);
    FunctionResidual dense = dense_walk(y);
    const auto one_block = walk_estimate(dense, estimator::Variance::ml);
    check_against(exact, one_block);
    // Integrating 200 latent states out of 400 records leaves n/2 ln 2 pi beside Phi_psi, which has none.
    CHECK_THAT(one_block.objective + 0.5 * points * std::log(2.0 * std::numbers::pi),
               WithinRel(exact.at(exact.maximum()).value, 1e-10));
    ConstrainedWalk constrained(y);
    const auto chain = walk_estimate(constrained, estimator::Variance::ml);
    check_against(exact, chain);
    CHECK_THAT(chain.log_likelihood, WithinRel(one_block.log_likelihood, 1e-8));
    for (Eigen::Index i = 0; i < points; ++i) {
        const auto b = static_cast<std::size_t>(i);
        CHECK_THAT(chain.latents[0][b][0], WithinAbs(one_block.latents[0][0][i], 1e-8));
        CHECK_THAT(chain.latent_sds[0][b][0], WithinRel(one_block.latent_sds[0][0][i], 1e-6));
    }
}

TEST_CASE("maximised jointly with the scales the states of a walk would collapse", "[estimator]") {
    const Eigen::VectorXd y = made_walk();
    FunctionResidual residual = dense_walk(y);
    // Phi of (M8) at z = y, the matching scale at its best there: every tenth of the reading scale gains 200 ln 10.
    const auto value = residual.evaluate(residual.initial_set(), Eigen::VectorXd::Constant(1, y[0]), {y}, false);
    CHECK_THAT(value[0].e.head(points).norm(), WithinAbs(0.0, 0.0));
    const double matching = value[0].e.tail(points).norm() / std::sqrt(points);
    const auto phi = [&](double reading) { return points * (std::log(reading) + std::log(matching)) + 0.5 * points; };
    for (int k = 1; k < 12; ++k)
        CHECK_THAT(phi(std::pow(10.0, -k)) - phi(std::pow(10.0, -k - 1)), WithinRel(points * std::log(10.0), 1e-12));
    ConstrainedWalk chain(y);
    for (const auto variance : {estimator::Variance::restricted}) {  // ml: the test above
        const auto result = walk_estimate(chain, variance);
        CAPTURE(result.message);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        // The walk was made with 0.3 and 0.1; 200 points tell them to about 6 % and 15 %.
        for (std::size_t g = 0; g < 2; ++g) {
            const double truth = g == 0 ? 0.3 : 0.1;
            CHECK(std::abs(result.scales[g].value - truth) < 3.0 * result.scales[g].uncertainty);
            CHECK(result.scales[g].uncertainty < 0.3 * truth);
        }
    }
}

}  // namespace orbid::tests::latent_chain_test
