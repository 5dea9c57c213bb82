// A residual of one's own: length of a pendulum from periods measured at several amplitudes.
#include <cmath>
#include <cstdio>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "estimator/estimate/estimate.hpp"

using namespace orbid;

/// e_k = T_k - T(l, A_k),   T = 2 pi sqrt(l / g) / agm(1, cos(A / 2)): one block, one record per reading.
class Periods : public estimator::Residual {
public:
    Periods(std::vector<double> amplitudes, std::vector<double> periods)
        : amplitudes_(std::move(amplitudes)), periods_(std::move(periods)) {
        groups_.push_back({.name = "period", .unit = "s"});
        layout_.push_back({.label = "readings", .group = std::vector<int>(periods_.size(), 0)});
    }
    std::string_view type() const override { return "periods"; }
    const std::vector<estimator::Group>& groups() const override { return groups_; }
    const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    estimator::LatentStructure structure() const override { return estimator::LatentStructure::none; }
    std::vector<Eigen::VectorXd> initial_latents() const override { return {Eigen::VectorXd(0)}; }

    std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet&, const Eigen::VectorXd& theta,
                                                const std::vector<Eigen::VectorXd>&,
                                                bool /*derivatives*/) const override {
        const auto count = static_cast<Eigen::Index>(periods_.size());
        estimator::BlockValue value;
        value.e.resize(count);
        value.e_theta.resize(count, 1);
        value.e_z.resize(count, 0);
        for (Eigen::Index k = 0; k < count; ++k) {
            double a = 1.0, b = std::cos(amplitudes_[k] / 2.0);
            // Digits double with each mean: five are enough for any amplitude below 179 degrees.
            for (int i = 0; i < 5; ++i)
                std::tie(a, b) = std::pair(0.5 * (a + b), std::sqrt(a * b));
            const double period = 2.0 * std::numbers::pi * std::sqrt(theta[0] / 9.81) / a;
            value.e[k] = periods_[k] - period;
            value.e_theta(k, 0) = -period / (2.0 * theta[0]);
        }
        return {value};
    }

private:
    std::vector<double> amplitudes_;  ///< [rad]
    std::vector<double> periods_;     ///< [s]
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
};

int main() {
    Periods periods({0.1, 0.5, 1.0, 1.5, 2.0}, {1.4190, 1.4406, 1.5139, 1.6503, 1.8854});
    const auto result = estimator::estimate(
        {{.name = "l", .unit = "m", .start = 0.3, .scale = estimator::Scale::log, .lower = 0.0}}, {&periods});
    const auto& length = result.parameters[0];
    std::printf("%s\nl = %.4f m, 95 %% within %.4f and %.4f m\n", estimator::name(result.status).data(), length.value,
                length.lower95, length.upper95);
    std::printf("sd of a reading %.4f s\n", result.scales[0].value);
}
