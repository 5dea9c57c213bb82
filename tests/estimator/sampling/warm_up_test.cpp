// What the warm-up of the sampler finds: the length of steps, and the metric.
#include <cmath>

#include "estimator/sampling/dual_averaging.hpp"
#include "estimator/sampling/nuts.hpp"
#include "tests/catch.hpp"

namespace orbid::tests::warm_up_test {

TEST_CASE("dual averaging of a constant acceptance has its closed form", "[estimator]") {
    // H_m = d m / (m + 10) for a constant difference d, so ln step_m = ln(10 step_0) - 20 d m^1.5 / (m + 10).
    estimator::DualAveraging averaging(0.2, 0.8);
    CHECK_THAT(averaging.step(), WithinRel(0.2, 1e-15));
    CHECK_THAT(averaging.averaged(), WithinRel(0.2, 1e-15));
    double ln_averaged = 0.0;
    for (int m = 1; m <= 30; ++m) {
        averaging.observe(0.7);
        const double ln_step = std::log(2.0) - 20.0 * 0.1 * std::pow(m, 1.5) / (m + 10.0);
        REQUIRE_THAT(std::log(averaging.step()), WithinAbs(ln_step, 1e-13));
        const double share = std::pow(m, -0.75);
        ln_averaged = share * ln_step + (1.0 - share) * ln_averaged;
        REQUIRE_THAT(std::log(averaging.averaged()), WithinAbs(ln_averaged, 1e-13));
    }
    averaging.restart(0.2);
    CHECK_THAT(averaging.averaged(), WithinRel(0.2, 1e-15));
}

TEST_CASE("dual averaging finds the step of a known acceptance", "[estimator]") {
    for (const double first : {1e-3, 1.0, 100.0}) {
        CAPTURE(first);
        estimator::DualAveraging averaging(first, 0.8);
        for (int m = 0; m < 3000; ++m)
            averaging.observe(std::exp(-averaging.step()));
        // The weights m^-0.75 forget slowly: measured within 1 % after 3000.
        CHECK_THAT(averaging.averaged(), WithinRel(-std::log(0.8), 0.1));
    }
}

TEST_CASE("windows of the warm-up", "[estimator]") {
    CHECK(estimator::warm_up_plan(1000).updates == std::vector<int>{100, 150, 250, 450, 950});
    CHECK(estimator::warm_up_plan(1000).skipped == 75);
    CHECK(estimator::warm_up_plan(500).updates == std::vector<int>{100, 150, 250, 450});
    CHECK(estimator::warm_up_plan(150).updates == std::vector<int>{100});
    CHECK(estimator::warm_up_plan(100).updates == std::vector<int>{90});
    CHECK(estimator::warm_up_plan(100).skipped == 15);
    CHECK(estimator::warm_up_plan(19).updates.empty());
    for (int n = 20; n < 3000; ++n) {
        const auto plan = estimator::warm_up_plan(n);
        REQUIRE_FALSE(plan.updates.empty());
        int before = plan.skipped;
        for (const int at : plan.updates) {
            REQUIRE(at - before >= 2);
            before = at;
        }
        REQUIRE(before <= n);
        REQUIRE(before >= n - 50);
    }
}

TEST_CASE("a renewed metric is the weighted mean of window and old metric", "[estimator]") {
    Eigen::MatrixXd window(2, 3);
    window << 1.0, 2.0, 3.0, 0.0, 3.0, 0.0;
    Eigen::MatrixXd covariance(2, 2);
    covariance << 1.0, 0.0, 0.0, 3.0;
    const Eigen::MatrixXd old = 2.0 * Eigen::MatrixXd::Identity(2, 2);
    CHECK((estimator::renewed_metric(window, old) - (3.0 * covariance + 7.0 * old) / 10.0).norm() < 1e-15);
}

}  // namespace orbid::tests::warm_up_test
