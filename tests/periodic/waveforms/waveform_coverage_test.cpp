// Steady states read with autoregressive errors, made many times over: how often do intervals of 95 % hold the truth?
// The example job fifty times: configs/campaigns/landing_gear_coverage.json.

#include <cmath>
#include <memory>

#include "estimator/estimate/estimate.hpp"
#include "periodic/waveforms/waveform_residual.hpp"
#include "tests/periodic/orbit/steady_state.hpp"

namespace waveform_coverage_test {

using namespace orbid;
using namespace orbid::tests;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

TEST_CASE("intervals of waveforms with autoregressive errors cover", "[periodic][waveform]") {
    constexpr int replicates = 16;
    constexpr double sd = 0.02, correlation = 0.6, phase = 0.7, offset = 0.1;
    const std::shared_ptr<const models::System> system = models::make_system("duffing", "");
    const Eigen::Vector3d truth(0.3, 1.0, 1.0);
    periodic::WaveformOptions options;
    options.channels = channels_of(*system, {"x"});
    options.channels[0].distribution = estimator::AutoregressiveErrors{};
    options.start = Eigen::Vector3d(0.4, 1.2, 0.8);
    options.flow = {1e-9, 1e-9, 100000};  // far below the errors, in half the time
    const VectorXd times = VectorXd::LinSpaced(80, 0.0, 20.0);
    std::vector<periodic::WaveformRecord> clean;
    for (const double omega : {0.8, 1.1, 1.4}) {
        const VectorXd values =
            with_values(*system, {{"delta", 0.3}, {"alpha", 1.0}, {"beta", 1.0}, {"gamma", 0.5}, {"omega", omega}});
        const auto binding = estimated(*system, values, {"delta", "alpha", "beta"});
        const MatrixXd y = steady_readings(*system, values, Eigen::Vector2d(0.0, 0.0), {}, times, phase, 200.0);
        clean.push_back(record_of(binding, times, y, options.channels));
        clean.back().offsets = {{true, 0.0}};
    }
    std::vector<estimator::FreeParameter> parameters(3);
    const char* names[] = {"delta", "alpha", "beta"};
    for (std::size_t i = 0; i < 3; ++i) {
        parameters[i].name = names[i];
        parameters[i].start = options.start(static_cast<Index>(i));
        parameters[i].scale = estimator::Scale::log;
        parameters[i].lower = 0.0;
    }

    // Parameters, then sd and correlation of the errors.
    Eigen::Array<double, 5, 1> covered = Eigen::Array<double, 5, 1>::Zero();
    double sum_sd = 0.0, sum_correlation = 0.0, phases = 0.0, offsets = 0.0;
    for (int r = 0; r < replicates; ++r) {
        std::vector<periodic::WaveformRecord> records = clean;
        for (std::size_t b = 0; b < records.size(); ++b) {
            estimator::RandomStream stream(static_cast<std::uint64_t>(r), estimator::RandomPurpose::reading_noise, b);
            double e = 0.0;
            for (Index k = 0; k < times.size(); ++k) {
                const double fresh = sd * stream.normal();
                e = k == 0 ? fresh : correlation * e + std::sqrt(1.0 - correlation * correlation) * fresh;
                records[b].values(0, k) += offset + e;
            }
        }
        periodic::WaveformResidual residual(system, records, options);
        const auto result = estimator::estimate(parameters, {&residual});
        CAPTURE(r, result.message);
        REQUIRE(result.status == estimator::EstimateStatus::converged);
        const auto holds = [](const auto& of, double value) { return of.lower95 <= value && value <= of.upper95; };
        for (std::size_t i = 0; i < 3; ++i)
            covered[static_cast<Index>(i)] += holds(result.parameters[i], truth(static_cast<Index>(i))) ? 1.0 : 0.0;
        const estimator::EstimatedScale& scale = result.scales[0];
        covered[3] += holds(scale, sd) ? 1.0 : 0.0;
        covered[4] += holds(scale.shape[0], correlation) ? 1.0 : 0.0;
        sum_sd += scale.value;
        sum_correlation += scale.shape[0].value;
        for (std::size_t b = 0; b < records.size(); ++b) {
            const double error = models::wrapped(result.latents[0][b](0) - phase);
            phases += std::abs(error) <= 1.96 * result.latent_sds[0][b](0) ? 1.0 : 0.0;
            offsets += std::abs(result.latents[0][b](1) - offset) <= 1.96 * result.latent_sds[0][b](1) ? 1.0 : 0.0;
        }
    }
    CAPTURE(covered.transpose(), sum_sd / replicates, sum_correlation / replicates, phases, offsets);
    // 15.2 are expected, binomial sd 0.87; three of them below are 12.6. Of fifty 50, 49, 48, 48 and 49 do.
    for (Index i = 0; i < 5; ++i)
        CHECK(covered[i] >= 13.0);
    // 240 readings: the sd is uncertain by 6 % and the correlation by 0.05 in one replicate, a quarter of that in the
    // mean; four of these, and the bias of first order.
    CHECK(std::abs(sum_sd / replicates / sd - 1.0) < 0.07);
    CHECK(std::abs(sum_correlation / replicates - correlation) < 0.06);
    // Of 48 phases and offsets each 45.6, sd 1.5, but three of one replicate share parameters: four sds below.
    CHECK(phases >= 40.0);
    CHECK(offsets >= 40.0);
}

}  // namespace waveform_coverage_test
