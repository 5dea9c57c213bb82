// Constraints between blocks that make no sense, and answers of the wrong shape.

#include <cmath>
#include <functional>
#include <limits>
#include <string>

#include "estimator/estimate/estimate.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/interface/function_residual.hpp"

namespace orbid::tests::chain_refusal_test {

namespace {

constexpr double nan_value = std::numeric_limits<double>::quiet_NaN();

/// Two nodes z_0, z_1 read without error law of their own, matched by z_1 = theta z_0.
struct Chain {
    std::function<void(std::vector<estimator::BlockValue>&)> spoil;
    std::function<void(estimator::BlockLayout&)> change;
    bool second_active = true;
};

class ChainResidual : public estimator::Residual {
public:
    explicit ChainResidual(Chain chain) : chain_(std::move(chain)), groups_{group("y", 0.1, false)} {
        for (int b = 0; b < 2; ++b) {
            auto block = orbid::tests::layout("node " + std::to_string(b), 1);
            block.latents = 1;
            if (b == 0) {
                block.constraints = 1;
                block.next = 1;
                if (chain_.change) chain_.change(block);
            }
            layout_.push_back(std::move(block));
        }
        layout_[1].active = chain_.second_active;
    }
    [[nodiscard]] std::string_view type() const override { return "chain"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override {
        return {Eigen::VectorXd::Constant(1, 2.0), Eigen::VectorXd::Constant(1, 3.0)};
    }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& z,
                                                              bool) const override {
        std::vector<estimator::BlockValue> values(2);
        for (std::size_t b = 0; b < 2; ++b) {
            if (!active.layout[b].active) continue;
            values[b].e = Eigen::VectorXd::Constant(1, (b == 0 ? 2.0 : 3.0) - z[b][0]);
            values[b].e_theta = Eigen::MatrixXd::Zero(1, 1);
            values[b].e_z = -Eigen::MatrixXd::Ones(1, 1);
        }
        values[0].c = Eigen::VectorXd::Constant(1, z[1][0] - theta[0] * z[0][0]);
        values[0].c_theta = Eigen::MatrixXd::Constant(1, 1, -z[0][0]);
        values[0].c_z = Eigen::MatrixXd::Constant(1, 1, -theta[0]);
        values[0].c_next = Eigen::MatrixXd::Ones(1, 1);
        if (chain_.spoil) chain_.spoil(values);
        return values;
    }

private:
    Chain chain_;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

estimator::Estimate chain_estimate(Chain chain) {
    ChainResidual residual(std::move(chain));
    return estimator::estimate({free_parameter("theta", 1.0)}, {&residual});
}

}  // namespace

TEST_CASE("constraints to a block that is missing or takes no part", "[estimator]") {
    const auto whole = chain_estimate({});
    CAPTURE(whole.message);
    CHECK(whole.status == estimator::EstimateStatus::converged);
    CHECK_THAT(whole.parameters[0].value, WithinRel(1.5, 1e-8));
    // theta = z_1 / z_0: sd^2 = (0.1 / 2)^2 + (3 * 0.1 / 4)^2.
    CHECK_THAT(whole.parameters[0].sd, WithinRel(std::hypot(0.05, 0.075), 1e-6));
    // Without its next block the constraint says nothing, and nothing else knows theta.
    Chain broken;
    broken.second_active = false;
    const auto cut = chain_estimate(broken);
    CHECK(cut.status == estimator::EstimateStatus::singular);
    REQUIRE(cut.null_directions.size() == 1);
    CHECK(cut.counts[0].lost == 1);
    CHECK(cut.counts[0].used == 1);
    Chain beyond;
    beyond.change = [](estimator::BlockLayout& block) { block.next = 2; };
    CHECK_THROWS_WITH(chain_estimate(beyond),
                      ContainsSubstring("\"node 0\": its next block 2 does not exist, there are 2"));
    for (const double size : {0.0, -1.0, nan_value}) {
        Chain sizes;
        sizes.change = [size](estimator::BlockLayout& block) {
            block.constraint_size = Eigen::VectorXd::Constant(1, size);
        };
        CHECK_THROWS_WITH(chain_estimate(sizes), ContainsSubstring("constraint sizes"));
    }
}

TEST_CASE("values of the wrong shape are refused with their block", "[estimator]") {
    using Values = std::vector<estimator::BlockValue>;
    const std::vector<std::function<void(Values&)>> spoils{
        [](Values& v) { v[0].e = Eigen::VectorXd::Zero(2); },
        [](Values& v) { v[0].e_theta = Eigen::MatrixXd::Zero(1, 2); },
        [](Values& v) { v[0].e_z = Eigen::MatrixXd::Zero(1, 2); },
        [](Values& v) { v[0].c = Eigen::VectorXd::Zero(2); },
        [](Values& v) { v[0].c.resize(0); },
        [](Values& v) { v[0].c_theta = Eigen::MatrixXd::Zero(1, 2); },
        [](Values& v) { v[0].c_z = Eigen::MatrixXd::Zero(2, 1); },
        [](Values& v) { v[0].c_z.resize(0, 0); },
        [](Values& v) { v[0].c_next = Eigen::MatrixXd::Zero(1, 2); },
        [](Values& v) { v[0].c_next.resize(0, 0); },
    };
    for (std::size_t i = 0; i < spoils.size(); ++i) {
        CAPTURE(i);
        Chain chain;
        chain.spoil = spoils[i];
        CHECK_THROWS_WITH(chain_estimate(chain), ContainsSubstring("\"node 0\": values of the wrong shape"));
    }
    Chain short_answer;
    short_answer.spoil = [](Values& v) { v.pop_back(); };
    CHECK_THROWS_WITH(chain_estimate(short_answer), ContainsSubstring("answered 1 blocks, layout has 2"));
    // A constraint that is not a number is a block that cannot be evaluated.
    Chain undefined;
    undefined.spoil = [](Values& v) { v[0].c[0] = nan_value; };
    const auto result = chain_estimate(undefined);
    CHECK(result.status == estimator::EstimateStatus::failed);
    CHECK_THAT(result.message, ContainsSubstring("\"node 0\""));
}

}  // namespace orbid::tests::chain_refusal_test
