#include <oneapi/tbb/parallel_for.h>

#include <numbers>
#include <vector>

#include "estimator/interface/random_stream.hpp"
#include "orbits/simulation/return_probe.hpp"
#include "orbits/simulation/virtual_experiment.hpp"

namespace orbid::orbits {

Eigen::MatrixXd probe_starts(const models::System& system, const Eigen::VectorXd& half, std::uint64_t seed) {
    Eigen::MatrixXd starts(system.dimension(), probe_count);
    for (Eigen::Index p = 0; p < probe_count; ++p) {
        estimator::RandomStream stream(seed, estimator::RandomPurpose::range_probe, static_cast<std::uint64_t>(p));
        for (Eigen::Index i = 0; i < starts.rows(); ++i) {
            const bool angle = system.coordinates()[static_cast<std::size_t>(i)].angle;
            starts(i, p) =
                angle ? stream.uniform(-std::numbers::pi, std::numbers::pi) : stream.uniform(-half[i], half[i]);
        }
    }
    return starts;
}

Eigen::VectorXd typical_range(const models::System& system, const Eigen::VectorXd& theta, double phase, double duration,
                              std::uint64_t seed, const models::FlowOptions& flow) {
    constexpr std::size_t periods = 64;
    constexpr std::size_t looks = 256;  // instants at which a system without sections is looked at
    const Eigen::Index n = system.dimension();
    const Eigen::MatrixXd starts = probe_starts(system, Eigen::VectorXd::Ones(n), seed);
    Eigen::VectorXd range = Eigen::VectorXd::Zero(n);
    if (system.kind() == models::Kind::autonomous) {
        std::vector<double> durations(looks);
        for (std::size_t k = 0; k < looks; ++k)
            durations[k] = duration * static_cast<double>(k) / (looks - 1);
        std::vector<Eigen::VectorXd> reached(probe_count, Eigen::VectorXd::Zero(n));
        oneapi::tbb::parallel_for(Eigen::Index{0}, probe_count, [&](Eigen::Index p) {
            const auto result = system.flow(starts.col(p), phase, durations, theta, models::Clock::time, flow);
            if (result.status == models::FlowStatus::ok) {
                reached[static_cast<std::size_t>(p)] = result.states.cwiseAbs().rowwise().maxCoeff();
            }
        });
        for (const auto& values : reached)
            range = range.cwiseMax(values);
    } else {
        const auto result = system.ensemble(starts, phase, periods, theta, flow);
        for (std::size_t p = 0; p < result.sections.size(); ++p) {
            if (result.status[p] != models::FlowStatus::ok) continue;
            range = range.cwiseMax(result.sections[p].cwiseAbs().rowwise().maxCoeff());
        }
    }
    for (Eigen::Index i = 0; i < n; ++i) {
        if (system.coordinates()[static_cast<std::size_t>(i)].angle) range[i] = std::numbers::pi;
        if (!(range[i] > 0.0)) range[i] = 1.0;
    }
    return range;
}

}  // namespace orbid::orbits
